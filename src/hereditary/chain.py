"""Equations of orders above 2 as systems of orders up to 1, of y and its derivatives.

With leading order alpha in (n - 1, n], ``sum_l c_l D^(gamma_l) y = f(t, y)`` becomes ``y_k' =
y_(k+1)`` for k < n - 1, and an equation of order alpha - n + 1 for the last, y_(n-1). A term of
order gamma is y_k for gamma = k, and else the derivative of order gamma - k of y_k, k < gamma: one
of the last is on its left side, and others are memory that the right-hand side reads.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ._checks import complaint
from .orders import merged_orders
from .rearranged import Tables, rearranged
from .system import System, leading_orders
from .terms import ConstantOrder, SystemTerm


class Chain:
    """Components of the system: y, and derivatives behind it.

    Parameters
    ----------
    left : list of SystemTerm
        Terms of the equation, of constant orders.
    d : int
        Components of the equation.

    Attributes
    ----------
    size : int
    """

    def __init__(self, left, d):
        for operator, _ in left:
            if not operator.constant:
                required = "be Caputo operators of constant order beside orders above 2"
                raise ValueError(complaint("terms", required, f"{operator}"))
        self.lengths = np.ceil(leading_orders(left, d)).astype(int)
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

    def origins(self):
        """Return what the right-hand side of each component is; see `Tables`."""
        last = self.lengths - 1
        return [float(self.at(j, k + 1) if k < last[j] else -1 - j) for j, k in self._places]

    def sorted(self, left):
        """Sort the terms: on the left side, known components, and memory that is read.

        Returns
        -------
        own : list of (float, int, float)
            Order, component and coefficient.
        lower : list of (float, float, float)
            Equation, coefficient and component; see `Tables`.
        read : list of (float, int, float, int)
            Order, component, coefficient and equation.
        """
        own, lower, read = [], [], []
        for operator, coefficients in left:
            for j in np.flatnonzero(coefficients).tolist():
                c, k = float(coefficients[j]), math.ceil(operator.order) - 1
                order = operator.order - k
                if k == self.lengths[j] - 1:
                    own.append((order, self.at(j, k), c))
                elif order == 1.0:
                    lower.append((float(j), c, float(self.at(j, k + 1))))
                else:
                    read.append((order, self.at(j, k), c, j))
        last = self.lengths - 1
        own += [(1.0, place, 1.0) for (j, k), place in self._places.items() if k < last[j]]
        return own, lower, read


class Chained(NamedTuple):
    """System of an equation with orders above 2.

    system, which lacks right-hand side and Jacobian where some memory is read, and then enlarged,
    the same with that memory, or None; speeds (d,), component that is y', -1 for none.
    """

    system: System
    enlarged: System | None
    speeds: np.ndarray


def chained(left, y0, params, rhs, jac):
    """Return the system of an equation with orders above 2, as `Chained`.

    Parameters
    ----------
    left : list of SystemTerm
    y0 : ndarray, shape (m, d)
    params, rhs, jac
        As a `System` takes them.
    """
    d = y0.shape[1]
    chain = Chain(left, d)
    own, lower, read = chain.sorted(left)
    memory: dict[tuple[float, int], int] = {}
    for order, source, c, j in read:
        place = memory.setdefault((order, source), chain.size + len(memory))
        lower.append((float(j), c, float(place)))
    tables = Tables([], lower, chain.origins(), np.ones(d), d)
    params, rhs, jac = rearranged(tables, params, rhs, jac)
    start = chain.values(y0)[None]
    found = [*own, *((order, place, 1.0) for (order, _), place in memory.items())]
    wide = _left(found, chain.size + len(memory))
    if not memory:
        return Chained(System(wide, start, params, rhs, jac), None, chain.speeds())
    sources = np.append(np.arange(chain.size), [source for _, source in memory]).astype(np.int64)
    enlarged = System(wide, start[:, sources], params, rhs, jac, sources)
    narrow = [SystemTerm(operator, c[: chain.size]) for operator, c in wide]
    shown = [term for term in narrow if np.any(term.coefficients)]
    return Chained(System(shown, start, params, None), enlarged, chain.speeds())


def _left(found, width):
    """List the terms of a system from orders, components and coefficients."""
    sums: dict[float, np.ndarray] = {}
    orders = merged_orders(np.array([order for order, _, _ in found]))
    for order, (_, place, c) in zip(orders.tolist(), found, strict=True):
        sums.setdefault(order, np.zeros(width))[place] += c
    return [SystemTerm(ConstantOrder(order), c) for order, c in sums.items()]
