"""Collocation where no integral form exists: orders that vary, kernels on the highest derivative.

Constant functions are constant orders, manufactured solutions tell the rest; a Prony series is an
ordinary system.
"""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_problems import error
from schemes.varying import MADE
from scipy.integrate import solve_ivp
from scipy.special import gamma
from solver.runs import completed, errors_of, warned

import hereditary as hd
from hereditary import exact

PRONY = hd.Prony((1.0, 10.0), (0.3, 0.7))


def decay(t, y):
    return -y


def always(order):
    return hd.Caputo(lambda t: order + 0.0 * t)


# Orders that vary


@pytest.mark.parametrize("name", MADE)
def test_manufactured_solutions(name):
    make, speed = MADE[name]
    equation = make()
    for rtol in (1e-4, 1e-7, 1e-10):
        sol = completed(equation, 10.0, rtol=rtol)
        assert error(sol, lambda t: (1 + speed * t + t**3)[:, None], rtol) <= 1
        assert sol.stats["n_steps"] < 120


ORDERS = st.floats(0.15, 1.0) | st.floats(1.15, 2.0)


@settings(max_examples=15)
@given(ORDERS, st.sampled_from([1e-5, 1e-9]), st.floats(0.1, 10.0))
def test_a_constant_function_is_a_constant_order(order, rtol, rate):
    y0 = [[1.0]] if order <= 1 else [[1.0], [-0.5]]
    equation = hd.Equation(always(order), lambda t, y, p: -p[0] * y, np.ravel(y0), params=[rate])
    sol = completed(equation, 5.0, rtol=rtol)
    assert error(sol, exact.relaxation(order, rate, y0), rtol) <= 1


@pytest.mark.parametrize("order", [0.3, 0.9, 1.5])
def test_steep_forces(order):
    y0 = [[1.0], [0.0]][: math.ceil(order)]
    equation = hd.Equation(always(order), lambda t, y: -1e6 * y, np.ravel(y0))
    for rtol in (1e-5, 1e-10):
        sol = hd.solve(equation, 0.3, rtol=rtol)
        assert error(sol, exact.relaxation(order, 1e6, y0), rtol) <= 1
        assert sol.stats["n_steps"] < 600


@pytest.mark.parametrize(
    ("higher", "b", "lower", "a"),
    [
        (always, 1.6, always, 0.7),
        (always, 1.6, hd.Caputo, 0.7),
        (hd.Caputo, 1.6, always, 0.7),
        # beside an integer derivative the other acts on as high a derivative
        (hd.Caputo, 1, always, 0.6),
        (hd.Caputo, 2, always, 1.6),
    ],
)
def test_one_of_two_orders_may_vary(higher, b, lower, a):
    y0 = [1.0, 0.5][: math.ceil(b)]
    equation = hd.Equation([higher(b), 0.5 * lower(a)], decay, y0)
    sol = hd.solve(equation, 20.0, rtol=1e-10)
    assert error(sol, exact.several_terms([a, b], [0.5, 1.0], y0, 1.0), 1e-10) <= 1


def stepped(t, y):
    return -y + (1.0 if t < 2.5 else 3.0)


# A memory of y'' needs an order above 1.
BESIDE = [
    (beside, order)
    for beside in (0, 1, 2, "a component", "a jump")
    for order in (0.3, 0.5, 1.2, 1.6)
    if beside != 2 or order > 1
]


