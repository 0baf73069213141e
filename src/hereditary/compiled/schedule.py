"""When tangents are made orthonormal: at a given interval, or one that follows their growth.

A mark is a time at which they may be made orthonormal; marks are equidistant. An interval is a
whole number of marks. With given steps each end of a step is a mark.
"""

import numpy as np

from .jit import inner

# Spread below which an automatic interval doubles. The spread is the largest minus the smallest of
# 0 and the logarithms of the tangents' growth over an interval. The factor R of tangents = Q R
# loses about as many of its sixteen digits as exp(spread) has.
_LOW = 3.0
# Spread above which an automatic interval gets shorter, in proportion to this over the spread.
_MAX_SPREAD = 8.0
# Integer fields of a schedule. In marks: the present interval, the longest one, the end of the
# transient, the end of the run, and the last renormalisation. Others: `automatic` is 1 if the
# interval follows the growth. `made` counts renormalisations in one call of compiled code.
# `lasting` is 1 if the march reads data of its first steps later on.
_INTEGER_FIELDS = "interval", "longest", "automatic", "transient", "end", "last", "made", "lasting"
# Type of a schedule: the integers, and `unit`, the distance of two marks in the stepper's
# positions.
SCHEDULE = np.dtype([*((name, "i8") for name in _INTEGER_FIELDS), ("unit", "f8")])


@inner
def due(schedule):
    """Return the mark of the next renormalisation."""
    stop = min(schedule["last"] + schedule["interval"], schedule["end"])
    return schedule["transient"] if schedule["last"] < schedule["transient"] < stop else stop


@inner(allocates=True)
def note(schedule, n, logs):
    """Note a renormalisation at mark n, and adapt the interval to the spread of `logs`."""
    # logs (k,): log growth of k tangents over the interval before
    schedule["last"] = n
    spread = max(0.0, np.max(logs)) - min(0.0, np.min(logs))
    if spread > _MAX_SPREAD and schedule["automatic"]:
        # the interval never grows above this value again, because rare contractions come back
        schedule["interval"] = max(1, int(schedule["interval"] * _MAX_SPREAD / spread))
        schedule["longest"] = schedule["interval"]
    elif spread < _LOW and schedule["automatic"]:
        schedule["interval"] = min(2 * schedule["interval"], schedule["longest"])
