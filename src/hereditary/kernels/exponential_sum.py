"""Power laws as sums of exponentials, in closed form.

``t**-a = 1/Gamma(a) int exp(-t e**x + a x) dx`` over the real line. The trapezoid rule of step h
turns the integral into exponentials with rates e**(j h). Its error is known exactly, so h follows
from the tolerance. Negligible fast rates are dropped by a closed-form bound, and the infinitely
many slow rates are replaced by a Gauss rule. Sums are constructed on [1, R] and scaled.

The rates of the grid are those of every order, with weights ``h / Gamma(a) exp(a h j)``. For orders
that vary, three nodes that all orders share replace the slow rates: 0 and two others. Their weights
keep the first three moments.
"""

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.special import gammaincc, gammainccinv, gammaln, loggamma, rgamma

from ..support.checks import positive, refuse, within

# Fraction of the tolerance for the trapezoidal rule. It adds up to 1 with the fractions of both
# cuts.
_TRAPEZOID_FRACTION = 0.90
# Fraction of the tolerance for the cut at fast rates.
_FAST_CUT_FRACTION = 0.05
# Fraction of the tolerance for the cut at slow rates.
_SLOW_CUT_FRACTION = 0.05
# Numbers m of nodes of the Gauss rules for slow rates, and log((2 m)! 4**(2 m)) of their errors.
_SLOW_RULES = np.arange(1, 40)
_OF_SLOW_RULES = gammaln(2 * _SLOW_RULES + 1) + 2 * _SLOW_RULES * math.log(4.0)
# Check points in one oscillation of the error curve in log t, whose band limit is 2 pi / h. The
# largest error at these points is below the maximum by at most 0.9 %.
_DIVISIONS = 24
# Fewest check points of the error curve.
_FEWEST_POINTS = 200
# An error below tol divided by this number at all check points is below tol at all times.
_CERTIFICATE = 1.01
# Steps h in log(rate) are multiples of 24 / 2**30. Then logarithms of rates and of check points,
# which divide them, are exact, and so are the logarithms of products of both.
_UNIT_STEP = _DIVISIONS / 2**30
_TOL_MIN = 1e-13
# A fit is constructed for these fractions of the tolerance, in turn, until its checked error is
# below the tolerance.
_FRACTIONS = 1.0, 0.9, 0.7, 0.5
# Least tolerance of a fit: this constant plus this multiple of log(R), which is the rounding of
# powers.
_MIN_TOL_BY_ROUNDING = 1.2e-14, 3e-16
RATIO_MAX = 1e100
# Number of slow rates that all orders share, in units of the fastest of them: nodes of Chebyshev
# and of Radau. With three of them all weights are positive; with more they are not for every order.
SLOW_NODES = 3
_SLOW_RATE_NODES = (1 - np.cos(2 * np.pi * np.arange(SLOW_NODES) / (2 * SLOW_NODES - 1))) / 2
# Exponents below this are replaced by it. So an exponent that rounding takes for 0 has the weights
# of a small one.
SMALLEST = 1e-290


def fit_interval(t_min: Any, t_max: Any, tol: Any) -> tuple[float, float, float]:
    """Return the arguments of a fit as floats, checked."""
    t_min = positive("t_min", t_min)
    t_max = positive("t_max", t_max)
    tol = tolerance("tol", tol)
    if not 1 < t_max / t_min <= RATIO_MAX:
        refuse("t_max", f"lie between t_min = {t_min} and {RATIO_MAX:g} times that", t_max)
    return t_min, t_max, tol


def tolerance(argument: str, value: Any) -> float:
    """Return `value`, checked as a tolerance that sums can reach in double precision."""
    remedy = "double precision sums cannot keep less than 1e-13"
    return within(argument, value, _TOL_MIN, 0.1, "[1e-13, 0.1]", remedy)


class UnitFit(NamedTuple):
    """Exponential sums of several kernels over one set of rates, on [1, R]."""

    rates: np.ndarray  # (n_modes,)
    weights: np.ndarray  # (n_kernels, n_modes), not negative; 0 for rates that only others use
    error: float  # largest relative error found [-]
    fraction: float  # of the tolerance for the trapezoid rule, which sets the grid of rates


