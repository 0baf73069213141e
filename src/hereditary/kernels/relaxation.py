"""Relaxation kernels, finite at 0: exponentials, stretched exponentials, Mittag-Leffler."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..support.checks import complaint, positive, within
from .density import Density
from .exponential_sum import fit_interval
from .kernel_fits import fit_positive
from .kernel_tools import GONE, all_positive, matching, mean_of_decay, refuse_gone
from .memory_kernel import ExponentialSum, MemoryKernel
from .special import first_moment_exponential, gauss_unit, mean_exponential


@dataclass(frozen=True, init=False)
class Prony(MemoryKernel):
    """A finite sum of exponentials, ``K(t) = sum_i weights[i] exp(-rates[i] t)``.

    Parameters
    ----------
    rates : array_like, shape (n,)
        Not negative [1/time].
    weights : array_like, shape (n,)
        Positive [unit of the kernel].

    Examples
    --------
    >>> from hereditary import Prony
    >>> round(float(Prony([0.0, 2.0], [1.0, 3.0])(0.5)), 6)
    2.103638
    """

    rates: tuple[float, ...]
    weights: tuple[float, ...]

    def __init__(self, rates: ArrayLike, weights: ArrayLike) -> None:
        rate, weight = matching("rates", rates, "weights", weights)
        if np.any(rate < 0):
            raise ValueError(complaint("rates", "not be negative", rate.tolist()))
        all_positive("weights", weight)
        own, index = np.unique(rate, return_inverse=True)
        object.__setattr__(self, "rates", tuple(own.tolist()))
        object.__setattr__(self, "weights", tuple(np.bincount(index, weight).tolist()))

    @property
    def singular_exponent(self) -> float:
        """0: the kernel is finite at 0."""
        return 0.0

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Kernel values, the shape of `t`."""
        t = np.asarray(t, dtype=float)
        return np.exp(-np.multiply.outer(t, self.rates)) @ np.array(self.weights)

    def integral(self, t: ArrayLike) -> np.ndarray:
        """``int_0^t K``, in closed form."""
        t = np.asarray(t, dtype=float)
        return t * (mean_exponential(np.multiply.outer(t, self.rates)) @ np.array(self.weights))

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """``sum_i weights[i] / (s + rates[i])``."""
        return (1 / np.add.outer(np.asarray(s), self.rates)) @ np.array(self.weights)

    def fit(self, t_min: float, t_max: float, tol: float) -> ExponentialSum:
        """The kernel itself, exact at any tolerance."""
        t_min, t_max, tol = fit_interval(t_min, t_max, tol)
        return ExponentialSum(np.array(self.rates), np.array(self.weights), t_min, t_max, 0.0)


