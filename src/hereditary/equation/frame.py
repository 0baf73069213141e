"""The map between times and components of a run and those of the user."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class Frame(NamedTuple):
    """Map between times and components inside a run and those of the user."""

    # A run begins at time 0 inside, and all of its components are real. The real and the imaginary
    # part of a complex component are two components of the run, next to each other. For orders
    # above 2 derivatives of y are further components.

    start: float = 0.0  # time of the user that is time 0 inside
    paired: bool = False  # whether components of the user are complex
    speeds: tuple[int, ...] = ()  # for each real one of y, the component that is y', or -1

    def values(self, inside: np.ndarray) -> np.ndarray:
        """Return y in the user's components, from the n components (..., n) of a run."""
        if self.speeds:
            inside = inside[..., : len(self.speeds)]
        return np.ascontiguousarray(inside).view(complex) if self.paired else inside

    def doubled(self, values: ArrayLike) -> ArrayLike:
        """Return values for real components from those for components of y; a number unchanged."""
        return np.repeat(values, 2) if self.paired and np.ndim(values) else values

    def moved(self, inside: np.ndarray, values: ArrayLike) -> np.ndarray:
        """Return a copy of the components (n,) of a run with these values of the user for y."""
        found = inside.copy()
        real = np.ascontiguousarray(values, complex if self.paired else float).view(float)
        found[: real.size] = real
        return found

    def slopes(self, inside: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Return y' in the user's components, from components of a run and their derivatives."""
        if self.speeds:
            speeds = np.array(self.speeds)
            known = inside[..., np.maximum(speeds, 0)]
            slopes = np.where(speeds >= 0, known, slopes[..., : speeds.size])
        return np.ascontiguousarray(slopes).view(complex) if self.paired else slopes

    def event(
        self, function: Callable[..., Any], memory: Callable[[float], np.ndarray] | None = None
    ) -> Callable[..., Any]:
        """Return an event function of the user as a function of times and components of a run."""
        # memory(t): the rows, real components of a run, that the function reads third
        alike = self == Frame() and memory is None
        return function if alike else _Inside(function, self, memory)


class _Inside:
    """An event function of the user, called with times and components of a run."""

    def __init__(self, function: Callable[..., Any], frame: Frame, memory: Callable | None) -> None:
        self._function, self._frame, self.start = function, frame, frame.start
        self._memory = memory
        for name in ("terminal", "direction", "forget"):
            if hasattr(function, name):
                setattr(self, name, getattr(function, name))

    def __repr__(self) -> str:
        return getattr(self._function, "__name__", repr(self._function))

    def __getstate__(self) -> dict[str, Any]:
        """Return what the digest of the function counts, which no run changes."""
        return vars(self) | {"_memory": None}

    def __call__(self, t: float, y: np.ndarray) -> Any:
        values = self._frame.values
        read = () if self._memory is None else (values(self._memory(t)),)
        return self._function(t + self.start, values(y), *read)
