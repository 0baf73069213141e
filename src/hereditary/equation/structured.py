"""Functions of large systems: those that are 0, and entries of Jacobians.

A sparse Jacobian is filled as compiled/jacobian.py has it.
"""

from functools import lru_cache

import numpy as np

from ..compiled.copying import clear_matrix
from ..compiled.jacobian import COLUMNS, CONSTANTS, GROUPS, ROWS, VALUES
from ..compiled.jit import JAC_SIG, RHS_SIG, as_value, compiled, derived
from .affine import own_size


@lru_cache(maxsize=64)
def entries_of(jac, shape, linear):
    """Return a Jacobian that sets the values of entries, from one that fills an array of `shape`.

    For None it is constant. `linear` tells whether the parameters are those of `affine`.
    """
    if jac is None:
        return as_value(_constants, JAC_SIG)
    shape = shape if len(shape) > 1 else (1, *shape)

    def entries(t, y, out, params):
        own = own_size(params) if linear else params.shape[0]
        filled = np.zeros(shape)
        jac(t, y, filled, params[:own])
        values = filled.reshape(filled.size)
        for k in range(out.shape[1]):
            place = int(out[GROUPS, k])
            out[VALUES, k] = out[CONSTANTS, k] + (values[place] if place >= 0 else 0.0)

    return as_value(derived(entries), JAC_SIG)


def dense_of(jac, table):
    """Return a dense Jacobian from one that sets the values of entries, whose `table` is (5, k)."""
    return _dense_of(jac, table.tobytes(), table.shape)


@lru_cache(maxsize=64)
def _dense_of(jac, content, shape):
    """Return `dense_of`, compiled once for tables of this content."""
    table = np.frombuffer(content).reshape(shape).copy()

    def dense(t, y, out, params):
        entries = table.copy()
        jac(t, y, entries, params)
        for i in range(out.shape[0]):
            for j in range(out.shape[1]):
                out[i, j] = 0.0
        for k in range(entries.shape[1]):
            out[int(entries[ROWS, k]), int(entries[COLUMNS, k])] = entries[VALUES, k]

    return as_value(derived(dense), JAC_SIG)


@compiled
def _constants(t, y, out, params):
    """Jacobian of constant entries alone."""
    for k in range(out.shape[1]):
        out[VALUES, k] = out[CONSTANTS, k]


@compiled
def _no_values(t, y, out, params):
    """Right-hand side 0."""
    for i in range(out.shape[0]):
        out[i] = 0.0


@compiled
def _no_slopes(t, y, out, params):
    """Jacobian 0."""
    clear_matrix(out)


def no_values():
    """Return the right-hand side 0."""
    return as_value(_no_values, RHS_SIG)


def no_slopes():
    """Return the Jacobian 0."""
    return as_value(_no_slopes, JAC_SIG)
