"""Sections of an orbit: samples once a period, and local maxima.

Both read the dense output of collocation, and parabolas through the rows of given steps, and give
arrays of a fixed size when asked to, filled up with NaN, so that a sweep can stack them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..solver.solution import Solution
from ..support.checks import complaint, count, instance, positive, real, real_array, shown

# Points of each step at which a dense output is looked at for maxima.
_LOOKS = 8
# Refinements of a maximum on a dense output, each over this share of the last distance: a parabola
# over a distance d misses the place by d**2, so that three leave rounding.
_REFINEMENTS, _CLOSER = 3, 1 / 16
# Samples that fit into memory.
_MOST_SAMPLES = 10_000_000


@dataclass(frozen=True, eq=False)
class Section:
    """An orbit looked at at some times; NaN where a section of fixed size has no more of them.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times [time].
    y : ndarray, shape (n, d)
        The solution then.
    ydot : ndarray, shape (n, d), or None
        Its first derivative, where the highest order exceeds 1.
    """

    t: np.ndarray
    y: np.ndarray
    ydot: np.ndarray | None

    def within(self, spacing: float) -> np.ndarray:
        """The solution reduced to one cell [0, spacing) of a chain of equal ones, shape (n, d)."""
        return np.mod(self.y, positive("spacing", spacing))

    def lag(self, speed: float) -> np.ndarray:
        """Return ``y - speed * t``, the distance ahead of an even motion, shape (n, d)."""
        return self.y - real("speed", speed) * self.t[:, None]


def stroboscopic(
    solution: Solution, period: float, transient: float | None = None, count: int | None = None
) -> Section:
    """The orbit at whole multiples of a period.

    Parameters
    ----------
    solution : Solution
    period : float
        Time between two samples, e.g. that of the drive; for the stick-slip oscillator
        ``2 pi omega**2 / b``, in which the pulled spring passes one well [time].
    transient : float, optional
        No samples before this time, by default the start [time].
    count : int, optional
        The last so many samples; where there are fewer, NaN follow them.

    Returns
    -------
    Section

    Error
    -----
    Between rows, a parabola's: the third power of their distance. None with a dense output.

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
    # a period that divides the run up to rounding still gives its last sample
    if np.ptp(solution.t[[0, -1]]) > _MOST_SAMPLES * period:
        required = f"give at most {_MOST_SAMPLES} samples"
        raise ValueError(complaint("period", required, period, "give one of the orbit's own"))
    ends = np.array([max(begin, solution.t[0]), solution.t[-1]]) / period
    slack = 1e-12 * np.abs(ends).max()
    first, last = int(np.ceil(ends[0] - slack)), int(np.floor(ends[1] + slack))
    times = np.clip(period * np.arange(first, last + 1), solution.t[0], solution.t[-1])
    size = _size(count, times.size)
    times = times[max(0, times.size - size) :]
    speeds = None if solution.ydot is None else _filled(values_at(solution, times, 1), size)
    return Section(_filled(times, size), _filled(values_at(solution, times), size), speeds)


