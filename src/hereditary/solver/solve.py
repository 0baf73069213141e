"""The function `solve`: it checks the arguments, opens a stepper and starts the run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..collocation.method import Collocation
from ..equation.equation import Equation, current_equation
from ..given.history.history import History
from ..given.schemes.explicit import ExplicitCaputo
from ..given.steps import COUNTED, Graded
from ..stepping.scheme import Scheme
from ..stepping.state import State, check_sound
from ..stepping.times import checked_breaks
from ..support import checks
from .accuracy import Provenance
from .opening import chooses_steps, how_to_step
from .output import Kept
from .problem import Problem
from .solution import Solution

CHANGES = "map times to functions change(t, y), e.g. {12.0: dose}"
# For keywords of other solvers, what a message says to write instead.
OF_OTHERS = {
    "t0": "Equation(..., t_start=t0) sets the start",
    "t_span": "Equation(..., t_start=...) sets the start, and t_end the end",
    "y0": "Equation(terms, rhs, y0) has it",
    "args": "Equation(..., params=args) has them",
    "jac": "Equation(..., jac=...) has it",
    "dense_output": "sol(t) is the dense output of every solution",
    "method": "pass scheme=, e.g. scheme=hd.BDF(2)",
    "first_step": "the first step is chosen by the tolerance, or is that of n_steps",
    "h": "pass n_steps, for steps of (t_end - t_start) / n_steps",
    "dt": "pass n_steps, for steps of (t_end - t_start) / n_steps",
}


@checks.refusing(OF_OTHERS | {"args": "pass params="})
def solve(
    equation: Equation,
    t_end: float,
    n_steps: int | None = None,
    *,
    rtol: float | None = None,
    atol: float | ArrayLike | None = None,
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
    resume: State | None = None,
    allow_change: bool = False,
    params: ArrayLike | None = None,
    estimate: bool = True,
) -> Solution:
    r"""Solve an equation with memory from its start to t_end.

    There are three ways to choose the steps:

    - ``rtol``: `Collocation` chooses them, so that errors stay below a tolerance. The default, with
      rtol = 1e-6. Start with it.
    - ``n_steps``: that many equal steps of `scheme`. The default scheme is the explicit one of the
      paper, of first order.
    - ``mesh``: the given steps, with a scheme that takes meshes.

    Parameters
    ----------
    equation : Equation
        The equation to solve.
    t_end : float
        End of the run, above the equation's t_start (the state's time when resuming) [time].
    n_steps : int
        Number of steps, h = (t_end - t_start) / n_steps. A resumed run keeps the state's step:
        leave n_steps out, or give a number that agrees, counted either from 0 or from the state.
    rtol : float, optional
        Tolerance of `Collocation`, which chooses its own steps: errors of a component stay about
        ``rtol * (|y| + 0.01 * size)``. The size is the largest \|y| so far of that component, at
        least a millionth of what others could make of it during the run. If the order exceeds 1,
        errors of y' stay so small that they move y by as much over the run. The default is 1e-6,
        and the least value 1e-12. A resumed run has the state's, and refuses another.
    atol : float or array_like, shape (d,), optional
        Errors stay about ``atol + rtol * |y|`` instead; one number or one for each component. A
        resumed run has the state's, and refuses another.
    mesh : Graded or array_like, shape (n+1,), optional
        ``graded(n, exponent)``, or times that increase from t_start to t_end. `L1` and `L2Sigma`
        take meshes with any order, `L2` with orders up to 1; histories are `Direct` and
        `SumOfExponentials`. A resumed run takes times from the state's on, or ``graded`` over the
        rest.
    scheme : Scheme, optional
        Default ``Collocation()``, or ``ExplicitCaputo()`` with `n_steps` or `mesh`. A run resumed
        without `rtol` keeps the state's.
    history : History, optional
        Default ``SumOfExponentials(tol=1e-10)``; a resumed run keeps the state's.
    save_every : int, optional
        Keep the first row, the last one, and the row of every `save_every`-th step.
    t_eval : array_like, shape (k,), optional
        Keep the solution at these increasing times instead, from the dense output.
    components : array_like of int, shape (k,), optional
        Keep only these components of y, in this order and without dense output. Events and the
        state still have all components.
    max_step : float, optional
        Longest step of `Collocation` [time]. A step may miss a force that acts for a shorter time
        than the step. If the run finds such a force, it warns. Half of the time for which the force
        acts is a safe choice. A resumed run has the state's by default.
    max_steps : int, optional
        Largest number of steps of `Collocation` in this call, by default one million or, when
        resuming, the state's number. A run that needs more ends with the status `max_steps` and can
        be resumed.
    breaks : array_like, shape (k,), optional
        Times at which the right-hand side jumps. `Collocation` restarts its steps there. Given
        steps must include these times. On uniform steps every scheme is of first order after a
        break, because the corner remains in the memory.
    events : callable or sequence of callable, optional
        Functions ``event(t, y)`` whose zeros are located to rounding on the dense output; truth
        values count as 1 and -1. ``event(t, y, memory)`` gets what delays read, as `rhs` does, if
        `memory=` has delays alone. Attributes of the function, as in SciPy's solve_ivp:
        `direction`, and `terminal`, a number n if the run ends at the n-th zero. The attribute
        ``change`` is a function ``change(t, y)`` that returns a new y. Its jump does not enter the
        memory, and rows contain y before and after (docs/events.md).
    switches : callable or sequence of callable, optional
        Functions ``switch(t, y)`` at whose changes of sign the right-hand side jumps. They are
        compiled, and their zeros are located as those of events. Steps restart there, and each step
        evaluates the right-hand side on one side of the jump only. If both sides push the solution
        back, a run by `rtol` keeps it there, within the tolerance (docs/friction.md). A run on
        given steps ends with the status `sliding`.
    changes : mapping of float to callable, optional
        ``{time: change}`` with functions ``change(t, y)`` that return a new y, such as doses, at
        times above t_start. A resumed run ignores times up to the state's. Times beyond t_end are
        ignored.
    progress : bool, optional
        Show a progress bar with the time left, on a terminal only.
    resume : State, optional
        ``Solution.state`` of an earlier run of the same equation. Rows then begin at its time. With
        uniform steps the result equals that of an unbroken run bit for bit; with `Collocation`
        within its tolerance.
    allow_change : bool, optional
        With `resume`: allow another right-hand side or other `params` than the state's. The whole
        memory is kept.
    params : float or sequence of float, optional
        Solve with these parameters instead of the equation's, as with
        ``equation.replace(params=...)``. With `resume` the run continues with them, and the whole
        memory is kept.
    estimate : bool, optional
        Estimate the error of a run on given steps, ``stats["error_estimate"]``, by a run of
        `Collocation` to 1e-4 (docs/step.md). It calls the functions of the user again, also changes
        of y.

    Returns
    -------
    Solution
        It has the rows computed so far, also if the run fails or Ctrl-C interrupts it:

        - ``sol.t``, shape (n,), and ``sol.y``, shape (n, d): times, and a row of y for each.
        - ``sol.ydot``, shape (n, d): y', if the highest order exceeds 1; otherwise None.
        - ``sol(t)``, shape (d,) or (k, d): y at any time or times; ``sol(t, 1)``: y'.
        - ``sol.success``, ``sol.status``, ``sol.message``: how the run ended; see `Status`.
        - ``sol.t_events``, ``sol.y_events``: times (k,) and rows (k, d) of each event function.
        - ``sol.stats``: a dict with counts, times and the error estimate.
        - ``sol.check()``: the errors, from another run that is more accurate.
        - ``sol.state``: what ``resume=`` takes.

    Raises
    ------
    TypeError, ValueError
        An argument is not as required; nothing has been run.
    KeyboardInterrupt
        Ctrl-C came when the run had just reached its end, or during the estimate of its error. The
        finished run is the attribute `result` of the exception.

    Warns
    -----
    SolveWarning
        The run ended early, but not by a terminal event or Ctrl-C. Or the estimated error of given
        steps is above 5 % of the solution's size. Or given steps do not resolve the solution. Or
        steps of `Collocation` miss a force that acts for a short time.
    StabilityWarning
        The step exceeded the scheme's stability limit along the orbit, or the solution zigzags.

    Notes
    -----
    Tolerance: the unit of y does not matter. A component keeps the tolerance while its ratio to the
    largest one is above 1e-8, and rtol times this ratio is above 1e-14 (docs/theory.md).

    Rows at `t_eval`: with given steps parabolas interpolate the solution, with an error of O(h**3)
    if it is smooth. In the first two steps of equations with constant orders powers of t
    interpolate it instead, among them t**alpha with each component's highest order. The error of a
    row is about that of the nearest steps.

    Events: `Collocation` evaluates them at nine points of each step, and given steps at their ends.
    Two zeros between neighbouring points are not found, nor is a zero next to a NaN. A zero at the
    very start is not reported. A resumed run with given steps starts at the first step that is not
    before the event.

    Cost
    ----
    Given steps: each has one evaluation of the right-hand side. The default history takes about 20
    ns more for each component, and constant storage (convergence/memory_is_nearly_free.py). The
    estimate takes 1 to 3 ms for a few components (convergence/estimates.py). It is
    given up when it takes longer than the run, and longer than 50 ms.
    `Collocation`: about 10 to 50 microseconds a step, but far fewer steps
    (convergence/collocation.py).

    Examples
    --------
    A tolerance; the solution at the end and at any time:

    >>> import hereditary as hd
    >>> terms = hd.Caputo(1.8) + 0.25 * hd.Caputo(0.8)
    >>> eq = hd.Equation(terms, lambda t, x: -x, y0=[1.0, 0.0])
    >>> sol = hd.solve(eq, 20.0, rtol=1e-8)
    >>> sol.success, sol.y[-1].round(6), sol([5.0, 10.0, 15.0]).shape
    (True, array([0.005973]), (3, 1))

    Fixed steps, here of a scheme of second order:

    >>> steps = hd.solve(eq, 20.0, n_steps=20_000, scheme=hd.BDF(2))
    >>> steps.t.shape, bool(abs(steps.y[-1] - sol.y[-1]).max() < 1e-7)
    ((20001,), True)

    An event; the times at which x crosses 0:

    >>> sol = hd.solve(eq, 10.0, rtol=1e-8, events=lambda t, x: x[0])
    >>> sol.t_events[0].round(4)
    array([1.7438, 4.9368, 8.2598])
    """
    equation, allow_change = current_equation(equation), checks.truth("allow_change", allow_change)
    if params is not None:
        equation = equation.replace(params=params)
        allow_change = allow_change if resume is None else True
    start = equation.t_start
    t_last = run_end("t_end", t_end, start)
    estimate = checks.truth("estimate", estimate)
    scheme = chosen_scheme(scheme, rtol, n_steps, mesh, resume)
    begin = _begin(resume, scheme, allow_change, start, t_last)
    kept = _kept(equation, save_every, evaluation_times(t_eval, begin, t_last), components)
    breaks = checked_breaks(() if breaks is None else breaks, start)
    if start != 0 and not isinstance(mesh, Graded | None):
        mesh = checks.real_array("mesh", mesh) - start
    functions, jumping = listed(events), listed(switches)
    changes = {} if changes is None else checks.mapping("changes", changes, CHANGES)
    problem = Problem(equation.system, t_last, breaks, functions, jumping, changes)
    policy = how_to_step(
        equation.system, scheme, t_last - start, resume, history=history,
        n_steps=n_steps, mesh=mesh, rtol=rtol, atol=atol, max_step=max_step, max_steps=max_steps,
    )  # fmt: skip
    solved = problem.solved(scheme, policy, kept, history, resume, allow_change, progress)
    provenance = Provenance(problem, scheme, kept.components, solved.jumps, resume, allow_change)
    solution = solved.solution
    object.__setattr__(solution, "provenance", provenance)  # it is new: nobody else has it yet
    if not estimate:
        return solution
    return provenance.with_error(solved)


def _begin(
    resume: State | None, scheme: Scheme, allow_change: bool, start: float, t_end: float
) -> float:
    """Return the user's time at which a run to t_end begins; refuse a state that does not fit."""
    if resume is None:
        if allow_change:
            remedy = "it allows another right-hand side than the state's"
            checks.refuse("allow_change", "come with resume", allow_change, remedy)
        return start
    checks.instance("resume", resume, State, "the .state of an earlier Solution")
    if chooses_steps(resume.scheme) != chooses_steps(scheme):
        required = "come from a run by a tolerance if it goes on by one, or else on given steps"
        checks.refuse("resume", required, f"one with {resume.scheme!r} for {scheme!r}")
    check_sound(resume)
    if t_end - start <= resume.t:
        checks.refuse("t_end", f"exceed the state's time {start + resume.t}", t_end)
    return start + resume.t


