"""Bad input: refused before any run, in one wording."""

import math
from functools import partial

import numpy as np
import pytest

import hereditary as hd


def decay(t, y):
    return -y


@pytest.mark.parametrize("order", [0, -0.5, 20.1, math.nan, math.inf, [0.5, 0.0], [[0.5]], []])
def test_orders(order):
    with pytest.raises(ValueError, match="order must"):
        hd.Caputo(order)


@pytest.mark.parametrize("order", ["a", 1j, None, True])
def test_orders_that_are_no_numbers(order):
    with pytest.raises(TypeError, match="order must"):
        hd.Caputo(order)


@pytest.mark.parametrize("coefficient", [math.nan, math.inf, "a", 1j, None, [[1.0, 2.0]]])
def test_coefficients(coefficient):
    with pytest.raises((TypeError, ValueError), match="coefficient must"):
        coefficient * hd.Caputo(0.5)


def test_coefficients_of_all_kinds():
    for coefficient in (2, 2.0, np.float64(2.0), np.array(2.0)):
        assert (coefficient * hd.Caputo(0.5)).coefficient == 2.0
        assert (hd.Caputo(0.5) * coefficient).coefficient == 2.0
    assert (-hd.Caputo(0.5)).coefficient == -1.0
    assert (-(2 * hd.Caputo(0.5))).coefficient == -2.0
    assert (3 * (2 * hd.Caputo(0.5))).coefficient == 6.0
    assert (np.array([1.0, 2.0]) * hd.Caputo(0.5)).coefficient.tolist() == [1.0, 2.0]


@pytest.mark.parametrize("terms", [[], 0.5, ["D"], None, [hd.Caputo(0.5), 1.0]])
def test_terms(terms):
    with pytest.raises((TypeError, ValueError), match="terms must"):
        hd.Equation(terms, decay, 1.0)


@pytest.mark.parametrize(
    ("order", "y0", "match"),
    [
        (0.5, math.nan, "y0 must be real, finite numbers, got nan"),
        (0.5, [1.0, math.inf], "y0 must be real, finite"),
        (0.5, complex(1.0, math.nan), "y0 must be finite numbers, got nan"),
        (2.1, [1.0, 0.0], r"y0 must hold y\(0\), y'\(0\) and y''\(0\), shape \(3, d\)"),
        (0.5, "one", "y0 must"),
        (0.5, [[1.0], [2.0]], r"y0 must hold y\(0\), shape \(1, d\), got shape \(2, 1\)"),
        (0.5, [[1.0], [2.0]], r"orders up to 1 need y\(0\) alone, its components in a row"),
        (1.5, 1.0, r"y0 must hold y\(0\) and y'\(0\), shape \(2, d\), got 1.; .*\[1.0, 0.0\]"),
        (1.5, [1.0, 2.0, 3.0], r"got shape \(3,\); for 3 components give two rows"),
        (1.5, [[1.0, 2.0]], r"got shape \(1, 2\)"),
        (1.5, [[[1.0]]], r"got shape \(1, 1, 1\)"),
        (1.5, [[1.0], [2.0, 3.0]], "y0 must"),
        (0.5, [], r"got shape \(0,\)"),
        ([0.5, 0.6], [1.0, 2.0, 3.0], r"order must be one number or one for each of the 3"),
        ([1.5, 0.6], [[1.0, 2.0], [0.0, 3.0]], r"got y0\[1\]\[1\] = 3.0; set it to 0"),
    ],
)
def test_initial_values(order, y0, match):
    with pytest.raises((TypeError, ValueError), match=match):
        hd.Equation(hd.Caputo(order), decay, y0)


def test_shorthands_of_initial_values():
    for order, y0, shape in (
        (0.5, 1, (1, 1)),
        (0.5, [1], (1, 1)),
        (0.5, [1, 2, 3], (1, 3)),
        (0.5, [[1, 2, 3]], (1, 3)),
        (1.5, (1, 2), (2, 1)),
        (1.5, [[1], [2]], (2, 1)),
        (1.5, [[1, 2], [3, 4]], (2, 2)),
    ):
        assert hd.Equation(hd.Caputo(order), decay, y0).y0.shape == shape


