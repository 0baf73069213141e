"""Jumps of a solution that bounded kernels on its highest derivative allow (floor 4).

Where ``sum_k kappa_k int K_k p' ds + ... = f`` holds all that makes p, and every K_k(0) is finite,
nothing keeps p continuous: at t = 0, and wherever f jumps, p jumps until the equation holds again.
"""

import numpy as np

from ..kernels.collocation import ITSELF, PRIMARY, SLOPE
from .orbit import rows

# Kernels at 0 are taken here.
_NEXT_TO_0 = 1e-300
# Sweeps of Newton's method, and the change relative to p that ends them.
_SWEEPS, _GOAL = 100, 1e-14


def jump(equation, form, strands, t, counts):
    """Let p, and what remembers it, jump at time t until the equation holds; whether it does.

    It held before: what the terms amount to is the right-hand side there, and nothing but p at 0.
    """
    stiffness, held = _stiffness(form), _held(form)
    free = (form.implicit == 1) & np.isfinite(stiffness) & (stiffness != 0)
    if not free.any():
        return True
    p, x, is_y = strands.p.copy(), strands.x.copy(), form.second == 0
    before = _forces(equation, np.nextafter(t, 0.0), x, counts)[0] if t > 0 else held * p
    stiffness = np.where(free, stiffness + held, 1.0)
    for _ in range(_SWEEPS):
        forces, jacobian = _forces(equation, np.nextafter(t, np.inf), x, counts)
        left = np.where(free, forces - before - stiffness * (p - strands.p), 0.0)
        matrix = np.diag(stiffness) - np.where(is_y, jacobian, 0.0) * np.outer(free, free)
        if not np.all(np.isfinite(left)) or np.linalg.matrix_rank(matrix) < free.size:
            return False
        change = np.linalg.solve(matrix, left.T).T
        p += change
        x += np.where(is_y, change, 0.0)
        if np.all(np.abs(change) <= _GOAL * (np.abs(p) + np.abs(strands.p))):
            strands.take_jump(p, x)
            return True
    return False


def _forces(equation, t, x, counts):
    """The right-hand side for each strand, tangents by the Jacobian, and that; x (1 + k, d)."""
    force, jacobian = np.empty(x.shape[1]), equation.jacobian(t, x[0])
    equation._rhs(t, x[0], force, equation._params)
    counts.rhs += 1
    return np.vstack([force, x[1:] @ jacobian.T]), jacobian


def _stiffness(form):
    """``sum_k kappa_k K_k(0)`` over the terms with p', infinite where one is singular, (d,)."""
    d, n_a = form.second.size, form.orders.size
    total = np.zeros(d)
    for c, q, k, kappa in rows(form):
        if q != SLOPE:
            continue
        bounded = n_a <= k < n_a + len(form.kernels)
        bounded = bounded and form.kernels[k - n_a].singular_exponent == 0
        total[c % d] += kappa * float(form.kernels[k - n_a](_NEXT_TO_0)) if bounded else np.inf
    return total


def _held(form):
    """Coefficients of p itself among the terms, (d,)."""
    d = form.second.size
    total = np.zeros(d)
    for c, q, k, kappa in rows(form):
        if k == ITSELF and q == PRIMARY:
            total[c % d] += kappa
    return total
