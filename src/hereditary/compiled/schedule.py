"""Times at which tangents are made orthonormal: a given interval, or one that follows their growth.

Intervals are whole numbers of marks. On given steps a mark is a step.
"""

import numpy as np

from .jit import inner

# Least growth, or spread, of tangents over one interval where the interval follows the growth. R
# loses about as many of sixteen digits as there are in exp(spread).
_LOW = 3.0
# Largest growth, or spread, over such an interval.
_HIGH = 8.0
# The present interval, the longest one, whether intervals follow the growth; the ends of the
# transient and of the run, the last time; how many times in one entry, and whether the march reads
# data of the first steps later on.
_NUMBERS = "interval", "longest", "automatic", "transient", "end", "last", "made", "lasting"
# `unit` is the distance of two marks in positions of the stepper.
SCHEDULE = np.dtype([*((name, "i8") for name in _NUMBERS), ("unit", "f8")])


@inner
def due(schedule):
    """Return the mark of the next renormalisation."""
    stop = min(schedule["last"] + schedule["interval"], schedule["end"])
    return schedule["transient"] if schedule["last"] < schedule["transient"] < stop else stop


@inner(allocates=True)
def note(schedule, n, logs):
    """Record the growth (k,) up to mark n, and adapt the interval to it."""
    schedule["last"] = n
    spread = max(0.0, np.max(logs)) - min(0.0, np.min(logs))
    if spread > _HIGH and schedule["automatic"]:
        # the interval is never lengthened again: spikes of contraction are rare, but come again
        schedule["interval"] = max(1, int(schedule["interval"] * _HIGH / spread))
        schedule["longest"] = schedule["interval"]
    elif spread < _LOW and schedule["automatic"]:
        schedule["interval"] = min(2 * schedule["interval"], schedule["longest"])
