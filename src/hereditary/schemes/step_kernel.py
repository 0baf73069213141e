"""Any memory kernel seen in units of the step (floor 2), and its weight rules on uniform steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from .._checks import complaint
from ..memory_kernel import ExponentialSum, MemoryKernel
from ..special import alternating_sum, gauss_unit, mean_exponential
from ..system import KernelTerm
from .scheme import WeightRule

# Terms after which an alternating sum of the weights is right to 1e-14.
_ALTERNATING = 24


@dataclass(frozen=True)
class Integrated:
    """The kernel ``int_0^t K``: with y' it gives ``int_0^t K(t-s) y(s) ds``, but for y(0) times it.

    Attributes
    ----------
    kernel : MemoryKernel
    """

    kernel: MemoryKernel

    @property
    def t_last(self):
        """As for the kernel."""
        return self.kernel.t_last

    @property
    def by_values(self):
        """As for the kernel."""
        return self.kernel.by_values

    def __call__(self, t):
        """Return values of the kernel."""
        return self.kernel.integral(t)

    def integral(self, t):
        """``int_0^t``; by a rule that is graded towards 0, where the kernel is a power of t."""
        u, weights = _graded()
        return t * (self.kernel.integral(t * u) @ weights)

    def closest_fit(self, t_min, t_max, tol):
        """Fit an exponential sum, a constant among it: the kernel's, integrated from t_min."""
        fit = self.kernel.closest_fit(t_min, t_max, tol, fading=True)
        if np.any(fit.rates <= 0):
            required = "decay where y itself is remembered (derivative 0)"
            remedy = "make the integral of y a component"
            raise ValueError(complaint("kernel", required, f"{self.kernel!r}", remedy))
        shares = fit.weights / fit.rates
        constant = float(self.kernel.integral(t_min)) + shares @ np.exp(-fit.rates * t_min)
        rates, weights = np.append(0.0, fit.rates), np.append(constant, -shares)
        return ExponentialSum(rates, weights, t_min, t_max, fit.max_error)


@lru_cache(maxsize=1)
def _graded():
    """Nodes and weights on [0, 1]: Gauss's on panels that halve towards 0."""
    u, weights = gauss_unit(16)
    ends = np.append(0.0, 0.5 ** np.arange(50, -1, -1))
    widths = np.diff(ends)[:, None]
    return (ends[:-1, None] + widths * u).ravel(), (widths * weights).ravel()


@dataclass(frozen=True)
class StepKernel:
    """The kernel ``K(h t)``, t in steps.

    Attributes
    ----------
    kernel : MemoryKernel
    h : float
        Step [time].
    """

    kernel: MemoryKernel | Integrated
    h: float

    def first(self, theta: float = 1.0) -> float:
        """``int_0^theta K(h t) dt``."""
        return float(self.kernel.integral(theta * self.h)) / self.h

    def at(self, t: np.ndarray) -> np.ndarray:
        """K(h t); beyond where it is known, which no step of a run reads, as it was there."""
        return self.kernel(np.minimum(self.h * t, self.kernel.t_last))

    def mean(self, start: float, end: float) -> float:
        """``int_start^end K(h t) dt``, 0 < start < end <= 4 start."""
        u, weights = gauss_unit(32)
        return (end - start) * float(self.at(start + (end - start) * u) @ weights)

    def shares(self, n: int) -> np.ndarray:
        """b_k = ``int_k^(k+1) K(h t) dt`` over that of k = 0, for k < n.

        By Gauss's rule: beyond the first step the kernel's singularity lies at least one interval
        away, where sixteen points leave an error of 5.8**-32.
        """
        b = np.ones(n)
        if n > 1:
            u, weights = gauss_unit(16)
            b[1:] = self.at(np.arange(1, n)[:, None] + u) @ weights / self.first()
        return b

    def alternating(self) -> float:
        """``sum_k (-1)**k b_k``."""
        return alternating_sum(self.shares(_ALTERNATING))

    def exponentials(self, n_steps: float, tol: float) -> ExponentialSum:
        """Fit an exponential sum from one step to `n_steps` steps, as close as it can be had."""
        return _exponentials(self, n_steps, tol)


@lru_cache(maxsize=64)
def _exponentials(kernel, n_steps, tol):
    end = min(kernel.h * max(n_steps, 2), kernel.kernel.t_last)
    start = min(kernel.h, end / 2)  # runs of one step read nothing of it
    fit = kernel.kernel.closest_fit(start, end, tol)
    return replace(fit, rates=fit.rates * kernel.h)


