"""Jumps and pulses of the right-hand side that nobody named, in runs by `rtol=`.

Runs with the same times in `breaks=`, or the same functions in `switches=`, are the truth.
"""

import math
from typing import NamedTuple

import numpy as np
import pytest
from problems import PROBLEMS
from solver.runs import completed, event, warned

import hereditary as hd

T_END = 100.0


class Force(NamedTuple):
    """A force g(t, p), and the times p -> edges at which it jumps or bends."""

    value: object
    edges: object
    jumps: bool = True


def window(t, p):
    return 1.0 / p[1] if p[0] < t < p[0] + p[1] else 0.0


def ramp(t, p):
    return min(max((t - p[0]) / p[1], 0.0), 1.0)


def spike(t, p):
    return np.exp(-(((t - p[0]) / (0.4 * p[1])) ** 2)) / p[1]


def doses(t, p):
    given = 0.0
    for k in range(4):
        if p[0] + 9.0 * k <= t < p[0] + 9.0 * k + 0.5 * p[1]:
            given = 2.0 / p[1]
    return given


def table(t, p):
    times = np.array([0.0, p[0] - p[1], p[0], p[0] + p[1], 200.0])
    return np.interp(t, times, np.array([0.2, 0.2, 1.0, 0.2, 0.2]))


def of_square(p):
    period = 5.0 + p[1]
    return np.add.outer(period * np.arange(30), [0.0, 0.4 * period]).ravel()


FORCES = {
    "window": Force(window, lambda p: p[0] + p[1] * np.arange(2)),
    "square wave": Force(
        lambda t, p: 1.0 if t % (5.0 + p[1]) < 0.4 * (5.0 + p[1]) else -0.5, of_square
    ),
    "ramp": Force(ramp, lambda p: p[0] + p[1] * np.arange(2), jumps=False),
    "spike": Force(spike, lambda p: p[0] + p[1] * np.arange(-2, 3), jumps=False),
    "doses": Force(
        doses, lambda p: np.add.outer(p[0] + 9.0 * np.arange(4), [0.0, 0.5 * p[1]]).ravel()
    ),
    "step": Force(lambda t, p: np.sin(0.3 * t) + (1.0 if t > p[0] else 0.0), lambda p: p[:1]),
    "table": Force(table, lambda p: p[0] + p[1] * np.arange(-1, 2), jumps=False),
}


def pushed(force):
    """Return the right-hand side of two components, of which the first is pushed by a force."""
    return lambda t, y, p: np.array([force(t, p) - y[0], 0.5 * y[0] - y[1]])


RIGHT = {name: pushed(force.value) for name, force in FORCES.items()}


def begun(order, y0):
    return y0 if order <= 1 else [y0, [0.0] * len(y0)]


def apart(sol, truth, least=0.01):
    """Return the largest difference of two runs, relative to the sizes of the components."""
    t = np.linspace(least, T_END, 2003)
    return np.max(np.abs(sol(t) - truth(t)).max(axis=0) / np.abs(truth.y).max(axis=0))


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("name", FORCES)
def test_what_nobody_named_is_found(name, seed):
    """Widths are a 500th of the run and more, orders 0.2 to 2, tolerances 1e-3 to 1e-9."""
    rng, force = np.random.default_rng(seed), FORCES[name]
    order = [0.4, 1.0, 1.5, rng.uniform(0.2, 2.0)][seed % 4]
    params = np.array([rng.uniform(10.5, 60.0), 10 ** rng.uniform(np.log10(0.5), 1.0)])
    rtol = 10 ** rng.uniform(-9, -3)
    equation = hd.Equation(hd.Caputo(order), RIGHT[name], begun(order, [1.0, 0.3]), params=params)
    edges = force.edges(params)
    edges = edges[(edges > 0) & (edges < T_END)]
    truth = hd.solve(equation, T_END, rtol=max(1e-2 * rtol, 1e-11), breaks=edges)
    sol = completed(equation, T_END, rtol=rtol)
    assert apart(sol, truth) <= 1.1 * rtol
    if force.jumps:  # each jump that the tolerance does not hide is found, and nothing else
        found = np.array(sol.stats["jumps"])
        assert np.all(np.abs(np.subtract.outer(found, edges)).min(axis=1) <= 1e-13 * T_END)
        assert found.size == edges.size or order > 0.9
    assert truth.stats["jumps"] == []


def crossing(t, y):
    over = 1.0 if y[0] > 0.3 else 0.2
    return np.array([0.8 * np.sin(0.2 * t) + 0.1 - 0.5 * y[0], over - y[1]])


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-7, 1e-8])
@pytest.mark.parametrize("order", [0.4, 0.7, 1.0, 1.3, 1.5, 1.8, 2.0])
def test_a_threshold_in_y_is_the_switch_of_it(order, rtol):
    """Orders below 1 end at such a jump unless it is found.

    Its time is found to 1e-13 of itself, which moves y of order 0.4 next to it by 1e-9 and more.
    """
    equation = hd.Equation(hd.Caputo(order), crossing, begun(order, [0.1, 0.03]))
    truth = hd.solve(equation, T_END, rtol=1e-10, switches=lambda t, y: y[0] - 0.3)
    sol = completed(equation, T_END, rtol=rtol)
    assert apart(sol, truth) <= 1.1 * rtol