def test_a_component_without_a_term_is_refused():
    terms = [np.array([1.0, 0.0]) * hd.Caputo(0.5)]
    with pytest.raises(ValueError, match="none for component 1"):
        hd.Equation(terms, decay, [1.0, 2.0])


@pytest.mark.parametrize("params", [[[1.0]], math.nan, [math.nan], "abc", [1j], {"a": 1.0}])
def test_params(params):
    with pytest.raises((TypeError, ValueError), match="params must"):
        hd.Equation(hd.Caputo(0.5), lambda t, y, p: -y, 1.0, params=params)


def test_one_parameter_may_be_a_number():
    for params in (2, 2.0, np.float64(2.0), [2.0], (2,), np.array([2.0])):
        eq = hd.Equation(hd.Caputo(0.5), lambda t, y, p: -p[0] * y, 1.0, params=params)
        assert eq.params.tolist() == [2.0]


def run(**change):
    arguments = {"equation": hd.scenes.relaxation(), "t_end": 1.0, "n_steps": 10} | change
    return hd.solve(**arguments)


@pytest.mark.parametrize(
    ("change", "error", "match"),
    [
        ({"n_steps": 0}, ValueError, "n_steps must be a positive integer, got 0"),
        ({"n_steps": -3}, ValueError, "n_steps must be a positive integer, got -3"),
        ({"n_steps": 2.5}, TypeError, "n_steps must be a positive integer, got 2.5"),
        ({"n_steps": True}, TypeError, "n_steps must"),
        ({"n_steps": None, "scheme": hd.L1()}, TypeError, "n_steps must be given"),
        ({"n_steps": 10**40}, ValueError, r"n_steps must be at most 9e\+15, .*, got 1e\+40"),
        ({"n_steps": 10**13}, ValueError, "save_every must keep as many rows as fit in memory"),
        ({"t_end": 5e-324}, ValueError, "t_end must leave steps h .* another unit of time"),
        ({"t_end": 0.0}, ValueError, "t_end must be a finite number above 0, got 0.0"),
        ({"t_end": -1.0}, ValueError, "t_end"),
        ({"t_end": math.inf}, ValueError, "t_end must be a finite number above 0, got inf"),
        ({"t_end": math.nan}, ValueError, "t_end"),
        ({"t_end": "late"}, TypeError, "t_end"),
        ({"t_end": [1.0]}, TypeError, "t_end"),
        ({"equation": 5}, TypeError, "equation must be an Equation"),
        ({"scheme": "explicit"}, TypeError, "scheme must be a Scheme"),
        ({"scheme": hd.L1}, TypeError, r"a Scheme, got the class L1; write L1\(...\)"),
        ({"history": hd.Direct}, TypeError, r"a History, got the class Direct; write Direct\("),
        ({"history": "direct"}, TypeError, "history must be a History"),
        ({"save_every": 0}, ValueError, "save_every must be a positive integer"),
        ({"save_every": 1.5}, TypeError, "save_every"),
        ({"t_eval": [0.5, 0.2]}, ValueError, "t_eval must be increasing times"),
        ({"t_eval": [0.5, 2.0]}, ValueError, "t_eval"),
        ({"t_eval": [-0.5]}, ValueError, "t_eval"),
        ({"t_eval": []}, ValueError, "t_eval"),
        ({"t_eval": [math.nan]}, ValueError, "t_eval"),
        ({"resume": "state"}, TypeError, "resume must be a State"),
        ({"steps": 10}, TypeError, "steps"),
    ],
)
def test_solve(change, error, match):
    with pytest.raises(error, match=match):
        run(**change)


def test_what_is_accepted_besides():
    """Whole floats, one time, and rows so rare that the ends alone are kept."""
    assert np.array_equal(run(n_steps=1e1).y, run().y)
    assert np.array_equal(run(t_eval=1.0).y, run().y[-1:])
    assert run(save_every=10**20).t.tolist() == [0.0, 1.0]


@pytest.mark.parametrize("history", [hd.Direct(), hd.FFT()])
def test_a_past_that_does_not_fit_in_memory(history):
    with pytest.raises(ValueError, match="history must hold 100000000000000 steps in memory"):
        run(n_steps=10**14, save_every=10**13, history=history)


