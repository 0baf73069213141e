"""How runs end: statuses, truth, and the warning of every ending that was not asked for."""

import pickle
from functools import cache

import numpy as np
import pytest

import hereditary as hd


def squared(t, y):
    return y**2


bursting = cache(lambda: hd.Equation(hd.Caputo(0.9), squared, 1.0))
WAYS = [{"n_steps": 1000}, {"rtol": 1e-6}]


def test_statuses_are_their_strings():
    for status in hd.Status:
        assert status == str(status) == f"{status}" == status.name.lower()
        assert hd.Status(str(status)) is status
        assert pickle.loads(pickle.dumps(status)) is status
        assert " " in status.sentence
    assert len({status.sentence for status in hd.Status}) == len(hd.Status)


@pytest.mark.parametrize("how", WAYS)
def test_a_run_that_ends_early_warns_and_is_false(how):
    with pytest.warns(hd.SolveWarning, match="stopped being finite") as caught:
        sol = hd.solve(bursting(), 5.0, **how)
    assert len(caught) == 1
    assert caught[0].filename == __file__  # the line of the call, not one of the library
    assert str(caught[0].message) == sol.message
    assert sol.message.startswith(sol.status.sentence)
    assert sol.status == "blown_up"
    assert not sol


@pytest.mark.parametrize("how", WAYS)
def test_a_run_ends_exactly_where_it_was_asked_to(how):
    """It is true then, and quiet."""
    for t_end in (0.1, 0.7, 123.456, 1e-9, 1e9):
        equation = hd.scenes.relaxation(0.5, t_end**-0.5)
        sol = hd.solve(equation, t_end, **how)
        assert sol
        assert sol.status == "completed"
        assert sol.t[-1] == t_end
        assert np.all(np.diff(sol.t) > 0)
        rounded = sol.t[:-1] * (1 + 2e-16)
        assert hd.solve(equation, t_end, **how, t_eval=rounded).t.size == rounded.size


@pytest.mark.parametrize(
    ("how", "off", "relative"),
    [({"n_steps": 2000}, 0.05, 0.1), ({"rtol": 1e-6}, 1e-5, 1e-2), ({"rtol": 1e-10}, 1e-9, 1e-6)],
)
def test_blow_up_is_told_where_it_happens(how, off, relative):
    """y = 1 / (1 - t); what was computed is kept, and the dense output covers it."""
    with pytest.warns(hd.SolveWarning, match="stopped being finite"):
        sol = hd.solve(hd.Equation(hd.Caputo(1.0), squared, 1.0), 2.0, **how)
    assert sol.status is hd.Status.BLOWN_UP
    assert sol.t[-1] == pytest.approx(1.0, abs=off)
    assert np.all(np.isfinite(sol.y[:-1]))
    t = np.linspace(0, 0.9, 50)
    np.testing.assert_allclose(sol(t)[:, 0], 1 / (1 - t), rtol=relative)


def test_blow_up_with_memory_does_not_depend_on_the_tolerance():
    ends = []
    for rtol in (1e-6, 1e-9):
        with pytest.warns(hd.SolveWarning, match="stopped being finite"):
            sol = hd.solve(hd.Equation(hd.Caputo(0.8), squared, 1.0), 2.0, rtol=rtol)
        assert np.all(np.isfinite(sol.y))
        ends.append(sol.t[-1])
    assert ends == pytest.approx([0.6288] * 2, abs=1e-4)
    assert ends[0] == pytest.approx(ends[1], abs=1e-5)


@pytest.mark.parametrize("order", [0.3, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("power", [2, 3])
def test_blow_up_is_told_at_loose_tolerances_too(order, power):
    """Newton's method fails in the last steps there; f does not jump."""
    growth = hd.Equation(hd.Caputo(order), lambda t, y, p: y ** p[0], 1.0, params=[power])
    ends = []
    for rtol in (1e-2, 1e-3, 1e-4, 1e-8):
        with pytest.warns(hd.SolveWarning, match="stopped being finite"):
            ends.append(hd.solve(growth, 5.0, rtol=rtol).t[-1])
    assert ends == pytest.approx([ends[-1]] * 4, rel=0.01)


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-10])
@pytest.mark.parametrize("turn", [0.0, 1.0])
@pytest.mark.parametrize("order", [0.7, 1.0, 1.6])
def test_growth_beyond_the_range_of_numbers_blows_up(order, turn, rtol):
    """Steps end soon after 1e300, also if they are few between two events."""
    growth = hd.Equation(
        hd.Caputo(order),
        lambda t, y, p: np.array([y[0] + p[0] * y[1], y[1] - p[0] * y[0]]),
        [[1.0, 0.5], [0.0, 0.0]][: 1 + (order > 1)],
        params=[turn],
    )
    for changes in ({}, {0.1: lambda t, y: y}):
        with pytest.warns(hd.SolveWarning, match="stopped being finite"):
            sol = hd.solve(growth, 2000.0, rtol=rtol, changes=changes)
        assert sol.status is hd.Status.BLOWN_UP
        assert 1e300 < np.abs(sol.y).max() < np.inf
        assert sol.stats["n_rejected"] < sol.stats["n_steps"] / 4


