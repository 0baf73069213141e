"""Derivatives of a solution by parameters, initial values and orders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..equation.equation import Equation, current_equation
from ..given.history.history import History
from ..given.steps import UniformSteps, kept_steps
from ..solver.elsewhere import lacking
from ..solver.opening import chooses_steps, how_to_step, open_stepper
from ..solver.progress import Interruption, ProgressBar
from ..solver.run import Drive, reached_end, report
from ..solver.solve import chosen_scheme, evaluation_times, run_end
from ..stepping.scheme import Scheme
from ..stepping.status import Ending, Status
from ..stepping.times import checked_breaks
from ..support.checks import refuse
from .run_differences import RunDifferences, initial_data

_KINDS = ("params", "y0", "orders")


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """A solution and its derivatives.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times of the rows [time].
    y : ndarray, shape (n, d)
    by_params : ndarray, shape (n, d, p), or None
        Derivatives by the parameters.
    by_y0 : ndarray, shape (n, d, n_data), or None
        By y(0) of each component, then by y'(0) of each component of order above 1, and so on. A
        complex component has two columns, for its real and its imaginary part.
    by_orders : ndarray, shape (n, d, n_terms), or None
        By the orders of the terms, in their order.
    status : Status
        How the run ended; rows end there as well.
    message : str
        It also says whether derivatives are differences of runs, and their errors.
    """

    t: np.ndarray
    y: np.ndarray
    by_params: np.ndarray | None
    by_y0: np.ndarray | None
    by_orders: np.ndarray | None
    status: Status
    message: str

    def __repr__(self) -> str:
        kinds = {"params": self.by_params, "y0": self.by_y0, "orders": self.by_orders}
        by = ", ".join(kind for kind, values in kinds.items() if values is not None)
        rows = f"{len(self.t)} rows of {self.y.shape[1]} components"
        return f"Sensitivities(by {by}; {self.message}; {rows})"

    @property
    def success(self) -> bool:
        """Whether the run came to its end, inside the scheme's stability limit."""
        return self.status is Status.COMPLETED