@lru_cache(maxsize=64)
def fit_unit(
    exponents: tuple[float, ...], ratio: float, tol: float, fraction: float | None = None
) -> UnitFit:
    """Fit several kernels ``t**-a``, 0 <= a <= 2, on [1, ratio] with one set of rates."""
    # fraction: that of an earlier fit, whose grid of rates is kept
    if not exponents:
        return UnitFit(np.zeros(0), np.zeros((0, 0)), 0.0, 1.0)
    if 0.0 in exponents:
        return _with_constant(exponents, ratio, tol, fraction)
    goal = tol / _CERTIFICATE
    allowed = max(goal, _MIN_TOL_BY_ROUNDING[0] + _MIN_TOL_BY_ROUNDING[1] * math.log(ratio))
    for tried in _FRACTIONS if fraction is None else (fraction,):
        grid = _construct(exponents, ratio, goal * tried)
        rates, weights, error = _trim(exponents, ratio, allowed, grid)
        if error <= allowed or tried == fraction:
            break
    else:
        raise ArithmeticError(f"no exponential sum found for {exponents}, {ratio}, {tol}")
    rates.flags.writeable = False
    weights.flags.writeable = False
    return UnitFit(rates, weights, error, tried)


def _with_constant(
    exponents: tuple[float, ...], ratio: float, tol: float, fraction: float | None
) -> UnitFit:
    """Fit kernels of which some are constant, ``t**0``, by a mode of rate 0 and weight 1."""
    fit = fit_unit(tuple(a for a in exponents if a > 0), ratio, tol, fraction)
    full = np.zeros((len(exponents), fit.rates.size + 1))
    full[[a > 0 for a in exponents], 1:] = fit.weights
    full[[a == 0 for a in exponents], 0] = 1.0
    return fit._replace(rates=np.concatenate([[0.0], fit.rates]), weights=full)


def trapezoid_step(a: float, tol: float) -> float:
    """Return the step h in log(rate) at which the trapezoid rule has the relative error 0.9 tol."""
    # The infinite rule for t**-a has the relative error 2 Re sum_k Gamma(a + 2 pi i k/h)/Gamma(a)
    # t**(-2 pi i k/h), of which k = 1 dominates. The step also gives the least possible number of
    # modes, ceil(log(4 R) / h) (docs/theory.md).
    goal = math.log(_TRAPEZOID_FRACTION * tol) - math.log(2.0) + gammaln(a)

    def excess(u: float) -> float:
        return loggamma(complex(a, 2 * math.pi * u)).real - goal

    u, previous = -math.log(tol) / math.pi**2, 0.5
    f_previous = excess(previous)
    if f_previous <= 0:
        return 2.0
    for _ in range(60):
        f = excess(u)
        if abs(f) < 1e-10 or f == f_previous:
            break
        u, previous, f_previous = u - f * (u - previous) / (f - f_previous), u, f
    return _UNIT_STEP * math.floor(min(2.0, 1 / u) / _UNIT_STEP)


def grid_spacing(exponents: Iterable[float], tol: float, fraction: float) -> float:
    """Return the spacing of log(rate) in `fit_unit`; inf if all kernels are constant."""
    others = [a for a in exponents if a > 0]
    return min((trapezoid_step(a, fraction * tol / _CERTIFICATE) for a in others), default=math.inf)