def test_crossings_that_come_ever_faster_end_as_sliding():
    """D^1.5 x = -sign(x): each swing lasts about a fifth of the one before."""
    equation = hd.Equation(hd.Caputo(1.5), lambda t, x: -np.sign(x), [1.0, 0.0])
    sol = warned("slides", equation, 20.0, rtol=1e-8)
    assert sol.status is hd.Status.SLIDING
    assert sol.stats["jumps"][0] == pytest.approx(math.gamma(2.5) ** (2 / 3), rel=1e-8)
    assert np.all(np.diff(sol.stats["jumps"], 2)[:5] < 0)
    truth = completed(equation, 20.0, rtol=1e-8, switches=lambda t, x: x[0])
    assert abs(sol.t[-1] - truth.stats["slides"][0][1]) <= 1e-6 * sol.t[-1]


def late_force(t, y, late):
    return (1.0 if 2.3 < t < 2.9 else 0.0) - late[0]


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
@pytest.mark.parametrize("order", [0.4, 1.0, 1.5])
def test_delays_carry_a_found_jump_on(order, rtol):
    memory = hd.Delay(1.0)
    equation = hd.Equation(hd.Caputo(order), late_force, begun(order, [0.5]), memory=memory)
    truth = hd.solve(equation, 12.0, rtol=1e-10, breaks=[2.3, 2.9])
    sol = completed(equation, 12.0, rtol=rtol)
    np.testing.assert_allclose(sol.stats["jumps"], [2.3, 2.9], rtol=1e-14)
    t = np.linspace(0.01, 12.0, 1501)
    assert np.abs(sol(t) - truth(t)).max() <= rtol * np.abs(truth.y).max()


def test_the_times_are_the_users_and_a_resumed_run_goes_on():
    def late(t, y):
        return (1.0 if t > 50.5 else 0.0) - y

    equation = hd.Equation(hd.Caputo(0.5), late, 0.3, t_start=48.0)
    whole = hd.solve(equation, 60.0, rtol=1e-8)
    assert whole.stats["jumps"] == pytest.approx([50.5], rel=1e-14)
    part = hd.solve(equation, 50.5 + 1e-6, rtol=1e-8)
    rest = completed(equation, 60.0, resume=part.state)
    assert rest.stats["jumps"] == []
    assert rest.y[-1, 0] == pytest.approx(whole.y[-1, 0], rel=1e-7)


def test_events_beside_a_found_jump():
    equation = hd.Equation(hd.Caputo(0.5), lambda t, y: (1.0 if t > 3.0 else 0.0) - y, 1.0)
    how = {"rtol": 1e-8, "events": event(lambda t, y: y[0] - 0.6, direction=1)}
    sol, truth = (hd.solve(equation, 10.0, **how, breaks=b) for b in ((), (3.0,)))
    assert sol.stats["jumps"] == pytest.approx([3.0], rel=1e-14)
    np.testing.assert_allclose(sol.t_events[0], truth.t_events[0], rtol=1e-8)


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
def test_smooth_runs_have_no_jumps(rtol):
    for problem in PROBLEMS:
        sol = completed(problem.equation(), problem.t_end, rtol=rtol)
        assert sol.stats["jumps"] == []
    for scene in (hd.scenes.lorenz, hd.scenes.selkov, hd.scenes.duffing, hd.scenes.van_der_pol):
        sol = completed(scene(), 30.0, rtol=rtol)
        assert sol.stats["jumps"] == []


@pytest.mark.filterwarnings("ignore::hereditary.PythonFunctionWarning")
def test_functions_in_python_are_looked_at_less_often():
    """A pulse of a hundredth of the run is found; calls remain few."""

    class Pulse:
        def __call__(self, t, y):
            return np.array([(1.0 if 41.3 < t < 42.3 else 0.0) - y[0]])

    equation = hd.Equation(hd.Caputo(0.7), Pulse(), 1.0)
    sol = hd.solve(equation, T_END, rtol=1e-6)
    truth = hd.solve(equation, T_END, rtol=1e-8, breaks=[41.3, 42.3])
    assert apart(sol, truth) <= 1e-6
    np.testing.assert_allclose(sol.stats["jumps"], [41.3, 42.3], rtol=1e-14)
    smooth = hd.Equation(hd.Caputo(0.7), lambda t, y: -y, 1.0)
    assert hd.solve(smooth, T_END, rtol=1e-6).stats["n_rhs"] < 1200


def test_a_jump_between_first_guess_and_solution_is_seen():
    """After a kink the first guess of a step is constant: f may jump before the solution."""

    def late(t, y, before):
        over = 1.0 if y[0] > 0.3 else -0.2
        return np.array([-0.5 * before[0, 1] - 0.2 * y[0] + np.sin(t), over - y[1]])

    equation = hd.Equation(hd.Caputo(0.7), late, [0.1, 0.03], memory=hd.Delay(1.0))
    truth = hd.solve(equation, 12.0, rtol=1e-10, switches=lambda t, y: y[0] - 0.3)
    for rtol in (1e-4, 1e-6, 1e-8):
        sol = hd.solve(equation, 12.0, rtol=rtol)
        t = np.linspace(0.01, 12.0, 1501)
        assert np.abs(sol(t) - truth(t)).max() <= rtol * np.abs(truth.y).max()


