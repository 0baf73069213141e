"""How far an adaptive run may go, and why it cannot go on (floor 4)."""

from typing import NamedTuple

import numpy as np

from ..kernels.adaptive import CRAWLING, JUMPING, NOT_SOLVED
from ..kernels.collocation import POSITION, PRIMARY

# Steps of a run, unless the caller wants more.
MAX_STEPS = 1_000_000
# A step where nothing happens is no longer than this share of the run: a force that comes on later
# would be stepped over.
_DORMANT = 1 / 32
# A run is given up where, in so many stretches of 200 steps or more, the solution stands still to
# this share of its size, more than this share of the steps is refused, no stretch gets much further
# than the one before, and at this pace more steps were needed than are left, or than this.
_STRETCHES, _STILL, _REFUSED, _HOPELESS = 4, 1e-2, 0.125, 1e7
# Relative growth over the last step, of what is larger than ever, beyond which a run that ends is
# one that grows without bound, unless the next one was refused down to this share of it.
_GROWING, _WALL = 1e-3, 1e-8
# In last steps: how far ahead is just ahead.
_FURTHER = (1.0, 10.0, 100.0, 1000.0)
_NOT_FINITE = "the right-hand side is not finite just ahead"
_JUMPS = (
    "the right-hand side jumps, or stops being finite, wherever the solution goes on (it may slide "
    "or chatter there); where it jumps at known times name these in breaks"
)
_CRAWLS = (
    "steps stay short wherever the solution goes on: it may slide or chatter where the right-hand "
    "side jumps, or rounding hides what the tolerance asks for"
)
ROUNDS = (
    "rounding hides what the tolerance asks for, or the solution is too steep; loosen rtol, and if "
    "the right-hand side jumps here name the time in breaks"
)


class Pace:
    """Limits of the steps of one run, and a watch on whether it gets anywhere.

    Parameters
    ----------
    max_step : float or None
        Longest step [time].
    max_steps : int
        Most steps.

    Attributes
    ----------
    longest : ndarray, shape (2,)
        The longest step, and the longest where nothing happens.
    last_step : int
        Number of the last step allowed, counted from t = 0.
    """

    def __init__(self, max_step, max_steps):
        self._max_step, self._max_steps = max_step or np.inf, max_steps
        self.longest, self.last_step = np.zeros(2), 0
        self._crawl: list[float] = []

    def begin(self, t, t_end, n_steps):
        """Set the limits of a run from t to t_end, `n_steps` steps after 0."""
        longest = min(self._max_step, t_end - t)
        self.longest = np.array([longest, min(longest, _DORMANT * (t_end - t))])
        self.last_step = n_steps + self._max_steps

    def used_up(self, n_steps):
        """Whether all steps allowed are made."""
        return n_steps >= self.last_step

    def hopeless(self, made, refused, n_steps, advance, left, begins):
        """Whether something holds all steps down: jumps, where a solution slides, or rounding.

        Parameters
        ----------
        made, refused : int
            Steps of the last stretch.
        n_steps : int
            Steps made in all.
        advance, left : float
            Time covered by the stretch, and time left [time].
        begins : ndarray, shape (n, 2, d)
            The solution at the starts of these steps.
        """
        if made < 200:
            return False
        still = np.ptp(begins, axis=0) <= _STILL * (_STILL + np.abs(begins).max(axis=0))
        allowed = min(self.last_step - n_steps, _HOPELESS)
        crawls = refused > _REFUSED * made and left * made > advance * allowed
        self._crawl = [*self._crawl, advance][-_STRETCHES:] if crawls and still.all() else []
        return len(self._crawl) == _STRETCHES and self._crawl[-1] <= 2 * self._crawl[0]


class Ending(NamedTuple):
    """Why a run cannot go on.

    Attributes
    ----------
    blown_up : bool
        The solution grows without bound.
    not_solved : bool
        Newton's method does not converge.
    no_step : str
        A clause about steps that are never small enough; empty where it is not that.
    """

    blown_up: bool = False
    not_solved: bool = False
    no_step: str = ""


def ending(status, equation, t, h, refused, last, peak):
    """The `Ending` behind the status of a march that stopped at time t.

    `last` (3 or 4, d, s) holds f, p and y at the nodes of the last step, of length h; the next one
    was refused down to the length `refused`. `peak` (2, d) is how large p and y were before.
    """
    if status == CRAWLING:
        return Ending(no_step=_CRAWLS)
    before, now = (np.abs(last[PRIMARY : POSITION + 1, :, i]) for i in (0, -1))
    largest = np.maximum((1 + _GROWING) * before, peak)
    growing = np.any(now.max(axis=1) > largest.max(axis=1)) and refused > _WALL * h
    if status != JUMPING and growing:
        return Ending(blown_up=True)
    if not _finite_ahead(equation, t, h, last[POSITION]):
        return Ending(no_step=_NOT_FINITE)
    if status == NOT_SOLVED:
        return Ending(not_solved=True)
    return Ending(no_step=_JUMPS if status == JUMPING else ROUNDS)


def _finite_ahead(equation, t, h, y):
    """Whether the right-hand side is finite where a step of length h, y (d, s), points to."""
    force = np.empty(equation.d)
    for further in _FURTHER:
        point = y[:, -1] + further * (y[:, -1] - y[:, 0])
        equation._rhs(t + further * h, point, force, equation._params)
        if not np.all(np.isfinite(force)):
            return False
    return True
