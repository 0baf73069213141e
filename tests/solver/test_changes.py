"""Changes of y by events and at stated times; each exact zero of drawn events acts once."""

from collections.abc import Callable
from functools import cache, partial
from math import gamma
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from solver.runs import at_end, completed, errors_of, event, warned

import hereditary as hd

C = hd.Caputo
GIVEN = [hd.ExplicitCaputo(), hd.L1(), hd.BDF(2), hd.Adams(), hd.GrunwaldLetnikov()]


def at_one(change, **attributes):
    """A new event at t = 1."""
    return event(lambda t, y: t - 1.0, change=change, **attributes)


def on_steps(how, n_steps):
    """Return arguments of a run, which are given or those of a scheme in so many steps."""
    return how if isinstance(how, dict) else {"n_steps": n_steps, "scheme": how}


def floor(e, kept=0.0, **attributes):
    """The floor off which a ball bounces with a share e of its speed, and of its height."""
    bounced = lambda t, y: np.array([kept * y[0], -e * y[1]])  # noqa: E731
    return event(lambda t, y: y[0], change=bounced, **attributes)


def leaking(order):
    """A neuron, and its spikes: v' = 1.5 - v up to 1, then from 0 on."""
    fire = event(lambda t, v: v[0] - 1.0, change=lambda t, v: 0 * v, direction=1)
    return hd.Equation(C(order), lambda t, v: 1.5 - v, 0.0), fire


def add(jump):
    return lambda t, y: y + jump


def decay(t, y):
    return -y


def read_decay(t, y, memory):
    return -y - 0.5 * memory[0]


# Linear equations without a force: from y0 on, and how they are stated.
LINEAR = {
    "order 1": (C(1.0), decay, 1.0, {}),
    "order 0.6": (C(0.6), decay, 1.0, {}),
    "two terms": (C(0.9) + 0.5 * C(0.4), decay, 1.0, {}),
    "oscillator": (C(1.8) + 0.3 * C(0.7), decay, [1.0, 0.0], {}),
    "friction above 1": (C(1.9) + 0.3 * C(1.2), decay, [1.0, 0.0], {}),
    "kernel": (C(1.0) + 0.5 * hd.Memory(hd.Prony([1.0], [2.0]), 1), decay, 1.0, {}),
    "kernel on y": (C(1.0) + 0.5 * hd.Memory(hd.Prony([1.0], [2.0]), 0), decay, 1.0, {}),
    "memory read": (C(0.9), read_decay, 1.0, {"memory": C(0.3)}),
    "read above 1": (C(1.8), read_decay, [1.0, 0.0], {"memory": C(0.6)}),
    "order 2.5": (C(2.5) + C(1.0), decay, [1.0, 0.0, 0.0], {}),
    "complex": (C(0.7), lambda t, y: -1j * y, 1.0 + 0.5j, {}),
    "matrix": (np.array([[1.0, 0.2], [0.1, 1.0]]) * C(0.8) + 0.3 * C(0.3), decay, [1.0, -1.0], {}),
}


@pytest.mark.parametrize("name", LINEAR)
def test_a_jump_is_another_solution_on_top(name):
    """Without a force: y = phi(t) y(0) + phi(t - tau) D, for the jump enters no memory."""
    terms, rhs, y0, more = LINEAR[name]
    eq = hd.Equation(terms, rhs, y0, **more)
    jump = 0.7 * np.atleast_1d(y0)[: 2 if name == "matrix" else 1]
    alone = hd.solve(eq, 3.0, rtol=1e-10)
    sol = completed(eq, 3.0, rtol=1e-10, events=at_one(add(jump)))
    after = sol.t > 1.0
    on_top = sol.y[after] - alone(sol.t[after])
    if name != "kernel on y":  # which acts on y itself, jump and all
        assert np.abs(on_top - 0.7 * alone(sol.t[after] - 1.0)).max() < 1e-8
    before = sol.t < 1.0
    assert np.abs(sol.y[before] - alone(sol.t[before])).max() < 1e-9
    assert sol.t_events[0] == pytest.approx([1.0], abs=1e-12)


def test_a_kernel_that_acts_on_y_sees_the_jump():
    """y' + 0.5 z = -y, z' = 2 y - z: z is the kernel's integral."""
    terms, rhs, y0, _ = LINEAR["kernel on y"]
    sol = hd.solve(hd.Equation(terms, rhs, y0), 3.0, rtol=1e-10, events=at_one(add(0.7)))

    def pair(t, y):
        return np.array([-y[0] - 0.5 * y[1], 2 * y[0] - y[1]])

    jump = at_one(lambda t, y: y + np.array([0.7, 0.0]))
    other = hd.solve(hd.Equation(C(1.0), pair, [1.0, 0.0]), 3.0, rtol=1e-10, events=jump)
    assert abs(sol.y[-1, 0] - other.y[-1, 0]) < 1e-9


