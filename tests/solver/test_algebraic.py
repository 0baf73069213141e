"""Rows without a derivative, and memory of functions of the solution, to a tolerance."""

import math
from functools import cache

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solver.runs import event

import hereditary as hd

FIRST = np.array([1.0, 0.0])
SECOND = np.array([0.0, 1.0])
G = math.gamma(1.7)


def relaxing(t, y, p):
    return np.array([p[0] - y[0] - y[1], y[0] - y[1]])


def equalled(t, y, p):
    return p[0] - 2 * y[0]


def pushed(t, y, p):
    force = 0.5 if t >= 1.0 else 0.0
    return np.array([p[0] - y[0] - y[1], y[0] - y[1] + force])


def polynomial(t, y):
    x, w = y
    return np.array([G + w - x**2, x**2 + x**6 / 10 - w - w**3 / 10])


def renewal(t, y, memory):
    return np.array([-y[1], y[0] * (2 * memory[0, 1] + 1e-4 * np.exp(-t)) - y[1]])


TERMS = FIRST * hd.Caputo(0.5)
algebraic = cache(lambda: hd.Equation(TERMS, relaxing, [1.0, 1.0], params=[1.0]))
reduced = cache(lambda: hd.Equation(hd.Caputo(0.5), equalled, 1.0, params=[1.0]))
TIGHT = {"rtol": 1e-9}


def circuit():
    terms = np.array([[1.0, -1.0], [0.0, 0.0]]) * hd.Caputo(0.7)
    return hd.Equation(terms, lambda t, v: np.array([v[1] / 2, v[0] - np.sin(t)]), [0.0, 0.0])


def square():
    return hd.Equation(
        0 * hd.Caputo(1),
        lambda t, y, memory: np.array([np.cos(t) - memory[0, 1] - y[0], y[0] ** 2 - y[1]]),
        [1.0, 1.0],
        memory=SECOND * hd.Memory(hd.TemperedPowerLaw(0.5, 1.0), 0),
    )


def late(shape, rate):
    """``y' = -y`` of earlier, by a gamma density."""
    memory = hd.Memory(hd.GammaDensity(shape, rate), 0)
    return hd.Equation(hd.Caputo(1), lambda t, y, memory: -memory[0], 1.0, memory=memory)


def renewed():
    memory = SECOND * hd.Memory(hd.GammaDensity(5.0, 5.0), 0)
    return hd.Equation(FIRST * hd.Caputo(1), renewal, [1.0, 1e-4], memory=memory)


CASES = [
    (algebraic, 2.0, [0.594410641301969] * 2),
    (
        lambda: hd.Equation(FIRST * hd.Caputo(0.7), polynomial, [1.0, 1.0]),
        2.0,
        [1 + 2**0.7, (1 + 2**0.7) ** 2],
    ),
    (circuit, 10.0, [math.sin(10), -0.62347142013735]),
    (square, 1.0, [0.28581642948650]),
    (square, 2.0, [-0.90715423688777]),
    (renewed, 20.0, [0.2044015705677]),
    (lambda: late(1.5, 1.0), 1.0, [0.803792100113431]),
    (lambda: late(1.5, 1.0), 10.0, [0.0153484396603218]),
]


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize(("made", "t_end", "expected"), CASES)
def test_the_tolerance_holds(made, t_end, expected, rtol):
    solved = hd.solve(made(), t_end, rtol=rtol)
    assert solved.success
    found = solved.y[-1, : len(expected)]
    np.testing.assert_allclose(found, expected, rtol=10 * rtol, atol=0)
    assert solved.stats["n_steps"] < 100


def index_2():
    rhs = lambda t, y: np.array([y[1], y[0] - np.sin(t)])  # noqa: E731
    return hd.solve(hd.Equation(FIRST * hd.Caputo(0.5), rhs, [0.0, 1.0]), 2.0)


