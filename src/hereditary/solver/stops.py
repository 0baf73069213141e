"""Times at which a run is to stop: which are one time, breaks, and the steps beside them."""

import numpy as np

from ..support.checks import complaint, real_array, shown

# Times closer than this, relatively, are one time: a few hundred units of rounding.
_ONE_TIME = 1e-13
# Breaks may miss their steps by so much of a step.
_OFF = 1e-6
# A step next to a jump sees it from this far aside, relative to its time.
_ASIDE = 8 * np.finfo(float).eps


def checked_breaks(breaks, start):
    """Increasing times above `start` that lie apart, shape (k,), counted from there."""
    given = real_array("breaks", breaks)
    if given.size == 0:
        return given.ravel()
    if given.ndim != 1 or np.any(np.diff(given) <= 0) or np.any(given <= start):
        required = f"be increasing times above {start:g}"
        raise ValueError(complaint("breaks", required, shown(given)))
    times = given - start
    return times[np.append(True, ~together(times[1:], times[:-1], start))]


def together(times, t, origin=0.0):
    """Return whether times are one with t: breaks, events, changes and ends of runs act once there.

    Functions of the user see times from `origin` on, which are rounded there.
    """
    return np.abs(times - t) <= _ONE_TIME * np.maximum(np.abs(t), abs(origin))


def breaks_ahead(times, start, t_end, origin):
    """Whether there is a break at `start`, and those between `start` and t_end."""
    at_once, at_end = together(times, start, origin), together(times, t_end, origin)
    ahead = (times > start) & (times < t_end) & ~at_once & ~at_end
    return bool(np.any(at_once)) and start > 0, times[ahead]


def break_steps(times, start, t_end, steps, origin):
    """Numbers of the steps that end at breaks from `start` on, a frozenset.

    Messages name times from `origin` on.
    """
    times = times[(times >= start) & (times <= t_end)]
    if times.size == 0:
        return frozenset()
    positions = steps.positions(times)
    numbers = np.rint(positions)
    off = np.abs(positions - numbers) > _OFF
    if np.any(off):
        required = "be times of steps, which see the jump from its own side each"
        remedy = "take as many steps that one ends there, or a mesh through it"
        raise ValueError(complaint("breaks", required, shown(origin + times[off]), remedy))
    return frozenset(int(n) for n in numbers)


def before_break(breaks, n, stop):
    """Step up to which a march goes from step n at once: each step beside a break goes alone."""
    if not breaks:
        return stop
    if breaks & {n, n + 1}:
        return n + 1
    return min([stop, *(number - 1 for number in breaks if number > n)])


def rows_beside(breaks, n, rows, steps, origin):
    """Return the rows of step n, which next to a break sees the jump from its own side.

    Functions see times from `origin` on.
    """
    theta = rows.theta
    for beside, seen, sign in ((n + 1 in breaks, 1.0, -1.0), (n in breaks, 0.0, 1.0)):
        if beside and np.all(theta == seen):
            t = steps.time(n + 1)
            theta = theta + sign * _ASIDE * max(t, abs(origin), abs(origin + t)) / steps.unit(n + 1)
    return rows._replace(theta=theta)


def kept_steps(times, h, start):
    """Return the numbers of the uniform steps h that end at given times, counted from `start`."""
    positions = (times - start) / h
    numbers = np.rint(positions)
    if np.any(np.abs(positions - numbers) > _OFF):
        required = f"be times of steps, whole multiples of h = {h:g} from t_start on"
        raise ValueError(complaint("t_eval", required, shown(times)))
    return numbers.astype(np.int64)
