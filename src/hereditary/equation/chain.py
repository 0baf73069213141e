"""Equations of orders above 2, or with matrices as coefficients, as systems without either.

``sum_l C_l D^(gamma_l) y = f(t, y)`` with matrices C_l is solved for the highest derivative of each
component. Column j of a matrix A is that of the C_l in front of the highest derivative of y_j. The
other columns remain in C_l, and ``D^alpha y + sum_l A^-1 C_l D^(gamma_l) y = A^-1 f``. Equation j
has terms of y_j on the left side. Terms of other components are memory that the right-hand side
reads.

Let the highest order alpha be in (n - 1, n] with n > 2. The components are y_0 = y and derivatives
up to y_(n-1), with ``y_k' = y_(k+1)`` for k < n - 1. The last one has an equation of order
``alpha - n + 1``. A term of order gamma is y_k if gamma = k < n. Otherwise it is the derivative of
order ``gamma - k`` of y_k, where k is the largest integer below gamma. Derivatives of the last
component are on the left side; other ones are memory that the right-hand side reads.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..support.checks import refuse, shown
from .affine import affine
from .orders import merged_orders
from .system import System, leading_orders
from .terms import ConstantOrder, SystemTerm

# Largest condition number of the matrix in front of the highest derivatives that is not refused.
_SINGULAR = 1e12


class Entry(NamedTuple):
    """Term ``coefficient D^order y_column`` of one equation, `row`."""

    order: float
    row: int
    column: int
    coefficient: float


def _summed(left: Iterable[SystemTerm]) -> list[SystemTerm]:
    """Add up the terms of equal order."""
    sums: dict[float, SystemTerm] = {}
    for operator, c in left:
        known = sums.get(operator.order)
        sums[operator.order] = SystemTerm(operator, c if known is None else known.coefficients + c)
    return [term for term in sums.values() if np.any(term.coefficients)]


def _solved(left: Sequence[SystemTerm], d: int) -> tuple[list[Entry], np.ndarray | None]:
    """Return the terms solved for the highest derivatives, and the matrix in front of f or None."""
    for operator, _ in left:
        if not operator.constant or operator.from_zero:
            required = (
                "be Caputo operators of constant order beside orders above 2 and coefficients that "
                "are matrices"
            )
            refuse("terms", required, f"{operator}")
    before = leading_orders(left, d)
    left = _summed(left)
    if not len(left) or np.any(np.ceil(leading_orders(left, d)) < np.ceil(before)):
        refuse("terms", "leave a nonzero coefficient before the highest order", "terms that cancel")
    if left[0].coefficients.ndim == 1:
        pairs = [(o.order, j, c[j]) for o, c in left for j in np.flatnonzero(c).tolist()]
        return [Entry(order, j, j, float(c)) for order, j, c in pairs], None
    highest = leading_orders(left, d)
    at_top = [(matrix, operator.order == highest) for operator, matrix in left]
    leading = sum(np.where(top, matrix, 0.0) for matrix, top in at_top)
    if np.linalg.cond(leading) > _SINGULAR:
        required = "have an invertible matrix in front of the highest derivatives"
        refuse("terms", required, shown(leading))
    inverse = np.linalg.inv(leading)
    entries = [Entry(float(highest[j]), j, j, 1.0) for j in range(d)]
    for (operator, matrix), (_, top) in zip(left, at_top, strict=True):
        below = inverse @ np.where(top, 0.0, matrix)
        entries += [
            Entry(operator.order, j, k, float(below[j, k])) for j, k in np.argwhere(below).tolist()
        ]
    return entries, inverse


class Chained(NamedTuple):
    """System of an equation with orders above 2 or matrices, and where y' is.

    `speeds` (d,) has the number of the component that is y', -1 for none; (0,) where derivatives
    are no components.
    """

    system: System
    speeds: np.ndarray


def chained(
    left: Sequence[SystemTerm], y0: np.ndarray, params: np.ndarray, rhs: Any, jac: Any
) -> Chained:
    """Return the system of an equation with orders above 2 or matrices, as `Chained`.

    Parameters
    ----------
    left : list of SystemTerm
        Coefficients are of shape (d,), or all (d, d), a row for each equation.
    y0 : ndarray, shape (m, d)
    params, rhs, jac
        Those of a `System`.
    """
    d, above = y0.shape[1], len(y0) > 2
    entries, inverse = _solved(left, d)
    lengths = np.ceil(leading_orders(left, d)).astype(int).tolist() if above else [1] * d
    # (j, k) is the k-th derivative of y_j: y comes first, then y', and so on
    pairs = [(j, k) for k in range(max(lengths)) for j in range(d) if k < lengths[j]]
    places = {pair: place for place, pair in enumerate(pairs)}
    last = [places[j, length - 1] for j, length in enumerate(lengths)]
    links = [(places[j, k - 1], places[j, k], 1.0) for j, k in pairs if k > 0]
    own: list[tuple[float, int, float]] = []
    lower, memory = list(links), dict[tuple[float, int], int]()
    for order, row, column, c in entries:
        k = min(math.ceil(order), lengths[column]) - 1
        if row == column and places[column, k] == last[column]:
            own.append((order - k, last[column], c))
            continue
        place = places.get((column, k + 1)) if order == k + 1 else None
        if place is None:
            key = order - k, places[column, k]
            place = memory.setdefault(key, len(places) + len(memory))
        lower.append((last[row], place, -c))
    own += [(1.0, place, 1.0) for place, _, _ in links]
    before = [(last[j], j, 1.0) for j in range(d)]
    if inverse is not None:
        before = [(last[i], j, float(inverse[i, j])) for i, j in np.argwhere(inverse).tolist()]
    size = len(places) + len(memory)
    params, rhs, jac = affine((params, rhs, jac), size, d, lower, before)
    start = np.array([[y0[k, j] for j, k in pairs]]) if above else y0
    speeds = np.array([places.get((j, 1), -1) for j in range(d)] if above else [], dtype=np.int64)
    of_y, quantities = np.array(pairs, dtype=np.int64).T.copy()
    found = [*own, *((order, place, 1.0) for (order, _), place in memory.items())]
    sources = np.append(np.arange(len(pairs)), [s for _, s in memory]).astype(np.int64)
    how = {"of_y": of_y[sources], "quantities": quantities[sources]}
    left = left_of(found, size)
    system = System(left, np.take(start, sources, axis=1), params, rhs, jac, sources, **how)
    return Chained(system, speeds)


def left_of(found: Iterable[tuple[float, int, float]], width: int) -> list[SystemTerm]:
    """List the terms of a system, given as (order, component, coefficient)."""
    sums: dict[float, np.ndarray] = {}
    orders = merged_orders(np.array([order for order, _, _ in found]))
    for order, (_, place, c) in zip(orders.tolist(), found, strict=True):
        sums.setdefault(order, np.zeros(width))[place] += c
    return [SystemTerm(ConstantOrder(order), c) for order, c in sums.items()]
