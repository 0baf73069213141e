"""Contract of memory kernels, kernels times numbers, and sums of exponentials."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..support.checks import instance, real, real_array, refuse
from ..support.warning import warn
from .exponential_sum import fit_interval
from .kernel_fits import closest_positive, in_pairs
from .special import mean_exponential

# Between check points the error of a fit is at most this multiple of the largest error at them.
_ERROR_BETWEEN_CHECKS = 1.05
# Least tolerance of kernel fits on given steps, whose schemes have larger errors.
_ON_GIVEN_STEPS = 1e-6
# Largest misfit of a table that counts as noise: 3 % of noise leave it at a thousand data.
_MAX_TABLE_NOISE = 0.1
_ADVICE = "allow for that, or use Direct or FFT, which take kernels as they are"

# Slowest rate in fits of named kernels, in units of 1 / t_max. Slower modes differ from a constant
# by rounding alone.
_SLOWEST_RATE = 1e-14


class KernelWarning(UserWarning):
    """The sum of exponentials for a kernel has an error above its tolerance."""


class MemoryKernel(ABC):
    """Contract of every memory kernel K(t), t > 0; see `hereditary.kernels`.

    It can be multiplied and divided by a number: ``2 * kernel``, ``kernel / 3``.
    """

    # without this NumPy would take `number * kernel` for an array's product
    __array_ufunc__ = None

    @property
    @abstractmethod
    def singular_exponent(self) -> float:
        """The a >= 0 of ``K ~ t**-a`` near 0; 0 where K(0) is finite [-]."""

    @property
    def generators(self) -> tuple[float, ...]:
        """Numbers g > 0; the powers of t in ``t**a K(t)`` near 0 are sums of them and of 1 [-]."""
        return ()

    @property
    def t_last(self) -> float:
        """Time up to which the kernel is known; finite for tables and fitted sums alone [time]."""
        return math.inf

    @property
    def by_values(self) -> bool:
        """Whether only values are known, so that each run fits the kernel over its own range."""
        return False

    @property
    def measured(self) -> bool:
        """Whether its values are measured: their noise may prevent a closer fit."""
        return False

    @abstractmethod
    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Return kernel values at times t > 0, the shape of `t`."""

    @abstractmethod
    def integral(self, t: ArrayLike) -> np.ndarray:
        """Return ``int_0^t K(s) ds`` at times t >= 0, the shape of `t`."""

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """Return ``int_0^inf K(t) exp(-s t) dt`` at complex s, Re s >= 0, the shape of `s`."""
        required, remedy = "have a Laplace transform in closed form", "take its fit_exponentials"
        refuse("kernel", required, repr(self), remedy)

    def fit(self, t_min: float, t_max: float, tol: float) -> ExponentialSum:
        """Return the kernel as a sum of exponentials on [t_min, t_max]; see `fit_exponentials`."""
        fit = self.closest_fit(t_min, t_max, tol)
        if fit.max_error > tol:
            refuse("tol", f"be at least {1.1 * fit.max_error:.1e} for this kernel", tol)
        return fit

    def closest_fit(
        self, t_min: float, t_max: float, tol: float, fading: bool = False
    ) -> ExponentialSum:
        """Fit as `fit` does, or as closely as possible, with a larger `max_error`.

        Where it is `fading`, a kernel known by its values is fitted without rate 0.
        """
        t_min, t_max, tol = fit_interval(t_min, t_max, tol)
        return self._closest(t_min, t_max, tol, fading)

    def _closest(self, t_min: float, t_max: float, tol: float, fading: bool) -> ExponentialSum:
        """Return the sum of `closest_fit`, whose arguments are checked."""
        fit = ExponentialSum(*closest_positive(self, t_min, t_max, tol, fading))
        if self.by_values:
            return fit
        # no named kernel has a constant part, so a rate of 0 is replaced by the slowest rate
        return replace(fit, rates=np.maximum(fit.rates, _SLOWEST_RATE / t_max))

    def __mul__(self, factor: float) -> ScaledKernel:
        return _scaled(_not_zero("factor", factor), self)

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> ScaledKernel:
        inverse = 1 / _not_zero("divisor", divisor)
        if not math.isfinite(inverse):
            refuse("divisor", "be a finite number other than 0, and so its inverse", divisor)
        return _scaled(inverse, self)


