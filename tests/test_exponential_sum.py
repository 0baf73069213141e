"""`fit_exponentials` keeps its tolerance everywhere, with close to the fewest modes possible."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.special import gammaln, loggamma

import hereditary as hd

EXPONENTS = [1e-6, 1e-3, 0.1, 0.5, 0.9, 1.0, 1.5, 1.99]
RATIOS = [1e1, 1e3, 2e5, 1e7, 1e12]
TOLERANCES = [1e-3, 1e-6, 1e-10, 1e-13]


def best_count(exponent, ratio, tol):
    """The fewest exponentials that can reach `tol`: a law measured on minimax approximations.

    Their rates are exp(h) apart, where ``2 |Gamma(a + 2 pi i / h)| / Gamma(a) = 0.9 tol``.
    """

    def excess(u):
        size = loggamma(complex(exponent, 2 * math.pi * u)).real - gammaln(exponent)
        return size + math.log(2 / (0.9 * tol))

    h = 1 / brentq(excess, 0.5, 50.0) if excess(0.5) > 0 else 2.0
    return math.ceil(math.log(4 * ratio) / h)


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
