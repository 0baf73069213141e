"""The L1-2 scheme: on each step a parabola that also passes through the value one step earlier."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ...equation.system import System
from ...stepping.scheme import Scheme, check_smoothness
from ...support.checks import within
from ..plan import Plan, WeightRule
from ..uniform_plan import uniform_plan
from ..weights import FIRST_DIFFERENCES, by_rule, parabola_start


@dataclass(frozen=True)
class L12(Scheme):
    """The L1-2 scheme of order 3 - alpha, for orders in (0, 1].

    On the first step the solution is linear. On every later step it is the parabola through both
    ends of the step and the value one step earlier. (`L2` uses the value one step later.) The
    equation holds at t_n. At alpha = 1 this is the second backward difference formula, started by
    one step of Euler's backward method. The scheme is implicit: Newton's method uses the equation's
    Jacobian, or differences of f. It takes any number of terms and components.

    Error
    -----
    At a fixed time the error is O(h**(3-alpha)) for smooth solutions. Next to 0 the linear first
    step causes an error of O(h**2), unless x''(0) = 0. For solutions like t**alpha, alpha < 1, the
    error at a fixed time is O(h) (convergence/orders.py).

    Stability
    ---------
    No step limit was found for orders from 0.1 to 1. Solutions of ``D^alpha y = -K y`` and undamped
    rotations do not exceed their initial values for K h**alpha up to 1e6. On the unit circle the
    argument of the scheme's generating function is below ``alpha pi / 2`` + 0.6 degrees.

    Source
    ------
    [GaoSunZhang2014], section 2.

    Examples
    --------
    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.relaxation(0.5), 1.0, n_steps=1000, scheme=hd.L12())
    >>> round(float(sol.y[-1, 0]), 4)
    0.4276
    """

    orders = (0.0, 1.0)

    def order(self, alpha: float, smoothness: str = "smooth") -> float:
        """Return the order of convergence at a fixed time.

        Parameters
        ----------
        alpha : float
            Highest order of the equation, 0 < alpha <= 1 [-].
        smoothness : {"smooth", "singular"}
            Whether the solution is smooth at 0 or behaves like t**alpha there. At alpha = 1 both
            are smooth.
        """
        alpha = within("alpha", alpha, 5e-324, 1.0, "(0, 1]", "use L1 for orders above 1")
        check_smoothness(smoothness)
        return 3 - alpha if smoothness == "smooth" or alpha == 1 else 1.0

    def plan(self, system: System, h: float) -> Plan:
        """Return the plan of this scheme for `system` with uniform steps h."""
        weighed, start = (
            partial(by_rule, h=h, rule=r) for r in (BACKWARD_PARABOLAS, BACKWARD_START)
        )
        return uniform_plan(system, h, 1.0, weighed, starts=[(start, 0.0)])


# Rule of the weights -m_(k+1), with m_k = int K(t) (k + 1/2 - t) dt over [k, k+1].
_NEXT_MOMENT = parabola_start(1.0)


def _lacking(kernel: Any, n: int) -> np.ndarray:
    last = -np.asarray(kernel.last_moment())[..., None]
    return np.concatenate([last, _NEXT_MOMENT.exact(kernel, n - 1)], axis=-1)


def _backward(kernel: Any, n: int) -> np.ndarray:
    return FIRST_DIFFERENCES.exact(kernel, n) - np.diff(_lacking(kernel, n), prepend=0.0)


# Rule of increments' weights for parabolas through the value before: b_k + m_k - m_(k-1). Here b_k
# is the integral of the kernel K over [k, k+1], and m_k that of (k + 1/2 - t) K(t).
BACKWARD_PARABOLAS = WeightRule(_backward)
# Rule of the corrections -m_k for the first increment, whose interval has no parabola. Here m_k is
# the integral of (k + 1/2 - t) K(t) over [k, k+1].
BACKWARD_START = WeightRule(_lacking)
