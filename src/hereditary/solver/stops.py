"""Breaks, times at which a right-hand side jumps, and the steps beside them."""

import numpy as np

from .._checks import complaint, real_array, shown

# Breaks closer than this, relatively, are no two times to a clock of double precision.
APART = 1e-13
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
    close = np.flatnonzero(np.diff(times) < APART * times[1:])
    if close.size:
        required = f"lie apart by more than rounding, {APART:g} of their time"
        pair = f"{float(times[close[0]])!r} and {float(times[close[0] + 1])!r}"
        raise ValueError(complaint("breaks", required, pair, "name such a jump once"))
    return times


def breaks_ahead(times, start, t_end):
    """Whether there is a break at `start`, and those between `start` and t_end."""
    ahead = (times > start * (1 + APART)) & (times < t_end * (1 - APART))
    return bool(np.any(np.abs(times - start) < APART * start)), times[ahead]


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
