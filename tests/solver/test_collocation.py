"""Adaptive collocation: equations it takes, breaks, going on from a state, and early ends.

How errors compare with tolerances is in test_collocation_tolerance.py, extremes of orders, rates
and times in test_collocation_reach.py, jumps that nobody named in test_found_jumps.py.
"""

import math
import pickle
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import half_order_relaxation
from random_problems import error, proportional
from scipy.special import gamma, rgamma
from solver.runs import completed, warned

import hereditary as hd
from hereditary import exact

core = pytest.mark.core


def manufactured(t, y, dy, p):
    """Components 1 + t**e_c of orders a_c, coupled by what is 0 for the solution; p = e, a, c."""
    d = y.shape[0]
    for c in range(d):
        b = (c + 1) % d
        before = y[b] - 1.0 - t ** p[b]
        dy[c] = p[2 * d + c] * t ** (p[c] - p[d + c]) + before - 2.0 * (y[c] - 1.0 - t ** p[c])


ORDERS = st.lists(st.floats(0.1, 2.0) | st.sampled_from([1.0, 2.0]), min_size=3, max_size=3)
EXTRA = st.lists(st.sampled_from([0.0, 0.3, 1.0]), min_size=3, max_size=3)


@core
@settings(max_examples=15)
@given(ORDERS, EXTRA)
def test_incommensurate_systems(orders, extra):
    """Any orders in one system: solutions 1 + t**e with e the order or above it."""
    orders, powers = np.array(orders), np.add(orders, extra)
    factors = gamma(powers + 1) * rgamma(powers + 1 - orders)
    y0 = [np.ones(3), np.zeros(3)] if orders.max() > 1 else np.ones(3)
    parameters = [*powers, *orders, *factors]
    equation = hd.Equation(hd.Caputo(orders), manufactured, y0, parameters)
    sol = hd.solve(equation, 2.0, rtol=1e-7)
    assert sol.success
    assert error(sol, lambda t: 1 + t[:, None] ** powers, 1e-7) <= 10


def predators(t, y):
    return np.array([y[0] * (1.0 - y[1]), y[1] * (y[0] - 1.0)])


def jacobian(t, y):
    return np.array([[1.0 - y[1], -y[0]], [y[1], y[0] - 1.0]])


@core
@pytest.mark.parametrize("rtol", [1e-5, 1e-10])
def test_differences_serve_as_well_as_the_jacobian(rtol):
    plain = hd.Equation(hd.Caputo([0.6, 1.0]), predators, [1.5, 1.0])
    one, other = (hd.solve(e, 5.0, rtol=rtol) for e in (plain, plain.replace(jac=jacobian)))
    t = np.linspace(0.01, 5, 50)
    assert np.abs(one(t) - other(t)).max() <= rtol * np.abs(one.y).max()
    assert other.stats["n_rhs"] < one.stats["n_rhs"]


@core
def test_absolute_tolerances_spare_what_is_small():
    """Errors of a decay to 1e-9 of its start stay below atol, in fewer steps than rtol takes."""
    equation, solution = proportional(hd.Caputo(1.0), 1.0, 1.0), exact.relaxation(1.0)
    fine, coarse = (hd.solve(equation, 20.0, rtol=1e-11, atol=a) for a in (1e-16, 1e-4))
    assert np.abs(coarse.y - solution(coarse.t)).max() <= 1e-4
    np.testing.assert_allclose(fine.y, solution(fine.t), rtol=1e-7)
    assert coarse.stats["n_steps"] < fine.stats["n_steps"]


@core
def test_the_tolerance_of_the_modes_can_be_tightened():
    """By default it follows from rtol; a looser one is not used: it would look like roughness."""
    equation = hd.scenes.oscillator(1.5, 0.5)
    own, tight, loose = (
        hd.solve(equation, 20.0, rtol=1e-7, history=history)
        for history in (None, hd.SumOfExponentials(1e-13), hd.SumOfExponentials(1e-3))
    )
    assert tight.stats["n_modes"] > own.stats["n_modes"]
    assert np.array_equal(loose.y, own.y)


