"""Representations in notebooks, and names that completion shows."""

import inspect
import io
import itertools
import re
from functools import partial
from html.parser import HTMLParser

import numpy as np
import pytest

import hereditary as hd


class Balance(HTMLParser):
    """Checks that tags close in order, and keeps the text."""

    def __init__(self, page):
        super().__init__()
        self.open, self.text, self.rows = [], "", 0
        self.feed(page)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.rows += tag == "tr"
        if tag != "img":
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def spring(t, x):
    return -x


def friction(t, x, memory):
    return -x - memory[0]


def ageing(t):
    return 0.5 + 0.1 * np.sin(t)


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (lambda: hd.Equation(hd.Caputo(1.8) + 0.25 * hd.Caputo(0.8), spring, [1.0, 0.0]),
         "D1.8 y + 0.25 D0.8 y = spring(t, y)one component, from t = 0 on"),
        (lambda: hd.Equation(hd.Caputo([0.5, 1.0]), spring, [1.0, 0.0]),
         "D(0.5, 1) y = spring(t, y)2 components, from t = 0 on"),
        (lambda: hd.Equation(hd.Caputo(1.8), friction, [1.0, 0.0], memory=-2 * hd.Caputo(0.5)),
         "D1.8 y = friction(t, y, memory), memory: -2 D0.5 yone component, from t = 0 on"),
        (lambda: hd.Equation(hd.Caputo(1) - hd.RiemannLiouville(0.5), spring, 1.0),
         "D1 y \N{MINUS SIGN} 1 DRL0.5 y = spring(t, y)one component, from t = 0 on"),
        (lambda: hd.Equation(np.eye(2) * hd.Caputo(0.5), spring, [1.0, 1.0]),
         "[2 x 2 matrix] D0.5 y = spring(t, y)2 components, from t = 0 on"),
        (lambda: hd.Equation(hd.Caputo(1) + hd.Memory(hd.Prony([1.0], [2.0]), 1), spring, 1.0),
         "D1 y + \N{INTEGRAL} Prony(rates=(1.0,), weights=(2.0,)) y\N{PRIME} = spring(t, y)"
         "one component, from t = 0 on"),
        (lambda: hd.scenes.subdiffusion(0.5, 3), "D0.5 y = A y3 components, from t = 0 on"),
        (lambda: hd.Equation(hd.Caputo(ageing), lambda t, y: -y, 1.0),
         "Dageing(t) y = f(t, y)one component, from t = 0 on"),
    ],
    ids=["two terms", "components", "memory", "RL", "matrix", "kernel", "linear", "varying"],
)  # fmt: skip
def test_an_equation_is_its_formula(made, expected):
    assert Balance(made()._repr_html_()).text == expected


def test_names_that_say_nothing_are_left_out():
    def _(t, y):
        return -y

    equation = hd.Equation(hd.Caputo(lambda t: 0.5), _, 1.0)
    assert Balance(equation._repr_html_()).text.startswith("Dalpha(t) y = f(t, y)")
    fitted = hd.fit_exponentials(hd.PowerLaw(0.5), 1e-3, 1e3, 1e-6)
    equation = hd.Equation(hd.Caputo(1) + hd.Memory(fitted, 1), spring, 1.0)
    assert "ExponentialSum y" in Balance(equation._repr_html_()).text
    equation = hd.Equation(hd.Caputo(1), lambda t, y: 1j * y, 1.0 + 0j)
    assert "one component, complex" in Balance(equation._repr_html_()).text


def test_a_solution_is_a_figure_and_its_numbers():
    for sol in (
        hd.solve(hd.scenes.relaxation(0.5), 1.0, 100),
        hd.solve(hd.scenes.lorenz(), 1.0, rtol=1e-6),
        hd.solve(hd.Equation(hd.Caputo(1), lambda t, y: 1j * y, 1.0 + 0j), 1.0, 10),
    ):
        page = sol._repr_html_()
        assert "data:image/png;base64," in page
        found = Balance(page)
        assert found.rows == 2
        assert "completed" in found.text
        assert str(sol.stats["n_steps"]) in found.text