def raises_late(t, y, p):
    if t > p[0]:
        raise ValueError("no further")
    return -y


@pytest.mark.parametrize("how", [{"n_steps": 400}, {"rtol": 1e-8}])
@pytest.mark.parametrize("late", [0.5, 0.0])
def test_an_exception_in_the_right_hand_side_keeps_what_was_computed(how, late):
    equation = hd.Equation(hd.Caputo(0.5), raises_late, 1.0, params=[late])
    with pytest.warns(hd.SolveWarning, match="ValueError: no further"):
        sol = hd.solve(equation, 2.0, **how)
    assert sol.status is hd.Status.RHS_FAILED
    assert "ValueError: no further" in sol.message
    assert min(late, 0.3) <= sol.t[-1] <= late + 2.0 / 400
    whole = hd.solve(hd.scenes.relaxation(0.5), 2.0, **how)
    np.testing.assert_allclose(sol.y, whole(sol.t), rtol=0.0 if "n_steps" in how else 1e-8)


def test_a_step_beyond_the_limit_warns_at_the_callers_line():
    fast = hd.scenes.relaxation(0.9, rate=200.0)
    with pytest.warns(hd.StabilityWarning) as caught:
        hd.solve(fast, 1.0, 100)
    assert len(caught) == 1
    assert issubclass(hd.StabilityWarning, hd.SolveWarning)
    assert caught[0].filename == __file__


def test_exponents_of_a_run_that_ends_early_warn_once_at_the_callers_line():
    with pytest.warns(hd.SolveWarning) as caught, np.errstate(over="ignore"):
        hd.lyapunov(bursting(), 5.0, 1000, verify=True)
    assert [warning.filename for warning in caught] == [__file__]


def test_ctrl_c_is_quiet(monkeypatch):
    """Whoever pressed it knows."""
    monkeypatch.setattr(
        "hereditary.solver.run.Interruption.__enter__",
        lambda self: setattr(self, "asked", True) or self,
    )
    monkeypatch.setattr("hereditary.collocation.adaptive_stepper._MAX_STEPS_PER_MARCH", 1)
    sol = hd.solve(hd.scenes.relaxation(), 1.0, rtol=1e-6)
    assert sol.status == "interrupted"
    assert not sol


def test_a_kernel_that_fails_is_not_told_as_the_right_hand_side():
    """Nor the other way round, beside a kernel."""

    def early(t):
        if np.any(np.asarray(t) < 1e-4):
            raise ArithmeticError("no data so early")
        return np.exp(-t)

    def rhs(t, y, p):
        if t >= p[0]:
            raise ValueError("no force so late")
        return -y

    kernel = hd.Kernel(early, singular_exponent=0.0)
    fails = hd.Equation([hd.Caputo(1.0), hd.Memory(kernel, 1)], rhs, 1.0, params=[99.0])
    with pytest.raises(ValueError, match=r"got ArithmeticError at t = .*no data so early"):
        hd.solve(fails, 1.0, rtol=1e-4)  # before the run
    terms = [hd.Caputo(1.0), hd.Memory(hd.Prony([1.0], [1.0]), 1)]
    for params in ([1e-7], [0.5]):
        with pytest.warns(hd.SolveWarning, match="ValueError: no force so late"):
            sol = hd.solve(fails.replace(terms=terms, params=params), 1.0, rtol=1e-4)
        assert sol.status is hd.Status.RHS_FAILED


@pytest.mark.filterwarnings("ignore::hereditary.SolveWarning")
@pytest.mark.parametrize(("order", "rtol"), [(0.6, 1e-4), (0.8, 1e-6), (1.5, 1e-6), (1.8, 1e-10)])
def test_a_relay_does_not_blow_up_where_the_solution_crosses_zero(order, rtol):
    """There y grows in no time from nothing; it never gets to be as large as it was."""
    y0 = [1.0, 0.0][: 1 + (order > 1)]
    for size in (0.3, 1.0, 3.0):
        params, relay = [size], hd.Caputo(order)
        equation = hd.Equation(relay, lambda t, y, p: -p[0] * np.sign(y) - y, y0, params=params)
        assert hd.solve(equation, 20.0, rtol=rtol).status != "blown_up"
