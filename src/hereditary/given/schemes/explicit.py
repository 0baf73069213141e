"""The explicit non-local scheme for Caputo terms, the default.

The mesh is uniform, with increments ``y_n = x_(n+1) - x_n`` and second differences
``d_n = y_n - y_(n-1)``. A term of order alpha in (0, 1] is ``A sum_k b_k y_(n-k)``, and a term of
order alpha in (1, 2] is ``A sum_k b_k d_(n-k)``. Here ``b_k = (k+1)**p - k**p``,
p = ceil(alpha) - alpha and ``A = coefficient h**-alpha / Gamma(p + 1)``. The right-hand side is
evaluated at t_n.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np

from ...equation.equation import Equation
from ...equation.system import System
from ...stepping.scheme import Scheme, check_smoothness
from ...support.checks import instance, refuse, within
from ..plan import Plan
from ..row_plan import varying_plan
from ..stability import largest_step
from ..uniform_plan import uniform_plan
from ..watch import SLOWEST
from ..weights import FIRST_DIFFERENCES, by_rule, value_weights, weighed


@dataclass(frozen=True)
class ExplicitCaputo(Scheme):
    r"""The explicit non-local finite-difference scheme for Caputo terms; the default.

    For ``D^beta x + lambda D^gamma x = f(t, x)``, 1 < beta <= 2, 0 < gamma <= 1, with step h, this
    equation is solved for x_(n+1):

    .. math::

        \sum_{k=0}^{n-1} \left[ A a_k (x_{n-k+1} - 2 x_{n-k} + x_{n-k-1})
        + B b_k (x_{n-k+1} - x_{n-k}) \right] = f(t_n, x_n)

    Here ``A = h**-beta / Gamma(3 - beta)``, ``a_k = (k+1)**(2-beta) - k**(2-beta)``,
    ``B = lambda h**-gamma / Gamma(2 - gamma)``, ``b_k = (k+1)**(1-gamma) - k**(1-gamma)`` and
    ``x_1 = x_0 + h x'(0)``. The scheme takes any number of terms, with orders in (0, 2], and any
    number of components. Equations of order up to 1 use the same sums from ``x_1 - x_0`` on. At
    beta = 2, gamma = 1 it is the classical difference scheme. If orders vary, the orders at t_n
    give all weights of a step.

    Error
    -----
    At a fixed t > 0 the error is O(h) plus terms in h**(3-beta) and h**(2-gamma). This holds for f
    smooth in its arguments (convergence/explicit_order.py, convergence/varying_orders.py).

    Stability
    ---------
    Conditional, with the sharp limit `step_limit`. Beyond the limit an orbit need not overflow. It
    can zigzag from step to step, bounded and wrong. `solve` checks the increments of
    every step for a zigzag and for growth.

    Cost
    ----
    A step takes one evaluation of the right-hand side, and one sum by the history.

    Source
    ------
    [Parovik2016], [Parovik2018]; increment form and limit: docs/theory.md.

    Examples
    --------
    >>> import hereditary as hd
    >>> eq = hd.Equation([hd.Caputo(1.0)], lambda t, y: -y, y0=1.0)
    >>> sol = hd.solve(eq, 1.0, n_steps=1000, scheme=hd.ExplicitCaputo())
    >>> round(float(sol.y[-1, 0]), 3)
    0.368
    """

    solve: ClassVar[str] = "explicit"
    whole: ClassVar[bool] = True
    takes_kernels: ClassVar[bool] = True
    takes_varying: ClassVar[bool] = True
    plans_by_terms: ClassVar[bool] = True

    def order(self, alpha: float, smoothness: str = "smooth") -> float:
        """Return the proven order of convergence at a fixed time: 1 for alpha in (0, 2].

        Parameters
        ----------
        alpha : float
            Highest order of the equation, 0 < alpha <= 2 [-].
        smoothness : {"smooth", "singular"}
            Whether the solution is smooth at 0 or behaves like t**alpha there; both give 1.
        """
        within("alpha", alpha, 5e-324, 2.0, "(0, 2]")
        check_smoothness(smoothness)
        return 1.0

    def step_limit(self, equation: Equation, stiffness: float) -> float:
        """Return the largest stable step for a constant ``-d rhs / d y = stiffness``.

        Parameters
        ----------
        equation : Equation
            Its terms determine the limit of each component; the smallest limit counts.
        stiffness : float
            omega**2 in ``D^beta x + ... = -omega**2 x``, above 0 [1/time**order].

        Returns
        -------
        float
            The h at which ``sum_j c_j h**-alpha_j s_j = stiffness``. The limit is sharp: solutions
            are bounded for smaller h and zigzag for larger h. For beta in (1, 2] s_j is
            8 eta(beta-2) / Gamma(3-beta). For gamma in (0, 1] it is
            4 eta(gamma-1) / Gamma(2-gamma), eta being Dirichlet's function.

        Examples
        --------
        >>> import hereditary as hd
        >>> eq = hd.Equation(hd.Caputo(2.0), lambda t, x: -9.0 * x, y0=[1.0, 0.0])
        >>> round(hd.ExplicitCaputo().step_limit(eq, 9.0), 12)
        0.666666666667
        """
        stiffness = within("stiffness", stiffness, 5e-324, np.inf, "(0, inf)")
        system = instance("equation", equation, Equation, "hereditary.Equation(...)").system
        if system.varies:
            refuse("equation", "have constant orders", repr(equation), "ask for those of one time")
        return largest_step(lambda h: self._limits(system, h)[: system.n_solved], stiffness)

    def _limits(self, system: System, h: float) -> np.ndarray:
        """Return the stiffness (d,) above which x_n = (-1)**n grows, for steps h."""
        distinct, groups = system.distinct
        limits = np.zeros(len(distinct))
        for i, key in enumerate(distinct):
            for c, operator in key:
                factor, _, kernel = weighed(c, operator, h)
                limits[i] += factor * kernel.alternating() * (4 if operator.derivative == 2 else 2)
        return limits[groups]

    def plan(self, system: System, h: float) -> Plan:
        """Return the plan of this scheme for `system` with uniform steps h."""
        if system.varies:
            return varying_plan(system, h, 1.0, explicit=True)
        above_one = system.highest_orders() > 1
        speed = h * system.y0[1] if system.m == 2 else 0.0
        speeds = partial(by_rule, h=h, rule=FIRST_DIFFERENCES)
        starts: list[Any] = [(lambda c, op: speeds(-c, op), np.where(above_one, speed, 0.0))]
        if any(op.kernel is not None and op.derivative == 0 for op, _ in system.left):
            # y(0) is a start value if a kernel acts on y itself, because increments omit it
            values = partial(value_weights, h=h, theta=0.0, derivative=0)
            starts.append((values, system.y0[0]))
        return uniform_plan(
            system, h, 0.0, partial(weighed, h=h), starts=starts, whole=True,
            given=above_one.astype(np.int64), slowest=SLOWEST,
        )  # fmt: skip
