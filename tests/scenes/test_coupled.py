"""What all standard systems share: exact Jacobians, orders for each component, checks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from references import differences, matrix
from strategies import amplitudes

import hereditary as hd
from hereditary.scenes import chaotic, oscillating

# right-hand side, Jacobian, components, parameters
KERNELS = {
    "lorenz": (chaotic._lorenz, chaotic._lorenz_jacobian, 3, 3),
    "rossler": (chaotic._rossler, chaotic._rossler_jacobian, 3, 3),
    "rabinovich_fabrikant": (
        chaotic._rabinovich_fabrikant,
        chaotic._rabinovich_fabrikant_jacobian,
        3,
        2,
    ),
    "duffing": (oscillating._cubic_spring, oscillating._cubic_spring_jacobian, 1, 4),
    "van_der_pol": (oscillating._van_der_pol, oscillating._van_der_pol_jacobian, 2, 3),
    "brusselator": (oscillating._brusselator, oscillating._brusselator_jacobian, 2, 2),
}
COUPLED = {
    hd.scenes.brusselator: 2,
    hd.scenes.lorenz: 3,
    hd.scenes.rabinovich_fabrikant: 3,
    hd.scenes.rossler: 3,
    hd.scenes.van_der_pol: 2,
}
coupled = pytest.mark.parametrize(
    ("scene", "d"), COUPLED.items(), ids=lambda v: getattr(v, "__name__", str(v))
)


@pytest.mark.parametrize("name", KERNELS)
@given(data=st.data())
def test_jacobian_equals_central_differences(name, data):
    rhs, jac, d, n_params = KERNELS[name]
    t = data.draw(amplitudes())
    y = data.draw(hnp.arrays(np.float64, d, elements=amplitudes()))
    params = data.draw(hnp.arrays(np.float64, n_params, elements=amplitudes()))
    expected = differences(rhs, t, y, params)
    np.testing.assert_allclose(matrix(jac, t, y, params), expected, rtol=0, atol=1e-9)


@coupled
def test_one_order_or_one_for_each_component(scene, d):
    assert scene().orders.tolist() == [[1.0] * d]
    assert scene(0.7).orders.tolist() == [[0.7] * d]
    orders = [0.9, 1.0, 0.95][:d]
    equation = scene(alpha=orders)
    assert equation.orders.tolist() == [orders]
    assert equation.has_jac
    solution = hd.solve(equation, 1.0, 200, scheme=hd.BDF(2))
    assert solution.success
    assert solution.y.shape == (201, d)
