"""Contract of memory kernels, and a sum of exponentials in place of one."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..support.checks import complaint, real
from ..support.warning import warn

# Between the check points of a fit its error is no larger than at them times this.
_MISSED = 1.05
# Least tolerance of kernels in runs on given steps, whose schemes err by more.
_ON_GIVEN_STEPS = 1e-6
_ADVICE = "allow for that, or use Direct or FFT, which take kernels as they are"


class KernelWarning(UserWarning):
    """The sum of exponentials that stands for a kernel is less close than its tolerance."""


@dataclass(frozen=True, eq=False)
class ExponentialSum:
    """A kernel as a sum of decaying exponentials, ``K(t) ~ sum_i weights[i] exp(-rates[i] t)``.

    Attributes
    ----------
    rates : ndarray, shape (n_modes,)
        Non-negative and increasing [1/time].
    weights : ndarray, shape (n_modes,)
        Positive, but for signed kernels [unit of the kernel].
    t_min, t_max : float
        Where the fit holds [time].
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

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """The sum at times `t`, in the shape of `t`."""
        t = np.asarray(t, dtype=float)
        return np.exp(-np.multiply.outer(t, self.rates)) @ self.weights


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
        """Numbers g > 0 whose sums, besides 1, are the powers of t in ``t**a K(t)`` near 0 [-]."""
        return ()

    @property
    def t_last(self) -> float:
        """Time up to which the kernel is known; infinite but for tables and fitted sums [time]."""
        return math.inf

    @property
    def by_values(self) -> bool:
        """Whether its values are all there is: then runs fit it over their own range alone."""
        return False

    @property
    def measured(self) -> bool:
        """Whether its values are measured: their noise alone may keep sums from coming closer."""
        return False

    @abstractmethod
    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Kernel values at times t > 0, the shape of `t`."""

    @abstractmethod
    def integral(self, t: ArrayLike) -> np.ndarray:
        """``int_0^t K(s) ds`` at times t >= 0, the shape of `t`."""

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """``int_0^inf K(t) exp(-s t) dt`` at complex s, Re s >= 0, the shape of `s`."""
        required, remedy = "have a Laplace transform in closed form", "take its fit_exponentials"
        raise ValueError(complaint("kernel", required, repr(self), remedy))

    @abstractmethod
    def fit(self, t_min: float, t_max: float, tol: float) -> ExponentialSum:
        """The kernel as a sum of exponentials on [t_min, t_max]; see `fit_exponentials`."""

    def closest_fit(
        self, t_min: float, t_max: float, tol: float, fading: bool = False
    ) -> ExponentialSum:
        """As `fit`, or what comes closest where `tol` cannot be met: `max_error` tells.

        Where it is `fading`, a kernel known by its values is fitted without rate 0.
        """
        return self.fit(t_min, t_max, tol)

    def __mul__(self, factor: float) -> ScaledKernel:
        return _scaled(_not_zero("factor", factor), self)

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> ScaledKernel:
        inverse = 1 / _not_zero("divisor", divisor)
        if not math.isfinite(inverse):
            required = "be a finite number other than 0, and so its inverse"
            raise ValueError(complaint("divisor", required, divisor))
        return _scaled(inverse, self)


@dataclass(frozen=True, repr=False)
class ScaledKernel(MemoryKernel):
    """A memory kernel times a number; made by ``2 * kernel`` or ``kernel / 3``.

    Terms take the number into their coefficient, so that kernels are told apart by their shape
    alone.

    Attributes
    ----------
    factor : float
        Not 0; where it is negative, so are the weights of its fit [-].
    kernel : MemoryKernel
    """

    factor: float
    kernel: MemoryKernel

    def __post_init__(self):
        # a product of two factors may leave the range of numbers
        _not_zero("factor", self.factor)

    def __repr__(self):
        return f"{self.factor} * {self.kernel!r}"

    @property
    def singular_exponent(self) -> float:
        """Singular exponent of the kernel."""
        return self.kernel.singular_exponent

    @property
    def generators(self) -> tuple[float, ...]:
        """Generators of the kernel."""
        return self.kernel.generators

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Kernel values, the shape of `t`."""
        return self.factor * self.kernel(t)

    def integral(self, t: ArrayLike) -> np.ndarray:
        """``int_0^t`` of it."""
        return self.factor * self.kernel.integral(t)

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """Laplace transform of it."""
        return self.factor * self.kernel.laplace(s)

    @property
    def t_last(self) -> float:
        """Last time of the kernel."""
        return self.kernel.t_last

    @property
    def by_values(self) -> bool:
        """As for the kernel."""
        return self.kernel.by_values

    @property
    def measured(self) -> bool:
        """As for the kernel."""
        return self.kernel.measured

    def fit(self, t_min: float, t_max: float, tol: float) -> ExponentialSum:
        """The kernel's sum with all weights times the factor."""
        fit = self.kernel.fit(t_min, t_max, tol)
        return replace(fit, weights=self.factor * fit.weights)

    def closest_fit(
        self, t_min: float, t_max: float, tol: float, fading: bool = False
    ) -> ExponentialSum:
        """The kernel's closest sum with all weights times the factor."""
        fit = self.kernel.closest_fit(t_min, t_max, tol, fading)
        return replace(fit, weights=self.factor * fit.weights)


class KernelErrors(NamedTuple):
    """Largest errors of the sums that stand for general kernels.

    Attributes
    ----------
    exact, measured : float
        Of kernels whose values are exact, and of measured ones [-].
    """

    exact: float = 0.0
    measured: float = 0.0

    @classmethod
    def of(cls, kernels, fits):
        """Return the largest errors of these fits."""
        errors: tuple[list, list] = [0.0], [0.0]
        for kernel, fit in zip(kernels, fits, strict=True):
            errors[kernel.measured].append(fit.max_error)
        return cls(*map(max, errors))

    @property
    def reported(self):
        """The largest error, with what check points may have missed."""
        return _MISSED * max(self)

    def misfit(self, tol):
        """Say by how much exact kernels miss the tolerance of a run; empty where they keep it."""
        if self.exact <= tol:
            return ""
        clause = f"its sum of exponentials differs by up to {self.exact:.1e}"
        return f"{clause}, more than the {tol:.0e} asked for; {_ADVICE}"


NO_ERRORS = KernelErrors()


def misfit_on_given_steps(errors, history):
    """Return the misfit of a run on given steps; warn of other errors beyond the history's."""
    tol = getattr(history, "tol", 0.0)
    misfit = errors.misfit(max(tol, _ON_GIVEN_STEPS))
    warn_of_fit(errors.measured if misfit else max(errors), tol)
    return misfit


def warn_of_fit(error, tol):
    """Warn, where the package was called, of a kernel's sum that misses its tolerance."""
    if error <= tol:
        return
    clause = f"a kernel differs by up to {error:.1e} from its sum of exponentials"
    warn(f"{clause}, more than the {tol:.0e} asked for; {_ADVICE}", KernelWarning)


def _scaled(factor, kernel):
    """``factor * kernel`` with one factor in all."""
    if isinstance(kernel, ScaledKernel):
        factor, kernel = factor * kernel.factor, kernel.kernel
    return ScaledKernel(factor, kernel)


def _not_zero(argument, value):
    """Return `value` as a finite float other than 0."""
    required = "be a finite number other than 0"
    number = real(argument, value, required)
    if number == 0:
        raise ValueError(complaint(argument, required, number))
    return number
