"""The explicit scheme: exact where it promises, first order and no better elsewhere."""

import numpy as np
import pytest
from hypothesis import example, given
from problems import PROBLEMS, observed_order
from scipy.special import rgamma
from strategies import orders

import hereditary as hd

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


@pytest.mark.parametrize("well", [None, (0.0,)])
def test_classical_limit_is_the_classical_difference_scheme(well):
    """(x_(n+1) - 2 x_n + x_(n-1))/h**2 + lambda (x_(n+1) - x_n)/h, to rounding."""
    h, n = 0.01, 400
    sol = hd.solve(hd.scenes.stick_slip(beta=2.0, gamma=1.0, well=well), n * h, n)
    x = sol.y[:, 0]
    coefficients = hd.scenes.PRINTED_WELL if well is None else well
    force = sum(50.0 * a * np.sin((k + 1) * x) for k, a in enumerate(coefficients))
    force += sol.t - x
    left = (x[2:] - 2 * x[1:-1] + x[:-2]) / h**2 + 0.25 * (x[2:] - x[1:-1]) / h
    assert np.abs(left - force[1:-1]).max() < 1e-15 / h**2 * 20
    assert sol.stats["n_modes"] == sol.stats["history_bytes"] == 0


def straight(t, x, p):
    """What makes 1 + 2 t the solution: D^gamma of it, halved."""
    return 0.5 * p[0] * t ** (1 - p[2])


def parabolic(t, x, p):
    """The same for 1 + 2 t + t**2."""
    slope = 0.5 * (p[0] * t ** (1 - p[2]) + p[1] * t ** (2 - p[2]))
    return slope + p[3] * t ** (2 - p[4])


@given(orders(1.02, 1.98), orders(0.02, 0.98))
@example(2.0, 1.0)
@example(1.8, 1.0)
@example(2.0, 0.3)
def test_exact_on_straight_lines_and_not_on_parabolas(beta, gamma):
    params = (2 * rgamma(2 - gamma), 2 * rgamma(3 - gamma), gamma, 2 * rgamma(3 - beta), beta)
    terms = [hd.Caputo(beta), 0.5 * hd.Caputo(gamma)]
    for rhs, square, exact in ((straight, 0.0, True), (parabolic, 1.0, False)):
        equation = hd.Equation(terms, rhs, [1.0, 2.0], params)
        for history in (hd.Direct(), hd.SumOfExponentials(1e-13)):
            sol = hd.solve(equation, 1.0, 64, history=history)
            error = np.abs(sol.y[:, 0] - (1 + 2 * sol.t + square * sol.t**2)).max()
            assert (error < 1e-11) == exact, (error, history)


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
    steps = [400, 800, 1600]
    equation = problem.equation()
    errors = []
    for n in steps:
        y = hd.solve(equation, problem.t_end, n, save_every=n).y[-1]
        errors.append(np.abs(y - problem.exact(np.array([problem.t_end]))[0]).max())
    order = observed_order(steps, errors)
    smoothness = "singular" if problem.name == "oscillator 1.5 0.5" else "smooth"
    expected = SCHEME.order(float(equation.highest_orders().max()), smoothness)
    assert order == pytest.approx(expected, abs=0.15), errors
    assert np.all(np.diff(errors) < 0)
    assert errors[-1] < 4 / 3 * ERRORS[problem.name]
