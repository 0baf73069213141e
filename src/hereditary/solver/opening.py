"""Steppers of a run, anew or from a state, with all that is asked of their steps checked."""

import math

import numpy as np

from ..collocation.adaptive_stepper import AdaptiveStepper
from ..history.exponentials import SumOfExponentials
from ..schemes.steps import UniformSteps, mesh_steps
from ..support.checks import complaint, count, positive, shown, whole, within
from .fixed_stepper import FixedStepper

# Steps of a run, and floats, are whole numbers up to here.
_COUNTED = 2**53
# Logarithms of the powers of the step that schemes may have to divide by.
_LEAST, _MOST = -290.0, 290.0
# Below this the rounding of double precision, not the scheme, decides.
TOLERANCE_FLOOR = 1e-12
# Time to the highest order, if that is above 1, must stay below this.
_FARTHEST = 1e300


def open_on_steps(equation, scheme, history, t_end, n_steps, mesh, resume, allow_change):
    """Stepper with uniform steps or along a mesh, and its last step number."""
    asked = t_end, n_steps, resume, allow_change
    if mesh is None:
        stepper, n_total = _on_uniform_steps(equation, scheme, history, *asked)
    else:
        stepper, n_total = _on_mesh(equation, scheme, history, mesh, *asked)
    try:
        stepper.prepare(n_total)
    except (MemoryError, OverflowError) as error:
        required = f"hold {n_total} steps in memory"
        remedy = "SumOfExponentials() takes no more for more steps"
        raise ValueError(complaint("history", required, repr(history), remedy)) from error
    return stepper, n_total


def open_adaptively(
    equation, scheme, history, t_end, rtol, atol, max_step, max_steps, resume, allow_change
):
    """Stepper that chooses its steps by the tolerance, and the time of its end."""
    check_end(t_end, equation)
    modes_tol = modes_tolerance(history)
    if resume is not None:
        rtol = resume.rtol if rtol is None else rtol
        atol = resume.atol if atol is None else atol
        modes_tol = resume.modes_tol if history is None else modes_tol
    rtol, atol = tolerances(rtol, atol)
    how = {"modes_tol": modes_tol, "max_step": max_step, "max_steps": max_steps}
    stepper = AdaptiveStepper(equation, scheme, t_end, rtol, atol, **how)
    if resume is None:
        return stepper, t_end
    if stepper.modes_tol != resume.modes_tol:
        required = f"be left out or ask for modes as the state has them, to {resume.modes_tol:g}"
        raise ValueError(complaint("history", required, f"to {stepper.modes_tol:g}"))
    return resumed(stepper, resume, allow_change), t_end


def check_end(t_end, equation):
    """Refuse ends of a run whose powers are no numbers of double precision."""
    farthest = _FARTHEST ** (1 / max(1.0, float(equation.highest_orders().max())))
    interval = f"[{1 / _FARTHEST:g}, {farthest:g}]"
    within("t_end", t_end, 1 / _FARTHEST, farthest, interval, "take another unit of time")


def tolerances(rtol, atol):
    """Return the relative and the absolute tolerance, checked; None for errors by sizes of y."""
    interval = f"[{TOLERANCE_FLOOR:g}, 0.1]"
    remedy = "write a number such as rtol=1e-6; below 1e-12 rounding decides"
    rtol = 1e-6 if rtol is None else rtol
    rtol = within("rtol", rtol, TOLERANCE_FLOOR, 0.1, interval, remedy)
    return rtol, None if atol is None else positive("atol", atol)


def modes_tolerance(history):
    """Tolerance of the modes that a history asks for, None where it asks for none."""
    if not isinstance(history, SumOfExponentials | None):
        required = "be left out with Collocation, or be SumOfExponentials(tol)"
        raise ValueError(complaint("history", required, repr(history)))
    return None if history is None else history.tol


def _on_mesh(equation, scheme, history, mesh, t_end, n_steps, resume, allow_change):
    """Stepper along a mesh, anew or resumed, and its last step number."""
    if n_steps is not None:
        required = "be left out where a mesh is given"
        raise ValueError(complaint("n_steps", required, type(n_steps).__name__))
    begun = None
    if resume is not None:
        if resume.h > 0:
            required = "be left out where a run of uniform steps goes on"
            raise ValueError(complaint("mesh", required, type(mesh).__name__))
        begun = resume.steps
    steps = mesh_steps(mesh, t_end, begun, equation.frame.start)
    n_total = steps.mesh.size - 1
    stepper = FixedStepper(equation, scheme, history, steps, n_total)
    return resumed(stepper, resume, allow_change), n_total


def _on_uniform_steps(equation, scheme, history, t_end, n_steps, resume, allow_change):
    """Stepper with uniform steps, anew or resumed, and its last step number."""
    h, n_total, prepared = uniform_steps(equation, t_end, n_steps, resume)
    stepper = FixedStepper(equation, scheme, history, UniformSteps(h), prepared)
    return resumed(stepper, resume, allow_change), n_total


def steps_in(name, length, h):
    """Return the number of steps h next to a length."""
    if not length / h <= _COUNTED:
        required = f"be at most {_COUNTED:.0e} steps h = {h:g}"
        raise ValueError(complaint(name, required, f"{length:g}"))
    return round(length / h)


def resumed(stepper, state, allow_change):
    """Return the stepper where a state was taken, or as it is without one."""
    if state is not None:
        stepper.restore(state, allow_change)
        if not np.all(np.isfinite(stepper.y)):
            required = "hold a finite solution"
            raise ValueError(complaint("resume", required, f"y = {shown(stepper.y)}"))
    return stepper


def uniform_steps(equation, t_end, n_steps, state):
    """Return step, last step number and the number of steps that the history is opened for."""
    origin = equation.frame.start
    if state is None:
        if n_steps is None:
            raise TypeError(complaint("n_steps", "be given", "none", "e.g. n_steps=10_000"))
        n_steps = count("n_steps", whole(n_steps))
        if n_steps > _COUNTED:
            required = f"be at most {_COUNTED:.0e}, as far as times of steps are told apart"
            raise ValueError(complaint("n_steps", required, f"{n_steps:.3g}"))
        h, order = t_end / n_steps, float(equation.highest_orders().max())
        if h == 0 or not _LEAST < order * math.log10(h) < _MOST:
            required = f"leave steps h whose power h**{order:g} is a number of double precision"
            raise ValueError(complaint("t_end", required, f"h = {h}", "take another unit of time"))
        return h, n_steps, n_steps
    if state.h == 0:
        required = "be given where a run on a mesh goes on"
        raise TypeError(complaint("mesh", required, "none", "times from the state's time on"))
    n_total = steps_in("t_end", t_end, state.h)
    if n_total <= state.n:
        required = f"exceed the state's time {origin + state.t}"
        raise ValueError(complaint("t_end", required, origin + t_end))
    if abs(n_total * state.h - t_end) > 1e-6 * state.h:
        remedy = f"the nearest is {origin + n_total * state.h}"
        required = f"be a whole number of the state's steps h = {state.h}"
        raise ValueError(complaint("t_end", required, origin + t_end, remedy))
    if n_steps is not None and count("n_steps", whole(n_steps)) not in (n_total, n_total - state.n):
        required = f"be {n_total - state.n} (from the state) or {n_total} (from 0), its step kept"
        raise ValueError(complaint("n_steps", required, n_steps, "or leave n_steps out"))
    return state.h, n_total, state.memory_steps
