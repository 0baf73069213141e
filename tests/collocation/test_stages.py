"""Collocation of many components: stage by stage, within its tolerance, as single equations are."""

import numpy as np
import pytest
import scipy.sparse as sp
from problems import laplacian, plane

import hereditary as hd
from hereditary.exact import mittag_leffler


def modes(d):
    """Two eigenvectors of the Laplacian, and their rates."""
    places, numbers = np.arange(1, d + 1) / (d + 1), np.array([1, 3])
    rates = 4 * (d + 1) ** 2 * np.sin(numbers * np.pi / (2 * d + 2)) ** 2
    return np.sin(np.pi * np.outer(numbers, places)), rates


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
@pytest.mark.parametrize(("d", "how"), [(50, "dense"), (50, "band"), (200, "band"), (1000, "band")])
def test_diffusion_keeps_its_tolerance(d, how, rtol):
    waves, rates = modes(d)
    a = laplacian(d) if how == "band" else laplacian(d).toarray()
    sol = hd.solve(hd.Equation(hd.Caputo(0.7), None, waves.sum(axis=0), linear=a), 1.0, rtol=rtol)
    assert sol.success
    times = np.array([1e-6, 1e-3, 0.1, 1.0])
    parts = np.array([[mittag_leffler(-rate * t**0.7, 0.7, 1.0) for rate in rates] for t in times])
    errors = np.abs(sol(times) - parts @ waves)
    assert errors.max() < 2 * rtol
    assert sol.stats["n_steps"] < 400


@pytest.mark.parametrize("d", [6, 30])
@pytest.mark.parametrize("terms", [hd.Caputo(0.7), hd.Caputo(0.9) + 0.5 * hd.Caputo(0.3)])
def test_a_linear_system_takes_the_steps_of_the_same_system_stated_as_a_function(d, terms):
    a, start = laplacian(d).toarray(), modes(d)[0].sum(axis=0) + np.arange(d) % 2
    alone = hd.solve(hd.Equation(terms, None, start, linear=a), 1.0, rtol=1e-8)
    known = {"jac": lambda t, u: a}
    stated = hd.solve(hd.Equation(terms, lambda t, u: a @ u, start, **known), 1.0, rtol=1e-8)
    assert np.abs(alone(stated.t) - stated.y).max() < 1e-9
    assert alone.stats["n_steps"] == pytest.approx(stated.stats["n_steps"], rel=0.1)
    assert alone.stats["n_rhs"] == pytest.approx(stated.stats["n_rhs"], rel=0.1)


@pytest.mark.parametrize(
    ("orders", "rtol"), [((0.7,), 1e-10), ((1.6,), 1e-6), ((0.9, 0.5), 1e-10)], ids=str
)
def test_a_smooth_start_takes_as_many_steps_on_any_mesh(orders, rtol):
    """The fastest rate grows ten thousand times, but y(0) has no part that changes so fast."""
    terms, steps = sum(map(hd.Caputo, orders[1:]), hd.Caputo(orders[0])), []
    for d in (20, 200, 2000):
        waves, rates = modes(d)
        one, start = (1.0, waves[0]) if orders[0] < 1 else ([1.0, 0.0], [waves[0], 0 * waves[0]])
        sol = hd.solve(hd.Equation(terms, None, start, linear=laplacian(d)), 0.5, rtol=rtol)
        alone = hd.Equation(terms, lambda t, y, p: -p * y, one, params=rates[0])
        part = hd.solve(alone, 0.5, rtol=1e-12)(sol.t)
        assert np.abs(sol.y - part.reshape(-1, 1) * waves[0]).max() < rtol
        steps.append(sol.stats["n_steps"] + sol.stats["n_rejected"])
    assert max(steps) <= 1.2 * steps[0]


def test_a_plane_keeps_its_tolerance():
    """Its pattern is too wide for a band and goes to SuperLU."""
    m = 40
    wave = modes(m)[0][0]
    rate = 2 * modes(m)[1][0]
    eq = hd.Equation(hd.Caputo(0.7), None, np.outer(wave, wave).ravel(), linear=plane(m))
    sol = hd.solve(eq, 0.5, rtol=1e-6, save_every=10)
    exact = mittag_leffler(-rate * 0.5**0.7, 0.7, 1.0) * np.outer(wave, wave).ravel()
    assert np.abs(sol.y[-1] - exact).max() < 1e-6


def spread(u):
    """Cubic oscillators by themselves."""
    out = np.empty(u.size)
    for i in range(u.size):
        out[i] = np.sin(u[i]) - u[i] ** 3
    return out


TERMS = {
    "one": hd.Caputo(0.6),
    "one, above 1": hd.Caputo(1.6),
    "two": hd.Caputo(0.9) + 0.5 * hd.Caputo(0.3),
    "two, above 1": hd.Caputo(1.8) + 0.3 * hd.Caputo(0.7),
    "classical": hd.Caputo(1.0),
    "classical oscillator": hd.Caputo(2.0) + 0.2 * hd.Caputo(1.0),
    "leading kernel": hd.Memory(hd.TemperedPowerLaw(0.5, 1.0), derivative=1),
    "kernel": hd.Caputo(1.0) + hd.Memory(hd.TemperedPowerLaw(0.5, 1.0), derivative=1),
    "varying": hd.Caputo(lambda t: 0.7 + 0.1 * np.sin(t)),
}