@pytest.mark.parametrize("t_end", [1e-300, 1e300])
def test_steps_whose_powers_are_no_numbers(t_end):
    equation = hd.Equation(hd.Caputo(1.5), decay, [1.0, 0.0])
    with pytest.raises(ValueError, match="t_end must leave steps h whose power h"):
        run(equation=equation, t_end=t_end)


def test_save_every_and_t_eval_exclude_each_other():
    with pytest.raises(ValueError, match="save_every must"):
        run(save_every=2, t_eval=[0.5])


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"history": hd.Direct()}, "same history"),
        ({"history": hd.SumOfExponentials(1e-8)}, "same history"),
        ({"equation": hd.scenes.relaxation(alpha=0.6)}, "same orders"),
        ({"equation": hd.Equation(2 * hd.Caputo(0.5), decay, 1.0)}, "same coefficients"),
        ({"equation": hd.Equation(hd.Caputo(0.5), decay, [1.0, 1.0])}, "same coefficients"),
        ({"t_end": 0.5}, "t_end must exceed the state's time 1"),
        ({"t_end": 1.0}, "t_end must exceed"),
        ({"t_end": 2.03}, "whole number of the state's steps"),
        ({"n_steps": 7}, "n_steps must be 10"),
        ({"scheme": hd.L1()}, "same scheme"),
        ({"equation": hd.scenes.relaxation(y0=2.0)}, "same y0"),
        ({"equation": hd.scenes.relaxation(rate=2.0)}, "same params"),
        ({"equation": hd.Equation(hd.Caputo(0.5), decay, 1.0, [-1.0])}, "same right-hand side"),
    ],
)
def test_resuming_with_something_else(change, match):
    state = run().state
    with pytest.raises(ValueError, match=match):
        run(**({"t_end": 2.0, "n_steps": None, "resume": state} | change))


def test_unknown_keywords():
    for call in (
        lambda: hd.Equation(hd.Caputo(0.5), decay, 1.0, parameters=()),
        lambda: hd.Caputo(alpha=0.5),
        lambda: hd.SumOfExponentials(tolerance=1e-8),
        lambda: hd.scenes.stick_slip(b=1.0),
        lambda: hd.ExplicitCaputo(h=0.1),
    ):
        with pytest.raises(TypeError, match="unexpected keyword"):
            call()


@pytest.mark.parametrize("well", [[], [[1.0]], ["a"], [math.nan]])
def test_wells(well):
    with pytest.raises((TypeError, ValueError), match="well must"):
        hd.scenes.stick_slip(well=well)


def test_scene_parameters():
    for name in ("friction", "omega", "spring_speed", "adhesion"):
        with pytest.raises(ValueError, match=f"{name} must"):
            hd.scenes.stick_slip(**{name: math.nan})


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: hd.scenes.oscillator(beta=1.0), r"beta must lie in \(1, 2\], got 1.0"),
        (lambda: hd.scenes.oscillator(gamma=1.5), r"gamma must lie in \(0, 1\], got 1.5"),
        (lambda: hd.scenes.relaxation(alpha=1.5), r"alpha must lie in \(0, 1\], got 1.5"),
        (lambda: hd.scenes.stick_slip(beta=0.9), r"beta must lie in \(1, 2\], got 0.9"),
        (lambda: hd.scenes.stick_slip(x0=[1, 2]), "x0 must"),
    ],
)
def test_scenes_keep_to_their_ranges(make, match):
    with pytest.raises((TypeError, ValueError), match=match):
        make()


def test_messages_stay_short():
    with pytest.raises(ValueError, match="t_eval must") as caught:
        run(t_eval=np.linspace(0, 2, 100_000))
    assert len(str(caught.value)) < 300


