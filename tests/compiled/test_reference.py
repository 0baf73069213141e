"""Records by reference: read as NamedTuples are, safe in their types and in their lifetimes."""

import gc
import importlib
import sys
from typing import Annotated, Any, NamedTuple, get_type_hints

import numpy as np
import pytest
from numba import config, njit, types
from numba.core import event

import hereditary as hd
from hereditary.compiled.functions import mapped, with_delays, with_switches
from hereditary.compiled.jacobian import force_at, jacobian_at, right_side
from hereditary.compiled.jit import (
    RHS_SIG,
    ComplexVector,
    Matrix,
    Vector,
    as_value,
    checked,
    compiled,
    compiled_type,
    entry,
    inner,
)
from hereditary.compiled.records import record, zeros
from hereditary.compiled.reference import Filled, FunctionField, Reference, by_reference
from hereditary.functions.assemble import functions_of, switch_of
from hereditary.functions.build import Start
from hereditary.given.signatures import MARCH_COUNTS, Counts, Tables
from hereditary.stepping.tolerance import Tolerance

pytestmark = pytest.mark.core


class Room(NamedTuple):
    before: Vector
    after: Vector


class System(NamedTuple):
    rhs: Annotated[Any, FunctionField(RHS_SIG)]
    params: Vector


class Work(NamedTuple):
    system: System
    n_steps: int
    h: float
    matrix: Matrix
    counts: Counts
    room: Room


WORK = Reference(compiled_type(Work))


@inner
def move(m, t):
    """A part of the record is a reference too, and functions are called as in Python."""
    room, y = m.room, m.room.after
    for i in range(y.shape[0]):
        room.before[i] = y[i]
    m.system.rhs(t, room.before, y, m.system.params)
    for i in range(y.shape[0]):
        y[i] = room.before[i] + m.h * y[i]
    m.counts.step += 1


@inner(allocates=True)
def sum_of(room):
    """Arrays of the record are cut and copied as any others."""
    part, copied = room.after[1:], room.after.copy()
    return part.sum() + copied[0]


@entry(WORK, allocates=False)
def march(m):
    for n in range(m.n_steps):
        move(m, n * m.h)
    return sum_of(m.room) + m.matrix[1, 0]


def decay(t, y, dy, params):
    if y[0] < 0.0:
        raise ValueError("y is negative")
    for i in range(y.shape[0]):
        dy[i] = -params[0] * y[i]


@compiled
def no_slope(t, y, out, params):
    """A function of the same arguments, but not compiled as a value."""


def work(**changes):
    system = System(as_value(njit(decay), RHS_SIG), np.ones(1))
    counts, matrix = record(MARCH_COUNTS), np.array([[0.0, 0.0], [1.0, 0.0]])
    made = Work(system, 2, 0.5, matrix, counts, Room(np.zeros(3), np.ones(3)))
    return made._replace(**changes)


def test_a_record_is_read_and_its_arrays_are_changed_in_place():
    given = work()
    assert march(given) == 1.75
    assert given.room.after.tolist() == [0.25] * 3
    assert given.counts["step"] == 2


def test_it_does_what_python_does():
    once, same = work(), work()
    source = getattr(move, "py_func", move)
    for n in range(same.n_steps):
        source(same._replace(counts=np.rec.array(same.counts)), 0.5 * n)
    march(once)
    assert np.array_equal(once.room.after, same.room.after)


def test_exceptions_of_its_functions_are_raised():
    with pytest.raises(ValueError, match="y is negative"):
        march(work(room=Room(np.zeros(3), -np.ones(3))))


@pytest.mark.skipif(config.DISABLE_JIT, reason="Python checks no types")
@pytest.mark.parametrize(
    "wrong",
    [
        {"matrix": np.ones((2, 2), int)},
        {"matrix": np.ones(4)},
        {"matrix": np.ones((4, 2))[::2].T},
        {"matrix": [[1.0]]},
        {"n_steps": 1.5},
        {"counts": np.zeros(1)[0]},
        {"system": System(no_slope, np.ones(1))},
        {"room": Room(np.zeros(3), None)},
    ],
    ids=lambda wrong: next(iter(wrong)),
)
def test_a_field_of_another_type_is_refused(wrong):
    with pytest.raises(TypeError, match=r"\w+\.\w+ must be of type"):
        march(work(**wrong))
    with pytest.raises((TypeError, ValueError)):
        by_reference(work()[:-1], WORK)


