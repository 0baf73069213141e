"""Right-hand sides that are finite on one side of an edge alone: runs complete from it.

Each run is held to the same run of f that is continued by a constant beyond the edge.
"""

import math
import warnings
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.special import gamma
from solver.runs import completed, warned

import hereditary as hd

pytestmark = pytest.mark.rounding


class Domain(NamedTuple):
    """f(t, y, p), where it is finite, and y(0) at the edge, which it leaves at once."""

    rhs: object
    low: float
    high: float
    edge: list


def between(rhs):
    """Return f with its constant values beyond the last two parameters, the edges."""
    return lambda t, y, p: rhs(t, np.minimum(np.maximum(y, p[2]), p[3]), p)


def hill(t, y, p):
    z = y ** (1 + 2 * p[1])
    return np.array([p[0] - y[0], 5.0 * z[0] / (0.2 + z[0]) - y[1] ** (0.7 + p[1])])


def cascade(t, y, p):
    z = y ** p[1]
    return np.array([p[0] - 0.4 * z[0], 0.4 * z[0] - 0.3 * z[1], 0.3 * z[1] - 0.3 * z[2]])


def logistic(t, y, p):
    return 0.2 + 0.3 * (y * (1.0 - y)) ** p[1] - 0.8 * y


INFINITY = 1e300
DOMAINS = {
    "tank": Domain(lambda t, y, p: p[0] - 0.4 * y ** p[1], 0.0, INFINITY, [0.0]),
    "Hill functions": Domain(hill, 0.0, INFINITY, [0.0, 0.0]),
    "cascade": Domain(cascade, 0.0, INFINITY, [0.0, 0.0, 0.0]),
    "growing": Domain(lambda t, y, p: p[0] + np.sqrt(y) - y, 0.0, INFINITY, [0.0]),
    "draining": Domain(lambda t, y, p: -p[0] * (1.0 - (-y) ** p[1]), -INFINITY, 0.0, [0.0]),
    "0 to 1": Domain(logistic, 0.0, 1.0, [0.0]),
    "1 to 0": Domain(logistic, 0.0, 1.0, [1.0]),
    "-1 to 1": Domain(lambda t, y, p: 0.2 * (1.0 - y * y) ** p[1] - y, -1.0, 1.0, [1.0]),
    "angle": Domain(lambda t, y, p: np.arccos(y) - 1.8, -1.0, 1.0, [1.0]),
    "logarithm": Domain(lambda t, y, p: -p[0] * np.log(y), 1e-3, INFINITY, [1e-3]),
}
WAYS = [
    {"rtol": 1e-4},
    {"rtol": 1e-8},
    {"n_steps": 200, "scheme": hd.BDF(2)},
    {"n_steps": 200, "scheme": hd.L1()},
]


def both(domain, order, how, amount, power, inside):
    """Return the run, and that of the f that goes on beyond the edges; `inside` moves y(0)."""
    rhs, low, high, edge = domain
    middle = min(max(low, -1.0), 0.0) + min(max(high, 0.0), 1.0)
    y0 = np.array(edge) + inside * (0.5 * middle - np.array(edge))
    start = y0 if order <= 1 else [y0, 0.0 * y0]
    nowhere = [amount, power, -INFINITY, INFINITY]
    equation = hd.Equation(hd.Caputo(order), between(rhs), start, params=nowhere)
    beyond = equation.replace(params=[amount, power, low, high])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hd.SolveWarning)
        return [hd.solve(e, 5.0, **how) for e in (equation, beyond)]


@given(
    name=st.sampled_from(sorted(DOMAINS)),
    order=st.sampled_from([0.5, 0.9, 1.0, 1.5]),
    how=st.sampled_from(WAYS),
    amount=st.floats(0.3, 2.0),
    power=st.floats(0.4, 1.9),
    inside=st.sampled_from([0.0, 1e-9, 0.3]),
)
def test_a_run_at_the_edge_is_the_one_whose_f_goes_on_beyond_it(
    name, order, how, amount, power, inside
):
    found, beyond = both(DOMAINS[name], order, how, amount, power, inside)
    assume(beyond.success)
    _, low, high, _ = DOMAINS[name]
    assume(np.all((beyond.y >= low - 1e-12) & (beyond.y <= high + 1e-12)))
    assert found.success, found.message
    size = np.abs(beyond.y).max()
    assert np.abs(found.y[-1] - beyond.y[-1]).max() <= how.get("rtol", 1e-8) * size


