"""The contract of steppers: what a march of one equation provides to its callers."""

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


class Health(NamedTuple):
    """Faults of a march that can go on.

    - instability: status beyond a stability limit, else None; remedy: what shows it, and what to
      take instead, in a clause.
    - misfit: by how much kernels miss their tolerance, in words; empty if they keep it.
    - missed: a time at which f differs from its interpolant, or 0 [time].
    """

    instability: Status | None = None
    remedy: str = ""
    misfit: str = ""
    missed: float = 0.0


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
    its
       derivative there.
    5. `trouble` says why the stepper cannot make the next step.
    6. `health` has faults that do not stop the march, and `stats` has counts.
    7. `come_back` restores what `checkpoint` returned.

    Three subclasses have further methods: `ResumableStepper`, `TangentStepper` and
    `JumpingStepper`.

    Attributes
    ----------
    system : System
    counted : bool
        Whether a position is a number of given steps; otherwise it is a time. With given steps
        events are evaluated at ends of steps only, and dense output interpolates the rows.
    """

    system: System
    counted = True

    def set_breaks(self, times: np.ndarray, t_end: float) -> None:
        """Let steps beside these times, (k,), evaluate f on their own side, in a run to t_end."""
        if times.size:
            refuse("breaks", f"be left out with {type(self).__name__}", shown(times))

    def stop_at(self, t: float) -> Stop:
        """Return the position and the time of the first possible stop that is not before time t."""
        return Stop(t, t)

    @abstractmethod
    def advance(self, stop: float, keep: bool = True) -> Piece | None:
        """March some way towards position `stop`; return dense output of it if `keep` is true."""

    @property
    @abstractmethod
    def position(self) -> float:
        """Number of steps made if `counted`, otherwise the time reached."""

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
    def trouble(self) -> Ending | None:
        """Why a march cannot go on, otherwise None."""
        return None

    @property
    def health(self) -> Health:
        """Faults of a march that can go on; none by default."""
        return Health()

    def stats(self) -> dict[str, Any]:
        """Return counts and errors for `Solution.stats`; by default only the position."""
        return {"n_steps": self.position, "history_bytes": 0}

    @abstractmethod
    def checkpoint(self) -> tuple:
        """Return copies of everything that a step changes."""

    @abstractmethod
    def come_back(self, checkpoint: tuple) -> None:
        """Return to the time at which `checkpoint` was taken; the checkpoint may be used again."""


class ResumableStepper(Stepper):
    """A stepper whose march another run can resume."""

    @abstractmethod
    def state(self) -> State:
        """Return a state from which another run continues."""

    @abstractmethod
    def restore(self, state: State, allow_change: bool = False) -> None:
        """Continue from `state`; `allow_change` admits another right-hand side or parameters."""


class Grown(NamedTuple):
    """Growth of k tangents over a part of a march with n renormalisations.

    - piece: dense output of this part, or None.
    - logs: for each renormalisation its mark, and the logarithms of the growth since the one
      before, (n, 1 + k).
    - lost: whether tangents overflowed or vanished.
    """

    piece: Piece | None
    logs: np.ndarray
    lost: bool = False


class TangentStepper(Stepper):
    """A stepper that solves tangents together with the orbit."""

    @property
    @abstractmethod
    def tangent(self) -> np.ndarray:
        """Derivatives of y, and of y' for orders above 1, along k directions, (n_data, k).

        The n_data rows are the components of y, followed by y' of those with orders above 1.
        """

    @abstractmethod
    def transform_tangent(self, matrix: np.ndarray) -> None:
        """Replace the tangents and their history by ``tangent @ matrix``; matrix (k, k)."""

    def grow(self, stop: float, schedule: Any) -> Grown:
        """March towards position `stop`, and make the tangents orthonormal when that is due.

        This is Benettin's loop, one renormalisation a call: ``tangent = Q R``, and the tangents are
        multiplied by the inverse of R. A stepper may make several renormalisations in one call.

        Parameters
        ----------
        stop : float
        schedule : SCHEDULE
            Times of the renormalisations, which it adapts to the growth (compiled/schedule.py).
        """
        mark, k = int(due(schedule)), self.tangent.shape[1]
        target = mark * float(schedule["unit"])
        piece, none = self.advance(min(stop, target)), np.empty((0, 1 + k))
        if self.position < target or self.trouble:
            return Grown(piece, none)
        r = np.linalg.qr(self.tangent, mode="r")
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
    def set_parameter(self, number: int, value: float) -> None:
        """Set the parameter `number` of the right-hand side, which makes f jump."""

    @property
    @abstractmethod
    def uncertainty(self) -> np.ndarray:
        """Errors of y, (d,): the sign of a component closer to 0 than its error is unknown."""
