"""Bad input: refused before any run, in one wording."""

import inspect
import math
import re
from functools import partial

import numpy as np
import pytest
from refusals import BAD, MASKED, PRONY, decay, linear, run
from refused_analyses import ROWS as ANALYSES
from refused_equations import ROWS as EQUATIONS
from refused_runs import ROWS as RUNS

import hereditary as hd
from hereditary import viscoelastic

T = np.linspace(1.0, 2.0, 9)


def fading(rate):
    return linear().replace(params=[rate])


CALLS = {
    "solve": run,
    "resume": lambda **change: run(
        **{"n_steps": None, "t_end": 2.0, "resume": run().state} | change
    ),
    "tolerance": lambda **change: hd.solve(linear(), 1.0, **change),
    "dense output": lambda **change: run()(0.5, **change),
    "lyapunov": lambda **change: hd.lyapunov(linear(), **{"t_end": 1.0, "n_steps": 40} | change),
    "sensitivities": lambda **change: hd.sensitivities(linear(), 1.0, **{"rtol": 1e-4} | change),
    "ensemble": lambda **change: hd.ensemble(
        linear(), **{"t_end": 1.0, "n_steps": 9, "params": [1.0, 2.0]} | change
    ),
    "fit": lambda **change: hd.fit(
        **{"model": fading, "t": T, "data": np.exp(-T), "p0": {"rate": 1.0}} | change
    ),
    "moduli": lambda **change: viscoelastic.fit_moduli(
        **{"model": viscoelastic.spring, "omega": T, "storage": T, "loss": T} | change
    ),
    "stiffness": viscoelastic.spring(1.0).stiffness,
    "data": partial(hd.derivative, T, T**2, hd.Caputo(0.5)),
    "function": partial(hd.derivative, T, np.square, hd.Caputo(0.5)),
    "memory": partial(hd.Memory, PRONY),
    "exponent": lambda **change: hd.PowerLaw(**change),
    "modes": hd.SumOfExponentials,
    "nodes": hd.Collocation,
    "solve_ivp": lambda **change: hd.solve_ivp(decay, (0.0, 1.0), [1.0], **change),
    "convergence": lambda **change: hd.convergence_table(linear(), 1.0, [4, 8], **change),
    "sweep": lambda **change: hd.sweep(lambda x: x, {"x": [1.0]}, **{"progress": False} | change),
    "duffing": hd.scenes.duffing,
    "diffusion": partial(hd.scenes.subdiffusion, 0.5, 3),
}
POSITIVE, COUNT, REAL = "a finite number above 0", "a positive integer", "a finite real number"
# What arguments that are one number must be.
NUMBERS = {
    "solve": {"t_end": POSITIVE, "n_steps": COUNT, "save_every": COUNT},
    "resume": {"t_end": POSITIVE},
    "tolerance": {
        "rtol": "lie in [1e-12, 0.1]", "max_step": POSITIVE, "max_steps": COUNT, "save_every": COUNT
    },
    "lyapunov": {
        "t_end": POSITIVE, "n_steps": COUNT, "k": COUNT, "renorm": POSITIVE, "separation": POSITIVE,
        "window": "lie in (0, 1]", "transient": "lie in [0, t_end)",
    },
    "ensemble": {"t_end": POSITIVE, "n_steps": COUNT, "threads": COUNT, "workers": COUNT},
    "data": {"t_start": REAL},
    "function": {"t_start": REAL},
    "exponent": {"exponent": "lie in (0, 2]"},
    "modes": {"tol": "lie in [1e-13, 0.1]", "horizon": POSITIVE},
    "nodes": {"horizon": POSITIVE},
    "solve_ivp": {"rtol": "lie in [1e-12, 0.1]"},
}  # fmt: skip
# Those of which other values than one number are taken, or no words are shared.
OTHERS = {
    "tolerance": ("atol",),
    "dense output": ("derivative",),
    "stiffness": ("s",),
    "memory": ("derivative",),
    "solve_ivp": ("atol", "max_step"),
    "diffusion": ("dimensions",),
}
# Bad values of each kind of number, and the exceptions.
OF_TYPE = [(value, TypeError) for value in (True, "one", 1j, [1.0])]
OF_REALS = [*OF_TYPE, (math.nan, ValueError), (math.inf, ValueError)]
OF_RANGES = [*OF_REALS, (0.0, ValueError), (-1.0, ValueError), (1e3, ValueError)]
VALUES = {
    "lie in [0, t_end)": [*OF_REALS, (-1.0, ValueError), (1e3, ValueError)],
    REAL: OF_REALS,
    POSITIVE: [*OF_REALS, (0.0, ValueError), (-1.0, ValueError)],
    COUNT: [*OF_TYPE, (2.5, TypeError), (math.nan, TypeError), (0, ValueError), (-3, ValueError)],
}
WORDS = {
    "solve": ("allow_change", "estimate", "progress", "changes"),
    "resume": ("allow_change",),
    "dense output": ("derivative",),
    "lyapunov": ("mode", "verify", "progress"),
    "sensitivities": ("wrt",),
    "ensemble": ("progress",),
    "fit": ("loss", "model", "bounds"),
    "moduli": ("p0", "bounds", "model"),
    "data": ("t_start",),
    "memory": ("derivative",),
    "solve_ivp": ("dense_output", "method"),
    "convergence": ("at_end",),
    "sweep": ("carry", "progress"),
    "duffing": ("riemann_liouville",),
    "diffusion": ("dimensions",),
}


