"""The tables of what schemes and histories take stand in the pages, up to the orders they say."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from cases import SCHEMES

import hereditary as hd

ROOT = Path(__file__).parent.parent
_SPEC = importlib.util.spec_from_file_location(
    "capabilities", ROOT / "convergence" / "capabilities.py"
)
tables = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(tables)

MESH = hd.graded(100, 2.0)


def equation(*orders):
    """Sum of terms of these orders; y'(0) where one exceeds 1."""
    y0 = 1.0 if max(orders) <= 1 else [1.0, 0.0]
    return hd.Equation([hd.Caputo(alpha) for alpha in orders], lambda t, y: -y, y0)


def taken(problem, scheme, mesh=None):
    """Whether a run is made; False where it is refused with a ValueError."""
    if isinstance(scheme, hd.IMEX):
        problem = problem.replace(rhs=lambda t, y: -0.5 * y, linear=-0.5 * np.eye(problem.d))
    how = {"n_steps": 200} if mesh is None else {"mesh": mesh}
    how = {} if isinstance(scheme, hd.Collocation) else how
    try:
        return hd.solve(problem, 0.5, scheme=scheme, **how).success
    except ValueError:
        return False


def reached(cell, high, run):
    """Hold a cell with "yes", "no" or "up to order ..." to runs at orders below and above."""
    highest = {"yes": high, "no": 0.0}.get(cell) if "order" not in cell else float(cell.split()[-1])
    for order in (0.3, 0.6, 1.0, 1.05, 1.3, 1.6, 2.0):
        if order <= high:
            assert run(order) == (order <= highest), order


@pytest.mark.parametrize("path", tables.tables(), ids=lambda path: path.name)
def test_the_pages_hold_the_tables(path):
    assert path.read_text() == tables.page(path, tables.tables()[path])


def test_every_scheme_and_history_has_a_row():
    public = [getattr(hd, name) for name in hd.__all__]
    named = {type(each) for each in (*SCHEMES, *tables.HISTORIES)}
    assert named == {each for each in public if is_described(each)}


def is_described(each):
    return isinstance(each, type) and hasattr(each, "takes_meshes")


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_orders_end_where_the_cells_say(scheme):
    """Other abilities are the first law of tests/test_laws_of_runs.py."""
    cells = tables.scheme_cells(scheme)
    low, high = scheme.orders
    assert cells[tables.ORDERS] == f"({low:g}, {high:g}]"
    for order in (low + 0.1, high, min(2.0, high + 0.01)):
        assert taken(equation(order), scheme) == (order <= high), order
    reached(cells[tables.SEVERAL], high, lambda order: taken(equation(order, order / 2), scheme))
    if not isinstance(scheme, hd.Collocation):
        reached(cells[tables.MESHES], high, lambda order: taken(equation(order), scheme, MESH))
