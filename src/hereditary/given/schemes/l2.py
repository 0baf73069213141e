"""The L2 scheme: piecewise quadratic solutions."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...equation.system import System
from ...stepping.scheme import Scheme, check_smoothness
from ...support.checks import within
from ..plan import Plan
from ..row_plan import mesh_plan
from ..uniform_plan import parabola_plan


@dataclass(frozen=True)
class L2(Scheme):
    """The L2 scheme of order 3 - alpha, for orders in (0, 1].

    On every step but the last the solution is the parabola through the ends of the step and the
    next value. On the last step it is the parabola through its ends and the value before. The
    equation holds at t_n. The first step is solved with a line. At alpha = 1 this is the second
    backward difference formula, started by one step of Euler's backward method. Implicit: Newton's
    method with the equation's Jacobian or differences. Any number of terms and components.

    Error
    -----
    O(h**(3-alpha)) at a fixed time for smooth solutions. Next to 0 the line of the first step has
    an error of O(h**2), unless x''(0) = 0. O(h) at a fixed time for solutions like t**alpha on
    uniform steps; O(n**-min(r alpha, 3-alpha)) at all times on the mesh ``graded(n, r)``. A step
    more than thirty times as long as the one before gets a line, because a parabola would amplify
    earlier errors (convergence/orders.py, convergence/graded_meshes.py).

    Stability
    ---------
    No step limit was found.

    Source
    ------
    [LvXu2016], section 2.

    Examples
    --------
    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.relaxation(0.5), 1.0, n_steps=1000, scheme=hd.L2())
    >>> round(float(sol.y[-1, 0]), 4)
    0.4276
    """

    orders = (0.0, 1.0)
    takes_meshes: ClassVar[bool] = True

    def order(self, alpha: float, smoothness: str = "smooth") -> float:
        """Return the proven order of convergence at a fixed time, on uniform steps.

        Parameters
        ----------
        alpha : float
            Highest order of the equation, 0 < alpha <= 1 [-].
        smoothness : {"smooth", "singular"}
            Whether the solution is smooth at 0 or behaves like t**alpha there.
        """
        alpha = within("alpha", alpha, 5e-324, 1.0, "(0, 1]", "use L1 for orders above 1")
        check_smoothness(smoothness)
        return 3 - alpha if smoothness == "smooth" else 1.0

    def plan(self, system: System, h: float) -> Plan:
        """Return tables and convolution for `system` with step h."""
        return parabola_plan(system, h, 1.0, closing=True)

    def mesh_plan(self, system: System, times: np.ndarray) -> Plan:
        """Return the plan on any mesh, for orders in (0, 1]."""
        return mesh_plan(self, system, times, 1.0, 2)
