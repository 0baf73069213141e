"""Events, dense output and breaks on given steps: for every scheme, as of collocation."""

import pickle
from functools import cache

import numpy as np
import pytest
from cases import GIVEN
from solver.runs import event

import hereditary as hd

HISTORIES = [hd.SumOfExponentials(), hd.FFT(), hd.Direct()]


def reaching(level):
    return event(lambda t, y: y[0] - level, terminal=True)


def oscillator():
    return hd.Equation([hd.Caputo(1.8), 0.2 * hd.Caputo(0.6)], lambda t, x: -4 * x, [1.0, 0.5])


@pytest.mark.parametrize("history", HISTORIES, ids=repr)
@pytest.mark.parametrize("scheme", GIVEN, ids=repr)
def test_a_terminal_event_ends_the_run_and_it_goes_on_from_there(scheme, history):
    """The state is that of the first step that is not before the event, bit for bit."""
    equation = hd.scenes.relaxation(0.6)
    whole = hd.solve(equation, 3.0, 300, scheme=scheme, history=history)
    first = hd.solve(equation, 3.0, 300, scheme=scheme, history=history, events=reaching(0.5))
    assert first.status == "event"
    assert first.t[-1] == first.t_events[0][0]
    assert first.y[-1, 0] == pytest.approx(0.5, abs=1e-14)
    np.testing.assert_array_equal(first.y[:-1], whole.y[: len(first.y) - 1])
    n = first.state.how.n
    assert whole.t[n - 1] < first.t[-1] <= whole.t[n]
    state = pickle.loads(pickle.dumps(first.state))
    later = hd.solve(equation, 3.0, resume=state, events=reaching(0.5))
    assert later.status == "completed"
    np.testing.assert_array_equal(later.y, whole.y[n:])


def test_rows_asked_for_do_not_depend_on_events():
    equation, times = oscillator(), [0.0013, 0.0049, 0.5, 1.23456, 3.0]
    plain = hd.solve(equation, 3.0, 600, t_eval=times)
    watched = hd.solve(equation, 3.0, 600, t_eval=times, events=lambda t, y: y[0] - 0.5)
    np.testing.assert_allclose(watched.y, plain.y, rtol=1e-13)
    np.testing.assert_allclose(watched.ydot, plain.ydot, rtol=1e-10)
    some = hd.solve(equation, 3.0, 600, save_every=7, events=lambda t, y: y[0] - 0.5)
    assert np.array_equal(some.y, hd.solve(equation, 3.0, 600, save_every=7).y)


# D^0.6 y = 1 - y from t = 2 on, -y before; at 2 itself as the names say.
at = cache(lambda: hd.Equation(hd.Caputo(0.6), lambda t, y: (1.0 if t >= 2.0 else 0.0) - y, 0.5))
after = cache(lambda: at().replace(rhs=lambda t, y: (1.0 if t > 2.0 else 0.0) - y))


@pytest.mark.parametrize("scheme", GIVEN, ids=repr)
def test_steps_see_a_jump_from_their_own_side(scheme):
    """So that the value at the jump itself plays no part."""
    found, same = (hd.solve(e(), 4.0, 400, scheme=scheme, breaks=[2.0]) for e in (at, after))
    assert np.array_equal(found.y, same.y)
    exact = hd.solve(at(), 4.0, rtol=1e-10, breaks=[2.0])
    assert np.abs(found(3.0) - exact(3.0))[0] < 1.1e-3
    before = hd.solve(hd.scenes.relaxation(0.6, 1.0, 0.5), 2.0, 200, scheme=scheme)
    np.testing.assert_allclose(found.y[:201], before.y, rtol=1e-12)


