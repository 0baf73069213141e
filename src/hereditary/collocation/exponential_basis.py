"""Exponential bases: convolution kernels of adaptive collocation as sums of exponentials.

The kernels are ``t**(a-1) / Gamma(a)`` with 0 < a <= 1, and general ones. Their sums are accurate
between the smallest time lag at which a step evaluates them and the end of the run. In this module
a *distance* is such a time lag. The rates lie on a grid that is even in log(rate), so a refinement
to smaller distances keeps all rates and adds faster ones. M is the number of rates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Self

import numpy as np
from scipy.special import rgamma

from ..kernels.exponential_sum import fit_unit, grid_spacing
from ..kernels.kernel_fits import RATIO_OF_VALUES
from ..kernels.memory_kernel import NO_ERRORS, ExponentialSum, KernelErrors, MemoryKernel
from ..support.checks import complaint

# Smallest distance of the fit of a general kernel, as fraction of the closest distance that steps
# evaluate, for a tolerance of 1. At smaller distances the kernel is a point mass, whose error is of
# second order in the distance. A bounded kernel is fitted only from the distance where it changes.
_FIT_START_FRACTION = 0.1
# Least value of that fraction, the smallest distance of a fit over the closest distance of steps,
# for any tolerance.
_MIN_FIT_START_FRACTION = 1e-9
# Rate times smallest distance above which a mode of a general kernel has decayed. Kernels are
# fitted from a distance this many times smaller. Decayed modes become part of the point mass,
# because the fit hardly determines their weights.
_DECAYED = 35.0
# Exponent below which a power law is nearly constant. It is then fitted to a tolerance relative to
# its variation, because an oscillation that hardly decays accumulates the errors of the fit.
_VARYING = 0.05
# Least tolerance of the fit of a nearly constant power law.
_LEAST_TOL = 1e-17
# Ratio of the largest |K| to |K(0)| of a kernel from which on its memory is small at first.
_RISING = 2.0
# Times, as fractions of the run's end, and number of times at which a kernel is seen to rise. The
# integral errs by 1 % for a peak whose width is a tenth of its time.
_RISE_CHECK_RANGE = 1e-6, 1.0
_RISE_CHECK_POINTS = 400
# Relative rounding error of a sum of exponentials.
_ROUNDING_OF_MODES = 2e-14


@dataclass(frozen=True, eq=False)
class GridBasis:
    """Rates on a grid that is even in log(rate), for kernels between two distances."""

    closest: float  # smallest distance at which the sums are accurate [time]
    farthest: float  # largest distance at which the sums are accurate [time]
    tol: float  # relative error of the sums [-]
    # (M,), ascending [1/time], except a few that do not belong to the grid and come first
    rates: np.ndarray
    spacing: float  # of the grid in log(rate), infinite if all kernels are constant

    def refine(self, closest: float) -> Self:
        """Return a basis that is accurate from `closest` on, and begins with these rates."""
        if np.isfinite(self.spacing):
            n_added = math.ceil(math.log(self.closest / closest) / self.spacing)
            closest = self.closest / math.exp(self.spacing * n_added)
        basis, n = self._down_to(closest), self.rates.size
        if basis.rates.size < n or not np.allclose(basis.rates[:n], self.rates, rtol=1e-6, atol=0):
            raise ArithmeticError(f"no basis from {closest} on extends that from {self.closest}")
        return basis

    def _down_to(self, closest: float) -> Any:
        """Return a basis with the same spacing that is accurate from the distance `closest` on."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class PowerLawBasis(GridBasis):
    """Exponential sums of several power laws over one set of rates."""

    orders: tuple[float, ...]  # order of integration a of each kernel
    weights: np.ndarray  # (len(orders), M)
    fraction: float  # fraction of the tolerance that sets the spacing of the rates

    @property
    def error(self) -> float:
        """Largest relative error of the sums; 0 if all kernels are constant."""
        exponents = tuple(1 - a for a in self.orders)  # of the kernels t**(a-1)
        return (
            max(_effective_tol(exponents, self.tol), _ROUNDING_OF_MODES) if any(exponents) else 0.0
        )

    def _down_to(self, closest: float) -> PowerLawBasis:
        return power_law_basis(self.orders, closest, self.farthest, self.tol, self.fraction)


def power_law_basis(
    orders: list[float] | tuple[float, ...],
    closest: float,
    farthest: float,
    tol: float,
    fraction: float | None = None,
) -> PowerLawBasis:
    """Return the sums of exponentials for power laws of these orders between two distances."""
    # fraction: part of tol that sets the spacing of the rates; None to let the fit determine it
    exponents = tuple(1 - a for a in orders)  # of the kernels t**(a-1)
    fit_tol = _effective_tol(exponents, tol)
    fit = fit_unit(exponents, farthest / closest, fit_tol, fraction)
    a = np.array(orders)[:, None]
    return PowerLawBasis(
        closest,
        farthest,
        tol,
        np.ascontiguousarray(fit.rates / closest),
        grid_spacing(exponents, fit_tol, fit.fraction),
        tuple(orders),
        np.ascontiguousarray(fit.weights * closest ** (a - 1) * rgamma(a)),
        fit.fraction,
    )


