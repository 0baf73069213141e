"""Problems of peers.py, each as an equation and in the form that other codes take.

Exact solutions: sums of powers, Mittag-Leffler functions (`hereditary.exact`), a sine. The two van
der Pol references are Taylor series in 48 digits and more; two orders and lengths of step agree in
18. P1 to P6 are those of work_precision.py.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numba import njit
from scipy.special import gamma
from work_precision import POWERS, TITLES, cases, largest, last, powers

import hereditary as hd
from hereditary import exact

# x(20) with mu = 1 and x(200) with mu = 100, from x(0) = 2, x'(0) = 0.
VAN_DER_POL = {1.0: (20.0, 2.00814976217494859), 100.0: (200.0, 1.71858720801924065)}


@dataclass(frozen=True)
class System:
    """A problem as other codes take it: one order a component, f(t, y) returns the values.

    Components beyond those of the problem are derivatives between its terms. `grading` is the
    mesh's exponent, 1 for uniform steps; docs/benchmark.md says how it was chosen.
    """

    orders: tuple[float, ...]
    f: Callable
    y0: tuple
    jac: Callable | None = None
    grading: float = 1.0


@dataclass(frozen=True)
class Problem:
    """A problem, how its error is taken, and who solves it beside `Collocation`."""

    name: str
    title: str
    equation: hd.Equation
    t_end: float
    alpha: float
    error: Callable
    schemes: tuple = (hd.ExplicitCaputo(), hd.BDF(2), hd.L2())
    counts: tuple = (100, 1000, 10_000, 100_000)
    system: System | None = None
    peer_counts: tuple = (16, 125, 500, 2000)
    scipy: tuple = ()


def largest_of_some(exact):
    """Largest error over 200 of the mesh's times, dense next to 0, where `exact` is slow."""

    def error(t, y):
        some = np.unique(np.geomspace(1, t.size, 200).astype(int)) - 1
        return np.abs(y[some] - exact(t[some])).max()

    return error


def jitted(fun):
    """Return a compiled function, which some of the scenes' are already."""
    return fun if hasattr(fun, "py_func") else njit(fun)


def compiled(equation):
    """Return f(t, y) of an equation whose right-hand side fills dy, compiled."""
    fill, p = jitted(equation.rhs), np.array(equation.params, dtype=float)

    @njit
    def f(t, y):
        dy = np.empty_like(y)
        fill(t, y, dy, p)
        return dy

    return f


def known_problems():
    """P1 to P6."""
    found = {name: (case, error) for case in cases() for name, error in case.errors.items()}
    systems = known_systems(found)
    for name, title in TITLES.items():
        case, error = found[name]
        more = {"counts": (10, 30, 100, 1000, 10_000, 100_000)} if name in ("P1", "P2") else {}
        if name not in ("P1", "P3"):
            more["peer_counts"] = (16, 125, 500, 2000, 8000)
        own = (case.equation, case.t_end, case.alpha, error)
        yield Problem(name, title, *own, system=systems[name], **more)


def known_systems(found):
    """P1 to P6 in one order a component.

    P3: x, D^0.5 x, x'. P5: x, x', D^0.8 x, since D^1.8 x = D^0.8 x' and D^0.2 D^0.8 x = x'.
    """
    scalar, stick = njit(powers), found["P5"][0].equation
    push, p = jitted(stick.rhs), np.array(stick.params, dtype=float)

    @njit
    def sum_of_powers(t, y):
        return np.array([scalar(t, y, POWERS)])

    @njit
    def stick_slip(t, y):
        force = np.empty(1)
        push(t, y[:1], force, p)
        return np.array([y[1], force[0] - 0.25 * y[2], y[1]])

    start = np.array([1.2, 2.8])
    product, two = compiled(found["P4"][0].equation), compiled(found["P6"][0].equation)
    return {
        "P1": System(
            (0.5,), njit(lambda t, y: -y), (np.ones(1),), lambda t, y: -np.ones(1), grading=2.0
        ),
        "P2": System(
            (0.5,), sum_of_powers, (np.zeros(1),), lambda t, y: -1.5 * np.sqrt(np.maximum(y, 0))
        ),
        "P3": System(
            (0.5, 0.5, 0.5),
            njit(lambda t, y: np.array([y[1], y[2], -0.5 * y[1] - y[0]])),
            (np.array([1.0, 0.0, 0.0]),),
            grading=2.0,
        ),
        "P4": System((0.8, 0.8), product, (start,)),
        "P5": System((1.0, 0.8, 0.2), stick_slip, (np.array([0.2, 0.3, 0.0]),)),
        "P6": System((1.3, 0.8), two, (start, np.array([1.0, 0.0]))),
    }


def three_orders():
    """Xue and Bai's problem of three orders: (t + 1, t**1.2 + 0.5, t**1.8 + 0.3) [XueBai2017].

    Its right-hand side has no bounded slope at t = 0.
    """

    def rhs(t, y, dy, p):
        product = max((y[1] - 0.5) * (y[2] - 0.3), 0.0)
        dy[0] = (product ** (1 / 6) + np.sqrt(t)) / np.sqrt(np.pi)
        dy[1] = p[0] * (y[0] - 1)
        dy[2] = p[1] * (y[1] - 0.5)

    orders, start = (0.5, 0.2, 0.6), np.array([1.0, 0.5, 0.3])
    params = (gamma(2.2), gamma(2.8) / gamma(2.2))
    equation = hd.Equation(hd.Caputo(list(orders)), rhs, start, params=params)
    return Problem(
        "three orders",
        "Xue and Bai, 0.5, 0.2, 0.6",
        equation,
        5.0,
        0.6,
        largest(lambda t: np.column_stack([t + 1, t**1.2 + 0.5, t**1.8 + 0.3])),
        schemes=(hd.BDF(2), hd.L2()),
        system=System(orders, compiled(equation), (start,), grading=3.0),
    )


