"""Pieces of dense output: the solution on collocation steps."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre as leg

from ..solver.dense import last_start
from .power_basis import PowerBasis
from .quadrature import polynomial_integrals, through_start

# The slope at 0 is taken here, and called infinite beyond this size.
_NEXT_TO_0, _STEEP = 1e-200, 1e12


@dataclass(frozen=True, eq=False)
class PowerPiece:
    """A step of functions in a power basis.

    Attributes
    ----------
    start, length : float
    basis : PowerBasis
    values : ndarray, shape (3, d, n)
        f, p and y at its nodes.
    means : ndarray, shape (d, n)
        Means of p from the start to the nodes.
    begin : ndarray, shape (d,)
        y at the start.
    """

    start: float
    length: float
    basis: PowerBasis
    values: np.ndarray
    means: np.ndarray
    begin: np.ndarray

    def edges(self):
        """Start of each step, here one."""
        return np.array([self.start])

    def evaluate(self, t, second, derivative):
        """y or y' at times t inside the step, shape (k, d)."""
        u = np.clip((t - self.start) / self.length, 0.0, 1.0)
        _, p, y = self.values
        if not derivative:
            # where y' is the unknown y is its integral, also next to the start, where y' may jump
            risen = self.begin + self.length * u[:, None] * self.basis.interpolate(self.means, u).T
            return np.where(second, risen, self.basis.interpolate(y, u).T)
        speeds = self.basis.interpolate(p, u).T
        if second.all():
            return speeds
        # powers below 1 are infinitely steep at 0, all but those whose coefficients vanish
        with np.errstate(over="ignore"):  # they may be steeper than any float
            slopes = self.basis.slopes(np.maximum(u, _NEXT_TO_0)) @ p.T / self.length
        steep = (u[:, None] == 0.0) & (np.abs(slopes) > _STEEP)
        return np.where(second, speeds, np.where(steep, np.copysign(np.inf, slopes), slopes))


@dataclass(frozen=True, eq=False)
class PolynomialPieces:
    """Consecutive steps: starts and lengths (k,), p at the nodes (k, d, s), y and p at the starts.

    `begins` (k, 2, d) holds first y, then p.
    """

    starts: np.ndarray
    lengths: np.ndarray
    rows: np.ndarray
    begins: np.ndarray

    def edges(self):
        """Start of each step."""
        return self.starts

    def evaluate(self, t, second, derivative):
        """y or y' at times t inside the steps, shape (k, d)."""
        i = np.clip(last_start(self.starts, t), 0, self.starts.size - 1)
        s = self.rows.shape[2]
        u = np.clip((t - self.starts[i]) / self.lengths[i], 0.0, 1.0)
        rows, h = self.rows[i], self.lengths[i, None]
        # p through its values at the start and at the nodes
        values = np.concatenate([self.begins[i, 1, :, None], rows], axis=2)
        coefficients = values @ through_start(s).T
        if derivative:
            slopes = np.einsum("kdj,kj->kd", coefficients, _slopes(u, s)) / h
            return np.where(second, np.einsum("kdj,kj->kd", coefficients, _values(u, s)), slopes)
        p = np.einsum("kdj,kj->kd", coefficients, _values(u, s))
        if not second.any():
            return p
        # the integral of the steps' own polynomials, so that y is continuous
        risen = h * np.einsum("kdj,kj->kd", rows, polynomial_integrals(s, 1.0, u))
        return np.where(second, self.begins[i, 0] + risen, p)


def _values(u, s):
    return leg.legvander(2 * u - 1, s)


def _slopes(u, s):
    """Derivatives of the shifted Legendre polynomials of degree 0 .. s."""
    return np.array([2 * leg.legval(2 * u - 1, leg.legder(row)) for row in np.eye(s + 1)]).T
