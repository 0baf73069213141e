"""Dense output: the solution of a run at any time, from its pieces."""

import numpy as np

from .._checks import complaint, real_array, shown
from ..frame import Frame


class Piece:
    """Dense output on one step, or on several consecutive ones."""

    def edges(self):
        """Return the start of each step."""
        raise NotImplementedError

    def evaluate(self, t, second, derivative):
        """Return y, or y' for ``derivative=1``, at times t inside the steps, (k, d).

        `second` (d,) tells the components whose first derivative was an unknown.
        """
        raise NotImplementedError

    def evaluate_both(self, t, second, slopes):
        """Return y and y' at times t inside the steps, (k, d) each; NaN for y' without `slopes`."""
        y = self.evaluate(t, second, 0)
        return y, self.evaluate(t, second, 1) if slopes else np.full_like(y, np.nan)

    def at_ends(self, ends, chosen, second, slopes=True):
        """As `evaluate_both`, at the chosen ones of the steps' ends."""
        return self.evaluate_both(ends[chosen], second, slopes)


class Dense:
    """The solution at any time of a run, from the steps that made it.

    Parameters
    ----------
    second : ndarray of bool, shape (d,)
        Components whose first derivative was the unknown.
    resolved : bool
        Whether steps are so short that their ends show whatever happens.
    frame : Frame
        How the user sees times and components.
    """

    def __init__(self, second, resolved=False, frame=Frame()):  # noqa: B008
        self._second, self.resolved = np.asarray(second, dtype=bool), resolved
        self._frame = frame
        self._pieces: list = []
        self._starts: list[float] = []

    def add(self, piece, start):
        """Take in what follows from `start` on."""
        self._pieces.append(piece)
        self._starts.append(start)

    def __call__(self, t, derivative, end):
        """y, or y' for ``derivative=1``, at times t up to `end`; shape (d,) or (k, d)."""
        times = np.atleast_1d(real_array("t", t))
        if times.ndim > 1:
            required, remedy = "be a number or of shape (k,)", "pass t.ravel()"
            raise ValueError(complaint("t", required, f"shape {times.shape}", remedy))
        if not self._pieces:
            raise ValueError(complaint("t", "wait for a run that made a step", shown(times)))
        start = self._starts[0] + self._frame.start
        if not ((times >= start) & (times <= end)).all():
            required = f"lie in [{start}, {end}]"
            raise ValueError(complaint("t", required, shown(times)))
        times = np.maximum(times - self._frame.start, self._starts[0])
        out = self._evaluate(times, derivative)
        if derivative:
            inside = self._evaluate(times, 0) if self._frame.speeds else out
            out = self._frame.slopes(inside, out)
        else:
            out = self._frame.values(out)
        return out if np.ndim(t) else out[0]

    def _evaluate(self, times, derivative):
        """Return the components inside, or their slopes, at times inside, (k, d)."""
        where = last_start(np.array(self._starts), times)
        if times.size and (where == where[0]).all():
            return self._pieces[where[0]].evaluate(times, self._second, derivative)
        out = np.empty((times.size, self._second.size))
        for k in np.unique(where):
            chosen = where == k
            out[chosen] = self._pieces[k].evaluate(times[chosen], self._second, derivative)
        return out


def last_start(starts, t):
    """The last that starts by each time, or the first of several that start at that very time.

    Steps next to a singular start may be too short for its time to change.
    """
    last = starts.searchsorted(t, side="right") - 1
    first = starts.searchsorted(t, side="left")
    return np.where(first <= last, first, last)
