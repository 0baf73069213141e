"""Special functions and moments keep every digit, shared rates their tolerance, roots rounding."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import hereditary as hd
from hereditary.given.row_plan import moments
from hereditary.kernels.exponential_sum import bank_of_all_orders, fit_unit, weights_of_orders
from hereditary.kernels.special import (
    alternating_power_sum,
    alternating_sum,
    hurwitz_zeta,
    mean_exponential,
    power_differences,
    power_second_differences,
)
from hereditary.solver.events import bracketed_root

POWERS = [1e-6, 0.05, 0.2, 0.5, 0.8, 0.999]


def exact(p, k):
    with mpmath.workdps(50):
        p = mpmath.mpf(p)
        return [mpmath.mpf(j + 1) ** p - mpmath.mpf(j) ** p for j in (k - 1, k)]


@pytest.mark.parametrize("p", POWERS)
def test_differences_of_powers_keep_their_digits(p):
    n = 100_000
    b, c = power_differences(p, n), power_second_differences(p, n)
    assert b[0] == c[0] == 1
    for k in [1, 2, 5, 15, 16, 17, 18, 100, 1234, n - 1]:
        before, here = exact(p, k)
        assert b[k] == pytest.approx(float(here), rel=2e-15)
        assert c[k] == pytest.approx(float(here - before), rel=2e-14)


def test_classical_terms_have_no_memory():
    assert power_differences(0.0, 5).tolist() == [1, 0, 0, 0, 0]
    assert power_second_differences(0.0, 40).tolist() == [1, -1] + 38 * [0]


@pytest.mark.parametrize("p", [0.0, *POWERS[1:]])
def test_alternating_sum(p):
    with mpmath.workdps(30):
        expected = 2 * mpmath.altzeta(-p)
    assert alternating_power_sum(p) == pytest.approx(float(expected), rel=1e-13)


def test_sums_of_weights_telescope():
    n, p = 5000, 0.37
    assert power_differences(p, n).sum() == pytest.approx(n**p, rel=1e-13)
    assert power_second_differences(p, n).sum() == pytest.approx(
        power_differences(p, n)[-1], rel=1e-12
    )


def test_mean_exponential():
    z = np.array([0.0, 1e-300, 1e-9, 0.3, 50.0, 1e6])
    with mpmath.workdps(40):
        expected = [1.0] + [float(-mpmath.expm1(-mpmath.mpf(v)) / mpmath.mpf(v)) for v in z[1:]]
    np.testing.assert_allclose(mean_exponential(z), expected, rtol=4e-16)


@given(st.floats(-3.0, 0.95), st.floats(0.05, 2.0))
@example(-1e-13, 0.5)
@example(-5e-324, 0.3)
@example(-1e-38, 0.3)
@example(0.0, 0.3)
@example(1e-30, 0.3)
def test_hurwitz_zeta(s, q):
    """Below s = 0 mpmath reflects and loses as many digits as 1 / s has, so it is given more."""
    with mpmath.workdps(50):
        truth = float(mpmath.zeta(s, q)) if abs(s) > 1e-20 else 0.5 - q
    assert abs(hurwitz_zeta(s, q) - truth) < 1e-11 * max(1.0, abs(truth), 1 / abs(1 - s))


@settings(max_examples=30)
@given(st.floats(0.01, 5), st.floats(0.01, 5))
def test_alternating_sums_of_exponentials(rate, other):
    k = np.arange(24)
    terms = np.exp(-rate * k) + np.exp(-other * k)
    exact = 1 / (1 + np.exp(-rate)) + 1 / (1 + np.exp(-other))
    assert abs(alternating_sum(terms) - exact) < 1e-13


@pytest.mark.parametrize("p", [0.02, 0.3, 0.7, 0.98])
def test_moments_of_steps_of_a_mesh(p):
    for low, width in ((0.0, 1.0), (1e-9, 1.0), (0.1, 1.0), (0.5, 1.0), (1.0, 1.0), (1.0, 1e-12)):
        with mpmath.workdps(60):
            a, b, q = mpmath.mpf(low), mpmath.mpf(low) + mpmath.mpf(width), mpmath.mpf(p)
            m_0 = b**q - a**q
            m_1 = (a + b) / 2 * m_0 - q / (q + 1) * (b ** (q + 1) - a ** (q + 1))
        found = moments(low, width, p)
        assert found[0] == pytest.approx(float(m_0), rel=1e-14)
        assert found[1] == pytest.approx(float(m_1), rel=1e-13)


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


@pytest.mark.parametrize(
    ("function", "low", "high", "root"),
    [
        (lambda x: x - 1.0 / 3.0, 0.0, 1.0, 1.0 / 3.0),
        (lambda x: np.cos(x) - x, 0.0, 1.0, 0.7390851332151607),
        (lambda x: x**9, -1.0, 3.0, 0.0),  # flat: false position alone would creep
        (lambda x: np.expm1(50.0 * (x - 0.9)), 0.0, 1.0, 0.9),
        (lambda x: np.sign(x - 0.3), 0.0, 1.0, 0.3),  # a jump
        (lambda x: x, 0.0, 1.0, 0.0),
        (lambda x: x - 1.0, 0.0, 1.0, 1.0),
        (lambda x: 2.0 - x, 5.0, 1.0, 2.0),  # falling, given the other way round
    ],
)
def test_bracketed_root(function, low, high, root):
    calls = []

    def counted(x):
        calls.append(x)
        return function(x)

    found = bracketed_root(counted, low, high)
    assert found == pytest.approx(root, abs=1e-15)
    assert len(calls) < 250
