"""Pieces of dense output: the solution on collocation steps.

Letters of shapes: d components, s or n nodes of a step, k times. The primary unknown p is y, or y'
for orders above 1; a piece's `above_one` (d,) is true for these components.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.polynomial.legendre import legder, legint

from ..compiled.delayed_values import JUMPED, LAST
from ..stepping.dense import Piece, last_start
from .first_rule import Variable, means_at_nodes
from .quadrature import legendre_values, through_start, to_legendre

# Smallest time at which slopes of the first step are evaluated, as fraction of the step.
_MIN_SLOPE_TIME = 1e-200
# Slopes at 0 are extrapolated from slopes at these times, as fractions of the step.
_TOWARDS_0 = (1e-4, 1e-2)
# A slope is infinite at 0 if it grows by more than this factor between these two times.
_INFINITE_SLOPE_GROWTH = 1.02
# Rounding error of a slope, as a fraction of the values over the step. Slopes below it do not count
# as growing.
_ROUNDING_OF_SLOPE = 1e-10


@dataclass(frozen=True, eq=False)
class FirstPiece(Piece):
    """Dense output on the first step after a singular start."""

    # p is a polynomial of degree n in the variable u, a power of time; row has p at the n nodes, y
    # and p (d,) are at the start of the step

    above_one: np.ndarray  # (d,)
    variable: Variable
    start: float  # [time]
    length: float  # [time]
    row: np.ndarray  # (d, n)
    y: np.ndarray
    p: np.ndarray

    def edges(self) -> np.ndarray:
        """Return the start time of the step, (1,)."""
        return np.array([self.start])

    def evaluate(self, t: np.ndarray, derivative: int) -> np.ndarray:
        """Return y, or y' for ``derivative=1``, at times t inside the step, (k, d)."""
        t = np.minimum(np.maximum((t - self.start) / self.length, 0.0), 1.0)
        with np.errstate(divide="ignore"):
            values = legendre_values(self._x(np.log(t)), self.variable.n).T
        if not derivative:
            p = self._first + self._change(self.row, values)
            p[t == 0.0] = self.p
            if not self.above_one.any():
                return p
            # y is the integral of p: t times the mean of p
            means = self._change(self.row @ means_at_nodes(self.variable).T, values) + self._first
            return np.where(self.above_one, self.y + self.length * t[:, None] * means, p)
        slopes = self._slopes(np.maximum(t, _MIN_SLOPE_TIME))
        if (t == 0.0).any():
            (near, far), (before, after) = _TOWARDS_0, self._slopes(np.array(_TOWARDS_0))
            line = before - near / (far - near) * (after - before)
            rounded = _ROUNDING_OF_SLOPE * np.abs(self.row).max(axis=1) / self.length
            steep = np.abs(before) > _INFINITE_SLOPE_GROWTH * np.abs(after) + rounded
            slopes[t == 0.0] = np.where(steep, np.copysign(np.inf, before), line)
        speeds = self._first + self._change(self.row, values)
        speeds[t == 0.0] = self.p
        return np.where(self.above_one, speeds, slopes)

    @cached_property
    def _first(self) -> np.ndarray:
        """Value of p at the start, or next to the start if p jumps there, (d,)."""
        found = self.row @ to_legendre(self.variable.n).T
        limit = found @ (-1.0) ** np.arange(self.variable.n)
        moved = np.abs(limit - self.p) > JUMPED * np.abs(found[:, -LAST:]).max(axis=1)
        return np.where(moved, limit, self.p)

    def at_ends(
        self, ends: np.ndarray, chosen: Any, slopes: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return y and y' at the end of the step, (1, d) each, or (0, d) if it is not `chosen`."""
        # without slopes, y' is NaN if it is not p
        p, n, above_one = self.row[:, -1], self.variable.n, self.above_one
        y, steep = p, np.nan
        if above_one.any():
            mean = self.row @ means_at_nodes(self.variable)[-1]
            y = np.where(above_one, self.y + self.length * mean, p)
        if slopes and not above_one.all():
            weights = _end_weights(n)[1] * (self.variable.slopes(np.ones(1)) / self.length)
            steep = (self.row - self._first[:, None]) @ weights
        return y[None][chosen], np.where(above_one, p, steep)[None][chosen]

    def _x(self, logs: np.ndarray) -> np.ndarray:
        """Return the argument 2 u - 1 of the polynomials at log(t)."""
        return 2 * np.minimum(self.variable.at(logs), 1.0) - 1

    def _change(self, row: np.ndarray, polynomials: np.ndarray) -> np.ndarray:
        """Return p minus its start, (k, d), from a row (d, n) and polynomials (k, n + 1)."""
        weights = (polynomials @ through_start(self.variable.n))[:, 1:]
        return weights @ (row - self._first[:, None]).T

    def _slopes(self, t: np.ndarray) -> np.ndarray:
        """Return the slopes of p at times t above 0, in units of 1 / length of the step, (k, d)."""
        n = self.variable.n
        values = legendre_values(self._x(np.log(t)), n - 1).T @ _derivatives(n)
        with np.errstate(over="ignore"):  # slopes next to a singular start may be infinite
            return self._change(self.row, values) * self.variable.slopes(t)[:, None] / self.length


@dataclass(frozen=True, eq=False)
class PolynomialPieces(Piece):
    """Dense output on n consecutive ordinary steps with s nodes."""

    above_one: np.ndarray  # (d,)
    starts: np.ndarray  # of each step, (n,) [time]
    lengths: np.ndarray  # (n,) [time]
    rows: np.ndarray  # p at the nodes, (n, d, s)
    at_starts: np.ndarray  # y and then p at the start, (n, 2, d)

    def edges(self) -> np.ndarray:
        """Return the start time of each step, (n,)."""
        return self.starts

    def evaluate(self, t: np.ndarray, derivative: int) -> np.ndarray:
        """Return y, or y' for ``derivative=1``, at times t inside the steps, (k, d)."""
        return self._at(self._places(t), derivative)

    def evaluate_both(self, t: np.ndarray, slopes: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return y and y' at times t inside the steps, (k, d) each; NaN for y' without `slopes`."""
        places = self._places(t)
        y = self._at(places, 0)
        return y, self._at(places, 1) if slopes else np.full_like(y, np.nan)

    def _places(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the steps of times t, (k,), their lengths (k, 1), and polynomials at t."""
        i = np.minimum(np.maximum(last_start(self.starts, t), 0), self.starts.size - 1)
        s, h = self.rows.shape[2], self.lengths[i]
        x = 2 * np.minimum(np.maximum((t - self.starts[i]) / h, 0.0), 1.0) - 1
        return i, h[:, None], legendre_values(x, s).T

    def _at(self, places: tuple[np.ndarray, np.ndarray, np.ndarray], derivative: int) -> np.ndarray:
        """Return y, or y' for ``derivative=1``, (k, d), at times that `_places` has located."""
        (i, h, values), above_one = places, self.above_one
        if not derivative and above_one.all():
            return self._positions(i, h, values)
        s = self.rows.shape[2]
        if derivative and not above_one.all():
            steep = self._weighted(i, values[:, :-1] @ _derivatives(s)) / h
            return np.where(above_one, self._weighted(i, values), steep)
        p = self._weighted(i, values)
        if derivative or not above_one.any():
            return p
        return np.where(above_one, self._positions(i, h, values), p)

    def _weighted(self, i: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """Return sums of Legendre coefficients of p in the steps i, (k, d), by weights."""
        # coefficients and weights (k, s + 1); p is the polynomial through its values at the start
        # and at the nodes
        weights = coefficients @ through_start(self.rows.shape[2])
        found = np.einsum("kdj,kj->kd", self.rows[i], weights[:, 1:])
        return found + self.at_starts[i, 1] * weights[:, :1]

    def _positions(self, i: np.ndarray, h: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return y in the steps i, (k, d), from Legendre polynomials at the times, (k, s + 1)."""
        # the integral of the polynomial through p at the nodes alone, so that y is continuous
        s = self.rows.shape[2]
        weights = values @ (_integrals(s) @ to_legendre(s))
        return self.at_starts[i, 0] + h * np.einsum("kdj,kj->kd", self.rows[i], weights)

    def at_ends(
        self, ends: np.ndarray, chosen: Any, slopes: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return y and y' at the chosen ends of steps."""
        rows, h, above_one = self.rows[chosen], self.lengths[chosen, None], self.above_one
        p, s, some = rows[:, :, -1], self.rows.shape[2], above_one.any()
        if not slopes and not some:
            return p, np.full(p.shape, np.nan)
        of_start, of_rows, integral = _end_weights(s)
        steep = (self.at_starts[chosen, 1] * of_start + rows @ of_rows) / h
        if not some:
            return p, steep
        position = self.at_starts[chosen, 0] + h * (rows @ integral)
        return np.where(above_one, position, p), np.where(above_one, p, steep)


@lru_cache(maxsize=16)
def _end_weights(s: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Return weights of p at start and nodes for slope and integral to the end of a step of 1."""
    # a number and (s,) for the slope at the end, (s,) for the integral
    slope = _derivatives(s).sum(axis=0) @ through_start(s)  # all polynomials are 1 at the end
    return slope[0], slope[1:], _integrals(s).sum(axis=0) @ to_legendre(s)


@lru_cache(maxsize=16)
def _derivatives(s: int) -> np.ndarray:
    """Return the derivatives of the shifted Legendre polynomials P_0 .. P_s, (s, s + 1)."""
    # column k: coefficients of the derivative of P_k in terms of P_0 .. P_(s-1)
    return 2 * legder(np.eye(s + 1))


@lru_cache(maxsize=16)
def _integrals(s: int) -> np.ndarray:
    """Return the integrals from 0 of shifted Legendre polynomials P_0 .. P_(s-1), (s + 1, s)."""
    # column k: coefficients of the integral of P_k in terms of P_0 .. P_s
    return legint(np.eye(s), lbnd=-1) / 2
