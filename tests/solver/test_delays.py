"""Delays that the right-hand side reads, to a tolerance and on given steps."""

import pickle
import re
from functools import cache

import matplotlib
import numpy as np
import pytest
from cases import GIVEN
from problems import MACKEY_GLASS, delayed_growth, delayed_growth_at, mackey_glass
from scipy.special import binom, gamma
from solver.runs import completed, event, warned

import hereditary as hd

matplotlib.use("Agg")


# the rounding of a time next to a kink limits small orders
CASES = [(0.3, 1e-8), (0.7, 1e-11), (1.0, 1e-11), (1.5, 1e-11)]


@pytest.mark.parametrize("k", [-2.0, 0.5])
@pytest.mark.parametrize(("alpha", "tightest"), CASES)
def test_the_tolerance_holds(alpha, tightest, k):
    times = np.linspace(0.5, 10.0, 20)
    exact = delayed_growth_at(alpha, k, times)
    size = np.abs(exact).max()
    for rtol in (1e-4, 1e-8, tightest):
        found = completed(delayed_growth(alpha, k), 10.0, rtol=rtol)
        assert np.abs(found(times)[:, 0] - exact).max() < 10 * rtol * size
        assert found.stats["n_steps"] < 400


def phases(t, y, late, p):
    """Phase oscillators with a delay for each of p[0] edges, from p[6 + k] to p[26 + k]."""
    slope = p[1:6].copy()
    for k in range(int(p[0])):
        to, of = int(p[26 + k]), int(p[6 + k])
        slope[to] += 0.6 * np.sin(late[k, of] - y[to])
    return slope


def network(order, n, random):
    """Five phase oscillators with n delays, drawn."""
    edges = random.integers(0, 5, 40)
    params, taus = np.r_[n, random.normal(1.0, 0.3, 5), edges], random.uniform(0.5, 1.5, n)
    start = random.uniform(0, 6, (1 + (order > 1), 5))
    return hd.Equation(
        hd.Caputo([order] * 5), phases, start if order > 1 else start[0], params,
        memory=[hd.Delay(tau) for tau in taus],
    )  # fmt: skip


NETWORKS = [(0.5, 3, 150), (0.7, 3, 150), (0.9, 5, 150), (1.0, 10, 150), (1.6, 10, 150)]


@pytest.mark.parametrize(("order", "n", "most"), NETWORKS)
def test_networks_of_delays_keep_the_tolerance_in_few_steps(order, n, most):
    random = np.random.default_rng(n)
    for _ in range(3):
        given, times = network(order, n, random), np.linspace(0.2, 8.0, 40)
        exact = hd.solve(given, 8.0, rtol=1e-9)(times)
        found = hd.solve(given, 8.0, rtol=1e-6)
        assert found.stats["n_steps"] < most
        assert (np.abs(found(times) - exact) < 1e-6 * np.abs(exact).max(axis=0)).all()


@pytest.mark.parametrize("order", [0.4, 0.9, 1.0])
def test_more_delays_than_kinks_that_are_known_keep_the_tolerance(monkeypatch, order):
    given, times = network(order, 8, np.random.default_rng(8)), np.linspace(0.2, 8.0, 40)
    jumps = [hd.Delay(delay.tau, past=0.0) for delay in given.memory]
    given = given.replace(memory=jumps)
    exact = completed(given, 8.0, rtol=1e-8)(times)
    for most in (1, 12, 60):
        monkeypatch.setattr("hereditary.solver.delayed._MOST_KINKS", most)
        found = completed(given, 8.0, rtol=1e-5)(times)
        assert (np.abs(found - exact) < 1e-5 * np.abs(exact).max(axis=0)).all()


TAU = 0.5


def manufactured(alpha, tau=TAU):
    """y = t^2 - t, also before 0."""
    first, second = 2 / gamma(3 - alpha), 1 / gamma(2 - alpha)

    def rhs(t, y, z):
        slope = first * max(t, 0.0) ** (2 - alpha) - second * max(t, 0.0) ** (1 - alpha)
        return slope + 2 * tau * t - tau**2 - tau - y + z[0]

    past = hd.Delay(tau, past=lambda t: t * t - t)
    return hd.Equation(hd.Caputo(alpha), rhs, 0.0, memory=past)


@pytest.mark.parametrize("alpha", [0.5, 0.9])
def test_a_known_past(alpha):
    found = hd.solve(manufactured(alpha), 5.0, rtol=1e-8)
    assert found.y[:, 0] == pytest.approx(found.t**2 - found.t, abs=1e-8)
    assert found.stats["n_steps"] < 150


def smooth(t, y, z, p):
    return p[0] * y - z[0] + p[1] * np.cos(t)


@pytest.mark.parametrize("tau", [0.5, 0.53])
@pytest.mark.parametrize("scheme", GIVEN, ids=repr)
def test_given_steps_converge_to_the_solution_of_a_tolerance(scheme, tau):
    """Delayed values of rows have at least the order of the scheme's own first steps."""
    equation = hd.Equation(hd.Caputo(0.8), smooth, 1.0, [-0.5, 0.4], memory=hd.Delay(tau))
    exact = hd.solve(equation, 4.0, rtol=1e-10).y[-1, 0]
    coarse, fine = (
        abs(hd.solve(equation, 4.0, n, scheme=scheme).y[-1, 0] - exact) for n in (400, 1600)
    )
    assert fine < 2e-3
    assert fine < coarse / 3 or fine < 1e-6


