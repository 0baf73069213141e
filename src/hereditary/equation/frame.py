"""The user's frame: where time begins, and complex components."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class Frame(NamedTuple):
    """Map between times and components inside a run and those of the user.

    Inside, a run begins at time 0 and all components are real: a complex one is two, its real and
    imaginary part side by side. Of an order above 2 the derivatives are components too, behind y.

    Attributes
    ----------
    start : float
        Time of the user at which runs begin.
    paired : bool
        Whether components are complex.
    speeds : tuple of int
        Component that is the first derivative of each real one of y, -1 for none; empty where
        derivatives are no components.
    """

    start: float = 0.0
    paired: bool = False
    speeds: tuple[int, ...] = ()

    def values(self, inside: np.ndarray) -> np.ndarray:
        """Return y of components (..., n) as the user sees it."""
        if self.speeds:
            inside = inside[..., : len(self.speeds)]
        return np.ascontiguousarray(inside).view(complex) if self.paired else inside

    def doubled(self, values: ArrayLike) -> ArrayLike:
        """Return a number, or one for each component of y, for the real components that y has."""
        return np.repeat(values, 2) if self.paired and np.ndim(values) else values

    def moved(self, inside: np.ndarray, values: ArrayLike) -> np.ndarray:
        """Return components (n,) where y, as the user sees it, has other values."""
        found = inside.copy()
        real = np.ascontiguousarray(values, complex if self.paired else float).view(float)
        found[: real.size] = real
        return found

    def slopes(self, inside: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Return y' as the user sees it, of components and their slopes (..., n) each."""
        if self.speeds:
            speeds = np.array(self.speeds)
            known = inside[..., np.maximum(speeds, 0)]
            slopes = np.where(speeds >= 0, known, slopes[..., : speeds.size])
        return np.ascontiguousarray(slopes).view(complex) if self.paired else slopes

    def event(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function of the user's times and components as one of those inside."""
        return function if self == Frame() else _Inside(function, self)


class _Inside:
    """An event function that is given times and components of a run."""

    def __init__(self, function: Callable[..., Any], frame: Frame) -> None:
        self._function, self._frame, self.start = function, frame, frame.start
        for name in ("terminal", "direction", "forget"):
            if hasattr(function, name):
                setattr(self, name, getattr(function, name))

    def __repr__(self) -> str:
        return getattr(self._function, "__name__", repr(self._function))

    def __call__(self, t: float, y: np.ndarray) -> Any:
        return self._function(t + self.start, self._frame.values(y))
