"""The bank of exponential modes behind adaptive collocation (floor 3).

Kernels ``t**(a-1) / Gamma(a)``, 0 < a <= 1, at all distances from the closest that a step reads to
the farthest of the run. The rates lie on a grid that is even in log(rate), so a bank that reaches
closer has the same rates and some faster ones besides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import rgamma

from ..exponential_sum import fit_unit, grid_spacing


@dataclass(frozen=True, eq=False)
class Bank:
    """Exponential sums of several kernels over one set of rates.

    Attributes
    ----------
    orders : tuple of float
        a of each kernel.
    closest, farthest : float
        Distances between which the sums hold [time].
    tol : float
        Their relative error [-].
    rates : ndarray, shape (M,)
        Ascending [1/time].
    weights : ndarray, shape (len(orders), M)
    """

    orders: tuple[float, ...]
    closest: float
    farthest: float
    tol: float
    rates: np.ndarray
    weights: np.ndarray

    def closer(self, closest: float) -> Bank:
        """A bank that reaches down to `closest`; its first rates are those of this one."""
        exponents = _exponents(self.orders)
        spacing = grid_spacing(exponents, self.tol)
        if not np.isfinite(spacing):  # constant kernels alone
            return open_bank(self.orders, closest, self.farthest, self.tol)
        factor = math.exp(spacing * math.ceil(math.log(self.closest / closest) / spacing))
        bank = open_bank(self.orders, self.closest / factor, self.farthest, self.tol)
        n = self.rates.size
        if bank.rates.size < n or not np.allclose(bank.rates[:n], self.rates, rtol=1e-6, atol=0):
            raise ArithmeticError(f"no bank from {closest} on goes on from {self.closest}")
        return bank


def open_bank(orders, closest, farthest, tol):
    """The bank of these kernels between two distances."""
    rates, weights, _ = fit_unit(_exponents(orders), farthest / closest, tol)
    a = np.array(orders)[:, None]
    return Bank(
        tuple(orders),
        closest,
        farthest,
        tol,
        np.ascontiguousarray(rates / closest),
        np.ascontiguousarray(weights * closest ** (a - 1) * rgamma(a)),
    )


def _exponents(orders):
    return tuple(1 - a for a in orders)