def refuse_late(system, t_end):
    """Refuse a run beyond the times at which a kernel is known."""
    for term, _ in system.memories:
        if isinstance(term, KernelTerm) and t_end > term.kernel.t_last * (1 + 1e-12):
            required = f"stay within t = {term.kernel.t_last:g}, up to which a kernel is known"
            remedy = "end the run there, or give a kernel that reaches farther"
            raise ValueError(complaint("t_end", required, f"{t_end:g}", remedy))


def of_increments(term):
    """The kernel with which a `KernelTerm` acts on increments or their differences."""
    return term.kernel if term.derivative else Integrated(term.kernel)


def weighed_kernel(c, term, h, theta):
    """Factor, rule and number of ``c`` times a `KernelTerm` seen at t_n + theta h.

    A scheme that weighs increments sees it as ``factor sum_k rule(number)_k u_(n-k)``.
    """
    number = StepKernel(of_increments(term), h)
    if term.derivative == 2:
        return c * number.first() / h, KERNEL_SECOND_DIFFERENCES, number
    return c * number.first(theta), shifted_kernel(theta), number


def value_weights(key, total, h, theta, derivative):
    """Weights ``c / total int_0^t K`` of a start value, for terms of one derivative."""
    return tuple(
        (c / total, kernel_values(theta), StepKernel(Integrated(operator.kernel), h))
        for c, operator in key
        if isinstance(operator, KernelTerm) and operator.derivative == derivative
    )


def remembers(equation, derivative):
    """Whether a term's kernel acts on this derivative of y."""
    return any(term.derivative == derivative and np.any(c) for term, c in equation.memories)


def refuse_values_beside_varying(equation):
    """Refuse terms that remember y itself beside orders that vary above order 1, for L1."""
    if equation.m == 2 and remembers(equation, 0):
        required = "be 1 or 2 with L1 in equations above order 1 whose orders vary"
        raise ValueError(complaint("derivative", required, 0, "use ExplicitCaputo or Collocation"))


def kernel_start(equation, theta, h, derivative):
    """Weights, for a plan, and value of the start value that increments leave out of terms.

    For derivative 0 that is y(0), for 1 the y'(0) that increments without h y'(0) lack.
    """
    return (
        lambda key, total: value_weights(key, total, h, theta, derivative),
        equation.y0[derivative],
    )


def _values(theta, kernel, n):
    return kernel.at(np.arange(n) + theta)


def _modal_values(theta, kernel, rates, weights, k):
    return weights * np.exp(-rates * (k + theta))


def _shifted(theta, kernel, n):
    weights = np.ones(n)
    if n > 1:
        u, gauss = gauss_unit(16)
        ends = np.arange(1, n)[:, None] - 1 + theta
        weights[1:] = kernel.at(ends + u) @ gauss / kernel.first(theta)
        weights[1] = kernel.mean(theta, 1 + theta) / kernel.first(theta)
    return weights


def _modal_shifted(theta, kernel, rates, weights, k):
    share = weights / kernel.first(theta) * mean_exponential(rates)
    return share * np.exp(-rates * (k - 1 + theta))


def _itself(kernel):
    return kernel


def _differences(kernel, n):
    return np.diff(kernel.shares(n), prepend=0.0)


def _modal(kernel, rates, weights, k):
    """Shares of b_k."""
    return weights / kernel.first() * mean_exponential(rates) * np.exp(-rates * k)


def _modal_differences(kernel, rates, weights, k):
    """Shares of ``b_k - b_(k-1)``."""
    return _modal(kernel, rates, weights, k - 1) * np.expm1(-rates)


# b_k, and b_k - b_(k-1) with b_0 for k = 0; p is a `StepKernel`
KERNEL_DIFFERENCES = WeightRule(StepKernel.shares, _itself, _modal)
KERNEL_SECOND_DIFFERENCES = WeightRule(_differences, _itself, _modal_differences)


@lru_cache(maxsize=8)
def kernel_values(theta):
    """Rule of the kernel's values at t_n + theta h themselves."""
    return WeightRule(partial(_values, theta), _itself, partial(_modal_values, theta))


@lru_cache(maxsize=8)
def shifted_kernel(theta):
    """Rule ``int_(k-1+theta)^(k+theta) K(h t) dt`` over that from 0 to theta, which is 1 for k = 0.

    For theta = 1 these are the b_k.
    """
    return WeightRule(partial(_shifted, theta), _itself, partial(_modal_shifted, theta))
