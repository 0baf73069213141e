"""Adams-type schemes in integral form: predictor-corrector and product trapezoid.

The equation ``c D^alpha x = f`` is written as ``x = x(0) + t x'(0) + J^alpha f / c``, J^alpha being
the fractional integral. On each step f is linear in t. Then each increment of x, less that of
t x'(0), is a weighted sum of values of f. All weights have the factor
``h**alpha / Gamma(alpha+2) / c``.

For f_(n+1-k), k steps before the end of the step to t_(n+1), the weight is W_k. Here ``W_0 = 1``,
``W_k = G_k - G_(k-1)`` and ``G_k = (k+1)**(alpha+1) - 2 k**(alpha+1) + (k-1)**(alpha+1)``. For f_0
the weight is ``A_n - A_(n-1)`` with ``A_n = n**(alpha+1) - (n-alpha) (n+1)**alpha``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import ClassVar

import numpy as np
from scipy.special import rgamma

from ...equation.system import System
from ...equation.terms import ConstantOrder
from ...kernels.special import first_moment_exponential, gauss_unit, mean_exponential
from ...stepping.scheme import Scheme, check_smoothness
from ...support.checks import count, within
from ..plan import Plan, WeightRule
from ..uniform_plan import uniform_plan
from ..watch import QUICK


def hat_weights(alpha: float, n: int) -> np.ndarray:
    """Return the weights W_0 .. W_(n-1) of values of f, computed without cancellation."""
    weights = np.ones(n)
    g = [1.0, 2 ** (alpha + 1) - 2, 3 ** (alpha + 1) - 2 * 2 ** (alpha + 1) + 1]
    weights[1:3] = np.diff(g)[: n - 1]
    if n > 3:
        rising, falling = _power_steps(alpha, n)
        weights[3:] = rising[:-1] + falling[1:]
    return weights


def start_weights(alpha: float, n: int) -> np.ndarray:
    """Return the weights A_k - A_(k-1) of f_0 for k = 0 .. n-1, with A_(-1) = 0."""
    weights = np.full(n, alpha)
    if n > 1:
        weights[1] = 1 - (1 - alpha) * 2**alpha - alpha
    if n > 2:
        weights[2:] = _power_steps(alpha, n)[0]
    return weights


@lru_cache(maxsize=4)
def _power_steps(alpha: float, n: int) -> np.ndarray:
    """Return integrals that make the weights, over [k, k+1] for k = 2 .. n-1, (2, n - 2)."""
    # Of alpha (alpha+1) (t**(alpha-1) - (t-1)**(alpha-1)) times t - k in row 0, and k + 1 - t in
    # row 1. Gauss's rule has 16 points below k = 16, six below k = 256, and three beyond. As the
    # singularity is k - 1 steps off, errors are 5.8**-32 at k = 2, 60**-12 at 16, 1000**-6 at 256.
    integrals, first = [], 2
    for points, end in ((16, min(n, 16)), (6, min(n, 256)), (3, n)):
        v, q = gauss_unit(points)
        before = np.arange(first, max(first, end))[:, None] - 1 + v
        shrink = np.expm1((alpha - 1) * np.log1p(1 / before))
        values = alpha * (alpha + 1) * before ** (alpha - 1) * shrink
        integrals.append(values @ np.array([q * v, q * (1 - v)]).T)
        first = max(first, end)
    return np.concatenate(integrals).T


def _exponent(alpha: float) -> float | None:
    """Return a of the kernel ``t**-a`` whose sum of exponentials gives the weights."""
    # t**(alpha-1) for alpha < 1, t**(alpha-2) for alpha > 1; None at 1, where there is no memory
    if alpha == 1:
        return None
    return 1 - alpha if alpha < 1 else 2 - alpha


def _step_share(alpha: float, rates: np.ndarray) -> np.ndarray:
    """Return the contributions of modes to ``t**(alpha-1) - (t-1)**(alpha-1)`` at t = 1."""
    # for unit weights of modes, with the factor alpha (alpha+1)
    if alpha < 1:
        return alpha * (alpha + 1) * np.expm1(-rates)
    return alpha * (alpha + 1) * (alpha - 1) * mean_exponential(rates)


def _modal_hat(alpha: float, rates: np.ndarray, weights: np.ndarray, k: int) -> np.ndarray:
    hat = mean_exponential(rates) ** 2
    return _step_share(alpha, rates) * weights * hat * np.exp(-rates * (k - 2))


def _modal_start(alpha: float, rates: np.ndarray, weights: np.ndarray, k: int) -> np.ndarray:
    ramp = first_moment_exponential(rates)
    # at k = 0 the result grows like exp(rates); it is used only times decays exp(-rates k), k >= 2
    return _step_share(alpha, rates) * weights * ramp * np.exp(-rates * (k - 1))


# Rule of the weights W_k of values of f, and that of the weights of f_0.
HATS = WeightRule(hat_weights, _exponent, _modal_hat)
FIRST_VALUE = WeightRule(start_weights, _exponent, _modal_start)


def _plan(system: System, h: float, corrections: int) -> Plan:
    """Make the plan of the product trapezoidal rule with this number of corrector sweeps."""
    # corrections 0: an implicit step by Newton's method
    weighed, start = (partial(_weighed, h=h, rule=rule) for rule in (HATS, FIRST_VALUE))
    return uniform_plan(
        system, h, 1.0, weighed, starts=[(start, 0.0)], integral=True, first_modal=3,
        sweeps=corrections, slowest=QUICK,
    )  # fmt: skip


def _weighed(
    c: float, operator: ConstantOrder, h: float, rule: WeightRule
) -> tuple[float, WeightRule, float]:
    """Return the factor, rule and order of a term c D^alpha: weights of f on the left side."""
    return -(h**operator.order) * rgamma(operator.order + 2) / c, rule, operator.order


@dataclass(frozen=True)
class Adams(Scheme):
    """Fractional Adams predictor-corrector (PECE), orders in (0, 2], one term in each component.

    On each step f is linear in t. On the newest step the predictor has a constant f. Each
    correction then uses the new value of f. The scheme is explicit. Components may have different
    orders.

    Parameters
    ----------
    corrections : int
        Number m >= 1 of corrections; a step takes m + 1 evaluations of the right-hand side.

    Error
    -----
    At a fixed time the error is O(h**min(2, 1 + (m + 1) alpha)) if f along the solution is smooth.
    The prediction has an error of O(h**(1+alpha)), and each correction gains a factor h**alpha. For
    solutions like t**alpha the error is O(h**min(2, 1 + alpha)) (convergence/orders.py).

    Stability
    ---------
    Conditional. Consider ``D^alpha y = -K y`` with one correction. For orders up to 1 K h**alpha
    must be below Gamma(alpha + 2), which is 1.02 to 2. Above order 1 the limit is about 1.5 to 2.5.
    At order 2 the solution grows slowly with any step (docs/stability.md).

    Beyond the limit the solution grows or, with a force that saturates, stays bounded and wrong.
    `solve` checks in every step whether corrections contract, K h**alpha < Gamma(alpha + 2). It
    also checks whether increments grow while their sign changes every few steps.

    Source
    ------
    [DiethelmFordFreed2002], eqs. (1.10) to (1.15); several sweeps [Diethelm2010], appendix C.

    Examples
    --------
    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.relaxation(0.8), 1.0, n_steps=1000, scheme=hd.Adams())
    >>> round(float(sol.y[-1, 0]), 4)
    0.3869
    """

    corrections: int = 1
    solve: ClassVar[str] = "sweeps"
    several_terms: ClassVar[bool] = False

    def __post_init__(self) -> None:
        count("corrections", self.corrections)

    def order(self, alpha: float, smoothness: str = "smooth") -> float:
        """Return the proven order of convergence at a fixed time, on uniform steps.

        Parameters
        ----------
        alpha : float
            Order of the equation, 0 < alpha <= 2 [-].
        smoothness : {"smooth", "singular"}
            Whether the solution is smooth at 0 or behaves like t**alpha there.
        """
        alpha = within("alpha", alpha, 5e-324, 2.0, "(0, 2]")
        check_smoothness(smoothness)
        gains = self.corrections + 1 if smoothness == "smooth" else 1
        return min(2.0, 1 + gains * alpha)

    def plan(self, system: System, h: float) -> Plan:
        """Return the plan of this scheme for `system` with uniform steps h."""
        return _plan(system, h, self.corrections)


@dataclass(frozen=True)
class ProductTrapezoid(Scheme):
    """The product trapezoidal rule, the implicit form of `Adams`.

    On each step f is linear in t, and Newton's method finds its new value. Orders are in (0, 2],
    with one term in each component. Components may have different orders.

    Error
    -----
    At a fixed time the error is O(h**2) if f along the solution is smooth. For solutions like
    t**alpha it is O(h**min(2, 1 + alpha)) (convergence/orders.py).

    Stability
    ---------
    No step limit for orders up to 1. Above order 1, for ``D^beta y = -K y``, K h**beta must be
    below ``Gamma(beta + 2) / (4 |eta(-1-beta)|)``, eta being Dirichlet's function. This is 50 for
    beta = 1.05, 9.3 for 1.6, and 12 for 2 (docs/stability.md). `solve` checks whether increments
    zigzag or grow beyond it.

    Source
    ------
    [DiethelmFordFreed2002], eq. (1.10), solved for its left side.

    Examples
    --------
    >>> import hereditary as hd
    >>> scheme = hd.ProductTrapezoid()
    >>> sol = hd.solve(hd.scenes.relaxation(0.8), 1.0, n_steps=1000, scheme=scheme)
    >>> round(float(sol.y[-1, 0]), 4)
    0.3869
    """

    several_terms: ClassVar[bool] = False
    plans_by_terms: ClassVar[bool] = True

    def order(self, alpha: float, smoothness: str = "smooth") -> float:
        """Return the proven order of convergence at a fixed time; see `Adams.order`."""
        alpha = within("alpha", alpha, 5e-324, 2.0, "(0, 2]")
        check_smoothness(smoothness)
        return 2.0 if smoothness == "smooth" else min(2.0, 1 + alpha)

    def plan(self, system: System, h: float) -> Plan:
        """Return the plan of this scheme for `system` with uniform steps h."""
        return _plan(system, h, 0)
