"""Weights of every rule: to rounding however far back, and the same as sums of exponentials."""

import mpmath
import numpy as np
import pytest
from scipy.special import binom

from hereditary.given import weights as rules
from hereditary.given.schemes.adams import FIRST_VALUE, HATS
from hereditary.given.schemes.bdf import _FIRST_MODAL, quadrature_weights
from hereditary.given.schemes.grunwald_letnikov import POWER_SERIES, SPEED
from hereditary.given.schemes.l12 import BACKWARD_PARABOLAS, BACKWARD_START
from hereditary.kernels.exponential_sum import fit_unit
from hereditary.kernels.step_kernel import PowerSteps

POWERS = tuple(PowerSteps(p) for p in (0.05, 0.5, 0.95))
FAR = [1, 2, 3, 4, 17, 300, 99_999]


def moment(p, low, high, power_of_offset, middle):
    """int p t**(p-1) (middle - t)**power dt over [low, high], in high precision."""

    def primitive(t, e):
        return mpmath.mpf(t) ** (p + e) * p / (p + e)

    plain = primitive(high, 0) - primitive(low, 0)
    if power_of_offset == 0:
        return plain
    return middle * plain - (primitive(high, 1) - primitive(low, 1))


def parabola(theta, closing, p, k):
    """W_k straight from its definition."""

    def a(j):
        return moment(p, max(j - 1 + theta, 0), j + theta, 0, 0)

    def m(j):
        middle = mpmath.mpf(j) - mpmath.mpf(1) / 2 + theta
        return moment(p, j - 1 + theta, j + theta, 1, middle) if j > 0 else 0

    value = a(k) + m(k + 1) - m(k)
    if closing:
        last = moment(p, 0, 1, 1, mpmath.mpf(1) / 2)
        value += {0: last, 1: -last}.get(k, 0)
    return value


@pytest.mark.parametrize("p", [0.02, 0.3, 0.7, 0.98])
@pytest.mark.parametrize(("theta", "closing"), [(1.0, True), (0.75, False), (0.5, False)])
def test_parabola_weights(theta, closing, p):
    found = rules.parabola_weights(theta, closing).exact(PowerSteps(p), 100_000)
    start = rules.parabola_start(theta).exact(PowerSteps(p), 100_000)
    with mpmath.workdps(60):
        p_exact, theta = mpmath.mpf(p), mpmath.mpf(theta)
        for k in [0, *FAR]:
            expected = float(parabola(theta, closing, p_exact, k))
            assert found[k] == pytest.approx(expected, rel=1e-13), k
        for k in [0, *FAR]:
            middle = k + theta + mpmath.mpf(1) / 2
            expected = -moment(p_exact, k + theta, k + 1 + theta, 1, middle)
            assert start[k] == pytest.approx(float(expected), rel=2e-14), k


@pytest.mark.parametrize("p", [0.02, 0.3, 0.7, 0.98])
def test_backward_parabola_weights(p):
    found, start = (
        rule.exact(PowerSteps(p), 100_000) for rule in (BACKWARD_PARABOLAS, BACKWARD_START)
    )
    with mpmath.workdps(60):
        p_exact = mpmath.mpf(p)

        def m(j):
            return moment(p_exact, j, j + 1, 1, j + mpmath.mpf(1) / 2) if j >= 0 else 0

        for k in [0, *FAR]:
            expected = moment(p_exact, k, k + 1, 0, 0) + m(k) - m(k - 1)
            assert found[k] == pytest.approx(float(expected), rel=1e-13), k
            assert start[k] == pytest.approx(-float(m(k)), rel=2e-14), k


