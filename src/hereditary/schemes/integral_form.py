"""Equations as systems of weakly singular integral equations (floor 2).

With p = y for components of order up to 1 and p = y' above, every component becomes ``p = p(0) +
sum_k kappa_k J**a_k (q_k - o_k)``, 0 < a_k <= 1, where q is the right-hand side f, p, or y and o a
constant: with the highest term ``c D**alpha`` and q = f that is kappa = 1/c, a = alpha - m + 1; a
lower term ``c_j D**alpha_j`` brings kappa = -c_j/c and ``J**(alpha - alpha_j)`` of p, less p(0)
where it has as many derivatives, or ``J**(alpha - alpha_j - 1)`` of y - y(0) where that exceeds 1.
"""

from dataclasses import dataclass

import numpy as np

from .._checks import complaint
from ..kernels.collocation import FORCE, POSITION, PRIMARY
from ..memory_kernel import MemoryKernel
from ..system import System

# Numbers closer than this are one; a sum of up to so many others is not taken for itself.
_APART, _FEW = 1e-9, 4


@dataclass(frozen=True)
class Form:
    """The system as weakly singular integral equations.

    Attributes
    ----------
    channels : ndarray, shape (n, 4)
        Row, driver (kernels/collocation.py), index of the order or kernel, kappa. Row c < d is p of
        component c, row d + c what is taken from its right-hand side.
    offset_of : ndarray of int64, shape (n,)
        What is taken from the driver: 0 nothing, 1 p(0), 2 y(0).
    orders : ndarray, shape (n_a,)
        Orders of integration in (0, 1], ascending; the last one is 1.
    second : ndarray of int64, shape (d,)
        Whether the primary unknown is y'.
    generators : tuple of float
        Numbers whose sums are the powers of t that f, p and y are made of near 0.
    kernels : tuple of MemoryKernel
        General kernels; their indices follow those of the orders.
    """

    channels: np.ndarray
    offset_of: np.ndarray
    orders: np.ndarray
    second: np.ndarray
    generators: tuple[float, ...]
    kernels: tuple = ()

    @property
    def n_rows(self) -> int:
        """Rows: d, or 2 d where something is taken from right-hand sides."""
        d = self.second.size
        return d if self.channels[:, 0].max() < d else 2 * d


def integral_form(system: System) -> Form:
    """The integral equations of a system of Caputo terms of orders in (0, 2]."""
    highest = system.highest_orders()
    second = highest > 1
    rows, kernel_rows = [], []
    kernels: list[MemoryKernel] = []
    for c in range(system.d):
        leading = system.coefficients[system.orders[:, c] == highest[c], c].sum()
        if leading == 0:
            required = "leave a nonzero coefficient before the highest order"
            _refuse_leading_kernel(system, c)
            raise ValueError(complaint("terms", required, f"0 for component {c}"))
        rows.append((c, FORCE, highest[c] - second[c], 1 / leading, 0))
        for coefficient, order in zip(system.coefficients[:, c], system.orders[:, c], strict=True):
            if coefficient == 0 or order == highest[c]:
                continue
            a, kappa = highest[c] - order, -coefficient / leading
            if not second[c] or order > 1:
                rows.append((c, PRIMARY, a, kappa, 1))
            elif a <= 1:
                rows.append((c, PRIMARY, a, kappa, 0))
            else:
                rows.append((c, POSITION, a - 1, kappa, 2))
        for term, coefficients in system.memories:
            if coefficients[c] != 0:
                alpha = highest[c] - second[c]
                row = _kernel_row(term, coefficients[c], c, system.d, second[c], alpha, leading)
                kernel_rows.append((*row, len(kernels)))
                kernels.append(term.kernel)
    orders = sorted({row[2] for row in rows} | {1.0})
    n = len(orders)
    listed = [(c, q, orders.index(a), kappa) for c, q, a, kappa, _ in rows]
    listed += [(c, q, n + k, kappa) for c, q, kappa, _, k in kernel_rows]
    offset_of = np.array([row[4] for row in rows] + [row[3] for row in kernel_rows])
    raised = [a + (q == POSITION) for _, q, a, _, _ in rows]
    for kernel in kernels:
        raised += [1 - kernel.singular_exponent, *kernel.generators]
    return Form(
        np.array(listed, dtype=float),
        offset_of,
        np.array(orders),
        second.astype(np.int64),
        _generators(tuple(raised)),
        tuple(kernels),
    )


def _refuse_leading_kernel(system, c):
    """Refuse a component whose highest derivative stands in a general kernel alone."""
    for term, coefficients in system.memories:
        if coefficients[c] != 0 and term.derivative == system.highest_orders()[c]:
            required = "hold a Caputo term of the highest derivative's order with Collocation"
            got = f"a Memory of derivative {term.derivative} alone for component {c}"
            raise ValueError(complaint("terms", required, got, "use ExplicitCaputo or L1"))


def _kernel_row(term, coefficient, c, d, second, alpha, leading):
    """Row, driver, kappa and offset of a term with a general kernel."""
    depth = term.derivative - second  # of p: -1 for its integral y, 1 for its derivative
    if depth < 1:
        return d + c, PRIMARY if depth == 0 else POSITION, coefficient, 0
    if alpha != 1:
        required = "be below the order of the highest Caputo term with Collocation"
        remedy = "or make that order an integer; ExplicitCaputo and L1 take any"
        raise ValueError(complaint("derivative", required, term.derivative, remedy))
    # J^1 of the convolution with p' is that with p - p(0)
    return c, PRIMARY, -coefficient / leading, 1


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