@dataclass(frozen=True, repr=False)
class ScaledKernel(MemoryKernel):
    """A memory kernel times a number; made by ``2 * kernel`` or ``kernel / 3``."""

    # terms multiply their coefficient by the number, so that only the shape distinguishes kernels

    factor: float  # not 0; where it is negative, so are the weights of its fit [-]
    kernel: MemoryKernel

    def __post_init__(self) -> None:
        # the product of two factors may overflow, or become 0
        _not_zero("factor", self.factor)

    def __repr__(self) -> str:
        return f"{self.factor} * {self.kernel!r}"

    singular_exponent = property(attrgetter("kernel.singular_exponent"))
    generators = property(attrgetter("kernel.generators"))
    t_last = property(attrgetter("kernel.t_last"))
    by_values = property(attrgetter("kernel.by_values"))
    measured = property(attrgetter("kernel.measured"))

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Return the kernel values, the shape of `t`."""
        return self.factor * self.kernel(t)

    def integral(self, t: ArrayLike) -> np.ndarray:
        """Return ``int_0^t`` of the kernel."""
        return self.factor * self.kernel.integral(t)

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """Return the Laplace transform of the kernel."""
        return self.factor * self.kernel.laplace(s)

    def fit(self, t_min: float, t_max: float, tol: float) -> ExponentialSum:
        """Return the sum of the kernel with all weights multiplied by the factor."""
        fit = self.kernel.fit(t_min, t_max, tol)
        return replace(fit, weights=self.factor * fit.weights)

    def _closest(self, t_min: float, t_max: float, tol: float, fading: bool) -> ExponentialSum:
        """Return the closest sum of the kernel with all weights multiplied by the factor."""
        fit = self.kernel._closest(t_min, t_max, tol, fading)
        return replace(fit, weights=self.factor * fit.weights)


class _Exponentials(MemoryKernel):
    """A kernel that is a sum of exponentials, of `rates` and `weights`; complex ones in pairs."""

    rates: np.ndarray | tuple[complex, ...]
    weights: np.ndarray | tuple[complex, ...]
    singular_exponent = 0.0

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Return values of the sum, in the shape of `t`."""
        t = np.asarray(t, dtype=float)
        return (np.exp(-np.multiply.outer(t, self.rates)) @ np.asarray(self.weights)).real

    def integral(self, t: ArrayLike) -> np.ndarray:
        """Return ``int_0^t`` of the sum, in closed form."""
        t = np.asarray(t, dtype=float)
        means = mean_exponential(np.multiply.outer(t, self.rates))
        return t * (means @ np.asarray(self.weights)).real

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """Return ``sum_i weights[i] / (s + rates[i])``."""
        return (1 / np.add.outer(np.asarray(s), self.rates)) @ np.asarray(self.weights)

    def _closest(self, t_min: float, t_max: float, tol: float, fading: bool) -> ExponentialSum:
        """Return the sum itself, exact at any tolerance."""
        return ExponentialSum(np.array(self.rates), np.array(self.weights), t_min, t_max, 0.0)


@dataclass(frozen=True, eq=False)
class ExponentialSum(_Exponentials):
    """A kernel as a sum of decaying exponentials, ``K(t) ~ sum_i weights[i] exp(-rates[i] t)``.

    Attributes
    ----------
    rates : ndarray, shape (n_modes,)
        Non-negative and increasing; of signed kernels complex in conjugate pairs [1/time].
    weights : ndarray, shape (n_modes,)
        Positive, but for signed kernels [unit of the kernel].
    t_min, t_max : float
        Interval of the fit [time].
    max_error : float
        Largest relative error found on the fit's own check points [-].
    """

    rates: np.ndarray
    weights: np.ndarray
    t_min: float
    t_max: float
    max_error: float

    @property
    def n_modes(self) -> int:
        """Number of exponentials."""
        return self.rates.size

    @property
    def t_last(self) -> float:
        """End of the fit."""
        return float(self.t_max)


