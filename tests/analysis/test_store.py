"""Stores of sweeps: killed at any byte they go on, and nothing that is stored is done again."""

import contextlib
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweep_points import GRID, LONG_GRID, march, odd, same

import hereditary as hd

AXES = {"a": np.array([0.1, 0.25, 2.0]), "how": np.array(["x", "é"])}
HERE = Path(__file__).parent


def counted(function, calls):
    def point(b, c):
        calls.append((b, c))
        return function(b, c)

    return point


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    """Bytes of whole stores, and their tables, by function."""
    found = {}
    for function in (march, odd):
        path = tmp_path_factory.mktemp("stores") / "points"
        found[function] = (hd.sweep(function, GRID, store=path), path.read_bytes())
    return found


def torn(content):
    """Expect a warning where the last line of a store is torn."""
    if content == content[: content.rfind(b"\n") + 1]:
        return contextlib.nullcontext()
    return pytest.warns(UserWarning, match="the last line of .* is torn and dropped")


@pytest.mark.parametrize("function", [march, odd])
@given(data=st.data())
@settings(max_examples=20)
def test_a_store_cut_anywhere_is_completed(function, unbroken, tmp_path_factory, data):
    table, content = unbroken[function]
    kept = content[: data.draw(st.integers(0, len(content)), "bytes")]
    n_stored = max(kept.count(b"\n") - 1, 0)
    path = tmp_path_factory.mktemp("cut") / "points"
    path.write_bytes(kept)
    calls = []
    with torn(kept):
        assert same(hd.sweep(counted(function, calls), GRID, store=path), table)
    assert len(set(calls)) == len(calls) == table.status.size - n_stored
    assert path.read_bytes().startswith(kept[: kept.rfind(b"\n") + 1])
    assert sorted(path.read_bytes().splitlines()) == sorted(content.splitlines())
    calls.clear()
    assert same(hd.sweep(counted(function, calls), GRID, store=path), table)
    assert not calls


SCRIPT = """
import sys
import hereditary as hd
from sweep_points import LONG_GRID, march
hd.sweep(march, LONG_GRID, store=sys.argv[1])
"""
PROCESSES = """
import sys
from concurrent.futures import ProcessPoolExecutor
import hereditary as hd
from sweep_points import LONG_GRID, march
if __name__ == "__main__":
    march(1.0, 10.0)
    with ProcessPoolExecutor(2) as pool:
        table = hd.sweep(march, LONG_GRID, executor=pool, store=sys.argv[1])
        sys.stdout.write("ended " + ",".join(sorted(set(table.status.ravel().tolist()))))
"""


def stop_in_the_middle(code, store, number):
    """Run a script, send its whole group a signal when some points are stored; what it printed."""
    path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": path, "SECONDS_A_POINT": "0.02"}
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(store)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    began = time.monotonic()
    while not store.exists() or store.read_bytes().count(b"\n") < 12:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() - began < 120
        time.sleep(0.005)
    os.killpg(process.pid, number)
    return process.communicate(timeout=60)[0]


@pytest.mark.parametrize(
    ("code", "number", "printed"),
    [(SCRIPT, signal.SIGKILL, ""), (PROCESSES, signal.SIGINT, "ended completed,not computed")],
    ids=["killed", "interrupted with its workers"],
)
@pytest.mark.usefixtures("ctrl_c")
def test_a_stopped_sweep_goes_on(code, number, printed, tmp_path):
    store = tmp_path / "points"
    assert stop_in_the_middle(code, store, number) == printed
    content = store.read_bytes()
    n_stored = content.count(b"\n") - 1
    n_points = LONG_GRID["b"].size * LONG_GRID["c"].size
    assert 11 <= n_stored < n_points
    calls = []
    with torn(content):
        table = hd.sweep(counted(march, calls), LONG_GRID, store=store)
    assert len(set(calls)) == len(calls) == n_points - n_stored
    assert store.read_bytes().startswith(content[: content.rfind(b"\n") + 1])
    assert table.success.all()
    assert same(table, hd.sweep(march, LONG_GRID))


def test_failed_points_are_not_tried_again(tmp_path):
    store = tmp_path / "points"
    before = hd.sweep(lambda a: 1 / (a - 1), {"a": [0.0, 1.0]}, store=store)
    after = hd.sweep(lambda a: 7.0, {"a": [0.0, 1.0]}, store=store)
    assert same(before, after)
    assert after.status.tolist() == ["completed", "ZeroDivisionError: float division by zero"]


NUMBERS = st.floats() | st.sampled_from([-0.0, 5e-324, math.inf, 1 / 3])
VALUES = NUMBERS | st.text(max_size=5) | st.lists(NUMBERS, min_size=2, max_size=2)


@given(
    st.lists(st.dictionaries(st.sampled_from("xyz"), VALUES, max_size=3), min_size=1, max_size=6)
)
def test_every_bit_comes_back(tmp_path_factory, points):
    path, grid = tmp_path_factory.mktemp("store") / "points", {"k": range(len(points))}
    table = hd.sweep(lambda k: points[k], grid, store=path, progress=False)
    assert same(hd.sweep(lambda k: 1 / 0, grid, store=path, progress=False), table)


@pytest.mark.parametrize(
    "axes",
    [
        {"b": AXES["a"], "how": AXES["how"]},
        {"how": AXES["how"], "a": AXES["a"]},
        {"a": AXES["a"][:2], "how": AXES["how"]},
        {"a": AXES["a"], "how": np.array(["x"])},
    ],
)
def test_another_grid_is_refused(tmp_path, axes):
    path = tmp_path / "points"
    hd.sweep(lambda a, how: a, AXES, store=path)
    content = path.read_bytes()
    with pytest.raises(
        ValueError, match=r"store must hold points of the same grid.*; name another"
    ):
        hd.sweep(lambda **point: 1.0, axes, store=path)
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    "content",
    [b"x,y\n1,2\n", b"no line", b'{"axes":{}}\n', b"\xff\n"],
    ids=lambda content: repr(content[-30:]),
)
def test_other_files_are_left_alone(tmp_path, content):
    path = tmp_path / "data.csv"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="store must hold points of the same grid"):
        hd.sweep(lambda a: a, {"a": [1.0]}, store=path)
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    "line",
    [
        b"nonsense\n",
        b'[9,"completed",{}]\n',
        b'[0.5,"completed",{}]\n',
        b'[true,"completed",{}]\n',
        b'[0,7,{"value":1.0}]\n',
        b'[0,"completed",{"value":[[1.0],[1.0,2.0]]}]\n',
        b'[0,"completed",{"value":null}]\n',
        b'[0,"completed",{"value":[[]]}]\n',
        b"[0,1]\n",
        b"\n",
        b"3\n",
        b"[" * 100_000 + b"\n",
    ],
    ids=lambda line: repr(line[:30]),
)
def test_a_spoilt_line_is_told(tmp_path, line):
    path = tmp_path / "points"
    hd.sweep(lambda a: a, {"a": [1.0, 2.0]}, store=path)
    with open(path, "ab") as file:
        file.write(line)
    with pytest.raises(ValueError, match=r"store must hold a point a line, got .* in line 4 of"):
        hd.sweep(lambda a: a, {"a": [1.0, 2.0]}, store=path)


def test_a_store_needs_its_folder(tmp_path):
    with pytest.raises(FileNotFoundError):
        hd.sweep(lambda a: a, {"a": [1.0]}, store=tmp_path / "none" / "points")
