"""Users' functions: what they may not do to a run, and what they read when it begins."""

import cProfile
import pickle
import warnings
from functools import partial
from types import ModuleType

import numpy as np
import pytest
from cases import chosen
from numba import njit
from problems import run

import hereditary as hd

pytestmark = pytest.mark.core

TABLE = np.ones(5)
SCHEMES = (hd.ExplicitCaputo(), hd.L1(), hd.Adams(), hd.Collocation())
run = partial(run, length=1.0, n=50, rtol=1e-6)


def equation(rhs, y0=1.0, params=(1.0, 2.0), **kwargs):
    return hd.Equation(hd.Caputo(0.8), rhs, y0, params, **kwargs)


def clamps(t, y, dy, params):
    if y[0] < 0.0:
        y[0] = 0.0
    dy[0] = -1.0 - y[0]


def adds(t, y):
    if t > 0.5:
        y += 1.0
    return -y


def writes_into_a_slice(t, y, params):
    last = y[-1:]
    if t > 0.5:
        last[0] = 0.0
    return -y


def counts(t, y, params):
    if t > 0.0:
        params[0] += 0.001
    return -params[0] * y[0]


@njit
def clamped(y):
    if y[0] < 0.0:
        y[0] = 0.0


def calls_what_writes(t, y):
    clamped(y)
    return -y


@njit
def jitted_counts(t, y, dy, params):
    if t > 0.0:
        params[0] += 0.001
    dy[0] = -params[0] * y[0]


@pytest.mark.parametrize(
    ("rhs", "line"),
    [
        (clamps, "y[0] = 0.0"),
        (adds, ""),
        (writes_into_a_slice, "last[0] = 0.0"),
        (counts, "params[0] += 0.001"),
        (jitted_counts, "params[0] += 0.001"),
        (calls_what_writes, ""),
    ],
)
def test_functions_that_would_write_later_are_refused(rhs, line):
    with pytest.raises(TypeError, match="rhs must leave y and params as they are") as caught:
        equation(rhs)
    message = str(caught.value)
    assert __file__ in message
    assert line in message
    assert "work on y.copy()" in message


def writes_by_flat(t, y, dy, params):
    dy[0] = -y[0]
    y.flat[0] = 7.0 if t > 0.0 else y[0]
    params.flat[0] = 7.0 if t > 0.0 else params[0]


def writes_past_read_only(t, y, dy, params):
    dy[0] = -y[0]
    np.ascontiguousarray(y)[0] = 7.0 if t > 0.0 else y[0]


@pytest.mark.parametrize("writer", [writes_by_flat, writes_past_read_only])
@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_what_gets_past_read_only_types_writes_into_copies(scheme, writer):
    """numba lets these through, or versions of it: they must do no harm, in any scheme."""
    try:
        eq = equation(writer)
    except TypeError as refusal:
        if writer is writes_by_flat or "rhs must leave y" not in str(refusal):
            raise
        return
    expected = run(equation(lambda t, y, p: -y[0]), scheme)
    np.testing.assert_array_equal(run(eq, scheme).y, expected.y)
    np.testing.assert_array_equal(eq.params, [1.0, 2.0])


def reads_beyond(t, y):
    return -y * TABLE[int(10 * t)]


@njit
def jitted_reads_beyond(t, y, dy, params):
    dy[0] = -y[0] * params[int(4 * t)]


@njit
def entry_of_table(i):
    return TABLE[i]


entry_of_table(0)  # compiled without bounds checks


def calls_what_reads_beyond(t, y):
    return -y * entry_of_table(int(10 * t))


def of_no_module(source):
    """Make a function as `exec` with a bare dictionary does, and some notebooks do."""
    made: dict = {}
    exec(source, made)
    return made["rhs"]


BEYOND = {
    "rhs": (reads_beyond, {}),
    "jitted": (jitted_reads_beyond, {}),
    "helper": (calls_what_reads_beyond, {}),
    "no module": (of_no_module("def rhs(t, y, p):\n    return -p[int(t * 4.0)] * y"), {}),
    "jac": (lambda t, y: -y, {"jac": lambda t, y: np.array([[-TABLE[int(300 * t)]]])}),
}