@pytest.mark.parametrize(("beside", "order"), BESIDE)
def test_a_constant_function_is_the_constant_order_beside(beside, order):
    """A memory of y, y' or y'', another component, or a jump of the right-hand side."""
    y0, rhs, breaks = [1.0, 0.5][: math.ceil(order)], decay, ()
    if beside == "a component":
        y0, rhs = np.outer(y0, [1.0, 0.0]), lambda t, y: np.array([y[1] - y[0], -y[0] - 0.5 * y[1]])
        y0 = y0 if order > 1 else y0[0]
    elif beside == "a jump":
        rhs, breaks = stepped, (2.5,)

    def run(term):
        terms = [term]
        if beside == "a component":
            terms = [[1.0, 0.0] * term, [0.0, 1.0] * hd.Caputo(0.8)]
        elif beside != "a jump":
            terms += [0.5 * hd.Memory(PRONY, beside)]
        return hd.solve(hd.Equation(terms, rhs, y0), 5.0, rtol=1e-9, breaks=breaks)

    t = np.concatenate([np.linspace(0, 2.5, 51), 2.5 + np.geomspace(1e-3, 2.5, 50)])
    assert np.abs(run(always(order))(t) - run(hd.Caputo(order))(t)).max() < 1e-9


def test_an_order_that_reaches_an_integer_and_stays():
    """From t = 2.5 on it is an ordinary equation, but one that remembers."""
    equation = hd.Equation(hd.Caputo(lambda t: np.minimum(1.0, 0.5 + 0.2 * t)), decay, 1.0)
    sol = completed(equation, 5.0, rtol=1e-9, breaks=[2.5])
    march = [hd.solve(equation, 5.0, n, scheme=hd.L1()).y[-1, 0] for n in (20_000, 40_000)]
    assert abs(sol.y[-1, 0] - (2 * march[1] - march[0])) < 1e-6
    assert sol(5.0, 1)[0] == pytest.approx(-sol.y[-1, 0], rel=1e-7)


def test_what_has_become_small_is_as_right_as_what_was_large_with_an_absolute_tolerance():
    t = np.linspace(0.5, 20, 100)
    runs = [
        hd.solve(
            hd.Equation(term, lambda t, y: -y - y**3 + np.cos(t), 1e9),
            20.0, rtol=rtol, atol=1e-2 * rtol,
        )(t)
        for term, rtol in ((always(0.9), 1e-6), (hd.Caputo(0.9), 1e-11))
    ]  # fmt: skip
    np.testing.assert_allclose(runs[0], runs[1], rtol=2e-6)


def test_a_state_pickles_and_knows_its_orders_by_their_values():
    """Functions may be lambdas, and have another name in the next process."""

    def ageing(rate):
        return hd.Equation(hd.Caputo(lambda t: 0.9 - rate * t), decay, 1.0)

    state = pickle.loads(pickle.dumps(hd.solve(ageing(0.05), 3.0, rtol=1e-8).state))
    again = hd.solve(ageing(0.05), 6.0, rtol=1e-8, resume=state)
    assert abs(again.y[-1] - hd.solve(ageing(0.05), 6.0, rtol=1e-8).y[-1]) < 1e-8
    with pytest.raises(ValueError, match="come from a run with the same orders"):
        hd.solve(ageing(0.06), 6.0, rtol=1e-8, resume=state)


def test_a_bad_order_ends_the_run_with_all_that_was_computed():
    equation = hd.Equation(hd.Caputo(lambda t: 0.5 + 0.2 * t), decay, 1.0)
    sol = warned("order must stay in", equation, 5.0, rtol=1e-8)
    assert sol.status is hd.Status.ORDER_FAILED
    assert "order must stay in (0, 1], where it is at the start, got" in sol.message
    assert 2.0 < sol.t[-1] <= 2.5
    held = hd.Equation(hd.Caputo(lambda t: np.minimum(0.5 + 0.2 * t, 1.0)), decay, 1.0)
    t = np.linspace(0, sol.t[-1], 51)
    assert np.abs(sol(t) - hd.solve(held, 5.0, rtol=1e-10, breaks=[2.5])(t)).max() < 1e-8


def test_orders_next_to_an_integer_below_end_at_once():
    """No step is so small that t**0.02 is: constant orders have their own functions there."""
    sol = warned("no step is small enough", hd.Equation(always(0.02), decay, 1.0), 5.0, rtol=1e-8)
    assert not sol.success
    assert sol.t[-1] == 0.0
    assert "no step is small enough" in sol.message


