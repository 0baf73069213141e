"""Every run on given steps tells its true error, and any solution can be checked."""

import pickle
import signal
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
from solver.runs import event

import hereditary as hd

pytestmark = pytest.mark.estimates
# Estimates compare with a run to 1e-4, so they know errors from twice that on.
KNOWN = 2e-4


def driven(t, y, p):
    return -p[0] * y + p[1] * np.sin(p[2] * t)


def equation(order=0.8, y0=None, params=(1.0, 1.0, 2.0)):
    y0 = y0 or ([1.0] if order <= 1 else [[1.0], [0.0]])
    return hd.Equation(hd.Caputo(order), driven, y0, params=params)


def quietly(eq, *how, **more):
    """Return a solution and the warnings of its run."""
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        sol = hd.solve(eq, *how, **more)
    return sol, [str(one.message) for one in seen]


def error(sol, truth):
    """Return the largest error of a component relative to its size."""
    return float(np.max(np.abs(sol.y - truth).max(axis=0) / np.abs(truth).max(axis=0)))


def assert_true(sol, truth):
    """Assert that an estimate is within 10 per cent of the error, or says that it is small."""
    off, told = error(sol, truth), sol.stats["error_estimate"]
    assert 0.9 * off <= told <= max(1.1 * off, KNOWN), (off, told)
    assert told >= 1e-4


def test_estimates_of_drawn_problems_are_true_and_no_large_error_is_silent():
    rng, schemes = np.random.default_rng(57), [hd.ExplicitCaputo(), hd.BDF(2), hd.L1(), hd.Adams()]
    for number in range(60):
        order, n = rng.uniform(0.2, 1.9), int(rng.choice([40, 150, 1000]))
        eq, t_end = equation(order, params=rng.uniform(0.3, 2.0, 3)), rng.uniform(5.0, 30.0)
        sol, seen = quietly(eq, t_end, n, scheme=schemes[number % 4])
        if not sol.success:
            continue
        truth = hd.solve(eq, t_end, rtol=1e-9, t_eval=sol.t).y
        if error(sol, truth) > 0.1:
            assert seen
        if sol.stats["error_estimate"] is not None:
            assert_true(sol, truth)


def dose(t, y):
    return y + 1.0


low = event(lambda t, y: y[0] - 0.3, direction=-1, change=dose)


@pytest.mark.parametrize(
    "how",
    [
        {"n_steps": 1000, "breaks": [2.0]},
        {"mesh": hd.graded(60, 2.0), "scheme": hd.L1()},
        {"n_steps": 1000, "changes": {1.0: dose, 3.5: dose}},
        {"n_steps": 1000, "events": low},
        {"n_steps": 1000, "switches": low},
        {"n_steps": 1000, "t_eval": np.linspace(0.5, 5.0, 17)},
        {"n_steps": 9000, "save_every": 2},
    ],
    ids=lambda how: next(iter(sorted(how.keys() - {"n_steps"}))),
)
def test_estimates_know_what_acts_on_the_way(how):
    eq = equation(params=(1.0, 0.0, 1.0))
    sol, seen = quietly(eq, 5.0, **how)
    given = {key: how[key] for key in how.keys() & {"breaks", "changes", "events", "switches"}}
    truth = hd.solve(eq, 5.0, rtol=1e-9, **given)
    jumps = [one.t[1:][np.diff(one.t) == 0] for one in (sol, truth)]
    apart = np.ones(sol.t.size, dtype=bool)
    if "n_steps" in how and jumps[0].size:  # rows between both times of a jump are not compared
        for first, last in np.sort(jumps, axis=0).T:
            apart &= (sol.t < first - 1e-9) | (sol.t > last + 1e-9)
    off = np.abs(sol.y - truth(sol.t))[apart].max() / np.abs(truth.y).max()
    assert 0.9 * off <= sol.stats["error_estimate"] <= max(1.1 * off, KNOWN)
    assert not seen


def test_a_delay_is_known():
    eq = hd.Equation(hd.Caputo(0.9), lambda t, y, past: -past[0], [1.0], memory=hd.Delay(1.0))
    sol, _ = quietly(eq, 8.0, 200)
    assert_true(sol, hd.solve(eq, 8.0, rtol=1e-9)(sol.t))


