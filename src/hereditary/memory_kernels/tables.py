"""Sums of exponentials for measured values."""

import math
from dataclasses import replace

import numpy as np

from .._checks import complaint
from ..exponential_sum import trapezoid_step
from .fits import Samples, attempts, largest, summed, without_fastest


def fit_table(times, values, t_min, t_max, tol):
    """As `closest_table`; a ValueError says how far the fit came where `tol` was not met."""
    fit = closest_table(times, values, t_min, t_max, tol, _root_mean_square)
    rms = _root_mean_square(fit(times) / values - 1)
    if rms > tol * (1 + 1e-9):
        remedy = "allow for the noise; only completely monotone data can be fitted closely"
        required = f"be at least {1.01 * rms:.2g}, the rms misfit of the best positive sum"
        raise ValueError(complaint("tol", required, tol, remedy))
    return fit


def _root_mean_square(error):
    return math.sqrt(np.mean(error**2))


def closest_table(times, values, t_min, t_max, tol, norm=largest, fading=False):
    """A sum with positive weights for measured values; `tol` bounds a norm of relative errors.

    The closest one is returned where `tol` cannot be met.
    """
    samples = Samples(times / times[0], values, values, np.ones(times.size), fading)
    best, closest = math.inf, (np.zeros(0), np.zeros(0))
    for v, weights in attempts(samples, trapezoid_step(0.5, tol), tol, norm=norm):
        error = samples.error(v, weights)
        if norm(error) < best:
            best, closest = norm(error), (v, weights)
        if best <= tol:
            break
    (v, weights), error = closest, largest(samples.error(*closest))
    if norm is largest:  # a rate that hardly counts at the first time may weigh much before it
        v, weights, error = without_fastest(samples, max(tol, best), v, weights)
    return replace(summed(v, weights, times[0], t_max, error), t_min=t_min)
