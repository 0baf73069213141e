"""Small linear systems, as the steps of collocation solve them, against NumPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hereditary.compiled.linalg import factorise, substitute


def solved(a, b):
    """The solution by factors, or None where they are refused; a is left alone."""
    factors, order, x = a.copy(), np.empty(len(a)), np.empty(len(a))
    if not factorise(factors, order):
        return None
    assert sorted(order) == list(range(len(a)))
    substitute(factors, order, b, x)
    return x


@given(st.integers(1, 30), st.integers(0, 2**32 - 1), st.floats(-8, 8))
def test_linear_equations(n, seed, scale):
    """As exact as the matrix allows, whatever the size of its entries; also with zero pivots."""
    rng = np.random.default_rng(seed)
    a, b = 10.0**scale * rng.normal(size=(n, n)), rng.normal(size=n)
    a[rng.random(n) < 0.2, 0] = 0.0
    if np.linalg.cond(a) > 1e10:
        return
    x, expected = solved(a, b), np.linalg.solve(a, b)
    bound = 1e-14 * np.linalg.cond(a) * np.abs(expected).max()
    np.testing.assert_allclose(x, expected, rtol=0, atol=bound)


@given(hnp.arrays(float, 6, elements=st.floats(-10, 10)), st.permutations(range(6)))
def test_a_permutation_is_undone_exactly(b, order):
    assert np.array_equal(solved(np.eye(6)[order], b)[np.array(order)], b)


def test_factors_serve_many_right_hand_sides():
    rng = np.random.default_rng(3)
    a, order, x = rng.normal(size=(5, 5)), np.empty(5), np.empty(5)
    factors = a.copy()
    assert factorise(factors, order)
    for b in rng.normal(size=(4, 5)):
        before = b.copy()
        substitute(factors, order, b, x)
        np.testing.assert_allclose(a @ x, b, atol=1e-13)
        assert np.array_equal(b, before)


@pytest.mark.parametrize(
    "a",
    [
        np.zeros((1, 1)),
        np.zeros((3, 3)),
        np.ones((2, 2)),
        np.array([[1.0, 0.0, 2.0], [3.0, 0.0, 4.0], [5.0, 0.0, 6.0]]),
        np.array([[1.0, 2.0], [np.nan, 1.0]]) * np.nan,
        np.diag([1.0, np.nan, 1.0]),
    ],
)
def test_singular_matrices_and_such_of_nan_are_refused(a):
    assert solved(a, np.ones(len(a))) is None
