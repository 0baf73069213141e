"""The solution inside the first two given steps of a run.

There a component is ``x(0) + t x'(0) + a t**alpha`` with its highest order alpha and a from the
equation at 0. Powers that interpolate the values of the scheme are added. These are t**r in the
first step, and t**r and t**(r+1) in the second. Here r = min(1, 2 alpha) below order 1 and r = 2
from order 1 on.
"""

from contextlib import suppress
from functools import cached_property

import numpy as np
from scipy.special import rgamma

# Time that stands for 0 where the slope at 0 is evaluated.
_NEXT_TO_0 = 1e-200
# A slope at 0 whose size exceeds this counts as infinite.
_STEEP = 1e12


def starting_steps(stepper):
    """Return `FirstSteps` of a stepper that made at most one step; otherwise None."""
    system = stepper.system
    # Riemann-Liouville terms start with lower powers of t, which the interpolation below lacks
    if stepper.n > 1 or not system.constant or any(op.from_zero for op, _ in system.left):
        return None
    return FirstSteps(system, stepper.steps.times(np.array([1.0, 2.0])))


class FirstSteps:
    """Rows inside the first two steps of a march that begins at 0.

    Parameters
    ----------
    system : System
        With constant orders alone.
    ends : array_like, shape (2,)
        Times at which the two steps end.
    """

    def __init__(self, system, ends):
        self._system, self._start = system, system.y0[:, : system.n_solved]
        self.ends, self._values = np.asarray(ends, dtype=float), np.zeros((2, system.n_solved))

    def __getstate__(self):
        """Leave out the system, whose compiled functions another process does not have."""
        self._powers  # noqa: B018
        return vars(self) | {"_system": None}

    @cached_property
    def _powers(self):
        """Highest order alpha, the factor a, and r for each component, (d,); few runs need them."""
        alpha = self._system.highest_orders()[: self._system.n_solved]
        more = np.where(alpha >= 1, 2.0, np.minimum(1.0, 2 * alpha))
        return alpha, _leading(self._system), more

    def end(self, n, y):
        """Record that step n, 1 or 2, ends at y."""
        self._values[n - 1] = y

    def inside(self, n, times):
        """Return the solution and slope at times inside step n, shapes (k, d)."""
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

    def near(self, n, t, derivative):
        """Return y or y' inside step n, 1 or 2; powers below 1 are infinitely steep at 0."""
        y, slope = self.inside(n, np.maximum(t, _NEXT_TO_0))
        steep = (t[:, None] == 0.0) & (np.abs(slope) > _STEEP)
        return np.where(steep, np.copysign(np.inf, slope), slope) if derivative else y

    def _known(self, t):
        """Return x(0) + t x'(0) + a t**alpha, and its slope."""
        y0, (alpha, lead, _) = self._start, self._powers
        speed = y0[1] if y0.shape[0] == 2 else 0.0
        y = y0[0] + t * speed + lead * t**alpha
        return y, speed + lead * alpha * t ** (alpha - 1)


def _leading(system):
    """Return the factor a of ``t**alpha``, (n_solved,), or 0 if f has no value at 0."""
    f, alpha = np.full(system.d, np.nan), system.highest_orders()
    with suppress(Exception):  # the march meets it again, or never asks for it there
        f = system.force(0.0, system.at_start)
    if system.m == 2:
        f -= np.where(alpha > 1, system.coefficient(1.0), 0.0) * system.y0[1]
    lead = (f * rgamma(1 + alpha) / system.coefficient(alpha))[: system.n_solved]
    return np.where(np.isfinite(lead), lead, 0.0)
