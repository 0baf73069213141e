"""Weight rules: weights of increments on a uniform mesh, from a kernel in units of the step.

All of them are moments of the kernel over intervals of one step.
"""

from functools import lru_cache, partial

import numpy as np

from ..kernels.step_kernel import Integrated, StepKernel
from .plan import WeightRule

# b_k - b_(k-1), and b_0 for k = 0, b_k being the integral over [k, k+1]
SECOND_DIFFERENCES = WeightRule(lambda kernel, n: kernel.differences(n))


@lru_cache(maxsize=8)
def shifted_differences(theta):
    """Return the rule of integrals over [k-1+theta, k+theta], for slopes at t_n + theta h.

    For theta = 1 these are the b_k above.
    """
    return WeightRule(lambda kernel, n: kernel.seen(theta, n))


FIRST_DIFFERENCES = shifted_differences(1.0)


@lru_cache(maxsize=8)
def kernel_values(theta):
    """Return the rule of the kernel's values at t_n + theta h."""
    return WeightRule(lambda kernel, n: kernel.at(np.arange(n) + theta))


def weighed(c, operator, h, theta=1.0):
    """Return factor, rule and kernel of ``c`` times an operator at t_n + theta h.

    It is ``factor sum_k rule(kernel)_k u_(n-k)`` for increments u.
    """
    second = operator.derivative == 2
    return by_rule(c, operator, h, SECOND_DIFFERENCES if second else shifted_differences(theta))


def by_rule(c, operator, h, rule):
    """Return the factor, rule and kernel of ``c`` times an operator, with any rule."""
    return c * operator.factor(h), rule, operator.in_steps(h)


def value_weights(c, operator, h, theta, derivative):
    """Return weights ``c int_0^t K`` of a start value, for a kernel on this derivative."""
    if operator.kernel is None or operator.derivative != derivative:
        return None
    return c, kernel_values(theta), StepKernel(Integrated(operator.kernel), h)


@lru_cache(maxsize=8)
def parabola_weights(theta, closing):
    """Return the rule for parabolas with slopes at t_n + theta h.

    ``W_k = a_k + m_(k+1) - m_k`` with a_k of `shifted_differences` and the moments
    ``m_k = int K(t) (middle - t) dt`` over [k-1+theta, k+theta]: the parabola on an interval leans
    on the one after it. With `closing` (theta = 1) the last interval takes the parabola of the one
    before. This adds m_0 over [0, 1] to W_0 and takes it from W_1.
    """
    return WeightRule(partial(_parabola, theta, closing))


@lru_cache(maxsize=8)
def parabola_start(theta):
    """Return the rule ``-m_(k+1)`` of the first increment, which has no interval before."""
    return WeightRule(lambda kernel, n: -kernel.moments(theta, n + 1)[..., 1:])


def _parabola(theta, closing, kernel, n):
    moments = kernel.moments(theta, n + 1)
    weights = kernel.seen(theta, n) + moments[..., 1:] - moments[..., :-1]
    if closing:
        last = np.asarray(kernel.last_moment())
        weights[..., 0] += last
        weights[..., 1:2] -= last[..., None]
    return weights
