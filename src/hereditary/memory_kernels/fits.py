"""Sums of exponentials for kernels known by their values.

Non-negative least squares on a grid of rates, uniform in log rate and as coarse as the trapezoid
rule for a power law would have it; finer grids follow, then rates that slide towards where the
error asks for them or, where they are few, by Gauss's and Newton's steps, and at last the trapezoid
rule for a spectral density where there is one.
Everything is built on [1, R] and scaled.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .._checks import complaint
from ..exponential_sum import RATIO_MAX, trapezoid_step
from ..memory_kernel import ExponentialSum
from .few_rates import few_rates
from .least_squares import fewer_positive, nonnegative_least_squares
from .shared import gauss_rule

# The check points, an oscillation of a power law's error curve; the fit uses every other one.
_POINTS_PER_OSCILLATION = 48
# Where t K(t) has faded to this share of its maximum, errors count relative to this share.
FADED = 1e-16
# Most that the ends of a fit by values may differ by.
RATIO_OF_VALUES = 1e30
# Over more than this a spectral density's own rule stands: to fit fewer rates would take minutes.
_WIDE = 1e15
# Rates above 45 / t_min and below 0.02 / t_max cannot help.
_FASTEST, _SLOWEST = math.log(45.0), math.log(0.02)
# A sum that is stuck above this share of the kernel shows that it is not completely monotone.
_HOPELESS = 1e-6


@dataclass(frozen=True, eq=False)
class Samples:
    """A kernel at log-spaced times on [1, R], and what its errors are measured by."""

    t: np.ndarray
    values: np.ndarray
    scale: np.ndarray
    emphasis: np.ndarray
    fading: bool = False  # whether a sum for it must do without rate 0

    @property
    def ratio(self):
        """t_max / t_min."""
        return self.t[-1]

    def columns(self, v):
        """Exponentials of log rates `v` relative to the kernel, shape (n, len(v))."""
        return np.exp(-np.multiply.outer(self.t, np.exp(v))) / self.scale[:, None]

    def error(self, v, weights):
        """Relative error of a sum, shape (n,)."""
        return self.columns(v) @ weights - self.values / self.scale

    def thinned(self):
        """Every other sample, those of an oscillation at each end counting more."""
        t, values, scale = (array[::2] for array in (self.t, self.values, self.scale))
        index = np.arange(t.size)
        near_end = np.minimum(index, index[::-1]) * (2 / _POINTS_PER_OSCILLATION)
        return Samples(t, values, scale, 1 + 3 * np.exp(-2 * near_end), self.fading)


def sampled(kernel, t_min, t_max, tol, wide=False, fading=False):
    """The kernel on its check points, in units of t_min.

    Over a wide range early times count as much as late ones, however little is left of t K there.
    """
    ratio, ratio_max = t_max / t_min, RATIO_MAX if wide else RATIO_OF_VALUES
    if ratio > ratio_max:
        raise ValueError(complaint("t_max", f"be at most {ratio_max:g} times t_min", t_max))
    n = math.ceil(_POINTS_PER_OSCILLATION * math.log(ratio) / trapezoid_step(0.5, tol))
    t = np.exp(np.linspace(0.0, math.log(ratio), max(400, n) // 2 * 2 + 1))
    t[-1] = ratio
    values = kernel(np.minimum(t * t_min, t_max))
    scale = np.abs(values) if wide else scale_of(t, values)
    return Samples(t, values, scale, np.ones(t.size), fading)


def scale_of(t, values):
    """The largest ``|K|`` from each time on, and no less than a faded kernel's share of t K(t)."""
    size = np.abs(values)
    largest = np.maximum.accumulate(size[::-1])[::-1]
    return np.maximum(largest, FADED * (t * size).max() / t)


def fit_positive(kernel, t_min, t_max, tol, density=None):
    """As `closest_positive`; a ValueError says how far the fit came where `tol` was not met."""
    return _within(closest_positive(kernel, t_min, t_max, tol, density), tol)


def _within(fit, tol, remedy=""):
    """Refuse a fit that is not as close as it should be."""
    if fit.max_error > tol:
        required = f"be at least {1.1 * fit.max_error:.1e} for this kernel"
        raise ValueError(complaint("tol", required, tol, remedy))
    return fit


