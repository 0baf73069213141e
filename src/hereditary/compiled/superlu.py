"""SuperLU's factors of sparse matrices, behind a C function for compiled code."""

import ctypes
import importlib
from typing import Any

import numpy as np

from .callbacks import C_FUNCTION, keep_raised
from .jacobian import COLUMNS, ROWS
from .signatures import FACTORISE

# Pivots are on the diagonal as long as they are this large in comparison.
_PIVOT = 0.1
_SYMMETRIC = {"SymmetricMode": True}


class SparseFactors:
    """Factors of real matrices of these entries, or of complex ones ``1 - lambda J``.

    Parameters
    ----------
    structure : Structure
    kind : type
        float or complex.

    Attributes
    ----------
    address : int
        Of a C function of twice the number of a matrix plus a task, of the entries of the matrix,
        or of J, and of a vector, which the solution replaces. To factorise a complex matrix, the
        vector begins with lambda.
    """

    def __init__(self, structure, kind):
        sparse = importlib.import_module("scipy.sparse")  # whose imports take long
        linalg = importlib.import_module("scipy.sparse.linalg")
        n, size = structure.n, structure.rows.size
        rows, columns = structure.entries[[ROWS, COLUMNS]].astype(np.int64)
        order = np.lexsort((rows, columns))
        starts = np.searchsorted(columns[order], np.arange(n + 1)).astype(np.int32)
        parts, diagonal = (rows[order].astype(np.int32), starts), rows[order] == columns[order]
        found: dict[int, Any] = {}
        length = n if kind is float else 2 * n

        def factorise(number, entries, vector):
            values = entries[order]
            if kind is complex:
                values = diagonal - vector[0] * values
            if not np.all(np.isfinite(values)):
                return 1
            matrix = sparse.csc_array((values, *parts), shape=(n, n))
            how = {"diag_pivot_thresh": _PIVOT, "options": _SYMMETRIC}
            found[number] = linalg.splu(matrix, "MMD_AT_PLUS_A", **how)
            return 0

        def call(task, entries_at, vector_at):
            """Do a task; 1 for a singular matrix, -1 for an exception."""
            try:
                number, task = divmod(int(task), 2)
                vector = np.frombuffer((ctypes.c_double * length).from_address(vector_at), kind)
                if task == FACTORISE:
                    entries = np.frombuffer((ctypes.c_double * size).from_address(entries_at))
                    return factorise(number, entries, vector)
                vector[:] = found[number].solve(vector)
                return 0
            except RuntimeError:  # which SuperLU raises for singular matrices
                return 1
            except BaseException as error:
                keep_raised(error)
                return -1

        self._function = C_FUNCTION(call)
        self.address = int(ctypes.cast(self._function, ctypes.c_void_p).value or 0)