def maxima(
    solution: Solution,
    component: int = 0,
    derivative: int = 0,
    transient: float | None = None,
    count: int | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Local maxima of one component, or of its first derivative.

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
        The last so many maxima; where there are fewer, NaN follow them.

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
    kept = slice(max(0, t.size - size), None)
    return _filled(t[kept], size), _filled(best[kept], size)


def extrema(solution, component, derivative, transient, signs=(1.0, -1.0)):
    """Return times and values (n,) of local maxima, sign 1, and minima, -1, of a component."""
    instance("solution", solution, Solution, "hereditary.solve(...)")
    if not _is_index(component, solution.y.shape[1]):
        required = f"be one of 0 .. {solution.y.shape[1] - 1}"
        raise ValueError(complaint("component", required, repr(component)))
    j = int(component)
    times, values = _samples(solution, j, derivative)
    inside = times >= _begin(solution, transient)
    times, values = times[inside], values[inside]
    top = tops(values, signs)
    t, best = _vertices(
        *(times[top + k] for k in (-1, 0, 1)), *(values[top + k] for k in (-1, 0, 1))
    )
    if solution.coarse and t.size:
        t, best = _refined(solution, j, derivative, t, times[top + 1] - times[top - 1])
    return t, best


def tops(values, signs=(1.0, -1.0)):
    """Return the indices of local maxima, sign 1, and minima, -1, of a series (n,).

    Of a plateau the first, where the series falls on both sides of it.
    """
    first = np.flatnonzero(np.append(True, values[1:] != values[:-1]))
    found = [
        first[1:-1][(level[1:-1] > level[:-2]) & (level[1:-1] > level[2:])]
        for level in (sign * values[first] for sign in signs)
    ]
    return np.sort(np.concatenate(found))


def values_at(solution: Solution, times: ArrayLike, derivative: int = 0) -> np.ndarray:
    """The solution, or its first derivative, at times within the run, shape (k, d).

    From the dense output of `Collocation`, otherwise by parabolas through the three rows nearest to
    each time.
    """
    at = real_array("times", times)
    ends = solution.t[0], solution.t[-1]
    slack = 1e-9 * (ends[1] - ends[0])  # times computed otherwise may miss the ends by rounding
    if at.ndim != 1 or np.any(at < ends[0] - slack) or np.any(at > ends[1] + slack):
        required = f"be a sequence of times in [{ends[0]:g}, {ends[1]:g}]"
        raise ValueError(complaint("times", required, shown(at)))
    at = np.clip(at, *ends)
    if solution.coarse:
        return solution(at, derivative) if at.size else np.empty((0, solution.y.shape[1]))
    t, rows = solution.t, _rows(solution, derivative)
    if t.size < 3:
        return np.array([np.interp(at, t, row) for row in rows.T]).T
    # the middle one of three rows
    i = np.clip(np.searchsorted((t[:-1] + t[1:]) / 2, at), 1, t.size - 2)
    a, b, c = t[i - 1], t[i], t[i + 1]
    slope = (rows[i] - rows[i - 1]) / (b - a)[:, None]
    bend = ((rows[i + 1] - rows[i]) / (c - b)[:, None] - slope) / (c - a)[:, None]
    # through the two rows a and b, then the bend that meets c
    return rows[i - 1] + (at - a)[:, None] * (slope + (at - b)[:, None] * bend)


def _rows(solution, derivative):
    """y, or y' where the rows hold it."""
    if not _is_index(derivative, 2):
        raise ValueError(complaint("derivative", "be 0 or 1", repr(derivative)))
    if not derivative:
        return solution.y
    if solution.ydot is None:
        required = "hold a first derivative (highest order above 1) or a dense output"
        raise ValueError(complaint("solution", required, "ydot = None", "use Collocation"))
    return solution.ydot


def _samples(solution, j, derivative):
    """Times and values among which maxima are looked for."""
    if not solution.coarse:
        return solution.t, _rows(solution, derivative)[:, j]
    share = np.arange(_LOOKS) / _LOOKS
    t = solution.t
    times = np.append((t[:-1, None] + np.diff(t)[:, None] * share).ravel(), t[-1])
    return times, solution(times, derivative)[:, j]


def _vertices(a, b, c, at_a, at_b, at_c):
    """Place and height of the vertex of each parabola through three points with b in the middle."""
    left, right = (at_b - at_a) / (b - a), (at_c - at_b) / (c - b)
    bend = (right - left) / (c - a)
    # slope 0 of the parabola; three equal values have their middle
    flat = bend == 0
    place = np.where(flat, b, (a + b) / 2 - left / (2 * np.where(flat, -1.0, bend)))
    return place, at_a + (place - a) * (left + (place - b) * bend)


def _refined(solution, j, derivative, t, distance):
    """Maxima on a dense output, from parabolas through ever closer points."""
    for _ in range(_REFINEMENTS):
        distance = distance * _CLOSER
        middle = np.clip(t, solution.t[0] + distance, solution.t[-1] - distance)
        points = [middle - distance, middle, middle + distance]
        t, _ = _vertices(*points, *(solution(point, derivative)[:, j] for point in points))
        t = np.clip(t, points[0], points[2])
    return t, solution(t, derivative)[:, j]


def _begin(solution, transient):
    """Return the time from which on samples count; refuse complex solutions."""
    if np.iscomplexobj(solution.y):
        required, remedy = "be real", "take parts, e.g. dataclasses.replace(solution, y=y.real)"
        raise ValueError(complaint("solution", required, "a complex one", remedy))
    check_unbroken(solution)
    return solution.t[0] if transient is None else real("transient", transient)


def check_unbroken(solution):
    """Refuse solutions that events have changed."""
    (where,) = np.nonzero(np.diff(solution.t) <= 0)
    if where.size:
        required, got = "hold no changes by events", f"one at t = {solution.t[where[0]]:g}"
        raise ValueError(complaint("solution", required, got, "take the parts between them"))


def _is_index(value, n):
    return isinstance(value, (int, np.integer)) and 0 <= value < n


def _size(wanted, found):
    size = found if wanted is None else count("count", wanted)
    if size > _MOST_SAMPLES:
        raise ValueError(complaint("count", f"be at most {_MOST_SAMPLES}", size))
    return size


def _filled(values, size):
    """`values` with rows of NaN behind them, up to `size` rows."""
    out = np.full((size, *values.shape[1:]), np.nan)
    out[: values.shape[0]] = values
    return out