@pytest.mark.parametrize("how", WAYS, ids=repr)
@pytest.mark.parametrize("order", [0.5, 0.9, 1.0, 1.5])
@pytest.mark.parametrize("name", sorted(DOMAINS))
def test_a_run_from_the_edge_completes(name, order, how):
    found, beyond = both(DOMAINS[name], order, how, 1.0, 0.5, 0.0)
    assert found.success, found.message
    size = np.abs(beyond.y).max()
    assert np.abs(found.y[-1] - beyond.y[-1]).max() <= how.get("rtol", 1e-8) * size


@pytest.mark.parametrize("name", ["Hill functions", "cascade", "tank", "1 to 0"])
def test_order_1_from_the_edge_is_scipys(name):
    rhs, low, high, edge = DOMAINS[name]
    f, how = between(rhs), {"t_eval": np.linspace(0.0, 5.0, 11)}
    nowhere, kept = np.array([1.0, 1.2, -INFINITY, INFINITY]), np.array([1.0, 1.2, low, high])
    found = hd.solve_ivp(f, (0, 5), edge, args=(nowhere,), rtol=1e-8, **how)
    expected = solve_ivp(f, (0, 5), edge, args=(kept,), rtol=1e-10, atol=1e-12, **how)
    assert found.success, found.message
    np.testing.assert_allclose(found.y, expected.y, rtol=1e-7, atol=1e-7)


# order, power of t of the solution, power of y in the outflow
FILLING = [
    (0.3, 2.0, 0.5), (0.3, 1.25, 0.8), (0.5, 2.0, 0.5), (0.5, 4.0, 0.5), (0.5, 3.0, 0.3),
    (0.8, 2.0, 0.5), (0.8, 1.5, 0.9), (0.95, 4.0, 0.5), (1.0, 2.0, 0.5), (1.0, 4.0, 0.5),
    (1.0, 3.5, 0.3), (1.2, 4.0, 0.5), (1.2, 3.0, 0.7), (1.5, 4.0, 0.5), (1.5, 2.5, 0.4),
]  # fmt: skip


def filling(t, y, p):
    """Two tanks in series; their inflows are those of the contents t^m and 3 t^m."""
    a, m, q, clipped = p[0], p[1], p[2], p[3]
    out = np.empty(2)
    z = np.maximum(y, 0.0) if clipped == 1.0 else y
    first, second = 2.0 * z[0] ** q, 2.0 * (z[1] / 3.0) ** q
    grows = math.gamma(m + 1) / math.gamma(m + 1 - a) * t ** (m - a)
    out[0] = grows + 2.0 * t ** (m * q) - first
    out[1] = 3.0 * grows + first - second
    return out


@pytest.mark.parametrize("rtol", [1e-4, 1e-7])
@pytest.mark.parametrize("clipped", [0.0, 1.0])
@pytest.mark.parametrize(("order", "power", "outflow"), FILLING)
def test_empty_tanks_fill_by_inflows_that_begin_at_0(order, power, outflow, clipped, rtol):
    start = [0.0, 0.0] if order <= 1 else [[0.0, 0.0], [0.0, 0.0]]
    params = [order, power, outflow, clipped]
    sol = completed(hd.Equation(hd.Caputo(order), filling, start, params=params), 2.0, rtol=rtol)
    t = np.concatenate([sol.t, np.geomspace(1e-9, 2.0, 50)])
    exact = np.outer(t**power, [1.0, 3.0])
    error = np.abs(np.array([sol(time) for time in t]) - exact)
    assert np.all(error <= rtol * (exact + 0.01 * exact.max(axis=0)))


def ramp(t, y, p):
    """An inflow from p[0] on, into a row of tanks without exchange."""
    return max(t - p[0], 0.0) - np.sqrt(y)


def chain(t, y, p):
    """A chain of two empty tanks, whose inflow p[0] t^p[1] begins at t = p[2]."""
    z = np.maximum(y, 0.0) if p[3] == 1.0 else y
    between = np.sqrt(z[0])
    inflow = p[0] * max(t - p[2], 0.0) ** p[1]
    return np.array([inflow - between, between - 1.3 * np.sqrt(z[1])])


@pytest.mark.parametrize("begins", [0.0, 0.7])
@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
@pytest.mark.parametrize(("strength", "power"), [(1e-6, 2.0), (1.0, 1.0), (1.0, 3.0)])
@pytest.mark.parametrize("order", [0.8, 0.9, 1.2, 1.5])
def test_chains_of_empty_tanks_fill(order, strength, power, rtol, begins):
    """With max(y, 0) in the root, they are the ones without it, to rtol 1e-9."""
    start = np.zeros(2) if order <= 1 else np.zeros((2, 2))
    roots = hd.Equation(hd.Caputo(order), chain, start, params=[strength, power, 0.0, 0.0])
    clipped = roots.replace(params=[strength, power, begins, 1.0])
    breaks = {"breaks": [begins]} if begins else {}
    found = completed(clipped, begins + 3.0, rtol=rtol, **breaks)
    expected = completed(roots, 3.0, rtol=1e-9)
    for t in (0.3, 1.0, 3.0):
        allowed = rtol * (np.abs(expected(t)) + 0.01 * np.abs(expected.y).max(axis=0))
        assert np.all(np.abs(found(begins + t) - expected(t)) <= allowed)