@pytest.mark.parametrize("friction", [hd.Caputo(0.8), always(0.8), hd.Caputo(1)], ids=str)
def test_nothing_jumps_at_a_break_where_nothing_does(friction):
    """Whatever the friction that p is held by, and however singular it is."""
    terms = [hd.Memory(hd.Prony([0.5], [1.0]), 2), 0.5 * friction]
    equation = hd.Equation(terms, lambda t, x: np.cos(t) - x, [0.5, 0.3])
    plain, broken = (hd.solve(equation, 6.0, rtol=1e-8, breaks=b) for b in ((), (2.0, 4.0)))
    t = np.linspace(0.1, 6, 60)
    assert broken.success
    assert np.abs(broken(t) - plain(t)).max() < 1e-8
    assert np.abs(broken(t, 1) - plain(t, 1)).max() < 1e-7


def test_a_jump_that_cannot_be_solved_for():
    """f = y and K(0) = 1 hold for any jump or none."""
    equation = hd.Equation(hd.Memory(hd.Prony([1.0], [1.0]), 1), lambda t, y: y, 1.0)
    sol = warned("Newton", equation, 1.0, rtol=1e-6)
    assert sol.status is hd.Status.NOT_SOLVED
    assert sol.t[-1] == 0.0


def test_a_jump_by_many_sweeps():
    """K(0) (y - y0) = cos t - y**3 from y0 = 1e6 on."""
    equation = hd.Equation(hd.Memory(hd.Prony([1.0], [1.0]), 1), lambda t, y: np.cos(t) - y**3, 1e6)
    sol = completed(equation, 1.0, rtol=1e-8)
    after = sol.y[1, 0]
    assert after + after**3 == pytest.approx(1e6 + 1, rel=1e-4)


# General kernels on the highest derivative


def test_a_prony_series_on_the_only_derivative_is_an_ordinary_equation():
    """``int exp(-2 (t-s)) y' ds = cos t - y`` is ``2 y' = 2 cos t - 2 y - sin t``."""
    equation = hd.Equation(hd.Memory(hd.Prony([2.0], [1.0]), 1), lambda t, y: np.cos(t) - y, 1.0)
    t = np.linspace(0, 5, 101)
    true = solve_ivp(
        lambda t, y: np.cos(t) - y - np.sin(t) / 2, (0, 5), [1.0], t_eval=t, rtol=1e-13, atol=1e-14
    )
    for rtol in (1e-5, 1e-10):
        assert np.abs(hd.solve(equation, 5.0, rtol=rtol)(t)[:, 0] - true.y[0]).max() < rtol


def test_a_bounded_kernel_lets_the_solution_jump():
    """At 0, where ``K(0) (y(0+) - y(0)) = f``, and by half of each jump of f = step - y."""

    def stepped(t, y):
        return (1.0 if t >= 1.0 else 0.0) - y

    equation = hd.Equation(hd.Memory(hd.Prony([2.0], [1.0]), 1), stepped, 1.0)
    sol = completed(equation, 3.0, rtol=1e-9, breaks=[1.0])
    t = np.linspace(0.01, 2.99, 150)
    # 2 y' = step' + 2 step - 2 y, from y(0+) = 1 / 2
    late = np.where(t > 1, 1 - 0.5 * np.exp(1 - t), 0.0)
    assert np.abs(sol(t)[:, 0] - 0.5 * np.exp(-t) - late).max() < 1e-9


