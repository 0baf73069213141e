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
from scipy.interpolate import CubicSpline

import hereditary as hd

SCHEMES = (hd.ExplicitCaputo(), hd.L1(), hd.BDF(2), hd.Adams(), hd.Collocation())
RATES = np.array([[-2, 1], [0, -1]])
TIMES = np.linspace(0.0, 2.0, 9)


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


def of_rates(t, y, rates):
    return rates @ y - np.array([0.0, t * y[1] ** 3])


def whole_numbers(t, y):
    return RATES @ y - np.array([0, t * y[1] ** 3])


def special(t, y):
    return compiled(t, y) * float(scipy.special.gamma(2.0))


def tries(t, y):
    try:
        ramp = math.sqrt(t - 3.0)
    except ValueError:
        ramp = t
    return np.array([-2.0 * y[0] + y[1], -y[1] - ramp * y[1] ** 3])


def formats(t, y):
    return compiled(float(f"{t!r}"), y)


IN_PYTHON = {
    "method": Model().method,
    "object": Model(),
    "in place": Model().in_place,
    "partial": partial(of_rates, rates=RATES),
    "whole numbers": whole_numbers,
    "scipy.special": special,
    "try": tries,
    "format": formats,
    "lambda": lambda t, y: Model.method(MODEL, t, y),
}
MODEL = Model()


def equation(rhs, **given):
    return hd.Equation(hd.Caputo(0.8), rhs, [1.0, -0.5], **given)


def in_python(rhs, **given):
    with pytest.warns(hd.PythonFunctionWarning):
        return equation(rhs, **given)


def run(eq, scheme, t_end=2.0, **given):
    steps = {"rtol": 1e-8} if isinstance(scheme, hd.Collocation) else {"n_steps": 150}
    return hd.solve(eq, t_end, scheme=scheme, **steps, **given)


@pytest.mark.parametrize("kind", IN_PYTHON)
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_the_numbers_are_those_of_the_compiled_function(kind, scheme):
    ours, theirs = (run(eq, scheme) for eq in (in_python(IN_PYTHON[kind]), equation(compiled)))
    assert ours.success
    np.testing.assert_allclose(ours.y[-1], theirs.y[-1], rtol=1e-12)
    # rounding decides whether a kept Jacobian is enough; f in Python is looked at less often
    looks = 450 if scheme == hd.Collocation() else 0
    assert ours.stats["n_rhs"] == pytest.approx(theirs.stats["n_rhs"] - looks, rel=0.15)


@given(
    rates=st.lists(st.floats(0.0, 3.0), min_size=2, max_size=2),
    alpha=st.floats(0.1, 1.9),
    scheme=st.sampled_from(SCHEMES),
)
def test_an_object_gives_what_params_give(rates, alpha, scheme):
    class Decay:
        def __call__(self, t, y):
            return -np.array(rates) * y

    y0 = [1.0, 2.0] if alpha <= 1 else [[1.0, 2.0], [0.0, 1.0]]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hd.PythonFunctionWarning)
        ours = hd.Equation(hd.Caputo(alpha), Decay(), y0)
    theirs = hd.Equation(hd.Caputo(alpha), lambda t, y, p: -p * y, y0, rates)
    # a large step may leave the stability limit, in the same way with both
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hd.SolveWarning)
        found, expected = run(ours, scheme, 1.0), run(theirs, scheme, 1.0)
    assert found.status == expected.status
    np.testing.assert_array_equal(found.y, expected.y)


def scaled(y, rate):
    return rate * y


def cubed(y):
    return scaled(y, 1.0) ** 3


def with_helpers(t, y):
    return np.array([scaled(y[0], -2.0) + y[1], -y[1] - t * cubed(y[1])])


def test_plain_helpers_are_compiled_too():
    eq = equation(with_helpers)  # a warning would be an error
    np.testing.assert_allclose(run(eq, hd.L1()).y, run(equation(compiled), hd.L1()).y, rtol=1e-13)


