"""The driver: rows, stopping and going on, endings of every kind."""

import math
import os
import pickle
import signal
import threading
import time
from functools import cache

import numpy as np
import pytest
from problems import PROBLEMS

import hereditary as hd

pytestmark = pytest.mark.core

HISTORIES = [hd.Direct(), hd.FFT(), hd.SumOfExponentials()]


def delayed(t, y, memory, p):
    return -p[0] * y - 0.5 * memory[0]


@pytest.mark.parametrize("memory", [None, hd.Delay(0.3, 1.0)], ids=["plain", "delay"])
@pytest.mark.parametrize(
    "how",
    [{"n_steps": 40}, {"rtol": 1e-6}, {"mesh": hd.graded(40, 2.0), "scheme": hd.L1()}],
    ids=lambda how: next(iter(how)),
)
def test_params_are_those_of_another_equation(how, memory):
    given = {"rhs": delayed, "memory": memory} if memory else {"rhs": lambda t, y, p: -p[0] * y}
    equation = hd.Equation(hd.Caputo(0.8), y0=1.0, params=[1.0], **given)
    sol = hd.solve(equation, 1.0, params=[2.0], **how)
    other = hd.solve(equation.replace(params=[2.0]), 1.0, **how)
    assert np.array_equal(sol.t, other.t)
    assert np.array_equal(sol.y, other.y)
    assert sol.state.identity == other.state.identity
    assert equation.params == [1.0]
    assert sol.y[-1] != hd.solve(equation, 1.0, **how).y[-1]


def test_going_on_accepts_either_count_of_steps():
    equation = hd.scenes.relaxation()
    state = hd.solve(equation, 1.0, 100).state
    ends = [hd.solve(equation, 2.0, n, resume=state).y[-1] for n in (None, 100, 200)]
    assert ends[0] == ends[1] == ends[2]


def test_state_is_small_with_modes_and_does_not_grow():
    equation = hd.scenes.stick_slip()
    sizes = [len(pickle.dumps(hd.solve(equation, 1.0, n).state)) for n in (1000, 100_000)]
    assert sizes[0] == pytest.approx(sizes[1], abs=64)
    assert sizes[1] < 8192


def test_times_and_shapes():
    sol = hd.solve(hd.scenes.stick_slip(), 2.0, 100)
    assert sol.t.shape == (101,)
    assert sol.y.shape == sol.ydot.shape == (101, 1)
    np.testing.assert_allclose(sol.t, np.linspace(0, 2, 101), rtol=1e-15)
    assert sol.y[0, 0] == 0.2
    assert sol.ydot[0, 0] == 0.3
    assert sol.success
    assert sol.status is hd.Status.COMPLETED
    assert hd.solve(hd.scenes.relaxation(), 1.0, 10).ydot is None
    assert sol.stats.keys() >= {
        "n_steps", "n_rhs", "n_modes", "history_bytes", "setup_seconds", "run_seconds",
    }  # fmt: skip
    assert sol.stats["n_steps"] == sol.stats["n_rhs"] == 100


def test_velocity_converges():
    problem = next(p for p in PROBLEMS if p.name == "classical oscillator")
    sol = hd.solve(problem.equation(), 10.0, 4000)
    slope = np.gradient(problem.exact(sol.t)[:, 0], sol.t)
    assert np.abs(sol.ydot[1:-1, 0] - slope[1:-1]).max() < 3e-3


def test_near_integers_the_scheme_is_continuous():
    def end(beta, gamma):
        return hd.solve(hd.scenes.oscillator(beta, gamma, 0.3), 5.0, 500).y[-1, 0]

    assert end(2 - 1e-9, 1 - 1e-9) == pytest.approx(end(2.0, 1.0), abs=1e-7)
    assert end(1.5, 1e-9) == pytest.approx(end(1.5, 1e-7), abs=1e-5)


def blown_up(**kept):
    with pytest.warns(hd.SolveWarning, match="stopped being finite"):
        return hd.solve(squared(), 2.0, 2000, **kept)


squared = cache(lambda: hd.Equation(hd.Caputo(1.0), lambda t, y: y**2, 1.0))


