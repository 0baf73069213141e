"""Tables of errors against numbers of steps or tolerances, as papers print them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..equation.equation import Equation
from ..given.history.history import History
from ..solver.elsewhere import lacking
from ..solver.solution import Solution
from ..solver.solve import solve
from ..stepping.scheme import Scheme
from ..stepping.tolerance import TOLERANCE_FLOOR
from ..support.checks import count, real_array, refuse, shown, truth, whole

# Ratio of the tolerance of the run that others are compared with to their smallest one. With a
# tenth the errors of both would be of similar size.
_FINER = 0.01


@dataclass(frozen=True, eq=False)
class ConvergenceTable:
    """Errors of a scheme on one equation, with observed orders.

    Attributes
    ----------
    n_steps : ndarray of int, shape (k,)
    h : ndarray, shape (k,)
        Steps, with tolerances their mean [time].
    errors : ndarray, shape (k,)
        Largest error of any component, in units of y.
    orders : ndarray, shape (k-1,)
        Observed order between neighbours, ``log(e_i / e_(i+1)) / log(N_(i+1) / N_i)``. With
        tolerances it is ``log(e_i / e_(i+1)) / log(rtol_i / rtol_(i+1))``, which is 1 if errors are
        proportional to them.
    slope : float
        Least-squares order over all of them.
    by : str
        How errors were found.
    rtol : ndarray, shape (k,), or None
        Tolerances, if they were given in place of numbers of steps.
    """

    n_steps: np.ndarray
    h: np.ndarray
    errors: np.ndarray
    orders: np.ndarray
    slope: float
    by: str
    rtol: np.ndarray | None = None

    @property
    def _heads(self) -> tuple[str, ...]:
        return (
            ("N", "h", "error", "order") if self.rtol is None else ("rtol", "N", "error", "order")
        )

    def _cells(self) -> list[tuple[str, ...]]:
        orders = ["", *(f"{p:.2f}" for p in self.orders)]
        errors, steps = [f"{e:.3e}" for e in self.errors], [str(n) for n in self.n_steps]
        if self.rtol is not None:
            return list(zip([f"{r:.3g}" for r in self.rtol], steps, errors, orders, strict=True))
        return list(zip(steps, [f"{h:.4g}" for h in self.h], errors, orders, strict=True))

    def to_markdown(self) -> str:
        """Return the table in Markdown."""
        rows = [self._heads, ("---:",) * len(self._heads), *self._cells()]
        return "\n".join("| " + " | ".join(row) + " |" for row in rows)

    def to_latex(self) -> str:
        """Return the table as a tabular environment of LaTeX, with booktabs' rules."""
        heads = "$N$ & $h$ & error & order" if self.rtol is None else "rtol & $N$ & error & order"
        rows = [" & ".join(row) + r" \\" for row in self._cells()]
        lines = [r"\begin{tabular}{rrrr}", r"\toprule", heads + r" \\", r"\midrule", *rows]
        return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"])

    def __repr__(self) -> str:
        rows = [self._heads, *self._cells()]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(map(str.rjust, row, widths)) for row in rows]
        return "\n".join([*lines, f"order {self.slope:.2f} over all; {self.by}"])


