"""The house: files and functions stay small, no import is hidden."""

import ast
import io
import re
import tokenize
from functools import cache
from pathlib import Path

import pytest
from decorators import DECORATORS

SOURCE = Path(__file__).parent.parent / "src" / "hereditary"
# Imported inside functions, since it takes long and few runs need it.
DEFERRED = {"scipy.interpolate", "scipy.linalg", "scipy.optimize", "scipy.signal"}
GALLERY = SOURCE.parents[1] / "docs" / "gallery"
# What a message must not say in place of the value that arrived.
VAGUE = {"another", "both", "int", "it", "neither", "none", "one", "others", "some"}
FILES = {path: path.read_text() for path in sorted(SOURCE.rglob("*.py"))}


@cache
def trees():
    return {str(path.relative_to(SOURCE)): ast.parse(text) for path, text in FILES.items()}


@cache
def nodes():
    return [(path, node) for path, tree in trees().items() for node in ast.walk(tree)]


def test_files_and_functions_are_small():
    assert not [path for path, text in FILES.items() if text.count("\n") > 800]
    for path, node in nodes():
        if isinstance(node, ast.FunctionDef):
            body = node.body[1:] if ast.get_docstring(node) else node.body
            if body:
                assert node.end_lineno - body[0].lineno - nested(node) < 80, (path, node.name)
            inner = [n for n in ast.walk(node) if isinstance(n, (ast.Import, ast.ImportFrom))]
            hidden = [n for n in inner if getattr(n, "module", None) not in DEFERRED]
            assert not hidden, f"{path}: {node.name} imports"


