"""Dense linear algebra for compiled code: elimination by loops, or by LAPACK if n is large."""

import importlib

import numpy as np

from .callbacks import call_lapack, lapack_address
from .jit import compiled, inner
from .signatures import FACTORISE

# Size from which a solution has blown up: above it, products with rates of 1e8 overflow.
LARGEST = 1e300


@inner
def put(values, out):
    """Copy the vector `values` to `out`."""
    for c in range(out.shape[0]):
        out[c] = values[c]


@inner
def largest_of(values, first, many):
    """Return the largest of `many` absolute values from index `first` on; NaN if one is NaN."""
    largest = 0.0
    for i in range(first, first + many):
        if abs(values[i]) > largest or np.isnan(values[i]):
            largest = abs(values[i])
    return largest


@inner
def clear(out):
    """Set a vector to 0."""
    for c in range(out.shape[0]):
        out[c] = 0.0


@inner
def clear_matrix(out):
    """Set a matrix to 0."""
    for i in range(out.shape[0]):
        clear(out[i])


@inner
def put_matrix(values, out):
    """Copy the matrix `values` to `out`."""
    for i in range(out.shape[0]):
        put(values[i], out[i])


@inner
def put_cube(values, out):
    """Copy the array `values`, which has three axes, to `out`."""
    for i in range(out.shape[0]):
        put_matrix(values[i], out[i])


# Number of columns that `factorise` eliminates at once, and of rows that `substitute` solves for at
# once; `subtract_rows` and `dots` are written for this number.
_PANEL = 4
# Smallest pivot. The reciprocals of smaller ones, and of those beyond its reciprocal, are infinite
# or inaccurate.
_LEAST_PIVOT = 1e-308
# Number of unknowns from which LAPACK factorises in less time than the loops here. For smaller
# matrices LAPACK would use threads too, and wait milliseconds for them if the cores are busy.
_LAPACK = 400
# Largest number of scalar multiplications in a matrix product for which BLAS uses no threads.
_ALONE = 2e5


@inner
def solve_in_place(a, b):
    """Solve a x = b in place of b with partial pivoting, overwriting a."""
    # returns False if a pivot is 0 or NaN
    # shapes for d unknowns: a (d, d), b (d,)
    d = b.shape[0]
    for j in range(d):
        pivot = j
        for i in range(j + 1, d):
            if abs(a[i, j]) > abs(a[pivot, j]):
                pivot = i
        if not abs(a[pivot, j]) > 0.0:  # also where it is nan
            return False
        if pivot != j:
            b[j], b[pivot] = b[pivot], b[j]
            for k in range(j, d):
                a[j, k], a[pivot, k] = a[pivot, k], a[j, k]
        for i in range(j + 1, d):
            factor = a[i, j] / a[j, j]
            b[i] -= factor * b[j]
            for k in range(j + 1, d):
                a[i, k] -= factor * a[j, k]
    for i in range(d - 1, -1, -1):
        for k in range(i + 1, d):
            b[i] -= a[i, k] * b[k]
        b[i] /= a[i, i]
    return True


@inner
def factorise(a, order):
    """Replace a by its LU factors, with partial pivoting; return whether this succeeded."""
    # row i of L U is row order[i] of a; False if a pivot is 0, NaN, or its reciprocal inaccurate
    # shapes for n unknowns: a (n, n), order (n,)
    n = a.shape[0]
    for i in range(n):
        order[i] = i
    for first in range(0, n, _PANEL):
        last = min(first + _PANEL, n)
        if not factorise_columns(a, order, first, last):
            return False
        for j in range(first, last):
            for i in range(j + 1, last):
                row, top, factor = a[i], a[j], a[i, j]
                for k in range(last, n):
                    row[k] -= factor * top[k]
        if last < n:  # then there are exactly _PANEL columns
            subtract_rows(a, first, last)
    return True


@inner
def factorise_columns(a, order, first, last):
    """Factorise columns from `first` to before `last`, exchanging rows, as `factorise`."""
    n = a.shape[0]
    for j in range(first, last):
        pivot = j
        for i in range(j + 1, n):
            if abs(a[i, j]) > abs(a[pivot, j]):
                pivot = i
        if not _LEAST_PIVOT < abs(a[pivot, j]) < 1.0 / _LEAST_PIVOT:
            return False
        inverse = 1.0 / a[pivot, j]
        if pivot != j:
            order[j], order[pivot] = order[pivot], order[j]
            for k in range(n):
                a[j, k], a[pivot, k] = a[pivot, k], a[j, k]
        for i in range(j + 1, n):
            factor = a[i, j] = a[i, j] * inverse
            for k in range(j + 1, last):
                a[i, k] -= factor * a[j, k]
    return True


