"""Records by reference: read as NamedTuples are, safe in their types and in their lifetimes."""

import gc
import sys
from typing import Annotated, Any, NamedTuple

import numpy as np
import pytest
from numba import config

from hereditary.compiled.jit import (
    RHS_SIG,
    Matrix,
    Vector,
    as_value,
    checked,
    compiled,
    compiled_type,
    derived,
    entry,
    inner,
)
from hereditary.compiled.records import record
from hereditary.compiled.reference import Filled, FunctionField, Reference, by_reference
from hereditary.given.signatures import MARCH_COUNTS, Counts

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
    system = System(as_value(derived(decay), RHS_SIG), np.ones(1))
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
