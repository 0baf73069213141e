"""Linear solvers of Newton's matrix for sparse Jacobians: by LAPACK for bands, else by SuperLU.

A sparse matrix has the form of jacobian.py. Compiled code calls SciPy's SuperLU through a C
function that enters Python.
"""

import ctypes
import importlib
from typing import Any

import numpy as np

from .callbacks import C_FUNCTION, PythonRaised, call_at, call_lapack, keep_raised
from .jacobian import COLUMNS, ROWS, VALUES
from .jit import compiled, inner
from .signatures import FACTORISE

# Number of integer arguments of LAPACK's dgbtrf in front of the pivots, see `factorise_band`.
_N_NUMBERS = 5


@compiled
def banded_solver(task, number, matrix, x, linear):
    """Factorise a banded matrix by LAPACK, or solve with its factors for x; return 0 on success."""
    # linear.factors has the shape (m, n, 2 lower + upper + 2) for m matrices: see `set_band`
    factors, place = linear.factors[number], linear.order
    lower, upper, n = linear.lower, linear.upper, x.shape[0]
    if task == FACTORISE:
        if not set_band(matrix, 1.0, place, lower, upper, factors):
            return 1
        return factorise_band(factors, lower, upper, linear.lapack)
    ordered = np.empty(n)
    for i in range(n):
        ordered[place[i]] = x[i]
    substitute_band(factors, lower, upper, ordered)
    for i in range(n):
        x[i] = ordered[place[i]]
    return 0


@inner
def substitute_band(factors, lower, upper, x):
    """Replace x (n,) by the solution, with the factors of `factorise_band`."""
    # LAPACK's own substitution takes longer
    n, width, diagonal = x.shape[0], factors.shape[1] - 1, lower + upper
    for j in range(n):
        pivot = int(factors[j, width].real)
        value = x[pivot]
        if pivot != j:
            x[pivot], x[j] = x[j], value
        for k in range(1, min(lower, n - 1 - j) + 1):
            x[j + k] -= value * factors[j, diagonal + k]
    for j in range(n - 1, -1, -1):
        value = x[j] * factors[j, diagonal]
        x[j] = value
        for k in range(1, min(diagonal, j) + 1):
            x[j - k] -= value * factors[j, diagonal - k]


@inner
def set_band(matrix, factor, place, lower, upper, out):
    """Set `out` to a sparse matrix times a number, a band in order `place`; False if infinite."""
    # row j of out (n, 2 lower + upper + 2) is column j of LAPACK's array ab, and a last number
    for j in range(out.shape[0]):
        for k in range(out.shape[1] - 1):
            out[j, k] = 0.0
    finite = True
    for k in range(matrix.shape[1]):
        i, j = place[int(matrix[ROWS, k])], place[int(matrix[COLUMNS, k])]
        out[j, lower + upper + i - j] += factor * matrix[VALUES, k]
        finite = finite and abs(matrix[VALUES, k]) < np.inf
    return finite


@inner(allocates=True)
def factorise_band(factors, lower, upper, lapack):
    """Replace a band of `set_band`, real or complex, by its LU factors; return 0 on success."""
    # lapack: address of dgbtrf or zgbtrf. The last number of row j becomes the row of the pivot;
    # the diagonal is inverted.
    n, width, diagonal = factors.shape[0], factors.shape[1] - 1, lower + upper
    # [n, lower, upper, length of a column, LAPACK's status, pivots...] in one array, so that all of
    # it is alive until LAPACK returns
    numbers = np.empty(_N_NUMBERS + n, dtype=np.int32)
    numbers[0], numbers[1], numbers[2], numbers[3] = n, lower, upper, width + 1
    numbers[4], pivots, at = 0, numbers[_N_NUMBERS:], numbers.ctypes.data
    pivots_at = at + 4 * _N_NUMBERS
    call_lapack(  # type: ignore[call-arg]
        lapack, (at, at, at + 4, at + 8, factors.ctypes.data, at + 12, pivots_at, at + 16)
    )
    for j in range(n if numbers[4] == 0 else 0):
        factors[j, width] = pivots[j] - 1
        factors[j, diagonal] = 1.0 / factors[j, diagonal]
    return int(numbers[4])


@compiled
def sparse_solver(task, number, matrix, x, linear):
    """Factorise a sparse matrix in Python, or solve with its factors for x; return 0 on success."""
    which = 2.0 * number + task
    matrix_at, x_at = matrix.ctypes.data, x.ctypes.data
    status: int = call_at(linear.python, which, matrix_at, x_at)  # type: ignore[call-arg]
    if status < 0:
        raise PythonRaised
    return status


# SuperLU takes the diagonal entry as pivot if it exceeds this fraction of the column's largest
# entry.
_PIVOT = 0.1
# Option of SuperLU for matrices with a nearly symmetric pattern, whose pivots are mostly diagonal.
_SYMMETRIC = {"SymmetricMode": True}


class SparseFactors:
    """SuperLU's factors of sparse real matrices, or of complex matrices ``1 - lambda J``."""

    def __init__(self, structure, kind):
        # structure: entries of the matrices, or of J; kind: float, or complex for 1 - lambda J.
        # address: of a C function. Its arguments are twice the number of a matrix plus the task,
        # and addresses of the entries of the matrix or J, and of the right-hand side. The solution
        # replaces the latter. To factorise a complex matrix this vector begins with lambda.
        sparse = importlib.import_module("scipy.sparse")  # a slow import
        linalg = importlib.import_module("scipy.sparse.linalg")
        n, size = structure.n, structure.rows.size
        rows, columns = structure.entries[[ROWS, COLUMNS]].astype(np.int64)
        order = np.lexsort((rows, columns))
        starts = np.searchsorted(columns[order], np.arange(n + 1)).astype(np.int32)
        parts, diagonal = (rows[order].astype(np.int32), starts), rows[order] == columns[order]
        factors: dict[int, Any] = {}
        length = n if kind is float else 2 * n

        def factorise(number, entries, vector):
            values = entries[order]
            if kind is complex:
                values = diagonal - vector[0] * values
            if not np.all(np.isfinite(values)):
                return 1
            matrix = sparse.csc_array((values, *parts), shape=(n, n))
            factors[number] = linalg.splu(
                matrix, "MMD_AT_PLUS_A", diag_pivot_thresh=_PIVOT, options=_SYMMETRIC
            )
            return 0

        def call(task, entries_at, vector_at):
            """Factorise or solve; return 0, or 1 for a singular matrix, or -1 for an exception."""
            try:
                number, task = divmod(int(task), 2)
                vector = np.frombuffer((ctypes.c_double * length).from_address(vector_at), kind)
                if task == FACTORISE:
                    entries = np.frombuffer((ctypes.c_double * size).from_address(entries_at))
                    return factorise(number, entries, vector)
                vector[:] = factors[number].solve(vector)
                return 0
            except RuntimeError:  # SuperLU raises it for singular matrices
                return 1
            except BaseException as error:
                keep_raised(error)
                return -1

        self._function = C_FUNCTION(call)
        self.address = int(ctypes.cast(self._function, ctypes.c_void_p).value or 0)
