"""Renewal equations, as epidemiologists write them: generation times of every usual kind.

Incidence i of an epidemic with the reproduction number R and the density K of generation times is
``i(t) = R int_0^t K(t-s) i(s) ds + exp(-t)``. Its Laplace transform is ``1 / (1 + s)`` divided by
``1 - R L(s)``, where L is the transform of K. So i grows like ``C exp(r t)`` with ``R L(r) = 1``.
"""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import gamma, lognorm

import hereditary as hd

REPRODUCTION, END = 1.8, 80.0
DAYS = np.arange(21.0)
SHARES = np.append(lognorm.pdf(DAYS[:-1], 0.37, scale=4.7), 0.0)
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
    "shifted gamma": (hd.GammaDensity(1.138, 0.711), 1.0),
    "shifted function": (hd.Kernel(lambda t: gamma.pdf(t - 1, 7, scale=0.6), signed=True), 0.0),
    "daily table": (hd.Kernel.from_table(DAYS, SHARES, signed=True), 0.0),
}
# Errors are relative to i. A kernel's error relative to its largest values enters more than once.
RTOL, OF_KERNEL = 1e-5, 5.0


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
    first, second = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    if shift:  # the convolution is a component, which is read after the delay
        memory = [first * hd.Memory(kernel, 0), hd.Delay(shift, past=0.0)]
        how = growth_after_a_shift, [1.0, 0.0]
    else:
        memory, how = [hd.Memory(kernel, 0)], (growth, 1.0)
    eq = hd.Equation(0 * hd.Caputo(1), *how, params=[REPRODUCTION], memory=memory)
    sol = hd.solve(eq, END, rtol=RTOL, breaks=breaks)
    r = brentq(lambda r: REPRODUCTION * transform(kernel, shift, r)[0] - 1, 0.01, 2.0, xtol=1e-14)
    expected = np.exp(r * END) / ((1 + r) * REPRODUCTION * transform(kernel, shift, r)[1])
    assert sol.success
    allowed = RTOL + OF_KERNEL * sol.stats["kernel_error"]
    assert sol.y[-1, 0] == pytest.approx(expected, rel=allowed)
