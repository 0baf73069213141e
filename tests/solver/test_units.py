"""Sizes of components, to which a tolerance is relative without `atol=`.

The size of a component is its largest |y| so far. While it grows from little it is at least a
millionth of what other components could make of it during the run. So the unit of each component
changes nothing, nor do components that stay at 0.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from random_problems import linear
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from solver.runs import completed

import hereditary as hd


class Problem(NamedTuple):
    """Terms, f(t, y), y(0) (and y'(0) in a row behind it), time, arguments, components.

    `rounding` are components that are rounding of others.
    """

    terms: object
    rhs: object
    y0: list
    t_end: float
    how: dict = {}
    rounding: tuple = ()


@lru_cache
def in_units(f, remembers):
    """Return f of y * s, the parameters s (d,)."""

    def rhs(t, z, s):
        return f(t, z / s) * s

    def reading(t, z, memory, s):
        return f(t, z / s, memory[0] / s) * s

    return reading if remembers else rhs


def van_der_pol(t, y):
    return np.array([y[1], 2 * (1 - y[0] ** 2) * y[1] - y[0]])


def kinetics(t, y):
    slow, back, fast = 0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] ** 2
    return np.array([-slow + back, slow - back - fast, fast])


def epidemic(t, y):
    return np.array([-y[0] * y[1], y[0] * y[1] - 0.3 * y[1], 0.3 * y[1]])


def cascade(t, y):
    return np.array([1 - y[0], y[0] - y[1], y[1] - y[2], y[2] - y[3]])


def laser(t, y):
    """Field, phase and carriers, in 1e10, 1 and 1e24 of SI units, time in ns."""
    field, phase, carriers = y
    net = 840.0 * (carriers - 1.4) - 1 / 1.927e-3
    return np.array([
        0.5 * net * field + 7.8 * np.cos(phase),
        1.5 * net - 7.8 / field * np.sin(phase),
        1.098 - carriers / 2.04 - 0.084 * (carriers - 1.4) * field**2,
    ])  # fmt: skip


def beside_growth(t, y):
    return np.array([0.1 * y[0], y[2], 8 * (1 - y[1] ** 2) * y[2] - 16 * y[1]])


def powers(t, y):
    """Each component from 0, by the square or the cube of the one before."""
    return np.array([1 - y[0], y[0] ** 2 - y[1], y[1] ** 3 - y[2]])


def cancelling(t, y):
    return np.array([-y[0], -y[1], 50 * (y[0] - y[1]) - y[2], y[2] - y[3]])


def turning(t, y):
    """y = -y: components that drive each other in a circle, one by one."""
    out = np.empty_like(y)
    out[:-1], out[-1] = y[1:], -y[0]
    return out


def remembering(t, y, m):
    return np.array([0.5 * y[1] - m[0], -2 * y[0] - m[1]])


def constrained(t, y):
    return np.array([y[2] - y[0], y[0] - 9 * y[1], y[0] + y[1] - y[2] - y[2] ** 3])


def ladder(t, y):
    """Voltages of three capacitors, and currents through nonlinear resistors before them."""
    volts, amperes = y[:3], y[3:]
    out = np.empty(6)
    for c in range(3):
        before = np.sin(3 * t) if c == 0 else volts[c - 1]
        out[c] = amperes[c] - (amperes[c + 1] if c < 2 else 0.0)
        out[3 + c] = before - volts[c] - amperes[c] - 0.1 * amperes[c] ** 3
    return out


def absorption(t, y):
    """A drug in the gut, in blood and in tissue; the first decays to nothing."""
    taken = 0.8 * y[1] / (1 + y[1])
    return np.array([-1.2 * y[0], 1.2 * y[0] - taken + 0.1 * y[2], taken - 0.15 * y[2]])


def with_flux(t, y):
    """A fast equilibrium whose net flux drives a relaxation oscillator."""
    flux, supply = 1e7 * (y[0] - y[1]), 0.2 + 0.1 * np.sin(0.3 * t)
    speed = 3 * (1 - y[3] ** 2) * y[4] - y[3] + 0.5 * y[2]
    return np.array([supply - flux, flux - 0.2 * y[1], flux - 0.2 * y[2], y[4], speed])


def diffusing(t, y):
    out = np.empty_like(y)
    for c in range(y.size):
        left = y[c - 1] if c > 0 else 0.0
        right = y[c + 1] if c < y.size - 1 else 0.0
        out[c] = 4 * (left - 2 * y[c] + right) + y[c] * (1 - y[c])
    return out


def network(t, y):
    """A chain of compartments in a ring, and a leak."""
    out = np.empty_like(y)
    for c in range(y.size):
        out[c] = y[c - 1] + 0.1 * y[c - 4] - (1.3 + 0.1 * c) * y[c]
    return out


N = np.arange(12)
RING = np.isin(N[:, None] - N, [0, 1, 4, -11, -8])
STARTS = {"one": [1.0] + 11 * [0.0], "middle": 5 * [0.0] + [1.0, 1.0] + 5 * [0.0]}
PROBLEMS = {
    "van der Pol": Problem(hd.Caputo(0.95), van_der_pol, [1.0, 0.0], 20.0),
    "driven from rest": Problem(
        hd.Caputo(0.6), lambda t, y: np.sin(3 * t) - 2 * y, [0.0], 20.0
    ),
    "oscillator": Problem(
        hd.Caputo(1.8) + 0.2 * hd.Caputo(0.8), lambda t, y: np.sin(t) - y - y**3,
        [[0.0], [0.0]], 20.0,
    ),
    "kinetics": Problem(hd.Caputo(0.9), kinetics, [1.0, 0.0, 0.0], 40.0),
    "epidemic": Problem(hd.Caputo(0.9), epidemic, [1 - 1e-9, 1e-9, 0.0], 60.0),
    "cascade from rest": Problem(hd.Caputo(0.8), cascade, [0.0, 0.0, 0.0, 0.0], 10.0),
    "laser": Problem(hd.Caputo(1.0), laser, [1.3, 0.0, 1.9], 1.0),
    "beside growth": Problem(hd.Caputo(1.0), beside_growth, [1.0, 1.0, 0.0], 5.0),
    "powers from rest": Problem(hd.Caputo(0.7), powers, [0.0, 0.0, 0.0], 5.0),
    "cancelling": Problem(hd.Caputo(0.5), cancelling, [1.0, 1.0, 0.0, 0.0], 5.0, rounding=(2, 3)),
    "turning": Problem(hd.Caputo(1.0), turning, [1.0] + 5 * [0.0], 6.0),
    "orders": Problem(hd.Caputo([0.5, 0.8, 1.0, 0.3]), cascade, [1.0, 0.0, 0.0, 0.0], 5.0),
    "terms": Problem(hd.Caputo(0.9) + hd.Caputo(0.4), epidemic, [0.9, 0.1, 0.0], 20.0),
    "memory": Problem(
        hd.Caputo(0.9), remembering, [1.0, 0.0], 10.0, {"memory": hd.Caputo(0.4)}
    ),
    "delay": Problem(hd.Caputo(0.9), remembering, [1.0, 0.0], 2.0, {"memory": hd.Delay(0.7)}),
    "kernel": Problem(
        hd.Caputo(0.9), remembering, [1.0, 0.0], 5.0,
        {"memory": hd.Memory(hd.TemperedPowerLaw(0.5, 1.0), 0)},
    ),
    "algebraic": Problem(
        np.array([1.0, 1.0, 0.0]) * hd.Caputo(0.8), constrained, [1, 0, 0.6823278038280193], 5.0
    ),
    "ladder": Problem(np.repeat([1.0, 0.0], 3) * hd.Caputo(0.9), ladder, 6 * [0.0], 5.0),
    "absorption": Problem(hd.Caputo(1.0), absorption, [5.0, 0.0, 0.0], 200.0),
    "flux": Problem(hd.Caputo(1.0), with_flux, [1.0, 1.0, 0.2, 1.5, 0.0], 10.0),
    "complex": Problem(
        hd.Caputo(0.9), lambda t, y: (2j - 0.1) * y + 0.05 * abs(y[0]) * y[::-1],
        [1.0 + 0j, 0.5j], 5.0,
    ),
    "band": Problem(hd.Caputo(0.8), diffusing, STARTS["middle"], 1.0, {"bandwidth": (1, 1)}),
    "dense": Problem(hd.Caputo(1.0), diffusing, STARTS["middle"], 1.0),
    "sparse": Problem(hd.Caputo(0.6), network, STARTS["one"], 5.0, {"jac_sparsity": RING}),
}  # fmt: skip
TOLERANCES = [1e-4, 1e-6, 1e-8]


def scaled(problem, scale):
    """Return the equation of y times `scale`, (d,)."""
    rhs = in_units(problem.rhs, "memory" in problem.how)
    return hd.Equation(problem.terms, rhs, problem.y0 * scale, params=scale, **problem.how)


def size_of(problem):
    return np.shape(problem.y0)[-1]


@pytest.fixture(scope="module")
def plain():
    """Solutions in units of 1, by name and tolerance."""
    return {
        (name, rtol): hd.solve(scaled(p, np.ones(size_of(p))), p.t_end, rtol=rtol)
        for name, p in PROBLEMS.items()
        for rtol in TOLERANCES
    }


@pytest.mark.parametrize("name", PROBLEMS)
@given(
    decades=st.lists(st.floats(-10, 10), min_size=12, max_size=12),
    power=st.integers(-80, 80),
    rtol=st.sampled_from(TOLERANCES),
)
def test_the_unit_of_each_component_changes_nothing(plain, name, decades, power, rtol):
    """Steps and errors are equal, but for rounding of the difference quotients of f.

    With 1e22 between two components at rest the first steps are shorter, and errors are equal.
    """
    problem, one = PROBLEMS[name], plain[name, rtol]
    scale = 10.0 ** (np.array(decades[: size_of(problem)]) + power)
    sol = completed(scaled(problem, scale), problem.t_end, rtol=rtol)
    t, real = np.linspace(0, problem.t_end, 101), np.arange(scale.size)
    real = real[~np.isin(real, problem.rounding)]
    apart = np.abs(sol(t) / scale - one(t))[:, real].max(axis=0)
    assert np.all(apart < rtol * np.abs(one(t))[:, real].max(axis=0))
    if not problem.rounding:
        steps = one.stats["n_steps"]
        assert abs(sol.stats["n_steps"] - steps) <= 1 + 0.1 * steps


ON_STEPS = ["van der Pol", "laser", "epidemic", "memory", "band", "turning", "absorption"]


@pytest.mark.parametrize("name", ON_STEPS)
@given(
    decades=st.lists(st.floats(-14, 14), min_size=12, max_size=12),
    scheme=st.sampled_from([hd.BDF(2), hd.L1(), hd.ExplicitCaputo()]),
)
def test_nor_does_it_on_given_steps(name, decades, scheme):
    problem = PROBLEMS[name]
    scale = 10.0 ** np.array(decades[: size_of(problem)])
    t_end = 0.01 * problem.t_end if scheme == hd.ExplicitCaputo() else problem.t_end
    one, sol = (
        hd.solve(scaled(problem, s), t_end, 400, scheme=scheme, estimate=False)
        for s in (np.ones(scale.size), scale)
    )
    assert sol.status == one.status
    assert np.all(np.abs(sol.y / scale - one.y).max(axis=0) <= 1e-9 * np.abs(one.y).max(axis=0))


@given(
    power=st.floats(-14, 14),
    name=st.sampled_from(["kinetics", "laser", "powers from rest", "oscillator"]),
)
def test_the_unit_of_time_changes_nothing(plain, power, name):
    problem, one, unit = PROBLEMS[name], plain[name, 1e-6], 10.0**power
    f, terms = problem.rhs, problem.terms
    if name == "oscillator":
        terms = unit**1.8 * hd.Caputo(1.8) + 0.2 * unit**0.8 * hd.Caputo(0.8)
    else:
        terms = unit**terms.order * terms
    equation = hd.Equation(terms, lambda t, y, p: f(t / p[0], y), problem.y0, params=[unit])
    sol = hd.solve(equation, unit * problem.t_end, rtol=1e-6)
    steps, t = one.stats["n_steps"], np.linspace(0, problem.t_end, 101)
    assert abs(sol.stats["n_steps"] - steps) <= 1 + 0.1 * steps
    assert np.all(np.abs(sol(unit * t) - one(t)).max(axis=0) < 1e-6 * np.abs(one(t)).max(axis=0))


@pytest.mark.parametrize("how", [{}, {"bandwidth": (0, 0)}])
@pytest.mark.parametrize("d", [1, 12])
@pytest.mark.parametrize("order", [0.03, 0.1, 0.5, 1.5])
def test_nor_does_a_number_by_which_the_equation_is_multiplied(order, d, how):
    y0, found = np.outer([1.0, 0.0][: int(order) + 1], np.ones(d)), []
    for factor in (1.0, 1e6, 1e-6):
        terms = factor * hd.Caputo(order)
        equation = hd.Equation(terms, lambda t, y, p: -100 * p[0] * y, y0, params=[factor], **how)
        found.append(completed(equation, 2.0, rtol=1e-8))
    for sol in found[1:]:
        np.testing.assert_allclose(sol.y[-1], found[0].y[-1], rtol=0, atol=1e-8)
        steps = found[0].stats["n_steps"]
        assert abs(sol.stats["n_steps"] - steps) <= 1 + 0.1 * steps


@given(decades=st.lists(st.floats(-14, 14), min_size=3, max_size=3))
def test_sensitivities_and_exponents_have_no_units(decades):
    scale, found = 10.0 ** np.array(decades), []
    for s in (np.ones(3), scale):
        tangents = hd.sensitivities(scaled(LORENZ, s), 2.0, rtol=1e-6)
        found.append(tangents.by_y0[-1] * s / s[:, None])
    np.testing.assert_allclose(found[1], found[0], rtol=1e-4, atol=1e-4 * np.abs(found[0]).max())
    sizes = decades + np.log10([1.0, 1.0, 20.0])
    assume(np.ptp(sizes) > 6.01)  # below, lengths are those in the units of y
    others = [scale, *(10.0 ** np.array(other) for other in ((-9, 0, 9), (3, -9, 0)))]
    rates = [scaled_exponents(s) for s in others]
    np.testing.assert_allclose(rates, [rates[1]] * 3, rtol=0.05, atol=0.05)


def scaled_exponents(s):
    return hd.lyapunov(scaled(LORENZ, s), 4.0, k=3, rtol=1e-6, verify=False).exponents


def chaotic(t, y):
    return np.array([10 * (y[1] - y[0]), y[0] * (28 - y[2]) - y[1], y[0] * y[1] - 8 / 3 * y[2]])


def three(t, y):
    return np.array([-y[0] + y[2], -y[1] - y[2], np.sin(3 * t) - y[2] - y[0]])


LORENZ = Problem(hd.Caputo(0.99), chaotic, [1.0, 1.0, 20.0], 4.0)


@given(
    decades=st.lists(st.floats(-14, 14), min_size=3, max_size=3),
    rows=st.sampled_from(
        [((2, 0.5, 0), (0.3, 1, 0.1), (0, 0.2, 3)), ((1, 0, 0), (1, 1, 0), 3 * (0,))]
    ),
)
def test_nor_does_it_with_a_matrix_before_the_derivatives(decades, rows):
    """With a matrix of full rank, and with a row of zeros."""
    found = []
    for s in (np.ones(3), 10.0 ** np.array(decades)):
        terms = np.array(rows) * s[:, None] / s * hd.Caputo(0.9)
        found.append(hd.solve(scaled(Problem(terms, three, [1.0, 0.0, -1.0], 8.0), s), 8.0))
    one, sol = found
    t = np.linspace(0, 8, 101)
    apart = np.abs(sol(t) / s - one(t)).max(axis=0)
    assert np.all(apart < 1e-6 * np.abs(one(t)).max(axis=0))
    assert abs(sol.stats["n_steps"] - one.stats["n_steps"]) <= 1 + 0.1 * one.stats["n_steps"]


@pytest.mark.parametrize("rtol", TOLERANCES)
def test_what_could_be_made_of_a_component_does_not_hide_its_error(rtol):
    """The gain of the flux is 1e7, but it leaves the oscillator as small as it is."""
    problem, d = PROBLEMS["flux"], 5
    equation = scaled(problem, np.ones(d))
    exact = hd.solve(equation, problem.t_end, rtol=1e-10, atol=1e-13)
    sol, t = hd.solve(equation, problem.t_end, rtol=rtol), np.linspace(0, problem.t_end, 401)
    apart = np.abs(sol(t) - exact(t)).max(axis=0)
    assert np.all(apart < rtol * np.abs(exact(t)).max(axis=0))


def reactions(t, y, p):
    made, back, used = p[0] * y[0], p[2] * y[1] * y[2], p[1] * y[1] * y[1]
    return np.array([-made + back, made - back - used, used])


@given(
    params=st.tuples(st.floats(-4, 0), st.floats(2, 8), st.floats(2, 7)).map(
        lambda decades: tuple(10.0**power for power in decades)
    ),
    t_end=st.floats(0, 3).map(lambda power: 10.0**power),
)
@example(
    params=(0.0014812626706539388, 3561.6666724720326, 4472.78226305147), t_end=544.3272672166207
)
def test_a_diverged_iteration_is_no_solution(params, t_end):
    """From (1, 0, 0) the last row has no gain, and long first steps lead Newton's method away."""

    def slopes(t, y, p):
        back, used = p[2] * y[1:], 2 * p[1] * y[1]
        return np.array([
            [-p[0], back[1], back[0]], [p[0], -back[1] - used, -back[0]], [0.0, used, 0.0]
        ])  # fmt: skip

    equation = hd.Equation(hd.Caputo(1.0), reactions, [1.0, 0.0, 0.0], params=params, jac=slopes)
    sol, t = hd.solve(equation, t_end, rtol=1e-6), np.linspace(0, t_end, 101)
    exact = solve_ivp(
        reactions, (0, t_end), [1.0, 0.0, 0.0], "Radau", t, args=(params,), rtol=1e-9, atol=1e-14
    ).y.T
    assert sol.success
    assert np.all(np.abs(sol(t) - exact).max(axis=0) < 1e-5 * np.abs(exact).max(axis=0))


@pytest.mark.estimates
@given(decades=st.lists(st.floats(-14, 14), min_size=3, max_size=3))
def test_check_and_estimates_speak_of_the_size_of_each_component(decades):
    scale, problem = 10.0 ** np.array(decades), PROBLEMS["epidemic"]
    for how in ({"rtol": 1e-4}, {"n_steps": 1000, "scheme": hd.BDF(2)}):
        one, sol = (hd.solve(scaled(problem, s), problem.t_end, **how) for s in (np.ones(3), scale))
        np.testing.assert_allclose(sol.check().largest, one.check().largest, rtol=1e-3)
        estimates = [each.stats["error_estimate"] for each in (sol, one)]
        assert estimates[0] == pytest.approx(estimates[1], rel=1e-3)


def test_check_names_what_is_rounding_of_others():
    problem = PROBLEMS["cancelling"]
    found = hd.solve(scaled(problem, np.array([1.0, 3.0, 1.0, 1.0])), 5.0).check()
    assert np.all(found.largest[2:] == 0)
    assert "left out as rounding of others: 2, 3" in repr(found)


class Core(NamedTuple):
    """A stable linear system ``D^order y = A y + b`` and its idle companions, in any order.

    `matrix`, `force` and `y0` are those of all components, `place` (k,) says where the core is.
    """

    order: float
    matrix: np.ndarray
    force: np.ndarray
    y0: np.ndarray
    place: np.ndarray

    def solved(self, kind, rtol):
        """Solve it to t = 3, its Jacobian stated as the kind says."""
        known, (rows, columns) = {}, np.nonzero(self.matrix)
        if kind == "banded":
            known = {"bandwidth": (int((rows - columns).max()), int((columns - rows).max()))}
        elif kind == "sparse":
            known = {"jac_sparsity": self.matrix != 0}
        y0 = self.y0 if self.order <= 1 else [self.y0, 0 * self.y0]
        params = [*self.matrix.ravel(), *self.force]
        equation = hd.Equation(hd.Caputo(self.order), linear, y0, params=params, **known)
        return hd.solve(equation, 3.0, rtol=rtol)

    def alone(self, many):
        """Return the core as many times as there are components for the solver of many."""
        k = self.place.size
        times = 1 + 9 // k if many else 1
        own = self.matrix[np.ix_(self.place, self.place)]
        matrix = np.kron(np.eye(times), own)
        force, y0 = (np.tile(values[self.place], times) for values in (self.force, self.y0))
        return Core(self.order, matrix, force, y0, np.arange(k))


def with_idle(rng, k, order):
    """Draw a core of k components, and join what it does not move.

    These are a copy, the difference of both, what that drives, a sum that is conserved, and two
    components at 0, of which one reads the difference alone.
    """
    basis = rng.normal(size=(k, k))
    own = -(basis @ basis.T) / k * 10 ** rng.uniform(0, 1) - 0.1 * np.eye(k)
    n = 2 * k + 5
    matrix, force, y0 = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    for first in (0, k):
        matrix[first : first + k, first : first + k] = own
    force[: 2 * k], y0[: 2 * k] = np.tile(rng.normal(size=(2, k)), 2)
    difference, driven, total, at_rest, reading = range(2 * k, n)
    matrix[difference, [0, k, difference]] = 1.0, -1.0, -1.0
    matrix[driven, [difference, driven]] = 1.0, -3.0
    matrix[total, [1, k + 1]], y0[total] = (1.0, -1.0), 1.0
    matrix[at_rest, at_rest] = -2.0
    matrix[reading, difference] = 1.0
    return Core(order, matrix, force, y0, np.arange(k))


def in_other_order(core, order):
    """Return the system with its components in another order."""
    place = np.argsort(order)[core.place]
    inside = core.matrix[np.ix_(order, order)]
    return Core(core.order, inside, core.force[order], core.y0[order], place)


KINDS = ["few", "many", "banded", "sparse"]


@pytest.mark.parametrize("kind", KINDS)
@given(
    seed=st.integers(0, 2**32 - 1),
    order=st.sampled_from([0.3, 0.5, 0.9, 1.0, 1.5]),
    rtol=st.sampled_from([1e-3, *TOLERANCES]),
)
def test_idle_components_change_nothing(kind, seed, order, rtol):
    rng = np.random.default_rng(seed)
    k = 2 if kind == "few" else int(rng.integers(3, 7))
    core = with_idle(rng, k, order)
    n, pairs = core.y0.size, np.arange(2 * k).reshape(2, k).T.ravel()
    core = in_other_order(
        core, [*range(2 * k, n), *pairs] if kind == "banded" else rng.permutation(n)
    )
    alone, sol = core.alone(kind != "few").solved(kind, rtol), core.solved(kind, rtol)
    assert alone.success
    assert sol.success
    t, largest = np.linspace(0, 3, 31), np.abs(sol.y).max()
    expected = alone(t)[:, :k]
    apart = np.abs(sol(t)[:, core.place] - expected)
    assert np.all(apart <= 2 * rtol * np.abs(expected).max(axis=0))
    idle = core.force == 0
    moved = np.abs(sol.y[:, idle] - core.y0[idle]).max()
    assert moved <= (1e-7 * rtol + 1e-13) * largest
    # 34 steps, a 32nd of the run each, are made where nothing seems to move, and may follow a dozen
    # where the core moves
    assert sol.stats["n_steps"] <= 12 + max(1.4 * alone.stats["n_steps"], 36)


POWERS = [-100, -12, 60]


@pytest.mark.parametrize("power", POWERS)
def test_exponents_have_no_units(power):
    one, other = (scaled_exponents(np.full(3, s)) for s in (1.0, 10.0**power))
    np.testing.assert_allclose(other, one, rtol=1e-4)


@pytest.mark.parametrize("power", POWERS)
def test_ensembles_sensitivities_and_responses_change_as_y_does(power):
    def forced(t, z, p):
        y = z / p[0]
        return (p[1] * np.cos(p[2] * t) - y - 0.1 * y**3) * p[0]

    terms, found = hd.Caputo(1.9) + 0.3 * hd.Caputo(0.9), []
    for s in (1.0, 10.0**power):
        equation = hd.Equation(terms, forced, [0.0, 0.0], params=[s, 1.0, 1.0])
        tangents = hd.sensitivities(equation, 10.0, rtol=1e-6)
        members = [[s, 1.0, 1.0], [s, 2.0, 1.0]]
        runs = [
            hd.ensemble(equation, 10.0, params=members, **how).y[:, -1]
            for how in ({"n_steps": 500, "scheme": hd.BDF(2)}, {"rtol": 1e-6})
        ]
        response = hd.frequency_response(equation, [0.5, 1.0, 1.5], frequency=2)
        of_y = tangents.by_params[-1, :, 1:] / s, *(rows / s for rows in runs)
        found.append((*of_y, tangents.by_y0[-1], response.coefficients / s))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-5, atol=1e-5)


