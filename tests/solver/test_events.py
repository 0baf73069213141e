"""Events: zeros of functions of the solution, located along an adaptive run."""

import pickle

import numpy as np
import pytest
from problems import half_order_relaxation
from scipy.optimize import brentq
from solver.runs import event

import hereditary as hd

pytestmark = pytest.mark.core

SWING = hd.scenes.oscillator(beta=2.0, gamma=1.0, friction=0.0)  # x = cos t
PRECISE = {"rtol": 1e-12}


def place(t, y):
    return y[0]


def zeros_of_cosine(t_end):
    k = np.arange(int(t_end / np.pi) + 1)
    zeros = (k + 0.5) * np.pi
    return zeros[zeros <= t_end]


def test_zeros_are_located():
    sol = hd.solve(SWING, 50.0, events=[place, event(place, direction=0)], **PRECISE)
    assert sol.status is hd.Status.COMPLETED
    for times, values in zip(sol.t_events, sol.y_events, strict=True):
        np.testing.assert_allclose(times, zeros_of_cosine(50.0), rtol=0, atol=1e-10)
        assert values.shape == (16, 1)
        assert np.abs(values).max() < 1e-14


@pytest.mark.parametrize(("direction", "first"), [(1, 1.5), (-1, 0.5), (2.0, 1.5), (-0.1, 0.5)])
def test_direction(direction, first):
    """Upwards x = cos t goes through 0 at 3 pi / 2, downwards at pi / 2."""
    sol = hd.solve(SWING, 30.0, events=event(place, direction=direction), **PRECISE)
    expected = (first + 2 * np.arange(5)) * np.pi
    np.testing.assert_allclose(sol.t_events[0], expected[expected < 30], rtol=0, atol=1e-10)


def test_a_terminal_event_ends_the_run():
    sol = hd.solve(SWING, 30.0, events=event(place, terminal=True), **PRECISE)
    assert sol.status is hd.Status.EVENT
    assert sol.success
    assert "a terminal event ended the run" in sol.message
    assert sol.t[-1] == sol.t_events[0][0] == pytest.approx(np.pi / 2, abs=1e-10)
    assert sol.y[-1, 0] == sol.y_events[0][0, 0] == pytest.approx(0, abs=1e-14)
    assert sol.ydot[-1, 0] == pytest.approx(-1, abs=1e-10)
    assert np.all(np.diff(sol.t) > 0)
    np.testing.assert_allclose(sol.y[:, 0], np.cos(sol.t), atol=1e-11)
    np.testing.assert_allclose(sol(1.0), np.cos(1.0), atol=1e-11)
    with pytest.raises(ValueError, match="t must lie in"):
        sol(sol.t[-1] + 1e-6)


def test_rows_end_with_a_terminal_event():
    stop, t_eval = event(place, terminal=True), np.arange(0, 30, 0.1)
    at_times = hd.solve(SWING, 30.0, events=stop, t_eval=t_eval, **PRECISE)
    assert at_times.t.tolist() == t_eval[t_eval < np.pi / 2].tolist()
    assert at_times.t_events[0][0] == pytest.approx(np.pi / 2, abs=1e-10)
    few = hd.solve(SWING, 30.0, events=stop, save_every=10**6, **PRECISE)
    assert few.t.tolist() == [0.0, few.t_events[0][0]]


def test_several_events():
    """Each has its own times; a terminal one cuts all of them off."""
    rising, slow = event(place, direction=1), event(lambda t, y: y[0] - 0.5)
    never, late = event(lambda t, y: y[0] - 2.0), event(lambda t, y: t - 10.0, terminal=True)
    sol = hd.solve(SWING, 30.0, events=[rising, slow, never, late], **PRECISE)
    assert sol.status is hd.Status.EVENT
    assert sol.t[-1] == pytest.approx(10.0, abs=1e-13)
    third = np.pi / 3
    expected = [[1.5 * np.pi], [third, 2 * np.pi - third, 2 * np.pi + third], [], [10.0]]
    for times, values, known in zip(sol.t_events, sol.y_events, expected, strict=True):
        np.testing.assert_allclose(times, known, rtol=0, atol=1e-10)
        assert values.shape == (len(known), 1)
    np.testing.assert_allclose(sol.y_events[1], 0.5, atol=1e-13)