def pairs(table):
    return [(call, name) for call, names in table.items() for name in names]


@pytest.mark.parametrize(("call", "name"), pairs(NUMBERS))
def test_other_values_than_a_number_of_its_kind_are_refused(call, name):
    kind = NUMBERS[call][name]
    words = kind if kind.startswith("lie") else f"be {kind}"
    for value, error in VALUES.get(kind, OF_RANGES):
        with pytest.raises(error, match="^" + re.escape(f"{name} must {words}, got ")):
            CALLS[call](**{name: value})


@pytest.mark.parametrize(("call", "name"), pairs(NUMBERS) + pairs(OTHERS))
def test_integers_beyond_double_precision_are_refused(call, name):
    with pytest.raises(BAD, match=f"{name} must") as caught:
        CALLS[call](**{name: 10**400})
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(("call", "name"), pairs(WORDS))
@pytest.mark.parametrize(
    "value", [np.array(["a", "b"]), MASKED, 3.5, "abc", object()], ids=lambda v: type(v).__name__
)
def test_what_is_neither_of_the_choices_is_refused(call, name, value):
    more = {"p0": {"modulus": 1.0}} if call == "moduli" else {}
    with pytest.raises(BAD, match=f"{name} must"):
        CALLS[call](**more | {name: value})


# Functions that lack some arguments of `solve`; the other arguments do not matter.
LACKING = (
    hd.convergence_table, hd.derivative, hd.ensemble, hd.frequency_response, hd.lyapunov,
    hd.memory_term, hd.sensitivities, hd.sweep, hd.solve_ivp,
)  # fmt: skip


@pytest.mark.parametrize("function", LACKING, ids=lambda f: f.__name__)
def test_an_argument_that_only_solve_takes_is_refused_with_a_remedy(function):
    own = inspect.signature(function).parameters.values()
    required = [decay] * sum(p.default is p.empty and p.kind is not p.VAR_KEYWORD for p in own)
    of_solve = inspect.signature(hd.solve).parameters.values()
    names = {p.name for p in of_solve if p.default is not p.empty} - {p.name for p in own}
    assert len(names) > 3
    for name in names:
        with pytest.raises(
            TypeError, match=f"{name} must be left out of {function.__name__}, got"
        ) as caught:
            function(*required, **{name: 0.125})
        assert re.search(r"0\.125; .*\w", str(caught.value))