@pytest.mark.parametrize(("rhs", "given"), BEYOND.values(), ids=BEYOND)
def test_reading_out_of_bounds_ends_the_run(rhs, given):
    with pytest.warns(hd.SolveWarning, match="IndexError"):
        sol = run(equation(rhs, **given), hd.L1() if given else None)
    assert sol.status is hd.Status.RHS_FAILED
    assert "IndexError" in sol.message
    assert sol.t[-1] == pytest.approx(0.0 if given else 0.5, abs=0.03)
    assert f"t = {sol.t[-1]:g}" in sol.message


@pytest.mark.parametrize("size", [2, 200_000])
def test_a_changed_array_changes_no_other_equation(size):
    """numba copies no array that is large or not contiguous: compiled code reads it in place."""
    first, second = (np.ones((size, 2))[:, 0] for _ in range(2))
    eq, other = equation(closure_of_first(first)), equation(closure_of_first(second))
    expected = run(other).y
    first[0] = 3.0
    np.testing.assert_array_equal(run(other).y, expected)
    assert run(eq).y[-1, 0] < 0.7 * expected[-1, 0]


def closure_of_first(table):
    return lambda t, y: -table[0] * y


def test_many_versions_of_one_function_are_told(monkeypatch):
    monkeypatch.setattr("hereditary.functions.build._VERSIONS_MAX", 3)

    def version(rate):
        return lambda t, y: rate - y[0]

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        equation(version(1.0)), equation(version(2.0)), equation(version(1.0))
    with pytest.warns(UserWarning, match="rhs was compiled 3 times .* through params") as caught:
        equation(version(3.0))
    assert caught[0].filename == __file__


RATE = 1.0


@njit
def helper_with_global(y):
    return -RATE * y


@pytest.mark.parametrize(
    "rhs",
    [
        lambda t, y, params: -RATE * y,
        lambda t, y, params: helper_with_global(y),
        njit(lambda t, y: -RATE * y),
        lambda t, y: np.array([-RATE * v for v in y]),
    ],
)
def test_a_run_takes_the_present_values_of_globals(rhs, monkeypatch):
    eq = equation(rhs, y0=1.0)
    slow = run(eq).y
    np.testing.assert_array_equal(run(eq).y, slow)
    monkeypatch.setitem(globals(), "RATE", 3.0)
    fast = run(eq).y
    np.testing.assert_array_equal(fast, run(equation(lambda t, y: -3.0 * y)).y)
    assert fast[-1, 0] < 0.7 * slow[-1, 0]
    monkeypatch.setitem(globals(), "RATE", 1.0)
    np.testing.assert_array_equal(run(eq).y, slow)


def test_a_run_takes_the_present_values_of_closed_over_arrays():
    rate = np.array([1.0])
    eq = equation(lambda t, y: -rate[0] * y, jac=lambda t, y: np.array([[-rate[0]]]))
    slow = run(eq, hd.L1()).y
    rate[0] = 3.0
    expected = run(equation(lambda t, y: -3.0 * y), hd.L1()).y
    np.testing.assert_allclose(run(eq, hd.L1()).y, expected, rtol=1e-9)
    assert run(eq, hd.L1()).y[-1, 0] < 0.7 * slow[-1, 0]
    rate[0] = np.nan
    with pytest.raises(ValueError, match="rhs must be finite at t = 0"):
        run(eq)


def test_lyapunov_takes_the_present_values():
    rate = np.array([0.5])
    eq = hd.Equation(hd.Caputo(1.0), lambda t, y: rate[0] * y, 1.0)
    rate[0] = 2.0
    found = hd.lyapunov(eq, 5.0, 500).exponents[0]
    assert found == hd.lyapunov(eq.replace(), 5.0, 500).exponents[0]
    assert found == pytest.approx(2.0, abs=0.1)


def test_equations_made_from_others():
    eq = equation(lambda t, y, p: -p[0] * y, jac=lambda t, y, p: np.array([[-p[0]]]))
    assert eq.replace(params=[3.0]).system.functions.rhs is eq.system.functions.rhs
    assert eq.replace(y0=[1.0, 2.0], jac=None).d == 2
    assert eq.replace(terms=hd.Caputo(0.5)).orders.tolist() == [[0.5]]
    assert not eq.replace(rhs=damped, jac=None).system.has_jac


