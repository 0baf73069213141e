"""The three-dimensional attractors: divergence, equilibria, classical trajectories."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from references import classical
from strategies import amplitudes

import hereditary as hd

points = st.tuples(*[amplitudes()] * 3)
parameters = st.tuples(*[amplitudes()] * 3)


@given(y=points, params=parameters)
def test_divergence_of_lorenz_is_minus_sigma_minus_1_minus_b(y, params):
    sigma, _, b = params
    divergence = np.trace(hd.scenes.lorenz().replace(params=params).jacobian(0.0, y))
    assert divergence == pytest.approx(-sigma - 1 - b, abs=1e-12)


@given(y=points, params=parameters)
def test_divergence_of_rossler_is_a_plus_x_minus_c(y, params):
    a, _, c = params
    divergence = np.trace(hd.scenes.rossler().replace(params=params).jacobian(0.0, y))
    assert divergence == pytest.approx(a + y[0] - c, abs=1e-12)


@given(y=points, params=parameters)
def test_divergence_of_rabinovich_fabrikant_is_2a_minus_2b(y, params):
    a, b, _ = params
    scene = hd.scenes.rabinovich_fabrikant().replace(params=params[:2])
    jacobian = scene.jacobian(0.0, y)
    assert np.trace(jacobian) == pytest.approx(2 * a - 2 * b, abs=1e-11)


def lorenz_equilibrium(sign):
    x = sign * np.sqrt(8 / 3 * 27)
    return [x, x, 27.0]


def rossler_equilibrium(sign):
    z = (5.7 + sign * np.sqrt(5.7**2 - 4 * 0.2 * 0.2)) / (2 * 0.2)
    return [0.2 * z, -z, z]


@pytest.mark.parametrize(
    ("scene", "equilibrium"),
    [
        (hd.scenes.lorenz, [0.0, 0.0, 0.0]),
        (hd.scenes.lorenz, lorenz_equilibrium(1)),
        (hd.scenes.lorenz, lorenz_equilibrium(-1)),
        (hd.scenes.rossler, rossler_equilibrium(1)),
        (hd.scenes.rossler, rossler_equilibrium(-1)),
        (hd.scenes.rabinovich_fabrikant, [0.0, 0.0, 0.0]),
    ],
)
@pytest.mark.parametrize("alpha", [1.0, 0.9, [0.8, 1.0, 0.9]])
def test_equilibria_stay_put_whatever_the_orders(scene, equilibrium, alpha):
    sol = hd.solve(scene(alpha, y0=equilibrium), 1.0, 200, scheme=hd.BDF(2))
    assert np.abs(sol.y - equilibrium).max() < 1e-9


def test_equilibria_of_lorenz_are_stable_up_to_order_0_994():
    """A system of order alpha is stable where |arg| > alpha pi / 2 for every eigenvalue."""
    jacobian = hd.scenes.lorenz().jacobian(0.0, lorenz_equilibrium(1))
    argument = np.abs(np.angle(np.linalg.eigvals(jacobian))).min()
    assert argument / (np.pi / 2) == pytest.approx(0.9941, abs=5e-5)


def lorenz(t, u):
    x, y, z = u
    return [10 * (y - x), x * (28 - z) - y, x * y - 8 / 3 * z]


def rossler(t, u):
    x, y, z = u
    return [-y - z, x + 0.2 * y, 0.2 + z * (x - 5.7)]


def rabinovich_fabrikant(t, u):
    x, y, z = u
    return [
        y * (z - 1 + x**2) + 0.1 * x,
        x * (3 * z + 1 - x**2) + 0.1 * y,
        -2 * z * (0.98 + x * y),
    ]


@pytest.mark.parametrize(
    ("scene", "rhs", "t_end", "bound"),
    [
        (hd.scenes.lorenz, lorenz, 2.0, 1e-4),
        (hd.scenes.rossler, rossler, 10.0, 4e-5),
        (hd.scenes.rabinovich_fabrikant, rabinovich_fabrikant, 10.0, 3e-6),
    ],
)
def test_classical_trajectory_is_that_of_the_written_equations(scene, rhs, t_end, bound):
    equation = scene()
    exact = classical(rhs, t_end, equation.y0[0])
    errors = [
        np.abs(hd.solve(equation, t_end, n, scheme=hd.L2Sigma()).y[-1] - exact).max()
        for n in (2000, 4000)
    ]
    assert errors[1] < bound
    assert errors[0] / errors[1] == pytest.approx(4, abs=0.3)


COUPLED = [
    *(hd.scenes.brusselator, hd.scenes.van_der_pol),
    *(hd.scenes.lorenz, hd.scenes.rabinovich_fabrikant, hd.scenes.rossler),
]


@pytest.mark.parametrize("scene", COUPLED, ids=lambda scene: scene.__name__)
def test_one_order_or_one_for_each_component(scene):
    d = scene().d
    assert scene(0.7).orders.tolist() == [[0.7] * d]
    orders = [0.9, 1.0, 0.95][:d]
    equation = scene(alpha=orders)
    assert equation.orders.tolist() == [orders]
    assert equation.system.has_jac  # which is compared with differences when an equation is made
    assert hd.solve(equation, 1.0, 200, scheme=hd.BDF(2)).success
