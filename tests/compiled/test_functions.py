"""The record of a right-hand side: its formula, its Jacobian, what it compiles, who changes it."""

import numpy as np
import pytest
from numba import config
from numba.core import event

import hereditary as hd
from hereditary.compiled.functions import mapped, with_delays, with_switches
from hereditary.compiled.jacobian import force_at, jacobian_at, right_side
from hereditary.functions.assemble import functions_of, switch_of
from hereditary.functions.build import Start

pytestmark = pytest.mark.core
START = 0.7
OUTER, INNER, BESIDE, READ = (
    np.random.default_rng(seed).integers(-3, 4, shape).astype(float)
    for seed, shape in enumerate([(5, 5), (4, 4), (5, 4), (4, 5)])
)


def g(t, y, memory, params):
    return np.array([params[0] * y[0] * y[1] + t * memory[0, 0], y[1] ** 2 - memory[1, 0] ** 2])


def by_y(t, y, memory, params):
    return np.array([[params[0] * y[1], params[0] * y[0]], [0.0, 2 * y[1]]])


def by_memory(t, y, memory, params):
    return np.array([[t, 0.0, 0.0, 0.0], [0.0, 0.0, -2 * memory[1, 0], 0.0]])


def surface(t, y):
    return y[0] + 2.0 * y[1] - 1.0


def entries(matrix):
    """Entries (row, column, value) of a matrix, as maps take them."""
    rows, columns = np.nonzero(matrix)
    return np.c_[rows, columns, matrix[rows, columns]]


def users(params):
    start = Start(np.array([1.0, 2.0]), np.array([[0.3, 0.4], [0.5, 0.6]]), params, START)
    return functions_of(g, by_y, by_memory, start, str).functions._replace(start=START)


def layers(delays, maps, switch):
    """A record with some of its layers, the number of its components, and the same f in NumPy."""
    params, late = np.array([1.5]), np.array([0.2, -0.8])
    functions, n = users(params), 6
    if delays:
        functions, n = with_delays(functions, [0, -1], late[None]), 4

    def inside(t, x):
        z = np.concatenate([x[:2], late, x[2:]]) if delays else x
        values = g(t + START, z[:2], z[2:].reshape(2, 2), params)
        return np.concatenate([values, np.zeros(x.size - 2)])

    f = [inside]
    if switch:
        one = switch_of(surface, np.array([1.0, 2.0]), START)
        functions = with_switches(functions, [one], 2)
        moved = f[-1]

        def to_the_side(t, x):
            x, value, slope = x.copy(), surface(t, x), np.array([1.0, 2.0])
            x[:2] -= min(value, 0.0) * slope / (slope @ slope)
            return moved(t, x)

        f.append(to_the_side)
    if maps:  # the inner one in place, the outer one anywhere
        functions = mapped(functions, 4, n, entries(INNER))
        functions = mapped(functions, 5, 4, entries(OUTER), entries(BESIDE), entries(READ))
        before, n = f[-1], 5
        f.append(lambda t, x: INNER @ x + before(t, x))
        between = f[-1]
        f.append(lambda t, x: OUTER @ x + BESIDE @ between(t, READ @ x))
    return functions, n, f[-1]


LAYERS = {
    "memory": (False, False, False),
    "delays": (True, False, False),
    "maps": (True, True, False),
    "switches": (False, False, True),
    "all": (True, True, True),
}


@pytest.mark.parametrize("kind", LAYERS)
def test_f_is_what_its_layers_say(kind):
    """The bound: moves to a switch leave 1e-12 of y, times entries of the matrices up to 3."""
    functions, n, f = layers(*LAYERS[kind])
    x, out = np.linspace(-0.4, 0.5, n), np.empty(n)
    force_at(right_side(functions, sparse=False), 0.25, x.copy(), out)
    np.testing.assert_allclose(out, f(0.25, x), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", ["memory", "delays", "maps"])
def test_a_jacobian_has_the_layers_of_f(kind):
    """Differences of polynomials of degree 2 are exact but for rounding, 1e-16 over a step 1e-5."""
    functions, n, _ = layers(*LAYERS[kind])
    x, found = np.linspace(-0.4, 0.5, n), np.empty((2, n, n))
    for of, out in zip((functions, functions.without_jac()), found, strict=True):
        jacobian_at(right_side(of, sparse=False), 0.25, x.copy(), np.ones(n), out)
    np.testing.assert_allclose(*found, rtol=1e-8, atol=1e-8)


def decay(rate, y0=1.0, **given):
    return hd.Equation(hd.Caputo(0.5), lambda t, y: -rate * y, y0, **given)


def reading(rate, memory):
    return hd.Equation(hd.Caputo(0.9), lambda t, y, m: -rate * m[0], 1.0, memory=memory)


KINDS = {
    "a start": lambda rate: decay(rate, t_start=-1.0),
    "memory": lambda rate: reading(rate, hd.Caputo(0.5)),
    "gamma densities": lambda rate: reading(rate, hd.Memory(hd.GammaDensity(2.0, 1.0), 0)),
    "delays": lambda rate: reading(rate, hd.Delay(0.5)),
    "matrices": lambda rate: decay(rate, [1.0, 2.0]).replace(terms=np.eye(2) * hd.Caputo(0.5)),
    "complex y": lambda rate: decay(rate, 1.0 + 0.5j),
    "a constant matrix": lambda rate: decay(rate, np.ones(2), linear=-np.eye(2)),
    "a band": lambda rate: decay(
        rate, np.ones(12), bandwidth=(0, 0), jac=lambda t, y: np.full((1, 12), -rate)
    ),
}


class Compiled(event.Listener):
    """The functions of the package that numba compiles, but for those around one of a user."""

    def __init__(self):
        self.names = []

    def on_start(self, event):
        made = event.data["dispatcher"].py_func
        if made.__module__ == "hereditary.functions.build" or "<lambda>" in made.__qualname__:
            return
        self.names.append(made.__qualname__)

    def on_end(self, event):
        pass


@pytest.mark.skipif(config.DISABLE_JIT, reason="numba compiles nothing")
@pytest.mark.parametrize("kind", KINDS)
def test_another_function_compiles_nothing_of_the_package(kind):
    hd.solve(KINDS[kind](1.0), 1.0, rtol=1e-4)
    with event.install_listener("numba:compile", Compiled()) as compiled:
        hd.solve(KINDS[kind](2.0), 1.0, rtol=1e-4)
    assert compiled.names == []


def arrays_of(part):
    """Bytes of every array of a record."""
    if isinstance(part, tuple):
        return [found for each in part for found in arrays_of(each)]
    return [part.tobytes()] if isinstance(part, np.ndarray) else []


@pytest.mark.parametrize("how", [{"rtol": 1e-4}, {"n_steps": 60, "scheme": hd.L1()}])
def test_a_run_changes_nothing_of_the_system(how):
    """Delayed values, and sides of switches, belong to the march."""
    equation = reading(1.0, hd.Delay(0.4))
    before, params = arrays_of(equation.system.functions), equation.params.copy()
    crossed = hd.solve(equation, 1.0, switches=[lambda t, y: y[0] - 0.5], **how)
    assert crossed.y[-1, 0] < 0.5  # it has passed a switch
    assert arrays_of(equation.system.functions) == before
    assert equation.params.tolist() == params.tolist()
