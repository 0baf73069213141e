"""Sweeps: the same bits from every executor and in every order, failures, and their tables."""

import io
import math
import multiprocessing
import os
import random
import re
import signal
import sys
import threading
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweep_points import GRID, exponents, march, odd, process, same

import hereditary as hd


@pytest.fixture(scope="module")
def processes():
    # spawned: forking beside threads is deprecated from Python 3.12 on
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        yield pool


@pytest.fixture(scope="module")
def dask():
    distributed = pytest.importorskip("distributed")
    arguments = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**arguments) as cluster, distributed.Client(cluster) as client:
        yield client.get_executor()


@pytest.fixture(scope="module")
def loops():
    """Tables of points that one thread computes, by function."""
    with ThreadPoolExecutor(1) as pool:
        return {f: hd.sweep(f, GRID, pool, progress=False) for f in (march, exponents, odd)}


@pytest.mark.parametrize("function", [march, exponents, odd])
def test_tables_hold_what_a_plain_loop_gives(function, loops):
    table = loops[function]
    for place in np.ndindex(table.shape):
        point = [float(axis[i]) for axis, i in zip(GRID.values(), place, strict=True)]
        try:
            found = function(*point)
        except ValueError as error:
            found = {"status": " ".join(f"ValueError: {error}".split())}
        assert table.status[place] == found.pop("status")
        for name, value in found.items():
            value = str(value) if isinstance(value, str) else np.array(value).tolist()
            assert repr(np.array(table[name][place]).tolist()) == repr(value)


@pytest.mark.parametrize("function", [march, exponents, odd])
@pytest.mark.parametrize("n_threads", [None, 1, 4])
def test_threads_give_the_bits_of_a_loop(function, n_threads, loops):
    pool = n_threads and ThreadPoolExecutor(n_threads)
    table = hd.sweep(function, GRID, executor=pool)
    assert same(table, loops[function])
    assert function is odd or table.success.all()


@pytest.mark.parametrize("executor", ["processes", "dask"])
def test_other_processes_give_the_bits_of_a_loop(executor, loops, request):
    pool = request.getfixturevalue(executor)
    for function, table in loops.items():
        assert same(hd.sweep(function, GRID, executor=pool), table)
    elsewhere = hd.sweep(process, GRID, executor=pool)["value"]
    assert os.getpid() not in elsewhere


class Shuffled(Executor):
    """One thread that runs whichever waiting point it fancies."""

    def __init__(self, seed):
        self._random, self._waiting, self.n_waiting_most = random.Random(seed), [], 0
        self._changed = threading.Condition()
        threading.Thread(target=self._work, daemon=True).start()

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        with self._changed:
            self._waiting.append((future, fn, args))
            self.n_waiting_most = max(self.n_waiting_most, len(self._waiting))
            self._changed.notify()
        return future

    def shutdown(self, wait=True, *, cancel_futures=False):
        with self._changed:
            self._waiting.append(None)
            self._changed.notify()

    def _work(self):
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting)
                call = self._waiting.pop(self._random.randrange(len(self._waiting)))
            if call is None:
                return
            future, fn, args = call
            if future.set_running_or_notify_cancel():
                future.set_result(fn(*args))


@given(st.integers(0, 10**6))
@settings(max_examples=10)
def test_the_order_of_points_does_not_matter(loops, seed):
    with Shuffled(seed) as shuffled:
        assert same(hd.sweep(odd, GRID, shuffled), loops[odd])


def test_few_points_are_handed_out_at_a_time():
    with Shuffled(1) as shuffled:
        table = hd.sweep(lambda a: a, {"a": range(3000)}, shuffled)
    assert table["value"].tolist() == list(range(3000))
    assert shuffled.n_waiting_most <= 1024


def test_the_executor_stays_open():
    with ThreadPoolExecutor(2) as pool:
        hd.sweep(lambda a: a, {"a": [1.0]}, pool)
        assert pool.submit(int, "3").result() == 3