@core
@pytest.mark.parametrize("nodes", [2, 3, 5, 12])
def test_any_number_of_nodes_keeps_the_tolerance(nodes):
    sol = hd.solve(hd.scenes.relaxation(0.5), 5.0, rtol=1e-6, scheme=hd.Collocation(nodes=nodes))
    assert error(sol, half_order_relaxation, 1e-6) <= 10


@core
def test_a_term_in_two_parts_is_the_term():
    """Equal operators with equal coefficients share all but their numbers."""

    def solved(*terms):
        return hd.solve(hd.Equation([*terms, hd.Caputo(1.0)], lambda t, y: -y, 1.0), 5.0, rtol=1e-9)

    half, times = hd.Caputo(0.5), np.linspace(0.0, 5.0, 41)
    assert np.abs(solved(half, half)(times) - solved(2 * half)(times)).max() < 1e-8


# Jumps


def switched(t, y, p):
    """D^a y = sum of unit jumps at the times p, less y."""
    total = -y
    for start in p:
        if t >= start:
            total = total + 1.0
    return total


def after_jumps(alpha, jumps):
    relaxing = exact.relaxation(alpha, 1.0, [[1.0], [0.0]][: math.ceil(alpha)])

    def solution(t):
        risen = [np.where(t[:, None] > s, 1 - relaxing(np.maximum(t - s, 0.0)), 0.0) for s in jumps]
        return relaxing(t) + sum(risen)

    return solution


# Orders, also next to integers, and the tightest of two tolerances.
JUMPING = [(alpha, 1e-9) for alpha in (0.1, 0.5, 0.9, 1.0, 1.6)]
JUMPING += [(alpha, 1e-8) for alpha in (1.0075, 1.001, 1.000001, 0.007, 0.001)]


@pytest.mark.parametrize(("alpha", "tightest"), JUMPING)
@pytest.mark.parametrize("jumps", [[9.0], [1.0], [0.3, 2.0], [1.0, 1.001]])
def test_jumps_of_the_right_hand_side(alpha, tightest, jumps):
    """Also at breaks where nothing jumps before the end."""
    y0, breaks = [1.0, 0.0][: math.ceil(alpha)], [0.5, 2.0, 2.2] if jumps[0] > 3 else jumps
    equation = hd.Equation(hd.Caputo(alpha), switched, y0, params=jumps)
    for rtol in (1e-5, tightest):
        sol = hd.solve(equation, 3.0, rtol=rtol, breaks=breaks)
        assert np.isin(breaks, sol.t).all()
        assert error(sol, after_jumps(alpha, jumps), rtol) <= 1


def towards_one(t, y, p):
    return p[0] * ((1.0 if t >= 1.0 else 0.0) - y)


@pytest.mark.parametrize(
    ("alpha", "rate", "rtol"),
    [
        *((0.15, 10.0**k, 1e-8) for k in (3, 6, 9)),
        *((0.25, 10.0**k, 1e-8) for k in (4, 6, 9)),
        *((0.5, 1e9, rtol) for rtol in (1e-4, 1e-8)),
        *((1 + 10.0**-k, 1e6, 1e-4) for k in (4, 6, 8)),
    ],
)
def test_a_jump_completes_if_rounding_of_time_hides_how_y_follows(alpha, rate, rtol):
    m = math.ceil(alpha)
    equation = hd.Equation(hd.Caputo(alpha), towards_one, [0.5, 0.0][:m], params=[rate])
    sol = completed(equation, 2.0, rtol=rtol, breaks=[1.0])
    before, after = (exact.relaxation(alpha, rate, [[y], [0.0]][:m]) for y in (0.5, 1.0))
    t = np.concatenate([np.linspace(0.0, 1.0, 50), 1 + np.geomspace(1e-6, 1.0, 50)])
    true = before(t) + np.where(t[:, None] > 1, 1 - after(np.maximum(t - 1, 0.0)), 0.0)
    assert np.abs(sol(t) - true).max() <= rtol