@pytest.mark.parametrize(
    ("order", "y0", "t_end", "rows"),
    [(2, [1.0, 0.0], 10.0, [np.pi / 2]), (1, [1.0], 30.0, [29.0, 30.0])],
    ids=["zero", "tail"],
)
def test_chosen_rows_where_the_solution_is_small_have_the_error_of_its_size(order, y0, t_end, rows):
    """A run to 1e-4 does not know these values of y, 0 and 1e-13, relative to themselves."""
    eq = hd.Equation(hd.Caputo(order), lambda t, y: -y, y0)
    sol, seen = quietly(eq, t_end, 10_000, scheme=hd.BDF(2), t_eval=rows)
    assert sol.stats["error_estimate"] == 1e-4
    assert not seen
    np.testing.assert_allclose(sol.accuracy.size, 1.0, rtol=0.01)
    np.testing.assert_allclose(sol.check().size, 1.0, rtol=0.01)


def test_an_accurate_run_that_misses_all_of_a_force_is_no_proof():
    def pulse(t, y):
        return (100.0 if 3.0 < t < 3.02 else 0.0) - y

    sol, seen = quietly(hd.Equation(hd.Caputo(0.9), pulse, 0.0), 100.0, 20_000)
    assert sol.stats["error_estimate"] == 1.0
    assert len(seen) == 1


@pytest.mark.parametrize("stored", [False, True])
def test_a_resumed_run_knows_its_error(stored):
    """The state has that of an accurate run beside it; with other parameters too."""
    eq = equation()
    first, _ = quietly(eq, 4.0, 100)
    state = pickle.loads(pickle.dumps(first.state)) if stored else first.state
    for params in (None, [0.5, 1.0, 1.0]):
        rest, _ = quietly(eq, 8.0, resume=state, params=params)
        close = hd.solve(eq, 4.0, rtol=1e-9)
        truth = hd.solve(eq, 8.0, resume=close.state, params=params)
        assert_true(rest, truth(np.maximum(rest.t, truth.t[0])))
    through, _ = quietly(eq, 8.0, 200)
    rest, _ = quietly(eq, 8.0, resume=state)
    assert np.array_equal(rest.y, through.y[100:])


def test_a_run_after_one_without_an_estimate_has_none():
    first = hd.solve(equation(), 4.0, 100, estimate=False)
    stats = hd.solve(equation(), 8.0, resume=first.state).stats
    assert stats["error_estimate"] is None
    assert stats["error_unknown"] == "the run that this one resumes has no estimate"


def test_a_run_goes_on_with_its_estimate_after_an_event_has_ended_it():
    eq = equation(params=(1.0, 0.0, 1.0))
    half = event(lambda t, y: y[0] - 0.6, terminal=True)
    first, _ = quietly(eq, 5.0, 100, events=half)
    assert first.t[-1] < 0.5
    rest, _ = quietly(eq, 5.0, resume=first.state)
    assert_true(rest, hd.solve(eq, 5.0, rtol=1e-9)(rest.t))


def test_reasons_are_about_the_run():
    eq = equation()
    stats = hd.solve(eq, 5.0, 100, t_eval=[0.0]).stats
    assert stats["error_unknown"] == "no row is after the start"
    stats = hd.solve(eq, 30.0, resume=hd.solve(eq, 1.0, 100).state).stats
    assert stats["error_unknown"].endswith("the end of its history, got a run to 30.0")
    sol, _ = quietly(growing(), 3.0, 60)
    assert not sol.success
    assert sol.stats["error_estimate"] is None
    assert "no success" in sol.stats["error_unknown"]


def test_what_an_accurate_run_does_not_solve_in_few_steps_is_not_resolved():
    quick = hd.Equation(hd.Caputo(0.9), lambda t, y: np.sin(300.0 * t) - y, 0.0)
    van_der_pol = hd.Equation(
        hd.Caputo(0.9), lambda t, y: np.array([y[1], 4.2 * (1 - y[0] ** 2) * y[1] - y[0]]), [1, 0.5]
    )
    for eq, t_end, n, scheme in ((quick, 20.0, 1000, hd.L1()), (van_der_pol, 40.0, 700, None)):
        sol, (seen,) = quietly(eq, t_end, n, scheme=scheme)
        assert sol.stats["error_estimate"] is None
        assert sol.stats["error_unknown"] in seen
        assert "takes more than 2" in seen
        assert "hardly resolve the solution: errors are about" in seen
    _, (seen,) = quietly(eq, t_end, n, scheme=scheme, save_every=n)
    assert "errors" not in seen  # the accurate run reached no row after the start


