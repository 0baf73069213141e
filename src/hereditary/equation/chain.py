"""Rewrite equations with orders above 2 or matrix coefficients as systems without either.

Matrices. ``sum_l C_l D^(gamma_l) y = f(t, y)`` with matrices C_l is solved for the highest
derivative of each component. Let A be the matrix whose column j is the column j of that C_l which
multiplies the highest derivative of y_j. Without these columns in C_l the equation becomes
``D^alpha y + sum_l A^-1 C_l D^(gamma_l) y = A^-1 f``. In row j terms of y_j stay on the left side.
Terms of other components become memory that the right-hand side reads.

Orders above 2. Let the highest order alpha be in (n - 1, n] with n > 2. The components are y_0 = y
and derivatives up to y_(n-1), with ``y_k' = y_(k+1)`` for k < n - 1. The equation of y_(n-1) has
the order ``alpha - n + 1``. A term of order gamma is y_k if gamma = k < n. Otherwise it is the
derivative of order ``gamma - k`` of y_k, where k is the largest integer below gamma. Derivatives of
y_(n-1) stay on the left side. Derivatives of other components become memory that the right-hand
side reads.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..compiled.functions import Functions, mapped
from ..support.checks import refuse, shown
from ..support.scaling import condition, inverse
from .orders import merged_orders
from .system import System, leading_orders
from .terms import ConstantOrder, Operator, SystemTerm

# Largest condition number of the matrix in front of the highest derivatives; larger ones are
# refused.
_MAX_CONDITION_NUMBER = 1e12


class Entry(NamedTuple):
    """One term of the equation in `row`: a coefficient times an operator on y_column."""

    operator: Operator
    row: int
    column: int
    coefficient: float


def _summed(left: Iterable[SystemTerm]) -> list[SystemTerm]:
    """Return the terms with the coefficients of equal operators added up, without zero terms."""
    sums: dict[Any, SystemTerm] = {}
    for operator, c in left:
        known = sums.get(operator)
        sums[operator] = SystemTerm(operator, c if known is None else known.coefficients + c)
    return [term for term in sums.values() if np.any(term.coefficients)]


def _solved(left: Sequence[SystemTerm], d: int) -> tuple[list[Entry], np.ndarray | None]:
    """Return the terms of d equations solved for the highest derivatives, and a matrix or None."""
    # the matrix is A^-1 of the module's docstring, which multiplies f
    where = "beside orders above 2 and coefficients that are matrices"
    for operator, _ in left:
        if operator.lower(0) is None:
            required = f"be Caputo operators of constant order, or kernels, {where}"
            remedy = operator.definition.instead if left[0].coefficients.ndim == 2 else ""
            refuse("terms", required, f"{operator}", remedy)
    before = _highest_of_caputo(left, d)
    left = _summed(left)
    highest = _highest_of_caputo(left, d)
    if not len(left) or np.any(np.ceil(highest) < np.ceil(before)):
        refuse("terms", "leave a nonzero coefficient before the highest order", "terms that cancel")
    if np.any(leading_orders(left, d) > highest):
        required = f"have a Caputo operator of the highest order in each component {where}"
        refuse("terms", required, " and ".join(f"{operator}" for operator, _ in left))
    if left[0].coefficients.ndim == 1:
        pairs = [(o, j, c[j]) for o, c in left for j in np.flatnonzero(c).tolist()]
        return [Entry(operator, j, j, float(c)) for operator, j, c in pairs], None
    at_top = [(matrix, op.constant & (op.order == highest)) for op, matrix in left]
    leading = np.sum([np.where(top, matrix, 0.0) for matrix, top in at_top], axis=0)
    if condition(leading) > _MAX_CONDITION_NUMBER:
        required = "have an invertible matrix in front of the highest derivatives"
        refuse("terms", required, shown(leading))
    of_f = inverse(leading)
    entries = [Entry(ConstantOrder(float(highest[j])), j, j, 1.0) for j in range(d)]
    for (operator, matrix), (_, top) in zip(left, at_top, strict=True):
        below = of_f @ np.where(top, 0.0, matrix)
        places = np.argwhere(below).tolist()
        entries += [Entry(operator, j, k, float(below[j, k])) for j, k in places]
    return entries, of_f


def _highest_of_caputo(left: Iterable[SystemTerm], d: int) -> np.ndarray:
    """Return for each of d components the highest order of its Caputo operators; 0 for none."""
    return leading_orders([term for term in left if term.operator.constant], d)


class Chained(NamedTuple):
    """System of an equation with orders above 2 or matrices, and which components are y'."""

    system: System
    speeds: np.ndarray  # (d,), the component that is y' of each, -1 for none; empty if none is any


