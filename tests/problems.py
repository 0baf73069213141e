"""Named problems with exact solutions, and what makes each of them hard."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import mpmath
import numpy as np
import scipy.sparse as sp
from scipy.special import erfcx, gamma, rgamma, wofz

import hereditary as hd

relaxation = hd.exact.relaxation


@dataclass(frozen=True)
class Problem:
    """An equation and its exact solution.

    Attributes
    ----------
    name : str
    equation : callable
        Makes the equation.
    exact : callable
        ``exact(t)``, shape (len(t), d).
    t_end : float
    """

    name: str
    equation: Callable[[], hd.Equation]
    exact: Callable[[np.ndarray], np.ndarray]
    t_end: float


def column(values):
    return np.asarray(values, dtype=float).reshape(-1, 1)


def monomial(t, order, power):
    """Caputo's derivative of t**power, power > 0 and above order - 1."""
    return rgamma(power + 1 - order) / rgamma(power + 1) * t ** (power - order)


def mittag_leffler(alpha, z, beta=1.0):
    """E_(alpha, beta)(z) of a complex number by its series."""
    with mpmath.workdps(60):
        a, z = mpmath.mpf(alpha), mpmath.mpmathify(z)
        return complex(mpmath.fsum(z**k * mpmath.rgamma(a * k + beta) for k in range(400)))


def laplacian(d):
    """Second differences of d places on a line of length 1, 0 at both ends."""
    ones = np.ones(d - 1)
    parts = [ones, -2 * np.ones(d), ones]
    return (sp.diags_array(parts, offsets=[-1, 0, 1]) * (d + 1.0) ** 2).tocsr()


def plane(m):
    """The same of m by m places on a square."""
    one = laplacian(m)
    return (sp.kron(one, sp.eye_array(m)) + sp.kron(sp.eye_array(m), one)).tocsr()


def half_order_relaxation(t):
    return column(erfcx(np.sqrt(t)))


def half_order_oscillator(t):
    """D^1.5 x + 0.5 D^0.5 x + x = 0, x(0) = 1, x'(0) = 0, by partial fractions in sqrt(s)."""
    roots = np.roots([1.0, 0.0, 0.5, 1.0])
    residues = (roots**2 + 0.5) / (3 * roots**2 + 0.5)
    z = np.multiply.outer(np.sqrt(np.asarray(t, dtype=float)), roots)
    return column((residues * wofz(1j * -z)).sum(axis=1).real)


def _half_order_equation():
    return hd.Equation([hd.Caputo(1.5), 0.5 * hd.Caputo(0.5)], lambda t, x: -x, y0=[1.0, 0.0])


def _smooth(beta, gamma):
    """D^beta x + 0.5 D^gamma x + x = rhs with x = 1 + 2 t + t**3."""
    params = (6 * rgamma(4 - beta), 6 * rgamma(4 - gamma), 2 * rgamma(2 - gamma), beta, gamma)

    def rhs(t, x, p):
        forcing = p[0] * t ** (3 - p[3]) + 0.5 * (p[1] * t ** (3 - p[4]) + p[2] * t ** (1 - p[4]))
        return forcing + (1 + 2 * t + t**3) - x

    return hd.Equation(hd.Caputo(beta) + 0.5 * hd.Caputo(gamma), rhs, [1.0, 2.0], params)


def _incommensurate():
    """D^(1.3, 0.6) of (t + t**2, 1 + t**2), coupled."""

    def rhs(t, y, dy, p):
        first, second = t + t**2, 1 + t**2
        dy[0] = p[0] * t**0.7 + second - y[1] + 0.5 * (first - y[0])
        dy[1] = p[1] * t**1.4 + 2 * (first - y[0])

    params = (2 * rgamma(1.7), 2 * rgamma(2.4))
    return hd.Equation(hd.Caputo([1.3, 0.6]), rhs, [[0.0, 1.0], [1.0, 0.0]], params)


@cache
def smooth_problem(alpha):
    """D^alpha y + y = rhs with y = 1 + t**3 (and y'(0) = 0 for orders above 1)."""
    params, y0 = (6 * rgamma(4 - alpha), alpha), 1.0 if alpha <= 1 else [1.0, 0.0]

    def rhs(t, y, p):
        return p[0] * t ** (3 - p[1]) + 1 + t**3 - y

    equation = partial(hd.Equation, hd.Caputo(alpha), rhs, y0, params=params)
    return Problem(f"smooth {alpha}", equation, lambda t: column(1 + t**3), 1.0)


