"""The contract of steppers: what a march of one equation owes to those who drive it."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from .dense import Piece
from .status import Status


class Stepper(ABC):
    """A march of one equation that moves on when it is asked to.

    Runs, ensembles, hybrid runs, exponents and sensitivities use steppers by this contract. There
    are two: `FixedStepper` and `AdaptiveStepper`. What `FixedStepper` has besides makes exponents
    and ensembles faster, without other results. A stepper

    1. begins with the initial values at time 0, which is the equation's `t_start`;
    2. moves on in `advance` by as many steps as take a moment, towards a position and never beyond
       it. It returns the solution on the way;
    3. has `t`, `y`, `ydot` and `position`, the number of steps made or the time;
    4. keeps an exception of the right-hand side in `error`, after the steps before it, and says in
       `trouble` why it cannot go on;
    5. says in `instability` and `misfit` what is wrong with a march that does go on, and counts in
       `stats`;
    6. returns in `checkpoint` copies of all that its march consists of; `go_back` comes back to
       them, and `state` and `restore` carry them to another run;
    7. stops at, or steps beside, the jumps of the right-hand side that `set_breaks` names.

    With tangents it has `tangent` and `transform_tangent`. A stepper whose y or parameters may jump
    has `moved`, `set_parameter`, `expect_moves` and `uncertainty`, one of many members has `reset`.
    These are optional: they are refused unless a subclass has them.

    Attributes
    ----------
    equation : System
    looks : int
        Points of each step at which events are evaluated, besides its end: its start, and where
        steps are long points between.
    h : float
        Step of uniform ones, else 0 [time].
    resolved : bool
        Whether steps are so short that their ends show whatever happens, as given ones are.
        Positions are then numbers of steps, and rows at all ends make the dense output.
    error : Exception or None
    n_rhs : int
        Calls of the right-hand side.
    """

    looks, h, resolved = 1, 0.0, True
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
    def ydot(self) -> np.ndarray:
        """First derivative at `t`, NaN where there is none, shape (d,)."""

    @property
    @abstractmethod
    def position(self) -> float:
        """Number of steps made, or the time."""

    @abstractmethod
    def advance(self, stop, keep: bool = True) -> Piece | None:
        """Move on towards position `stop`; return the solution on the way if it is to be kept."""

    @property
    @abstractmethod
    def trouble(self) -> tuple[Status, str] | None:
        """Status and detail of a march that cannot go on, else None."""

    @property
    def instability(self) -> Status | None:
        """Status of a march beyond its stability limit, else None; `remedy` says more."""
        return None

    def remedy(self) -> str:
        """Return a clause: what shows the instability, and what to take instead."""
        raise self._lacks("has no stability limit")

    @property
    @abstractmethod
    def misfit(self) -> str:
        """By how much kernels miss their tolerance, in words; empty where they keep it."""

    @property
    def missed(self) -> float:
        """A time at which f is not what the steps made of it, or 0 [time]."""
        return 0.0

    @abstractmethod
    def stats(self) -> dict:
        """Return counts and errors for the solution's stats."""

    @abstractmethod
    def set_breaks(self, times: np.ndarray, t_end: float) -> None:
        """Let steps see jumps at these times, (k,), from their own side, in a run to t_end."""

    @abstractmethod
    def position_at(self, t: float) -> float:
        """Return the position of a march that stops at time t."""

    @abstractmethod
    def stands_at(self, t: float) -> float:
        """Return the time of `position_at(t)`: t, or that of the first step not before t."""

    @abstractmethod
    def checkpoint(self) -> tuple:
        """Return copies of all that the march consists of, for `go_back` and `state`."""

    @abstractmethod
    def go_back(self, checkpoint: tuple, t: float) -> None:
        """Come back to where `checkpoint` was taken, and march to `stands_at(t)`."""

    @abstractmethod
    def state(self):
        """Return a state from which another run goes on."""

    @abstractmethod
    def restore(self, state, allow_change: bool = False) -> None:
        """Go on from `state`; `allow_change` admits another right-hand side or parameters."""

    @property
    def tangent(self) -> np.ndarray:
        """Derivatives of y, and of y' for orders above 1, along k directions, (n_data, k)."""
        raise self._lacks("has no tangents")

    def transform_tangent(self, matrix: np.ndarray) -> None:
        """Replace the tangents and all of their history by ``tangent @ matrix``, matrix (k, k)."""
        raise self._lacks("has no tangents")

    @property
    def uncertainty(self) -> np.ndarray:
        """Errors of y, (d,); closer to a zero than this, the side of y is unknown."""
        raise self._lacks("takes no jump of y")

    def expect_moves(self, of_y: bool) -> None:
        """Prepare for jumps of f, and of y if `of_y`: make few steps at once, or refuse."""
        raise self._lacks("takes no jump of y")

    def moved(self, y: np.ndarray) -> None:
        """Let y jump to these values, (d,), at the present time; no memory sees the jump."""
        raise self._lacks("takes no jump of y")

    def set_parameter(self, number: int, value: float) -> None:
        """Set a parameter of the right-hand side, which jumps."""
        raise self._lacks("takes no jump of y")

    def reset(self, params: np.ndarray, y0: np.ndarray) -> None:
        """Begin anew with other parameters (p,) and initial values (m, d)."""
        raise self._lacks("cannot be started again")

    def _lacks(self, what):
        return NotImplementedError(f"{type(self).__name__} {what}")
