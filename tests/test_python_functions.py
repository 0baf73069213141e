"""Functions that numba cannot compile: called in Python, with the numbers of compiled ones."""

import gc
import math
import os
import pickle
import signal
import threading
import traceback
import warnings
from functools import partial

import numpy as np
import pytest
import scipy.special
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from problems import run
from scipy.interpolate import CubicSpline

import hereditary as hd

SCHEMES = (hd.ExplicitCaputo(), hd.L1(), hd.BDF(2), hd.Adams(), hd.Collocation())
RATES = np.array([[-2, 1], [0, -1]])
TIMES = np.linspace(0.0, 2.0, 9)
run = partial(run, n=150, rtol=1e-8)


def compiled(t, y):
    return np.array([-2.0 * y[0] + y[1], -y[1] - t * y[1] ** 3])


def jac(t, y):
    return np.array([[-2.0, 1.0], [0.0, -1.0 - 3 * t * y[1] ** 2]])


class Model:
    """A right-hand side in every form that numba refuses."""

    def __init__(self):
        self.rates = {"fast": 2.0, "slow": 1.0}
        self.ramp = CubicSpline(TIMES, TIMES)

    def method(self, t, y):
        p = self.rates
        return [-p["fast"] * y[0] + p["slow"] * y[1], -y[1] - float(self.ramp(t)) * y[1] ** 3]

    def __call__(self, t, y):
        return self.method(t, y)

    def in_place(self, t, y, dy, params):
        dy[:] = self.method(t, y)


def special(t, y):
    return compiled(t, y) * float(scipy.special.gamma(2.0))


def tries(t, y):
    try:
        ramp = math.sqrt(t - 3.0)
    except ValueError:
        ramp = t
    return np.array([-2.0 * y[0] + y[1], -y[1] - ramp * y[1] ** 3])


MODEL = Model()
IN_PYTHON = {
    "method": MODEL.method,
    "object": MODEL,
    "in place": MODEL.in_place,
    "partial": partial(lambda t, y, rates: rates @ y - [0.0, t * y[1] ** 3], rates=RATES),
    "whole numbers": lambda t, y: RATES @ y - np.array([0, t * y[1] ** 3]),
    "scipy.special": special,
    "try": tries,
    "format": lambda t, y: compiled(float(f"{t!r}"), y),
    "lambda": lambda t, y: Model.method(MODEL, t, y),
}


def equation(rhs, **given):
    return hd.Equation(hd.Caputo(0.8), rhs, [1.0, -0.5], **given)


def in_python(rhs, **given):
    """Make the equation of a function that numba refuses, as it does any `partial`."""
    with pytest.warns(hd.PythonFunctionWarning):
        return equation(rhs, **given)


def silently(rhs, **given):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hd.PythonFunctionWarning)
        return equation(rhs, **given)


def assert_same_run(ours, theirs, scheme):
    assert ours.success
    np.testing.assert_allclose(ours.y[-1], theirs.y[-1], rtol=1e-12)
    # rounding decides whether a kept Jacobian is enough; f in Python is looked at less often
    looks = 450 if scheme == hd.Collocation() else 0
    assert ours.stats["n_rhs"] == pytest.approx(theirs.stats["n_rhs"] - looks, rel=0.15)


@pytest.mark.parametrize("kind", IN_PYTHON)
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_the_numbers_are_those_of_the_compiled_function(kind, scheme):
    ours, theirs = (run(eq, scheme) for eq in (in_python(IN_PYTHON[kind]), equation(compiled)))
    assert_same_run(ours, theirs, scheme)


@given(
    rates=st.lists(st.floats(0.0, 3.0), min_size=2, max_size=2),
    alpha=st.floats(0.1, 1.9),
    scheme=st.sampled_from(SCHEMES),
)
def test_an_object_gives_what_params_give(rates, alpha, scheme):
    y0 = [1.0, 2.0] if alpha <= 1 else [[1.0, 2.0], [0.0, 1.0]]
    with warnings.catch_warnings():
        # a large step may leave the stability limit, in the same way with both
        warnings.simplefilter("ignore")
        ours = hd.Equation(hd.Caputo(alpha), partial(lambda t, y: -np.array(rates) * y), y0)
        theirs = hd.Equation(hd.Caputo(alpha), lambda t, y, p: -p * y, y0, rates)
        found, expected = run(ours, scheme, 1.0), run(theirs, scheme, 1.0)
    assert found.status == expected.status
    np.testing.assert_array_equal(found.y, expected.y)


