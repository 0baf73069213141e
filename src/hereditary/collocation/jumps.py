"""Jumps of a solution whose highest derivative is convolved with bounded kernels alone.

The primary unknown p is y, or y' for orders above 1. If p follows from
``sum_k c_k int K_k p' ds + ... = f`` and every K_k(0) is finite, p need not be continuous. It jumps
at t = 0, and at each jump of f, so that the equation holds. The shapes below have d components and
k tangents.
"""

import numpy as np

from ..equation.system import System
from ..support.scaling import condition, inverse
from .equations import Form
from .operators import ITSELF, PRIMARY, SLOPE
from .orbit import OrbitAndTangents

# Time lag at which a bounded kernel K is evaluated in place of K(0).
_LAG_NEXT_TO_0 = 1e-300
# Largest number of Newton iterations for a jump of p.
_JUMP_NEWTON_MAXITER = 100
# Relative change of p at which Newton's method for a jump ends.
_JUMP_NEWTON_RTOL = 1e-14
# Step of one-sided differences next to a jump, relative to a component or its unit.
_ONE_SIDED = 1e-7
# Largest condition number of a linear system for a change.
_MAX_CONDITION_AT_JUMPS = 1e14


def jump(system: System, form: Form, orbit: OrbitAndTangents, t: float, counts: np.void) -> bool:
    """Apply the jump of p at t after which the equation holds; return if iterations converged."""
    # just before t > 0 the terms of the equation equal the right-hand side; at t = 0 they are those
    # of p
    stiffness, coefficients_of_p = _stiffness(form), _coefficients_of_p(form)
    free = (form.implicit == 1) & np.isfinite(stiffness) & (stiffness != 0)
    if not free.any():
        return True
    p, x, is_y = orbit.p.copy(), orbit.x.copy(), form.above_one == 0
    before = _forces(system, system.beside(t, -1), x, counts)[0] if t > 0 else coefficients_of_p * p
    stiffness = np.where(free, stiffness + coefficients_of_p, 1.0)
    for _ in range(_JUMP_NEWTON_MAXITER):
        forces, jacobian = _forces(system, system.beside(t, 1), x, counts)
        left = np.where(free, forces - before - stiffness * (p - orbit.p), 0.0)
        matrix = np.diag(stiffness) - np.where(is_y, jacobian, 0.0) * np.outer(free, free)
        if not np.all(np.isfinite(left)) or condition(matrix) > _MAX_CONDITION_AT_JUMPS:
            return False
        change = left @ inverse(matrix).T
        p += change
        x += np.where(is_y, change, 0.0)
        if np.all(np.abs(change) <= _JUMP_NEWTON_RTOL * (np.abs(p) + np.abs(orbit.p))):
            orbit.jump_to(p, x)
            return True
    return False


def _forces(
    system: System, t: float, x: np.ndarray, counts: np.void
) -> tuple[np.ndarray, np.ndarray]:
    """Return f of the orbit and its linearisation for k tangents, (1 + k, d), and the Jacobian."""
    # x (1 + k, d): y of the orbit and of its tangents
    f, jacobian = system.rhs(t, x[0]), system.derivative(t, x[0])
    jacobian = jacobian if system.structure is None else jacobian.toarray()
    counts["rhs"] += 1
    forces = np.vstack([f, x[1:] @ jacobian.T])
    forces[1 : 1 + system.by_params] += system.derivatives_by_parameters(t, x[0])
    return forces, jacobian


def _stiffness(form: Form) -> np.ndarray:
    """Return ``sum_k c_k K_k(0)`` over the terms with p', (d,); infinite for singular kernels."""
    d, n_a = form.above_one.size, form.orders.size
    total = np.zeros(d)
    for c, q, k, coefficient in form.listed:
        if q != SLOPE:
            continue
        bounded = n_a <= k < n_a + len(form.kernels)
        bounded = bounded and form.kernels[k - n_a].singular_exponent == 0
        total[c % d] += (
            coefficient * float(form.kernels[k - n_a](_LAG_NEXT_TO_0)) if bounded else np.inf
        )
    return total


def _coefficients_of_p(form: Form) -> np.ndarray:
    """Return the sum of the coefficients of terms that are p itself, (d,)."""
    d = form.above_one.size
    total = np.zeros(d)
    for c, q, k, coefficient in form.listed:
        if k == ITSELF and q == PRIMARY:
            total[c % d] += coefficient
    return total


def jacobian_beside_jump(system: System, t: float, y: np.ndarray, units: np.ndarray) -> np.ndarray:
    """Return the Jacobian (d, d) of f at y (d,) next to a jump by y, by one-sided differences."""
    # each column is the smaller of the differences to both sides: the other has the jump in it
    f, steps = system.rhs(t, y), _ONE_SIDED * np.maximum(units, np.abs(y))
    sides = [
        [(system.rhs(t, y + sign * step * unit) - f) / (sign * step) for sign in (1, -1)]
        for step, unit in zip(steps, np.eye(y.size), strict=True)
    ]
    return np.array([min(pair, key=lambda column: np.abs(column).max()) for pair in sides]).T
