"""Sums of exponentials for kernels known by their values.

Non-negative least squares on a grid of rates that is even in the logarithm. Where the error is too
large, the grid is refined: first evenly, then next to the rates in use. Signed kernels have plain
least squares on the rates of a matrix pencil, complex ones too, or on these and such a grid. All
sums are constructed on [1, R] and scaled.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..support.checks import complaint, refuse
from .exponential_sum import trapezoid_step

# Check points in one oscillation of the error curve of a power law.
_POINTS_PER_OSCILLATION = 48
# Of this many neighbouring check points one enters the least squares; all of them are checked.
_FITTED = 8
# Errors are relative to the kernel where it exceeds this fraction of its mean from 0 to t, and
# relative to that fraction elsewhere. A convolution depends on the mean.
_OF_MEAN = 1e-3
# Largest ratio of the last to the first time of a fit by values. Least squares take two seconds at
# this ratio.
RATIO_OF_VALUES = 1e60
# Singular values of pencils, and diagonals of R of signed fits, below these fractions of the
# largest one are left out; each fraction is tried.
_CUTS = (1e-8, 1e-10, 1e-12, 1e-14, 1e-16)
# As _FITTED, for the weights of signed kernels. With 8, errors of tables grow tenfold.
_FITTED_SIGNED = 2
# Most rates of a matrix pencil: eigenvalues of 400 take 0.1 s, and tables gain nothing by them.
_MAX_PENCIL = 200
# Number of equally spaced samples of a matrix pencil.
_PENCIL_SAMPLES = 800
# Place of a check point between two samples of a matrix pencil, at which its fastest oscillation
# is not 0.
_BETWEEN = 0.38
# Length of the first matrix pencil over that of the second. In the first, exp(-t) cos(200 t) up to
# t = 50 has too few samples.
_PENCIL_LENGTH_RATIO = 16
# Fraction of the largest |K| below which a kernel has vanished. The first pencil ends at twice the
# time from which on it has: a density of a mean of 5 is seen in runs of any length.
_VANISHED = 1e-15
# Slowest positive rate of grids, in units of 1 / t_max.
_SLOWEST = 0.02
# Spacings of the grid in log(rate), relative to the step of a trapezoidal rule of the same
# tolerance. They are tried from the coarsest on.
_SPACINGS = (0.92, 0.75, 0.6)
# The next finer spacing is tried if the error is below this many tolerances.
_MAX_ERROR_TO_REFINE = 300.0
# A round adds the rates at which the gradient of the misfit exceeds this fraction of its maximum.
_OF_GRADIENT = 0.01
# A gradient whose maximum is below this is rounding, and all rates are added.
_MIN_GRADIENT = 1e-14
# Most rounds of adding rates. Of 800 fits of random kernels (convergence/random_kernels.py) none
# took more than 15.
_MAX_ROUNDS_OF_RATES = 20
# Rounds after which the search ends, if the error has not halved during them.
_STALL = 8
# A merge of neighbouring rates merges one pair at once, and one more for each multiple of this
# number of rates.
_RATES_PER_MERGE = 32
# Most iterations of one least-squares solution, in units of its columns. The fits of random kernels
# needed 30.
_NNLS_MAXITER = 60
# Most work of all least-squares solutions of a fit: the sum of rows times columns squared. It takes
# a second.
_WORK = 4e8
# Fraction of its size by which the kernel of a run may rise or be negative, because of rounding.
_MAX_KERNEL_RISE = 1e-6
# The kernel of a run is checked from this fraction of the end of the run on, whatever the steps
# are.
_CHECK_START_FRACTION = 1e-8
# Tolerance of the rough fit by which the kernel of a run is checked.
_ROUGH = 1e-3
# Error of the rough fit from which on a kernel is refused. The error of exp(-t**2) is 0.8.
_HOPELESS = 0.1


# Rates, weights, first and last time, and largest error of a sum of exponentials.
Fit = tuple[np.ndarray, np.ndarray, float, float, float]


@dataclass(frozen=True, eq=False)
class Samples:
    """A kernel at increasing times from 1 on, and the sizes that errors are relative to."""

    t: np.ndarray
    values: np.ndarray
    size: np.ndarray

    def columns(self, rates: np.ndarray) -> np.ndarray:
        """Return exponentials of these rates over the sizes, shape (n, len(rates))."""
        # a rate whose imaginary part is above 0 has a cosine, its conjugate has a sine
        table = np.exp(-np.multiply.outer(self.t, rates.real)) / self.size[:, None]
        for turning, wave in ((rates.imag > 0, np.cos), (rates.imag < 0, np.sin)):
            if turning.any():
                table[:, turning] *= wave(np.multiply.outer(self.t, np.abs(rates.imag[turning])))
        return table

    def error(self, rates: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Return the relative error of a sum, shape (n,)."""
        return self.columns(rates) @ weights - self.values / self.size

    def every(self, n: int) -> Samples:
        """Return every n-th sample, and the last one."""
        kept = np.unique(np.append(np.arange(0, self.t.size, n), self.t.size - 1))
        return Samples(self.t[kept], self.values[kept], self.size[kept])


