"""Functions of large systems: constant matrices beside a right-hand side, entries of Jacobians.

A constant matrix stands behind the parameters in SciPy's CSR form: its values, their columns, where
each row begins, and the numbers of values and rows. A sparse Jacobian is filled as
compiled/jacobian.py has it.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from ..compiled.jacobian import COLUMNS, CONSTANTS, GROUPS, ROWS, VALUES
from ..compiled.jit import JAC_SIG, RHS_SIG, as_value, compiled, derived, inlined


def behind_params(params, linear):
    """Return the parameters with a constant matrix, SciPy's CSR array, behind them."""
    sizes = np.array([linear.nnz, linear.shape[0]])
    return np.concatenate([params, linear.data, linear.indices, linear.indptr, sizes], dtype=float)


@inlined
def own_size(params):
    """Number of parameters in front of a constant matrix."""
    return params.shape[0] - 2 * int(params[-2]) - int(params[-1]) - 3


@lru_cache(maxsize=64)
def with_linear(rhs):
    """Return a right-hand side, or for None that of nothing, plus a constant matrix times y."""
    without: Any = rhs is None
    rhs = rhs or as_value(_nothing, RHS_SIG)

    def total(t, y, dy, params):
        own, k, n = own_size(params), int(params[-2]), int(params[-1])
        if without:
            for i in range(n):
                dy[i] = 0.0
        else:
            rhs(t, y, dy, params[:own])
        columns, starts = own + k, own + 2 * k
        for i in range(n):
            summed = 0.0
            for p in range(int(params[starts + i]), int(params[starts + i + 1])):
                summed += params[own + p] * y[int(params[columns + p])]
            dy[i] += summed

    return as_value(derived(total), RHS_SIG)


@lru_cache(maxsize=64)
def dense_with_linear(jac):
    """Return a dense Jacobian, or for None that of nothing, plus a constant matrix."""
    without: Any = jac is None
    jac = jac or as_value(_nothing_twice, JAC_SIG)

    def total(t, y, out, params):
        own, k, n = own_size(params), int(params[-2]), int(params[-1])
        if without:
            for i in range(n):
                for j in range(n):
                    out[i, j] = 0.0
        else:
            jac(t, y, out, params[:own])
        columns, starts = own + k, own + 2 * k
        for i in range(n):
            for p in range(int(params[starts + i]), int(params[starts + i + 1])):
                out[i, int(params[columns + p])] += params[own + p]

    return as_value(derived(total), JAC_SIG)


@lru_cache(maxsize=64)
def entries_of(jac, shape, linear):
    """Return a Jacobian that sets the values of entries, from one that fills an array of `shape`.

    For None it is constant. `linear` tells whether a constant matrix stands behind the parameters.
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


@lru_cache(maxsize=64)
def as_row(values):
    """Return a function that fills the row of an array (1, k), from one that fills (k,)."""

    def row(t, y, out, params):
        values(t, y, out[0], params)

    return as_value(derived(row), JAC_SIG)


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
def _nothing(t, y, dy, params):
    """Stands in for a right-hand side where there is none."""


@compiled
def _nothing_twice(t, y, out, params):
    """Stands in for a Jacobian where there is none."""
