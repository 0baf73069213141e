"""Runs of first order estimate their own error."""

import numpy as np
import pytest
from problems import PROBLEMS as EXACT

import hereditary as hd


def oscillator():
    terms = hd.Caputo(1.8) + 0.25 * hd.Caputo(0.8)
    return hd.Equation(terms, lambda t, x: np.sin(t) - x, [0.2, 0.3])


PROBLEMS = {
    "oscillator": (oscillator(), 50.0),
    "relaxation 0.4": (hd.scenes.relaxation(0.4), 5.0),
    "relaxation 0.5": (hd.scenes.relaxation(0.5), 5.0),
    "relaxation 0.8": (hd.scenes.relaxation(0.8), 20.0),
}


@pytest.mark.parametrize("scheme", [hd.ExplicitCaputo(), hd.GrunwaldLetnikov()], ids=str)
@pytest.mark.parametrize("problem", PROBLEMS)
@pytest.mark.parametrize("n", [2_000, 20_000])
def test_the_estimate_is_within_a_factor_of_3_beyond_40_steps(scheme, problem, n):
    equation, t_end = PROBLEMS[problem]
    sol = hd.solve(equation, t_end, n, scheme=scheme)
    true = hd.solve(equation, t_end, rtol=1e-9, t_eval=sol.t)
    error = np.abs(sol.y - true.y)[40:].max() / np.abs(sol.y).max()
    assert error / 3 < sol.stats["error_estimate"] < 3 * error


def test_a_large_error_is_a_warning_and_none_is_estimated_where_nothing_can_be():
    with pytest.warns(hd.SolveWarning, match=r"errors are about .* rtol=1e-6, scheme=BDF\(2\)"):
        sol = hd.solve(oscillator(), 50.0, 500)
    assert sol.success
    assert hd.solve(oscillator(), 50.0, 59).stats["error_estimate"] is None
    assert "error_estimate" not in hd.solve(oscillator(), 50.0, 400, estimate=False).stats
    assert "error_estimate" not in hd.solve(oscillator(), 50.0, 400, breaks=[25.0]).stats


@pytest.mark.filterwarnings("ignore:errors are about")
@pytest.mark.parametrize("scheme", [hd.ExplicitCaputo(), hd.GrunwaldLetnikov()], ids=str)
@pytest.mark.parametrize("problem", EXACT, ids=lambda problem: problem.name)
def test_runs_of_60_steps_and_more_have_an_estimate(problem, scheme):
    """The factor at 400 steps is 3.2: the first number for companions with a twentieth of them."""
    for n in (60, 83, 200, 399, 400, 1000):
        sol = hd.solve(problem.equation(), problem.t_end, n, scheme=scheme)
        off = np.abs(sol.y - problem.exact(sol.t))[40:].max(axis=0) / np.abs(sol.y).max(axis=0)
        assert off.max() / 3 < sol.stats["error_estimate"] < 4 * off.max()


def van_der_pol(t, y, dy, p):
    dy[0] = y[1]
    dy[1] = p[0] * (1 - y[0] ** 2) * y[1] - y[0]


@pytest.mark.parametrize("n", [500, 1000, 2000, 5000, 8000])
@pytest.mark.parametrize("stiffness", [1.0, 2.0])
def test_no_large_error_is_silent(stiffness, n):
    """Companions of a tenth differ by the size of the solution, and closer ones at few steps."""
    equation = hd.Equation(hd.Caputo(0.9), van_der_pol, [0.5, 0.0], params=[stiffness])
    with pytest.warns(hd.SolveWarning) as warned:
        sol = hd.solve(equation, 30.0, n)
    (message,) = (str(one.message) for one in warned)
    truth = hd.solve(equation, 30.0, rtol=1e-8)(sol.t)
    off = (np.abs(sol.y - truth).max(axis=0) / np.abs(truth).max(axis=0)).max()
    assert off > 0.05
    if sol.stats["error_estimate"] is None:
        assert "is not resolved or the solution is chaotic: rtol= shows which" in message
        assert off > 0.5
    else:
        assert off / 2 < sol.stats["error_estimate"] < 2 * off


def test_companions_that_turn_chaotic_by_long_steps_are_no_warning():
    equation = hd.scenes.lorenz(alpha=0.9, y0=(8.0, 8.0, 27.0))
    sol = hd.solve(equation, 20.0, 20_000)
    off = np.abs(sol.y - hd.solve(equation, 20.0, rtol=1e-8)(sol.t)).max() / np.abs(sol.y).max()
    assert off / 3 < sol.stats["error_estimate"] < 3 * off


def test_a_chaotic_run_is_a_warning_that_can_be_left_out():
    with pytest.warns(hd.SolveWarning, match=r"differ by \d+ % of the solution's size.*chaotic"):
        sol = hd.solve(hd.scenes.rossler(), 100.0, 20_000)
    assert sol.success
    assert sol.stats["error_estimate"] is None
    hd.solve(hd.scenes.rossler(), 100.0, 20_000, estimate=False)


def test_time_alone_is_solved_to_a_tolerance():
    by_default, asked = hd.solve(oscillator(), 50.0), hd.solve(oscillator(), 50.0, rtol=1e-6)
    np.testing.assert_array_equal(by_default.y, asked.y)