def chained(left: Sequence[SystemTerm], y0: np.ndarray, functions: Functions) -> Chained:
    """Return the system of an equation with orders above 2 or matrices, as `Chained`."""
    # coefficients (d,), or all (d, d) with a row for each equation; y0 (m, d), m = ceil(order)
    d, above = y0.shape[1], len(y0) > 2
    if not above and np.any([c.any(axis=1) for _, c in left], axis=0).sum() < d:
        return _with_algebraic_rows(_summed(left), y0, functions)
    entries, inverse = _solved(left, d)
    lengths = np.ceil(leading_orders(left, d)).astype(int).tolist() if above else [1] * d
    # (j, k) is the k-th derivative of y_j: y comes first, then y', and so on
    pairs = [(j, k) for k in range(max(lengths)) for j in range(d) if k < lengths[j]]
    places = {pair: place for place, pair in enumerate(pairs)}
    last = [places[j, length - 1] for j, length in enumerate(lengths)]
    links = [(places[j, k - 1], places[j, k], 1.0) for j, k in pairs if k > 0]
    own: list[tuple[Any, int, float]] = []
    lower, memory = list(links), dict[tuple[Any, int], int]()
    for operator, row, column, c in entries:
        k = max(min(operator.derivative, lengths[column]) - 1, 0)
        of_last = operator.lower(k)
        if row == column and places[column, k] == last[column]:
            own.append((of_last, last[column], c))
            continue
        place = places.get((column, k + 1)) if of_last == ConstantOrder(1.0) else None
        if place is None:
            key = of_last, places[column, k]
            place = memory.setdefault(key, len(places) + len(memory))
        lower.append((last[row], place, -c))
    own += [(ConstantOrder(1.0), place, 1.0) for place, _, _ in links]
    before = [(last[j], j, 1.0) for j in range(d)]
    if inverse is not None:
        before = [(last[i], j, float(inverse[i, j])) for i, j in np.argwhere(inverse).tolist()]
    size = len(places) + len(memory)
    functions = mapped(functions, size, d, lower, before)
    start = np.array([[y0[k, j] for j, k in pairs]]) if above else y0
    speeds = np.array([places.get((j, 1), -1) for j in range(d)] if above else [], dtype=np.int64)
    of_y = np.array([j for j, _ in pairs], dtype=np.int64)
    found = [*own, *((operator, place, 1.0) for (operator, _), place in memory.items())]
    sources = np.append(np.arange(len(pairs)), [s for _, s in memory]).astype(np.int64)
    left = left_of(found, size)
    system = System(
        left, np.take(start, sources, axis=1), functions, None, sources, of_y=of_y[sources]
    )
    return Chained(system, speeds)


def _with_algebraic_rows(
    left: Sequence[SystemTerm], y0: np.ndarray, functions: Functions
) -> Chained:
    """Return the system of ``C D^alpha y = f``, where rows of C are 0, as `Chained`."""
    # The components are y and, for each nonzero row c of C, a further component z = c y. The
    # equation of z is D^alpha z = f_c, with the same row of f. The equations of y are algebraic:
    # z = c y for the nonzero rows, and 0 = f for the others.
    d = y0.shape[1]
    rows = np.flatnonzero(left[0].coefficients.any(axis=1)).tolist() if left else []
    matrix = left[0].coefficients[rows] if left else np.zeros((0, d))
    order = left[0].operator.order if len(left) == 1 and left[0].operator.constant else np.inf
    if order > 1 or left[0].operator.lower(0) is None:
        required = "be one Caputo operator of order up to 1, where rows of its matrix are 0"
        remedy = "give each element a component of its own, with coefficients of shape (d,)"
        refuse("terms", required, " and ".join(f"{operator}" for operator, _ in left), remedy)
    if condition(matrix) > _MAX_CONDITION_NUMBER:
        required = "have independent rows besides those of zeros in front of the derivatives"
        refuse("terms", required, shown(left[0].coefficients), "combine dependent rows to zeros")
    size = d + len(rows)
    more, parts = range(d, size), matrix.tolist()
    own = [(i, j, -c) for i, part in zip(rows, parts, strict=True) for j, c in enumerate(part)]
    own += [(i, place, 1.0) for i, place in zip(rows, more, strict=True)]
    before = [(i, i, 1.0) for i in range(d) if i not in rows]
    before += [(place, i, 1.0) for i, place in zip(rows, more, strict=True)]
    read = [(i, i, 1.0) for i in range(d)]
    functions = mapped(functions, size, d, own, before, read)
    start = np.hstack([y0[:1], y0[:1] @ matrix.T])
    of_y = np.append(np.arange(d), np.abs(matrix).argmax(axis=1))
    further = np.repeat([0, 1], [d, len(rows)])
    terms = [SystemTerm(ConstantOrder(order), further.astype(float))]
    system = System(terms, start, functions, of_y=of_y)
    return Chained(system, np.full(d, -1))


def left_of(found: Sequence[tuple[Any, int, float]], width: int) -> list[SystemTerm]:
    """List the terms of a system of `width` components from (operator, component, coefficient)."""
    sums: dict[Any, np.ndarray] = {}
    constant = [operator.order for operator, _, _ in found if operator.constant]
    orders = iter(merged_orders(np.array(constant)).tolist())
    for operator, place, c in found:
        if operator.constant:
            operator = ConstantOrder(next(orders))
        sums.setdefault(operator, np.zeros(width))[place] += c
    return [SystemTerm(operator, c) for operator, c in sums.items()]
