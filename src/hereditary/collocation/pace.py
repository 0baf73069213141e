"""Step limits of an adaptive run, and reasons why it cannot go on."""

from typing import NamedTuple

import numpy as np

from ..compiled.adaptive import CRAWLING, JUMPING, NOT_SOLVED
from ..compiled.rows import POSITION, PRIMARY
from ..compiled.structures import Limits
from ..solver.status import Status

# Largest number of steps of a run by default.
MAX_STEPS = 1_000_000
# Longest step where the solution is at rest, as fraction of the run; a longer one could miss a
# force that sets in later.
_DORMANT = 1 / 32
# A run stalls if in so many consecutive stretches of 200 steps or more the solution changes by less
# than the fraction _STILL, the last stretch covers no more than twice the time of the first, and
# more steps would be needed than _MOST_STEPS, or than are left if more than the fraction _REFUSED
# of steps is refused.
_STRETCHES, _STILL, _REFUSED, _MOST_STEPS = 4, 1e-2, 0.125, 1e7
# A run that ends blows up if the solution, larger than before, grew by more than this fraction over
# the last step and the next step was not refused below _WALL times its length.
_GROWING, _WALL = 1e-3, 1e-8
# Distances ahead at which f is evaluated, in lengths of the last step, where y goes on or turns
# back; f jumps where it changes by more than a fraction of its size on the way, for steps are as
# short as they can be.
_DISTANCES_AHEAD, _JUMP = (0.0, 1.0, 10.0, 100.0, 1000.0, -1.0, -10.0, -100.0, -1000.0), 0.1
_NOT_FINITE = "the right-hand side is not finite just ahead"
_JUMPS = (
    "the right-hand side jumps, or stops being finite, wherever the solution goes on (it may slide "
    "or chatter there); name known times in breaks, functions that change their sign in switches"
)
_CRAWLS = (
    "steps stay short wherever the solution goes on: it may slide or chatter where the right-hand "
    "side jumps, or rounding hides what the tolerance asks for"
)
_ROUNDS = (
    "rounding hides what the tolerance asks for, or the solution is too steep; loosen rtol, and if "
    "the right-hand side jumps here name the time in breaks, or the function in switches"
)


class Pace:
    """Step limits of one run, and detection of a run that stalls.

    Parameters
    ----------
    max_step : float or None
        Longest step [time].
    max_steps : int
        Largest number of steps.

    Attributes
    ----------
    longest : ndarray, shape (2,)
        The longest step, and the longest where the solution is at rest.
    last_step : int
        Number of the last step allowed, counted from t = 0.
    """

    def __init__(self, max_step, max_steps):
        self._max_step, self._max_steps = max_step or np.inf, max_steps
        self.longest, self.last_step = np.zeros(2), 0
        self._slow: list[float] = []
        self._t_end = np.inf

    def begin(self, t, t_end, n_steps):
        """Set the limits of a run from t to t_end that begins after `n_steps` steps."""
        longest, self._t_end = min(self._max_step, t_end - t), t_end
        self.longest = np.array([longest, min(longest, _DORMANT * (t_end - t))])
        self.last_step = n_steps + self._max_steps

    def limits(self, system, origin, t_stop, tolerances):
        """Return the `Limits` of a march from `origin` to `t_stop`."""
        times = t_stop, system.beside(origin, 1), system.beside(t_stop, -1)
        return Limits._make([*times, *self.longest.tolist(), *tolerances, self._t_end])

    def used_up(self, n_steps):
        """Return whether all allowed steps are made."""
        return n_steps >= self.last_step

    def is_stalled(self, since, earlier, t, counts, t_stop, at_starts, sizes):
        """Return whether steps stay short where the solution stands still, at jumps or by rounding.

        Parameters
        ----------
        since, t : float
            Times at which the last stretch of steps began and ended.
        earlier, counts : np.void
            Counts there.
        t_stop : float
        at_starts : ndarray, shape (n, 2, d)
            y and p at the starts of the steps of the stretch.
        sizes : ndarray, shape (2, d)
            Largest |y| and |p| before.
        """
        accepted, refused = (
            counts["accepted"] - earlier["accepted"],
            counts["refused"] - earlier["refused"],
        )
        if accepted < 200:
            return False
        advance, left, n_steps = t - since, t_stop - t, int(counts["accepted"])
        largest = np.abs(at_starts).max(axis=0)
        still = np.ptp(at_starts, axis=0) <= _STILL * (
            _STILL * np.maximum(sizes, largest) + largest
        )
        allowed = min(self.last_step - n_steps, _MOST_STEPS)
        needed = left * accepted / advance
        slow = needed > (allowed if refused > _REFUSED * accepted else _MOST_STEPS)
        self._slow = [*self._slow, advance][-_STRETCHES:] if slow and still.all() else []
        return len(self._slow) == _STRETCHES and self._slow[-1] <= 2 * self._slow[0]


class Ending(NamedTuple):
    """Status of a run that cannot go on, and a clause for its message; None for one that can."""

    status: Status | None = None
    detail: str = ""


BLOWN_UP, UNSOLVED = Ending(Status.BLOWN_UP), Ending(Status.NOT_SOLVED)
TOO_STEEP = Ending(Status.STEP_TOO_SMALL, _ROUNDS)


def ending(status, equation, t, h, refused, last, peak):
    """Return the `Ending` behind the status code of a march that stopped at time t.

    `last` (3 or 4, d, s) holds f, p and y at the nodes of the last step, of length h; the next step
    was refused down to the length `refused`. `peak` (2, d) holds the largest |p| and |y| before.
    """
    if status == CRAWLING:
        return Ending(Status.STEP_TOO_SMALL, _CRAWLS)
    before, now = (np.abs(last[PRIMARY : POSITION + 1, :, i]) for i in (0, -1))
    largest = np.maximum((1 + _GROWING) * before, peak)
    growing = np.any(now.max(axis=1) > largest.max(axis=1)) and refused > _WALL * h
    if status != JUMPING and growing:
        return BLOWN_UP
    forces = _forces_ahead(equation, t, h, last[POSITION])
    if not np.all(np.isfinite(forces)):
        return Ending(Status.STEP_TOO_SMALL, _NOT_FINITE)
    jumps = np.abs(forces - forces[0]).max() > _JUMP * np.abs(forces).max()
    if status == NOT_SOLVED and not jumps:
        return UNSOLVED
    return Ending(Status.STEP_TOO_SMALL, _JUMPS) if status in (JUMPING, NOT_SOLVED) else TOO_STEEP


def _forces_ahead(equation, t, h, y):
    """Return f where the last step, y (d, s) of length h, points to, shape (n, d).

    It is evaluated at points extrapolated linearly from the first and the last node.
    """
    ahead = [(t + abs(a) * h, y[:, -1] + a * (y[:, -1] - y[:, 0])) for a in _DISTANCES_AHEAD]
    return np.array([equation.force(*point) for point in ahead])
