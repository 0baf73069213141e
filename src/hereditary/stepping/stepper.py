"""The contract of steppers: what a march of one equation owes to those who drive it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple, NoReturn

import numpy as np

from ..equation.system import System
from ..support.checks import refuse, shown
from .dense import Piece
from .status import Status, failed


class Stop(NamedTuple):
    """A position at which a march can stop, and its time."""

    position: float
    t: float


class Health(NamedTuple):
    """Faults of a march that does go on.

    - instability: status beyond a stability limit, else None; remedy: what shows it, and what to
      take instead, in a clause.
    - misfit: by how much kernels miss their tolerance, in words; empty where they keep it.
    - missed: a time at which f is not what the steps made of it, or 0 [time].
    """

    instability: Status | None = None
    remedy: str = ""
    misfit: str = ""
    missed: float = 0.0


class Stepper(ABC):
    """A march of one equation that moves on when it is asked to.

    Runs, ensembles, hybrid runs, exponents and sensitivities use steppers by this contract. The
    engines have two, `FixedStepper` and `AdaptiveStepper`; `tests/solver/test_contract.py` has one
    of twenty lines. A stepper needs `system`, `t`, `y`, `position`, `advance`, `checkpoint` and
    `come_back`. All else has a default. In the order of a run it

    1. begins with the initial values at time 0, which is the equation's `t_start`;
    2. stops at, or steps beside, the jumps of the right-hand side that `set_breaks` names;
    3. moves on in `advance` by as many steps as take a moment, towards a position and never beyond
       it. It returns the solution on the way. `stop_at` finds the position of a time;
    4. keeps an exception of the right-hand side in `error`, after the steps before it, and says in
       `trouble` why it cannot go on;
    5. says in `health` what is wrong with a march that does go on, and counts in `stats`;
    6. comes back by `come_back` to what `checkpoint` returned; `state` and `restore` carry that to
       another run.

    With tangents it has `tangent` and `transform_tangent`. A stepper whose y or parameters may jump
    has `expect_moves`, `moved`, `set_parameter` and `uncertainty`.

    Attributes
    ----------
    system : System
    looks : int
        Points of each step at which events are evaluated, besides its end: its start, and where
        steps are long points between. If there is 1, steps are so short that their ends show
        whatever happens, as given ones are. Positions are then numbers of steps, and rows at all
        ends make the dense output.
    h : float
        Step of uniform ones, else 0 [time].
    error : Exception or None
    """

    system: System
    looks = 1
    h = 0.0
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
    def ydot(self) -> np.ndarray:
        """First derivative at `t`, NaN where there is none, shape (d,)."""
        return np.full_like(self.y, np.nan)

    @property
    @abstractmethod
    def position(self) -> float:
        """Number of steps made, or the time."""

    def stop_at(self, t: float) -> Stop:
        """Return the position of a march that stops at time t, or at the first step not before."""
        return Stop(t, t)

    def set_breaks(self, times: np.ndarray, t_end: float) -> None:
        """Let steps see jumps at these times, (k,), from their own side, in a run to t_end."""
        if times.size:
            refuse("breaks", f"be left out with {type(self).__name__}", shown(times))

    @abstractmethod
    def advance(self, stop: float, keep: bool = True) -> Piece | None:
        """Move on towards position `stop`; return the solution on the way if it is to be kept."""

    @property
    def trouble(self) -> tuple[Status, str] | None:
        """Status and detail of a march that cannot go on, else None."""
        return None if self.error is None else failed(self.error)

    @property
    def health(self) -> Health:
        """Faults of a march that does go on; none by default."""
        return Health()

    def stats(self) -> dict[str, Any]:
        """Return counts and errors for the solution's stats; by default positions count steps."""
        return {"n_steps": self.position, "history_bytes": 0}

    @abstractmethod
    def checkpoint(self) -> tuple:
        """Return copies of all that the march consists of."""

    @abstractmethod
    def come_back(self, checkpoint: tuple) -> None:
        """Come back to where `checkpoint` was taken; it may be used again."""

    def go_back(self, checkpoint: tuple, t: float) -> None:
        """Come back to where `checkpoint` was taken, and march to the stop at time t."""
        self.come_back(checkpoint)
        stop = self.stop_at(t).position
        while self.position < stop and self.trouble is None:
            self.advance(stop, keep=False)

    def state(self) -> Any:
        """Return a state from which another run goes on."""
        self._lack("has no states")

    def restore(self, state: Any, allow_change: bool = False) -> None:
        """Go on from `state`; `allow_change` admits another right-hand side or parameters."""
        self._lack("has no states")

    @property
    def tangent(self) -> np.ndarray:
        """Derivatives of y, and of y' for orders above 1, along k directions, (n_data, k)."""
        self._lack("has no tangents")

    def transform_tangent(self, matrix: np.ndarray) -> None:
        """Replace the tangents and all of their history by ``tangent @ matrix``, matrix (k, k)."""
        self._lack("has no tangents")

    def expect_moves(self, of_y: bool) -> None:
        """Prepare for jumps of f, and of y if `of_y`: make few steps at once, or refuse."""
        self._lack("takes no jumps")

    def moved(self, y: np.ndarray) -> None:
        """Let y jump to these values, (d,), at the present time; no memory sees the jump."""
        self._lack("takes no jumps")

    def set_parameter(self, number: int, value: float) -> None:
        """Set a parameter of the right-hand side, which jumps."""
        self._lack("takes no jumps")

    @property
    def uncertainty(self) -> np.ndarray:
        """Errors of y, (d,); closer to a zero than this, the side of y is unknown."""
        self._lack("takes no jumps")

    def _lack(self, what: str) -> NoReturn:
        raise NotImplementedError(f"{type(self).__name__} {what}")
