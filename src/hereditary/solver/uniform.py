"""The driver of given steps: marches a stepper to the end and keeps the rows."""

import math
import time
from dataclasses import replace

import numpy as np

from .._checks import complaint, count, shown, whole
from ..memory_kernel import told_error
from ..meshes import UniformSteps, mesh_steps
from .dense import Dense
from .drive import Drive, reached_end, told
from .events import Events
from .first_steps import starting_steps
from .progress import Interruption, ProgressBar
from .rows import Rows
from .solution import Solution, Status
from .step_pieces import StepPieces
from .stepper import Stepper
from .stops import checked_breaks
from .watched import Watched

# Steps of a run, and floats, are whole numbers up to here.
_COUNTED = 2**53
# Breaks may miss their steps by so much of a step.
_OFF = 1e-6
# Logarithms of the powers of the step that schemes may have to divide by.
_LEAST, _MOST = -290.0, 290.0


def solve_on_steps(
    equation, t_end, n_steps, mesh, scheme, history, save_every, t_eval, breaks, events, progress,
    resume, allow_change,
):  # fmt: skip
    """Solve with uniform steps or along a mesh; the arguments of `solve`, most of them checked."""
    began = time.perf_counter()
    if mesh is not None:
        asked = t_end, n_steps, mesh, resume, allow_change
        stepper, n_total = _on_mesh(equation, scheme, history, *asked)
    else:
        stepper, n_total = _on_uniform_steps(
            equation, scheme, history, t_end, n_steps, resume, allow_change
        )
    stepper.breaks = _break_steps(breaks, stepper, t_end)
    signs = {} if resume is None else resume.event_signs
    found = Events(events, stepper.t, stepper.y, signs, looks=1)
    wanted = Rows(stepper, n_total, save_every, t_eval)
    _prepare(stepper, n_total, history)
    ready = time.perf_counter()
    status, detail = _run(stepper, n_total, wanted, found, progress)
    wanted.close(stepper, t_end)
    seconds = (ready - began, time.perf_counter() - ready)
    return _solution(stepper, wanted, found, status, detail, seconds)


def _on_mesh(equation, scheme, history, t_end, n_steps, mesh, resume, allow_change):
    """Stepper along a mesh, anew or resumed, and its last step number."""
    if n_steps is not None:
        required = "be left out where a mesh is given"
        raise ValueError(complaint("n_steps", required, type(n_steps).__name__))
    begun = None
    if resume is not None:
        if resume.h > 0:
            required = "be left out where a run of uniform steps goes on"
            raise ValueError(complaint("mesh", required, type(mesh).__name__))
        if t_end <= resume.t:
            raise ValueError(complaint("t_end", f"exceed the state's time {resume.t}", t_end))
        begun = resume.steps
    steps = mesh_steps(mesh, t_end, begun)
    n_total = steps.mesh.size - 1
    stepper = Stepper(equation, scheme, history, steps, n_total)
    return _resumed(stepper, resume, allow_change), n_total


def _on_uniform_steps(equation, scheme, history, t_end, n_steps, resume, allow_change):
    """Stepper with uniform steps, anew or resumed, and its last step number."""
    h, n_total, prepared = uniform_steps(t_end, n_steps, resume)
    order = float(equation.highest_orders().max())
    if h == 0 or not _LEAST < order * math.log10(h) < _MOST:
        required = f"leave steps h whose power h**{order:g} is a number of double precision"
        raise ValueError(complaint("t_end", required, f"h = {h}", "take another unit of time"))
    stepper = Stepper(equation, scheme, history, UniformSteps(h), prepared)
    return _resumed(stepper, resume, allow_change), n_total


def _resumed(stepper, state, allow_change):
    """Return the stepper where a state was taken, or as it is without one."""
    if state is not None:
        stepper.restore(state, allow_change)
        if not np.all(np.isfinite(stepper.y)):
            required = "hold a finite solution"
            raise ValueError(complaint("resume", required, f"y = {shown(stepper.y)}"))
    return stepper


def _prepare(stepper, n_total, history):
    """Make room for all steps, or say that there is none."""
    try:
        stepper.prepare(n_total)
    except (MemoryError, OverflowError) as error:
        required = f"hold {n_total} steps in memory"
        remedy = "SumOfExponentials() takes no more for more steps"
        raise ValueError(complaint("history", required, repr(history), remedy)) from error


