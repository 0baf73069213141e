"""Renewal equations, as epidemiologists write them: generation times of every usual kind.

Incidence i of an epidemic with the reproduction number R and the density K of generation times is
``i(t) = R int_0^t K(t-s) i(s) ds + exp(-t)``. Its Laplace transform is ``1 / (1 + s)`` divided by
``1 - R L(s)``, where L is the transform of K. So i grows like ``C exp(r t)`` with ``R L(r) = 1``.
"""

from contextlib import nullcontext

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import gamma, lognorm, weibull_min

import hereditary as hd

REPRODUCTION, END = 1.8, 80.0
DAYS = np.arange(21.0)
SHARES = np.round(lognorm.pdf(DAYS, 0.37, scale=4.7), 4)
# Generation times in days; a shift is a delay beside the density.
DENSITIES = {
    "lognormal": (hd.LognormalDensity.from_mean(5.0, 1.9), 0.0),
    "narrow lognormal": (hd.LognormalDensity.from_mean(5.0, 1.0), 0.0),
    "lognormal function": (hd.Kernel(lambda t: lognorm.pdf(t, 0.6, scale=4.7), signed=True), 0.0),
    "Weibull": (hd.WeibullDensity.from_mean(5.0, 1.9), 0.0),
    "Weibull, of shape next to 1": (hd.WeibullDensity(1.05, 5.0), 0.0),
    "Weibull, singular": (hd.WeibullDensity(0.7, 5.0), 0.0),
    "gamma": (hd.GammaDensity(1.138, 0.711), 0.0),
    "gamma, narrow": (hd.GammaDensity.from_mean(5.0, 1.9), 0.0),
    "gamma, of shape 9 but for rounding": (hd.GammaDensity.from_mean(5.7, 1.9), 0.0),
    "gamma, of shape next to 3": (hd.GammaDensity.from_mean(2.6, 1.5), 0.0),
    "shifted gamma": (hd.GammaDensity(1.138, 0.711), 1.0),
    "shifted function": (hd.Kernel(lambda t: gamma.pdf(t - 1, 7, scale=0.6), signed=True), 0.0),
    "daily table": (hd.Kernel.from_table(DAYS, SHARES, signed=True), 0.0),
}
# Errors are relative to i. A kernel's error relative to its largest values enters more than once.
RTOL, OF_KERNEL = 1e-5, 5.0
FIRST, SECOND = np.array([1.0, 0.0]), np.array([0.0, 1.0])


def transform(kernel, shift, r):
    """``L(r)`` and ``-L'(r)``, by integrals of the distribution function up to day 400."""
    nodes, weights = np.polynomial.legendre.leggauss(10)
    edges = 400.0 * np.linspace(0.0, 1.0, 400) ** 4
    t = (edges[:-1, None] + np.diff(edges)[:, None] * (1 + nodes) / 2).ravel()
    w = (np.diff(edges)[:, None] * weights / 2).ravel() * np.exp(-r * t)
    known, last = kernel.integral(t), float(kernel.integral(400.0)) * np.exp(-r * 400.0)
    value, slope = r * (w @ known) + last, (w * (r * t - 1)) @ known + 400.0 * last
    return np.exp(-r * shift) * value, np.exp(-r * shift) * (slope + shift * value)


def growth(t, y, memory, p):
    return np.array([p[0] * memory[0, 0] + np.exp(-t) - y[0]])


def growth_after_a_shift(t, y, memory, p):
    return np.array([p[0] * memory[1, 1] + np.exp(-t) - y[0], memory[0, 0] - y[1]])


