"""Tables of parameters and initial values, a row for each member of an ensemble."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._checks import complaint, real_array, refuse_masked, shown
from ..equation import Equation

_NEITHER = "be given, params or y0 or both"


class Members(NamedTuple):
    """Members of an ensemble, E of them.

    params (E, p) and y0 (E, ...) as given, or None; inside (E, m, d), initial values of the
    components that are marched, or None where they are those of the equation.
    """

    size: int
    params: np.ndarray | None
    y0: np.ndarray | None
    inside: np.ndarray | None

    def equation(self, m, equation):
        """Return the equation of member m."""
        changes = {"params": self.params, "y0": self.y0}
        return equation.replace(**{name: v[m] for name, v in changes.items() if v is not None})


def members_of(equation: Equation, params, y0) -> Members:
    """Check the tables of an ensemble."""
    if params is None and y0 is None:
        raise TypeError(complaint("params", _NEITHER, "neither", "a row for each member"))
    numbers = None if params is None else _params(params, equation.params.size)
    values = None if y0 is None else _table("y0", y0, np.iscomplexobj(np.asarray(y0)))
    sizes = [len(table) for table in (numbers, values) if table is not None]
    if len(set(sizes)) > 1:
        got = f"{sizes[0]} rows of params and {sizes[1]} of y0"
        raise ValueError(complaint("params", "have as many rows as y0", got))
    inside = None if values is None else _inside(equation, values)
    return Members(sizes[0], numbers, values, inside)


def _table(name, given, is_complex=False):
    """Return an array with a row for each member."""
    refuse_masked(name, given)
    if is_complex:
        table = np.array(given, dtype=complex)
        for part in (table.real, table.imag):
            real_array(name, part)
    else:
        table = real_array(name, given)
    if table.ndim == 0 or len(table) == 0:
        required = "have a row for each member, one at least"
        raise ValueError(complaint(name, required, f"shape {table.shape}"))
    return table


def _params(given, p):
    """Return the table of parameters, (E, p)."""
    table = _table("params", given)
    if table.ndim == 1 and p == 1:
        table = table[:, None]
    if table.ndim != 2 or table.shape[1] != p:
        required = f"have shape (E, {p}), a row of the equation's parameters for each member"
        raise ValueError(complaint("params", required, f"shape {table.shape}"))
    return table


def _inside(equation, values):
    """Return the initial values of the components that are marched, (E, m, d)."""
    first = equation.replace(y0=values[0])  # which says what is wrong with them
    if first.d != equation.d:
        required = f"hold {equation.d} components, as the equation has"
        raise ValueError(complaint("y0", required, f"{first.d} in a row"))
    rearranged = equation.frame.paired or equation.frame.speeds
    if rearranged or equation._given_d is not None:
        rows = [first, *(equation.replace(y0=row) for row in values[1:])]
        return np.array([row.y0 for row in rows])
    inside = values.reshape(-1, *first.y0.shape)
    idle = equation.highest_orders() <= 1
    if equation.m == 2 and np.any(inside[:, 1, idle]):
        m = int(np.argmax(np.any(inside[:, 1, idle] != 0, axis=1)))
        required = "hold no y'(0) for components whose highest order is at most 1"
        raise ValueError(complaint(f"y0[{m}]", required, shown(values[m]), "set it to 0"))
    return inside