@pytest.mark.parametrize(("alpha", "rate"), [(1.15, 1e3), (1.2, 1e4), (1.3, 1e5)])
def test_above_order_1_a_fast_jump_rejects_few_steps(alpha, rate):
    equation = hd.Equation(hd.Caputo(alpha), towards_one, [0.5, 0.0], params=[rate])
    assert completed(equation, 2.0, rtol=1e-4, breaks=[1.0]).stats["n_rejected"] <= 3


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


def test_breaks_outside_of_the_run_do_nothing():
    """Nor does one that misses its end by rounding."""
    equation = hd.scenes.relaxation(0.7)
    plain = hd.solve(equation, 2.0, rtol=1e-8)
    for breaks in ([2.0], [3.0, 5.0], np.array([7.0]), [np.nextafter(2.0, 0)]):
        assert np.array_equal(hd.solve(equation, 2.0, rtol=1e-8, breaks=breaks).y, plain.y)


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


SCENES = [hd.scenes.relaxation, hd.scenes.stick_slip, lambda: hd.scenes.brusselator(0.8)]


@pytest.mark.parametrize("scene", SCENES)
def test_a_state_is_small_and_does_not_grow(scene):
    sizes = [len(pickle.dumps(hd.solve(scene(), t, rtol=1e-8).state)) for t in (10.0, 100.0)]
    assert max(sizes) < 20_000
    assert sizes[1] < 1.3 * sizes[0]


def test_beyond_ten_times_its_length_a_run_is_not_resumed():
    equation = hd.scenes.relaxation(0.5)
    state = hd.solve(equation, 1.0, rtol=1e-8).state
    with pytest.raises(
        ValueError, match=r"resume must .*Collocation\(horizon=11.0\), or with the end"
    ):
        hd.solve(equation, 11.0, rtol=1e-8, resume=state)
    far = hd.Collocation(horizon=1e6)
    state = hd.solve(equation, 1.0, rtol=1e-8, scheme=far).state
    for t_end in (30.0, 1e3, 1e6):
        sol = hd.solve(equation, t_end, rtol=1e-8, scheme=far, resume=state)
        assert error(sol, half_order_relaxation, 1e-8) <= 1
        state = sol.state


@pytest.mark.parametrize("scene", SCENES)
def test_limits_of_steps_go_on(scene, tmp_path):
    first = hd.solve(scene(), 1.0, rtol=1e-4, max_step=0.03, max_steps=200)
    first.save(tmp_path / "first.npz")
    for state in (first.state, hd.Solution.load(tmp_path / "first.npz").state):
        rest = hd.solve(scene(), 2.0, resume=state)
        assert np.diff(rest.t).max() <= 0.03
        assert np.diff(hd.solve(scene(), 3.0, resume=rest.state, max_step=0.3).t).max() > 0.03
        before = rest.stats["n_steps"]
        with pytest.warns(hd.SolveWarning, match="max_steps"):
            last = hd.solve(scene(), 9.9, resume=rest.state)
        assert last.stats["n_steps"] == before + 200
        assert hd.solve(scene(), 9.9, resume=rest.state, max_steps=1000).success


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
def test_sliding_and_chattering_end_with_the_reason(rtol):
    sliding = hd.Equation(hd.Caputo(0.9), lambda t, y: np.sin(t) - y - 0.5 * np.sign(y), 0.0)
    sticking = hd.Equation(
        hd.Caputo(1.0), lambda t, y: np.array([y[1], -y[0] - 0.5 * np.sign(y[1])]), [2.2, 0.0]
    )
    for equation, start in ((sliding, 0.0), (sticking, 2 * np.pi)):
        sol = warned("slide", equation, 20.0, rtol=rtol)
        assert sol.status in (hd.Status.STEP_TOO_SMALL, hd.Status.SLIDING)
        assert "slide" in sol.message
        assert start - rtol <= sol.t[-1] < start + 0.1
        assert sol.stats["n_steps"] < 5000
    assert sol.y[-1, 0] == pytest.approx(0.2, abs=5 * rtol)  # where it sticks