@lru_cache(maxsize=64)
def closest_positive(kernel, t_min, t_max, tol, density=None, fading=False):
    """A sum with positive weights for a completely monotone kernel.

    Parameters
    ----------
    kernel : callable
        Values at times of shape (n,).
    t_min, t_max, tol : float
        As in `fit_exponentials`.
    density : Density, optional
        The kernel's spectral density.
    fading : bool
        Whether the sum must do without rate 0.

    Returns
    -------
    ExponentialSum
        With ``max_error <= tol`` where one was found, else what came closest.
    """
    wide = density is not None and t_max / t_min > _WIDE
    samples = sampled(kernel, t_min, t_max, tol, wide, fading)
    refuse_if_rising(samples, t_min)
    thin, step = samples.thinned(), trapezoid_step(0.5, tol)
    best, closest = math.inf, (np.zeros(0), np.zeros(0))
    rules = _density_rules if wide else attempts
    for v, weights in rules(thin, step, tol, density):
        error = float(np.abs(samples.error(v, weights)).max())
        if error < best:
            best, closest = error, (v, weights)
        if error <= tol:
            if not wide:
                v, weights = _fewest(samples, thin, tol, v, weights)
            v, weights, error = without_fastest(samples, tol, v, weights)
            return summed(v, weights, t_min, t_max, error)
    if best > max(_HOPELESS, 100 * tol):
        raise ValueError(not_monotone(f"one that positive sums only approach to {best:.1e}"))
    v, weights, error = without_fastest(samples, best, *closest)
    return summed(v, weights, t_min, t_max, error)


def refuse_if_rising(samples, t_min):
    """Refuse what is negative or grows: neither is completely monotone."""
    values, slack = samples.values, 1e-12 * samples.scale
    rising = np.flatnonzero(np.diff(values) > slack[1:])
    negative = np.flatnonzero(values < -slack)
    for where, what in ((negative, "negative"), (rising, "rising")):
        if where.size:
            i = where[0]
            raise ValueError(not_monotone(f"{what} at t = {samples.t[i] * t_min:g}"))


def not_monotone(got):
    """The sentence for kernels that no positive sum of decaying exponentials can follow."""
    required = "be completely monotone (a sum of decaying exponentials with positive weights)"
    return complaint("kernel", required, got, "pass signed=True to allow weights of both signs")


def largest(error):
    """The largest size."""
    return float(np.abs(error).max())


def attempts(samples, step, tol, density=None, norm=largest):
    """Log rates and weights to try, those with few modes first."""

    def good_enough(error):
        return norm(error) <= (0.99 * tol if norm is largest else tol * (1 + 1e-9))

    if density is None and norm is largest:
        yield from _few(samples, step, good_enough)
    for finer in (1.0, 0.92, 0.85, 0.72, 0.6):
        v, weights, _ = _grid_fit(samples, finer * step)
        yield v, weights
        if np.abs(samples.error(v, weights)).max() > 30 * tol:
            break
    yield sliding(samples, step, good_enough, 26 if density is None else 10)
    if density is not None:
        yield from _density_rules(samples, step, tol, density)
    # through noise, all rates of a grid follow the kernel more closely than a few
    if norm is not largest:
        yield from _few(samples, step, good_enough)


def _few(samples, step, good_enough):
    """A few separate rates, where they are good enough."""
    found = few_rates(samples, rate_grid(samples, step / 6), good_enough)
    if found is not None:
        yield found


def _density_rules(samples, step, tol, density):
    """Trapezoid rules for the spectral density, ever finer."""
    for finer in (1.0, 0.85, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2):
        yield _density_rule(density, samples.ratio, finer * step, tol)


def rate_grid(samples, step):
    """Log rates 0 (-inf), then uniform from the slowest to the fastest that matter."""
    ratio = samples.ratio
    first, last = (_SLOWEST - math.log(ratio)) / step, _FASTEST / step
    grid = step * np.arange(math.floor(first), math.ceil(last) + 1)
    return grid if samples.fading else np.append(-np.inf, grid)


def _grid_fit(samples, step):
    v = rate_grid(samples, step)
    return _fit_on(samples, v, np.ones(v.size, dtype=bool))


def _fit_on(samples, v, start):
    """Non-negative least squares over given log rates: those used, weights and relative error."""
    v, start, table, size = _unit_columns(samples, v, start)
    target = samples.values / samples.scale
    q, r = np.linalg.qr(samples.emphasis[:, None] * table)
    x = nonnegative_least_squares(r, q.T @ (samples.emphasis * target), start)
    used = x > 0
    return v[used], x[used] / size[used], table @ x - target


def _unit_columns(samples, v, other):
    """Columns of largest value 1, without those that are 0, and their sizes; `other` along v."""
    table = samples.columns(v)
    size = table.max(axis=0)
    v, other, table, size = (a[..., size > 1e-250] for a in (v, other, table, size))
    return v, other, table / size, size


def sliding(samples, step, good_enough, patience=26):
    """Log rates and weights of a fit whose rates move, by half the last distance each time.

    The problem over all positive measures is convex: neighbours of the rates in use and the peaks
    of the misfit's own transform are all that can improve it.
    """
    fine = rate_grid(samples, step / 6)
    peaks = samples.columns(fine)
    peaks /= peaks.max(axis=0)
    v, weights, error = _grid_fit(samples, step)
    history = [np.abs(error).max()]
    while not good_enough(error) and len(history) < patience:
        step /= 2
        wish = -(samples.emphasis**2 * error) @ peaks
        inner = wish[1:-1]
        peak = (inner > wish[:-2]) & (inner >= wish[2:]) & (inner > 0)
        moving = v[v > -np.inf]
        candidates = np.concatenate([v, moving + step, moving - step, fine[1:-1][peak]])
        candidates, index = np.unique(candidates, return_index=True)
        v, weights, error = _fit_on(samples, candidates, index < v.size)
        history.append(np.abs(error).max())
        if len(history) > 8 and history[-1] > 0.6 * history[-8]:
            break
    return v, weights


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


