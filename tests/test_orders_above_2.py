"""Orders above 2: systems of y and its derivatives, made by the library."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from problems import assert_converges, mittag_leffler, run

import hereditary as hd

C = hd.Caputo
GIVEN = (hd.ExplicitCaputo(), hd.L1(), hd.BDF(2), hd.GrunwaldLetnikov())


@pytest.mark.parametrize("alpha", [2.1, 2.5, 3.0, 3.7])
def test_decay_of_order_above_2_is_mittag_leffler(alpha):
    m, t_end = int(np.ceil(alpha)), 3.0
    for k in range(m):
        y0 = np.eye(m)[k]
        eq = hd.Equation(C(alpha), lambda t, y: -y, y0)
        exact = t_end**k * mittag_leffler(alpha, -(t_end**alpha), k + 1).real
        slope = t_end ** (k - 1) * mittag_leffler(alpha, -(t_end**alpha), k).real
        sol = hd.solve(eq, t_end, rtol=1e-10)
        assert sol.y.shape == (sol.t.size, 1)
        assert abs(sol.y[-1, 0] - exact) < 1e-9
        assert abs(sol.ydot[-1, 0] - slope) < 1e-9
        assert abs(sol(t_end, 1)[0] - slope) < 1e-9

        def end(n, eq=eq):
            return hd.solve(eq, t_end, n, scheme=hd.BDF(2)).y[-1]

        assert_converges(end, exact, (400, 800), 2, 1e-3)


def test_the_benchmark_of_many_terms_holds_for_long():
    """D^3 x + D^2.5 x + x'' + 4 x' + D^0.5 x + 4 x = 6 cos t."""
    terms = C(3) + C(2.5) + C(2) + 4 * C(1) + C(0.5)
    eq = hd.Equation(terms, lambda t, x: 6 * np.cos(t) - 4 * x, [1.0, 1.0, -1.0])
    sol = hd.solve(eq, 5000.0, rtol=1e-10)
    t = np.linspace(0.0, 5000.0, 50_001)
    assert np.abs(sol(t)[:, 0] - np.sqrt(2) * np.sin(t + np.pi / 4)).max() < 1e-11
    assert np.abs(sol(t, 1)[:, 0] - np.sqrt(2) * np.cos(t + np.pi / 4)).max() < 1e-11
    for scheme, order, least in ((hd.BDF(2), 2, 1e-4), (hd.ExplicitCaputo(), 1, 2e-2)):

        def off(n, scheme=scheme):
            steps = hd.solve(eq, 10.0, n, scheme=scheme)
            return steps.y[:, 0] - np.sqrt(2) * np.sin(steps.t + np.pi / 4)

        assert_converges(off, 0.0, (2000, 4000), order, least)


@given(
    alpha=st.floats(2.05, 3.0),
    low=st.floats(0.1, 0.9),
    middle=st.floats(1.1, 1.9),
    factors=st.tuples(*[st.floats(-0.5, 0.5)] * 4),
)
def test_it_is_the_system_by_hand(alpha, low, middle, factors):
    a, b, c, d = factors
    terms = [C(alpha), a * C(middle), b * C(low), c * C(2), d * C(1)]

    def f(t, y):
        return -y[0] - 0.1 * y[0] ** 3 + np.cos(t)

    eq = hd.Equation(terms, f, [1.0, 0.5, -0.2])

    def by_hand(t, y):
        # y, y', y'', D^low y, D^middle y
        force = f(t, y) - a * y[4] - b * y[3] - c * y[2] - d * y[1]
        return np.array([y[1], y[2], force, y[1], y[2]])

    orders = [1.0, 1.0, alpha - 2, 1 - low, 2 - middle]
    system = hd.Equation(C(orders), by_hand, [1.0, 0.5, -0.2, 0.0, 0.0])
    found, expected = run(eq, hd.Collocation()), run(system, hd.Collocation())
    np.testing.assert_allclose(found.y[-1, 0], expected.y[-1, 0], atol=1e-7)
    np.testing.assert_allclose(found.ydot[-1, 0], expected.y[-1, 1], atol=1e-7)


