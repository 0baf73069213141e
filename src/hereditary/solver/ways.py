"""Ways on from an event that has changed y where it vanishes: through its zero, or back from it.

A bounce turns back; a counter, or a force that is switched, lets the solution pass. Next to the
zero errors and rounding hide which it is, so it is told by slopes.
"""

import math

import numpy as np

# Values below this fraction of the largest one over a step may be its rounding; no larger ones than
# the second fraction are taken for the error of where the event was found.
_HIDDEN, _MISPLACED = 1e-13, 1e-2
# How far ahead, relative to the time, the motion behind a change is followed.
_AHEAD = 1e-8
# Steps for which an event that has turned back may go on: schemes remember a corner.
_CORNER = 4
# Relative rounding of y on given steps.
_ROUNDED = 1e-13
# A value that has a sign, and no size.
TINY = 5e-324


class Way:
    """Way on from an event that has just changed y and is still at its zero.

    Parameters
    ----------
    before : float
        Sign that the event had behind its zero.
    sign : float
        Sign that it goes on with, 0 where that is not known.
    value, error : float
        Its value where the change was made, and how much of that may be an error.
    by_steps : bool
        Whether steps are given, and the change is made at one of them, behind the zero.

    Attributes
    ----------
    returning : bool
        Whether the event has turned back, but has not come to its zero again.
    """

    def __init__(self, before, sign, value, error, by_steps):
        self.before, self.sign, self._error = before, sign, error
        self.returning = by_steps and sign == -before == -np.sign(value)
        self._far, self._steps = abs(value), 0

    def settle(self, values):
        """Set the first of the values over the next step, which errors hide.

        Returns whether they hide all of the way back from a turn, such as that of a short bounce.
        """
        scale = np.nanmax(np.abs(values))
        error = min(2 * self._error, _MISPLACED * scale) if self.sign else 0.0
        hidden = np.abs(values) <= max(_HIDDEN * scale, error)
        if not hidden[1] or hidden.all():
            return False
        clear = np.argmin(hidden[1:]) + 1
        values[:clear] = math.copysign(TINY, self.sign or -self.before)
        return self.sign == -self.before == -np.sign(values[clear])

    def follow(self, values):
        """Let values of an event that is returning count as returned, until they are.

        Returns the number of the value at which it goes away again instead, or None.
        """
        for i, value in enumerate(values[1:].tolist(), 1):
            self._steps = self._steps + 1 if abs(value) > self._far else 0
            if not value * self.before > 0.0 or self._steps > _CORNER:
                self.returning = False
                values[:i] = math.copysign(TINY, -self.before)
                return i if value * self.before > 0.0 else None
            self._far = abs(value)
        values[:] = math.copysign(TINY, -self.before)
        return None


def uncertainty(value, stepper):
    """Return how far errors of y leave the value of an event open where a march stands."""
    t, y = stepper.t, stepper.y
    allowed = stepper.uncertainty if stepper.adaptive else _ROUNDED * np.abs(y)
    signs = np.ones(y.size), (-1.0) ** np.arange(y.size)
    try:
        with np.errstate(all="ignore"):
            here = value(t, y)
            found = max(abs(value(t, y + side * allowed) - here) for side in signs)
    except Exception:  # it is not defined beside y
        return 0.0
    return found if math.isfinite(found) else 0.0


def sign_ahead(value, sign, before, stepper, crossed):
    """Return the sign to which an event goes behind a change of y; 0 where it is not known.

    It is that of its slope along the motion there. What comes to rest has turned back. `value(t,
    y)` is that of the event, which had this sign in front of the change, where y was `before`,
    (d,); `crossed` tells that it had come through its zero.
    """
    t, equation, slopes = stepper.t, stepper.equation, []
    if equation.enlarged is not equation:
        return 0.0
    ahead = t + _AHEAD * t
    try:
        with np.errstate(all="ignore"):
            for y in (before, stepper.y):
                then = y + (ahead - t) * equation.motion(t, y, stepper.ydot)
                slopes.append(float(np.sign(value(ahead, then) - value(t, y))))
    except Exception:  # the march meets it again
        return 0.0
    if crossed and slopes[0] == slopes[1]:
        return sign
    return slopes[1] or -sign if slopes[0] == sign else 0.0