def test_axes_keep_their_kinds():
    kinds = hd.sweep(
        lambda **point: {name + "_kind": type(value).__name__ for name, value in point.items()},
        {"n": [1, 2], "x": np.float32([0.5]), "how": ("a", "bc"), "on": [True, False]},
    )
    assert kinds.shape == (2, 1, 2, 2)
    assert [kinds[name].flat[0] for name in kinds.names] == ["int", "float", "str", "bool"]
    assert kinds.axes["how"].tolist() == ["a", "bc"]


def test_what_a_point_may_return():
    returned = [
        {"value": 1, "matrix": np.eye(2, dtype=int), "status": hd.Status.COMPLETED},
        {"value": np.float32(0.5), "matrix": [[1, 2], [3, 4]], "verdicts": ("neutral", "diverged")},
        {"value": True, "status": hd.Status.BLOWN_UP, "verdicts": np.array(["a", "b"])},
        3.5,
        {},
    ]
    table = hd.sweep(lambda k: returned[k], {"k": range(5)})
    assert table["value"].tolist()[:4] == [1.0, 0.5, 1.0, 3.5]
    assert math.isnan(table["value"][4])
    assert table["matrix"].shape == (5, 2, 2)
    assert np.isnan(table["matrix"][2:]).all()
    assert table["verdicts"].tolist() == [
        ["", ""], ["neutral", "diverged"], ["a", "b"], ["", ""], ["", ""]
    ]  # fmt: skip
    assert table.status.tolist() == [*["completed"] * 2, "blown_up", *["completed"] * 2]
    assert table.success.tolist() == [True, True, False, True, True]


@pytest.mark.parametrize(
    ("returned", "match"),
    [
        (None, "TypeError: value must be a number, a string, or an array of them, got a NoneType"),
        (1j, "TypeError: value must be a number, .* got a complex"),
        ([[]], "TypeError: value must be a number"),
        ({"x": [[1], [2, 3]]}, "ValueError: setting an array element"),
        ({"a": 1.0}, "ValueError: function must name its values .* got 'a'"),
        ({1: 1.0}, "ValueError: function must name its values"),
        (10**400, "TypeError"),
        (
            [1.0, 2.0],
            "ValueError: value must be numbers of shape \\(\\), but for its length, as at ",
        ),
        ("text", "ValueError: value must be numbers of shape"),
    ],
)
def test_a_point_that_returns_something_else_has_failed(returned, match):
    table = hd.sweep(lambda a: a if a < 1 else returned, {"a": [0.0, 1.0, 0.5]})
    assert table["value"][[0, 2]].tolist() == [0.0, 0.5]
    assert math.isnan(table["value"][1])
    assert table.success.tolist() == [True, False, True]
    with pytest.raises(AssertionError, match=match):
        raise AssertionError(table.status[1])


def test_arrays_of_different_lengths(tmp_path):
    """As maxima are: rows are filled up to the longest one, in a store too."""
    returned = [[1.0, 2.0], [], [3.0], 4.0, [[5.0]], ["a"]]

    def point(k):
        return {"tops": returned[k], "words": ["long"] * k}

    with_store = [
        hd.sweep(point, {"k": range(6)}, store=tmp_path / "points", progress=False)
        for _ in range(2)
    ]
    table = with_store[0]
    assert np.array_equal(table["tops"][:3], [[1, 2], [np.nan] * 2, [3, np.nan]], equal_nan=True)
    assert np.isnan(table["tops"][3:]).all()
    assert table.success.tolist() == [True] * 3 + [False] * 3
    assert table["words"].shape == (6, 5)
    assert table["words"][2].tolist() == ["long", "long", "", "", ""]
    assert np.array_equal(with_store[1]["tops"], table["tops"], equal_nan=True)


def test_pairs_of_which_there_are_none(tmp_path):
    """Times and heights of maxima, say: two columns, and at some points no row."""
    for empty in ([], np.zeros((0, 2))):
        table = hd.sweep(
            lambda n, empty=empty: {"tops": np.ones((n, 2)) if n else empty},
            {"n": [0, 1, 3]},
            store=tmp_path / f"points{len(np.shape(empty))}",
            progress=False,
        )
        assert table.success.all()
        assert table["tops"].shape == (3, 3, 2)
        assert np.isfinite(table["tops"]).sum(axis=(1, 2)).tolist() == [0, 2, 6]


