"""Implicit steps of many components: factors of Newton's matrix that are kept over steps."""

import numpy as np
import pytest
from problems import laplacian
from scipy.optimize import brentq
from solver.runs import at_end, completed, errors_of, warned

import hereditary as hd

SCHEMES = [hd.BDF(2), hd.L1(), hd.L2(), hd.ProductTrapezoid()]


def diffusion(t, u):
    n = u.size
    du = -2 * u * (n + 1.0) ** 2
    du[1:] += u[:-1] * (n + 1.0) ** 2
    du[:-1] += u[1:] * (n + 1.0) ** 2
    return du


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
@pytest.mark.parametrize("d", [9, 15, 60])
def test_many_components_are_as_many_single_ones(scheme, d):
    """A symmetric system in its eigenvectors is a scheme for each of them."""
    rates, vectors = np.linalg.eigh(laplacian(d).toarray())
    u0 = np.sin(np.pi * np.arange(1, d + 1) / (d + 1)) ** 3
    sol = hd.solve(hd.Equation(hd.Caputo(0.7), diffusion, u0), 1.0, 100, scheme=scheme)
    single = hd.Equation(hd.Caputo(0.7), lambda t, y, p: p[0] * y, 1.0, params=[-1.0])
    grown = [hd.solve(single, 1.0, 100, scheme=scheme, params=[rate]).y[-1, 0] for rate in rates]
    assert np.abs(sol.y[-1] - vectors @ (grown * (vectors.T @ u0))).max() < 1e-11
    assert sol.stats["n_factorised"] <= (4 if d > 10 else 400)


@pytest.mark.parametrize("scheme", [hd.L1(), hd.BDF(2), hd.ProductTrapezoid()], ids=repr)
def test_a_jacobian_found_by_differences_is_as_good_as_a_given_one(scheme):
    """Also where stiffness fades on the way, beside a component a thousand times larger."""

    def fading(t, y, p):
        g = 0.5 * (1 - np.tanh((t - 2) / 0.3))
        return np.array([-p[0] * g * (y[0] - y[1] / p[1]) - 0.3 * y[0], -0.1 * y[1]])

    def jac(t, y, p):
        g = 0.5 * (1 - np.tanh((t - 2) / 0.3))
        return np.array([[-p[0] * g - 0.3, p[0] * g / p[1]], [0.0, -0.1]])

    how = {"y0": [1.0, 1e3], "params": [1e8, 1e3]}
    ends = [
        hd.solve(hd.Equation(hd.Caputo(0.9), fading, jac=given, **how), 5.0, 1000, scheme=scheme).y
        for given in (None, jac)
    ]
    assert np.abs(ends[0] / ends[1] - 1).max() < 1e-8


@pytest.mark.parametrize("scheme", [hd.L1(), hd.BDF(2)], ids=repr)
def test_short_steps_call_f_twice(scheme):
    """The Jacobian of an earlier step is kept: once to move, once to see that it was enough."""

    def duffing(t, y):
        return y - y**3 + 0.3 * np.cos(t)

    n = 100_000
    eq = hd.Equation(hd.Caputo(1.6) + 0.1 * hd.Caputo(0.5), duffing, [0.5, 0.0])
    sol = hd.solve(eq, 20.0, n, scheme=scheme)
    assert 2 * n <= sol.stats["n_rhs"] <= 2.1 * n


@pytest.mark.parametrize("order", [0.8, 1.0])
@pytest.mark.parametrize("named", [True, False])
def test_a_kept_jacobian_does_not_outlast_a_jump(order, named):
    """Stiff up to t = 1, with entries of -1e8: later changes by that Jacobian are tiny."""

    def stiff_at_first(t, y):
        out = -y.copy()
        out[0] = -1e8 * (y[0] - 1) if t < 1 else 3 - 0.5 * y[0]
        return out

    few, many = (
        hd.solve(
            hd.Equation(hd.Caputo(order), stiff_at_first, np.ones(d)), 3.0, rtol=1e-6,
            breaks=[1.0] if named or d == 5 else (),
        )
        for d in (5, 10)
    )  # fmt: skip
    assert many.y[-1, 0] == pytest.approx(few.y[-1, 0], rel=1e-5)


