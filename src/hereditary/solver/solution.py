"""What a run returns (floor 4): the orbit, how the run ended, and the state to go on from."""

import enum
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .stepper import State


class Status(enum.Enum):
    """How a run ended; the value is the sentence shown as the solution's message."""

    COMPLETED = "the run reached the end"
    STEP_TOO_LARGE = "the run reached the end, but beyond the scheme's stability limit on the way"
    ZIGZAG = "the solution zigzags from step to step: the step is beyond the stability limit"
    BLOWN_UP = "the solution stopped being finite"
    INTERRUPTED = "the run was interrupted"
    NOT_SOLVED = "Newton's method did not converge: take smaller steps, or give an exact jac"
    RHS_FAILED = "the right-hand side raised an exception"

    def __str__(self):
        return self.name.lower()


class StabilityWarning(UserWarning):
    """The step is beyond the scheme's stability limit, or the solution zigzags."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A numerical solution, and how it came about.

    Attributes
    ----------
    t : ndarray, shape (n+1,)
        Times of the rows [time].
    y : ndarray, shape (n+1, d)
        Solution, time first.
    ydot : ndarray, shape (n+1, d), or None
        First derivative when the highest order exceeds 1; NaN at t = 0 for components that have
        no initial derivative.
    status : Status
        How the run ended; ``success`` says whether it is COMPLETED.
    message : str
        The same in a sentence, with the numbers of this run.
    stats : dict
        n_steps and n_rhs (counted from t = 0), n_modes, history_bytes, setup_seconds, run_seconds,
        and stiffness_ratio: the largest ratio of an eigenvalue of d rhs / d y to its step limit
        seen along the orbit, sampled every 32 steps (more rarely in systems); the scheme is
        unstable above 1. Where the components of a system have different terms only real
        eigenvalues are seen.
    state : State
        Everything needed to go on, ``solve(eq, t_later, resume=sol.state)``: a few kilobytes with
        `SumOfExponentials`, the whole past with `Direct`. None on a mesh.
    """

    t: np.ndarray
    y: np.ndarray
    ydot: np.ndarray | None
    status: Status
    message: str
    stats: dict[str, Any] = field(repr=False)
    state: State | None = field(repr=False)

    @property
    def success(self) -> bool:
        """Whether the run reached the end inside the scheme's stability limit."""
        return self.status is Status.COMPLETED

    def __repr__(self):
        return (
            f"Solution({self.message}; {self.t.size} rows of {self.y.shape[1]} components, "
            f"t = {self.t[0]:g} .. {self.t[-1]:g})"
        )
