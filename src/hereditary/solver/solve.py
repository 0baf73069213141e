"""The front door of the solver: checks what is asked and hands it to a run."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from ..collocation.method import Collocation
from ..equation.equation import Equation
from ..history.history import History
from ..schemes.explicit import ExplicitCaputo
from ..schemes.grunwald_letnikov import GrunwaldLetnikov
from ..schemes.scheme import Scheme
from ..schemes.steps import COUNTED, Graded, checked_breaks
from ..support.checks import (
    complaint,
    component_numbers,
    count,
    instance,
    positive,
    real,
    real_array,
    refusing,
    shown,
    whole,
)
from .events import Events
from .first_order import note_error
from .opening import how_to_step, open_stepper
from .output import Kept, Output
from .run import Drive, run
from .solution import Solution
from .state import AdaptiveState, State, check_sound

# What to write instead of keywords of other solvers.
_INSTEAD = {
    "t0": "Equation(..., t_start=t0) sets the start",
    "t_span": "Equation(..., t_start=...) sets the start, and solve(eq, t_end) the end",
    "y0": "Equation(terms, rhs, y0) has it",
    "args": "Equation(..., params=...) has them",
    "jac": "Equation(..., jac=...) has it",
    "method": "pass scheme=, e.g. scheme=hd.BDF(2)",
    "dense_output": "sol(t) is the dense output of every solution",
    "h": "pass n_steps, for steps of (t_end - t_start) / n_steps",
    "dt": "pass n_steps, for steps of (t_end - t_start) / n_steps",
}


@refusing(_INSTEAD)
def solve(
    equation: Equation,
    t_end: float,
    n_steps: int | None = None,
    *,
    rtol: float | None = None,
    atol: float | None = None,
    mesh: Graded | ArrayLike | None = None,
    scheme: Scheme | None = None,
    history: History | None = None,
    save_every: int = 1,
    t_eval: ArrayLike | None = None,
    components: ArrayLike | None = None,
    max_step: float | None = None,
    max_steps: int | None = None,
    breaks: ArrayLike = (),
    events: Callable | Sequence[Callable] = (),
    switches: Callable | Sequence[Callable] = (),
    changes: Mapping[float, Callable] | None = None,
    progress: bool = False,
    resume: State | AdaptiveState | None = None,
    allow_change: bool = False,
    params: ArrayLike | None = None,
    estimate: bool = True,
) -> Solution:
    r"""Solve an equation with memory up to t_end: adaptively, with uniform steps, or along a mesh.

    ``hd.solve(equation, t_end)`` keeps errors within rtol = 1e-6 by `Collocation`; with `n_steps`
    the paper's explicit scheme, of first order, takes that many steps.

    Parameters
    ----------
    equation : Equation
        What is solved.
    t_end : float
        End of the run, above the equation's t_start (the state's time when resuming) [time].
    n_steps : int
        Number of steps, h = (t_end - t_start) / n_steps. When resuming, the state's step is kept:
        leave it out, or give a number that agrees, counted either from 0 or from the state.
    rtol, atol : float, optional
        Tolerances of `Collocation`, which chooses its own steps: errors of a component stay about
        ``rtol * (|y| + 0.01 * size)``, size being the largest \|y| of that component so far. So
        the units of components do not matter. A component that begins at 0 has a size from what
        the right-hand side makes of it over the run (docs/collocation_method.md). With `atol`
        errors stay about ``atol + rtol * |y|`` instead. Errors of y', where the order exceeds 1,
        move y by as much over the run. rtol is 1e-6 by default and at least 1e-12; when resuming,
        both are the state's.
    mesh : Graded or array_like, shape (n+1,), optional
        Instead of n_steps: ``graded(n, exponent)`` or times that increase from t_start to t_end.
        For L2 with orders up to 1, L1 and L2Sigma with any, with Direct or SumOfExponentials. When
        resuming such a run, times from the state's on, or ``graded`` over what is left.
    scheme : Scheme, optional
        Default ``Collocation()``, or ``ExplicitCaputo()`` with `n_steps` or `mesh`; the state's
        when resuming without `rtol`.
    history : History, optional
        Default ``SumOfExponentials(tol=1e-10)``, the state's when resuming.
    save_every : int, optional
        Keep every so many-th step, besides the first and the last row.
    t_eval : array_like, shape (k,), optional
        Keep the solution at these increasing times instead, from the dense output. Given steps are
        joined by parabolas, to O(h**3) where the solution is smooth. In the first two steps of
        equations with constant orders powers of t take their place, t**alpha for each component's
        highest order among them: a row errs about as much as the nearest steps.
    components : array_like of int, shape (k,), optional
        Keep rows of these components of y alone, in this order and without dense output; events
        and the state have all of them.
    max_step : float, optional
        Longest step of `Collocation` [time]. A force that comes on for a time shorter than a step
        may lie between all points that the step looks at; half of its length is a safe choice.
    max_steps : int, optional
        Most steps of this call of `Collocation`, one million by default; a run that needs more ends
        with the status MAX_STEPS and can be resumed.
    breaks : array_like, shape (k,), optional
        Times at which the right-hand side jumps: each step sees the jump from its own side. With
        `rtol` the steps begin anew there; otherwise they must be times of steps, and on uniform
        steps every scheme is of first order from there on, for its memory keeps the corner.
    events : callable or sequence of callable, optional
        ``event(t, y)``, whose zeros are located to rounding on the dense output; with the
        attributes `terminal` (a number n: the run ends at the n-th zero) and `direction` as in
        SciPy's solve_ivp. Truth values count as 1 and -1. Nine points of each step of `Collocation`
        are looked at, and the ends of given steps: two zeros between neighbours pass unseen, unless
        steps are shorter, and so does a zero next to where the function is NaN. A zero at the very
        start is not reported. Given steps go on, when resumed, from the first one that is not
        before the event. The attribute ``change``, a function ``change(t, y)``, returns a new y,
        whose jump does not enter the memory; rows hold y before and after (docs/events.md).
    switches : callable or sequence of callable, optional
        ``switch(t, y)``, functions at whose changes of sign the right-hand side jumps, compiled as
        it is. They are located as events are, and the steps begin anew there, each seeing one side
        alone. Where both sides push the solution back the run ends as SLIDING.
    changes : mapping of float to callable, optional
        ``{time: change}`` with functions ``change(t, y)`` that return a new y, such as doses; as
        `change` of an event, at stated times above t_start. Those up to the state's time are over
        when resuming, those beyond t_end are left out.
    progress : bool, optional
        Show a progress bar with the time left, on a terminal only.
    resume : State, optional
        ``Solution.state`` of an earlier run of the same equation; rows then begin at its time. With
        uniform steps the result equals that of an unbroken run bit for bit, with `Collocation`
        within its tolerance.
    allow_change : bool, optional
        Go on with another right-hand side or other `params` than the state's, all of the memory
        kept: a force or a parameter is switched at the state's time.
    params : float or sequence of float, optional
        With `resume`: go on with these parameters instead of the equation's.
    estimate : bool, optional
        Estimate the error of a run with uniform steps of `ExplicitCaputo` or `GrunwaldLetnikov`,
        ``stats["error_estimate"]``, at 15 % more time.

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
    SolveWarning
        The run ended early, other than by a terminal event or Ctrl-C; or the error of a
        first-order run is estimated above 5 % of the solution's size.
    StabilityWarning
        One of these: the step exceeded the scheme's stability limit along the orbit, or the
        solution zigzags.

    Cost
    ----
    One right-hand side a step and the history's share: with the default history constant memory
    and about 20 ns a step and component besides `rhs` (convergence/memory_is_nearly_free.py). With
    `Collocation` some 10 to 50 microseconds a step, of which there are far fewer
    (convergence/collocation.py).

    Examples
    --------
    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.stick_slip(), t_end=100.0, n_steps=20_000)
    >>> sol.success, sol.y.shape
    (True, (20001, 1))
    """
    equation = instance(
        "equation", equation, Equation, "hereditary.Equation(terms, rhs, y0)"
    ).current()
    if params is not None:
        if resume is None:
            remedy = "equation.replace(params=...) makes an equation with others"
            raise ValueError(complaint("params", "come with resume", repr(params), remedy))
        equation, allow_change = equation.replace(params=params), True
    start = equation.frame.start
    t_last = run_end("t_end", t_end, start)
    t_end = t_last - start
    scheme = chosen_scheme(scheme, rtol, n_steps, mesh, resume)
    if history is not None:
        instance("history", history, History, "hereditary.SumOfExponentials()")
    begin = _begin(resume, scheme, allow_change, start, t_last)
    kept = _kept(equation, save_every, evaluation_times(t_eval, begin, t_last), components)
    breaks = checked_breaks(() if breaks is None else breaks, start)
    if start != 0 and not isinstance(mesh, Graded | None):
        mesh = real_array("mesh", mesh) - start
    functions, jumping = _listed(events), _listed(switches)
    began = time.perf_counter()
    system, hybrid = equation, None
    if jumping or changes or any(getattr(f, "change", None) is not None for f in functions):
        from ..hybrid import Hybrid  # a leaf that stands on this room

        hybrid = Hybrid(equation, scheme, functions, jumping, changes or {})
        system = hybrid.system
    how = how_to_step(
        system, scheme, t_end, resume, history=history, n_steps=n_steps, mesh=mesh,
        rtol=rtol, atol=atol, max_step=max_step, max_steps=max_steps,
    )  # fmt: skip
    stepper, stop = open_stepper(system, scheme, history, how, t_end, resume, allow_change)
    stepper.set_breaks(breaks, t_end)
    signs = {} if resume is None else resume.event_signs
    if hybrid:
        found = hybrid.open(stepper, t_end, breaks, signs)
    else:
        found = Events(map(equation.frame.event, functions), stepper, signs)
    output = Output(stepper, stop, kept, found)
    march = partial(hybrid.march, output) if hybrid else Drive.to
    solution = run(stepper, stop, t_last, output, progress, began, march)
    first_order = isinstance(scheme, (ExplicitCaputo, GrunwaldLetnikov)) and mesh is None
    if first_order and estimate and resume is None and not (hybrid or np.size(breaks)):
        note_error(solution, stepper, stop)
    return solution


def _begin(resume, scheme, allow_change, start, t_end):
    """Return the user's time at which a run to t_end begins: `start`, or that of a sound state."""
    if resume is None:
        if allow_change:
            remedy = "it allows another right-hand side than the state's"
            raise ValueError(complaint("allow_change", "come with resume", allow_change, remedy))
        return start
    kind = AdaptiveState if scheme.adaptive else State
    instance("resume", resume, kind, "the .state of an earlier Solution of the same kind")
    check_sound(resume)
    if t_end - start <= resume.t:
        raise ValueError(complaint("t_end", f"exceed the state's time {start + resume.t}", t_end))
    return start + resume.t