@pytest.mark.parametrize("scheme", [hd.L1(), hd.BDF(2)])
def test_given_steps_that_cannot_leave_the_edge_name_rtol(scheme):
    chain_of = hd.Equation(hd.Caputo(0.8), chain, np.zeros(2), params=[1.0, 3.0, 0.0, 0.0])
    sol = warned("use rtol=", chain_of, 3.0, n_steps=300, scheme=scheme)
    assert (sol.status, sol.t[-1]) == ("not_solved", 0.0)


def test_empty_tanks_beside_others_and_with_a_given_jacobian():
    one = hd.Equation(hd.Caputo(0.8), ramp, 0.0, params=[0.0])
    expected = hd.solve(one, 3.0, rtol=1e-6).y[-1, 0]
    full = hd.Equation(
        hd.Caputo(0.8), lambda t, y: np.array([t - np.sqrt(y[0]), y[0] - y[1]]), [0.0, 1.0]
    )
    given = hd.Equation(
        hd.Caputo(0.8),
        lambda t, y: t - np.sqrt(y),
        0.0,
        jac=lambda t, y: -0.5 / np.sqrt(max(y[0], 1e-12)),
    )
    many = hd.Equation(hd.Caputo(0.8), ramp, np.zeros(12), params=[0.0], bandwidth=(1, 1))
    for equation in (full, given, many):
        sol = completed(equation, 3.0, rtol=1e-6)
        assert sol.y[-1, 0] == pytest.approx(expected, rel=2e-6)


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("order", [0.3, 0.5, 0.8])
def test_what_stays_full_beside_an_empty_tank_at_first_costs_little(order, rtol):
    """At the first nodes it is on either side of its start value, by rounding."""
    tank = hd.Equation(hd.Caputo(order), ramp, 0.0, params=[0.0])
    both = hd.Equation(
        hd.Caputo(order), lambda t, y: np.array([t - np.sqrt(y[0]), -y[0]]), [0.0, 1.0]
    )
    alone, beside = (completed(equation, 3.0, rtol=rtol) for equation in (tank, both))
    assert beside.y[-1, 0] == pytest.approx(alone.y[-1, 0], rel=2 * rtol)
    assert beside.stats["n_rhs"] < 10 * alone.stats["n_rhs"]


@pytest.mark.parametrize("alpha", [0.1, 0.5, 1.25, 1.5])
def test_a_benchmark_with_a_power_of_y_that_begins_at_0(alpha):
    """By Diethelm, Ford and Freed (2004): y = t^8 - 3 t^(4 + a/2) + 9/4 t^a."""

    def rhs(t, y, p):
        forced = p[1] * t ** (8 - p[0]) - p[2] * t ** (4 - p[0] / 2) + p[3]
        return forced + (1.5 * t ** (p[0] / 2) - t**4) ** 3 - y**1.5

    above = 3 * math.gamma(5 + alpha / 2) / math.gamma(5 - alpha / 2)
    params = [alpha, 40320 / math.gamma(9 - alpha), above, 2.25 * math.gamma(1 + alpha)]
    start = [0.0] if alpha < 1 else [[0.0], [0.0]]
    sol = completed(hd.Equation(hd.Caputo(alpha), rhs, start, params=params), 1.0, rtol=1e-7)
    exact = sol.t**8 - 3 * sol.t ** (4 + alpha / 2) + 2.25 * sol.t**alpha
    assert np.abs(sol.y[:, 0] - exact).max() <= 1e-7


def sixth_root(t, y):
    root = ((y[1] - 0.5) * (y[2] - 0.3)) ** (1 / 6)
    slopes = math.gamma(2.2) * (y[0] - 1), math.gamma(2.8) / math.gamma(2.2) * (y[1] - 0.5)
    return np.array([(root + np.sqrt(t)) / np.sqrt(np.pi), *slopes])


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-8])
def test_a_root_whose_argument_is_rounding_at_first(rtol):
    """By Garrappa (2018): y = t + 1, t^1.2 + 0.5, t^1.8 + 0.3."""
    equation = hd.Equation(hd.Caputo([0.5, 0.2, 0.6]), sixth_root, [1.0, 0.5, 0.3])
    sol = completed(equation, 5.0, rtol=rtol)
    exact = np.transpose([sol.t + 1, sol.t**1.2 + 0.5, sol.t**1.8 + 0.3])
    assert np.abs(sol.y / exact - 1).max() <= rtol