def _density_rule(density, ratio, step, tol):
    """Trapezoid rule, denser around the peak; the slow tail by its Gauss rule."""
    centre = density.centre + math.log(density.t_min)
    extra, width = 1.5 / step, density.width
    low, high = -density.reach - math.log(ratio), _FASTEST

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
        return v, weights
    top = v[slow[-1]]
    nodes, masses = gauss_rule(np.exp(v[slow] - top), weights[slow], m)
    nodes = np.log(np.maximum(nodes, 1e-300)) + top
    return np.concatenate([nodes, v[slow.size :]]), np.concatenate([masses, weights[slow.size :]])


_SPREAD = np.sinh(np.linspace(-12.0, 12.0, 2001))


def _fewest(samples, thin, tol, v, weights):
    """Fewer rates where the tolerance bears it, as for the many of a trapezoid rule."""
    own, masses, table, size = _unit_columns(thin, v, weights)
    q, r = np.linalg.qr(thin.emphasis[:, None] * table)
    x = fewer_positive(r, q.T @ (thin.emphasis * thin.values / thin.scale), masses * size)
    used = x > 0
    fewer = own[used], x[used] / size[used]
    merged = _merged(samples, thin, tol, v, weights)
    if fewer[0].size == v.size or np.abs(samples.error(*fewer)).max() > tol:
        return merged
    return min(merged, _merged(samples, thin, tol, *fewer), key=lambda pair: pair[0].size)


def _merged(samples, thin, tol, v, weights):
    """Fewer rates: the closest two become one and the weights are fitted anew, while that holds."""
    while v.size > 2:
        order = np.argsort(v, kind="stable")
        v, weights = v[order], weights[order]
        first = 1 if v[0] == -np.inf else 0
        i = first + int(np.argmin(np.diff(v[first:])))
        if v[i + 1] - v[i] > 0.5 or i + 1 >= v.size:
            break
        middle = np.average(v[i : i + 2], weights=weights[i : i + 2])
        fewer = np.concatenate([v[:i], [middle], v[i + 2 :]])
        fewer, fitted, _ = _fit_on(thin, fewer, np.ones(fewer.size, dtype=bool))
        if fewer.size >= v.size or np.abs(samples.error(fewer, fitted)).max() > tol:
            break
        v, weights = fewer, fitted
    return v, weights


def without_fastest(samples, tol, v, weights):
    """Without the fastest rates that the tolerance does not need."""
    order = np.argsort(v, kind="stable")
    v, weights = v[order], weights[order]
    error = samples.error(v, weights)
    while v.size > 1:
        trial = error - samples.columns(v[-1:])[:, 0] * weights[-1]
        if np.abs(trial).max() > tol:
            break
        v, weights, error = v[:-1], weights[:-1], trial
    return v, weights, float(np.abs(error).max())


def summed(v, weights, t_min, t_max, error):
    """The sum in the kernel's own units, its rates in order."""
    order = np.argsort(v, kind="stable")
    rates, weights = np.exp(v[order]) / t_min, weights[order]
    rates.flags.writeable = weights.flags.writeable = False
    return ExponentialSum(rates, weights, t_min, t_max, error)


def fit_signed(kernel, t_min, t_max, tol):
    """As `closest_signed`; a ValueError says how far the fit came where `tol` was not met."""
    remedy = "decaying exponentials without oscillation come no closer to it"
    return _within(closest_signed(kernel, t_min, t_max, tol), tol, remedy)


@lru_cache(maxsize=64)
def closest_signed(kernel, t_min, t_max, tol, fading=False):
    """A sum with weights of both signs, by least squares.

    Errors are relative to the largest ``|K|`` from each time on.
    """
    samples = sampled(kernel, t_min, t_max, tol, fading=fading)
    thin, step = samples.thinned(), trapezoid_step(0.5, tol)
    best, closest = math.inf, (np.zeros(0), np.zeros(0))
    for finer in (1.0, 0.8, 0.6, 0.45):
        v = rate_grid(samples, finer * step)
        table = thin.columns(v)
        size = table.max(axis=0)
        v, table, size = v[size > 1e-250], table[:, size > 1e-250], size[size > 1e-250]
        weighted = thin.emphasis[:, None] * table / size
        target = thin.emphasis * thin.values / thin.scale
        for cut in (1e-8, 1e-10, 1e-12, 1e-14):
            weights = np.linalg.lstsq(weighted, target, rcond=cut)[0] / size
            error = float(np.abs(samples.error(v, weights)).max())
            if error < best:
                best, closest = error, (v, weights)
            if best <= tol:
                return summed(*closest, t_min, t_max, best)
    return summed(*closest, t_min, t_max, best)