def test_an_order_may_cross_1_where_d_is_stated():
    for order in (0.8, 0.99, 1.0, 1.01, 1.6, 2.4):
        eq = hd.Equation(hd.Caputo(order), decay, [1.0, 0.5, 0.0], d=1)
        rows = math.ceil(order)
        plain = hd.Equation(hd.Caputo(order), decay, [1.0, 0.5, 0.0][:rows])
        ours, theirs = (hd.solve(e, 1.0, rtol=1e-8).y[-1] for e in (eq, plain))
        assert np.array_equal(ours, theirs)
        assert np.array_equal(hd.solve(eq.replace(d=1), 1.0, rtol=1e-8).y[-1], ours)
    two = [[1.0, 2.0], [0.5, 0.6]]
    eq = hd.Equation(hd.Caputo([1.5, 0.6]), decay, two, d=2)
    assert eq.y0.tolist() == [[1.0, 2.0], [0.5, 0.0]]
    crossed = eq.replace(terms=hd.Caputo([0.5, 1.6]))
    assert crossed.y0.tolist() == [[1.0, 2.0], [0.0, 0.6]]
    for y0, d, told in (
        ([1.0, 2.0, 3.0], 2, r"y0 must hold at least 2 rows of 2.*got shape \(3,\)"),
        (1.0, 1, "y0 must hold at least 2 rows of 1.*got 1."),
        (two, 3, r"got shape \(2, 2\)"),
        (two, 0, "d must be a positive integer"),
    ):
        with pytest.raises(ValueError, match=told):
            hd.Equation(hd.Caputo(1.5), decay, y0, d=d)


def linear(t, y, p):
    return -p[0] * y


LINEAR = hd.Equation(hd.Caputo(0.7), linear, 1.0, params=[1.0])
MASKED = np.ma.array([0.5, 1.0], mask=[False, True])
LOOKUP = {"level": 0.5}


def velocity(t, x):
    return -x[0] - 0.3 * x[1]


def noisy(t, y):
    return -y + np.random.default_rng().normal()


def looked_up(t, y):
    return y[0] - LOOKUP.get("level")


def fit(**change):
    t, data = [0.1, 0.2, 0.5], [0.9, 0.8, 0.6]
    return hd.fit(lambda r: LINEAR.replace(params=[r]), t, data, {"r": 1.0}, **change)


def fit_an_order():
    t = np.linspace(0.1, 3.0, 10)
    hd.fit(lambda a: hd.Equation(hd.Caputo(a), decay, [1.0, 0.0], d=1), t, 5.0 * t, {"a": 0.1})


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        # a name for an object
        (partial(run, scheme="L1"), TypeError, ["scheme must be a Scheme", "'L1'", "hd.L1()"]),
        (partial(run, scheme="bdf2"), TypeError, ["hd.BDF()"]),
        (partial(run, scheme="explicit"), TypeError, ["hd.ExplicitCaputo()"]),
        (partial(run, scheme="IMEX"), TypeError, ["hd.IMEX(...)"]),
        (partial(run, scheme="Radau"), TypeError, ["pass hereditary.ExplicitCaputo()"]),
        (partial(run, history="FFT"), TypeError, ["history must be a History", "hd.FFT()"]),
        # keywords of other solvers
        (partial(run, t0=1.0), TypeError, ["t0 must be left out", "t_start"]),
        (partial(run, t_span=(0, 1)), TypeError, ["t_span must", "t_start", "solve(eq, t_end)"]),
        (partial(run, method="RK45"), TypeError, ["method must", "scheme="]),
        # numbers that are none, or too large
        (partial(hd.solve, LINEAR, 1.0, rtol=1), ValueError, ["rtol must lie", "rtol=1e-6"]),
        (partial(hd.solve, LINEAR, 1.0, rtol="1e-6"), TypeError, ["rtol must lie", "a number"]),
        (lambda: hd.solve(LINEAR, 1e308, resume=hd.solve(LINEAR, 1.0, 10).state),
         ValueError, ["t_end must be at most 9e+15 steps h = 0.1", "1e+308"]),
        (partial(hd.lyapunov, LINEAR, 2.0, 200, renorm=1e300), ValueError, ["renorm must be at"]),
        (partial(hd.lyapunov, LINEAR, 2.0, 200, renorm=1e308), ValueError, ["renorm must be at"]),
        (partial(hd.sensitivities, LINEAR, 1e-320, 20), ValueError, ["another unit of time"]),
        (partial(hd.lyapunov, LINEAR, 1e-320, rtol=1e-6, scheme=hd.Collocation()),
         ValueError, ["another unit of time"]),
        # functions
        (partial(hd.Equation, hd.Caputo(1.8), velocity, [1.0, 0.0]),
         ValueError, ["two write [[y(0)", "memory=hd.Caputo(1)", "(t, y, memory)", "memory[0, 0]"]),
        (partial(hd.Equation, hd.Caputo(1.8), velocity, [[1.0], [0.0]]),
         ValueError, ["memory=hd.Caputo(1)", "memory[0, 0]"]),
        (partial(hd.Equation, hd.Caputo(0.8), noisy, 1.0),
         ValueError, ["rhs must give equal values for equal t, y", "random numbers", "at line"]),
        (partial(run, rtol=1e-6, n_steps=None, switches=looked_up),
         TypeError, ["switches must", "LOOKUP", "numba cannot compile it at line"]),
        (partial(hd.Kernel, lambda t: np.exp(-t), signed="abc"), TypeError, ["signed must be"]),
        (partial(hd.memory_term, True, 0.1, hd.L1(), 1.0), TypeError, ["an order alpha", "True"]),
        # fits
        (partial(fit, observe=np.diff), ValueError, ["shape (3,)", "got shape (3, 0)"]),
        (partial(fit, observe=[1]), ValueError, ["observe must be numbers of components, 0 to 0"]),
        (partial(fit, observe=0.5), ValueError, ["observe must be numbers of components"]),
        (partial(fit, observe=[-1]), ValueError, ["observe must be numbers of components"]),
        (partial(fit, observe=True), ValueError, ["observe must be numbers of components"]),
        (fit_an_order, ValueError, ["order must lie in (0, 20]", "from model at a = 0", "bounds="]),
    ],
)  # fmt: skip
def test_messages_say_what_to_write(call, error, words):
    with pytest.raises(error) as caught:
        call()
    missing = [word for word in words if word not in str(caught.value)]
    assert not missing, str(caught.value)


