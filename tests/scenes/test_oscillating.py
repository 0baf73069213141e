"""The oscillators: equilibria, limit cycles, published digits."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import rgamma

import hereditary as hd


def test_duffing_parameters_reach_the_equation():
    equation = hd.scenes.duffing(
        beta=1.6, gamma=0.4, friction=0.3, stiffness=2.0, cubic=3.0, force=4.0, frequency=5.0,
        x0=6.0, v0=7.0,
    )  # fmt: skip
    assert equation.orders[:, 0].tolist() == [1.6, 0.4]
    assert equation.coefficients[:, 0].tolist() == [1.0, 0.3]
    assert equation.params.tolist() == [2.0, 3.0, 4.0, 5.0]
    assert equation.y0[:, 0].tolist() == [6.0, 7.0]


@pytest.mark.parametrize(("beta", "gamma"), [(2.0, 1.0), (1.8, 0.8)])
def test_undriven_load_stays_at_the_bottom_of_a_well(beta, gamma):
    """stiffness x + cubic x**3 vanishes at x = sqrt(-stiffness / cubic)."""
    well = hd.scenes.duffing(
        beta, gamma, friction=0.3, stiffness=-2.0, cubic=0.5, force=0.0, x0=-2.0
    )
    assert np.abs(hd.solve(well, 5.0, 500).y + 2.0).max() < 1e-12


@given(a=st.floats(0.3, 4.0), alpha=st.floats(0.05, 1.0))
def test_brusselator_turns_unstable_where_the_docstring_says(a, alpha):
    """A system of order alpha does where an eigenvalue has |arg| = alpha pi / 2."""
    b = 1 + a**2 + 2 * a * math.cos(math.pi * alpha / 2)
    jacobian = hd.scenes.brusselator(a=a, b=b).jacobian(0.0, [a, b / a])
    arguments = np.abs(np.angle(np.linalg.eigvals(jacobian)))
    np.testing.assert_allclose(arguments, alpha * math.pi / 2, atol=1e-6)


def test_free_van_der_pol_circuit_settles_on_its_cycle():
    """Amplitude 2.0086 and period 6.6633 at mu = 1."""
    sol = hd.solve(hd.scenes.van_der_pol(y0=(0.1, 0.0)), 60.0, 6000, scheme=hd.L2Sigma())
    t, x = sol.t[3000:], sol.y[3000:, 0]
    assert x.max() == pytest.approx(2.0086, abs=1e-3)
    k = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    crossings = t[k] - x[k] * (t[k + 1] - t[k]) / (x[k + 1] - x[k])
    np.testing.assert_allclose(np.diff(crossings), 6.6633, atol=1e-3)


@pytest.mark.filterwarnings("ignore::hereditary.PythonFunctionWarning")
def test_a_control_loop_reads_the_derivative_of_its_reference():
    """D^mu e with D^mu of the plant on the left side, and that of sin t by its series."""
    mu, gains = 0.4, (8.0, 4.0, 1.5)

    def loop(t, y, memory, p):
        error = y[2] - y[0]
        u = p[0] * error + p[1] * y[1] + p[2] * (memory[0, 2] - memory[0, 0])
        return np.array([u - y[0], error, np.cos(t)])

    orders = [0.9, 0.6, 1.0]
    eq = hd.Equation(hd.Caputo(orders), loop, [0.0] * 3, gains, memory=hd.Caputo(mu))
    k = np.arange(60)
    reciprocals = rgamma(2 * k + 2 - mu)

    def of_sine(t):
        return t ** (1 - mu) * float(np.sum((-t * t) ** k * reciprocals))

    def direct(t, y):
        error = math.sin(t) - y[0]
        u = gains[0] * error + gains[1] * y[1] + gains[2] * of_sine(t)
        return [u - y[0], error]

    terms = hd.Caputo([0.9, 0.6]) + np.array([gains[2], 0.0]) * hd.Caputo(mu)
    truth = hd.solve(hd.Equation(terms, direct, [0.0, 0.0]), 5.0, rtol=1e-9)
    times = np.linspace(0.5, 5.0, 10)
    assert np.abs(hd.solve(eq, 5.0, rtol=1e-9)(times)[:, :2] - truth(times)).max() < 3e-8
    steps = hd.solve(eq, 5.0, 2000, scheme=hd.BDF(2))
    assert np.abs(steps.y[::200, :2] - truth(steps.t[::200])).max() < 1e-4