def growing(t, y, z, p):
    return p[0] * y * (1 - z[0])


@cache
def reacts():
    return hd.Equation(hd.Caputo(0.9), growing, 0.5, [1.5], memory=hd.Delay(1.0))


TIGHT = {"rtol": 1e-8}
END = 5.0


def end(equation=None, **how):
    return hd.solve(equation or reacts(), END, **(how or TIGHT)).y[-1, 0]


def test_mackey_and_glass():
    times, values = zip(*MACKEY_GLASS.items(), strict=True)
    found = hd.solve(mackey_glass(), 60.0, rtol=1e-9, t_eval=times).y[:, 0]
    assert found == pytest.approx(values, abs=2e-8)


def test_switches():
    def relayed(t, y, z):
        return -0.8 * z[0] + (0.5 if y[0] > 0.0 else 0.0)

    equation = hd.Equation(hd.Caputo(0.9), relayed, 1.0, memory=hd.Delay(1.0))
    found = end(equation, switches=lambda t, y: y[0], **TIGHT)
    assert found == pytest.approx(end(equation, n_steps=20_000, scheme=hd.BDF(2)), abs=1e-5)


def test_resumed_runs_have_the_past_of_one_delay():
    """Also where the equation ran between the two parts."""
    first = hd.solve(reacts(), 2.3, scheme=hd.Collocation(horizon=END), **TIGHT)
    state, whole = pickle.loads(pickle.dumps(first)).state, end()
    assert end(resume=state) == pytest.approx(whole, abs=1e-9)
    scheme = hd.BDF(2)
    half = hd.solve(reacts(), 2.5, 250, scheme=scheme)
    state = pickle.loads(pickle.dumps(half)).state
    assert end(resume=state) == end(n_steps=500, scheme=scheme)


@pytest.mark.parametrize("tau", [0.1, 0.75, 1.23])
@pytest.mark.parametrize("scheme", GIVEN, ids=repr)
def test_resumed_runs_on_given_steps_are_equal_to_the_bit(scheme, tau):
    equation = hd.Equation(hd.Caputo(0.8), lambda t, y, z: -1.4 * z[0], 1.0, memory=hd.Delay(tau))
    fire = event(lambda t, y: y[0] - 0.3, change=lambda t, y: y + 0.5)
    for how in ({}, {"events": fire}):
        whole = completed(equation, 4.0, 400, scheme=scheme, **how)
        for n in (37, 75, 200):
            half = completed(equation, n / 100, n, scheme=scheme, **how)
            rest = completed(equation, 4.0, resume=half.state, **how)
            assert np.array_equal(rest.y[-200:], whole.y[-200:])


@pytest.mark.parametrize("gap", [1e-12, 1e-10, 1e-8])
@pytest.mark.parametrize("order", [0.6, 1.0])
def test_two_delays_that_nearly_meet_make_no_error(order, gap):
    def slope(t, y, late):
        return -0.8 * late[0] + 0.5 * late[1] - 0.3 * y

    one, two = (
        hd.Equation(hd.Caputo(order), slope, 0.7, memory=[hd.Delay(1.0), hd.Delay(1.0 + apart)])
        for apart in (0.0, gap)
    )
    for rtol in (1e-4, 1e-6):
        found, near = (completed(each, 5.0, rtol=rtol).y[-1, 0] for each in (two, one))
        assert found == pytest.approx(near, abs=rtol + 10 * gap**order)


@pytest.mark.parametrize("n", [2, 8, 32])
@pytest.mark.parametrize("scheme", [hd.ProductTrapezoid(), hd.Adams(), hd.L2Sigma()], ids=repr)
def test_the_value_at_the_start_is_read_a_delay_later(scheme, n):
    """The rule of these schemes is exact for y' = 1 + 100 (t - 1), up to t = 1."""
    past = hd.Delay(1.0, past=lambda t: 1 + 100 * t)
    equation = hd.Equation(hd.Caputo(1), lambda t, y, z: z[0], 1.0, memory=past)
    assert completed(equation, 1.0, n, scheme=scheme).y[-1, 0] == pytest.approx(-48.0, abs=1e-9)


@pytest.mark.parametrize("p", [3, 4, 5])
def test_first_steps_of_higher_order_see_the_past(p):
    late = lambda t, y, z: -np.exp(-5.0) * z[0]  # noqa: E731
    past = hd.Delay(5.0, past=lambda t: np.exp(-t))
    given = hd.Equation(hd.Caputo(1), late, 1.0, memory=past)
    same = hd.Equation(hd.Caputo(1), lambda t, y: -np.exp(-t), 1.0)
    found, forced = (completed(each, 2.0, 64, scheme=hd.BDF(p)).y for each in (given, same))
    np.testing.assert_allclose(found, forced, atol=1e-9)


