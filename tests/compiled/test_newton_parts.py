"""Parts of Newton's method: elimination and products against NumPy's; verdicts on iterations."""

import numpy as np
import pytest

from hereditary.collocation.newton import verdict as of_stages
from hereditary.compiled.jit import compiled
from hereditary.compiled.linalg import (
    address_of_factors,
    dense_solver,
    largest_of,
    product,
    transposed_product,
)
from hereditary.compiled.newton import ACCEPT, CHECK, FAIL, ITERATE, REFRESH, RESTART
from hereditary.compiled.signatures import FACTORISE, SUBSTITUTE, LinearSolver
from hereditary.given.newton import verdict as of_step

pytestmark = pytest.mark.core
NAN, INF = np.nan, np.inf


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


@compiled
def largest(values, first, many):
    return largest_of(values, first, many)


def test_the_largest_of_values_is_nan_if_one_is():
    values = np.array([9.0, 1.0, -3.0, 2.0, 0.0, 9.0])
    assert largest(values, 1, 4) == 3.0
    for unbounded in (np.nan, np.inf, -np.inf):
        for place in range(1, 5):
            values[place], kept = unbounded, values[place]
            np.testing.assert_equal(largest(values, 1, 4), abs(unbounded))
            values[place] = kept


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
@pytest.mark.parametrize("n", [1, 2, 4, 5, 8, 11, 60, 401])
@pytest.mark.parametrize("column", [0, 1, -1])
def test_a_matrix_without_a_finite_pivot_has_no_factors(n, column):
    a, b, x, order = np.eye(n) + np.tri(n) / (2 * n), np.ones(n), np.empty(n), np.empty(n)
    for unit in (1e-305, 1.0, 1e305):
        assert solved(unit * a, order, b, x)
        np.testing.assert_allclose(a @ (unit * x), b, rtol=1e-13)
    for bad in (0.0, 1e-310, np.nan, np.inf):
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


@pytest.mark.parametrize(
    ("numbers", "fresh", "kept"),
    [
        # size, previous, allowed and slow; the verdict with a new Jacobian, and with a kept one
        ((1e-3, INF, 1e-9, 0.1), ITERATE, ITERATE),  # no rate is known
        ((1e-9, INF, 1e-9, 0.1), ACCEPT, ACCEPT),  # the error is at most the first correction
        ((1e-5, 1e-3, 1e-9, 0.1), ITERATE, ITERATE),
        ((2e-4, 1e-3, 1e-9, 0.1), REFRESH, REFRESH),
        ((1e-3, 1e-3, 1e-9, 0.1), REFRESH, RESTART),
        ((2e-3, 1e-3, 1e-9, 0.1), REFRESH, RESTART),
        ((INF, 1e-3, 1e-9, 0.1), FAIL, RESTART),
        ((INF, INF, 1e-9, 0.1), FAIL, RESTART),
        ((NAN, 1e-3, 1e-9, 0.1), FAIL, RESTART),
    ],
)
def test_an_iteration_on_given_steps_has_a_verdict(numbers, fresh, kept):
    assert of_step(*numbers, True, False) == fresh
    assert of_step(*numbers, False, False) == kept


@pytest.mark.parametrize("rate", [1e-6, 1e-3, 0.3, 0.7, 0.99])
def test_an_iteration_on_given_steps_ends_as_soon_as_its_rest_is_allowed(rate):
    """Corrections rate**k leave the sum of all further ones, a geometric series."""
    sizes = rate ** np.arange(2, 40)
    rests = sizes * rate / (1 - rate)
    for size, rest in zip(sizes, rests, strict=True):
        for allowed, ends in ((1.01 * rest, True), (0.99 * rest, False)):
            found = of_step(size, size / rate, allowed, 0.1, True, False)
            assert (found == ACCEPT) == ends


def test_small_corrections_that_shrink_slowly_are_compared_with_rounding_once():
    slow, fast = (0.6e-9, 1e-9), (0.4e-9, 1e-9)
    assert of_step(*slow, 1e-15, 0.1, True, True) == CHECK
    assert of_step(*slow, 1e-15, 0.1, True, False) == REFRESH
    assert of_step(*fast, 1e-15, 0.1, True, True) == REFRESH


@pytest.mark.parametrize(
    ("numbers", "fresh", "kept"),
    [
        # size, previous, rate and number of the iteration
        ((0.9, INF, 1.0, 0), ACCEPT, ACCEPT),  # below the goal
        ((20.0, INF, 0.01, 0), ACCEPT, ACCEPT),  # so will be the next one
        ((30.0, INF, 0.01, 0), ITERATE, ITERATE),
        ((30.0, INF, 5.0, 0), ITERATE, ITERATE),  # the rate is one of earlier steps
        ((30.0, 1e3, 0.03, 1), ITERATE, ITERATE),
        ((30.0, 1e2, 0.3, 1), ITERATE, REFRESH),
        ((30.0, 30.0, 1.0, 5), ITERATE, REFRESH),
        ((30.0, 30.0, 1.0, 6), FAIL, FAIL),
    ],
)
def test_an_iteration_of_collocation_has_a_verdict(numbers, fresh, kept):
    assert of_stages(*numbers, True) == fresh
    assert of_stages(*numbers, False) == kept
