"""A given Jacobian is compared with differences when an equation is made."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import hereditary as hd

pytestmark = pytest.mark.rounding


def quadratic(t, y, params):
    """f_i = sum_j a_ij y_j + b_ij y_j**2; params hold a, b and factors for the Jacobian."""
    p = params.reshape(3, y.size, y.size)
    return (p[0] * y + p[1] * y**2).sum(axis=1)


def its_jacobian(t, y, params):
    p = params.reshape(3, y.size, y.size)
    return p[2] * (p[0] + 2.0 * p[1] * y)


def equation(a, b, factors, y0, jac=its_jacobian):
    return hd.Equation(hd.Caputo(0.5), quadratic, y0, np.ravel([a, b, factors]), jac)


@st.composite
def problems(draw):
    d = draw(st.integers(1, 4))
    numbers = st.floats(-10, 10).map(lambda x: round(x, 3))
    a, b = (draw(arrays(float, (d, d), elements=numbers)) for _ in range(2))
    # smaller numbers and their squares are too far apart for a common step of differences
    sizes = st.floats(-1e3, 1e3).map(lambda x: x if abs(x) > 1e-30 else 0.0)
    y0 = draw(arrays(float, d, elements=sizes))
    return a * 10.0 ** draw(st.integers(-6, 6)), b, y0


@given(problems(), st.sampled_from([0.999, 1.0, 1.001]))
def test_entries_that_are_right_to_a_thousandth_pass(problem, factor):
    a, b, y0 = problem
    assert equation(a, b, np.full_like(a, factor), y0).system.has_jac


@given(problems(), st.data(), st.sampled_from([-1.0, 0.0, 0.9, 1.05, 3.0]))
def test_errors_above_a_hundredth_of_the_row_are_refused(problem, data, factor):
    """Above it all over the neighbourhood in which the check compares (`wrong_jacobian`)."""
    a, b, y0 = problem
    d = y0.size
    i, j = data.draw(st.integers(0, d - 1)), data.draw(st.integers(0, d - 1))
    factors = np.ones((d, d))
    units = equation(a, b, factors, y0, None).system.units()
    reach = 0.03 * np.maximum(np.abs(y0), 0.1 * units)
    around = y0[:, None] + reach[:, None] * np.linspace(-1, 1, 21)
    rows = np.abs(a[i][:, None] + 2 * b[i][:, None] * around)
    assume(abs(factor - 1) * rows[j].min() > 0.01 * rows.max() > 0)
    factors[i, j] = factor
    with pytest.raises(ValueError, match=rf"jac must hold .* got .* in row {i}, column {j}"):
        equation(a, b, factors, y0)


@pytest.mark.parametrize("size", [1e-3, 1 / 128, 1.0])
@pytest.mark.parametrize("large", [2.0, 1e6])
@pytest.mark.parametrize("factor", [-1.0, 0.0, 1.05])
def test_a_wrong_entry_beside_a_large_component_is_refused(size, large, factor):
    """Component 2 is 0; its unit follows from f_2, which is small, and f_0 has other sizes."""
    a, b, factors = np.zeros((4, 4)), np.zeros((4, 4)), np.ones((4, 4))
    a[0, 2], a[0, 3], a[2, 2], a[3, 3], b[2, 1] = 1, 1, 1, 1, 0.5
    factors[0, 2] = factor
    with pytest.raises(ValueError, match="in row 0, column 2"):
        equation(a, b, factors, np.array([0.0, size, 0.0, large]))


def test_a_transposed_one_and_a_missing_term_are_refused():
    def rotation(y0, jac):
        terms = hd.Caputo(0.5)
        return hd.Equation(terms, lambda t, y: np.array([y[1] - y[0] ** 3, -2 * y[0]]), y0, jac=jac)

    for y0 in ([0.0, 0.0], [1.0, 2.0]):
        right = rotation(y0, lambda t, y: np.array([[-3.0 * y[0] ** 2, 1.0], [-2.0, 0.0]]))
        assert right.system.has_jac
        with pytest.raises(ValueError, match="check signs and whether it is transposed"):
            rotation(y0, lambda t, y: np.array([[-3.0 * y[0] ** 2, -2.0], [1.0, 0.0]]))
    with pytest.raises(ValueError, match=r"= -3.* got 0 in row 0, column 0"):
        rotation([1.0, 2.0], lambda t, y: np.array([[0.0, 1.0], [-2.0, 0.0]]))


def test_corners_jumps_and_edges_of_the_domain_refuse_nothing():
    def rough(t, y):
        return np.array([abs(y[0]), np.sign(y[1]), np.sqrt(y[2]), np.tanh(1e9 * y[3])])

    def its_jac(t, y):
        out = np.zeros((4, 4))
        out[0, 0], out[2, 2] = np.sign(y[0]), 0.5 / np.sqrt(y[2] + 1e-300)
        out[3, 3] = 1e9 / np.cosh(min(1e9 * abs(y[3]), 300.0)) ** 2
        return out

    assert hd.Equation(hd.Caputo(0.5), rough, [0.0, 0.0, 0.0, 0.0], jac=its_jac).system.has_jac


def coupled(t, y, p):
    return np.array([-p[0] * y[0] + 0.5 * p[0] * y[1], 0.5 * p[0] * y[0] - p[0] * y[1] + np.cos(t)])


def wrong_later(t, y, p):
    matrix = p[0] * np.array([[-1.0, 0.5], [0.5, -1.0]])
    return matrix if t <= 1e-3 else p[1] * matrix


@pytest.mark.parametrize(("alpha", "factor", "max_steps"), [(0.5, 0.0, 3000), (0.9, 0.5, 500)])
def test_one_that_is_wrong_away_from_the_start_is_the_reason_of_the_end(alpha, factor, max_steps):
    args = hd.Caputo(alpha), coupled, [1.0, 0.5], [1e4, factor], wrong_later
    with pytest.warns(hd.SolveWarning, match="jac must hold"):
        sol = hd.solve(hd.Equation(*args), 3.0, rtol=1e-6, max_steps=max_steps)
    assert sol.status in (hd.Status.STEP_TOO_SMALL, hd.Status.MAX_STEPS)
    assert "where the run ends" in sol.message


def test_a_right_one_is_no_reason():
    args = hd.Caputo(0.9), coupled, [1.0, 0.5], [1e4, 1.0], wrong_later
    with pytest.warns(hd.SolveWarning):
        sol = hd.solve(hd.Equation(*args), 3.0, rtol=1e-6, max_steps=20)
    assert sol.status is hd.Status.MAX_STEPS
    assert "jac" not in sol.message
