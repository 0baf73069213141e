"""Meshes of any steps: full orders on graded ones, the uniform march on uniform ones."""

import pickle

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import errors_on_mesh, singular_problem, smooth_problem
from scipy.special import gamma
from test_pairs import EQUATIONS, REFUSED, name_of

import hereditary as hd
from hereditary.analysis.order import observed_order
from hereditary.compiled.mesh import moments
from hereditary.meshes import mesh_steps
from hereditary.solver.stepper import Stepper
from hereditary.special import gauss_unit
from hereditary.system import displaced

SCHEMES = [hd.L1(), hd.L2(), hd.L2Sigma()]
HISTORIES = [hd.Direct(), hd.SumOfExponentials(1e-12)]
COVERED = tuple(EQUATIONS)


def full_order(scheme, alpha):
    return scheme.order(alpha, smoothness="smooth")


@pytest.mark.parametrize("alpha", [0.3, 0.5, 0.8, 0.95])
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_graded_meshes_keep_the_full_order_for_singular_solutions(scheme, alpha):
    """Largest error over all times, with the grading order / alpha."""
    order, steps = full_order(scheme, alpha), [250, 500, 1000]
    problem = singular_problem(alpha)
    found = [
        errors_on_mesh(problem, scheme, hd.SumOfExponentials(1e-13), hd.graded(n, order / alpha))
        for n in steps
    ]
    table = observed_order(steps, found)
    assert table.slope == pytest.approx(order, abs=0.15), table
    assert table.errors[-1] < 2e-4 * 4 ** (2 - order)


@pytest.mark.parametrize("beta", [1.2, 1.5, 1.8])
def test_order_reduction_keeps_second_order_on_graded_meshes(beta):
    steps, problem = [200, 400, 800], singular_problem(beta)
    history = hd.SumOfExponentials(1e-13)
    found = [errors_on_mesh(problem, hd.L2Sigma(), history, hd.graded(n, 4 / beta)) for n in steps]
    assert observed_order(steps, found).slope == pytest.approx(2.0, abs=0.15)
    assert found[-1] < 5e-6


@pytest.mark.parametrize("scheme", [hd.L2(), hd.L2Sigma()], ids=repr)
def test_strong_grading_loses_no_digits(scheme):
    """Grading (3 - alpha) / alpha = 9 at alpha = 0.3: closed-form moments would break here."""
    steps = [500, 1000, 2000]
    found = [
        errors_on_mesh(
            singular_problem(0.3), scheme, hd.SumOfExponentials(1e-13), hd.graded(n, 9.0)
        )
        for n in steps
    ]
    assert observed_order(steps, found).slope == pytest.approx(full_order(scheme, 0.3), abs=0.15)


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_without_grading_the_start_limits_the_order_to_alpha(scheme):
    steps = [2000, 4000, 8000]
    problem = singular_problem(0.5)
    found = [
        errors_on_mesh(problem, scheme, hd.SumOfExponentials(1e-13), hd.graded(n, 1.0))
        for n in steps
    ]
    assert observed_order(steps, found).slope == pytest.approx(0.5, abs=0.15)