def _kept(equation, save_every, times, components):
    """Return what a run keeps, checked: `times` of rows, or every so many-th step."""
    save_every = min(count("save_every", whole(save_every)), COUNTED)
    if save_every > 1 and times is not None:
        required = "be left out where t_eval says which rows to keep"
        raise ValueError(complaint("save_every", required, save_every))
    if components is not None:
        if equation.frame.paired or equation.frame.speeds:
            required = "be left out for complex y and orders above 2"
            raise ValueError(complaint("components", required, shown(components)))
        components = component_numbers(components, equation.d)
    return Kept(save_every, times, components)


def _listed(functions):
    """Return a function, several or none as a tuple."""
    functions = () if functions is None else functions
    return tuple(functions) if isinstance(functions, (list, tuple)) else (functions,)


def run_end(name, t_end, start):
    """Return the end of a run, a number above its start."""
    if start == 0:
        return positive(name, t_end)
    number = real(name, t_end)
    if number <= start:
        raise ValueError(complaint(name, f"exceed t_start = {start:g}", number))
    return number


def chosen_scheme(scheme, rtol, n_steps, mesh, resume):
    """Return the scheme given, or the state's, or the default of the other arguments."""
    if scheme is not None:
        return instance("scheme", scheme, Scheme, "hereditary.ExplicitCaputo()")
    if isinstance(resume, AdaptiveState) or (isinstance(resume, State) and rtol is None):
        return resume.scheme
    by_steps = n_steps is not None or mesh is not None or resume is not None
    return ExplicitCaputo() if rtol is None and by_steps else Collocation()


def evaluation_times(t_eval, t_start, t_end):
    """Return the times of rows that are asked for, checked; None where none are."""
    if t_eval is None:
        return None
    times = np.atleast_1d(real_array("t_eval", t_eval))
    inside = f"be increasing times in [{t_start}, {t_end}]"
    if times.ndim != 1 or times.size == 0:
        raise ValueError(complaint("t_eval", inside, f"shape {times.shape}"))
    # times computed otherwise may miss the ends by rounding
    slack = 1e-12 * max(abs(t_start), abs(t_end))
    if (times[1:] <= times[:-1]).any() or times[0] < t_start - slack or times[-1] > t_end + slack:
        raise ValueError(complaint("t_eval", inside, shown(times)))
    return np.minimum(np.maximum(times, t_start), t_end)