def test_other_parameters_have_units_of_their_own():
    equation = hd.Equation(hd.Caputo(0.8), lambda t, y, p: p[0] - y, 0.0, params=[1.0])
    anew = hd.Equation(hd.Caputo(0.8), equation.rhs, 0.0, params=[1000.0])
    replaced = equation.replace(params=[1000.0])
    assert equation.system.units() < anew.system.units() == replaced.system.units()


@pytest.mark.parametrize("order", [0.5, 1.0])
def test_a_spot_spreads_into_what_is_almost_empty(order):
    """Elimination must not go from tiny values far from the spot to larger ones near it."""
    x = np.arange(1, 25) / 25
    spot = np.exp(-200 * ((x[:, None] - 0.35) ** 2 + (x - 0.6) ** 2))
    equation = hd.scenes.subdiffusion(order, 24, dimensions=2, u0=spot)
    fine = completed(equation, 0.02, rtol=1e-8, t_eval=[0.01, 0.02])
    for scheme, bound in ((hd.BDF(1), 5e-3), (hd.BDF(2), 1e-4), (hd.L1(), 5e-3)):
        sol = hd.solve(equation, 0.02, 400, scheme=scheme, t_eval=fine.t, estimate=False)
        assert np.abs(sol.y - fine.y).max() < bound * fine.y.max()


