"""The oscillators: equilibria, limit cycles, classical trajectories, published digits."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from references import classical, matrix, value

import hereditary as hd
from hereditary.scenes import oscillating


def duffing(t, u):
    x, v = u
    return [v, 7.5 * math.cos(t) - 0.05 * v - x**3]


def two_wells(t, u):
    x, v = u
    return [v, 0.3 * math.cos(1.2 * t) - 0.25 * v + x - x**3]


def van_der_pol(t, u):
    x, v = u
    return [v, 5 * (1 - x**2) * v - x + 5 * math.cos(2.466 * t)]


def brusselator(t, u):
    x, y = u
    return [1 - 4 * x + x**2 * y, 3 * x - x**2 * y]


WELLS = hd.scenes.duffing(
    friction=0.25, stiffness=-1.0, cubic=1.0, force=0.3, frequency=1.2, x0=0.5
)
DRIVEN = hd.scenes.van_der_pol(mu=5.0, force=5.0, frequency=2.466)


@pytest.mark.parametrize(
    ("equation", "scheme", "rhs", "t_end", "bound"),
    [
        (hd.scenes.duffing(), hd.BDF(2), duffing, 5.0, 4e-5),
        (WELLS, hd.BDF(2), two_wells, 5.0, 3e-6),
        (DRIVEN, hd.L2Sigma(), van_der_pol, 5.0, 1e-5),
        (hd.scenes.brusselator(), hd.L2Sigma(), brusselator, 5.0, 4e-7),
    ],
    ids=["Ueda", "two wells", "van der Pol", "Brusselator"],
)
def test_classical_trajectory_is_that_of_the_written_equations(equation, scheme, rhs, t_end, bound):
    exact = classical(rhs, t_end, equation.y0.ravel())[: equation.d]
    errors = [
        np.abs(hd.solve(equation, t_end, n, scheme=scheme).y[-1] - exact).max()
        for n in (2000, 4000)
    ]
    assert errors[1] < bound
    assert errors[0] / errors[1] == pytest.approx(4, abs=0.3)


def test_duffing_parameters_reach_the_equation():
    equation = hd.scenes.duffing(
        beta=1.6, gamma=0.4, friction=0.3, stiffness=2.0, cubic=3.0, force=4.0, frequency=5.0,
        x0=6.0, v0=7.0,
    )  # fmt: skip
    assert equation.orders[:, 0].tolist() == [1.6, 0.4]
    assert equation.coefficients[:, 0].tolist() == [1.0, 0.3]
    assert equation.params.tolist() == [2.0, 3.0, 4.0, 5.0]
    assert equation.y0[:, 0].tolist() == [6.0, 7.0]


@pytest.mark.parametrize(("order", "value"), [("beta", 1.0), ("beta", 2.1), ("gamma", 1.1)])
def test_duffing_refuses_orders_outside_their_ranges(order, value):
    with pytest.raises(ValueError, match=rf"{order} must lie in \("):
        hd.scenes.duffing(**{order: value})


@pytest.mark.parametrize(("beta", "gamma"), [(2.0, 1.0), (1.8, 0.8)])
def test_undriven_load_stays_at_the_bottom_of_a_well(beta, gamma):
    """stiffness x + cubic x**3 vanishes at x = sqrt(-stiffness / cubic)."""
    well = hd.scenes.duffing(
        beta, gamma, friction=0.3, stiffness=-2.0, cubic=0.5, force=0.0, x0=-2.0
    )
    assert np.abs(hd.solve(well, 5.0, 500).y + 2.0).max() < 1e-12


@pytest.mark.parametrize("alpha", [1.0, 0.8, [0.7, 1.0]])
def test_equilibrium_of_the_brusselator_stays_put_whatever_the_orders(alpha):
    equation = hd.scenes.brusselator(alpha, a=2.0, b=5.0, y0=(2.0, 2.5))
    assert np.abs(hd.solve(equation, 2.0, 400, scheme=hd.BDF(2)).y - [2.0, 2.5]).max() < 1e-10


@given(a=st.floats(0.3, 4.0), alpha=st.floats(0.05, 1.0))
def test_brusselator_turns_unstable_where_the_docstring_says(a, alpha):
    """A system of order alpha does where an eigenvalue has |arg| = alpha pi / 2."""
    b = 1 + a**2 + 2 * a * math.cos(math.pi * alpha / 2)
    jacobian = matrix(oscillating._brusselator_jacobian, 0.0, [a, b / a], [a, b])
    arguments = np.abs(np.angle(np.linalg.eigvals(jacobian)))
    np.testing.assert_allclose(arguments, alpha * math.pi / 2, atol=1e-6)


def test_brusselator_with_memory_agrees_with_another_library():
    """x(100) = 1.23585168586364 at alpha = 0.8, and its error falls by four for half the step."""
    errors = [
        abs(hd.solve(hd.scenes.brusselator(0.8), 100.0, n, scheme=hd.BDF(2)).y[-1, 0]
            - 1.23585168586364)
        for n in (10_000, 20_000)
    ]  # fmt: skip
    assert errors[1] < 2e-4
    assert errors[0] / errors[1] == pytest.approx(4, abs=0.3)


def test_free_van_der_pol_circuit_settles_on_its_cycle():
    """Amplitude 2.0086 and period 6.6633 at mu = 1."""
    sol = hd.solve(hd.scenes.van_der_pol(y0=(0.1, 0.0)), 60.0, 6000, scheme=hd.L2Sigma())
    t, x = sol.t[3000:], sol.y[3000:, 0]
    assert x.max() == pytest.approx(2.0086, abs=1e-3)
    k = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    crossings = t[k] - x[k] * (t[k + 1] - t[k]) / (x[k + 1] - x[k])
    np.testing.assert_allclose(np.diff(crossings), 6.6633, atol=1e-3)


def test_van_der_pol_near_its_equilibrium_is_linear():
    origin = matrix(oscillating._van_der_pol_jacobian, 0.0, [0.0, 0.0], [0.7, 0.0, 1.0])
    assert origin.tolist() == [[0.0, 1.0], [-1.0, 0.7]]
    assert value(oscillating._van_der_pol, 0.3, np.zeros(2), [0.7, 2.0, 4.0]).tolist() == [
        0.0,
        pytest.approx(2.0 * math.cos(1.2)),
    ]