@pytest.mark.parametrize("breaks", [None, [5.0, 30.0]])
@pytest.mark.parametrize("name", DENSITIES)
def test_an_epidemic_grows_as_lotka_and_euler_say(name, breaks):
    kernel, shift = DENSITIES[name]
    rtol = RTOL if name != "daily table" else 1e-4
    if shift:  # the convolution is a component, which is read after the delay
        memory = [FIRST * hd.Memory(kernel, 0), hd.Delay(shift, past=0.0)]
        how = growth_after_a_shift, [1.0, 0.0]
    else:
        memory, how = [hd.Memory(kernel, 0)], (growth, 1.0)
    eq = hd.Equation(0 * hd.Caputo(1), *how, params=[REPRODUCTION], memory=memory)
    sol = hd.solve(eq, END, rtol=rtol, breaks=breaks)
    r = brentq(lambda r: REPRODUCTION * transform(kernel, shift, r)[0] - 1, 0.01, 2.0, xtol=1e-14)
    expected = np.exp(r * END) / ((1 + r) * REPRODUCTION * transform(kernel, shift, r)[1])
    assert sol.success
    allowed = rtol + OF_KERNEL * sol.stats["kernel_error"]
    assert sol.y[-1, 0] == pytest.approx(expected, rel=allowed)


def by_sums(kernel, n):
    """Incidence on day 80 without its source, by the trapezoid rule in n steps.

    A lognormal density and this part vanish at 0 with all derivatives, so that the error is below
    any power of the step.
    """
    h, t = END / n, np.linspace(0.0, END, n + 1)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    between = t[:-1, None] + h * (1 + nodes) / 2
    added = h / 2 * (kernel(between) * np.exp(between - t[1:, None])) @ weights
    k, part, source = h * kernel(t), np.zeros(n + 1), 0.0
    for j in range(1, n + 1):
        source = np.exp(-h) * source + added[j - 1]
        part[j] = REPRODUCTION * (source + k[j - 1 : 0 : -1] @ part[1:j])
    return part[-1]


@pytest.mark.parametrize(
    ("sd", "rtol", "success"), [(0.5, 1e-8, False), (0.5, 1e-6, True), (1.9, 1e-8, True)]
)
def test_a_run_whose_kernel_is_less_accurate_than_a_tenth_of_rtol_is_no_success(sd, rtol, success):
    """Over ten generations the solution errs by up to ten errors of its kernel."""
    kernel = hd.LognormalDensity.from_mean(5.0, sd)
    eq = hd.Equation(
        0 * hd.Caputo(1), growth, 1.0, params=[REPRODUCTION], memory=[hd.Memory(kernel, 0)]
    )
    with nullcontext() if success else pytest.warns(hd.SolveWarning, match="allowed"):
        sol = hd.solve(eq, END, rtol=rtol)
    assert sol.success is success
    assert success == (sol.stats["kernel_error"] < 0.1 * rtol)
    error = abs(sol.y[-1, 0] / (by_sums(kernel, 4000) + np.exp(-END)) - 1)
    assert error < max(rtol, 10 * sol.stats["kernel_error"])


def test_a_daily_table_that_its_sum_misses_warns():
    """Its values between the days are unknown, so the run goes on to the end."""
    memory = [hd.Memory(DENSITIES["daily table"][0], 0)]
    eq = hd.Equation(0 * hd.Caputo(1), growth, 1.0, params=[REPRODUCTION], memory=memory)
    with pytest.warns(hd.KernelWarning, match="a kernel differs by up to") as caught:
        sol = hd.solve(eq, END, rtol=1e-7)
    assert len(caught) == 1
    assert sol.success
    assert 1e-7 < sol.stats["kernel_error"] < 1e-5


def reproduction(t):
    return 1.8 if t < 40.0 else 0.9


def by_trapezoids(kernel, n):
    """S, infections and deaths on day 80 by n steps; a vaccination on day 30, a lockdown on day 40.

    The infections jump on both days. The convolution sees the mean of both sides there.
    """
    h, t = END / n, np.linspace(0.0, END, n + 1)
    k, seen, share, deaths = kernel(t), np.zeros(n + 1), 1.0, 0.0
    before = seen[0] = 1e-4
    of_before = 0.0
    for j in range(1, n + 1):
        known = h * (k[j:0:-1] @ seen[:j] - 0.5 * k[j] * seen[0])
        force = reproduction(t[j] - h / 2) * known + 1e-4 * np.exp(-t[j])
        share = (share - h / 2 * before) / (1 + h / 2 * force)
        left = share * force
        if t[j] == 30.0:
            share *= 0.7
        before = share * (reproduction(t[j]) * known + 1e-4 * np.exp(-t[j]))
        seen[j] = (left + before) / 2
        deaths, of_before = deaths + h / 2 * (of_before + known), known
    return np.array([share, before, deaths])