def convolved_derivative():
    memory = hd.Memory(hd.Prony([1.0], [0.5]), 1)
    rhs = lambda t, y, m: np.cos(t) - y - m[0]  # noqa: E731
    return hd.solve(hd.Equation(0 * hd.Caputo(1), rhs, 1.0, memory=memory), 2.0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda: hd.solve(algebraic().replace(y0=[1.0, 0.5]), 2.0),
            r"a residual of 0.5; .* y0\[0, 1\] = 1",
        ),
        (index_2, r"index above 1.*differentiate"),
        (convolved_derivative, r"memory must convolve y of component 0.*left-hand side"),
        (
            lambda: hd.solve(algebraic(), 2.0, 100),
            "none for component 1; solve algebraic rows with rtol=",
        ),
        (
            lambda: hd.lyapunov(algebraic(), 10.0, rtol=1e-6),
            "equation must have a derivative of every component",
        ),
        # what the derivative acts on would have to change too
        (
            lambda: hd.solve(circuit(), 2.0, changes={1.0: lambda t, v: v + 1.0}),
            "change no y where the matrix in front of a derivative",
        ),
    ],
)
def test_refusals(call, words):
    with pytest.raises(ValueError, match=words):
        call()


LIFT = event(lambda t, y: t - 1.0, change=lambda t, y: y + np.eye(y.size)[0])


@pytest.mark.parametrize("acts", [LIFT, lambda t, y: y[0] - 0.7])
def test_events_and_changes_are_those_of_the_equation_without_the_row(acts):
    how = {"events": acts, "t_eval": [0.5, 1.0, 1.5, 2.0], **TIGHT}
    found, expected = (hd.solve(e, 2.0, **how) for e in (algebraic(), reduced()))
    assert found.t_events[0] == pytest.approx(expected.t_events[0], abs=1e-8)
    np.testing.assert_allclose(found.y, expected.y[:, [0, 0]], atol=1e-8)


def test_rows_hold_after_a_jump_of_the_right_hand_side():
    found = hd.solve(algebraic().replace(rhs=pushed), 2.0, breaks=[1.0], **TIGHT)
    alone = reduced().replace(rhs=lambda t, y, p: p[0] - 2 * y[0] - (0.5 if t >= 1.0 else 0.0))
    end = hd.solve(alone, 2.0, breaks=[1.0], **TIGHT).y[-1, 0]
    assert found.y[-1] == pytest.approx([end, end + 0.5], abs=1e-8)
    assert found(1.5)[1] - found(1.5)[0] == pytest.approx(0.5, abs=1e-8)


def test_runs_resume_beside_rows_which_may_change():
    state = hd.solve(algebraic(), 1.0, scheme=hd.Collocation(horizon=2.0), **TIGHT).state
    expected = hd.solve(reduced(), 2.0, **TIGHT).y[-1, 0]
    found = hd.solve(algebraic(), 2.0, resume=state)
    assert found.y[-1] == pytest.approx([expected] * 2, abs=1e-8)
    other = algebraic().replace(rhs=pushed)
    expected = hd.solve(other, 2.0, breaks=[1.0], **TIGHT).y[-1]
    found = hd.solve(other, 2.0, resume=state, allow_change=True)
    assert found.y[-1] == pytest.approx(expected, abs=1e-8)
    with pytest.raises(ValueError, match="same right-hand side"):
        hd.solve(other, 2.0, resume=state)


def test_members_of_an_ensemble_and_sensitivities():
    members = hd.ensemble(algebraic(), 2.0, params=[[1.0], [2.0]], rtol=1e-8)
    for m, p in enumerate([1.0, 2.0]):
        expected = hd.solve(reduced().replace(params=[p]), 2.0, **TIGHT).y[-1, 0]
        assert members.y[m, -1] == pytest.approx([expected] * 2, abs=1e-7)
    found, alone = (hd.sensitivities(e, 2.0, **TIGHT) for e in (algebraic(), reduced()))
    assert found.by_params[-1, :, 0] == pytest.approx([alone.by_params[-1, 0, 0]] * 2, abs=1e-8)
    assert found.by_y0[-1, :, 0] == pytest.approx([alone.by_y0[-1, 0, 0]] * 2, abs=1e-8)
    assert not found.by_y0[-1, :, 1].any()


