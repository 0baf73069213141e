"""What stored code is known by, and what functions without counts, or handed on, may do."""

import functools
import os
import pickle
import subprocess
import sys
import types

import numpy as np
import pytest
from numba import njit
from numba.core.codegen import JITCPUCodegen

import hereditary as hd
from hereditary.compiled.jit import F8, I8, as_value, compiled, inner
from hereditary.compiled.numba_internals import LINKED
from hereditary.functions import reads
from hereditary.functions.reads import digest

pytestmark = pytest.mark.core

SOURCE = """
import math
import numpy as np
TABLE, RATE = np.arange(3.0), 2.5
def inner(x):
    return math.sin(x) in {"a", "b", "c"}
def outer(t, y, factor=3.0):
    return [RATE * TABLE[0] * inner(v) * np.exp(factor) for v in y]
"""


def made(source=SOURCE):
    """The function `outer` of some source, its own globals behind it."""
    names = {"__name__": "a_script"}
    exec(source, names)
    return names["outer"]


def test_a_digest_lasts():
    """Another process orders sets otherwise and puts everything at other addresses."""
    source = f"{SOURCE}\nfrom hereditary.functions.reads import digest\nprint(digest(outer))"
    told = subprocess.run(
        [sys.executable, "-c", source],
        env=os.environ | {"PYTHONHASHSEED": "7"},
        capture_output=True,
        text=True,
        check=True,
    )
    main = types.FunctionType(made().__code__, made().__globals__, "outer", (3.0,))
    assert told.stdout.strip() == digest(main) == digest(made())


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("RATE = np.arange(3.0), 2.5", "RATE = np.arange(3.0), 2.6"),
        ("np.arange(3.0)", "np.arange(4.0)"),
        ("factor=3.0", "factor=3.1"),
        ("math.sin", "math.cos"),
        ("np.exp", "np.sqrt"),
        ('"c"', '"d"'),
        ("RATE * TABLE[0]", "RATE / TABLE[0]"),
    ],
)
def test_what_a_function_does_tells_it_from_others(old, new):
    assert digest(made(SOURCE.replace(old, new))) != digest(made())


def test_what_it_is_called_and_whether_it_is_compiled_does_not():
    assert digest(made(SOURCE.replace("v in y", "w in y").replace("inner(v)", "inner(w)")))
    alike = [(lambda t, y: -y), (lambda t, y: -y), njit(lambda t, y: -y)]
    assert len({digest(function) for function in alike}) == 1


class Event:
    """A callable with a state."""

    def __init__(self, level):
        self.level = level

    def __call__(self, t, y):
        return y[0] - self.level

    def method(self, t, y):
        return self(t, y)


def test_values_of_all_kinds():
    values = [
        1, 1.0, "1", b"1", None, True, (1,), (1, 2), {1}, {1: 2}, np.ones(2), np.ones((2, 1)),
        np.ones(2, dtype=np.float32), np.array([1.0, -0.0]), np.array([1.0, 0.0]), Event(1.0),
        Event(2.0), Event(1.0).method, Event(2.0).method, functools.partial(made(), 1.0),
        functools.partial(made(), 2.0), np.sin, np.linalg.norm, Event, os,
    ]  # fmt: skip
    digests = [digest(value) for value in values]
    assert len(set(digests)) == len(values)
    kept = [v for v in values if isinstance(v, (int, float, str, tuple, set, dict, np.ndarray))]
    assert [digest(pickle.loads(pickle.dumps(v))) for v in kept] == [digest(v) for v in kept]


def test_what_lies_in_itself():
    value = [1.0]
    value.append(value)
    assert digest(value) == digest(value)


def _scaled(x, factor):
    for i in range(x.shape[0]):
        x[i] *= factor


def test_functions_without_counts_work_on_their_caller_s_arrays():
    helper = inner(_scaled)

    @compiled
    def scaled(n):
        x = np.ones(n)
        for _ in range(3):
            helper(x[1:], 2.0)
        return x

    assert scaled(4).tolist() == [1.0, 8.0, 8.0, 8.0]


@pytest.mark.parametrize("in_tuple", [False, True])
def test_a_function_without_counts_that_returns_an_array_is_refused(in_tuple):
    @inner
    def same(x):
        return (1.0, x) if in_tuple else x

    @compiled
    def caller(x):
        return same(x)

    with pytest.raises(Exception, match=r"allocates|returning of array"):
        caller(np.ones(2))


def test_a_function_is_a_value_of_its_signature_alone():
    @compiled
    def halved(x):
        return 0.5 * x

    @compiled
    def rounded(x):
        return int(x)

    assert as_value(halved, F8(F8)) is as_value(halved, F8(F8)) is halved
    assert (halved(3.0), halved.of_signature) == (1.5, F8(F8))
    assert halved.address > 0
    with pytest.raises(TypeError, match=r"must be .* -> float64; it returns int64"):
        as_value(rounded, F8(F8))
    assert as_value(rounded, I8(F8)).of_signature == I8(F8)


class Read:
    """An object that counts how often its contents are read."""

    def __init__(self, value):
        self.value, self.n_reads = value, 0

    def __reduce_ex__(self, _):
        self.n_reads += 1
        return Read, (self.value,)


class Fixed(Read):
    fixed_contents = True


def test_contents_that_never_change_are_read_once():
    fixed, same, other, changing = Fixed(1.0), Fixed(1.0), Fixed(2.0), Read(1.0)
    for _ in range(3):
        assert digest(fixed) == digest(same) != digest(other)
        first = digest([changing, fixed])
        changing.value += 1.0
        assert digest([changing, fixed]) != first
    assert (fixed.n_reads, changing.n_reads) == (1, 6)


def test_solutions_are_read_once():
    """Runs whose right-hand side reads many solutions do not walk through them again."""
    solved = hd.solve(hd.Equation(hd.Caputo(0.8), lambda t, y: -y, 1.0), 1.0, rtol=1e-4)
    again = pickle.loads(pickle.dumps(solved))
    assert digest(solved) == digest(again)
    assert solved in reads._FIXED


@pytest.mark.skipif(not LINKED, reason="plain numba makes more")
def test_one_machine_code_is_made_of_a_function_and_its_helpers(monkeypatch):
    made = []
    add = JITCPUCodegen._add_module
    monkeypatch.setattr(
        JITCPUCodegen, "_add_module", lambda self, module: made.append(add(self, module))
    )

    def helper(y):
        return np.asarray(3.0 * y)

    hd.Equation(hd.Caputo(0.5), lambda t, y: -helper(y), [1.0, 2.0])
    assert len(made) == 1
