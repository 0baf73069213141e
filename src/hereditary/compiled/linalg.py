"""Dense linear algebra for compiled code: elimination by loops, from some size on by LAPACK."""

import numpy as np
from numba import config, types

from .._jit import inner, reordered

# Size from which LAPACK, and sums in any order, take less time than plain loops.
_LARGE = np.inf if config.DISABLE_JIT else 40  # type: ignore[attr-defined]
# numba's own entry to SciPy's LAPACK: kind, m, n, a, lda, ipiv
_GETRF = types.ExternalFunction(
    "numba_xxgetrf",
    types.intc(
        types.char, types.intp, types.intp, types.CPointer(types.float64), types.intp,
        types.CPointer(types.int32),
    ),
)  # fmt: skip
_DOUBLE = np.uint8(ord("d"))


@inner
def solve_in_place(a, b):
    """Solve a x = b by elimination with partial pivoting; x replaces b, a is used up.

    Returns False where a pivot vanishes or is not finite.
    """
    # a (d, d), b (d,)
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
    """LU factors of a with partial pivoting, in its place; rows as they went to `order`.

    Returns False where a pivot vanishes or is not finite.
    """
    # a (n, n), order (n,)
    n = a.shape[0]
    if n >= _LARGE:
        return factorise_large(a, order)
    for i in range(n):
        order[i] = i
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            if abs(a[i, j]) > abs(a[pivot, j]):
                pivot = i
        if not abs(a[pivot, j]) > 0.0:
            return False
        if pivot != j:
            order[j], order[pivot] = order[pivot], order[j]
            for k in range(n):
                a[j, k], a[pivot, k] = a[pivot, k], a[j, k]
        for i in range(j + 1, n):
            a[i, j] /= a[j, j]
            factor = a[i, j]
            for k in range(j + 1, n):
                a[i, k] -= factor * a[j, k]
    return True


@inner
def factorise_large(a, order):
    """As `factorise`, by LAPACK."""
    n = a.shape[0]
    swaps = np.empty(n, dtype=np.int32)
    transpose(a)  # LAPACK's matrices have their columns in a row
    failed = _GETRF(_DOUBLE, n, n, a.ctypes, n, swaps.ctypes)  # type: ignore[call-overload]
    transpose(a)
    for i in range(n):
        order[i] = i
    for i in range(n):
        k = swaps[i] - 1
        order[i], order[k] = order[k], order[i]
    for i in range(n):
        if not 0.0 < abs(a[i, i]) < np.inf:
            return False
    return failed == 0


@inner
def transpose(a):
    """Transpose a square matrix in its place."""
    for i in range(a.shape[0]):
        for k in range(i):
            a[i, k], a[k, i] = a[k, i], a[i, k]


@reordered
def dot(row, x, first, end):
    """Return the sum of products of two vectors, from `first` to before `end`."""
    total, a, b = 0.0, row[first:end], x[first:end]
    for k in range(a.shape[0]):  # from 0 on: vectorised
        total += a[k] * b[k]
    return total


@reordered
def sums_of_sizes(row, x, y):
    """Return the sums of |row| times two vectors."""
    by_x, by_y = 0.0, 0.0
    for k in range(row.shape[0]):
        size = abs(row[k])
        by_x += size * x[k]
        by_y += size * y[k]
    return by_x, by_y


@inner
def substitute(factors, order, b, x):
    """Solve a x = b with the factors of `factorise`."""
    # factors (n, n), order (n,), b, x (n,)
    n = b.shape[0]
    if n >= _LARGE:
        for i in range(n):
            x[i] = b[int(order[i])] - dot(factors[i], x, 0, i)
        for i in range(n - 1, -1, -1):
            x[i] = (x[i] - dot(factors[i], x, i + 1, n)) / factors[i, i]
        return
    for i in range(n):
        total = b[int(order[i])]
        for k in range(i):
            total -= factors[i, k] * x[k]
        x[i] = total
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= factors[i, k] * x[k]
        x[i] = total / factors[i, i]
