"""Members of an ensemble: one march after the other from starts of their own.

The march is handed over as a function value, so that this loop is compiled once for all of them.
"""

from typing import NamedTuple

import numpy as np
from numba import from_dtype, types

from .._jit import CUBE, CUBES, I8, IVEC, MAT, entry, inner
from .copying import put, put_matrix
from .signatures import (
    COUNTS,
    EXCHANGE,
    JAC,
    LINEAR,
    MARCH_VALUE,
    MEMORY,
    MONITOR,
    RHS,
    SOLVER,
    STATE,
    STEP_ROWS,
    STEP_TABLE,
    TABLES,
    Output,
)
from .step import UNITS

# How a member ended whose march raised; the others are those of compiled/block.py.
RAISED = -1


class Starts(NamedTuple):
    """Where E members begin, with W columns each; names are those of `March`.

    params (E, p); units (E, d); x, increment, shift and first (E, W); drift (E, W, r), corrections
    (E, W, k) and starts (E, W, V); monitor (d,), that of each of them.
    """

    params: np.ndarray
    units: np.ndarray
    x: np.ndarray
    increment: np.ndarray
    shift: np.ndarray
    first: np.ndarray
    drift: np.ndarray
    corrections: np.ndarray
    starts: np.ndarray
    monitor: np.ndarray

    def of(self, part):
        """Return those of some members."""
        return Starts._make((*(array[part] for array in self[:-1]), self.monitor))


class Found(NamedTuple):
    """Results of E members.

    rows and slopes (E, k, d) of the steps in `kept` (k,), but for step 0; jacobians (E, n,
    ., .); counts (E,) as those of `March`; status (E,), how each ended.
    """

    kept: np.ndarray
    rows: np.ndarray
    slopes: np.ndarray
    jacobians: np.ndarray
    counts: np.ndarray
    status: np.ndarray


_COUNTED = types.Array(from_dtype(COUNTS), 1, "C")
_MONITORS = types.Array(from_dtype(MONITOR), 1, "C")
_STARTS = types.NamedTuple((MAT, MAT, MAT, MAT, MAT, MAT, CUBE, CUBE, CUBE, _MONITORS), Starts)
_FOUND = types.NamedTuple((IVEC, CUBE, CUBE, CUBES, _COUNTED, IVEC), Found)
_MEMBERS = (
    MARCH_VALUE, RHS, JAC, I8, EXCHANGE, TABLES, MEMORY, SOLVER, LINEAR,
    STEP_TABLE, STEP_ROWS, STATE, _STARTS, MAT, MAT, MAT, _FOUND, I8, I8,
)  # fmt: skip


@inner
def begin(m, starts, state, memory):
    """Let a march stand where member m begins."""
    counts, x, monitor = state.counts, starts.x[m], state.monitor
    counts.step, counts.rhs = 0, 0
    counts.zigzag, counts.opened, counts.growth = -1, -1, -1
    counts.factored, counts.factorised = 0, 0
    put(x, state.x)
    put(starts.increment[m], state.increment)
    put(starts.shift[m], state.shift)
    put(starts.first[m], state.first)
    put_matrix(starts.drift[m], state.drift)
    put_matrix(starts.corrections[m], state.corrections)
    put_matrix(starts.starts[m], state.starts)
    for c in range(x.shape[0]):
        state.change[c] = state.force[c] = state.lacks[c] = 0.0
    for c in range(monitor.shape[0]):
        monitor[c] = starts.monitor[c]
    for array in (state.lag, state.pieces, *memory):
        clear(array)


@inner
def clear(array):
    """Set a matrix to 0."""
    for i in range(array.shape[0]):
        for j in range(array.shape[1]):
            array[i, j] = 0.0


@inner
def keep(m, n, rows, slopes, found):
    """Keep the chosen ones of the first n steps of member m."""
    kept = found.kept
    for k in range(kept.shape[0]):
        if 0 < kept[k] <= n:
            put(rows[kept[k] - 1], found.rows[m, k])
            put(slopes[kept[k] - 1], found.slopes[m, k])


@entry(*_MEMBERS, told="the loop over the members of an ensemble")
def march_members(
    march, rhs, jac, has_jac, exchange, tables, memory, solver, linear, table, rows, state, starts,
    all_rows, all_slopes, room, found, first, end,
):  # fmt: skip
    """March from the start of each member, from number `first` on, to step `end`.

    all_rows and all_slopes (end, d) are room for every step of one member, room that of one step.
    """
    for m in range(first, found.status.shape[0]):
        begin(m, starts, state, memory)
        put(starts.units[m], room[UNITS][: starts.units.shape[1]])
        output = Output(all_rows, all_slopes, found.jacobians[m], room, 0, end)
        found.status[m] = march(
            rhs, jac, has_jac, starts.params[m], exchange, tables, memory, solver, linear, table,
            rows, state, output, end,
        )  # fmt: skip
        keep(m, state.counts.step, all_rows, all_slopes, found)
        found.counts[m] = state.counts