@pytest.mark.parametrize("name", COVERED)
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_a_uniform_mesh_gives_the_uniform_march(scheme, name):
    if (name_of(scheme), name) in REFUSED:
        return
    equation, n = EQUATIONS[name](), 200
    uniform = hd.solve(equation, 2.0, n, scheme=scheme, history=hd.Direct())
    for history in HISTORIES:
        mesh = hd.solve(
            equation, 2.0, mesh=np.linspace(0, 2, n + 1), scheme=scheme, history=history
        )
        assert mesh.success
        np.testing.assert_allclose(mesh.y, uniform.y, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("name", COVERED)
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_histories_agree_on_irregular_meshes(scheme, name):
    if (name_of(scheme), name) in REFUSED:
        with pytest.raises(ValueError, match="L1"):
            hd.solve(EQUATIONS[name](), 2.0, mesh=hd.graded(10, 2.0), scheme=scheme)
        return
    steps = np.random.default_rng(2).uniform(0.3, 1.0, 300) * np.geomspace(1e-8, 1, 300)
    times = np.concatenate([[0.0], np.cumsum(steps)])
    times *= 2.0 / times[-1]
    direct, modes = (
        hd.solve(EQUATIONS[name](), 2.0, mesh=times, scheme=scheme, history=h) for h in HISTORIES
    )
    assert np.abs(modes.y - direct.y).max() <= 1e-11 * np.abs(direct.y).max()


def slope_of_line(t, y, p):
    """D^0.6 of t."""
    return p[0] * t**0.4


@settings(max_examples=15)
@given(st.lists(st.floats(0.05, 1.0), min_size=3, max_size=60))
def test_lines_are_exact_on_any_mesh(steps):
    times = np.concatenate([[0.0], np.cumsum(steps)])
    equation = hd.Equation(hd.Caputo(0.6), slope_of_line, 0.0, (1 / gamma(1.4),))
    for scheme in SCHEMES:
        sol = hd.solve(equation, times[-1], mesh=times, scheme=scheme, history=hd.Direct())
        np.testing.assert_allclose(sol.y[:, 0], sol.t, rtol=1e-11)


def test_smooth_solutions_keep_their_order_on_a_mildly_graded_mesh():
    steps = [200, 400, 800]
    for scheme in SCHEMES:
        found = [
            errors_on_mesh(smooth_problem(0.5), scheme, hd.Direct(), hd.graded(n, 1.5))
            for n in steps
        ]
        table = observed_order(steps, found)
        assert table.slope == pytest.approx(full_order(scheme, 0.5), abs=0.15), scheme


def test_rows_on_a_mesh():
    equation, mesh = hd.scenes.relaxation(0.6), hd.graded(100, 2.0)
    full = hd.solve(equation, 3.0, mesh=mesh, scheme=hd.L2())
    np.testing.assert_allclose(full.t, mesh.times(3.0), rtol=1e-15)
    some = hd.solve(equation, 3.0, mesh=mesh, scheme=hd.L2(), save_every=7)
    assert np.array_equal(some.y, full.y[[*range(0, 100, 7), 100]])
    square = hd.Equation(hd.Caputo(0.6), lambda t, y, p: p[0] * t**1.4, 0.0, (2 / gamma(2.4),))
    times = np.linspace(0.05, 2.9, 40)
    rows = hd.solve(square, 3.0, mesh=mesh, scheme=hd.L2(), t_eval=times)
    np.testing.assert_allclose(
        rows.y[:, 0], times**2, rtol=1e-10
    )  # on parabolas, as of uniform steps


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
@pytest.mark.parametrize("history", [hd.Direct(), hd.SumOfExponentials(horizon=30.0)], ids=repr)
def test_a_run_on_a_mesh_goes_on_where_it_stopped(scheme, history):
    """Stopped and resumed twice, once at a step of another length: as in one run, bit for bit.

    With modes where shortest step and horizon are those of the whole run.
    """
    times = 2.0 * np.linspace(0, 1, 61) ** 2
    equation = EQUATIONS["system"]()
    whole = hd.solve(equation, 2.0, mesh=times, scheme=scheme, history=history)
    sol = hd.solve(equation, times[20], mesh=times[:21], scheme=scheme, history=history)
    for first, last in ((20, 21), (21, 60)):
        state = pickle.loads(pickle.dumps(sol.state))
        sol = hd.solve(equation, times[last], mesh=times[first : last + 1], resume=state)
        assert sol.t[0] == times[first]
    assert np.array_equal(sol.y, whole.y[21:])
    again = hd.solve(equation, 3.0, mesh=hd.graded(10, 1.5), resume=sol.state)
    assert again.success
    assert again.t[-1] == 3.0


@pytest.mark.parametrize("name", COVERED)
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_tangents_on_a_mesh_are_derivatives(scheme, name):
    """Of every step, against differences of runs from displaced initial values."""
    if (name_of(scheme), name) in REFUSED:
        return
    equation = EQUATIONS[name]()
    steps = mesh_steps(hd.graded(60, 2.0), 2.0)
    how = scheme, hd.SumOfExponentials(), steps, 60
    d, above = equation.d, equation.highest_orders() > 1
    direction = np.random.default_rng(3).normal(size=(d + above.sum(), 1))
    along = Stepper(equation, *how, directions=direction)
    while along.n < 60:
        along.advance(60, keep=False)
    ends = []
    for sign in (1, -1):
        y0 = equation.y0.copy()
        y0[0] += sign * 1e-5 * direction[:d, 0]
        y0[1:, above] += sign * 1e-5 * direction[d:, 0]
        stepper = Stepper(displaced(equation, y0), *how)
        while stepper.n < 60:
            stepper.advance(60, keep=False)
        ends.append(stepper.y)
    expected = (ends[0] - ends[1]) / 2e-5
    np.testing.assert_allclose(along.tangent[:d, 0], expected, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("beta", [1.2, 1.5, 1.8])
def test_orders_above_1_keep_their_order_on_graded_meshes(beta):
    """Of lines of velocities, over all times."""
    steps, problem = [400, 800, 1600], singular_problem(beta)
    history = hd.SumOfExponentials(1e-13)
    found = [errors_on_mesh(problem, hd.L1(), history, hd.graded(n, 3.0)) for n in steps]
    assert observed_order(steps, found).slope == pytest.approx(3 - beta, abs=0.15)
    assert found[-1] < {1.2: 1e-6, 1.5: 3e-5, 1.8: 4e-4}[beta]


@pytest.mark.parametrize("p", [0.02, 0.3, 0.7, 0.98])
def test_moments_keep_their_digits(p):
    rule = gauss_unit(16)
    for low, width in ((0.0, 1.0), (1e-9, 1.0), (0.1, 1.0), (0.5, 1.0), (1.0, 1.0), (1.0, 1e-12)):
        with mpmath.workdps(60):
            a, b, q = mpmath.mpf(low), mpmath.mpf(low) + mpmath.mpf(width), mpmath.mpf(p)
            m_0 = b**q - a**q
            m_1 = (a + b) / 2 * m_0 - q / (q + 1) * (b ** (q + 1) - a ** (q + 1))
        found = moments(low, width, p, *rule)
        assert found[0] == pytest.approx(float(m_0), rel=1e-14)
        assert found[1] == pytest.approx(float(m_1), rel=1e-13)


@pytest.mark.parametrize(("alpha", "exponent"), [(0.02, 40.0), (0.05, 20.0), (0.1, 29.0)])
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_the_steepest_meshes_give_no_garbage(scheme, alpha, exponent):
    """Neighbouring steps differ by 2**exponent there: parabolas over that ratio would amplify."""
    history = hd.SumOfExponentials(1e-13)
    problem = singular_problem(alpha)
    assert errors_on_mesh(problem, scheme, history, hd.graded(1000, exponent)) < 1e-3
