"""Linear solvers of Newton's matrix for many components, with their room."""

import ctypes
import importlib
from typing import Any, NamedTuple

import numpy as np
from numba.extending import get_cython_function_address

from .._jit import as_value
from .._python_calls import C_FUNCTION, keep_raised
from ..compiled.jacobian import COLUMNS, ROWS, VALUES
from ..compiled.newton import KEPT_FROM
from ..compiled.signatures import FACTORISE, SOLVER_SIG, LinearSolver
from ..compiled.solvers import banded_solver, dense_solver, sparse_solver

# Pivots of SuperLU are on the diagonal as long as they are this large in comparison.
_PIVOT = 0.1


class Newton(NamedTuple):
    """Newton's method for many components: solver, its tables, and room for the matrices.

    held keeps alive what enters Python.
    """

    solver: Any
    tables: LinearSolver
    room: np.ndarray
    held: Any = None

    def taken_over(self, march):
        """Return the room with the matrices that a restored march kept.

        Where their entries are others, as of another equation, its factors are no longer in force.
        """
        kept, room = march.newton, self.room
        if kept.shape == room.shape and kept.shape[1] == kept.shape[2]:
            return kept
        places = slice(ROWS, COLUMNS + 1)
        if kept.shape == room.shape and np.array_equal(kept[:, places], room[:, places]):
            room[:, VALUES] = kept[:, VALUES]
        else:
            march.counts.factored = 0
        return room


def newton_of(structure, d, tangents, implicit):
    """Return `Newton` for d components of an orbit, with tangents or without.

    Of few components, and of dense ones whose steps are not implicit, room and tables are empty.
    """
    slots = 1 + int(tangents)
    room = np.zeros((0, 0, 0))
    if structure is None:
        kept = d if implicit and d > KEPT_FROM else 0
        if kept:
            room = np.zeros((1 + slots, d, d))
        tables = _tables(np.zeros((slots if kept else 0, kept + 1, kept)), np.arange(kept))
        return Newton(as_value(dense_solver, SOLVER_SIG), tables, room)
    room = np.tile(structure.entries, (1 + slots if implicit else 1, 1, 1))
    if not implicit:
        empty = _tables(np.zeros((0, 0, 0)), np.arange(0))
        return Newton(as_value(dense_solver, SOLVER_SIG), empty, room)
    band = structure.band
    if band is None:
        held = SparseFactors(structure)
        tables = _tables(np.zeros((0, 0, 0)), np.arange(d), python=held.address)
        return Newton(as_value(sparse_solver, SOLVER_SIG), tables, room, held)
    factors = np.zeros((slots, d, 2 * band.lower + band.upper + 3))
    lapack = get_cython_function_address("scipy.linalg.cython_lapack", "dgbtrf")
    tables = _tables(factors, band.order, band.lower, band.upper, lapack)
    return Newton(as_value(banded_solver, SOLVER_SIG), tables, room)


def _tables(factors, order, lower=0, upper=0, lapack=0, python=0):
    """Return the tables of a solver."""
    return LinearSolver(factors, order.astype(np.int64), lower, upper, lapack, python)


class SparseFactors:
    """SuperLU's factors of sparse matrices, for compiled code.

    Attributes
    ----------
    address : int
        Of a C function of a task, the entries of a matrix and a vector.
    """

    def __init__(self, structure):
        sparse = importlib.import_module("scipy.sparse")  # whose imports take long
        linalg = importlib.import_module("scipy.sparse.linalg")
        n, size = structure.n, structure.rows.size
        rows, columns = structure.entries[[ROWS, COLUMNS]].astype(np.int64)
        order = np.lexsort((rows, columns))
        starts = np.searchsorted(columns[order], np.arange(n + 1))
        parts = rows[order].astype(np.int32), starts.astype(np.int32)
        symmetric = {"SymmetricMode": True}
        found: dict[int, Any] = {}

        def call(task, matrix_at, x_at):
            """Do a task; 1 for a singular matrix, -1 for an exception."""
            try:
                number, kind = divmod(int(task), 2)
                if kind == FACTORISE:
                    entries = (ctypes.c_double * size).from_address(matrix_at)
                    values = np.frombuffer(entries)[order]
                    if not np.all(np.isfinite(values)):
                        return 1
                    matrix = sparse.csc_array((values, *parts), shape=(n, n))
                    found[number] = linalg.splu(
                        matrix, "MMD_AT_PLUS_A", diag_pivot_thresh=_PIVOT, options=symmetric
                    )
                    return 0
                x = np.frombuffer((ctypes.c_double * n).from_address(x_at))
                x[:] = found[number].solve(x)
                return 0
            except RuntimeError:  # which SuperLU raises for singular matrices
                return 1
            except BaseException as error:
                keep_raised(error)
                return -1

        self._function = C_FUNCTION(call)
        self.address = int(ctypes.cast(self._function, ctypes.c_void_p).value or 0)
