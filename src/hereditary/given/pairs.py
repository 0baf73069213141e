"""Neighbouring orbits in place of tangents, on given steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..equation.system import System, displaced
from ..stepping.dense import Piece
from ..stepping.status import Ending
from ..stepping.stepper import Stop, TangentStepper


class Pairs(TangentStepper):
    """Orbits side by side as one stepper, whose tangents are distances from the first one."""

    def __init__(
        self,
        opened: Callable[[System], Any],
        system: System,
        directions: np.ndarray,
        separation: float,
    ) -> None:
        # No derivative is needed. opened(system) returns a stepper on given steps, with `parts`.
        # directions (n_data, k); separation: distance of orbits at the start, the unit of tangents.
        self._separation, self.system = separation, system
        starts, n = [], system.n_solved
        for direction in separation * directions.T:
            starts.append(system.y0[:, :n].copy())
            starts[-1][0] += direction[:n]
            starts[-1][1:, system.above_one] += direction[n:]
        self._orbit = opened(system)
        self._others = [opened(displaced(system, y0)) for y0 in starts]
        self._all = [self._orbit, *self._others]

    def set_breaks(self, times: np.ndarray, t_end: float) -> None:
        """Let all orbits see jumps of f at these times."""
        for stepper in self._all:
            stepper.set_breaks(times, t_end)

    def stop_at(self, t: float) -> Stop:
        """Return the first step not before t, and its time."""
        return self._orbit.stop_at(t)

    def advance(self, stop: float, keep: bool = True) -> Piece | None:
        """March some way towards `stop`; return dense output of the first orbit if it is kept."""
        piece = self._orbit.advance(stop, keep)
        for other in self._others:
            while other.position < self._orbit.position and not other.failure:
                other.advance(self._orbit.position, keep=False)
        return piece

    position = property(lambda self: self._orbit.position)
    t = property(lambda self: self._orbit.t)
    y = property(lambda self: self._orbit.y)
    ydot = property(lambda self: self._orbit.ydot)
    diagnostics = property(lambda self: self._orbit.diagnostics)

    @property
    def failure(self) -> Ending | None:
        """Why the first orbit that cannot go on has stopped, otherwise None."""
        return next((stepper.failure for stepper in self._all if stepper.failure), None)

    def stats(self) -> dict[str, Any]:
        """Return the counts of the first orbit, but the calls of f of all orbits."""
        n_rhs = sum(stepper.stats()["n_rhs"] for stepper in self._all)
        return self._orbit.stats() | {"n_rhs": n_rhs}

    def checkpoint(self) -> tuple:
        """Return the checkpoints of all orbits."""
        return tuple(stepper.checkpoint() for stepper in self._all)

    def come_back(self, checkpoint: tuple) -> None:
        """Return all orbits to the step at which `checkpoint` was taken."""
        for stepper, own in zip(self._all, checkpoint, strict=True):
            stepper.come_back(own)

    @property
    def tangent(self) -> np.ndarray:
        """Differences from the first orbit over the separation, (n_data, k)."""
        first, *others = (np.append(each.y, each.ydot[self.system.above_one]) for each in self._all)
        return (np.array(others) - first).T / self._separation

    def transform_tangent(self, matrix: np.ndarray) -> None:
        """Replace the differences, and those of all memory, by ``tangent @ matrix``."""
        for first, *others in zip(*(stepper.linear_arrays() for stepper in self._all), strict=True):
            drawn = np.tensordot(matrix.T, np.array(others) - first, axes=1)
            for array, difference in zip(others, drawn, strict=True):
                array[...] = first + difference
