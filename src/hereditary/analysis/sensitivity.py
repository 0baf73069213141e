"""Derivatives of a solution by parameters, initial values and orders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..equation.equation import Equation, current_equation
from ..given.history.history import History
from ..given.steps import kept_steps
from ..solver.opening import chooses_steps, how_to_step, open_stepper
from ..solver.run import reached_end, report
from ..solver.solve import chosen_scheme, evaluation_times, run_end, solve
from ..stepping.scheme import Scheme
from ..stepping.status import Ending, Status
from ..stepping.times import checked_breaks
from ..support.checks import refuse
from ..support.warning import silence

_KINDS = ("params", "y0", "orders")
# Change of an order in differences of runs on given steps.
_BY_STEPS = 1e-5
# Change of an order in differences of runs by a tolerance.
_BY_TOLERANCE = 1e-4
# Largest tolerance of the runs whose differences give derivatives by an order.
_TIGHT = 1e-11


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
        By y(0) of each component, and then by y'(0) of each component of order above 1.
    by_orders : ndarray, shape (n, d, n_terms), or None
        By the orders of the terms, in their order.
    status : Status
        How the run ended; rows end there as well.
    message : str
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
) -> Sensitivities:
    """Solve an equation with the derivatives of its solution by parameters, y0 and orders.

    The derivative s by a parameter p solves the linearised equation with a force. For one term it
    is ``D^alpha s = df/dy s + df/dp`` with s(0) = 0. Derivatives by y(0) solve it without the
    force. They are solved with the solution, by its scheme and steps and with the factors of its
    Newton method. Derivatives by orders are central differences of further runs, and one-sided next
    to an integer, which an order cannot cross.

    Parameters
    ----------
    equation : Equation
        Of real y, orders up to 2 and compiled functions, without delays. A matrix of coefficients
        has no rows of zeros.
    t_end : float
        End of the run [time].
    n_steps : int, optional
        Number of steps; or `rtol`.
    wrt : str or sequence of str, optional
        "params", "y0", "orders", or several of them; by default y0, and params if there are any.
    t_eval : array_like, shape (n,), optional
        Times of the rows, by default the start and the end. With n_steps they are times of steps.
    rtol, atol, scheme, history, breaks
        As in `solve`.

    Returns
    -------
    Sensitivities
        If the run ends early, it has the rows until then.

    Raises
    ------
    TypeError, ValueError
        An argument is not as required, or the scheme does not take tangents.

    Error
    -----
    With given steps, derivatives by params and y0 are those of the discrete solution to 1e-9, and
    converge with the order of the scheme. With `Collocation` their error is below rtol times their
    largest size so far, or 1e-9. Of a derivative by p that size is at least a tenth of y / p. The
    right-hand side is differentiated by differences in p, and in y without `jac`. Derivatives by
    orders have errors of 1e-7 of the solution; they are NaN if one of their runs ends early.

    Cost
    ----
    One linearised equation of d components for each parameter and initial value; two runs for each
    order.

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
    how: dict[str, Any] = {"scheme": scheme, "history": history, "n_steps": n_steps}
    how |= {"rtol": rtol, "atol": atol}
    size = equation.params.size if "params" in kinds else 0
    system = replace(equation.system, by_params=size)
    n_data = system.n_solved + int(np.sum(system.second))
    directions = np.eye(n_data)[:, : n_data if "y0" in kinds else 0]
    directions = np.hstack([np.zeros((n_data, size)), directions])
    span = t_last - start
    stepping = how_to_step(system, t_end=span, **how)
    stepper, _ = open_stepper(system, scheme, history, stepping, span, directions=directions)
    stepper.set_breaks(checked_breaks(breaks, start), span)
    how["breaks"] = breaks
    if chooses_steps(scheme):
        rows = _between_steps(stepper, times - start)
    else:  # times of steps may be given up to rounding
        rows = _at_steps(stepper, kept_steps(times, stepping.h, start))
    ended = stepper.trouble or Ending(reached_end(stepper))
    message = report(stepper, ended)
    columns = np.array(rows).reshape(len(rows), 1 + directions.shape[1], equation.d)
    y, every = columns[:, 0], np.moveaxis(columns[:, 1:], 1, 2)
    by_orders = _by_orders(equation, t_last, times[: len(y)], how) if "orders" in kinds else None
    return Sensitivities(
        t=times[: len(y)],
        y=y,
        by_params=every[..., :size] if "params" in kinds else None,
        by_y0=every[..., size:] if "y0" in kinds else None,
        by_orders=by_orders,
        status=ended.status,
        message=message,
    )