def damped(t, y, p):
    return (p[1] * np.cos(t) - p[0]) * y


def damped_by_memory(t, y, memory, p):
    return p[1] * np.cos(t) * memory[0] - p[0] * y


LATER = {"t_start": 2.0}
COMPLEX = {"y0": [1.0 + 0.5j]}
BANDED = {"y0": [1.0, 2.0], "bandwidth": (0, 0)}
CHAINED = {"terms": hd.Caputo(2.5) + hd.Caputo(1.0), "y0": [1.0, 0.0, 0.0]}
READING = {"rhs": damped_by_memory, "memory": hd.Caputo(0.3)}


@pytest.mark.parametrize("given", [{}, LATER, COMPLEX, BANDED, CHAINED, READING])
def test_other_params_give_the_equation_that_they_would_have_made(given):
    how = {"terms": hd.Caputo(0.7), "rhs": damped, "y0": 1.0} | given
    eq = hd.Equation(params=[1.0, 0.2], **how)
    replaced = eq.replace(params=[2.0, 0.3])
    made = hd.Equation(params=[2.0, 0.3], **how)
    assert replaced.params.tolist() == [2.0, 0.3]
    assert eq.params.tolist() == [1.0, 0.2]
    ends = [hd.solve(one, 3.0, 200, estimate=False).y for one in (replaced, made, eq)]
    assert np.array_equal(ends[0], ends[1])
    assert not np.array_equal(ends[0], ends[2])
    again = pickle.loads(pickle.dumps(eq.replace(params=[4.0, 0.3]).replace(params=[2.0, 0.3])))
    assert np.array_equal(hd.solve(again, 3.0, 200, estimate=False).y, ends[0])


def test_a_function_of_no_module_may_print_too(capfd):
    eq = equation(of_no_module("def rhs(t, y):\n    print('at', t)\n    return -y"), params=())
    capfd.readouterr()
    eq.system.rhs(0.5, np.ones(1))
    assert capfd.readouterr().out == "at 0.5\n"


@njit
def recursive(n):
    return 1.0 if n < 2 else recursive(n - 1) + recursive(n - 2)


HELPERS = ModuleType("helpers")
HELPERS.doubled = njit(lambda y: 2.0 * np.asarray(y))  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("rhs", "expected"),
    [
        (lambda t, y: -recursive(6) * y, [-13.0, -26.0]),
        (lambda t, y: (y[1], 0), [2.0, 0.0]),
        (lambda t, y: [y[1], 3], [2.0, 3.0]),
    ],
)
def test_helpers_and_values_of_all_kinds_are_compiled(rhs, expected):
    eq = equation(rhs, [1.0, 2.0], params=())
    assert eq.system.functions.bare
    assert eq.system.rhs(0.0, np.array([1.0, 2.0])).tolist() == expected


def test_a_helper_that_an_equation_has_compiled_is_called_in_python():
    assert equation(lambda t, y: HELPERS.doubled(y), params=()).system.functions.bare
    assert HELPERS.doubled(np.ones(2)).tolist() == [2.0, 2.0]


def test_a_function_that_is_known_is_compared_at_every_start():
    """Whole numbers overflow in compiled code alone, and for some parameters alone."""

    def power(t, y, p):
        return 2 ** int(p[0]) * 1e-20 * y

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hd.Equation(hd.Caputo(0.5), power, 1.0, params=[10.0])
    with pytest.warns(hd.PythonFunctionWarning, match="whole numbers"):
        eq = hd.Equation(hd.Caputo(0.5), power, 1.0, params=[64.0])
    found, exact = hd.solve(eq, 1e-3, 10).y, hd.solve(eq.replace(rhs=grown), 1e-3, 10).y
    assert np.abs(found / exact - 1).max() < 1e-12


def grown(t, y, p):
    return 2.0 ** p[0] * 1e-20 * y


def test_equations_are_made_under_a_profiler():
    """It changes the hashes of code in Python 3.11, by which compiled versions are known."""
    known, profiler = chosen(steps="uniform")[:40], cProfile.Profile()
    for case in known:
        case.equation()
    profiler.enable()
    try:
        made = [case.equation() for case in known]
    finally:
        profiler.disable()
    assert len(made) == 40