decaying = cache(lambda: hd.Equation(C(0.7), decay, 1.0))


def risen(**how):
    """A decay that rises by 1 at t = 1."""
    return hd.solve(decaying(), 2.0, events=at_one(add(1.0)), **how)


BOTH_WAYS = pytest.mark.parametrize("how", [{"rtol": 1e-8}, {"n_steps": 100}], ids=str)


@BOTH_WAYS
def test_rows_and_dense_output_show_both_sides(how):
    sol, plain = risen(**how), hd.solve(decaying(), 2.0, **how)
    (where,) = np.flatnonzero(np.diff(sol.t) == 0)
    before, after = sol.y[where : where + 2, 0]
    assert sol.t[where] == pytest.approx(1.0, abs=1e-12)
    assert after - before == pytest.approx(1.0, abs=1e-9)
    assert np.array_equal(sol.y[: where // 2], plain.y[: where // 2])
    assert np.all(np.diff(sol.t) >= 0)
    assert sol(1.0)[0] == pytest.approx(after, abs=1e-12)
    assert sol(1.0 - 1e-9)[0] == pytest.approx(before, abs=1e-7)
    assert sol(1.0 + 1e-12)[0] == pytest.approx(after, abs=1e-5)
    rows = risen(**how, t_eval=[0.5, 1.0, 1.5])
    assert rows.y[1, 0] == pytest.approx(after, abs=1e-7)
    assert rows.y[2, 0] == pytest.approx(sol(1.5)[0], abs=1e-5)


def test_both_sides_are_saved_beside_every_30th_step():
    every, steps = risen(n_steps=100, save_every=30), risen(n_steps=100)
    assert np.round(every.t / 0.02).tolist() == [0, 30, 50, 50, 60, 90, 100]
    assert np.isin(every.y, steps.y).all()


@pytest.mark.parametrize("history", [hd.Direct(), hd.FFT(), hd.SumOfExponentials()], ids=repr)
@pytest.mark.parametrize("scheme", GIVEN, ids=repr)
def test_given_steps_converge_to_the_jump(scheme, history):
    jump = {"events": at_one(add(1.0))}
    sought = hd.solve(decaying(), 2.0, rtol=1e-10, **jump).y[-1]
    how = {"scheme": scheme, "history": history, **jump}
    errors = errors_of(at_end, sought, (500, 1000), decaying(), 2.0, **how)
    assert errors[1] < 2e-3
    assert np.log2(errors[0] / errors[1]) > 0.85


def spikes_by_sums(alpha, force, start, reset, t_end, n):
    """Product rectangles: y = y(0) + all jumps + J**alpha f, no jump in the memory."""
    h = t_end / n
    y, jumps = np.array(start, dtype=float), np.array(start, dtype=float)
    k = np.arange(n + 1.0)
    weights = np.diff(k**alpha) * h**alpha / gamma(1 + alpha)
    f, spikes = np.zeros((n, y.size)), []
    for i in range(n):
        f[i] = force(y)
        before, y = y, jumps + weights[: i + 1] @ f[i::-1]
        new = reset(y)
        if new is not None:
            spikes.append(((i + 1) * h, before))
            jumps, y = jumps + new - y, new
    return np.array([t for t, _ in spikes])


def test_leaky_integrate_and_fire_with_memory_against_tiny_steps():
    eq, fire = leaking(0.8)
    (spikes,) = hd.solve(eq, 8.0, rtol=1e-10, events=fire).t_events
    assert spikes.size == 4
    rule = 0.8, lambda v: 1.5 - v, [0.0], lambda v: 0 * v if v[0] >= 1 else None, 8
    tiny = [np.abs(spikes_by_sums(*rule, n) - spikes).max() for n in (4000, 16_000)]
    steps = errors_of(lambda sol: sol.t_events[0], spikes, (4000, 16_000), eq, 8.0, events=fire)
    for errors, bound in ((tiny, 1e-3), (steps, 2e-3)):
        assert errors[1] < bound
        assert errors[1] < errors[0] / 2.5


def izhikevich(t, y):
    v, u = y
    return np.array([0.04 * v**2 + 5 * v + 140 - u + 10, 0.02 * (0.2 * v - u)])


def test_izhikevich_with_memory_against_tiny_steps():
    reset = lambda t, y: np.array([-65.0, y[1] + 8.0])  # noqa: E731
    peak = event(lambda t, y: y[0] - 30.0, change=reset)
    eq = hd.Equation(C(0.9), izhikevich, [-65.0, -13.0])
    (spikes,) = completed(eq, 100.0, rtol=1e-9, events=peak).t_events
    assert spikes.size == 2
    how = {"events": peak, "save_every": 1000}
    errors = errors_of(lambda sol: sol.t_events[0], spikes, (20_000, 80_000), eq, 100.0, **how)
    assert errors[1] < 0.1
    assert errors[1] < errors[0] / 2.5
    force, at_peak = lambda y: izhikevich(0.0, y), lambda y: reset(0.0, y) if y[0] >= 30 else None
    tiny = spikes_by_sums(0.9, force, [-65.0, -13.0], at_peak, 40.0, 20_000)
    assert np.abs(tiny - spikes).max() < 0.15


@pytest.mark.hypothesis
@example(1.0, 0.30000000000000004, hd.ExplicitCaputo())  # a step is at 0.3
@given(st.floats(0.3, 1.9), st.floats(0.1, 1.9), st.sampled_from([None, *GIVEN]))
def test_the_present_value_changes_nothing(alpha, tau, scheme):
    how = {"rtol": 1e-9} if scheme is None else {"n_steps": 100, "scheme": scheme}
    eq = hd.Equation(C(alpha), lambda t, y: np.cos(t) - y, [1.0, 0.3] if alpha > 1 else 1.0)
    same = event(lambda t, y: t - tau, change=lambda t, y: y)
    plain = hd.solve(eq, 2.0, **how)
    changed = hd.solve(eq, 2.0, **how, events=same)
    assert abs(changed.t_events[0][0] - tau) < 1e-10
    assert np.abs(changed.y[-1] - plain.y[-1]).max() < (1e-8 if scheme is None else 1e-12)


def test_a_run_with_jumps_goes_on_from_its_state():
    eq, fire = leaking(0.8)
    for how, near in (({"rtol": 1e-9}, 1e-7), ({"n_steps": 8000}, 0.0)):
        whole = hd.solve(eq, 8.0, **how, events=fire)
        part = {"n_steps": 3000} if "n_steps" in how else how
        first = hd.solve(eq, 3.0, **part, events=fire)
        rest = hd.solve(eq, 8.0, resume=first.state, events=fire)
        assert abs(rest.y[-1, 0] - whole.y[-1, 0]) <= near
        assert first.t_events[0].size + rest.t_events[0].size == whole.t_events[0].size


free = cache(lambda: hd.Equation(C(1.0), lambda t, y: np.array([y[1], 0.0]), [0.5, 1.0]))
falling = cache(lambda: hd.Equation(C(1.0), lambda t, y: np.array([y[1], -1.0]), [1.0, 0.0]))


@pytest.mark.parametrize("order", [0.8, 1.0])
@pytest.mark.parametrize("scheme", GIVEN, ids=repr)
def test_a_change_that_leads_further_acts_once(scheme, order):
    further = event(lambda t, v: v[0] - 1.0, change=lambda t, v: v + 2.0)
    equation = hd.Equation(C(order), lambda t, v: 1.5 - v, 0.0)
    exact = completed(equation, 8.0, rtol=1e-9, events=further)
    found = completed(equation, 8.0, 4000, scheme=scheme, events=further)
    assert found.t_events[0] == pytest.approx(exact.t_events[0], abs=3e-3)
    assert found.y[-1] == pytest.approx(exact.y[-1], abs=3e-4)


@pytest.mark.parametrize("e", [0.8, 0.3, 0.1, 2e-3, 1e-3, 3e-4, 0.0])
def test_a_bouncing_ball_comes_to_an_end(e):
    words, events = "follow each other without end", floor(e, direction=-1)
    sol = warned(words, falling(), 20.0, rtol=1e-9, events=events)
    assert sol.status is hd.Status.PILED_UP
    flights = np.sqrt(2) * np.cumsum([1, *(2 * e**k for k in range(1, sol.t_events[0].size))])
    assert np.abs(sol.t_events[0] - flights).max() < (1e-7 if e else 2e-7)
    assert abs(sol.t[-1] - np.sqrt(2) * (1 + 2 * e / (1 - e))) < 1e-3
    assert sol.y[:, 0].min() > -1e-9
    rest = warned("without end", falling(), 20.0, resume=sol.state, events=events)
    assert rest.status is hd.Status.PILED_UP  # it stays there
    assert rest.y[:, 0].min() > -1e-9


@pytest.mark.parametrize("how", [{"n_steps": 1000}, {"mesh": hd.graded(1000, 1.5)}], ids=str)
def test_a_bouncing_ball_comes_to_an_end_on_given_steps(how):
    how, eq = how | {"events": floor(0.7, direction=-1)}, falling().replace(y0=[0.1, 0.0])
    sol = warned("follow each other without end", eq, 3.0, scheme=hd.L1(), **how)
    assert sol.status is hd.Status.PILED_UP
    assert sol.t[-1] == pytest.approx(np.sqrt(0.2) * (1 + 2 * 0.7 / 0.3), rel=0.1)


def test_terminal_counts_and_other_events_go_along():
    eq, fire = leaking(1.0)
    fire.terminal, fire.direction = 3, 0
    half = event(lambda t, v: v[0] - 0.5, direction=1)
    for how in ({"rtol": 1e-9}, {"n_steps": 20_000}):
        sol = hd.solve(eq, 20.0, **how, events=[fire, half])
        assert sol.status is hd.Status.EVENT
        assert sol.t_events[0].size == sol.t_events[1].size == 3
        assert sol.t[-1] == pytest.approx(3 * np.log(3), abs=1e-2)


def test_bad_changes_end_the_run():
    for change in (lambda t, y: np.zeros(2), lambda t, y: np.nan * y, lambda t, y: "x"):
        sol = warned("change", decaying(), 2.0, rtol=1e-6, events=at_one(change))
        assert sol.status is hd.Status.EVENT_FAILED
        assert sol.t[-1] == pytest.approx(1.0)
    varying = hd.Equation(C(lambda t: 0.8 - 0.1 * t), decay, 1.0)
    assert hd.solve(varying, 2.0, 100, events=at_one(add(1.0))).success


def test_doses_at_times_of_steps_and_one_a_step():
    """Given steps act at a zero on a step, and equal intervals are no pile."""
    doses = event(lambda t, y: np.sin(np.pi * (t - 0.5)), change=add(1.0))
    ways = [{"n_steps": n, "scheme": hd.L1()} for n in (20, 200, 1000)]
    ends = []
    for how in (*ways, {"rtol": 1e-9}):
        sol = hd.solve(decaying(), 10.0, **how, events=doses)
        assert sol.status is hd.Status.COMPLETED
        assert sol.t_events[0] == pytest.approx(np.arange(10) + 0.5, abs=1e-9)
        ends.append(sol.y[-1, 0])
    assert abs(ends[-2] - ends[-1]) < 0.05


def test_neurons_in_step_all_fire():
    """Zeros that coincide to rounding are each found."""
    eq = hd.Equation(C(0.8), lambda t, v: np.array([1.5 - v[0], (4.5 - 3 * v[1]) / 3]), [0.0, 0.0])
    fires = [
        event(lambda t, v: v[0] - 1.0, change=lambda t, v: np.array([0.0, v[1]])),
        event(lambda t, v: v[1] - 1.0, change=lambda t, v: np.array([v[0], 0.0])),
    ]
    sol = hd.solve(eq, 8.0, rtol=1e-9, events=fires)
    assert sol.t_events[0].size == sol.t_events[1].size == 4
    assert np.abs(sol.t_events[0] - sol.t_events[1]).max() < 1e-9
    assert np.abs(sol.y[:, 0] - sol.y[:, 1]).max() < 1.1  # at an event one is reset first
    assert abs(sol.y[-1, 0] - sol.y[-1, 1]) < 1e-9


def test_a_terminal_event_changes_y_before_it_ends_the_run():
    late = lambda t, y: t - 1.0005  # noqa: E731
    stop = event(late, change=add(1.0), terminal=True)
    for how in ({"rtol": 1e-9}, {"n_steps": 2000}):
        whole = hd.solve(decaying(), 2.0, **how, events=event(late, change=add(1.0)))
        part = hd.solve(decaying(), 2.0, **how, events=stop)
        assert part.status is hd.Status.EVENT
        assert part.y[-1, 0] - part.y[-2, 0] == pytest.approx(1.0, abs=1e-9)
        rest = completed(decaying(), 2.0, resume=part.state, events=stop)
        assert rest.t_events[0].size == 0
        assert abs(rest.y[-1, 0] - whole.y[-1, 0]) < 1e-8


def counter(t, y):
    return np.array([y[0], y[1] + 1.0])


@given(st.floats(0.3, 1.0), st.floats(0.1, 0.3), st.sampled_from([1e-4, 1e-6, 1e-8]), st.booleans())
def test_a_change_elsewhere_is_made_once(alpha, start, rtol, either):
    """Where the event is found y errs by the tolerance, and may lie on either side of the zero."""
    level = event(lambda t, y: y[0] - 0.7, change=counter, direction=0 if either else 1)
    watched = event(lambda t, y: y[0] - 0.7)
    eq = hd.Equation(C(alpha), lambda t, y: np.array([1.0, 0.0]), [start, 0.0])
    sol = completed(eq, 3.0, rtol=rtol, events=[watched, level])
    exact = ((0.7 - start) * gamma(1 + alpha)) ** (1 / alpha)
    assert sol.y[-1, 1] == 1.0
    for times in sol.t_events:
        assert times == pytest.approx([exact], rel=1e3 * rtol)


@pytest.mark.parametrize("direction", [-1, 0])
@pytest.mark.parametrize("e", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("how", [{"rtol": 1e-4}, {"rtol": 1e-8}, *GIVEN], ids=repr)
def test_balls_that_keep_their_height_stay_above_the_floor(how, e, direction):
    """SciPy's users write [y[0], -e y[1]]; errors left it below, from where it fell."""
    how = on_steps(how, 8000) | {"events": floor(e, kept=1.0, direction=direction)}
    sol = warned("", falling(), 10.0, **how)
    assert not sol.success
    assert sol.y[:, 0].min() > -1e-2
    assert sol.t_events[0][0] == pytest.approx(np.sqrt(2), abs=3e-3)
    assert sol.t[-1] < 10.0 or sol.status is hd.Status.ZIGZAG


@pytest.mark.parametrize(("alpha", "gap"), [(1.0, 1e-3), (0.85, 1e-2), (0.75, 1e-2), (0.72, 2e-3)])
@pytest.mark.parametrize("either", [True, False])
def test_a_thermostat_keeps_between_its_levels(alpha, gap, either):
    """The next zero may follow a change within a tiny fraction of a step."""
    turned = lambda rate: lambda t, y: np.array([y[0], rate])  # noqa: E731
    side = 0 if either else 1  # on its way up y passes the lower level
    hot = event(lambda t, y: y[0] - 1.0, change=turned(-1.0), direction=side)
    cold = event(lambda t, y: y[0] - 1.0 + gap, change=turned(1.0), direction=-side)
    eq = hd.Equation(C([alpha, 1.0]), lambda t, y: np.array([y[1], 0.0]), [0.5, 1.0])
    first = (0.5 * gamma(1 + alpha)) ** (1 / alpha)
    sol = completed(eq, 1.2 * first, rtol=1e-6, events=[hot, cold])
    late = sol.t >= sol.t_events[0][0]
    assert sol.y[late, 0].max() < 1.0 + 1e-5  # ten tolerances
    assert sol.y[late, 0].min() > 1.0 - gap - 1e-5


@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
@pytest.mark.parametrize("above", [1e-3, 1e-5, 1e-7])
def test_a_run_that_grazes_a_zero_goes_on(above, rtol):
    """Errors may hide the way back, but no pile and no sliding is told."""
    graze = event(lambda t, y: y[0] - 1.0, change=counter)
    eq = hd.Equation(C(1.0), lambda t, y: np.array([np.cos(t), 0.0]), [above, 0.0])
    sol = completed(eq, 20.0, rtol=rtol, events=graze, max_step=0.05)
    assert sol.y[-1, 1] == sol.t_events[0].size
    assert np.abs(sol.y[:, 0] - above - np.sin(sol.t)).max() < 10 * rtol


@pytest.mark.parametrize("n", [3999, 4000])
@pytest.mark.parametrize("scheme", [hd.ExplicitCaputo(), hd.L1(), hd.GrunwaldLetnikov()], ids=repr)
def test_a_mirror_acts_once_where_it_falls_on_a_step(scheme, n):
    back = lambda t, y: np.array([-y[0] if y[0] < 0 else 2.0 - y[0], -y[1]])  # noqa: E731
    mirror = event(lambda t, y: y[0] * (1.0 - y[0]), change=back)
    sol = hd.solve(free().replace(y0=[0.5, 7.3]), 10.0, n, scheme=scheme, events=mirror)
    assert sol.t_events[0].size == 73
    assert sol.y[-1] == pytest.approx([0.5, -7.3], abs=1e-9)


@pytest.mark.parametrize("scale", [1e-150, 1e-160, 1e-300])
def test_events_of_tiny_values_are_located(scale):
    small = [lambda t, v, c=c: c * (v[0] - 1.0) for c in (1.0, scale)]
    times = [hd.solve(leaking(0.8)[0], 3.0, rtol=1e-9, events=e).t_events[0][0] for e in small]
    assert times[1] == pytest.approx(times[0], abs=1e-12)


@pytest.mark.parametrize(
    "how", [{"rtol": 1e-6}, *GIVEN, hd.ProductTrapezoid(), hd.IMEX(hd.L1())], ids=repr
)
def test_a_right_hand_side_that_raises_behind_a_change_keeps_what_was_computed(how):
    def bounded(t, v):
        if v[0] < -0.5:
            raise ValueError("below")
        return [float(str(1.0))]  # in Python

    fire = event(lambda t, v: v[0] - 1.0, change=lambda t, v: 0 * v - 1.0, direction=1)
    with pytest.warns(hd.PythonFunctionWarning):
        eq = hd.Equation(C(1.0), bounded, 0.0, linear=np.zeros((1, 1)))
    with pytest.raises(ValueError, match="below") as caught:
        hd.solve(eq, 3.0, events=fire, **on_steps(how, 1000))
    sol = caught.value.result
    assert sol.status is hd.Status.RHS_FAILED
    assert sol.t_events[0] == pytest.approx([1.0], abs=1e-9)
    assert sol.t[-1] == pytest.approx(1.0, abs=4e-3)
    assert sol.y[-1, 0] == pytest.approx(-1.0, abs=1e-12)


@pytest.mark.parametrize("how", [{"rtol": 1e-8}, *GIVEN], ids=repr)
def test_doses_at_stated_times_add_solutions(how):
    """Those beyond the end are left out; at the end the last row is the one after the change."""
    eq = hd.Equation(C(0.7), decay, 1.0, t_start=-2.0)
    allowed = 1e-7 if isinstance(how, dict) else 5e-3
    how = on_steps(how, 4000)
    doses, relax = dict.fromkeys([0.5, -1.0, 2.0, 7.0], add(1.0)), hd.exact.relaxation(0.7)
    sol = completed(eq, 2.0, **how, changes=doses)
    assert np.flatnonzero(np.diff(sol.t) == 0).size == 3
    for t in (-1.2, -0.9, 0.4, 0.7, 1.9):
        exact = sum(relax(t - since)[0] for since in (-2.0, -1.0, 0.5) if t > since)
        assert abs(sol(t)[0] - exact) < allowed
    assert sol.y[-1, 0] - sol.y[-2, 0] == pytest.approx(1.0, abs=1e-9)
    times = [-1.5, -1.0, 0.5, 1.0]
    rows = hd.solve(eq, 2.0, **how, changes=doses, t_eval=times)
    np.testing.assert_allclose(rows.y, sol(times), rtol=0, atol=1e-5)
    half = how | {"n_steps": 2500} if "n_steps" in how else how
    first = hd.solve(eq, 0.5, **half, changes=doses)
    rest = hd.solve(eq, 2.0, resume=first.state, changes=doses)
    assert abs(rest.y[-1, 0] - sol.y[-1, 0]) < 1e-7


@pytest.mark.parametrize("how", [{"n_steps": 1000}, {"rtol": 1e-8}], ids=str)
@pytest.mark.parametrize(
    "interrupted",
    [
        {"changes": {0.51: add(1.0)}},
        {"switches": lambda t, y: y[0] - 0.8},
        {"events": event(lambda t, y: y[0] - 0.8, change=add(1.0))},
    ],
    ids=lambda given: next(iter(given)),
)
def test_a_run_after_its_last_interruption_keeps_the_rows_it_is_asked_for(interrupted, how):
    """To its very end, and each n-th step only; where it is interrupted there is a row as well."""
    times = [0.0, 0.5, 1.0, 2.0]
    sol = hd.solve(decaying(), 2.0, **how, **interrupted)
    rows = hd.solve(decaying(), 2.0, **how, **interrupted, t_eval=times)
    assert rows.t.tolist() == times
    assert rows.y[-1] == pytest.approx(sol.y[-1], rel=1e-12)
    some = hd.solve(decaying(), 2.0, **how, **interrupted, save_every=100)
    steps = np.linspace(0.0, 2.0, 11) if "n_steps" in how else np.array([0.0, 2.0])
    others = {t for t in some.t.tolist() if np.abs(steps - t).min() > 1e-12}
    assert len(others) == (len(sol.t_events[0]) if sol.t_events else 1)


@pytest.mark.parametrize("end", [1.0, 1.0 + 4e-16, 2.0])
@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_coinciding_changes_act_in_order(end, order):
    """First as stated, then by events in the order in which they are given."""
    changes = [lambda t, y: 2.0 * y, lambda t, y: y + 1.0]
    first, second = (changes[k] for k in order)
    fire = event(lambda t, y: t - np.nextafter(1.0, 0.0), change=second, terminal=end == 2.0)
    acts = {"breaks": [1.0 - 2e-16], "events": fire, "changes": {1.0: first}}
    sol = hd.solve(decaying(), end, rtol=1e-8, **acts)
    before = hd.exact.relaxation(0.7)(1.0)[0]
    assert sol.y[-1, 0] == pytest.approx(second(1.0, first(1.0, before)), abs=1e-7)
    assert sol.t[-1] == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("step", [1, 2, 3])
@pytest.mark.parametrize("scheme", GIVEN, ids=repr)
def test_rows_and_dense_output_agree_next_to_a_change_in_the_first_steps(scheme, step):
    eq = hd.Equation(C(0.5), lambda t, y: 3.0 - y, -0.9)
    times = np.array([0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.5]) / 16
    how = {"scheme": scheme, "changes": {(step - 0.5) / 16: add(-1.0)}}
    sol, rows = (hd.solve(eq, 1.0, 16, **how, **more) for more in ({}, {"t_eval": times}))
    np.testing.assert_allclose(rows.y, sol(times), rtol=0, atol=1e-12)


@pytest.mark.parametrize("start", [0.0, 0.1, 7.7, 100.1, -1000.3])
@pytest.mark.parametrize("scheme", [hd.ExplicitCaputo(), hd.BDF(2)], ids=str)
def test_a_start_does_not_move_a_dose_nor_the_row_at_its_time(scheme, start):
    """Times less `start` are rounded, in steps, in changes and in `t_eval`."""
    eq, dosed = hd.Equation(C(0.8), decay, 1.0, t_start=start), add(10.0)
    times = start + 0.1 * np.arange(21)
    run = partial(hd.solve, eq, times[-1], 20, scheme=scheme, estimate=False)
    for k in range(1, 20):
        dose = {times[k]: dosed}
        assert np.argmax(np.diff(run(changes=dose, t_eval=times).y[:, 0]) > 5.0) == k - 1
        assert run(changes=dose).t[k : k + 2] == pytest.approx(times[k], rel=1e-14)
    doses = [{t: dosed} for t in times[1:-1]]
    found = hd.ensemble(eq, times[-1], 20, scheme=scheme, y0=np.ones(len(doses)), changes=doses)
    assert np.array_equal(np.argmax(np.diff(found.y[:, :, 0]) > 5.0, axis=1), np.arange(19))


C1 = hd.Caputo(1.0)
FORMS = {
    "number": lambda g: g,
    "tiny": lambda g: lambda t, y: 1e-8 * g(t, y),
    "truth": lambda g: lambda t, y: g(t, y) > 0.0,
    "sign": lambda g: lambda t, y: np.sign(g(t, y)),
    "cube": lambda g: lambda t, y: g(t, y) ** 3,
    "step": lambda g: lambda t, y: np.heaviside(g(t, y), 0.0) - 0.5,
}


class Drawn(NamedTuple):
    """A problem with `n` zeros of each event before `t_end`, at the exact `times`."""

    equation: hd.Equation
    t_end: float
    events: list[Callable]
    times: list[np.ndarray]


def drawn_event(rng, function, change, directions=(0,)):
    """An event in a drawn form, with a drawn one of its directions."""
    found = FORMS[rng.choice(list(FORMS))](function)
    found.change, found.direction = change, int(rng.choice(directions))
    return found


def stop(rng, times):
    """A time between the last two of `times`, and all times but the last."""
    return times[-2] + rng.uniform(0.25, 0.75) * (times[-1] - times[-2]), times[:-1]


def threshold(rng):
    """y' = I - y up to 1, then back by a gap of 1e-8 to 1."""
    force, start, gap = rng.uniform(1.1, 3), rng.uniform(-1, 0.9), 10 ** rng.uniform(-8, 0)
    first, each = np.log((force - start) / (force - 1)), np.log1p(gap / (force - 1))
    t_end, times = stop(rng, first + each * np.arange(rng.integers(2, 20)))
    by = [lambda t, y: y - gap, lambda t, y: 0.0 * y + (1.0 - gap)][rng.integers(2)]
    fire = drawn_event(rng, lambda t, y: y[0] - 1.0, by, (0, 1))
    return Drawn(
        hd.Equation(C1, lambda t, y, p: p[0] - y, start, params=force), t_end, [fire], [times]
    )


def bounce(rng):
    keep, g, height = rng.uniform(0.5, 0.95), 10 ** rng.uniform(-1, 1), rng.uniform(0.1, 10)
    powers = keep ** np.arange(1, rng.integers(2, 9))
    t_end, times = stop(rng, np.sqrt(2 * height / g) * np.cumsum([1, *(2 * powers)]))
    at = float(rng.integers(2))  # the height is kept, or set to 0
    floor = drawn_event(
        rng, lambda t, y: y[0], lambda t, y: np.array([at * y[0], -keep * y[1]]), (0, -1)
    )
    equation = hd.Equation(C1, lambda t, y, p: np.array([y[1], -p[0]]), [height, 0.0], params=g)
    return Drawn(equation, t_end, [floor], [times])


def walls(rng):
    keep, width, speed = rng.uniform(0.7, 1), 10 ** rng.uniform(-2, 1), rng.uniform(0.5, 2)
    n, start = rng.integers(2, 12), rng.uniform(0.1, 0.9) * width
    flights = np.array([width - start, *(width / keep ** np.arange(1, n))]) / speed
    t_end, times = stop(rng, np.cumsum(flights))
    flip = lambda t, y: np.array([y[0], -keep * y[1]])  # noqa: E731
    right = drawn_event(rng, lambda t, y: y[0] - width, flip, (0, 1))
    left = drawn_event(rng, lambda t, y: y[0], flip, (0, -1))
    equation = hd.Equation(C1, lambda t, y: np.array([y[1], 0.0]), [start, speed])
    return Drawn(equation, t_end, [right, left], [times[::2], times[1::2]])


def heated(t, y, p):
    return np.array([(p[1] if y[1] > 0.5 else p[0]) - y[0], 0.0])


def thermostat(rng):
    out, hot, gap = -rng.uniform(0.5, 2), 1 + rng.uniform(0.5, 2), 10 ** rng.uniform(-6, 0)
    start, low = rng.uniform(-1, 0.9 - gap), 1 - gap
    down, up = np.log((1 - out) / (low - out)), np.log((hot - low) / (hot - 1))
    more = np.resize([down, up], rng.integers(1, 15))
    t_end, times = stop(rng, np.cumsum([np.log((hot - start) / (hot - 1)), *more]))
    off = drawn_event(rng, lambda t, y: y[0] - 1.0, lambda t, y: np.array([y[0], 0.0]), (1,))
    on = drawn_event(rng, lambda t, y: y[0] - low, lambda t, y: np.array([y[0], 1.0]), (-1,))
    equation = hd.Equation(C1, heated, [start, 1.0], params=[out, hot])
    return Drawn(equation, t_end, [off, on], [times[::2], times[1::2]])


def kicks(rng):
    """Zeros in time alone, in one direction or both, and of two functions at once."""
    w, phase, up = 10 ** rng.uniform(-1, 1), rng.uniform(0.01, 0.99), int(rng.integers(-1, 2))
    times = (phase + np.arange(rng.integers(4, 40))) * np.pi / w
    t_end, times = stop(rng, times if up == 0 else times[(1 - up) // 2 :: 2])
    events = [
        drawn_event(rng, lambda t, y: np.sin(w * t - phase * np.pi), lambda t, y: y + 1.0, (up,)),
        drawn_event(
            rng, lambda t, y: 3.0 * np.sin(w * t - phase * np.pi), lambda t, y: 2.0 * y, (up,)
        ),
    ]
    return Drawn(hd.Equation(C1, lambda t, y: 0.0 * y, 1.0), t_end, events, [times, times])


KINDS = [threshold, bounce, walls, thermostat, kicks]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("seed", range(8))
def test_each_zero_acts_once_by_a_tolerance(kind, seed):
    rng = np.random.default_rng([26, seed])
    drawn = kind(rng)
    rtol, breaks = 10 ** rng.uniform(-10, -3), ()
    if seed % 2:  # the run stops at some of the zeros
        breaks = np.unique(np.concatenate(drawn.times)[:: rng.integers(1, 4)])
    sol = hd.solve(drawn.equation, drawn.t_end, rtol=rtol, breaks=breaks, events=drawn.events)
    assert sol.status is hd.Status.COMPLETED
    for found, times in zip(sol.t_events, drawn.times, strict=True):
        assert found.size == times.size
        assert np.abs(found - times).max(initial=0.0) <= 100 * rtol * drawn.t_end


@pytest.mark.parametrize("kind", [walls, kicks], ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("seed", range(8))
def test_each_zero_acts_once_on_given_steps(kind, seed):
    """Two and a half steps are between two kicks, thirty between two walls."""
    rng = np.random.default_rng([27, seed])
    drawn = kind(rng)
    closest = np.diff([0.0, *np.unique(np.concatenate(drawn.times))]).min()
    n = int(np.ceil((2.5 if kind is kicks else 30.0) * drawn.t_end / closest))
    sol = hd.solve(drawn.equation, drawn.t_end, n, events=drawn.events, estimate=False)
    for found, times in zip(sol.t_events, drawn.times, strict=True):
        assert found.size == times.size


def test_an_event_that_acts_at_each_step_is_told():
    """A reset by 1e-3, where y rises by 1e-2 in each step."""
    fire = event(lambda t, y: y[0] - 1.0, change=lambda t, y: y - 1e-3)
    eq = hd.Equation(C1, lambda t, y, p: p[0] - y, 0.0, params=2.0)
    with pytest.warns(hd.SolveWarning, match="at one step after the other from t = 0.7"):
        sol = hd.solve(eq, 0.9, 90, events=fire, estimate=False)
    assert sol.t_events[0].size > 15
    assert hd.solve(eq, 0.9, rtol=1e-6, events=fire).success
