"""Equations of orders above 2, or with matrices as coefficients, as systems without.

``sum_l C_l D^(gamma_l) y = f(t, y)`` with matrices C_l is solved for the highest derivative of each
component: with A made of its columns of the C_l, ``D^alpha y + sum_l A^-1 C_l D^(gamma_l) y = A^-1
f``. Terms of other components than the equation's own are memory that the right-hand side reads.

Let the leading order alpha be in (n - 1, n] with n > 2. Then ``y_k' = y_(k+1)`` for k < n - 1, and
the last component y_(n-1) has an equation of order alpha - n + 1. A term of order gamma is y_k if
gamma = k. Otherwise it is the derivative of order gamma - k of y_k, k < gamma. Derivatives of the
last component are on the left side; other ones are memory that the right-hand side reads.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..support.checks import complaint, shown
from .affine import affine
from .orders import merged_orders
from .system import System, leading_orders
from .terms import ConstantOrder, SystemTerm

# Condition of the matrix in front of the highest derivatives from which on nothing is solved.
_SINGULAR = 1e12


class Entry(NamedTuple):
    """Term ``coefficient D^order y_column`` of one equation, `row`."""

    order: float
    row: int
    column: int
    coefficient: float


class Chain:
    """Components of the system: y, and derivatives behind it.

    Parameters
    ----------
    lengths : ndarray of int64, shape (d,)
        Components for each of y, itself and its derivatives.

    Attributes
    ----------
    size : int
    """

    def __init__(self, lengths):
        self.lengths = lengths
        self._places: dict[tuple[int, int], int] = {}
        for k in range(self.lengths.max()):
            for j in np.flatnonzero(self.lengths > k).tolist():
                self._places[j, k] = len(self._places)
        self.size = len(self._places)

    def at(self, j, k):
        """Return the number of the component that is the k-th derivative of y_j."""
        return self._places[j, k]

    def speeds(self):
        """Return the numbers of the first derivatives, (d,); -1 where there is none."""
        return np.array([self._places.get((j, 1), -1) for j in range(self.lengths.size)])

    def values(self, y0):
        """Return initial values of the system, (size,), from those of the equation, (m, d)."""
        return np.array([y0[k, j] for j, k in self._places])

    def last(self, j):
        """Return the number of the component that is the highest derivative of y_j."""
        return self.at(j, int(self.lengths[j]) - 1)

    def links(self):
        """List (component, its derivative, 1) where that is a component."""
        return [
            (place, self.at(j, k + 1), 1.0)
            for (j, k), place in self._places.items()
            if k < self.lengths[j] - 1
        ]

    def sorted(self, entries):
        """Sort the terms: on the left side, known components, and memory that is read.

        Returns
        -------
        own : list of (float, int, float)
            Order, component and coefficient.
        lower : list of (int, int, float)
            Component whose equation has another one on its left side, that one, and -coefficient.
        read : list of (float, int, float, int)
            Order, component, coefficient and equation.
        """
        own, lower, read = [], [], []
        for order, row, column, c in entries:
            last = self.lengths[column] - 1
            k = min(math.ceil(order) - 1, int(last))
            if row == column and k == last:
                own.append((order - k, self.at(column, k), c))
            elif order == k + 1 and k < last:
                lower.append((self.last(row), self.at(column, k + 1), -c))
            else:
                read.append((order - k, self.at(column, k), c, row))
        own += [(1.0, place, 1.0) for place, _, _ in self.links()]
        return own, lower, read


def _summed(left):
    """Add up the terms of equal order."""
    sums: dict[float, SystemTerm] = {}
    for operator, c in left:
        known = sums.get(operator.order)
        sums[operator.order] = SystemTerm(operator, c if known is None else known.coefficients + c)
    return [term for term in sums.values() if np.any(term.coefficients)]


def _solved(left, d):
    """List the terms, solved for the highest derivatives; and the matrix in front of f, or None."""
    for operator, _ in left:
        if not operator.constant or operator.from_zero:
            required = (
                "be Caputo operators of constant order beside orders above 2 and coefficients that "
                "are matrices"
            )
            raise ValueError(complaint("terms", required, f"{operator}"))
    before = leading_orders(left, d)
    left = _summed(left)
    if not len(left) or np.any(np.ceil(leading_orders(left, d)) < np.ceil(before)):
        required = "leave a nonzero coefficient before the highest order"
        raise ValueError(complaint("terms", required, "terms that cancel"))
    if left[0].coefficients.ndim == 1:
        pairs = [(o.order, j, c[j]) for o, c in left for j in np.flatnonzero(c).tolist()]
        return [Entry(order, j, j, float(c)) for order, j, c in pairs], None
    highest = leading_orders(left, d)
    at_top = [(matrix, operator.order == highest) for operator, matrix in left]
    leading = sum(np.where(top, matrix, 0.0) for matrix, top in at_top)
    if np.linalg.cond(leading) > _SINGULAR:
        required = "have an invertible matrix in front of the highest derivatives"
        raise ValueError(complaint("terms", required, shown(leading)))
    inverse = np.linalg.inv(leading)
    entries = [Entry(float(highest[j]), j, j, 1.0) for j in range(d)]
    for (operator, matrix), (_, top) in zip(left, at_top, strict=True):
        below = inverse @ np.where(top, 0.0, matrix)
        entries += [
            Entry(operator.order, j, k, float(below[j, k])) for j, k in np.argwhere(below).tolist()
        ]
    return entries, inverse


class Chained(NamedTuple):
    """System of an equation with orders above 2 or matrices.

    system, which lacks right-hand side and Jacobian where some memory is read, and then enlarged,
    the same with that memory, or None; speeds (d,), component that is y', -1 for none; (0,) where
    derivatives are no components.
    """

    system: System
    enlarged: System | None
    speeds: np.ndarray


def chained(left, y0, params, rhs, jac):
    """Return the system of an equation with orders above 2 or matrices, as `Chained`.

    Parameters
    ----------
    left : list of SystemTerm
        Coefficients are of shape (d,), or all (d, d), a row for each equation.
    y0 : ndarray, shape (m, d)
    params, rhs, jac
        As a `System` takes them.
    """
    d, above = y0.shape[1], len(y0) > 2
    entries, inverse = _solved(left, d)
    lengths = np.ceil(leading_orders(left, d)).astype(int) if above else np.ones(d, dtype=int)
    chain = Chain(lengths)
    own, lower, read = chain.sorted(entries)
    memory: dict[tuple[float, int], int] = {}
    for order, source, c, j in read:
        place = memory.setdefault((order, source), chain.size + len(memory))
        lower.append((chain.last(j), place, -c))
    before = [(j, j, 1.0) for j in range(d)]
    if inverse is not None:
        before = [(i, j, float(inverse[i, j])) for i, j in np.argwhere(inverse).tolist()]
    before = [(chain.last(i), j, c) for i, j, c in before]
    size = chain.size + len(memory)
    params, rhs, jac = affine((params, rhs, jac), size, d, [*chain.links(), *lower], before)
    start = chain.values(y0)[None] if above else y0
    speeds = chain.speeds() if above else np.zeros(0, dtype=np.int64)
    found = [*own, *((order, place, 1.0) for (order, _), place in memory.items())]
    wide = _left(found, size)
    if not memory:
        return Chained(System(wide, start, params, rhs, jac), None, speeds)
    sources = np.append(np.arange(chain.size), [source for _, source in memory]).astype(np.int64)
    enlarged = System(wide, start[:, sources], params, rhs, jac, sources)
    narrow = [SystemTerm(operator, c[: chain.size]) for operator, c in wide]
    own_terms = [term for term in narrow if np.any(term.coefficients)]
    return Chained(System(own_terms, start, params), enlarged, speeds)


def _left(found, width):
    """List the terms of a system from orders, components and coefficients."""
    sums: dict[float, np.ndarray] = {}
    orders = merged_orders(np.array([order for order, _, _ in found]))
    for order, (_, place, c) in zip(orders.tolist(), found, strict=True):
        sums.setdefault(order, np.zeros(width))[place] += c
    return [SystemTerm(ConstantOrder(order), c) for order, c in sums.items()]
