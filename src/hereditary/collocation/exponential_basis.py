"""Exponential bases: convolution kernels of adaptive collocation as sums of exponentials.

The kernels ``t**(a-1) / Gamma(a)``, 0 < a <= 1, hold between the smallest distance that a step
reads and the end of the run. The rates lie on a grid that is even in log(rate), so a refinement to
smaller distances keeps all rates and adds faster ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.special import rgamma

from ..history.varying_memory import SLOW_NODES, bank_of_all_orders, weights_of_orders
from ..kernels.exponential_sum import fit_unit, grid_spacing
from ..kernels.kernel_fits import RATIO_OF_VALUES
from ..kernels.memory_kernel import NO_ERRORS, KernelErrors
from ..support.checks import complaint

# General kernels are fitted down to a fraction of the closest distance, and are a point mass below,
# whose error is of second order in that distance: 0.1 for a tolerance of 1, at least 1e-9. Bounded
# kernels are fitted only from where they change.
_BELOW, _LEAST_BELOW = 0.1, 1e-9
# Kernels are fitted from this many times closer on; modes that have decayed at the first distance
# become part of the point mass, because a fit hardly determines their weights.
_DECAYED = 35.0
# Power laws with exponents below this are nearly constant and fitted to a tolerance of their
# variation: an oscillation that hardly decays accumulates their errors. Least tolerance.
_VARYING, _LEAST_TOL = 0.05, 1e-17


@dataclass(frozen=True, eq=False)
class PowerLawBasis:
    """Exponential sums of several power laws over one set of rates.

    Attributes
    ----------
    orders : tuple of float
        Order of integration a of each kernel.
    closest, farthest : float
        Distances between which the sums hold [time].
    tol : float
        Relative error of the sums [-].
    rates : ndarray, shape (M,)
        Ascending [1/time].
    weights : ndarray, shape (len(orders), M)
    fraction : float
        Fraction of the tolerance that sets the spacing of the rates.
    """

    orders: tuple[float, ...]
    closest: float
    farthest: float
    tol: float
    rates: np.ndarray
    weights: np.ndarray
    fraction: float

    def refine(self, closest: float) -> PowerLawBasis:
        """Return a basis that holds down to `closest`; its first rates are those of this one."""
        exponents = _exponents(self.orders)
        spacing = grid_spacing(exponents, _effective_tol(exponents, self.tol), self.fraction)
        if not np.isfinite(spacing):  # constant kernels alone
            return power_law_basis(self.orders, closest, self.farthest, self.tol)
        factor = math.exp(spacing * math.ceil(math.log(self.closest / closest) / spacing))
        closest = self.closest / factor
        basis = power_law_basis(self.orders, closest, self.farthest, self.tol, self.fraction)
        n = self.rates.size
        if basis.rates.size < n or not np.allclose(basis.rates[:n], self.rates, rtol=1e-6, atol=0):
            raise ArithmeticError(f"no basis from {closest} on extends that from {self.closest}")
        return basis


def power_law_basis(orders, closest, farthest, tol, fraction=None):
    """Fit the power laws of these orders between two distances.

    `fraction` is the fraction of the tolerance that sets the spacing of the rates, found if not
    given.
    """
    exponents = _exponents(orders)
    fit = fit_unit(exponents, farthest / closest, _effective_tol(exponents, tol), fraction)
    a = np.array(orders)[:, None]
    return PowerLawBasis(
        tuple(orders),
        closest,
        farthest,
        tol,
        np.ascontiguousarray(fit.rates / closest),
        np.ascontiguousarray(fit.weights * closest ** (a - 1) * rgamma(a)),
        fit.fraction,
    )


@dataclass(frozen=True, eq=False)
class KernelBasis:
    """Exponential sums of general kernels, down to far below the closest distance that steps read.

    Attributes
    ----------
    rates, gains : ndarray, shape (M,)
        Complex rates in conjugate pairs, and factors of the modes in the history
        (compiled/mode_tables.py).
    weights : ndarray, shape (n, M)
        1 for complex rates, whose gains are the weights.
    masses : ndarray, shape (n,)
        Integral of each kernel over smaller distances, less that of the sum; a point mass at 0.
    farthest : float
        Distance up to which all sums hold [time].
    errors : KernelErrors
        Largest relative errors of the sums.
    """

    rates: np.ndarray
    gains: np.ndarray
    weights: np.ndarray
    masses: np.ndarray
    farthest: float = math.inf
    errors: KernelErrors = NO_ERRORS


def kernel_basis(kernels, closest, farthest, t_end, tol):
    """Fit general kernels for steps that read no closer than `closest`.

    The sums hold up to `farthest`, or to `t_end` for kernels known by their values alone.
    """
    if not kernels:
        return NO_KERNELS
    starts = [_first_distance(kernel, closest, tol) for kernel in kernels]
    ends = [min(t_end if k.by_values else farthest, k.t_last) for k in kernels]
    fits = [
        _fit(kernel, nearest, end, tol)
        for kernel, nearest, end in zip(kernels, starts, ends, strict=True)
    ]
    rates, gains = (np.concatenate([getattr(fit, name) for fit in fits]) for name in _PARTS)
    turns = np.sign(rates.imag)
    gains = np.where(turns == 0, 1.0, 2 * turns * gains)
    weights, masses, offset = np.zeros((len(fits), rates.size)), np.zeros(len(fits)), 0
    for k, (kernel, fit, nearest) in enumerate(zip(kernels, fits, starts, strict=True)):
        own = slice(offset, offset + fit.rates.size)
        weights[k, own] = np.where(turns[own] == 0, fit.weights.real, 1.0)
        offset += fit.rates.size
        masses[k] = float(kernel.integral(nearest) - fit.integral(nearest))
    return KernelBasis(rates, gains, weights, masses, min(ends), KernelErrors.of(kernels, fits))


_PARTS = "rates", "weights"
NO_KERNELS = KernelBasis(np.zeros(0), np.zeros(0), np.zeros((0, 0)), np.zeros(0))


def _first_distance(kernel, closest, tol):
    """Return the distance from which a kernel is fitted by exponentials."""
    below = max(_LEAST_BELOW, _BELOW * tol ** (1 / (2 - kernel.singular_exponent)))
    return max(below * closest, 1e-300, _constant_until(kernel, closest, tol))


def _constant_until(kernel, closest, tol):
    """Return the distance up to which a bounded kernel equals K(0) within `tol`; else 0."""
    if kernel.singular_exponent > 0:
        return 0.0
    t = np.geomspace(max(1e-20 * closest, 1e-300), closest, 1000)
    values = kernel(t)
    changed = np.abs(values - values[0]) > tol * np.abs(values[0])
    return t[np.argmax(changed) - 1] if changed[1:].any() else closest


@lru_cache(maxsize=64)
def _fit(kernel, t_min, t_max, tol):
    """Fit a kernel to `tol`, or as closely as can be."""
    try:
        fit = kernel.closest_fit(t_min / _DECAYED, t_max, max(1e-13, tol))
    except ValueError as error:
        if t_max * _DECAYED <= RATIO_OF_VALUES * t_min:
            raise
        required = "let steps begin within 60 decades of t_end for a kernel without a closed sum"
        remedy = "take a larger rtol, or L1"
        got = f"a first distance {t_min:.1e}"
        raise ValueError(complaint("rtol", required, got, remedy)) from error
    lasting = fit.rates.real * t_min <= _DECAYED
    return replace(fit, rates=fit.rates[lasting], weights=fit.weights[lasting], t_min=t_min)


def _effective_tol(exponents, tol):
    """Return the tolerance of a fit of the kernels t**-e; smaller for tiny exponents e."""
    least = min((a for a in exponents if a > 0), default=1.0)
    return tol * min(1.0, max(least / _VARYING, _LEAST_TOL / tol))


def _exponents(orders):
    """Return the exponents 1 - a of the kernels t**(a-1)."""
    return tuple(1 - a for a in orders)


@dataclass(frozen=True, eq=False)
class VaryingBasis:
    """Rates for power laws of every order a in [0, 1] between two distances.

    Attributes
    ----------
    closest, farthest : float
        Distances between which the sums hold [time].
    tol : float
        Relative error of the sums [-].
    rates : ndarray, shape (M,)
        The few slowest ones first, then ascending [1/time].
    """

    closest: float
    farthest: float
    tol: float
    rates: np.ndarray

    def weights(self, orders: np.ndarray) -> np.ndarray:
        """Return the weights for the kernels of orders a, (k,); shape (M, k)."""
        ratio = self.farthest / self.closest
        found = _slow_first(weights_of_orders(1 - orders, ratio, self.tol))
        return found * self.closest ** (orders - 1) * rgamma(orders)

    def refine(self, closest: float) -> VaryingBasis:
        """Return a basis that holds down to `closest`; its first rates are those of this one."""
        _, h, _ = bank_of_all_orders(self.farthest / self.closest, self.tol)
        factor = math.exp(h * math.ceil(math.log(self.closest / closest) / h))
        basis = varying_basis(self.closest / factor, self.farthest, self.tol)
        n = self.rates.size
        if basis.rates.size < n or not np.allclose(basis.rates[:n], self.rates, rtol=1e-6, atol=0):
            raise ArithmeticError(f"no basis from {closest} on extends that from {self.closest}")
        return basis


def varying_basis(closest: float, farthest: float, tol: float) -> VaryingBasis:
    """Return the rates for power laws of every order between two distances."""
    rates, _, _ = bank_of_all_orders(farthest / closest, tol)
    return VaryingBasis(closest, farthest, tol, _slow_first(rates) / closest)


def _slow_first(rows):
    # rates of the grid last: a refinement adds to them
    """Move the slowest rates, a fixed number, from the end to the front."""
    return np.concatenate([rows[-SLOW_NODES:], rows[:-SLOW_NODES]])
