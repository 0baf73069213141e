"""Jumps of a solution that bounded kernels on its highest derivative allow (floor 4).

Where ``sum_k kappa_k int K_k p' ds + ... = f`` holds all that makes p, and every K_k(0) is finite,
nothing keeps p continuous: at t = 0, and wherever f jumps, p jumps until the equation holds again.
"""

import numpy as np

from ..kernels.collocation import ITSELF, PRIMARY, SLOPE
from .strands import rows

# Kernels at 0 are taken here.
_NEXT_TO_0 = 1e-300
# Sweeps of Newton's method, and the change relative to p that ends them.
_SWEEPS, _GOAL = 100, 1e-14


def jump(equation, form, strands, t, notes):
    """Let p, and what remembers it, jump at time t until the equation holds; whether it does."""
    stiffness, held = _stiffness(form), _held(form)
    free = (form.implicit == 1) & np.isfinite(stiffness) & (stiffness != 0)
    if not free.any():
        return True
    d, stiffness = free.size, np.where(free, stiffness, 0.0)
    begun, is_y = strands.p.copy(), form.second == 0
    past, force = strands.modes[:, d : 2 * d].sum(axis=2), np.empty(d)
    for _ in range(_SWEEPS):
        equation._rhs(t, strands.x[0], force, equation.params)
        notes[0] += 1
        jacobian = equation.jacobian(t, strands.x[0])
        forces = np.vstack([force, strands.x[1:] @ jacobian.T])
        left = forces - past - stiffness * (strands.p - begun) - held * strands.p
        matrix = np.diag(np.where(free, stiffness + held, 1.0))
        matrix -= np.where(is_y, jacobian, 0.0) * np.outer(free, free)
        if not np.all(np.isfinite(left[:, free])) or np.linalg.matrix_rank(matrix) < d:
            return False
        change = np.linalg.solve(matrix, np.where(free, left, 0.0).T).T
        strands.p += change
        strands.x += np.where(is_y, change, 0.0)
        if np.all(np.abs(change) <= _GOAL * (np.abs(strands.p) + np.abs(begun))):
            strands.take_jump(strands.p - begun)
            return True
    return False


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
