"""Right-hand sides that jump where functions of t and y change their signs."""

from math import gamma

import numpy as np
import pytest
from solver.runs import at_end, completed, errors_of, event, warned

import hereditary as hd

C = hd.Caputo


def first(t, y):
    return y[0]


def second(t, y):
    return y[1]


def relay(t, x):
    return -np.sign(x)


def test_an_algebraic_row_that_jumps_is_checked_on_the_side_of_the_start():
    def heated(t, y):
        cold = y[0] < 0.5
        return np.array([(2.0 if cold else 0.6) - y[0], (1.0 if cold else 3.0) - y[1]])

    eq = hd.Equation(np.array([1.0, 0.0]) * C(1), heated, [0.0, 1.0])
    sol = completed(eq, 2.0, rtol=1e-8, switches=lambda t, y: y[0] - 0.5)
    assert np.abs(sol.y[-1] - [0.6 - 0.1 * np.exp(np.log(4 / 3) - 2), 3.0]).max() < 1e-8


def test_a_relay_of_order_2_moves_along_parabolas():
    eq = hd.Equation(C(2.0), relay, [1.0, 0.0])
    sol = hd.solve(eq, 10.0, rtol=1e-9, switches=first, events=first)
    quarters = np.sqrt(2) * (1 + 2 * np.arange(4))
    assert np.abs(sol.t_events[0] - quarters).max() < 1e-12
    assert sol.stats["n_rejected"] == 0
    plain = hd.solve(eq, 10.0, rtol=1e-9, events=first)
    assert sol.stats["n_steps"] < plain.stats["n_steps"] / 3
    rows = np.searchsorted(sol.t, quarters - 1e-9)
    assert np.abs(sol.t[rows] - quarters).max() < 1e-12  # steps end there


def test_pieces_of_a_fractional_relay_add_up():
    """x = 1 - t**a / Gamma(1+a) + 2 sum of (t - t_k)**a / Gamma(1+a), alternating."""
    a = 1.5
    eq = hd.Equation(C(a), relay, [1.0, 0.0])
    sol = completed(eq, 10.0, rtol=1e-10, switches=first, events=first)
    _, begin, end = sol.stats["slides"][-1]
    times = sol.t_events[0][sol.t_events[0] < begin]
    signs = 2.0 * (-1.0) ** np.arange(times.size)

    def exact(t):
        parts = signs * np.maximum(np.subtract.outer(t, times), 0.0) ** a
        return 1 - (t**a - parts.sum(axis=1)) / gamma(1 + a)

    assert times.size > 10
    assert np.abs(exact(times)).max() < 1e-11
    moves = sol.t < begin
    assert np.abs(sol.y[moves, 0] - exact(sol.t[moves])).max() < 1e-11
    assert np.abs(sol.y[~moves]).max() < 1e-9
    assert end == 10.0
    gaps = np.diff(times)
    gaps = gaps[gaps > 3e-8]  # in shorter ones x stays below atol
    assert gaps.size > 8
    assert np.all(gaps[1:] < 0.3 * gaps[:-1])


def test_a_force_that_grows_at_a_switch():
    a, level = 0.7, {"switches": lambda t, y: y[0] - 1}
    eq = hd.Equation(C(a), lambda t, y: 1.0 if y[0] < 1 else 2.0, 0.0)
    sol = hd.solve(eq, 3.0, rtol=1e-10, **level)
    begin = gamma(1 + a) ** (1 / a)
    exact = (sol.t**a + np.maximum(sol.t - begin, 0) ** a) / gamma(1 + a)
    apart = np.abs(sol.t - begin) > 1e-12  # rounding of the time at the switch counts by its power
    assert apart.sum() >= apart.size - 2
    assert np.abs(sol.y[:, 0] - exact)[apart].max() < 1e-11
    errors = errors_of(at_end, exact[-1], (1000, 2000), eq, 3.0, **level)
    assert errors[1] < 1e-2
    assert errors[1] < errors[0] / 1.6