@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_rounding_of_large_components_stays_out_of_tiny_ones(rtol):
    """Tanks of a chain begin with contents of many sizes; the first one stays empty."""
    contents = np.array([0.0, 9e-38, 1e-33, 1.5e-33, 1.2e-3, 4e-15, 0.0, 7e-14, 1.0, 0.3])
    leaves = np.array([2, 1, 1, 1, 2, 1, 2, 2, 2, 1])
    chain = 0.35 * (np.eye(10, k=-1) + np.eye(10, k=1) - np.diag(leaves))
    chain[[0, 1, 2, 4], [1, 2, 3, 5]] = 0.0  # no way back
    equation = hd.Equation(hd.Caputo(1.0), None, contents, linear=chain)
    sol = completed(equation, 1.0, rtol=rtol, max_steps=100)
    exact = expm(chain) @ contents
    assert (np.abs(sol.y[-1] - exact) <= rtol * exact).all()


@pytest.mark.parametrize("unit", [1.0, 1e-8])
@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
def test_a_component_that_stays_at_0_takes_no_steps_of_its_own(rtol, unit):
    """It is felt by a stiff one, whose elimination leaves it rounding."""
    matrix = np.array([[-1.0, 0.0], [49.5 / unit, -100.0]])
    eq = hd.Equation(hd.Caputo(0.25), lambda t, y: matrix @ y + np.array([0.0, 1.0]), [0.0, 0.0])
    alone = hd.Equation(hd.Caputo(0.25), lambda t, y: 1.0 - 100.0 * y, 0.0)
    sol, other = (hd.solve(one, 1.0, rtol=rtol) for one in (eq, alone))
    assert sol.success
    assert abs(sol.y[-1, 1] - other.y[-1, 0]) < rtol * other.y[-1, 0]
    assert sol.stats["n_steps"] < 2 * other.stats["n_steps"]