@pytest.mark.parametrize("how", [{"rtol": 1e-6}, {"n_steps": 200, "scheme": hd.BDF(2)}], ids=repr)
def test_many_components_from_the_edge(how):
    """Of a Jacobian by groups of columns too; all components are equal to the one of a tank."""

    def tanks(t, y):
        total = 0.5 - 0.4 * np.sqrt(y)
        total[1:] += 0.1 * (y[:-1] - y[1:])
        total[:-1] += 0.1 * (y[1:] - y[:-1])
        return total

    one = hd.solve(
        hd.Equation(hd.Caputo(0.8), lambda t, y: 0.5 - 0.4 * np.sqrt(y), 0.0), 5.0, **how
    )
    for stated in ({}, {"bandwidth": (1, 1)}):
        equation = hd.Equation(hd.Caputo(0.8), tanks, np.zeros(14), **stated)
        sol = completed(equation, 5.0, **how)
        np.testing.assert_allclose(sol.y[-1], one.y[-1, 0], rtol=1e-6)


@pytest.mark.parametrize(("y0", "expected"), [([0.0, 1.0], 1.5e-8), ([0.25, -1.0], 0.75)])
def test_differences_are_one_sided_at_an_edge(y0, expected):
    """In one column alone, with the components of the others as exact as ever."""
    edge = hd.Equation(
        hd.Caputo(0.5),
        lambda t, y: np.array([y[0] ** 1.5 - y[1] ** 3, np.sqrt(1 - y[1] ** 2) * y[0] + y[1]]),
        y0,
    )
    found = edge.jacobian(0.0, y0)
    assert found[0, 0] == pytest.approx(expected, rel=1e-5, abs=3e-3)
    np.testing.assert_allclose(found[1, 0], np.sqrt(1 - y0[1] ** 2), atol=1e-9)
    np.testing.assert_allclose(found[0, 1], -3.0, rtol=1e-4)
    assert np.isfinite(found).all()


def test_a_wrong_jacobian_is_refused_at_the_edge_and_a_right_one_is_not():
    def rhs(t, y):
        return 1.0 - y**1.5

    hd.Equation(hd.Caputo(0.5), rhs, 0.0, jac=lambda t, y: np.array([[-1.5 * y[0] ** 0.5]]))
    with pytest.raises(ValueError, match="jac must hold"):
        hd.Equation(
            hd.Caputo(0.5), rhs, 0.0, jac=lambda t, y: np.array([[1.0 - 1.5 * y[0] ** 0.5]])
        )


LEAVING = {
    "at once": (lambda t, y: np.sqrt(y) - 1.0, 0.0),
    "later": (lambda t, y: 0.1 * np.sqrt(y) - 2.0, 1.0),
    "upwards": (lambda t, y: 1.0 + 0.0 * np.arccos(y), 0.5),
}


@pytest.mark.parametrize("how", [{"rtol": 1e-6}, {"n_steps": 200, "scheme": hd.BDF(2)}], ids=repr)
@pytest.mark.parametrize("name", LEAVING)
def test_a_solution_that_leaves_the_domain_says_so(name, how):
    rhs, y0 = LEAVING[name]
    sol = warned(
        "right-hand side is not finite just ahead", hd.Equation(hd.Caputo(0.9), rhs, y0), 5.0, **how
    )
    assert sol.status in ("step_too_small", "not_solved")
    assert np.isfinite(sol.y).all()
    assert (sol.t[-1] == 0.0) == (name == "at once")


@pytest.mark.parametrize("how", [{"rtol": 1e-6}, {"n_steps": 200, "scheme": hd.BDF(2)}], ids=repr)
def test_python_and_compiled_code_meet_an_edge_alike(how):
    """`math` raises an exception there, and compiled code gives NaN."""

    class Tank:
        def __call__(self, t, y):
            return [0.5 - 0.4 * math.sqrt(y[0])]

    compiled = hd.Equation(hd.Caputo(0.7), lambda t, y: 0.5 - 0.4 * np.sqrt(y), 0.0)
    with pytest.warns(UserWarning, match="called in Python"):
        in_python = hd.Equation(hd.Caputo(0.7), Tank(), 0.0)
    expected, found = (hd.solve(equation, 5.0, **how) for equation in (compiled, in_python))
    assert found.success, found.message
    np.testing.assert_array_equal(found.y, expected.y)


