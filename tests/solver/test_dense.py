"""Dense output of adaptive runs, rows inside the first two steps, and rows of some components."""

import math

import numpy as np
import pytest
from problems import PROBLEMS, half_order_relaxation, monomial
from scipy.special import gamma, wofz

import hereditary as hd
from hereditary import exact
from hereditary.exact import relaxation

RTOLS = (1e-4, 1e-8, 1e-11)
HALVES = next(p for p in PROBLEMS if p.name == "oscillator 1.5 0.5")


def speed(t):
    """The derivative of `half_order_oscillator`."""
    roots = np.roots([1.0, 0.0, 0.5, 1.0])
    residues = (roots**2 + 0.5) / (3 * roots**2 + 0.5)
    z = np.multiply.outer(np.sqrt(np.asarray(t, dtype=float)), roots)
    return (residues * roots**2 * wofz(1j * -z)).sum(axis=1).real.reshape(-1, 1)


def everywhere(sol):
    """Times all over the run, and from its start on in powers of ten."""
    first = sol.t[0] + (sol.t[1] - sol.t[0]) * np.geomspace(1e-16, 1, 33)
    return np.unique(np.concatenate([np.linspace(sol.t[0], sol.t[-1], 1001), first]))


# What is neither smooth nor small: a run of a few hundred steps, a system, orders near each other,
# a jump, and a first step in functions of three generators.
RUNS = {
    "relaxation": (lambda: hd.scenes.relaxation(0.5), 20.0, ()),
    "oscillator": (lambda: hd.scenes.oscillator(1.3, 0.7), 30.0, ()),
    "stick-slip": (hd.scenes.stick_slip, 100.0, ()),
    "brusselator": (lambda: hd.scenes.brusselator(0.8), 100.0, ()),
    "with breaks": (lambda: hd.scenes.oscillator(), 10.0, (1.0, 1.5, 7.0)),
    "three terms": (lambda: hd.Equation(THREE, lambda t, x: -x, [1.0, 1.0]), 5.0, ()),
}
THREE = [hd.Caputo(1.7722), 0.133 * hd.Caputo(0.9575), 0.195 * hd.Caputo(0.4143)]


@pytest.mark.parametrize("rtol", RTOLS)
def test_values_and_speeds_of_an_oscillator_at_all_times(rtol):
    """Above order 1 the derivative is as exact as the solution, also inside the first step."""
    sol = hd.solve(HALVES.equation(), 20.0, rtol=rtol)
    t = everywhere(sol)
    assert np.abs(sol(t) - HALVES.exact(t)).max() <= rtol
    assert np.abs(sol(t[1:], 1) - speed(t[1:])).max() <= rtol
    assert np.abs(sol.ydot - speed(sol.t)).max() <= rtol


@pytest.mark.parametrize("rtol", RTOLS)
def test_values_and_slopes_of_a_relaxation_at_all_times(rtol):
    """Up to order 1 the derivative is exact relative to what a change of 1 over t would be."""
    sol = hd.solve(hd.scenes.relaxation(0.5), 20.0, rtol=rtol)
    t = everywhere(sol)
    np.testing.assert_allclose(sol(t), half_order_relaxation(t), rtol=rtol)
    later = t[1:]
    slope = half_order_relaxation(later)[:, 0] - 1 / np.sqrt(np.pi * later)
    assert np.abs(later * (sol(later, 1)[:, 0] - slope)).max() <= 10 * rtol
    assert sol.ydot is None


def powers(t, y, dy, p):
    dy[0] = p[0] * t**1.5
    dy[1] = p[1] * t**0.5


def test_each_component_has_the_derivative_of_its_kind():
    """Orders 1.5 and 0.5 together: t**3 and t; no y'(0) is known of the second one."""
    factors = [float(monomial(1.0, 1.5, 3.0)), float(monomial(1.0, 0.5, 1.0))]
    y0 = [[0.0, 0.0], [0.0, 0.0]]
    sol = hd.solve(hd.Equation(hd.Caputo([1.5, 0.5]), powers, y0, factors), 2.0, rtol=1e-9)
    t = np.linspace(0.1, 2, 30)
    np.testing.assert_allclose(sol(t), np.column_stack([t**3, t]), atol=1e-8)
    np.testing.assert_allclose(sol(t, 1), np.column_stack([3 * t**2, np.ones(30)]), atol=1e-7)
    np.testing.assert_allclose(sol.ydot[:, 0], 3 * sol.t**2, atol=1e-8)
    assert np.isnan(sol.ydot[0, 1])
    np.testing.assert_allclose(sol.ydot[1:, 1], 1, atol=1e-7)


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
@pytest.mark.parametrize("name", RUNS)
def test_continuous_at_step_ends_and_begun_at_the_initial_value(name, rtol):
    """From both sides, also where stretches of steps meet; to a hundredth of the tolerance.

    At the start it is within the tolerance.
    """
    make, t_end, breaks = RUNS[name]
    equation = make()
    sol = hd.solve(equation, t_end, rtol=rtol, breaks=breaks)
    inner, rows = sol.t[1:-1], sol.y[1:-1]
    within = 1e-2 * rtol * np.abs(sol.y).max()
    for t in (np.nextafter(inner, 0.0), inner, np.nextafter(inner, t_end)):
        assert np.abs(sol(t) - rows).max() <= within
    if sol.ydot is not None:
        for t in (np.nextafter(inner, 0.0), np.nextafter(inner, t_end)):
            assert np.abs(sol(t, 1) - sol.ydot[1:-1]).max() <= 1e-2 * rtol * np.abs(sol.ydot).max()
        assert np.abs(sol(0.0, 1) - equation.y0[1]).max() <= rtol * np.abs(sol.ydot).max()
    np.testing.assert_allclose(sol(t_end), sol.y[-1], rtol=0, atol=1e-14 * np.abs(sol.y).max())
    y0 = equation.y0[0]
    assert np.abs(sol(0.0) - y0).max() <= rtol * np.abs(y0).max()