def test_of_two_terminal_events_the_first_one_counts():
    events = [event(lambda t, y, s=s: t - s, terminal=True) for s in (0.7, 0.3, 0.5)]
    sol = hd.solve(SWING, 1.0, events=events, **PRECISE)
    assert sol.t[-1] == pytest.approx(0.3, abs=1e-14)
    assert [times.size for times in sol.t_events] == [0, 1, 0]


def test_events_that_never_happen():
    for never in (lambda t, y: 1.0, lambda t, y: y[0] + 3.0, lambda t, y: -1.0 - t):
        sol = hd.solve(SWING, 5.0, rtol=1e-6, events=never)
        assert sol.status is hd.Status.COMPLETED
        assert sol.t_events[0].shape == (0,)
    assert hd.solve(SWING, 5.0, rtol=1e-6).t_events == []


@pytest.mark.parametrize("breaks", [(), (1.0,), (0.5, 1.0, 1.5)])
def test_a_zero_at_the_end_of_a_step_counts_once(breaks):
    """A step ends at each break; t = 0 itself is no event, the end of the run is one."""
    for when, n in ((0.0, 0), (1.0, 1), (2.0, 1)):
        at = {"events": lambda t, y, when=when: t - when, "breaks": breaks}
        sol = hd.solve(SWING, 2.0, rtol=1e-8, **at)
        assert sol.t_events[0].tolist() == [when] * n


@pytest.mark.parametrize("level", [1 - 1e-6, 1 - 1e-3, 0.9, 0.5, 0.2])
def test_relaxation_down_to_a_level(level):
    """Also in the first step, where the solution falls like the root of t."""
    sol = hd.solve(hd.scenes.relaxation(0.5), 20.0, events=lambda t, y: y[0] - level, **PRECISE)
    t = brentq(lambda s: half_order_relaxation([s])[0, 0] - level, 1e-14, 20, xtol=1e-16)
    assert sol.t_events[0].size == 1
    assert sol.t_events[0][0] == pytest.approx(t, rel=1e-10, abs=1e-16)


def test_events_go_on_where_a_run_goes_on():
    """Stopped in between or by an event, no zero is lost and none is found twice."""
    t_eval = np.arange(0, 31, 5.0)
    found, state = [], None
    for t_end in t_eval[1:]:
        sol = hd.solve(SWING, t_end, rtol=1e-11, events=place, resume=state)
        found, state = [*found, *sol.t_events[0]], sol.state
    np.testing.assert_allclose(found, zeros_of_cosine(30.0), atol=1e-8)


def test_after_a_terminal_event_a_run_goes_on_from_it():
    """Zeros that follow soon after the one that ended the run are found by the next."""
    fast = event(lambda t, y: np.sin(10 * t), terminal=True)
    found, state = [], None
    for _ in range(5):
        sol = hd.solve(SWING, 100.0, rtol=1e-11, events=fast, resume=state)
        assert sol.status is hd.Status.EVENT
        found, state = [*found, *sol.t_events[0]], sol.state
    np.testing.assert_allclose(found, np.arange(1, 6) * np.pi / 10, atol=1e-9)


def test_many_zeros_in_a_step_are_told_apart():
    """Steps of such a smooth solution are long; of every step eight parts are looked at."""
    sol = hd.solve(SWING, 10.0, rtol=1e-6, events=lambda t, y: np.sin(5 * t))
    longest = np.diff(sol.t).max()
    assert longest < 8 * np.pi / 5
    np.testing.assert_allclose(sol.t_events[0], np.arange(1, 16) * np.pi / 5, atol=1e-12)


def test_shorter_steps_see_a_fast_event_beside_a_slow_solution():
    equation, fast = hd.scenes.relaxation(0.5), event(lambda t, y: np.sin(5 * t))
    expected = np.arange(1, 160) * np.pi / 5
    assert hd.solve(equation, 100.0, rtol=1e-6, events=fast).t_events[0].size < 159
    sol = hd.solve(equation, 100.0, rtol=1e-6, events=fast, max_step=2.0)
    np.testing.assert_allclose(sol.t_events[0], expected, atol=1e-12)


