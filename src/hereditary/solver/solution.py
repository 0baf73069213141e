"""What a run returns (floor 4): the orbit, how the run ended, and the state to go on from."""

import enum
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._checks import complaint, shown
from .adaptive_stepper import AdaptiveState
from .dense import Dense
from .stepper import State


class Status(enum.Enum):
    """How a run ended; the value is the sentence shown as the solution's message."""

    COMPLETED = "the run reached the end"
    STEP_TOO_LARGE = "the run reached the end, but beyond the scheme's stability limit on the way"
    ZIGZAG = "the solution zigzags from step to step: the step is beyond the stability limit"
    BLOWN_UP = "the solution stopped being finite"
    INTERRUPTED = "the run was interrupted"
    NOT_SOLVED = (
        "Newton's method did not converge: take smaller steps, give an exact jac, or name the "
        "times of jumps as breaks"
    )
    EVENT = "a terminal event ended the run"
    RHS_FAILED = "the right-hand side raised an exception"
    ORDER_FAILED = "an order left its range, or its function raised an exception"

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
        n_steps and n_rhs (counted from t = 0), n_modes, history_bytes, setup_seconds, run_seconds.
        With `Collocation` n_rejected, the steps made again shorter, and error_estimate: rtol times
        the largest error of a step over its share of the tolerance, a tenth of it, and rtol / 10 at
        the least, which the first step may err by. Otherwise
        stiffness_ratio: the largest ratio of an eigenvalue of d rhs / d y to its step limit
        seen along the orbit, sampled every 32 steps (more rarely in systems); the scheme is
        unstable above 1. Where the components of a system have different terms only real
        eigenvalues are seen.
    state : State
        Everything needed to go on, ``solve(eq, t_later, resume=sol.state)``: a few kilobytes with
        `SumOfExponentials`, the whole past with `Direct`. None on a mesh.
    dense : Dense or None
        What ``sol(t)`` reads, with `Collocation` and without t_eval.
    t_events, y_events : list of ndarray
        Times (k,) and solutions (k, d) of each event function's zeros.
    """

    t: np.ndarray
    y: np.ndarray
    ydot: np.ndarray | None
    status: Status
    message: str
    stats: dict[str, Any] = field(repr=False)
    state: State | AdaptiveState | None = field(repr=False)
    dense: Dense | None = field(default=None, repr=False)
    t_events: list[np.ndarray] = field(default_factory=list, repr=False)
    y_events: list[np.ndarray] = field(default_factory=list, repr=False)

    @property
    def success(self) -> bool:
        """Whether the run came to its end as asked for, inside the scheme's stability limit."""
        return self.status in (Status.COMPLETED, Status.EVENT)

    def __call__(self, t: ArrayLike, derivative: int = 0) -> np.ndarray:
        """The solution at any time of the run, with the accuracy of its steps.

        Parameters
        ----------
        t : float or array_like, shape (k,)
            Times between the first and the last row.
        derivative : {0, 1}, optional
            1 for the first derivative; infinite at 0 where the solution starts like t**alpha.

        Returns
        -------
        ndarray, shape (d,) or (k, d)

        Raises
        ------
        ValueError
            A time outside the run, or a run that kept rows alone.
        """
        if self.dense is None:
            required = "be answered by rows: this run kept no dense output"
            remedy = "use Collocation without t_eval, or pass t_eval"
            raise ValueError(complaint("t", required, shown(t), remedy))
        if derivative not in (0, 1):
            raise ValueError(complaint("derivative", "be 0 or 1", derivative))
        return self.dense(t, derivative, self.t[-1])

    def __repr__(self):
        return (
            f"Solution({self.message}; {self.t.size} rows of {self.y.shape[1]} components, "
            f"t = {self.t[0]:g} .. {self.t[-1]:g})"
        )
