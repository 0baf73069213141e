"""Alikhanov's L2-1sigma scheme."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.special import rgamma

from ...equation.system import System
from ...stepping.scheme import Scheme, check_smoothness
from ...support.checks import refuse, within
from ..plan import Plan
from ..row_plan import mesh_plan
from ..uniform_plan import parabola_plan
from .reduction import reduce_order


@dataclass(frozen=True)
class L2Sigma(Scheme):
    """Alikhanov's second-order scheme, for orders in (0, 2].

    The equation holds at t_n + sigma h with x = x_n + sigma (x_(n+1) - x_n). On every earlier step
    the solution is the parabola through both ends of the step and the value one step later. On the
    newest step it is linear. The error of the linear step cancels if sigma = 1 - alpha/2 for one
    term. For several terms sigma is the root of ``sum_j c_j h**(2-alpha_j) / Gamma(3-alpha_j)
    sigma**(1-alpha_j) (sigma - 1 + alpha_j/2)``. At alpha = 1 the scheme is the implicit midpoint
    rule.

    The scheme takes any number of components, all with the same terms. One term of order beta in
    (1, 2] becomes two equations of order beta/2, which are solved together
    (given/schemes/reduction.py).

    Error
    -----
    For smooth solutions the error is O(h**2). For solutions like t**alpha it is O(h) at a fixed
    time on uniform steps. On the mesh ``graded(n, r)`` it is O(n**-min(r alpha, 2)) at all times.
    Above order 1 alpha is beta/2 here (convergence/orders.py, convergence/graded_meshes.py).

    Stability
    ---------
    Unconditional for linear dissipative equations.

    Source
    ------
    [Alikhanov2015], eqs. (26) to (28); several terms: [GaoAlikhanovSun2017].

    Examples
    --------
    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.relaxation(0.5), 1.0, n_steps=1000, scheme=hd.L2Sigma())
    >>> round(float(sol.y[-1, 0]), 4)
    0.4276
    """

    several_up_to: ClassVar[float] = 1.0
    components_differ: ClassVar[bool] = False
    takes_memory: ClassVar[bool] = False
    takes_meshes: ClassVar[bool] = True
    meshes_up_to: ClassVar[float] = 2.0
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
        within("alpha", alpha, 5e-324, 2.0, "(0, 2]")
        check_smoothness(smoothness)
        return 2.0 if smoothness == "smooth" else 1.0

    def reduction(self, system: System) -> System | None:
        """Return an equation of order in (1, 2] as two of half the order; None up to order 1."""
        if system.highest_orders().max() <= 1:
            return None
        distinct, _ = system.distinct
        if len(distinct) > 1 or len(distinct[0]) > 1:
            required = "be one for all components with L2Sigma above order 1"
            got = f"{len(distinct)} kinds of components, {len(distinct[0])} terms"
            refuse("terms", required, got, "use BDF(2) or L1")
        ((c, operator),) = distinct[0]
        return reduce_order(system, c, operator.order)

    def plan(self, system: System, h: float) -> Plan:
        """Return the plan of this scheme for `system` with uniform steps h."""
        return parabola_plan(system, h, _sigma(_terms(system), h))

    def mesh_plan(self, system: System, times: np.ndarray) -> Plan:
        """Return the plan of this scheme on a mesh of any steps, for orders in (0, 1]."""
        terms = _terms(system)
        sigma = np.array([_sigma(terms, step) for step in np.diff(times)])
        return mesh_plan(self, system, times, sigma, 1)


def _terms(system: System) -> list[tuple[float, float]]:
    """Return coefficients and orders of the terms that all components share."""
    distinct, _ = system.distinct
    if len(distinct) > 1:
        required = "be the same for all components with L2Sigma, whose sigma depends on them"
        got = f"{len(distinct)} different sets of orders and coefficients"
        refuse("terms", required, got, "use L1 or L2")
    return [(c, operator.order) for c, operator in distinct[0]]


def _sigma(terms: list[tuple[float, float]], h: float) -> float:
    """Return sigma for (coefficient, order) of each term and steps h, by bisection."""
    # the equation for sigma is in the docstring of `L2Sigma`
    if len(terms) == 1:
        return 1 - terms[0][1] / 2
    c, alpha = np.array(terms).T
    if np.any(c < 0):
        refuse("terms", "have positive coefficients with L2Sigma", c.tolist(), "use L1 or L2")
    weights = c * h ** (2 - alpha) * rgamma(3 - alpha)
    low, high = 1 - alpha.max() / 2, 1 - alpha.min() / 2
    for _ in range(60):
        sigma = (low + high) / 2
        if np.sum(weights * sigma ** (1 - alpha) * (sigma - 1 + alpha / 2)) > 0:
            high = sigma
        else:
            low = sigma
    return float((low + high) / 2)