NO_POWER_LAWS = PowerLawBasis(math.inf, 0.0, 0.0, np.zeros(0), math.inf, (), np.zeros((0, 0)), 1.0)


@dataclass(frozen=True, eq=False)
class KernelBasis:
    """Exponential sums of n general kernels, to far below the closest distance of steps."""

    sums: tuple[ExponentialSum, ...]  # one for each kernel
    # (n,), weights of point masses at distance 0: the integral of each kernel over the smaller
    # distances, minus that of its sum
    masses: np.ndarray
    farthest: float = math.inf  # distance up to which all sums are accurate [time]
    errors: KernelErrors = NO_ERRORS  # largest relative errors of the sums


def kernel_basis(
    kernels: tuple[MemoryKernel, ...], closest: float, farthest: float, t_end: float, tol: float
) -> KernelBasis:
    """Return the sums of exponentials for general kernels, as a `KernelBasis`."""
    # accurate from below `closest`, for steps, up to `farthest`, or `t_end` for kernels given by
    # values
    if not kernels:
        return NO_KERNELS
    starts = [_first_distance(kernel, closest, tol) for kernel in kernels]
    ends = [min(t_end if k.by_values else farthest, k.t_last) for k in kernels]
    fits = tuple(
        _fit(kernel, nearest, end, tol)
        for kernel, nearest, end in zip(kernels, starts, ends, strict=True)
    )
    pieces = zip(kernels, fits, starts, strict=True)
    masses = [float(kernel.integral(t) - fit.integral(t)) for kernel, fit, t in pieces]
    return KernelBasis(fits, np.array(masses), min(ends), KernelErrors.of(kernels, fits))


NO_KERNELS = KernelBasis((), np.zeros(0))


def _first_distance(kernel: MemoryKernel, closest: float, tol: float) -> float:
    """Return the smallest distance of the fit of a kernel by exponentials."""
    below = max(
        _MIN_FIT_START_FRACTION, _FIT_START_FRACTION * tol ** (1 / (2 - kernel.singular_exponent))
    )
    return max(below * closest, 1e-300, _constant_until(kernel, closest, tol))


def _constant_until(kernel: MemoryKernel, closest: float, tol: float) -> float:
    """Return the distance up to which a bounded kernel equals K(0) within `tol`, 0 if singular."""
    if kernel.singular_exponent > 0:
        return 0.0
    t = np.geomspace(max(1e-20 * closest, 1e-300), closest, 1000)
    values = kernel(t)
    changed = np.abs(values - values[0]) > tol * np.abs(values[0])
    return t[np.argmax(changed) - 1] if changed[1:].any() else closest


@lru_cache(maxsize=64)
def integral_if_rising(kernel: MemoryKernel, t_end: float) -> float:
    """Return ``int_0^t_end |K|`` of a kernel that rises to more than `_RISING` |K(0)|; else 0."""
    if kernel.singular_exponent > 0:
        return 0.0
    t = np.geomspace(*_RISE_CHECK_RANGE, _RISE_CHECK_POINTS) * min(t_end, kernel.t_last)
    values = np.abs(kernel(t))
    return np.trapezoid(values, t) if values.max() > _RISING * values[0] else 0.0


@lru_cache(maxsize=64)
def _fit(kernel: MemoryKernel, t_min: float, t_max: float, tol: float) -> ExponentialSum:
    """Return a kernel's sum of exponentials from t_min to t_max, with error `tol` if possible."""
    # modes that have decayed at t_min are left out
    try:
        fit = kernel.closest_fit(t_min / _DECAYED, t_max, max(1e-13, tol))
    except ValueError as error:
        if t_max * _DECAYED <= RATIO_OF_VALUES * t_min:
            raise
        required = "let steps begin within 60 decades of t_end for a kernel without a closed sum"
        remedy = "take a larger rtol, or L1() with n_steps"
        got = f"a first distance {t_min:.1e}"
        raise ValueError(complaint("rtol", required, got, remedy)) from error
    lasting = fit.rates.real * t_min <= _DECAYED
    return replace(fit, rates=fit.rates[lasting], weights=fit.weights[lasting], t_min=t_min)


def _effective_tol(exponents: tuple[float, ...], tol: float) -> float:
    """Return the tolerance of a fit of kernels t**-e, less than `tol` if an exponent e is tiny."""
    least = min((a for a in exponents if a > 0), default=1.0)
    return tol * min(1.0, max(least / _VARYING, _LEAST_TOL / tol))
