"""Sizes of components, to which a tolerance is relative without `atol=`.

The size of a component is its largest |y| so far, at least a millionth of the largest size of all.
So components that stay at 0 change nothing, the unit of y changes nothing, and components that are
smaller than others keep the tolerance over eight decades.
"""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from random_problems import linear

import hereditary as hd


class Problem(NamedTuple):
    """Terms, f(t, z, s) of z = y * s, y(0) (and y'(0) behind it), time."""

    terms: object
    rhs: object
    y0: list
    t_end: float


def van_der_pol(t, z, s):
    y = z / s
    return np.array([y[1], 2 * (1 - y[0] ** 2) * y[1] - y[0]]) * s


def driven(t, z, s):
    return (np.sin(3 * t) - 2 * z / s) * s


def oscillator(t, z, s):
    return (np.sin(t) - z / s - (z / s) ** 3) * s


def kinetics(t, z, s):
    y = z / s
    slow, back, fast = 0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] ** 2
    return np.array([-slow + back, slow - back - fast, fast]) * s


def epidemic(t, z, s):
    y = z / s
    return np.array([-y[0] * y[1], y[0] * y[1] - 0.3 * y[1], 0.3 * y[1]]) * s


def cascade(t, z, s):
    y = z / s
    return np.array([1 - y[0], y[0] - y[1], y[1] - y[2], y[2] - y[3]]) * s


PROBLEMS = {
    "van der Pol": Problem(hd.Caputo(0.95), van_der_pol, [1.0, 0.0], 20.0),
    "driven from rest": Problem(hd.Caputo(0.6), driven, [0.0], 20.0),
    "oscillator": Problem(hd.Caputo(1.8) + 0.2 * hd.Caputo(0.8), oscillator, [0.0, 0.0], 20.0),
    "kinetics": Problem(hd.Caputo(0.9), kinetics, [1.0, 0.0, 0.0], 40.0),
    "epidemic": Problem(hd.Caputo(0.9), epidemic, [0.99, 0.01, 0.0], 40.0),
    "cascade from rest": Problem(hd.Caputo(0.8), cascade, [0.0, 0.0, 0.0, 0.0], 10.0),
}
TOLERANCES = [1e-4, 1e-6, 1e-8]


def scaled(problem, scale):
    """Return the equation of y times `scale`, (d,)."""
    y0 = np.reshape(problem.y0, (-1, scale.size)) * scale
    y0 = y0[0] if len(y0) == 1 else y0
    return hd.Equation(problem.terms, problem.rhs, y0, params=scale)


def size_of(problem):
    return len(problem.y0) // (2 if problem.rhs is oscillator else 1)


@pytest.fixture(scope="module")
def plain():
    """Solutions in units of 1, by name and tolerance."""
    return {
        (name, rtol): hd.solve(scaled(p, np.ones(size_of(p))), p.t_end, rtol=rtol)
        for name, p in PROBLEMS.items()
        for rtol in TOLERANCES
    }


def compared(problem, one, scale, rtol, **how):
    """Solve the problem in other units; return the run and its distance in tolerances."""
    sol = hd.solve(scaled(problem, scale), problem.t_end, rtol=rtol, **how)
    assert sol.success
    t = np.linspace(0, problem.t_end, 101)
    apart = np.abs(sol(t) / scale - one(t)).max(axis=0)
    return sol, (apart / (rtol * np.abs(one(t)).max(axis=0))).max()


@pytest.mark.parametrize("name", PROBLEMS)
@given(power=st.integers(-100, 100), rtol=st.sampled_from(TOLERANCES))
def test_the_unit_of_y_changes_nothing(plain, name, power, rtol):
    problem, one = PROBLEMS[name], plain[name, rtol]
    sol, apart = compared(problem, one, np.full(size_of(problem), 10.0**power), rtol)
    assert apart < 1
    assert abs(sol.stats["n_steps"] - one.stats["n_steps"]) <= 0.2 * one.stats["n_steps"]


