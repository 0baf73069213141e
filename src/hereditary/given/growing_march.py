"""Growth of tangents: Benettin's loop (stepping/stepper.py) around a march on given steps.

The first d columns are the orbit, the next d the first tangent, and so on. Phi has the values of
the tangents, and their slopes for components whose initial derivative is given. At intervals the
loop computes ``Phi = Q R``, and multiplies everything that is linear in the tangents by the inverse
of R.
"""

from typing import Annotated, Any, NamedTuple

import numpy as np
from numba import from_dtype

from ..compiled.jit import I8, MAT, Integers, Matrix, compiled_type, entry, inner
from ..compiled.reference import FunctionField, Reference
from ..compiled.schedule import SCHEDULE, due, note
from .block import RUNNING
from .signatures import GIVEN_MARCH, MARCH_SIG, MARCH_STATE, MEMORY

# Status of a march whose tangents overflowed or vanished; given/block.py has the other statuses.
LOST = 3
# Number of steps that read data of the start alone. Later steps read only lasting data.
_FIRST_STEPS = 8


@inner
def triangle(columns, inverse):
    """Set `inverse` (k, k) to that of R in ``columns = Q R``; columns become Q.

    The diagonal of R is positive. Return whether the inverse exists: columns (n, k) are finite and
    independent.
    """
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
        # row m of column j of the inverse of R is -(inverse of R) r_j, computed while columns are
        # made orthogonal
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
    """Replace the columns of tangents, rows of `array` (W, n), by linear combinations."""
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
    """Combine everything that is linear in the tangents by a matrix (k, k)."""
    if state.counts.step > _FIRST_STEPS:
        # arrays that only the first steps read would grow without end as tangents decay
        forget(state.starts, d)
        if lasting == 0:
            forget(state.corrections, d)
    for vector in (state.x, state.increment, state.change, state.shift, state.force, state.lacks):
        combine(vector.reshape(-1, 1), d, matrix)
    for array in (state.lag, state.pieces, state.drift, state.corrections, state.starts):
        combine(array, d, matrix)
    for array in (memory.pieces, memory.modes, memory.starts, memory.pending):
        combine(array, d, matrix)


@inner
def forget(array, d):
    """Set the columns behind the first d to 0."""
    for c in range(d, array.shape[0]):
        for i in range(array.shape[1]):
            array[c, i] = 0.0


@entry(MARCH_STATE, MEMORY, I8, I8, MAT)
def transform_march(state, memory, d, lasting, matrix):
    """Call `combine_tangents` from Python, between two calls of the march."""
    combine_tangents(state, memory, d, lasting, matrix)


class Renormalisations(NamedTuple):
    """Functions and arrays with which a march renormalises its tangents.

    - above (.,): components whose initial slopes are given.
    - columns (n_data, k): the matrix Phi; inverse (k, k): that of R.
    - grown (n, 1 + k): the step and the k logarithms of each renormalisation.
    """

    march: Annotated[Any, FunctionField(MARCH_SIG)]
    schedule: Annotated[np.void, from_dtype(SCHEDULE)]
    above: Integers
    columns: Matrix
    inverse: Matrix
    grown: Matrix


@entry(
    GIVEN_MARCH, Reference(compiled_type(Renormalisations)), I8,
    announced="the growth of tangents", allocates=False,
)  # fmt: skip
def grow(march, growth, end):
    """March to step `end` with renormalisations; return how the march ended."""
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