def _with_mean(t: np.ndarray, size: np.ndarray, before: float) -> np.ndarray:
    """Return sizes at t, raised to a fraction of their mean; `before` is their integral to 1."""
    pieces = 0.5 * (size[1:] + size[:-1]) * np.diff(t)
    mean = (abs(before) + np.append(0.0, np.cumsum(pieces))) / t
    return np.maximum(np.maximum(size, _OF_MEAN * mean), 1e-300)


def _sampled(kernel: Any, t_min: float, t_max: float, tol: float, end: float = 0.0) -> Samples:
    """Return the kernel on its check points, in units of t_min."""
    # a signed kernel has the `end` of its first pencil, and further points between those of it
    ratio = t_max / t_min
    if ratio > RATIO_OF_VALUES:
        refuse("t_max", f"be at most {RATIO_OF_VALUES:g} times t_min", t_max)
    n = math.ceil(_POINTS_PER_OSCILLATION * math.log(ratio) / trapezoid_step(0.5, tol))
    t = np.exp(np.linspace(0.0, math.log(ratio), max(400, n) // 2 * 2 + 1))
    t[-1] = ratio
    if end:
        between, h = np.linspace(1.0, end, _PENCIL_SAMPLES, retstep=True)
        t = np.union1d(t, between[:-1] + _BETWEEN * h)
    values = kernel(np.minimum(t * t_min, t_max))
    size = np.abs(values)
    if end:  # the largest from each time on
        size = np.maximum.accumulate(size[::-1])[::-1]
    return Samples(t, values, _with_mean(t, size, float(kernel.integral(t_min)) / t_min))


def _largest(error: np.ndarray) -> float:
    """Return the largest absolute value of errors."""
    return float(np.abs(error).max())


@lru_cache(maxsize=64)
def closest_positive(
    kernel: Any, t_min: float, t_max: float, tol: float, fading: bool = False
) -> Fit:
    """Fit a completely monotone kernel as closely as positive weights can."""
    # without rate 0 if `fading`; whether a function is accepted does not depend on t_min
    if kernel.by_values:
        _refuse_if_rising(kernel, _CHECK_START_FRACTION * t_max, t_max)
        error = _positive(kernel, _CHECK_START_FRACTION * t_max, t_max, _ROUGH)[-1]
        if error > _HOPELESS:
            raise ValueError(_not_monotone(f"one from which positive sums differ by {error:.1e}"))
    return _positive(kernel, t_min, t_max, tol, fading)


def _positive(kernel: Any, t_min: float, t_max: float, tol: float, fading: bool = False) -> Fit:
    samples = _sampled(kernel, t_min, t_max, tol)
    rates, weights = _positive_sum(samples, tol, _FITTED, fading=fading)
    error = _largest(samples.error(rates, weights))
    return *_scaled(rates, weights, t_min), t_min, t_max, error


def _refuse_if_rising(kernel: Any, t_min: float, t_max: float) -> None:
    """Refuse a kernel that is negative or grows: neither is completely monotone."""
    samples = _sampled(kernel, t_min, t_max, _MAX_KERNEL_RISE)
    values, slack = samples.values, _MAX_KERNEL_RISE * samples.size
    rising = np.flatnonzero(np.diff(values) > slack[1:])
    negative = np.flatnonzero(values < -slack)
    for where, what in ((negative, "negative"), (rising, "rising")):
        if where.size:
            at = f"t = {samples.t[where[0]] * t_min:g}"
            raise ValueError(_not_monotone(f"{what} at {at}"))


def _not_monotone(got: str) -> str:
    """Return the refusal of a kernel that no sum with positive weights can follow."""
    required = "be completely monotone (a sum of decaying exponentials with positive weights)"
    return complaint("kernel", required, got, "pass signed=True to allow weights of both signs")


def _positive_sum(
    samples: Samples,
    tol: float,
    every: int = 1,
    norm: Callable[[np.ndarray], float] = _largest,
    fading: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Fit every n-th sample by positive weights; return rates and weights of the closest sum."""
    # until the norm of relative errors (n,) at all samples is below tol; without rate 0 if `fading`
    fitted, step = samples.every(every), trapezoid_step(0.5, tol)
    spacings = list(_SPACINGS)
    candidates = _rate_grid(samples.t[-1], spacings.pop(0) * step, tol, fading)
    closest, bests, work = (np.zeros(0), np.zeros(0)), [math.inf], 0.0
    share = _OF_GRADIENT
    for _ in range(_MAX_ROUNDS_OF_RATES):
        rates, weights = _least_squares(fitted, candidates)
        used = weights > 0
        error = norm(samples.error(rates[used], weights[used]))
        if error < bests[-1]:
            closest = rates[used], weights[used]
        bests.append(min(error, bests[-1]))
        if bests[-1] <= tol:
            return _merged(samples, fitted, tol, norm, _WORK - work, *closest)
        stalls = len(bests) > _STALL and bests[-1] > 0.5 * bests[-1 - _STALL]
        work += fitted.t.size * rates.size**2
        share = 0.1 * share if bests[-1] > 0.5 * bests[-2] else _OF_GRADIENT
        new = _refinement(fitted, rates, weights, share)
        if stalls or work > _WORK or new.size == 0:
            break
        if spacings and error < _MAX_ERROR_TO_REFINE * tol:
            candidates = _rate_grid(samples.t[-1], spacings.pop(0) * step, tol, fading)
        else:
            candidates, spacings = np.union1d(rates, new), []
    return closest


def _least_squares(samples: Samples, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rates whose columns are not 0, and their weights >= 0; 0 without a solution."""
    from scipy.optimize import nnls

    rates, table, scale = _unit_columns(samples, rates)
    try:
        x = nnls(table, samples.values / samples.size, maxiter=_NNLS_MAXITER * rates.size)[0]
    except RuntimeError:  # the iterations are used up
        x = np.zeros(rates.size)
    return rates, x / scale


def _rate_grid(ratio: float, step: float, tol: float, fading: bool = False) -> np.ndarray:
    """Return rate 0, and rates even in the logarithm up to one of exp(-3) tol at t = 1."""
    first = math.floor(math.log(_SLOWEST / ratio) / step)
    last = math.ceil(math.log(3.0 - math.log(tol)) / step)
    grid = np.exp(step * np.arange(first, last + 1))
    return grid if fading else np.append(0.0, grid)


def _unit_columns(samples: Samples, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rates whose columns are not 0, the columns scaled to 1, and their sizes."""
    table = samples.columns(rates)
    scale = np.abs(table).max(axis=0)
    kept = scale > 1e-250
    return rates[kept], table[:, kept] / scale[kept], scale[kept]


def _refinement(
    samples: Samples, rates: np.ndarray, weights: np.ndarray, share: float
) -> np.ndarray:
    """Return new rates next to those in use, (n,), with steep gradients."""
    # The gradient is at least the fraction `share` of the steepest. The middles between rates in
    # use and their neighbours resolve a continuous spectrum. A lone rate is the mean of the two
    # rates that surround it, up to the square of their distance.
    used = weights > 0
    beside_used = (used[1:] | used[:-1]) & (rates[:-1] > 0)
    middles = np.sqrt(rates[:-1] * rates[1:])[beside_used]
    r, w = rates[used], weights[used]
    means = (w[:-1] * r[:-1] + w[1:] * r[1:]) / (w[:-1] + w[1:])
    new, table, _ = _unit_columns(samples, np.setdiff1d(np.append(middles, means), rates))
    gradient = -samples.error(rates, weights) @ (table / np.linalg.norm(table, axis=0))
    steepest = gradient.max(initial=0.0)
    return new[gradient > share * steepest] if steepest > _MIN_GRADIENT else new


def _merged(
    samples: Samples, fitted: Samples, tol: float, norm: Callable[[np.ndarray], float], work: float,
    rates: np.ndarray, weights: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return fewer rates: the closest pairs become their means while the error stays below tol."""
    # the work is at most `work`, in rows times columns squared
    while rates.size > 1 and work > 0:
        gaps = np.diff(np.log(np.maximum(rates, 1e-300)))
        around = np.concatenate([[np.inf], gaps, [np.inf]])
        closer = np.flatnonzero((gaps < around[:-2]) & (gaps <= around[2:]))
        pairs = closer[np.argsort(gaps[closer])[: 1 + rates.size // _RATES_PER_MERGE]]
        group = np.arange(rates.size) - np.searchsorted(np.sort(pairs), np.arange(rates.size))
        masses = np.bincount(group, weights)
        means = np.bincount(group, weights * rates) / masses
        fewer, masses = _least_squares(fitted, means)
        used = masses > 0
        if norm(samples.error(fewer[used], masses[used])) > tol:
            break
        work -= fitted.t.size * rates.size**2
        rates, weights = fewer[used], masses[used]
    return rates, weights


def in_pairs(rates: np.ndarray) -> np.ndarray:
    """Return the indices that sort rates, with conjugate pairs next to each other."""
    return np.lexsort((-rates.imag, np.abs(rates.imag), rates.real))


def _scaled(rates: np.ndarray, weights: np.ndarray, unit: float) -> tuple[np.ndarray, np.ndarray]:
    """Return rates in order and in units of the kernel, and their weights."""
    order = in_pairs(rates)
    rates, weights = rates[order] / unit, weights[order]
    if not rates.imag.any():
        rates, weights = rates.real.copy(), weights.real.copy()
    rates.flags.writeable = weights.flags.writeable = False
    return rates, weights


def closest_table(
    times: np.ndarray, values: np.ndarray, t_min: float, t_max: float, tol: float, by_rms: bool,
    fading: bool = False,
) -> Fit:  # fmt: skip
    """Fit measured values by positive weights until the rms, or the largest, error is `tol`."""
    samples = Samples(times / times[0], values, values)
    norm = root_mean_square if by_rms else _largest
    rates, weights = _positive_sum(samples, tol, norm=norm, fading=fading)
    error = _largest(samples.error(rates, weights))
    return *_scaled(rates, weights, times[0]), t_min, t_max, error


def root_mean_square(error: np.ndarray) -> float:
    """Return the root of the mean square."""
    return math.sqrt(np.mean(error**2))


@lru_cache(maxsize=64)
def closest_signed(
    kernel: Any, t_min: float, t_max: float, tol: float, fading: bool = False
) -> Fit:
    """Fit a kernel with weights of both signs, by least squares, as closely as can be."""
    # errors are relative to the largest |K| from each time on, at least to a thousandth of its mean
    end = _end_of_pencil(kernel, t_min, t_max)
    samples = _sampled(kernel, t_min, t_max, tol, end)
    best, closest = math.inf, (np.zeros(0), np.zeros(0))
    sets = _rates_of_signed(kernel, samples.t[-1], end, t_min, tol, fading)
    sums = (one for rates in sets for one in _signed_sums(samples, rates, best))
    for error, used, weights in sums:
        if error < best:
            best, closest = error, (used, weights)
        if best <= tol:
            break
    return *_scaled(*_with_pairs(*closest), t_min), t_min, t_max, best


def _end_of_pencil(kernel: Any, t_min: float, t_max: float) -> float:
    """Return the end of the first pencil in units of t_min: twice the time when K has vanished."""
    times = np.geomspace(t_min, t_max, _PENCIL_SAMPLES)[:-1]
    sizes = np.abs(kernel(times))
    return min(t_max, 2.0 * times[sizes >= _VANISHED * sizes.max()][-1]) / t_min


def _rates_of_signed(
    kernel: Any, ratio: float, end: float, t_min: float, tol: float, fading: bool
) -> Iterator[np.ndarray]:
    """Yield sets of rates: real ones of pencils and grids, then complex ones, and both."""
    # The pencil is that of the Hankel matrix of equidistant samples, without its last and without
    # its first column. It is reduced to singular values above a cut [HuaSarkar1990]. Samples from a
    # part of the time resolve fast oscillations. The last sets have grids turned by 45 degrees, for
    # kernels whose transforms have an essential singularity on the negative axis.
    sets_of_pencils = []
    for last in (end, 1.0 + (ratio - 1.0) / _PENCIL_LENGTH_RATIO):
        times, h = np.linspace(1.0, last, _PENCIL_SAMPLES, retstep=True)
        values = kernel(times[:-1] * t_min)
        sizes, columns = np.linalg.eigh(sliding_window_view(values, _PENCIL_SAMPLES // 2))
        order = np.argsort(-np.abs(sizes))
        sizes, columns = np.abs(sizes)[order], columns[:, order]
        counts = {min(_MAX_PENCIL, np.count_nonzero(sizes > cut * sizes[0])) for cut in _CUTS}
        sets = []
        for n in sorted(counts):
            kept = columns[:, :n]
            poles = np.linalg.eigvals(np.linalg.lstsq(kept[:-1], kept[1:], rcond=None)[0])
            rates = -np.log(poles[poles != 0].astype(complex)) / h
            rates = np.maximum(rates.real, 0.0) + 1j * rates.imag
            pairs = rates[(rates.imag > 0) & (rates.imag < 0.99 * math.pi / h)]
            sets.append(np.concatenate([rates[rates.imag == 0], pairs, pairs.conj()]))
        sets_of_pencils.append(sets)
        # pencils of steep kernels may have no rates
        yield from (rates for rates in sets if rates.size and not rates.imag.any())
    step = trapezoid_step(0.5, tol)
    grids = [_rate_grid(ratio, spacing * step, tol, fading) for spacing in (1.0, 0.6, 0.4)]
    yield from grids[:2]
    yield from (rates for sets in sets_of_pencils for rates in sets if rates.imag.any())
    yield grids[2]
    yield from (np.append(grid, sets[len(sets) // 2]) for sets in sets_of_pencils for grid in grids)
    yield from (np.append(grid, sets[-2:][0]) for sets in sets_of_pencils for grid in grids[:2])
    for every in (2, 1):
        turned = grids[1][grids[1] > 0][::every] * np.exp(0.25j * math.pi)
        yield np.concatenate([grids[1], turned, turned.conj()])


def _signed_sums(
    samples: Samples, rates: np.ndarray, best: float
) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """Yield errors, rates (n,), and weights (n,) of their columns, with more and more columns."""
    # A QR decomposition with pivoting on few samples orders the columns. Their weights are those of
    # least squares on more samples. Nothing comes if the few samples already err by `best`.
    from scipy.linalg import qr, solve_triangular  # takes long to import

    fitted = samples.every(_FITTED)
    rates, table, _ = _unit_columns(fitted, rates)
    q, r, order = qr(table, mode="economic", pivoting=True, check_finite=False)
    sizes, values = np.abs(r.diagonal()), fitted.values / fitted.size
    counts = sorted({np.count_nonzero(sizes > cut * sizes[0]) for cut in _CUTS})
    basis = q[:, : counts[-1]]
    if _largest(basis @ (basis.T @ values) - values) >= best:
        return
    rates, table, scale = _unit_columns(samples, rates[order[: counts[-1]]])
    values = samples.values / samples.size
    q, r = qr(table[::_FITTED_SIGNED], mode="economic", check_finite=False)
    shares = q.T @ values[::_FITTED_SIGNED]
    for n in counts:
        x = solve_triangular(r[:n, :n], shares[:n])
        yield _largest(table[:, :n] @ x - values), rates[:n], x / scale[:n]


def _with_pairs(rates: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rates and complex weights of exponentials, from weights of cosines and sines."""
    paired, place = np.unique(np.append(rates, rates.conj()), return_inverse=True)
    amplitudes = np.zeros(paired.size, dtype=complex)
    halves = 0.5 * weights * np.where(rates.imag < 0, -1j, 1.0)
    np.add.at(amplitudes, place, np.append(halves, halves.conj()))
    return paired, amplitudes
