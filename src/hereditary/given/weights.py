"""Weight rules: weights of increments on uniform steps, from a kernel in units of the step.

All weights are values of the kernel, or its integrals and first moments over intervals of one step.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any

import numpy as np

from ..equation.terms import ConstantOrder
from ..kernels.step_kernel import Integrated, PowerSteps, StepKernel
from .plan import WeightRule

# Rule of second derivatives: weights b_k - b_(k-1), and b_0 for k = 0. b_k is the integral of the
# kernel over [k, k+1].
SECOND_DIFFERENCES = WeightRule(lambda kernel, n: kernel.differences(n))


@lru_cache(maxsize=8)
def shifted_differences(theta: float) -> WeightRule:
    """Return the rule whose weights are integrals of the kernel over [k-1+theta, k+theta]."""
    # for first derivatives at t_n + theta h; the interval of k = 0 is [0, theta]
    return WeightRule(lambda kernel, n: kernel.integrals(theta, n))


# Rule of first derivatives at the end of a step: integrals of the kernel over [k, k+1].
FIRST_DIFFERENCES = shifted_differences(1.0)


@lru_cache(maxsize=8)
def kernel_values(theta: float) -> WeightRule:
    """Return the rule whose weights are values of the kernel at k + theta."""
    return WeightRule(lambda kernel, n: kernel.at(np.arange(n) + theta))


def weighed(
    c: float, operator: ConstantOrder, h: float, theta: float = 1.0
) -> tuple[float, WeightRule, PowerSteps]:
    """Return the factor, rule and kernel of ``c`` times an operator at t_n + theta h.

    This term of the equation is ``factor sum_k rule(kernel)_k u_(n-k)`` for increments u.
    """
    second = operator.derivative == 2
    return by_rule(c, operator, h, SECOND_DIFFERENCES if second else shifted_differences(theta))


def by_rule(
    c: float, operator: ConstantOrder, h: float, rule: WeightRule
) -> tuple[float, WeightRule, PowerSteps]:
    """Return the factor, rule and kernel of ``c`` times an operator, for a given rule."""
    return c * operator.factor(h), rule, operator.in_steps(h)


def value_weights(
    c: float, operator: Any, h: float, theta: float, derivative: int
) -> tuple[Any, ...] | None:
    """Return the factor, rule and kernel of ``c int_0^t K``, the weights of a start value."""
    # of y(0) (derivative 0) or y'(0) (1); None unless the operator has a general kernel K that acts
    # on this derivative
    if operator.kernel is None or operator.derivative != derivative:
        return None
    return c, kernel_values(theta), StepKernel(Integrated(operator.kernel), h)


@lru_cache(maxsize=8)
def parabola_weights(theta: float, closing: bool) -> WeightRule:
    """Return the rule of first derivatives at t_n + theta h for piecewise parabolic solutions."""
    # W_k = a_k + m_(k+1) - m_k, a_k of `shifted_differences`, m_k = int K(t) (middle - t) dt over
    # [k-1+theta, k+theta]. Parabolas use the value at the end of the next interval. With `closing`
    # (theta = 1) the last interval has the parabola before: m_0 over [0, 1] is added to W_0,
    # subtracted from W_1.
    return WeightRule(partial(_parabola, theta, closing))


@lru_cache(maxsize=8)
def parabola_start(theta: float) -> WeightRule:
    """Return the rule ``-m_(k+1)``, which corrects the weight of the first increment."""
    # it has no interval before it; for m see `parabola_weights`
    return WeightRule(lambda kernel, n: -kernel.moments(theta, n + 1)[..., 1:])


def _parabola(theta: float, closing: bool, kernel: Any, n: int) -> np.ndarray:
    moments = kernel.moments(theta, n + 1)
    weights = kernel.integrals(theta, n) + moments[..., 1:] - moments[..., :-1]
    if closing:
        last = np.asarray(kernel.last_moment())
        weights[..., 0] += last
        weights[..., 1:2] -= last[..., None]
    return weights
