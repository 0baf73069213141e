"""Convolution quadrature by backward difference formulas.

Let ``delta(z) = sum_(k=1)^p (1-z)**k / k``. The power series of ``(delta(z) / h)**alpha`` acts on
the samples of x - x(0) - t x'(0) and approximates the derivative of order alpha. In terms of
increments w it is ``h**-alpha sum_k W_k w_(n-k)``, where W_k are the coefficients of
``delta(z)**alpha / (1 - z)``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial, reduce
from typing import Any

import numpy as np
from scipy.special import factorial, rgamma

from ...equation.system import System
from ...equation.terms import ConstantOrder
from ...stepping.scheme import Scheme, check_smoothness
from ...support.checks import count, refuse, within
from ..plan import Plan, WeightRule
from ..power_series import series_of_power
from ..uniform_plan import uniform_plan

# First k from which the weights W_k are sums of exponentials up to 1e-11, for p = 1 to 6. Before
# it the parasitic roots of delta contribute, like 0, 1/3, 0.43, 0.56, 0.71, 0.86 to the power k.
_FIRST_MODAL = (20, 26, 33, 48, 81, 189)
# Largest order of an equation, for p = 1 to 6. Up to this order an undamped oscillation stays
# inside the formula's sector of stability. The order is pi / (pi - theta), where the sector has
# theta = 90, 90, 86.03, 73.35, 51.84, 17.84 degrees.
_LARGEST_ORDER = (2.0, 2.0, 1.9156, 1.6878, 1.4045, 1.1100)


@dataclass(frozen=True, init=False, repr=False)
class BDF(Scheme):
    """Convolution quadrature by the backward difference formula of order 1 to 6.

    The scheme is implicit, for any number of terms and components with orders in (0, 2]. The first
    p - 1 steps of the formula of order p are corrected with the right-hand side and its time
    derivatives at 0. This restores the full order for solutions that start like t**alpha. No badly
    conditioned starting weights are needed.

    Parameters
    ----------
    order : int
        Order p of the formula, 1 to 6.

    Error
    -----
    At a fixed time the error is O(h**p) if f(t, x(0) + t x'(0)) is smooth and f is linear in x.
    This includes solutions like t**alpha, equations with lower terms, and any x'(0). Otherwise a
    part t**mu of f along the solution causes an error of O(h**(1+mu)). For nonlinear f mu is
    2 alpha (convergence/orders.py).

    Stability
    ---------
    No step limit for ``D^alpha y = -K y``, K > 0, and alpha up to 2, 2, 1.9156, 1.6878, 1.4045,
    1.1100 for p = 1 to 6. Higher orders are refused.

    Source
    ------
    [Lubich1986]; corrections [JinLiZhou2017], section 2.

    Examples
    --------
    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.relaxation(0.5), 1.0, n_steps=200, scheme=hd.BDF(3))
    >>> round(float(sol.y[-1, 0]), 6)
    0.427584
    """

    formula: int

    def __init__(self, order: int = 2) -> None:
        if count("order", order) > 6:
            refuse("order", "lie in 1..6", order, "BDF7 is unstable")
        # the field is not called `order`, because that is the name of a method
        object.__setattr__(self, "formula", int(order))

    def __repr__(self) -> str:
        return f"BDF({self.formula})"

    @property
    def orders(self) -> tuple[float, float]:
        """Highest orders (low, high] of equations for which the formula is stable."""
        return 0.0, _LARGEST_ORDER[self.formula - 1]

    def order(self, alpha: float, smoothness: str = "smooth") -> float:
        """Return the proven order of convergence at a fixed time, for linear equations: p.

        Parameters
        ----------
        alpha : float
            Highest order of the equation, 0 < alpha <= 2 [-].
        smoothness : {"smooth", "singular"}
            Whether the solution is smooth at 0 or behaves like t**alpha there; both give p.
        """
        within("alpha", alpha, 5e-324, self.orders[1], "its sector of stability")
        check_smoothness(smoothness)
        return float(self.formula)

    def plan(self, system: System, h: float) -> Plan:
        """Return the plan of this scheme for `system` with uniform steps h."""
        p = self.formula
        corrections, drift = _start_corrections(system, h, p), _formed_drift(system, h, p)
        if drift is not None:
            at_start, *drift = drift
            at_start[: p - 1] -= corrections
            corrections = -at_start
        # lasting: corrections of the drift extend over _N_EARLY steps
        return uniform_plan(
            system, h, 1.0, partial(weighed_by_power, h=h, rule=quadrature_weights(p)),
            first_modal=_FIRST_MODAL[p - 1], corrections=corrections, drift=drift,
            lasting=drift is not None,
        )  # fmt: skip


def weighed_by_power(
    c: float, operator: ConstantOrder, h: float, rule: WeightRule
) -> tuple[float, WeightRule, float]:
    """Return the factor, rule and order for the term c times an operator, with steps h."""
    return c * h**-operator.order, rule, operator.order


@lru_cache(maxsize=8)
def quadrature_weights(p: int) -> WeightRule:
    """Return the rule whose weights are the coefficients of ``delta(z)**alpha / (1 - z)``."""
    return WeightRule(partial(_exact, p), exponent, partial(_modal, p))


def _exact(p: int, alpha: float, n: int) -> np.ndarray:
    """Return n coefficients of ``(1-z)**(alpha-1) (sum_(k=1)^p (1-z)**(k-1) / k)**alpha``."""
    return series_of_power(_shifted_power_sum(p), float(alpha), n)


@lru_cache(maxsize=8)
def _shifted_power_sum(p: int) -> np.ndarray:
    """Return the coefficients of the polynomial ``sum_(k=1)^p (1-z)**(k-1) / k`` in z."""
    total = np.polynomial.Polynomial([0.0])
    for k in range(1, p + 1):
        total = total + np.polynomial.Polynomial([1.0, -1.0]) ** (k - 1) / k
    return total.coef


def exponent(alpha: float) -> float | None:
    """Return a of the kernel ``t**-a`` behind the weights: alpha, or None for integer orders."""
    # integer orders have no memory beyond 2 p steps
    return None if alpha in (1.0, 2.0) else alpha


def _modal(p: int, alpha: float, rates: np.ndarray, weights: np.ndarray, k: int) -> np.ndarray:
    """Return the contributions to W_k of modes, which are summands of the kernel t**-alpha."""
    # W_k = sin(pi alpha)/pi int exp(-k s) |delta(e**s)|**alpha / (e**s - 1) ds along the cut of the
    # generating function, over s below the first zero of delta(e**s). Rates that have decayed below
    # exp(-45) = 3e-20 at _FIRST_MODAL matter for earlier weights only, which are exact.
    shares = np.zeros_like(rates)
    x = -np.expm1(np.minimum(rates, 50.0))  # 1 - e**s
    quotient = sum(x ** (j - 1) / j for j in range(1, p + 1))  # delta / (1 - e**s)
    positive = (np.cumprod(quotient > 0) > 0) & (rates * _FIRST_MODAL[p - 1] < 45)
    s, grown = rates[positive], -x[positive]
    ratio = np.where(s > 0, grown / np.where(s > 0, s, 1.0), 1.0)
    power = ratio ** (alpha - 1) * quotient[positive] ** alpha
    shares[positive] = weights[positive] * rgamma(1 - alpha) * power * np.exp(-k * s)
    return shares


# Number of first steps in which the error that `drift_defect` describes is computed exactly.
_N_EARLY = 256
# Number of terms in the expansion of this error of `drift_defect`, for later steps. The expansion
# has an error of 1e-12 in sums of 100.
_N_LATE = 3


def _formed_drift(system: System, h: float, p: int) -> Sequence[np.ndarray] | None:
    """Return the error of the formula for t y'(0) in terms of order gamma below 1."""
    # Increments leave out t y'(0), whose exact derivative is a multiple of t**(1-gamma). With it
    # alone the order would be 2 - gamma, so the error is added. Results are its first k values (k,
    # d), and amplitudes and powers of its expansion (r, d). None if p is 1 or no component of order
    # above 1 has such terms.
    above = system.above
    lower = [
        (operator.order, np.where(above, c, 0.0))
        for operator, c in system.left
        if operator.order < 1 and np.any(c[above])
    ]
    if p == 1 or system.m == 1 or not lower:
        return None
    first, k = np.zeros((_N_EARLY, system.d)), np.arange(_N_LATE)
    amplitudes, powers = [], []
    for gamma, c in lower:
        early, late = drift_defect(p, gamma)
        speed = c * system.y0[1]
        first += np.outer(h ** (1 - gamma) * early, speed)
        amplitudes.append(np.outer(h ** (p + k) * late, speed))
        powers.append(np.outer(1 - gamma - p - k, c != 0))
    return first, np.concatenate(amplitudes), np.concatenate(powers)


