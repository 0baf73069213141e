"""Growth of tangents: a march that makes them orthonormal now and then, memory and all.

Tangents stand behind the d columns of the orbit, d columns each. All that is linear in them is
multiplied by the inverse of R in ``Phi = Q R``, Phi being their values, and their slopes where an
initial derivative belongs to the data.
"""

from typing import NamedTuple

import numpy as np
from numba import from_dtype, types

from .block import RUNNING
from .jit import F8, I8, IVEC, MAT, allocating, entry, inner
from .signatures import MARCH, MARCH_VALUE, MEMORY, STATE

# Ends of a march besides those of compiled/block.py: tangents overflowed or vanished, and there is
# no room for another renormalisation.
LOST, FULL = 3, 4
# Steps after which a march reads no data but the lasting ones.
_FIRST_STEPS = 8
# Growth, or spread, of tangents over one interval that is wanted where it follows the growth: R
# loses about as many of sixteen digits as there are in exp(spread).
LOW, HIGH = 3.0, 8.0
# Intervals between renormalisations [steps]: the present and the longest one; the end of the
# transient, the last renormalisation, and whether intervals follow the growth.
PACE = np.dtype([(n, "i8") for n in ("interval", "longest", "transient", "last", "automatic")])


class Growth(NamedTuple):
    """How tangents are measured, and room for what is found.

    above (n,), components whose slopes belong to the data; d, components that do; h, the step; 1
    where the march reads data of the first steps later on; the last step of the run; steps (K,) and
    logs (K, k) of renormalisations, made (1,) of them.
    """

    above: np.ndarray
    d: int
    h: float
    lasting: int
    last: int
    steps: np.ndarray
    logs: np.ndarray
    made: np.ndarray


GROWTH = types.NamedTuple((IVEC, I8, F8, I8, I8, IVEC, MAT, IVEC), Growth)


@inner
def due(pace, last):
    """Return the step of the next renormalisation of a run that ends at step `last`."""
    stop = min(pace["last"] + pace["interval"], last)
    return pace["transient"] if pace["last"] < pace["transient"] < stop else stop


@allocating
def note(pace, n, logs):
    """Note the growth (k,) up to step n, and suit the interval to it."""
    pace["last"] = n
    size = np.max(np.abs(logs))
    spread = max(size, np.max(logs) - np.min(logs))
    if pace["automatic"] == 0:
        return
    if spread > HIGH:
        # and no longer ever after: spikes of contraction are rare, but come again
        pace["interval"] = max(1, int(pace["interval"] * HIGH / spread))
        pace["longest"] = pace["interval"]
    elif spread < LOW:
        pace["interval"] = min(2 * pace["interval"], pace["longest"])


@allocating
def triangle(columns, inverse):
    """Set the inverse (k, k) of R in ``columns = Q R``, its diagonal above 0; columns become Q.

    Returns whether there is one: columns (n, k) are finite and independent.
    """
    n, k = columns.shape
    r = np.zeros((k, k))
    for j in range(k):
        for i in range(j):
            for c in range(n):
                r[i, j] += columns[c, i] * columns[c, j]
            for c in range(n):
                columns[c, j] -= r[i, j] * columns[c, i]
        largest, total = 0.0, 0.0
        for c in range(n):
            largest = max(largest, abs(columns[c, j]))
            if not abs(columns[c, j]) < np.inf:
                return False
        if largest == 0.0:
            return False
        for c in range(n):
            total += (columns[c, j] / largest) ** 2
        r[j, j] = largest * np.sqrt(total)
        for c in range(n):
            columns[c, j] = columns[c, j] / largest / np.sqrt(total)
    for j in range(k):
        for i in range(k):
            inverse[i, j] = 0.0
        inverse[j, j] = 1.0 / r[j, j]
        for i in range(j - 1, -1, -1):
            total = 0.0
            for m in range(i + 1, j + 1):
                total += r[i, m] * inverse[m, j]
            inverse[i, j] = -total / r[i, i]
    return True


@inner
def set_tangents(growth, state, d, columns):
    """Set Phi (n_data, k): values, and slopes where they belong to the data."""
    x, u, change, above = state.x, state.increment, state.change, growth.above
    for j in range(columns.shape[1]):
        first = (1 + j) * d
        for c in range(growth.d):
            columns[c, j] = x[first + c]
        for i in range(above.shape[0]):
            c = first + above[i]
            columns[growth.d + i, j] = (u[c] + 0.5 * change[c]) / growth.h


@allocating
def combine(array, d, matrix):
    """Replace the columns of tangents by their combinations, rows of `array` (W, n)."""
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
def transform(state, memory, d, lasting, matrix):
    """Replace all that is linear in the tangents by combinations of them, matrix (k, k)."""
    if state.counts.step > _FIRST_STEPS:
        # what is used in the first steps alone would grow without end as tangents decay
        forget(state.starts, d)
        if lasting == 0:
            forget(state.corrections, d)
    for vector in (state.x, state.increment, state.change, state.shift, state.force, state.lacks):
        combine(vector.reshape(-1, 1), d, matrix)
    for array in (state.lag, state.pieces, state.drift, state.corrections, state.starts):
        combine(array, d, matrix)
    for array in memory:
        combine(array, d, matrix)


@inner
def forget(array, d):
    """Clear what the columns behind the first d hold."""
    for c in range(d, array.shape[0]):
        for i in range(array.shape[1]):
            array[c, i] = 0.0


@entry(MAT, MAT)
def measure(columns, inverse):
    """Call `triangle` from Python."""
    return triangle(columns, inverse)


@entry(STATE, MEMORY, I8, I8, MAT)
def transform_march(state, memory, d, lasting, matrix):
    """Call `transform` between two entries into the march."""
    transform(state, memory, d, lasting, matrix)


@entry(
    MARCH_VALUE, *MARCH, from_dtype(PACE), GROWTH,
    told="the growth of tangents",
)  # fmt: skip
def grow(
    march, rhs, jac, has_jac, params, exchange, tables, memory, solver, linear, table, rows, state,
    output, end, pace, growth,
):  # fmt: skip
    """March to step `end`, renormalising on the way; return how the march ended."""
    d, counts = table.n_orbit, state.counts
    k = growth.logs.shape[1]
    columns = np.empty((growth.d + growth.above.shape[0], k))
    inverse = np.empty((k, k))
    while counts.step < end:
        stop = due(pace, growth.last)
        status = march(
            rhs, jac, has_jac, params, exchange, tables, memory, solver, linear, table, rows,
            state, output, min(stop, end),
        )  # fmt: skip
        if status != RUNNING:
            return status
        if counts.step < stop:
            return RUNNING
        set_tangents(growth, state, d, columns)
        if not triangle(columns, inverse):
            return LOST
        transform(state, memory, d, growth.lasting, inverse)
        made = growth.made[0]
        for j in range(k):
            growth.logs[made, j] = -np.log(inverse[j, j])
        growth.steps[made], growth.made[0] = counts.step, made + 1
        note(pace, counts.step, growth.logs[made])
        if made + 1 == growth.steps.shape[0]:
            return FULL
    return RUNNING
