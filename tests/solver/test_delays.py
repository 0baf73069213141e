"""Delays that the right-hand side reads, to a tolerance and on given steps."""

import pickle

import matplotlib
import numpy as np
import pytest
from cases import GIVEN
from problems import MACKEY_GLASS, delayed_growth, delayed_growth_at, mackey_glass
from scipy.special import gamma

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
        found = hd.solve(delayed_growth(alpha, k), 10.0, rtol=rtol)
        assert found.success
        assert np.abs(found(times)[:, 0] - exact).max() < 10 * rtol * size
        assert found.stats["n_steps"] < 400


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


REACTS = hd.Equation(hd.Caputo(0.9), growing, 0.5, [1.5], memory=hd.Delay(1.0))
TIGHT = {"rtol": 1e-8}
END = 5.0


def end(equation=REACTS, **how):
    return hd.solve(equation, END, **(how or TIGHT)).y[-1, 0]


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
    first = hd.solve(REACTS, 2.3, scheme=hd.Collocation(horizon=END), **TIGHT)
    state = pickle.loads(pickle.dumps(first)).state
    assert hd.solve(REACTS, END, resume=state).y[-1, 0] == pytest.approx(end(), abs=1e-9)
    scheme = hd.BDF(2)
    half = hd.solve(REACTS, 2.5, 250, scheme=scheme)
    state = pickle.loads(pickle.dumps(half)).state
    whole = hd.solve(REACTS, END, 500, scheme=scheme).y[-1]
    assert np.array_equal(hd.solve(REACTS, END, resume=state).y[-1], whole)


STEPS = {"n_steps": 8000, "scheme": hd.BDF(2)}


def test_events():
    def level(t, y):
        return y[0] - 1.2

    found, rough = (hd.solve(REACTS, END, events=level, **how) for how in (TIGHT, STEPS))
    assert len(found.t_events[0]) == 3
    assert found.t_events[0] == pytest.approx(rough.t_events[0], abs=1e-4)


def test_a_run_resumed_from_an_event():
    def level(t, y):
        return y[0] - 1.2

    level.terminal = True
    stopped = hd.solve(REACTS, END, events=level, scheme=hd.Collocation(horizon=END), **TIGHT)
    assert stopped.status == "event"
    assert hd.solve(REACTS, END, resume=stopped.state).y[-1, 0] == pytest.approx(end(), abs=1e-9)


def test_changes():
    def lift(t, y):
        return y + 0.3

    found, rough = (
        hd.solve(REACTS, END, changes={2.0: lift}, **how).y[-1, 0] for how in (TIGHT, STEPS)
    )
    assert found == pytest.approx(rough, abs=2e-4)


def test_breaks():
    assert end(breaks=[1.7], **TIGHT) == pytest.approx(end(), abs=1e-9)


def test_members_sweeps_and_fits():
    for how in (TIGHT, {"n_steps": 2000, "scheme": hd.BDF(2)}):
        members = hd.ensemble(REACTS, END, params=[[1.0], [1.5]], **how).y[:, -1, 0]
        for member, p in zip(members, (1.0, 1.5), strict=True):
            assert member == pytest.approx(end(REACTS.replace(params=[p]), **how), abs=1e-12)
    times = np.linspace(0.2, END, 30)

    def model(tau):
        return REACTS.replace(memory=hd.Delay(tau))

    data = hd.solve(model(0.8), END, rtol=1e-10, t_eval=times).y
    assert hd.fit(model, times, data, {"tau": 1.0}).parameters["tau"] == pytest.approx(
        0.8, abs=1e-6
    )


def test_runs_of_one_equation_have_tables_of_their_own():
    """A run between two parts of another one does not move its tables."""
    outer = hd.solve(REACTS, 2.3, scheme=hd.Collocation(horizon=END), **TIGHT)
    hd.solve(REACTS, END, **TIGHT)
    assert hd.solve(REACTS, END, resume=outer.state).y[-1, 0] == pytest.approx(end(), abs=1e-9)


def several(t, y, z):
    return -z[0] + 0.3 * z[1] - 0.2 * z[2]


SEVERAL = [hd.Delay(1.0), hd.Caputo(0.4), hd.Delay(0.37, past=lambda t: 1 + t)]
VARYING = hd.Delay(lambda t: 1 + 0.5 * np.sin(t), past=np.cos)
OTHERS = [
    hd.Equation(hd.Caputo(0.9), several, 1.0, memory=SEVERAL),
    hd.Equation(hd.Caputo(0.9), lambda t, y, z: -z[0], 1.0, memory=VARYING),
    hd.Equation(hd.Caputo(0.9), lambda t, y, z: 1j * z[0], 1.0 + 0j, memory=hd.Delay(1.0)),
    hd.Equation(
        hd.Caputo(0.9), lambda t, y, z: -z[0] + np.sin(t), 1.0, memory=VARYING, t_start=3.0
    ),
    hd.Equation(hd.Caputo(1.8), lambda t, x, z: -x - 0.3 * z[0], [1.0, 0.2], memory=hd.Delay(1.0)),
    hd.Equation(
        hd.Caputo([0.9, 0.7]),
        lambda t, y, z: np.array([-z[0, 1], z[0, 0] - y[1]]),
        [1.0, 0.5],
        memory=hd.Delay(0.8, past=[0.9, 0.5]),
    ),
]


