"""What steps chosen by a tolerance may overlook: jumps in y, forces that come late, first steps."""

from itertools import product

import numpy as np
import pytest
from random_problems import error, proportional

import hereditary as hd
from hereditary import exact

# Jumps of the right-hand side in y


def switched_at(t, x, p):
    """-1, and the other sign from each of the times p on."""
    force = -1.0
    for time in p:
        if t > time:
            force = -force
    return force


TERMS = [hd.Caputo(2.0), 0.3 * hd.Caputo(0.8)]


@pytest.fixture(scope="module")
def relayed():
    """The relay's orbit to t = 8: its force as a function of time, switched where x crosses 0."""
    times = []
    while True:
        known = [*times, 100.0]  # one more than there are: params keep their shape
        force = hd.Equation(TERMS, switched_at, [1.0, 0.0], params=known)
        sol = hd.solve(force, 8.0, rtol=1e-11, breaks=times, events=_after(times))
        if sol.status is not hd.Status.EVENT:
            return sol, times
        times.append(float(sol.t[-1]))


def _after(times):
    def crosses(t, x):
        return x[0] if not times or t > times[-1] + 1e-3 else (-1.0) ** len(times)

    crosses.terminal = True
    return crosses


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-7, 1e-9])
def test_a_relay_keeps_its_tolerance(relayed, rtol):
    truth, times = relayed
    assert len(times) >= 3
    sol = hd.solve(hd.Equation(TERMS, lambda t, x: -np.sign(x), [1.0, 0.0]), 8.0, rtol=rtol)
    assert sol.success, sol.message
    t = np.linspace(0.0, 8.0, 500)
    off = np.abs(sol(t) - truth(t)).max()
    # each crossing errs in when it happens, which the later ones carry on
    assert off <= 5 * rtol * 1.01
    assert sol.stats["n_rejected"] > 3 * len(times)  # it saw them


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
def test_sliding_and_chattering_end_with_the_reason(rtol):
    sliding = hd.Equation(hd.Caputo(0.9), lambda t, y: np.sin(t) - y - 0.5 * np.sign(y), 0.0)
    sticking = hd.Equation(
        hd.Caputo(1.0), lambda t, y: np.array([y[1], -y[0] - 0.5 * np.sign(y[1])]), [2.2, 0.0]
    )
    for equation, start in ((sliding, 0.0), (sticking, 2 * np.pi)):
        with pytest.warns(hd.SolveWarning, match="slide"):
            sol = hd.solve(equation, 20.0, rtol=rtol)
        assert sol.status in (hd.Status.STEP_TOO_SMALL, hd.Status.SLIDING)
        assert "slide" in sol.message
        assert start - rtol <= sol.t[-1] < start + 0.1
        assert sol.stats["n_steps"] < 5000
    assert sol.y[-1, 0] == pytest.approx(0.2, abs=5 * rtol)  # where it sticks


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
def test_blow_up_is_told_from_what_is_not_finite(rtol):
    def status(rhs, y0):
        with pytest.warns(hd.SolveWarning, match="finite"):
            sol = hd.solve(hd.Equation(hd.Caputo(0.9), rhs, y0), 5.0, rtol=rtol)
        assert np.all(np.isfinite(sol.y))
        return sol.status, "not finite just ahead" in sol.message

    assert status(lambda t, y: y * y, 1.0) == (hd.Status.BLOWN_UP, False)
    assert status(lambda t, y: np.log(0.5 - t) * y, 1.0) == (hd.Status.STEP_TOO_SMALL, True)


# Forces that come on later


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
@pytest.mark.parametrize("width", [1.0, 5.0])
def test_a_window_of_force_after_rest_is_seen(width, rtol):
    edges = [50.0, 50.0 + width]
    equation = hd.Equation(
        hd.Caputo(1.0), lambda t, y, p: -y + (1.0 if p[0] < t < p[1] else 0.0), 0.0, params=edges
    )
    t = np.linspace(0.0, 100.0, 400)
    risen = [np.where(t > edge, -np.expm1(edge - np.maximum(t, edge)), 0.0) for edge in edges]
    sol = hd.solve(equation, 100.0, rtol=rtol)
    assert sol.success
    assert np.abs(sol(t)[:, 0] - (risen[0] - risen[1])).max() <= rtol


def test_a_short_pulse_needs_max_step():
    def pulse(t, y):
        return -y + np.exp(-(((t - 50.0) / 0.03) ** 2)) / 0.03

    equation = hd.Equation(hd.Caputo(0.5), pulse, 1.0)
    right = hd.solve(equation, 60.0, rtol=1e-8, breaks=[49.8, 50.2])(50.1)
    sol = hd.solve(equation, 60.0, rtol=1e-4, max_step=0.06)
    assert np.diff(sol.t).max() <= 0.06
    assert sol(50.1) == pytest.approx(right, rel=1e-4)
    free = hd.solve(equation, 60.0, rtol=1e-4)
    assert np.diff(free.t).max() > 0.06


