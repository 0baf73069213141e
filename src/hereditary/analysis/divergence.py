"""The divergence of a classical flow along an orbit."""

import numpy as np

from ..compiled.jacobian import COLUMNS, ROWS, VALUES, is_sparse, jacobian
from ..compiled.jit import F8, I8, MAT, VEC, entry
from ..compiled.signatures import JAC, RHS


class Divergence:
    """Integral of the divergence of the first-order system behind an equation of integer orders.

    A component ``c_1 x' = f`` adds ``d f_j / d x_j / c_1``, one of ``c_2 x'' + c_1 x' = f`` adds
    ``-c_1 / c_2``, for f knows no velocities.

    Parameters
    ----------
    equation : System
    h : float
        Step [time].
    """

    def __init__(self, equation, h):
        self._equation, self._h, d = equation, h, equation.d
        self._units = equation.steps
        known = equation.structure
        self._jacobian = np.empty((d, d)) if known is None else known.entries.copy()
        second = equation.highest_orders() > 1
        first, leading = equation.coefficient(1.0), equation.coefficient(2.0)
        self._shares = np.where(second, 0.0, 1 / np.where(second, 1.0, first))
        self._constant = -float(np.sum(first[second] / leading[second]))
        self._first = self._newest = self._sum_at(0.0, equation.y0[:1].copy())
        self._total = 0.0
        self.mark()

    def mark(self):
        """Note that growth is known up to here: `integral` ends here."""
        self._marked = self._total, self._newest

    def add(self, n, rows):
        """Take in the orbit at the steps from n + 1 on, shape (k, d)."""
        if len(rows) == 0:
            return
        self._newest = self._sum_at((n + rows.shape[0]) * self._h, rows[-1:])
        self._total += self._sum_at((n + 1) * self._h, rows)

    def integral(self, n):
        """Integral from 0 to step n, the marked one, by the trapezoidal rule."""
        total, newest = self._marked
        changing = total + 0.5 * (self._first - newest) if n else 0.0
        return self._h * (changing + n * self._constant)

    def _sum_at(self, t, rows):
        equation = self._equation
        rows = np.ascontiguousarray(rows)
        return _sum_of_traces(
            *equation.compiled,
            t,
            self._h,
            rows,
            self._shares,
            self._units,
            self._jacobian,
        )


@entry(RHS, JAC, I8, VEC, F8, F8, MAT, VEC, VEC, MAT)
def _sum_of_traces(rhs, jac, has_jac, params, t, h, rows, shares, units, j_f):
    """Sum over rows (k, d) of ``sum_j shares_j d f_j / d x_j``, the first one at time t."""
    d, total = rows.shape[1], 0.0
    for k in range(rows.shape[0]):
        jacobian(rhs, jac, has_jac, t + k * h, rows[k], params, units, j_f)
        if is_sparse(j_f, d):
            for i in range(j_f.shape[1]):
                j = int(j_f[COLUMNS, i])
                total += shares[j] * j_f[VALUES, i] if int(j_f[ROWS, i]) == j else 0.0
        for j in range(0 if is_sparse(j_f, d) else d):
            total += shares[j] * j_f[j, j]
    return total