def test_failing_points_stop_nothing():
    def picky(a, b):
        if a == b:
            raise RuntimeError("long " * 100)
        return a - b

    table = hd.sweep(picky, {"a": [1, 2, 3], "b": [1, 2]})
    assert np.array_equal(table["value"], [[np.nan, -1], [1, np.nan], [2, 1]], equal_nan=True)
    assert table.status[0, 0].startswith("RuntimeError: long long")
    assert len(table.status[0, 0]) == 200
    nothing = hd.sweep(lambda a: 1 / 0, {"a": [1, 2]})
    assert nothing.names == ()
    assert set(nothing.status.tolist()) == {"ZeroDivisionError: division by zero"}


def test_an_executor_that_breaks_down_is_no_failing_point(processes, tmp_path):
    store = tmp_path / "points"
    with pytest.raises(RuntimeError, match=r"executor must carry every point .* top of a module"):
        hd.sweep(lambda a: a, {"a": [1.0, 2.0]}, processes, store)
    assert store.read_text().count("\n") == 1
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    with pytest.raises(RuntimeError, match="after shutdown"):
        hd.sweep(lambda a: a, {"a": [1.0]}, pool)


def interrupt(seconds=0.0):
    time.sleep(seconds)
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_keeps_what_was_computed(tmp_path):
    def point(a):
        if a == 5:
            interrupt()
        time.sleep(0.01)
        return float(a)

    before = signal.getsignal(signal.SIGINT)
    store, grid = tmp_path / "points", {"a": range(100)}
    table = hd.sweep(point, grid, store=store)
    assert signal.getsignal(signal.SIGINT) is before
    n_done = int(table.success.sum())
    assert 5 <= n_done < 100
    assert set(table.status.tolist()) == {"completed", "not computed"}
    assert np.isnan(table["value"][~table.success]).all()
    called = []
    again = hd.sweep(lambda a: called.append(a) or float(a), grid, store=store)
    assert again["value"].tolist() == list(range(100))
    assert len(called) == 100 - n_done
    assert not set(called) & set(np.flatnonzero(table.success).tolist())


@pytest.mark.usefixtures("ctrl_c")
def test_a_second_ctrl_c_raises(no_collection):
    def point(a):
        if a == 2:
            interrupt()
            interrupt(0.3)
        return a

    began = time.perf_counter()
    with ThreadPoolExecutor(1) as pool, pytest.raises(KeyboardInterrupt):
        hd.sweep(lambda a: point(a) if a < 3 else time.sleep(0.05), {"a": range(1000)}, pool)
    assert time.perf_counter() - began < 10


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_that_comes_too_late_is_not_swallowed(no_collection):
    with pytest.raises(KeyboardInterrupt):
        hd.sweep(lambda a: interrupt(), {"a": [1.0]})


def test_progress_counts_what_is_left(monkeypatch, tmp_path):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    def drawn(**how):
        monkeypatch.setattr("sys.stderr", Terminal())
        hd.sweep(lambda a: time.sleep(0.15), {"a": range(4)}, store=store, **how)
        return re.findall(r"[\d.]+ %", sys.stderr.getvalue())

    store = tmp_path / "points"
    shares = ["25.0 %", "50.0 %", "75.0 %", "100.0 %"]
    with ThreadPoolExecutor(1) as pool:
        assert drawn(executor=pool) == shares
        store.write_bytes(b"".join(store.read_bytes().splitlines(keepends=True)[:3]))
        assert drawn(executor=pool) == shares[1::2]
        assert drawn(executor=pool) == drawn(progress=False) == []


TERMS = hd.Caputo(2.0) + 0.2 * hd.Caputo(0.9)


def hardening(t, x, p):
    return p[0] * np.cos(p[1] * t) - x - x**3


def resonance(force, frequency, state):
    """Amplitude of a hardening spring with memory, 200 on from the last frequency."""
    eq = hd.Equation(TERMS, hardening, [0.0, 0.0], params=[force, frequency])
    if state is None:
        sol = hd.solve(eq, 200.0, 4000, scheme=hd.BDF(2))
    else:
        sol = hd.solve(eq, state.t + 200.0, resume=state, params=eq.params)
    amplitude = np.abs(sol.y[-1000:]).max()
    return {"amplitude": amplitude, "state": sol.state, "status": sol.status}


