"""Exponential bases: kernels at all distances, to their tolerance, and refined with equal rates."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import rgamma

from hereditary.collocation.exponential_basis import power_law_basis
from hereditary.collocation.varying import varying_basis

ORDERS = st.lists(st.floats(0.001, 1.0), min_size=1, max_size=3, unique=True).map(sorted)
EXPONENTS = st.floats(-13, -3)


def errors(basis, closest=None, farthest=None, n=4000):
    """Relative errors of each kernel at n distances between the closest and the farthest."""
    t = np.geomspace(closest or basis.closest, farthest or basis.farthest, n)
    sums = basis.weights @ np.exp(-np.multiply.outer(basis.rates, t))
    a = np.array(basis.orders)[:, None]
    return np.abs(sums / (t ** (a - 1) * rgamma(a)) - 1)


@settings(max_examples=30)
@given(ORDERS, st.floats(-12, 0), st.floats(1, 15), EXPONENTS)
def test_kernels_at_all_distances(orders, low, decades, log_tol):
    closest, tol = 10.0**low, 10.0**log_tol
    basis = power_law_basis(orders, closest, closest * 10**decades, tol)
    assert errors(basis).max() <= tol + 2e-15
    assert basis.orders == tuple(orders)
    assert basis.weights.shape == (len(orders), basis.rates.size)
    assert np.all(basis.weights >= 0)
    assert np.all(basis.rates >= 0)
    assert np.all(np.diff(basis.rates) >= 0)


@pytest.mark.parametrize("orders", [[0.5], [0.2, 0.8], [1e-3, 0.999]])
def test_beyond_its_distances_a_basis_does_not_hold(orders):
    """The two-sided half: it would be too large if it held much further than asked for."""
    basis = power_law_basis(orders, 1e-3, 1e3, 1e-8)
    assert np.all(errors(basis, 1e-6, 2e-6).max(axis=1) > 1e-8)
    assert np.all(errors(basis, 1e7, 2e7).max(axis=1) > 1e-8)


@settings(max_examples=30)
@given(ORDERS, st.floats(1, 10), EXPONENTS, st.floats(0.01, 6))
def test_a_refined_basis_extends_the_old_one(orders, decades, log_tol, log_factor):
    """It reaches down to what was asked, to the same tolerance, and old modes keep their rates."""
    old = power_law_basis(orders, 1e-2, 1e-2 * 10**decades, 10.0**log_tol)
    wanted = 1e-2 / 10**log_factor
    new = old.refine(wanted)
    assert new.closest <= wanted * (1 + 1e-12)
    assert (new.orders, new.farthest, new.tol) == (old.orders, old.farthest, old.tol)
    n = old.rates.size
    np.testing.assert_allclose(new.rates[:n], old.rates, rtol=1e-6)
    assert np.all(new.rates[n:] > old.rates[-1])
    assert errors(new).max() <= new.tol + 2e-15


def test_a_basis_keeps_its_grid_where_its_tolerance_is_that_of_rounding():
    """There a fit may need another share of its tolerance than one that reaches closer."""
    orders, tol, alone = [0.0031612884040537552, 1.0], 2e-14, []
    for closest in np.geomspace(1e-1, 1e-6, 40):
        old = power_law_basis(orders, closest, 4.2e5, tol)
        new = old.refine(closest / 100)
        assert new.fraction == old.fraction
        np.testing.assert_allclose(new.rates[: old.rates.size], old.rates, rtol=1e-6)
        alone.append(power_law_basis(orders, new.closest, 4.2e5, tol).fraction - old.fraction)
    assert min(alone) < 0 < max(alone)  # by which machines round, at other distances


def test_closer_and_closer():
    """A thousand times closer in many small reaches, as in one."""
    basis = power_law_basis([0.3, 0.7], 1.0, 1e4, 1e-10)
    one = basis.refine(1e-3)
    for reach in np.geomspace(0.5, 1e-3, 12):
        basis = basis.refine(reach)
    assert abs(basis.rates.size - one.rates.size) <= 1
    assert errors(basis).max() <= 1e-10


def test_where_it_is_close_enough_it_stays():
    basis = power_law_basis([0.5], 1e-3, 1e3, 1e-8)
    same = basis.refine(basis.closest)
    assert np.array_equal(same.rates, basis.rates)


@pytest.mark.parametrize("orders", [[1.0], [0.4, 1.0]])
def test_a_constant_kernel_is_one_mode_that_does_not_decay(orders):
    for basis in (
        power_law_basis(orders, 1e-3, 1e3, 1e-8),
        power_law_basis(orders, 1.0, 1e3, 1e-8).refine(0.1),
    ):
        assert basis.rates[0] == 0.0
        assert basis.weights[-1].tolist() == [1.0] + [0.0] * (basis.rates.size - 1)
        assert np.all(basis.weights[:-1, 0] == 0.0)
        assert errors(basis).max() <= 1e-8


def test_a_tighter_tolerance_takes_more_modes_and_shared_rates_fewer():
    sizes = [power_law_basis([0.5], 1e-3, 1e3, tol).rates.size for tol in (1e-4, 1e-8, 1e-12)]
    assert sizes == sorted(sizes)
    assert sizes[0] < sizes[2] <= 60
    alone = [power_law_basis([a], 1e-3, 1e3, 1e-8).rates.size for a in (0.3, 0.6)]
    assert power_law_basis([0.3, 0.6], 1e-3, 1e3, 1e-8).rates.size < sum(alone)


@pytest.mark.parametrize("closest", [1e-3, 1e-7, 3e-20])
def test_a_basis_of_orders_that_vary_is_refined(closest):
    basis = varying_basis(1e-2, 1e3, 1e-9)
    closer = basis.refine(closest)
    assert closer.closest <= closest
    np.testing.assert_allclose(closer.rates[: basis.rates.size], basis.rates, rtol=1e-9)
    t = np.geomspace(closest, 1e3, 200)
    for a in (0.01, 0.3, 0.99):
        sums = np.exp(-np.multiply.outer(t, closer.rates)) @ closer.weights(np.array([a]))[:, 0]
        np.testing.assert_allclose(sums, t ** (a - 1) * rgamma(a), rtol=1e-9)
