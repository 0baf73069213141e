"""The driver (floor 4): marches a stepper to the end, a stretch at a time, and keeps the rows."""

import time

import numpy as np
from numpy.typing import ArrayLike

from .._checks import complaint, count, instance, positive, real_array, shown
from ..equation import Equation
from ..history.exponentials import SumOfExponentials
from ..history.history import History
from ..meshes import Graded, mesh_times
from ..schemes.explicit import ExplicitCaputo
from ..schemes.scheme import Scheme
from .drive import Drive, reached_end, told
from .mesh_stepper import MeshStepper
from .progress import Interruption, ProgressBar
from .rows import Rows
from .solution import Solution
from .stepper import State, Stepper


def solve(
    equation: Equation,
    t_end: float,
    n_steps: int | None = None,
    *,
    mesh: Graded | ArrayLike | None = None,
    scheme: Scheme | None = None,
    history: History | None = None,
    save_every: int = 1,
    t_eval: ArrayLike | None = None,
    progress: bool = False,
    resume: State | None = None,
) -> Solution:
    """Solve an equation with memory on [0, t_end], with uniform steps or along a mesh.

    Parameters
    ----------
    equation : Equation
        What is solved.
    t_end : float
        End of the run, above 0 (above the state's time when resuming) [time].
    n_steps : int
        Number of steps, h = t_end / n_steps. When resuming, the state's step is kept: leave it
        out, or give a number that agrees, counted either from 0 or from the state.
    mesh : Graded or array_like, shape (n+1,), optional
        Instead of n_steps: ``graded(n, exponent)`` or times that increase from 0 to t_end. For L1,
        L2 and L2Sigma with orders up to 1 (L2Sigma also above), with Direct or SumOfExponentials;
        such a run cannot be resumed, its ``state`` is None.
    scheme : Scheme, optional
        Default ``ExplicitCaputo()``.
    history : History, optional
        Default ``SumOfExponentials(tol=1e-10)``.
    save_every : int, optional
        Keep every so many-th step, besides the first and the last row.
    t_eval : array_like, shape (k,), optional
        Keep the solution at these increasing times instead, linearly interpolated between steps.
    progress : bool, optional
        Show a progress bar with the time left, on a terminal only.
    resume : State, optional
        ``Solution.state`` of an earlier run; rows then begin at its time, and the result equals
        that of an unbroken run bit for bit.

    Returns
    -------
    Solution
        Also when the run blows up, is interrupted by Ctrl-C, or the right-hand side raises: its
        status says so and it holds everything computed until then.

    Raises
    ------
    TypeError, ValueError
        An argument is not as required; nothing has been run.
    KeyboardInterrupt
        Ctrl-C came when the run had just reached its end.

    Warns
    -----
    StabilityWarning
        The step exceeded the scheme's stability limit along the orbit, or the solution zigzags.

    Cost
    ----
    One right-hand side a step and the history's share: with the default history constant memory
    and about 20 ns a step and component besides `rhs` (convergence/memory_is_nearly_free.py).

    Examples
    --------
    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.stick_slip(), t_end=100.0, n_steps=20_000)
    >>> sol.success, sol.y.shape
    (True, (20001, 1))
    """
    began = time.perf_counter()
    instance("equation", equation, Equation, "hereditary.Equation(terms, rhs, y0)")
    t_end = positive("t_end", t_end)
    if scheme is None:
        scheme = ExplicitCaputo()
    if history is None:
        history = SumOfExponentials()
    instance("scheme", scheme, Scheme, "hereditary.ExplicitCaputo()")
    instance("history", history, History, "hereditary.SumOfExponentials()")
    save_every = count("save_every", save_every)
    if save_every > 1 and t_eval is not None:
        required = "be left out where t_eval says which rows to keep"
        raise ValueError(complaint("save_every", required, save_every))
    if mesh is not None:
        stepper, n_total = _on_mesh(equation, scheme, history, t_end, n_steps, mesh, resume)
    else:
        stepper, n_total = _on_uniform_steps(equation, scheme, history, t_end, n_steps, resume)
    wanted = Rows(stepper, n_total, save_every, _eval_times(t_eval, stepper.t, t_end))
    stepper.prepare(n_total)
    ready = time.perf_counter()
    status, detail = _run(stepper, n_total, wanted, progress)
    wanted.close(stepper, t_end)
    finished = time.perf_counter()
    seconds = (ready - began, finished - ready)
    return _solution(stepper, wanted, status, detail, seconds)


