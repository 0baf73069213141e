"""Small dense linear algebra for compiled code."""

from .._jit import inner


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
    # a (n, n), order (n,) of whole numbers
    n = a.shape[0]
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
def substitute(factors, order, b, x):
    """Solve a x = b with the factors of `factorise`."""
    # factors (n, n), order (n,), b, x (n,)
    n = b.shape[0]
    for i in range(n):
        total = b[order[i]]
        for k in range(i):
            total -= factors[i, k] * x[k]
        x[i] = total
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= factors[i, k] * x[k]
        x[i] = total / factors[i, i]
