"""Tables of what schemes and histories accept, from their class attributes, in choosing.md.

Nothing is measured here: tests/test_capabilities.py makes a run for every cell. A full run writes
the tables between the marks of the page, a quick one compares them.
"""

import sys
from pathlib import Path

import hereditary as hd

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from cases import SCHEMES  # noqa: E402

MARKS = "<!-- capabilities -->\n", "<!-- /capabilities -->"
HISTORIES = [hd.SumOfExponentials(), hd.FFT(), hd.Direct()]
KERNELS, VARYING, MESHES = "`Memory` kernels", "varying orders", "meshes"
READS = "memory in `rhs`"
ORDERS, SEVERAL, DIFFER = "orders", "several terms", "terms differ by component"


def scheme_cells(scheme):
    """Abilities of a scheme and how far they go, in words."""
    low, high = scheme.orders
    return {
        ORDERS: f"({low:g}, {high:g}]",
        SEVERAL: _reach(scheme.several_terms, scheme.several_up_to, high),
        DIFFER: _word(scheme.components_differ),
        KERNELS: _word(scheme.takes_kernels),
        VARYING: _word(scheme.takes_varying),
        READS: _word(scheme.takes_memory),
        MESHES: "its own"
        if isinstance(scheme, hd.Collocation)
        else _reach(scheme.takes_meshes, scheme.meshes_up_to, high),
    }


def history_cells(history):
    """Abilities of a history, in words."""
    return {
        KERNELS: _word(history.takes_kernels),
        VARYING: _word(history.takes_varying),
        MESHES: _word(history.takes_meshes),
    }


def _word(takes):
    return "yes" if takes else "no"


def _reach(takes, highest, high):
    """Words for an ability that may end at a highest order."""
    return f"up to order {highest:g}" if takes and highest < high else _word(takes)


def _name(schemes):
    """Of a row, as one writes it; parameters where the row needs them."""
    first, *_, last = schemes + schemes
    if len({scheme.orders for scheme in schemes}) == 1:
        has_default = "scheme" not in vars(first)
        return f"`{type(first).__name__}()`" if has_default else f"`{_written(first)}`"
    return f"`{_written(first)}` to `{_written(last)}`"


def _written(scheme):
    return repr(scheme).replace("scheme=", "")


def _alike():
    """Lists of schemes of one kind whose cells are equal but for the orders."""
    rows = {}
    for scheme in SCHEMES:
        cells = scheme_cells(scheme)
        key = type(scheme), *(value for name, value in cells.items() if name != ORDERS)
        rows.setdefault(key, []).append(scheme)
    return rows.values()


def _scheme_rows():
    """Name and cells of every row: schemes of one kind that differ in their orders alone.

    Cells in which they differ are joined.
    """
    for schemes in _alike():
        columns = [scheme_cells(scheme) for scheme in schemes]
        yield (
            _name(schemes),
            {key: ", ".join(dict.fromkeys(c[key] for c in columns)) for key in columns[0]},
        )


def _history_rows():
    for history in HISTORIES:
        yield f"`{type(history).__name__}()`", history_cells(history)


def _table(head, rows, columns):
    """Markdown table of rows of (name, cells)."""
    lines = [f"| {' | '.join([head, *columns])} |", "|---" * (1 + len(columns)) + "|"]
    lines += [f"| {' | '.join([name, *(cells[key] for key in columns)])} |" for name, cells in rows]
    return "\n".join(lines) + "\n"


def tables():
    """The text between the marks of each page."""
    table = _table("scheme", _scheme_rows(), list(scheme_cells(hd.L1())))
    table += "\n" + _table("history", _history_rows(), list(history_cells(hd.FFT())))
    return {ROOT / "docs" / "choosing.md": table}


def page(path, table):
    """A page with the table between its marks."""
    before, rest = path.read_text().split(MARKS[0])
    return before + MARKS[0] + table + MARKS[1] + rest.split(MARKS[1])[1]


def main():
    stale = [path for path, table in tables().items() if path.read_text() != page(path, table)]
    for path, table in tables().items():
        print(path.name, table, sep="\n\n")
        if "--quick" not in sys.argv[1:]:
            path.write_text(page(path, table))
    if stale and "--quick" in sys.argv[1:]:
        raise SystemExit(f"tables are not as fields say: {', '.join(p.name for p in stale)}")


if __name__ == "__main__":
    main()