def test_only_what_a_run_reads_of_a_past_has_to_exist():
    def past(t):
        if not -0.5 <= t <= 0:
            raise ValueError("outside of the data")
        return 1.0 + t

    equation = hd.Equation(hd.Caputo(0.8), lambda t, y, z: -z[0], 1.0, memory=hd.Delay(0.5, past))
    for how in ({"rtol": 1e-8}, {"n_steps": 100}):
        half = completed(equation, 1.0, **how)
        assert completed(equation, 2.0, resume=half.state)
    long = hd.Delay(1e4, past=np.cos)
    sine = hd.Equation(hd.Caputo(1), lambda t, y, z: z[0], 0.0, memory=long)
    exact = np.sin(1.0 - 1e4) - np.sin(-1e4)
    assert completed(sine, 1.0, rtol=1e-8).y[-1, 0] == pytest.approx(exact, abs=1e-8)


STEPS = {"n_steps": 8000, "scheme": hd.BDF(2)}


def level(t, y):
    return y[0] - 1.2


level.terminal = 3


def test_events_and_changes():
    found, rough = (hd.solve(reacts(), END, events=level, **how) for how in (TIGHT, STEPS))
    assert found.t_events[0].size == 3
    assert found.t_events[0] == pytest.approx(rough.t_events[0], abs=1e-4)
    later = hd.solve(reacts(), END, events=level, scheme=hd.Collocation(horizon=END), **TIGHT)
    assert later.status == "event"
    assert end(resume=later.state) == pytest.approx(end(), abs=1e-9)
    lifted, rough = (end(changes={2.0: lambda t, y: y + 0.3}, **how) for how in (TIGHT, STEPS))
    assert lifted == pytest.approx(rough, abs=2e-4)


def test_members_and_fits():
    for how in (TIGHT, {"n_steps": 2000, "scheme": hd.BDF(2)}):
        members = hd.ensemble(reacts(), END, params=[[1.0], [1.5]], **how).y[:, -1, 0]
        alone = [end(reacts().replace(params=[p]), **how) for p in (1.0, 1.5)]
        assert members == pytest.approx(alone, abs=1e-12)

    def model(tau):
        return reacts().replace(memory=hd.Delay(tau))

    times = np.linspace(0.2, END, 30)
    data = hd.solve(model(0.8), END, rtol=1e-10, t_eval=times).y
    found = hd.fit(model, times, data, {"tau": 1.0})
    assert found.parameters["tau"] == pytest.approx(0.8, abs=1e-6)


def several(t, y, z):
    return -z[0] + 0.3 * z[1] - 0.2 * z[2]


SEVERAL = [hd.Delay(1.0), hd.Caputo(0.4), hd.Delay(0.37, past=lambda t: 1 + t)]
VARYING = hd.Delay(lambda t: 1 + 0.5 * np.sin(t), past=np.cos)
OTHERS = {
    "several": lambda: hd.Equation(hd.Caputo(0.9), several, 1.0, memory=SEVERAL),
    "varying": lambda: hd.Equation(hd.Caputo(0.9), lambda t, y, z: -z[0], 1.0, memory=VARYING),
    "complex": lambda: hd.Equation(
        hd.Caputo(0.9), lambda t, y, z: 1j * z[0], 1.0 + 0j, memory=hd.Delay(1.0)
    ),
    "later": lambda: hd.Equation(
        hd.Caputo(0.9), lambda t, y, z: -z[0] + np.sin(t), 1.0, memory=VARYING, t_start=3.0
    ),
    "above 1": lambda: hd.Equation(
        hd.Caputo(1.8), lambda t, x, z: -x - 0.3 * z[0], [1.0, 0.2], memory=hd.Delay(1.0)
    ),
    "two": lambda: hd.Equation(
        hd.Caputo([0.9, 0.7]),
        lambda t, y, z: np.array([-z[0, 1], z[0, 0] - y[1]]),
        [1.0, 0.5],
        memory=hd.Delay(0.8, past=[0.9, 0.5]),
    ),
}


@pytest.mark.parametrize("name", OTHERS)
def test_other_delays(name):
    equation = OTHERS[name]()
    last = equation.t_start + END
    tight = hd.solve(equation, last, rtol=1e-10).y[-1]
    assert hd.solve(equation, last, rtol=1e-7).y[-1] == pytest.approx(tight, abs=1e-6)
    steps = hd.solve(equation, last, 8000, scheme=hd.BDF(2)).y[-1]
    assert steps == pytest.approx(tight, abs=3e-4)


def test_a_right_hand_side_in_python_and_a_jacobian():
    with pytest.warns(hd.PythonFunctionWarning):
        called = reacts().replace(rhs=lambda t, y, z, p: [p[0] * float(str(y[0])) * (1 - z[0, 0])])
    assert end(called, rtol=1e-6) == pytest.approx(end(), abs=1e-6)

    def jac(t, y, z, p):
        return np.array([[p[0] * (1 - z[0, 0])]])

    def jac_memory(t, y, z, p):
        return np.array([[-p[0] * y[0]]])

    given = hd.Equation(
        hd.Caputo(0.9), growing, 0.5, [1.5], jac, memory=hd.Delay(1.0), jac_memory=jac_memory
    )
    assert end(given) == pytest.approx(end(), abs=1e-9)