@pytest.mark.parametrize(
    ("how", "why"), [({"rtol": 1e-9}, "a larger rtol follows"), ({"n_steps": 2000}, "by rtol=")]
)
@pytest.mark.parametrize("a", [0.7, 1.0])
def test_sliding_is_told_where_it_is_not_followed(a, how, why):
    """Both sides push towards y = 1, which is reached at Gamma(1+a)**(1/a)."""
    eq = hd.Equation(C(a), lambda t, y: 1.0 if y[0] < 1 else -0.5, 0.0)
    sol = warned(f"slides along a switch.*{why}", eq, 3.0, **how, switches=lambda t, y: y[0] - 1)
    assert sol.status is hd.Status.SLIDING
    assert not sol
    near = 1e-9 if "rtol" in how else 1e-2
    assert abs(sol.t[-1] - gamma(1 + a) ** (1 / a)) < near
    assert abs(sol.y[-1, 0] - 1) < near
    assert sol.stats["n_steps"] < 2000


def coulomb(t, y):
    return np.array([y[1], -y[0] - 0.3 * np.sign(y[1])])


@pytest.mark.parametrize("how", [{"rtol": 1e-9}, {"n_steps": 20_000}], ids=str)
def test_coulomb_friction_loses_the_same_amplitude_each_half_period(how):
    """It sticks where abs(x) < 0.3, and sticks again where it goes on."""
    eq = hd.Equation(C(1.0), coulomb, [2.0, 0.0])
    if "rtol" in how:
        sol = completed(eq, 20.0, **how, switches=second, events=second)
        assert np.abs(sol.t_events[0][:3] / np.pi - [1, 2, 3]).max() < 1e-9
        assert np.abs(sol.y_events[0][:3, 0] - [-1.4, 0.8, -0.2]).max() < 1e-9
        (slide,) = sol.stats["slides"]
        assert slide == pytest.approx((0, 3 * np.pi, 20.0), abs=1e-9)
        rest = completed(eq, 40.0, resume=sol.state, switches=second)
        np.testing.assert_allclose(rest.y[-1], [-0.2, 0.0], atol=2e-8)
        return
    sol = warned("slides", eq, 20.0, **how, switches=second, events=second)
    rest = warned("slides", eq, 40.0, resume=sol.state, switches=second)
    assert rest.t[-1] - sol.t[-1] < 0.02


def test_friction_with_memory_against_small_steps():
    """A force keeps it moving: no sticking; the memory is not the friction's."""

    def driven(t, y):
        return np.array([y[1], -y[0] - 0.2 * np.sign(y[1]) + 2.0 * np.cos(1.5 * t)])

    eq = hd.Equation(C(1.0) + np.array([0.0, 0.4]) * C(0.5), driven, [0.0, 1.0])
    sol = completed(eq, 15.0, rtol=1e-9, switches=second, events=second)
    assert sol.t_events[0].size >= 5
    assert np.abs(hd.solve(eq, 15.0, rtol=1e-7).y[-1] - sol.y[-1]).max() < 1e-5
    errors = errors_of(at_end, sol.y[-1], (4000, 16_000), eq, 15.0, switches=second)
    assert errors[1] < 1e-2
    assert errors[1] < errors[0] / 2.5


def test_switches_with_memory_read_another_start_and_a_jacobian():
    def rhs(t, y, memory):
        return np.array([-0.5 * memory[0, 0] + (1.2 if y[0] > t - 4.0 else 0.3)])

    later = [lambda t, y: y[0] - (t - 4.0)]
    eq, how = hd.Equation(C(0.9), rhs, 0.0, memory=C(0.3), t_start=2.0), {"switches": later}
    sol = completed(eq, 12.0, rtol=1e-9, **how, events=later)
    assert sol.t_events[0].size == 1
    how |= {"events": later, "scheme": hd.L1()}
    late = errors_of(lambda run: run.t_events[0], sol.t_events[0], (4000, 16_000), eq, 12.0, **how)
    assert np.all(np.less(late, [30 / 4000, 30 / 16_000]))
    errors = errors_of(at_end, sol.y[-1], (4000, 16_000), eq, 12.0, **how)
    assert errors[1] < 2e-3
    assert errors[1] < errors[0] / 2.5
    given = hd.Equation(C(2.0), relay, [1.0, 0.0], jac=lambda t, x: np.zeros((1, 1)))
    for scheme in (hd.BDF(2), hd.L1(), hd.L2Sigma()):
        steps = hd.solve(given, 5.0, 5000, scheme=scheme, switches=first, events=first)
        assert np.abs(steps.t_events[0] - np.sqrt(2) * np.array([1, 3])).max() < 2e-2


