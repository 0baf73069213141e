"""Recipes of docs/recipes.md, each against another way of computing it."""

import mpmath
import numpy as np
import pytest
from scipy.special import gamma

import hereditary as hd


def product_trapezoid(alpha, g, force, t_end, n):
    """Volterra's equation with a power-law kernel, by product trapezoids for a force -y."""
    h = t_end / n
    t = h * np.arange(n + 1)
    scale = h**alpha / gamma(alpha + 2)
    y = np.zeros(n + 1)
    y[0] = g(0.0)
    for i in range(1, n + 1):
        k = np.arange(1, i)
        first = (i - 1) ** (alpha + 1) - (i - 1 - alpha) * i**alpha
        inner = (i - k + 1.0) ** (alpha + 1) - 2 * (i - k) ** (alpha + 1)
        inner += (i - k - 1.0) ** (alpha + 1)
        past = first * force * y[0] + np.sum(inner * force * y[1:i])
        y[i] = (g(t[i]) + scale * past) / (1 - scale * force)
    return y


def test_a_power_law_volterra_equation():
    eq = hd.Equation(hd.Caputo(0.5), lambda t, w: -(np.cos(t) + w), 0.0)
    y = np.cos(2.0) + hd.solve(eq, 2.0, rtol=1e-9).y[-1, 0]
    sums = [product_trapezoid(0.5, np.cos, -1.0, 2.0, n)[-1] for n in (1000, 2000)]
    assert abs(sums[1] - y) < 1e-4
    assert abs(2 * sums[1] - sums[0] - y) < 1e-4
    assert abs(y + 0.375526) < 1e-6


@pytest.mark.parametrize("scheme", [hd.ExplicitCaputo(), hd.L1()], ids=repr)
def test_any_kernel_of_a_volterra_equation(scheme):
    """K = exp(-t) and y = 1 - K * y: y = (1 + exp(-2 t)) / 2."""
    memory = hd.Memory(hd.Prony([1.0], [1.0]), 1)
    eq = hd.Equation(hd.Caputo(1), lambda t, z, memory: 1 - memory[0], 0.0, memory=memory)
    errors = []
    for n in (500, 1000):
        sol = hd.solve(eq, 2.0, n, scheme=scheme)
        errors.append(abs(sol.y[-1, 0] - (1 + (1 - np.exp(-4)) / 4)))
        assert abs(sol(2.0, 1)[0] - (1 + np.exp(-4)) / 2) < 1e-3
    assert errors[1] < 1e-3
    assert abs(np.log2(errors[0] / errors[1]) - 1) < 0.15


def test_a_tempered_kernel_of_a_volterra_equation_by_laplace():
    """y = 1/s - K y with K = Gamma(1/2) (s + 1)**(-1/2)."""
    kernel = hd.TemperedPowerLaw(0.5, 1.0)
    eq = hd.Equation(
        hd.Caputo(1), lambda t, z, memory: 1 - memory[0], 0.0, memory=hd.Memory(kernel, 1)
    )
    with mpmath.workdps(30):
        exact = mpmath.invertlaplace(
            lambda s: 1 / s / (1 + mpmath.gamma(0.5) / mpmath.sqrt(s + 1)), 2.0, method="talbot"
        )
    errors = []
    for n in (2000, 4000):
        sol = hd.solve(eq, 2.0, n, scheme=hd.L1())
        errors.append(abs(sol(2.0, 1)[0] - float(exact)))
    assert errors[1] < 1e-3
    assert errors[1] < errors[0] / 1.6


def test_a_given_past_is_a_force():
    alpha = 0.6

    def with_past(t, y):
        return -y - ((t + 1) ** (1 - alpha) - t ** (1 - alpha)) / gamma(2 - alpha)

    factor = 1 / gamma(2 - alpha)

    def compiled(t, y):
        return -y - factor * ((t + 1) ** 0.4 - t**0.4)

    y = hd.solve(hd.Equation(hd.Caputo(alpha), compiled, 1.0), 2.0, rtol=1e-9).y[-1, 0]
    assert abs(y - 0.079754) < 1e-6
    sums = []
    for n in (1000, 2000):  # L1 over [-1, 2], the past given
        h = 1.0 / n
        b = np.diff(np.arange(3 * n + 1.0) ** (1 - alpha))
        scale = h**-alpha / gamma(2 - alpha)
        increments = np.full(3 * n, h)
        x = 1.0
        for i in range(n, 3 * n):
            past = scale * np.sum(b[1 : i + 1] * increments[i - 1 :: -1])
            increments[i] = -(x + past) / (scale + 1)
            x += increments[i]
        sums.append(x)
    assert abs(sums[1] - y) < 2e-3
    assert abs(2 * sums[1] - sums[0] - y) < 2e-4
    assert with_past(1.0, 0.0) == pytest.approx(compiled(1.0, 0.0))
