"""Pages on collocation: the names that they list are those of the code."""

import importlib
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


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