def test_runs_go_on_on_the_side_where_they_were():
    eq = hd.Equation(C(2.0), relay, [1.0, 0.0])
    for how in ({"rtol": 1e-9}, {"n_steps": 1000}):
        whole = hd.solve(eq, 4.0, **how, switches=first)
        half = hd.solve(eq, 2.0, **({"n_steps": 500} if "n_steps" in how else how), switches=first)
        rest = hd.solve(eq, 4.0, resume=half.state, switches=first)
        assert abs(rest.y[-1, 0] - whole.y[-1, 0]) <= (0 if "n_steps" in how else 1e-9)


def test_a_start_on_the_switch_finds_its_side():
    for speed in (1.0, -1.0):
        eq = hd.Equation(C(2.0), relay, [0.0, speed])
        sol = hd.solve(eq, 3.0, rtol=1e-9, switches=first, events=first)
        assert abs(sol(1.0)[0] - speed / 2) < 1e-9
        assert sol.t_events[0] == pytest.approx([2.0], abs=1e-9)
    stuck = completed(hd.Equation(C(0.8), relay, 0.0), 3.0, rtol=1e-9, switches=first)
    assert stuck.stats["slides"] == [(0, 0.0, 3.0)]
    assert np.abs(stuck.y).max() < 1e-9


def test_a_change_may_carry_y_across_a_switch():
    across = event(lambda t, y: t - 1.0, change=lambda t, y: -y)
    eq = hd.Equation(C(1.0), lambda t, y: np.array([1.0]) if y[0] > 0 else np.array([-2.0]), 1.0)
    sol = hd.solve(eq, 2.0, rtol=1e-9, switches=first, events=across)
    assert sol.y[-1, 0] == pytest.approx(-2.0 - 2.0, abs=1e-9)


def test_two_switches_at_once():
    """A square of forces: each changes its own."""
    eq = hd.Equation(C(2.0), lambda t, y: -np.sign(y), [[1.0, 0.5], [0.0, 0.0]])
    switches = [first, second]
    sol = hd.solve(eq, 10.0, rtol=1e-9, switches=switches, events=switches)
    assert np.abs(sol.t_events[0] - np.sqrt(2) * np.arange(1, 8, 2)).max() < 1e-11
    assert np.abs(sol.t_events[1] - np.arange(1, 10, 2)).max() < 1e-11


@pytest.mark.parametrize("ratio", [1.0, 3.0, 0.7])
def test_switches_that_coincide_are_both_seen(ratio):
    """The same motion in two sizes."""
    eq = hd.Equation(
        C(2.0), lambda t, x, p: -p * np.sign(x), [[1.0, ratio], [0.0, 0.0]], params=[1.0, ratio]
    )
    sol = completed(eq, 10.0, rtol=1e-9, switches=[first, second])
    assert np.abs(sol.y[:, 1] - ratio * sol.y[:, 0]).max() < 1e-7
    assert abs(sol.y[-1, 0] - 0.137085) < 1e-5


def stepping(t, y):
    return np.where(y > 0, -1.0, -2.0)


@pytest.mark.parametrize("apart", [0.0, 1e-14, 1e-13, 5e-13, 1e-12, 1e-9])
def test_switches_next_to_each_other(apart):
    eq = hd.Equation(C(1.0), stepping, [1.0, 1.0 + apart])
    sol = completed(eq, 3.0, rtol=1e-9, switches=[first, second])
    assert np.abs(sol.y[-1] + 4.0).max() < 1e-8


