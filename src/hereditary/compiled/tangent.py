"""Tangents alongside an orbit: the derivative of each step along some directions.

The columns of a march are the components of the orbit and then those of one tangent after the
other. All linear parts of a step treat them alike; what remains is the right-hand side, which for a
tangent is the Jacobian at the orbit times its value, here and in newton.py.
"""

from .jacobian import jacobian, multiply
from .jit import inner


@inner
def push_tangents(d, j_f, x, f):
    """Set the right-hand sides of the tangents: the Jacobian times each of them."""
    # x, f (W,), of d components of the orbit and then those of tangents
    for first in range(d, x.shape[0], d):
        multiply(j_f, x[first : first + d], f[first : first + d])


@inner
def evaluate(rhs, jac, has_jac, params, t, d, x, units, j_f, f, counts):
    """Right-hand sides of orbit and tangents; calls of `rhs` are counted."""
    # x, f (W,), d components of the orbit; j_f takes the Jacobian where there are tangents
    orbit = x[:d]
    rhs(t, orbit, f[:d], params)
    counts.rhs += 1
    if x.shape[0] > d:
        counts.rhs += jacobian(rhs, jac, has_jac, t, orbit, params, units, j_f)
        push_tangents(d, j_f, x, f)
