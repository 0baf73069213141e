"""Tables of errors against numbers of steps, as papers print them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from ..equation.equation import Equation
from ..given.history.history import History
from ..solver.solution import Solution
from ..solver.solve import solve
from ..stepping.scheme import Scheme
from ..support.checks import count, real_array, refuse, shown, truth, whole

_HEADS = "N", "h", "error", "order"


@dataclass(frozen=True, eq=False)
class ConvergenceTable:
    """Errors of a scheme on one equation, with observed orders.

    Attributes
    ----------
    n_steps : ndarray of int, shape (k,)
    h : ndarray, shape (k,)
        Steps [time].
    errors : ndarray, shape (k,)
        Largest error of any component, in units of y.
    orders : ndarray, shape (k-1,)
        Observed order between neighbours, ``log(e_i / e_(i+1)) / log(N_(i+1) / N_i)``.
    slope : float
        Least-squares order over all of them.
    by : str
        How errors were found.
    """

    n_steps: np.ndarray
    h: np.ndarray
    errors: np.ndarray
    orders: np.ndarray
    slope: float
    by: str

    def _cells(self) -> list[tuple[str, ...]]:
        orders = ["", *(f"{p:.2f}" for p in self.orders)]
        values = zip(self.n_steps, self.h, self.errors, orders, strict=True)
        return [(str(n), f"{h:.4g}", f"{e:.3e}", p) for n, h, e, p in values]

    def to_markdown(self) -> str:
        """Return the table in Markdown."""
        rows = [_HEADS, ("---:",) * len(_HEADS), *self._cells()]
        return "\n".join("| " + " | ".join(row) + " |" for row in rows)

    def to_latex(self) -> str:
        """Return the table as a tabular environment of LaTeX, with booktabs' rules."""
        heads = "$N$ & $h$ & error & order"
        rows = [" & ".join(row) + r" \\" for row in self._cells()]
        lines = [r"\begin{tabular}{rrrr}", r"\toprule", heads + r" \\", r"\midrule", *rows]
        return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"])

    def __repr__(self) -> str:
        rows = [_HEADS, *self._cells()]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(map(str.rjust, row, widths)) for row in rows]
        return "\n".join([*lines, f"order {self.slope:.2f} over all; {self.by}"])


def convergence_table(
    equation: Equation,
    t_end: float,
    n_steps: ArrayLike,
    *,
    scheme: Scheme | None = None,
    history: History | None = None,
    exact: Callable | None = None,
    at_end: bool = False,
) -> ConvergenceTable:
    """Measure errors of a scheme at several numbers of steps, and its observed order.

    Parameters
    ----------
    equation : Equation
    t_end : float
        End of the runs [time].
    n_steps : sequence of int, shape (k,)
        Increasing numbers of uniform steps, k >= 2.
    scheme, history : optional
        As in `solve`.
    exact : callable, optional
        ``exact(t)``: the solution at times (n,), shape (n, d), as in `hereditary.exact`. By default
        errors are found by Runge's rule. Each run is compared with one of twice as many steps. The
        difference is divided by ``1 - 2**-p``, with the order p that the differences show.
    at_end : bool, optional
        Errors at t_end instead of the largest ones at the times of all steps.

    Returns
    -------
    ConvergenceTable

    Raises
    ------
    RuntimeError
        A run did not complete: its message.

    Error
    -----
    At the end Runge's rule is exact to leading order if the error is one power of the step. If the
    orders of neighbours still change, it is a guess. If a solution starts like t**alpha, the
    largest error at all times is that of the first step. The rule overstates it by up to 2.5 times,
    but orders are right. At the level of rounding orders mean nothing.

    Cost
    ----
    The runs; with Runge's rule three times as much.

    Examples
    --------
    >>> import hereditary as hd
    >>> table = hd.convergence_table(hd.scenes.stick_slip(), 5.0, [500, 1000, 2000])
    >>> print(table.to_markdown())
    | N | h | error | order |
    | ---: | ---: | ---: | ---: |
    | 500 | 0.01 | 7.697e-02 |  |
    | 1000 | 0.005 | 3.989e-02 | 0.95 |
    | 2000 | 0.0025 | 2.067e-02 | 0.95 |
    """
    numbers = [count("n_steps", whole(n)) for n in np.atleast_1d(np.asarray(n_steps)).tolist()]
    if len(numbers) < 2 or any(b <= a for a, b in pairwise(numbers)):
        refuse("n_steps", "be two or more increasing numbers", numbers)

    def run(n: int) -> Solution:
        found = solve(equation, t_end, n, scheme=scheme, history=history, estimate=False)
        if not found.success:
            raise RuntimeError(f"{n} steps: {found.message}")
        return found

    errors = []
    at_end = truth("at_end", at_end)
    for n in numbers:
        found = run(n)
        t, y = (found.t[-1:], found.y[-1:]) if at_end else (found.t, found.y)
        known = run(2 * n).y[::2][-len(y) :] if exact is None else np.asarray(exact(t))
        if known.shape != y.shape:
            required = f"return shape (n, {y.shape[1]}) for times (n,)"
            refuse("exact", required, f"shape {known.shape} for n = {len(y)}")
        errors.append(float(np.abs(y - known).max()))
    if not min(errors) > 0:
        refuse("n_steps", "leave errors above 0", shown(errors), "take fewer steps")
    orders, slope = observed_order(numbers, errors)
    by = "errors against the exact solution"
    if exact is None:
        by = "errors by Runge's rule"
        errors = [error / (1 - 2.0**-slope) for error in errors] if slope > 0 else errors
    h = (t_end - equation.t_start) / np.array(numbers)
    return ConvergenceTable(np.array(numbers), h, np.array(errors), orders, slope, by)


def observed_order(n_steps: ArrayLike, errors: ArrayLike) -> tuple[np.ndarray, float]:
    """Return orders between neighbours, (k - 1,), and their least-squares order over all of them.

    Examples
    --------
    >>> from hereditary.analysis.convergence import observed_order
    >>> round(observed_order([100, 200, 400], [4e-2, 2e-2, 1e-2])[1], 12)
    1.0
    """
    n, e = np.log(real_array("n_steps", n_steps)), np.log(real_array("errors", errors))
    return -np.diff(e) / np.diff(n), -float(np.polyfit(n, e, 1)[0])
