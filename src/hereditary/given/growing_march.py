"""Growth of tangents: Benettin's loop (stepping/stepper.py) around a march on given steps.

Arrays have d columns of the orbit, then d columns of each of k tangents. The matrix Phi (n_data, k)
has the values of the tangents and, for components of order above 1, their slopes. At intervals the
loop computes ``Phi = Q R``. Then it multiplies every array that is linear in the tangents by the
inverse of R.
"""

from typing import Annotated, Any, NamedTuple

import numpy as np
from numba import from_dtype

from ..compiled.jit import I8, MAT, Integers, Matrix, compiled_type, entry, inner
from ..compiled.reference import FunctionField, Reference
from ..compiled.schedule import SCHEDULE, due, note
from .block import RUNNING
from .signatures import GIVEN_MARCH, MARCH_SIG, MARCH_STATE, MEMORY

# Status of a march whose tangents overflowed or vanished; other statuses are in given/block.py.
LOST = 3
# Number of steps after which a march no longer reads start values, nor corrections of its first
# steps unless these are lasting.
_FIRST_STEPS = 8


@inner
def triangle(columns, inverse):
    """Factorise ``columns = Q R`` with a positive diagonal of R; return whether this succeeded."""
    # columns (n, k) become Q, and inverse (k, k) that of R; it fails for dependent or infinite
    # columns
    n, k = columns.shape
    for j in range(k):
        largest, total = 0.0, 0.0
        for c in range(n):
            if not abs(columns[c, j]) < np.inf:
                return False
            largest = max(largest, abs(columns[c, j]))
        if largest == 0.0:
            return False
        for c in range(n):
            columns[c, j] /= largest
        # the steps that orthogonalise column j, applied to the unit matrix, give column j of the
        # inverse of R
        for m in range(k):
            inverse[m, j] = 0.0
        for i in range(j):
            r = 0.0
            for c in range(n):
                r += columns[c, i] * columns[c, j]
            for c in range(n):
                columns[c, j] -= r * columns[c, i]
            for m in range(i + 1):
                inverse[m, j] -= r * inverse[m, i]
        for c in range(n):
            total += columns[c, j] ** 2
        if total == 0.0:
            return False
        size = np.sqrt(total)
        inverse[j, j] = 1.0 / largest
        for c in range(n):
            columns[c, j] /= size
        for m in range(j + 1):
            inverse[m, j] /= size
    return True


@inner
def read_tangents(state, table, above, columns):
    """Set `columns` (n_data, k) to Phi: values of tangents, slopes of components `above`."""
    d = columns.shape[0] - above.shape[0]
    for j in range(columns.shape[1]):
        first = (1 + j) * table.n_orbit
        for c in range(d):
            columns[c, j] = state.x[first + c]
        for i in range(above.shape[0]):
            c = first + above[i]
            columns[d + i, j] = (state.increment[c] + 0.5 * state.change[c]) / table.h


@inner(allocates=True)
def combine(array, d, matrix):
    """Multiply the tangents in the rows of `array` (W, n) by `matrix` (k, k) from the right."""
    # the first d rows belong to the orbit, the next d to the first tangent
    k, n = matrix.shape[0], array.shape[1]
    if k == 1:
        for c in range(d, 2 * d):
            for i in range(n):
                array[c, i] *= matrix[0, 0]
        return
    old = np.empty((k, n))
    for c in range(d if n > 0 else 0):
        for j in range(k):
            for i in range(n):
                old[j, i] = array[(1 + j) * d + c, i]
                array[(1 + j) * d + c, i] = 0.0
        for j in range(k):
            row = array[(1 + j) * d + c]
            for m in range(k):
                if matrix[m, j] != 0.0:
                    for i in range(n):
                        row[i] += old[m, i] * matrix[m, j]


@inner
def combine_tangents(state, memory, d, lasting, matrix):
    """Replace tangents by linear combinations in all arrays of march and memory; matrix (k, k)."""
    if state.counts.step > _FIRST_STEPS:
        # values that only the first steps use would overflow if the tangents decay
        forget(state.starts, d)
        if lasting == 0:
            forget(state.corrections, d)
    for vector in (state.x, state.increment, state.change, state.shift, state.last_f, state.lacks):
        combine(vector.reshape(-1, 1), d, matrix)
    for array in (state.lag, state.pieces, state.drift, state.corrections, state.starts):
        combine(array, d, matrix)
    for array in (memory.pieces, memory.modes, memory.starts, memory.pending):
        combine(array, d, matrix)


@inner
def forget(array, d):
    """Set the rows of `array` behind the first d, those of the tangents, to 0."""
    for c in range(d, array.shape[0]):
        for i in range(array.shape[1]):
            array[c, i] = 0.0


@entry(MARCH_STATE, MEMORY, I8, I8, MAT)
def transform_march(state, memory, d, lasting, matrix):
    """Call `combine_tangents` from Python, between two calls of the march."""
    combine_tangents(state, memory, d, lasting, matrix)


class Renormalisations(NamedTuple):
    """Functions and arrays for n renormalisations of k tangents during a march."""

    march: Annotated[Any, FunctionField(MARCH_SIG)]
    schedule: Annotated[np.void, from_dtype(SCHEDULE)]  # when renormalisations are due
    above: Annotated[Integers, "."]  # components of order above 1, whose slopes are part of Phi
    columns: Annotated[Matrix, "n_data k"]  # Phi, or Q
    inverse: Annotated[Matrix, "k k"]  # the inverse of R
    grown: Annotated[Matrix, "n 1+k"]  # step of each, and the logarithms of R's diagonal


@entry(
    GIVEN_MARCH, Reference(compiled_type(Renormalisations)), I8,
    announced="the growth of tangents", allocates=False,
)  # fmt: skip
def grow(march, growth, end):
    """March to step `end`, and orthonormalise the tangents when due; return the march's status."""
    m, schedule, columns, inverse = march.work, growth.schedule, growth.columns, growth.inverse
    state = m.state
    schedule["made"] = 0
    while state.counts.step < end:
        stop = due(schedule)
        status = growth.march(march, min(stop, end))
        if status != RUNNING:
            return status
        if state.counts.step < stop:
            return RUNNING
        read_tangents(state, m.table, growth.above, columns)
        if not triangle(columns, inverse):
            return LOST
        combine_tangents(state, m.memory.arrays, m.table.n_orbit, schedule["lasting"], inverse)
        row = growth.grown[schedule["made"]]
        row[0] = stop
        for j in range(columns.shape[1]):
            row[1 + j] = -np.log(inverse[j, j])
        note(schedule, stop, row[1:])
        schedule["made"] += 1
    return RUNNING
