"""Tangents alongside an orbit: the derivative of each step along some directions.

The columns of a march are the d components of the orbit and then those of one tangent after the
other. All linear parts of a step treat them alike; what remains is the right-hand side, which for a
tangent is the Jacobian at the orbit times its value.
"""

import numpy as np

from .._jit import inner
from .jacobian import jacobian
from .linalg import solve_in_place
from .newton import newton_matrix


@inner
def push_tangents(j_f, x, f):
    """Right-hand sides of the tangents: the Jacobian `j_f` (d, d) times each of them."""
    # x, f (W,)
    d = j_f.shape[0]
    for first in range(d, x.shape[0], d):
        for i in range(d):
            total = 0.0
            for k in range(d):
                total += j_f[i, k] * x[first + k]
            f[first + i] = total


@inner
def evaluate(rhs, jac, has_jac, params, t, x, j_f, f, counts):
    """Right-hand sides of orbit and tangents; calls of `rhs` are counted."""
    # x, f (W,), j_f (d, d): filled with the Jacobian where there are tangents
    d = j_f.shape[0]
    orbit = x[:d]
    rhs(t, orbit, f[:d], params)
    counts.rhs += 1
    if x.shape[0] > d:
        counts.rhs += jacobian(rhs, jac, has_jac, t, orbit, params, j_f)
        push_tangents(j_f, x, f)


@inner
def solve_tangents(
    rhs, jac, has_jac, params, t, n_solved, sources, base, gain, j_f, scale, known, lead, w, counts
):
    """Solve ``scale w + known = lead J (base + gain w)`` for every tangent's w.

    J is the Jacobian where the orbit's own w, which is given, solves the step (compiled/newton.py).
    Returns False where the equations are singular; calls of `rhs` are counted.
    """
    # sources, base, gain, known, lead, w (W,), j_f (n, n): filled with J, scale (>= n,)
    n, d = j_f.shape[0], n_solved
    point, change, matrix = np.empty(n), np.empty(d), np.empty((d, d))
    for c in range(n):
        point[c] = base[c] + gain[c] * w[sources[c]]
    counts.rhs += jacobian(rhs, jac, has_jac, t, point, params, j_f)
    for first in range(n, base.shape[0], n):
        newton_matrix(j_f, sources, gain, scale, lead, matrix)
        for i in range(d):
            total = 0.0
            for k in range(n):
                total += j_f[i, k] * base[first + k]
            change[i] = lead[i] * total - known[first + i]
        if not solve_in_place(matrix, change):
            return False
        for i in range(d):
            w[first + i] = change[i]
    return True
