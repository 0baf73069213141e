"""Memory kernels: closed forms against mpmath, fits within their tolerance, limits, refusals."""

import math

import mpmath
import numpy as np
import pytest
import scipy.integrate
import scipy.special
from hypothesis import given, settings
from hypothesis import strategies as st

import hereditary as hd
from hereditary import (
    DistributedOrder,
    GammaDensity,
    Kernel,
    MemoryKernel,
    MittagLeffler,
    Prony,
    StretchedExponential,
    TabulatedKernel,
    TemperedPowerLaw,
)

TIMES = [1e-300, 1e-12, 1e-3, 0.3, 1.0, 5.0, 40.0]


def series(alpha, beta, x):
    """E_(alpha, beta)(-x) by its series, in as many digits as that cancels."""
    with mpmath.workdps(40 + int(float(x) ** (1 / alpha))):
        total, n = mpmath.mpf(0), 0
        while True:
            term = (-x) ** n * mpmath.rgamma(alpha * n + beta)
            total, n = total + term, n + 1
            if n > 20 and abs(term) < abs(total) * mpmath.mpf(10) ** -30:
                return total


def exact(kernel, t):
    """Value and integral in 40 digits."""
    t = mpmath.mpf(t)
    if isinstance(kernel, MittagLeffler):
        a, r = mpmath.mpf(kernel.order), mpmath.mpf(kernel.rate)
        return series(a, 1, (r * t) ** a), t * series(a, 2, (r * t) ** a)
    a, r = mpmath.mpf(kernel.exponent), mpmath.mpf(kernel.rate)
    if isinstance(kernel, TemperedPowerLaw):
        return t**-a * mpmath.exp(-r * t), mpmath.gammainc(1 - a, 0, r * t) / r ** (1 - a)
    x = (r * t) ** a
    return mpmath.exp(-x), mpmath.gammainc(1 / a, 0, x) / (a * r)


@pytest.mark.parametrize("t", TIMES)
@pytest.mark.parametrize(
    "kernel",
    [
        *(TemperedPowerLaw(a, 2.0) for a in (1e-3, 0.5, 0.95)),
        *(StretchedExponential(b, 2.0) for b in (0.05, 0.5, 0.9, 1.0)),
        *(MittagLeffler(a, 2.0) for a in (0.5, 0.8, 0.95, 0.999, 1.0)),
    ],
    ids=str,
)
def test_values_and_integrals(kernel, t):
    if isinstance(kernel, MittagLeffler) and kernel.order == 0.5 and t > 5:
        pytest.skip("the series needs thousands of digits")
    with mpmath.workdps(40):
        value, integral = exact(kernel, t)
        assert abs(mpmath.mpf(float(kernel(t))) / value - 1) < 1e-13
        assert abs(mpmath.mpf(float(kernel.integral(t))) / integral - 1) < 1e-14


@pytest.mark.parametrize("kernel", [TemperedPowerLaw(0.5, 1.0), StretchedExponential(0.4, 1.0)])
def test_integrals_by_quadrature(kernel):
    with mpmath.workdps(30):
        whole = mpmath.quad(lambda u: exact(kernel, u**4)[0] * 4 * u**3, [0, 0.5, 1, 1.2])
    assert float(kernel.integral(1.2**4)) == pytest.approx(float(whole), rel=1e-13)


@pytest.mark.parametrize(
    ("order", "t"), [(0.05, 1e25), (0.3, 1e18), (0.8, 1e18), (0.5, 1e280), (0.999, 1e280)]
)
def test_mittag_leffler_long_after(order, t):
    with mpmath.workdps(40):
        x, a = mpmath.mpf(t) ** mpmath.mpf(order), mpmath.mpf(order)
        terms = [-((-x) ** -n) for n in range(1, 25)]
        value = sum(c * mpmath.rgamma(1 - a * n) for n, c in enumerate(terms, 1))
        whole = t * sum(c * mpmath.rgamma(2 - a * n) for n, c in enumerate(terms, 1))
    kernel = MittagLeffler(order, 1.0)
    assert float(kernel(t)) == pytest.approx(float(value), rel=1e-13)
    assert float(kernel.integral(t)) == pytest.approx(float(whole), rel=1e-13)


def worst(fit, kernel, t_min, t_max):
    """Largest error relative to K, and at least to a thousandth of its mean from 0 to t."""
    t = np.geomspace(t_min, t_max, 20_001)
    t[[0, -1]] = t_min, t_max
    values = kernel(t)
    return (np.abs(fit(t) - values) / np.maximum(values, 1e-3 * kernel.integral(t) / t)).max()