@pytest.mark.parametrize("force", [1e-36, 1e-12, 1e-6])
def test_a_force_next_to_0_leaves_sizes_and_steps_as_without(force):
    """f of another component hides by rounding how a step of a force's own size moves it."""

    def spiral(t, y, p):
        return np.array([1 - y[0] - 93 * y[1], p[0] + 106 * y[0] - 71 * y[1]])

    equation = hd.Equation(hd.Caputo(0.5), spiral, [0.0, 0.0], params=[0.0])
    still, pushed = (hd.solve(equation.replace(params=[p]), 1.0, rtol=1e-9) for p in (0.0, force))
    assert pushed.stats["n_steps"] == still.stats["n_steps"]


def test_a_step_that_no_other_component_feels_may_grow_beyond_all_numbers():
    scale = 10.0 ** np.array([99, 100, -100, 99])
    assert np.all(scaled(PROBLEMS["cascade from rest"], scale).system.units() < np.inf)


def test_rounding_that_is_multiplied_is_left():
    """Rounding of y0 - y1 is multiplied by 1e8 on its way to y3."""

    def differences(t, y):
        first = np.sin(3 * t) - y[0], np.sin(3 * t) - y[1] + 1e-16 * y[0]
        return np.array([*first, 1e4 * (y[0] - y[1]) - y[2], 1e4 * y[2] - y[3]])

    sol = completed(hd.Equation(hd.Caputo(0.5), differences, [0.3, 0.3, 0.0, 0.0]), 5.0)
    assert sol.stats["n_steps"] < 50
    assert np.abs(sol.y[:, 3]).max() < 1e-5


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
def test_atol_keeps_a_component_that_falls_to_1e_14_and_grows_again(rtol):
    speed = np.pi / 20

    def depth(t):
        return 16 * (1 - np.cos(speed * t))

    def slope(t, y):
        return -16 * speed * np.sin(speed * t) * y

    equation = hd.Equation(hd.Caputo(1), slope, 1.0)
    t = np.linspace(0.0, 40.0, 80)
    found = hd.solve(equation, 40.0, rtol=rtol, atol=1e-14 * rtol)(t)[:, 0]
    rounding = 1e-15
    assert (np.abs(found - np.exp(-depth(t))) < 2 * rtol * np.exp(-depth(t)) + rounding).all()