def test_plots_of_the_delayed_value():
    axes = hd.plots.phase_portrait(hd.solve(reacts(), END, **TIGHT), delay=1.0)
    x, y = axes.lines[0].get_data()
    assert x[0] == pytest.approx(hd.solve(reacts(), END, **TIGHT)(1.0)[0], abs=1e-6)
    assert y[0] == pytest.approx(0.5)


def mackey_glass_with_tangent():
    """Mackey and Glass's equation, and its derivative by y0 and by the past, which is y0."""

    def rhs(t, y, late):
        x, tangent = late[0]
        power = x**9.65
        slope = (1 + power - 9.65 * power) / (1 + power) ** 2
        return 2 * np.array([x / (1 + power), slope * tangent]) - y

    return hd.Equation(hd.Caputo(0.95), rhs, [0.5, 1.0], memory=hd.Delay(2.0))


@pytest.mark.parametrize("renorm", [None, 0.5, 5.0])
@pytest.mark.parametrize("scheme", [hd.ExplicitCaputo(), hd.Adams(), hd.BDF(2), hd.L1()], ids=repr)
def test_pairs_grow_as_the_tangent(scheme, renorm):
    exact = hd.solve(mackey_glass_with_tangent(), 40.0, 2000, scheme=scheme).y[:, 1]
    found = hd.lyapunov(
        mackey_glass(), 40.0, 2000, mode="pair", scheme=scheme, renorm=renorm, verify=False,
        directions=[[1.0]],
    )  # fmt: skip
    assert found.times.size > 5
    steps = np.rint(found.times / 0.02).astype(int)
    # next to zeros of the tangent orbits are drawn far apart
    allowed = 1e-4 * np.abs(exact).max()
    assert np.exp(found.log_growth[:, 0]) == pytest.approx(np.abs(exact[steps]), abs=allowed)
    assert found.y[0] == pytest.approx(hd.solve(mackey_glass(), 40.0, 2000, scheme=scheme).y[-1, 0])


WHOLE = hd.Delay(1.0)
SWINGING = hd.Delay(lambda t: 1 + 0.5 * np.sin(t))


@pytest.mark.parametrize(
    "memory",
    [[WHOLE], [hd.Delay(0.61), SWINGING], [WHOLE, hd.Caputo(0.4)]],
    ids=["one", "two", "beside memory"],
)
@pytest.mark.parametrize("order", [0.7, 1.0, 1.8, 2.0])
def test_pairs_of_a_linear_equation_grow_as_a_solution(order, memory):
    """Also with other parameters than it was made with."""

    def equation(initial):
        rhs = lambda t, y, z, p: 0.4 * z[0] - p[0] * z[-1] - 0.2 * y  # noqa: E731
        return hd.Equation(hd.Caputo(order), rhs, initial, [9.0], memory=memory)

    direction, how = np.array([0.6, 0.8] if order > 1 else [1.0]), {"params": [0.3]}
    found = hd.lyapunov(
        equation(0.5 * direction).replace(**how), 10.0, 1000, mode="pair", renorm=0.25,
        verify=False, directions=direction[:, None], separation=1e-3,
    )  # fmt: skip
    scheme = found.settings["scheme"]
    moved = hd.solve(equation(direction).replace(**how), 10.0, 1000, scheme=scheme)
    tangent = np.column_stack([moved.y, moved.ydot] if order > 1 else [moved.y])
    exact = np.linalg.norm(tangent[np.rint(found.times / 0.01).astype(int)], axis=1)
    # inside the first two steps, delayed values come from parabolas
    allowed = 1e-8 if WHOLE in memory else 1e-5
    assert np.exp(found.log_growth[:, 0]) == pytest.approx(exact, abs=allowed)


def simple(**delay):
    return hd.Equation(hd.Caputo(0.9), lambda t, y, z: -z[0], 1.0, memory=hd.Delay(**delay))


def late_in_the_past(wrong):
    past = lambda t: 1.0 if t < -0.5 else wrong  # noqa: E731
    return hd.solve(simple(tau=1.0, past=past), 3.0, **TIGHT)