@lru_cache(maxsize=64)
def drift_defect(p: int, gamma: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the formula's derivative of order gamma of t, less the exact one, for steps of 1."""
    # Samples of t with start corrections b, n + b_n, have the generating function delta**-2 up to
    # (1-z)**p. The formula makes q_n = sum_k W_k (1 + b_(n-k) - b_(n-k-1)) of them. The difference
    # q_n - n**(1-gamma) / Gamma(2-gamma) is expanded in powers from n**(1-gamma-p) on. This is by a
    # series in s of the generating function of q_n at z = exp(-s). Returns the difference at n = 1,
    # 2, .. less its expansion (_N_EARLY,), and coefficients of the expansion (_N_LATE,).
    n = np.arange(1, _N_EARLY + 1)
    b = start_coefficients(p, 1)[: p - 2] if p > 2 else np.zeros(0)
    weights = _exact(p, gamma, _N_EARLY)
    steps = np.diff(b, prepend=0.0, append=0.0)
    formed = np.cumsum(weights) + np.convolve(weights, steps)[:_N_EARLY]
    size = p + _N_LATE
    s = np.arange(size)
    x = (-1.0) ** s / factorial(s + 1)  # (1 - z) / s with z = exp(-s)
    z = np.append(1.0, -x[:-1])
    delta: Any = sum(_product(_power(x, k), np.eye(size)[k - 1]) / k for k in range(1, p + 1))
    start = sum((b_k * _power(z, k) for k, b_k in enumerate(b, 1)), np.zeros(size))
    # series in s of delta**(gamma-2) (delta**2 (z / (1-z)**2 + b)), without the factor s**(gamma-2)
    ratio = _product(_power(delta, 2), _product(z, _real_power(x, -2)))
    ratio += _product(_power(delta, 2), _product(np.eye(size)[2], start))
    total = _product(ratio, _real_power(delta, gamma - 2))
    late = total[p:] * rgamma(2 - gamma - p - np.arange(_N_LATE))
    powers = 1 - gamma - p - np.arange(_N_LATE)
    early = formed - n ** (1 - gamma) * rgamma(2 - gamma)
    early -= np.sum(late[:, None] * n ** powers[:, None], axis=0)
    return early, late


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the product of two power series, with as many coefficients as the first one has."""
    return np.convolve(a, b)[: a.size]


def _power(a: np.ndarray, k: int) -> np.ndarray:
    """Return the k-th power of a power series, k = 0, 1, 2, .., with as many coefficients."""
    return reduce(_product, [a] * k, np.eye(a.size)[0])


def _real_power(a: np.ndarray, exponent: float) -> np.ndarray:
    """Return a real power of a power series with a_0 = 1, with as many coefficients."""
    power = np.eye(a.size)[0]
    for n in range(1, a.size):
        k = np.arange(1, n + 1)
        power[n] = np.sum(((exponent + 1) * k / n - 1) * a[1 : n + 1] * power[n - k])
    return power


def _start_corrections(system: System, h: float, p: int) -> np.ndarray:
    """Return corrections of the right-hand side in the first p - 1 steps, shape (p-1, d)."""
    # a_n phi(0) + sum_(l=1)^(p-2) b_(l,n) h**l phi^(l)(0) in step n, phi(t) = f(t, x(0) + t x'(0))
    # less terms of order 1 applied to t x'(0). Derivatives are from differences over p values.
    # Memory that f reads has its value at 0 in phi.
    if p == 1:
        return np.zeros((0, system.d))
    speed = np.where(system.is_memory, 0.0, system.y0[-1] if system.m == 2 else 0.0)
    values = np.array([system.rhs(i * h, system.at_start + i * h * speed) for i in range(p)])
    values -= np.where(system.above, system.coefficient(1.0), 0.0) * speed
    values[:, system.is_memory] = 0.0
    nodes = np.arange(p)
    taylor = np.linalg.solve(np.vander(nodes, increasing=True).astype(float), values)
    derivatives = taylor * np.cumprod(np.maximum(nodes, 1))[:, None]  # h**l phi^(l)(0)
    summands = (np.outer(start_coefficients(p, n), derivatives[n]) for n in range(p - 1))
    return sum(summands, np.zeros((p - 1, system.d)))


@lru_cache(maxsize=32)
def start_coefficients(p: int, order: int) -> np.ndarray:
    """Return the coefficients b_(l,n) of start corrections, n = 1 .. p-1, for l = `order`."""
    # For l = 0 they are the a_n. delta(z)**(l+1) (sum_n n**l z**n / l! + sum_n b_n z**n) = 1 +
    # O((1-z)**p), so t**l / l! is integrated with full order. Both sides are polynomials in x = 1 -
    # z.
    x = np.polynomial.Polynomial([0.0, 1.0])
    z = 1 - x
    quotient = sum((x ** (k - 1) / k for k in range(1, p + 1)), 0 * x)  # delta / x
    numerator = z  # sum_n n**l z**n = numerator / x**(l+1)
    for j in range(order):
        numerator = z * (-numerator.deriv() * x + (j + 1) * numerator)
    scale = float(factorial(order))
    power = quotient ** (order + 1)
    target = _coefficients(1 - power * numerator / scale, p)
    unknown = p - 1 - order
    columns = [_coefficients(power * x ** (order + 1) * z**n, p) for n in range(1, unknown + 1)]
    solved = np.linalg.solve(np.array(columns).T[order + 1 :], target[order + 1 :])
    return np.concatenate([solved, np.zeros(order)])


def _coefficients(polynomial: Any, n: int) -> np.ndarray:
    return np.pad(polynomial.coef, (0, n))[:n]
