"""The Jacobian of a right-hand side, from the user or by differences."""

import numpy as np

from .._jit import F8, I8, MAT, VEC, entry, inner
from .signatures import JAC, RHS

# Central differences lose least at the cube root of the rounding unit, 6e-6: error 4e-11 relative.
_STEP = 6.055454452393343e-06


@inner
def jacobian(rhs, jac, has_jac, t, y, params, out):
    """out[i, j] = d rhs_i / d y_j at (t, y); by central differences where `has_jac` is 0.

    Returns the number of calls of `rhs`.
    """
    # y (d,), out (d, d)
    if has_jac == 1:
        jac(t, y, out, params)
        return 0
    d = y.shape[0]
    up, down, shifted = np.empty(d), np.empty(d), np.empty(d)
    for j in range(d):  # y.copy() takes longer to compile
        shifted[j] = y[j]
    for j in range(d):
        step = _STEP * max(1.0, abs(y[j]))
        shifted[j] = y[j] + step
        rhs(t, shifted, up, params)
        width = shifted[j]
        shifted[j] = y[j] - step
        rhs(t, shifted, down, params)
        width -= shifted[j]
        shifted[j] = y[j]
        for i in range(d):
            out[i, j] = (up[i] - down[i]) / width
    return 2 * d


@entry(RHS, JAC, I8, F8, VEC, VEC, MAT)
def jacobian_at(rhs, jac, has_jac, t, y, params, out):
    """Set the Jacobian at (t, y), for one call from Python."""
    jacobian(rhs, jac, has_jac, t, y, params, out)