def check(kernel, t_min, t_max, tol):
    fit = hd.fit_exponentials(kernel, t_min, t_max, tol)
    error = worst(fit, kernel, t_min, t_max)
    assert error <= 1.02 * tol
    assert fit.max_error <= tol
    assert error <= 1.05 * fit.max_error + 2e-14
    assert np.all(fit.weights > 0)
    assert np.all(fit.rates >= 0)
    assert np.all(np.diff(fit.rates) > 0)
    return fit


# All of them down to 1e-10: convergence/memory_kernels.py, which takes minutes.
@pytest.mark.parametrize(
    ("kernel", "most", "tol"),
    [
        (TemperedPowerLaw(0.5, 1.0), 50, 1e-10),
        (TemperedPowerLaw(0.5, 1.0), 50, 1e-4),
        (MittagLeffler(0.5, 1.0), 65, 1e-8),
        (MittagLeffler(0.95, 1.0), 65, 1e-4),
        (MittagLeffler(0.999, 1.0), 70, 1e-4),
        (StretchedExponential(0.3, 1.0), 60, 1e-8),
        (StretchedExponential(0.8, 1.0), 80, 1e-4),
        (StretchedExponential(0.9, 1.0), 70, 1e-4),
        (DistributedOrder([0.0, 0.2, 0.9], [1.0, 1.0, 2.0]), 60, 1e-4),
        (DistributedOrder.from_density(lambda a: 1 + a), 60, 1e-8),
        (Kernel(lambda t: 1 / np.sqrt(t * (1 + t))), 60, 1e-8),
    ],
    ids=lambda value: str(value)[:40],
)
def test_fits_over_six_decades(kernel, most, tol):
    assert check(kernel, 1e-4, 1e2, tol).n_modes <= most


@pytest.mark.parametrize(
    "kernel", [TemperedPowerLaw(0.5, 1.0), MittagLeffler(0.5, 1.0), StretchedExponential(0.5, 1.0)]
)
def test_fits_down_to_tiny_times(kernel):
    check(kernel, 1e-8, 10.0, 1e-8)


def test_prony_is_exact():
    kernel = Prony([2.0, 0.0, 2.0], [1.0, 0.5, 2.0])
    fit = hd.fit_exponentials(kernel, 1e-3, 10.0, 1e-4)
    assert fit.rates.tolist() == [0.0, 2.0]
    assert fit.weights.tolist() == [0.5, 3.0]
    assert fit.max_error == 0.0
    t = np.array([1e-300, 0.1, 2.0])
    expected = 0.5 * t + 1.5 * -np.expm1(-2 * t)
    np.testing.assert_allclose(kernel.integral(t), expected, rtol=1e-15)


def test_limits():
    t = np.geomspace(1e-6, 5.0, 50)
    power = hd.PowerLaw(0.4)
    for rate in (1e-4, 1e-8, 0.0):
        tempered = TemperedPowerLaw(0.4, rate)
        np.testing.assert_allclose(tempered(t), power(t), rtol=6 * rate + 1e-15)
        np.testing.assert_allclose(tempered.integral(t), power.integral(t), rtol=6 * rate + 1e-15)
        fit, bare = (kernel.fit(1e-3, 5.0, 1e-8) for kernel in (tempered, power))
        np.testing.assert_allclose(fit(t[t > 1e-3]), bare(t[t > 1e-3]), rtol=6 * rate + 1e-14)
    plain = np.exp(-2.0 * t)
    np.testing.assert_allclose(MittagLeffler(1.0, 2.0)(t), plain, rtol=1e-15)
    np.testing.assert_allclose(MittagLeffler(1 - 1e-9, 2.0)(t), plain, rtol=1e-5)
    np.testing.assert_allclose(StretchedExponential(1.0, 2.0)(t), plain, rtol=1e-15)
    for kernel in (MittagLeffler(1.0, 2.0), StretchedExponential(1.0, 2.0)):
        assert kernel.fit(1e-3, 5.0, 1e-8).rates == pytest.approx([2.0], rel=1e-7)
    single = DistributedOrder([0.4], [math.gamma(0.6)])
    np.testing.assert_allclose(single(t), power(t), rtol=1e-14)
    np.testing.assert_allclose(single.integral(t), power.integral(t), rtol=1e-14)


