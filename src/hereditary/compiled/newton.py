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
def solve_step(
    rhs,
    jac,
    has_jac,
    params,
    t,
    n_solved,
    sources,
    base,
    gain,
    shift,
    scale,
    known,
    lead,
    w,
    counts,
):
    """Solve ``scale w + known = lead f(t, base + gain w)`` for w, from its present value.

    The first `n_solved` components have an equation; f reads all, at the w of their sources.
    Returns False where the iteration does not converge; calls of `rhs` are counted.
    """
    # base (n,), sources, gain, shift, scale, known, lead, w (>= n,)
    n, d = base.shape[0], n_solved
    point, f, change = np.empty(n), np.empty(n), np.empty(d)
    j_f, matrix = np.empty((n, n)), np.empty((d, d))
    previous = np.inf
    for iteration in range(_SIMPLIFIED + _FULL):
        for c in range(n):
            point[c] = base[c] + gain[c] * w[sources[c]]
        rhs(t, point, f, params)
        counts.rhs += 1
        if iteration == 0 or iteration >= _SIMPLIFIED:
            counts.rhs += jacobian(rhs, jac, has_jac, t, point, params, j_f)
        for i in range(d):
            change[i] = lead[i] * f[i] - known[i] - scale[i] * w[i]
        newton_matrix(j_f, sources, gain, scale, lead, matrix)
        if not solve_in_place(matrix, change):
            return False
        size, largest, reference = 0.0, 0.0, 0.0
        for c in range(d):
            w[c] += change[c]
            size = max(size, abs(change[c]))
            largest = max(largest, abs(w[c]) + abs(shift[c]))
            reference = max(reference, abs(base[c]))
        if not size < np.inf:
            return False
        # a contraction by `rate` leaves an error of rate / (1 - rate) times the last change
        rate = size / previous if iteration > 0 else 1.0
        left = size * rate / (1.0 - rate) if rate < 1.0 else size
        if left <= _TOLERANCE * largest + _ROUNDING * reference + _UNDERFLOW:
            return True
        previous = size
    return False


@inner
def newton_matrix(j_f, sources, gain, scale, lead, matrix):
    """Set the derivative of ``scale w - lead f(t, base + gain w)`` by the w with an equation."""
    # j_f (n, n), sources, gain, scale, lead (>= n,), matrix (d, d)
    d = matrix.shape[0]
    for i in range(d):
        for k in range(d):
            matrix[i, k] = -gain[k] * lead[i] * j_f[i, k]
        for k in range(d, j_f.shape[0]):
            matrix[i, sources[k]] -= gain[k] * lead[i] * j_f[i, k]
        matrix[i, i] += scale[i]


@inlined
def guess(p, integral, ratio, lead, known, force, pieces, w):
    """Set w to a first guess: with f as it was, or the increment before."""
    for c in range(w.shape[0]):
        w[c] = lead[c] * force[c] - known[c] if integral == 1 else ratio * pieces[c, p]
