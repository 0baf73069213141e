"""The explicit scheme: exact where it promises, first order and no better elsewhere."""

import numpy as np
import pytest
from problems import PROBLEMS, observed_order
from scipy.special import rgamma
from solver.runs import at_end, errors_of

import hereditary as hd

pytestmark = pytest.mark.core

SCHEME = hd.ExplicitCaputo()


def printed_scheme(beta, gamma, friction, force, x0, v0, h, n_steps):
    """The scheme as it is printed: sums of differences of x, solved for x_(n+1)."""
    k = np.arange(n_steps)
    a = (k + 1.0) ** (2 - beta) - np.where(k > 0, k, np.nan) ** (2 - beta)
    b = (k + 1.0) ** (1 - gamma) - np.where(k > 0, k, np.nan) ** (1 - gamma)
    a[0] = b[0] = 1.0
    big_a = h**-beta * rgamma(3 - beta)
    big_b = friction * h**-gamma * rgamma(2 - gamma)
    x = np.empty(n_steps + 1)
    x[0], x[1] = x0, x0 + h * v0
    for j in range(1, n_steps):
        second = x[j:1:-1] - 2 * x[j - 1 : 0 : -1] + (x[j - 2 :: -1] if j > 1 else x[:0])
        first = x[j:1:-1] - x[j - 1 : 0 : -1]
        past = big_a * (a[1:j] @ second) + big_b * (b[1:j] @ first)
        known = big_a * (x[j - 1] - 2 * x[j]) - big_b * x[j]
        x[j + 1] = (force(j * h, x[j]) - past - known) / (big_a + big_b)
    return x


@pytest.mark.parametrize(
    ("beta", "gamma"),
    [(1.8, 0.8), (1.2, 0.3), (1.05, 0.95), (1.999, 0.999), (2.0, 1.0), (2.0, 0.4)],
)
def test_is_the_printed_scheme(beta, gamma):
    n, t_end = 300, 3.0
    equation = hd.scenes.stick_slip(beta=beta, gamma=gamma)
    well = hd.scenes.PRINTED_WELL

    def force(t, x):
        return t + 50.0 * sum(a * np.sin((k + 1) * x) for k, a in enumerate(well)) - x

    expected = printed_scheme(beta, gamma, 0.25, force, 0.2, 0.3, t_end / n, n)
    sol = hd.solve(equation, t_end, n, history=hd.Direct())
    np.testing.assert_allclose(sol.y[:, 0], expected, rtol=0, atol=2e-9)


# The error at t_end with 1600 steps, as measured; a third more is allowed. The orders are read off
# 400, 800 and 1600 steps.
ERRORS = {
    "oscillator 1.5 0.5": 9.4e-6,
    "smooth 1.2 0.3": 8.9e-4,
    "smooth 1.5 0.5": 9.2e-4,
    "smooth 1.8 0.8": 8.1e-4,
    "smooth 1.95 0.05": 3.5e-4,
    "smooth 2.0 1.0": 1.4e-4,
    "smooth 1.0": 7.0e-4,
    "incommensurate 1.3 0.6": 7.4e-4,
    "classical oscillator": 9.1e-4,
}


@pytest.mark.parametrize("problem", [p for p in PROBLEMS if p.name in ERRORS], ids=lambda p: p.name)
def test_order_and_error(problem):
    steps, equation = [400, 800, 1600], problem.equation()
    end = problem.exact(np.array([problem.t_end]))[0]
    errors = errors_of(at_end, end, steps, equation, problem.t_end)
    order = observed_order(steps, errors)
    smoothness = "singular" if problem.name == "oscillator 1.5 0.5" else "smooth"
    expected = SCHEME.order(float(equation.system.highest_orders().max()), smoothness)
    assert order == pytest.approx(expected, abs=0.15), errors
    assert np.all(np.diff(errors) < 0)
    assert errors[-1] < 4 / 3 * ERRORS[problem.name]
