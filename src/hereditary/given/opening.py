"""Steps from the arguments of a run (n_steps or mesh), and steppers that march on them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ..equation.system import System
from ..stepping.scheme import Scheme
from ..stepping.state import State, go_on_from
from ..support.checks import complaint, count, left_out, refuse, shown, whole
from .fixed_stepper import FixedStepper
from .history.exponentials import SumOfExponentials
from .history.history import History
from .members import MemberStepper
from .steps import COUNTED, MeshSteps, UniformSteps, mesh_steps, steps_in

# Least decimal logarithm of h**order, which schemes divide by.
_MIN_LOG10_POWER = -290.0
# Largest decimal logarithm of h**order.
_MAX_LOG10_POWER = 290.0


# History of runs for which none is given.
_EXPONENTIALS = SumOfExponentials()


def given_steps(
    system: System,
    scheme: Scheme,
    t_end: float,
    state: State | None = None,
    *,
    n_steps: int | None = None,
    mesh: Any = False,
    **tolerated: Any,
) -> UniformSteps | MeshSteps:
    """Return `UniformSteps` or `MeshSteps` to t_end, including the steps of a resumed `state`."""
    # rtol and other tolerances are refused, because given steps do not adapt
    remedy = "or give mesh=graded(n, exponent)" if scheme.takes_meshes and mesh is not False else ""
    left_out("or come with scheme=Collocation()", remedy, **tolerated)
    if mesh is None or mesh is False:
        return _uniform_steps(system, t_end, n_steps, state)
    if n_steps is not None:
        refuse("n_steps", "be left out if a mesh is given", repr(n_steps))
    if state is not None and not isinstance(state.how, MeshSteps):
        refuse("mesh", "be left out if a run of uniform steps is resumed", shown(mesh))
    return mesh_steps(mesh, t_end, state.how if state else None, system.frame.start)


def _uniform_steps(
    system: System, t_end: float, n_steps: int | None, state: State | None
) -> UniformSteps:
    """Return uniform steps to t_end, with n_steps given or with the step of a state."""
    origin = system.frame.start
    if state is None:
        if n_steps is None:
            refuse("n_steps", "be given", "None", "e.g. n_steps=10_000", kind=TypeError)
        n_steps = count("n_steps", whole(n_steps))
        if n_steps > COUNTED:
            required = f"be at most {COUNTED:.0e}, so that times of steps differ"
            refuse("n_steps", required, f"{n_steps:.3g}")
        h, order = t_end / n_steps, system.highest_order
        if h == 0 or not _MIN_LOG10_POWER < order * math.log10(h) < _MAX_LOG10_POWER:
            required = f"leave steps h whose power h**{order:g} is a number of double precision"
            refuse("t_end", required, f"h = {h}", "take another unit of time")
        return UniformSteps(h, n_steps)
    if isinstance(state.how, MeshSteps):
        required = "be given if a run on a mesh is resumed"
        refuse("mesh", required, "None", "times from the state's time on", kind=TypeError)
    how, n_total = state.how, steps_in("t_end", t_end, state.how.h)
    if n_total <= how.n:
        refuse("t_end", f"exceed the state's time {origin + state.t}", origin + t_end)
    if abs(n_total * how.h - t_end) > 1e-6 * how.h:
        remedy = f"the nearest is {origin + n_total * how.h}"
        required = f"be a whole number of the state's steps h = {how.h}"
        refuse("t_end", required, origin + t_end, remedy)
    if n_steps is not None and count("n_steps", whole(n_steps)) not in (n_total, n_total - how.n):
        required = f"be {n_total - how.n} (from the state) or {n_total} (from 0), its step kept"
        refuse("n_steps", required, n_steps, "or leave n_steps out")
    return replace(how, n=n_total)


def open_given(
    system: System,
    scheme: Scheme,
    history: History | None,
    how: Any,
    state: State | None,
    allow_change: bool,
    directions: np.ndarray | None,
) -> tuple[FixedStepper, int]:
    """Return a `FixedStepper` at the start of a run or at `state`, and the run's last step."""
    history = history or getattr(state, "history", None) or _EXPONENTIALS
    stepper = FixedStepper(system, scheme, history, how, how.n, directions)
    go_on_from(state, stepper, allow_change)
    return _prepared(stepper, how.n), how.n


def open_members(
    system: System,
    scheme: Scheme,
    history: History | None,
    how: Any,
    params: np.ndarray,
    y0: np.ndarray,
    plan: Any = None,
) -> MemberStepper:
    """Return a `MemberStepper` for an ensemble; for its last arguments see there."""
    history = history or _EXPONENTIALS
    stepper = MemberStepper(system, scheme, history, how, how.n, params, y0, plan)
    return _prepared(stepper, how.n)


def _prepared(stepper: Any, n: int) -> Any:
    """Return a stepper with storage for a march to step n, or refuse more than can be allocated."""
    try:
        stepper.prepare(n)
    except (MemoryError, OverflowError) as error:
        required = f"hold {n} steps in memory"
        remedy = "SumOfExponentials() takes no more for more steps"
        raise ValueError(complaint("history", required, repr(stepper.history), remedy)) from error
    return stepper
