"""Models of the field: thresholds and exact solutions."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from model_references import (
    airy_series,
    mathieu_edges,
    nerve_at_rest,
    onset,
    riccati_series,
    selkov_onset,
)
from problems import assert_converges
from scipy.special import gamma, mathieu_a, mathieu_b

import hereditary as hd


def grows(equation, t_end):
    """Whether an oscillation about its late mean grows."""
    sol = hd.solve(equation, t_end, rtol=1e-9)
    t = np.linspace(0, t_end, 4001)
    x = sol(t)[:, 0]
    middle, late = (np.ptp(x[(t > a * t_end) & (t < b * t_end)]) for a, b in ((0.3, 0.5), (0.8, 1)))
    return bool(late > middle)


def test_van_der_pol_duffing_begins_to_oscillate_where_its_docstring_says():
    beta, omega = onset(-1.0, 1.0, 0.8, [1.3, 1.2])
    assert (beta, omega) == pytest.approx((1.337001, 1.197992), abs=1e-6)
    for apart in (-0.03, 0.03):
        equation = hd.scenes.van_der_pol_duffing(beta + apart, 0.8, cubic=0.0, x0=1e-4)
        assert grows(equation, 60.0) is (apart > 0)


def test_the_nerve_begins_to_fire_where_its_docstring_says():
    x, *at_rest = nerve_at_rest()
    assert x == pytest.approx(0.906567, abs=1e-6)
    beta, _ = onset(*at_rest, 1.0, [1.8, 0.9])
    assert beta == pytest.approx(1.818246, abs=1e-6)
    for apart in (-0.03, 0.03):
        assert grows(hd.scenes.fitzhugh_nagumo(beta + apart, x0=x + 1e-4), 200.0) is (apart > 0)


@pytest.mark.parametrize("stimulus", [-1.403522, -0.346478])
def test_hopf_bifurcations_of_the_nerve(stimulus):
    """Friction vanishes at the equilibrium there."""
    x = math.copysign(math.sqrt(1 - 0.8 / 9), stimulus + 0.875)
    assert 0.8 * x**3 / 3 + 0.2 * x == pytest.approx(0.7 + 0.8 * stimulus, abs=1e-6)


@pytest.mark.parametrize("beta", [1.8, 2.0])
def test_airys_oscillator_without_friction_is_its_series(beta):
    equation = hd.scenes.van_der_pol_airy(beta, friction=0.0, x0=1.0)
    for t in (1.0, 5.0, 10.0):
        found = hd.solve(equation, t, rtol=1e-10).y[-1, 0]
        assert found == pytest.approx(airy_series(beta, t), abs=1e-9)


def test_edges_of_instability_of_mathieu():
    """Without friction characteristic values of Mathieu's functions; marches on both sides."""
    free = mathieu_edges(0.3, 0.0, 0.5, (0.1, 0.4))
    assert free == pytest.approx([mathieu_b(1, 0.6) / 4, mathieu_a(1, 0.6) / 4], abs=1e-12)
    found = mathieu_edges(0.3, 0.1, 0.5, (0.0586, 0.3414))
    assert found == pytest.approx([0.0480962963, 0.3289509755], abs=1e-9)
    for edge, inwards in zip(found, (1, -1), strict=True):
        for side in (1, -1):
            equation = hd.scenes.mathieu(stiffness=edge + 0.01 * side * inwards)
            assert grows(equation, 300.0) is (side > 0)


@given(a=st.floats(0.01, 0.12), b=st.floats(0.2, 1.0))
def test_selkov_begins_to_oscillate_where_its_docstring_says(a, b):
    selkov = hd.scenes.selkov().replace(params=[a, b])
    jacobian = selkov.jacobian(0.0, [b, b / (a + b**2)])
    trace, determinant = np.trace(jacobian), np.linalg.det(jacobian)
    assume(trace > 1e-3 and 4 * determinant > trace**2)
    alpha = selkov_onset(a, b)
    arguments = np.abs(np.angle(np.linalg.eigvals(jacobian)))
    np.testing.assert_allclose(arguments, alpha * math.pi / 2, atol=1e-6)


