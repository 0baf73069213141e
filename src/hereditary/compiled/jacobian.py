"""The Jacobian of a right-hand side, from the user or by differences: dense or sparse.

A sparse one is an array (5, k) of its k entries: values, rows, columns, groups and constants.
Columns of one group share no row, so that one difference serves them all; entries stand in the
order of their groups. Systems of few components are always dense, so these shapes never coincide.
"""

import numpy as np

from .jit import (
    F8,
    MAT,
    VEC,
    allocating,
    as_value,
    compiled,
    entry,
    inlined,
    inner,
    plug_in,
    reordered,
)
from .linalg import dot
from .signatures import JACOBIAN_SIG, RIGHT_SIDE, RightSide, UserFunctions

# Components up to which a system is dense whatever is stated: nothing is gained below.
FEW = 9
# Central differences lose least at the cube root of the rounding unit, 6e-6: error 4e-11 relative.
_STEP = 6.055454452393343e-06
# Least unit and least tolerance: smaller numbers lose their digits. No run changes with ten times
# this, not even from y(0) = 1e-190.
LEAST = 1e-200
# Rows of the entries of a sparse Jacobian. Where it is given, the place of each value in the array
# that the user's function fills (-1: none) stands for its group; constants are added to these.
VALUES, ROWS, COLUMNS, GROUPS, CONSTANTS, N_ENTRY_ROWS = range(6)


@inlined
def is_sparse(j_f, n):
    """Return whether a Jacobian of n components is given by its entries."""
    return j_f.shape[0] != n


@allocating
def jacobian(rhs, jac, has_jac, t, y, params, units, out):
    """Set out[i, j] = d rhs_i / d y_j at (t, y), by differences if `has_jac` is 0.

    Returns the number of calls of `rhs`.
    """
    # y (d,), units (d,) of steps where y is small; out (d, d), or (5, k) with rows, columns and
    # groups set
    if has_jac == 1:
        jac(t, y, out, params)
        return 0
    if is_sparse(out, y.shape[0]):
        return grouped_differences(rhs, t, y, params, units, out)
    return ungrouped_differences(rhs, t, y, params, units, out)


@allocating
def ungrouped_differences(rhs, t, y, params, units, out):
    """Set a dense Jacobian by differences."""
    d = y.shape[0]
    up, down, shifted = np.empty(d), np.empty(d), np.empty(d)
    for j in range(d):  # y.copy() takes longer to compile
        shifted[j] = y[j]
    return differences(rhs, t, shifted, params, units, out, up, down)


@inner
def differences(rhs, t, y, params, units, out, up, down):
    """Set the Jacobian by central differences, moving y; up and down (>= d,) are room.

    They are one-sided where f is finite on one side alone. Returns the number of calls of `rhs`.
    """
    d, calls = y.shape[0], 2 * y.shape[0]
    for j in range(d):
        here = y[j]
        step = _STEP * max(units[j], abs(here))
        y[j] = here + step
        rhs(t, y, up[:d], params)
        width = y[j]
        y[j] = here - step
        rhs(t, y, down[:d], params)
        width -= y[j]
        y[j] = here
        if not finite_between(d, up, down):
            extend(rhs, t, y, params, up, down)
            calls += 1
        for i in range(d):
            out[i, j] = (up[i] - down[i]) / width
    return calls


@inlined
def finite_between(d, up, down):
    """Return whether the differences of d values are finite."""
    finite = True
    for i in range(d):
        finite = finite and abs(up[i] - down[i]) < np.inf
    return finite


@allocating
def extend(rhs, t, y, params, up, down):
    """Continue f by a straight line to the side of y where it is not finite.

    up, down (>= d,) are its values at equal distances from y (d,).
    """
    middle = np.empty(y.shape[0])
    rhs(t, y, middle, params)
    for i in range(y.shape[0]):
        if not abs(down[i]) < np.inf:
            down[i] = 2.0 * middle[i] - up[i]
        elif not abs(up[i]) < np.inf:
            up[i] = 2.0 * middle[i] - down[i]


@allocating
def grouped_differences(rhs, t, y, params, units, out):
    """Set the values of a sparse Jacobian, one group of columns after the other."""
    up, down, shifted = np.empty(y.shape[0]), np.empty(y.shape[0]), np.empty(y.shape[0])
    for j in range(y.shape[0]):
        shifted[j] = y[j]
    first, calls = 0, 0
    while first < out.shape[1]:
        end = first
        while end < out.shape[1] and out[GROUPS, end] == out[GROUPS, first]:
            j = int(out[COLUMNS, end])
            shifted[j] = y[j] + _STEP * max(units[j], abs(y[j]))
            end += 1
        rhs(t, shifted, up, params)
        for k in range(first, end):
            j = int(out[COLUMNS, k])
            shifted[j] = y[j] - _STEP * max(units[j], abs(y[j]))
        rhs(t, shifted, down, params)
        calls += 2
        if not finite_between(y.shape[0], up, down):
            extend(rhs, t, y, params, up, down)
            calls += 1
        for k in range(first, end):
            i, j = int(out[ROWS, k]), int(out[COLUMNS, k])
            step = _STEP * max(units[j], abs(y[j]))
            out[VALUES, k] = (up[i] - down[i]) / ((y[j] + step) - (y[j] - step))
        for k in range(first, end):
            j = int(out[COLUMNS, k])
            shifted[j] = y[j]
        first = end
    return calls