def test_complex_components():
    def turning(t, y):
        return np.array([1j * y[0] - y[1], y[0] - y[1]])

    equation = hd.Equation(FIRST * hd.Caputo(0.5), turning, [1.0 + 0j, 1.0])
    found = hd.solve(equation, 2.0, **TIGHT)
    expected = hd.solve(
        hd.Equation(hd.Caputo(0.5), lambda t, y: (1j - 1) * y, 1 + 0j), 2.0, **TIGHT
    )
    assert found.y[-1] == pytest.approx(expected.y[-1, [0, 0]], abs=1e-8)
    with pytest.raises(ValueError, match=r"the row of component 1, .* a residual of 0.5"):
        hd.solve(equation.replace(y0=[1.0 + 0j, 0.5]), 2.0)


@pytest.mark.parametrize("stated", [{}, {"bandwidth": (1, 1)}], ids=str)
def test_many_components(stated):
    def chain(t, y, dy, p):
        for c in range(0, y.size, 2):
            before = y[c - 2] if c > 0 else 1.0
            dy[c] = p[0] - y[c] - y[c + 1]
            dy[c + 1] = y[c] - y[c + 1] + 0.0 * before

    orders = np.tile(FIRST, 10) * hd.Caputo(0.5)
    equation = hd.Equation(orders, chain, np.ones(20), params=[1.0], **stated)
    expected = hd.solve(reduced(), 2.0, **TIGHT).y[-1, 0]
    assert hd.solve(equation, 2.0, **TIGHT).y[-1] == pytest.approx([expected] * 20, abs=1e-8)


def test_a_given_jacobian():
    def jac(t, y, p):
        return np.array([[-1.0, -1.0], [1.0, -1.0]])

    found = hd.solve(algebraic().replace(jac=jac), 2.0, **TIGHT)
    assert found.y[-1] == pytest.approx([0.594410641301969] * 2, abs=1e-8)


KERNELS = hd.Prony([1.0], [0.5]), hd.TemperedPowerLaw(0.5, 1.0)


@pytest.mark.parametrize(
    ("order", "derivative"), [(0.8, 0), (0.8, 1), (1.8, 0), (1.8, 1), (1.8, 2)]
)
@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
def test_kernels_that_are_read_with_derivatives(kernel, order, derivative):
    """The same term on the left-hand side, with the other sign, gives the same solution."""
    y0, operator = [1.0, 0.3][: math.ceil(order)], hd.Memory(kernel, derivative)
    reads = hd.Equation(hd.Caputo(order), lambda t, y, m: -y - 0.4 * m[0], y0, memory=operator)
    holds = hd.Equation(hd.Caputo(order) + 0.4 * operator, lambda t, y: -y, y0)
    expected = hd.solve(holds, 5.0, **TIGHT).y[-1]
    found = hd.solve(reads, 5.0, rtol=1e-6)
    assert found.y[-1] == pytest.approx(expected, abs=1e-6)
    assert found.stats["n_steps"] < 300


@pytest.mark.parametrize("how", [TIGHT, {"n_steps": 2000, "scheme": hd.L1()}], ids=str)
def test_kernels_behind_matrices(how):
    """Sum and difference of two components are equations of their own."""
    mass, coupling = np.array([[1.0, 0.3], [0.3, 1.0]]), np.array([[0.5, -0.2], [-0.2, 0.5]])
    kernel = hd.Memory(hd.Prony([1.0], [1.0]), 0)
    pair = hd.Equation(mass * hd.Caputo(0.8) + coupling * kernel, lambda t, y: -y, [1.0, 0.2])
    found = hd.solve(pair, 3.0, **how).y[-1]
    for sign in (1, -1):
        terms = (1 + sign * 0.3) * hd.Caputo(0.8) + (0.5 - sign * 0.2) * kernel
        alone = hd.Equation(terms, lambda t, y: -y, 1.0 + sign * 0.2)
        expected = hd.solve(alone, 3.0, **TIGHT).y[-1, 0]
        allowed = 1e-8 if "rtol" in how else 2e-3
        assert found[0] + sign * found[1] == pytest.approx(expected, abs=allowed)