def test_factors_follow_an_order_that_varies():
    """The matrices of a step change with the order, also at one length."""
    terms = hd.Caputo(lambda t: 0.7 + 0.2 * np.sin(t))
    few, many = (
        hd.solve(hd.Equation(terms, lambda t, y: -y, np.ones(d)), 3.0, rtol=1e-8) for d in (9, 10)
    )
    assert many.y[-1][0] == pytest.approx(few.y[-1][0], rel=1e-10)
    assert many.stats["n_steps"] < 1.2 * few.stats["n_steps"]


@pytest.mark.parametrize("name", TERMS)
def test_components_by_themselves_are_single_equations(name):
    """Twelve components and one, of all kinds of terms; a tolerance each may err by."""
    d, rtol = 12, 1e-8
    above = name.endswith(("above 1", "oscillator"))
    y0 = np.linspace(0.2, 1.3, d)
    eq = hd.Equation(TERMS[name], lambda t, u: spread(u), [y0, 0 * y0] if above else y0)
    sol = hd.solve(eq, 3.0, rtol=rtol, t_eval=[0.0, 0.5, 3.0], max_steps=600)
    for k in (0, 5, 11):
        single = hd.Equation(
            TERMS[name], lambda t, u: np.sin(u) - u**3, [y0[k], 0.0] if above else y0[k]
        )
        expected = hd.solve(single, 3.0, rtol=rtol, t_eval=[0.0, 0.5, 3.0])
        assert np.abs(sol.y[:, k] - expected.y[:, 0]).max() < 2 * rtol


@pytest.mark.parametrize("how", ["dense", "band", "sparse"])
@pytest.mark.parametrize("pair", [(0.6, 0.8), (0.7, 1.6)])
def test_components_of_other_orders_are_single_equations(pair, how, monkeypatch):
    """As the others, with the stages of all components in one system."""
    d = 14
    if how == "sparse":
        monkeypatch.setattr("hereditary.equation.jacobian_structure._WIDEST", -1)
    orders = np.where(np.arange(d) % 2, *pair)
    y0 = np.linspace(0.2, 1.3, d)
    kwargs = {} if how == "dense" else {"bandwidth": (0, 0)}
    start = np.array([y0, 0 * y0]) if max(pair) > 1 else y0
    eq = hd.Equation(hd.Caputo(orders), lambda t, u: spread(u), start, **kwargs)
    sol = hd.solve(eq, 2.0, rtol=1e-8)
    for k in (2, 3):
        begin = [y0[k], 0.0] if orders[k] > 1 else y0[k]
        single = hd.Equation(hd.Caputo(orders[k]), lambda t, u: np.sin(u) - u**3, begin)
        assert abs(sol.y[-1, k] - hd.solve(single, 2.0, rtol=1e-8).y[-1, 0]) < 2e-8


@pytest.mark.parametrize("d", [40, 300])
def test_two_fields_of_different_orders_keep_their_tolerance(d):
    """Eigenvectors of the Laplacian in both fields reduce them to two equations, solved tightly."""
    orders, pull, rtol = (0.9, 0.6), 3.0, 1e-6
    waves, rates = modes(d)
    line, eye = 0.1 * laplacian(d), sp.eye_array(d)
    a = sp.kron(line, np.eye(2)) + sp.kron(eye, [[0.0, pull], [-pull, 0.0]])
    start = np.outer(waves[0], [1.0, 0.5]).ravel()
    eq = hd.Equation(hd.Caputo(np.tile(orders, d)), None, start, linear=a)
    few = np.array([[-0.1 * rates[0], pull], [-pull, -0.1 * rates[0]]])
    pair = hd.Equation(hd.Caputo(orders), lambda t, u: few @ u, [1.0, 0.5])
    expected = hd.solve(pair, 2.0, rtol=1e-11)
    sol = hd.solve(eq, 2.0, rtol=rtol)
    times = np.array([1e-4, 0.1, 1.0, 2.0])
    for t in times:
        assert np.abs(sol(t) - np.outer(waves[0], expected(t)).ravel()).max() < 2 * rtol
    assert sol.stats["n_steps"] < 100


def test_stiff_reactions_renew_their_jacobian():
    """Of a Jacobian that changes by orders the kept one would no longer contract."""

    def burning(t, u, du, p):
        for i in range(u.size):
            du[i] = -(1.0 + 1e4 * np.sin(t) ** 2) * (u[i] - np.cos(t + i))

    d, rtol = 12, 1e-7
    sol = hd.solve(
        hd.Equation(hd.Caputo(0.9), burning, np.zeros(d), bandwidth=(0, 0)), 4.0, rtol=rtol
    )
    single = hd.Equation(
        hd.Caputo(0.9), lambda t, u: -(1.0 + 1e4 * np.sin(t) ** 2) * (u - np.cos(t + 5)), 0.0
    )
    expected = hd.solve(single, 4.0, rtol=1e-10)
    assert sol.success
    assert (
        np.abs(sol(np.linspace(0, 4, 9))[:, 5] - expected(np.linspace(0, 4, 9))[:, 0]).max() < rtol
    )