@pytest.mark.parametrize("order", [0.3, 0.5, 0.8])
def test_a_jump_and_then_a_power(order):
    """Cole and Cole's kernel: y = E(-t**order / 2) / 2 after the jump."""
    equation = hd.Equation(hd.Memory(hd.MittagLeffler(order, 1.0), 1), decay, 1.0)
    after = exact.relaxation(order, 0.5)
    for rtol in (1e-5, 1e-9):
        sol = completed(equation, 5.0, rtol=rtol)
        t = np.unique(np.concatenate([sol.t[1:], np.linspace(0.05, 5, 100)]))
        assert np.abs(sol(t) - after(t) / 2).max() < rtol


def test_a_jump_of_the_velocity_has_tangents():
    """Inertia by a Prony series, x(0) at odds with the force."""

    def made(x0, v0):
        inertia = hd.Prony([0.5], [1.0])
        return hd.scenes.stick_slip(inertia=inertia, adhesion=5.0, x0=x0, v0=v0)

    tangents = hd.sensitivities(made(0.2, 0.3), 5.0, rtol=1e-9, wrt="y0").by_y0[-1, 0]
    for found, (dx, dv) in zip(tangents, 1e-5 * np.eye(2), strict=True):
        ends = [
            hd.solve(made(0.2 + sign * dx, 0.3 + sign * dv), 5.0, rtol=1e-11).y[-1, 0]
            for sign in (1, -1)
        ]
        assert found == pytest.approx((ends[0] - ends[1]) / 2e-5, abs=1e-5)
    end = hd.solve(made(0.2, 0.3), 5.0, rtol=1e-8).y[-1, 0]
    march = [hd.solve(made(0.2, 0.3), 5.0, n).y[-1, 0] for n in (20_000, 40_000)]
    assert abs(end - (2 * march[1] - march[0])) < 1e-5


def test_inertia_by_a_prony_series():
    """``K1 * x'' + 0.4 x' = F(t, x)``: one mode z = F - 0.4 x', z' = x'' - 3 z."""

    def rhs(t, x):
        return np.sin(t) - x**3

    def ordinary(t, state):
        x, v = state
        known = np.cos(t) - 3 * x**2 * v + 3 * (np.sin(t) - x**3 - 0.4 * v)
        return [v, known / 1.4]

    terms = [hd.Memory(hd.Prony([3.0], [1.0]), 2), 0.4 * hd.Caputo(1)]
    # consistent: sin(0) - x0**3 = 0.4 v0
    sol = hd.solve(hd.Equation(terms, rhs, [0.5, -0.3125]), 10.0, rtol=1e-10)
    true = solve_ivp(ordinary, (0, 10), [0.5, -0.3125], t_eval=sol.t, rtol=1e-13, atol=1e-14)
    assert np.abs(sol.y[:, 0] - true.y[0]).max() < 1e-9
    assert np.abs(sol.ydot[:, 0] - true.y[1]).max() < 1e-9


@pytest.mark.parametrize("order", [0.4, 1.6])
def test_a_hardly_tempered_kernel_on_the_only_derivative(order):
    m = math.ceil(order)
    kernel = hd.TemperedPowerLaw(order + 1 - m, 1e-13)
    y0 = [[1.0], [0.5]][:m]
    equation = hd.Equation(hd.Memory(kernel / gamma(m - order), m), decay, np.ravel(y0))
    sol = hd.solve(equation, 10.0, rtol=1e-9)
    assert error(sol, exact.relaxation(order, 1.0, y0), 1e-9) <= 1


def test_two_general_kernels_as_in_the_paper():
    """Equation (4): as uniform steps have it, which converge to it."""
    equation = hd.scenes.stick_slip(
        inertia=hd.TemperedPowerLaw(0.8, 0.05), resistance=hd.Prony([0.5, 5.0], [0.5, 0.5])
    )
    t = np.linspace(0, 10, 101)
    exact = hd.solve(equation, 10.0, rtol=1e-9)(t)
    off = errors_of(lambda sol: sol(t), exact, (20_000, 40_000), equation, 10.0)
    assert off[1] < 2e-3
    assert off[0] / off[1] == pytest.approx(2.0, abs=0.1)
