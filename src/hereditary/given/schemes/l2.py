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

    On every step but the newest the solution is the parabola through both ends of the step and the
    value one step later. On the newest step it is the parabola through both ends and the value one
    step earlier. The equation holds at t_n. The first step is solved with a linear solution. At
    alpha = 1 this is the second backward difference formula, started by one step of Euler's
    backward method. The scheme is implicit: Newton's method uses the equation's Jacobian, or
    differences of f. It takes any number of terms and components.

    Error
    -----
    At a fixed time the error is O(h**(3-alpha)) for smooth solutions. Next to 0 the linear first
    step causes an error of O(h**2), unless x''(0) = 0. For solutions like t**alpha the error is
    O(h) at a fixed time on uniform steps. On the mesh ``graded(n, r)`` it is
    O(n**-min(r alpha, 3-alpha)) at all times. On a step more than thirty times as long as the step
    before the solution is linear. A parabola would amplify earlier errors (convergence/orders.py,
    convergence/graded_meshes.py).

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
    plans_by_terms: ClassVar[bool] = True

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
        """Return the plan of this scheme for `system` with uniform steps h."""
        return parabola_plan(system, h, 1.0, closing=True)

    def mesh_plan(self, system: System, times: np.ndarray) -> Plan:
        """Return the plan of this scheme on a mesh of any steps, for orders in (0, 1]."""
        return mesh_plan(self, system, times, 1.0, 2)