def scaled(y, rate):
    return rate * y


def cubed(y):
    return scaled(y, 1.0) ** 3


def with_helpers(t, y):
    return np.array([scaled(y[0], -2.0) + y[1], -y[1] - t * cubed(y[1])])


def test_plain_helpers_are_compiled_too_and_a_changed_one_is_seen(monkeypatch):
    eq = equation(with_helpers)  # a warning would be an error
    before = run(eq, hd.L1()).y
    np.testing.assert_allclose(before, run(equation(compiled), hd.L1()).y, rtol=1e-13)
    monkeypatch.setitem(globals(), "cubed", lambda y: -1.0)
    assert np.abs(run(eq, hd.L1()).y - before).max() > 0.01


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_either_of_rhs_and_jac_may_be_in_python(scheme):
    expected = run(equation(compiled, jac=jac), scheme)
    for rhs, slopes in ((compiled, partial(jac)), (MODEL.method, jac), (MODEL, partial(jac))):
        assert_same_run(run(in_python(rhs, jac=slopes), scheme), expected, scheme)


READERS = (
    lambda t, y, memory, params: -params[0] * y - (y**2 - 1) * memory[0],
    lambda t, y, memory, params: np.diag(-params[0] - 2 * y * memory[0]),
    lambda t, y, memory, params: np.diag(1 - y**2),
)


@pytest.mark.parametrize("places", [(0, 1, 2), (0,), (2,)], ids=str)
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_memory_is_read_in_python(scheme, places):
    mixed = [partial(fun) if place in places else fun for place, fun in enumerate(READERS)]
    ends = []
    for make, (rhs, jac, jac_memory) in ((equation, READERS), (in_python, mixed)):
        given = {"memory": hd.Caputo(0.4), "jac": jac, "jac_memory": jac_memory}
        ends.append(run(make(rhs, params=[0.7], **given), scheme, 1.0).y[-1])
    np.testing.assert_allclose(*ends, rtol=1e-12)


def lorenz(t, y):
    return [10 * (y[1] - y[0]), y[0] * (28 - y[2]) - y[1], y[0] * y[1] - 8 / 3 * y[2]]


@pytest.mark.parametrize("mode", ["tangent", "pair"])
def test_pairs_and_tangents_go_through_python(mode):
    theirs = hd.Equation(hd.Caputo(0.99), lorenz, [1.0, 2.0, 20.0])
    with pytest.warns(hd.PythonFunctionWarning):
        ours = theirs.replace(rhs=partial(lorenz))
    how = {"t_end": 2.0, "n_steps": 400, "mode": mode, "k": 1, "renorm": 0.5}
    found, expected = (hd.lyapunov(eq, **how).exponents for eq in (ours, theirs))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_warning_has_the_place_the_reason_and_the_price_once():
    line = special.__code__.co_firstlineno + 1
    with pytest.warns(hd.PythonFunctionWarning) as caught:
        equation(special)
    equation(special)  # a warning would be an error
    (told,) = caught
    assert told.filename == __file__
    for part in (
        f"rhs is called in Python, for numba cannot compile it at line {line} of {__file__}",
        "Unknown attribute 'gamma'",
        "use arithmetic, math and NumPy functions",
        "times as long",
    ):
        assert part in str(told.message)


class Late(Exception):
    pass


class Refuses(Exception):
    """An exception that takes no attributes."""

    def __setattr__(self, name, value):
        raise AttributeError(name)

    def add_note(self, note):
        raise TypeError("no notes")


def raises_late(t, y, error):
    if t > 1.0:
        raise error("too late")
    return [-y[0], -y[1]]


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_exceptions_pass_through_with_their_traceback_and_the_time(scheme):
    with pytest.raises(Late, match="too late") as caught:
        run(in_python(partial(raises_late, error=Late)), scheme)
    error = caught.value
    assert traceback.extract_tb(error.__traceback__)[-1].line == 'raise error("too late")'
    (told, kept) = error.__notes__
    sol = error.result
    assert sol.status is hd.Status.RHS_FAILED
    assert sol.t[-1] <= 1.0 + 2 / 150 < 1.1
    assert float(told.removeprefix("raised by rhs at t = ")) > 1.0
    assert "result" in kept
    # what was computed goes on
    how = {"rtol": 1e-8} if scheme == hd.Collocation() else {}
    goes_on = {"resume": sol.state, "allow_change": True}
    assert hd.solve(equation(compiled), 2.0, **goes_on, **how).success


