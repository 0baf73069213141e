"""Riemann-Liouville terms: Caputo's derivative and what y(0) adds, which is infinite at 0."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from problems import assert_converges

import hereditary as hd

FRICTION, STIFFNESS, T_END = 0.7, 1.3, 3.0
# Highest order and that of the Riemann-Liouville term.
CASES = [(2.0, 0.5), (1.7, 0.4), (1.0, 0.6), (0.8, 0.5)]


def spring(t, x):
    return -1.3 * x


def waving(t):
    return 0.5 + 0.3 * np.sin(t)


def initial(alpha, scale=1.0):
    return [scale, 0.3 * scale] if alpha > 1 else [scale]


def equation(alpha, gamma, rhs=spring, scale=1.0):
    terms = hd.Caputo(alpha) + FRICTION * hd.RiemannLiouville(gamma)
    return hd.Equation(terms, rhs, initial(alpha, scale))


def exact(alpha, gamma, t):
    """By Laplace: that of D^gamma y is s**gamma Y, without y(0)."""
    y0 = initial(alpha)

    def transform(s):
        start = s ** (alpha - 1) * y0[0] + (s ** (alpha - 2) * y0[1] if alpha > 1 else 0)
        return start / (s**alpha + FRICTION * s**gamma + STIFFNESS)

    with mpmath.workdps(30):
        return float(mpmath.invertlaplace(transform, t, method="talbot", degree=40))


def order_claimed(scheme, alpha, gamma):
    if isinstance(scheme, hd.BDF):
        return scheme.formula
    if isinstance(scheme, hd.L2 | hd.L12):
        return 1 - gamma
    return 3 - alpha if isinstance(scheme, hd.L1) and alpha > 1 else 1.0


SCHEMES = [hd.ExplicitCaputo(), hd.GrunwaldLetnikov(), hd.L1(), hd.BDF(1), hd.BDF(2), hd.BDF(3)]
SCHEMES += [hd.L2(), hd.L12()]


def end(eq, scheme, t_end=T_END):
    """Return how y at the end follows from the number of steps."""
    return lambda n: hd.solve(eq, t_end, n, scheme=scheme).y[-1]


@pytest.mark.parametrize(("alpha", "gamma"), CASES)
def test_collocation_is_exact_to_its_tolerance(alpha, gamma):
    times = np.array([1e-6, 1e-3, 0.1, 1.0, 3.0])
    truth = np.array([exact(alpha, gamma, t) for t in times])
    for rtol in (1e-6, 1e-10):
        sol = hd.solve(equation(alpha, gamma), T_END, rtol=rtol)
        assert np.abs(sol(times)[:, 0] - truth).max() < rtol


@pytest.mark.parametrize(("alpha", "gamma"), CASES)
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_schemes_converge_as_told(scheme, alpha, gamma):
    if alpha > scheme.orders[1]:
        pytest.skip("beyond the scheme's orders")
    truth, order = exact(alpha, gamma, T_END), order_claimed(scheme, alpha, gamma)
    bound = 1e-2 if order >= 1 else 1e-1
    assert_converges(end(equation(alpha, gamma), scheme), truth, (800, 1600), order, bound)


@pytest.mark.parametrize("scheme", [hd.L1(), hd.L2()], ids=repr)
def test_graded_meshes_restore_the_order(scheme):
    alpha, gamma = 0.8, 0.5
    order, eq = scheme.order(alpha), equation(alpha, gamma)

    def on_mesh(n):
        mesh = hd.graded(n, order / (1 - gamma))
        return hd.solve(eq, T_END, mesh=mesh, scheme=scheme).y[-1]

    assert_converges(on_mesh, exact(alpha, gamma, T_END), (400, 800), order, 1e-4)


@pytest.mark.parametrize("alpha", [2.0, 1.0])
def test_an_order_that_varies_may_be_constant(alpha):
    def half(t):
        return 0.5 + 0.0 * t

    truth = exact(alpha, 0.5, T_END)
    sol = hd.solve(equation(alpha, half), T_END, rtol=1e-10)
    assert abs(sol.y[-1, 0] - truth) < 1e-10
    for scheme in (hd.ExplicitCaputo(), hd.L1()):
        for history in (hd.Direct(), hd.SumOfExponentials()):
            how = {"scheme": scheme, "history": history}
            varying = hd.solve(equation(alpha, half), T_END, 300, **how).y
            constant = hd.solve(equation(alpha, 0.5), T_END, 300, **how).y
            assert np.abs(varying - constant).max() < 1e-8


@pytest.mark.hypothesis
@given(
    st.floats(0.1, 0.9),
    st.sampled_from([hd.ExplicitCaputo(), hd.L1(), hd.BDF(2), hd.GrunwaldLetnikov(), None]),
    st.floats(-2.0, 2.0),
)
def test_without_an_initial_value_it_is_caputos(gamma, scheme, slope):
    how = {"rtol": 1e-9} if scheme is None else {"n_steps": 60, "scheme": scheme, "estimate": False}
    rows = []
    for kind in (hd.Caputo, hd.RiemannLiouville):
        terms = hd.Caputo(2.0) + 0.5 * kind(gamma)
        eq = hd.Equation(terms, lambda t, x: np.cos(t) - x, [0.0, slope])
        rows.append(hd.solve(eq, 2.0, **how).y[-1, 0])
    assert abs(rows[1] - rows[0]) < (1e-12 if scheme is not None else 1e-9)


@pytest.mark.parametrize(("alpha", "gamma"), CASES)
def test_rows_between_the_first_steps_err_as_steps_do(alpha, gamma):
    sol = hd.solve(equation(alpha, gamma), 1.0, 100, scheme=hd.BDF(2))
    exactly = hd.solve(equation(alpha, gamma), 1.0, rtol=1e-9)
    times = np.linspace(1e-4, 0.02, 50)
    steps = np.abs(sol.y[1:3] - exactly(sol.t[1:3])).max()
    assert np.abs(sol(times) - exactly(times)).max() < 1.5 * steps


def test_one_of_several_components_may_have_it():
    """The other component and another start of time change nothing."""
    terms = hd.Caputo([1.0, 0.6]) + np.array([FRICTION, 0.0]) * hd.RiemannLiouville(0.6)
    eq = hd.Equation(terms, lambda t, y: np.array([-1.3 * y[0], -y[1]]), [1.0, 1.0], t_start=5.0)
    sol = hd.solve(eq, 8.0, rtol=1e-10)
    assert abs(sol.y[-1, 0] - exact(1.0, 0.6, 3.0)) < 1e-10
    steps = hd.solve(eq, 8.0, 1600, scheme=hd.BDF(3))
    assert abs(steps.y[-1, 0] - exact(1.0, 0.6, 3.0)) < 1e-7
    sol = hd.solve(equation(1.0, 0.6, scale=1.0 + 2.0j), 3.0, rtol=1e-10)
    assert abs(sol.y[-1, 0] - (1 + 2j) * exact(1.0, 0.6, 3.0)) < 1e-9


def test_the_duffing_oscillator_of_that_kind():
    eq = hd.scenes.duffing(gamma=waving, friction=0.3, riemann_liouville=True)
    sol = hd.solve(eq, 5.0, rtol=1e-9)
    assert_converges(end(eq, None, 5.0), sol.y[-1], (8000, 16_000), 1, 1e-2)
    other = hd.solve(hd.scenes.duffing(gamma=waving, friction=0.3), 5.0, rtol=1e-9)
    assert abs(other.y[-1, 0] - sol.y[-1, 0]) > 0.1


def test_what_is_refused_with_steps_that_adapt_runs_on_given_ones():
    RL, C = hd.RiemannLiouville, hd.Caputo
    read = hd.Equation(C(0.9) + RL(0.4), lambda t, y, m: -y - m[0], 1.0, memory=C(0.3))
    assert hd.solve(read, 1.0, 100, scheme=hd.BDF(2)).success
    mixed = hd.Equation(C(2.0) + RL(waving) + C(lambda t: 0.5 + 0.0 * t), spring, [1.0, 0.0])
    assert hd.solve(mixed, 1.0, 100, scheme=hd.L1()).success
    ahead = hd.Equation(C(lambda t: 1.9 - 0.05 * t) + RL(0.3), spring, [1.0, 0.0])
    assert hd.solve(ahead, 1.0, 100).success