@dataclass(frozen=True, init=False)
class Prony(_Exponentials):
    """A finite sum of exponentials, ``K(t) = sum_i weights[i] exp(-rates[i] t)``.

    Parameters
    ----------
    rates : array_like, shape (n,)
        Not negative; or complex, in conjugate pairs, with real parts of at least 0 [1/time].
    weights : array_like, shape (n,)
        Positive for real rates. With complex rates of any sign, and conjugate for pairs [unit of
        the kernel].

    Examples
    --------
    >>> from hereditary import Prony
    >>> round(float(Prony([0.0, 2.0], [1.0, 3.0])(0.5)), 6)
    2.103638
    """

    rates: tuple[complex, ...]
    weights: tuple[complex, ...]

    def __init__(self, rates: ArrayLike, weights: ArrayLike) -> None:
        rate, weight = matching("rates", np.real(rates), "weights", np.real(weights))
        if np.iscomplexobj(rates) or np.iscomplexobj(weights):
            turns, phases = matching("rates", np.imag(rates), "weights", np.imag(weights))
            rate, weight = rate + 1j * turns, weight + 1j * phases
        if np.any(rate.real < 0):
            remedy = "pass a function that grows as hereditary.Kernel(function, signed=True)"
            refuse("rates", "not be negative", rate.tolist(), remedy)
        distinct, index = np.unique(rate, return_inverse=True)
        masses = np.zeros(distinct.size, dtype=weight.dtype)
        np.add.at(masses, index, weight)
        order = in_pairs(distinct)
        distinct, masses = distinct[order], masses[order]
        if not distinct.imag.any():
            all_positive("weights", masses)
        with_both = distinct[in_pairs(distinct.conj())], masses[in_pairs(distinct.conj())]
        if not np.allclose(with_both, (distinct.conj(), masses.conj()), rtol=1e-12, atol=0):
            required, remedy = "be complex in conjugate pairs", "the kernel is real"
            refuse("rates and weights", required, distinct.tolist(), remedy)
        object.__setattr__(self, "rates", tuple(distinct.tolist()))
        object.__setattr__(self, "weights", tuple(masses.tolist()))


def fit_exponentials(
    kernel: MemoryKernel, t_min: float, t_max: float, tol: float
) -> ExponentialSum:
    """Fit a memory kernel by a sum of exponentials with positive weights.

    Parameters
    ----------
    kernel : MemoryKernel
        A power law, ``hereditary.PowerLaw(exponent)``, or any other memory kernel; pass your own
        function as ``Kernel(function)``.
    t_min, t_max : float
        Interval of the fit, 0 < t_min < t_max [time].
    tol : float
        Largest relative error allowed on [t_min, t_max], 1e-13 <= tol <= 0.1 [-].

    Returns
    -------
    ExponentialSum
        Its ``max_error`` is at most `tol`, or larger at the data of a table (see Error).

    Error
    -----
    Relative error at most `tol` on [t_min, t_max], checked at 24 or more points per oscillation of
    the error curve. Between them it is at most 1.05 times `max_error`. Where the kernel is below a
    thousandth of its mean from 0 to t, the error is relative to that bound. The mean is what a
    convolution sees. Power laws, tempered ones too, are accurate relative to K everywhere. For a
    table the error is the misfit at the data, whose root mean square is at most `tol`. For a signed
    kernel the largest ``|K|`` from each time on counts instead of K. Beyond t_max the sum decays
    too fast and must not be used. Below 1e-13 the rounding of the sum itself is no longer
    negligible.

    Cost
    ----
    A power law takes a millisecond. A kernel fitted by its values takes about 10 milliseconds, at
    most two seconds (200 random kernels: convergence/random_kernels.py). A signed one takes 0.1 to
    0.4 seconds with one thread of BLAS, and up to 20 if its threads compete for busy cores. A
    repeated call is served from a cache. The number of modes grows like
    ``log(t_max / t_min) * log(1 / tol) / pi**2``. A power law has 2 to 12 modes more than the
    least possible number.

    Source
    ------
    Trapezoid rule and its error: [McLean2018], section 2. The Gauss rule of the slow tail uses the
    idea of the Prony reduction there. The recurrence of its orthogonal polynomials is in
    [KoekoekLeskySwarttouw2010], section 14.12. See docs/theory.md.

    Examples
    --------
    >>> import hereditary as hd
    >>> fit = hd.fit_exponentials(hd.PowerLaw(0.5), 1e-3, 1e3, 1e-10)
    >>> bool(abs(fit(4.0) - 0.5) < 0.5e-10), fit.n_modes < 50
    (True, True)
    """
    instance("kernel", kernel, MemoryKernel, "hereditary.PowerLaw(exponent)")
    return kernel.fit(t_min, t_max, tol)


