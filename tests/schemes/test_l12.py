"""The L1-2 scheme: what the line of its first step costs, and bounded at every step."""

import numpy as np
import pytest
from scipy.special import gamma
from solver.runs import at_end, errors_of

import hereditary as hd

SCHEME = hd.L12()


def square(t, y, p):
    return p[1] * t ** (2 - p[0]) + t**2 - y


@pytest.mark.parametrize("alpha", [0.1, 0.3, 0.5, 0.8, 0.95, 1.0])
@pytest.mark.parametrize("scheme", [SCHEME, hd.L2()], ids=repr)
def test_the_line_of_the_first_step_costs_no_order_at_a_fixed_time(scheme, alpha):
    """y = t**2 with y''(0) = 2: order 2 over all times, 3 - alpha at the end."""
    equation = hd.Equation(hd.Caputo(alpha), square, 0.0, (alpha, 2 / gamma(3 - alpha)))
    found = []
    for n in (400, 800, 1600):
        sol = hd.solve(equation, 1.0, n, scheme=scheme, history=hd.Direct())
        off = np.abs(sol.y[:, 0] - sol.t**2)
        found.append((off[-1], off.max()))
    orders = np.log2(np.array(found[:-1]) / found[1:])
    assert orders[:, 0] == pytest.approx(scheme.order(alpha), abs=0.05)
    assert orders[:, 1] == pytest.approx(2.0, abs=0.05)


def test_order_one_is_the_second_backward_difference():
    """Begun with Euler's backward method; so solutions like t**1 are smooth, and of order 2."""
    n, h = 50, 0.1
    equation = hd.Equation(hd.Caputo(1.0), lambda t, y: np.cos(t) - y, 2.0)
    y = hd.solve(equation, n * h, n, scheme=SCHEME).y[:, 0]
    f = np.cos(h * np.arange(n + 1)) - y
    assert y[1] - y[0] == pytest.approx(h * f[1], abs=1e-14)
    np.testing.assert_allclose(1.5 * y[2:] - 2 * y[1:-1] + 0.5 * y[:-2], h * f[2:], atol=1e-14)
    assert SCHEME.order(1.0, "singular") == 2.0
    decay, how = hd.scenes.relaxation(1.0), {"scheme": SCHEME}
    errors = errors_of(at_end, np.exp(-1), (800, 1600), decay, 1.0, **how)
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.01)


@pytest.mark.parametrize("alpha", [0.1, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("stiffness", [0.1, 1.0, 10.0, 1e3, 1e6])
def test_bounded_at_every_step(alpha, stiffness):
    decay = hd.scenes.relaxation(alpha, stiffness, 1.0)  # h = 1
    assert np.abs(hd.solve(decay, 400.0, 400, scheme=SCHEME).y).max() <= 1.0
    turn = hd.Equation(
        hd.Caputo(alpha), lambda t, y, p: p[0] * np.array([y[1], -y[0]]), [1.0, 0.0], (stiffness,)
    )
    assert np.hypot(*hd.solve(turn, 400.0, 400, scheme=SCHEME).y.T).max() <= 1.0 + 1e-12