@pytest.mark.parametrize(
    ("call", "name", "remedy"),
    [
        (partial(hd.solve, None, 1.0), "n_step", "write n_steps="),
        (partial(hd.solve, None, 1.0), "method", "pass scheme="),
        (partial(hd.solve, None, 1.0), "args", "pass params="),
        (partial(hd.solve, None, 1.0), "foo", "see help(hereditary.solve)"),
        (partial(hd.ensemble, None, 1.0), "nsteps", "write n_steps="),
        (partial(hd.ensemble, None, 1.0), "dt", "pass n_steps, for steps of"),
        (partial(hd.ensemble, None, 1.0), "n_workers", "write workers="),
        (partial(hd.sensitivities, None, 1.0), "args", "Equation(..., params=args) has them"),
        (partial(hd.lyapunov, None, 1.0), "t0", "Equation(..., t_start=t0) sets the start"),
        (partial(hd.memory_term, 0.5), "dt", "see help(hereditary.memory_term)"),
    ],
)
def test_a_keyword_that_no_argument_has_is_refused_with_a_remedy(call, name, remedy):
    words = f"{name} must be left out of {call.func.__name__}, got 0.125; {remedy}"
    with pytest.raises(TypeError, match=re.escape(words)):
        call(**{name: 0.125})


@pytest.mark.parametrize("value", [1, 0, True, False, np.True_])
def test_truth_may_be_a_number(value):
    assert np.array_equal(run(estimate=value).y, run().y)


def test_memory_of_data_begins_with_them():
    found = hd.derivative(T, T**2, hd.Caputo(0.5))
    assert np.array_equal(hd.derivative(T, T**2, hd.Caputo(0.5), t_start=T[0]), found)
    with pytest.raises(ValueError, match=r"t_start must be left out for data"):
        hd.derivative(T, T**2, hd.Caputo(0.5), t_start=0.5)


@pytest.mark.parametrize("row", [*EQUATIONS, *RUNS, *ANALYSES])
def test_refusals(row):
    call, words, error = (*row, ValueError)[:3]
    with pytest.raises(error, match=words):
        call()


def test_coefficients_of_all_kinds():
    for coefficient in (2, 2.0, np.float64(2.0), np.array(2.0)):
        assert (coefficient * hd.Caputo(0.5)).coefficient == 2.0
        assert (hd.Caputo(0.5) * coefficient).coefficient == 2.0
    assert (-hd.Caputo(0.5)).coefficient == -1.0
    assert (-(2 * hd.Caputo(0.5))).coefficient == -2.0
    assert (3 * (2 * hd.Caputo(0.5))).coefficient == 6.0
    assert (np.array([1.0, 2.0]) * hd.Caputo(0.5)).coefficient.tolist() == [1.0, 2.0]


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


def test_one_parameter_may_be_a_number():
    for params in (2, 2.0, np.float64(2.0), [2.0], (2,), np.array([2.0])):
        eq = hd.Equation(hd.Caputo(0.5), lambda t, y, p: -p[0] * y, 1.0, params=params)
        assert eq.params.tolist() == [2.0]


def test_what_is_accepted_besides():
    """Whole floats, one time, and rows so rare that the ends alone are kept."""
    assert np.array_equal(run(n_steps=1e1).y, run().y)
    assert np.array_equal(run(t_eval=1.0).y, run().y[-1:])
    assert run(save_every=10**20).t.tolist() == [0.0, 1.0]
    assert hd.BDF(order=3) == hd.BDF(3)


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


def test_masked_arrays_without_masked_entries_are_arrays():
    equation = hd.Equation(hd.Caputo(0.7), decay, np.ma.array([1.0, 2.0], mask=False))
    assert equation.y0.tolist() == [[1.0, 2.0]]