@pytest.mark.parametrize("terminal", [2, np.int64(2), False, 0, None, 50])
def test_a_number_of_zeros_ends_the_run(terminal):
    sol = hd.solve(SWING, 30.0, events=event(place, terminal=terminal), **PRECISE)
    ended = terminal == 2
    assert sol.status == ("event" if ended else "completed")
    expected = zeros_of_cosine(5.0 if ended else 30.0)
    np.testing.assert_allclose(sol.t_events[0], expected, atol=1e-10)
    assert (sol.t[-1] == sol.t_events[0][-1]) == ended


@pytest.mark.parametrize(
    "shape", [lambda v: np.array([v]), np.float32, lambda v: np.array(v), lambda v: np.array([[v]])]
)
def test_one_number_of_any_shape(shape):
    sol = hd.solve(SWING, 30.0, rtol=1e-10, events=lambda t, y: shape(y[0] - 0.25))
    plain = hd.solve(SWING, 30.0, rtol=1e-10, events=lambda t, y: y[0] - 0.25)
    np.testing.assert_allclose(sol.t_events[0], plain.t_events[0], atol=1e-6)


@pytest.mark.parametrize("truth", [bool, np.bool_, lambda v: np.array([v])])
def test_changes_of_a_truth_value(truth):
    """Found where it switches, in either direction, also where it is False at first."""
    below = event(lambda t, y: truth(y[0] < 0.5))
    falling = event(lambda t, y: truth(y[0] < 0.5), direction=-1)
    sol = hd.solve(SWING, 10.0, events=[below, falling], **PRECISE)
    third = np.pi / 3
    expected = [third, 5 * third, 7 * third]
    np.testing.assert_allclose(sol.t_events[0], expected, atol=1e-10)
    np.testing.assert_allclose(sol.t_events[1], expected[1:2], atol=1e-10)


@np.errstate(invalid="ignore")
def test_where_a_function_is_not_defined_there_is_no_zero():
    """log(x + 1/2) is NaN for more than a third of each turn, and square roots meet 0 there."""
    sol = hd.solve(SWING, 10.0, rtol=1e-8, events=lambda t, y: np.log(y[0] + 0.5))
    third = np.pi / 3
    np.testing.assert_allclose(sol.t_events[0], [third, 5 * third, 7 * third], atol=1e-7)
    roots = hd.solve(SWING, 10.0, rtol=1e-8, events=lambda t, y: 1 + np.sqrt(y[0]))
    assert roots.t_events[0].size == 0
    gap = hd.solve(SWING, 10.0, rtol=1e-8, events=lambda t, y: np.sqrt(abs(t - 5) - 1e-4) * (t - 5))
    assert gap.t_events[0].size == 0


def fails_after(limit, how):
    def event(t, y):
        if t > limit:
            return how(t)
        return y[0]

    return event


@pytest.mark.parametrize(
    ("how", "told"),
    [
        (lambda t: 1 / (t - t), "event raised ZeroDivisionError: .* at t = 3"),
        (lambda t: None, "event returned None at t = 3"),
        (lambda t: np.ones(2), r"event returned \[1., 1.\] at t = 3"),
        (lambda t: 1j, "event returned 0.\\+1.j at t = 3"),
    ],
)
def test_an_event_function_that_fails_ends_the_run(how, told):
    """With a status of its own, at the last step before, and the run can go on from there."""
    with pytest.warns(hd.SolveWarning, match=told):
        sol = hd.solve(SWING, 10.0, rtol=1e-8, events=[fails_after(3.0, how), place])
    assert sol.status is hd.Status.EVENT_FAILED
    assert not sol.success
    assert 1.6 < sol.t[-1] <= 3.1
    np.testing.assert_allclose(sol.y[:, 0], np.cos(sol.t), atol=1e-7)
    for times in sol.t_events:
        np.testing.assert_allclose(times, [np.pi / 2], atol=1e-7)
    rest = hd.solve(SWING, 10.0, events=place, resume=sol.state)
    assert rest.t[0] == sol.t[-1]
    np.testing.assert_allclose(rest.t_events[0], zeros_of_cosine(10.0)[1:], atol=1e-7)


