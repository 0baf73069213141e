"""The explicit Grünwald-Letnikov scheme.

The power series of ``((1-z)/h)**alpha`` acts on samples of x - x(0). In terms of increments
``y_n = x_(n+1) - x_n`` this is ``h**-alpha sum_k W_k y_(n-k)``, where W_k are the coefficients of
``(1-z)**(alpha-1)``. Above order 1 the series acts on x - x(0) - t x'(0). This subtracts
``h**-alpha S_n h x'(0)``, where S_n is the sum of W_0 to W_n.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from scipy.special import rgamma

from ...equation.equation import Equation
from ...equation.system import System
from ...kernels.special import mean_exponential
from ...stepping.scheme import Scheme, check_smoothness
from ...support.checks import instance, refuse, within
from ..plan import Plan, WeightRule
from ..stability import largest_step
from ..uniform_plan import uniform_plan
from ..watch import SLOWEST
from .bdf import exponent, quadrature_weights, weighed_by_power


@dataclass(frozen=True)
class GrunwaldLetnikov(Scheme):
    r"""The explicit Grünwald-Letnikov scheme, for orders in (0, 2].

    The power series of ``((1-z)/h)**alpha`` replaces the derivative. It acts on x - x(0), and above
    order 1 on x - x(0) - t x'(0). This equation is solved for x_(n+1):

    .. math::

        h^{-\alpha} \sum_{k=0}^{n+1} (-1)^k \binom{\alpha}{k}
        \left( x_{n+1-k} - x(0) - (n+1-k) h x'(0) \right) = f(t_n, x_n)

    The implicit form, with the right-hand side at t_(n+1), is ``BDF(1)``. In lower terms ``BDF(1)``
    has exact derivatives of t x'(0). At order 1 the scheme is Euler's method. At order 2 it is the
    classical difference scheme with ``x_1 = x(0) + h x'(0) + h**2 f(0, x(0))``. The scheme takes
    any number of terms and components.

    Parameters
    ----------
    map : bool, optional
        True for a map with memory, whose steps are the equation and not an approximation of it.
        Then no error is estimated, and steps may alternate. With ``n_steps=t_end`` and one term
        it is the map of Wu and Baleanu of order alpha <= 1.

    Error
    -----
    At a fixed t > 0 the error is O(h), for smooth solutions and for solutions like t**alpha. For
    one term of order 2 it is O(h**2) if x''(0) = 0 (convergence/orders.py,
    tests/schemes/test_grunwald_letnikov.py).

    Stability
    ---------
    Conditional, with the sharp limit `step_limit`. `solve` checks increments as it does
    for `ExplicitCaputo`.

    Cost
    ----
    A step takes one evaluation of the right-hand side, and one sum by the history.

    Source
    ------
    [SchererEtAl2011]; the power series: [Lubich1986]; maps: [WuBaleanu2014].

    Examples
    --------
    >>> import hereditary as hd
    >>> eq = hd.scenes.relaxation(0.5)
    >>> sol = hd.solve(eq, 1.0, n_steps=1000, scheme=hd.GrunwaldLetnikov())
    >>> round(float(sol.y[-1, 0]), 3)
    0.428
    """

    map: bool = False

    solve: ClassVar[str] = "explicit"
    whole: ClassVar[bool] = True
    plans_by_terms: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not isinstance(self.map, bool):
            refuse("map", "be True or False", repr(self.map), kind=TypeError)

    def __repr__(self) -> str:
        return f"GrunwaldLetnikov({'map=True' if self.map else ''})"

    @property
    def is_map(self) -> bool:
        """Whether the steps are the equation itself and not an approximation of it."""
        return self.map

    def order(self, alpha: float, smoothness: str = "smooth") -> float:
        """Return the order of convergence at a fixed time: 1 for every alpha in (0, 2].

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
            K in ``D^alpha x + ... = -K x``, above 0 [1/time**order].

        Returns
        -------
        float
            The h at which ``sum_j c_j (2/h)**alpha_j = stiffness``. The limit is sharp: solutions
            are bounded for smaller h and zigzag for larger h.

        Examples
        --------
        >>> import hereditary as hd
        >>> eq = hd.Equation(hd.Caputo(0.5), lambda t, x: -4.0 * x, y0=1.0)
        >>> round(hd.GrunwaldLetnikov().step_limit(eq, 4.0), 12)
        0.125
        """
        system = instance("equation", equation, Equation, "hereditary.Equation(...)").system
        self.check_terms(system)
        stiffness = within("stiffness", stiffness, 5e-324, np.inf, "(0, inf)")
        return largest_step(lambda h: self._limits(system, h)[: system.n_solved], stiffness)

    def _limits(self, system: System, h: float) -> np.ndarray:
        """Return the stiffness (d,) above which x_n = (-1)**n grows, for steps h."""
        distinct, groups = system.distinct
        limits = [sum(c * (2 / h) ** op.order for c, op in key) for key in distinct]
        return np.array(limits)[groups]

    def plan(self, system: System, h: float) -> Plan:
        """Return the plan of this scheme for `system` with uniform steps h."""
        starts: list = [(None, 0.0)]
        if system.m == 2:  # h x'(0) is the second start value: the first one does not act in step 0
            start = np.where(system.highest_orders() > 1, h * system.y0[1], 0.0)
            starts.append((partial(weighed_by_power, h=h, rule=SPEED), start))
        weighed = partial(weighed_by_power, h=h, rule=POWER_SERIES)
        return uniform_plan(system, h, 0.0, weighed, starts=starts, whole=True, slowest=SLOWEST)


def _modal(alpha: float, rates: np.ndarray, weights: np.ndarray, k: int) -> np.ndarray:
    """Return contributions of modes of t**-alpha to W_k."""
    # W_k = sin(pi alpha)/pi int exp(-k s) (exp(s) - 1)**(alpha-1) ds
    shares = weights * rgamma(1 - alpha) * mean_exponential(rates) ** (alpha - 1)
    return shares * np.exp(-rates * (k + 1 - alpha))


def _speed(alpha: float, n: int) -> np.ndarray:
    """Return weights of h x'(0): -S_k above order 1, otherwise 0; W_0 = 1 is added for k = 0."""
    # explicit steps are solved for the change of the increment, and h x'(0) is the increment before
    # the first step, which the added W_0 cancels
    sums = -_EULER_WEIGHTS.exact(alpha - 1, n) if alpha > 1 else np.zeros(n)
    sums[:1] += 1.0
    return sums


def _speed_exponent(alpha: float) -> float | None:
    return exponent(alpha - 1) if alpha > 1 else None


def _modal_speed(alpha: float, rates: np.ndarray, weights: np.ndarray, k: int) -> np.ndarray:
    return -_modal(alpha - 1, rates, weights, k)


_EULER_WEIGHTS = quadrature_weights(1)
# Rule of the weights W_k of increments, and rule of the weights of h x'(0).
POWER_SERIES = WeightRule(_EULER_WEIGHTS.exact, exponent, _modal)
SPEED = WeightRule(_speed, _speed_exponent, _modal_speed)
