"""The explicit Grünwald-Letnikov scheme against its printed sums, and where it is exact."""

import numpy as np
import pytest
from scipy.special import binom
from solver.runs import at_end, errors_of

import hereditary as hd

SCHEME = hd.GrunwaldLetnikov()
HISTORIES = [hd.Direct(), hd.FFT(), hd.SumOfExponentials(1e-13)]


def printed_scheme(terms, force, x0, v0, h, n_steps):
    """Binomial sums over x itself, solved for x_(n+1); terms (c, alpha)."""
    k = np.arange(n_steps + 1)
    x = np.empty(n_steps + 1)
    x[0] = x0
    for n in range(n_steps):
        total, known = 0.0, 0.0
        for c, alpha in terms:
            g = (-1.0) ** k[: n + 2] * binom(alpha, k[: n + 2])
            taken = x0 + (v0 * h * k[: n + 2] if alpha > 1 else 0.0 * k[: n + 2])
            total += c * h**-alpha
            # the newest value counts as 0 here, and what is taken off it as the rest
            known += c * h**-alpha * (g[1:] @ (x[n::-1] - taken[n::-1]) - taken[n + 1])
        x[n + 1] = (force(n * h, x[n]) - known) / total
    return x


@pytest.mark.parametrize("history", HISTORIES, ids=repr)
@pytest.mark.parametrize(
    "terms",
    [
        ((1.0, 0.3),),
        ((1.0, 1.0),),
        ((2.0, 0.9), (0.5, 0.3)),
        ((1.0, 1.6),),
        ((1.0, 1.8), (0.5, 0.8), (0.1, 1.2)),
        ((1.0, 2.0),),
        ((1.0, 2.0), (0.25, 1.0)),
        ((1.0, 2.0), (0.25, 0.4)),
    ],
)
def test_is_the_printed_scheme(terms, history):
    h, n = 0.02, 300
    y0 = 0.2 if max(alpha for _, alpha in terms) <= 1 else [0.2, 0.7]
    equation = hd.Equation(
        [c * hd.Caputo(alpha) for c, alpha in terms], lambda t, x: np.cos(t) - np.sin(2 * x), y0
    )
    expected = printed_scheme(terms, lambda t, x: np.cos(t) - np.sin(2 * x), 0.2, 0.7, h, n)
    sol = hd.solve(equation, n * h, n, scheme=SCHEME, history=history, estimate=False)
    np.testing.assert_allclose(sol.y[:, 0], expected, rtol=0, atol=2e-10)


def test_order_two_is_of_second_order_where_it_starts_at_rest():
    """And of first where the first step takes all of f."""
    for force, exact, order in ((lambda t, x: 6 * t, 1.0, 2), (lambda t, x: 6 * t + 2, 2.0, 1)):
        equation = hd.Equation(hd.Caputo(2.0), force, [0.0, 0.0])
        errors = errors_of(at_end, exact, (400, 800), equation, 1.0, scheme=SCHEME)
        assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.01)


@pytest.mark.parametrize("alpha", [1 - 1e-9, 1 + 1e-9, 2 - 1e-9])
def test_orders_next_to_the_integers(alpha):
    y0 = 1.0 if alpha < 1 else [1.0, 0.0]
    near, there = (
        hd.solve(hd.Equation(hd.Caputo(a), lambda t, x: -x, y0), 5.0, 500, scheme=SCHEME).y
        for a, y0 in ((alpha, y0), (float(round(alpha)), y0 if alpha > 1.5 else 1.0))
    )
    assert np.abs(near - there).max() < 1e-7


def logistic_map(order, factor, n_steps):
    """Sums of Wu and Baleanu from 0.3 on, weights by their recurrence."""
    u = np.full(n_steps + 1, 0.3)
    weights = np.cumprod([1.0, *(1 + (order - 1) / np.arange(1, n_steps))])
    for n in range(1, n_steps + 1):
        u[n] += weights[:n] @ (factor * u[:n] * (1 - u[:n]))[::-1]
    return u


@pytest.mark.parametrize(("order", "factor"), [(0.8, 1.5), (0.8, 2.2), (0.5, 2.0), (1.0, 2.2)])
@pytest.mark.parametrize("history", [hd.Direct(), hd.FFT(), hd.SumOfExponentials()], ids=repr)
def test_a_map_with_memory_may_alternate_and_is_exact(order, factor, history):
    """At 2.0 and 2.2 values alternate for good; 500 steps, of which a scheme's are estimated."""
    eq = hd.Equation(hd.Caputo(order), lambda n, u, p: p[0] * u * (1 - u), 0.3, params=[factor])
    sol = hd.solve(eq, 500, 500, scheme=hd.GrunwaldLetnikov(map=True), history=history)
    exact = logistic_map(order, factor, 500)
    assert sol.success
    assert "error_estimate" not in sol.stats
    assert abs(sol.y[:, 0] - exact).max() < 1e-8
    alternates = np.ptp(exact[-20:]) > 0.1
    assert alternates == (factor > 1.5)
    if alternates:
        with pytest.warns(hd.StabilityWarning, match="zigzag"):
            scheme = hd.solve(eq, 500, 500, scheme=SCHEME, history=history)
        assert np.array_equal(scheme.y, sol.y)