def _kept(equation: Equation, save_every: Any, times: np.ndarray | None, components: Any) -> Kept:
    """Check the arguments on output; return which rows and components the run keeps."""
    save_every = min(checks.count("save_every", checks.whole(save_every)), COUNTED)
    if save_every > 1 and times is not None:
        checks.refuse("save_every", "be left out if t_eval names the rows to keep", save_every)
    return Kept(save_every, times, kept_components(equation, components))


def kept_components(equation: Equation, components: Any) -> np.ndarray | None:
    """Check `components` and return it as an array of numbers of components; None if it is None."""
    if components is None:
        return None
    if equation.system.frame.paired or equation.system.frame.speeds:
        checks.refuse(
            "components", "be left out for complex y and orders above 2", checks.shown(components)
        )
    return checks.component_numbers(components, equation.d)


def listed(functions: Any) -> tuple:
    """Return an argument as a tuple of functions: it may be one, several or None."""
    functions = () if functions is None else functions
    return tuple(functions) if isinstance(functions, (list, tuple)) else (functions,)


def run_end(name: str, t_end: Any, start: float) -> float:
    """Check that the end of a run is a number above its start; return it as a float."""
    span = isinstance(t_end, (list, tuple, np.ndarray))
    remedy = "hd.solve_ivp takes a span; here Equation(..., t_start=...) sets its start"
    if start == 0:
        return checks.positive(name, t_end, remedy if span else "")
    number = checks.real(name, t_end, remedy=remedy if span else "")
    if number <= start:
        checks.refuse(name, f"exceed t_start = {start:g}", number)
    return number