@pytest.mark.parametrize(
    ("terms", "rows"), [(hd.Caputo(0.9), 1), (hd.Caputo(2.5) + hd.Caputo(0.5), 3)]
)
def test_one_tolerance_for_each_component(terms, rows):
    """atol of a fast and small component keeps its error; that of the other alone does not."""

    def fast(t, y):
        return np.array([np.sin(t) - y[0], 1e-9 * np.sin(30 * t) - y[1]])

    equation = hd.Equation(terms, fast, np.zeros((rows, 2)))
    exact = hd.solve(equation, 10.0, rtol=1e-11, atol=1e-22)
    t = np.linspace(0, 10, 101)
    apart = {
        atol: np.abs(hd.solve(equation, 10.0, rtol=1e-6, atol=list(atol))(t) - exact(t)).max(axis=0)
        for atol in ((1e-6, 1e-15), (1e-6, 1e-6))
    }
    assert np.all(apart[1e-6, 1e-15] < [2e-6, 2e-15])
    assert apart[1e-6, 1e-6][1] > 1e-12


def test_all_that_take_a_tolerance_take_one_for_each_component():
    """One for each, all alike, gives what the number gives."""

    def moving(t, y, p):
        return np.array([p[0] * y[1], -y[0]])

    equation = hd.Equation(hd.Caputo(0.9), moving, [1.0, 0.0], params=[1.0])
    calls = {
        "lyapunov": lambda atol: hd.lyapunov(equation, 5.0, rtol=1e-6, atol=atol).exponents,
        "sensitivities": lambda atol: hd.sensitivities(equation, 5.0, atol=atol).by_params,
        "ensemble": lambda atol: hd.ensemble(equation, 5.0, params=[[1], [2]], atol=atol).y,
        "solve_ivp": lambda atol: hd.solve_ivp(
            lambda t, y: np.array([y[1], -y[0]]), (0, 5), [1.0, 0.0], atol=atol
        ).y,
        "complex": lambda atol: hd.solve(
            hd.Equation(hd.Caputo(0.9), lambda t, y: 1j * y, [1.0 + 0j, 2.0]), 5.0, atol=atol
        ).y,
        "memory": lambda atol: hd.solve(
            hd.Equation(
                hd.Caputo(0.9), lambda t, y, z: -y - z[0], [1.0, 2.0], memory=hd.Caputo(0.4)
            ),
            5.0, atol=atol,
        ).y,
    }  # fmt: skip
    for name, call in calls.items():
        assert np.array_equal(call(1e-7), call([1e-7, 1e-7])), name


