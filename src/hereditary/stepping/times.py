"""Times at which runs stop: breaks, events, changes and ends. Rounding does not separate them."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..support.checks import real_array, refuse, shown

# Relative distance up to which two times count as one: a few hundred units of rounding.
ONE_TIME = 1e-13


def checked_breaks(breaks: ArrayLike, start: float) -> np.ndarray:
    """Return the breaks as increasing, distinct times after `start`, shape (k,), minus `start`."""
    if isinstance(breaks, tuple) and not breaks:
        return np.zeros(0)
    times = real_array("breaks", breaks)
    if times.size == 0:
        return times.ravel()
    if times.ndim != 1 or np.any(np.diff(times) <= 0) or np.any(times <= start):
        refuse("breaks", f"be increasing times above {start:g}", shown(times))
    times -= start
    return times[np.append(True, ~together(times[1:], times[:-1], start))]


def together(times: Any, t: Any, origin: float = 0.0) -> np.ndarray:
    """Return for each of `times` whether it equals t up to rounding, but none an infinite t."""
    # the user's times are these plus `origin`, whose rounding errors count too
    return np.isfinite(t) & (np.abs(times - t) <= ONE_TIME * np.maximum(np.abs(t), abs(origin)))


def breaks_ahead(
    times: np.ndarray, start: float, t_end: float, origin: float
) -> tuple[bool, np.ndarray]:
    """Return whether there is a break at a `start` above 0, and the breaks between it and t_end."""
    if times.size == 0:
        return False, times
    at_once, at_end = together(times, start, origin), together(times, t_end, origin)
    ahead = (times > start) & (times < t_end) & ~at_once & ~at_end
    return bool(np.any(at_once)) and start > 0, times[ahead]
