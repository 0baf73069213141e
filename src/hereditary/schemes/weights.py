"""Weight rules: what schemes weigh increments with on a uniform mesh (floor 2).

All of them are moments of the kernel ``p t**(p-1)``, 0 <= p < 1, over intervals of one step (t in
units of the step). As p tends to 0 the kernel becomes a point mass at 0: no memory.
"""

from functools import partial

import numpy as np

from ..special import (
    first_moment_exponential,
    gauss_unit,
    mean_exponential,
    power_differences,
    power_second_differences,
)
from .scheme import WeightRule


def _exponent(p):
    """The kernel ``t**(p-1)`` is ``t**-a`` with a = 1 - p."""
    return 1 - p if p > 0 else None


def _modal(p, rates, weights, k):
    """Shares of ``b_k = p int_k^(k+1) t**(p-1) dt``."""
    return p * weights * mean_exponential(rates) * np.exp(-rates * k)


def _modal_differences(p, rates, weights, k):
    """Shares of ``b_k - b_(k-1)``."""
    return _modal(p, rates, weights, k - 1) * np.expm1(-rates)


# b_k = (k+1)**p - k**p
FIRST_DIFFERENCES = WeightRule(power_differences, _exponent, _modal)
# b_k - b_(k-1), and b_0 for k = 0
SECOND_DIFFERENCES = WeightRule(power_second_differences, _exponent, _modal_differences)


def shifted_differences(theta):
    """Rule ``(k+theta)**p - (k-1+theta)**p``, and theta**p for k = 0: slopes seen at t_n + theta h.

    For theta = 1 these are the b_k above.
    """
    return WeightRule(partial(_shifted, theta), _exponent, partial(_modal_shifted, theta))


def _shifted(theta, p, n):
    weights = np.full(n, theta**p)
    if n > 1:
        k = np.arange(n - 1) + theta
        weights[1:] = k**p * np.expm1(p * np.log1p(1 / k))
    return weights


def _modal_shifted(theta, p, rates, weights, k):
    return _modal(p, rates, weights, k - 1 + theta)


def parabola_weights(theta, closing):
    """Rule for parabolas whose slopes are seen at t_n + theta h.

    ``W_k = a_k + m_(k+1) - m_k`` with a_k of `shifted_differences` and the moments
    ``m_k = int p t**(p-1) (middle - t) dt`` over [k-1+theta, k+theta]: the parabola on an interval
    leans on the one after it. With `closing` (theta = 1) the last interval takes the parabola of
    the one before, which adds m_0 over [0, 1] to W_0 and takes it from W_1.
    """
    return WeightRule(
        partial(_parabola, theta, closing), _exponent, partial(_modal_parabola, theta)
    )


def parabola_start(theta):
    """Rule ``-m_(k+1)`` for the first increment, which no interval before leans on."""
    return WeightRule(
        lambda p, n: -_slope_moments(theta, p, n + 1)[1:],
        _exponent,
        lambda p, rates, weights, k: -_modal_moment(theta, p, rates, weights, k + 1),
    )


def _parabola(theta, closing, p, n):
    moments = _slope_moments(theta, p, n + 1)
    weights = _shifted(theta, p, n) + moments[1:] - moments[:-1]
    if closing:
        last = last_moment(p)
        weights[0] += last
        weights[1:2] -= last
    return weights


def last_moment(p):
    """``int_0^1 p t**(p-1) (1/2 - t) dt``."""
    return (1 - p) / (2 * (1 + p))


def _slope_moments(theta, p, n):
    """m_0 = 0 and m_1 .. m_(n-1), by Gauss quadrature: the closed form cancels for large k.

    The kernel's singularity lies at least 0.5 before the interval, where sixteen points leave an
    error of 3.7**-32.
    """
    moments = np.zeros(n)
    v, weights = gauss_unit(16)
    middle = np.arange(n - 1)[:, None] + theta + 0.5
    # less its value in the middle, whose moment is 0: what is left cancels nowhere
    bend = np.expm1((p - 1) * np.log1p((v - 0.5) / middle))
    moments[1:] = p * middle[:, 0] ** (p - 1) * (bend @ (weights * (0.5 - v)))
    return moments


def _modal_moment(theta, p, rates, weights, k):
    middle = 0.5 * mean_exponential(rates) - first_moment_exponential(rates)
    return p * weights * middle * np.exp(-rates * (k - 1 + theta))


def _modal_parabola(theta, p, rates, weights, k):
    here = _modal_moment(theta, p, rates, weights, k)
    return _modal_shifted(theta, p, rates, weights, k) + here * np.expm1(-rates)