def test_a_changed_helper_is_seen(monkeypatch):
    eq = equation(with_helpers)
    before = run(eq, hd.L1()).y
    monkeypatch.setitem(globals(), "cubed", lambda y: -1.0)
    assert np.abs(run(eq, hd.L1()).y - before).max() > 0.01


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_either_of_rhs_and_jac_may_be_in_python(scheme):
    class Slopes:
        def __call__(self, t, y):
            return jac(t, y)

    expected = run(equation(compiled, jac=jac), scheme)
    for rhs, slopes in ((compiled, Slopes()), (Model().method, jac), (Model(), Slopes())):
        sol = run(in_python(rhs, jac=slopes), scheme)
        np.testing.assert_allclose(sol.y[-1], expected.y[-1], rtol=1e-12)
        # by rounding a kept Jacobian may do for more steps, or fewer
        looks = 450 if scheme == hd.Collocation() else 0
        assert sol.stats["n_rhs"] == pytest.approx(expected.stats["n_rhs"] - looks, rel=0.15)


def reads_memory(t, y, memory, params):
    return -params[0] * y - (y**2 - 1) * memory[0]


def by_y(t, y, memory, params):
    return np.diag(-params[0] - 2 * y * memory[0])


def by_memory(t, y, memory, params):
    return np.diag(1 - y**2)


class Reader:
    def __init__(self, fun):
        self.fun = fun

    def read(self, t, y, memory, params):
        return self.fun(t, y, memory, params)


@pytest.mark.parametrize("places", [(0, 1, 2), (0,), (2,)], ids=str)
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_memory_is_read_in_python(scheme, places):
    def made(*functions):
        rhs, jac, jac_memory = functions
        read = {"memory": hd.Caputo(0.4), "jac": jac, "jac_memory": jac_memory}
        return equation(rhs, params=[0.7], **read)

    functions = [reads_memory, by_y, by_memory]
    theirs = run(made(*functions), scheme, 1.0)
    for place in places:
        functions[place] = Reader(functions[place]).read
    with pytest.warns(hd.PythonFunctionWarning):
        sol = run(made(*functions), scheme, 1.0)
    np.testing.assert_allclose(sol.y[-1], theirs.y[-1], rtol=1e-12)


def test_pairs_and_tangents_go_through_python():
    def lorenz(t, y):
        return [10 * (y[1] - y[0]), y[0] * (28 - y[2]) - y[1], y[0] * y[1] - 8 / 3 * y[2]]

    class Lorenz:
        def __call__(self, t, y):
            return lorenz(t, y)

    made = partial(hd.Equation, hd.Caputo(0.99), y0=[1.0, 2.0, 20.0])
    with pytest.warns(hd.PythonFunctionWarning):
        ours = made(Lorenz())
    theirs = made(lambda t, y: np.array(lorenz(t, y)))
    for mode in ("tangent", "pair"):
        how = {"t_end": 2.0, "n_steps": 400, "mode": mode, "k": 1, "renorm": 0.5}
        found, expected = (hd.lyapunov(eq, **how).exponents for eq in (ours, theirs))
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_it_is_told_once_with_the_place_the_reason_and_the_price():
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


def raises_late(t, y):
    if t > 1.0:
        raise Late("too late")
    return [-y[0], -y[1]]


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_exceptions_pass_through_with_their_traceback_and_the_time(scheme):
    eq = in_python(_late())
    with pytest.raises(Late, match="too late") as caught:
        run(eq, scheme)
    error = caught.value
    lines = traceback.extract_tb(error.__traceback__)
    assert lines[-1].line == 'raise Late("too late")'
    (told, kept) = error.__notes__
    t = float(told.removeprefix("raised by rhs at t = "))
    sol = error.result
    assert sol.status is hd.Status.RHS_FAILED
    assert sol.t[-1] <= 1.0 + 2 / 150 < 1.1
    assert t > 1.0
    assert "result" in kept
    # what was computed goes on
    again = hd.solve(
        equation(compiled), 2.0, resume=sol.state, allow_change=True, **_tolerances(scheme)
    )
    assert again.success


def _late():
    class LateObject:
        def __call__(self, t, y):
            return raises_late(t, y)

    return LateObject()


