"""Kernels in closed form: power laws, tempered and mixed ones, and relaxation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit, gamma, gammainc, gammaln, ndtr, rgamma

from ..support.checks import count, positive, real, refuse, within
from .exponential_sum import fit_unit
from .kernel_fits import closest_signed
from .memory_kernel import ExponentialSum, MemoryKernel, all_positive, matching
from .special import first_moment_exponential, gauss_unit, mean_exponential

# Largest exponent below 1.
_BELOW_ONE = math.nextafter(1.0, 0.0)
# Largest exponent x at which exp(-x) is computed; beyond it kernels and their sums are set to 0.
_GONE = 700.0
# Largest shape of a gamma density; each whole number is one more equation.
_MOST_STAGES = 50.0
# Rounding of a shape that was computed from a mean and a standard deviation.
_ROUNDING_OF_SHAPE = 1e-12
# Least remainder of a shape for which its density is a convolution: one of a smaller shape rises
# over more decades than numbers have.
_LEAST_REMAINDER = 0.01
# Range of the parameter sigma of lognormal densities.
_SIGMAS = 0.05, 5.0
# Range of the shapes of Weibull densities.
_SHAPES = 0.1, 20.0
# Smallest time at which the logarithm of time is taken.
_MIN_TIME_OF_LOG = 1e-300
# Step of the trapezoid rule for Cole-Cole relaxation, in units of the order: 0.26 leaves 1e-15, 0.3
# leaves 1e-13.
_SPECTRUM_STEP = 0.23


@dataclass(frozen=True)
class PowerLaw(MemoryKernel):
    """The memory kernel ``K(t) = t**-exponent``.

    Parameters
    ----------
    exponent : float
        0 < exponent <= 2 [-]. Caputo's derivative of order alpha in (0, 1) has exponent alpha,
        of order beta in (1, 2) exponent beta - 1.

    Examples
    --------
    >>> import hereditary as hd
    >>> float(hd.PowerLaw(0.5)(4.0))
    0.5
    """

    exponent: float

    def __post_init__(self) -> None:
        remedy = "K(t) is t**-exponent; Caputo(beta) with 1 < beta < 2 has beta - 1"
        within("exponent", self.exponent, 5e-324, 2.0, "(0, 2]", remedy)

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Return the kernel values, the shape of `t`."""
        return np.asarray(t, dtype=float) ** -self.exponent

    @property
    def singular_exponent(self) -> float:
        """The exponent itself."""
        return float(self.exponent)

    def integral(self, t: ArrayLike) -> np.ndarray:
        """Return ``int_0^t K`` = t**(1 - exponent) / (1 - exponent), for exponents below 1."""
        a = float(self.exponent)
        if a >= 1:
            refuse("exponent", "be below 1 for a finite integral from 0", a)
        return np.asarray(t, dtype=float) ** (1 - a) / (1 - a)

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """Return ``Gamma(1 - exponent) s**(exponent - 1)``, for exponents below 1."""
        a = float(self.exponent)
        return gamma(1 - a) * np.asarray(s) ** (a - 1)

    def _closest(self, t_min: float, t_max: float, tol: float, fading: bool) -> ExponentialSum:
        """Return the sum of exponentials in closed form, to the tolerance `tol`."""
        a = float(self.exponent)
        if abs(a * math.log(t_min)) > 690:
            refuse("t_min", "leave the kernel a finite value there", t_min)
        rates, weights, error, _ = fit_unit((a,), t_max / t_min, tol)
        return ExponentialSum(rates / t_min, weights[0] * t_min**-a, t_min, t_max, error)


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

    def __post_init__(self) -> None:
        within("exponent", self.exponent, math.ulp(0.0), _BELOW_ONE, "(0, 1)")
        if real("rate", self.rate, "be a finite number of at least 0") < 0:
            refuse("rate", "be a finite number of at least 0", self.rate)

    @property
    def singular_exponent(self) -> float:
        """The exponent of the power law."""
        return float(self.exponent)

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Return the kernel values, the shape of `t`."""
        t = np.asarray(t, dtype=float)
        return t**-self.exponent * np.exp(-self.rate * t)

    def integral(self, t: ArrayLike) -> np.ndarray:
        """Return ``int_0^t K``, an incomplete gamma function."""
        t = np.asarray(t, dtype=float)
        p = 1 - self.exponent
        return t**p / p * mean_of_decay(p, self.rate * t)

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """Return ``Gamma(1 - exponent) (s + rate)**(exponent - 1)``."""
        p = 1 - self.exponent
        return math.gamma(p) * (np.asarray(s) + self.rate) ** -p

    def _closest(self, t_min: float, t_max: float, tol: float, fading: bool) -> ExponentialSum:
        """Return the sum of the power law with all rates increased by `rate`."""
        if self.rate * t_min > _GONE:
            refuse("t_min", "come before the kernel is 0 in rounding", t_min)
        end = min(t_max, max(_GONE / self.rate, 2 * t_min)) if self.rate else t_max
        power = PowerLaw(self.exponent)._closest(t_min, end, tol, fading)
        return ExponentialSum(power.rates + self.rate, power.weights, t_min, t_max, power.max_error)


@dataclass(frozen=True)
class GammaDensity(MemoryKernel):
    """The gamma density ``K(t) = rate**shape t**(shape - 1) exp(-rate t) / Gamma(shape)``.

    It is the density of delays whose mean is shape / rate. With `rtol=` no fit is needed where it
    acts on y itself. The density of shape n + b is n exponential ones after that of shape b < 1.
    Elsewhere, and with b between 0 and 0.01, one of shape above 1 is fitted with weights of both
    signs, which takes seconds.

    Parameters
    ----------
    shape : float
        0 < shape <= 50 [-].
    rate : float
        rate > 0 [1/time].

    Examples
    --------
    >>> from hereditary import GammaDensity
    >>> round(float(GammaDensity(2.0, 1.0)(4.0)), 6)
    0.073263
    """

    shape: float
    rate: float

    def __post_init__(self) -> None:
        within("shape", self.shape, math.ulp(0.0), _MOST_STAGES, f"(0, {_MOST_STAGES:g}]")
        positive("rate", self.rate)

    @classmethod
    def from_mean(cls, mean: float, sd: float) -> GammaDensity:
        """Return the gamma density of this mean and standard deviation, both positive [time]."""
        mean, sd = positive("mean", mean), positive("sd", sd)
        return cls((mean / sd) ** 2, mean / sd**2)

    @property
    def singular_exponent(self) -> float:
        """1 - shape, or 0 for shapes from 1 on."""
        return max(1.0 - self.shape, 0.0)

    @property
    def generators(self) -> tuple[float, ...]:
        """The exponent shape - 1 of shapes above 1."""
        return (self.shape - 1.0,) if self.shape > 1 else ()

    @property
    def stages(self) -> tuple[int, float]:
        """The whole number n and the remainder b of the shape, 0 <= b < 1."""
        n = math.floor(self.shape + _ROUNDING_OF_SHAPE)
        return n, self.shape - n if self.shape - n > _ROUNDING_OF_SHAPE else 0.0

    @property
    def in_stages(self) -> bool:
        """Whether a convolution with it is one with exponential densities, and one of shape b."""
        b = self.stages[1]
        return self.shape >= 1 and (b == 0 or b >= _LEAST_REMAINDER)

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Return the kernel values, the shape of `t`."""
        x = self.rate * np.asarray(t, dtype=float)
        with np.errstate(divide="ignore"):
            return self.rate * np.exp((self.shape - 1) * np.log(x) - x - gammaln(self.shape))

    def integral(self, t: ArrayLike) -> np.ndarray:
        """Return ``int_0^t K``, a regularised incomplete gamma function."""
        return gammainc(self.shape, self.rate * np.asarray(t, dtype=float))

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """Return ``(1 + s / rate)**-shape``."""
        return (1 + np.asarray(s) / self.rate) ** -self.shape

    def _closest(self, t_min: float, t_max: float, tol: float, fading: bool) -> ExponentialSum:
        """Return the sum of a tempered power law, or a sum with both signs for shapes above 1."""
        if self.shape > 1:
            return ExponentialSum(*closest_signed(self, t_min, t_max, tol, fading))
        if self.shape == 1:
            one = np.array([self.rate])
            return ExponentialSum(one, one, t_min, t_max, 0.0)
        fit = TemperedPowerLaw(1 - self.shape, self.rate)._closest(t_min, t_max, tol, fading)
        return replace(fit, weights=self.rate**self.shape * rgamma(self.shape) * fit.weights)


