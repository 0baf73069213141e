"""Limits of the steps of a run by collocation, and runs that make no progress."""

import numpy as np

from ..stepping.tolerance import Tolerance
from .structures import Limits

# Longest step while the solution is at rest, as fraction of the run. A longer step could miss a
# force that sets in later.
_DORMANT = 1 / 32
# Distance of the times at which f is looked at between the nodes, as fraction of the run. A call of
# a function in Python takes as long as two hundred calls of a compiled one.
_LOOKS = 1 / 600
_LOOKS_IN_PYTHON = 1 / 150
# A run stalls after this many consecutive blocks, of 200 steps or more each, that are still and
# slow. The last block then covers at most twice the time of the first.
_STALLED_BLOCKS = 4
# A block is still if the solution changes by less than this fraction of its size.
_STILL = 1e-2
# If more than this fraction of the accepted steps is rejected, a block is slow when `max_steps`
# does not suffice to the end.
_MAX_REJECTED_RATIO = 0.125
# Number of steps to the end of the run. A block is slow if, at its speed, the run needs more.
_MOST_STEPS = 1e7


def limits_of(tolerance: Tolerance, t: float, t_end: float, in_python: bool) -> Limits:
    """Return the `Limits` of a march from t to t_end, by the tolerance of a step."""
    # in_python: whether f is a function in Python
    longest = min(tolerance.max_step, t_end - t)
    idle = min(longest, _DORMANT * (t_end - t))
    looks = _LOOKS_IN_PYTHON if in_python else _LOOKS
    return Limits(t_end, t, t_end, longest, idle, t_end, looks * t_end, tolerance)


class Progress:
    """Progress of a run of at most `last_step` steps from t = 0 on."""

    def __init__(self, last_step: int) -> None:
        self.last_step = last_step
        self._slow: list[float] = []

    def is_stalled(
        self,
        since: float,
        earlier: np.void,
        t: float,
        counts: np.void,
        t_stop: float,
        at_starts: np.ndarray,
        sizes: np.ndarray,
    ) -> bool:
        """Return whether steps stay short although the solution hardly changes."""
        # From since to t, in a batch of n steps on the way to t_stop; earlier and counts: the
        # march's then and now. at_starts (n, 2, d): y and p at starts of steps; sizes (2, d): those
        # of the tolerance.
        accepted, rejected = (
            counts["accepted"] - earlier["accepted"],
            counts["rejected"] - earlier["rejected"],
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
        slow = needed > (allowed if rejected > _MAX_REJECTED_RATIO * accepted else _MOST_STEPS)
        self._slow = [*self._slow, advance][-_STALLED_BLOCKS:] if slow and still.all() else []
        return len(self._slow) == _STALLED_BLOCKS and self._slow[-1] <= 2 * self._slow[0]
