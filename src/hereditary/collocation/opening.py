"""Checks of the tolerances that a user passes, and the start of an adaptive stepper."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ..equation.system import System
from ..stepping.state import State, go_on_from
from ..support.checks import count, left_out, positive, real_array, refuse, shown, within
from .adaptive_stepper import AdaptiveStepper
from .algebraic import check_start
from .tolerances import Tolerance

# Smallest relative tolerance. Below it, rounding in double precision decides the error.
TOLERANCE_FLOOR = 1e-12
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
    checks: dict[str, Callable[[Any], Any]] = {
        "rtol": _relative,
        "atol": partial(_absolute, n=system.n_y),
        "modes": float,
        "max_step": partial(positive, "max_step"),
        "max_steps": partial(count, "max_steps"),
    }
    found = {name: checks[name](value) for name, value in asked.items() if value is not None}
    return (Tolerance() if state is None else state.how)._replace(**found)


def _relative(rtol: Any) -> float:
    """Return the checked relative tolerance."""
    interval = f"[{TOLERANCE_FLOOR:g}, 0.1]"
    remedy = "write a number such as rtol=1e-6; below 1e-12 rounding decides"
    return within("rtol", rtol, TOLERANCE_FLOOR, 0.1, interval, remedy)


def _absolute(atol: Any, n: int) -> float | tuple[float, ...]:
    """Return the checked absolute tolerance: a number, or a tuple for each of n components."""
    if not isinstance(atol, list | tuple) and np.ndim(atol) == 0:
        return positive("atol", atol)
    values = real_array("atol", atol)
    if values.shape != (n,) or not np.all(values > 0):
        required = f"be a positive number, or one for each of the {n} components of y"
        refuse("atol", required, shown(values))
    return tuple(values.tolist())


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
        check_start(system, t_end, how.rtol, how.atol)
    stepper = AdaptiveStepper(system, scheme, t_end, how, directions)
    if state is not None and stepper.allowed.of_modes != state.how.modes:
        required = f"be left out or ask for modes as the state has them, to {state.how.modes:g}"
        refuse("history", required, f"to {stepper.allowed.of_modes:g}")
    go_on_from(state, stepper, allow_change)
    return stepper, t_end
