"""Equations as systems of weakly singular integral equations (floor 2).

With p = y for components of order up to 1 and p = y' above, every component becomes ``p = p(0) +
sum_k kappa_k J**a_k (q_k - o_k)``, 0 < a_k <= 1, where q is the right-hand side f, p, or y and o a
constant: with the highest term ``c D**alpha`` and q = f that is kappa = 1/c, a = alpha - m + 1; a
lower term ``c_j D**alpha_j`` brings kappa = -c_j/c and ``J**(alpha - alpha_j)`` of p, less p(0)
where it has as many derivatives, or ``J**(alpha - alpha_j - 1)`` of y - y(0) where that exceeds 1.

Terms with general kernels, or with orders that vary, have no such integrals: they are taken from
the right-hand side. Where the highest derivative stands in such terms, none is left to integrate
with: then p is what makes right-hand side and terms equal, with p' among what drives these.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .._checks import complaint
from ..kernels.collocation import FORCE, ITSELF, POSITION, PRIMARY, SLOPE
from ..kernels.structures import TERM
from ..orders import OrderFailed
from ..system import System
from ..terms import Operator

# No step is so small that its power below this tells it from another.
_LEAST = 5e-10
# Numbers closer than this are one; a sum of up to so many others is not taken for itself.
_APART, _FEW = 1e-9, 4


@dataclass(frozen=True)
class Form:
    """The system as weakly singular integral equations.

    Attributes
    ----------
    terms : recarray of `TERM`, shape (n,)
        Convolutions: row, integrand (kernels/collocation.py), index of the order or kernel, and
        coefficient kappa. Row c < d is p of component c, row d + c what is taken from its
        right-hand side. The index is -1 for the integrand itself.
    offset_of : ndarray of int64, shape (n,)
        What is taken from the driver: 0 nothing, 1 p(0), 2 y(0).
    orders : ndarray, shape (n_a,)
        Orders of integration in (0, 1], ascending; the last one is 1.
    second : ndarray of int64, shape (d,)
        Whether the primary unknown is y'.
    generators : tuple of float
        Numbers whose sums are the powers of t that f, p and y are made of near 0.
    implicit : ndarray of int64, shape (d,)
        Whether p is what makes right-hand side and terms equal; then no row c is listed.
    kernels : tuple of MemoryKernel
        General kernels; their indices follow those of the orders.
    varying : tuple of VaryingOrder
        Orders that vary; their indices follow those of the kernels.
    """

    terms: np.recarray
    offset_of: np.ndarray
    orders: np.ndarray
    second: np.ndarray
    generators: tuple[float, ...]
    implicit: np.ndarray
    kernels: tuple = ()
    varying: tuple = ()

    @cached_property
    def n_rows(self) -> int:
        """Rows: d, or 2 d where something is taken from right-hand sides."""
        d = self.second.size
        return d if self.terms.row.max() < d else 2 * d

    @cached_property
    def n_drivers(self) -> int:
        """Drivers that a step has values of."""
        return 4 if np.any(self.terms.integrand == SLOPE) else 3

    @cached_property
    def raw(self) -> np.ndarray:
        """Drivers of orders that vary, whose modes are kept without weights; ascending."""
        first = self.orders.size + len(self.kernels)
        return np.unique(self.terms.integrand[self.terms.index >= first])

    def start_exponent(self, t: float = 0.0) -> float:
        """The least power of the time since t with which p changes after a corner there."""
        d, found = self.second.size, []
        for c in range(d):
            driver = SLOPE if self.implicit[c] else FORCE
            own = (self.terms.row % d == c) & (self.terms.integrand == driver)
            powers = [self._power(k, driver, t) for k in self.terms.index[own].tolist()]
            found.append(max(powers) if self.implicit[c] else min(powers))
        return min(1.0, *found)

    def tiny(self, t: float, left: float, atol: float, least: float = 0.0) -> float:
        """The first of ordinary steps from a corner at t: over it the solution is still."""
        return max(least, left * min(1e-2, atol ** (1 / self.start_exponent(t))))

    def _power(self, k, driver, t):
        """Of integrals of the force, their order; of others, that of their kernel's start."""
        n_a, n_k = self.orders.size, len(self.kernels)
        if k < n_a:
            return self.orders[k] if driver == FORCE else 1 - self.orders[k]
        if k < n_a + n_k:
            kernel = self.kernels[k - n_a]
            return kernel.singular_exponent or min((*kernel.generators, 1.0))
        order = self.varying[k - n_a - n_k]
        values, trouble = order.sampled(np.full(1, t))
        if trouble:
            raise OrderFailed(trouble)
        return 1 - order.derivative + float(values[0])