@pytest.mark.parametrize("scheme", [hd.L1(), hd.Collocation()], ids=repr)
def test_exceptions_that_take_no_attributes_pass_through(scheme):
    with pytest.raises(Refuses, match="late"):
        run(in_python(partial(raises_late, error=Refuses)), scheme)


def test_an_exception_of_jac_passes_through():
    def slopes(t, y):
        if t > 0.0:
            raise Late("slopes")
        return [[-1.0, 0.0], [0.0, -1.0]]

    with pytest.raises(Late, match="slopes") as caught:
        run(in_python(lambda t, y: -y, jac=partial(slopes)), hd.L1())
    assert caught.value.__notes__[0].startswith("raised by jac at t = 0.01")


def test_an_exception_in_lyapunov_passes_through():
    with pytest.raises(Late) as caught:
        hd.lyapunov(in_python(partial(raises_late, error=Late)), 2.0, n_steps=200, k=1, renorm=0.1)
    assert caught.value.result.status is hd.Status.RHS_FAILED
    assert caught.value.result.times[-1] == pytest.approx(1.0)


def test_the_jacobian_of_a_function_in_python_raises_what_it_raises():
    eq = in_python(partial(raises_late, error=Late))
    with pytest.raises(Late, match="too late"):
        eq.jacobian(1.5, [2.0, 0.0])


NO_NUMBERS = "rhs must return real numbers, got"


@pytest.mark.parametrize(
    ("value", "words"),
    [
        *((value, NO_NUMBERS) for value in (None, "one", 1j, np.array([1j, 0]))),
        ([1.0, 2.0, 3.0], "another shape than at the start"),
    ],
)
def test_values_of_other_kinds_or_shapes_than_at_the_start_end_the_run(value, words):
    with pytest.raises((TypeError, ValueError), match=words):
        run(in_python(partial(lambda t, y: -y if t < 0.5 else value)), hd.L1())


def test_writing_into_y_is_refused_and_keeping_it_is_not():
    seen = []

    def keeps(t, y):
        seen.append(y)
        if t > 1.0:
            y[0] = 0.0
        return -y

    with pytest.raises(ValueError, match="read-only") as caught:
        run(in_python(keeps), hd.ExplicitCaputo())
    # beside the rows there are points for differences
    rows = caught.value.result.y
    apart = np.abs(rows[None] - np.array(seen[1:-1])[:, None]).max(axis=2).min(axis=1)
    assert apart.max() < 1e-5
    assert np.mean(apart < 1e-14) > 0.8


def fading(t, y, rate, last):
    if rate > last and t >= 0.5:
        raise Late(f"no rate {rate}")
    return -rate * y