@lacking(save_every="t_eval names the rows")
def sensitivities(
    equation: Equation,
    t_end: float,
    n_steps: int | None = None,
    *,
    wrt: str | Sequence[str] | None = None,
    t_eval: ArrayLike | None = None,
    rtol: float | None = None,
    atol: float | ArrayLike | None = None,
    scheme: Scheme | None = None,
    history: History | None = None,
    breaks: ArrayLike = (),
    max_step: float | None = None,
    progress: bool = False,
) -> Sensitivities:
    """Solve an equation with the derivatives of its solution by parameters, y0 and orders.

    The derivative s by a parameter p solves the linearised equation with a force. For one term it
    is ``D^alpha s = df/dy s + df/dp`` with s(0) = 0. Derivatives by y(0) solve it without the
    force. They are solved with the solution, by its scheme and steps and with the factors of its
    Newton method. Derivatives by orders are central differences of further runs, and one-sided next
    to an integer, which an order cannot cross.

    All derivatives are differences of runs where no tangents are possible, and `message` says so.
    These equations have delays, complex y, orders above 2, functions called in Python, or a matrix
    with rows of zeros. `IMEX` has no tangents either.

    Parameters
    ----------
    equation : Equation
        A past of a delay that is y0 by default moves with y0.
    t_end : float
        End of the run [time].
    n_steps : int, optional
        Number of steps; or `rtol`.
    wrt : str or sequence of str, optional
        "params", "y0", "orders", or several of them; by default y0, and params if there are any.
    t_eval : array_like, shape (n,), optional
        Times of the rows, by default the start and the end. With n_steps they are times of steps.
    rtol, atol, scheme, history, breaks, max_step, progress
        As in `solve`.

    Returns
    -------
    Sensitivities
        If the run ends early, also by Ctrl-C, it has the rows until then. Differences of runs do
        not return after Ctrl-C.

    Raises
    ------
    TypeError, ValueError
        An argument is not as required.

    Error
    -----
    With given steps, derivatives by params and y0 are those of the discrete solution to 1e-9, and
    converge with the order of the scheme. With `Collocation` their error is below rtol times their
    largest size so far, or 1e-9. Of a derivative by p that size is at least a tenth of y / p. The
    right-hand side is differentiated by differences in p, and in y without `jac`. Derivatives by
    orders have errors of 1e-7 of the solution; they are NaN if one of their runs ends early.

    Differences by params and y0 are central, over 1e-4 of a value, or less where y changes more.
    A parameter of 0 has the size 1, and an initial value has at least the size of y. Their errors
    are about 1e-7 of their largest size. With `Collocation` runs have rtol 1e-11 or, if that run
    does not complete, 1e-9, which leaves errors of 2e-6. `message` has the error, which is larger
    if the second difference shows that y bends.

    Cost
    ----
    One linearised equation of d components for each parameter and initial value; two runs for each
    order. Differences take two runs for each number.

    Examples
    --------
    >>> import hereditary as hd
    >>> eq = hd.Equation(hd.Caputo(1.0), lambda t, y, p: -p[0] * y, 2.0, params=[0.5])
    >>> found = hd.sensitivities(eq, 1.0, rtol=1e-10)
    >>> found.by_params[-1, 0].round(6).tolist(), found.by_y0[-1, 0].round(6).tolist()
    ([-1.213061], [0.606531])
    """
    equation = current_equation(equation)
    kinds = _kinds(wrt, equation)
    start = equation.t_start
    t_last = run_end("t_end", t_end, start)
    scheme = chosen_scheme(scheme, rtol, n_steps, None, None)
    times = evaluation_times(t_eval, start, t_last)
    times = np.array([start, t_last]) if times is None else times
    stepping = how_to_step(
        equation.system, scheme, t_last - start,
        history=history, n_steps=n_steps, rtol=rtol, atol=atol, max_step=max_step,
    )  # fmt: skip
    if isinstance(stepping, UniformSteps):  # times of steps may be given up to rounding
        kept_steps(times, stepping.h, start)
    arguments: dict[str, Any] = {
        "scheme": scheme, "history": history, "n_steps": n_steps, "rtol": rtol, "atol": atol,
        "max_step": max_step, "breaks": breaks,
    }  # fmt: skip
    reason, bar = obstacle(equation, scheme), ProgressBar(progress)
    counts = {"params": equation.params.size, "orders": len(equation.terms)}
    counts["y0"] = len(initial_data(equation)) if reason else 0
    by_runs = sum(counts[kind] for kind in kinds if reason or kind == "orders")
    runs = RunDifferences(equation, t_last, times, arguments, bar, by_runs)
    try:
        if reason:
            return _by_runs(runs, kinds, reason)
        return _by_tangents(equation, t_last, times, kinds, arguments, stepping, runs, bar)
    finally:
        bar.close()


def _by_runs(runs: RunDifferences, kinds: tuple[str, ...], reason: str) -> Sensitivities:
    """Return derivatives by differences of runs; `reason` says why there are no tangents."""
    found = runs.run()
    by = {kind: getattr(runs, f"by_{kind}")() if kind in kinds else None for kind in _KINDS}
    message = f"{found.message}; derivatives are differences of runs, because {reason}"
    message += f": their errors are about {runs.error:.0e} of their largest size"
    if any(each is not None and np.isnan(each).any() for each in by.values()):
        message += "; they are NaN where a run of a changed equation has no rows"
    by = {f"by_{kind}": each for kind, each in by.items()}
    return Sensitivities(t=found.t, y=found.y, status=found.status, message=message, **by)


