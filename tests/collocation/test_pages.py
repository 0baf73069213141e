"""Pages on collocation: the names and the constants that they list are those of the code."""

import ast
import importlib
import re
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "hereditary"
FILES = [f"collocation/{path.stem}" for path in sorted((SOURCE / "collocation").glob("*.py"))]
FILES += ["compiled/reach", "stepping/tolerance"]
# Numbers that name a case, a place, a letter of LAPACK or the range of an argument.
CODES = {"FORCE", "PRIMARY", "POSITION", "SLOPE", "ITSELF", "ALGEBRAIC"}
CODES |= {"_WITHOUT", "_WITH", "_SCALING", "TOLERANCE_FLOOR", "_FARTHEST"}


def rows_of(page, heading):
    """Cells of the rows of tables in a section of a page, without the first two rows."""
    text = (ROOT / "docs" / page).read_text()
    section = re.search(rf"^(#+) {re.escape(heading)}$(.*?)(?=^#|\Z)", text, re.M | re.S)
    lines = [line for line in section.group(2).splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def test_names_of_the_method_are_in_the_files_named():
    rows = rows_of("theory.md", "In the code")
    assert len(rows) > 10
    for _, names, file in rows:
        module = importlib.import_module("hereditary." + file[:-3].replace("/", "."))
        for name in re.findall(r"`(\w+)`", names):
            assert module.__dict__[name].__module__ == module.__name__, (file, name)


def constants_of(file):
    """Names and values of the numeric constants of a file, and of tuples of numbers."""
    module = importlib.import_module("hereditary." + file.replace("/", "."))
    names = []
    for node in ast.parse((SOURCE / f"{file}.py").read_text()).body:
        if isinstance(node, ast.Assign) and not ast.unparse(node.value).startswith("range("):
            targets = node.targets[0]
            names += targets.elts if isinstance(targets, ast.Tuple) else [targets]
    found = {node.id: getattr(module, node.id) for node in names}
    return {k: v for k, v in found.items() if is_numeric(v) and k not in CODES}


def is_numeric(value):
    parts = value if type(value) is tuple else [value]
    return all(isinstance(part, (int, float, complex, np.ndarray)) for part in parts)


@pytest.mark.parametrize("file", FILES)
def test_the_page_lists_each_constant_with_its_value(file):
    known = constants_of(file)
    rows = rows_of("collocation_method.md", f"{file}.py") if known else []
    listed = {name.strip("`"): value.strip("`") for name, value, *_ in rows}
    assert list(listed) == list(known)
    for name, value in listed.items():
        given = eval(value, {"np": np})
        assert np.array_equal(given, known[name]), name
    assert all(len(row) == 4 and all(row) for row in rows)