@pytest.mark.parametrize("v0", [-2.0, 0.5, 2.0])
def test_the_start_of_a_solution_of_three_generators(v0):
    """What a basis of powers makes of x(0) = 1 must not leave the tolerance."""
    sol = hd.solve(hd.Equation(THREE, lambda t, x: -0.221 * x, [1.0, v0]), 0.77, rtol=5e-11)
    t = sol.t[1] * np.concatenate([[0.0], np.geomspace(1e-18, 1, 40)])
    orders, coefficients = (0.4143, 0.9575, 1.7722), (0.195, 0.133, 1.0)
    solution = exact.several_terms(orders, coefficients, [1.0, v0], 0.221)
    assert np.abs(sol(t) - solution(t)).max() <= 5e-11


@pytest.mark.parametrize("order", [0.02, 0.1, 0.3, 0.5, 0.8, 0.9, 0.95, 0.97, 1.0])
def test_the_slope_at_the_start_is_infinite_where_powers_below_1_are(order):
    sol = hd.solve(hd.scenes.relaxation(order), 2.0, rtol=1e-8)
    assert sol(0.0, 1)[0] == (pytest.approx(-1, rel=1e-7) if order == 1 else -np.inf)

    def line(t, y, p):
        return t ** (1 - order) / p[0] + 1 + t - y

    equation = hd.Equation(hd.Caputo(order), line, 1.0, params=[math.gamma(2 - order)])
    assert hd.solve(equation, 2.0, rtol=1e-8)(0.0, 1)[0] == pytest.approx(1, abs=0.02)


def test_rows_at_the_start_and_at_the_end_are_there_if_asked_for():
    equation = hd.scenes.stick_slip()
    for t_eval in ([0.0, 1.0], [1.0], [0.0], [0.5, 0.6], [1.0 - 1e-15]):
        rows = hd.solve(equation, 1.0, rtol=1e-8, t_eval=t_eval)
        np.testing.assert_allclose(rows.t, t_eval, rtol=1e-14)
        assert rows.y.shape == rows.ydot.shape == (len(t_eval), 1)
    assert hd.solve(equation, 1.0, rtol=1e-8, t_eval=[0.0]).y[0, 0] == 0.2


def test_shapes():
    sol = hd.solve(hd.scenes.brusselator(0.8), 2.0, rtol=1e-6)
    assert sol(1).shape == sol(1.0).shape == sol(np.float64(1.0)).shape == (2,)
    assert sol([1.0]).shape == (1, 2)
    assert sol(np.linspace(0, 2, 7)).shape == sol(np.linspace(0.1, 2, 7), derivative=1).shape
    assert sol([]).shape == (0, 2)


def test_the_order_of_times_does_not_matter():
    sol = hd.solve(hd.scenes.stick_slip(), 20.0, rtol=1e-6)
    t = np.random.default_rng(0).permutation(np.linspace(0, 20, 500))
    np.testing.assert_allclose(sol(t), [sol(one) for one in t], rtol=1e-14, atol=1e-14)


def test_runs_that_keep_rows_alone_have_no_dense_output():
    equation = hd.scenes.relaxation()
    for sol in (
        hd.solve(equation, 2.0, rtol=1e-6, t_eval=[1.0]),
        hd.solve(equation, 2.0, 100, t_eval=[1.0]),
        hd.solve(equation, 2.0, 100, scheme=hd.BDF(2), save_every=2),
    ):
        assert sol.dense is None
        with pytest.raises(ValueError, match="t must be answered by rows"):
            sol(1.0)


def steady(t, y, p):
    return np.full(1, p[0])


def power(order):
    """D^alpha x = Gamma(alpha + 1): x(0) + t x'(0) + t**alpha."""
    equation = hd.Equation(
        hd.Caputo(order), steady, [1.0] + [0.5] * (order > 1), (gamma(order + 1),)
    )
    t = np.linspace(0, 4, 41)[1:]
    return t, hd.solve(equation, 4.0, 4, scheme=hd.Adams(), t_eval=t)