def epidemic(t, y, memory):
    r = 1.8 if t < 40.0 else 0.9
    force = r * memory[0, 1] + 1e-4 * np.exp(-t)
    return np.array([-y[1], y[0] * force - y[1], memory[0, 1]])


def vaccination(t, y):
    return np.array([0.7 * y[0], y[1], y[2]])


@pytest.mark.parametrize("name", ["lognormal", "Weibull", "narrow lognormal"])
def test_an_epidemic_with_a_vaccination_and_a_lockdown(name):
    """Deaths begin at 0 and follow the infections by the same density."""
    kernel = DENSITIES[name][0]
    memory = np.array([0.0, 1.0, 0.0]) * hd.Memory(kernel, 0)
    derived = np.array([1.0, 0.0, 1.0]) * hd.Caputo(1)
    eq = hd.Equation(derived, epidemic, [1.0, 1e-4, 0.0], memory=memory)
    sol = hd.solve(eq, END, rtol=RTOL, changes={30.0: vaccination}, breaks=[40.0])
    coarse, fine, finer = (by_trapezoids(kernel, n) for n in (1600, 3200, 6400))
    first, second = fine + (fine - coarse) / 3, finer + (finer - fine) / 3
    expected = second + (second - first) / 15
    assert sol.success
    # the reference errs by a hundredth of the difference of its last two steps at most
    allowed = RTOL + OF_KERNEL * sol.stats["kernel_error"] + 1e-2 * abs(second - first) / expected
    assert np.all(abs(sol.y[-1] / expected - 1) < allowed)


def test_the_densities_are_those_of_scipy():
    t = np.geomspace(1e-3, 50.0, 60)
    pairs = [
        (hd.LognormalDensity(1.5, 0.4), lognorm(0.4, scale=np.exp(1.5))),
        (hd.WeibullDensity(0.7, 5.0), weibull_min(0.7, scale=5.0)),
        (hd.WeibullDensity(2.8, 5.0), weibull_min(2.8, scale=5.0)),
    ]
    for density, expected in pairs:
        np.testing.assert_allclose(density(t), expected.pdf(t), rtol=1e-12)
        np.testing.assert_allclose(density.integral(t), expected.cdf(t), rtol=1e-12)
        assert density.integral(0.0) == 0.0


@pytest.mark.parametrize("kind", [hd.GammaDensity, hd.LognormalDensity, hd.WeibullDensity])
@pytest.mark.parametrize("sd", [1.9, 5.0, 8.0])
def test_a_density_of_a_mean_and_a_standard_deviation(kind, sd):
    """The moments are sums over the values, by the trapezoid rule in log(t)."""
    logs, h = np.linspace(-60.0, 20.0, 80_001, retstep=True)
    t = np.exp(logs)
    with np.errstate(under="ignore"):
        mass = h * t * kind.from_mean(5.0, sd)(t)
    mean = mass @ t
    assert mean == pytest.approx(5.0, rel=1e-9)
    assert np.sqrt(mass @ (t - mean) ** 2) == pytest.approx(sd, rel=1e-9)


def test_a_table_that_rises():
    """A lognormal density is a parabola of logarithms: it is met between the days too."""
    kernel = DENSITIES["daily table"][0]
    known = SHARES > 0
    np.testing.assert_allclose(kernel(DAYS[known]), SHARES[known], rtol=1e-14)
    between = np.arange(1.5, 15.0)
    # a hundredth of the largest value: the shares have four decimals
    expected = lognorm.pdf(between, 0.37, scale=4.7)
    np.testing.assert_allclose(kernel(between), expected, rtol=0, atol=0.0025)
    assert kernel(400.0) < 1e-9 * SHARES.max()