def test_short_first_steps_of_an_accurate_run_do_not_count_as_many():
    x = np.arange(1, 51) / 51
    spot = np.exp(-200 * ((x[:, None] - 0.35) ** 2 + (x[None, :] - 0.6) ** 2))
    eq = hd.scenes.subdiffusion(0.5, 50, dimensions=2, u0=spot)
    sol, seen = quietly(eq, 0.02, 200, scheme=hd.BDF(2), save_every=10)
    assert not any("takes more than" in text for text in seen)
    assert "takes more than" not in sol.stats.get("error_unknown", "")


def slow(t, y):
    until = time.thread_time() + 2e-3
    while time.thread_time() < until:
        pass
    return -5.0 * y


@pytest.mark.filterwarnings("ignore::hereditary.PythonFunctionWarning")
def test_no_warning_tells_how_far_an_accurate_run_came_in_its_time(monkeypatch):
    monkeypatch.setattr("hereditary.solver.accuracy._MIN_SECONDS_ALLOWED", 0.0)
    eq = hd.Equation(hd.Caputo(0.5), slow, 1.0)
    quietly(eq, 20.0, 40, scheme=hd.BDF(2))  # the first run may compile, which takes its time too
    sol, seen = quietly(eq, 20.0, 40, scheme=hd.BDF(2))
    assert "takes longer than this run" in sol.stats["error_unknown"]
    assert not seen
    assert sol.check().largest.max() > 0.05


def test_a_map_and_what_collocation_refuses_have_no_estimate():
    eq = hd.Equation(hd.Caputo(0.8), lambda n, u: 1.5 * u * (1 - u), 0.3)
    stats = hd.solve(eq, 50, 50, scheme=hd.GrunwaldLetnikov(map=True)).stats
    assert stats["error_estimate"] is None
    assert "map" in stats["error_unknown"]
    eq = hd.Equation(hd.Caputo(lambda t: 0.8 + 0.0 * t), driven, [1.0], params=(1, 1, 1))
    sol, _ = quietly(eq, 2.0, 50, changes={1.0: dose})
    assert sol.stats["error_estimate"] is None
    assert "a run to rtol=1e-4 is not possible" in sol.stats["error_unknown"]


growing = cache(lambda: hd.Equation(hd.Caputo(1), lambda t, y: y * y, 1.0))


@pytest.mark.parametrize("t_eval", [None, [2.9, 3.0]])
def test_steps_beyond_the_time_at_which_the_solution_ends_are_no_success_in_silence(t_eval):
    sol, (seen,) = quietly(growing(), 3.0, 10, t_eval=t_eval)
    assert sol.success
    assert sol.stats["error_estimate"] is None
    assert "ends at t = 1: the solution stopped being finite, which 10 steps" in seen


def test_beyond_the_end_of_an_accurate_run_errors_are_not_unknown_in_silence():
    """No step is short enough for a force that is infinite at a time that nobody named."""
    rng, schemes, early = np.random.default_rng(7), [None, hd.BDF(2), hd.L1()], 0
    for number in range(30):
        order, n, jump = rng.uniform(0.2, 0.35), int(rng.choice([50, 200])), rng.uniform(1.0, 9.0)
        eq = hd.Equation(
            hd.Caputo(order), lambda t, y, p: p[1] * np.abs(t - p[0]) ** -0.4 - y, 1.0,
            params=[jump, 10.0 ** rng.uniform(0.0, 2.0)],
        )  # fmt: skip
        sol, seen = quietly(eq, 10.0, n, scheme=schemes[number % 3])
        unknown = sol.stats.get("error_unknown")
        if unknown is None:
            continue
        early += 1
        assert unknown in seen[0]
        assert "later errors are unknown" in seen[0]
        t, y = sol.t[sol.t < jump], sol.y[sol.t < jump]
        near = hd.solve(eq, t[-1], rtol=1e-8)
        worst = 100 * np.abs(y - near(t)).max() / np.abs(near(t)).max()
        told = float(seen[0].partition("errors are about ")[2].partition(" %")[0])
        assert told == pytest.approx(worst, rel=0.1, abs=0.02)
        with pytest.warns(hd.SolveWarning, match="ended early"):
            found = sol.check()
        assert found.t[-1] == t[-1]
        assert found.ended in repr(found)
        assert f"t = {jump:g}" in found.ended
        assert 100 * found.largest[0] == pytest.approx(worst, rel=0.01)
    assert early > 20