@given(
    seed=st.integers(0, 2**32 - 1),
    d=st.sampled_from([3, 8, 12]),
    order=st.sampled_from([0.5, 0.9, 1.0, 1.5]),
    rtol=st.sampled_from([1e-3, *TOLERANCES]),
)
def test_a_mode_that_is_not_excited_leaves_the_tolerance(seed, d, order, rtol):
    """``A = V diag(rates) V^-1``, and y(0) is a sum of all columns of V but one."""
    rng = np.random.default_rng(seed)
    basis, rates = rng.normal(size=(d, d)) + 2 * np.eye(d), -(10 ** rng.uniform(-1, 1, d))
    assume(np.linalg.cond(basis) < 1e4)
    amounts = rng.normal(size=d)
    amounts[-1] = 0.0
    y0, matrix = basis @ amounts, basis @ np.diag(rates) @ np.linalg.inv(basis)
    params = [*matrix.ravel(), *np.zeros(d)]
    equation = hd.Equation(
        hd.Caputo(order), linear, y0 if order <= 1 else [y0, 0 * y0], params=params
    )
    sol, t = hd.solve(equation, 3.0, rtol=rtol), np.linspace(0.1, 3, 7)
    assert sol.success
    modes = [hd.exact.mittag_leffler(rate * t**order, order, 1.0).real for rate in rates]
    off = np.abs(sol(t) - (np.array(modes).T * amounts) @ basis.T).max()
    assert off <= 2 * rtol * np.abs(y0).max()
