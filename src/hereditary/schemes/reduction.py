"""Symmetric order reduction (floor 2): order beta in (1, 2] as two equations of order beta/2.

With ``z = x - x(0) - t x'(0)`` and ``w = D^(beta/2) z`` the equation ``c D^beta x = f(t, x)``
becomes ``D^(beta/2) z = w``, ``D^(beta/2) w = f(t, x(0) + t x'(0) + z) / c``, with z(0) = w(0) = 0.
Source: [LyuVong2022].
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit

from ..equation import Equation
from ..operators import Caputo


@dataclass(frozen=True, eq=False)
class Reduction:
    """The pair of equations, and the way back.

    Attributes
    ----------
    equation : Equation
        For (z, w), 2 d components.
    y0 : ndarray, shape (2, d)
        x(0) and x'(0).
    """

    equation: Equation
    y0: np.ndarray

    def lift(self, t, rows, slopes):
        """Solution and first derivative, shape (n, d), from rows of (z, w) and their slopes."""
        d = self.y0.shape[1]
        x = self.y0[0] + np.multiply.outer(t, self.y0[1]) + rows[:, :d]
        return x, self.y0[1] + slopes[:, :d]


def reduce_order(equation: Equation, coefficient: float, beta: float) -> Reduction:
    """Reduce an equation whose components all have the one term ``coefficient * Caputo(beta)``."""
    d = equation.d
    params = np.concatenate([equation.params, equation.y0.ravel(), [coefficient]])
    reduced = Equation(Caputo(beta / 2), _pair(equation._rhs), np.zeros(2 * d), params)
    return Reduction(reduced, equation.y0)


@lru_cache(maxsize=64)
def _pair(rhs):
    """The right-hand side of the pair; y is (z, w), params end in x(0), x'(0) and c."""

    def pair(t, y, dy, params):
        d = y.shape[0] // 2
        own = params.shape[0] - 2 * d - 1
        x = np.empty(d)
        for j in range(d):
            x[j] = params[own + j] + t * params[own + d + j] + y[j]
            dy[j] = y[d + j]
        rhs(t, x, dy[d:], params[:own])
        for j in range(d):
            dy[d + j] /= params[own + 2 * d]

    return njit(error_model="numpy", nogil=True)(pair)