@pytest.mark.parametrize("alpha", [0.05, 0.5, 0.95, 1.0, 1.05, 1.5, 1.95, 2.0])
def test_power_series_weights(alpha):
    """Binomial coefficients of (1-z)**(alpha-1), and above order 1 their sums for x'(0)."""
    k = np.arange(60)
    found, start = POWER_SERIES.exact(alpha, 60), SPEED.exact(alpha, 60)
    np.testing.assert_allclose(found, (-1.0) ** k * binom(alpha - 1, k), rtol=1e-12, atol=1e-15)
    expected = -np.cumsum(found) if alpha > 1 else np.zeros(60)
    expected[0] += 1.0  # the march solves for a change of h x'(0)
    np.testing.assert_allclose(start, expected, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("alpha", [0.05, 0.5, 0.95, 1.05, 1.5, 1.95])
def test_hat_weights(alpha):
    found, start = HATS.exact(alpha, 100_000), FIRST_VALUE.exact(alpha, 100_000)
    with mpmath.workdps(60):
        a = mpmath.mpf(alpha)

        def g(k):
            power = [mpmath.mpf(abs(j)) ** (a + 1) for j in (k + 1, k, k - 1)]
            return power[0] - 2 * power[1] + power[2] if k else mpmath.mpf(1)

        def first(k):
            return mpmath.mpf(k) ** (a + 1) - (k - a) * mpmath.mpf(k + 1) ** a if k >= 0 else 0

        for k in FAR:
            assert found[k] == pytest.approx(float(g(k) - g(k - 1)), rel=1e-12), k
        for k in [0, *FAR]:
            expected = float(first(k) - first(k - 1))
            assert start[k] == pytest.approx(expected, rel=1e-12), k
    assert found[0] == 1.0


@pytest.mark.parametrize("alpha", [0.05, 0.5, 0.95, 1.5, 1.9])
@pytest.mark.parametrize("p", [1, 2, 3, 4, 5, 6])
def test_quadrature_weights(p, alpha):
    """The first ones against the power series, the last against the integral along the cut."""
    n = 20_000
    found = quadrature_weights(p).exact(alpha, n)
    z = 0.7 * np.exp(2j * np.pi * np.arange(256) / 256)
    delta = sum((1 - z) ** k / k for k in range(1, p + 1))
    series = np.fft.fft(delta**alpha / (1 - z)).real / 256 / 0.7 ** np.arange(256)
    np.testing.assert_allclose(found[:20], series[:20], rtol=1e-11, atol=2e-12)
    with mpmath.workdps(30):

        def along_cut(log_s):
            s = mpmath.exp(log_s)
            x = -mpmath.expm1(s)
            delta = sum(x**k / mpmath.mpf(k) for k in range(1, p + 1))
            return mpmath.exp(-(n - 1) * s) * abs(delta) ** alpha / mpmath.expm1(s) * s

        tail = mpmath.quad(along_cut, [-1500, -400, -100, -50, -20, -14, -11, -9, -7.5, -6])
        expected = mpmath.sinpi(alpha) / mpmath.pi * tail
    assert found[-1] == pytest.approx(float(expected), rel=1e-10)


QUADRATURES = [
    (f"quadrature {p}", quadrature_weights(p), (0.1, 0.5, 0.9, 1.1, 1.5), first)
    for p, first in zip((1, 2, 3, 4, 5, 6), _FIRST_MODAL, strict=True)
]
RULES = [
    *QUADRATURES,
    ("first differences", rules.FIRST_DIFFERENCES, POWERS, 2),
    ("second differences", rules.SECOND_DIFFERENCES, POWERS, 2),
    ("shifted", rules.shifted_differences(0.6), POWERS, 2),
    ("parabola", rules.parabola_weights(1.0, closing=True), POWERS, 2),
    ("parabola sigma", rules.parabola_weights(0.7, closing=False), POWERS, 2),
    ("parabola start", rules.parabola_start(0.7), POWERS, 2),
    ("backward parabola", BACKWARD_PARABOLAS, POWERS, 2),
    ("backward start", BACKWARD_START, POWERS, 2),
    ("quadrature from 2 on", POWER_SERIES, (0.05, 0.5, 0.95, 1.05, 1.5, 1.95), 2),
    ("quadrature of x'(0)", SPEED, (1.05, 1.5, 1.95), 2),
    ("hats", HATS, (0.05, 0.5, 0.95, 1.05, 1.5, 1.95), 3),
    ("first value", FIRST_VALUE, (0.05, 0.5, 0.95, 1.05, 1.5, 1.95), 2),
]


@pytest.mark.parametrize(("name", "rule", "numbers", "first"), RULES, ids=lambda v: str(v)[:20])
def test_modal_shares_sum_to_the_weights(name, rule, numbers, first):
    n = 20_000
    for p in numbers:
        rates, weights, *_ = fit_unit((rule.exponent(p),), float(n), 1e-12)
        shares = rule.modal(p, rates, weights[0], first)
        k = np.unique(np.geomspace(first, n - 1, 200).astype(int))
        summed = np.exp(-np.multiply.outer(k - first, rates)) @ shares
        exact = rule.exact(p, n)[k]
        # a difference of moments is off by the tolerance of the moments themselves
        number = getattr(p, "p", p)  # of a kernel, or itself
        moments = np.abs(k - 1.0 + 1e-9) ** ((number if number < 1 else number - 1) - 1)
        scale = (
            np.abs(exact) if name.startswith("quadrature") else np.maximum(moments, np.abs(exact))
        )
        assert np.all(np.abs(summed - exact) <= 2e-11 * scale), p


def test_no_memory_at_the_integers():
    for rule in (rules.FIRST_DIFFERENCES, rules.SECOND_DIFFERENCES):
        assert rule.exponent(PowerSteps(0.0)) is None
    assert HATS.exponent(1.0) is None
    parabolas = rules.parabola_weights(1.0, closing=True).exact(PowerSteps(0.0), 5)
    assert parabolas.tolist() == [1.5, -0.5, 0, 0, 0]
    assert BACKWARD_PARABOLAS.exact(PowerSteps(0.0), 5).tolist() == [1.5, -0.5, 0, 0, 0]
    assert [POWER_SERIES.exponent(alpha) for alpha in (1.0, 2.0)] == [None, None]
    assert HATS.exact(1.0, 6).tolist() == pytest.approx([1, 1, 0, 0, 0, 0], abs=1e-15)


@pytest.mark.parametrize("alpha", [0.05, 0.1, 0.3, 0.5, 0.8, 0.95, 1.0])
def test_the_symbol_of_l12_keeps_to_the_sector_of_growth(alpha):
    """So no damped mode grows at any step; the excess of 0.57 degrees is the largest there is."""
    z = np.exp(1j * np.linspace(0.1, np.pi, 400))
    weights = BACKWARD_PARABOLAS.exact(PowerSteps(1 - alpha), 20_000)
    for _ in range(4):  # the series of the fourth differences converges on the circle
        weights = np.diff(weights, prepend=0.0)
    symbol = np.polynomial.polynomial.polyval(z, weights) / (1 - z) ** 3
    excess = np.degrees(np.abs(np.angle(symbol)).max()) - 90 * alpha
    assert excess < 0.6
    assert (excess > 0.5) == (alpha == 0.3)
    assert np.abs(np.angle(symbol)).max() < np.pi / 2 or alpha == 1
