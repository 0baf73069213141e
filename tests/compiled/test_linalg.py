"""Elimination and products of the compiled marches against those of NumPy."""

import numpy as np
import pytest

from hereditary.compiled.jit import compiled
from hereditary.compiled.linalg import (
    address_of_factors,
    dense_solver,
    product,
    transposed_product,
)
from hereditary.compiled.signatures import FACTORISE, SUBSTITUTE, LinearSolver

pytestmark = pytest.mark.core


def solved(a, order, b, x):
    n = b.size
    room = np.zeros((1, n + 2, n))
    linear = LinearSolver(room, np.arange(n), lapack=address_of_factors(n))
    if dense_solver(FACTORISE, 0, a, x, linear) != 0:
        return False
    a[:], order[:], x[:] = room[0, :n], room[0, n], b
    assert dense_solver(SUBSTITUTE, 0, a, x, linear) == 0
    return True


@compiled
def multiplied(a, b, out):
    product(a, b, out)


@compiled
def multiplied_transposed(a, b, out):
    transposed_product(a, b, out)


@pytest.mark.parametrize("n", [*range(1, 14), 39, 40, 41, 90, 130, 401])
def test_systems_of_any_size_are_solved_to_rounding(n):
    generator = np.random.default_rng(n)
    a = generator.normal(size=(n, n)) * 10.0 ** generator.uniform(-6, 6, n)[:, None]
    a[:, ::3] *= 1e-3
    b, x, order = generator.normal(size=n), np.empty(n), np.empty(n)
    factors = a.copy()
    assert solved(factors, order, b, x)
    assert np.array_equal(np.sort(order), np.arange(n))
    lower, upper = np.tril(factors, -1) + np.eye(n), np.triu(factors)
    sizes = np.abs(lower) @ np.abs(upper)
    rows = order.astype(int)
    assert np.all(np.abs(lower) <= 1)
    assert np.all(np.abs(lower @ upper - a[rows]) <= 1e-15 * n * sizes)
    assert np.all(np.abs(a @ x - b)[rows] <= 3e-15 * n * (sizes @ np.abs(x)))


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize("n", [1, 2, 4, 5, 8, 11, 60])
@pytest.mark.parametrize("column", [0, 1, -1])
def test_a_matrix_without_a_finite_pivot_has_no_factors(n, column):
    a, b, x, order = np.eye(n) + np.tri(n) / (2 * n), np.ones(n), np.empty(n), np.empty(n)
    assert solved(a.copy(), order, b, x)
    for bad in (0.0, np.nan, np.inf):
        a[:, min(column, n - 1)] = bad
        assert not solved(a.copy(), order, b, x), bad


@pytest.mark.parametrize(
    ("m", "k", "n"), [(1, 1, 1), (3, 18, 50), (900, 18, 18), (40, 700, 9), (70, 70, 70), (0, 4, 4)]
)
def test_products_by_blocks_are_products(m, k, n):
    generator = np.random.default_rng(m + k)
    a, b = generator.normal(size=(m, k)), generator.normal(size=(k, n))
    out = np.full((m, n), np.nan)
    for multiply, first in ((multiplied, a), (multiplied_transposed, a.T.copy())):
        out[:] = np.nan
        multiply(first, b, out)
        np.testing.assert_allclose(out, a @ b, rtol=0, atol=1e-14 * k)