@inner
def multiply(j_f, x, out):
    """Set out = J x, of a dense Jacobian or a sparse one."""
    n = x.shape[0]
    for i in range(n):
        out[i] = 0.0 if is_sparse(j_f, n) else dot(j_f[i], x, 0, n)
    if is_sparse(j_f, n):
        for k in range(j_f.shape[1]):
            out[int(j_f[ROWS, k])] += j_f[VALUES, k] * x[int(j_f[COLUMNS, k])]


@reordered
def magnitudes(j_f, x, out):
    """Set out = |J| |x|, of a dense Jacobian or a sparse one."""
    n = x.shape[0]
    for i in range(n):
        total, row = 0.0, j_f[i if n == j_f.shape[0] else 0]
        for k in range(0 if is_sparse(j_f, n) else n):
            total += abs(row[k] * x[k])
        out[i] = total
    for k in range(j_f.shape[1] if is_sparse(j_f, n) else 0):
        out[int(j_f[ROWS, k])] += abs(j_f[VALUES, k] * x[int(j_f[COLUMNS, k])])


@inner
def newton_matrix(j_f, n, d, sources, gain, scale, lead, out):
    """Set the derivative of ``scale w - lead f(t, base + gain w)`` by w, of J as dense or sparse.

    Components beyond d have no equation: their w is left as it is.
    """
    if is_sparse(j_f, n):
        for k in range(j_f.shape[1]):
            i, j = int(j_f[ROWS, k]), int(j_f[COLUMNS, k])
            out[VALUES, k] = (scale[i] if i == j else 0.0) - gain[j] * lead[i] * j_f[VALUES, k]
        return
    for i in range(n):
        for k in range(n):
            out[i, k] = 0.0
        for k in range(n if i < d else 0):
            out[i, sources[k]] -= gain[k] * lead[i] * j_f[i, k]
        out[i, i] += scale[i] if i < d else 1.0


@compiled
def no_jacobian(t, y, out, params):
    """Do nothing, in place of a Jacobian."""


@plug_in
def given_jacobian(functions, t, y, units, out):
    """Set the Jacobian that the user gives."""
    functions.jac(t, y, out, functions.params)
    return 0


@plug_in
def dense_jacobian(functions, t, y, units, out):
    """Set a dense Jacobian by differences."""
    return ungrouped_differences(functions.rhs, t, y, functions.params, units, out)


@plug_in
def sparse_jacobian(functions, t, y, units, out):
    """Set the entries of a sparse Jacobian by differences."""
    return grouped_differences(functions.rhs, t, y, functions.params, units, out)


def right_side(functions, sparse):
    """Return a `RightSide` of rhs, its Jacobian, whether that is given, and parameters."""
    rhs, jac, has_jac, params = functions
    by_differences = sparse_jacobian if sparse else dense_jacobian
    how = as_value(given_jacobian if has_jac else by_differences, JACOBIAN_SIG)
    return RightSide(UserFunctions(rhs, jac, params), how)


@entry(RIGHT_SIDE, F8, VEC, VEC, MAT)
def jacobian_at(right, t, y, units, out):
    """Set the Jacobian at (t, y), for one call from Python."""
    right.jacobian(right.user, t, y, units, out)


@inner
def push_tangents(d, j_f, x, f):
    """Set the right-hand sides of the tangents: the Jacobian times each of them."""
    # x, f (W,), of d components of the orbit and then those of tangents
    for first in range(d, x.shape[0], d):
        multiply(j_f, x[first : first + d], f[first : first + d])


@inner
def evaluate(rhs, jac, has_jac, params, t, d, x, units, j_f, f, counts):
    """Evaluate right-hand sides of orbit and tangents, and count calls of `rhs`."""
    # x, f (W,), d components of the orbit; j_f takes the Jacobian where there are tangents
    orbit = x[:d]
    rhs(t, orbit, f[:d], params)
    counts.rhs += 1
    if x.shape[0] > d:
        counts.rhs += jacobian(rhs, jac, has_jac, t, orbit, params, units, j_f)
        push_tangents(d, j_f, x, f)
