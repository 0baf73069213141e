"""The stick-slip scene: its coefficients, its force, its stays."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

import hereditary as hd

WELL = hd.scenes.PRINTED_WELL


def test_coefficients_of_the_well_are_the_printed_ones():
    assert hd.scenes.well_coefficients(7).round(3).tolist() == pytest.approx(WELL, abs=1.001e-3)
    direct = [
        2 * n * quad(lambda y, n=n: np.cos(np.pi * n * y) / np.cosh(np.pi * y) ** 2, 0, 1,
                     epsabs=1e-13, limit=200)[0]
        for n in range(1, 8)
    ]  # fmt: skip
    np.testing.assert_allclose(hd.scenes.well_coefficients(7), direct, atol=1e-11)


@pytest.mark.parametrize("n_coefficients", [1, 2, 7, 12])
def test_the_jacobian_of_the_force(n_coefficients):
    """The force itself is that of the printed scheme in test_explicit.py."""
    well, n = hd.scenes.well_coefficients(n_coefficients), np.arange(1, n_coefficients + 1)
    equation = hd.scenes.stick_slip(omega=1.3, spring_speed=0.7, adhesion=20.0, well=well)
    for x in (-3.0, 0.0, 0.4, np.pi, 61.0):
        expected = 20.0 * (n * well) @ np.cos(n * x) - 1.3**2
        assert equation.jacobian(2.0, [x])[0, 0] == pytest.approx(expected, abs=1e-12)


def test_parameters_reach_the_equation():
    equation = hd.scenes.stick_slip(
        beta=1.6, gamma=0.4, friction=0.3, omega=2.0, spring_speed=0.5, adhesion=7.0, x0=1.0, v0=2.0
    )
    assert equation.orders[:, 0].tolist() == [1.6, 0.4]
    assert equation.coefficients[:, 0].tolist() == [1.0, 0.3]
    assert equation.y0[:, 0].tolist() == [1.0, 2.0]
    assert equation.params.tolist() == [4.0, 0.5, 7.0, *WELL]


def test_no_friction_is_allowed():
    assert hd.solve(hd.scenes.stick_slip(friction=0.0), 1.0, 1000).success


class Orbit:
    """Stands in for a solution: a load at the given places at the times 0, 1, 2, ..."""

    coarse = False

    def __init__(self, places):
        self.t = np.arange(float(len(places)))
        self.y = 2 * np.pi * np.array(places, dtype=float).reshape(-1, 1)


def test_stays_on_a_dense_output_do_not_depend_on_the_tolerance():
    equation = hd.scenes.stick_slip(beta=2.0, gamma=1.0)
    loose, tight = (hd.solve(equation, 70.0, rtol=rtol) for rtol in (1e-8, 1e-11))
    found = hd.scenes.sticking_intervals(tight)
    assert found[0][1] == pytest.approx(45.2715885, abs=1e-7)
    assert np.abs(np.array(hd.scenes.sticking_intervals(loose)) - found).max() < 1e-6
    exits = hd.solve(equation, 70.0, rtol=1e-11, events=lambda t, y: y[0] - 2 * np.pi).t_events[0]
    assert exits[0] == pytest.approx(found[0][1], abs=1e-10)


def test_stays():
    # five time units in the first well, a slip over the second, four in the third
    orbit = Orbit([0.5, 0.5, 0.5, 0.5, 0.5, 1.5, 2.5, 2.5, 2.5, 2.5, 2.5])
    assert hd.scenes.sticking_intervals(orbit) == [(0.0, 4.5), (5.5, 10.0)]
    assert hd.scenes.sticking_intervals(orbit, shortest=0.5) == [
        (0.0, 4.5), (4.5, 5.5), (5.5, 10.0),
    ]  # fmt: skip
    back = Orbit([0.5, 0.5, 0.5, 0.5, -0.5, -0.5, -0.5, -0.5, -0.5])
    assert hd.scenes.sticking_intervals(back) == [(0.0, 3.5), (3.5, 8.0)]
    leap = Orbit([0.5, 0.5, 0.5, 0.5, 0.5, 3.5, 3.5, 3.5, 3.5])
    leaves, enters = 4 + 0.5 / 3, 4 + 2.5 / 3
    expected = [(0.0, leaves), (enters, 8.0)]
    np.testing.assert_allclose(hd.scenes.sticking_intervals(leap), expected)
    back = Orbit([3.5, 3.5, 3.5, 3.5, 3.5, 0.5, 0.5, 0.5, 0.5])
    np.testing.assert_allclose(hd.scenes.sticking_intervals(back), expected)


def test_orders_that_vary():
    """Constant functions are constant orders."""
    runs = [
        hd.solve(hd.scenes.stick_slip(beta=beta, gamma=gamma), 20.0, 4000).y
        for beta, gamma in ((1.8, 0.8), (lambda t: 1.8, lambda t: 0.8), (lambda t: 1.8, 0.8))
    ]
    np.testing.assert_allclose(runs[1], runs[0], rtol=0, atol=1e-7)
    np.testing.assert_allclose(runs[2], runs[0], rtol=0, atol=1e-7)
    ageing = hd.scenes.stick_slip(beta=lambda t: 2.0 - 0.2 * np.exp(-t / 10), gamma=1.0)
    assert hd.solve(ageing, 20.0, 4000).success


def test_kernels_instead_of_orders():
    """The power laws of the orders are the same equation; K1 alone makes it another."""
    from_orders = hd.solve(hd.scenes.stick_slip(), 20.0, 4000).y
    tempered = hd.TemperedPowerLaw(0.8, 1e-12)
    weight = 1 / math.gamma(0.2)
    by_kernel = hd.scenes.stick_slip(friction=0.25 * weight, resistance=tempered)
    np.testing.assert_allclose(hd.solve(by_kernel, 20.0, 4000).y, from_orders, rtol=0, atol=1e-6)
    heavy = hd.solve(hd.scenes.stick_slip(inertia=tempered, resistance=tempered), 20.0, 4000)
    assert heavy.success
    assert np.abs(heavy.y - from_orders).max() > 0.1
