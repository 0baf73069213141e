"""The Jacobian of a right-hand side, from the user or by differences: dense or sparse.

A dense Jacobian of d components is an array (d, d). A sparse one is an array (5, k) of its k
entries: values, rows, columns, groups and constants. Columns of one group share no row, so that one
difference of the right-hand side gives all of their entries. Entries are sorted by their group.
Systems of at most `FEW` components are always dense, so that d is never 5 for a sparse Jacobian.
"""

import numpy as np

from .functions import (
    GIVEN,
    Functions,
    force_of,
    n_blends,
    set_force,
    set_force_with,
    set_slopes,
    slopes_of_user,
)
from .jit import F8, MAT, VEC, as_value, checked, entry, inner, plug_in
from .linalg import dot
from .signatures import JACOBIAN_SIG, RIGHT_SIDE, RightSide

# Largest number of components for which the Jacobian is dense even if the user states a pattern: a
# sparse one would save nothing.
FEW = 9
# Step of central differences relative to a component or its unit: the cube root of the rounding
# unit, where truncation and rounding add up to the least error, about 4e-11 relative.
_DIFFERENCE_STEP = 6.055454452393343e-06
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


@inner
def extend(middle, up, down):
    """Replace infinite values of f by linear extrapolation from the other side of y."""
    # middle (d,) is f at y; up and down are f at equal distances above and below y
    for i in range(middle.shape[0]):
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


@plug_in
def given_jacobian(force, t, y, units, out):
    """Set `out` to the Jacobian by the user's function; return 0, the number of calls of f."""
    functions = force.functions
    functions.jac(t + functions.start, y, out.reshape(out.size), functions.params)
    return 0


@plug_in
def composed_jacobian(force, t, y, units, out):
    """Set `out` to the user's Jacobian and what stands around it; return calls of f."""
    if n_blends(force.functions) > 0:
        return differences_of(force, t, y, units, out)
    set_slopes(force.functions, t, y, out)
    return 0


@plug_in
def entries_jacobian(force, t, y, units, out):
    """Set the values of a sparse Jacobian by the user's function; return 0."""
    values = slopes_of_user(force.functions, t, y)
    for k in range(out.shape[1]):
        place = int(out[GROUPS, k])
        out[VALUES, k] = out[CONSTANTS, k] + (values[place] if place >= 0 else 0.0)
    return 0


@plug_in
def dense_jacobian(force, t, y, units, out):
    """Set a dense Jacobian by central differences; return the number of calls of f."""
    return differences_of(force, t, y, units, out)


@inner(allocates=True)
def differences_of(force, t, y, units, out):
    """Set a dense Jacobian by central differences; return the number of calls of f."""
    # one-sided where f is finite on one side of y only
    d, calls = y.shape[0], 2 * y.shape[0]
    up, down, shifted = np.empty(d), np.empty(d), np.empty(d)
    for j in range(d):  # a loop, because y.copy() takes longer to compile
        shifted[j] = y[j]
    for j in range(d):
        step = _DIFFERENCE_STEP * max(units[j], abs(y[j]))
        shifted[j] = y[j] + step
        set_force(force, t, shifted, up)
        width = shifted[j]
        shifted[j] = y[j] - step
        set_force(force, t, shifted, down)
        width -= shifted[j]
        shifted[j] = y[j]
        if not finite_between(d, up, down):
            middle = np.empty(d)
            set_force(force, t, shifted, middle)
            extend(middle, up, down)
            calls += 1
        for i in range(d):
            out[i, j] = (up[i] - down[i]) / width
    return calls


