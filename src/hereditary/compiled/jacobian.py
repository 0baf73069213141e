"""The Jacobian of a right-hand side, from the user or by differences: dense or sparse.

A dense Jacobian of d components is an array (d, d). A sparse one is an array (5, k) of its k
entries: values, rows, columns, groups and constants. Columns of one group share no row, so that one
difference of the right-hand side gives all of their entries. Entries are sorted by their group.
Systems of at most `FEW` components are always dense, so that d is never 5 for a sparse Jacobian.
"""

import numpy as np

from .jit import F8, JAC_SIG, MAT, VEC, as_value, compiled, entry, inner, plug_in
from .linalg import dot
from .signatures import JACOBIAN_SIG, RIGHT_SIDE, RightSide, UserFunctions

# Largest number of components for which the Jacobian is dense even if the user states a pattern: a
# sparse one would save nothing.
FEW = 9
# Step of central differences relative to a component or its unit: the cube root of the rounding
# unit, where truncation and rounding add up to the least error, about 4e-11 relative.
_STEP = 6.055454452393343e-06
# Least unit of a component, and least tolerance: smaller numbers lose digits by underflow. With ten
# times this value no run changes, not even one from y(0) = 1e-190.
LEAST = 1e-200
# Rows of the array of a sparse Jacobian, and their number. If the user gives the Jacobian, row
# GROUPS has the index of each value in the array that the user's function fills, or -1 if it has
# none. Row CONSTANTS has summands that are added to these values.
VALUES, ROWS, COLUMNS, GROUPS, CONSTANTS, N_ENTRY_ROWS = range(6)


@inner
def is_sparse(j_f, n):
    """Return whether the array `j_f` is a sparse Jacobian of n components, (5, k), not (n, n)."""
    return j_f.shape[0] != n


@inner
def finite_between(d, up, down):
    """Return whether `up - down` is finite in all of the first d entries."""
    finite = True
    for i in range(d):
        finite = finite and abs(up[i] - down[i]) < np.inf
    return finite


@inner(allocates=True)
def extend(rhs, t, y, params, up, down):
    """Replace values of f that are not finite by linear extrapolation from the other side of y.

    `up` and `down` are the values of f at equal distances above and below y (d,).
    """
    middle = np.empty(y.shape[0])
    rhs(t, y, middle, params)
    for i in range(y.shape[0]):
        if not abs(down[i]) < np.inf:
            down[i] = 2.0 * middle[i] - up[i]
        elif not abs(up[i]) < np.inf:
            up[i] = 2.0 * middle[i] - down[i]


@inner
def multiply(j_f, x, out):
    """Set out = J x for the Jacobian J = `j_f`, dense or sparse."""
    n = x.shape[0]
    for i in range(n):
        out[i] = 0.0 if is_sparse(j_f, n) else dot(j_f[i], x, 0, n)
    if is_sparse(j_f, n):
        for k in range(j_f.shape[1]):
            out[int(j_f[ROWS, k])] += j_f[VALUES, k] * x[int(j_f[COLUMNS, k])]


@inner(reorders=True)
def magnitudes(j_f, x, out):
    """Set out = |J| |x|, with moduli of all entries; the Jacobian J = `j_f` is dense or sparse."""
    n = x.shape[0]
    for i in range(n):
        total, row = 0.0, j_f[i if n == j_f.shape[0] else 0]
        for k in range(0 if is_sparse(j_f, n) else n):
            total += abs(row[k] * x[k])
        out[i] = total
    for k in range(j_f.shape[1] if is_sparse(j_f, n) else 0):
        out[int(j_f[ROWS, k])] += abs(j_f[VALUES, k] * x[int(j_f[COLUMNS, k])])


@compiled
def no_jacobian(t, y, out, params):
    """Do nothing: the field `jac` of an equation whose Jacobian comes from differences."""


@plug_in
def given_jacobian(functions, t, y, units, out):
    """Set `out` to the Jacobian by the user's function; return 0, the number of calls of `rhs`."""
    functions.jac(t, y, out, functions.params)
    return 0


@plug_in
def dense_jacobian(functions, t, y, units, out):
    """Set a dense Jacobian by central differences; return the number of calls of `rhs`.

    If f is finite on one side of y only, the differences are one-sided.
    """
    rhs, params, d, calls = functions.rhs, functions.params, y.shape[0], 2 * y.shape[0]
    up, down, shifted = np.empty(d), np.empty(d), np.empty(d)
    for j in range(d):  # a loop, because y.copy() takes longer to compile
        shifted[j] = y[j]
    for j in range(d):
        step = _STEP * max(units[j], abs(y[j]))
        shifted[j] = y[j] + step
        rhs(t, shifted, up, params)
        width = shifted[j]
        shifted[j] = y[j] - step
        rhs(t, shifted, down, params)
        width -= shifted[j]
        shifted[j] = y[j]
        if not finite_between(d, up, down):
            extend(rhs, t, shifted, params, up, down)
            calls += 1
        for i in range(d):
            out[i, j] = (up[i] - down[i]) / width
    return calls


@plug_in
def sparse_jacobian(functions, t, y, units, out):
    """Set the values of a sparse Jacobian by central differences.

    All columns of one group are shifted at once. Returns the number of calls of `rhs`.
    """
    rhs, params = functions.rhs, functions.params
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


@inner(allocates=True)
def add_derivative_by(k, functions, t, y, out):
    """Add df / dp_k, by central differences, to out (d,); return the number of calls of `rhs`."""
    rhs, n, d, calls = functions.rhs, functions.params.shape[0], y.shape[0], 2
    up, down, params = np.zeros(d), np.zeros(d), np.empty(n)  # f leaves memory unset
    for i in range(n):
        params[i] = functions.params[i]
    p = params[k]
    step = _STEP * (abs(p) if p != 0.0 else 1.0)
    params[k] = p + step
    rhs(t, y, up, params)
    width = params[k]
    params[k] = p - step
    rhs(t, y, down, params)
    width -= params[k]
    if not finite_between(d, up, down):
        extend(rhs, t, y, functions.params, up, down)
        calls += 1
    for i in range(d):
        out[i] += (up[i] - down[i]) / width
    return calls


def right_side(rhs, jac, params, sparse, by_params=0):
    """Return the `RightSide` of compiled functions, with differences if `jac` is None."""
    by_differences = sparse_jacobian if sparse else dense_jacobian
    how = as_value(by_differences if jac is None else given_jacobian, JACOBIAN_SIG)
    jac = as_value(no_jacobian, JAC_SIG) if jac is None else jac
    return RightSide(UserFunctions(rhs, jac, params), how, by_params)


@entry(RIGHT_SIDE, F8, VEC, VEC, MAT)
def jacobian_at(right, t, y, units, out):
    """Set `out` to the Jacobian at (t, y); this is the entry for Python."""
    right.jacobian(right.user, t, y, units, out)


@entry(RIGHT_SIDE, F8, VEC, MAT)
def derivatives_by_parameters(right, t, y, out):
    """Set row k of `out` (p, d) to the derivative of f by parameter k; the entry for Python."""
    out[:] = 0.0
    for k in range(out.shape[0]):
        add_derivative_by(k, right.user, t, y, out[k])
