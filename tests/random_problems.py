"""Random linear problems with exact solutions, and how the error of a run is judged.

A kind of problem draws its numbers by ``uniform(low, high)``, be it hypothesis' or a generator's.
Orders lie in 1e-6 .. 1.98 and rates reach 1e6. Left out is what takes a second or more: more than
some 200 periods; rates above 1e6 to the power of ten times the order, for several terms, complex
eigenvalues and, with orders below 0.06, real ones, for much of a solution then happens at times
down to 1e-300 and bent functions do not follow it; and, in systems, tolerances below what rounding
leaves of the right-hand side. Two more take 100,000 steps or end at t = 0: complex eigenvalues next
to the edge of stability below 1e-9, and terms closer than 0.1 to each other of which the highest
lies just above order 1.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import hereditary as hd
from hereditary import exact


@dataclass(frozen=True)
class Linear:
    """An equation, its exact solution, how late a run may end, and whether it only decays.

    `rtol` is the least tolerance worth asking for: where large numbers cancel in the right-hand
    side, their rounding counts as an error of each step.
    """

    name: str
    equation: hd.Equation
    solution: Callable[[np.ndarray], np.ndarray]
    t_end: float = np.inf
    decays: bool = False
    rtol: float = 1e-12


def linear(t, y, dy, p):
    """dy = A y + b, params A by rows and then b."""
    d = y.shape[0]
    for c in range(d):
        dy[c] = p[d * d + c]
        for e in range(d):
            dy[c] += p[c * d + e] * y[e]


def proportional(terms, rate, y0):
    """``terms = -rate y``."""
    return hd.Equation(terms, linear, y0, params=[-rate, 0.0])


def relaxing(uniform):
    """One term up to order 1."""
    return relaxation(uniform(0.02, 1.0), 10 ** uniform(-2.0, 6.0))


def tiny(uniform):
    """One term of an order below 0.1, most of whose course may be over at 1e-300."""
    order, rate = 10 ** uniform(-6.0, -1.0), 10 ** uniform(-2.0, 6.0)
    # order 1e-3 and rate 1e6 end at t = 0 with 1e-11, as rounding hides the tolerance
    return relaxation(order, rate, max(1e-12, 1e-16 * rate))


def swinging(uniform):
    """One term above order 1."""
    alpha, speed = uniform(1.001, 1.98), uniform(-2.0, 2.0)
    rate = 10 ** uniform(-2.0, 6.0)
    equation = proportional(hd.Caputo(alpha), rate, [1.0, speed])
    solution = exact.relaxation(alpha, rate, [[1.0], [speed]])
    return Linear(f"oscillation {alpha:.2f}, {rate:.0e}", equation, solution, late(alpha, rate))


def several_terms(uniform):
    """Two or three terms of any orders."""
    n = 2 + round(uniform(0.0, 1.0))
    orders = np.sort([uniform(0.02, 1.98) for _ in range(n)])
    coefficients = [*(10 ** uniform(-1.0, 1.0) for _ in orders[1:]), 1.0]
    if 1 < orders[-1] < min(1.1, orders[-2] + 0.1):
        orders[-1] += 0.1
    rate, y0 = 10 ** uniform(-1.0, stiffest(orders[-1])), [1.0, uniform(-2.0, 2.0)]
    y0 = y0 if orders[-1] > 1 else y0[:1]
    terms = [c * hd.Caputo(a) for c, a in zip(coefficients, orders, strict=True)]
    solution = exact.several_terms(orders, coefficients, y0, rate)
    name = f"terms {', '.join(f'{order:.2f}' for order in orders)}, {rate:.0e}"
    equation = proportional(terms, rate, y0)
    return Linear(name, equation, solution, late(orders[-1], rate), decays=orders[-1] <= 1)


def spiral(uniform):
    """A pair of complex eigenvalues, just stable or more, and a forcing."""
    alpha = uniform(0.02, 1.0)
    size, angle = 10 ** uniform(-1.0, stiffest(alpha)), uniform(1.02 * alpha * np.pi / 2, 3.1)
    real, imag = size * np.cos(angle), size * np.sin(angle)
    return system("spiral", uniform, alpha, np.array([[real, -imag], [imag, real]]), size, 1e-9)


def pair(uniform):
    """Two negative eigenvalues of any sizes, and a forcing."""
    alpha = uniform(0.02, 1.0)
    rates = [10 ** uniform(-1.0, min(6.0, 100 * alpha)) for _ in range(2)]
    return system("pair", uniform, alpha, np.diag(np.negative(rates)), max(rates))


KINDS = [relaxing, tiny, swinging, several_terms, spiral, pair]


def relaxation(alpha, rate, rtol=1e-12):
    """``D^alpha y = -rate y``, which only decays."""
    equation = proportional(hd.Caputo(alpha), rate, 1.0)
    name = f"relaxation {alpha:.2g}, {rate:.0e}"
    return Linear(name, equation, exact.relaxation(alpha, rate), rtol=rtol, decays=True)


def system(kind, uniform, alpha, core, size, rtol=1e-12):
    """Two components coupled so that their matrix has the eigenvalues of `core`."""
    basis = np.array([[1.0, uniform(-1.0, 1.0)], [uniform(-0.5, 0.5), 1.0]])
    matrix = basis @ core @ np.linalg.inv(basis)
    y0, forcing = ([uniform(-1.0, 1.0), uniform(-1.0, 1.0)] for _ in range(2))
    equation = hd.Equation(hd.Caputo(alpha), linear, y0, params=[*matrix.ravel(), *forcing])
    solution = exact.system(alpha, matrix, y0, forcing)
    name, rtol = f"{kind} {alpha:.2f}, {size:.0e}", max(rtol, 1e-14 * size)
    return Linear(name, equation, solution, rtol=rtol)


def stiffest(order):
    """Logarithm of the largest rate taken with this order, where no bent functions help."""
    return min(6.0, 60 * order)


def late(order, rate):
    """A time after some 200 periods where they do not fade at once."""
    return 1e3 / rate ** (1 / order) if order > 1.5 else np.inf


def points(sol):
    """Step ends, times between them, and some very close to the start."""
    ends = sol.t[:: 1 + sol.t.size // 200]
    inside = ends[:-1, None] + np.diff(ends)[:, None] * [0.13, 0.5, 0.91]
    start = sol.t[0] + (sol.t[1] - sol.t[0]) * 10.0 ** -np.arange(1, 16, 2)
    return np.unique(np.concatenate([ends, sol.t[-1:], inside.ravel(), start]))


def deviation(sol, solution, decays=False):
    """Largest error at those times over size + 0.01 of its largest, the components taken together.

    Size is y at that time where solutions only decay, and elsewhere the largest y so far, for an
    oscillation carries its errors through its zeros.
    """
    t = points(sol)
    y = solution(t)
    size = np.abs(y).max(axis=1)
    size = size if decays else np.maximum.accumulate(size)
    scale = np.maximum(size + 0.01 * size.max(), 1e-200)
    return float((np.abs(sol(t) - y).max(axis=1) / scale).max())


def error(sol, solution, rtol, decays=False):
    """Largest error over tolerance, which is rtol times that."""
    return deviation(sol, solution, decays) / rtol
