"""The solution between given steps: parabolas, and powers of t in the first two."""

from __future__ import annotations

import numpy as np

from .dense import Piece
from .first_steps import FirstSteps

# The slope at 0 is taken here, and called infinite beyond this size.
_NEXT_TO_0, _STEEP = 1e-200, 1e12


class StepPieces(Piece):
    """Consecutive steps, each a parabola through its ends with the slope at its end.

    Parameters
    ----------
    times : ndarray, shape (k+1,)
        Ends of the steps, the start in front [time].
    rows, slopes : ndarray, shape (k+1, d)
        Solution and first derivative there.
    starting : FirstSteps, optional
        The solution inside the first two steps of a run, where it is known there.
    n : int
        Number of the step that the start is.
    """

    def __init__(self, times, rows, slopes, starting: FirstSteps | None = None, n=0):
        self.times, self.rows, self.slopes = times, rows, slopes
        self.starting, self._n = starting, n
        if starting is not None:
            for number in range(max(1, n), min(3, n + times.size)):
                if times[number - n] >= starting.ends[number - 1]:  # no event before it
                    starting.end(number, rows[number - n])

    def edges(self):
        """Return the start of each step."""
        return self.times[:-1]

    def at_ends(self, ends, chosen, second, slopes=True):
        """Return y and y' at the chosen ones of the steps' ends, (k, d) each."""
        return self.rows[1:][chosen], self.slopes[1:][chosen]

    def evaluate(self, t, second, derivative):
        """Return y or y' at times t inside the steps, shape (k, d)."""
        last = self.times.size - 1
        i = np.clip(np.searchsorted(self.times, t), 1, last)
        # where a change of y gives a time two rows, the second one counts
        i = np.where((self.times[np.minimum(i + 1, last)] == t) & (i + 2 <= last), i + 2, i)
        h = (self.times[i] - self.times[i - 1])[:, None]
        back = (t - self.times[i])[:, None] / h
        with np.errstate(over="ignore", invalid="ignore"):  # the last step may overflow
            increment = self.rows[i] - self.rows[i - 1]
            change = 2.0 * (h * self.slopes[i] - increment)
            if derivative:
                found = (increment + (0.5 + back) * change) / h
            else:
                found = self.rows[i] + back * (increment + 0.5 * (1.0 + back) * change)
        if self.starting is not None:
            for number in (1, 2):
                inside = (i + self._n == number) & (t < self.times[i])
                if inside.any():
                    found[inside] = _near_start(self.starting, number, t[inside], derivative)
        return found


def _near_start(starting, n, t, derivative):
    """y or y' inside step n, 1 or 2; powers below 1 are infinitely steep at 0."""
    y, slope = starting.inside(n, np.maximum(t, _NEXT_TO_0))
    steep = (t[:, None] == 0.0) & (np.abs(slope) > _STEEP)
    return np.where(steep, np.copysign(np.inf, slope), slope) if derivative else y
