"""Check the arguments that determine the steps of a run, and open the stepper for them."""

from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from ..collocation.method import Collocation
from ..collocation.opening import checked_tolerance, open_adaptive
from ..equation.system import System
from ..given.history.exponentials import SumOfExponentials
from ..given.history.history import History
from ..given.opening import given_steps, open_given
from ..given.steps import MeshSteps, UniformSteps
from ..stepping.scheme import Scheme
from ..stepping.state import State
from ..stepping.tolerance import Tolerance
from ..support.checks import instance, refuse
from .delayed import DelayedStepper

# How a run steps.
Policy: TypeAlias = UniformSteps | MeshSteps | Tolerance


def chooses_steps(scheme: Scheme) -> bool:
    """Return whether a scheme chooses its steps by a tolerance."""
    return isinstance(scheme, Collocation)


def how_to_step(
    system: System, scheme: Scheme, t_end: float, state: State | None = None, *,
    history: History | None = None, **steps: Any,
) -> Policy:  # fmt: skip
    """Return how a run steps, from the arguments of `solve` that say it."""
    # t_end counts from the start; a state's steps, or its tolerances unless others are given, are
    # kept; steps: arguments of `solve`, with mesh=False if the caller has no such argument
    if history is not None:
        instance("history", history, History, "hereditary.SumOfExponentials()")
    if not chooses_steps(scheme):
        return given_steps(system, scheme, t_end, state, **steps)
    if not isinstance(history, SumOfExponentials | None):
        required = "be left out with Collocation, or be SumOfExponentials(tol)"
        refuse("history", required, repr(history))
    return checked_tolerance(system, t_end, state, modes=history and history.tol, **steps)


def open_stepper(
    system: System, scheme: Scheme, history: History | None, policy: Policy, t_end: float,
    state: State | None = None, allow_change: bool = False, directions: np.ndarray | None = None,
) -> tuple[Any, Any]:  # fmt: skip
    """Return a stepper at the start of a run, or at its `state`, and the position of its end."""
    # t_end: from the start; directions: initial ones of tangents
    if system.delays or system.switches:  # which have arrays that change during a march
        functions = system.functions.for_a_march()
        system = replace(system, functions=functions)
    if system.delays:
        return _open_delayed(system, scheme, history, policy, t_end, state, allow_change)
    if isinstance(policy, Tolerance):
        return open_adaptive(system, scheme, policy, t_end, state, allow_change, directions)
    return open_given(system, scheme, history, policy, state, allow_change, directions)


def _open_delayed(
    system: System, scheme: Scheme, history: History | None, policy: Policy, t_end: float,
    state: State | None, allow_change: bool,
) -> tuple[Any, Any]:  # fmt: skip
    """Return a stepper whose f reads its earlier steps, and the position of the run's end."""
    delays, system = system.delays, replace(system, delays=())
    own = state and replace(state, checkpoint=state.checkpoint[0])
    inner, last = open_stepper(system, scheme, history, policy, t_end, own, allow_change)
    rtol = policy.rtol if isinstance(policy, Tolerance) else None
    stepper = DelayedStepper(inner, delays, t_end, rtol)
    moving = any(callable(delay.past.delay.past) for delay in delays)
    if rtol is None and state is None and moving:  # corrections of first steps read the past
        system = replace(system, functions=system.functions._replace(delays=stepper.pieces))
        inner, last = open_stepper(system, scheme, history, policy, t_end)
        stepper = DelayedStepper(inner, delays, t_end)
    if state is not None:
        stepper.remember(state.checkpoint[1])
    return stepper, last
