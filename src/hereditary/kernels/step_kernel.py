"""Memory kernels in units of the step: their moments on uniform steps, and their sums."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from operator import attrgetter

import numpy as np
from numpy.typing import ArrayLike

from ..support.checks import refuse
from . import special
from .memory_kernel import ExponentialSum, MemoryKernel

# Terms after which an alternating sum of the weights is right to 1e-14.
_ALTERNATING = 24


@dataclass(frozen=True)
class PowerSteps:
    """The kernel ``p t**(p-1)``, 0 <= p < 1, t in steps; a point mass at 0 for p = 0."""

    p: float

    @property
    def key(self) -> float | None:
        """Exponent of the power law whose sum replaces the kernel; None without memory."""
        return 1 - self.p if self.p > 0 else None

    @property
    def amplitude(self) -> float:
        """Ratio of the kernel to the power law `key`."""
        return self.p

    def differences(self, n: int) -> np.ndarray:
        """Return b_0, and then ``b_k - b_(k-1)`` for k < n."""
        return special.power_second_differences(self.p, n)

    def integrals(self, theta: float, n: int) -> np.ndarray:
        """Return integrals over [k-1+theta, k+theta] for k < n; over [0, theta] for k = 0."""
        weights = np.full(n, theta**self.p)
        if n > 1:
            k = np.arange(n - 1) + theta
            weights[1:] = k**self.p * np.expm1(self.p * np.log1p(1 / k))
        return weights

    def moments(self, theta: float, n: int) -> np.ndarray:
        """Return integrals of ``(middle - t) K`` over [k-1+theta, k+theta], k < n; 0 for k = 0."""
        # by Gauss's rule, because the closed form cancels for large k; the singularity is at least
        # 0.5 before the interval, where sixteen points leave an error of 3.7**-32
        moments = np.zeros(n)
        v, weights = special.gauss_unit(16)
        middle = np.arange(n - 1)[:, None] + theta + 0.5
        # the integrand minus its value in the middle, whose first moment is 0: so nothing cancels
        excess = np.expm1((self.p - 1) * np.log1p((v - 0.5) / middle))
        moments[1:] = self.p * middle[:, 0] ** (self.p - 1) * (excess @ (weights * (0.5 - v)))
        return moments

    def last_moment(self) -> float:
        """Return the integral of ``(1/2 - t) K`` over [0, 1]."""
        return (1 - self.p) / (2 * (1 + self.p))

    def alternating(self) -> float:
        """Return ``sum_k (-1)**k b_k``."""
        return float(special.alternating_power_sum(self.p))


@dataclass(frozen=True, eq=False)
class ExponentialSteps:
    """The kernels ``weights exp(-rates t)``, (M,), t in steps from 1 on: one a row of a result."""

    rates: np.ndarray
    weights: np.ndarray

    def at(self, t: np.ndarray) -> np.ndarray:
        """Return values at times t (n,), shape (M, n); at t < 0 the finite values at 0."""
        return self.weights[:, None] * np.exp(-np.multiply.outer(self.rates, np.maximum(t, 0.0)))

    def integrals(self, theta: float, n: int) -> np.ndarray:
        """Return the integrals of `PowerSteps.integrals`, valid from k = 1 on."""
        return special.mean_exponential(self.rates)[:, None] * self.at(np.arange(n) - 1 + theta)

    def differences(self, n: int) -> np.ndarray:
        """Return the differences of `PowerSteps.differences`, valid from k = 1 on."""
        return np.expm1(-self.rates)[:, None] * self.integrals(0.0, n)

    def moments(self, theta: float, n: int) -> np.ndarray:
        """Return the moments of `PowerSteps.moments`, valid from k = 1 on."""
        first = special.first_moment_exponential(self.rates)
        middle = 0.5 * special.mean_exponential(self.rates) - first
        return middle[:, None] * self.at(np.arange(n) - 1 + theta)

    def last_moment(self) -> np.ndarray:
        """Return the moments over [0, 1], shape (M,)."""
        return self.moments(1.0, 1)[:, 0]


@dataclass(frozen=True)
class Integrated:
    """The kernel ``int_0^t K``: its convolution with y' is that of K with y - y(0)."""

    kernel: MemoryKernel

    t_last = property(attrgetter("kernel.t_last"))
    by_values = property(attrgetter("kernel.by_values"))
    measured = property(attrgetter("kernel.measured"))

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Return values of the kernel."""
        return self.kernel.integral(t)

    def integral(self, t: float | np.ndarray) -> np.ndarray:
        """Return ``int_0^t K``, by a rule whose panels shrink towards 0."""
        u, weights = special.graded_unit(16)
        return t * (self.kernel.integral(np.multiply.outer(t, u)) @ weights)

    def closest_fit(self, t_min: float, t_max: float, tol: float) -> ExponentialSum:
        """Fit by a sum with a constant: the sum of the kernel, integrated from t_min."""
        fit = self.kernel.closest_fit(t_min, t_max, tol, fading=True)
        if np.any(fit.rates == 0):
            required = "decay if it acts on y itself (derivative 0)"
            refuse("kernel", required, f"{self.kernel!r}", "make the integral of y a component")
        shares = fit.weights / fit.rates
        constant = float(self.kernel.integral(t_min))
        constant += (shares @ np.exp(-fit.rates * t_min)).real
        rates, weights = np.append(0.0, fit.rates), np.append(constant, -shares)
        return ExponentialSum(rates, weights, t_min, t_max, fit.max_error)


@dataclass(frozen=True)
class StepKernel:
    """The kernel ``K(h t)``, t in steps of h [time], with the methods of `PowerSteps`."""

    kernel: MemoryKernel | Integrated
    h: float  # step [time]

    amplitude = 1.0

    @property
    def key(self) -> StepKernel:
        """The object itself: no other kernel shares its sum of exponentials."""
        return self

    def at(self, t: np.ndarray) -> np.ndarray:
        """Return K(h t); beyond the last known time the value at that time."""
        return self.kernel(np.minimum(self.h * t, self.kernel.t_last))

    def shares(self, n: int) -> np.ndarray:
        """Return integrals b_k over [k, k+1] for k < n."""
        return self.integrals(1.0, n)

    def differences(self, n: int) -> np.ndarray:
        """Return b_0, and then ``b_k - b_(k-1)`` for k < n."""
        return np.diff(self.shares(n), prepend=0.0)

    def integrals(self, theta: float, n: int) -> np.ndarray:
        """Return integrals over [k-1+theta, k+theta] for k < n; over [0, theta] for k = 0."""
        # by Gauss's rule: from k = 2 on the singularity of the kernel is at least one interval
        # away, where sixteen points leave an error of 5.8**-32
        weights = np.empty(n)
        weights[0] = self.kernel.integral(theta * self.h) / self.h
        if n > 1:
            u, gauss = special.gauss_unit(16)
            weights[1:] = self.at(np.arange(n - 1)[:, None] + theta + u) @ gauss
            u, gauss = special.gauss_unit(32)
            weights[1] = self.at(theta + u) @ gauss
        return weights

    def alternating(self) -> float:
        """Return ``sum_k (-1)**k b_k``."""
        shares = self.shares(_ALTERNATING)
        return float(shares[0] * special.alternating_sum(shares / shares[0]))

    def exponentials(self, n_steps: float, tol: float) -> ExponentialSum:
        """Fit a sum from one step to `n_steps` steps, to `tol` or as closely as possible."""
        return _exponentials(self, n_steps, tol)


@lru_cache(maxsize=64)
def _exponentials(kernel: StepKernel, n_steps: float, tol: float) -> ExponentialSum:
    end = min(kernel.h * max(n_steps, 2), kernel.kernel.t_last)
    start = min(kernel.h, end / 2)  # runs of one step read nothing of it
    fit = kernel.kernel.closest_fit(start, end, tol)
    return replace(fit, rates=fit.rates * kernel.h)
