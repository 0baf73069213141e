"""Adaptive collocation at the ends of what there is: orders near integers, stiffness, times."""

import math

import numpy as np
import pytest
from random_problems import error, linear, points, proportional
from scipy.special import gamma
from solver.runs import completed, warned

import hereditary as hd
from hereditary import exact

LIMITS = [
    (1.8, 0.6), (1.3, 0.7), (1.5, 0.5), (1.999, 0.999), (1.999, 0.001), (1.02, 0.98),
    (1.001, 0.999), (1.000001, 0.5), (1.999999, 0.999999), (1.5, 1e-6), (1.5, 1 - 1e-6),
]  # fmt: skip


@pytest.mark.parametrize(("beta", "gamma"), LIMITS)
def test_limits_of_the_orders(beta, gamma):
    """Orders that tend to 0, 1 and 2 lose nothing: D^beta x + 0.2 D^gamma x + x = 0."""
    parameters = (beta, gamma, 0.2, 1.0, 1.0, 0.5)
    sol = hd.solve(hd.scenes.oscillator(*parameters), 40.0, rtol=1e-11)
    t = points(sol)
    assert np.abs(sol(t) - exact.oscillator(*parameters)(t)).max() < 1e-10


# Order, rate, y'(0), end, tolerance, whether errors are relative to y at their time, and steps.
RELAXATIONS = [
    *((alpha, 0.7, 0.5, 10.0, 1e-10, False, 200) for alpha in (0.02, 1.0, 1.999999, 2.0)),
    *((1 + near, 0.7, 0.5, 10.0, 1e-10, False, 200) for near in (-1e-6, 1e-6)),
    # tiny orders, stiff or not, at tight tolerances
    *((1e-6, rate, 0.0, 1.0, 1e-8, True, 50) for rate in (0.7, 1.0, 1e3)),
    *((1e-6, rate, 0.0, 1.0, 1e-10, True, 50) for rate in (0.7, 1.0, 1e3)),
    (1e-6, 1.0, 0.0, 1.0, 1e-11, True, 20),
    (1e-4, 1.0, 0.0, 1.0, 1e-11, True, 20),
    (0.02, 1e6, 0.0, 1.0, 1e-11, True, 30),
    # the stiffest
    *((alpha, 1e6, 0.0, 1.0, 1e-6, True, 600) for alpha in (0.3, 0.5, 0.95, 1.0)),
    # a steep start: x' grows from 0 to any size at once, and its error is relative to that
    *((beta, 1e4, 0.0, 0.01, rtol, False, 300) for beta in (1.002, 1.01) for rtol in (1e-6, 1e-11)),
    # a speed that has long faded: x' is x'(0) and what the modes take from it, in long steps
    *((1.5, 1.0, 0.5, t_end, 1e-11, False, 400) for t_end in (1e4, 1e6)),
]


@pytest.mark.parametrize(("alpha", "rate", "v", "t_end", "rtol", "decays", "most"), RELAXATIONS)
def test_relaxations_and_oscillations_at_the_ends(alpha, rate, v, t_end, rtol, decays, most):
    y0 = [1.0, v][: math.ceil(alpha)]
    sol = completed(proportional(hd.Caputo(alpha), rate, y0), t_end, rtol=rtol)
    solution = exact.relaxation(alpha, rate, np.reshape(y0, (-1, 1)))
    assert error(sol, solution, rtol, decays) <= 1
    assert sol.stats["n_steps"] < most


@pytest.mark.parametrize("rate", [0.7, 1.0, 10.0, 1e3, 1e6])
@pytest.mark.parametrize("alpha", [1e-6, 1e-4, 10**-3.75, 1e-3, 0.01, 0.02, 0.05, 0.1])
def test_tiny_orders(alpha, rate):
    """Nearly all may happen before t = 1e-300: errors count at all times from there on.

    They are held to the size at that time, which is some 1 / rate.
    """
    equation, solution = proportional(hd.Caputo(alpha), rate, 1.0), exact.relaxation(alpha, rate)
    for rtol in (1e-4, 1e-6, 1e-7):
        sol = completed(equation, 1.0, rtol=rtol)
        assert error(sol, solution, rtol, decays=True) <= 1
        t = np.append(0.0, np.geomspace(1e-300, 1.0, 200))
        y = solution(t)
        assert np.all(np.abs(sol(t) - y) <= rtol * (y + 0.01))
        assert sol.stats["n_steps"] < 50


@pytest.mark.parametrize("t_end", [1e-300, 1e-200, 1e-100, 1e100])
@pytest.mark.parametrize("alpha", [0.02, 0.5, 0.9, 1.0])
def test_any_length_of_a_run(alpha, t_end):
    sol = completed(proportional(hd.Caputo(alpha), 1.0, 1.0), t_end, rtol=1e-6)
    assert sol.t[-1] == t_end
    assert sol(t_end) == pytest.approx(exact.relaxation(alpha)(t_end), rel=1e-6, abs=1e-8)


