"""The front door of the solver (floor 4): checks what is asked and hands it to a driver."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from .._checks import complaint, count, instance, positive, real_array, shown
from ..equation import Equation
from ..history.exponentials import SumOfExponentials
from ..history.history import History
from ..meshes import Graded
from ..schemes.collocation import Collocation
from ..schemes.explicit import ExplicitCaputo
from ..schemes.scheme import Scheme
from .adaptive import solve_adaptively
from .adaptive_stepper import AdaptiveState
from .solution import Solution
from .stepper import State
from .uniform import solve_on_steps


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
    breaks: ArrayLike = (),
    events: Callable | Sequence[Callable] = (),
    progress: bool = False,
    resume: State | AdaptiveState | None = None,
) -> Solution:
    """Solve an equation with memory on [0, t_end]: with uniform steps, along a mesh, or adaptively.

    Parameters
    ----------
    equation : Equation
        What is solved.
    t_end : float
        End of the run, above 0 (above the state's time when resuming) [time].
    n_steps : int
        Number of steps, h = t_end / n_steps. When resuming, the state's step is kept: leave it
        out, or give a number that agrees, counted either from 0 or from the state.
    rtol, atol : float, optional
        Tolerances of `Collocation`, which chooses its own steps: errors of y, and of y' where the
        order exceeds 1, stay about ``atol + rtol * size``. rtol is 1e-6 by default and at least
        1e-12, atol a hundredth of rtol.
    mesh : Graded or array_like, shape (n+1,), optional
        Instead of n_steps: ``graded(n, exponent)`` or times that increase from 0 to t_end. For L1,
        L2 and L2Sigma with orders up to 1 (L2Sigma also above), with Direct or SumOfExponentials;
        such a run cannot be resumed, its ``state`` is None.
    scheme : Scheme, optional
        Default ``ExplicitCaputo()``, or ``Collocation()`` where `rtol` is given.
    history : History, optional
        Default ``SumOfExponentials(tol=1e-10)``.
    save_every : int, optional
        Keep every so many-th step, besides the first and the last row.
    t_eval : array_like, shape (k,), optional
        Keep the solution at these increasing times instead: interpolated by parabolas between
        uniform steps, by lines on a mesh, from the dense output with `Collocation`.
    breaks : array_like, shape (k,), optional
        Times at which the right-hand side jumps, for `Collocation`: the steps begin anew there.
    events : callable or sequence of callable, optional
        ``event(t, y)``, whose zeros `Collocation` locates to rounding on its dense output; with the
        attributes `terminal` and `direction` as in SciPy's solve_ivp. A zero at the very start is
        not reported.
    progress : bool, optional
        Show a progress bar with the time left, on a terminal only.
    resume : State, optional
        ``Solution.state`` of an earlier run; rows then begin at its time. With uniform steps the
        result equals that of an unbroken run bit for bit, with `Collocation` within its tolerance.

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
    instance("equation", equation, Equation, "hereditary.Equation(terms, rhs, y0)")
    t_end = positive("t_end", t_end)
    if scheme is None:
        scheme = ExplicitCaputo() if rtol is None else Collocation()
    instance("scheme", scheme, Scheme, "hereditary.ExplicitCaputo()")
    if history is not None:
        instance("history", history, History, "hereditary.SumOfExponentials()")
    save_every = count("save_every", save_every)
    if save_every > 1 and t_eval is not None:
        required = "be left out where t_eval says which rows to keep"
        raise ValueError(complaint("save_every", required, save_every))
    if resume is not None:
        kind = AdaptiveState if isinstance(scheme, Collocation) else State
        instance("resume", resume, kind, "the .state of an earlier Solution of the same kind")
    times = _eval_times(t_eval, 0.0 if resume is None else resume.t, t_end)
    breaks = () if breaks is None else breaks
    events = () if events is None else events
    functions = tuple(events) if isinstance(events, (list, tuple)) else (events,)
    if isinstance(scheme, Collocation):
        _refuse("with Collocation, which chooses its steps", n_steps=n_steps, mesh=mesh)
        return solve_adaptively(
            equation, t_end, scheme, history, rtol, atol, save_every, times, breaks, functions,
            progress, resume,
        )  # fmt: skip
    given = {"breaks": breaks if np.size(breaks) else None, "events": functions or None}
    given |= {"rtol": rtol, "atol": atol}
    _refuse("or come with scheme=Collocation()", **given)
    return solve_on_steps(
        equation, t_end, n_steps, mesh, scheme, history or SumOfExponentials(), save_every, times,
        progress, resume,
    )  # fmt: skip


def _refuse(reason, **given):
    for name, value in given.items():
        if value is not None:
            raise ValueError(complaint(name, f"be left out {reason}", shown(value)))


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