def test_the_hint_on_a_velocity_is_right():
    def hinted(t, x, memory):
        return -x[0] - 0.3 * memory[0, 0]

    start, classical = [1.0, 0.0], hd.Caputo(1.8) + 0.3 * hd.Caputo(1)
    ours = hd.solve(hd.Equation(hd.Caputo(1.8), hinted, start, memory=hd.Caputo(1)), 5.0, rtol=1e-8)
    theirs = hd.solve(hd.Equation(classical, decay, start), 5.0, rtol=1e-8)
    assert ours.y[-1] == pytest.approx(theirs.y[-1], abs=1e-7)


@pytest.mark.parametrize(
    "read",
    [
        partial(hd.Equation, hd.Caputo(0.7), decay),
        lambda y0: hd.Equation(hd.Caputo(0.7), decay, 1j * y0),
        lambda y0: hd.Equation(hd.Caputo(0.7), decay, [y0, y0]),
        lambda params: LINEAR.replace(params=params),
        lambda order: hd.Caputo(order),
        lambda coefficient: coefficient * hd.Caputo(0.5),
        lambda t_eval: run(t_eval=t_eval),
        lambda mesh: run(mesh=np.ma.concatenate([[0.0], mesh]), n_steps=None, scheme=hd.L1()),
        lambda breaks: run(breaks=breaks),
        lambda components: run(components=np.ma.array([0, 0], mask=components.mask)),
        lambda t: run()(t),
        lambda y0: hd.ensemble(LINEAR, 1.0, 10, y0=y0),
        lambda linear: hd.Equation(hd.Caputo(0.7), None, [1, 1], linear=np.ma.stack([linear] * 2)),
        lambda rates: hd.Prony(rates, [1.0, 1.0]),
        lambda t: hd.Kernel.from_table(np.ma.concatenate([t, [2.0, 3.0]]), [4.0, 3.0, 2.0, 1.0]),
        hd.zero_one_test,
        hd.power_spectrum,
        lambda sigma: fit(sigma=np.ma.concatenate([[1.0], sigma])),
        lambda a: hd.sweep(lambda a: {"a": a}, {"a": a}),
    ],
)
def test_masked_entries_are_refused(read):
    with pytest.raises(ValueError, match="got masked entries; leave these entries out, or fill"):
        read(MASKED)


def test_masked_arrays_without_masked_entries_are_arrays():
    equation = hd.Equation(hd.Caputo(0.7), decay, np.ma.array([1.0, 2.0], mask=False))
    assert equation.y0.tolist() == [[1.0, 2.0]]