@cache
def singular_problem(alpha, rate=1.0, t_end=2.0, name=None):
    """D^alpha y + y = 0, y(0) = 1 (and y'(0) = 0.5 for orders above 1), by Mittag-Leffler."""
    if alpha <= 1:
        equation = partial(hd.scenes.relaxation, alpha, rate, 1.0)
        exact = relaxation(alpha, rate, 1.0)
    else:
        equation = partial(hd.Equation, hd.Caputo(alpha), lambda t, y: -y, [1.0, 0.5])
        exact = relaxation(alpha, rate, (1.0, 0.5))
    return Problem(name or f"singular {alpha}", equation, exact, t_end)


PROBLEMS = [
    Problem(
        "relaxation 0.5",
        lambda: hd.scenes.relaxation(alpha=0.5, rate=1.0, y0=1.0),
        half_order_relaxation,
        5.0,
    ),
    Problem("oscillator 1.5 0.5", _half_order_equation, half_order_oscillator, 20.0),
    *(
        Problem(
            f"smooth {beta} {gamma}",
            partial(_smooth, beta, gamma),
            lambda t: column(1 + 2 * t + t**3),
            1.0,
        )
        for beta, gamma in ((1.2, 0.3), (1.5, 0.5), (1.8, 0.8), (1.95, 0.05), (2.0, 1.0))
    ),
    *(smooth_problem(alpha) for alpha in (0.1, 0.3, 0.5, 0.8, 0.95, 1.0)),
    Problem("incommensurate 1.3 0.6", _incommensurate, lambda t: np.c_[t + t**2, 1 + t**2], 1.0),
    Problem(
        "classical oscillator",
        lambda: hd.scenes.oscillator(beta=2.0, gamma=1.0, friction=0.2, x0=1.0, v0=0.5),
        lambda t: column(np.exp(-0.1 * t) * (np.cos(W * t) + (0.5 + 0.1) / W * np.sin(W * t))),
        10.0,
    ),
]
W = np.sqrt(1 - 0.01)


def _powers_rhs(t, y, p):
    """Diethelm, Ford and Freed's problem with alpha = 0.5; y is kept from below 0 by rounding."""
    known = p[0] * t**7.5 - p[1] * t**3.75 + p[2]
    return known + (1.5 * t**0.25 - t**4) ** 3 - np.abs(y) ** 1.5


def _powers():
    params = (40320 * rgamma(8.5), 3 * gamma(5.25) * rgamma(4.75), 2.25 * gamma(1.5))
    return hd.Equation(hd.Caputo(0.5), _powers_rhs, 0.0, params)


def _two_orders():
    """Orders 0.9 and 0.4: a relaxation, coupled to 1 + t**1.3, which it never feels exactly."""

    def rhs(t, y, p):
        return np.array([-y[0] + 2.0 * (y[1] - 1.0 - t**1.3), p[0] * t**0.9])

    return hd.Equation(hd.Caputo([0.9, 0.4]), rhs, [1.0, 1.0], (gamma(2.3) * rgamma(1.9),))


# Each needs a scheme chosen for what makes it hard; tests/test_problems.py says which.
HARD = [
    singular_problem(0.8, 1e6, 10.0, "stiff 0.8"),
    singular_problem(0.3, 1e4, 10.0, "stiff 0.3"),
    singular_problem(0.02, 1.0, 1.0, "small order 0.02"),
    singular_problem(0.05, 1.0, 1.0, "small order 0.05"),
    singular_problem(0.5, 1.0, 1e4, "long time 0.5"),
    singular_problem(0.999, 1.0, 5.0, "order 0.999"),
    singular_problem(1.001, 1.0, 5.0, "oscillation 1.001"),
    singular_problem(1.999, 1.0, 5.0, "oscillation 1.999"),
    Problem("powers 0.5", _powers, lambda t: column(t**8 - 3 * t**4.25 + 2.25 * t**0.5), 1.0),
    Problem(
        "two orders",
        _two_orders,
        lambda t: np.c_[relaxation(0.9, 1.0, 1.0)(t), 1 + t**1.3],
        3.0,
    ),
]


