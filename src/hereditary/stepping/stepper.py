"""The interface of steppers, which solve one equation step by step for all kinds of runs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np

from ..compiled.schedule import due, note
from ..equation.system import System
from ..support.checks import refuse, shown
from .dense import Piece
from .state import State
from .status import Ending, Status


class Stop(NamedTuple):
    """A position at which a stepper can stop, and the time of that position."""

    position: float
    t: float


class Diagnostics(NamedTuple):
    """Faults of a run that do not stop it."""

    instability: Status | None = None  # status beyond a stability limit
    remedy: str = ""  # how the instability shows, and what to do about it
    misfit: str = ""  # by how much kernels miss their tolerance; empty if none does


class Stepper(ABC):
    """Base class of steppers, which march one equation forward in time.

    Runs, events, ensembles, Lyapunov exponents and sensitivities use steppers by this interface
    only. `FixedStepper` has given steps and `AdaptiveStepper` chooses them;
    `tests/solver/test_contract.py` has an example of twenty lines. In the order of a run:

    1. A stepper begins with the initial values of its `system` at time 0, the user's `t_start`.
    2. `set_breaks` names times at which the right-hand side jumps.
    3. `advance` makes steps for a short computing time, towards a position and never beyond it. It
       returns the solution on these steps. `stop_at` finds the position of a time.
    4. `position`, `t`, `y` and `ydot` are the position and the time reached, and the solution and
       its derivative there.
    5. `failure` says why the stepper cannot make the next step.
    6. `diagnostics` has faults that do not stop the march, and `stats` has counts.
    7. `come_back` restores what `checkpoint` returned.

    Three subclasses have further methods: `ResumableStepper`, `TangentStepper` and
    `JumpingStepper`.

    Attributes
    ----------
    system : System
    on_given_steps : bool
        Whether a position is a number of given steps; otherwise it is a time. With given steps
        events are evaluated at ends of steps only, and dense output interpolates the rows.
    """

    system: System
    on_given_steps = True

    def set_breaks(self, times: np.ndarray, t_end: float) -> None:
        """Set times (k,) of jumps of f before t_end; steps on each side use f of that side."""
        if times.size:
            refuse("breaks", f"be left out with {type(self).__name__}", shown(times))

    def stop_at(self, t: float) -> Stop:
        """Return the position and the time of the first possible stop that is not before time t."""
        return Stop(t, t)

    @abstractmethod
    def advance(self, stop: float, keep: bool = True) -> Piece | None:
        """Make steps towards position `stop`; return the solution on them if `keep` is True."""

    @property
    @abstractmethod
    def position(self) -> float:
        """Number of steps made if `on_given_steps`, otherwise the time reached."""

    @property
    @abstractmethod
    def t(self) -> float:
        """Time reached, counted from the start [time]."""

    @property
    @abstractmethod
    def y(self) -> np.ndarray:
        """Solution at `t`, shape (d,) for d components; a copy."""

    @property
    def ydot(self) -> np.ndarray:
        """First derivative at `t`, shape (d,); NaN for components without one."""
        return np.full_like(self.y, np.nan)

    @property
    def failure(self) -> Ending | None:
        """Why the stepper cannot make the next step; None if it can."""
        return None

    @property
    def diagnostics(self) -> Diagnostics:
        """Faults that do not stop the march; none by default."""
        return Diagnostics()

    def stats(self) -> dict[str, Any]:
        """Return counts and errors for `Solution.stats`; by default only the position."""
        return {"n_steps": self.position, "history_bytes": 0}

    @abstractmethod
    def checkpoint(self) -> tuple:
        """Return copies of all data from which `come_back` restores the march."""

    @abstractmethod
    def come_back(self, checkpoint: tuple) -> None:
        """Restore the march from what `checkpoint` returned, which can be used again."""


class ResumableStepper(Stepper):
    """A stepper whose march another run can resume."""

    @abstractmethod
    def state(self) -> State:
        """Return the state from which another run can resume this one."""

    @abstractmethod
    def restore(self, state: State, allow_change: bool = False) -> None:
        """Continue from `state`; `allow_change` allows a changed right-hand side or parameters."""


class Grown(NamedTuple):
    """Growth of k tangents over a part of a march with n renormalisations."""

    piece: Piece | None  # the solution on this part
    logs: np.ndarray  # (n, 1 + k): marks (compiled/schedule.py), logarithms of each growth
    lost: bool = False  # whether tangents overflowed or became 0


class TangentStepper(Stepper):
    """A stepper that solves the equation and its linearisation along k directions: k tangents."""

    @property
    @abstractmethod
    def tangent(self) -> np.ndarray:
        """Derivatives along k directions, (n_data, k): of y, then of y' for orders above 1."""

    @abstractmethod
    def transform_tangent(self, matrix: np.ndarray) -> None:
        """Replace the tangents and their history by ``tangent @ matrix``; matrix (k, k)."""

    # sizes of y, then of y' for orders above 1, over which tangents become orthonormal, (n_data, 1)
    norm: np.ndarray | float = 1.0

    def grow(self, stop: float, schedule: Any) -> Grown:
        """Make steps towards position `stop`, and make the tangents orthonormal by `schedule`."""
        # This is Benettin's method: at a renormalisation tangent = Q R, and the tangents are
        # multiplied by the inverse of R. This method does at most one renormalisation in a call,
        # that of a subclass may do more. Tangents are orthonormal over the sizes `norm`. The
        # schedule adapts its times to the growth (compiled/schedule.py).
        mark, k = int(due(schedule)), self.tangent.shape[1]
        target = mark * float(schedule["unit"])
        piece, none = self.advance(min(stop, target)), np.empty((0, 1 + k))
        if self.position < target or self.failure:
            return Grown(piece, none)
        r = np.linalg.qr(self.tangent / self.norm, mode="r")
        r *= np.sign(np.diag(r))[:, None]
        if not (np.all(np.isfinite(r)) and np.diag(r).min() > 0):
            return Grown(piece, none, lost=True)
        self.transform_tangent(np.linalg.inv(r))
        logs = np.log(np.diag(r))
        note(schedule, mark, logs)
        return Grown(piece, np.array([[mark, *logs]]))


class JumpingStepper(Stepper):
    """A stepper whose y and parameters may jump at events and at given times."""

    @abstractmethod
    def expect_jumps(self, of_y: bool) -> None:
        """Prepare for jumps of f, and of y if `of_y`: `advance` makes few steps; or refuse them."""

    @abstractmethod
    def set_y(self, y: np.ndarray) -> None:
        """Set y (d,) at the present time; the jump does not enter the memory."""

    @abstractmethod
    def set_side(self, number: int, sign: float, center: float = 0.0, width: float = 0.0) -> None:
        """Evaluate f on the side `sign`, 1 or -1, of a switch, or as a blend if it has a width."""

    @property
    @abstractmethod
    def uncertainty(self) -> np.ndarray:
        """Errors of y, (d,): the sign of a component closer to 0 than its error is unknown."""