@pytest.mark.parametrize(
    "equation", OTHERS, ids=["several", "varying", "complex", "later", "above 1", "two"]
)
def test_other_delays(equation):
    last = equation.t_start + END
    tight = hd.solve(equation, last, rtol=1e-10).y[-1]
    assert hd.solve(equation, last, rtol=1e-7).y[-1] == pytest.approx(tight, abs=1e-6)
    steps = hd.solve(equation, last, 8000, scheme=hd.BDF(2)).y[-1]
    assert steps == pytest.approx(tight, abs=3e-4)


def test_a_right_hand_side_in_python_and_a_jacobian():
    def spoken(t, y, z, p):
        return [p[0] * float(str(y[0])) * (1 - z[0, 0])]

    with pytest.warns(hd.PythonFunctionWarning):
        called = REACTS.replace(rhs=spoken)
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
    axes = hd.plots.phase_portrait(hd.solve(REACTS, END, **TIGHT), delay=1.0)
    x, y = axes.lines[0].get_data()
    assert x[0] == pytest.approx(hd.solve(REACTS, END, **TIGHT)(1.0)[0], abs=1e-6)
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


@pytest.mark.parametrize("delays", [[WHOLE], [hd.Delay(0.61), SWINGING]], ids=len)
@pytest.mark.parametrize("order", [0.7, 1.0, 1.8, 2.0])
def test_pairs_of_a_linear_equation_grow_as_a_solution(order, delays):
    def rhs(t, y, late):
        return 0.4 * late[0] - 0.3 * late[-1] - 0.2 * y

    def equation(initial):
        return hd.Equation(hd.Caputo(order), rhs, initial, memory=delays)

    direction = np.array([0.6, 0.8] if order > 1 else [1.0])
    found = hd.lyapunov(
        equation(0.5 * direction), 10.0, 1000, mode="pair", renorm=0.25, verify=False,
        directions=direction[:, None], separation=1e-3,
    )  # fmt: skip
    scheme = found.settings["scheme"]
    moved = hd.solve(equation(direction), 10.0, 1000, scheme=scheme)
    tangent = np.column_stack([moved.y, moved.ydot] if order > 1 else [moved.y])
    exact = np.linalg.norm(tangent[np.rint(found.times / 0.01).astype(int)], axis=1)
    # inside the first two steps, delayed values come from parabolas
    allowed = 1e-8 if delays == [WHOLE] else 1e-5
    assert np.exp(found.log_growth[:, 0]) == pytest.approx(exact, abs=allowed)


def test_pairs_beside_other_memory_and_with_other_parameters():
    memory = [hd.Delay(1.0), hd.Caputo(0.4)]
    slow = hd.Equation(
        hd.Caputo(0.9), lambda t, y, z, p: -p[0] * z[0] - 0.1 * z[1], 1.0, [1.0], memory=memory
    )
    equation, how = slow.replace(params=[2.0]), {"scheme": hd.BDF(2)}
    found = hd.lyapunov(
        equation, 10.0, 1000, mode="pair", renorm=0.3, verify=False, directions=[[1.0]], **how
    )
    exact = np.abs(hd.solve(equation, 10.0, 1000, **how).y[:, 0])
    at = np.rint(found.times / 0.01).astype(int)
    assert np.exp(found.log_growth[:, 0]) == pytest.approx(exact[at], abs=1e-6)


def simple(**delay):
    return hd.Equation(hd.Caputo(0.9), lambda t, y, z: -z[0], 1.0, memory=hd.Delay(**delay))


REFUSED = [
    (lambda: hd.Delay(0.0), "tau must be a finite number above 0"),
    (
        lambda: simple(tau=1.0, past=[1.0, 2.0]),
        r"past must be finite at t = -1, one number or shape",
    ),
    (lambda: simple(tau=1.0, past=lambda t: np.nan), "past must be finite at t = -1"),
    (lambda: simple(tau=1.0, past=lambda t: 1 / 0), "past must be defined at t = -1"),
    (lambda: simple(tau=1.0, past=1j), "real where y0 is"),
    (lambda: hd.solve(simple(tau=lambda t: -1.0), 3.0), "tau must stay above 0, got tau.0. = -1"),
    (lambda: hd.solve(simple(tau=lambda t: 1 - 0.4 * t), 4.0), "tau must stay above 0, got tau.4."),
    (lambda: hd.solve(simple(tau=lambda t: 1 + 2 * t), 3.0), "tau must grow slower than t"),
    (lambda: hd.solve(simple(tau=0.1), 5.0, 40), "tau must be at least a step h on given steps"),
    (lambda: hd.lyapunov(REACTS, 2.0, **TIGHT), 'mode must be "pair" with delays'),
    (lambda: hd.lyapunov(REACTS, 2.0, mode="pair", **TIGHT), 'mode must be "tangent" with Coll'),
    (lambda: REACTS.jacobian(0.0, [0.5]), "rhs must read no memory"),
    (
        lambda: hd.plots.phase_portrait(hd.solve(REACTS, END, **TIGHT), delay=9.0),
        "delay must be shorter than the solution",
    ),
]


@pytest.mark.parametrize(("call", "words"), REFUSED, ids=[words for _, words in REFUSED])
def test_refusals(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_a_delay_in_a_formula():
    shown = hd.Equation(hd.Caputo(0.9), several, 1.0, memory=[*SEVERAL[:2], VARYING])._repr_html_()
    assert "y(t &minus; 1)" in shown
    assert "y(t &minus; tau(t))" in shown
    assert repr(hd.Delay(2.0, past=[1.0, 2.0])) == "Delay(2.0, past=[1., 2.])"


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
