"""The contract of steppers: what a march of one equation owes to those who drive it."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from .dense import Piece
from .status import Status


class Stepper(ABC):
    """A march of one equation that moves on when it is asked to.

    Runs, ensembles, hybrid runs, exponents and sensitivities stand on this class. A stepper

    1. begins with the initial values at time 0, which is the equation's `t_start`;
    2. moves on in `advance`, towards a position and never beyond it, by as many steps as take a
       moment, and returns the solution on the way;
    3. has `t`, `y` and `position`, the number of steps made or the time;
    4. keeps an exception of the right-hand side in `error`, after the steps before it, and says in
       `trouble` why it cannot go on.

    With tangents it has `tangent` and `transform_tangent`. All other methods are optional: they are
    refused unless a subclass has them.

    Attributes
    ----------
    adaptive : bool
        Whether positions are times instead of numbers of steps.
    looks : int
        Points of each step at which events are evaluated, besides its end.
    error : Exception or None
    """

    adaptive, looks = False, 1
    error: Exception | None = None

    @property
    @abstractmethod
    def t(self) -> float:
        """Time reached, counted from the start [time]."""

    @property
    @abstractmethod
    def y(self) -> np.ndarray:
        """Solution at `t`, shape (d,); a copy."""

    @property
    @abstractmethod
    def position(self) -> float:
        """Number of steps made, or the time."""

    @abstractmethod
    def advance(self, stop, keep: bool = True) -> Piece | None:
        """Move on towards position `stop`; return the solution on the way if it is to be kept."""

    @property
    def trouble(self) -> tuple[Status, str] | None:
        """Status and detail of a march that cannot go on, else None."""
        return None

    @property
    def tangent(self) -> np.ndarray:
        """Derivatives of y, and of y' for orders above 1, along k directions, (n_data, k)."""
        raise self._lacks("has no tangents")

    def transform_tangent(self, matrix: np.ndarray) -> None:
        """Replace the tangents and all of their history by ``tangent @ matrix``, matrix (k, k)."""
        raise self._lacks("has no tangents")

    def moved(self, y: np.ndarray) -> None:
        """Let y jump to these values, (d,), at the present time; no memory sees the jump."""
        raise self._lacks("takes no jump of y")

    def reset(self, params: np.ndarray, y0: np.ndarray) -> None:
        """Begin anew with other parameters (p,) and initial values (m, d)."""
        raise self._lacks("does not begin anew")

    def state(self):
        """Return a state from which another run goes on."""
        raise self._lacks("gives no state")

    def _lacks(self, what):
        return NotImplementedError(f"{type(self).__name__} {what}")