@pytest.mark.parametrize("name", PROBLEMS)
@given(
    decades=st.lists(st.floats(0, 8), min_size=4, max_size=4),
    power=st.integers(-50, 50),
    rtol=st.sampled_from(TOLERANCES),
)
def test_components_apart_by_eight_decades_keep_the_tolerance(plain, name, decades, power, rtol):
    """As long as rounding of the largest, 1e-14 of it, is below the tolerance of the smallest."""
    problem, one = PROBLEMS[name], plain[name, rtol]
    decades = np.minimum(decades[: size_of(problem)], 14 + np.log10(rtol))
    sizes = np.abs(one.y).max(axis=0)
    _, apart = compared(problem, one, 10.0 ** (decades + power) / sizes, rtol)
    assert apart < 2


@given(decades=st.lists(st.floats(-30, 30), min_size=3, max_size=3))
def test_beyond_eight_decades_atol_keeps_it(plain, decades):
    problem, one, rtol = PROBLEMS["epidemic"], plain["epidemic", 1e-6], 1e-6
    scale = 10.0 ** np.array(decades)
    _, apart = compared(problem, one, scale, rtol, atol=0.01 * rtol * scale)
    assert apart < 2


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
    # 34 steps, a 32nd of the run each, are made where nothing seems to move
    assert sol.stats["n_steps"] <= max(1.4 * alone.stats["n_steps"], 36)


POWERS = [-100, -12, 60]


@pytest.mark.parametrize("power", POWERS)
def test_exponents_have_no_units(power):
    def lorenz(t, z, s):
        y = z / s
        x, u, v = y[0], y[1], y[2]
        return np.array([10 * (u - x), x * (28 - v) - u, x * u - 8 / 3 * v]) * s

    problem = Problem(hd.Caputo(0.99), lorenz, [1.0, 1.0, 20.0], 4.0)
    one, other = (
        hd.lyapunov(
            scaled(problem, np.full(3, s)), 4.0, rtol=1e-8, scheme=hd.Collocation()
        ).exponents
        for s in (1.0, 10.0**power)
    )
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
    def towards(t, y, p):
        return p[0] - y

    equation = hd.Equation(hd.Caputo(0.8), towards, 0.0, params=[1.0])
    anew = hd.Equation(hd.Caputo(0.8), towards, 0.0, params=[1000.0])
    replaced = equation.replace(params=[1000.0])
    assert equation.system.units < anew.system.units == replaced.system.units


@pytest.mark.parametrize("power", POWERS)
def test_fits_find_the_same_rate(power):
    t = np.linspace(0, 5, 21)

    def relaxing(t, z, p):
        return -p[0] * z

    scale = 10.0**power
    result = hd.fit(
        lambda rate: hd.Equation(hd.Caputo(0.8), relaxing, scale, params=[rate]),
        t, scale * hd.exact.relaxation(0.8, 0.7)(t), {"rate": 1.0},
    )  # fmt: skip
    assert result.parameters["rate"] == pytest.approx(0.7, rel=1e-6)


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
    assert np.all(scaled(PROBLEMS["cascade from rest"], scale).system.units < np.inf)


def test_a_run_that_rounding_ends_names_the_component_and_atol():
    """Rounding of y0 - y1 is multiplied by 1e8 on its way to y3."""

    def differences(t, y):
        force = np.sin(3 * t)
        return np.array(
            [
                force - y[0],
                force - y[1] + 1e-16 * y[0],
                1e4 * (y[0] - y[1]) - y[2],
                1e4 * y[2] - y[3],
            ]
        )

    equation = hd.Equation(hd.Caputo(0.5), differences, [0.3, 0.3, 0.0, 0.0])
    with pytest.warns(hd.SolveWarning, match=r"component 3 .* give atol="):
        ended = hd.solve(equation, 5.0)
    assert not ended.success
    assert hd.solve(equation, 5.0, atol=1e-6).stats["n_steps"] < 50


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