class KernelErrors(NamedTuple):
    """Largest errors of the sums that replace general kernels [-]."""

    exact: float = 0.0  # of kernels with exact values
    measured: float = 0.0  # of measured kernels

    @classmethod
    def of(cls, kernels: Iterable, fits: Iterable) -> KernelErrors:
        """Return the largest errors of these fits."""
        errors: tuple[list, list] = [0.0], [0.0]
        for kernel, fit in zip(kernels, fits, strict=True):
            errors[kernel.measured].append(fit.max_error)
        return cls(*map(max, errors))

    @property
    def reported(self) -> float:
        """The largest error, raised by what check points may have missed."""
        return _ERROR_BETWEEN_CHECKS * max(self)

    @property
    def noise(self) -> float:
        """The largest error of measured kernels if it may be noise, otherwise 0."""
        return self.measured if self.measured <= _MAX_TABLE_NOISE else 0.0

    def misfit(self, tol: float) -> str:
        """Say by how much kernels miss the tolerance of a run; empty if they keep it."""
        # errors of measured kernels count only if they exceed noise
        if self == NO_ERRORS:
            return ""
        error = self.exact if self.noise else max(self)
        if error <= tol:
            return ""
        clause = f"its sum of exponentials differs by up to {error:.1e}"
        return f"{clause}, more than the {tol:.0e} allowed; {_ADVICE}"


NO_ERRORS = KernelErrors()


def misfit_on_given_steps(errors: KernelErrors, history: Any) -> str:
    """Return the misfit of a run on given steps; warn of other errors beyond the tolerance."""
    tol = getattr(history, "tol", 0.0)
    misfit = errors.misfit(max(tol, _ON_GIVEN_STEPS))
    warn_of_fit(errors.noise if misfit else max(errors), tol)
    return misfit


def warn_of_fit(error: float, tol: float) -> None:
    """Warn, at the line of the user, that the sum of a kernel misses its tolerance."""
    if error <= tol:
        return
    clause = f"a kernel differs by up to {error:.1e} from its sum of exponentials"
    warn(f"{clause}, more than the {tol:.0e} asked for; {_ADVICE}", KernelWarning)


def _scaled(factor: float, kernel: MemoryKernel) -> ScaledKernel:
    """Return ``factor * kernel``; a factor of the kernel is multiplied into the new one."""
    if isinstance(kernel, ScaledKernel):
        factor, kernel = factor * kernel.factor, kernel.kernel
    return ScaledKernel(factor, kernel)


def _not_zero(argument: str, value: Any) -> float:
    """Return `value` as a finite float other than 0."""
    required = "be a finite number other than 0"
    number = real(argument, value, required)
    if number == 0:
        refuse(argument, required, number)
    return number


def matching(
    name: str, first: ArrayLike, other: str, second: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Return two arrays of equal length, at least 1."""
    a, b = np.atleast_1d(real_array(name, first)), np.atleast_1d(real_array(other, second))
    if a.ndim != 1 or a.shape != b.shape or a.size == 0:
        refuse(name, f"have shape (n,) as {other}, n >= 1", f"shapes {a.shape} and {b.shape}")
    return a, b


def all_positive(name: str, values: np.ndarray) -> None:
    """Refuse an array with an entry that is not above 0."""
    if np.any(values <= 0):
        remedy = "leave out what has no weight" if np.any(values == 0) else ""
        refuse(name, "be positive", values.tolist(), remedy)