def test_a_function_is_integrated_through_its_singularity():
    for a in (0.0, 0.5, 0.9):
        kernel = Kernel(lambda t, a=a: t**-a * np.exp(-t))
        assert kernel.singular_exponent == pytest.approx(a, abs=1e-12)
        t = np.array([0.0, 1e-300, 1e-5, 0.7, 0.7, 90.0])
        expected = TemperedPowerLaw(a, 1.0).integral(t) if a else -np.expm1(-t)
        np.testing.assert_allclose(kernel.integral(t), expected, rtol=1e-13)


def test_functions_of_one_time_and_given_exponents():
    kernel = Kernel(lambda t: math.exp(-t) if t >= 0 else 0.0, singular_exponent=0)
    np.testing.assert_allclose(kernel([[0.5, 1.0]]), np.exp([[-0.5, -1.0]]))
    fit = kernel.fit(1e-2, 10.0, 1e-6)
    assert fit(2.0) == pytest.approx(math.exp(-2.0), rel=1e-6)


SEPARATE = {
    "one": ([3.0], [2.0]),
    "near": ([1.0, 1.2], [1.0, 1.0]),
    "with a constant": ([0.0, 2.0], [0.5, 1.0]),
    "heavy and light": ([1.0, 33.0], [1.0, 1e-3]),
    "five": ([0.03, 0.4, 2.0, 11.0, 150.0], [0.1, 0.2, 1.0, 0.5, 3.0]),
    "slow, light next to heavy": ([0.01, 0.03, 0.09, 0.27], [10.0, 10.0, 0.01, 10.0]),
}


@pytest.mark.parametrize("name", SEPARATE)
@pytest.mark.parametrize("tol", [1e-7, 1e-10, 1e-12])
@pytest.mark.parametrize(("t_min", "t_max"), [(1e-4, 1e2), (1e-3, 10.0), (1e-5, 1e3)])
def test_separate_rates_are_fitted_by_few(name, tol, t_min, t_max):
    prony = Prony(*SEPARATE[name])
    fit = check(Kernel(prony), t_min, t_max, tol)
    assert fit.n_modes <= 2 * len(prony.rates) + 1


@settings(max_examples=15)
@given(st.data())
def test_random_separate_rates_are_fitted_by_few(data):
    gaps = data.draw(st.lists(st.floats(3.0, 30.0), max_size=3))
    rates = data.draw(st.floats(0.01, 1.0)) * np.cumprod([1.0, *gaps])
    weights = [10 ** data.draw(st.floats(-2.0, 1.0)) for _ in rates]
    assert check(Kernel(Prony(rates, weights)), 1e-4, 1e2, 1e-10).n_modes <= 2 * rates.size + 1


SIGNED = {
    "difference": (lambda t: np.exp(-t) - 0.9 * np.exp(-3 * t), 2),
    "rising at first": (lambda t: t * np.exp(-t), 3),
    # a triple pole: rounding decides whether about 80 or 140 modes are tried first
    "of three stages": (lambda t: t**2 * np.exp(-3 * t), 150),
    "one oscillation": (lambda t: np.exp(-0.1 * t) * np.cos(3 * t), 2),
    "a fast one": (lambda t: np.exp(-t) * np.cos(200 * t), 2),
    "an undamped one": (lambda t: np.cos(2 * t), 2),
    "two": (lambda t: np.exp(-t / 9) * np.cos(3 * t) + np.exp(-t / 2) * np.sin(7 * t) / 2, 4),
    "Bessel's": (lambda t: scipy.special.j0(t), 20),
    "Gaussian": (lambda t: np.exp(-(t**2)), 15),
    "Gaussian, oscillating": (lambda t: np.exp(-(t**2) / 8) * np.cos(3 * t), 24),
    "singular": (lambda t: t**-0.5 * np.exp(-t / 5) * np.cos(2 * t), 110),
}


@pytest.mark.parametrize("name", SIGNED)
def test_signed_kernels(name):
    function, most = SIGNED[name]
    fit = hd.fit_exponentials(Kernel(function, signed=True), 1e-3, 50.0, 1e-7)
    assert fit.n_modes <= most
    assert np.all(fit.rates.real >= 0)
    t = np.geomspace(1e-3, 50.0, 20_001)
    largest = np.maximum.accumulate(np.abs(function(t))[::-1])[::-1]
    mean = (t[0] + scipy.integrate.cumulative_trapezoid(largest, t, initial=0)) / t
    assert (np.abs(fit(t) - function(t)) / np.maximum(largest, 1e-3 * mean)).max() <= 1.05e-7


