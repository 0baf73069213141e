"""Power laws with a cut-off, and mixtures of power laws."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import rgamma

from ..support.checks import complaint, count, real, within
from .density import Density
from .exponential_sum import fit_interval, fit_power
from .kernel_fits import fit_positive
from .kernel_tools import (
    BELOW_ONE,
    GONE,
    all_positive,
    matching,
    mean_of_decay,
    not_negative,
    refuse_gone,
)
from .memory_kernel import ExponentialSum, MemoryKernel
from .special import gauss_unit

# As a peak's width: none.
_NO_PEAK = 1e6


@dataclass(frozen=True)
class TemperedPowerLaw(MemoryKernel):
    """The memory kernel ``K(t) = t**-exponent exp(-rate t)``.

    Parameters
    ----------
    exponent : float
        0 < exponent < 1 [-].
    rate : float
        rate >= 0 [1/time]; 0 gives the power law.

    Examples
    --------
    >>> from hereditary import TemperedPowerLaw
    >>> round(float(TemperedPowerLaw(0.5, 1.0)(4.0)), 6)
    0.009158
    """

    exponent: float
    rate: float

    def __post_init__(self):
        within("exponent", self.exponent, math.ulp(0.0), BELOW_ONE, "(0, 1)")
        not_negative("rate", self.rate)

    @property
    def singular_exponent(self) -> float:
        """The exponent of the power law."""
        return float(self.exponent)

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Kernel values, the shape of `t`."""
        t = np.asarray(t, dtype=float)
        return t**-self.exponent * np.exp(-self.rate * t)

    def integral(self, t: ArrayLike) -> np.ndarray:
        """``int_0^t K``, an incomplete gamma function."""
        t = np.asarray(t, dtype=float)
        p = 1 - self.exponent
        return t**p / p * mean_of_decay(p, self.rate * t)

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """``Gamma(1 - exponent) (s + rate)**(exponent - 1)``."""
        p = 1 - self.exponent
        return math.gamma(p) * (np.asarray(s) + self.rate) ** -p

    def fit(self, t_min: float, t_max: float, tol: float) -> ExponentialSum:
        """The power law's sum with all rates faster by `rate`; see `fit_exponentials`."""
        t_min, t_max, tol = fit_interval(t_min, t_max, tol)
        refuse_gone(self.rate * t_min, t_min)
        end = min(t_max, max(GONE / self.rate, 2 * t_min)) if self.rate else t_max
        power = fit_power(float(self.exponent), t_min, end, tol)
        return ExponentialSum(power.rates + self.rate, power.weights, t_min, t_max, power.max_error)


@dataclass(frozen=True, init=False)
class DistributedOrder(MemoryKernel):
    """A mixture of Caputo kernels, ``K(t) = sum_k weights[k] t**-orders[k] / Gamma(1-orders[k])``.

    Parameters
    ----------
    orders : array_like, shape (n,)
        0 <= order < 1 [-]; order 0 adds a constant.
    weights : array_like, shape (n,)
        Positive.

    Examples
    --------
    >>> from hereditary import DistributedOrder
    >>> round(float(DistributedOrder([0.0, 0.5], [1.0, 1.0])(4.0)), 6)
    1.282095
    """

    orders: tuple[float, ...]
    weights: tuple[float, ...]
    _factors: np.ndarray = field(repr=False, compare=False)

    def __init__(self, orders: ArrayLike, weights: ArrayLike) -> None:
        order, weight = matching("orders", orders, "weights", weights)
        if np.any(order < 0) or np.any(order >= 1):
            raise ValueError(complaint("orders", "lie in [0, 1)", order.tolist()))
        all_positive("weights", weight)
        object.__setattr__(self, "orders", tuple(order.tolist()))
        object.__setattr__(self, "weights", tuple(weight.tolist()))
        object.__setattr__(self, "_factors", weight * rgamma(1 - order))

    @classmethod
    def from_density(
        cls, density: Callable[[float], float], low: float = 0.0, high: float = 1.0, n: int = 32
    ) -> DistributedOrder:
        """``int_low^high density(a) t**-a / Gamma(1-a) da`` by the Gauss rule of `n` points.

        Parameters
        ----------
        density : callable
            Positive and smooth on (low, high).
        low, high : float
            0 <= low < high <= 1 [-].
        n : int
            Points; 32 reach rounding over a hundred decades of t for smooth densities.
        """
        low = within("low", low, 0.0, BELOW_ONE, "[0, 1)")
        high = within("high", high, math.nextafter(low, 1.0), 1.0, f"({low}, 1]")
        nodes, weights = gauss_unit(count("n", n))
        orders = low + (high - low) * nodes
        values = [real("density(order)", density(float(a))) for a in orders]
        return cls(orders, (high - low) * weights * np.array(values))

    @property
    def singular_exponent(self) -> float:
        """The largest order."""
        return max(self.orders)

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Kernel values, the shape of `t`."""
        t = np.asarray(t, dtype=float)
        return np.power.outer(t, -np.array(self.orders)) @ self._factors

    def integral(self, t: ArrayLike) -> np.ndarray:
        """``int_0^t K``, in closed form."""
        t, order = np.asarray(t, dtype=float), np.array(self.orders)
        return np.power.outer(t, 1 - order) @ (self._factors / (1 - order))

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """``sum_k weights[k] s**(orders[k] - 1)``."""
        return np.power.outer(np.asarray(s), np.array(self.orders) - 1) @ np.array(self.weights)

    def fit(self, t_min: float, t_max: float, tol: float) -> ExponentialSum:
        """By its values, or by its spectrum where the tolerance is too tight for these."""
        t_min, t_max, tol = fit_interval(t_min, t_max, tol)
        density = Density(self._spectrum, 0.0, _NO_PEAK, t_min, rest=self._slowest)
        return fit_positive(self, t_min, t_max, tol, density)

    def _spectrum(self, v):
        """Density per log rate, ``sum_k factors[k] exp(orders[k] v) / Gamma(orders[k])``."""
        order = np.array(self.orders)
        return np.exp(np.multiply.outer(v, order)) @ (self._factors * rgamma(order))

    def _slowest(self, v, step):
        """Sum over all of the grid v - step, v - 2 step, ...; order 0 is a constant as it is."""
        order, constant = np.array(self.orders), np.array(self.orders) == 0
        safe = np.where(constant, 1.0, order)
        sums = rgamma(safe) * step * np.exp(safe * v) / np.expm1(safe * step)
        return float(self._factors @ np.where(constant, 1.0, sums))
