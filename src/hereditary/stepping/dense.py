"""Dense output: the solution of a run at any time, from pieces on one or several steps.

On given steps the solution between two rows is a parabola. Inside the first two steps of a run it
may have another form (given/first_steps.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..equation.frame import Frame
from ..support.checks import real_array, refuse, shown

# Largest distance of a plotted curve from its chords, as a fraction of the curve's size: half a
# pixel if the figure has 1,000 pixels.
_CHORD = 5e-4
# Number of points at which the refinement of a curve stops, for curves that are never smooth, such
# as rounding errors of a constant.
_MAX_CURVE_POINTS = 100_000
# Number of halvings of a long step before chords are compared with the curve: the middle of a chord
# over a whole oscillation lies on the curve.
_MIN_HALVINGS_OF_STEP = 3


class Piece:
    """Dense output on one step, or on several consecutive steps, of d components."""

    # solution inside the first two steps of a run, if it is known there
    starting: Any = None
    # whether steps are so long that a curve needs points between their ends
    coarse = True

    def edges(self) -> np.ndarray:
        """Return the start of each step."""
        raise NotImplementedError

    def evaluate(self, t: np.ndarray, derivative: int) -> np.ndarray:
        """Return y, or y' for ``derivative=1``, at times t inside the steps, (k, d)."""
        raise NotImplementedError

    def evaluate_both(self, t: np.ndarray, slopes: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return y and y' at k times t in the steps, (k, d) each; y' is NaN without `slopes`."""
        y = self.evaluate(t, 0)
        return y, self.evaluate(t, 1) if slopes else np.full_like(y, np.nan)

    def at_ends(
        self, ends: np.ndarray, chosen: Any, slopes: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return y and y' as `evaluate_both` does, at the chosen ends of steps."""
        return self.evaluate_both(ends[chosen], slopes)


class Dense:
    """The solution of a run at any time, from the interpolants of its steps."""

    def __init__(self, d: int, frame: Frame) -> None:
        self._d, self._frame = d, frame
        self._pieces: list = []
        self._starts: list[float] = []

    @property
    def coarse(self) -> bool:
        """Whether steps are so long that a curve needs points between their ends."""
        return any(piece.coarse for piece in self._pieces)

    def add(self, piece: Piece, start: float) -> None:
        """Append the dense output of steps that begin at time `start`."""
        self._pieces.append(piece)
        self._starts.append(start)

    def __call__(self, t: ArrayLike, derivative: int, end: float) -> np.ndarray:
        """Return y, or y' for ``derivative=1``, at the user's t <= end; (d,), or (k, d)."""
        times = np.atleast_1d(real_array("t", t))
        if times.ndim > 1:
            refuse("t", "be a number or of shape (k,)", f"shape {times.shape}", "pass t.ravel()")
        if not self._pieces:
            refuse("t", "wait for a run that made a step", shown(times))
        start = self._starts[0] + self._frame.start
        if not ((times >= start) & (times <= end)).all():
            refuse("t", f"lie in [{start}, {end}]", shown(times))
        times = np.maximum(times - self._frame.start, self._starts[0])
        out = self._evaluate(times, derivative)
        if derivative:
            inside = self._evaluate(times, 0) if self._frame.speeds else out
            out = self._frame.slopes(inside, out)
        else:
            out = self._frame.values(out)
        return out if np.ndim(t) else out[0]

    def _evaluate(self, times: np.ndarray, derivative: int) -> np.ndarray:
        """Return components of the run, or their slopes, (k, d), at times of the run."""
        where = last_start(np.array(self._starts), times)
        if times.size and (where == where[0]).all():
            return self._pieces[where[0]].evaluate(times, derivative)
        out = np.empty((times.size, self._d))
        for k in np.unique(where):
            chosen = where == k
            out[chosen] = self._pieces[k].evaluate(times[chosen], derivative)
        return out


def last_start(starts: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return for each time the last start not after it, or the first of several equal starts."""
    # steps next to a singular start may be so short that time does not change
    last = starts.searchsorted(t, side="right") - 1
    first = starts.searchsorted(t, side="left")
    return np.where(first <= last, first, last)


class StepPieces(Piece):
    """Consecutive steps, each a parabola through its ends with the slope at its end."""

    coarse = False

    def __init__(
        self, times: np.ndarray, rows: np.ndarray, slopes: np.ndarray, starting: Any = None,
        n: int = 0,
    ) -> None:  # fmt: skip
        # times (k+1,): of all ends [time]; rows, slopes (k+1, d); starting: the solution inside the
        # first two steps of a run, if it is known; n: number of steps before
        self.times, self.rows, self.slopes = times, rows, slopes
        self.starting, self._n = starting, n
        if starting is not None:
            for number in range(max(1, n), min(3, n + times.size)):
                if times[number - n] >= starting.ends[number - 1]:  # not cut by an event
                    starting.end(number, rows[number - n])

    def edges(self) -> np.ndarray:
        """Return the start of each step."""
        return self.times[:-1]

    def at_ends(
        self, ends: np.ndarray, chosen: Any, slopes: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return y and y' at the chosen ends of steps, (k, d) each."""
        return self.rows[1:][chosen], self.slopes[1:][chosen]

    def evaluate(self, t: np.ndarray, derivative: int) -> np.ndarray:
        """Return y, or y' for ``derivative=1``, at k times t inside the steps, shape (k, d)."""
        last = self.times.size - 1
        i = np.clip(np.searchsorted(self.times, t), 1, last)
        # if a change of y has given a time two rows, the second row counts
        i = np.where((self.times[np.minimum(i + 1, last)] == t) & (i + 2 <= last), i + 2, i)
        h = (self.times[i] - self.times[i - 1])[:, None]
        back = (t - self.times[i])[:, None] / h
        with np.errstate(over="ignore", invalid="ignore"):  # the last step may overflow
            increment = self.rows[i] - self.rows[i - 1]
            change = 2.0 * (h * self.slopes[i] - increment)
            if derivative:
                values = (increment + (0.5 + back) * change) / h
            else:
                values = self.rows[i] + back * (increment + 0.5 * (1.0 + back) * change)
        if self.starting is not None:
            for number in (1, 2):
                inside = (i + self._n == number) & (t < self.times[i])
                if inside.any():
                    values[inside] = self.starting.near(number, t[inside], derivative)
        return values


def curve(
    solution: Any, components: Any, derivatives: Sequence[int] = (0,)
) -> tuple[np.ndarray, np.ndarray]:
    """Return times (k,) and values (k, m) of a curve that looks smooth as straight lines."""
    # Rows and, if steps are long, points of the dense output between them; the columns are the
    # chosen components of y, of y', or first of one and then of the other.
    t = solution.t
    values = np.hstack([(solution.y, solution.ydot)[k][:, components] for k in derivatives])
    if not solution.coarse:
        return t, values
    with np.errstate(invalid="ignore", over="ignore"):  # of runs that blew up
        allowed = _CHORD * np.fmax.reduce(np.abs(values - values[-1]))
        chords, halvings = np.arange(t.size - 1), 0
        while chords.size and t.size < _MAX_CURVE_POINTS:
            middle = (t[chords] + t[chords + 1]) / 2
            inside = (t[chords] < middle) & (middle < t[chords + 1])
            chords, middle = chords[inside], middle[inside]
            at_middle = np.hstack([solution(middle, k)[:, components] for k in derivatives])
            missed = np.abs(at_middle - (values[chords] + values[chords + 1]) / 2) > allowed
            bent = missed.any(axis=1) | (halvings < _MIN_HALVINGS_OF_STEP)
            chords, halvings = chords[bent], halvings + 1
            t = np.insert(t, chords + 1, middle[bent])
            values = np.insert(values, chords + 1, at_middle[bent], axis=0)
            chords = chords + np.arange(chords.size)
            chords = np.sort(np.concatenate([chords, chords + 1]))
    return t, values
