"""`scipy.integrate.solve_ivp` with memory: the same call, with orders as well."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .collocation.method import Collocation
from .equation.equation import Equation
from .equation.operators import Caputo
from .solver.elsewhere import OF_SOLVE
from .solver.solution import Solution
from .solver.solve import evaluation_times, solve
from .stepping.status import Status
from .support.checks import one_of, real_array, refuse, refuse_masked, shown, truth

# SciPy's names of methods, which all mean adaptive collocation here.
_METHODS = "RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA", "Collocation"
# SciPy's further options: their defaults, which are accepted, and what to do about other values.
_UNKNOWN = {
    "vectorized": (False, "fun is compiled and called at one point at a time"),
    "first_step": (None, "the first step is chosen by the tolerance"),
    "min_step": (0, "a run that needs shorter steps ends with a message"),
    "jac_sparsity": (None, "hereditary.Equation(..., jac_sparsity=) takes it"),
    "lband": (None, "hereditary.Equation(..., bandwidth=) takes it"),
    "uband": (None, "hereditary.Equation(..., bandwidth=) takes it"),
}


def solve_ivp(
    fun: Callable,
    t_span: Sequence[float],
    y0: ArrayLike,
    method: str = "Collocation",
    t_eval: ArrayLike | None = None,
    dense_output: bool = False,
    events: Callable | Sequence[Callable] | None = None,
    args: Sequence | None = None,
    *,
    order: ArrayLike = 1.0,
    rtol: float = 1e-3,
    atol: ArrayLike = 1e-6,
    max_step: float | None = np.inf,
    jac: Any = None,
    **options: Any,
) -> Any:
    r"""Solve ``D^order y = fun(t, y)`` by the call and with the result of SciPy's `solve_ivp`.

    A script that solves ordinary differential equations with SciPy changes one line: the
    import. `order` then replaces y' by Caputo's derivative. `solve` has more: kernels, several
    terms, given steps, resumed runs.

    Parameters
    ----------
    fun : callable
        ``fun(t, y, *args)`` returning shape (n,); compiled with numba if that is possible.
    t_span : (float, float)
        Start and end; the end lies after the start [time].
    y0 : array_like, shape (n,), or (2, n) with an order above 1
        y, and y' in the second row, at the start.
    method : str, optional
        Any name that SciPy takes; all mean `Collocation`, which suits stiff equations too.
    t_eval : array_like, shape (k,), optional
        Times of the result; by default those of the steps.
    dense_output : bool, optional
        Whether the result has `sol`.
    events : callable or list of callable, optional
        ``event(t, y, *args)`` with SciPy's attributes `terminal` and `direction`. A zero at the
        very start is no event.
    args : tuple, optional
        Further arguments of `fun`, `jac` and events. They are constants of the compiled function:
        for many values make one `Equation` with `params`.
    order : float or array_like of shape (n,), optional
        Order of Caputo's derivative, in (0, 2], one for all or one for each component [-].
    rtol : float, optional
        Errors of y stay about ``atol + rtol * |y|``; rtol is at least 1e-12.
    atol : float or array_like of shape (n,), optional
        See rtol; one number for all components, or one for each.
    max_step : float, optional
        Longest step [time]; None for no limit, as infinity.
    jac : callable or matrix of shape (n, n), optional
        ``jac(t, y, *args)`` returning d fun / d y, shape (n, n); or the matrix itself if it is
        constant, an array or SciPy's sparse matrix.
    **options
        SciPy's further options at their defaults: ``vectorized=False``, ``first_step=None``.

    Returns
    -------
    OptimizeResult
        Its fields are those of SciPy's function: t (k,), y (n, k), nfev, message and success. `sol`
        is None, or a function of times that returns shape (n,) or (n, k). `t_events` and
        `y_events` are None, or lists with an array for each event. `status` is 0 if the end was
        reached, 1 after a terminal event, and -1 if the run failed. `njev` and `nlu` are None,
        because `Collocation` does not count Jacobians and factorisations.

    Raises
    ------
    TypeError, ValueError
        An argument is not as required; nothing has been run.

    Error
    -----
    Within the tolerance for right-hand sides that are smooth in t and y, also where the solution
    starts like t**order (see `Collocation`).

    Examples
    --------
    >>> import hereditary as hd
    >>> def spring(t, y, friction):
    ...     return [y[1], -friction * y[1] - y[0]]
    >>> classical = hd.solve_ivp(spring, (0, 10), [1.0, 0.0], args=(0.1,), rtol=1e-8)
    >>> hereditary = hd.solve_ivp(spring, (0, 10), [1.0, 0.0], args=(0.1,), rtol=1e-8, order=0.9)
    >>> [round(float(sol.y[0, -1]), 4) for sol in (classical, hereditary)]
    [-0.5292, -0.1111]
    """
    for name, value in options.items():
        where = (
            "hereditary.solve takes it" if name in OF_SOLVE else "see help(hereditary.solve_ivp)"
        )
        default, remedy = _UNKNOWN.get(name, (..., where))
        if not (value is default or (np.isscalar(value) and value == default)):
            refuse(name, "be left out of solve_ivp", repr(value), remedy, kind=TypeError)
    one_of("method", method, _METHODS, f"be one of {', '.join(_METHODS)}")
    span = real_array("t_span", t_span, "be (start, end)")
    if span.shape != (2,) or not span[0] < span[1]:
        required = "be (start, end) with the start before the end"
        remedy = "an equation with memory has no solution before its start"
        refuse("t_span", required, shown(span), remedy)
    more, dense_output = _further(args), truth("dense_output", dense_output)
    listed = () if events is None else events if isinstance(events, (list, tuple)) else (events,)
    start, end = span.tolist()
    slopes = jac if jac is None else _with(jac, more) if callable(jac) else _constant(jac)
    equation = Equation(Caputo(order), _with(fun, more), y0, jac=slopes, t_start=start)
    times = evaluation_times(t_eval, start, end)
    solution = solve(
        equation,
        end,
        rtol=rtol,
        atol=atol,
        scheme=Collocation(),
        t_eval=None if dense_output else times,
        max_step=None if np.isscalar(max_step) and max_step == np.inf else max_step,
        events=[_with(event, more) for event in listed],
    )
    rows = solution.t, solution.y
    if dense_output and times is not None:
        times = times[times <= solution.t[-1]]
        stepped = solution.stats["n_steps"] > 0  # otherwise only the start is known
        rows = times, solution(times) if stepped else solution.y[: times.size]
    return _result(solution, *rows, dense_output, bool(listed))


def _further(args: Any) -> tuple:
    """Return further arguments as a tuple; refuse anything but sequences, as SciPy does."""
    if args is None:
        return ()
    refuse_masked("args", args, "hold no masked entries")
    if not isinstance(args, (list, tuple)) and np.ndim(args) == 0:
        required, remedy = "be a sequence of further arguments", "write args=(value,) for one"
        refuse("args", required, repr(args), remedy, kind=TypeError)
    return tuple(args)


def _constant(jac: Any) -> Any:
    """Return a function of t and y with this matrix, dense or sparse, as its value."""
    required = "be a function jac(t, y, *args), or a matrix of shape (n, n)"
    matrix = real_array("jac", jac.toarray() if hasattr(jac, "toarray") else jac, required)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        refuse("jac", required, f"shape {matrix.shape}")

    def constant(t: float, y: np.ndarray) -> Any:
        return matrix

    return constant


def _with(fun: Any, more: tuple) -> Any:
    """Return a function of t and y that adds `more` arguments, with the attributes of `fun`."""
    if not more:
        return fun

    def of_t_and_y(t: float, y: np.ndarray) -> Any:
        return fun(t, y, *more)

    of_t_and_y.__name__ = getattr(fun, "__name__", repr(fun))
    vars(of_t_and_y).update(getattr(fun, "__dict__", {}))
    return of_t_and_y


class _Interpolant:
    """The dense output of a solution, with a column for each time."""

    def __init__(self, solution: Solution) -> None:
        self._solution = solution

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Return y at a time (n,), or at times (n, k)."""
        return self._solution(t).T


def _result(solution: Any, times: Any, values: Any, dense_output: bool, has_events: bool) -> Any:
    """Return a `Solution`, with rows at these times, as SciPy's `solve_ivp` returns one."""
    from scipy.optimize import OptimizeResult  # takes long to import

    status = {Status.COMPLETED: 0, Status.EVENT: 1}.get(solution.status, -1)
    return OptimizeResult(
        t=times,
        y=values.T,
        sol=_Interpolant(solution) if dense_output else None,
        t_events=solution.t_events if has_events else None,
        y_events=[rows if rows.size else np.empty(0) for rows in solution.y_events]
        if has_events
        else None,
        nfev=solution.stats["n_rhs"],
        njev=None,
        nlu=None,
        status=status,
        message=solution.message,
        success=status >= 0,
    )
