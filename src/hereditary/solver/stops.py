"""Breaks: times at which a right-hand side jumps."""

import numpy as np

from .._checks import complaint, real_array, shown

# Breaks closer than this, relatively, are no two times to a clock of double precision.
APART = 1e-13


def checked_breaks(breaks):
    """Increasing times above 0 that lie apart, shape (k,)."""
    times = real_array("breaks", breaks)
    if times.ndim != 1 or np.any(np.diff(times) <= 0) or np.any(times <= 0):
        required = "be increasing times above 0"
        raise ValueError(complaint("breaks", required, shown(times)))
    close = np.flatnonzero(np.diff(times) < APART * times[1:])
    if close.size:
        required = f"lie apart by more than rounding, {APART:g} of their time"
        pair = f"{float(times[close[0]])!r} and {float(times[close[0] + 1])!r}"
        raise ValueError(complaint("breaks", required, pair, "name such a jump once"))
    return times
