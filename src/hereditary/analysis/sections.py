"""Sections of an orbit: samples once a period, and local maxima.

Both use the dense output of collocation, and a cubic spline through the rows of given steps. They
return arrays of a fixed size on request, filled up with NaN, so that a sweep can stack them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..solver.solution import Solution
from ..support.checks import count, instance, positive, real, real_array, refuse, shown

# Points of each step at which dense output is evaluated to find maxima.
_POINTS_PER_STEP_FOR_MAXIMA = 8
# Refinements of a maximum. A parabola over a distance d misses the place by d**2, so that only
# rounding remains after four.
_REFINEMENTS = 4
# Ratio of the distances d of two consecutive refinements.
_CLOSER = 1 / 16
# Most samples of a section, because of storage.
_MAX_SECTION_SAMPLES = 10_000_000


@dataclass(frozen=True, eq=False)
class Section:
    """An orbit at selected times; NaN after the last one in a section of fixed size.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times [time].
    y : ndarray, shape (n, d)
        Solution at these times.
    ydot : ndarray, shape (n, d), or None
        Its first derivative, if the highest order exceeds 1.
    """

    t: np.ndarray
    y: np.ndarray
    ydot: np.ndarray | None

    def within(self, spacing: float) -> np.ndarray:
        """Return the solution modulo `spacing`, the length of a cell of a chain, shape (n, d)."""
        return np.mod(self.y, positive("spacing", spacing))

    def lag(self, speed: float) -> np.ndarray:
        """Return ``y - speed * t``, the distance ahead of an even motion, shape (n, d)."""
        return self.y - real("speed", speed) * self.t[:, None]


def stroboscopic(
    solution: Solution, period: float, transient: float | None = None, count: int | None = None
) -> Section:
    """Sample the orbit at whole multiples of a period.

    Parameters
    ----------
    solution : Solution
    period : float
        Time between two samples, e.g. that of the drive; for the stick-slip oscillator
        ``2 pi omega**2 / b``, in which the pulled spring passes one well [time].
    transient : float, optional
        No samples before this time, by default the start [time].
    count : int, optional
        Return only the last `count` samples; NaN follows if there are fewer.

    Returns
    -------
    Section

    Error
    -----
    Between rows that of a cubic spline, the fourth power of their distance. None with a dense
    output.

    Examples
    --------
    >>> import hereditary as hd
    >>> from hereditary.analysis.sections import stroboscopic
    >>> sol = hd.solve(hd.scenes.stick_slip(adhesion=10.0), 200.0, 20_000)
    >>> section = stroboscopic(sol, 2 * 3.141592653589793, transient=100.0, count=4)
    >>> section.within(2 * 3.141592653589793)[:, 0].round(2).tolist()
    [5.35, 3.09, 5.35, 3.08]
    """
    instance("solution", solution, Solution, "hereditary.solve(...)")
    period, begin = positive("period", period), _begin(solution, transient)
    # up to rounding a period may divide the run; then the sample at the end counts
    if np.ptp(solution.t[[0, -1]]) > _MAX_SECTION_SAMPLES * period:
        required = f"give at most {_MAX_SECTION_SAMPLES} samples"
        refuse("period", required, period, "give one of the orbit's own")
    ends = np.array([max(begin, solution.t[0]), solution.t[-1]]) / period
    slack = 1e-12 * np.abs(ends).max()
    first, last = int(np.ceil(ends[0] - slack)), int(np.floor(ends[1] + slack))
    times = np.clip(period * np.arange(first, last + 1), solution.t[0], solution.t[-1])
    size = _size(count, times.size)
    times = times[-size:]
    speeds = None if solution.ydot is None else _filled(values_at(solution, times, 1), size)
    return Section(_filled(times, size), _filled(values_at(solution, times), size), speeds)


def maxima(
    solution: Solution,
    component: int = 0,
    derivative: int = 0,
    transient: float | None = None,
    count: int | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Find local maxima of one component, or of its first derivative.

    Parameters
    ----------
    solution : Solution
        Its rows, or steps of a dense output, must resolve the maxima.
    component : int, optional
    derivative : {0, 1}, optional
        1 for maxima of the first derivative.
    transient : float, optional
        No maxima before this time, by default the start [time].
    count : int, optional
        Return only the last `count` maxima; NaN follows if there are fewer.

    Returns
    -------
    t, values : ndarray, shape (n,)

    Examples
    --------
    >>> import hereditary as hd
    >>> from hereditary.analysis.sections import maxima
    >>> eq = hd.Equation(hd.Caputo(2.0), lambda t, x: -x, [0.0, 1.0])
    >>> times, values = maxima(hd.solve(eq, 10.0, rtol=1e-10))
    >>> times.round(6).tolist(), values.round(6).tolist()
    ([1.570796, 7.853982], [1.0, 1.0])
    """
    t, best = extrema(solution, component, derivative, transient, (1.0,))
    size = _size(count, t.size)
    return _filled(t[-size:], size), _filled(best[-size:], size)