@inner
def subtract_rows(a, first, last):
    """Eliminate _PANEL columns from the rows from `last` on."""
    # multiples of _PANEL pivot rows are subtracted at once, so that each row is stored only once
    b, c, d, e = a[first, last:], a[first + 1, last:], a[first + 2, last:], a[first + 3, last:]
    for i in range(last, a.shape[0]):
        row, of_b, of_c = a[i, last:], a[i, first], a[i, first + 1]
        of_d, of_e = a[i, first + 2], a[i, first + 3]
        for k in range(row.shape[0]):
            row[k] = row[k] - of_b * b[k] - of_c * c[k] - of_d * d[k] - of_e * e[k]


@inner(allocates=True)
def factorise_large(a, order, lapack):
    """Factorise a as `factorise` does, by LAPACK's dgetrf at the address `lapack`."""
    n = a.shape[0]
    # [n, LAPACK's status, pivots...] in one array, so that all of it is alive until LAPACK returns
    numbers = np.empty(2 + n, dtype=np.int32)
    numbers[0], at = n, numbers.ctypes.data
    transpose(a)  # LAPACK stores matrices by columns
    call_lapack(lapack, (at, at, a.ctypes.data, at, at + 8, at + 4))  # type: ignore[call-arg]
    transpose(a)
    for i in range(n):
        order[i] = i
    for i in range(n):
        k = numbers[2 + i] - 1
        order[i], order[k] = order[k], order[i]
    for i in range(n):
        if not _LEAST_PIVOT < abs(a[i, i]) < 1.0 / _LEAST_PIVOT:
            return False
    return numbers[1] == 0


def address_of_factors(n):
    """Return the address of LAPACK's dgetrf; 0 if n unknowns take less time without LAPACK."""
    return lapack_address("dgetrf") if n >= _LAPACK else 0


@inner
def all_finite(x):
    """Return whether all components of x are finite."""
    return largest_of(x, 0, x.shape[0]) < np.inf


@inner
def bounded(x):
    """Return whether all components of x are finite and below `LARGEST` in size."""
    return largest_of(x, 0, x.shape[0]) < LARGEST


@inner
def transpose(a):
    """Transpose a square matrix in place."""
    for i in range(a.shape[0]):
        for k in range(i):
            a[i, k], a[k, i] = a[k, i], a[i, k]


@inner(allocates=True)
def product(a, b, out):
    """Set out = a b, by blocks of rows for which BLAS uses no threads."""
    # threads gain little for such matrices, and BLAS waits milliseconds for them if cores are busy
    # shapes: a (m, k), b (k, n), out (m, n)
    rows = max(1, int(_ALONE / max(1, b.size)))
    for first in range(0, out.shape[0], rows):
        np.dot(a[first : first + rows], b, out[first : first + rows])


@inner(allocates=True)
def transposed_product(a, b, out):
    """Set out = a^T b, by blocks of rows for which BLAS uses no threads, as `product` does."""
    # shapes: a (k, m), b (k, n), out (m, n)
    rows, summand = max(1, int(_ALONE / max(1, out.size))), np.empty(out.shape)
    out[:] = 0.0
    for first in range(0, a.shape[0], rows):
        np.dot(a[first : first + rows].T, b[first : first + rows], summand)
        out += summand


@inner(reorders=True)
def dot(row, x, first, end):
    """Return the dot product of the entries `first` to `end - 1` of two vectors."""
    total, a, b = 0.0, row[first:end], x[first:end]
    for k in range(a.shape[0]):  # an index from 0 on lets the compiler vectorise
        total += a[k] * b[k]
    return total


@inner(reorders=True)
def dots(rows, x, first, end):
    """Return the dot products, as `dot`, of _PANEL consecutive rows with x."""
    a, b, c, d = rows[0, first:end], rows[1, first:end], rows[2, first:end], rows[3, first:end]
    of_a, of_b, of_c, of_d, part = 0.0, 0.0, 0.0, 0.0, x[first:end]
    for k in range(part.shape[0]):
        of_a, of_b = of_a + a[k] * part[k], of_b + b[k] * part[k]
        of_c, of_d = of_c + c[k] * part[k], of_d + d[k] * part[k]
    return of_a, of_b, of_c, of_d


