"""Events (floor 4): times at which functions of the solution vanish."""

import numpy as np

from .._checks import complaint
from ..special import bracketed_root

# Points of each step at which an event function is looked at, besides the ends.
_LOOKS = 8


class Events:
    """Zeros of some functions along a run, located on its dense output.

    Parameters
    ----------
    functions : sequence of callable
        ``event(t, y)``, with the attributes `terminal` (default False) and `direction` (default 0:
        both; 1 upwards only, -1 downwards only) as in SciPy.
    """

    def __init__(self, functions):
        self._functions = functions
        for function in functions:
            if not callable(function):
                required = "be functions event(t, y)"
                raise TypeError(complaint("events", required, repr(function)))
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
            signs = np.array([float(function(t, y)) for t, y in zip(times, rows, strict=True)])
            for t in self._zeros(function, times, signs, at):
                found.append((t, number))
                if getattr(function, "terminal", False):
                    end = min(end, t)
                    break
        for t, number in sorted(found):
            if t <= end:
                self.times[number].append(t)
                self.values[number].append(at(np.array([t]))[0])
        return None if end == np.inf else end

    def _zeros(self, function, times, values, at):
        """Zeros in ascending order; one at a left edge belongs to the stretch before."""
        direction = getattr(function, "direction", 0)
        for i in np.flatnonzero(values[:-1] * values[1:] <= 0):
            left, right = values[i], values[i + 1]
            if left == 0 or (direction and np.sign(right - left) != np.sign(direction)):
                continue
            if right == 0:
                yield float(times[i + 1])
                continue
            yield bracketed_root(
                lambda t: float(function(t, at(np.array([t]))[0])),
                float(times[i]),
                float(times[i + 1]),
            )