def test_kept_jacobians_leave_no_error_that_adds_up():
    """Errors of increments are kicks, which steps of order above 1 add up twice."""

    def airy(t, x, memory):
        return np.cos(t) + (1 - x[0] ** 2) * memory[0, 0] - (1 + t) * x[0]

    eq = hd.Equation(hd.Caputo(1.6), airy, [0.5, 0.1], memory=hd.Caputo(0.7))
    exact = hd.solve(eq, 2.0, rtol=1e-12).y[-1]
    how = {"scheme": hd.BDF(3), "history": hd.SumOfExponentials(1e-13)}
    errors = errors_of(at_end, exact, (6400, 12_800), eq, 2.0, **how)
    assert errors[1] < 2e-11
    assert 2.85 < np.log2(errors[0] / errors[1]) < 3.15


@pytest.mark.parametrize("period", [2, 3, 40])
def test_kept_jacobians_do_not_change_what_steps_solve(period):
    """Implicit Euler against roots by bisection, where stiffness jumps up and down by 1e6."""
    n, h = 400, 0.01

    def force(t, y):
        k = 1e6 if round(t / h) % period == 0 else 1.0
        return np.cos(5 * t) - k * y**3

    sol = hd.solve(hd.Equation(hd.Caputo(1.0), force, 1.0), n * h, n, scheme=hd.BDF(1))
    y = [1.0]
    for i in range(1, n + 1):
        k = 1e6 if i % period == 0 else 1.0
        start, push = y[-1], np.cos(5 * i * h)
        y.append(brentq(lambda z: z - start - h * (push - k * z**3), -2, 2, xtol=1e-15))  # noqa: B023
    assert np.abs(sol.y[:, 0] - y).max() < 1e-12
    assert sol.stats["n_rhs"] <= 14 * n  # as many as Newton takes from anew


IMPLICIT = [hd.L1(), hd.L12(), hd.L2(), hd.L2Sigma(), hd.BDF(2), hd.BDF(3), hd.ProductTrapezoid()]


@pytest.mark.parametrize("scheme", IMPLICIT, ids=repr)
def test_a_first_step_that_has_no_solution_is_told(scheme):
    """D^0.55 y = 30 y**2 - y in steps of 0.1; so are members of an ensemble."""
    equation = hd.Equation(hd.Caputo(0.55), lambda t, y, p: p[0] * y**2 - y, 1.0, [30.0])
    sol = warned("Newton", equation, 3.0, 30, scheme=scheme)
    assert sol.status is hd.Status.NOT_SOLVED
    assert (sol.t.tolist(), sol.y.tolist()) == ([0.0], [[1.0]])
    with pytest.warns(hd.SolveWarning, match="1 of 2 members"):
        members = hd.ensemble(equation, 3.0, 30, params=[[30.0], [0.5]], scheme=scheme)
    assert list(members.status) == [hd.Status.NOT_SOLVED, hd.Status.COMPLETED]


@pytest.mark.parametrize("scheme", [hd.L1(), hd.L2Sigma(), hd.ProductTrapezoid()], ids=repr)
def test_newton_that_does_not_converge_is_told(scheme):
    """y' = y**2 jumps past its pole: no solution of the step's equation is left."""
    equation = hd.Equation(hd.Caputo(1.0), lambda t, y: 1 + y**2, 0.0)
    sol = warned("Newton", equation, 3.0, 30, scheme=scheme)
    assert sol.status is hd.Status.NOT_SOLVED
    assert "Newton" in sol.message
    assert 0.5 < sol.t[-1] < 1.8
    assert np.all(np.isfinite(sol.y))


@pytest.mark.parametrize(
    "scheme", [hd.L1(), hd.L2(), hd.L2Sigma(), hd.ProductTrapezoid()], ids=repr
)
@pytest.mark.parametrize("rate", [1e3, 1e6])
def test_stiff_relaxation_stays_bounded(scheme, rate):
    sol = completed(hd.scenes.relaxation(0.7, rate, 1.0), 10.0, 200, scheme=scheme)
    assert np.abs(sol.y).max() <= 1.0
    assert abs(sol.y[-1, 0]) < 1e-2


def test_solutions_that_decay_to_nothing_are_solved():
    """Below 1e-308 no increment has relative accuracy left; that is no failure."""
    sol = completed(hd.scenes.relaxation(1.0, 100.0), 20.0, 2000, scheme=hd.L2())
    assert sol.y[-1, 0] == 0.0 or abs(sol.y[-1, 0]) < 1e-300
