"""Memory kernels times numbers: what scales with them, what terms make of them, refusals."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import gamma

import hereditary as hd

TABLE = np.geomspace(1e-3, 1e2, 40)
KERNELS = [
    hd.PowerLaw(0.7),
    hd.TemperedPowerLaw(0.5, 1.0),
    hd.Prony([1.0, 10.0], [0.3, 0.7]),
    hd.MittagLeffler(0.5, 1.0),
    hd.StretchedExponential(0.5, 1.0),
    hd.GammaDensity(0.6, 2.0),
    hd.DistributedOrder([0.2, 0.9], [1.0, 2.0]),
    hd.Kernel(lambda t: 1 / np.sqrt(t * (1 + t))),
    hd.Kernel.from_table(TABLE, TABLE**-0.5 * np.exp(-TABLE)),
]
FACTORS = st.floats(1e-100, 1e100).flatmap(lambda size: st.sampled_from([size, -size]))


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda kernel: type(kernel).__name__)
@settings(max_examples=5)
@given(FACTORS)
def test_values_integrals_and_fits_scale(kernel, c):
    t, fit = np.array([[1e-3, 0.3], [2.0, 50.0]]), kernel.fit(1e-2, 50.0, 1e-3)
    for scaled, factor in ((kernel * c, c), (c * kernel, c), (kernel / c, 1 / c)):
        np.testing.assert_allclose(scaled(t), factor * kernel(t), rtol=1e-15)
        np.testing.assert_allclose(scaled.integral(t), factor * kernel.integral(t), rtol=1e-15)
        mine = hd.fit_exponentials(scaled, 1e-2, 50.0, 1e-3)
        assert np.array_equal(mine.rates, fit.rates)
        np.testing.assert_allclose(mine.weights, factor * fit.weights, rtol=1e-15)
        assert (mine.t_min, mine.t_max, mine.max_error) == (1e-2, 50.0, fit.max_error)
        assert scaled.singular_exponent == kernel.singular_exponent
        assert scaled.generators == kernel.generators


def test_numbers_of_all_kinds_and_products_of_them():
    kernel = hd.Prony([1.0], [2.0])
    assert repr(3 * kernel / 2) == "1.5 * Prony(rates=(1.0,), weights=(2.0,))"
    assert 3 * kernel / 2 == kernel * 1.5 != kernel * 2
    assert np.float64(2.0) * kernel == np.array(2.0) * kernel == kernel * np.int64(2) == 2 * kernel
    assert pickle.loads(pickle.dumps(2 * kernel)) == 2 * kernel


def test_terms_take_the_factor():
    """So equal kernels remain equal, share their modes, and power laws remain Caputo's."""
    prony = KERNELS[2]
    operators = [hd.Caputo(2), 3 * hd.Memory(prony / 6, 1), -hd.Memory(-2 * prony, 0)]
    equation = hd.Equation(operators, lambda t, x: -x, [1.0, 0.2])
    assert [term.coefficient.item() for term in equation.terms] == [1.0, 0.5, 2.0]
    assert all(operator.kernel is prony for operator, _ in equation.system.left[1:])
    assert repr(hd.Memory(2 * prony, 1)) == f"Memory(2.0 * {prony!r}, 1)"
    beta = 1.7
    scaled = hd.Memory(hd.PowerLaw(beta - 1) / gamma(2 - beta), 2)
    assert "Caputo(1.7)" in repr(hd.Equation(scaled, lambda t, x: -x, [1.0, 0.2]))


@pytest.mark.parametrize("scheme", [hd.ExplicitCaputo(), hd.L1(), hd.Collocation()], ids=str)
@pytest.mark.parametrize(("order", "m"), [(1.7, 2), (0.4, 1)])
def test_a_normalised_power_law_is_caputos_derivative(scheme, order, m):
    a = order - (m - 1)
    y0 = [1.0, 0.2] if m == 2 else 1.0
    how = {"rtol": 1e-9} if isinstance(scheme, hd.Collocation) else {"n_steps": 300}
    by_kernel, by_order = (
        hd.solve(hd.Equation(operator, lambda t, x: -x, y0), 5.0, scheme=scheme, **how)
        for operator in (hd.Memory(hd.PowerLaw(a) / gamma(1 - a), m), hd.Caputo(order))
    )
    np.testing.assert_allclose(by_kernel.y, by_order.y, rtol=0, atol=1e-13)


@pytest.mark.parametrize("m", [0, 1, 2])
def test_factors_in_the_kernel_or_the_coefficient(m):
    kernel = hd.TemperedPowerLaw(0.4, 1.0)
    runs = [
        hd.solve(hd.Equation([hd.Caputo(2), term], lambda t, x: -x, [1.0, 0.2]), 5.0, 300).y
        for term in (0.3 * hd.Memory(kernel, m), hd.Memory(kernel * 0.3, m))
    ]
    assert np.array_equal(*runs)
