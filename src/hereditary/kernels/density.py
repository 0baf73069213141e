"""Sums of exponentials from a kernel's spectral density."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .kernel_tools import gauss_rule, log_fastest


@dataclass(frozen=True)
class Density:
    """A spectral density over log rate, with a peak at `centre` of the given width.

    ``per_log_rate(v)`` integrates to K(0) over v = log(rate). Rates slower than exp(-reach) / t_max
    are left out, or enter as a constant: ``rest(v, step)``, the sum over all grid points below v.
    """

    per_log_rate: Callable
    centre: float
    width: float
    t_min: float
    reach: float = 80.0
    rest: Callable | None = None


def density_rule(density, ratio, step, tol):
    """Return rates and weights of the trapezoid rule, denser around the peak of the density.

    The slow rates are replaced by their Gauss rule.
    """
    centre = density.centre + math.log(density.t_min)
    extra, width = 1.5 / step, density.width
    low, high = -density.reach - math.log(ratio), log_fastest(tol)

    def index(v):
        return v / step + extra * np.arcsinh((v - centre) / width)

    # the map's inverse, by Newton's iteration from a table
    table = np.unique(np.concatenate([np.linspace(low, high, 2001), centre + width * _SPREAD]))
    table = table[(table >= low) & (table <= high)]
    k = np.arange(math.ceil(index(low)), math.floor(index(high)) + 1)
    v = np.interp(k, index(table), table)
    for _ in range(4):
        slope = 1 / step + extra / np.hypot(v - centre, width)
        v = v - (index(v) - k) / slope
    slope = 1 / step + extra / np.hypot(v - centre, width)
    weights = density.per_log_rate(v - math.log(density.t_min)) / slope
    if density.rest is not None:
        constant = density.rest(v[0] - math.log(density.t_min), v[1] - v[0])
        v, weights = np.append(-np.inf, v), np.append(constant, weights)
    v, weights = v[weights > 1e-300], weights[weights > 1e-300]
    slow = np.flatnonzero(v <= -math.log(ratio))
    m = 4 + math.ceil(-0.4 * math.log10(tol))
    if slow.size <= m:
        return np.exp(v), weights
    top = v[slow[-1]]
    nodes, masses = gauss_rule(np.exp(v[slow] - top), weights[slow], m)
    rates = np.append(math.exp(top) * nodes, np.exp(v[slow.size :]))
    return rates, np.append(masses, weights[slow.size :])


_SPREAD = np.sinh(np.linspace(-12.0, 12.0, 2001))