def test_sweeps_up_and_down_show_hysteresis():
    frequencies = np.linspace(1.0, 3.0, 9)
    up = hd.sweep(resonance, {"force": [0.8], "frequency": frequencies}, carry=True)
    down = hd.sweep(resonance, {"force": [0.8], "frequency": frequencies[::-1]}, carry=True)
    assert up.success.all()
    assert down.success.all()
    more = up["amplitude"][0] - down["amplitude"][0, ::-1]
    assert np.abs(more[[0, -1]]).max() < 1e-3
    assert more.max() > 1.0


def walk(row, step, state):
    """A sum along the row."""
    if step == 3 and row == "b":
        raise ValueError("no step 3 here")
    total = (state or 0.0) + step
    calls.append((row, step))
    return {"total": total, "state": total}


calls: list = []


def test_each_row_carries_its_own_state(tmp_path, processes):
    grid = {"row": ["a", "b"], "step": [1, 2, 3, 4]}
    table = hd.sweep(walk, grid, carry=True)
    assert table["total"][0].tolist() == [1, 3, 6, 10]
    assert table["total"][1, [0, 1, 3]].tolist() == [1, 3, 7]  # on from the last that ended
    assert table.status[1, 2] == "ValueError: no step 3 here"
    store = tmp_path / "walk"
    hd.sweep(walk, grid, carry=True, store=store)
    lines = store.read_text().splitlines(keepends=True)
    store.write_text("".join(lines[:3]))  # the grid and two points
    calls.clear()
    again = hd.sweep(walk, grid, carry=True, store=store)
    assert np.array_equal(again["total"], table["total"], equal_nan=True)
    assert len(store.read_text().splitlines()) == 9
    assert len(calls) == 7  # both rows from their first points on
    kept = hd.sweep(walk, grid, carry=True, store=store)
    assert len(calls) == 7
    assert np.array_equal(kept["total"], table["total"], equal_nan=True)


def test_what_carrying_needs_is_told():
    table = hd.sweep(lambda a, state: a, {"a": [1.0]}, carry=True)
    assert 'mapping with "state"' in table.status[0]


def test_labels():
    table = hd.sweep(odd, GRID)
    assert table.shape == (4, 3)
    assert table.names == ("extremes", "place")
    assert table["extremes"].shape == (4, 3, 5)
    assert table["place"] is table.values["place"]
    assert table.success.tolist() == (table.status == "completed").tolist()
    assert table.success.sum() == 4
    assert repr(table) == "Table(extremes, place over b (4), c (3); 4 of 12 completed)"
    words = "name must be one of 'extremes', 'place', got 'b'; axes are"
    with pytest.raises(KeyError, match=words):
        table["b"]


def test_tables_of_other_packages():
    pytest.importorskip("pandas")
    table = hd.sweep(odd, GRID)
    frame = table.to_pandas()
    assert list(frame.index.names) == ["b", "c"]
    assert list(frame.columns) == [*(f"extremes[{k}]" for k in range(5)), "place", "status"]
    assert len(frame) == 12
    assert frame.loc[(GRID["b"][2], 50.0), "extremes[2]"] == table["extremes"][2, 2, 2]
    assert frame["status"].tolist() == table.status.ravel().tolist()
    single = hd.sweep(lambda n: {"m": np.full((1, 2), float(n))}, {"n": [1, 2]}).to_pandas()
    assert single.index.name == "n"
    assert single["m[0, 1]"].tolist() == [1.0, 2.0]
    pytest.importorskip("xarray")
    data = table.to_xarray()
    assert data["extremes"].dims == ("b", "c", "extremes_0")
    assert dict(data.sizes) == {"b": 4, "c": 3, "extremes_0": 5}
    assert data["place"].sel(b=0.5, c=50.0).item() == table["place"][0, 2]
    assert (data["status"].values == table.status).all()
