"""The user's frame: equations that begin at other times than 0, and complex ones."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from problems import assert_converges, mittag_leffler, run

import hereditary as hd

SCHEMES = (
    hd.ExplicitCaputo(), hd.GrunwaldLetnikov(), hd.L1(), hd.BDF(2), hd.Adams(),
    hd.Collocation(),
)  # fmt: skip
run = partial(run, n=100, rtol=1e-8)


def order(t):
    return 0.6 + 0.1 * np.tanh(t)


KERNEL = hd.Caputo(1.0) + hd.Memory(hd.Prony([1.0], [0.5]), 1)


@pytest.mark.parametrize(
    ("terms", "later"), [(hd.Caputo(order), hd.Caputo(lambda t: order(t + 3.0))), (KERNEL, KERNEL)]
)
def test_orders_that_vary_kernels_memory_and_breaks_begin_at_the_start(terms, later):
    def reads(t, y, memory):
        return -y * (1 + np.sign(t - 4.0)) - memory[0] * t

    there = hd.Equation(terms, reads, 1.0, memory=hd.Caputo(0.3), t_start=3.0)
    here = hd.Equation(later, lambda t, y, m: reads(t + 3.0, y, m), 1.0, memory=hd.Caputo(0.3))
    found, expected = (run(eq, hd.L1(), breaks=[eq.t_start + 1.0]).y for eq in (there, here))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_the_message_of_an_early_end_has_the_users_time():
    def fails(t, y):
        return y if t < 2.5 else [1.0][int(t)] * y

    eq = hd.Equation(hd.Caputo(0.7), fails, 1.0, t_start=2.0)
    with pytest.warns(hd.SolveWarning, match=r"t = 2.5"):
        sol = hd.solve(eq, 3.0, 100)
    assert sol.t[-1] == pytest.approx(2.5, abs=0.011)


# complex equations


@given(
    alpha=st.floats(0.5, 1.9),
    numbers=st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6),
    scheme=st.sampled_from(SCHEMES),
)
def test_a_complex_equation_is_its_real_pair(alpha, numbers, scheme):
    a, b, *parts = numbers
    z0 = np.array([complex(*parts[:2]), complex(*parts[2:])])

    def both(t, z, p):
        return (p[0] + 1j * p[1]) * z - z * np.abs(z) ** 2 + np.conj(z[::-1]) * np.sin(t)

    def pair(t, y, p):
        z = both(t, y[0::2] + 1j * y[1::2], p)
        out = np.empty(4)
        out[0::2], out[1::2] = z.real, z.imag
        return out

    y0 = z0.view(float)
    if alpha > 1:
        z0, y0 = np.array([z0, 1j * z0]), np.array([y0, (1j * z0).view(float)])
    ours = hd.Equation(hd.Caputo(alpha), both, z0, [a, b])
    theirs = hd.Equation(hd.Caputo(alpha), pair, y0, [a, b])
    found, expected = run(ours, scheme), run(theirs, scheme)
    assert found.status == expected.status
    assert found.y.dtype == complex
    np.testing.assert_allclose(found.y.view(float), expected.y, rtol=1e-9, atol=1e-9)
    if alpha > 1:
        np.testing.assert_allclose(found.ydot.view(float), expected.ydot, rtol=1e-8, atol=1e-8)
    t = np.linspace(0.5, 2.0, 5)
    np.testing.assert_allclose(found(t).view(float), expected(t), rtol=1e-9, atol=1e-9)
    assert found(1.0).shape == (2,)


@pytest.mark.parametrize("alpha", [0.4, 0.9, 1.3])
def test_a_complex_rate_gives_mittag_leffler(alpha):
    rate, t_end = -0.7 + 1.9j, 3.0
    y0 = 1.0 + 0.0j if alpha <= 1 else [1.0 + 0j, 0j]
    eq = hd.Equation(hd.Caputo(alpha), lambda t, z: rate * z, y0)
    sol = hd.solve(eq, t_end, rtol=1e-10)
    exact = mittag_leffler(alpha, rate * t_end**alpha)
    assert abs(sol.y[-1, 0] - exact) < 3e-10

    def end(n):
        return hd.solve(eq, t_end, n, scheme=hd.BDF(2)).y[-1]

    assert_converges(end, exact, (400, 800), 2, 1e-3)


RATE = 1j - 0.5


def in_place(t, z, dz, params):
    for j in range(z.size):
        dz[j] = RATE * z[j]


SHAPES = (
    lambda t, z: RATE * z,
    lambda t, z, p: RATE * z,
    in_place,
    partial(lambda t, z: RATE * z),
    lambda t, z: [RATE * z[0], RATE * z[1]],
)


@pytest.mark.filterwarnings("ignore::hereditary.PythonFunctionWarning")
def test_all_shapes_of_complex_functions_agree():
    z0 = [1.0 + 1j, -0.5j]
    sols = [run(hd.Equation(hd.Caputo(0.6), f, z0), hd.L1()) for f in SHAPES]
    for sol in sols[1:]:
        np.testing.assert_allclose(sol.y, sols[0].y, rtol=1e-13)
    one = hd.Equation(hd.Caputo(0.6), lambda t, z: (1j - 0.5) * z[0], 1.0 + 1j)
    np.testing.assert_allclose(run(one, hd.L1()).y[:, 0], sols[0].y[:, 0], rtol=1e-13)


def test_complex_events_memory_orders_and_coefficients():
    def reads(t, z, memory):
        return 1j * z - np.abs(z) ** 2 * memory[0]

    def parts(t, y, memory):
        z, m = y[0::2] + 1j * y[1::2], memory[0, 0::2] + 1j * memory[0, 1::2]
        f = 1j * z - np.abs(z) ** 2 * m
        return np.array([f[0].real, f[0].imag, f[1].real, f[1].imag])

    orders, factors, z0 = np.array([0.7, 0.9]), np.array([1.0, 2.0]), [1 + 0j, 0.5j]
    eq = hd.Equation(factors * hd.Caputo(orders), reads, z0, memory=hd.Caputo([0.3, 0.5]))
    two = np.repeat(factors, 2) * hd.Caputo(np.repeat(orders, 2))
    memory = hd.Caputo(np.repeat([0.3, 0.5], 2))
    real = hd.Equation(two, parts, [1.0, 0.0, 0.0, 0.5], memory=memory)

    def turns(t, z):
        assert z.dtype == complex
        return z[0].imag - 0.2

    for scheme in (hd.L1(), hd.Collocation()):
        sol = run(eq, scheme, events=turns)
        other = run(real, scheme, events=lambda t, y: y[1] - 0.2)
        np.testing.assert_allclose(sol.y.view(float), other.y, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(sol.t_events[0], other.t_events[0], rtol=1e-9)
        assert sol.y_events[0].dtype == complex
        assert sol.y_events[0][0, 0].imag == pytest.approx(0.2)


def test_exponents_of_a_complex_equation_are_those_of_the_pair():
    eq = hd.Equation(hd.Caputo(0.9), lambda t, z: (1 + 1j) * z - np.abs(z) ** 2 * z, 0.5 + 0j)

    def pair(t, y):
        rest = 1 - y[0] ** 2 - y[1] ** 2
        return np.array([rest * y[0] - y[1], y[0] + rest * y[1]])

    real = hd.Equation(hd.Caputo(0.9), pair, [0.5, 0.0])
    result, expected = (hd.lyapunov(e, 20.0, 2000, k=2) for e in (eq, real))
    np.testing.assert_allclose(result.exponents, expected.exponents, rtol=1e-6)
    assert result.y.dtype == complex


def test_schroedinger_by_its_eigenstates():
    """i D^alpha psi = H psi on a chain of sites."""
    n, alpha = 8, 0.8
    chain = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    psi = np.exp(-((np.arange(n) - 2.0) ** 2)) * np.exp(1j * np.arange(n))
    eq = hd.Equation(hd.Caputo(alpha), lambda t, y: -1j * (chain.astype(np.complex128) @ y), psi)
    energies, states = np.linalg.eigh(chain)
    factors = [mittag_leffler(alpha, -1j * energy * 2.0**alpha) for energy in energies]
    exact = states @ (factors * (states.T @ psi))
    assert np.abs(hd.solve(eq, 2.0, rtol=1e-9).y[-1] - exact).max() < 3e-9

    def end(k):
        return hd.solve(eq, 2.0, k, scheme=hd.Adams()).y[-1]

    assert_converges(end, exact, (200, 400), 1 + alpha, 2e-4)


@pytest.mark.parametrize("start", [0.0, 0.3, 7.0, -50.0, 1000.0])
@pytest.mark.parametrize("scheme", [hd.L1(), hd.BDF(2), hd.Collocation()], ids=repr)
def test_steps_see_jumps_from_their_own_side_wherever_time_begins(start, scheme):
    def jumps(t, y, p):
        return np.array([1.0 if t < p[0] else -300.0])

    for place in (0.1, 0.37, 0.5, 0.93):
        at = start + place
        eq = hd.Equation(hd.Caputo(1.0), jumps, 0.0, [at], t_start=start)
        sol = run(eq, scheme, 1.0, breaks=[at])
        exact = (at - start) - 300.0 * (start + 1.0 - at)
        # BDF's three points lie on both sides of the jump: half a step of it is lost, on one side
        lost = 0.5 * 0.01 * 301.0 if scheme == hd.BDF(2) else 0.0
        bound = 1e-3 if lost else 1e-9 * max(1.0, abs(start))
        assert sol.y[-1, 0] - exact == pytest.approx(lost, abs=bound)
        if isinstance(scheme, hd.Collocation):
            assert sol.stats["n_rejected"] == 0


def test_rows_events_and_sections_at_negative_times():
    eq = hd.Equation(hd.Caputo(2.0), lambda t, x: -x, [0.0, 1.0], t_start=-20.0)
    sol = hd.solve(eq, -1.0, rtol=1e-8, t_eval=[-20.0, -7.0, -1.0])
    assert sol.t.tolist() == [-20.0, -7.0, -1.0]
    dense = hd.solve(eq, -1.0, rtol=1e-8)
    times, values = hd.maxima(dense)
    np.testing.assert_allclose(times, -20 + np.pi / 2 + 2 * np.pi * np.arange(3), atol=1e-5)
    np.testing.assert_allclose(values, 1.0, atol=1e-6)
    np.testing.assert_array_equal(hd.stroboscopic(dense, 2.0).t, np.arange(-20.0, -1.0, 2.0))


def test_the_jacobian_takes_the_users_time():
    eq = hd.Equation(hd.Caputo(0.9), lambda t, y: -t * y, 1.0, t_start=2.0)
    assert eq.jacobian(5.0, [1.0])[0, 0] == pytest.approx(-5.0)
    given = eq.replace(jac=lambda t, y: np.array([[-t]]))
    assert given.jacobian(5.0, [1.0])[0, 0] == -5.0


@pytest.mark.parametrize("start", [0.0, 2.0])
def test_events_of_one_name_are_told_apart_when_a_run_goes_on(start):
    eq = hd.Equation(hd.Caputo(2.0), lambda t, y: -y, [1.0 + 0j, 0j], t_start=start)
    levels = [lambda t, z, level=level: z[0].real - level for level in (0.5, -0.5)]
    levels[0].terminal = True
    half = hd.solve(eq, start + 8.0, rtol=1e-9, events=levels)
    assert half.status is hd.Status.EVENT
    assert len(half.state.event_signs) == 2
    rest = hd.solve(eq, start + 4.0, resume=half.state, events=[lambda t, z: 1.0, levels[1]])
    np.testing.assert_allclose(half.t_events[0], [start + np.pi / 3], atol=1e-7)
    np.testing.assert_allclose(rest.t_events[1], start + 2 * np.pi / 3, atol=1e-7)