@plug_in
def sparse_jacobian(force, t, y, units, out):
    """Set a sparse Jacobian by central differences of groups of columns; return calls of f."""
    up, down, shifted = np.empty(y.shape[0]), np.empty(y.shape[0]), np.empty(y.shape[0])
    for j in range(y.shape[0]):
        shifted[j] = y[j]
    first, calls = 0, 0
    while first < out.shape[1]:
        end = first
        while end < out.shape[1] and out[GROUPS, end] == out[GROUPS, first]:
            j = int(out[COLUMNS, end])
            shifted[j] = y[j] + _DIFFERENCE_STEP * max(units[j], abs(y[j]))
            end += 1
        set_force(force, t, shifted, up)
        for k in range(first, end):
            j = int(out[COLUMNS, k])
            shifted[j] = y[j] - _DIFFERENCE_STEP * max(units[j], abs(y[j]))
        set_force(force, t, shifted, down)
        calls += 2
        if not finite_between(y.shape[0], up, down):
            middle = np.empty(y.shape[0])
            set_force(force, t, y, middle)
            extend(middle, up, down)
            calls += 1
        for k in range(first, end):
            i, j = int(out[ROWS, k]), int(out[COLUMNS, k])
            step = _DIFFERENCE_STEP * max(units[j], abs(y[j]))
            out[VALUES, k] = (up[i] - down[i]) / ((y[j] + step) - (y[j] - step))
        for k in range(first, end):
            j = int(out[COLUMNS, k])
            shifted[j] = y[j]
        first = end
    return calls


@inner(allocates=True)
def add_derivative_by(k, force, t, y, out):
    """Add df / dp_k, by central differences, to out (d,); return the number of calls of f."""
    params = force.functions.params
    n, d, calls = params.shape[0], y.shape[0], 2
    up, down, changed = np.zeros(d), np.zeros(d), np.empty(n)  # f leaves memory unset
    for i in range(n):
        changed[i] = params[i]
    p = changed[k]
    step = _DIFFERENCE_STEP * (abs(p) if p != 0.0 else 1.0)
    changed[k] = p + step
    set_force_with(force, t, y, up, changed)
    width = changed[k]
    changed[k] = p - step
    set_force_with(force, t, y, down, changed)
    width -= changed[k]
    if not finite_between(d, up, down):
        middle = np.empty(d)
        set_force(force, t, y, middle)
        extend(middle, up, down)
        calls += 1
    for i in range(d):
        out[i] += (up[i] - down[i]) / width
    return calls


def right_side(functions: Functions, sparse: bool, by_params: int = 0) -> RightSide:
    """Return the `RightSide` of functions, with differences if they have no Jacobian."""
    if not functions.has_jac:
        jacobian = sparse_jacobian if sparse else dense_jacobian
    elif sparse:
        jacobian = entries_jacobian
    else:
        plain = functions.jac_form == GIVEN and not functions.in_python[1]
        bare = functions.bare and plain and not functions.places.size
        jacobian = given_jacobian if bare else composed_jacobian
    jacobian = as_value(jacobian, JACOBIAN_SIG)
    return checked(RightSide(force_of(functions), jacobian, by_params))


@entry(RIGHT_SIDE, F8, VEC, VEC)
def _force_at(right, t, y, out):
    """Set out = f(t, y)."""
    set_force(right.force, t, y, out)


def force_at(right: RightSide, t: float, y: np.ndarray, out: np.ndarray) -> None:
    """Set out = f(t, y); this is the way from Python."""
    if right.force.bare:
        functions = right.force.functions
        functions.rhs(t + functions.start, y, out, functions.params)
    else:
        _force_at(right, t, y, out)


@entry(RIGHT_SIDE, F8, VEC, VEC, MAT)
def jacobian_at(right, t, y, units, out):
    """Set `out` to the Jacobian at (t, y); this is the entry for Python."""
    right.jacobian(right.force, t, y, units, out)


@entry(RIGHT_SIDE, F8, VEC, MAT)
def derivatives_by_parameters(right, t, y, out):
    """Set row k of `out` (p, d) to the derivative of f by parameter k; the entry for Python."""
    out[:] = 0.0
    for k in range(out.shape[0]):
        add_derivative_by(k, right.force, t, y, out[k])
