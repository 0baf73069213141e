"""The bank of exponential modes behind adaptive collocation (floor 3).

Kernels ``t**(a-1) / Gamma(a)``, 0 < a <= 1, at all distances from the closest that a step reads to
the farthest of the run. The rates lie on a grid that is even in log(rate), so a bank that reaches
closer has the same rates and some faster ones besides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.special import rgamma

from ..exponential_sum import fit_unit, grid_spacing
from ..history.varying import SLOW_NODES, bank_of_all_orders, weights_of_orders
from ..special import mean_exponential

# General kernels are sums of exponentials down to this share of the closest distance, and a point
# mass below: its error is of second order in that distance. Bounded ones no further than they move,
# those known by their values as far as the tolerance asks for: to fit many decades takes long.
_BELOW, _BELOW_OF_VALUES = 1e-9, 0.1
# The latter are fitted this many times closer, and rates that are gone by then become part of the
# point mass: next to its first time a fit may weigh such a rate by any number.
_GONE = 35.0
# Kernels next to constant are fitted as if to the tolerance of what they vary by, exponents from
# here on as they are: an oscillation that hardly decays adds up what they err by.
_VARYING, _LEAST_TOL = 0.05, 1e-17


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
    share : float
        Share of the tolerance that sets the grid of the rates.
    """

    orders: tuple[float, ...]
    closest: float
    farthest: float
    tol: float
    rates: np.ndarray
    weights: np.ndarray
    share: float

    def closer(self, closest: float) -> Bank:
        """A bank that reaches down to `closest`; its first rates are those of this one."""
        exponents = _exponents(self.orders)
        spacing = grid_spacing(exponents, _sharpened(exponents, self.tol), self.share)
        if not np.isfinite(spacing):  # constant kernels alone
            return open_bank(self.orders, closest, self.farthest, self.tol)
        factor = math.exp(spacing * math.ceil(math.log(self.closest / closest) / spacing))
        closest = self.closest / factor
        bank = open_bank(self.orders, closest, self.farthest, self.tol, self.share)
        n = self.rates.size
        if bank.rates.size < n or not np.allclose(bank.rates[:n], self.rates, rtol=1e-6, atol=0):
            raise ArithmeticError(f"no bank from {closest} on goes on from {self.closest}")
        return bank


def open_bank(orders, closest, farthest, tol, share=None):
    """The bank of these kernels between two distances; of the grid that a share of tol sets."""
    exponents = _exponents(orders)
    fit = fit_unit(exponents, farthest / closest, _sharpened(exponents, tol), share)
    a = np.array(orders)[:, None]
    return Bank(
        tuple(orders),
        closest,
        farthest,
        tol,
        np.ascontiguousarray(fit.rates / closest),
        np.ascontiguousarray(fit.weights * closest ** (a - 1) * rgamma(a)),
        fit.share,
    )


@dataclass(frozen=True, eq=False)
class KernelBank:
    """Exponential sums of general kernels, far below the closest distance at which steps read.

    Attributes
    ----------
    rates : ndarray, shape (M,)
    weights : ndarray, shape (n, M)
    masses : ndarray, shape (n,)
        What each kernel's integral over still smaller distances is more than the sum's.
    farthest : float
        Distance up to which all of them hold [time].
    error : float
        Largest relative error of a sum [-].
    """

    rates: np.ndarray
    weights: np.ndarray
    masses: np.ndarray
    farthest: float = math.inf
    error: float = 0.0


def open_kernels(kernels, closest, farthest, t_end, tol):
    """The sums of these kernels for steps that read no closer than `closest`.

    Up to `farthest`, or to `t_end` where they are known by their values alone.
    """
    starts = [_start(kernel, closest, tol) for kernel in kernels]
    ends = [min(t_end if k.by_values else farthest, k.t_last) for k in kernels]
    fits = [
        _finest(kernel, nearest, end, tol)
        for kernel, nearest, end in zip(kernels, starts, ends, strict=True)
    ]
    rates = np.concatenate([np.zeros(0), *(fit.rates for fit in fits)])
    weights, masses, offset = np.zeros((len(fits), rates.size)), np.zeros(len(fits)), 0
    for k, (kernel, fit, nearest) in enumerate(zip(kernels, fits, starts, strict=True)):
        weights[k, offset : offset + fit.rates.size] = fit.weights
        offset += fit.rates.size
        held = fit.weights @ (nearest * mean_exponential(fit.rates * nearest))
        masses[k] = float(kernel.integral(nearest)) - held
    error = max((fit.max_error for fit in fits), default=0.0)
    return KernelBank(rates, weights, masses, min(ends, default=math.inf), error)