def test_breaks_on_a_mesh_and_in_a_resumed_run():
    half = 2 * np.linspace(0, 1, 101) ** 2
    how = {"mesh": np.append(half, 2 + half[1:]), "scheme": hd.L2(), "breaks": [2.0]}
    sols = [hd.solve(e(), 4.0, **how) for e in (at, after)]
    assert np.array_equal(sols[0].y, sols[1].y)
    exact = hd.solve(at(), 4.0, rtol=1e-10, breaks=[2.0])
    assert np.abs(sols[0](3.0) - exact(3.0))[0] < 2.5e-3  # of the long step before the jump
    first = hd.solve(at(), 2.0, 200, breaks=[2.0])
    later = hd.solve(at(), 4.0, resume=first.state, breaks=[2.0])
    whole = hd.solve(at(), 4.0, 400, breaks=[2.0])
    assert np.array_equal(later.y, whole.y[200:])


@pytest.mark.parametrize("scheme", [hd.ExplicitCaputo(), hd.BDF(2)])
def test_an_event_counts_though_the_run_blows_up_behind_it(scheme):
    """In the same stretch of steps; the state stands at the first step not before the event."""
    equation = hd.Equation(hd.Caputo(1.0), lambda t, y: y**2, 1.0)
    sol = hd.solve(equation, 2.0, 400, scheme=scheme, events=reaching(5.0))
    assert sol.status == "event"
    assert 0 <= sol.state.t - sol.t[-1] < 2.0 / 400
    assert sol.t[-1] == pytest.approx(0.8, abs=0.02)


def test_an_event_counts_though_steps_cannot_go_on_behind_it():
    for order in (1.0, 0.7):
        equation = hd.Equation(hd.Caputo(order), lambda t, y: np.where(y < 0.7, 1.0, -1.0), 0.5)
        for level in (0.6, 0.69, 0.6999):
            sol = hd.solve(equation, 2.0, rtol=1e-3, events=reaching(level))
            assert sol.status == "event"
            assert sol.state.t == sol.t[-1]
            assert sol.y[-1, 0] == pytest.approx(level, abs=1e-6)


def test_the_last_row_asked_for_is_kept_though_the_last_step_misses_it():
    """By rounding, as far as runs may be ended beside a step."""
    equation = hd.scenes.relaxation(0.5)
    begun, end = hd.solve(equation, 1.0, 100), 2.0 * (1 + 1e-10)
    assert hd.solve(equation, end, resume=begun.state, t_eval=[1.5, end]).t.tolist() == [1.5, end]
    mesh = np.linspace(0, 1, 101) ** 2 * (1 - 5e-13)
    sol = hd.solve(equation, 1.0, mesh=mesh, scheme=hd.L1(), t_eval=[0.5, 1.0])
    assert sol.t.tolist() == [0.5, 1.0]
    assert np.all(np.isfinite(sol.y))


def test_dense_output_in_the_first_step_does_not_depend_on_an_event_in_it():
    equation = hd.scenes.relaxation(0.5)
    whole = hd.solve(equation, 1.0, 10, scheme=hd.L1())
    ended = hd.solve(equation, 1.0, 10, scheme=hd.L1(), events=reaching(0.9))
    assert ended.t[-1] < 0.1
    np.testing.assert_allclose(ended(0.004), whole(0.004), rtol=1e-13)


def test_equal_terms_and_initial_values_share_a_plan_and_others_have_their_own():
    """A plan depends on scheme, step, terms and y(0); runs in any order give the same bits."""

    first = hd.Equation(hd.Caputo(0.7), lambda t, y, p: -p[0] * y, 1.0, params=[1.0])
    changed = {
        "params": first.replace(params=[2.0]),
        "y0": first.replace(y0=2.0),
        "terms": first.replace(terms=hd.Caputo(0.8)),
    }
    runs = [(first, 40, hd.L1()), (first, 50, hd.L1()), (first, 40, hd.ExplicitCaputo())]
    runs += [(equation, 40, hd.L1()) for equation in changed.values()]
    found = [
        [hd.solve(one, 1.0, n, scheme=scheme, estimate=False).y for one, n, scheme in order]
        for order in (runs, runs[::-1])
    ]
    assert all(map(np.array_equal, found[0], found[1][::-1]))
    assert np.unique([rows[-1, 0] for rows in found[0]]).size == len(runs)
    # linear: twice the initial value gives twice the solution
    assert np.array_equal(found[0][4], 2 * found[0][0])