def test_noise_is_smoothed():
    t = np.geomspace(1e-3, 1e3, 300)
    truth = MittagLeffler(0.6, 1.0)
    noise = 1 + 0.01 * np.random.default_rng(1).standard_normal(t.size)
    kernel = Kernel.from_table(t, truth(t) * noise)
    assert isinstance(kernel, TabulatedKernel)
    fit = hd.fit_exponentials(kernel, 1e-3, 1e3, 0.011)
    assert np.all(fit.weights > 0)
    assert np.abs(fit(t) / truth(t) - 1).max() < 0.02
    assert fit.n_modes < 20
    assert 0.011 < fit.max_error < 0.05
    with pytest.raises(ValueError, match=r"tol must be at least 0\.00.*rms misfit"):
        kernel.fit(1e-3, 1e3, 1e-4)


def test_tables_interpolate_power_laws_exactly():
    t = np.geomspace(1e-2, 10.0, 20)
    kernel = Kernel.from_table(t, t**-0.5)
    assert kernel.singular_exponent == pytest.approx(0.5)
    times = np.array([1e-300, 1e-2, 0.037, 10.0])
    np.testing.assert_allclose(kernel(times), times**-0.5, rtol=1e-12)
    np.testing.assert_allclose(kernel.integral(times), 2 * times**0.5, rtol=1e-12)


FAMILIES = st.one_of(
    st.builds(TemperedPowerLaw, st.floats(0.01, 0.99), st.floats(0.0, 10.0)),
    st.builds(MittagLeffler, st.floats(0.05, 1.0), st.floats(0.1, 10.0)),
    st.builds(StretchedExponential, st.floats(0.05, 1.0), st.floats(0.1, 10.0)),
    st.builds(GammaDensity, st.floats(0.01, 1.0), st.floats(0.1, 10.0)),
    st.builds(lambda a, w: DistributedOrder([a, 0.0], [w, 1.0]), st.floats(0.01, 0.99), st.just(2)),
)


@given(FAMILIES)
def test_laws_of_every_kernel(kernel):
    assert isinstance(kernel, MemoryKernel)
    t = np.geomspace(1e-6, 30.0, 60)
    values, integrals = kernel(t), kernel.integral(t)
    assert np.all(values > 0)
    assert np.all(np.diff(values) < 0)
    # the mean of a decreasing kernel lies above its last value, and falls
    assert np.all(integrals > t * values * (1 - 1e-14))
    assert np.all(np.diff(integrals) >= -1e-14 * integrals[1:])
    assert np.all(np.diff(integrals / t) <= 1e-14 * (integrals / t)[1:])
    # K t**a tends to a constant
    a = kernel.singular_exponent
    early = kernel([1e-280, 1e-281]) * np.array([1e-280, 1e-281]) ** a
    assert early[0] == pytest.approx(early[1], rel=1e-2)


@given(
    st.sampled_from([MittagLeffler, StretchedExponential]), st.floats(0.3, 1.0), st.floats(-3, 3)
)
@settings(max_examples=10)
def test_time_scales_scale(family, exponent, log_c):
    c = 10**log_c
    one, other = family(exponent, 1.0), family(exponent, 1 / c)
    t = np.geomspace(1e-3, 10.0, 40)
    np.testing.assert_allclose(other(c * t), one(t), rtol=1e-13)
    np.testing.assert_allclose(other.integral(c * t), c * one.integral(t), rtol=1e-13)
    fit = other.fit(c * 1e-3, c * 10.0, 1e-5)
    least = 1e-3 * one.integral(t) / t  # a thousandth of the mean counts where K is smaller
    assert np.all(np.abs(fit(c * t) - one(t)) <= 1.01e-5 * np.maximum(one(t), least))


def test_a_first_step_that_values_do_not_reach_is_refused_in_the_users_words():
    """A leading kernel given as a function: steps begin at about (rtol / 1000)**(1 / alpha)."""

    def end(order, rtol):
        def kernel(u):
            own = order - 0.1 * np.exp(-u)
            return u**-own / scipy.special.gamma(1 - own)

        equation = hd.Equation(hd.Memory(hd.Kernel(kernel), 1), lambda t, y: -y, 1.0)
        return hd.solve(equation, 2.0, rtol=rtol).y[-1, 0]

    for rtol in (1e-5, 1e-8):
        assert abs(end(0.6, rtol) - end(0.6, 1e-10)) < rtol
    with pytest.raises(ValueError, match=r"rtol must let steps begin .* take a larger rtol, or L1"):
        end(0.3, 1e-8)