@pytest.mark.filterwarnings("ignore::hereditary.SolveWarning")
@pytest.mark.parametrize(("alpha", "rate"), [(0.02, 1e3), (0.5, 1e-3), (0.5, 1e3), (1.0, 1e3)])
def test_the_longest_run_ends_well_or_says_why(alpha, rate):
    sol = hd.solve(proportional(hd.Caputo(alpha), rate, 1.0), 1e300, rtol=1e-4)
    assert sol.success or sol.status in (hd.Status.STEP_TOO_SMALL, hd.Status.RHS_FAILED)
    assert sol.success == (sol.t[-1] == 1e300)
    assert sol.success or sol.message.endswith("(t = 0 after 0 steps)")
    assert np.all(np.isfinite(sol.y))


@pytest.mark.parametrize("alpha", [0.3, 0.8, 1.0])
def test_rates_and_times_scale(alpha):
    """Two-sided: a run 2**20 times as fast is the same run, step for step."""
    fast = 2.0**20
    slow, quick = (
        hd.solve(proportional(hd.Caputo(alpha), rate, 1.0), t_end, rtol=1e-8)
        for rate, t_end in ((1.0, 8.0), (fast**alpha, 8.0 / fast))
    )
    assert slow.t.size == quick.t.size
    np.testing.assert_allclose(quick.t * fast, slow.t, rtol=1e-9)
    np.testing.assert_allclose(quick.y, slow.y, atol=1e-10)


def test_doubling_the_time_of_a_decay_adds_a_few_steps():
    """The steps grow with t, so their number grows like its logarithm."""
    equation = hd.scenes.relaxation(0.5)
    ends = 10.0 * 2.0 ** np.arange(15)
    added = np.diff([hd.solve(equation, t, rtol=1e-8).stats["n_steps"] for t in ends])
    assert added.max() <= 12
    assert np.ptp(added[-7:]) <= 2


@pytest.mark.parametrize("beta", [1.02, 1.04, 1.1])
def test_a_steep_force_next_to_order_one(beta):
    """Newton's contraction on the tiny steps after the start says nothing about long ones."""
    equation, t = hd.scenes.stick_slip(beta=beta), np.linspace(0, 10, 60)
    fine, coarse = (hd.solve(equation, 10.0, rtol=rtol) for rtol in (1e-10, 1e-7))
    assert fine.success
    assert fine.stats["n_steps"] < 200
    assert np.abs(fine(t) - coarse(t)).max() < 1e-6


# Orders, factor of the lower one, rate, tolerance. Where terms cancel, what is left of them counts.
# Where y falls far below y(0), whose rounding it keeps, shorter steps would not make that less.
CANCELLING = [
    *(((0.5, 0.5390625), 10.0, 1e4, rtol) for rtol in (1e-11, 1e-12)),
    *(((0.9, 0.95), 10.0, 1e3, rtol) for rtol in (1e-11, 1e-12)),
    ((0.9216, 0.9643), 11.0, 3.9e3, 3.8e-12),
    ((0.6945, 0.7921), 15.0, 1.4e4, 1.3e-12),
    ((0.8167, 0.9135), 3.8, 1.2e3, 1.05e-11),
    ((0.9444, 1.0), 2.0, 5.1e2, 1.75e-12),
]


@pytest.mark.parametrize(("orders", "factor", "rate", "rtol"), CANCELLING, ids=str)
def test_terms_that_cancel(orders, factor, rate, rtol):
    """``factor D^a y + D^b y = -rate y``, b just above a."""
    terms = [factor * hd.Caputo(orders[0]), hd.Caputo(orders[1])]
    for near in (rate, 1.003 * rate, 1.007 * rate):  # by which machines round, others would fail
        sol = completed(proportional(terms, near, 1.0), 1.0, rtol=rtol)
        solution = exact.several_terms(orders, [factor, 1.0], [1.0], near)
        assert error(sol, solution, rtol, True) <= 1
        assert sol.stats["n_steps"] < (400 if factor == 10.0 else 600)


@pytest.mark.parametrize(
    ("orders", "friction", "stiffness", "t_end"),
    [((1.8844, 0.8253), 2.026, 0.1311, 0.1363), ((1.7215, 0.6551), 81.3, 2.09, 2.483)],
    ids=str,
)
def test_terms_of_y_itself_beside_its_velocity(orders, friction, stiffness, t_end):
    """Orders that differ by little more than 1: y, known to rounding, acts on y' almost at once."""
    parameters = (*orders, friction, stiffness**0.5, 1.0, 0.0)
    solution = exact.oscillator(*parameters)
    for rtol in (1e-12, 3e-12, 1e-11):
        sol = completed(hd.scenes.oscillator(*parameters), t_end, rtol=rtol)
        assert error(sol, solution, rtol) <= 1
        assert sol.stats["n_steps"] < 2000


