"""Rows inside the first two steps, where solutions start like a power of t.

There a component is ``x(0) + t x'(0) + a t**alpha`` with alpha its highest order and a from the
equation at 0, and powers more that go through the values of the scheme: with r = min(1, 2 alpha)
below order 1 and 2 from there on, t**r in the first step, t**r and t**(r+1) in the second.
"""

from functools import cached_property

import numpy as np
from scipy.special import rgamma


def starting_steps(stepper):
    """`FirstSteps` of a stepper that made one step at most; else None, or without these powers."""
    system = stepper.equation.enlarged
    # Riemann-Liouville terms begin with lower ones, which the values of the first steps miss
    if stepper.n > 1 or not system.constant or any(op.from_zero for op, _ in system.left):
        return None
    return FirstSteps(stepper.equation, stepper.steps.times(np.array([1.0, 2.0])))


class FirstSteps:
    """Rows inside the first two steps of a march that begins at 0.

    Parameters
    ----------
    equation : System
        With constant orders alone.
    ends : array_like, shape (2,)
        Times at which the two steps end.
    """

    def __init__(self, equation, ends):
        self._equation = equation
        self.ends, self._values = np.asarray(ends, dtype=float), np.zeros((2, equation.d))

    @cached_property
    def _powers(self):
        """Highest order, its factor, and r for each component, (d,); asked for by few runs."""
        alpha = self._equation.highest_orders()
        more = np.where(alpha >= 1, 2.0, np.minimum(1.0, 2 * alpha))
        return alpha, _leading(self._equation, alpha), more

    def end(self, n, y):
        """Note that step n, 1 or 2, ends at y."""
        self._values[n - 1] = y

    def inside(self, n, times):
        """Solution and slope at times inside step n, shapes (k, d)."""
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

    def _known(self, t):
        """x(0) + t x'(0) + a t**alpha, and its slope."""
        y0, (alpha, lead, _) = self._equation.y0, self._powers
        speed = y0[1] if y0.shape[0] == 2 else 0.0
        y = y0[0] + t * speed + lead * t**alpha
        return y, speed + lead * alpha * t ** (alpha - 1)


def _leading(equation, alpha):
    """The a above, 0 where the right-hand side has no value at 0."""
    f = np.full(equation.d, np.nan)
    try:
        system = equation.enlarged
        f[:] = system.force(0.0, system.at_start)[: equation.d]
    except Exception:  # the march meets it again, or never looks there
        f[:] = np.nan
    if equation.m == 2:
        f -= np.where(alpha > 1, equation.coefficient(1.0), 0.0) * equation.y0[1]
    lead = f * rgamma(1 + alpha) / equation.coefficient(alpha)
    return np.where(np.isfinite(lead), lead, 0.0)
