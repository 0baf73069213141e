"""Pieces of dense output: the solution on collocation steps."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre as leg

from ..solver.dense import Piece, last_start
from .power_basis import PowerBasis
from .quadrature import polynomial_integrals, through_start

# Distance at which the slope at 0 is evaluated, and size beyond which it is infinite.
_NEXT_TO_0, _STEEP = 1e-200, 1e12


@dataclass(frozen=True, eq=False)
class PowerPiece(Piece):
    """Dense output on the step of a singular start, in a power basis.

    Attributes
    ----------
    start, length : float
    basis : PowerBasis
    values : ndarray, shape (3, d, n)
        f, p and y at the nodes.
    means : ndarray, shape (d, n)
        Means of p from the start to the nodes.
    at_start : ndarray, shape (d,)
        y at the start.
    """

    start: float
    length: float
    basis: PowerBasis
    values: np.ndarray
    means: np.ndarray
    at_start: np.ndarray

    def edges(self):
        """Return the start of the step, (1,)."""
        return np.array([self.start])

    def evaluate(self, t, second, derivative):
        """Return y, or y' for ``derivative=1``, at times t inside the step, (k, d)."""
        u = np.clip((t - self.start) / self.length, 0.0, 1.0)
        _, p, y = self.values
        if not derivative:
            # y is the integral of p where p is y', also near the start, where y' may jump
            position = (
                self.at_start + self.length * u[:, None] * self.basis.interpolate(self.means, u).T
            )
            return np.where(second, position, self.basis.interpolate(y, u).T)
        speeds = self.basis.interpolate(p, u).T
        if second.all():
            return speeds
        # powers below 1 with a nonzero coefficient are infinitely steep at 0
        with np.errstate(over="ignore"):  # slopes may overflow
            slopes = self.basis.slopes(np.maximum(u, _NEXT_TO_0)) @ p.T / self.length
        steep = (u[:, None] == 0.0) & (np.abs(slopes) > _STEEP)
        return np.where(second, speeds, np.where(steep, np.copysign(np.inf, slopes), slopes))

    def at_ends(self, ends, chosen, second, slopes=True):
        """As `evaluate_both`, at the end of the step, if it is chosen."""
        _, p, y = self.values[..., -1]
        position, steep = self.at_start + self.length * self.means[:, -1], np.nan
        if slopes and not np.all(second):
            steep = self.values[1] @ self.basis.slopes_at_end / self.length
        found = np.where(second, position, y), np.where(second, p, steep)
        return tuple(row[None][chosen] for row in found)


@dataclass(frozen=True, eq=False)
class PolynomialPieces(Piece):
    """Dense output on n consecutive ordinary steps.

    Attributes
    ----------
    starts, lengths : ndarray, shape (n,)
    rows : ndarray, shape (n, d, s)
        p at the nodes.
    at_starts : ndarray, shape (n, 2, d)
        y and then p at the starts.
    """

    starts: np.ndarray
    lengths: np.ndarray
    rows: np.ndarray
    at_starts: np.ndarray

    def edges(self):
        """Return the start of each step, (n,)."""
        return self.starts

    def evaluate(self, t, second, derivative):
        """Return y, or y' for ``derivative=1``, at times t inside the steps, (k, d)."""
        i = np.clip(last_start(self.starts, t), 0, self.starts.size - 1)
        s = self.rows.shape[2]
        u = np.clip((t - self.starts[i]) / self.lengths[i], 0.0, 1.0)
        rows, h = self.rows[i], self.lengths[i, None]
        # polynomial through p at the start and at the nodes
        values = np.concatenate([self.at_starts[i, 1, :, None], rows], axis=2)
        coefficients = values @ through_start(s).T
        if derivative:
            slopes = np.einsum("kdj,kj->kd", coefficients, _slopes(u, s)) / h
            return np.where(second, np.einsum("kdj,kj->kd", coefficients, _values(u, s)), slopes)
        p = np.einsum("kdj,kj->kd", coefficients, _values(u, s))
        if not second.any():
            return p
        # integral of the polynomial through the nodes alone, so that y is continuous
        position = h * np.einsum("kdj,kj->kd", rows, polynomial_integrals(s, 1.0, u))
        return np.where(second, self.at_starts[i, 0] + position, p)

    def at_ends(self, ends, chosen, second, slopes=True):
        """As `evaluate_both`, at the chosen ones of the steps' ends."""
        rows, h = self.rows[chosen], self.lengths[chosen, None]
        p, s = rows[:, :, -1], self.rows.shape[2]
        of_start, of_rows, integral = _end_weights(s)
        slopes = (self.at_starts[chosen, 1] * of_start + rows @ of_rows) / h
        if not second.any():
            return p, slopes
        position = self.at_starts[chosen, 0] + h * (rows @ integral)
        return np.where(second, position, p), np.where(second, p, slopes)


@lru_cache(maxsize=16)
def _end_weights(s):
    """Return weights for the end of a step of length 1, of p at the start and at the nodes.

    Weights of the slope there: a number and (s,); and of the integral, (s,).
    """
    end = np.ones(1)
    slope = (_slopes(end, s) @ through_start(s))[0]
    return slope[0], slope[1:], polynomial_integrals(s, 1.0, end)[0]


def _values(u, s):
    """Return the shifted Legendre polynomials P_0 .. P_s at u, (k, s + 1)."""
    return leg.legvander(2 * u - 1, s)


def _slopes(u, s):
    """Return the derivatives in u of the shifted Legendre polynomials P_0 .. P_s, (k, s + 1)."""
    return np.array([2 * leg.legval(2 * u - 1, leg.legder(row)) for row in np.eye(s + 1)]).T
