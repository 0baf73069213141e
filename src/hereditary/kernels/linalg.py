"""Small dense linear algebra for compiled code (floor 1)."""

from .._jit import kernel


@kernel
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