class _Row(NamedTuple):
    """One convolution of a row of equations.

    order is that of an integral J**a; operator what takes its place, with a general kernel or an
    order that varies; neither where the integrand enters itself. offset as in `Form.offset_of`.
    """

    row: int
    integrand: int
    coefficient: float
    order: float | None = None
    operator: Operator | None = None
    offset: int = 0


def integral_form(system: System) -> Form:
    """The integral equations of a system whose derivatives have orders in (0, 2]."""
    highest = system.highest_orders()
    leading, second = system.coefficient(highest), highest > 1
    implicit = np.array([_lacks(system, c, highest[c]) for c in range(system.d)], dtype=np.int64)
    rows: list[_Row] = []
    for c in range(system.d):
        if implicit[c]:
            rows += _derivative_rows(system, c, second[c])
        elif leading[c] == 0:
            required = "leave a nonzero coefficient before the highest order"
            raise ValueError(complaint("terms", required, f"0 for component {c}"))
        else:
            rows += _integral_rows(system, c, highest[c], second[c], leading[c])
    orders = sorted({row.order for row in rows if row.order is not None} | {1.0})
    if orders[0] < _LEAST:
        required = f"keep {_LEAST:g} above integers, and from each other, with Collocation"
        remedy = "take the integer, or equal orders, instead"
        got = sorted({operator.order for operator, _ in system.left})
        raise ValueError(complaint("order", required, got, remedy))
    others = [row.operator for row in rows if row.operator is not None]
    kernels = list(dict.fromkeys(op.kernel for op in others if op.kernel is not None))
    varying = list(dict.fromkeys(op for op in others if op.kernel is None))
    places: list = [*orders, *kernels, *varying]
    listed = [(row.row, row.integrand, _place(row, places), row.coefficient) for row in rows]
    raised = [r.order + (r.integrand == POSITION) for r in rows if r.order is not None]
    for kernel in kernels:
        raised += [1 - kernel.singular_exponent, *kernel.generators]
    return Form(
        np.array(listed, dtype=TERM).view(np.recarray),
        np.array([row.offset for row in rows]),
        np.array(orders),
        second.astype(np.int64),
        _generators(tuple(raised)),
        implicit,
        tuple(kernels),
        tuple(varying),
    )


def _lacks(system, c, highest):
    """Whether no Caputo derivative of constant order is the highest of a component."""
    return not any(
        operator.constant and operator.order == highest and coefficients[c] != 0
        for operator, coefficients in system.left
    )


def _place(row, places):
    """Index of a row's order or kernel."""
    if row.operator is not None:
        return places.index(row.operator.kernel or row.operator)
    return ITSELF if row.order is None else places.index(row.order)


def _integral_rows(system, c, highest, second, leading):
    """List the rows of a component with an integral form."""
    rows = [_Row(c, FORCE, 1 / leading, float(highest - second))]
    for operator, coefficients in system.left:
        factor = -coefficients[c] / leading
        if factor == 0 or (operator.constant and operator.order == highest):
            continue
        if not operator.constant:
            # where the highest order is an integer, J of the convolution with p' is that with
            # p - p(0)
            if operator.kernel is not None and operator.derivative == 1 + second:
                rows.append(_Row(c, PRIMARY, factor, operator=operator, offset=1))
            else:
                rows.append(_taken(operator, coefficients[c], c, system.d, second))
            continue
        a = float(highest - operator.order)
        if not second or operator.order > 1:
            rows.append(_Row(c, PRIMARY, factor, a, offset=1))
        elif a <= 1:
            rows.append(_Row(c, PRIMARY, factor, a))
        else:
            rows.append(_Row(c, POSITION, factor, a - 1, offset=2))
    return rows


def _derivative_rows(system, c, second):
    """List the rows of a component whose highest derivative stands in other terms than Caputo's."""
    present = [(operator, own[c]) for operator, own in system.left if own[c] != 0]
    rows = []
    for operator, coefficient in present:
        if not operator.constant:
            rows.append(_taken(operator, coefficient, c, system.d, second))
            continue
        integrand = SLOPE if operator.derivative > second else PRIMARY
        order = None if operator.classical else operator.power
        rows.append(_Row(system.d + c, integrand, coefficient, order))
    return rows


def _taken(operator, coefficient, c, d, second):
    """Row of a term that is taken from the right-hand side."""
    integrand = (POSITION, PRIMARY, SLOPE)[operator.derivative - second + 1]
    return _Row(d + c, integrand, coefficient, operator=operator)


def _generators(raised):
    """Numbers whose sums are the powers of t in the solution: what integrals raise them by, and 1.

    A number that is a sum of few smaller ones is left out.
    """
    kept: list[float] = []
    for g in sorted({*raised, 1.0}):
        sums = {0.0}
        for _ in range(_FEW):
            sums |= {e + other for e in sums for other in kept if e + other < g + _APART}
        if min(abs(g - e) for e in sums) > _APART:
            kept.append(float(g))
    return tuple(kept)
