"""How a run is to step, as a user asks for it, and the stepper that does so."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..collocation.pace import MAX_STEPS
from ..history.exponentials import SumOfExponentials
from ..support.checks import complaint, count, positive, shown
from .opening import open_adaptively, open_on_steps


class Asked(NamedTuple):
    """Arguments of `solve` that say how to step; None where one is left out."""

    n_steps: Any
    rtol: Any
    atol: Any
    mesh: Any
    max_step: Any
    max_steps: Any
    breaks: Any
    resume: Any
    allow_change: bool


def open_run(system, scheme, history, t_end, asked: Asked):
    """Return the stepper of a run to `t_end`, counted from its start, and its last position."""
    resume, allow_change = asked.resume, asked.allow_change
    rtol, atol, max_step, max_steps = asked.rtol, asked.atol, asked.max_step, asked.max_steps
    if max_steps is not None:
        max_steps = count("max_steps", max_steps)
    if scheme.adaptive:
        reason = "with Collocation, which chooses its steps"
        _refuse(reason, "", n_steps=asked.n_steps, mesh=asked.mesh)
        max_step = None if max_step is None else positive("max_step", max_step)
        tolerated = rtol, atol, max_step, max_steps or MAX_STEPS
        stepper, stop = open_adaptively(
            system, scheme, history, t_end, *tolerated, resume, allow_change
        )
    else:
        history = history or getattr(resume, "history", None) or SumOfExponentials()
        reason = "or come with scheme=Collocation()"
        remedy = "or give mesh=graded(n, exponent)" if scheme.takes_meshes else ""
        _refuse(reason, remedy, rtol=rtol, atol=atol, max_step=max_step, max_steps=max_steps)
        run = system, scheme, history, t_end
        stepper, stop = open_on_steps(*run, asked.n_steps, asked.mesh, resume, allow_change)
    stepper.set_breaks(asked.breaks, t_end)
    return stepper, stop


def _refuse(reason, remedy, **given):
    """Refuse arguments that are given."""
    for name, value in given.items():
        if value is not None:
            raise ValueError(complaint(name, f"be left out {reason}", shown(value), remedy))
