"""Functions of time that a user gives, as polynomials between their jumps and corners.

The interval is cut, again and again, where a polynomial misses the function. A cut next to a jump
or a corner leaves one short interval after the other, which is how jumps and corners are found.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial.chebyshev import chebder, chebval, chebvander

# Coefficients of a polynomial, and Chebyshev's points in (-1, 1) that determine them.
_N_COEFFICIENTS = 10
_NODES = np.cos(np.pi * (np.arange(_N_COEFFICIENTS) + 0.5) / _N_COEFFICIENTS)[::-1]
_TO_COEFFICIENTS = np.linalg.inv(chebvander(_NODES, _N_COEFFICIENTS - 1))
# Distances of further samples from both ends, over that of equidistant ones. They see short ramps
# next to the ends: without them one of 1e-8 of the delay is missed.
_BESIDE_ENDS = 4.0 ** np.arange(-17, -1)
# Points in [-1, 1], the interval of a polynomial, at which it is compared with the function. Those
# next to the ends see jumps and corners outside of the nodes: without them 5 % are missed.
_CHECK_POINTS = np.array([-1 + 1e-6, -0.4, 0.15, 0.8, 1 - 1e-6])
_FIT_POINTS = np.concatenate([_NODES, _CHECK_POINTS])
_AT_CHECK_POINTS = chebvander(_CHECK_POINTS, _N_COEFFICIENTS - 1)
# Fraction at which intervals are cut. No jump at a decimal or binary fraction coincides with a cut.
_CUT = 0.4936170361
# Intervals shorter than this fraction of the distance of samples show a jump or a corner.
_MAX_JUMP_INTERVAL = 1 / 64
# Fraction of the width of a bracket by which its corner moves when the polynomials are better.
_NEARER = 0.1
# Largest number of intervals of a function, and of its jumps and corners.
_MOST_INTERVALS = 50_000
# Largest number of halvings that locate a jump: the bits of a float.
_HALVINGS_TO_JUMP = 60
# Relative difference of values up to which they are a constant with rounding errors.
_RESTS = 8 * np.finfo(float).eps
# Least size of a component, so that one that is 0 everywhere can be divided by its size.
_LEAST_SIZE = 1e-300


class FitTolerance(NamedTuple):
    """The accuracy with which polynomials meet a function."""

    tol: float  # largest difference, as a fraction of the largest value of a component
    order: float  # at x of the time from a jump or a corner it may be x**-order as large
    least: float  # shortest interval, by rounding [time]


class Piecewise(NamedTuple):
    """A function of time as polynomials."""

    edges: np.ndarray  # times between them, (n + 1,)
    coefficients: np.ndarray  # those of Chebyshev, (n, d, _N_COEFFICIENTS)
    kinks: list[tuple[float, float]]  # time and exponent, 0 or 1, of each jump or corner
    missed: float  # largest difference over the size; 0 within the tolerance
    where: float  # its time

    def __call__(self, times: np.ndarray, inside: np.ndarray) -> np.ndarray:
        """Return values at times (k,), by the polynomials of the times `inside`, (k, d)."""
        last = self.edges.size - 2
        i = np.clip(np.searchsorted(self.edges, inside, side="right") - 1, 0, last)
        low, high = self.edges[i], self.edges[i + 1]
        u = np.clip(2.0 * (times - low) / (high - low) - 1.0, -1.0, 1.0)
        powers = chebvander(u, _N_COEFFICIENTS - 1)
        return np.einsum("kj,kdj->kd", powers, self.coefficients[i])


class _Fit(NamedTuple):
    """Polynomials between times `low` and `high`, (n,), and by how much they miss, (n,)."""

    low: np.ndarray
    high: np.ndarray
    coefficients: np.ndarray
    missed: np.ndarray
    complete: bool


def piecewise(
    function: Callable[[np.ndarray], np.ndarray],
    low: float,
    high: float,
    n_samples: int,
    tolerance: FitTolerance,
) -> Piecewise:
    """Return a function (k, d) of k times as polynomials between `low` and `high`."""
    # compared at n_samples equidistant times, between which narrow features may be missed
    spacing = (high - low) / n_samples
    beside = spacing * _BESIDE_ENDS
    times = low + spacing * (np.arange(n_samples) + 0.5)
    times = np.concatenate([low + beside, times, high - beside[::-1]])
    short, ends = _MAX_JUMP_INTERVAL * spacing, np.array([low, high])
    samples = times, function(times), short
    fit = _fitted(function, ends, samples, tolerance)
    which = _brackets(fit, short) if fit.complete else np.zeros(0, np.int64)
    kinks, exponents = np.zeros(0), np.zeros(0)
    if which.size:
        a, b = fit.low[which], fit.high[which]
        kinks = _crossings(fit, which - 1, which + 1)
        corners = (a <= kinks) & (kinks <= b)
        kinks = np.where(corners, kinks, _located(function, a, b))
        fit = _fitted(function, np.unique([low, *kinks, high]), samples, tolerance)
        right = np.searchsorted(fit.low, kinks)
        nearer = _crossings(fit, right - 1, right)
        corners &= np.abs(nearer - kinks) <= _NEARER * (b - a)
        kinks, exponents = np.where(corners, nearer, kinks), np.where(corners, 1.0, 0.0)
        fit = _fitted(function, np.unique([low, *kinks, high]), samples, tolerance)
    worst = int(np.argmax(fit.missed))
    missed = 0.0 if fit.complete else float(fit.missed[worst])
    edges = np.append(fit.low, fit.high[-1])
    pairs = list(zip(kinks.tolist(), exponents.tolist(), strict=True))
    return Piecewise(edges, fit.coefficients, pairs, missed, float(fit.low[worst]))


def _fitted(
    function: Callable[[np.ndarray], np.ndarray],
    edges: np.ndarray,
    samples: tuple[np.ndarray, np.ndarray, float],
    tolerance: FitTolerance,
) -> _Fit:
    """Return polynomials between edges; intervals are cut where a polynomial is not accurate."""
    # samples: times, values there, and the length up to which intervals show a jump
    (times, known, short), tol, span = samples, tolerance.tol, edges[-1] - edges[0]
    sizes = np.maximum(np.abs(known).max(axis=0), _LEAST_SIZE)
    low, high, complete = edges[:-1], edges[1:], True
    found: list[tuple[np.ndarray, ...]] = []
    while low.size:
        middle, half = 0.5 * (low + high)[:, None], 0.5 * (high - low)[:, None]
        values = function((middle + half * _FIT_POINTS).ravel())
        values = values.reshape(low.size, _FIT_POINTS.size, -1)
        sizes = np.maximum(sizes, np.abs(values).max(axis=(0, 1)))
        polynomials = _to_polynomials(values[:, : _NODES.size], known[0])
        missed = np.abs(
            _AT_CHECK_POINTS @ np.moveaxis(polynomials, 1, 2) - values[:, _NODES.size :]
        )
        missed = (missed.max(axis=1) / sizes).max(axis=1)
        i = np.maximum(np.searchsorted(low, times, side="right") - 1, 0)
        inside = (times > low[i]) & (times < high[i])
        i, here = i[inside], times[inside]
        powers = chebvander((here - middle[i, 0]) / half[i, 0], _N_COEFFICIENTS - 1)
        apart = np.abs(np.einsum("kj,kdj->kd", powers, polynomials[i]) - known[inside])
        np.maximum.at(missed, i, (apart / sizes).max(axis=1))
        length = high - low
        counts = (length > short) | (missed * (length / span) ** tolerance.order > tol)
        rough = (missed > tol) & counts & (length > tolerance.least)
        n_found = sum(part[0].size for part in found)
        if n_found + 2 * low.size > _MOST_INTERVALS:
            complete, rough = complete and not rough.any(), np.zeros_like(rough)
        done = ~rough
        found.append((low[done], high[done], polynomials[done], missed[done]))
        cut = low[rough] + _CUT * length[rough]
        low, high = np.sort(np.append(low[rough], cut)), np.sort(np.append(cut, high[rough]))
    low, high, polynomials, missed = (np.concatenate(part) for part in zip(*found, strict=True))
    order = np.argsort(low)
    return _Fit(low[order], high[order], polynomials[order], missed[order], complete)


def _to_polynomials(values: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Return k coefficients (n, d, k) of polynomials by values (n, k, d) at the nodes."""
    # Values that differ by rounding only become a constant, `rest` (d,) up to rounding, so that
    # nothing resolves the rounding errors of a constant.
    coefficients = np.moveaxis(np.einsum("ij,njd->nid", _TO_COEFFICIENTS, values), 1, 2)
    first = values[:, 0]
    rounding = _RESTS * np.abs(first)
    rests = np.ptp(values, axis=1) <= rounding
    if rests.any():
        constant = np.where(np.abs(first - rest) <= rounding, rest, first)
        coefficients[rests] = 0.0
        coefficients[..., 0][rests] = constant[rests]
    return coefficients


