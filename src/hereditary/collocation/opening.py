"""The tolerance of a run by collocation, and the start of its stepper."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..equation.system import System
from ..stepping.state import State, go_on_from
from ..stepping.tolerance import Tolerance
from ..support.checks import left_out, refuse, within
from .adaptive_stepper import AdaptiveStepper
from .algebraic import check_start

# Upper limit of t_end**alpha, where alpha is the highest order of the equation or 1 if that is
# larger. The reciprocal is the lower limit of t_end.
_FARTHEST = 1e300


def checked_tolerance(
    system: System,
    t_end: float,
    state: State | None = None,
    *,
    n_steps: Any = None,
    mesh: Any = False,
    **asked: Any,
) -> Tolerance:
    """Return the checked `Tolerance` of a run to t_end.

    Fields for which nothing, or None, is asked are those of `state`, if one is given.
    """
    by = "rtol, which chooses the steps"
    if asked.get("rtol") is None:
        by = "Collocation, which chooses its steps"
    left_out(f"with {by}", n_steps=n_steps, mesh=None if mesh is False else mesh)
    _check_end(t_end, system)
    return (Tolerance() if state is None else state.how).asked(system.n_y, **asked)


def _check_end(t_end: float, system: System) -> None:
    """Refuse a t_end whose powers up to the highest order exceed the range of double precision."""
    farthest = _FARTHEST ** (1 / max(1.0, system.highest_order))
    interval = f"[{1 / _FARTHEST:g}, {farthest:g}]"
    within("t_end", t_end, 1 / _FARTHEST, farthest, interval, "take another unit of time")


def open_adaptive(
    system: System,
    scheme: Any,
    how: Tolerance,
    t_end: float,
    state: State | None,
    allow_change: bool,
    directions: np.ndarray | None,
) -> tuple[AdaptiveStepper, float]:
    """Return an `AdaptiveStepper` at the start of a run, or at `state`; and t_end."""
    # directions: of the tangents' initial values
    if state is None:
        check_start(system, t_end, how)
    stepper = AdaptiveStepper(system, scheme, t_end, how, directions)
    if state is not None and stepper.tolerance.modes != state.how.modes:
        required = f"be left out or ask for modes as the state has them, to {state.how.modes:g}"
        refuse("history", required, f"to {stepper.tolerance.modes:g}")
    go_on_from(state, stepper, allow_change)
    return stepper, t_end
