"""The solution inside the first two steps of a march that starts at 0.

There a component is ``x(0) + t x'(0) + a t**alpha`` plus powers of t that fit the scheme's values
at the ends of the steps. The highest order of the component is alpha; a follows from the equation
at 0. The powers are t**r in the first step, and t**r and t**(r+1) in the second. Here r is
min(1, 2 alpha) for alpha below 1, and 2 for alpha from 1 on.
"""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import rgamma

from ..equation.system import System

# Time at which the slope is evaluated instead of 0, where powers below 1 have no slope.
_TIME_NEXT_TO_0 = 1e-200
# Slope at `_TIME_NEXT_TO_0` above which the slope at 0 is returned as infinite.
_INFINITE_SLOPE = 1e12


def starting_steps(stepper: Any) -> FirstSteps | None:
    """Return the `FirstSteps` of a stepper that made at most one step; otherwise None."""
    # None also if orders vary, or if a derivative acts on y itself: the solution begins with lower
    # powers, which FirstSteps does not have
    system = stepper.system
    if stepper.n > 1 or not (system.constant and system.subtracts_start):
        return None
    return FirstSteps(system, stepper.steps.times(np.array([1.0, 2.0])))


class FirstSteps:
    """The solution inside the first two steps of a march that starts at 0; orders are constant."""

    def __init__(self, system: System, ends: np.ndarray) -> None:
        # ends (2,): times at which the two steps end
        self._system, self._start = system, system.y0[:, : system.n_solved]
        self.ends, self._values = np.asarray(ends, dtype=float), np.zeros((2, system.n_solved))
        functions = system.functions
        if functions.delays.rows.size or functions.switches.signs.size:
            self._powers  # noqa: B018  # by f at 0: later tables and sides give another f

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for pickling, without the system, whose functions cannot be pickled."""
        self._powers  # noqa: B018
        return vars(self) | {"_system": None}

    @cached_property
    def _powers(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """alpha, a and r of the module's docstring for each component, (d,)."""
        alpha = self._system.highest_orders()[: self._system.n_solved]
        more = np.where(alpha >= 1, 2.0, np.minimum(1.0, 2 * alpha))
        return alpha, _leading(self._system), more

    def end(self, n: int, y: np.ndarray) -> None:
        """Store y (d,), the solution at the end of step n, which is 1 or 2."""
        self._values[n - 1] = y

    def inside(self, n: int, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the solution and its slope, (k, d) each, at k times inside step n, 1 or 2."""
        t, ends = times[:, None], self.ends[:n, None]
        unit = ends[-1]
        missed = (self._values[:n] - self._known(ends)[0]).T  # (d, n)
        _, _, more = self._powers
        powers = more[:, None] + np.arange(n)  # (d, n)
        matrix = (ends.T / unit)[..., None] ** powers[:, None]  # (d, n, n)
        factors = np.linalg.solve(matrix, missed[..., None])[..., 0]
        y, slope = self._known(t)
        for k in range(n):
            y = y + factors[:, k] * (t / unit) ** powers[:, k]
            slope = slope + factors[:, k] * powers[:, k] / unit * (t / unit) ** (powers[:, k] - 1)
        return y, slope

    def near(self, n: int, t: np.ndarray, derivative: int) -> np.ndarray:
        """Return y or, if `derivative`, y' at times t (k,) inside step n, which is 1 or 2."""
        # y' is infinite at t = 0 where the solution has powers below 1
        y, slope = self.inside(n, np.maximum(t, _TIME_NEXT_TO_0))
        steep = (t[:, None] == 0.0) & (np.abs(slope) > _INFINITE_SLOPE)
        return np.where(steep, np.copysign(np.inf, slope), slope) if derivative else y

    def _known(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return ``x(0) + t x'(0) + a t**alpha``, and its slope, at times t (k, 1)."""
        y0, (alpha, lead, _) = self._start, self._powers
        speed = y0[1] if y0.shape[0] == 2 else 0.0
        y = y0[0] + t * speed + lead * t**alpha
        return y, speed + lead * alpha * t ** (alpha - 1)


def _leading(system: System) -> np.ndarray:
    """Return the factors a of t**alpha, (n_solved,); 0 if the right-hand side has no value at 0."""
    f, alpha = np.full(system.d, np.nan), system.highest_orders()
    with suppress(Exception):  # if the march needs f at 0, the march reports the exception
        f = system.rhs(0.0, system.at_start)
    if system.m == 2:
        f -= np.where(alpha > 1, system.coefficient(1.0), 0.0) * system.y0[1]
    lead = (f * rgamma(1 + alpha) / system.coefficient(alpha))[: system.n_solved]
    return np.where(np.isfinite(lead), lead, 0.0)