@pytest.mark.parametrize("order", [0.3, 0.5, 0.8, 1.0, 1.4])
def test_rows_follow_the_power_until_parabolas_take_over(order):
    t, sol = power(order)
    off = np.abs(sol.y[:, 0] - 1.0 - 0.5 * (order > 1) * t - t**order)
    assert off[:20].max() < 1e-13
    assert (off[20:30].max() > 1e-4) == (order != 1)


def test_slopes_follow_the_power():
    t, sol = power(1.4)
    inside = np.r_[:9, 10:19]  # at the steps themselves it is the scheme's
    np.testing.assert_allclose(sol.ydot[inside, 0], 0.5 + 1.4 * t[inside] ** 0.4, rtol=1e-12)


SCHEMES = [
    *(hd.ExplicitCaputo(), hd.GrunwaldLetnikov(), hd.L1(), hd.L12(), hd.L2()),
    *(hd.BDF(2), hd.Adams()),
]
Y0, BELOW_1 = [1.0, 0.5], (hd.L12, hd.L2)
FIRST_STEPS = [
    (scheme, order)
    for scheme in SCHEMES
    for order in (0.3, 0.5, 0.8, 0.95, 1.4, 1.8)
    if order < 1 or not isinstance(scheme, BELOW_1)
]
UNIFORM, MESH = {"n_steps": 100}, {"mesh": np.linspace(0, 1, 101)}
WITH_MESHES = [
    *((*run, UNIFORM) for run in FIRST_STEPS),
    *((*run, MESH) for run in FIRST_STEPS if run[1] < 1 and isinstance(run[0], (hd.L1, hd.L2))),
]


@pytest.mark.parametrize(("scheme", "order", "steps"), WITH_MESHES)
def test_rows_at_and_inside_the_first_steps(scheme, order, steps):
    """Those inside err like the steps; a run that is resumed there has the same rows."""
    true, y0 = relaxation(order, 1.0, Y0[: 1 + (order > 1)]), Y0[: 1 + (order > 1)]
    fall = hd.Equation(hd.Caputo(order), lambda t, y: -y, y0)
    full = hd.solve(fall, 1.0, scheme=scheme, **steps)
    nearest = np.abs(full.y[1:4, 0] - true(full.t[1:4])[:, 0]).max()
    t = np.linspace(0, 0.02, 41)[1:]
    off = np.abs(full(t)[:, 0] - true(t)[:, 0])
    assert off.max() < 2 * nearest + 1e-4 / 4  # and something like a bend of h**2
    times = [0.005, 0.01, 0.015, 0.02, 0.5]
    rows = hd.solve(fall, 1.0, scheme=scheme, t_eval=times, **steps)
    assert np.array_equal(rows.y[[1, 3]], full.y[1:3])
    if steps == UNIFORM:
        state = hd.solve(fall, 0.01, 1, scheme=scheme).state
        again = hd.solve(fall, 1.0, scheme=scheme, resume=state, t_eval=times[2:])
        assert np.array_equal(again.y, rows.y[2:])


def ring(t, y):
    return np.roll(y, 1) - 2 * y + np.sin(t)


def equation(d=5):
    return hd.Equation(hd.Caputo(0.8), ring, np.arange(1.0, d + 1))


HOW = [
    {"n_steps": 50},
    {"n_steps": 50, "save_every": 7, "scheme": hd.BDF(2)},
    {"n_steps": 50, "t_eval": [0.1, 0.33, 1.0]},
    {"rtol": 1e-6},
    {"rtol": 1e-6, "t_eval": [0.1, 0.33, 1.0]},
]


@pytest.mark.parametrize("how", HOW, ids=str)
def test_rows_are_columns_of_the_whole_run(how):
    crossing = [lambda t, y: y[0] - 2.0]
    whole = hd.solve(equation(), 1.0, events=crossing, **how)
    some = hd.solve(equation(), 1.0, events=crossing, components=[3, 0], **how)
    assert np.array_equal(some.t, whole.t)
    assert np.array_equal(some.y, whole.y[:, [3, 0]])
    assert np.array_equal(some.y_events[0], whole.y_events[0])
    assert some.dense is None
    with pytest.raises(ValueError, match="kept no dense output"):
        some(0.5)
    on = {key: value for key, value in how.items() if key == "scheme"}
    ends = [hd.solve(equation(), 2.0, resume=each.state, **on).y[-1] for each in (whole, some)]
    assert np.array_equal(*ends)


def test_slopes_go_with_them():
    above = hd.Equation(hd.Caputo(1.5), ring, np.array([np.arange(4.0), np.ones(4)]))
    whole, some = (hd.solve(above, 1.0, 20, components=c) for c in (None, [2]))
    assert np.array_equal(some.ydot, whole.ydot[:, [2]])