REFUSED = [
    (lambda: hd.Delay(0.0), "tau must be a finite number above 0"),
    (lambda: simple(tau=1.0, past=[1.0, 2.0]), "past must be finite at t = -1, one number or s"),
    (lambda: simple(tau=1.0, past=lambda t: np.nan), "past must be finite at t = -1"),
    (lambda: simple(tau=1.0, past=lambda t: 1 / 0), "past must be defined at t = -1"),
    (lambda: simple(tau=lambda t: 1 / 0), "tau must be defined at t = 0"),
    (lambda: simple(tau=lambda t: -1.0), r"tau.t., least. with a least one above 0"),
    (
        lambda: hd.solve(simple(tau=lambda t: 0.2 * np.sin(t + 1) ** 2), 9.0),
        r"tau must stay above 0, got tau.* take max.tau.t., least.",
    ),
    *(  # the value at t = -1, where a past is looked at first, is right
        (lambda w=wrong: late_in_the_past(w), "past must be finite at t = -0.")
        for wrong in (np.nan, None, "1", [1.0, 2.0])
    ),
    (lambda: simple(tau=1.0, past=1j), "real where y0 is"),
    (lambda: hd.solve(simple(tau=lambda t: -1.0), 3.0), "tau must stay above 0, got tau.0. = -1"),
    (
        lambda: hd.solve(simple(tau=lambda t: 1 - 0.4 * t), 4.0),
        "tau must stay above 0, got tau.2.5",
    ),
    (lambda: hd.solve(simple(tau=lambda t: 1 + 2 * t), 3.0), "tau must grow slower than t"),
    (lambda: hd.solve(simple(tau=0.1), 5.0, 40), "tau must be at least a step h on given steps"),
    (lambda: hd.lyapunov(reacts(), 2.0, **TIGHT), 'mode must be "pair" with delays'),
    (lambda: hd.lyapunov(reacts(), 2.0, mode="pair", **TIGHT), 'mode must be "tangent" with Coll'),
    (lambda: reacts().jacobian(0.0, [0.5]), "rhs must read no memory"),
    (
        lambda: hd.plots.phase_portrait(hd.solve(reacts(), END, **TIGHT), delay=9.0),
        "delay must be shorter than the solution",
    ),
]
OF_A_WRONG_KIND = [
    (lambda: hd.Delay(lambda t, y: y[0]), "tau must be a function of t alone, got tau.t, y."),
    (lambda: hd.Delay(1.0, lambda t, y: y), "past must be a function of t alone"),
    (lambda: simple(tau=lambda t: None), "tau must return one number, got None at t = 0"),
    (lambda: simple(tau=lambda t: [1.0, 2.0]), "tau must return one number"),
    (lambda: simple(tau=lambda t: "1"), "tau must return one number"),
]


@pytest.mark.parametrize(
    ("call", "kind", "words"),
    [(call, ValueError, words) for call, words in REFUSED]
    + [(call, TypeError, words) for call, words in OF_A_WRONG_KIND],
)
def test_refusals(call, kind, words):
    with pytest.raises(kind, match=words):
        call()


def test_a_delay_in_a_formula():
    shown = hd.Equation(hd.Caputo(0.9), several, 1.0, memory=[*SEVERAL[:2], VARYING])._repr_html_()
    assert "y(t &minus; 1)" in shown
    assert "y(t &minus; tau(t))" in shown
    assert repr(hd.Delay(2.0, past=[1.0, 2.0])) == "Delay(2.0, past=[1., 2.])"


def crossing(t, y, late):
    return late[0, 0].real