def chosen_scheme(scheme: Any, rtol: Any, n_steps: Any, mesh: Any, resume: Any) -> Scheme:
    """Return the given scheme, else that of the state, else the default for the other arguments."""
    if scheme is not None:
        return checks.instance("scheme", scheme, Scheme, "hereditary.ExplicitCaputo()")
    if isinstance(resume, State) and (rtol is None or chooses_steps(resume.scheme)):
        return resume.scheme
    by_steps = n_steps is not None or mesh is not None or resume is not None
    return _EXPLICIT if rtol is None and by_steps else _COLLOCATION


# Scheme of runs on given steps for which none is given.
_EXPLICIT = ExplicitCaputo()
# Scheme of runs by a tolerance for which none is given.
_COLLOCATION = Collocation()


def evaluation_times(t_eval: Any, t_start: float, t_end: float) -> np.ndarray | None:
    """Check `t_eval` and return it as an array of times in the run; None if it is None."""
    if t_eval is None:
        return None
    times = np.atleast_1d(checks.real_array("t_eval", t_eval))
    inside = f"be increasing times in [{t_start}, {t_end}]"
    if times.ndim != 1 or times.size == 0:
        checks.refuse("t_eval", inside, f"shape {times.shape}")
    # times that the user computed may miss the ends of the run by rounding
    slack = 1e-12 * max(abs(t_start), abs(t_end))
    if (times[1:] <= times[:-1]).any() or times[0] < t_start - slack or times[-1] > t_end + slack:
        checks.refuse("t_eval", inside, checks.shown(times))
    return np.minimum(np.maximum(times, t_start), t_end)
