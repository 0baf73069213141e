"""Derivatives of a solution by differences of runs of changed equations."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from typing import Any

import numpy as np

from ..collocation.algebraic import settled
from ..compiled.jacobian import LEAST
from ..equation.equation import Equation
from ..equation.statement import factors_of, left_side
from ..equation.system import leading_orders
from ..solver.accuracy import no_estimates
from ..solver.opening import chooses_steps
from ..solver.progress import ProgressBar
from ..solver.solution import Solution
from ..solver.solve import solve
from ..stepping.status import Status
from ..support.checks import refuse
from ..support.warning import silence

# Change of an order in differences of runs on given steps.
_ORDER_BY_STEPS = 1e-5
# Relative change of every other number, and of an order in differences of runs by a tolerance. Next
# to the error of these runs, 1e-12, the error of a central difference is smallest with it.
_MIN_RELATIVE_CHANGE = 1e-4
# Largest tolerances of the runs, the next one where a run does not complete. Sums of delays leave
# rounded kinks that rtol 1e-11 resolves in vain for orders below 0.4.
_TIGHT = 1e-11, 1e-9
# Tolerance of the last of these runs if the user gives none, as in `solve`.
_DEFAULT = 1e-6
# Errors of runs by a tolerance, as a fraction of it: those of a step.
_RUN_ERROR = 0.1
# Largest change of y by a relative change of 1 that needs no smaller change.
_MAX_SENSITIVITY = 10.0
# Errors of central differences that the errors of runs leave, as a multiple of the square of the
# relative change. On the equations of tests/analysis/test_sensitivity.py it is at most 4.
_OF_CHANGE = 10.0
# Most changes that are tried for one number. Twice is enough where y is nearly linear in it.
_TRIALS = 5
# Factor of the next change where a run ends early.
_SHRUNK = 1e-2


class RunDifferences:
    """Runs of an equation and of its neighbours, and their differences."""

    def __init__(
        self, equation: Equation, t_last: float, times: np.ndarray, arguments: dict[str, Any],
        bar: ProgressBar, n_numbers: int,
    ) -> None:  # fmt: skip
        # t_last: the user's time; times (n,): of the rows; arguments: of `solve`; n_numbers: how
        # many derivatives are requested, for the bar; `change`: of a number, relative
        self._equation, self._t_last, self._times = equation, t_last, times
        self._of_solve, self._bar, bar.parts = arguments, bar, 1 + 2 * n_numbers
        self._made, self._bend = 0, 0.0
        self._tries: list[dict[str, Any]] = [{}]
        if chooses_steps(arguments["scheme"]):
            wanted = arguments["rtol"] or _DEFAULT
            tight = [{"rtol": rtol, "atol": None} for rtol in _TIGHT if rtol < wanted]
            self._tries = [*tight, {"rtol": wanted}]
        self._ask(self._tries[0])

    def _ask(self, tolerances: dict[str, Any]) -> None:
        """Let runs have these tolerances in place of the user's."""
        self._arguments = self._of_solve | {"estimate": False} | tolerances
        self.change = max(
            _MIN_RELATIVE_CHANGE, float(np.cbrt(_RUN_ERROR * (self._arguments["rtol"] or 0.0)))
        )

    def run(self) -> Solution:
        """Return the run of the equation itself, to the first tolerance with which it completes."""
        # if none does, it is the first one with the most rows
        tried: list[tuple[Solution, dict[str, Any]]] = []
        for tolerances in self._tries:
            self._ask(tolerances)
            with silence() if tolerances is not self._tries[-1] else nullcontext():
                tried.append((self._solved(self._equation), tolerances))
            if tried[-1][0].success:
                break
        solution, tolerances = max(tried, key=lambda pair: (pair[0].success, len(pair[0].y)))
        self._ask(tolerances)
        self._times, self._rows = solution.t, solution.y
        sizes = np.abs(solution.y).max(axis=0, initial=0.0)
        sizes = np.maximum(sizes, np.abs(self._equation._initial.given[0]))
        span, system = self._t_last - self._equation.t_start, self._equation.system
        units = system.frame.values(system.units(span))[: sizes.size]
        self._sizes = np.where(sizes > 0, sizes, np.maximum(units.real, units.imag))
        slopes = np.zeros(1) if solution.ydot is None else np.nan_to_num(np.abs(solution.ydot))
        self._rates = np.maximum(slopes.max(axis=0, initial=0.0) / self._sizes, 1 / span)
        return solution

    @property
    def error(self) -> float:
        """Errors of derivatives by parameters and y0, as a fraction of their largest size."""
        # If the second difference of y is b times the first one, the third is about b**2 times it.
        # This is the error that the change leaves. It is 1 where y bends more than it changes.
        return max(_OF_CHANGE * self.change**2, self._bend**2)

    def by_params(self) -> np.ndarray:
        """Return derivatives by the parameters, (n, d, p)."""
        params = self._equation.params

        def moved(k: int, by: float) -> Equation:
            return self._equation.replace(params=params + by * (np.arange(params.size) == k))

        sizes = np.where(params == 0, 1.0, np.abs(params)).tolist()
        return np.stack([self._by(partial(moved, k), size) for k, size in enumerate(sizes)], axis=2)

    def by_y0(self) -> np.ndarray:
        """Return derivatives by the initial values, (n, d, n_data)."""
        equation, y0 = self._equation, self._equation._initial.given
        real, factor = y0.view(float), 2 if equation.system.frame.paired else 1

        def moved(row: int, column: int, by: float) -> Equation:
            values = y0.copy()
            values.view(float)[row, column] += by
            return equation.replace(y0=values)

        derivatives = []
        for row, column in initial_data(equation):
            c = column // factor
            size = max(self._sizes[c] * self._rates[c] ** row, abs(real[row, column]))
            derivatives.append(self._by(partial(moved, row, column), float(size)))
        return np.stack(derivatives, axis=2)

    def _by(self, moved: Callable[[float], Equation], size: float) -> np.ndarray:
        """Return derivatives of y by a number of this size, (n, d); ``moved(by)`` changes it."""
        # the change is smaller where y would change by more than itself
        by = self.change * size
        for _ in range(_TRIALS):
            above = self._moved_rows(moved, by)
            effect = np.max(np.abs(above - self._rows) / self._sizes, initial=0.0)
            if effect <= _MAX_SENSITIVITY * self.change:
                break
            by *= self.change / effect if np.isfinite(effect) else _SHRUNK
        else:
            above = self._moved_rows(moved, by)
        below = self._moved_rows(moved, -by)
        bend, twice = above - 2 * self._rows + below, above - below
        parts = (np.nanmax(np.abs(each) / self._sizes, initial=LEAST) for each in (bend, twice))
        ratio = next(parts) / next(parts)
        self._bend = max(self._bend, min(float(ratio), 1.0))
        return twice / (2 * by)

    def by_orders(self, n: int | None = None) -> np.ndarray:
        """Return derivatives by the orders of all terms at the first n times, (n, d, n_terms)."""
        self._times = self._times[:n]
        self._made = max(self._made, 1)  # tangents count as a run
        by_tolerance = chooses_steps(self._arguments["scheme"])
        change = self.change if by_tolerance else _ORDER_BY_STEPS

        def moved(k: int, by: float) -> Equation:
            terms = list(self._equation.terms)
            operator = terms[k].operator
            other = type(operator)(np.asarray(operator.order) + by)
            terms[k] = other * terms[k].coefficient
            return self._equation.replace(terms=terms)

        derivatives = []
        for k, term in enumerate(self._equation.terms):
            order = np.atleast_1d(term.operator.order)
            up = np.ceil(order)
            sides = [s for s in (1, -1) if np.all(np.ceil(order + 2 * s * change) == up)]
            if not sides:
                refuse("orders of a term", "lie on one side of 1 and of 2, by 2e-4", order.tolist())
            side = sides[0]  # one side is of second order too
            weights = {0: -1.5 * side, side: 2.0 * side, 2 * side: -0.5 * side}
            weights = {1: 0.5, -1: -0.5} if len(sides) == 2 else weights
            rows = [w * self._moved_rows(partial(moved, k), s * change) for s, w in weights.items()]
            derivatives.append(sum(rows) / change)
        return np.stack(derivatives, axis=2)

    def _moved_rows(self, moved: Callable[[float], Equation], by: float) -> np.ndarray:
        """Return rows (n, d) of a changed equation; NaN after the end of its run."""
        paired = self._equation.system.frame.paired
        d = self._equation._initial.given.shape[1]
        rows = np.full((self._times.size, d), np.nan, complex if paired else float)
        if not self._times.size:
            return rows
        with silence():
            try:
                equation = _consistent(moved(by))
            except ValueError:  # the changed number lies outside of a domain
                return rows
            solution = self._solved(equation)
        rows[: len(solution.y)] = solution.y
        return rows

    def _solved(self, equation: Equation) -> Solution:
        with no_estimates():
            solution = solve(equation, self._t_last, t_eval=self._times, **self._arguments)
        self._made += 1
        self._bar.update(min(self._made, self._bar.parts))
        if solution.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        return solution


def initial_data(equation: Equation) -> list[tuple[int, int]]:
    """Return rows and real columns of y0 that the equation needs: y(0), y'(0), and so on."""
    y0, paired = equation._initial.given, equation.system.frame.paired
    factors = factors_of(equation.terms, y0.shape[1], paired)
    left = left_side(equation.terms, factors, equation.orders, equation.t_start)
    highest = leading_orders(left, y0.view(float).shape[1])
    return [
        (k, c) for k in range(len(y0)) for c in np.flatnonzero((k == 0) | (highest > k)).tolist()
    ]


def _consistent(equation: Equation) -> Equation:
    """Return an equation whose initial values satisfy its algebraic rows."""
    system = equation.system
    if not system.algebraic.any():
        return equation
    y0 = equation._initial.given.copy()
    consistent = settled(system, system.beside(0.0, 1), system.at_start)[: system.n_solved]
    y0[0] = system.frame.values(consistent)
    return equation.replace(y0=y0)