def _on_mesh(equation, scheme, history, t_end, n_steps, mesh, resume):
    """Stepper along a mesh, and its last step number."""
    for name, value in (("n_steps", n_steps), ("resume", resume)):
        if value is not None:
            required = "be left out where a mesh is given"
            raise ValueError(complaint(name, required, type(value).__name__))
    times = mesh_times(mesh, t_end)
    return MeshStepper(equation, scheme, history, times), times.size - 1


def _on_uniform_steps(equation, scheme, history, t_end, n_steps, resume):
    """Stepper with uniform steps, anew or resumed, and its last step number."""
    if resume is not None:
        instance("resume", resume, State, "the .state of an earlier Solution")
    h, n_total, prepared = uniform_steps(t_end, n_steps, resume)
    stepper = Stepper(equation, scheme, history, h, prepared)
    if resume is not None:
        stepper.restore(resume)
        if not np.all(np.isfinite(stepper.y)):
            required = "hold a finite solution"
            raise ValueError(complaint("resume", required, f"y = {shown(stepper.y)}"))
    return stepper, n_total


def uniform_steps(t_end, n_steps, state):
    """Step, last step number and the number of steps that the history is opened for."""
    if state is None:
        if n_steps is None:
            raise TypeError(complaint("n_steps", "be given", "none", "e.g. n_steps=10_000"))
        n_steps = count("n_steps", n_steps)
        return t_end / n_steps, n_steps, n_steps
    n_total = round(t_end / state.h)
    if n_total <= state.n:
        raise ValueError(complaint("t_end", f"exceed the state's time {state.t}", t_end))
    if abs(n_total * state.h - t_end) > 1e-6 * state.h:
        remedy = f"the nearest is {n_total * state.h}"
        required = f"be a whole number of the state's steps h = {state.h}"
        raise ValueError(complaint("t_end", required, t_end, remedy))
    if n_steps is not None and count("n_steps", n_steps) not in (n_total, n_total - state.n):
        required = f"be {n_total - state.n} (from the state) or {n_total} (from 0), its step kept"
        raise ValueError(complaint("n_steps", required, n_steps, "or leave n_steps out"))
    return state.h, n_total, state.memory_steps


def _eval_times(t_eval, t_start, t_end):
    if t_eval is None:
        return None
    times = real_array("t_eval", t_eval)
    inside = f"be increasing times in [{t_start}, {t_end}]"
    if times.ndim != 1 or times.size == 0:
        raise ValueError(complaint("t_eval", inside, f"shape {times.shape}"))
    slack = 1e-12 * t_end  # times computed otherwise may miss the ends by rounding
    if np.any(np.diff(times) <= 0) or times[0] < t_start - slack or times[-1] > t_end + slack:
        raise ValueError(complaint("t_eval", inside, shown(times)))
    return np.clip(times, t_start, t_end)


def _run(stepper, n_total, wanted, progress):
    """March to step n_total or as far as it goes; return the status and a detail for it."""

    def advance(n_more):
        positions, rows, slopes = wanted.positions(stepper.n, stepper.n + n_more)
        try:
            stepper.advance(n_more, positions, rows, slopes)
        finally:
            wanted.keep(positions, stepper.rows_written)  # also those before an exception

    bar = ProgressBar(progress)
    try:
        with Interruption() as interruption:
            ended = Drive(stepper, n_total, advance, interruption, bar).to(n_total)
    finally:
        bar.close()
    return ended or (reached_end(stepper), "")


def _solution(stepper, wanted, status, detail, seconds):
    size = wanted.size
    t, y, ydot = wanted.t[:size], wanted.y[:size], wanted.ydot[:size]
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
        },
        state=stepper.state(),
    )