def uniform_steps(t_end, n_steps, state):
    """Step, last step number and the number of steps that the history is opened for."""
    if state is None:
        if n_steps is None:
            raise TypeError(complaint("n_steps", "be given", "none", "e.g. n_steps=10_000"))
        n_steps = count("n_steps", whole(n_steps))
        if n_steps > _COUNTED:
            required = f"be at most {_COUNTED:.0e}, as far as times of steps are told apart"
            raise ValueError(complaint("n_steps", required, f"{n_steps:.3g}"))
        return t_end / n_steps, n_steps, n_steps
    if state.h == 0:
        required = "be given where a run on a mesh goes on"
        raise TypeError(complaint("mesh", required, "none", "times from the state's time on"))
    n_total = round(t_end / state.h)
    if n_total <= state.n:
        raise ValueError(complaint("t_end", f"exceed the state's time {state.t}", t_end))
    if abs(n_total * state.h - t_end) > 1e-6 * state.h:
        remedy = f"the nearest is {n_total * state.h}"
        required = f"be a whole number of the state's steps h = {state.h}"
        raise ValueError(complaint("t_end", required, t_end, remedy))
    if n_steps is not None and count("n_steps", whole(n_steps)) not in (n_total, n_total - state.n):
        required = f"be {n_total - state.n} (from the state) or {n_total} (from 0), its step kept"
        raise ValueError(complaint("n_steps", required, n_steps, "or leave n_steps out"))
    return state.h, n_total, state.memory_steps


def _break_steps(breaks, stepper, t_end):
    """Numbers of the steps that end at breaks."""
    times = checked_breaks(breaks)
    times = times[(times >= stepper.t) & (times <= t_end)]
    positions = stepper.steps.positions(times)
    numbers = np.rint(positions)
    off = np.abs(positions - numbers) > _OFF
    if np.any(off):
        required = "be times of steps, which see the jump from its own side each"
        remedy = "take as many steps that one ends there, or a mesh through it"
        raise ValueError(complaint("breaks", required, shown(times[off]), remedy))
    return frozenset(int(n) for n in numbers)


def _run(stepper, n_total, wanted, found, progress):
    """March to step n_total or as far as it goes; return the status and a detail for it."""

    def advance(n_more):
        positions, rows, slopes = wanted.positions(stepper.n, stepper.n + n_more)
        try:
            stepper.advance(n_more, positions, rows, slopes)
        finally:
            wanted.keep(positions, stepper.rows_written)  # also those before an exception

    watched = Watched(stepper, wanted, found) if found.times else None
    bar = ProgressBar(progress)
    try:
        with Interruption() as interruption:
            drive = Drive(stepper, n_total, watched or advance, interruption, bar)
            ended = drive.to(n_total)
    finally:
        bar.close()
    if watched and watched.ended:
        status = Status.EVENT_FAILED if found.failure else Status.EVENT
        return status, found.failure
    return ended or (reached_end(stepper), "")


def _solution(stepper, wanted, found, status, detail, seconds):
    size = wanted.size
    t, y, ydot = wanted.t[:size], wanted.y[:size], wanted.ydot[:size]
    dense = _dense(stepper, wanted, t, y, ydot)
    if stepper.equation.m == 1:
        ydot = None
    message = told(stepper, status, detail)
    return Solution(
        t=t,
        y=y,
        ydot=ydot,
        status=status,
        message=message,
        stats={
            "n_steps": stepper.n,
            "n_rhs": stepper.n_rhs,
            "n_modes": stepper.memory.n_modes,
            "history_bytes": stepper.memory.nbytes,
            "setup_seconds": seconds[0],
            "run_seconds": seconds[1],
            "stiffness_ratio": stepper.largest_ratio,
            "kernel_error": told_error(stepper.memory.kernel_error),
        },
        state=replace(stepper.state(), event_signs=found.signs()),
        dense=dense,
        t_events=[np.array(times) for times in found.times],
        y_events=[np.array(rows).reshape(-1, stepper.equation.d) for rows in found.values],
    )


def _dense(stepper, wanted, t, y, ydot):
    """Dense output of a run that kept every step; None for others."""
    if not wanted.keeps_steps or t.size < 2:
        return None
    dense = Dense(stepper.equation.highest_orders() > 1, resolved=True)
    dense.add(StepPieces(t, y, ydot, starting_steps(stepper, t[0])), t[0])
    return dense