@pytest.mark.parametrize("beside", [-1e-12, -1e-13, 1e-13, 1e-12])
def test_runs_that_end_next_to_a_switch_go_on(beside):
    eq = hd.Equation(C(1.0), stepping, 1.0)
    part = completed(eq, 1.0 + beside, rtol=1e-9, switches=first)
    rest = hd.solve(eq, 3.0, resume=part.state, switches=first)
    assert abs(rest.y[-1, 0] + 4.0) < 1e-8


def sine(t, y):
    return np.sin(t)


@pytest.mark.parametrize("alpha", [0.3, 0.7, 1.0])
@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-11])
def test_a_switch_of_time_alone(alpha, rtol):
    sol = completed(
        hd.Equation(C(alpha), lambda t, y: np.sign(np.sin(t)), 0.0), 10.0, rtol=rtol, switches=sine
    )
    starts = np.pi * np.arange(4)
    exact = np.array([1.0, -2.0, 2.0, -2.0]) @ (10.0 - starts) ** alpha / gamma(1 + alpha)
    assert abs(sol.y[-1, 0] - exact) < 10 * rtol


@pytest.mark.parametrize("rtol", [1e-4, 1e-5, 1e-7])
def test_errors_at_a_switch_are_no_sliding(rtol):
    """Where the switch is found y errs by the tolerance; the force only grows there."""
    a, start = 0.8, 0.3
    eq = hd.Equation(C(a), lambda t, y: 1.0 + 3.0 * (y[0] > 1.0), start)
    sol = completed(eq, 1.5, rtol=rtol, switches=lambda t, y: y[0] - 1.0)
    tau = ((1.0 - start) * gamma(1 + a)) ** (1 / a)
    exact = start + (1.5**a + 3.0 * (1.5 - tau) ** a) / gamma(1 + a)
    assert sol.y[-1, 0] == pytest.approx(exact, rel=5 * rtol)


REST = 0.5


def resting(t, y):
    """A neuron without current while its clock is above 0."""
    return np.array([(0.0 if y[1] > 0.0 else 1.5) - y[0], -1.0])


def spike(rest):
    change = lambda t, y: np.array([0.0, rest])  # noqa: E731
    return event(lambda t, y: y[0] - 1.0, direction=1, change=change)


@pytest.mark.parametrize("t_end", [6.0, 10.0, 20.0])
@pytest.mark.parametrize("rest", [0.3, REST, float(np.log(3))])
def test_a_refractory_period_ends_at_the_end_of_a_step_or_elsewhere(rest, t_end):
    """Without memory v rests at 0, and a first step after the spike may be 0.5 long."""
    neuron = hd.Equation(hd.Caputo([1.0, 1.0]), resting, [0.0, 0.0])
    sol = completed(neuron, t_end, rtol=1e-9, events=spike(rest), switches=second)
    period = np.log(3) + rest
    expected = np.log(3) + period * np.arange(1 + int((t_end - np.log(3)) / period))
    assert sol.t_events[0] == pytest.approx(expected, abs=1e-8)


def test_a_refractory_period_with_memory_equals_one_at_known_times():
    neuron = hd.Equation(hd.Caputo([0.8, 1.0]), resting, [0.0, 0.0])
    sol = hd.solve(neuron, 10.0, rtol=1e-9, events=spike(REST), switches=second)
    (spikes,) = sol.t_events

    def driven(t, v, p):
        current = 1.5
        for k in range(p.size):
            if p[k] <= t < p[k] + 0.5:
                current = 0.0
        return current - v

    known = hd.Equation(hd.Caputo(0.8), driven, 0.0, params=spikes)
    breaks = np.sort(np.append(spikes, spikes + REST))
    changes = {time: lambda t, v: 0.0 * v for time in spikes.tolist()}
    same = hd.solve(known, 10.0, rtol=1e-9, changes=changes, breaks=breaks)
    times = np.linspace(0.05, 9.95, 50)
    assert spikes.size == 4
    assert sol(times)[:, 0] == pytest.approx(same(times)[:, 0], abs=1e-8)
