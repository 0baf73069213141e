"""Which rows of a run are kept."""

import os

import numpy as np

from .._checks import complaint


class Rows:
    """Which rows are kept, and the rows kept so far."""

    def __init__(self, stepper, n_total, save_every, times):
        self._every, self._times, self._n_total = save_every, times, n_total
        self._ended = False
        n = stepper.n
        if times is not None:
            self._positions = np.minimum(stepper.steps.positions(times), n_total)
            size = times.size
        else:
            size = n_total // save_every - n // save_every + (n_total % save_every > 0) + 1
        d = stepper.equation.d
        self.t, self.y, self.ydot = _room(size, d, "save_every" if times is None else "t_eval")
        self.size = 0
        self._times_of = stepper.steps.times
        if times is None or times[0] <= stepper.t:
            self.t[0], self.y[0], self.ydot[0] = stepper.t, stepper.y, stepper.ydot
            self.size = 1

    def positions(self, n, n_end):
        """Positions in steps of the rows in (n, n_end], and the arrays to write them to."""
        if self._times is not None:
            stop = int(np.searchsorted(self._positions, n_end, side="right"))
            positions = self._positions[self.size : stop]
        else:
            first = (n // self._every + 1) * self._every
            positions = np.arange(first, n_end + 1, self._every, dtype=float)
            if n_end == self._n_total and n_end % self._every:
                positions = np.append(positions, float(n_end))
        part = slice(self.size, self.size + positions.size)
        return positions, self.y[part], self.ydot[part]

    def keep(self, positions, written):
        """Note that the first `written` of these rows have been filled."""
        part = slice(self.size, self.size + written)
        if self._times is None:
            self.t[part] = self._times_of(positions[:written])
        else:
            self.t[part] = self._times[part]
        self.size += written

    @property
    def keeps_steps(self):
        """Whether every step is kept."""
        return self._times is None and self._every == 1

    def end(self, t, y, ydot):
        """Add the row of the event that ends the run, where steps are kept."""
        self._ended = True
        if self._times is None and self.t[self.size - 1] < t:
            last = self.size
            self.t[last], self.y[last], self.ydot[last] = t, y, ydot
            self.size += 1

    def close(self, stepper, t_end):
        """Add the last step of a run that ended early, and name the end of one that did not."""
        if self._times is not None or self._ended:
            return
        if stepper.n == self._n_total:
            self.t[self.size - 1] = t_end  # n h may miss it by rounding
        elif self.t[self.size - 1] < stepper.t:
            last = self.size
            self.t[last], self.y[last], self.ydot[last] = stepper.t, stepper.y, stepper.ydot
            self.size += 1


def _room(size, d, argument):
    """Arrays (size,), (size, d) and (size, d) for rows, or a refusal where they do not fit."""
    n_bytes = 8.0 * size * (1 + 2 * d)
    try:
        if n_bytes > _memory():
            raise MemoryError
        return np.empty(size), np.empty((size, d)), np.empty((size, d))
    except MemoryError as error:
        required = "keep as many rows as fit in memory"
        got = f"{size:.3g} rows of {d} components, {n_bytes:.1e} bytes"
        raise ValueError(complaint(argument, required, got, "keep fewer")) from error


def _memory():
    """Bytes of memory that the machine has, where it says."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        return np.inf