@lacking()
def convergence_table(
    equation: Equation,
    t_end: float,
    n_steps: ArrayLike | None = None,
    *,
    rtol: ArrayLike | None = None,
    scheme: Scheme | None = None,
    history: History | None = None,
    breaks: ArrayLike = (),
    exact: Callable | None = None,
    at_end: bool = False,
) -> ConvergenceTable:
    """Measure errors of a scheme at several numbers of steps or tolerances, and its order.

    Parameters
    ----------
    equation : Equation
    t_end : float
        End of the runs [time].
    n_steps : sequence of int, shape (k,)
        Increasing numbers of uniform steps, k >= 2.
    rtol : sequence of float, shape (k,)
        Decreasing tolerances of `Collocation`, in place of numbers of steps.
    scheme, history, breaks : optional
        As in `solve`.
    exact : callable, optional
        ``exact(t)``: the solution at times (n,), shape (n, d), as in `hereditary.exact`. By default
        errors are found by Runge's rule. Each run is compared with one of twice as many steps. The
        difference is divided by ``1 - 2**-p``, with the order p that the differences show. Runs to
        a tolerance are compared with one to a hundredth of the smallest tolerance, or 1e-12.
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
    The runs; with Runge's rule three times as much, with tolerances one run more.

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
    if (n_steps is None) == (rtol is None):
        required, got = "be given, one of the two", "neither" if rtol is None else "both"
        refuse("n_steps or rtol", required, got)
    shared: dict[str, Any] = {"scheme": scheme, "history": history, "breaks": breaks}

    def run(**steps: Any) -> Solution:
        solution = solve(equation, t_end, estimate=False, **shared, **steps)
        if not solution.success:
            ((name, value),) = steps.items()
            said = f"{value} steps" if name == "n_steps" else f"rtol = {value:g}"
            raise RuntimeError(f"{said}: {solution.message}")
        return solution

    at_end, reference, by = truth("at_end", at_end), exact, "errors against the exact solution"
    tolerances = None if rtol is None else _decreasing(rtol)
    if tolerances is None:
        asked: list[dict[str, Any]] = [{"n_steps": n} for n in _increasing(n_steps)]
    else:
        asked = [{"rtol": each} for each in tolerances.tolist()]
        if reference is None:
            finest = max(_FINER * float(tolerances[-1]), TOLERANCE_FLOOR)
            if tolerances[-1] <= finest:
                required = (
                    f"exceed {finest:g}, the tolerance of the run that others are compared with"
                )
                refuse("rtol", required, shown(tolerances), "leave it out, or give exact")
            reference, by = run(rtol=finest), f"errors against a run with rtol = {finest:g}"
    numbers, errors = [], []
    for steps in asked:
        solution = run(**steps)
        numbers.append(solution.stats["n_steps"])
        t, y = (solution.t[-1:], solution.y[-1:]) if at_end else (solution.t, solution.y)
        if reference is None:
            true = run(n_steps=2 * numbers[-1]).y[::2][-len(y) :]
        else:
            true = np.asarray(reference(t))
        if true.shape != y.shape:
            required = f"return shape (n, {y.shape[1]}) for times (n,)"
            refuse("exact", required, f"shape {true.shape} for n = {len(y)}")
        errors.append(float(np.abs(y - true).max()))
    if not min(errors) > 0:
        name, remedy = ("n_steps", "fewer steps") if rtol is None else ("rtol", "larger ones")
        refuse(name, "leave errors above 0", shown(errors), f"take {remedy}")
    orders, slope = observed_order(numbers if tolerances is None else 1 / tolerances, errors)
    if reference is None:
        by = "errors by Runge's rule"
        errors = [error / (1 - 2.0**-slope) for error in errors] if slope > 0 else errors
    h = (t_end - equation.t_start) / np.array(numbers)
    return ConvergenceTable(np.array(numbers), h, np.array(errors), orders, slope, by, tolerances)


def _increasing(n_steps: Any) -> list[int]:
    """Return numbers of steps, checked."""
    numbers = [count("n_steps", whole(n)) for n in np.atleast_1d(np.asarray(n_steps)).tolist()]
    if len(numbers) < 2 or any(b <= a for a, b in pairwise(numbers)):
        refuse("n_steps", "be two or more increasing numbers", numbers)
    return numbers


def _decreasing(rtol: ArrayLike) -> np.ndarray:
    """Return tolerances, checked, (k,)."""
    tolerances = np.atleast_1d(real_array("rtol", rtol))
    if tolerances.ndim != 1 or tolerances.size < 2 or np.any(np.diff(tolerances) >= 0):
        refuse("rtol", "be two or more decreasing tolerances", shown(tolerances))
    return tolerances


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
