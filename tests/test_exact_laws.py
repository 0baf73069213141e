"""Schemes held to exact Mittag-Leffler solutions on problems that hypothesis draws."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import hereditary as hd
from hereditary import exact

# Orders keep 0.05 away from 0 and 2, where errors are tested one by one; rates and times keep
# K t**alpha moderate, beyond which solutions are all tail.
first_orders = st.floats(0.05, 1.0)
second_orders = st.floats(1.02, 1.98)
rates = st.floats(0.1, 8.0)
times = st.floats(0.2, 5.0)
values = st.floats(-3.0, 3.0)


def decay(t, y, p):
    return -p[0] * y


def largest_error(sol, solution):
    return np.abs(sol.y - solution(sol.t)).max()


@settings(max_examples=30)
@given(first_orders, rates, times, values)
@pytest.mark.parametrize("p", [1, 2, 3])
def test_relaxation_by_quadrature(p, alpha, rate, t_end, y0):
    """At t_end BDF(p) is off by a few (rate t**alpha + 1) h**p, however the solution starts."""
    solution, n = exact.relaxation(alpha, rate, y0), 200
    sol = hd.solve(hd.scenes.relaxation(alpha, rate, y0), t_end, n, scheme=hd.BDF(p))
    bound = 40.0 * (1 + rate * t_end**alpha) ** p / n**p * abs(y0) + 1e-11
    assert np.abs(sol.y[-1] - solution(t_end)).max() <= bound


@settings(max_examples=30)
@example(0.5, 1.0, 1.0, 5e-324)
@given(first_orders, rates, times, values)
def test_relaxation_on_a_graded_mesh(alpha, rate, t_end, y0):
    """At all times; grading is capped where its first step would leave the float range.

    Subnormal numbers have no digits left to hold a relative error to.
    """
    solution, n = exact.relaxation(alpha, rate, y0), 200
    mesh = hd.graded(n, min(2 / alpha, 40.0))
    sol = hd.solve(hd.scenes.relaxation(alpha, rate, y0), t_end, mesh=mesh, scheme=hd.L2Sigma())
    assert sol.success
    bound = 60.0 * (1 + rate * t_end**alpha) ** 2 / n**2 * abs(y0)
    assert largest_error(sol, solution) <= bound + np.finfo(float).tiny


@settings(max_examples=30)
@given(second_orders, rates, times, values, values)
def test_oscillation(beta, rate, t_end, x0, v0):
    solution, n = exact.relaxation(beta, rate, (x0, v0)), 400
    equation = hd.Equation(hd.Caputo(beta), decay, [x0, v0], (rate,))
    size = abs(x0) + abs(v0) * t_end
    z = 1 + rate * t_end**beta
    for scheme, bound in ((hd.ProductTrapezoid(), z**2 / n**2), (hd.BDF(2), z**2.5 / n**2)):
        sol = hd.solve(equation, t_end, n, scheme=scheme)
        assert np.abs(sol.y[-1] - solution(t_end)).max() <= 30 * bound * size + 1e-11, scheme


@settings(max_examples=20)
@given(second_orders, st.floats(0.05, 1.0), st.floats(0.0, 2.0), st.floats(0.3, 3.0), values)
def test_damped_oscillation_of_two_orders(beta, gamma, friction, omega, x0):
    solution = exact.oscillator(beta, gamma, friction, omega, x0, 0.0)
    equation = hd.scenes.oscillator(beta, gamma, friction, omega, x0, 0.0)
    sol = hd.solve(equation, 3.0, 1000, scheme=hd.BDF(2))
    assert np.abs(sol.y[-1] - solution(3.0)).max() <= 2e-3 * abs(x0) + 1e-11
    first_order = hd.solve(equation, 3.0, 4000)
    assert np.abs(first_order.y[-1] - solution(3.0)).max() <= 3e-2 * abs(x0) + 1e-11


@settings(max_examples=20)
@given(first_orders, st.floats(-2.0, 2.0), st.floats(0.1, 2.0))
def test_systems(alpha, coupling, t_end):
    matrix = np.array([[-1.0, coupling], [-coupling, -2.0]])
    if abs(np.diff(np.linalg.eigvals(matrix)))[0] < 0.05:
        return  # nearly defective: exact.system refuses it
    solution = exact.system(alpha, matrix, [1.0, -0.5])

    equation = hd.Equation(hd.Caputo(alpha), linear, [1.0, -0.5], matrix.ravel())
    sol = hd.solve(equation, t_end, 300, scheme=hd.BDF(2))
    assert np.abs(sol.y[-1] - solution(t_end)).max() <= 1e-3


def linear(t, y, p):
    return np.array([p[0] * y[0] + p[1] * y[1], p[2] * y[0] + p[3] * y[1]])


@pytest.mark.parametrize("alpha", [0.02, 0.05])
def test_small_orders(alpha):
    """Sound schemes give 1e-6 at t = 1; none of them garbage."""
    solution = exact.relaxation(alpha, 1.0, 1.0)(1.0)[0]
    for scheme, bound in (
        (hd.BDF(2), 1e-6),
        (hd.BDF(4), 1e-6),
        (hd.L1(), 1e-5),
        (hd.L2(), 1e-5),
        (hd.L2Sigma(), 1e-5),
        (hd.ProductTrapezoid(), 1e-5),
    ):
        sol = hd.solve(hd.scenes.relaxation(alpha, 1.0, 1.0), 1.0, 10_000, scheme=scheme)
        assert sol.success
        assert abs(sol.y[-1, 0] - solution) < bound, scheme


def test_several_terms_keep_second_order_to_many_steps():
    """D^1.5 x + 0.5 D^0.5 x + x = 0 at t = 20: no floor above 1e-12 up to 1e5 steps."""
    solution = exact.oscillator(1.5, 0.5, 0.5, 1.0, 1.0, 0.0)(20.0)[0]
    equation = hd.Equation([hd.Caputo(1.5), 0.5 * hd.Caputo(0.5)], decay, [1.0, 0.0], (1.0,))
    errors = []
    for n in (12_500, 25_000, 50_000, 100_000):
        history = hd.SumOfExponentials(1e-13)
        sol = hd.solve(equation, 20.0, n, scheme=hd.BDF(2), history=history, save_every=n)
        errors.append(abs(sol.y[-1, 0] - solution))
    orders = -np.diff(np.log2(errors))
    np.testing.assert_allclose(orders, 2.0, atol=0.15)
