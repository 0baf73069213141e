"""Recipes of docs/recipes.md, each against another way of computing it."""

import numpy as np
import pytest
from problems import assert_converges
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

    def end(n):
        sol = hd.solve(eq, 2.0, n, scheme=scheme)
        assert abs(sol(2.0, 1)[0] - (1 + np.exp(-4)) / 2) < 1e-3
        return sol.y[-1]

    assert_converges(end, 1 + (1 - np.exp(-4)) / 4, (500, 1000), 1, 1e-3)


def test_a_given_past_is_a_force():
    alpha, factor = 0.6, 1 / gamma(1.4)

    def with_past(t, y):
        return -y - factor * ((t + 1) ** 0.4 - t**0.4)

    y = hd.solve(hd.Equation(hd.Caputo(alpha), with_past, 1.0), 2.0, rtol=1e-9).y[-1, 0]
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