def test_a_table_shows_its_first_points():
    table = hd.sweep(
        lambda a, b: {"<x>": a + b, "orbit": [a, b]}, {"a": range(4), "b": [0.5, 1.0, 2.0]}
    )
    found = Balance(table._repr_html_())
    assert found.rows == 1 + 10
    assert "ab<x>status" in found.text
    assert "orbit" not in found.text.split("ab<x>status")[1]


def test_exponents_are_a_table():
    result = hd.lyapunov(hd.scenes.lorenz(), 10.0, 1000, k=2, verify=False)
    found = Balance(result._repr_html_())
    assert found.rows == 3
    assert str(result.verdict) in found.text


def test_completion_shows_public_names_alone():
    assert set(dir(hd)) == {*hd.__all__, "__doc__", "__version__"}
    modules = [each for name in hd.__all__ if inspect.ismodule(each := getattr(hd, name))]
    assert len(modules) == 4
    for module in modules:
        assert dir(module) == sorted(module.__all__)
        own = [getattr(getattr(module, name), "__module__", "") for name in module.__all__]
        assert not [name for name in own if name.startswith(("numpy", "typing", "collections"))]
        # whatever else the module itself defines has a name that begins with _
        defined = {name for name, each in vars(module).items() if is_own(each, module.__name__)}
        assert defined <= set(module.__all__)


def is_own(each, module):
    """Whether a function or a class without an underscore is defined in a module."""
    name = getattr(each, "__name__", "_")
    return getattr(each, "__module__", "") == module and not name.startswith("_")


@pytest.mark.parametrize("name", [*hd.__all__])
def test_signatures_can_be_read(name):
    thing = getattr(hd, name)
    if callable(thing) and not (isinstance(thing, type) and issubclass(thing, Warning)):
        assert "numpy._typing" not in str(inspect.signature(thing))


class Terminal(io.StringIO):
    def isatty(self):
        return True


def drawn(stream, monkeypatch, progress=True, seconds=0.05, call=hd.solve):
    """Return what a run of 1,000 steps that takes `seconds` a clock's tick draws."""
    clock = itertools.count(0.0, seconds)
    monkeypatch.setattr("sys.stderr", stream)
    monkeypatch.setattr("time.perf_counter", lambda: next(clock))
    call(hd.scenes.relaxation(), 1.0, 1000, progress=progress)
    return stream.getvalue()


def test_a_fit_counts_runs_on_a_terminal(monkeypatch):
    def fit(eq, t_end, n_steps, progress):
        t = np.linspace(0.1, t_end, 20)
        model = lambda rate: eq.replace(params=[rate])  # noqa: E731
        hd.fit(model, t, np.exp(-t), {"rate": 2.0}, n_steps=40, progress=progress)

    assert re.search(r"\d sets of runs, cost 0\.", drawn(Terminal(), monkeypatch, call=fit))


def test_a_bar_moves_on_terminals_and_in_notebooks_alone(monkeypatch):
    kernel = type("OutStream", (io.StringIO,), {"__module__": "ipykernel.iostream"})()
    for stream in (Terminal(), kernel):
        text = drawn(stream, monkeypatch)
        assert "100.0 %  done in 0:0" in text
        assert text.endswith("\n")
    for call in (hd.sensitivities, partial(hd.sensitivities, wrt="orders"), hd.lyapunov):
        assert "100.0 %  done in 0:0" in drawn(Terminal(), monkeypatch, call=call)
    assert drawn(Terminal(), monkeypatch, progress=False) == ""
    assert drawn(io.StringIO(), monkeypatch) == ""
    assert re.search(r"done in \d+:00:\d\d", drawn(Terminal(), monkeypatch, seconds=3600.0))
