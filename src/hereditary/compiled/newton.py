"""Newton's method for one implicit step."""

import numpy as np

from .._jit import inlined, inner
from .jacobian import jacobian
from .linalg import solve_in_place

# Simplified Newton steps (one Jacobian) before the full method takes over, and full ones before a
# step is given up.
_SIMPLIFIED, _FULL = 8, 30
# The step is solved when the estimated error of the increment is below this share of it, or below
# rounding of the solution, or below what floats can resolve.
_TOLERANCE, _ROUNDING, _UNDERFLOW = 1e-13, 2e-16, 1e-300


@inner
def solve_step(rhs, jac, has_jac, params, t, x, theta, shift, scale, known, lead, w, counts):
    """Solve ``scale w + known = lead f(t, x + theta (shift + w))`` for w, from its present value.

    Returns False where the iteration does not converge; calls of `rhs` are counted.
    """
    # x (d,), shift, scale, known, lead, w (>= d,)
    d = x.shape[0]
    point, f, change = np.empty(d), np.empty(d), np.empty(d)
    j_f, matrix = np.empty((d, d)), np.empty((d, d))
    previous = np.inf
    for iteration in range(_SIMPLIFIED + _FULL):
        for c in range(d):
            point[c] = x[c] + theta * (shift[c] + w[c])
        rhs(t, point, f, params)
        counts.rhs += 1
        if iteration == 0 or iteration >= _SIMPLIFIED:
            counts.rhs += jacobian(rhs, jac, has_jac, t, point, params, j_f)
        for i in range(d):
            change[i] = lead[i] * f[i] - known[i] - scale[i] * w[i]
            for k in range(d):
                matrix[i, k] = -theta * lead[i] * j_f[i, k]
            matrix[i, i] += scale[i]
        if not solve_in_place(matrix, change):
            return False
        size, largest, reference = 0.0, 0.0, 0.0
        for c in range(d):
            w[c] += change[c]
            size = max(size, abs(change[c]))
            largest = max(largest, abs(w[c]) + abs(shift[c]))
            reference = max(reference, abs(x[c]))
        if not size < np.inf:
            return False
        # a contraction by `rate` leaves an error of rate / (1 - rate) times the last change
        rate = size / previous if iteration > 0 else 1.0
        left = size * rate / (1.0 - rate) if rate < 1.0 else size
        if left <= _TOLERANCE * largest + _ROUNDING * reference + _UNDERFLOW:
            return True
        previous = size
    return False


@inlined
def guess(p, integral, ratio, lead, known, force, pieces, w):
    """Set w to a first guess: with f as it was, or the increment before."""
    for c in range(w.shape[0]):
        w[c] = lead[c] * force[c] - known[c] if integral == 1 else ratio * pieces[c, p]


@inlined
def end_point(x, shift, w, point):
    """Set the end of the step."""
    for c in range(w.shape[0]):
        point[c] = x[c] + (shift[c] + w[c])