def test_selkov_on_both_sides_of_its_threshold():
    near = 0.6 + 1e-4, 0.6 / 0.44
    for apart in (-0.02, 0.02):
        assert grows(hd.scenes.selkov(0.905423 + apart, y0=near), 300.0) is (apart > 0)


@pytest.mark.parametrize("alpha", [0.7, 0.95])
def test_the_time_scale_of_selkov_stretches_time(alpha):
    plain, slow = (hd.scenes.selkov(alpha, time_scale=scale) for scale in (1.0, 3.0))
    stretched = 10.0 * 3.0 ** ((1 - alpha) / alpha)
    one, other = hd.solve(plain, stretched, rtol=1e-9), hd.solve(slow, 10.0, rtol=1e-9)
    assert np.abs(one.y[-1] - other.y[-1]).max() < 1e-7


def test_orders_of_selkov_that_vary():
    """Functions that are constant are constants; and each component has its own."""
    constant = hd.scenes.selkov([0.9, 0.8], time_scale=2.0)
    functions = hd.scenes.selkov((lambda t: 0.9, lambda t: 0.8), time_scale=2.0)
    one, other = (hd.solve(equation, 20.0, rtol=1e-8).y[-1] for equation in (constant, functions))
    assert np.abs(one - other).max() < 1e-6
    pair = (lambda t: 0.95 - 0.05 * np.cos(0.1 * t), lambda t: 0.9 - 0.05 * np.sin(0.1 * t))
    varying = hd.scenes.selkov(pair, time_scale=2.0)
    exact = hd.solve(varying, 20.0, rtol=1e-9).y[-1]

    def end(n):
        return hd.solve(varying, 20.0, n, scheme=hd.L1()).y[-1]

    assert_converges(end, exact, (2000, 4000), 1.0, 2e-3, off=0.32)


@given(alpha=st.floats(0.4, 1.0), linear=st.floats(-1.0, 2.0))
def test_riccati_is_its_series_near_0(alpha, linear):
    t = 0.15 if alpha > 0.7 else 0.04
    expected = riccati_series(alpha, t, linear, 60)
    equation = hd.scenes.riccati(alpha, 1.0, linear, -1.0)
    assert hd.solve(equation, t, rtol=1e-10).y[-1, 0] == pytest.approx(expected, rel=1e-8)


def test_riccati_tends_to_its_root_like_a_power():
    alpha, limit = 0.6, 1 + math.sqrt(2)
    sol = hd.solve(hd.scenes.riccati(alpha), 2e4, rtol=1e-9)
    left = (limit - sol.y[-1, 0]) / limit
    expected = 2e4**-alpha / (2 * math.sqrt(2) * gamma(1 - alpha))
    assert left == pytest.approx(expected, rel=5e-3)


def test_rough_heston():
    """Towards its stable root; and within the published approximant's own error on the way."""
    a, nu, rho, rate = 3 - 0.5j, 0.4, -0.65, 1.0
    coefficients = -0.5 * a * (a + 1j), 1j * rho * nu * a - rate, 0.5 * nu**2
    sol = hd.solve(hd.scenes.riccati(0.7, *coefficients), 3.0, rtol=1e-9)
    assert abs(sol.y[-1, 0] - (-2.520564 + 1.086576j)) < 0.02
    roots = np.roots(coefficients[::-1])
    limit = roots[np.argmin(abs(roots - (-2.747831628 + 1.365466499j)))]
    assert abs(limit - (-2.747831628 + 1.365466499j)) < 1e-8
    far = [
        hd.solve(hd.scenes.riccati(0.7, *coefficients), t, rtol=1e-8).y[-1, 0] for t in (2e3, 4e3)
    ]
    ratio = abs(far[0] - limit) / abs(far[1] - limit)
    assert ratio == pytest.approx(2**0.7, rel=0.02)