@pytest.mark.parametrize(
    ("how", "error"), [(TIGHT, 1e-9), ({"n_steps": 4000, "scheme": hd.BDF(2)}, 1e-4)], ids=str
)
@pytest.mark.parametrize("y0", [1.0, 1.0 + 0.2j])
@pytest.mark.parametrize("tau", [0.7, lambda t: 0.7 + 0.2 * np.sin(t)])
def test_an_event_of_the_delayed_value_is_that_of_y_a_delay_later(tau, y0, how, error):
    eq = hd.Equation(
        hd.Caputo(0.9), lambda t, y, z: -1.7 * z[0], y0, memory=hd.Delay(tau), t_start=2.0
    )
    sol = hd.solve(eq, 14.0, events=[crossing, lambda t, y: y[0].real], **how)
    late, own = sol.t_events
    ago = late - np.array([tau(t) if callable(tau) else tau for t in late])
    assert late.size >= 3
    assert np.abs(ago - own[: late.size]).max() < error
    part = hd.solve(
        eq, 8.0, events=crossing, **how | {"n_steps": how.get("n_steps", 0) // 2 or None}
    )
    rest = hd.solve(eq, 14.0, events=crossing, resume=part.state)
    np.testing.assert_allclose(np.append(part.t_events[0], rest.t_events[0]), late, atol=error)


def test_an_event_that_reads_a_delay_switches_a_heater():
    """The sensor sees 0.5 one time unit late; between switches y is 2 or 0 and an exponential."""

    def warm(t, y, late):
        return late[0, 0] - 0.5

    warm.change = lambda t, y: np.array([y[0], 1.0 - y[1]])

    def heated(t, y, late):
        return np.array([2.0 * y[1] - y[0], 0.0])

    eq = hd.Equation(hd.Caputo(1), heated, [0.0, 1.0], memory=hd.Delay(1.0))
    sol = hd.solve(eq, 8.0, rtol=1e-9, events=warm)
    first = np.log(4 / 3) + 1
    top = 2 * (1 - np.exp(-first))
    second = first + np.log(top / 0.5) + 1
    low = top * np.exp(first - second)
    third = second + np.log((2 - low) / 1.5) + 1
    assert np.abs(sol.t_events[0][:3] - [first, second, third]).max() < 1e-7


def test_delays_beside_algebraic_rows():
    """The row without a derivative is what the other one reads late."""
    rows = np.array([1.0, 0.0]) * hd.Caputo(0.8)

    def split(t, y, z):
        return np.array([-y[1], z[0, 0] - y[1]])

    both = hd.Equation(rows, split, [1.0, 1.0], memory=hd.Delay(1.0))
    alone = hd.Equation(hd.Caputo(0.8), lambda t, y, z: -z[0], 1.0, memory=hd.Delay(1.0))
    assert end(both) == pytest.approx(end(alone), abs=1e-9)


@pytest.mark.parametrize("how", [TIGHT, {"n_steps": 4000, "scheme": hd.L1()}], ids=str)
def test_delays_beside_kernels(how):
    """Without the delay's coefficient it is another equation's solution."""
    terms = hd.Caputo(0.9) + hd.Memory(hd.Prony([1.0], [0.5]), 0)
    late = hd.Equation(terms, lambda t, y, z: -y + 0.0 * z[0], 1.0, memory=hd.Delay(0.7))
    plain = hd.Equation(terms, lambda t, y: -y, 1.0)
    assert end(late, **how) == pytest.approx(end(plain, **how), abs=1e-9)


def forced(t, y, z, p):
    return p[0] * z[0] + p[1] * z[1] + (p[2] if t >= p[3] else 0.0)


GAINS = (-1.0, -0.3)


def sums(order, taus, t, shift):
    """Sum over i and j of binomials, powers of the gains, and the power ``n order + shift`` of
    ``t - i tau_1 - j tau_2``, over its gamma function; n = i + j."""
    m, n = (np.arange(max(t[-1], 0.0) / tau + 1) for tau in taus)
    m, n = m[:, None, None], n[:, None]
    left, power = t - m * taus[0] - n * taus[1], (m + n) * order + shift
    factor = binom(m + n, n) * GAINS[0] ** m * GAINS[1] ** n / gamma(power + 1)
    terms = np.where(left > 1e-12, factor * np.maximum(left, 1e-12) ** power, 0.0)
    return terms.sum(axis=(0, 1))


def forced_at(order, taus, t, at, force, lift):
    """y of D^order y = `forced` from a past of 1; at `at` a force sets in, and y is lifted."""
    found = 1 + sum(GAINS) * sums(order, taus, t, order)
    return found + force * sums(order, taus, t - at, order) + lift * sums(order, taus, t - at, 0.0)


DECIMALS = [
    (0.1, 0.3),
    (0.2, 0.6),
    (0.7, 2.1),
    (0.1, 0.7),
    (0.25, 0.75),
    (0.3, 0.1),
    (0.15, 0.2),
    (0.05, 0.35),
]
START = [0.0, 1.7]


@pytest.mark.parametrize("t_start", START)
@pytest.mark.parametrize("order", [0.6, 1.0])
@pytest.mark.parametrize("taus", DECIMALS, ids=str)
def test_delays_breaks_and_changes_on_a_decimal_grid(taus, order, t_start):
    """Times that differ by rounding are one time: sums of delays, breaks, changes and the end."""
    unit, end = taus[0], round(9 * taus[0], 10)
    times = np.linspace(0.1 * unit, end, 50)
    memory = [hd.Delay(tau) for tau in taus]

    for k in (3, 6, 8):
        at = round(k * unit, 10)
        params = [*GAINS, 2.0, t_start + at]
        equation = hd.Equation(
            hd.Caputo(order), forced, 1.0, params, memory=memory, t_start=t_start
        )
        for lift in (0.0, 0.5):
            how = {"changes": {t_start + at: lambda t, y: y + 0.5}} if lift else {}
            found = completed(equation, t_start + end, rtol=1e-7, breaks=[t_start + at], **how)
            assert found.stats["n_steps"] < 400
            exact = forced_at(order, taus, times, at, 2.0, lift)
            away = np.abs(times - at) > 1e-9
            missed = np.abs(found(t_start + times)[:, 0] - exact)[away]
            assert missed.max() < 1e-6 * np.abs(exact).max()


DATA = 1 + 0.3 * np.random.default_rng(0).normal(size=51)
AT_DATA = np.linspace(-1, 0, DATA.size)
INTEGRAL = np.append(0, np.cumsum((DATA[1:] + DATA[:-1]) / 2 * np.diff(AT_DATA)))


def of_data(t):
    """Return the integral of the data from -1 to t - 1."""
    k = np.clip(np.searchsorted(AT_DATA, t - 1) - 1, 0, DATA.size - 2)
    over = t - 1 - AT_DATA[k]
    slope = (DATA[k + 1] - DATA[k]) / (AT_DATA[k + 1] - AT_DATA[k])
    return INTEGRAL[k] + over * (DATA[k] + 0.5 * slope * over)


PASTS = {
    "a jump": (lambda t: 1.0 if t > -0.37 else 0.0, lambda t: np.maximum(t - 0.63, 0)),
    "a jump at a half": (lambda t: 1.0 if t >= -0.5 else 0.0, lambda t: np.maximum(t - 0.5, 0)),
    "a pulse": (lambda t: 1.0 if -0.5 < t < -0.4 else 0.0, lambda t: np.clip(t - 0.5, 0, 0.1)),
    "a pulse of two thousandths": (
        lambda t: 1.0 if -0.5 < t < -0.498 else 0.0,
        lambda t: np.clip(t - 0.5, 0, 0.002),
    ),
    "fast": (lambda t: np.cos(100 * t), lambda t: (np.sin(100 * (t - 1)) + np.sin(100)) / 100),
    "a corner": (lambda t: abs(t + 0.3), lambda t: (0.49 + (t - 0.7) * np.abs(t - 0.7)) / 2),
    "data": (lambda t: np.interp(t, AT_DATA, DATA), of_data),
    "a root": (lambda t: np.sqrt(t + 1), lambda t: t**1.5 / 1.5),
}


@pytest.mark.parametrize("name", PASTS)
def test_pasts_are_met_to_the_tolerance(name):
    past, exact = PASTS[name]
    equation = hd.Equation(hd.Caputo(1), lambda t, y, z: z[0], 0.0, memory=hd.Delay(1.0, past))
    times = np.linspace(0.01, 1.0, 300)
    size = np.abs(exact(times)).max()
    for rtol in (1e-4, 1e-8):
        found = completed(equation, 1.0, rtol=rtol)
        assert np.abs(found(times)[:, 0] - exact(times)).max() < rtol * size
    # the implicit Euler rule: half a step times the variation of the past
    steps = hd.solve(equation, 1.0, 4000, scheme=hd.BDF(1), t_eval=times).y[:, 0]
    variation = np.abs(np.diff([past(t) for t in np.linspace(-1, -1e-9, 5000)])).sum()
    assert np.abs(steps - exact(times)).max() < 2 * (1 + variation) / 4000


@pytest.mark.parametrize("order", [0.4, 0.8, 1.0])
def test_a_jump_of_a_past_is_a_kink_after_each_delay(order):
    equation = hd.Equation(
        hd.Caputo(order), lambda t, y, z: -z[0], 0.0,
        memory=hd.Delay(1.0, lambda t: 1.0 if t > -0.37 else 0.0),
    )  # fmt: skip
    times, exact = np.linspace(0.2, 6.0, 60), np.zeros(60)
    for n in range(7):
        power = (n + 1) * order
        for first, sign in ((0.63, 1.0), (1.0, -1.0)):
            left = np.maximum(times - first - n, 0.0)
            exact += sign * (-1.0) ** (n + 1) * left**power / gamma(power + 1)
    found = hd.solve(equation, 6.0, rtol=1e-8)
    assert found(times)[:, 0] == pytest.approx(exact, abs=1e-7)


@pytest.mark.parametrize("high", ["as wide", "as y0"])
@pytest.mark.parametrize("d", [1, 4])
def test_short_ramps_of_a_past_are_met_to_the_tolerance(d, high):
    """The past is 0 up to a ramp before the start, whose width is drawn."""
    random, units = np.random.default_rng(d), 10.0 ** np.linspace(0, -9, d)
    for width in 10.0 ** random.uniform(-9, -2, 4):
        height = width if high == "as wide" else 1.0

        def past(t, width=width, height=height):
            return height * units * max(0.0, 1 + t / width)

        def difference(t, y, z):
            return units - z[0]

        late = hd.Equation(hd.Caputo(1), difference, height * units, memory=hd.Delay(0.5, past))
        # y' = 1 but for the area of the ramp; then y' = 1 - height - (t - 0.5)
        exact = height + 0.5 - 0.5 * width * height + 0.25 * (1 - height) - 0.5 * 0.25**2
        for rtol in (1e-6, 1e-10):
            found = completed(late, 0.75, rtol=rtol)
            assert len(found.t) < 300
            assert found.y[-1] == pytest.approx(exact * units, rel=rtol)


def test_a_past_that_is_too_fast_for_its_table_warns():
    """The warning says by how much the past is missed, and where."""
    noise = hd.Equation(
        hd.Caputo(1), lambda t, y, z: z[0], 0.0, memory=hd.Delay(1.0, lambda t: np.sin(1e9 * t))
    )
    with pytest.warns(hd.SolveWarning, match=r"too fast: at t = -0\.\d+ it is missed by [1-3] of"):
        hd.solve(noise, 0.01, 10)


def clock(t, y, z):
    return np.array([1.0, z[0, 0]])


VARYING_DELAYS = {
    "slow": (lambda t: 0.3 + 0.15 * np.sin(5 * t), lambda t: 0.3 * t + 0.03 * (1 - np.cos(5 * t))),
    "a corner": (
        lambda t: 1 + 0.3 * abs(t - 2),
        lambda t: t + 0.15 * (4 + (t - 2) * np.abs(t - 2)),
    ),
    "a jump downwards": (
        lambda t: 1.0 if t < 1.3 else 0.4,
        lambda t: np.where(t < 1.3, t, 1.3 + 0.4 * (t - 1.3)),
    ),
    "bounded below": (
        lambda t: max(1 - 0.5 * t, 0.2),
        lambda t: np.where(t < 1.6, t - 0.25 * t**2, 0.96 + 0.2 * (t - 1.6)),
    ),
}


@pytest.mark.parametrize("name", VARYING_DELAYS)
def test_delays_that_vary_are_met_to_the_tolerance(name):
    """The clock t, read late and integrated, shows the integral of the delay."""
    tau, integral = VARYING_DELAYS[name]
    equation = hd.Equation(
        hd.Caputo(1), clock, [0.0, 0.0], memory=hd.Delay(tau, lambda t: [t, 0.0])
    )
    found = completed(equation, 4.0, rtol=1e-8)
    assert found.y[:, 1] == pytest.approx(found.t**2 / 2 - integral(found.t), abs=1e-8)


@pytest.mark.parametrize(
    "tau",
    [
        lambda t: 0.3 + 0.25 * np.sin(5 * t),
        lambda t: 0.3 + 0.29 * np.sin(12 * t),
        lambda t: 0.4 if t < 1.3 else 1.0,
        lambda t: 0.4 if t < 1.3 else 0.401,
    ],
    ids=["fast", "faster", "a jump upwards", "a small one"],
)
@pytest.mark.parametrize("how", [{"rtol": 1e-6}, {"n_steps": 400}], ids=str)
def test_delays_that_grow_faster_than_t_somewhere_are_refused(tau, how):
    with pytest.raises(ValueError, match="tau must grow slower than t"):
        hd.solve(simple(tau=tau), 4.0, **how)


def balance(t, y, z):
    return np.array([y[1], 0.5 * z[0, 1] + np.cos(t) - y[1]])


@pytest.mark.parametrize("first", [1.0, 0.7])
def test_algebraic_rows_carry_jumps_on_as_long_as_the_run_lasts(first):
    """p = p(t - 1) / 2 + cos t from p = `first`: a jump at each delay, and a neutral y' = p."""
    rows = np.array([1.0, 0.0]) * hd.Caputo(1)
    equation = hd.Equation(
        rows, balance, [0.0, 0.5 * first + 1], memory=hd.Delay(1.0, [0.0, first])
    )
    found = completed(equation, 20.0, rtol=1e-8)
    times = np.linspace(0.05, 19.95, 200)
    n = np.floor(times).astype(int)
    exact = first * 0.5 ** (n + 1.0)
    for k in range(20):
        exact += np.where(k <= n, 0.5**k * np.cos(times - k), 0.0)
    assert found(times)[:, 1] == pytest.approx(exact, abs=1e-7)


def neutral(t, z, late):
    y, p = z
    return np.array([p, -y - 0.5 * late[0, 1] - p])


@pytest.mark.parametrize("order", [0.3, 0.4, 0.5, 0.6])
def test_neutral_equations_say_what_rounding_hides(order):
    """The tolerance that the message names completes."""
    rows = np.array([1.0, 0.0]) * hd.Caputo(order)
    late = hd.Delay(1.0, past=[1.0, 0.0])
    equation = hd.Equation(rows, neutral, [1.0, -1.0], memory=late)
    ended = warned(r"within the rounding of t.* or eliminate the row", equation, 2.9, rtol=1e-10)
    assert ended.status == "step_too_small"
    rtol = float(re.search(r"take an rtol of (\S+)", ended.message)[1])
    found = completed(equation, 2.9, rtol=rtol)
    plain = hd.Equation(
        hd.Caputo(order),
        lambda t, y, z: -y + 0.5 * (t >= 1) * z[0] - 0.25 * (t >= 2) * z[1],
        1.0,
        memory=[hd.Delay(1.0, past=0.0), hd.Delay(2.0, past=0.0)],
    )
    exact = hd.solve(plain, 2.9, rtol=1e-8, breaks=[1.0, 2.0]).y[-1, 0]
    assert found.y[-1, 0] == pytest.approx(exact, rel=rtol)


def loop(t, x, late, p):
    error = p[0] + (p[3] if t >= p[4] else 0.0) - late[0, 0]
    force = min(max(p[1] * error + p[2] * x[2], -2.0), 2.0)
    return np.array([x[1], force - 0.6 * x[1] - x[0], error])


@pytest.mark.parametrize("order", [0.6, 0.9, 1.0])
def test_loops_at_rest_resolve_no_rounding(order):
    """A loop rests to the last bit, with as many steps as at 0, where nothing is rounded."""
    counts = []
    for rest in (0.0, 0.3, 0.7):
        start = [rest, 0.0, 2 * rest]
        equation = hd.Equation(
            hd.Caputo(order), loop, start, [rest, 1.0, 0.5, 0.0, 1.0], memory=hd.Delay(0.2)
        )
        found = completed(equation, 10.0, rtol=1e-9)
        assert np.abs(found.y - start).max() < 1e-14
        counts.append(found.stats["n_steps"])
    assert max(counts) < 1.5 * min(counts)


def test_loops_with_a_setpoint_that_jumps_and_saturation_complete():
    for k, tau in ((3, 0.1), (8, 0.1), (15, 0.2), (9, 0.7), (14, 0.4)):
        for gain in (0.5, 10.0):
            at = round(k * tau, 10)
            equation = hd.Equation(
                hd.Caputo(0.8), loop, [0.3, 0.0, 0.6], [0.3, gain, 0.5, 0.5, at],
                memory=hd.Delay(tau),
            )  # fmt: skip
            found = completed(equation, 10.0, rtol=1e-6, breaks=[at])
            assert found.stats["n_steps"] < 600
            tight = hd.solve(equation, 10.0, rtol=1e-9, breaks=[at])
            assert found.y[-1] == pytest.approx(tight.y[-1], abs=1e-4)