def infusions(t, y, p):
    """p: period, length, decay, phase, frequency of another force."""
    return (1.0 if (t + p[3]) % p[0] < p[1] else 0.0) + np.sin(p[4] * t) - p[2] * y


@pytest.mark.parametrize("length", [2.0, 0.5])
def test_pulses_that_nobody_named_are_seen(length):
    """Ten pulses of a 120th and of a 480th of the run, in long steps that a slow force makes."""
    for alpha, phase in product((0.7, 1.0), np.linspace(0.0, 23.0, 8)):
        equation = hd.Equation(
            hd.Caputo(alpha), infusions, 1.0, params=[24.0, length, 0.1, phase, 0.3]
        )
        edges = np.add.outer(24.0 * np.arange(11) - phase, [0.0, length]).ravel()
        truth = hd.solve(equation, 240.0, rtol=1e-7, breaks=edges[(edges > 0) & (edges < 240)])
        sol = hd.solve(equation, 240.0, rtol=1e-4, max_steps=5000)
        assert sol.success
        assert np.abs(sol.y - truth(sol.t)).max() <= 1e-4 * np.abs(sol.y).max()


def test_a_run_stops_at_its_last_step_and_goes_on():
    equation = hd.scenes.relaxation(0.5)
    whole = hd.solve(equation, 5.0, rtol=1e-8)
    with pytest.warns(hd.SolveWarning, match="max_steps"):
        part = hd.solve(equation, 5.0, rtol=1e-8, max_steps=7)
    assert part.status is hd.Status.MAX_STEPS
    assert "7 in all; name times of jumps and corners" in part.message
    assert part.stats["n_steps"] == 7
    np.testing.assert_array_equal(part.t, whole.t[:8])
    rest = hd.solve(equation, 5.0, resume=part.state, max_steps=100)
    assert rest.success
    assert rest.y[-1] == pytest.approx(whole.y[-1], rel=1e-8)


# Orders next to integers


@pytest.mark.parametrize("above", [1e-2, 1e-3, 1e-5, 1e-9])
@pytest.mark.parametrize(("v", "t_end"), [(-1.0, 1.0), (-1400.0, 1e-3), (1e6, 1e-6)])
def test_the_first_step_of_orders_next_to_1_is_right_everywhere(above, v, t_end):
    equation = hd.Equation(hd.Caputo(1 + above), lambda t, x: -x, [1.0, v])
    truth = exact.relaxation(1 + above, 1.0, [[1.0], [v]])
    for rtol in (1e-6, 1e-11):
        sol = hd.solve(equation, t_end, rtol=rtol)
        assert sol.success
        assert sol(0.0) == 1.0
        t = sol.t[1] * np.append(0.0, np.geomspace(1e-12, 1.0, 60))
        assert np.abs(sol(t) - truth(t)).max() <= rtol


@pytest.mark.parametrize("alpha", [1.0075, 1.001, 1.000001, 0.007, 0.001])
def test_a_break_with_an_order_next_to_an_integer(alpha):
    y0 = [[1.0], [0.0]] if alpha > 1 else 1.0
    truth = exact.relaxation(alpha, 1.0, y0)
    plain = hd.solve(proportional(hd.Caputo(alpha), 1.0, y0), 1.0, rtol=1e-8, breaks=[0.5])
    assert error(plain, truth, 1e-8) <= 1

    def pushed(t, x):
        return -x + (1.0 if t > 0.5 else 0.0)

    def solution(t):
        rest = exact.relaxation(alpha, 1.0, [[1.0], [0.0]] if alpha > 1 else 1.0)
        return truth(t) + np.where(t[:, None] > 0.5, 1 - rest(np.maximum(t - 0.5, 0.0)), 0.0)

    sol = hd.solve(hd.Equation(hd.Caputo(alpha), pushed, y0), 1.0, rtol=1e-8, breaks=[0.5])
    assert error(sol, solution, 1e-8) <= 1


def pulse(t, y, p):
    return (1.0 if p[0] <= t < p[0] + 1 / 150 else 0.0) - y


@pytest.mark.filterwarnings("ignore::hereditary.SolveWarning")
@pytest.mark.parametrize("rtol", [1e-2, 1e-5, 1e-8])
@pytest.mark.parametrize("alpha", [0.1, 0.8, 1.5])
def test_a_force_after_rest_is_seen_if_it_lasts_for_a_150th_of_the_run(alpha, rtol):
    for begin in np.linspace(1e-4, 0.2, 14):
        equation = hd.Equation(
            hd.Caputo(alpha), pulse, [0.0, 0.0][: int(alpha) + 1], params=[begin]
        )
        sol = hd.solve(equation, 1.0, rtol=rtol, max_steps=60)
        assert not sol.success or sol.y.any(), begin
