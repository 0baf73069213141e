"""Systems of first order: divergences, equilibria, orders of components."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import amplitudes

import hereditary as hd

points = st.tuples(*[amplitudes()] * 3)
# By the parameters and y.
DIVERGENCES = {
    hd.scenes.lorenz: lambda p, y: -p[0] - 1 - p[2],
    hd.scenes.rossler: lambda p, y: p[0] + y[0] - p[2],
    hd.scenes.rabinovich_fabrikant: lambda p, y: 2 * p[0] - 2 * p[1],
}


@pytest.mark.parametrize("scene", DIVERGENCES, ids=lambda scene: scene.__name__)
@given(y=points, params=points)
def test_divergences(scene, y, params):
    params = params[: scene().params.size]
    divergence = np.trace(scene().replace(params=params).jacobian(0.0, y))
    assert divergence == pytest.approx(DIVERGENCES[scene](params, y), abs=1e-11)


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
        (partial(hd.scenes.brusselator, a=2.0, b=5.0), [2.0, 2.5]),
    ],
)
@pytest.mark.parametrize("alpha", [1.0, 0.9, [0.8, 1.0, 0.9]])
def test_equilibria_stay_put_whatever_the_orders(scene, equilibrium, alpha):
    alpha = np.resize(alpha, len(equilibrium)) if isinstance(alpha, list) else alpha
    sol = hd.solve(scene(alpha, y0=equilibrium), 1.0, 200, scheme=hd.BDF(2))
    assert np.abs(sol.y - equilibrium).max() < 1e-9


def test_equilibria_of_lorenz_are_stable_up_to_order_0_994():
    """A system of order alpha is stable where |arg| > alpha pi / 2 for every eigenvalue."""
    jacobian = hd.scenes.lorenz().jacobian(0.0, lorenz_equilibrium(1))
    argument = np.abs(np.angle(np.linalg.eigvals(jacobian))).min()
    assert argument / (np.pi / 2) == pytest.approx(0.9941, abs=5e-5)


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