@pytest.mark.parametrize("how", [{"rtol": 1e-8}, {"n_steps": 1000}])
def test_an_event_that_writes_into_y_ends_the_run_and_changes_nothing(how):
    def writing(t, y):
        value = y[0] - 0.1
        if t > 3.0:
            y[0] = 7.0
        return value

    plain = hd.solve(SWING, 10.0, **how)
    with pytest.warns(hd.SolveWarning, match=r"writing wrote into y, .*`change`.* at t = 3"):
        sol = hd.solve(SWING, 10.0, events=writing, **how)
    assert sol.status is hd.Status.EVENT_FAILED
    assert sol.t.size >= 5
    assert np.array_equal(sol.y, plain.y[: sol.t.size])


def test_a_change_may_write_into_its_y():
    def doubled(t, y):
        y *= 2.0
        return y

    ends = [
        hd.solve(SWING, 4.0, rtol=1e-8, events=event(place, change=change)).y
        for change in (doubled, lambda t, y: 2.0 * y)
    ]
    assert np.array_equal(*ends)


def test_a_terminal_event_before_a_failure_is_what_ends_the_run():
    stop = event(place, terminal=True)
    sol = hd.solve(SWING, 10.0, rtol=1e-8, events=[fails_after(2.0, lambda t: None), stop])
    assert sol.status is hd.Status.EVENT
    assert sol.t[-1] == pytest.approx(np.pi / 2, abs=1e-7)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
@pytest.mark.parametrize("level", [0.3, 0.7, 1.0])
def test_a_run_does_not_stop_twice_at_one_zero(level, rtol):
    """The solution at the end is known by its tolerance: the zero may lie on either side of it."""

    def charge():  # another function object of the same contents: as in another process
        return event(lambda t, y: y[0] - level, terminal=True)

    equation = hd.Equation(hd.Caputo(0.8), lambda t, y: 1.5 - y, 0.0)
    first = hd.solve(equation, 10.0, rtol=rtol, events=charge())
    assert first.status is hd.Status.EVENT
    state = pickle.loads(pickle.dumps(first.state))
    second = hd.solve(equation, 10.0, events=charge(), resume=state)
    assert second.status is hd.Status.COMPLETED
    assert second.t_events[0].size == 0


def test_nothing_is_lost_before_the_first_row_asked_for():
    """Ends before it come with what there is: a state and the event."""
    swing = hd.scenes.oscillator(beta=1.5, gamma=1.0)
    sol = hd.solve(swing, 10.0, rtol=1e-8, events=event(place, terminal=True), t_eval=[8.0, 9.0])
    assert sol.status is hd.Status.EVENT
    assert (sol.t.shape, sol.y.shape, sol.ydot.shape) == ((0,), (0, 1), (0, 1))
    assert sol.t_events[0].size == 1
    assert repr(sol).endswith("0 rows of 1 components)")
    rest = hd.solve(swing, 10.0, resume=sol.state, t_eval=[8.0, 9.0])
    np.testing.assert_allclose(rest.y, hd.solve(swing, 10.0, rtol=1e-8)(rest.t), atol=1e-6)


def test_signs_in_a_state_are_those_of_the_run():
    """A state is made when it is asked for; an event function may be another by then."""

    class Below:
        level = 0.1

        def __call__(self, t, y):
            return y[0] - self.level

    below, eq = Below(), hd.Equation(hd.Caputo(0.7), lambda t, y: -y, 1.0)
    first = hd.solve(eq, 1.0, rtol=1e-8, events=below)
    below.level = 0.45
    assert hd.solve(eq, 3.0, resume=first.state, events=below).t_events[0].size == 0


def test_two_zeros_between_two_looks_are_found():
    """y = sin t exceeds 0.9999 for 0.03 of a time at each of its tops."""
    top = lambda t, y: y[0] - 0.9999  # noqa: E731
    sol = hd.solve(hd.Equation(hd.Caputo(2.0), lambda t, y: -y, [0.0, 1.0]), 30.0, events=top)
    width = np.arccos(0.9999)
    exact = (np.pi / 2 + 2 * np.pi * np.arange(5)[:, None] + [-width, width]).ravel()
    assert sol.t_events[0] == pytest.approx(exact, abs=1e-4)
