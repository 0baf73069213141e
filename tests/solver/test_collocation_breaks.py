"""Adaptive collocation where the right-hand side jumps, and steps that are cut short by a stop."""

import warnings

import numpy as np
import pytest
from problems import half_order_relaxation
from random_problems import error, proportional

import hereditary as hd
from hereditary import exact

# Jumps


def switched(t, y, p):
    """D^a y = sum of unit jumps at the times p, less y."""
    total = -y
    for start in p:
        if t >= start:
            total = total + 1.0
    return total


def after_jumps(alpha, jumps):
    relaxing = exact.relaxation(alpha)

    def solution(t):
        risen = [np.where(t[:, None] > s, 1 - relaxing(np.maximum(t - s, 0.0)), 0.0) for s in jumps]
        return relaxing(t) + sum(risen)

    return solution


@pytest.mark.parametrize("alpha", [0.1, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("jumps", [[1.0], [0.3, 2.0], [1.0, 1.001]])
def test_jumps_of_the_right_hand_side(alpha, jumps):
    equation = hd.Equation(hd.Caputo(alpha), switched, 1.0, params=jumps)
    for rtol in (1e-5, 1e-9):
        sol = hd.solve(equation, 3.0, rtol=rtol, breaks=jumps)
        assert np.isin(jumps, sol.t).all()
        assert error(sol, after_jumps(alpha, jumps), rtol) <= 1


def test_a_jump_in_an_oscillator():
    equation = hd.Equation(
        hd.Caputo(1.6), lambda t, x, p: (1.0 if t > p[0] else 0.0) - x, [0.0, 0.0], params=[1.0]
    )
    sol = hd.solve(equation, 6.0, rtol=1e-9, breaks=[1.0])
    rest = exact.relaxation(1.6, 1.0, [[1.0], [0.0]])

    def solution(t):
        return np.where(t[:, None] > 1, 1 - rest(np.maximum(t - 1, 0)), 0.0)

    assert error(sol, solution, 1e-9) <= 1


def test_breaks_keep_the_tolerance_and_are_cheaper_than_none():
    equation = hd.Equation(hd.Caputo(0.5), switched, 1.0, params=[1.0])
    solution, t = after_jumps(0.5, [1.0]), 1 + np.geomspace(1e-12, 2, 300)
    for rtol in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7):
        broken = hd.solve(equation, 3.0, rtol=rtol, breaks=[1.0])
        with warnings.catch_warnings():  # at the tightest the jump ends the run
            warnings.simplefilter("ignore", hd.SolveWarning)
            plain = hd.solve(equation, 3.0, rtol=rtol)
        assert np.abs(broken(t) - solution(t)).max() < 0.1 * rtol
        assert broken.stats["n_rhs"] < plain.stats["n_rhs"]


@pytest.mark.parametrize("alpha", [0.3, 0.5])
def test_a_jump_that_no_step_is_small_enough_for_is_found(alpha):
    """At a tight tolerance, at which no step may contain the jump."""
    equation = hd.Equation(hd.Caputo(alpha), switched, 1.0, params=[1.0])
    t = np.append(np.linspace(0.01, 0.99, 50), np.linspace(1.01, 3.0, 100))
    for rtol in (1e-9, 1e-12):
        sol = hd.solve(equation, 3.0, rtol=rtol)
        named = hd.solve(equation, 3.0, rtol=1e-12, breaks=[1.0])
        assert sol.stats["jumps"] == pytest.approx([1.0], rel=1e-14)
        assert np.abs(sol(t) - named(t)).max() <= 2 * rtol


def test_breaks_outside_of_the_run_do_nothing():
    """Nor does one that misses its end by rounding."""
    equation = hd.scenes.relaxation(0.7)
    plain = hd.solve(equation, 2.0, rtol=1e-8)
    for breaks in ([2.0], [3.0, 5.0], np.array([7.0]), [np.nextafter(2.0, 0)]):
        assert np.array_equal(hd.solve(equation, 2.0, rtol=1e-8, breaks=breaks).y, plain.y)


def test_a_break_where_nothing_breaks_does_no_harm():
    sol = hd.solve(hd.scenes.oscillator(), 10.0, rtol=1e-9, breaks=[1.0, 4.0, 4.5])
    assert error(sol, exact.oscillator(), 1e-9) <= 1


# What is left of a run after its first step is sometimes very short: modes are refitted for it, not
# for ever.


def test_a_run_that_ends_just_after_its_first_step():
    equation = proportional(hd.Caputo(0.5), 0.4999, 1.0)
    for t_end in (1.0, 1.001, 1.01, 1.02, 1.1):  # the first step goes to 1.0004
        sol = hd.solve(equation, t_end, rtol=1e-6)
        assert sol.success, sol.message
        assert error(sol, exact.relaxation(0.5, 0.4999), 1e-6) <= 1


@pytest.mark.parametrize("more", [0.1, 1e-2, 1e-3, 1e-6, 1e-12])
def test_going_on_by_very_little(more):
    equation = hd.scenes.relaxation(0.5)
    state = hd.solve(equation, 1.0, rtol=1e-8).state
    sol = hd.solve(equation, 1.0 + more, rtol=1e-8, resume=state)
    assert sol.success, sol.message
    assert error(sol, half_order_relaxation, 1e-8) <= 1


@pytest.mark.parametrize("gap", [0.1, 1e-3, 1e-6, 1e-9, 1e-12])
def test_breaks_that_are_close_to_each_other_and_to_the_ends(gap):
    sol = hd.solve(hd.scenes.relaxation(0.5), 2.0, rtol=1e-8, breaks=[gap, 1.0, 1.0 + gap, 2 - gap])
    assert sol.success, sol.message
    assert error(sol, half_order_relaxation, 1e-8) <= 1
