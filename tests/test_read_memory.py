"""Memory terms that a right-hand side reads: the same equation, however it is written."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import assert_converges

import hereditary as hd

ON_BOTH_SIDES = [hd.L1(), hd.L2(), hd.L12(), hd.BDF(1), hd.BDF(2), hd.BDF(4)]
HISTORIES = [hd.Direct(), hd.FFT(), hd.SumOfExponentials(1e-12)]


def force(t, x):
    return np.cos(t) - x - 0.2 * x**3


def with_friction(t, x, memory, params):
    return np.cos(t) - x - 0.2 * x**3 - params[0] * memory[0]


def pair(leading, lower, c, y0):
    """An equation with a term c times `lower` on the left, and with the same one read."""
    left = hd.Equation([leading, c * lower], force, y0)
    read = hd.Equation(leading, with_friction, y0, params=[c], memory=lower)
    return left, read


def airy(t, x, memory):
    """Van der Pol-Airy: friction (x**2 - 1) D^gamma x, stiffness t."""
    return (1.0 - x[0] ** 2) * memory[0, 0] - t * x[0]


def van_der_pol(beta=1.8, gamma=0.6):
    return hd.Equation(hd.Caputo(beta), airy, [0.5, 0.1], memory=hd.Caputo(gamma))


@settings(deadline=None, max_examples=40)
@given(
    scheme=st.sampled_from(ON_BOTH_SIDES),
    history=st.sampled_from(HISTORIES),
    alpha=st.floats(0.1, 1.0),
    share=st.floats(0.05, 0.95),
    above=st.booleans(),
    c=st.floats(-0.5, 2.0),
    speed=st.floats(-1.0, 1.0),
)
def test_moving_a_term_into_memory_changes_rounding_alone(
    scheme, history, alpha, share, above, c, speed
):
    above = above and scheme.orders[1] > 1 + alpha
    leading = 1 + alpha if above else alpha
    y0 = [0.5, speed] if above else 0.5
    left, read = pair(hd.Caputo(leading), hd.Caputo(share * leading), c, y0)
    a, b = (hd.solve(e, 1.0, 60, scheme=scheme, history=history) for e in (left, read))
    np.testing.assert_allclose(b.y, a.y, rtol=0, atol=1e-11 * np.abs(a.y).max())


MESH, VARYING = {"mesh": hd.graded(60, 2.0)}, hd.Caputo(lambda t: 1.7 - 0.1 * t)
TEMPERED = hd.TemperedPowerLaw(0.6, 1.0)


@pytest.mark.parametrize("history", HISTORIES[::2], ids=repr)
@pytest.mark.parametrize(
    ("leading", "lower", "steps"),
    [
        (hd.Caputo(0.8), hd.Caputo(0.4), MESH),
        (hd.Caputo(1.6), hd.Caputo(0.4), MESH),
        (VARYING, hd.Caputo(lambda t: 0.4 + 0.2 * t), {"n_steps": 80}),
        (hd.Caputo(1.6), hd.Memory(TEMPERED, 0), {"n_steps": 80}),
        (hd.Caputo(1.6), hd.Memory(TEMPERED, 1), {"n_steps": 80}),
    ],
)
def test_on_meshes_with_orders_that_vary_and_with_kernels(leading, lower, steps, history):
    y0 = 0.5 if leading == hd.Caputo(0.8) else [0.5, 0.3]
    how = {"scheme": hd.L1(), "history": history} | steps
    a, b = (hd.solve(e, 1.0, **how).y for e in pair(leading, lower, 0.7, y0))
    np.testing.assert_allclose(b, a, rtol=0, atol=1e-13)


@pytest.mark.parametrize("history", [hd.Direct(), hd.SumOfExponentials(1e-12)])
@pytest.mark.parametrize("scheme", [hd.ExplicitCaputo(), hd.L1()])
@pytest.mark.parametrize("beta", [0.9, 1.8])
def test_a_function_that_is_constant_is_the_constant_order(scheme, history, beta):
    y0 = [0.5, 0.1] if beta > 1 else 0.5
    runs = []
    for lower in (hd.Caputo(0.6), hd.Caputo(lambda t: 0.6)):
        equation = hd.Equation(hd.Caputo(beta), airy, y0, memory=lower)
        runs.append(hd.solve(equation, 1.5, 150, scheme=scheme, history=history).y)
    np.testing.assert_allclose(runs[1], runs[0], rtol=0, atol=1e-10 * np.abs(runs[0]).max())


def test_explicit_scheme_is_the_sum_written_out():
    beta, gamma, h, n_steps = 1.8, 0.6, 0.01, 300
    a = np.diff(np.arange(n_steps + 1.0) ** (2 - beta)) * h**-beta / math.gamma(3 - beta)
    b = np.diff(np.arange(n_steps + 1.0) ** (1 - gamma)) * h**-gamma / math.gamma(2 - gamma)
    x = np.zeros(n_steps + 1)
    x[:2] = 0.5, 0.5 + h * 0.1
    for n in range(1, n_steps):
        memory = b[:n] @ np.diff(x[: n + 1])[::-1]
        f = (1 - x[n] ** 2) * memory - n * h * x[n]
        older = a[1:n] @ np.diff(x[: n + 1], 2)[::-1]
        x[n + 1] = 2 * x[n] - x[n - 1] + (f - older) / a[0]
    sol = hd.solve(van_der_pol(), n_steps * h, n_steps, history=hd.Direct())
    np.testing.assert_allclose(sol.y[:, 0], x, rtol=0, atol=1e-12)


@pytest.mark.parametrize("gamma", [0.25, 0.6, 1.0])
def test_collocation_is_the_equation_with_more_components(gamma):
    """D^(1-gamma) w = v for w = D^gamma x and v = x'."""

    def extended(t, z):
        w = z[2] if gamma < 1 else z[1]
        return np.array([z[1], (1 - z[0] ** 2) * w - t * z[0], z[1]])

    orders = [1.0, 0.8, 1 - gamma if gamma < 1 else 1.0]
    other = hd.Equation(hd.Caputo(orders), extended, [0.5, 0.1, 0.0])
    t = np.linspace(0.0, 10.0, 41)
    expected = hd.solve(other, 10.0, rtol=1e-12, t_eval=t).y
    sol = hd.solve(van_der_pol(gamma=gamma), 10.0, rtol=1e-11, t_eval=t)
    np.testing.assert_allclose(sol.y[:, 0], expected[:, 0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(sol.ydot[:, 0], expected[:, 1], rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("leading", "lower", "y0"),
    [
        (0.6, [0.2, 0.4], [0.5, 1.0]),
        ([0.9, 1.0], 0.5, [0.5, 1.0]),
        (1.7, 1.3, [[0.5, 1.0], [0.3, -0.2]]),
        (2.0, 1.0, [[0.5, 1.0], [0.3, -0.2]]),
        ([1.5, 0.7], 0.4, [[0.5, 1.0], [0.3, 0.0]]),
    ],
)
def test_collocation_agrees_with_the_left_side(leading, lower, y0):
    """Several components; y, y' and the dense output."""
    left, read = pair(hd.Caputo(leading), hd.Caputo(lower), 0.7, y0)
    between = np.linspace(0.1, 3.0, 17)
    a, b = (hd.solve(e, 3.0, rtol=1e-10) for e in (left, read))
    np.testing.assert_allclose(b(between), a(between), rtol=0, atol=2e-10)
    second = np.broadcast_to(leading, 2) > 1
    np.testing.assert_allclose(b(between, 1)[:, second], a(between, 1)[:, second], atol=2e-9)


@pytest.mark.parametrize(
    ("scheme", "beta", "gamma", "order", "bound"),
    [
        (hd.ExplicitCaputo(), 0.9, 0.4, 1.0, 3e-5),
        (hd.GrunwaldLetnikov(), 0.9, 0.4, 1.0, 3e-5),
        (hd.L1(), 0.9, 0.4, 1.0, 2e-5),
        (hd.L2(), 0.9, 0.4, 1.0, 2e-6),
        (hd.L12(), 0.9, 0.4, 1.0, 2e-6),
        (hd.BDF(2), 0.9, 0.4, 2.0, 1e-9),
        (hd.BDF(3), 0.9, 0.4, 2.4, 1e-11),
        (hd.Adams(), 0.9, 0.4, 1.6, 4e-8),
        (hd.ProductTrapezoid(), 0.9, 0.4, 1.6, 4e-8),
        (hd.L1(), 1.6, 0.7, 1.4, 1e-6),
        (hd.BDF(2), 1.6, 0.7, 2.0, 1e-8),
        (hd.Adams(), 1.6, 0.7, 1.3, 5e-8),
        (hd.GrunwaldLetnikov(), 1.6, 0.7, 1.0, 1e-4),
    ],
)
def test_order_of_convergence(scheme, beta, gamma, order, bound):
    """For a force that goes on like t**(alpha - gamma) at 0; docs/memory_terms.md."""

    def f(t, x, memory):
        return np.cos(t) - x - (0.5 + x**2) * memory[0]

    y0 = [0.5, 0.3] if beta > 1 else 0.5
    equation = hd.Equation(hd.Caputo(beta), f, y0, memory=hd.Caputo(gamma))
    how = {"scheme": scheme, "history": hd.SumOfExponentials(1e-13)}
    assert_converges(
        lambda n: hd.solve(equation, 1.0, n, **how).y[-1],
        hd.solve(equation, 1.0, rtol=1e-12).y[-1],
        (400, 6400),
        order,
        bound,
    )


@pytest.mark.parametrize("scheme", [hd.BDF(2), hd.BDF(3), hd.Adams(), hd.GrunwaldLetnikov()])
@pytest.mark.parametrize("order", [0.7, 1.0])
def test_a_coefficient_of_memory_is_one_in_front_of_it(scheme, order):
    """At 0 too, where memory of order 1 is y'(0)."""
    runs = []
    for c in (1.0, 3.0):
        _, read = pair(hd.Caputo(1.5), c * hd.Caputo(order), 0.6 / c, [1.0, 2.0])
        runs.append(hd.solve(read, 2.0, 200, scheme=scheme).y)
    np.testing.assert_allclose(runs[1], runs[0], rtol=0, atol=1e-12)


def test_exponents_agree_between_kinds_of_schemes():
    equation = van_der_pol()
    given_steps = hd.lyapunov(equation, 20.0, 4000, k=2, renorm=0.5, scheme=hd.BDF(2))
    pairs = hd.lyapunov(equation, 20.0, 4000, k=2, renorm=0.5, mode="pair", scheme=hd.BDF(2))
    how = {"renorm": 0.5, "scheme": hd.Collocation(), "rtol": 1e-8}
    adaptive = hd.lyapunov(equation, 20.0, 4000, k=2, **how)
    np.testing.assert_allclose(pairs.exponents, given_steps.exponents, rtol=0, atol=1e-5)
    np.testing.assert_allclose(adaptive.exponents, given_steps.exponents, rtol=0, atol=1e-3)


@pytest.mark.parametrize("scheme", [hd.ExplicitCaputo(), hd.GrunwaldLetnikov()])
@pytest.mark.parametrize("gamma", [0.3, 0.9])
def test_step_limit_counts_memory(scheme, gamma):
    """The step at which ``limit(beta) = K + c limit(gamma)``: friction is read a step late."""
    beta, c, stiffness = 1.6, 2.0, 4.0

    def f(t, x, memory):
        return -stiffness * x - c * memory[0]

    equation = hd.Equation(hd.Caputo(beta), f, [1.0, 0.0], memory=hd.Caputo(gamma))
    parts = [
        hd.Equation(hd.Caputo(a), lambda t, x: -x, y0).system
        for a, y0 in ((beta, [1.0, 0.0]), (gamma, 1.0))
    ]

    def limits(h):
        a, b = (scheme._limits(part, h)[0] for part in parts)
        return a - c * b - stiffness

    low, high = 1e-4, 10.0
    for _ in range(80):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if limits(middle) > 0 else (low, middle)
    below = hd.solve(equation, 600 * 0.97 * low, 600, scheme=scheme)
    with pytest.warns(hd.SolveWarning):
        above = hd.solve(equation, 600 * 1.03 * low, 600, scheme=scheme)
    assert np.abs(below.y[-50:]).max() < 1 < np.abs(above.y[-50:]).max()


def test_given_jacobians():
    equation = van_der_pol()
    with_jac = equation.replace(
        jac=lambda t, x, memory: np.array([[-2 * x[0] * memory[0, 0] - t]]),
        jac_memory=lambda t, x, memory: np.array([[1 - x[0] ** 2]]),
    )
    for how in ({"n_steps": 500, "scheme": hd.BDF(2)}, {"rtol": 1e-8}):
        a, b = hd.solve(equation, 5.0, **how), hd.solve(with_jac, 5.0, **how)
        np.testing.assert_allclose(b.y[-1], a.y[-1], rtol=0, atol=1e-9)
        assert b.stats["n_rhs"] < a.stats["n_rhs"]
    assert with_jac.replace(jac=None).jac_memory is None
    assert with_jac.replace(rhs=lambda t, x, memory: -x, jac=None).jac is None


@pytest.mark.parametrize("k", [1, 2])
def test_in_every_form(k):
    """In place, with params, several terms."""
    memory = [hd.Caputo(0.8), 0.5 * hd.Caputo(0.3)][:k]

    def in_place(t, y, memory, dy, p):
        for i in range(2):
            dy[i] = -y[i]
            for m in range(memory.shape[0]):
                dy[i] += p[0] * memory[m, i]

    y0 = [[1.0, 2.0], [0.0, 0.5]]
    runs = [
        hd.solve(hd.Equation(hd.Caputo(1.5), f, y0, params=-0.4, memory=memory), 2.0, 100)
        for f in (lambda t, y, memory, p: p[0] * memory.sum(axis=0) - y, in_place)
    ]
    left = [hd.Caputo(1.5), 0.4 * hd.Caputo(0.8), 0.2 * hd.Caputo(0.3)][: 1 + k]
    expected = hd.solve(hd.Equation(left, lambda t, y: -y, y0), 2.0, rtol=1e-8)
    # sums in another order
    np.testing.assert_allclose(runs[0].y, runs[1].y, rtol=0, atol=1e-14)
    np.testing.assert_allclose(runs[0].y[-1], expected.y[-1], atol=0.05)


def test_a_message_shows_the_components_of_the_user():
    """Not the memory that follows them in the system."""
    _, read = pair(hd.Caputo(0.9), hd.Caputo(0.4), 1.0, 1.0)
    state = hd.solve(read, 1.0, 20).state
    with pytest.raises(ValueError, match=r"same y0, here \[\[2\.0\]\], got \[\[1\.0\]\]"):
        hd.solve(read.replace(y0=2.0), 2.0, resume=state)
