"""Make one value of the arguments that say how to step, and open the stepper."""

import math

import numpy as np

from ..collocation.adaptive_stepper import MAX_STEPS, AdaptiveStepper, Tolerance
from ..given.fixed_stepper import FixedStepper
from ..given.history.exponentials import SumOfExponentials
from ..given.history.history import History
from ..given.steps import COUNTED, UniformSteps, mesh_steps, steps_in
from ..support.checks import (
    complaint,
    count,
    instance,
    positive,
    real_array,
    refuse,
    shown,
    whole,
    within,
)

# Logarithms of the powers of the step that schemes may have to divide by.
_LEAST, _MOST = -290.0, 290.0
# Below this the rounding of double precision, not the scheme, decides.
TOLERANCE_FLOOR = 1e-12
# Time to the highest order, if that is above 1, must stay below this.
_FARTHEST = 1e300


def how_to_step(
    equation, scheme, t_end, state=None, *, history=None, n_steps=None, mesh=False, **tolerated
):
    """Return how a run steps: `UniformSteps`, `MeshSteps` or a `Tolerance`; refuse all else.

    Parameters
    ----------
    equation : System
    scheme : Scheme
    t_end : float
        End of the run, counted from its start.
    state : State, optional
        Of the run that goes on: its steps are kept, or its tolerances where none are given.
    history, n_steps : optional
        As of `solve`.
    mesh : optional
        As of `solve`; False where the user could not give one.
    **tolerated
        rtol, atol, max_step and max_steps as of `solve`.
    """
    if history is not None:
        instance("history", history, History, "hereditary.SumOfExponentials()")
    if scheme.adaptive:
        given = {"n_steps": n_steps, "mesh": None if mesh is False else mesh}
        _refuse("with Collocation, which chooses its steps", **given)
        _check_end(t_end, equation)
        return _tolerance(equation, state, history, **tolerated)
    remedy = "or give mesh=graded(n, exponent)" if scheme.takes_meshes and mesh is not False else ""
    _refuse("or come with scheme=Collocation()", remedy, **tolerated)
    if mesh is None or mesh is False:
        return _uniform_steps(equation, t_end, n_steps, state)
    if n_steps is not None:
        refuse("n_steps", "be left out if a mesh is given", repr(n_steps))
    if state is not None and state.h > 0:
        refuse("mesh", "be left out if a run of uniform steps is resumed", shown(mesh))
    return mesh_steps(mesh, t_end, state and state.steps, equation.frame.start)


def open_stepper(
    equation, scheme, history, how, t_end, state=None, allow_change=False, directions=None
):
    """Return a stepper at the start of a run, or where its state was taken, and its last position.

    `how` is what `how_to_step` returns, `t_end` counts from the start, and `directions` are those
    of tangents.
    """
    stepper: AdaptiveStepper | FixedStepper
    if isinstance(how, Tolerance):
        stepper, stop = AdaptiveStepper(equation, scheme, t_end, how, directions), t_end
        if state is not None and stepper.modes_tol != state.modes_tol:
            required = f"be left out or ask for modes as the state has them, to {state.modes_tol:g}"
            refuse("history", required, f"to {stepper.modes_tol:g}")
    else:
        stop, history = how.n, history or getattr(state, "history", None) or SumOfExponentials()
        covered = state.memory_steps if state is not None and state.h > 0 else stop
        stepper = FixedStepper(equation, scheme, history, how, covered, directions)
    if state is not None:
        stepper.restore(state, allow_change)
        if not np.all(np.isfinite(stepper.y)):
            refuse("resume", "hold a finite solution", f"y = {shown(stepper.y)}")
    if isinstance(stepper, FixedStepper):
        try:
            stepper.prepare(stop)
        except (MemoryError, OverflowError) as error:
            required = f"hold {stop} steps in memory"
            remedy = "SumOfExponentials() takes no more for more steps"
            raise ValueError(complaint("history", required, repr(history), remedy)) from error
    return stepper, stop