@cache
def exact_rows(problem, n):
    """The solution at n uniform steps."""
    return problem.exact(np.linspace(0.0, problem.t_end, n + 1))


def errors(problem, scheme, history, n):
    """Largest error of a component at t_end, and over all times, with n uniform steps."""
    how = {"scheme": scheme, "history": history, "estimate": False}
    sol = hd.solve(problem.equation(), problem.t_end, n, **how)
    off = np.abs(sol.y - exact_rows(problem, n))
    return float(off[-1].max()), float(off.max())


def observed_order(n_steps, errors):
    """Return the order that errors at these numbers of steps show, by least squares."""
    return -np.polyfit(np.log(n_steps), np.log(errors), 1)[0]


def run(equation, scheme=None, length=2.0, n=200, rtol=1e-9, **given):
    """Solve over a length of time, in n steps or, by collocation, within a tolerance."""
    steps = {"rtol": rtol} if isinstance(scheme, hd.Collocation) else {"n_steps": n}
    return hd.solve(equation, equation.t_start + length, scheme=scheme, **steps, **given)


def assert_converges(end, exact, n_steps, order, bound, off=0.15):
    """Hold errors of y, which `end` gives for these numbers of steps, to an order and a bound."""
    errors = [np.abs(end(n) - exact).max() for n in n_steps]
    assert errors[-1] < bound, errors
    assert abs(observed_order(n_steps, errors) - order) < off, errors


def errors_on_mesh(problem, scheme, history, mesh):
    """Largest error of a component over all times on a mesh."""
    sol = hd.solve(problem.equation(), problem.t_end, mesh=mesh, scheme=scheme, history=history)
    return float(np.abs(sol.y - problem.exact(sol.t)).max())


def linear_and_rest(alpha, powers):
    """Two components, a constant matrix and a nonlinear rest; y(1) of a known solution.

    y = (1, 2) (1 + sum_k t**powers_k).
    """
    mu = np.array(powers)
    factors = gamma(1 + mu) / gamma(1 + mu - alpha)

    def rhs(t, y, dy, p):
        k = (p.size - 1) // 2
        x, derivative = 1.0, 0.0
        for i in range(k):
            x += t ** p[i]
            derivative += p[k + i] * t ** (p[i] - p[-1])
        dy[0] = derivative + np.sin(y[0] * y[1]) - np.sin(2 * x * x)
        dy[1] = 2 * derivative + 1.5 * x + np.cos(y[0]) - np.cos(x)

    start = np.array([1.0, 2.0])
    y0 = start if alpha <= 1 else [start, 0 * start]
    params = [*mu, *factors, alpha]
    return hd.Equation(
        hd.Caputo(alpha), rhs, y0, params, linear=[[-2.0, 1.0], [0.5, -1.0]]
    ), start * (1 + mu.size)


def _late(t, y, delayed, p):
    return p[0] * delayed[0]


def delayed_growth(alpha, k):
    """D^alpha y = k y(t - 1), with y = 1 up to 0."""
    y0 = [1.0] if alpha <= 1 else [1.0, 0.0]
    return hd.Equation(hd.Caputo(alpha), _late, y0, params=[k], memory=hd.Delay(1.0))


def delayed_growth_at(alpha, k, t):
    """Solution of `delayed_growth` at times t (n,): its Laplace transform is a sum over delays."""
    j = np.arange(int(np.max(t)) + 2)
    powers = np.maximum(t[:, None] - j + 1.0, 0.0) ** (j * alpha) * rgamma(j * alpha + 1)
    powers[:, 0] = 1.0
    return powers @ k**j


# Values of `mackey_glass` at two times.
MACKEY_GLASS = {20.0: 0.95637921316, 60.0: 0.953997344661}


def mackey_glass():
    """Mackey and Glass's equation of order 0.95 with the delay 2."""
    return hd.Equation(
        hd.Caputo(0.95),
        lambda t, y, late: 2 * late[0] / (1 + late[0] ** 9.65) - y,
        0.5,
        memory=hd.Delay(2.0, past=0.5),
    )