def _tolerances(scheme):
    return {"rtol": 1e-8} if isinstance(scheme, hd.Collocation) else {}


def test_an_exception_of_jac_passes_through():
    def slopes(t, y):
        if t > 0.0:
            raise Late("slopes")
        return [[-1.0, 0.0], [0.0, float(scipy.special.gamma(1.0)) * -1.0]]

    with pytest.raises(Late, match="slopes") as caught:
        run(in_python(lambda t, y: -y, jac=slopes), hd.L1())
    assert caught.value.__notes__[0].startswith("raised by jac at t = 0.01")


def test_an_exception_in_lyapunov_passes_through():
    with pytest.raises(Late) as caught:
        hd.lyapunov(in_python(_late()), 2.0, n_steps=200, k=1, renorm=0.1)
    assert caught.value.result.status is hd.Status.RHS_FAILED
    assert caught.value.result.times[-1] == pytest.approx(1.0)


def test_other_values_than_at_the_start_are_refused():
    def grows(t, y):
        return [-y[0], float(scipy.special.gamma(1.0))] if t < 0.5 else [1.0, 2.0, 3.0]

    with pytest.raises(ValueError, match="another shape than at the start"):
        run(in_python(grows), hd.L1())


def test_writing_into_y_is_refused_and_keeping_it_is_not():
    seen = []

    class Keeps:
        def __call__(self, t, y):
            seen.append(y)
            if t > 1.0:
                y[0] = 0.0
            return -y

    with pytest.raises(ValueError, match="read-only") as caught:
        run(in_python(Keeps()), hd.ExplicitCaputo())
    # beside the rows there are points for differences
    rows = caught.value.result.y
    apart = np.abs(rows[None] - np.array(seen[1:-1])[:, None]).max(axis=2).min(axis=1)
    assert apart.max() < 1e-5
    assert np.mean(apart < 1e-14) > 0.8


def test_runs_in_threads_keep_to_their_own_functions():
    class Rate:
        def __init__(self, rate):
            self.rate = rate

        def __call__(self, t, y):
            if self.rate > 3 and t > 0.5:
                raise Late(str(self.rate))
            return -self.rate * y

    def one(rate):
        try:
            return hd.solve(equations[rate], 1.0, 3000).y[-1, 0]
        except Late as error:
            return str(error)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hd.PythonFunctionWarning)
        equations = {rate: equation(Rate(rate)) for rate in (1.0, 2.0, 3.0, 4.0, 5.0)}
    alone = {rate: one(rate) for rate in equations}
    found = {}
    threads = [
        threading.Thread(target=lambda rate=rate: found.update({rate: one(rate)}))
        for rate in equations
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == alone
    assert alone[4.0] == "4.0"


def point(rate):
    class Decay:
        def __call__(self, t, y):
            if rate > 2:
                raise Late("no rate")
            return -rate * y

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hd.PythonFunctionWarning)
        sol = hd.solve(hd.Equation(hd.Caputo(0.5), Decay(), 1.0), 1.0, 50)
    return {"y": sol.y[-1, 0]}


def test_sweeps_take_such_functions():
    table = hd.sweep(point, {"rate": [1.0, 2.0, 3.0]})
    assert np.all(np.isfinite(table["y"][:2]))
    assert np.isnan(table["y"][2])
    assert "Late: no rate" in table.status[2]


@pytest.mark.skipif(os.name == "nt", reason="no signals to send")
@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_ends_a_run_and_keeps_its_rows():
    class Interrupts:
        calls = 0

        def __call__(self, t, y):
            self.calls += 1
            if self.calls == 500:
                os.kill(os.getpid(), signal.SIGINT)
            return -y

    eq = in_python(Interrupts())
    sol = hd.solve(eq, 1.0, 2_000_000)
    assert sol.status is hd.Status.INTERRUPTED
    assert 400 < sol.t.size < 200_000
    np.testing.assert_array_equal(sol.y, run_of_length(sol.t.size - 1))


def run_of_length(n):
    return hd.solve(equation(lambda t, y: -y), n * 0.5e-6, n).y


