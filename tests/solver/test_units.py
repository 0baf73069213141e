"""Units of y do not matter: by default tolerances are relative to the size of each component."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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
        for rtol in (1e-4, 1e-6, 1e-8)
    }


@pytest.mark.parametrize("name", PROBLEMS)
@given(
    powers=st.lists(st.integers(-100, 100), min_size=4, max_size=4),
    alike=st.booleans(),
    rtol=st.sampled_from([1e-4, 1e-6, 1e-8]),
)
def test_the_relative_result_changes_by_less_than_twice_the_tolerance(
    plain, name, powers, alike, rtol
):
    problem, one = PROBLEMS[name], plain[name, rtol]
    d = size_of(problem)
    scale = 10.0 ** np.array([powers[0]] * d if alike else powers[:d])
    sol = hd.solve(scaled(problem, scale), problem.t_end, rtol=rtol)
    assert sol.success
    t = np.linspace(0, problem.t_end, 101)
    size = np.abs(one(t)).max(axis=0)
    assert np.all(np.abs(sol(t) / scale - one(t)) < 2 * rtol * size)


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
    assert equation.units < anew.units == equation.replace(params=[1000.0]).units


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


@pytest.mark.parametrize("unit", [1.0, 1e-30])
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
    assert np.all(scaled(PROBLEMS["cascade from rest"], scale).units < np.inf)
