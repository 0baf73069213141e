"""Ensembles: every member is the run that `solve` makes of it, bit for bit on given steps.

By a tolerance it is so to rounding, which may decide of a step.
"""

import os
import signal
import sys
import threading
import warnings
from functools import cache

import numpy as np
import pytest
from cases import GIVEN
from hypothesis import given, settings
from hypothesis import strategies as st
from solver.runs import event

import hereditary as hd


def decay(t, y, p):
    return -p[0] * y


decaying = cache(lambda: hd.Equation(hd.Caputo(0.8), decay, 1.0, [1.0]))


def passing(t, y, p):
    """From the gut into the blood."""
    return [-p[0] * y[0], p[0] * y[0] - p[1] * y[1]]


absorbed = cache(lambda: hd.Equation(hd.Caputo(0.8), passing, [1.0, 0.0], [1.0, 0.5]))


def alone(equation, tables, m, t_end, *arguments, **how):
    """The run of one member by itself."""
    changed = {name: table[m] for name, table in tables.items()}
    return hd.solve(equation.replace(**changed), t_end, *arguments, **how)


def assert_equal(found, m, sol, rounding=0.0):
    n = len(sol.y)
    assert np.array_equal(found.t[:n], sol.t)
    assert np.all(np.isnan(found.y[m, n:]))
    assert (found.ydot is None) == (sol.ydot is None)
    for own, theirs in ((found.y, sol.y), (found.ydot, sol.ydot)):
        if theirs is not None:
            sizes = rounding * np.nan_to_num(np.abs(theirs)).max(axis=0)
            assert np.array_equal(np.isnan(own[m, :n]), np.isnan(theirs))
            assert not np.any(np.abs(own[m, :n] - theirs) > sizes)
    assert found.status[m] == sol.status
    assert found.messages.get(m, hd.Status.COMPLETED.sentence) == sol.message
    if not rounding:  # which may decide of a step
        assert found.stats["n_rhs"][m] == sol.stats["n_rhs"]
        assert found.stats["n_steps"][m] == sol.stats["n_steps"]
    assert_same_events(found, m, sol)


def assert_same_members(found, same):
    for name in ("t", "y", "ydot", "status"):
        own, theirs = getattr(found, name), getattr(same, name)
        assert (own is None) == (theirs is None)
        assert own is None or (own.dtype == theirs.dtype and own.tobytes() == theirs.tobytes())
    assert found.messages == same.messages
    for name in ("n_rhs", "n_steps"):
        assert np.array_equal(found.stats[name], same.stats[name])
    for name in ("t_events", "y_events"):
        for own, theirs in zip(getattr(found, name), getattr(same, name), strict=True):
            assert [each.tolist() for each in own] == [each.tolist() for each in theirs]


def assert_same_events(found, m, sol):
    own = (found.t_events[m], found.y_events[m]) if found.t_events else ([], [])
    for parts, theirs in zip(own, (sol.t_events, sol.y_events), strict=True):
        assert len(parts) == len(theirs)
        for part, other in zip(parts, theirs, strict=True):
            assert part.shape == other.shape
            assert np.array_equal(part, other)


@pytest.mark.filterwarnings("ignore::hereditary.SolveWarning")
@settings(max_examples=25)
@given(
    st.lists(st.floats(0.01, 3.0), min_size=1, max_size=5),
    st.integers(1, 70),
    st.integers(1, 80),
    st.sampled_from(GIVEN),
)
def test_any_members_are_the_runs_by_themselves(rates, n_steps, save_every, scheme):
    equation = hd.Equation(hd.Caputo(0.6), decay, 1.0, [1.0])
    how = {"scheme": scheme, "save_every": save_every}
    found = hd.ensemble(equation, 1.0, n_steps, params=rates, **how)
    for m in range(len(rates)):
        sol = alone(equation, {"params": rates}, m, 1.0, n_steps, **how)
        assert_equal(found, m, sol)


def dose(t, y):
    return [y[0] + 1.0, y[1]]