def test_equations_pickle():
    eq = pickle.loads(pickle.dumps(equation(compiled, jac=jac)))
    assert np.array_equal(run(eq, hd.L1()).y, run(equation(compiled, jac=jac), hd.L1()).y)
    with pytest.warns(hd.PythonFunctionWarning):
        eq = pickle.loads(pickle.dumps(equation(Model().method)))
    np.testing.assert_allclose(run(eq, hd.L1()).y, run(equation(compiled), hd.L1()).y, rtol=1e-12)


def test_a_run_goes_on_in_another_process_state():
    eq = in_python(Model())
    half = run(eq, hd.L1(), 1.0)
    later = hd.solve(equation(Model()), 2.0, resume=pickle.loads(pickle.dumps(half.state)))
    whole = hd.solve(eq, 2.0, 300, scheme=hd.L1())
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

    class Decay:
        def __call__(self, t, y, p):
            return -p.size * y

    assert equation_in_python(Decay(), slopes).jacobian(0.0, [1.0, 2.0])[0, 0] == -1.0


def equation_in_python(rhs, jac):
    return in_python(rhs, jac=jac, params=[3.0])


def test_a_changed_object_is_another_right_hand_side():
    class Decay:
        k = 1.0

        def __call__(self, t, y):
            return -self.k * y

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


def test_classes_and_keyword_defaults_tell_right_hand_sides_apart():
    def made(k):
        class Decay:
            def __call__(self, t, y):
                return -k * y

        return Decay()

    def keyword(k):
        def decay(t, y, *, k=k):
            return -k * y

        return decay

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hd.PythonFunctionWarning)
        for make in (made, keyword):
            digests = [equation(make(k)).system.rhs_digest for k in (1.0, 1.0, 5.0)]
            assert digests[0] == digests[1] != digests[2]


@pytest.mark.parametrize("value", [None, "one", 1j, np.array([1j, 0])])
def test_values_that_are_no_real_numbers_end_the_run(value):
    class Late:
        def __call__(self, t, y):
            return -y if t < 0.5 else value

    with pytest.raises((TypeError, ValueError), match="rhs must return real numbers, got"):
        run(in_python(Late()), hd.L1())


class Refuses(Exception):
    """An exception that takes no attributes."""

    def __setattr__(self, name, value):
        raise AttributeError(name)

    def add_note(self, note):
        raise TypeError("no notes")


@pytest.mark.parametrize("scheme", [hd.L1(), hd.Collocation()], ids=repr)
def test_exceptions_that_take_no_attributes_pass_through(scheme):
    class Raises:
        def __call__(self, t, y):
            if t > 0.5:
                raise Refuses("no")
            return -y

    with pytest.raises(Refuses, match="no"):
        run(in_python(Raises()), scheme)


def test_the_jacobian_of_a_function_in_python_raises_what_it_raises():
    class Only:
        def __call__(self, t, y):
            if y[0] != 1.0:
                raise Late("only there")
            return -y

    with pytest.raises(Late, match="only there"):
        in_python(Only()).jacobian(0.0, [2.0, 0.0])


def test_lists_in_a_table_leak_no_warning_of_numba():
    """In Python where they are global, compiled where they are written in the function."""
    t, values = [0.0, 1.0, 2.0], [0.0, 3.0, 1.0]

    def of_lists(time, y):
        return np.interp(time, t, values) - y

    def of_own_lists(time, y):
        return np.interp(time, [0.0, 1.0, 2.0], [0.0, 3.0, 1.0]) - y

    places, heights = np.array(t), np.array(values)

    def of_arrays(time, y):
        return np.interp(time, places, heights) - y

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = [
            hd.solve(hd.Equation(hd.Caputo(0.8), rhs, 0.0), 2.0, 50, scheme=hd.L1()).y
            for rhs in (of_lists, of_own_lists, of_arrays)
        ]
    assert [warning.category for warning in caught] == [hd.PythonFunctionWarning]
    assert abs(np.diff(found, axis=0)).max() < 1e-12