def _by_tangents(
    equation: Equation, t_last: float, times: np.ndarray, kinds: tuple[str, ...],
    arguments: dict[str, Any], stepping: Any, runs: RunDifferences, bar: ProgressBar,
) -> Sensitivities:  # fmt: skip
    """Return derivatives that are solved with the solution; those by orders from `runs`."""
    scheme, history = arguments["scheme"], arguments["history"]
    start, size = equation.t_start, equation.params.size if "params" in kinds else 0
    system = replace(equation.system, by_params=size)
    n_data = system.n_solved + int(np.sum(system.above_one))
    directions = np.eye(n_data)[:, : n_data if "y0" in kinds else 0]
    directions = np.hstack([np.zeros((n_data, size)), directions])
    span = t_last - start
    stepper, _ = open_stepper(system, scheme, history, stepping, span, directions=directions)
    stepper.set_breaks(checked_breaks(arguments["breaks"], start), span)
    since, between, rows = times - start, chooses_steps(scheme), list[np.ndarray]()
    stops = [since[-1]] if between else kept_steps(times, stepping.h, start)
    if between:
        stepper.keep_tangents()
        rows += [_columns(stepper)] if since[0] == 0.0 else []

    def advance(stop: float) -> None:
        piece = stepper.advance(stop, keep=between)
        reached = int(np.searchsorted(since, stepper.t, side="right"))
        if piece is not None and reached > len(rows):
            rows.extend(piece.evaluate(since[len(rows) : reached], 0))

    ended = None
    with Interruption() as interruption:
        drive = Drive(stepper, stops[-1], advance, interruption, bar)
        for stop in stops:
            ended = ended or drive.to(stop)
            rows += [] if between or ended else [_columns(stepper)]
    ended = ended or Ending(reached_end(stepper.diagnostics))
    columns = np.array(rows).reshape(len(rows), 1 + directions.shape[1], equation.d)
    y, every = columns[:, 0], np.moveaxis(columns[:, 1:], 1, 2)
    by_orders = np.full((*y.shape, len(equation.terms)), np.nan) if "orders" in kinds else None
    if by_orders is not None and ended.status is not Status.INTERRUPTED:
        by_orders = runs.by_orders(len(y))
    return Sensitivities(
        t=times[: len(y)],
        y=y,
        by_params=every[..., :size] if "params" in kinds else None,
        by_y0=every[..., size:] if "y0" in kinds else None,
        by_orders=by_orders,
        status=ended.status,
        message=report(stepper, ended, stepper.diagnostics),
    )


def _columns(stepper: Any) -> np.ndarray:
    """Return y and its tangents, ((1 + k) d,)."""
    return np.vstack([stepper.y, stepper.tangent[: stepper.y.size].T]).ravel()


def _kinds(wrt: Any, equation: Equation) -> tuple[str, ...]:
    """Return which derivatives are requested; refuse equations that have none."""
    if wrt is None:
        wrt = ("params", "y0") if equation.params.size else ("y0",)
    kinds = tuple(wrt) if np.iterable(wrt) and not isinstance(wrt, str) else (wrt,)
    if not kinds or not all(isinstance(kind, str) and kind in _KINDS for kind in kinds):
        refuse("wrt", f"hold some of {', '.join(_KINDS)}", repr(wrt))
    if "params" in kinds and equation.params.size == 0:
        refuse("wrt", "leave out params, which the equation has none of", kinds)
    if "orders" in kinds and not equation.system.constant:
        refuse("wrt", "leave out orders if they vary or if kernels are general", kinds)
    return kinds


def obstacle(equation: Equation, scheme: Scheme) -> str:
    """Return why no tangents can be solved for, as a clause; "" if they can."""
    system, speeds = equation.system, equation.system.frame.speeds
    obstacles = {
        "the equation has delays, which tangents do not see": bool(system.delays),
        "y is complex": system.frame.paired,
        "an order exceeds 2": any(speed >= 0 for speed in speeds),
        "a matrix of coefficients has a row of zeros": bool(speeds),
        "a function is called in Python": bool(system.callbacks),
        f"{scheme!r} has no tangents": not scheme.takes_tangents,
    }
    return next((clause for clause, present in obstacles.items() if present), "")
