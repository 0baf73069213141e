"""The compiled pieces of a collocation step, against high precision and against NumPy."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hereditary.kernels.linalg import factorise, substitute
from hereditary.kernels.mode_tables import exponential_legendre

# Around the changes of method, z = 20 and the smallest arguments, and everywhere else.
ARGUMENTS = [0.0, 5e-324, 1e-300, 1e-20, 1e-8, 1e-3, 0.1, 1.0, 5.0, 19.9, 20.0, 20.1, 25.0, 50.0]
ARGUMENTS += [100.0, 745.0, 1e3, 1e4, 1e6, 1e12]


def moments(z, n=12):
    out = np.full(n, np.nan)
    exponential_legendre(z, n, out)
    return out


def exact_moments(z, n=12):
    """``exp(-x) i_k(x)``, x = z/2, with modified spherical Bessel functions in 60 digits."""
    if z == 0:
        return np.eye(n)[0]
    with mpmath.workdps(60):
        x = mpmath.mpf(z) / 2
        factor = mpmath.sqrt(mpmath.pi / (2 * x)) * mpmath.exp(-x)
        half = mpmath.mpf(1) / 2
        return np.array([float(factor * mpmath.besseli(k + half, x)) for k in range(n)])


@pytest.mark.parametrize("z", ARGUMENTS)
def test_moments_of_legendre_polynomials(z):
    """The high ones are tiny for small z, and no digit of them is lost."""
    exact = exact_moments(z)
    if z <= 20:
        np.testing.assert_allclose(moments(z), exact, rtol=5e-15, atol=1e-300)
    else:
        np.testing.assert_allclose(moments(z), exact, rtol=0, atol=3e-14 * exact[0])


@given(st.floats(0, 1e6), st.integers(1, 12))
def test_moments_are_those_of_exponentials(z, n):
    """For any z, against Gauss' rule where the exponential is not steep; fewer are the same."""
    found = moments(z)
    assert np.array_equal(moments(z, n), found[:n])
    assert np.all((found >= 0) & (found <= found[0]))
    if z < 50:
        x, weights = np.polynomial.legendre.leggauss(60)
        values = np.polynomial.legendre.legvander(x, 11)
        expected = 0.5 * (weights * np.exp(-z * (1 - x) / 2)) @ values
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize("z", [1e-9, 0.3, 30.0, 1e5])
def test_moments_obey_the_recurrence_of_bessel_functions(z):
    """``i_(k-1)(x) - i_(k+1)(x) = (2 k + 1) / x i_k(x)``."""
    m, x, k = moments(z), z / 2, np.arange(1, 11)
    np.testing.assert_allclose(m[:-2] - m[2:], (2 * k + 1) / x * m[1:-1], rtol=1e-12, atol=1e-15)


def solved(a, b):
    """The solution by factors, or None where they are refused; a is left alone."""
    factors, order, x = a.copy(), np.empty(len(a), dtype=np.int64), np.empty(len(a))
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
    a, order, x = rng.normal(size=(5, 5)), np.empty(5, dtype=np.int64), np.empty(5)
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