@dataclass(frozen=True)
class StretchedExponential(MemoryKernel):
    """Kohlrausch's relaxation, ``K(t) = exp(-(rate t)**exponent)``.

    Parameters
    ----------
    exponent : float
        0.01 <= exponent <= 1 [-]; 1 is the plain exponential.
    rate : float
        rate > 0 [1/time].

    Examples
    --------
    >>> from hereditary import StretchedExponential
    >>> round(float(StretchedExponential(0.5, 1.0)(4.0)), 6)
    0.135335
    """

    exponent: float
    rate: float

    def __post_init__(self):
        within("exponent", self.exponent, 0.01, 1.0, "[0.01, 1]")
        positive("rate", self.rate)

    @property
    def singular_exponent(self) -> float:
        """0: the kernel is 1 at 0."""
        return 0.0

    @property
    def generators(self) -> tuple[float, ...]:
        """The exponent: the kernel is a series in its multiples."""
        return (float(self.exponent),)

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Kernel values, the shape of `t`."""
        return np.exp(-((self.rate * np.asarray(t, dtype=float)) ** self.exponent))

    def integral(self, t: ArrayLike) -> np.ndarray:
        """``int_0^t K``, an incomplete gamma function."""
        t = np.asarray(t, dtype=float)
        return t * mean_of_decay(1 / self.exponent, (self.rate * t) ** self.exponent)

    def fit(self, t_min: float, t_max: float, tol: float) -> ExponentialSum:
        """By its values, or by its spectrum where the tolerance is too tight for these."""
        t_min, t_max, tol = fit_interval(t_min, t_max, tol)
        b = self.exponent
        refuse_gone((self.rate * t_min) ** b, t_min)
        if b == 1:
            return Prony([self.rate], [1.0]).fit(t_min, t_max, tol)
        # the late kernel comes from where rates end steeply: the saddle of exp(-s t) at t_max
        late = (1 / b - 1) * math.log(min(max((self.rate * t_max) ** b, 1.0), 37.0))
        centre, width = math.log(self.rate * b) - late, 0.25 * math.pi * (1 / b - 1)
        density = Density(self._spectrum, centre, width, t_min)
        return fit_positive(self, t_min, t_max, tol, density)

    def _spectrum(self, v):
        """Density per log rate, Kanter's integral over an angle phi = pi / (1 + exp(-w)).

        ``b/(1-b) 1/pi int y exp(-y) dphi`` with ``y = a(phi) exp(-v b/(1-b))``.
        """
        b, v = self.exponent, v - math.log(self.rate)
        step = min(0.25, (1 - b) * 0.16)
        end = 45.0 + max(0.0, b * v.max())
        w = np.arange(-45.0, end, step)
        fall = np.logaddexp(0.0, w)  # pi - phi = pi exp(-fall)
        phi, rest = math.pi * np.exp(w - fall), math.pi * np.exp(-fall)
        log_a = np.log(np.sin((1 - b) * phi)) + b / (1 - b) * np.log(np.sin(b * phi))
        log_a -= np.log(np.sin(np.minimum(phi, rest))) / (1 - b)
        mass = b / (1 - b) / math.pi * step * phi * np.exp(-fall)
        density = np.empty(v.size)
        for i, shift in enumerate(v * b / (1 - b)):
            log_y = np.minimum(log_a - shift, 7.0)
            density[i] = np.exp(log_y - np.exp(log_y)) @ mass
        return density


@dataclass(frozen=True)
class MittagLeffler(MemoryKernel):
    """Cole and Cole's relaxation, ``K(t) = E_order(-(rate t)**order)``.

    The relaxation modulus of the fractional Maxwell element: exp(-rate t) for order 1, a stretched
    exponential at short times and the power law ``(rate t)**-order / Gamma(1 - order)`` at long.

    Parameters
    ----------
    order : float
        0.01 <= order <= 1 [-].
    rate : float
        rate > 0 [1/time].

    Examples
    --------
    >>> from hereditary import MittagLeffler
    >>> round(float(MittagLeffler(0.5, 1.0)(1.0)), 6)
    0.427584
    """

    order: float
    rate: float

    def __post_init__(self):
        within("order", self.order, 0.01, 1.0, "[0.01, 1]")
        positive("rate", self.rate)

    @property
    def singular_exponent(self) -> float:
        """0: the kernel is 1 at 0."""
        return 0.0

    @property
    def generators(self) -> tuple[float, ...]:
        """The order: the kernel is a series in its multiples."""
        return (float(self.order),)

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Kernel values, the shape of `t`; ``int t exp(-t s) F(s) ds`` with F of `_below`."""
        x = self.rate * np.asarray(t, dtype=float)
        if self.order == 1:
            return np.exp(-x)
        return self._over_decades(x, lambda y: y * np.exp(-np.minimum(y, GONE)), 4.0)

    def integral(self, t: ArrayLike) -> np.ndarray:
        """``int_0^t K``, to full precision by the same quadrature."""
        t = np.asarray(t, dtype=float)
        x = self.rate * t
        if self.order == 1:
            return t * mean_exponential(x)

        def weight(y):
            return np.where(y < 1e3, y * first_moment_exponential(np.minimum(y, 1e3)), 1 / y)

        return t * self._over_decades(x, weight, 40 / (1 - self.order))

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """``s**(order - 1) / (s**order + rate**order)``."""
        s = np.asarray(s)
        return 1 / (s + self.rate**self.order * s ** (1 - self.order))

    def fit(self, t_min: float, t_max: float, tol: float) -> ExponentialSum:
        """By its values, or by its spectrum where the tolerance is too tight for these."""
        t_min, t_max, tol = fit_interval(t_min, t_max, tol)
        if self.order == 1:
            refuse_gone(self.rate * t_min, t_min)
            return Prony([self.rate], [1.0]).fit(t_min, t_max, tol)
        width = math.pi * (1 - self.order) / self.order
        centre, reach = math.log(self.rate), 40 / self.order
        density = Density(self._spectrum, centre, width, t_min, reach)
        return fit_positive(self, t_min, t_max, tol, density)

    def _below(self, v):
        """F, the share of the spectrum below the log rate v (in units of `rate`)."""
        theta, u = math.pi * self.order, np.maximum(self.order * v, -GONE)
        gap = math.sin(math.pi / 2 * (1 - self.order))  # cos(theta) = 2 gap**2 - 1
        return np.arctan2(math.sin(math.pi * (1 - self.order)), np.expm1(-u) + 2 * gap**2) / theta

    def _spectrum(self, v):
        """Density per log rate, ``sin(theta) / (2 pi (cosh u + cos(theta)))``, u = order * v."""
        u = self.order * (v - math.log(self.rate))
        gap = math.sin(math.pi / 2 * (1 - self.order))
        top = math.sin(math.pi * (1 - self.order)) / (4 * math.pi)
        return top / (np.sinh(np.clip(u / 2, -350, 350)) ** 2 + gap**2)

    def _over_decades(self, x, weight, far):
        """``int weight(y) F(log(y / x)) dlog y`` for log y in [-40, far], x in any shape.

        Gauss panels, short beside the spectrum's peak; for large y the weight is 1/y and F is 1.
        """
        flat = x.ravel()
        values = np.ones(flat.size)  # both kernels' mean is 1 at x = 0
        log_x = np.log(np.maximum(flat, 1e-320))
        decade = np.floor(log_x / 2.3)
        for d in np.unique(decade[flat > 0]):
            mine = np.flatnonzero((decade == d) & (flat > 0))
            low, high = -42.4 - 2.3 * d, far - 2.3 * d
            high = min(high, max(40.0 - 2.3 * d, 40 / self.order)) if far > 4.0 else high
            v, share = self._panels(low, high)
            share = share * self._below(v)
            for block in np.array_split(mine, 1 + mine.size * v.size // 2_000_000):
                y = np.exp(np.add.outer(log_x[block], v))
                values[block] = weight(y) @ share
                if far > 4.0:
                    values[block] += np.exp(-high - log_x[block])
        return values.reshape(x.shape)

    def _panels(self, low, high):
        """Gauss nodes and weights on [low, high], panels at most 1 long and graded towards 0."""
        length, ends = min(1.0, 0.5 * math.pi * (1 - self.order) / self.order), [0.0]
        while ends[-1] < max(high, -low):
            ends.append(ends[-1] + length)
            length = min(1.0, 1.5 * length)
        both = np.concatenate([-np.array(ends[:0:-1]), ends])
        edges = np.concatenate([[low], both[(both > low) & (both < high)], [high]])
        nodes, weights = gauss_unit(16)
        sizes = np.diff(edges)[:, None]
        return (edges[:-1, None] + sizes * nodes).ravel(), (sizes * weights).ravel()
