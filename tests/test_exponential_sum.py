"""`fit_exponentials` keeps its tolerance everywhere, with close to the fewest modes possible."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import hereditary as hd
from hereditary.kernels.exponential_sum import (
    bank_of_all_orders,
    fit_unit,
    trapezoid_step,
    weights_of_orders,
)

EXPONENTS = [1e-6, 1e-3, 0.1, 0.5, 0.9, 1.0, 1.5, 1.99]
RATIOS = [1e1, 1e3, 2e5, 1e7, 1e12]
TOLERANCES = [1e-3, 1e-6, 1e-10, 1e-13]


def best_count(exponent, ratio, tol):
    """The fewest exponentials that can reach `tol`: a law measured on minimax approximations."""
    return math.ceil(math.log(4 * ratio) / trapezoid_step(exponent, tol))


def worst_error(fit, exponent):
    t = np.exp(np.linspace(math.log(fit.t_min), math.log(fit.t_max), 20_001))
    t[0], t[-1] = fit.t_min, fit.t_max
    return np.abs(fit(t) * t**exponent - 1).max()


def check(exponent, t_min, ratio, tol):
    fit = hd.fit_exponentials(hd.PowerLaw(exponent), t_min, t_min * ratio, tol)
    assert worst_error(fit, exponent) <= tol
    assert fit.max_error <= tol
    assert np.all(fit.weights > 0)
    assert np.all(fit.rates >= 0)
    assert np.all(np.diff(fit.rates) > 0)
    assert fit.n_modes <= best_count(exponent, ratio, tol) + 12
    return fit


@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("exponent", EXPONENTS)
def test_fit(exponent, ratio, tol):
    check(exponent, 1.0, ratio, tol)


@given(
    st.floats(math.log(1e-6), math.log(1.99)),
    st.floats(1.0, 12.0),
    st.floats(-13.0, -3.0),
    st.floats(-6.0, 6.0),
)
def test_fit_anywhere(log_exponent, decades, log_tol, log_t_min):
    check(math.exp(log_exponent), 10**log_t_min, 10**decades, 10**log_tol)


@pytest.mark.parametrize("tol", [1e-4, 1e-8, 1e-12])
def test_the_tolerance_is_used_and_not_only_met(tol):
    fit = hd.fit_exponentials(hd.PowerLaw(0.5), 1.0, 1e6, tol)
    assert worst_error(fit, 0.5) > tol / 20
    # the next tolerance costs modes: none are carried along unused
    assert hd.fit_exponentials(hd.PowerLaw(0.5), 1.0, 1e6, tol / 10).n_modes > fit.n_modes


def test_reported_error_does_not_understate():
    for exponent in EXPONENTS:
        fit = hd.fit_exponentials(hd.PowerLaw(exponent), 1.0, 1e5, 1e-9)
        assert worst_error(fit, exponent) <= 1.01 * fit.max_error


def test_beyond_the_interval_it_fails():
    fit = hd.fit_exponentials(hd.PowerLaw(0.5), 1.0, 1e3, 1e-10)
    assert abs(fit(1e5) * 1e5**0.5 - 1) > 0.1
    assert abs(fit(1e-3) * 1e-3**0.5 - 1) > 0.1


def test_kernels_share_one_bank():
    alone = sum(fit_unit((a,), 2e5, 1e-10).rates.size for a in (0.8, 0.6))
    rates, weights, error, _ = fit_unit((0.6, 0.8), 2e5, 1e-10)
    assert rates.size <= 0.7 * alone
    assert error <= 1e-10
    t = np.exp(np.linspace(0, math.log(2e5), 20_001))[:-1]
    table = np.exp(-np.multiply.outer(t, rates))
    for row, a in zip(weights, (0.6, 0.8), strict=True):
        assert np.abs(table @ row * t**a - 1).max() <= 1e-10


@pytest.mark.parametrize("tol", [1e-4, 1e-7, 1e-10, 1e-13])
@pytest.mark.parametrize("ratio", [1e3, 2e7])
def test_one_set_of_rates_serves_every_order(ratio, tol):
    """Relative error below tol at 20,001 points for all exponents; weights positive; not idle."""
    rates, _, _ = bank_of_all_orders(ratio, tol)
    t = np.exp(np.linspace(0.0, math.log(ratio), 20_001))
    exponents = np.concatenate([[1e-300, 1e-9, 1e-4], np.linspace(0.01, 1.0, 34)])
    weights = weights_of_orders(np.array(exponents), ratio, tol).T
    assert np.all(weights >= 0)
    decays = np.exp(-np.multiply.outer(t, rates))
    errors = np.abs(decays @ weights.T * t[:, None] ** exponents - 1).max(axis=0)
    assert errors.max() < max(tol, 3e-14)
    assert errors[-1] > 0.5 * tol
    alone = hd.fit_exponentials(hd.PowerLaw(0.5), 1.0, ratio, tol).n_modes
    assert alone < rates.size < 2 * alone
