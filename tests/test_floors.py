"""The house: imports go down only, files and functions stay small, no import is hidden."""

import ast
from pathlib import Path

import pytest

SOURCE = Path(__file__).parent.parent / "src" / "hereditary"
FLOORS = {
    "_warning": -2,
    "compiled.numba_internals": -1,
    "_cache": 0,
    "_jit": 0,
    "_checks": 0,
    "_complaints": 0,
    "_frozen": 0,
    "_digest": 0,
    "_optional": 0,
    "_machine": 0,
    "_html": 0,
    "compiled": 1,
    "special": 1,
    "_callables": 1,
    "_one_function": 1,
    "_python_calls": 0,
    "_trial": 0,
    "frame": 0,
    "formula": 0,
    "initial_values": 1,
    "rearranged": 1,
    "chain": 2,
    "_memory_argument": 1,
    "_differences": 1,
    "_structured": 1,
    "structure": 2,
    "superlu": 2,
    "memory_kernel": 1,
    "operators": 2,
    "orders": 2,
    "step_kernel": 2,
    "terms": 2,
    "equation": 2,
    "sides": 2,
    "system": 2,
    "exponential_sum": 2,
    "memory_kernels": 2,
    "meshes": 2,
    "schemes": 2,
    "history": 3,
    "solver.state": 4,
    "solver.identity": 4,
    "solver.dense": 4,
    "solver.status": 4,
    "solver.stops": 4,
    "collocation": 5,
    "solver": 6,
    "analysis": 7,
    "_ahead": 8,
    "scenes": 8,
    "plots": 8,
    "exact": 8,
    "paper": 8,
    "__main__": 8,
    "__init__": 9,
}
# Importable from the floor's other rooms; inside one floor the rest must not know each other.
SAME_FLOOR = {
    ("_jit", "_cache"),
    ("_cache", "_frozen"),
    ("_digest", "_frozen"),
    ("_callables", "_memory_argument"),
    ("_callables", "_structured"),
    ("_callables", "_one_function"),
    ("_one_function", "_memory_argument"),
    ("equation", "_one_function"),
    ("_structured", "compiled"),
    ("_differences", "compiled"),
    ("equation", "structure"),
    ("system", "structure"),
    ("__main__", "_ahead"),
    ("_python_calls", "_jit"),
    ("_python_calls", "_complaints"),
    ("_trial", "_checks"),
    ("_trial", "_complaints"),
    ("equation", "operators"),
    ("operators", "exponential_sum"),
    ("__main__", "plots"),
}
SAME_FLOOR |= {
    ("_complaints", "_checks"),
    ("equation", "orders"),
    ("equation", "sides"),
    ("equation", "chain"),
    ("chain", "orders"),
    ("chain", "system"),
    ("chain", "terms"),
    ("sides", "operators"),
    ("sides", "orders"),
    ("sides", "system"),
    ("sides", "terms"),
    ("operators", "terms"),
    ("system", "terms"),
    ("schemes", "terms"),
    ("schemes", "step_kernel"),
    ("terms", "orders"),
    ("terms", "step_kernel"),
    ("operators", "orders"),
    ("schemes", "orders"),
    ("equation", "system"),
    ("system", "exponential_sum"),
    ("memory_kernels", "exponential_sum"),
    ("schemes", "exponential_sum"),
    ("schemes", "system"),
    ("schemes", "operators"),
    ("__main__", "scenes"),
    ("__main__", "paper"),
    ("paper", "plots"),
    ("paper", "scenes"),
}
# The march on given steps, whose parts would take longer to be called than to be run.
LONGEST = {"march": 90}
# Imported inside functions, since it takes long and few runs need it.
DEFERRED = {"scipy.optimize"}
FILES = sorted(SOURCE.rglob("*.py"))


def place(*names):
    """A file's place: its room, or what it is by itself where it has a floor of its own."""
    own = ".".join(names[:2])
    return own if own in FLOORS else names[0]


def parts(path):
    return path.relative_to(SOURCE).with_suffix("").parts


def imported_places(path):
    """The package's own places that a file imports."""
    package = ("hereditary", *parts(path)[:-1])
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1]
            target = (*base, *(node.module.split(".") if node.module else ()))[1:]
            if len(target) < 2:  # modules may stand among the names
                yield from (place(*target, alias.name) for alias in node.names)
            else:
                yield place(*target)


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(SOURCE)))
def test_imports_go_down(path):
    here = place(*parts(path))
    for there in imported_places(path):
        if there != here and (here, there) not in SAME_FLOOR:
            assert FLOORS[there] < FLOORS[here], f"{here} must not import {there}"


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(SOURCE)))
def test_files_and_functions_are_small(path):
    text = path.read_text()
    assert text.count("\n") <= 800
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            body = node.body[1:] if ast.get_docstring(node) else node.body
            if body:
                longest = LONGEST.get(node.name, 80)
                assert node.end_lineno - body[0].lineno - nested(node) < longest, node.name
            inner = [n for n in ast.walk(node) if isinstance(n, (ast.Import, ast.ImportFrom))]
            hidden = [n for n in inner if getattr(n, "module", None) not in DEFERRED]
            assert not hidden, f"{node.name} imports"


def nested(node):
    """Lines of the functions that a function makes, which are counted by themselves."""
    inner = [n for n in node.body if isinstance(n, ast.FunctionDef)]
    return sum(n.end_lineno - n.lineno for n in inner)


def test_only_plots_and_the_command_line_import_matplotlib():
    users = {parts(path)[0] for path in FILES if "import matplotlib" in path.read_text()}
    assert users == {"plots", "paper", "__main__"}
