"""Events (floor 4): times at which functions of the solution vanish."""

import numpy as np

from .._checks import complaint, shown
from ..special import bracketed_root

# Points of each step at which an event function is looked at, besides the ends.
_LOOKS = 8
# Zeros this close to the start, relatively, are the start itself.
_SAME = 1e-12


class Events:
    """Zeros of some functions along a run, located on its dense output.

    Parameters
    ----------
    functions : sequence of callable
        ``event(t, y)``, with the attributes `terminal` (default False) and `direction` (default 0:
        both; 1 upwards only, -1 downwards only) as in SciPy.
    """

    def __init__(self, functions, t, y):
        self._functions, self._start = functions, t
        # the last value seen: a zero between two stretches is then found once, and only once
        self._values = [_first_value(function, t, y) for function in functions]
        self.times: list[list[float]] = [[] for _ in functions]
        self.values: list[list[np.ndarray]] = [[] for _ in functions]
        self.terminal = any(getattr(function, "terminal", False) for function in functions)

    def look(self, edges, at):
        """Search between consecutive `edges`; `at(t)` is the solution, (k, d) for k times.

        Returns the time of the first terminal event, or None.
        """
        looks = edges[:-1, None] + np.diff(edges)[:, None] * np.arange(_LOOKS) / _LOOKS
        times = np.append(looks.ravel(), edges[-1])
        rows = at(times)
        found, end = [], np.inf
        for number, function in enumerate(self._functions):
            after = [float(function(t, y)) for t, y in zip(times[1:], rows[1:], strict=True)]
            values = np.array([self._values[number], *after])
            self._values[number] = values[-1]
            for t in _zeros(function, times, values, at):
                if t <= self._start * (1 + _SAME):
                    continue  # where a run goes on from its own event
                found.append((t, number))
                if getattr(function, "terminal", False):
                    end = min(end, t)
                    break
        for t, number in sorted(found):
            if t <= end:
                self.times[number].append(t)
                self.values[number].append(at(np.array([t]))[0])
        return None if end == np.inf else end


def _first_value(function, t, y):
    """The function at the start, checked."""
    required = "be functions event(t, y)"
    if not callable(function):
        raise TypeError(complaint("events", required, repr(function)))
    name = getattr(function, "__name__", repr(function))
    try:
        value = np.asarray(function(t, y), dtype=float)
    except Exception as error:
        got = f"{name}, which raises {type(error).__name__}: {error}"
        raise TypeError(complaint("events", required, got)) from error
    if value.size != 1 or not np.isfinite(value).all():
        required = "return one finite number each"
        raise ValueError(complaint("events", required, f"{shown(value)} from {name} at t = {t}"))
    return float(value.reshape(()))


def _zeros(function, times, values, at):
    """Zeros in ascending order; one at the first time belongs to what was before."""
    direction, signs = getattr(function, "direction", 0), np.sign(values)
    for i in np.flatnonzero((signs[:-1] != signs[1:]) & (signs[:-1] != 0)):
        if direction and np.sign(values[i + 1] - values[i]) != np.sign(direction):
            continue
        if signs[i + 1] == 0:
            yield float(times[i + 1])
            continue

        def along(t, i=i):
            # at the ends the signs are known; another rounding must not change them
            if t == times[i] or t == times[i + 1]:
                return float(values[i] if t == times[i] else values[i + 1])
            return float(function(t, at(np.array([t]))[0]))

        yield bracketed_root(along, float(times[i]), float(times[i + 1]))