def test_coefficients_next_to_0_are_named_where_the_start_contradicts_them():
    tiny = hd.Equation([1.0, 1e-20] * hd.Caputo(0.5), relaxing, [1.0, 1.0], params=[1.0])
    assert hd.solve(tiny, 2.0, **TIGHT).success
    with pytest.warns(hd.SolveWarning, match=r"component 1 are at most 1e-20, .* write 0"):
        hd.solve(tiny.replace(y0=[1.0, 0.5]), 2.0, **TIGHT)


@settings(max_examples=10)
@given(st.integers(0, 5), st.floats(0.02, 1.0), st.floats(0.3, 3.0))
def test_delays_with_gamma_densities_by_laplace(stages, rest, rate):
    shape = stages + rest
    found = hd.solve(late(shape, rate), 3.0, rtol=1e-9).y[-1, 0]
    with mpmath.workdps(25):
        exact = mpmath.invertlaplace(
            lambda s: 1 / (s + (1 + s / rate) ** -shape), 3, method="talbot"
        )
    assert found == pytest.approx(float(exact), abs=1e-8)


def cubic(t, y, memory):
    return memory[0] ** 3 + memory[0] + y - np.sin(t)


@pytest.mark.parametrize("start", [0.0, 1.0])
def test_rows_that_are_implicit_in_a_derivative(start):
    """With a break, too, and beginning with a derivative other than 0; by Cardano's formula."""

    def slope(t, y):
        half = (np.sin(t) - y) / 2
        root = np.sqrt(half * half + 1 / 27)
        return np.cbrt(half + root) + np.cbrt(half - root)

    implicit = hd.Equation(0 * hd.Caputo(0.6), cubic, start, memory=hd.Caputo(0.6))
    expected = hd.solve(hd.Equation(hd.Caputo(0.6), slope, start), 5.0, **TIGHT).y[-1]
    for breaks in ([], [1.0]):
        found = hd.solve(implicit, 5.0, breaks=breaks, **TIGHT)
        assert found.y[-1] == pytest.approx(expected, abs=1e-8)
    lifts = {"changes": {1.0: lambda t, y: y + 0.5}}
    found, expected = (
        hd.solve(e, 5.0, **TIGHT, **lifts)
        for e in (implicit, hd.Equation(hd.Caputo(0.6), slope, start))
    )
    assert found.y[-1] == pytest.approx(expected.y[-1], abs=1e-8)


@pytest.mark.parametrize("order", [0.6, 1.0, 1.5, 2.0])
def test_a_derivative_that_a_row_determines_begins_anywhere(order):
    y0 = [1.0, 0.3][: math.ceil(order)]
    row = hd.Equation(0 * hd.Caputo(order), lambda t, y, m: m[0] + y, y0, memory=hd.Caputo(order))
    expected = hd.solve(hd.Equation(hd.Caputo(order), lambda t, y: -y, y0), 2.0, **TIGHT)
    assert hd.solve(row, 2.0, rtol=1e-6).y[-1] == pytest.approx(expected.y[-1], abs=1e-6)


def waves(t, y):
    return np.array([0.0 * y[0], np.cos(3 * t) - y[1]])