class Pressed:
    """The right-hand side -y; its call number `at` comes with Ctrl-C."""

    calls, at = 0, 0

    def __call__(self, t, y):
        Pressed.calls += 1
        if Pressed.calls == Pressed.at:
            signal.raise_signal(signal.SIGINT)
        return -y


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.filterwarnings("ignore::hereditary.PythonFunctionWarning")
def test_ctrl_c_ends_a_loop_of_runs_and_keeps_the_finished_one(monkeypatch):
    eq = hd.Equation(hd.Caputo(0.8), Pressed(), 1.0)
    # all steps in one part of the run, however long a call takes: a run ends between its parts
    monkeypatch.setattr("hereditary.given.fixed_stepper._SECONDS_PER_CALL", 60.0)
    calls = []
    for estimate in (False, True):
        monkeypatch.setattr(Pressed, "calls", 0)
        whole = hd.solve(eq, 5.0, 100, estimate=estimate)
        calls.append(Pressed.calls)
    alone, total = calls
    reasons = set()
    for at in range(alone // 2, total + 1, 3):
        monkeypatch.setattr(Pressed, "calls", 0)
        monkeypatch.setattr(Pressed, "at", at)
        with pytest.raises(KeyboardInterrupt) as caught:
            hd.solve(eq, 5.0, 100)
        kept = caught.value.result
        assert kept.success
        np.testing.assert_array_equal(kept.y, whole.y)
        assert kept.state.t == 5.0
        reasons.add(kept.stats.get("error_unknown"))
    assert "Ctrl-C ended a run to rtol=1e-4" in reasons
    monkeypatch.setattr(Pressed, "at", Pressed.calls + 50)
    with pytest.raises(KeyboardInterrupt):
        whole.check()


def turns(t, y, dy, p):
    dy[0] = p[0] * y[0] + p[1] * y[1]
    dy[1] = p[0] * y[1] - p[1] * y[0]


@pytest.mark.parametrize("scheme", [hd.Adams(2), hd.Adams(3)], ids=str)
def test_steps_that_make_a_decaying_solution_grow_are_no_success_in_silence(scheme):
    """At order 0.16, with |rate| h**order about 1, both schemes are unstable."""
    eq = hd.Equation(hd.Caputo(0.16), turns, [6.8, 6.4], params=(-1.2, 1.4))
    sol, (seen,) = quietly(eq, 5.6, 165, scheme=scheme)
    assert np.abs(sol.y).max() > 100.0
    if sol.success:
        assert "differ from a run to rtol=1e-4 by the size of the solution" in seen
        assert sol.stats["error_estimate"] > 1.0
    else:
        assert "stability limit" in seen


def test_a_chaotic_run_says_so_and_a_large_error_too():
    sol, (seen,) = quietly(hd.scenes.rossler(), 100.0, 20_000)
    assert "do not resolve it, or it is chaotic" in seen
    assert sol.stats["error_estimate"] > 0.5
    sol, (seen,) = quietly(equation(1.5), 20.0, 40)
    assert seen.startswith("errors are about")
    assert "% at the end" in seen
    assert sol.accuracy.largest.max() == sol.stats["error_estimate"] > 0.05


@pytest.mark.parametrize("how", [{"estimate": False}, {"rtol": 1e-6, "n_steps": None}])
def test_no_estimate_is_made_unasked(how):
    sol, seen = quietly(equation(1.5), 20.0, **{"n_steps": 40} | how)
    assert not seen
    assert sol.accuracy is None
    assert "error_unknown" not in sol.stats


def test_many_runs_estimate_nothing(monkeypatch):
    """Sweeps, ensembles, fits, sensitivities and tables of convergence."""

    def refused(*how):
        raise AssertionError("an estimate was made")

    monkeypatch.setattr("hereditary.solver.accuracy.Provenance._accurate_or_why", refused)
    eq, t = equation(1.5), np.linspace(0.5, 5.0, 10)
    with ThreadPoolExecutor(1) as executor:
        grid = {"n": [30, 40]}
        swept = hd.sweep(lambda n: hd.solve(eq, 5.0, n).y[-1, 0], grid, executor, progress=False)
    assert swept.success.all()
    hd.ensemble(eq, 5.0, 40, params=[[1.0, 1.0, 2.0], [1.0, 1.0, 1.0]])
    data = hd.solve(eq, 5.0, rtol=1e-6, t_eval=t).y
    hd.fit(lambda p: equation(1.5, params=(p, 1.0, 2.0)), t, data, {"p": 0.9}, n_steps=50)
    hd.convergence_table(eq, 5.0, [40, 80])
    with pytest.raises(AssertionError, match="an estimate"):
        hd.solve(eq, 5.0, 40)


def test_results_do_not_depend_on_the_estimate_and_functions_are_called_for_it():
    calls = []

    def counted(t, y):
        calls.append(t)
        return dose(t, y)

    how = {"changes": {2.0: counted}}
    with_it, without = (hd.solve(equation(), 5.0, 500, estimate=e, **how) for e in (True, False))
    assert np.array_equal(with_it.y, without.y)
    assert calls == [2.0] * 3


def test_an_exception_of_the_accurate_run_does_not_end_the_run():
    class Table:
        def fails_between_steps(self, t, y):
            if round(t * 20, 9) % 1:
                raise ZeroDivisionError
            return -y

    with pytest.warns(hd.PythonFunctionWarning):
        eq = hd.Equation(hd.Caputo(0.8), Table().fails_between_steps, [1.0])
    sol = hd.solve(eq, 5.0, 100)
    assert sol.success
    assert "is not possible" in sol.stats["error_unknown"]


@pytest.mark.parametrize(
    "how",
    [{"n_steps": 400}, {"n_steps": 300, "scheme": hd.BDF(2)}, {"rtol": 1e-3}, {"atol": 1e-4}],
    ids=str,
)
def test_a_solution_can_be_checked(how):
    eq = equation(1.5)
    sol = hd.solve(eq, 20.0, **how)
    truth, found = hd.solve(eq, 20.0, rtol=1e-11)(sol.t), sol.check()
    off = np.abs(sol.y - truth) / np.abs(truth).max(axis=0)
    np.testing.assert_allclose(found.relative, off, rtol=0.02, atol=1e-6)
    assert found.largest.shape == found.size.shape == (1,)
    t, c = found.worst
    assert c == 0
    assert found.relative[list(found.t).index(t), 0] == found.largest[0]
    assert f"{found.largest[0]:.1e}" in repr(found)


def test_the_run_of_a_check_has_the_longest_step_of_the_solution():
    pushed = hd.Equation(hd.Caputo(1), lambda t, y: -y + 100.0 * (7.0 < t < 7.01), 1.0)
    sol = hd.solve(pushed, 10.0, rtol=1e-6, max_step=5e-3)
    assert sol.y[-1, 0] > 0.04
    assert sol.check().largest.max() < 1e-5


def test_what_cannot_be_checked_is_refused(tmp_path):
    eq = equation()
    sol = hd.solve(eq, 4.0, 100)
    assert hd.solve(eq, 4.0, 100, t_eval=[4.0]).check().t == [4.0]
    with pytest.raises(ValueError, match="have a row after the start"):
        hd.solve(eq, 4.0, 100, t_eval=[0.0]).check()
    for other in (pickle.loads(pickle.dumps(sol)), hd.solve(eq, 8.0, resume=sol.state)):
        with pytest.raises(ValueError, match="solution must be one"):
            other.check()
    for rtol in (2.0, 0.0):
        with pytest.raises(ValueError, match="rtol must"):
            sol.check(rtol=rtol)
    late, _ = quietly(growing(), 3.0, 10, t_eval=[2.9])
    with pytest.raises(RuntimeError, match=r"finite .* no row of this run is before that"):
        late.check()


def test_time_alone_is_solved_to_a_tolerance():
    by_default, asked = hd.solve(equation(), 10.0), hd.solve(equation(), 10.0, rtol=1e-6)
    np.testing.assert_array_equal(by_default.y, asked.y)


@pytest.mark.parametrize("order", [0.2, 0.3, 0.5])
def test_rounded_times_just_after_a_break_are_no_error(order):
    """The solution grows like a power of the time since the break, which the rows round."""

    def loaded(t, strain):
        return 1.0 if t < 2.0 else 0.0

    terms = hd.Caputo(order) + hd.Memory(hd.Prony([0.0], [1.0]), 1)
    for named in ([2.0], ()):
        sol = hd.solve(hd.Equation(terms, loaded, 0.0), 5.0, rtol=1e-8, breaks=named)
        assert sol.success
        assert sol.check().largest.max() < 1e-8
    steps = hd.solve(hd.Equation(terms, loaded, 0.0), 5.0, 50, scheme=hd.L1(), estimate=False)
    after = np.abs(steps.t - 2.1) < 1e-9
    assert np.any(np.isin(steps.check().t, steps.t[after]))  # the first row after it