class _Grid(NamedTuple):
    """Rates of a sum: slow rates (n,), and exp(j h) with j = first, first + 1, ..."""

    slow: np.ndarray
    h: float
    first: int
    weights: np.ndarray  # (n_kernels, n + n_grid), those of the slow rates first

    def kept(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the n slowest rates, ascending, and their weights."""
        grid = np.arange(self.first, self.first + n - self.slow.size)
        rates = np.concatenate([self.slow, np.exp(self.h * grid)])
        order = np.argsort(rates, kind="stable")
        return rates[order], np.take(self.weights, order, axis=1)


def _construct(exponents: tuple[float, ...], ratio: float, tol: float) -> _Grid:
    """Return the rates on a grid, the slow nodes of each kernel, and the weights."""
    h = min(trapezoid_step(a, tol) for a in exponents)
    pieces = [_one_kernel(a, h, ratio, tol) for a in exponents]
    first = min(j0 for j0, *_ in pieces)
    last = max(j1 for _, j1, *_ in pieces)
    grid = np.arange(first, last + 1)
    slow_rates = np.concatenate([nodes for _, _, nodes, _ in pieces])
    weights = np.zeros((len(exponents), slow_rates.size + grid.size))
    offset = 0
    for row, a, (j0, j1, nodes, masses) in zip(weights, exponents, pieces, strict=True):
        row[offset : offset + nodes.size] = masses
        offset += nodes.size
        used = (grid >= j0) & (grid <= j1)
        row[slow_rates.size :][used] = np.exp(math.log(h) - gammaln(a) + a * h * grid[used])
    return _Grid(slow_rates, h, first, weights)


def _one_kernel(
    a: float, h: float, ratio: float, tol: float
) -> tuple[int, int, np.ndarray, np.ndarray]:
    """Return first and last grid index, and the Gauss rule that replaces slower rates."""
    fast = max(a, float(gammainccinv(a, _FAST_CUT_FRACTION * tol)))
    while gammaincc(a, fast) > _FAST_CUT_FRACTION * tol:  # the inverse is inaccurate for tiny a
        fast *= 1.05
    m, kappa = _slow_cut(a, h, tol)
    j_slow = math.floor(math.log(kappa / ratio) / h)
    j_fast = math.ceil(math.log(fast) / h)
    nodes, masses = _slow_tail(a, h, j_slow, m)
    return j_slow + 1, max(j_fast, j_slow + 1), nodes, masses


def _slow_cut(a: float, h: float, tol: float) -> tuple[int, float]:
    """Choose the size m of the slow Gauss rule, which replaces rates up to kappa/R, and kappa."""
    # The relative error of the m-point rule for t <= R is at most a h/(1-exp(-a h)) kappa**a
    # / Gamma(a+1) 4 (kappa/4)**(2m)/(2m)!. A kappa saves log(kappa)/h grid rates for m nodes.
    of_mass = math.log(_SLOW_CUT_FRACTION * tol / 4) + math.log(-math.expm1(-a * h) / (a * h))
    of_mass += math.lgamma(a + 1)
    log_kappa = (of_mass + _OF_SLOW_RULES) / (a + 2 * _SLOW_RULES)
    best = int(np.argmin(_SLOW_RULES - log_kappa / h))
    return int(_SLOW_RULES[best]), math.exp(log_kappa[best])


def _slow_tail(a: float, h: float, j_slow: int, m: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the m-point Gauss rule for the measure of all grid rates exp(j h), j <= j_slow."""
    # Relative to the fastest one these are q**i, i = 0, 1, ..., with masses p**i, where q = exp(-h)
    # and p = exp(-a h). Their polynomials are the little q-Jacobi ones, whose recurrence is known.
    n = np.arange(m)

    def rest(k: float | np.ndarray) -> float | np.ndarray:
        return -np.expm1(-h * k)

    up = np.exp(-h * n) * rest(a + n) ** 2 / (rest(a + 2 * n) * rest(a + 2 * n + 1))
    k = n[1:]
    down = np.exp(-h * (a + k - 1)) * rest(k) ** 2 / (rest(a + 2 * k - 1) * rest(a + 2 * k))
    jacobi = np.diag(up)
    jacobi[k, k] += down
    jacobi[k, k - 1] = np.sqrt(up[:-1] * down)  # eigh reads the lower half
    nodes, vectors = np.linalg.eigh(jacobi)
    unit = math.exp(math.log(h) - gammaln(a) + a * h * j_slow) / rest(a)
    return math.exp(h * j_slow) * np.maximum(nodes, 0.0), unit * vectors[0] ** 2


def _trim(
    exponents: tuple[float, ...], ratio: float, goal: float, grid: _Grid
) -> tuple[np.ndarray, np.ndarray, float]:
    """Drop the fastest rates while errors are below `goal`; return rates, weights and error."""
    # log(t) is a multiple of a fraction of the grid, so that t times rate has few values
    slow, h, first, weights = grid
    n_slow, n = slow.size, weights.shape[1]
    finer = max(0, math.ceil(math.log2(_FEWEST_POINTS * h / (_DIVISIONS * math.log(ratio)))))
    between = _DIVISIONS * 2**finer
    logs = np.arange(math.ceil(math.log(ratio) * between / h)) * (h / between)
    t = np.append(np.exp(logs), ratio)
    table = np.empty((n, t.size))
    table[:n_slow] = np.exp(-np.multiply.outer(slow, t))
    numbers = np.arange(first * between, (first + n - n_slow - 1) * between + logs.size)
    decayed = np.exp(-np.exp(numbers * (h / between)))  # at t times rate, exact as multiples are
    table[n_slow:, :-1] = sliding_window_view(decayed, logs.size)[::between]
    table[n_slow:, -1] = np.exp(-ratio * np.exp(h * np.arange(first, first + n - n_slow)))
    powers = np.array([t**a for a in exponents])
    excess = powers * (weights @ table) - 1
    error = float(np.abs(excess).max())
    while n > max(n_slow, 1):
        trial = excess - powers * np.multiply.outer(weights[:, n - 1], table[n - 1])
        trial_error = float(np.abs(trial).max())
        if trial_error > goal:
            break
        excess, error, n = trial, trial_error, n - 1
    return *grid.kept(n), error


@lru_cache(maxsize=16)
def bank_of_all_orders(ratio: float, tol: float) -> tuple[np.ndarray, float, float]:
    """Rates (M,) with which ``t**-a`` is a sum of exponentials on [1, ratio], a in (0, 1]; h, x."""
    # rates of the grid, h apart in log(rate) after x, ascend before the slow ones
    a = np.append(1e-9, np.linspace(0.01, 1.0, 100))
    h = min(trapezoid_step(value, tol / 1.01) for value in (1e-3, 0.5, 1.0))
    fast = max(1.0, float(gammainccinv(1.0, _FAST_CUT_FRACTION * tol)))
    # three nodes replace the rates up to kappa / t: they err by left * kappa**3 times the weight of
    # these rates, which is exp(mass) * kappa**a
    u = np.linspace(0.0, 1.0, 513)
    left = np.abs(np.prod(u[:, None] - _SLOW_RATE_NODES, axis=1)).max() / math.factorial(SLOW_NODES)
    mass = np.log(h) - gammaln(a) - np.log(-np.expm1(-a * h))
    log_kappa = ((math.log(_SLOW_CUT_FRACTION * tol / left) - mass) / (a + SLOW_NODES)).min()
    j_slow = math.floor((log_kappa - math.log(ratio)) / h)
    grid = h * np.arange(j_slow + 1, math.ceil(math.log(fast) / h) + 1)
    rates = np.concatenate([np.exp(grid), _SLOW_RATE_NODES * math.exp(h * j_slow)])
    rates.flags.writeable = False
    return rates, h, h * j_slow


def weights_of_orders(a: np.ndarray, ratio: float, tol: float) -> np.ndarray:
    """Return weights of these rates for kernels ``t**-a``, a (k,) in (0, 1], shape (M, k)."""
    rates, h, x = bank_of_all_orders(ratio, tol)
    a = np.maximum(a, SMALLEST)
    k = np.arange(SLOW_NODES)[:, None]
    moments = np.exp(a * x) / -np.expm1(-(a + k) * h)
    grid = np.exp(a * (x + h * np.arange(1, rates.size - SLOW_NODES + 1)[:, None]))
    return h * rgamma(a) * np.concatenate([grid, weights_of_moments() @ moments])


@lru_cache(maxsize=1)
def weights_of_moments() -> np.ndarray:
    """Return the matrix from the moments of the slow rates to the weights of the nodes."""
    return np.linalg.inv(np.vander(_SLOW_RATE_NODES, increasing=True).T)
