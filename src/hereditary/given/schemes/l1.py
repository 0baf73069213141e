"""The L1 scheme: piecewise linear solutions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np

from ...equation.system import System
from ...stepping.scheme import Scheme, check_smoothness
from ...support.checks import within
from ..plan import Plan
from ..row_plan import mesh_plan, varying_plan
from ..uniform_plan import uniform_plan
from ..weights import FIRST_DIFFERENCES, by_rule, value_weights, weighed


@dataclass(frozen=True)
class L1(Scheme):
    r"""The L1 scheme, in its half-step form for orders above 1.

    For orders in (0, 1] the solution is linear on each step, and the equation holds at t_n. With
    ``b_k = (k+1)**(1-alpha) - k**(1-alpha)`` the derivative is

    .. math::

        D^\alpha x(t_n) = \frac{h^{-\alpha}}{\Gamma(2 - \alpha)}
        \sum_{k=0}^{n-1} b_k (x_{n-k} - x_{n-k-1})

    If any order is in (1, 2], the velocity is linear between the middles of steps, where it is
    ``v_(k+1/2) = (x_(k+1) - x_k) / h``. With ``a_k = (k+1)**(2-beta) - k**(2-beta)`` the derivative
    of order beta is

    .. math::

        D^\beta x(t_{n+1/2}) = \frac{h^{1-\beta}}{\Gamma(3 - \beta)} \left( v_{n+1/2}
        - \sum_{k=1}^n (a_{k-1} - a_k) v_{n+1/2-k} - a_n x'(0) \right)

    Terms of lower order are also evaluated at t_n + h/2, and the equation holds there with
    ``x = (x_n + x_(n+1)) / 2``. The scheme is implicit: Newton's method uses the equation's
    Jacobian, or differences of f. It takes any number of terms and components. If orders vary, the
    orders at the time of the equation give all weights of a step.

    Error
    -----
    For orders up to 1 and smooth solutions the error is O(h**(2-alpha)). For solutions like
    t**alpha it is O(h) at a fixed time on uniform steps. On the mesh ``graded(n, r)`` it is
    O(n**-min(r alpha, 2-alpha)) at all times.

    For orders above 1 the error is O(h**(3-beta)). On the mesh ``graded(n, 3)`` it is
    O(n**-(3-beta)) at all times (convergence/orders.py, convergence/graded_meshes.py,
    tests/schemes/test_schemes.py). If orders vary, their largest value counts
    (convergence/varying_orders.py).

    Stability
    ---------
    No step limit.

    Source
    ------
    [LinXu2007], eq. (3.1); [SunWu2006], for orders above 1.

    Examples
    --------
    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.relaxation(0.5), 1.0, n_steps=1000, scheme=hd.L1())
    >>> round(float(sol.y[-1, 0]), 4)
    0.4277
    """

    takes_kernels: ClassVar[bool] = True
    takes_varying: ClassVar[bool] = True
    meshes_up_to: ClassVar[float] = 2.0
    takes_meshes: ClassVar[bool] = True
    plans_by_terms: ClassVar[bool] = True

    def order(self, alpha: float, smoothness: str = "smooth") -> float:
        """Return the proven order of convergence at a fixed time, on uniform steps.

        Parameters
        ----------
        alpha : float
            Highest order of the equation, 0 < alpha <= 2 [-].
        smoothness : {"smooth", "singular"}
            Whether the solution is smooth at 0 or behaves like t**alpha there.
        """
        alpha = within("alpha", alpha, 5e-324, 2.0, "(0, 2]")
        check_smoothness(smoothness)
        if alpha > 1:
            return 3 - alpha
        return 2 - alpha if smoothness == "smooth" else 1.0

    def plan(self, system: System, h: float) -> Plan:
        """Return the plan of this scheme for `system` with uniform steps h."""
        theta = 0.5 if system.highest_orders().max() > 1 else 1.0
        if system.varies:
            return varying_plan(system, h, theta, explicit=False)
        # If a kernel acts on y, its integral over t y'(0) grows with t, so decaying modes cannot
        # approximate it. Then the increments contain h y'(0), and y'(0) is the first velocity in
        # the differences of velocities.
        whole = system.m == 2 and _remembers(system, 0)
        starts: list = [(None, 0.0)]
        for derivative in (0, 1):
            # increments omit y(0) and, unless `whole`, t y'(0): both need weights of start values
            lacking = derivative == 0 or (system.m == 2 and not whole)
            if lacking and _remembers(system, derivative):
                weights = partial(value_weights, h=h, theta=theta, derivative=derivative)
                starts.append((weights, system.y0[derivative]))
        if whole:
            starts.append((partial(_speed_weights, h=h), h * system.y0[1]))
        terms = partial(weighed, h=h, theta=theta)
        return uniform_plan(system, h, theta, terms, starts=starts, whole=whole)

    def mesh_plan(self, system: System, times: np.ndarray) -> Plan:
        """Return the plan of this scheme on a mesh with steps of any lengths."""
        theta = 0.5 if system.highest_orders().max() > 1 else 1.0
        return mesh_plan(self, system, times, theta, 0)


def _speed_weights(c: float, operator: Any, h: float) -> tuple[Any, ...] | None:
    """Return weights of h y'(0) in terms with y'', or None for terms with y or y'."""
    # y'(0) is the first velocity in the differences of velocities
    return by_rule(-c, operator, h, FIRST_DIFFERENCES) if operator.derivative == 2 else None


def _remembers(system: System, derivative: int) -> bool:
    """Return whether a term has a general kernel that acts on this derivative of y (0 or 1)."""
    general = (op for op, c in system.left if op.kernel is not None and np.any(c))
    return any(op.derivative == derivative for op in general)