def third_order():
    """``D^3 x + D^2.5 x + x'' + 4 x' + D^0.5 x + 4 x = 6 cos t``, x = sqrt(2) sin(t + pi / 4)."""
    operator = hd.Caputo(3) + hd.Caputo(2.5) + hd.Caputo(2) + 4 * hd.Caputo(1) + hd.Caputo(0.5)

    @njit
    def chain(t, y):  # x, x', x'', D^2.5 x, D^0.5 x
        end = 6 * np.cos(t) - y[3] - y[2] - 4 * y[1] - y[4] - 4 * y[0]
        return np.array([y[1], y[2], y[3], end, y[1]])

    return Problem(
        "order 3",
        "five terms, order 3",
        hd.Equation(operator, lambda t, x: 6 * np.cos(t) - 4 * x, [1.0, 1.0, -1.0]),
        50.0,
        3.0,
        largest(lambda t: np.sqrt(2) * np.sin(np.asarray(t)[:, None] + np.pi / 4)),
        schemes=(hd.BDF(2),),
        counts=(1000, 10_000, 100_000),
        system=System(
            (1.0, 1.0, 0.5, 0.5, 0.5),
            chain,
            (np.array([1.0, 1.0, -1.0, 0.0, 0.0]),),
            grading=1.5,
        ),
    )


def stiff_chain():
    """A decays into B into C at rates of 10^4, 100 and 1, order 0.8."""
    matrix = np.array([[-1e4, 0.0, 0.0], [1e4, -100.0, 0.0], [0.0, 100.0, -1.0]])
    start, solution = np.array([1.0, 0.0, 0.0]), exact.system(0.8, matrix, [1.0, 0.0, 0.0])

    def rhs(t, y, dy, p):
        dy[0] = -1e4 * y[0]
        dy[1] = 1e4 * y[0] - 100.0 * y[1]
        dy[2] = 100.0 * y[1] - y[2]

    equation = hd.Equation(hd.Caputo(0.8), rhs, start)
    return Problem(
        "stiff chain",
        "stiff chain, order 0.8",
        equation,
        10.0,
        0.8,
        largest_of_some(solution),
        schemes=(hd.BDF(2), hd.L2()),
        system=System((0.8,) * 3, compiled(equation), (start,), lambda t, y: matrix, grading=2.5),
    )


def diffusion(d):
    """D^0.7 u = u_xx on d inner points, u(0) = x (1 - x)."""
    x = np.arange(1, d + 1) / (d + 1)
    parts = np.array([1.0, -2.0, 1.0]) * (d + 1.0) ** 2
    matrix = sp.diags_array(parts, offsets=[-1, 0, 1], shape=(d, d)).tocsr()
    start, dense = x * (1 - x), matrix.toarray()
    return Problem(
        f"diffusion {d}",
        f"diffusion, {d} components",
        hd.Equation(hd.Caputo(0.7), None, start, linear=matrix),
        1.0,
        0.7,
        largest_of_some(exact.system(0.7, dense, start)),
        schemes=(hd.BDF(2), hd.L2()),
        counts=(30, 100, 1000, 10_000),
        system=System(
            (0.7,) * d, njit(lambda t, y: dense @ y), (start,), lambda t, y: dense, 2 / 0.7
        ),
        peer_counts=(16, 125, 500, 2000) if d < 20 else (16, 125, 500),
    )


def van_der_pol(mu):
    """x'' = mu (1 - x**2) x' - x as two equations of order 1."""

    def rhs(t, y, dy, p):
        dy[0] = y[1]
        dy[1] = p[0] * (1 - y[0] * y[0]) * y[1] - y[0]

    @njit
    def jac(t, y):
        return np.array([[0.0, 1.0], [-2 * mu * y[0] * y[1] - 1, mu * (1 - y[0] * y[0])]])

    t_end, value = VAN_DER_POL[mu]
    start, stiff = np.array([2.0, 0.0]), mu > 10
    equation = hd.Equation(hd.Caputo(1.0), rhs, start, params=[mu])
    return Problem(
        f"van der Pol {mu:g}",
        f"van der Pol, mu = {mu:g}, order 1",
        equation,
        t_end,
        1.0,
        last(value),
        schemes=() if stiff else (hd.BDF(2), hd.BDF(4)),
        system=System((1.0, 1.0), compiled(equation), (start,), jac),
        peer_counts=(),
        scipy=("Radau", "LSODA") if stiff else ("DOP853", "LSODA"),
    )


def problems():
    """All of them, in the order of the tables."""
    yield from known_problems()
    yield three_orders()
    yield third_order()
    yield stiff_chain()
    yield from map(diffusion, (10, 40))
    yield from map(van_der_pol, VAN_DER_POL)