# Most lines of code of each room, without docstrings, comments and blank lines. They only fall: who
# needs lines takes them from the same room.
BUDGETS = {
    "collocation": 5585,
    "given": 3628,
    "solver": 2620,
    "analysis": 2363,
    "compiled": 2212,
    "top": 1780,
    "equation": 1663,
    "kernels": 1498,
    "functions": 888,
    "paper": 688,
    "scenes": 639,
    "stepping": 510,
    "support": 367,
    "plots": 348,
}
# What stands in a line without making it a line of code.
EMPTY = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE}
EMPTY |= {tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


def test_each_room_keeps_to_its_budget():
    """A room that has become smaller lowers its budget."""
    sizes = dict.fromkeys(BUDGETS, 0)
    for path, text in FILES.items():
        place = path.relative_to(SOURCE).parts
        sizes[place[0] if len(place) > 1 else "top"] += len(lines_of_code(text))
    over = {room: n for room, n in sizes.items() if n > BUDGETS[room]}
    assert not over
    assert sum(BUDGETS.values()) - sum(sizes.values()) < 150, sizes


def lines_of_code(text):
    """The numbers of the lines that have code."""
    found = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in EMPTY:
            found.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        for part in node.body if isinstance(getattr(node, "body", None), list) else []:
            if isinstance(part, ast.Expr) and isinstance(part.value, ast.Constant):
                found.difference_update(range(part.lineno, part.end_lineno + 1))
    return found


def test_few_files_of_tests_import_inner_parts():
    """So that inner parts can change without their tests; the number only falls."""
    public = "exact|schemes|history|viscoelastic|__main__"
    inner = re.compile(rf"^\s*(from|import) hereditary\.(?!({public})\b)", re.MULTILINE)
    tests = Path(__file__).parent
    assert sum(bool(inner.search(path.read_text())) for path in tests.rglob("*.py")) <= 12


def decorators(node):
    """Return the names of the decorators of a function, or none."""
    found = getattr(node, "decorator_list", ())
    return {getattr(getattr(each, "func", each), "id", "") for each in found}


def test_compiled_functions_have_a_record_and_five_values_at_most():
    for path, node in nodes():
        if decorators(node) & DECORATORS:
            assert len(node.args.args) <= 6, (path, node.name)


def test_functions_that_python_calls_have_types():
    """Types of compiled functions are in their signatures and docstrings."""
    for path, tree in trees().items():
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        outer = {id(n) for f in functions for n in ast.walk(f) if n is not f}
        for node in functions:
            known = id(node) in outer or decorators(node) & DECORATORS
            assert known or path.startswith("compiled") or node.returns, (path, node.name)


def nested(node):
    """Lines of the functions that a function makes, which are counted by themselves."""
    inner = [n for n in node.body if isinstance(n, ast.FunctionDef)]
    return sum(n.end_lineno - n.lineno for n in inner)


def test_only_plots_and_the_command_line_import_matplotlib():
    using = [path for path, text in FILES.items() if "import matplotlib" in text]
    users = {path.relative_to(SOURCE) for path in using}
    assert {user.with_suffix("").parts[0] for user in users} == {"plots", "paper", "__main__"}


@pytest.mark.parametrize("path", sorted(GALLERY.glob("*.py")), ids=lambda p: p.stem)
def test_scripts_of_the_gallery_open_no_file_and_so_run_from_any_folder(path):
    """The site runs them from their own folder, where __file__ is not defined."""
    names = {
        getattr(node, "id", getattr(node, "attr", ""))
        for node in ast.walk(ast.parse(path.read_text()))
    }
    assert not names & {"Path", "open", "load", "loadtxt", "genfromtxt", "imread", "__file__"}


def test_numbers_of_the_gallery_are_those_of_the_study():
    tree = ast.parse((GALLERY / "lorenz_with_memory.py").read_text())
    shown = next(
        ast.literal_eval(n) for n in ast.walk(tree) if isinstance(n, ast.List) and len(n.elts) > 9
    )
    results = SOURCE.parents[1] / "convergence" / "results" / "restarting.csv"
    lines = [line.split(",") for line in results.read_text().splitlines()]
    study = {
        float(line[5]): float(line[6])
        for line in lines
        if line[:3] == ["trace", "0.99", "restart"] and line[4] == "0.02"
    }
    assert all(abs(study[t] - value) < 6e-4 for t, value in shown)


def test_the_way_of_a_call_names_functions_that_are_there():
    page = (SOURCE.parents[1] / "docs" / "architecture.md").read_text()
    ways = re.findall(r"^\| \d+ \| `([\w/]+\.py)` \| ([^|]+) \|", page, re.M)
    assert len(ways) > 20
    for file, names in ways:
        tree = ast.parse((SOURCE / file).read_text())
        there = {node.name for node in ast.walk(tree) if hasattr(node, "name")}
        assert set(re.findall(r"`(\w+)`", names)) <= there, file


def test_messages_say_the_value_that_arrived():
    for path, node in nodes():
        called = getattr(node, "func", None)
        if getattr(called, "id", getattr(called, "attr", "")) in ("complaint", "refuse"):
            got = getattr(node.args[2], "value", None) if len(node.args) > 2 else None
            assert got not in VAGUE, (path, node.lineno)


# Names that users reach by their module, and a figure named after what it draws.
BY_MODULE = {"relaxation", "oscillator", "fit", "frequency_response"}


def in_several_files(pattern, place=Path, kinds=ast.Assign | ast.AnnAssign):
    """Return the names that match a pattern and are defined in several modules, by their places."""
    places = {}
    for path, tree in trees().items():
        for node in tree.body:
            names = [getattr(node, "name", "")]
            for target in getattr(node, "targets", [getattr(node, "target", node)]):
                stored = ast.walk(target) if isinstance(node, kinds) else ()
                names += [each.id for each in stored if isinstance(each, ast.Name)]
            for name in filter(re.compile(pattern).fullmatch, names):
                places.setdefault(name, set()).add(place(path))
    return {name for name, where in places.items() if len(where) > 1}


def test_no_public_name_is_defined_twice():
    """Files of one name, in several rooms, count as one."""
    assert in_several_files(r"[^_]\w*", lambda path: Path(path).name, ast.Assign) == BY_MODULE


def test_the_name_of_a_private_constant_stands_in_one_file():
    """So that it says which quantity it is; letters of type variables are shared."""
    assert in_several_files(r"_[A-Z0-9_]{2,}") == set()


def test_each_constant_has_a_line():
    for path, tree in trees().items():
        for node in tree.body:
            if isinstance(node, ast.Assign):
                both = node.targets[0], node.value
                assert not all(isinstance(each, ast.Tuple) for each in both), (path, node.lineno)


# Words that prose must not use in a sense of its own, and that names must not either.
BANNED = {"told", "begun", "pace", "Pace", "PACE", "STRETCH"}


def test_names_are_no_banned_words():
    for path, node in nodes():
        names = {getattr(node, field, None) for field in ("id", "arg", "name", "attr")}
        found = {name for name in names if isinstance(name, str)} & BANNED
        assert not found, (path, node.lineno)