@pytest.mark.skipif(config.DISABLE_JIT, reason="Python checks no types")
def test_a_part_is_checked_once_where_it_is_made_and_again_after_a_change():
    room = checked(Room(np.zeros(3), np.ones(3)))
    assert march(work(room=room)) == march(work())
    assert room == Room(*room)
    with pytest.raises(TypeError, match=r"Room\.after must be of type"):
        checked(Room(np.zeros(3), None))
    with pytest.raises(TypeError, match=r"Room\.after must be of type"):
        march(work(room=room._replace(after=None)))
    with pytest.raises(TypeError, match=r"Work\.room|System\.rhs must be of type"):
        march(work(system=room))


@pytest.mark.skipif(config.DISABLE_JIT, reason="Python has no other form of it")
def test_a_checked_record_is_handed_on_again_and_counts_no_references():
    given = work(n_steps=0)
    filled = by_reference(given, WORK)
    assert by_reference(filled, WORK) is filled
    assert isinstance(filled, Filled)
    parts = [given, given.room, given.room.after, given.matrix, given.counts, given.system.rhs]
    march(filled)
    gc.collect()
    before = [sys.getrefcount(part) for part in parts]
    for _ in range(1000):
        march(filled)
    assert [sys.getrefcount(part) for part in parts] == before


# The record of a right-hand side: its formula, its Jacobian, what it compiles, who changes it.
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
        functions = with_switches(functions, [one], [1.0], 2)
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


def decaying(rate, y0=1.0, **given):
    return hd.Equation(hd.Caputo(0.5), lambda t, y: -rate * y, y0, **given)


def reading(rate, memory):
    return hd.Equation(hd.Caputo(0.9), lambda t, y, m: -rate * m[0], 1.0, memory=memory)


KINDS = {
    "a start": lambda rate: decaying(rate, t_start=-1.0),
    "memory": lambda rate: reading(rate, hd.Caputo(0.5)),
    "gamma densities": lambda rate: reading(rate, hd.Memory(hd.GammaDensity(2.0, 1.0), 0)),
    "delays": lambda rate: reading(rate, hd.Delay(0.5)),
    "matrices": lambda rate: decaying(rate, [1.0, 2.0]).replace(terms=np.eye(2) * hd.Caputo(0.5)),
    "complex y": lambda rate: decaying(rate, 1.0 + 0.5j),
    "a constant matrix": lambda rate: decaying(rate, np.ones(2), linear=-np.eye(2)),
    "a band": lambda rate: decaying(
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


WITH_RECORDS = (
    "analysis.lyapunov", "collocation.structures", "compiled.functions", "compiled.reach",
    "compiled.signatures", "given.growing_march", "given.signatures",
)  # fmt: skip


# shapes of `Tables` depend on the history, and `Tolerance` has checks in their place
@pytest.mark.parametrize("name", WITH_RECORDS)
def test_shapes_of_arrays_have_as_many_axes_as_their_types(name):
    module = importlib.import_module(f"hereditary.{name}")
    records = [kind for kind in vars(module).values() if hasattr(kind, "_field_defaults")]
    records = [kind for kind in records if kind not in (Tables, Tolerance)]
    hints = [get_type_hints(kind, include_extras=True) for kind in records]
    metadata = [getattr(hint, "__metadata__", (None,)) for each in hints for hint in each.values()]
    arrays = [each for each in metadata if isinstance(each[0], types.Array)]
    assert arrays
    assert all(len(shape.split()) == array.ndim for array, shape in arrays)


def test_zeros_have_the_lengths_of_their_letters():
    class Mixed(NamedTuple):
        matrix: Annotated[Matrix, "1+k 2*d"]
        free: Annotated[ComplexVector, "."]
        n: int

    made = zeros(Mixed, k=2, d=3)
    assert (made.matrix.shape, made.free.shape, made.n) == ((3, 6), (0,), 0)
    assert (made.free.dtype, compiled_type(Mixed)[0].ndim) == (complex, 2)
    with pytest.raises(NameError):
        zeros(Mixed, k=2)