@given(alpha=st.floats(2.05, 4.0), scheme=st.sampled_from(GIVEN))
def test_one_term_is_the_chain_to_rounding(alpha, scheme):
    m = int(np.ceil(alpha))
    y0 = [1.0, 0.5, -0.2, 0.3][:m]

    def chain(t, y):
        return np.append(y[1:], -np.sin(y[0]) + 0.2 * t)

    ours = run(hd.Equation(C(alpha), lambda t, y: -np.sin(y) + 0.2 * t, y0), scheme)
    orders = np.append(np.ones(m - 1), alpha - m + 1)
    theirs = run(hd.Equation(C(orders), chain, y0), scheme)
    np.testing.assert_allclose(ours.y[:, 0], theirs.y[:, 0], rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(ours.ydot[:, 0], theirs.y[:, 1], rtol=1e-10, atol=1e-11)


def coupled(t, y):
    return np.array([0.7 * y[1] - y[0], -y[1] + y[0] * y[1]])


def slopes(t, y):
    return np.array([[-1.0, 0.7], [y[1], -1.0 + y[0]]])


@pytest.mark.parametrize("scheme", [hd.L1(), hd.BDF(2), hd.Collocation()], ids=repr)
def test_components_may_have_orders_of_their_own_and_a_jacobian(scheme):
    y0 = [[1.0, 0.5], [0.2, 0.0], [0.1, 0.0]]
    terms = C([2.6, 0.8]) + np.array([0.3, 0.0]) * C(1.4)
    found, expected = (run(hd.Equation(terms, coupled, y0, jac=j), scheme) for j in (None, slopes))
    np.testing.assert_allclose(found.y[-1], expected.y[-1], rtol=1e-7)

    def by_hand(t, y):
        force = coupled(t, y[:2])
        return np.array([y[2], force[1], y[3], force[0] - 0.3 * y[4], y[3]])

    system = hd.Equation(C([1, 0.8, 1, 0.6, 0.6]), by_hand, [1.0, 0.5, 0.2, 0.1, 0.0])
    truth = hd.solve(system, 2.0, rtol=1e-10)
    bound = 1e-7 if scheme == hd.Collocation() else 0.02
    assert np.abs(found.y[-1] - truth.y[-1, :2]).max() < bound
    # y' of the second is its slope, as ever
    assert np.isfinite(found.ydot[-1]).all()
    assert found.ydot[-1, 1] == pytest.approx(float(truth(2.0, 1)[1]), abs=0.02)


def test_exponents_count_all_derivatives():
    eq = hd.Equation(C(3) + 0.5 * C(2) + C(1), lambda t, y: -0.2 * y, [1.0, 0.0, 0.0])
    result = hd.lyapunov(eq, 200.0, 20_000, k=3)
    # roots of s^3 + 0.5 s^2 + s + 0.2
    real = np.sort(np.roots([1, 0.5, 1, 0.2]).real)[::-1]
    np.testing.assert_allclose(np.sort(result.exponents)[::-1], real, atol=0.01)
    assert result.y.shape == (1,)


def test_equal_terms_add_up():
    twice, once = (
        hd.Equation(terms + C(1), lambda t, y: -y, [1.0, 0, 0]) for terms in (C(3) + C(3), 2 * C(3))
    )
    np.testing.assert_array_equal(*(hd.solve(eq, 1.0, 50).y for eq in (twice, once)))


def test_slopes_at_the_start_are_unknown_where_no_order_exceeds_1():
    eq = hd.Equation(C([2.5, 0.7]), lambda t, y: -y, [[1.0, 1.0], [0.3, 0], [0, 0]])
    for how in ({"n_steps": 100}, {"rtol": 1e-6}):
        first = hd.solve(eq, 1.0, **how).ydot[0]
        assert first[0] == 0.3
        assert np.isnan(first[1])


def test_exponents_do_not_depend_on_the_tolerance():
    eq = hd.Equation(hd.Caputo(2.5), lambda t, y: -y + np.cos(t), [1.0, 0.0, 0.1])
    coarse, fine = (hd.lyapunov(eq, 6.0, rtol=rtol).exponents for rtol in (1e-5, 1e-7))
    # tangents err by rtol of their size, and exponents are their logarithms over a time of 6
    np.testing.assert_allclose(coarse, fine, rtol=0, atol=1e-5)