def _brackets(fit: _Fit, short: float) -> np.ndarray:
    """Return the indices (k,) of the intervals in which the function jumps or has a corner."""
    # the one with the largest difference of each inner group of intervals below the length `short`
    length = fit.high - fit.low
    inside = (fit.low > fit.low[0] + short) & (fit.high < fit.high[-1] - short)
    which = np.flatnonzero((length <= short) & inside)
    groups = np.split(which, np.flatnonzero(np.diff(fit.low[which]) > 2 * short) + 1)
    found = [group[np.argmax(fit.missed[group])] for group in groups if group.size]
    return np.array(found, np.int64)


def _crossings(fit: _Fit, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the times (k,) at which straight lines meet; NaN if they are parallel."""
    # They continue the polynomials `left` beyond their ends, and `right` before their starts. The
    # component with the largest change of its slope counts.
    low, high = fit.low[right, None], fit.high[left, None]
    before, after = (np.moveaxis(fit.coefficients[which], 2, 0) for which in (left, right))
    length, next_length = high - fit.low[left, None], fit.high[right, None] - low
    slope = 2.0 * chebval(1.0, chebder(before)) / length
    next_slope = 2.0 * chebval(-1.0, chebder(after)) / next_length
    jump = chebval(-1.0, after) - chebval(1.0, before) - slope * (low - high)
    bend = slope - next_slope
    k, c = np.arange(left.size), np.argmax(np.abs(bend), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return low[:, 0] + jump[k, c] / bend[k, c]


def _located(
    function: Callable[[np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Return the times of jumps between `low` and `high`, (k,) each, accurate to rounding."""
    # a time in the middle belongs to the side whose value is nearer; corners remain inside
    left, right = function(low), function(high)
    for _ in range(_HALVINGS_TO_JUMP):
        middle = low + 0.5 * (high - low)
        if not ((low < middle) & (middle < high)).any():
            break
        values = function(middle)
        before = np.abs(values - left).max(axis=1) <= np.abs(values - right).max(axis=1)
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return high
