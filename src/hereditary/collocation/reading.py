"""Memory terms that the right-hand side reads, as components of orders up to 1.

With leading order alpha, ``c D^alpha y + sum_l c_l D^(gamma_l) y = f(t, y, m)`` and F = D^alpha y:

- up to order 1, m = D^gamma y solves ``D^(alpha-gamma) m = F``;
- above, with v = y', ``D^(alpha-1) v = F``. The memory m = D^gamma y solves ``D^(1-gamma) m = v``
  for gamma below 1. It is v for gamma = 1, and solves ``D^(alpha-gamma) m = F`` beyond.

Here m(0) = 0, since y solves the equation. The lower terms of the left side become such components
as well, so that F is ``(f - sum_l c_l m_l) / c``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..equation.affine import affine
from ..equation.chain import left_of
from ..equation.frame import Frame
from ..equation.system import System
from ..stepping.dense import Piece
from ..support.checks import refuse


class Plain:
    """View of a stepper that solves the equation as it is.

    Attributes
    ----------
    system : System
        What is solved.
    second : ndarray of bool, shape (d,)
        Components of y whose first derivative is an unknown.
    """

    def __init__(self, system):
        self.system, self.second = system, system.second

    def directions(self, directions):
        """Return directions of initial data of the system, shape (n_data, k)."""
        return directions

    def values(self, x, p):
        """Return y and y' of x and its slopes p, (..., d) each; NaN where y' is no unknown."""
        return x.copy(), np.where(self.second, p, np.nan)

    def piece(self, piece):
        """Return the dense output of y."""
        return piece

    def widened(self, change):
        """Return a change of y, (d,), as one of all components of the system."""
        return change


class Reading(Plain):
    """View of a stepper that solves an equation whose right-hand side reads memory."""

    def __init__(self, system):
        self.system, self._speeds = reduced(system)
        self.second, self._d = system.second, system.n_solved

    def directions(self, directions):
        """Return directions of initial data of the system, shape (n_data, k)."""
        if directions is None:
            return None
        wide = np.zeros((self.system.d, directions.shape[1]))
        wide[: self._d] = directions[: self._d]
        wide[self._speeds[self.second]] = directions[self._d :]
        return wide

    def values(self, x, p):
        """Return y and y' of x and its slopes p, (..., d) each; NaN where y' is no unknown."""
        speeds = np.where(self.second, x[..., self._speeds], np.nan)
        return x[..., : self._d].copy(), speeds

    def piece(self, piece):
        """Return the dense output of y."""
        return ReadingPiece(piece, self._speeds)

    def widened(self, change):
        """Return a change of y, (d,), as one of all components of the system."""
        return np.pad(change, (0, self.system.d - self._d))


@dataclass(frozen=True, eq=False)
class ReadingPiece(Piece):
    """Dense output of y among the components of a larger system.

    Attributes
    ----------
    inner : Piece
    speeds : ndarray of int64, shape (d,)
        Component that is y', where there is one.
    """

    inner: Piece
    speeds: np.ndarray

    def edges(self):
        """Return the start of each step."""
        return self.inner.edges()

    def evaluate(self, t, second, derivative):
        """Return y, or y' for ``derivative=1``, at times t inside the steps, (k, d)."""
        none, d = np.zeros(1, dtype=bool), self.speeds.size
        found = self.inner.evaluate(t, none, derivative)[:, :d]
        if not derivative or not second.any():
            return found
        return np.where(second, self.inner.evaluate(t, none, 0)[:, self.speeds], found)


def reduced(system):
    """Return the system without memory, and the component that is y' of each, (d,)."""
    for operator, _ in system.left:
        if operator.from_zero:
            required = "hold no RiemannLiouville with Collocation, where memory is read"
            refuse("terms", required, f"{operator}", "take BDF or L1")
    for operator, _ in system.left:
        if not operator.constant:
            required = (
                "be Caputo operators of constant order with Collocation, where memory is read"
            )
            refuse("terms", required, f"{operator}", "take ExplicitCaputo or L1")
    d, leading = system.n_solved, system.highest_orders()
    before = system.coefficient(leading)
    second = np.flatnonzero(system.second).tolist()
    speeds = np.zeros(d, dtype=np.int64)
    speeds[second] = d + np.arange(len(second))
    # of each component the initial value, the order, and what its derivative is: F_j, as -1 - j, or
    # another component
    origins = np.where(system.second, speeds, -1 - np.arange(d)).tolist()
    made = list(zip(system.y0[0, :d], np.minimum(leading[:d], 1.0).tolist(), origins, strict=True))
    made += [(system.y0[1, j], leading[j] - 1, -1 - j) for j in second]
    roles = [(j, 0.0) for j in range(d)] + [(j, 1.0) for j in second]
    places = {(j, 1.0): int(speeds[j]) for j in second}

    def place(j, gamma):
        """Return the component that is D^gamma y_j."""
        if gamma == 1.0 and leading[j] > 1:
            return int(speeds[j])
        if (j, gamma) not in places:
            places[j, gamma] = len(made)
            slow = leading[j] > 1 and gamma < 1
            order = 1 - gamma if slow else leading[j] - gamma
            made.append((0.0, order, int(speeds[j]) if slow else -1 - j))
            roles.append((j, gamma))
        return places[j, gamma]

    # what f reads, and the lower terms of each F_j
    read: list[tuple] = [(j, j, 1.0) for j in range(d)]
    lower: list[list[tuple]] = [[] for _ in range(d)]
    for operator, coefficients in system.left:
        for c in np.flatnonzero(coefficients).tolist():
            j = int(system.sources[c])
            if c != j:
                read.append((c, place(j, operator.order), coefficients[c]))
            elif operator.order < leading[j]:
                lower[j].append((place(j, operator.order), coefficients[c]))
    n, lead, own, forces = len(made), np.ones(len(made)), [], []
    for i, (_, _, origin) in enumerate(made):
        if origin < 0:
            j = -1 - origin
            lead[i] = before[j]
            forces.append((i, j, 1.0))
            own += [(i, k, -c) for k, c in lower[j]]
        else:
            own.append((i, origin, 1.0))
    left = left_of([(order, i, lead[i]) for i, (_, order, _) in enumerate(made)], n)
    how = system.compiled_params, system.compiled_rhs, system.compiled_jac
    quantities = [(system.quantities[j], gamma) for j, gamma in roles]
    numbers = {quantity: number for number, quantity in enumerate(sorted(set(quantities)))}
    params, rhs, jac = affine(how, n, system.d, own, forces, read)
    found = System(
        left,
        np.array([[value for value, _, _ in made]]),
        params,
        rhs,
        jac,
        quantities=np.array([numbers[quantity] for quantity in quantities]),
        of_y=system.of_y[[j for j, _ in roles]],
        frame=Frame(system.frame.start),
        rhs_digest=system.rhs_digest,
        callbacks=system.callbacks,
    )
    return found, speeds