def test_a_run_stops_at_its_last_step_and_goes_on():
    equation = hd.scenes.relaxation(0.5)
    whole = hd.solve(equation, 5.0, rtol=1e-8)
    part = warned("max_steps", equation, 5.0, rtol=1e-8, max_steps=7)
    assert part.status is hd.Status.MAX_STEPS
    assert "7 in all; name times of jumps and corners" in part.message
    assert part.stats["n_steps"] == 7
    np.testing.assert_array_equal(part.t, whole.t[:8])
    rest = completed(equation, 5.0, resume=part.state, max_steps=100)
    assert rest.y[-1] == pytest.approx(whole.y[-1], rel=1e-8)


@pytest.mark.parametrize("above", [1e-2, 1e-3, 1e-5, 1e-9])
@pytest.mark.parametrize(("v", "t_end"), [(-1.0, 1.0), (-1400.0, 1e-3), (1e6, 1e-6)])
def test_the_first_step_of_orders_next_to_1_is_right_everywhere(above, v, t_end):
    equation = hd.Equation(hd.Caputo(1 + above), lambda t, x: -x, [1.0, v])
    truth = exact.relaxation(1 + above, 1.0, [[1.0], [v]])
    for rtol in (1e-6, 1e-11):
        sol = completed(equation, t_end, rtol=rtol)
        assert sol(0.0) == 1.0
        t = sol.t[1] * np.append(0.0, np.geomspace(1e-12, 1.0, 60))
        assert np.abs(sol(t) - truth(t)).max() <= rtol


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("near", [0.1, 0.46, 3.0])
@pytest.mark.parametrize("v", [0.0342, -20.0])
def test_slopes_that_jump_at_the_start_leave_the_first_step_right(v, near, rtol):
    """Two orders 1.1e-9 apart: x' is v at the start alone, and v / (1 + near) just after it."""
    terms = (0.673, 0.957, 1 - 1e-10, 1 + 1e-9), (10.8, 0.025, near, 1.0)
    left = [coefficient * hd.Caputo(order) for order, coefficient in zip(*terms, strict=True)]
    sol = completed(hd.Equation(left, lambda t, x: -0.01 * x, [0.0756, v]), 10.0, rtol=rtol)
    t = sol.t[1] * np.append(0.0, np.geomspace(1e-12, 1.0, 60))
    true = exact.several_terms(*terms, [0.0756, v], 0.01)(t)
    assert np.abs(sol(t) - true).max() <= 0.1 * rtol * np.abs(true).max()
    assert sol(1e-9 * sol.t[1], 1)[0] == pytest.approx(v / (1 + near), rel=0.05)


def pulse(t, y, p):
    return (1.0 if p[0] <= t < p[0] + 1 / 150 else 0.0) - y


@pytest.mark.filterwarnings("ignore::hereditary.SolveWarning")
@pytest.mark.parametrize("rtol", [1e-2, 1e-5, 1e-8])
@pytest.mark.parametrize("alpha", [0.1, 0.8, 1.5])
def test_a_force_after_rest_is_seen_if_it_lasts_for_a_150th_of_the_run(alpha, rtol):
    for begin in np.linspace(1e-4, 0.2, 14):
        equation = hd.Equation(
            hd.Caputo(alpha), pulse, [0.0, 0.0][: int(alpha) + 1], params=[begin]
        )
        sol = hd.solve(equation, 1.0, rtol=rtol, max_steps=60)
        assert not sol.success or sol.y.any(), begin