def own_jump(t, y, p):
    return p[0] + (p[1] if y[0] > p[2] else 0.0) - p[3] * y


@pytest.mark.parametrize("seed", range(10))
def test_a_component_that_passes_its_own_threshold(seed):
    """The jump bends the solution at once, like t to the order of the equation."""
    rng = np.random.default_rng(seed)
    order, rtol = rng.uniform(0.6, 1.0), 10 ** rng.uniform(-9, -4)
    params = [rng.uniform(0.3, 1.5), rng.uniform(0.1, 2.0), rng.uniform(0.1, 0.5), 0.1]
    equation = hd.Equation(hd.Caputo(order), own_jump, 0.0, params=params)
    level = params[2]
    truth = hd.solve(equation, 4.0, rtol=1e-11, switches=lambda t, y: y[0] - level)
    sol = completed(equation, 4.0, rtol=rtol)
    t = np.linspace(0.002, 4.0, 2001)
    assert np.abs(sol(t) - truth(t)).max() <= 3 * rtol * np.abs(truth.y).max()


def onset(t, y, p):
    return (p[1] if t > p[0] else 0.0) - p[2] * y


@pytest.mark.parametrize("order", [0.3, 0.5, 1.0, 1.5])
@pytest.mark.parametrize("start", [0.0, 1e-12, 1.0])
@pytest.mark.parametrize(("rate", "at"), [(1e4, 77.77), (10.0, 0.6), (0.1, 0.3), (1.0, 3.0)])
def test_a_force_that_sets_in_on_a_component_at_rest(order, start, rate, at):
    """Rounding of f over tiny increments of y must not hide it, nor may a first step pass it."""
    for rtol in (1e-3, 1e-6):
        y0 = begun(order, [start])
        equation = hd.Equation(hd.Caputo(order), onset, y0, params=[at, 0.7 * rate, rate])
        truth = hd.solve(equation, T_END, rtol=1e-9, breaks=[at])
        sol = completed(equation, T_END, rtol=rtol)
        assert apart(sol, truth) <= 1.1 * rtol


def test_an_onset_that_is_smooth_is_seen():
    def pulse(t, y):
        return 500.0 * np.exp(-(((t - 61.17333334298031) / 0.3072) ** 2)) - 1e4 * y

    equation = hd.Equation(hd.Caputo(1.0), pulse, 0.0)
    sol = hd.solve(equation, 146.3, rtol=1e-6)
    assert sol(61.0)[0] == pytest.approx(0.03635359, rel=1e-5)


def test_noise_ends_early_and_algebraic_rows_restart():
    def noise(t, y):
        x = math.sin(12989.8 * t) * 43758.5453
        return x - math.floor(x) - y

    sol = warned("jumps", hd.Equation(hd.Caputo(0.5), noise, 0.5), 10.0, rtol=1e-4)
    assert sol.status is hd.Status.STEP_TOO_SMALL
    assert len(sol.stats["jumps"]) < 1000

    def row(t, z):
        return np.array([z[1] - z[0], z[1] + z[1] ** 3 - (1.0 if t > 3.3 else 0.0) - z[0]])

    terms = np.array([1.0, 0.0]) * hd.Caputo(0.7)
    equation = hd.Equation(terms, row, [1.0, 0.6823278038280193])
    sol = completed(equation, 10.0, rtol=1e-6)
    truth = hd.solve(equation, 10.0, rtol=1e-8, breaks=[3.3])
    np.testing.assert_allclose(sol.y[-1], truth.y[-1], rtol=1e-6)


def infusions(t, y, p):
    """p: period, length, decay, phase, frequency of another force."""
    return (1.0 if (t + p[3]) % p[0] < p[1] else 0.0) + np.sin(p[4] * t) - p[2] * y


@pytest.mark.parametrize("length", [2.0, 0.5])
def test_pulses_in_long_steps_are_seen(length):
    """Ten pulses of a 120th and of a 480th of the run, in long steps that a slow force makes."""
    for alpha in (0.7, 1.0):
        for phase in np.linspace(0.0, 23.0, 8):
            params = [24.0, length, 0.1, phase, 0.3]
            equation = hd.Equation(hd.Caputo(alpha), infusions, 1.0, params=params)
            edges = np.add.outer(24.0 * np.arange(11) - phase, [0.0, length]).ravel()
            truth = hd.solve(equation, 240.0, rtol=1e-7, breaks=edges[(edges > 0) & (edges < 240)])
            sol = hd.solve(equation, 240.0, rtol=1e-4, max_steps=5000)
            assert sol.success
            assert np.abs(sol.y - truth(sol.t)).max() <= 1e-4 * np.abs(sol.y).max()