gate = event(lambda t, y: y[0] - 0.5)
low = event(lambda t, y: y[0] - 0.3, direction=-1)
refill = event(lambda t, y: y[0] - 0.3, change=dose)
last = event(lambda t, y: y[0] - 0.3, terminal=True)
# Arguments of runs, the same for all members; "each" has one for each of three.
ABILITIES = {
    "changes": {"changes": {0.51: dose, 1.0: lambda t, y: [y[0] + 2.0, y[1]]}},
    "changes of each": {
        "each": [{0.51: dose}, {}, {0.7: lambda t, y: [y[0] + 2.0, y[1]], 1.1: dose}]
    },
    "events": {"events": [low, refill]},
    "a terminal event": {"events": last, "changes": {0.51: dose}},
    "switches": {"switches": gate},
    "components": {"components": [1]},
    "all": {"events": low, "switches": gate, "changes": {0.51: dose}, "components": [1, 0]},
}
TIMES = [0.0, 0.4, 0.51, 1.5, 2.0]
WAYS = {
    "explicit": {"n_steps": 100},
    "BDF(2)": {"n_steps": 100, "scheme": hd.BDF(2)},
    "tolerance": {"rtol": 1e-6, "t_eval": TIMES, "max_step": 0.1},
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("ability", ABILITIES)
def test_members_take_what_single_runs_take(ability, way):
    tables = {"params": [[0.5, 1.0], [1.0, 0.5], [3.0, 1.0]]}
    given = dict(ABILITIES[ability])
    each, how = given.pop("each", None), WAYS[way]
    more = {} if each is None else {"changes": each}
    found = hd.ensemble(absorbed(), 2.0, **tables, **how, **given, **more)
    assert found.success.all()
    for m in range(3):
        own = given if each is None else {"changes": each[m]}
        sol = alone(absorbed(), tables, m, 2.0, **how | own | {"t_eval": found.t})
        assert_equal(found, m, sol, 1e-9 if "rtol" in how else 0.0)
        if "n_steps" in how:  # each row of the run itself; a change has one before it and one after
            run = alone(absorbed(), tables, m, 2.0, **how, **own)
            after = np.append(np.diff(run.t) > 0, True) & np.isin(run.t, found.t)
            assert np.array_equal(found.y[m, : after.sum()], run.y[after])


def swing(t, x, p):
    return [p[0] * np.cos(p[1] * t) - x[0] ** 3]


def oscillator(t, y, p):
    return [y[1], p[0] * (1 - y[0] ** 2) * y[1] - p[1] * y[0]]


def attractor(t, y, p):
    return [10 * (y[1] - y[0]), y[0] * (p[0] - y[2]) - y[1], y[0] * y[1] - p[1] * y[2]]


def growth(t, y, p):
    return [p[0] * y[0] ** p[1]]


def tank(t, y, p):
    return [p[0] - p[1] * np.sqrt(max(y[0], 0.0))]


def reached(t, y, p):
    share = y[0] / p[0]
    return [p[0] * (1 - share**3), y[0] * share - p[1] * y[1]]


SWINGING = hd.Caputo(1.8) + 0.3 * hd.Caputo(0.7)
# Equations of two parameters: initial values, ends, and parameters of five members.
RATES = [[0.7, 1.3], [1.0, 0.9], [1.4, 1.0], [0.5, 2.0], [3.0, 1.0]]
MARCHED = {
    "orders above 1": (lambda: hd.Equation(SWINGING, swing, [1.0, 0.3], RATES[0]), 20.0, RATES),
    "at rest, later start": (
        lambda: hd.Equation(
            hd.Caputo(2.0) + 0.2 * hd.Caputo(0.5), swing, [0.0, 0.0], RATES[0], t_start=3.0
        ),
        23.0,
        [*RATES, [0.0, 1.0]],
    ),
    "orders that differ": (
        lambda: hd.Equation(hd.Caputo([0.6, 0.95]), oscillator, [2.0, 0.0], RATES[0]),
        10.0,
        RATES,
    ),
    "complex": (
        lambda: hd.Equation(
            hd.Caputo(1.7), lambda t, y, p: (-p[0] + 1j * p[1]) * y, [[0.5 + 1j], [0j]], RATES[0]
        ),
        2.0,
        RATES,
    ),
    "no memory": (
        lambda: hd.Equation(hd.Caputo(1.0), oscillator, [2.0, 0.0], RATES[0]),
        20.0,
        RATES,
    ),
    "many batches": (
        lambda: hd.Equation(hd.Caputo(0.99), attractor, np.ones(3), [28.0, 2.6]),
        12.0,
        [[28.0, 2.6], [20.0, 2.6]],
    ),
    "blow-up": (
        lambda: hd.Equation(hd.Caputo(0.8), growth, 1.0, [1.0, 2.0]),
        1.0,
        [[0.1, 2.0], [3.0, 2.0], [0.3, 1.0], [30.0, 3.0]],
    ),
    "an edge": (
        lambda: hd.Equation(hd.Caputo(0.7), tank, 0.0, RATES[0]),
        2.0,
        [*RATES, [0.0, 1.0]],
    ),
    "far units": (
        lambda: hd.Equation(hd.Caputo(0.8), reached, [0.0, 0.0], RATES[0]),
        8.0,
        [[1e60, 1.0], [1e-9, 1.0], [1.0, 0.1], [1e9, 1.0]],
    ),
    "stiff": (
        lambda: hd.Equation(hd.Caputo(0.5), lambda t, y, p: p[1] - p[0] * y, 0.0, RATES[0]),
        10.0,
        [[1e-3, 1.0], [1.0, 1.0], [1e6, 1.0]],
    ),
}


@pytest.mark.filterwarnings("ignore::hereditary.SolveWarning")
@pytest.mark.parametrize("name", MARCHED)
def test_members_by_a_tolerance_are_the_runs_by_themselves(name):
    make, t_end, params = MARCHED[name]
    equation = make()
    times = np.linspace(equation.t_start, t_end, 7)
    how = {"rtol": 1e-6, "t_eval": times}
    found = hd.ensemble(equation, t_end, params=params, threads=1, **how)
    assert_same_members(found, hd.ensemble(equation, t_end, params=params, threads=3, **how))
    again = hd.ensemble(equation, t_end, params=params[::-1], threads=1, **how)
    for m in range(len(params)):
        sol = alone(equation, {"params": params}, m, t_end, estimate=False, **how)
        assert_equal(found, m, sol, 1e-9)
        assert np.array_equal(found.y[m], again.y[-1 - m], equal_nan=True)


def test_members_that_an_event_ends_are_successful_and_have_their_times():
    rates = [[0.5, 1.0], [3.0, 1.0], [0.01, 1.0]]
    found = hd.ensemble(absorbed(), 2.0, 100, params=rates, events=last)
    assert found.status.tolist() == ["completed", "event", "completed"]
    assert found.success.all()
    assert sorted(found.messages) == [1]
    assert [len(times) for (times,) in found.t_events] == [0, 1, 0]
    assert found.y_events[1][0].shape == (1, 2)
    assert np.isnan(found.y[1, found.t > found.t_events[1][0]]).all()
    assert "2 of 3 completed, 1 ended by an event" in repr(found)


@pytest.mark.parametrize(
    "how", [{"n_steps": 40, "scheme": hd.L1()}, {"rtol": 1e-6, "t_eval": [2.0, 3.5, 5.0]}], ids=str
)
def test_members_see_a_jump_from_its_own_side(how):
    def pushed(t, y, p):
        return -p[0] * y + (1.0 if t >= 3.5 else 0.0)

    equation = hd.Equation(hd.Caputo(0.6), pushed, 1.0, [1.0], t_start=1.0)
    tables = {"params": [0.5, 1.0, 2.0]}
    found = hd.ensemble(equation, 5.0, breaks=[3.5], **tables, **how)
    without = hd.ensemble(equation, 5.0, **tables, **how)
    for m in range(3):
        assert_equal(found, m, alone(equation, tables, m, 5.0, breaks=[3.5], **how))
        assert not np.array_equal(found.y[m], without.y[m])


def test_each_member_has_its_own_ending():
    """Members that blow up, are unstable or raise leave the others alone, and keep their rows."""

    def moody(t, y, p):
        if p[0] == 3.0 and t > 1.0:
            raise ValueError("too late")
        return p[0] * y[0] ** 2 if p[0] > 0 else p[0] * y[0]

    equation = hd.Equation(hd.Caputo(0.8), moody, 1.0, [0.1])
    rates = [0.1, 40.0, -100.0, 3.0, -0.1]
    with pytest.warns(hd.StabilityWarning, match="3 of 5 members did not complete"):
        found = hd.ensemble(equation, 2.0, 100, params=rates, y0=[0.1, 1.0, 1.0, 0.1, 1.0])
    assert found.status.tolist() == [
        "completed",
        "blown_up",
        "step_too_large",
        "rhs_failed",
        "completed",
    ]
    assert found.success.tolist() == [True, False, False, False, True]
    assert sorted(found.messages) == [1, 2, 3]
    assert "ValueError: too late" in found.messages[3]
    assert np.isfinite(found.y[3]).sum() == found.stats["n_steps"][3] + 1 == 52
    assert np.isfinite(found.y[1]).all(axis=1).sum() <= found.stats["n_steps"][1] + 1


@pytest.mark.parametrize(
    "how",
    [
        {"n_steps": 40},
        {"n_steps": 40, "scheme": hd.BDF(2)},  # whose plan calls f
        {"n_steps": 40, "scheme": hd.L2()},
        {"n_steps": 40, "history": hd.FFT()},
        {"rtol": 1e-5},
    ],
    ids=str,
)
def test_a_member_that_cannot_begin_leaves_the_others_alone(how):
    def moody(t, y, p):
        if p[0] > 1:
            raise ValueError("too large")
        return -p[0] * y

    equation = hd.Equation(hd.Caputo(0.7), moody, 1.0, [0.5])
    with pytest.warns(hd.SolveWarning, match="1 of 3 members") as told:
        found = hd.ensemble(equation, 1.0, params=[0.5, 2.0, 0.7], **how)
    assert len(told) == 1  # one warning for all
    assert found.status.tolist() == ["completed", "rhs_failed", "completed"]
    assert "too large" in found.messages[1]


@pytest.mark.parametrize("scheme", [hd.ExplicitCaputo(), hd.BDF(2)], ids=repr)
def test_a_member_whose_rhs_is_no_number_at_the_start_is_told_so(scheme):
    equation = hd.Equation(hd.Caputo(0.7), lambda t, y, p: np.sqrt(p[0]) * -y, 1.0, [1.0])
    with pytest.warns(hd.SolveWarning):
        found = hd.ensemble(equation, 1.0, 40, params=[1.0, -1.0, 2.0], scheme=scheme)
    assert found.status.tolist() == ["completed", "rhs_failed", "completed"]
    assert "rhs must be finite at t = 0" in found.messages[1]


def test_functions_called_in_python():
    class Decay:
        def __call__(self, t, y, p):
            return -p[0] * y

    with pytest.warns(hd.PythonFunctionWarning):
        called = decaying().replace(rhs=Decay())
    found, compiled = (hd.ensemble(e, 1.0, 40, params=[0.5, 2.0]) for e in (called, decaying()))
    assert np.array_equal(found.y, compiled.y)


# From Python 3.12 on copies of a process with threads, such as those of a test runner, warn.
copies = pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
on_linux = pytest.mark.skipif(sys.platform != "linux", reason="processes are copied on Linux only")


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize(
    "by", [{"threads": 2}, pytest.param({"workers": 2}, marks=[copies, on_linux])], ids=str
)
def test_ctrl_c_leaves_the_members_that_are_left(by):
    hd.ensemble(decaying(), 1.0, 100, params=[1.0])  # compiled: the interrupt shall meet the run
    before = signal.getsignal(signal.SIGINT)
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    found = hd.ensemble(decaying(), 1.0, 10**6, save_every=10**5, params=np.ones(200), **by)
    timer.join()
    assert signal.getsignal(signal.SIGINT) is before
    assert set(found.status) <= {"completed", "interrupted"}
    assert found.status[-1] == "interrupted"
    assert "interrupted" in found.messages[199]
    assert np.all(np.isfinite(found.y[found.success]))
    assert np.all(np.isnan(found.y[-1]))


class Called:
    """A function that is called in Python."""

    def __call__(self, t, y, p):
        if p[0] == 3.0 and t > 0.1:
            raise ValueError("too late")
        return [-p[0] * y[0], p[0] * y[0] - p[1] * y[1]]


@pytest.mark.filterwarnings("ignore::hereditary.SolveWarning")
@pytest.mark.filterwarnings("ignore::hereditary.PythonFunctionWarning")
@copies
@on_linux
@pytest.mark.parametrize(
    "how",
    [{"n_steps": 40}, {"rtol": 1e-5, "events": [low, last], "changes": {0.51: dose}}],
    ids=["steps", "tolerance"],
)
@pytest.mark.parametrize("rhs", ["compiled", "called"])
def test_processes_solve_the_same_members(rhs, how):
    """Also where members fail, and with functions that cannot be sent to another process."""
    equation = absorbed().replace(rhs=Called()) if rhs == "called" else absorbed()
    tables = {"params": [[rate, 0.5] for rate in (0.5, 0.7, 1.0, 2.0, 3.0, 4.0)]}
    found, same = (
        hd.ensemble(equation, 2.0, **tables, **how, **by) for by in ({"workers": 2}, {"threads": 1})
    )
    assert_same_members(found, same)
    assert found.success[4] == (rhs == "compiled")


def test_other_systems_copy_no_process(monkeypatch):
    monkeypatch.setattr("sys.platform", "win32")
    with pytest.raises(ValueError, match=r"workers must be left out .*, got win32; use hd\.sweep"):
        hd.ensemble(decaying(), 1.0, 10, params=[1.0], workers=2)


def test_times_of_steps_and_of_a_tolerance():
    whole = hd.ensemble(decaying(), 1.0, 40, params=[0.5, 2.0])
    some = hd.ensemble(decaying(), 1.0, 40, params=[0.5, 2.0], t_eval=[0.1, 0.5])
    assert np.array_equal(some.y, whole.y[:, [4, 20]])
    assert np.array_equal(some.stats["n_steps"], [40, 40])
    assert hd.ensemble(decaying(), 1.0, rtol=1e-8, params=[0.5, 2.0]).t.tolist() == [0.0, 1.0]


@pytest.fixture(params=["plain", "events", "above 1", "complex"])
def members(request):
    """An ensemble of three, of each kind of result."""
    if request.param == "events":
        rates = [[0.5, 1.0], [3.0, 1.0], [0.01, 1.0]]
        return hd.ensemble(absorbed(), 2.0, 100, params=rates, events=[low, last])
    if request.param == "above 1":
        equation = hd.Equation(hd.Caputo(1.5), decay, [1.0, 0.0], [1.0])
    else:
        y0 = 1.0 + 1.0j if request.param == "complex" else 1.0
        equation = hd.Equation(hd.Caputo(0.8), decay, y0, [1.0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hd.SolveWarning)
        return hd.ensemble(equation, 2.0, 20, params=[0.5, 1e6, 2.0])


def test_a_file_gives_back_an_ensemble(members, tmp_path):
    members.save(tmp_path / "kept")
    found = hd.Ensemble.load(tmp_path / "kept")
    assert_same_members(found, members)
    assert found.stats["seconds"] == members.stats["seconds"]
    with pytest.raises(ValueError, match=r"a solution that Solution\.save wrote"):
        hd.Solution.load(tmp_path / "kept")


def test_tables_of_other_packages(members):
    pytest.importorskip("pandas")
    frame = members.to_pandas()
    assert frame.index.names == ["member", "t"]
    for m, rows in enumerate(members.y):
        assert np.array_equal(frame.loc[m].index, members.t)
        assert np.array_equal(frame.loc[m]["y[0]"], rows[:, 0], equal_nan=True)
    assert ("ydot[0]" in frame) == (members.ydot is not None)
    pytest.importorskip("xarray")
    data = members.to_xarray()
    assert data.y.dims == ("member", "t", "component")
    assert np.array_equal(data.y, members.y, equal_nan=True)
    assert np.array_equal(data.t, members.t)
    assert data.status.values.tolist() == members.status.tolist()
    assert data.n_steps.dims == ("member",)
    assert ("ydot" in data) == (members.ydot is not None)


def raising(t, y, p):
    if p[0] > 2.5 and t > 0.5:
        raise ValueError("late")
    return [-p[0] * y[0]]


@pytest.mark.filterwarnings("ignore::hereditary.SolveWarning")
def test_a_member_that_raises_leaves_the_bits_of_the_others():
    equation = hd.Equation(hd.Caputo(0.7), raising, 1.0, [1.0])
    rates = np.linspace(0.1, 3.0, 40)
    how = {"rtol": 1e-6, "t_eval": [0.25, 2.0]}
    found = hd.ensemble(equation, 2.0, params=rates, threads=1, **how)
    assert_same_members(found, hd.ensemble(equation, 2.0, params=rates, threads=3, **how))
    assert np.array_equal(found.success, rates <= 2.5)
    few = hd.ensemble(equation, 2.0, params=rates[:20], threads=1, **how)
    assert np.array_equal(found.y[:20], few.y)


@pytest.mark.parametrize(("order", "rate"), [(0.15, 1e50), (0.3, 1e120)])
def test_rates_whose_first_length_no_number_has(order, rate):
    equation = hd.Equation(hd.Caputo(order), decay, 1.0, [rate])
    assert hd.solve(equation, 1.0, rtol=1e-6).success
    found = hd.ensemble(equation, 1.0, params=[rate, 1.0], rtol=1e-6)
    assert found.success.all()