def _at_steps(stepper: Any, stops: np.ndarray) -> list[np.ndarray]:
    """March to each of these steps; return rows of y and its tangents, ((1 + k) d,), there."""
    rows: list[np.ndarray] = []
    for stop in stops:
        while stepper.position < stop and not stepper.trouble:
            stepper.advance(stop, keep=False)
        if stepper.trouble:
            break
        rows.append(_columns(stepper))
    return rows


def _between_steps(stepper: Any, times: np.ndarray) -> list[np.ndarray]:
    """March by steps of a tolerance; return rows ((1 + k) d,) at times between."""
    stepper.keep_tangents()
    rows = [_columns(stepper)] if times[0] == 0.0 else []
    d = stepper.y.size
    second = np.tile(stepper.system.second, _columns(stepper).size // d)
    while stepper.position < times[-1] and not stepper.trouble:
        piece = stepper.advance(times[-1])
        if piece is None:
            continue
        reached = int(np.searchsorted(times, stepper.t, side="right"))
        if reached > len(rows):
            rows.extend(piece.evaluate(times[len(rows) : reached], second, 0))
    return rows


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
    if not has_tangents(equation):
        required = "be real and compiled, of orders up to 2, without delays and rows of zeros"
        refuse("equation", required, repr(equation), "or take differences")
    if "params" in kinds and equation.params.size == 0:
        refuse("wrt", "leave out params, which the equation has none of", kinds)
    if "orders" in kinds and not equation.system.constant:
        refuse("wrt", "leave out orders if they vary or if kernels are general", kinds)
    return kinds


def has_tangents(equation: Equation) -> bool:
    """Return whether derivatives by parameters and initial values can be solved for."""
    system = equation.system
    reads = system.callbacks or system.delays
    return not (system.frame.paired or system.frame.speeds or reads)


def _by_orders(
    equation: Equation, t_last: float, times: np.ndarray, how: dict[str, Any]
) -> np.ndarray:
    """Return derivatives by the orders of all terms, (n, d, n_terms), by differences of runs."""
    by_tolerance = chooses_steps(how["scheme"])
    change = _BY_TOLERANCE if by_tolerance else _BY_STEPS
    if by_tolerance:
        how = how | {"rtol": min(how["rtol"] or _TIGHT, _TIGHT), "atol": None}
    how = how | {"estimate": False}

    def run(k: int, by: float) -> np.ndarray:
        terms = list(equation.terms)
        operator = terms[k].operator
        moved = type(operator)(np.asarray(operator.order) + by)
        terms[k] = moved * terms[k].coefficient
        with silence():
            found = solve(equation.replace(terms=terms), t_last, t_eval=times, **how)
        rows = np.full((times.size, equation.d), np.nan)
        rows[: len(found.y)] = found.y
        return rows

    found = []
    for k, term in enumerate(equation.terms):
        order = np.atleast_1d(term.operator.order)
        sides = [s for s in (1, -1) if np.all(np.ceil(order + 2 * s * change) == np.ceil(order))]
        if not sides:
            refuse("orders of a term", "lie on one side of 1 and of 2, by 2e-4", order.tolist())
        side = sides[0]  # one side is of second order too
        weights = {0: -1.5 * side, side: 2.0 * side, 2 * side: -0.5 * side}
        weights = {1: 0.5, -1: -0.5} if len(sides) == 2 else weights
        found.append(sum(w * run(k, by * change) for by, w in weights.items()) / change)
    return np.moveaxis(np.array(found), 0, 2)