@pytest.mark.parametrize("coefficients", [FIRST, 0.0 * FIRST], ids=["one at rest", "none"])
def test_rows_that_follow_the_time_alone(coefficients):
    """A first step over which the other component rests must not be taken back."""
    rhs = waves if coefficients.any() else (lambda t, y: np.cos(3 * t) - y)
    found = hd.solve(hd.Equation(coefficients * hd.Caputo(0.5), rhs, [1.0, 1.0]), 20.0, rtol=1e-6)
    assert found.success
    times = np.linspace(0.0, 20.0, 300)
    assert found(times)[:, 1] == pytest.approx(np.cos(3 * times), abs=1e-6)


def test_a_row_that_begins_like_a_root_of_t():
    def rooted(t, y):
        return np.array([y[1] - y[0], np.sqrt(t) - y[1]])

    found = hd.solve(hd.Equation(FIRST * hd.Caputo(0.5), rooted, [0.0, 0.0]), 1.0, rtol=1e-6)
    alone = hd.Equation(hd.Caputo(0.5), lambda t, y: np.sqrt(t) - y, 0.0)
    assert found.y[-1, 0] == pytest.approx(hd.solve(alone, 1.0, **TIGHT).y[-1, 0], abs=1e-6)


def test_sensitivities_at_the_start_satisfy_the_rows():
    def squared(t, y, p):
        return np.array([p[1] * y[1] - y[0], p[0] * y[0] ** 2 - y[1]])

    eq = hd.Equation(FIRST * hd.Caputo(0.5), squared, [1.0, 1.0], params=[1.0, 0.3])
    found = hd.sensitivities(eq, 2.0, rtol=1e-8, t_eval=[0.0, 1e-12])
    assert found.by_params[0, 1] == pytest.approx([1.0, 0.0], abs=1e-8)
    assert found.by_y0[0, 1] == pytest.approx([2.0, 0.0], abs=1e-8)
    assert found.by_params[1] == pytest.approx(found.by_params[0], abs=1e-4)


def fold(t, y, p):
    return np.array([-1.0, y[1] ** 2 - y[0]])


def constant_power(t, y, p):
    """A supercapacitor with the resistance p[0] that delivers the power p[1]; y is E and I."""
    return np.array([-y[1], (y[0] - p[0] * y[1]) * y[1] - p[1]])


@pytest.mark.parametrize("order", [0.6, 0.8, 0.95, 1.0])
def test_rows_that_become_singular_end_the_run_in_these_words(order):
    """Two solutions of the row meet: at y[0] = 0 of the fold, at E = 2 R I of the capacitor.

    Tighter runs may end up to a seventh earlier, at a jump that they take for one of f.
    """
    one = np.array([1.0, 0.0]) * hd.Caputo(order)
    for start in (0.7, 1.0, 1.3):
        with pytest.warns(hd.SolveWarning, match="algebraic components becomes singular here"):
            sol = hd.solve(hd.Equation(one, fold, [start, start**0.5]), 5.0, rtol=1e-4)
        assert sol.status == "step_too_small"
        meet = (start * math.gamma(1 + order)) ** (1 / order)
        assert sol.t[-1] == pytest.approx(meet, rel=1e-6)
    start = [1.0, 1.0 - np.sqrt(1.0 - 4 * 0.5 * 0.04)]
    with pytest.warns(hd.SolveWarning, match="algebraic components becomes singular here"):
        sol = hd.solve(
            hd.Equation(one, constant_power, start, params=[0.5, 0.04]), 500.0, rtol=1e-6
        )
    assert sol.y[-1, 0] == pytest.approx(sol.y[-1, 1], rel=1e-5)  # 2 R = 1


def test_other_failures_beside_algebraic_rows_keep_their_words():
    def jumps(t, y):
        return np.array([-np.sign(y[0] - 0.5), y[1] - y[0]])

    one = np.array([1.0, 0.0]) * hd.Caputo(0.6)
    with pytest.warns(hd.SolveWarning, match="slide or chatter"):
        hd.solve(hd.Equation(one, jumps, [1.0, 1.0]), 5.0, rtol=1e-6)