@pytest.mark.parametrize(
    ("alpha", "matrix", "y0", "rtol", "most"),
    [
        # each gets 1e5 times the other less itself: known to 1e-11, which the equation damps
        (0.5, [[-1e5, 1e5], [1e5, -1e5]], [1.0, 0.0], 1e-11, 400),
        # eigenvalues -1e3 and -30: rational maps for each; at 1e-11 rounding may refuse their step
        *(
            (0.05, [[-515.0, 485.0], [485.0, -515.0]], [1.0, 0.5], *how)
            for how in ((1e-8, 100), (2e-11, 100), (1e-11, 1000))
        ),
    ],
)
def test_two_components_of_different_rates(alpha, matrix, y0, rtol, most):
    equation = hd.Equation(hd.Caputo(alpha), linear, y0, params=[*np.ravel(matrix), 0.0, 0.0])
    sol = completed(equation, 1.0, rtol=rtol)
    assert error(sol, exact.system(alpha, np.array(matrix), y0), rtol) <= 1
    assert sol.stats["n_steps"] < most


@pytest.mark.parametrize("alpha", [1.999, 1.9999, 1.99999, 2.0])
def test_an_oscillation_that_hardly_decays_keeps_its_phase(alpha):
    """Over 600 radians the kernel, next to constant, must be known better than the tolerance."""
    sol = hd.solve(proportional(hd.Caputo(alpha), 1.0, [1.0, 0.0]), 600.0, rtol=1e-10)
    right = exact.relaxation(alpha, 1.0, np.array([[1.0], [0.0]]))
    t = np.linspace(0.0, 600.0, 500)
    assert np.abs(sol(t) - right(t)).max() < 0.1e-10


def test_tiny_orders_beside_orders_just_above_1():
    """A component of order 0.057 has moved by a tenth of its step at 1e-12 of it.

    D^0.057 y_0 = -rate y_1, where y_1 with orders 1 + 1e-4 and y_2 with 1 + 1e-9 rest: it is
    y_0(0) - rate y_1 t^0.057 / Gamma(1.057).
    """
    order, rate, resting = 0.05684891654585258, 0.3, 0.5
    orders = hd.Caputo([order, 1.0001, 1.000000001])

    def rhs(t, y, dy, p):
        dy[0], dy[1], dy[2] = -p[0] * y[1], 0.0, 0.0

    equation = hd.Equation(orders, rhs, [[1.0, resting, 0.2], [0.0, 0.0, 0.0]], params=[rate])
    sol = hd.solve(equation, 2.0, rtol=1e-8)
    t = sol.t[1] * np.geomspace(1e-14, 1.0, 40)
    right = 1.0 - rate * resting * t**order / gamma(1 + order)
    assert np.abs(sol(t)[:, 0] - right).max() < 1e-8


@pytest.mark.parametrize("gap", [1e-6, 1e-5, 1e-4, 1e-3, 3e-3])
@pytest.mark.parametrize("rate", [0.7, 3.0, 300.0, 1e4])
def test_orders_that_nearly_meet(gap, rate):
    """D^(1 + gap) x + rate x' = 0 is a relaxation of x', most of it before t = 1e-300."""
    equation = proportional(hd.Caputo(1 + gap) + rate * hd.Caputo(1.0), 0.0, [1.0, 0.5])
    rtol = 1e-7
    sol = completed(equation, 1.0, rtol=rtol)
    t = np.append(sol.t[1] * np.geomspace(1e-12, 1.0, 13), np.geomspace(1e-9, 1.0, 30))
    speed = 0.5 * exact.relaxation((1 + gap) - 1.0, rate)(t)[:, 0]
    assert np.all(np.abs(sol(t, 1)[:, 0] - speed) <= rtol * (speed + 0.01 * 0.5))


def test_orders_around_1_that_no_first_step_resolves():
    """Orders 1.00001 and 0.99 need a loose tolerance, and the status names their distance from 1.

    At a tight tolerance, no power of time is linear for both exponents 1e-5 and 0.01001.
    """
    parameters = (1.00001, 0.99, 3.0, 1.0, 1.0, 0.5)
    equation, t = hd.scenes.oscillator(*parameters), np.linspace(0.0, 1.0, 20)
    sol = completed(equation, 1.0, rtol=1e-3)
    assert np.abs(sol(t) - exact.oscillator(*parameters)(t)).max() <= 1e-3
    sol = warned("1e-05 from another one or from an integer", equation, 1.0, rtol=1e-7)
    assert sol.status is hd.Status.STEP_TOO_SMALL
    assert sol.t.tolist() == [0.0]