def _start(kernel, closest, tol):
    """Distance from which on a kernel is a sum."""
    below = _BELOW
    if kernel.by_values:
        below = max(below, _BELOW_OF_VALUES * tol ** (1 / (2 - kernel.singular_exponent)))
    return max(below * closest, 1e-300, _still(kernel, closest, tol))


def _still(kernel, closest, tol):
    """Up to where a bounded kernel is what it is at 0, to `tol`; 0 for others."""
    if kernel.singular_exponent > 0:
        return 0.0
    t = np.geomspace(1e-20 * closest if kernel.by_values else 1e-300, closest, 1000)
    values = kernel(t)
    moved = np.abs(values - values[0]) > tol * np.abs(values[0])
    return t[np.argmax(moved) - 1] if moved[1:].any() else closest


@lru_cache(maxsize=64)
def _finest(kernel, t_min, t_max, tol):
    """The kernel's fit to `tol`, or to as little more as it can be had at."""
    if kernel.by_values:
        fit = kernel.closest_fit(t_min / _GONE, t_max, max(1e-13, tol))
        seen = fit.rates * t_min <= _GONE
        return replace(fit, rates=fit.rates[seen], weights=fit.weights[seen], t_min=t_min)
    for loosened in (1.0, 10.0, 100.0):
        try:
            return kernel.fit(t_min, t_max, max(1e-13, loosened * tol))
        except ValueError:
            continue
    return kernel.fit(t_min, t_max, 1e3 * tol)


def _sharpened(exponents, tol):
    """The tolerance that kernels of these exponents are fitted to."""
    least = min((a for a in exponents if a > 0), default=1.0)
    return tol * min(1.0, max(least / _VARYING, _LEAST_TOL / tol))


def _exponents(orders):
    return tuple(1 - a for a in orders)


@dataclass(frozen=True, eq=False)
class OrderBank:
    """Rates with which every such kernel is a sum of exponentials between two distances.

    Attributes
    ----------
    closest, farthest : float
        Distances between which the sums hold [time].
    tol : float
        Their relative error [-].
    rates : ndarray, shape (M,)
        [1/time].
    """

    closest: float
    farthest: float
    tol: float
    rates: np.ndarray

    def weights(self, orders: np.ndarray) -> np.ndarray:
        """Weights for kernels of some orders a (k,), shape (M, k)."""
        ratio = self.farthest / self.closest
        found = _slow_first(weights_of_orders(1 - orders, ratio, self.tol))
        return found * self.closest ** (orders - 1) * rgamma(orders)

    def closer(self, closest: float) -> OrderBank:
        """A bank that reaches down to `closest`; its first rates are those of this one."""
        _, h, _ = bank_of_all_orders(self.farthest / self.closest, self.tol)
        factor = math.exp(h * math.ceil(math.log(self.closest / closest) / h))
        bank = open_order_bank(self.closest / factor, self.farthest, self.tol)
        n = self.rates.size
        if bank.rates.size < n or not np.allclose(bank.rates[:n], self.rates, rtol=1e-6, atol=0):
            raise ArithmeticError(f"no bank from {closest} on goes on from {self.closest}")
        return bank


def open_order_bank(closest: float, farthest: float, tol: float) -> OrderBank:
    """The bank between two distances."""
    rates, _, _ = bank_of_all_orders(farthest / closest, tol)
    return OrderBank(closest, farthest, tol, _slow_first(rates) / closest)


def _slow_first(rows):
    # a bank that reaches closer has more of those of the grid
    return np.concatenate([rows[-SLOW_NODES:], rows[:-SLOW_NODES]])