def test_runs_in_threads_keep_to_their_own_functions():
    def one(rate):
        try:
            return hd.solve(equations[rate], 1.0, 3000).y[-1, 0]
        except Late as error:
            return str(error)

    rates = (1.0, 2.0, 3.0, 4.0, 5.0)
    equations = {rate: silently(partial(fading, rate=rate, last=3.0)) for rate in rates}
    alone = {rate: one(rate) for rate in rates}
    found = {}
    threads = [
        threading.Thread(target=lambda rate=rate: found.update({rate: one(rate)})) for rate in rates
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == alone
    assert alone[4.0] == "no rate 4.0"


def point(rate):
    sol = hd.solve(silently(partial(fading, rate=rate, last=2.0)), 1.0, 50)
    return {"y": sol.y[-1, 0]}


def test_sweeps_take_such_functions():
    table = hd.sweep(point, {"rate": [1.0, 2.0, 3.0]})
    assert np.all(np.isfinite(table["y"][:2]))
    assert np.isnan(table["y"][2])
    assert "Late: no rate" in table.status[2]


@pytest.mark.skipif(os.name == "nt", reason="no signals to send")
@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_ends_a_run_and_keeps_its_rows():
    calls = []

    def interrupts(t, y):
        calls.append(t)
        if len(calls) == 500:
            os.kill(os.getpid(), signal.SIGINT)
        return -y

    sol = hd.solve(in_python(interrupts), 1.0, 2_000_000)
    assert sol.status is hd.Status.INTERRUPTED
    assert 400 < sol.t.size < 200_000
    n = sol.t.size - 1
    expected = hd.solve(equation(lambda t, y: -y), n * 0.5e-6, n)
    np.testing.assert_array_equal(sol.y, expected.y)


def test_equations_pickle():
    eq = pickle.loads(pickle.dumps(equation(compiled, jac=jac)))
    assert np.array_equal(run(eq, hd.L1()).y, run(equation(compiled, jac=jac), hd.L1()).y)
    with pytest.warns(hd.PythonFunctionWarning):
        eq = pickle.loads(pickle.dumps(equation(Model().method)))
    np.testing.assert_allclose(run(eq, hd.L1()).y, run(equation(compiled), hd.L1()).y, rtol=1e-12)


def test_a_run_goes_on_in_another_process_state():
    eq = in_python(Model())
    half, whole = hd.solve(eq, 1.0, 150, scheme=hd.L1()), hd.solve(eq, 2.0, 300, scheme=hd.L1())
    later = hd.solve(equation(Model()), 2.0, resume=pickle.loads(pickle.dumps(half.state)))
    np.testing.assert_array_equal(later.y[-1], whole.y[-1])


def test_dense_output_outlives_its_equation():
    """Of the first two steps f at 0 is asked for later, when only the solution is left."""
    direct = hd.solve(equation(compiled), 1.0, 1000)(0.0005)
    solution = hd.solve(in_python(Model().method), 1.0, 1000)
    stored = pickle.dumps(solution)
    gc.collect()

    def other(t, y):
        return 5 * y * len(f"{t}")

    others = [in_python(other), equation(other), equation(other)]
    for found in (solution, pickle.loads(stored)):
        np.testing.assert_allclose(found(0.0005), direct, rtol=1e-9)
    assert len(others) == 3


def test_params_do_not_show_addresses():
    eq = in_python(lambda t, y, p: -y * len(f"{p[0]}"), params=[3.0])
    assert eq.params.tolist() == [3.0]
    assert eq.replace(params=[4.0]).params.tolist() == [4.0]

    @njit
    def slopes(t, y, p):
        return np.diag(np.full(2, -float(p.size)))

    given = in_python(partial(lambda t, y, p: -p.size * y), jac=slopes, params=[3.0])
    assert given.jacobian(0.0, [1.0, 2.0])[0, 0] == -1.0


class Decay:
    k = 1.0

    def __call__(self, t, y):
        return -self.k * y


def test_a_changed_object_is_another_right_hand_side():
    rates = {"k": 1.0}
    for rhs, change in (
        (Decay(), lambda rhs: setattr(rhs, "k", 5.0)),
        (lambda t, y: -rates["k"] * y, lambda rhs: rates.update(k=5.0)),
    ):
        eq = in_python(rhs)
        state = hd.solve(eq, 1.0, 100).state
        assert hd.solve(eq, 2.0, resume=state).success
        change(rhs)
        with pytest.raises(ValueError, match="same right-hand side"):
            hd.solve(eq, 2.0, resume=state)
        assert hd.solve(eq, 2.0, resume=state, allow_change=True).success


def in_a_class(value):
    class OfValue:
        def __call__(self, t, y):
            return -value * y

    return OfValue()


def keyword(value):
    def decay(t, y, *, k=value):
        return -k * y

    return decay


@pytest.mark.parametrize("make", [in_a_class, keyword])
def test_classes_and_keyword_defaults_tell_right_hand_sides_apart(make):
    digests = [silently(make(k)).system.rhs_digest for k in (1.0, 1.0, 5.0)]
    assert digests[0] == digests[1] != digests[2]


def test_lists_in_a_table_leak_no_warning_of_numba():
    """In Python where they are global, compiled where they are written in the function."""
    t, values = [0.0, 1.0, 2.0], [0.0, 3.0, 1.0]
    places, heights = np.array(t), np.array(values)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = [
            hd.solve(hd.Equation(hd.Caputo(0.8), rhs, 0.0), 2.0, 50, scheme=hd.L1()).y
            for rhs in (
                lambda time, y: np.interp(time, t, values) - y,
                lambda time, y: np.interp(time, [0.0, 1.0, 2.0], [0.0, 3.0, 1.0]) - y,
                lambda time, y: np.interp(time, places, heights) - y,
            )
        ]
    assert [warning.category for warning in caught] == [hd.PythonFunctionWarning]
    assert abs(np.diff(found, axis=0)).max() < 1e-12
