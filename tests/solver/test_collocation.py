"""Adaptive collocation on every kind of equation it takes.

How errors compare with tolerances is in test_collocation_tolerance.py, extremes of orders, rates
and times in test_collocation_reach.py.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import half_order_relaxation
from random_problems import error, points, proportional
from scipy.integrate import solve_ivp
from scipy.special import gamma, rgamma

import hereditary as hd
from hereditary import exact

pytestmark = pytest.mark.core


def predators(t, y, dy, p):
    dy[0] = y[0] * (1.0 - y[1])
    dy[1] = y[1] * (y[0] - 1.0)


def pendulum(t, y, dy, p):
    dy[0] = -np.sin(y[0]) + 0.2 * np.cos(t)


@pytest.mark.parametrize("rtol", [1e-5, 1e-8, 1e-10])
def test_classical_equations(rtol):
    """Orders 1 and 2, against an explicit Runge-Kutta method of order 8."""
    cases = [
        (hd.Equation(hd.Caputo(1.0), predators, [1.5, 1.0]), predators, [1.5, 1.0], False),
        (hd.Equation(hd.Caputo(2.0), pendulum, [1.0, 0.5]), pendulum, [1.0, 0.5], True),
    ]
    for equation, rhs, y0, second in cases:

        def flow(t, y, rhs=rhs, second=second):
            dy = np.empty(2)
            rhs(t, y, dy, ())
            return [y[1], dy[0]] if second else dy

        found = solve_ivp(flow, (0, 20), y0, "DOP853", rtol=1e-13, atol=1e-14, dense_output=True)
        sol = hd.solve(equation, 20.0, rtol=rtol)
        solution = found.sol(points(sol)).T
        y = np.hstack([sol(points(sol)), sol(points(sol), 1)]) if second else sol(points(sol))
        assert np.abs(y - solution).max() <= 10 * rtol * np.abs(solution).max()


def mixed(t, y, dy, p):
    dy[0] = -y[0] + 0.5 * y[1] * y[2]
    dy[1] = np.cos(t) - y[1] - 0.2 * y[0] ** 2
    dy[2] = -2.0 * y[2] + y[0]
    dy[3] = -np.sin(y[3]) + 0.3 * y[1]


def mixed_jacobian(t, y, jacobian, p):
    jacobian[:] = 0.0
    jacobian[0, :3] = -1.0, 0.5 * y[2], 0.5 * y[1]
    jacobian[1, :2] = -0.4 * y[0], -1.0
    jacobian[2, 0], jacobian[2, 2] = 1.0, -2.0
    jacobian[3, 1], jacobian[3, 3] = 0.3, -np.cos(y[3])


def mixed_equation(jac=None, orders=(1.0, 0.6, 1.4, 2.0)):
    y0 = np.array([[1.0, 0.5, 0.2, 1.0], [0.0, 0.0, -0.3, 0.5]])
    return hd.Equation(hd.Caputo(list(orders)), mixed, y0, jac=jac)


def test_classical_and_fractional_components_together():
    """Against BDF in fine steps, whose error shrinks fourfold where its steps are halved."""
    t_eval = [0.5, 1.0, 2.0, 3.0]
    fine, finer = (
        hd.solve(mixed_equation(), 3.0, n, scheme=hd.BDF(2), t_eval=t_eval).y for n in (1000, 2000)
    )
    error_of_bdf = np.abs(finer - fine)
    sol = hd.solve(mixed_equation(), 3.0, rtol=1e-8)
    assert np.all(np.abs(sol(t_eval) - finer) <= error_of_bdf + 1e-7)
    assert error_of_bdf.max() < 1e-4
    tight = hd.solve(mixed_equation(), 3.0, rtol=1e-11)
    assert error(sol, tight, 1e-8) <= 1


def manufactured(t, y, dy, p):
    """Components 1 + t**e_c of orders a_c, coupled by what is 0 for the solution; p = e, a, c."""
    d = y.shape[0]
    for c in range(d):
        b = (c + 1) % d
        before = y[b] - 1.0 - t ** p[b]
        dy[c] = p[2 * d + c] * t ** (p[c] - p[d + c]) + before - 2.0 * (y[c] - 1.0 - t ** p[c])


ORDERS = st.lists(st.floats(0.1, 2.0), min_size=3, max_size=3)
EXTRA = st.lists(st.sampled_from([0.0, 0.3, 1.0]), min_size=3, max_size=3)


@settings(max_examples=15)
@given(ORDERS, EXTRA)
def test_incommensurate_systems(orders, extra):
    """Any orders in one system: solutions 1 + t**e with e the order or above it."""
    orders, powers = np.array(orders), np.add(orders, extra)
    factors = gamma(powers + 1) * rgamma(powers + 1 - orders)
    y0 = [np.ones(3), np.zeros(3)] if orders.max() > 1 else np.ones(3)
    parameters = [*powers, *orders, *factors]
    equation = hd.Equation(hd.Caputo(orders), manufactured, y0, parameters)
    sol = hd.solve(equation, 2.0, rtol=1e-7)
    assert sol.success
    assert error(sol, lambda t: 1 + t[:, None] ** powers, 1e-7) <= 10


@pytest.mark.parametrize("rtol", [1e-5, 1e-10])
def test_differences_serve_as_well_as_the_jacobian(rtol):
    one, other = (hd.solve(mixed_equation(jac), 5.0, rtol=rtol) for jac in (None, mixed_jacobian))
    t = np.linspace(0.01, 5, 50)
    assert np.abs(one(t) - other(t)).max() <= rtol
    assert other.stats["n_rhs"] < one.stats["n_rhs"]


def test_absolute_tolerances_spare_what_is_small():
    """Errors of a decay to 1e-9 of its start stay below atol, in fewer steps than rtol takes."""
    equation, solution = proportional(hd.Caputo(1.0), 1.0, 1.0), exact.relaxation(1.0)
    fine, coarse = (hd.solve(equation, 20.0, rtol=1e-11, atol=a) for a in (1e-16, 1e-4))
    assert np.abs(coarse.y - solution(coarse.t)).max() <= 1e-4
    np.testing.assert_allclose(fine.y, solution(fine.t), rtol=1e-7)
    assert coarse.stats["n_steps"] < fine.stats["n_steps"]


def test_the_tolerance_of_the_modes_can_be_tightened():
    """By default it follows from rtol; a looser one is not used: it would look like roughness."""
    equation = hd.scenes.oscillator(1.5, 0.5)
    own, tight, loose = (
        hd.solve(equation, 20.0, rtol=1e-7, history=history)
        for history in (None, hd.SumOfExponentials(1e-13), hd.SumOfExponentials(1e-3))
    )
    assert tight.stats["n_modes"] > own.stats["n_modes"]
    assert np.array_equal(loose.y, own.y)


@pytest.mark.parametrize("nodes", [2, 3, 5, 12])
def test_any_number_of_nodes_keeps_the_tolerance(nodes):
    sol = hd.solve(hd.scenes.relaxation(0.5), 5.0, rtol=1e-6, scheme=hd.Collocation(nodes=nodes))
    assert error(sol, half_order_relaxation, 1e-6) <= 10


@given(st.floats(0.2, 0.95), st.floats(1.0, 30.0))
def test_runs_do_not_depend_on_runs_before_or_beside_them(order, t_end):
    """Bit for bit: tables of factors are kept from run to run."""
    eq = hd.Equation(hd.Caputo(order), lambda t, y: np.cos(t) - y, 1.0)

    def rows(end=t_end):
        return hd.solve(eq, end, rtol=1e-6).y

    fresh = rows()
    rows(0.7 * t_end)
    assert np.array_equal(rows(), fresh)
    with ThreadPoolExecutor(4) as pool:
        assert all(np.array_equal(found, fresh) for found in pool.map(lambda _: rows(), range(8)))


def test_a_term_in_two_parts_is_the_term():
    """Equal operators with equal coefficients share all but their numbers."""

    def solved(*terms):
        return hd.solve(hd.Equation([*terms, hd.Caputo(1.0)], lambda t, y: -y, 1.0), 5.0, rtol=1e-9)

    half, times = hd.Caputo(0.5), np.linspace(0.0, 5.0, 41)
    assert np.abs(solved(half, half)(times) - solved(2 * half)(times)).max() < 1e-8