def powers(t, y, p):
    """Return the f of y = unit t^q with a part, `share`, of it that grows like y^power."""
    share, power, unit, rate, q, order = p  # below 0 the unit is negative
    own = share * rate * unit * (y / unit) ** power
    return own + rate * unit * (t ** (q - order) - share * t ** (q * power))


@pytest.mark.parametrize("seed", range(8))
def test_growth_from_an_edge_follows_its_largest_solution(seed):
    """D^a y = share y^p + g(t) from 0, whose exact solution is t^q with q = a / (1 - p)."""
    random = np.random.default_rng(seed)
    order, power = (1.0, random.uniform(0.3, 1.0))[seed % 2], random.uniform(0.25, 0.75)
    share, unit, q = random.uniform(0.3, 1.0), 10 ** random.uniform(-6, 6), order / (1 - power)
    unit *= random.choice([-1.0, 1.0])
    rate = gamma(q + 1) / gamma(q + 1 - order)
    params = [share, power, unit, rate, q, order]
    equation = hd.Equation(hd.Caputo(order), powers, 0.0, params=params)
    for rtol in (1e-5, 1e-8):
        found = completed(equation, 2.0, rtol=rtol)
        assert len(found.t) < 200
        assert found.y[-1, 0] == pytest.approx(unit * 2.0**q, rel=rtol)


def test_growth_that_no_first_step_resolves_names_the_edge():
    steep = hd.Equation(hd.Caputo(0.1), lambda t, y: y**0.1 + t, 0.0)
    with pytest.warns(hd.SolveWarning):
        ended = hd.solve(steep, 2.0, rtol=1e-8)
    assert ended.status == "step_too_small"
    assert "no derivative at y(0) = 0" in ended.message
    assert hd.solve(steep.replace(y0=1e-20), 2.0, rtol=1e-8).success


def leaving(t, y, p):
    """k y^q + c t^m, which may be continued by a constant below 0."""
    k, q, c, m, clamped = p
    z = np.maximum(y, 0.0) if clamped == 1.0 else y
    return k * z**q + c * t**m


def largest_solution(k, q, c, m, t_end):
    """y(t_end) for y' = k y^q + c t^m, y(0) = 0, y > 0, by u = y^(1 - q) from a tiny time on."""

    def slope(log_t, u):
        t = np.exp(log_t)
        return t * (1 - q) * (k + c * t**m * u ** (-q / (1 - q)))

    begin, how = 1e-16, {"method": "DOP853", "rtol": 1e-12, "atol": 1e-40}
    found = solve_ivp(slope, np.log([begin, t_end]), [(1 - q) * k * begin], **how)
    return found.y[0, -1] ** (1 / (1 - q))


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("clamped", [0.0, 1.0])
@pytest.mark.parametrize(
    ("k", "q", "c", "m"),
    [(1.0, 0.3, 1.0, 1.0), (1.0, 0.5, 1.0, 2.0), (9.0, 0.1, 0.1, 3.0), (0.3, 0.2, 3.0, 1.0),
     (2.0, 0.4, 5.0, 1.0), (0.2, 0.1, 1.0, 0.5)],
)  # fmt: skip
def test_growth_from_an_edge_leaves_at_once(k, q, c, m, clamped, rtol):
    """y = 0 up to any time would solve the equation but for its force."""
    equation = hd.Equation(hd.Caputo(1.0), leaving, 0.0, params=[k, q, c, m, clamped])
    sol = completed(equation, 1.0, rtol=rtol)
    assert sol.y[-1, 0] == pytest.approx(largest_solution(k, q, c, m, 1.0), rel=rtol)


def dipping(t, y, p):
    return np.array([t - p[0], y[0] ** p[1]])


@pytest.mark.filterwarnings("ignore::hereditary.SolveWarning")
@pytest.mark.parametrize(
    ("order", "depth", "power", "rtol"),
    [
        (1.0, 1e-3, 1.7, 1e-8),
        (1.0, 1e-3, 2.5, 1e-10),
        (0.4, 1e-3, 2.5, 1e-8),
        (0.7, 1e-3, 1.7, 1e-6),
    ],
)
def test_a_solution_that_leaves_the_domain_by_more_than_its_tolerance_ends(
    order, depth, power, rtol
):
    """It comes back later: f beyond the edge must not be that at the edge."""
    equation = hd.Equation(hd.Caputo(order), dipping, [0.0, 0.0], params=[depth, power])
    assert not hd.solve(equation, 3.0, rtol=rtol).success
