"""Memory terms with kernels other than Caputo's: the same numbers by other means."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import gamma
from solver.runs import at_end, completed, errors_of

import hereditary as hd

PRONY = hd.Prony((1.0, 10.0), (0.3, 0.7))
# two pairs and a rate, with weights of all signs
PAIRS = hd.Prony([1 + 2j, 1 - 2j, 0.3 + 5j, 0.3 - 5j, 2.0], [0.1 - 0.2j, 0.1 + 0.2j, 0.1, 0.1, 0.4])
HISTORIES = [hd.SumOfExponentials(), hd.Direct(), hd.FFT()]


def decay(t, y):
    return -y


def driven(t, y):
    return np.sin(t) - y


def with_modes(terms, depth, rhs, y0, kernel=PRONY):
    """x(10) of ``sum_m a_m x^(m) + sum_m c_m int K x^(m) = rhs`` as an ordinary system.

    `terms` maps m to (a_m, c_m); depth is the highest m. Each memory term has modes z' = x^(m) - r
    z; where it acts on the highest derivative, that is solved for.
    """
    rates, weights = np.array(kernel.rates), np.array(kernel.weights)
    remembered = [m for m, (_, c) in terms.items() if c]

    def slopes(t, state):
        x, modes = state[:depth], state[depth:].reshape(len(remembered), rates.size)
        known, lead = rhs(t, x[:1])[0], 0.0
        for m, (a, _) in terms.items():
            if m < depth:
                known -= a * x[m]
            else:
                lead += a
        slope = np.zeros_like(modes)
        held = [terms[m][1] * weights @ z for m, z in zip(remembered, modes, strict=True)]
        top = (known - sum(held)) / lead
        for row, m in enumerate(remembered):
            slope[row] = (top if m == depth else x[m]) - rates * modes[row]
        return np.concatenate([x[1:], [top], slope.ravel()])

    start = np.concatenate([y0, np.zeros(len(remembered) * rates.size, dtype=rates.dtype)])
    run = solve_ivp(slopes, (0, 10), start, method="DOP853", rtol=1e-12, atol=1e-13)
    return run.y[0, -1].real


# what terms, initial values and right-hand side are
CASES = {
    "y": ({1: (1.0, 0.0), 0: (0.0, 0.5)}, [1.0], driven),
    "y'": ({1: (1.0, 0.5)}, [1.0], driven),
    "y' above order 1": ({2: (1.0, 0.0), 1: (0.0, 0.5)}, [1.0, 0.3], decay),
    "y and y'": ({2: (1.0, 0.0), 1: (0.0, 0.3), 0: (0.0, 0.5)}, [1.0, 0.3], driven),
    "y''": ({2: (1.0, 0.5), 1: (1.0, 0.0)}, [1.0, -1.0], decay),
    "y and y''": ({2: (1.0, 0.5), 0: (0.0, 0.5)}, [1.0, 0.3], driven),
}


def made(name, kernel=PRONY):
    terms, y0, rhs = CASES[name]
    operators = [a * hd.Caputo(m) for m, (a, _) in terms.items() if a]
    operators += [c * hd.Memory(kernel, m) for m, (_, c) in terms.items() if c]
    return hd.Equation(operators, rhs, y0)


def exactly(name, kernel=PRONY):
    terms, y0, rhs = CASES[name]
    return with_modes(terms, len(y0), rhs, y0, kernel)


@pytest.mark.parametrize(
    "how", [*({"history": history} for history in HISTORIES), {"scheme": hd.L1()}], ids=str
)
@pytest.mark.parametrize("name", CASES)
def test_modes_of_a_prony_series_are_an_ordinary_system(name, how):
    """To first order, which is that of L1, 2 - alpha or 3 - beta, at the integers."""
    errors = errors_of(at_end, exactly(name), (1000, 2000), made(name), 10.0, **how)
    assert errors[0] < (0.03 if "scheme" in how else 0.01)
    assert abs(np.log2(errors[0] / errors[1]) - 1) < 0.15


# each with a kernel on y: alone, beside all that L1 weighs otherwise, and in one component of two
REMEMBERING = {
    "alone": (hd.Caputo(1.5), 0.5 * hd.Memory(PRONY, 0)),
    "beside": (
        *(hd.Caputo(1.5), 0.3 * hd.Caputo(0.6), 0.5 * hd.Memory(PRONY, 0)),
        *(0.2 * hd.Memory(hd.PowerLaw(0.4), 0), 0.3 * hd.Memory(PRONY, 1)),
    ),
    "of two": (
        hd.Caputo([1.5, 1.0]),
        [0.5, 0.2] * hd.Memory(PRONY, 0),
        [0.3, 0.0] * hd.Memory(hd.MittagLeffler(0.5, 1.0), 1),
    ),
}


def remembering(name):
    y0 = [[1.0, 0.5], [0.7, 0.0]] if name == "of two" else [1.0, 0.7]
    return hd.Equation(REMEMBERING[name], driven, y0)


@pytest.mark.parametrize("name", REMEMBERING)
def test_l1_keeps_its_order_where_y_is_remembered(name):
    equation, first = remembering(name), lambda sol: sol.y[-1, 0]
    exact = first(hd.solve(equation, 10.0, rtol=1e-9))
    errors = errors_of(first, exact, (500, 1000), equation, 10.0, scheme=hd.L1())
    assert errors[1] < 2e-4
    assert abs(np.log2(errors[0] / errors[1]) - 1.5) < 0.1


@pytest.mark.parametrize("kernel", [PRONY, PAIRS], ids=["real", "pairs"])
@pytest.mark.parametrize("name", CASES)
def test_collocation_solves_the_same_system(name, kernel):
    exact = exactly(name, kernel)
    for rtol in (1e-6, 1e-10):
        sol = hd.solve(made(name, kernel), 10.0, rtol=rtol, scheme=hd.Collocation())
        assert abs(sol.y[-1, 0] - exact) < rtol


# a ramp from t = 5 on, so steep that modes are refined there
SLOPE = 1e6
RATES, INTEGRATED = np.array(PAIRS.rates), np.array(PAIRS.weights) / np.array(PAIRS.rates)


def order(t):
    return 0.4 + 0.2 * math.sin(t)


def ramped(t, y):
    since = max(t - 5.0, 0.0)
    remembered = (INTEGRATED * (1.0 - np.exp(-RATES * since))).sum().real
    return 1.0 + SLOPE * (since + since**0.3 / math.gamma(1.3) + remembered) - y


def ramped_with_more(t, y):
    since, a = max(t - 5.0, 0.0), 0.4 + 0.2 * math.sin(t)
    return ramped(t, y) + SLOPE * since ** (1.0 - a) / math.gamma(2.0 - a)


# the second with an order that varies, whose modes lie between those of powers and pairs
RAMPS = {
    "constant orders": (hd.Caputo(0.7), ramped),
    "one that varies": (hd.Caputo(0.7) + hd.Caputo(order), ramped_with_more),
}


@pytest.mark.parametrize(
    ("name", "way", "allowed"),
    [
        ("constant orders", {"rtol": 1e-5}, 1e-5),
        ("constant orders", {"rtol": 1e-7}, 1e-7),
        ("one that varies", {"rtol": 1e-7}, 1e-7),
        # it makes no error on straight lines, so what remains is that of the modes
        ("constant orders", {"n_steps": 1000, "scheme": hd.L1()}, 1e-9),
    ],
    ids=str,
)
def test_both_engines_follow_a_ramp_by_pairs_beside_power_laws(name, way, allowed):
    """And both miss it where the weights have the other phase."""
    other, errors = hd.Prony(PAIRS.rates, np.conj(PAIRS.weights)), []
    for kernel in (PAIRS, other):
        terms, rhs = RAMPS[name]
        sol = hd.solve(hd.Equation(terms + hd.Memory(kernel, 1), rhs, 1.0), 10.0, **way)
        exact = 1.0 + SLOPE * np.maximum(sol.t - 5.0, 0.0)
        errors.append(np.abs(sol.y[:, 0] - exact).max() / exact[-1])
    assert errors[0] < allowed
    assert errors[1] > 0.01


@pytest.mark.parametrize(("leading", "m"), [(1, 1), (2, 2), (1.8, 1), (2, 1)])
@pytest.mark.parametrize("a", [0.2, 0.8])
def test_a_hardly_tempered_power_law_is_a_power_law(leading, m, a):
    """Its singular moments, its modes and its powers of t are all its own here."""
    y0 = 1.0 if leading <= 1 else [1.0, 0.5]
    by_kernel = 0.25 / gamma(1 - a) * hd.Memory(hd.TemperedPowerLaw(a, 1e-13), m)
    equations = [
        hd.Equation([hd.Caputo(leading), term], decay, y0)
        for term in (by_kernel, 0.25 * hd.Caputo(m - 1 + a))
    ]
    t = np.linspace(0, 10, 30)
    exact = hd.solve(equations[1], 10.0, rtol=1e-11, scheme=hd.Collocation())(t)
    for rtol in (1e-5, 1e-9):
        sol = hd.solve(equations[0], 10.0, rtol=rtol, scheme=hd.Collocation())
        assert np.abs(sol(t) - exact).max() < rtol
    runs = [hd.solve(equation, 10.0, 2000) for equation in equations]
    np.testing.assert_allclose(runs[0].y, runs[1].y, rtol=0, atol=1e-9)


def test_the_step_limit_is_sharp():
    equation = hd.Equation(
        [hd.Caputo(2), 0.5 * hd.Memory(PRONY, 1)], lambda t, x: -100 * x, [1, 0.3]
    )
    limit = hd.ExplicitCaputo().step_limit(equation, 100.0)
    below = hd.solve(equation, 0.99 * limit * 4000, 4000)
    assert np.abs(below.y[-100:]).max() < 2
    with pytest.warns(hd.StabilityWarning):
        hd.solve(equation, 1.01 * limit * 4000, 4000)


OSCILLATING = {
    "pair": hd.Prony([0.1 + 3j, 0.1 - 3j], [0.5, 0.5]),
    "function": hd.Kernel(lambda t: np.exp(-0.1 * t) * np.cos(3 * t), signed=True),
}
# y(50) of y' + int K y = 0, y(0) = 1, in 30 digits by the system of y and two modes
SWUNG = 0.5467356060190188


def swung(kernel, order=1):
    return hd.Equation(hd.Caputo(order) + hd.Memory(kernel, 0), lambda t, y: 0 * y, 1.0)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-10])
@pytest.mark.parametrize("name", OSCILLATING)
def test_kernels_that_oscillate_keep_the_tolerance(name, rtol):
    sol = completed(swung(OSCILLATING[name]), 50.0, rtol=rtol)
    assert abs(sol.y[-1, 0] - SWUNG) < rtol


@pytest.mark.parametrize("history", HISTORIES, ids=str)
@pytest.mark.parametrize("name", OSCILLATING)
def test_kernels_that_oscillate_on_given_steps(name, history):
    equation, how = swung(OSCILLATING[name]), {"scheme": hd.L1(), "history": history}
    errors = errors_of(at_end, SWUNG, (8000, 16_000), equation, 50.0, **how)
    assert errors[0] < 1e-4
    assert abs(np.log2(errors[0] / errors[1]) - 1) < 0.15  # the order of L1 at integers


TURNING = {
    "explicit": (hd.Caputo(1.7) + hd.Memory(OSCILLATING["pair"], 1), hd.ExplicitCaputo()),
    "implicit": (hd.Caputo(0.6) + hd.Memory(OSCILLATING["function"], 1), hd.L1()),
    "of y": (hd.Caputo(2) + hd.Memory(OSCILLATING["pair"], 0), hd.ExplicitCaputo()),
    "two kernels": (hd.Memory(OSCILLATING["pair"], 0) + hd.Memory(PRONY, 1), hd.L1()),
}


@pytest.mark.parametrize("name", TURNING)
def test_modes_that_turn_sum_what_direct_sums_do(name):
    terms, scheme = TURNING[name]
    y0 = [1.0, 0.5] if scheme == hd.ExplicitCaputo() else 1.0
    eq = hd.Equation(terms, lambda t, y: np.sin(t) - y**3, y0)
    modes = {"scheme": scheme, "history": hd.SumOfExponentials(tol=1e-12, horizon=30.0)}
    direct = hd.solve(eq, 30.0, 3000, scheme=scheme, history=hd.Direct())
    found = hd.solve(eq, 30.0, 3000, **modes)
    np.testing.assert_allclose(found.y, direct.y, rtol=0, atol=1e-11)
    half = hd.solve(eq, 15.0, 1500, **modes)
    np.testing.assert_array_equal(hd.solve(eq, 30.0, resume=half.state).y[-1], found.y[-1])


def test_modes_that_turn_take_tangents_with_them():
    eq, how = swung(OSCILLATING["pair"]), {"scheme": hd.L1()}
    grown = hd.lyapunov(eq, 50.0, 1000, verify=False, **how).exponents[0]
    assert abs(np.exp(50 * grown) - hd.solve(eq, 50.0, 1000, **how).y[-1, 0]) < 1e-10


@pytest.mark.parametrize("name", OSCILLATING)
def test_kernels_that_oscillate_turn_tangents_and_states_with_them(name):
    """The equation is linear: its tangent is y itself. A run to half the time goes on."""
    eq = swung(OSCILLATING[name])
    grown = hd.lyapunov(eq, 50.0, rtol=1e-8, scheme=hd.Collocation(), verify=False).exponents[0]
    assert abs(50 * grown - np.log(SWUNG)) < 1e-6
    way = {"rtol": 1e-8, "scheme": hd.Collocation(horizon=50.0)}
    half = hd.solve(eq, 25.0, **way)
    assert abs(hd.solve(eq, 50.0, resume=half.state, **way).y[-1, 0] - SWUNG) < 1e-8


@pytest.mark.parametrize("rtol", [1e-5, 1e-8])
def test_a_gaussian_is_a_memory_too(rtol):
    """Of y itself, where no exponential decays so fast; errors of L1 are of order 1 here."""
    kernel = hd.Kernel(lambda t: np.exp(-(t**2) / 8) * np.cos(3 * t), signed=True)
    eq = hd.Equation(hd.Caputo(1) + hd.Memory(kernel, 0), decay, 1.0)
    end, how = completed(eq, 20.0, rtol=rtol).y[-1, 0], {"scheme": hd.L1(), "history": hd.FFT()}
    coarse = [hd.solve(eq, 20.0, n, **how).y[-1, 0] for n in (4000, 8000, 16_000)]
    by_two = [2 * fine - rough for rough, fine in itertools.pairwise(coarse)]
    assert abs((4 * by_two[1] - by_two[0]) / 3 - end) < max(0.1 * rtol, 1e-9)


def test_states_beside_a_power_law_turn_with_it():
    eq = swung(OSCILLATING["pair"], 0.7).replace(rhs=lambda t, y: -(y**3))
    end, how = hd.solve(eq, 20.0, rtol=1e-9).y[-1, 0], {"scheme": hd.L1(), "history": hd.FFT()}
    coarse = [hd.solve(eq, 20.0, n, **how).y[-1, 0] for n in (2000, 4000)]
    assert abs(2 * coarse[1] - coarse[0] - end) < 1e-5