@pytest.mark.parametrize("history", HISTORIES, ids=repr)
@pytest.mark.parametrize("n_failed", [1, 32, 64, 65])
def test_going_on_after_an_exception(n_failed, history):
    """Also where the function raised just after a block had been opened."""
    equations = [
        hd.Equation(hd.Caputo(0.5), raises_after, 1.0, params=[limit])
        for limit in ((n_failed - 0.5) * 0.01, 99.0)
    ]
    with pytest.warns(hd.SolveWarning, match="too late"):
        failed = hd.solve(equations[0], 2.0, 200, history=history)
    assert failed.status is hd.Status.RHS_FAILED
    assert failed.stats["n_steps"] == n_failed
    through = hd.solve(equations[1], 2.0, 200, history=history)
    rest = hd.solve(equations[1], 2.0, resume=failed.state, allow_change=True)
    assert np.array_equal(rest.y, through.y[n_failed:])
    with pytest.warns(hd.SolveWarning, match="too late"):
        again = hd.solve(equations[0], 2.0, resume=failed.state)
    assert again.status is hd.Status.RHS_FAILED
    assert again.t.tolist() == [failed.t[-1]]


def raises_after(t, y, p):
    if t > p[0]:
        raise ValueError("too late")
    return -y


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_keeps_what_was_computed_and_can_be_resumed():
    equation = hd.scenes.stick_slip()
    hd.solve(equation, 1.0, 100)  # compiled: the interrupt shall meet the run
    before = signal.getsignal(signal.SIGINT)
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    n = 10**8
    sol = hd.solve(equation, n * 1e-6, n, save_every=10**6)
    timer.join()
    assert signal.getsignal(signal.SIGINT) is before
    assert sol.status is hd.Status.INTERRUPTED
    assert 0 < sol.stats["n_steps"] < n
    n_more = sol.stats["n_steps"] + 1000
    assert hd.solve(equation, n_more * 1e-6, resume=sol.state).success


def takes_long(t, y):
    total = 0.0
    for k in range(1_000_000):
        total += math.sin(t + k)
    return -y + 1e-9 * total


@pytest.mark.usefixtures("ctrl_c")
def test_a_slow_right_hand_side_does_not_keep_ctrl_c_waiting():
    """It takes milliseconds a step: thousands of steps would be half a minute."""
    slow = hd.Equation(hd.Caputo(0.5), takes_long, 1.0)
    hd.solve(slow, 1.0, 1)
    began = time.perf_counter()
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    sol = hd.solve(slow, 1.0, 10_000)
    timer.join()
    assert sol.status is hd.Status.INTERRUPTED
    assert time.perf_counter() - began < 5


def test_stability_and_numbers_of_a_tolerance_are_remembered_in_the_state():
    equation = hd.scenes.oscillator(2.0, 1.0, 0.1, omega=1.0)
    state = hd.solve(equation, 10.0, 100, history=hd.SumOfExponentials(np.float64(1e-8))).state
    second = hd.solve(equation, 20.0, history=hd.SumOfExponentials(1e-8), resume=state)
    assert second.stats["n_rhs"] == 200


def test_the_last_step_of_a_run_that_blew_up_is_kept_and_is_no_start():
    sol = blown_up(save_every=10**6)
    assert sol.t.tolist() == [0.0, sol.state.t]
    with pytest.raises(ValueError, match="resume must hold a finite solution"):
        hd.solve(squared(), 3.0, resume=sol.state)


def test_derivative_of_components_with_and_without_an_initial_one():
    terms, y0 = hd.Caputo([2.0, 1.0]), [[1.0, 1.0], [0.0, 0.0]]
    sol = hd.solve(hd.Equation(terms, lambda t, y: -y, y0), 1.0, 1000)
    assert sol.ydot[0, 0] == 0.0
    assert np.isnan(sol.ydot[0, 1])
    np.testing.assert_allclose(sol.ydot[1:, 1], -np.exp(-sol.t[1:]), atol=2e-3)


def test_large_systems_take_few_extra_calls():
    sol = hd.solve(hd.Equation(hd.Caputo(0.9), lambda t, y: -y, np.ones(200)), 1.0, 1000)
    assert sol.stats["n_rhs"] < 1.3 * 1000 + 2 * 200


def test_the_smallest_orders_run():
    sol = hd.solve(hd.Equation(hd.Caputo(1e-17), lambda t, y: -0.5 * y, 1.0), 1.0, 10)
    assert np.all(np.isfinite(sol.y))


def test_long_runs_with_few_rows_take_no_memory():
    long = hd.solve(hd.scenes.stick_slip(), 100.0, 10**6, save_every=10**5)
    short = hd.solve(hd.scenes.stick_slip(), 1.0, 100)
    assert long.y.shape == (11, 1)
    assert long.stats["history_bytes"] == short.stats["history_bytes"]
    assert math.isfinite(long.y[-1, 0])