@dataclass(frozen=True)
class LognormalDensity(MemoryKernel):
    """The lognormal density ``K(t) = exp(-((log(t) - mu) / sigma)**2 / 2) / (sqrt(2 pi) sigma t)``.

    It is the density of delays whose logarithms have the mean `mu` and the standard deviation
    `sigma`. It rises from 0, so it is fitted with weights of both signs, in 0.1 to 4 seconds. The
    narrower the density, the larger the error: 1e-11 of the largest values for sigma = 0.4, 5e-9
    for sigma = 0.1.

    Parameters
    ----------
    mu : float
        Mean of log(t), the logarithm of the median.
    sigma : float
        Standard deviation of log(t), 0.05 <= sigma <= 5 [-].

    Examples
    --------
    The generation time of an epidemic, of mean 5 and standard deviation 1.9:

    >>> from hereditary import LognormalDensity
    >>> LognormalDensity.from_mean(5.0, 1.9)
    LognormalDensity(mu=1.5419976713371912, sigma=0.36726078227033465)
    >>> round(float(LognormalDensity(0.0, 1.0)(1.0)), 6)
    0.398942
    """

    mu: float
    sigma: float
    singular_exponent = 0.0
    by_values = True

    def __post_init__(self) -> None:
        real("mu", self.mu)
        within("sigma", self.sigma, *_SIGMAS, "[{:g}, {:g}]".format(*_SIGMAS))

    @classmethod
    def from_mean(cls, mean: float, sd: float) -> LognormalDensity:
        """Return the lognormal density of this mean and standard deviation, positive [time]."""
        mean, sd = positive("mean", mean), positive("sd", sd)
        variance = math.log1p((sd / mean) ** 2)
        return cls(math.log(mean) - variance / 2, math.sqrt(variance))

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Return the kernel values, the shape of `t`."""
        logs = np.log(np.maximum(np.asarray(t, dtype=float), _MIN_TIME_OF_LOG))
        exponents = -(((logs - self.mu) / self.sigma) ** 2) / 2 - logs
        return np.exp(exponents) / (self.sigma * math.sqrt(2 * math.pi))

    def integral(self, t: ArrayLike) -> np.ndarray:
        """Return ``int_0^t K``, the distribution function."""
        logs = np.log(np.maximum(np.asarray(t, dtype=float), _MIN_TIME_OF_LOG))
        return ndtr((logs - self.mu) / self.sigma)

    def _closest(self, t_min: float, t_max: float, tol: float, fading: bool) -> ExponentialSum:
        """Return a sum with weights of both signs."""
        return ExponentialSum(*closest_signed(self, t_min, t_max, tol, fading))


@dataclass(frozen=True)
class WeibullDensity(MemoryKernel):
    """The Weibull density, ``K(t) = shape / scale x**(shape - 1) exp(-x**shape)``, x = t / scale.

    Of shape up to 1 it is completely monotone. Of larger shape it rises from 0, so it is fitted
    with weights of both signs, in 0.1 to 4 seconds. The error is then up to 1e-8 of the largest
    values.

    Parameters
    ----------
    shape : float
        0.1 <= shape <= 20 [-]; 1 is the exponential density.
    scale : float
        scale > 0 [time].

    Examples
    --------
    >>> from hereditary import WeibullDensity
    >>> density = WeibullDensity.from_mean(5.0, 1.9)
    >>> round(density.shape, 6), round(density.scale, 6)
    (2.854534, 5.610923)
    >>> round(float(WeibullDensity(2.0, 1.0)(1.0)), 6)
    0.735759
    """

    shape: float
    scale: float

    def __post_init__(self) -> None:
        within("shape", self.shape, *_SHAPES, "[{:g}, {:g}]".format(*_SHAPES))
        positive("scale", self.scale)

    @classmethod
    def from_mean(cls, mean: float, sd: float) -> WeibullDensity:
        """Return the Weibull density of this mean and standard deviation, positive [time]."""
        mean, sd = positive("mean", mean), positive("sd", sd)

        low, high = _SHAPES
        for _ in range(60):  # the ratio of sd to mean decreases with the shape
            shape = math.sqrt(low * high)
            ratio = math.exp(math.lgamma(1 + 2 / shape) - 2 * math.lgamma(1 + 1 / shape)) - 1
            low, high = (shape, high) if ratio > (sd / mean) ** 2 else (low, shape)
        if not _SHAPES[0] * 1.001 < shape < _SHAPES[1] / 1.001:
            required = "be 0.063 to 400 times the mean, for shapes of {:g} to {:g}"
            refuse("sd", required.format(*_SHAPES[::-1]), sd)
        return cls(shape, mean / math.gamma(1 + 1 / shape))

    @property
    def singular_exponent(self) -> float:
        """1 - shape, or 0 for shapes from 1 on."""
        return max(1.0 - self.shape, 0.0)

    @property
    def generators(self) -> tuple[float, ...]:
        """The shape, and shape - 1 if it is positive: K is a series in powers of ``t**shape``."""
        return (self.shape - 1.0, self.shape) if self.shape > 1 else (self.shape,)

    @property
    def by_values(self) -> bool:
        """Whether each run fits the density over its own range: of shapes above 1."""
        return self.shape > 1

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Return the kernel values, the shape of `t`."""
        x = np.asarray(t, dtype=float) / self.scale
        return self.shape / self.scale * x ** (self.shape - 1) * np.exp(-(x**self.shape))

    def integral(self, t: ArrayLike) -> np.ndarray:
        """Return ``int_0^t K``, the distribution function."""
        return -np.expm1(-((np.asarray(t, dtype=float) / self.scale) ** self.shape))

    def _closest(self, t_min: float, t_max: float, tol: float, fading: bool) -> ExponentialSum:
        """Return a sum with positive weights, or with both signs for shapes above 1."""
        if self.shape <= 1:
            return super()._closest(t_min, t_max, tol, fading)
        return ExponentialSum(*closest_signed(self, t_min, t_max, tol, fading))


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
            refuse("orders", "lie in [0, 1)", order.tolist())
        all_positive("weights", weight)
        object.__setattr__(self, "orders", tuple(order.tolist()))
        object.__setattr__(self, "weights", tuple(weight.tolist()))
        object.__setattr__(self, "_factors", weight * rgamma(1 - order))

    @classmethod
    def from_density(
        cls, density: Callable[[float], float], low: float = 0.0, high: float = 1.0, n: int = 32
    ) -> DistributedOrder:
        """Return ``int_low^high density(a) t**-a / Gamma(1-a) da`` by the Gauss rule of `n` points.

        Parameters
        ----------
        density : callable
            Positive and smooth on (low, high).
        low, high : float
            0 <= low < high <= 1 [-].
        n : int
            Points; 32 reach rounding over a hundred decades of t for smooth densities.
        """
        low = within("low", low, 0.0, _BELOW_ONE, "[0, 1)")
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
        """Return the kernel values, the shape of `t`."""
        t = np.asarray(t, dtype=float)
        return np.power.outer(t, -np.array(self.orders)) @ self._factors

    def integral(self, t: ArrayLike) -> np.ndarray:
        """Return ``int_0^t K``, in closed form."""
        t, order = np.asarray(t, dtype=float), np.array(self.orders)
        return np.power.outer(t, 1 - order) @ (self._factors / (1 - order))

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """Return ``sum_k weights[k] s**(orders[k] - 1)``."""
        return np.power.outer(np.asarray(s), np.array(self.orders) - 1) @ np.array(self.weights)


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
    singular_exponent = 0.0

    def __post_init__(self) -> None:
        within("exponent", self.exponent, 0.01, 1.0, "[0.01, 1]")
        positive("rate", self.rate)

    @property
    def generators(self) -> tuple[float, ...]:
        """The exponent, because the kernel is a series in its multiples."""
        return (float(self.exponent),)

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Return the kernel values, the shape of `t`."""
        return np.exp(-((self.rate * np.asarray(t, dtype=float)) ** self.exponent))

    def integral(self, t: ArrayLike) -> np.ndarray:
        """Return ``int_0^t K``, an incomplete gamma function."""
        t = np.asarray(t, dtype=float)
        return t * mean_of_decay(1 / self.exponent, (self.rate * t) ** self.exponent)


@dataclass(frozen=True)
class MittagLeffler(MemoryKernel):
    """The Cole-Cole relaxation, ``K(t) = E_order(-(rate t)**order)``.

    It is the relaxation modulus of the fractional Maxwell element. For order 1 it is exp(-rate t).
    Otherwise it is like a stretched exponential at short times, and like the power law
    ``(rate t)**-order / Gamma(1 - order)`` at long times.

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
    singular_exponent = 0.0

    def __post_init__(self) -> None:
        within("order", self.order, 0.01, 1.0, "[0.01, 1]")
        positive("rate", self.rate)

    @property
    def generators(self) -> tuple[float, ...]:
        """The order, because the kernel is a series in its multiples."""
        return (float(self.order),)

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Return the kernel values, the shape of `t`."""
        x = self.rate * np.asarray(t, dtype=float)
        if self.order == 1:
            return np.exp(-x)
        return self._over_spectrum(x, lambda y: y * np.exp(-y), 4.0)

    def integral(self, t: ArrayLike) -> np.ndarray:
        """Return ``int_0^t K``, to full precision by the same quadrature."""
        t = np.asarray(t, dtype=float)
        x = self.rate * t
        if self.order == 1:
            return t * mean_exponential(x)

        def weight(y: np.ndarray) -> np.ndarray:
            near, far = np.minimum(y, 1e3), np.maximum(y, 1e3)
            return np.where(y < 1e3, near * first_moment_exponential(near), 1 / far)

        return t * self._over_spectrum(x, weight, 40.0)

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """Return ``s**(order - 1) / (s**order + rate**order)``."""
        s = np.asarray(s)
        return 1 / (s + self.rate**self.order * s ** (1 - self.order))

    def _over_spectrum(
        self, x: np.ndarray, weight: Callable[[np.ndarray], np.ndarray], far: float
    ) -> np.ndarray:
        """Return ``int weight(x exp(v)) F dv`` for x >= 0 of any shape."""
        # F is the share of the spectrum below the log rate v, in units of `rate`, and exp(order v)
        # = sin(pi order F) / sin(pi order (1 - F)). In log F/(1 - F) all of it is smooth for every
        # order, so that the trapezoid rule converges exponentially. `far` is the log of x exp(v),
        # at least 1, and of exp(v), beyond which nothing is left.
        a = self.order
        sine = math.sin(math.pi * min(a, 1 - a))
        logs = np.log(np.maximum(x.ravel(), math.exp(-min(40 / a, _GONE))))  # the mean is 1 below
        bend, step = math.log(math.pi * a / sine), _SPECTRUM_STEP * a
        low = max(-_GONE, a * (-40 - logs.max(initial=0.0)) - bend)
        high = a * (far - logs.min(initial=0.0)) + bend
        w = step * np.arange(math.floor(low / step), math.ceil(high / step))
        f, rest = expit(w), expit(-w)
        # sin(pi z) = sin(pi (1 - z)) keeps all digits next to z = 1
        below = np.sin(np.pi * np.minimum(a * f, 1 - a + a * rest))
        above = np.sin(np.pi * np.minimum(a * rest, 1 - a + a * f))
        v = np.log(below / above) / a
        shares = step * math.pi * sine * (f / below) * (f * rest / above)
        batches = np.array_split(logs, 1 + logs.size * w.size // 2_000_000)
        parts = [weight(np.exp(np.minimum(np.add.outer(z, v), _GONE))) @ shares for z in batches]
        return np.where(x > 0, np.concatenate(parts).reshape(x.shape), 1.0)


def mean_of_decay(p: float, x: ArrayLike) -> np.ndarray:
    """Return ``p int_0^1 u**(p-1) exp(-x u) du``, 1 at x = 0, with full precision everywhere."""
    # for x < p + 1 the series exp(-x) sum_k x**k / ((p+1)...(p+k)), whose terms have one sign
    x = np.asarray(x, dtype=float)
    small = x < p + 1
    near, far = np.where(small, x, 0.0), np.where(small, 1.0, x)
    term, total, k = np.ones_like(near), np.ones_like(near), 0
    while np.any(term > 1e-17 * total):
        k += 1
        term = term * near / (p + k)
        total = total + term
    closed = gamma(p + 1) * far**-p * gammainc(p, far) if not np.all(small) else total
    return np.where(small, np.exp(-near) * total, closed)