def extrema(
    solution: Solution,
    component: int,
    derivative: int,
    transient: float | None,
    signs: tuple[float, ...] = (1.0, -1.0),
) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values (n,) of local maxima, sign 1, and minima, -1, of a component."""
    instance("solution", solution, Solution, "hereditary.solve(...)")
    check_component(component, solution)
    begin = _begin(solution, transient)
    value, t = _function(solution, derivative), solution.t
    if solution.coarse:
        looks = (
            np.arange((t.size - 1) * _POINTS_PER_STEP_FOR_MAXIMA + 1) / _POINTS_PER_STEP_FOR_MAXIMA
        )
        t = np.interp(looks, np.arange(t.size), t)
    t = t[t >= begin]
    top = tops(value(t)[:, component], signs) if t.size else np.zeros(0, dtype=int)
    distance = (t[top + 1] - t[top - 1]) / 2
    t = t[top]
    for _ in range(_REFINEMENTS):
        t = np.clip(t, solution.t[0] + distance, solution.t[-1] - distance)
        before, here, after = (value(t + k * distance)[:, component] for k in (-1, 0, 1))
        bend = before - 2 * here + after
        shift = np.divide(before - after, 2 * bend, out=np.zeros(t.size), where=bend != 0)
        t, distance = t + np.clip(shift, -1, 1) * distance, distance * _CLOSER
    return t, value(t)[:, component]


def tops(values: np.ndarray, signs: tuple[float, ...] = (1.0, -1.0)) -> np.ndarray:
    """Return the indices of local maxima, sign 1, and minima, -1, of a series (n,)."""
    # that of a plateau is its middle, if the series falls on both sides of it
    from scipy.signal import find_peaks

    return np.sort(np.concatenate([find_peaks(sign * values)[0] for sign in signs]))


def values_at(solution: Solution, times: ArrayLike, derivative: int = 0) -> np.ndarray:
    """Return the solution, or its first derivative, at times within the run, shape (k, d)."""
    # from the dense output of `Collocation`, otherwise from a cubic spline through the rows
    at = real_array("times", times)
    ends = solution.t[0], solution.t[-1]
    slack = 1e-9 * (ends[1] - ends[0])  # times computed otherwise may miss the ends by rounding
    if at.ndim != 1 or np.any(at < ends[0] - slack) or np.any(at > ends[1] + slack):
        refuse("times", f"be a sequence of times in [{ends[0]:g}, {ends[1]:g}]", shown(at))
    return _function(solution, derivative)(np.clip(at, *ends))


def _function(solution: Solution, derivative: int) -> Callable[[np.ndarray], np.ndarray]:
    """Return y, or y' if the rows have it, as a function of times (k,), with values (k, d)."""
    if not _is_index(derivative, 2):
        refuse("derivative", "be 0 or 1", repr(derivative))
    if solution.coarse:
        return lambda t: solution(t, derivative)
    rows = solution.ydot if derivative else solution.y
    if rows is None:
        required = "hold a first derivative (highest order above 1) or a dense output"
        refuse("solution", required, "ydot = None", "use Collocation")
    from scipy.interpolate import CubicSpline

    finite = np.isfinite(rows).all(axis=0)
    spline = CubicSpline(solution.t, np.where(finite, rows, 0.0))
    return lambda t: np.where(finite, spline(t), np.nan)


def _begin(solution: Solution, transient: float | None) -> float:
    """Return the time from which samples count; refuse complex solutions."""
    if np.iscomplexobj(solution.y):
        required, remedy = "be real", "take parts, e.g. dataclasses.replace(solution, y=y.real)"
        refuse("solution", required, "a complex one", remedy)
    check_unbroken(solution)
    return solution.t[0] if transient is None else real("transient", transient)


def check_unbroken(solution: Solution) -> None:
    """Refuse solutions that events have changed."""
    (where,) = np.nonzero(np.diff(solution.t) <= 0)
    if where.size:
        required, got = "hold no changes by events", f"one at t = {solution.t[where[0]]:g}"
        refuse("solution", required, got, "take the parts between them")


def check_component(component: int, solution: Solution) -> None:
    """Refuse anything but the number of a component of the solution."""
    if not _is_index(component, solution.y.shape[1]):
        refuse("component", f"be one of 0 .. {solution.y.shape[1] - 1}", repr(component))


def _is_index(value: Any, n: int) -> bool:
    return isinstance(value, (int, np.integer)) and bool(0 <= value < n)


def _size(wanted: int | None, n_found: int) -> int:
    size = n_found if wanted is None else count("count", wanted)
    if size > _MAX_SECTION_SAMPLES:
        refuse("count", f"be at most {_MAX_SECTION_SAMPLES}", size)
    return size


def _filled(values: np.ndarray, size: int) -> np.ndarray:
    """Return `values` followed by rows of NaN, `size` rows in all."""
    out = np.full((size, *values.shape[1:]), np.nan)
    out[: values.shape[0]] = values
    return out
