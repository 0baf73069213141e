"""Dense output (floor 4): the solution of collocation steps at any time."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre as leg

from .._checks import complaint, real_array, shown
from ..schemes.power_basis import PowerBasis
from ..schemes.quadrature import polynomial_integrals, through_start

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
        i = np.clip(_place(self.starts, t), 0, self.starts.size - 1)
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


def _place(starts, t):
    """The last that starts by each time, or the first of several that start at that very time.

    Steps next to a corner may be too short for its time to change.
    """
    last = np.searchsorted(starts, t, side="right") - 1
    first = np.searchsorted(starts, t, side="left")
    return np.where(first <= last, first, last)


def _values(u, s):
    return leg.legvander(2 * u - 1, s)


def _slopes(u, s):
    """Derivatives of the shifted Legendre polynomials of degree 0 .. s."""
    return np.array([2 * leg.legval(2 * u - 1, leg.legder(row)) for row in np.eye(s + 1)]).T


class Dense:
    """The solution at any time of a run, from the steps that made it.

    Parameters
    ----------
    second : ndarray of bool, shape (d,)
        Components whose first derivative was the unknown.
    """

    def __init__(self, second):
        self._second = np.asarray(second, dtype=bool)
        self._pieces: list = []
        self._starts: list[float] = []

    def add(self, piece, start):
        """Take in what follows from `start` on."""
        self._pieces.append(piece)
        self._starts.append(start)

    def __call__(self, t, derivative, end):
        """y, or y' for ``derivative=1``, at times t up to `end`; shape (d,) or (k, d)."""
        times = np.atleast_1d(real_array("t", t))
        if times.ndim > 1:
            required, remedy = "be a number or of shape (k,)", "pass t.ravel()"
            raise ValueError(complaint("t", required, f"shape {times.shape}", remedy))
        if not self._pieces:
            raise ValueError(complaint("t", "wait for a run that made a step", shown(times)))
        starts = np.array(self._starts)
        start = starts[0]
        if not np.all((times >= start) & (times <= end)):
            required = f"lie in [{start}, {end}]"
            raise ValueError(complaint("t", required, shown(times)))
        out = np.empty((times.size, self._second.size))
        where = _place(starts, times)
        for k in np.unique(where):
            chosen = where == k
            out[chosen] = self._pieces[k].evaluate(times[chosen], self._second, derivative)
        return out if np.ndim(t) else out[0]