def _refuse(reason, remedy="", **given):
    """Refuse arguments that are given."""
    for name, value in given.items():
        if value is not None:
            refuse(name, f"be left out {reason}", shown(value), remedy)


def _check_end(t_end, equation):
    """Refuse an end of a run if its powers exceed the range of double precision."""
    farthest = _FARTHEST ** (1 / max(1.0, float(equation.highest_orders().max())))
    interval = f"[{1 / _FARTHEST:g}, {farthest:g}]"
    within("t_end", t_end, 1 / _FARTHEST, farthest, interval, "take another unit of time")


def _tolerance(equation, state, history, rtol=None, atol=None, max_step=None, max_steps=None):
    """Return the `Tolerance`; what is not given is that of a state, or a default."""
    if not isinstance(history, SumOfExponentials | None):
        required = "be left out with Collocation, or be SumOfExponentials(tol)"
        refuse("history", required, repr(history))
    modes = None if history is None else history.tol
    if state is not None:
        rtol = state.rtol if rtol is None else rtol
        atol = state.atol if atol is None else atol
        modes = state.modes_tol if modes is None else modes
    interval = f"[{TOLERANCE_FLOOR:g}, 0.1]"
    remedy = "write a number such as rtol=1e-6; below 1e-12 rounding decides"
    rtol = 1e-6 if rtol is None else rtol
    return Tolerance(
        within("rtol", rtol, TOLERANCE_FLOOR, 0.1, interval, remedy),
        None if atol is None else _absolute(atol, equation.n_y),
        modes,
        None if max_step is None else positive("max_step", max_step),
        MAX_STEPS if max_steps is None else count("max_steps", max_steps),
    )


def _absolute(atol, n):
    """Return an absolute tolerance: a number, or a tuple of one for each of n components of y."""
    if not isinstance(atol, list | tuple) and np.ndim(atol) == 0:
        return positive("atol", atol)
    values = real_array("atol", atol)
    if values.shape != (n,) or not np.all(values > 0):
        required = f"be a positive number, or one for each of the {n} components of y"
        refuse("atol", required, shown(values))
    return tuple(values.tolist())


def _uniform_steps(equation, t_end, n_steps, state):
    """Return uniform steps to t_end: as many as are asked for, or more of those of a state."""
    origin = equation.frame.start
    if state is None:
        if n_steps is None:
            refuse("n_steps", "be given", "None", "e.g. n_steps=10_000", kind=TypeError)
        n_steps = count("n_steps", whole(n_steps))
        if n_steps > COUNTED:
            required = f"be at most {COUNTED:.0e}, so that times of steps differ"
            refuse("n_steps", required, f"{n_steps:.3g}")
        h, order = t_end / n_steps, float(equation.highest_orders().max())
        if h == 0 or not _LEAST < order * math.log10(h) < _MOST:
            required = f"leave steps h whose power h**{order:g} is a number of double precision"
            refuse("t_end", required, f"h = {h}", "take another unit of time")
        return UniformSteps(h, n_steps)
    if state.h == 0:
        required = "be given if a run on a mesh is resumed"
        refuse("mesh", required, "None", "times from the state's time on", kind=TypeError)
    n_total = steps_in("t_end", t_end, state.h)
    if n_total <= state.n:
        refuse("t_end", f"exceed the state's time {origin + state.t}", origin + t_end)
    if abs(n_total * state.h - t_end) > 1e-6 * state.h:
        remedy = f"the nearest is {origin + n_total * state.h}"
        required = f"be a whole number of the state's steps h = {state.h}"
        refuse("t_end", required, origin + t_end, remedy)
    if n_steps is not None and count("n_steps", whole(n_steps)) not in (n_total, n_total - state.n):
        required = f"be {n_total - state.n} (from the state) or {n_total} (from 0), its step kept"
        refuse("n_steps", required, n_steps, "or leave n_steps out")
    return UniformSteps(state.h, n_total)