@inner(fuses=True)
def substitute(factors, order, b, x):
    """Solve a x = b with the factors and the row order that `factorise` made of a."""
    # shapes: factors (n, n), order (n,), b (n,), x (n,)
    # _PANEL rows at once: the sum of a single row waits for each of its additions
    n, alone = b.shape[0], b.shape[0] % _PANEL
    for i in range(alone):
        x[i] = b[int(order[i])] - dot(factors[i], x, 0, i)
    for i in range(alone, n, _PANEL):
        x[i], x[i + 1], x[i + 2], x[i + 3] = dots(factors[i:], x, 0, i)
        for k in range(i, i + _PANEL):
            total = b[int(order[k])] - x[k]
            for e in range(i, k):
                total -= factors[k, e] * x[e]
            x[k] = total
    for i in range(n - _PANEL, alone - 1, -_PANEL):
        p, q, r, s = dots(factors[i:], x, i + _PANEL, n)
        x[i], x[i + 1], x[i + 2], x[i + 3] = x[i] - p, x[i + 1] - q, x[i + 2] - r, x[i + 3] - s
        for k in range(i + _PANEL - 1, i - 1, -1):
            total = x[k]
            for e in range(k + 1, i + _PANEL):
                total -= factors[k, e] * x[e]
            x[k] = total * (1.0 / factors[k, k])
    for i in range(alone - 1, -1, -1):
        x[i] = (x[i] - dot(factors[i], x, i + 1, n)) * (1.0 / factors[i, i])


@compiled
def no_solver(task, number, matrix, x, linear):
    """Do nothing and return 1, failure: the solver of a run that needs none."""
    return 1


@compiled
def dense_solver(task, number, matrix, x, linear):
    """Factorise a dense matrix, or solve with its factors in place of x; return 0 on success."""
    # linear.factors (m, n + 2, n) has for each of m matrices the LU factors in n rows, then the
    # order of the rows, then workspace for a right-hand side
    n = x.shape[0]
    factors, order = linear.factors[number, :n], linear.factors[number, n]
    if task == FACTORISE:
        put_matrix(matrix, factors)
        if linear.lapack != 0:
            return 0 if factorise_large(factors, order, linear.lapack) else 1
        return 0 if factorise(factors, order) else 1
    right = linear.factors[number, n + 1]
    put(x, right)
    substitute(factors, order, right, x)
    return 0


@inner
def add_rows(out, factors, rows):
    """Add factors @ rows to out, four rows at a time."""
    # the inner loop runs along out, so it is vectorised without reordering any sum
    # shapes: out (n,), factors (m,), rows (m, n)
    fours = factors.shape[0] // 4 * 4
    for k in range(0, fours, 4):
        f0, f1, f2, f3 = factors[k], factors[k + 1], factors[k + 2], factors[k + 3]
        r0, r1, r2, r3 = rows[k], rows[k + 1], rows[k + 2], rows[k + 3]
        for j in range(out.shape[0]):
            out[j] += (f0 * r0[j] + f1 * r1[j]) + (f2 * r2[j] + f3 * r3[j])
    for k in range(fours, factors.shape[0]):
        for j in range(out.shape[0]):
            out[j] += factors[k] * rows[k, j]


@inner
def multiply_modes(modes, factors, n_real, out):
    """Set out to the product of modes and factors, mode by mode."""
    # each array has n_real real numbers, then real, then imaginary parts, as in
    # kernels/mode_bank.py
    # all arrays have the shape (M,); out may be modes or factors itself
    for i in range(n_real):
        out[i] = factors[i] * modes[i]
    half = (modes.shape[0] - n_real) // 2
    for i in range(n_real, n_real + half):
        a, b, x, y = factors[i], factors[i + half], modes[i], modes[i + half]
        out[i], out[i + half] = a * x - b * y, a * y + b * x


# Number of rows of a matrix beyond which `eigenvalues` computes only those of largest modulus.
_VERY_MANY = 200
# Number of eigenvalues that are computed of such a large matrix.
_LARGEST = 6
# Most restarts of ARPACK; after them `eigenvalues` returns a bound by norms.
_RESTARTS = 300


def eigenvalues(matrix):
    """Return all eigenvalues of a matrix, or those of largest modulus beyond 200 rows."""
    # one upper bound of their moduli if ARPACK finds none of a large matrix
    if matrix.shape[0] <= _VERY_MANY:
        return np.linalg.eigvals(matrix if isinstance(matrix, np.ndarray) else matrix.toarray())
    arpack = importlib.import_module("scipy.sparse.linalg")  # a slow import
    start = np.random.default_rng(0).normal(size=matrix.shape[0])
    try:
        return arpack.eigs(
            matrix, _LARGEST, v0=start, return_eigenvectors=False, tol=1e-5, maxiter=_RESTARTS
        )
    except arpack.ArpackNoConvergence as error:
        # eigenvalues of largest modulus converge first, so any that converged are enough; otherwise
        # sqrt(|A|_1 |A|_inf) bounds all moduli
        if error.eigenvalues.size:
            return error.eigenvalues
        sizes = abs(matrix)
        return np.sqrt([sizes.sum(axis=0).max() * sizes.sum(axis=1).max()])
