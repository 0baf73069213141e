"""Newton's method for a collocation step of many components, one Jacobian for all its stages."""

import numpy as np

from .collocation import (
    contraction_rate,
    empty_room,
    forces,
    positions,
    residuals,
    solve_newton,
    take_change,
)
from .copying import put, put_matrix
from .jacobian import COLUMNS, ROWS, VALUES, is_sparse, jacobian, multiply
from .jit import allocating, inner
from .linalg import product, sums_of_sizes
from .mode_tables import read_modes
from .rows import FORCE, POSITION, PRIMARY
from .signatures import FACTORISE
from .structures import KEPT, LENGTH, OF_SPEEDS, OF_VALUES, REDUCED, REST, StageFactors

# Newton iterations before a step is refused, and contraction from which a Jacobian is not kept.
_SWEEPS, _SLOW = 12, 0.05
# Iterations for a tangent, and the relative change that ends them.
_TANGENT_SWEEPS, _TANGENT_GOAL = 30, 1e-11


@allocating
def stage_factors(d, s, n_checks, solver, stages):
    """Join the solver of the stages, the scales of f and the room of a step."""
    room = empty_room(d, s, n_checks)
    return StageFactors(solver, stages, np.zeros(d), np.zeros(d), np.zeros(d), room)


@inner
def solve_many(
    rhs, jac, has_jac, params, times, h, base, x_start, second, operators, kinds, integral, goal,
    values, counts, contraction, newton,
):  # fmt: skip
    """Solve the equations of a step by systems of the size of the equation.

    The Jacobian is kept over steps while the method converges fast, and factors as long as the
    step's length stays.
    """
    f, p, x = values[FORCE], values[PRIMARY], values[POSITION]
    stages, control = newton.stages, newton.stages.control
    room, s = newton.room, p.shape[1]
    residual, change, before = room.residual, room.change, room.before
    previous, fresh = np.inf, False
    positions(h, p, x_start, second, integral, x)
    if set_pencil(h, operators.matrices, integral, stages.second, stages.pencil):
        control[LENGTH] = 0.0
    for sweep in range(_SWEEPS):
        if control[KEPT] == 0.0:
            put(x[:, s // 2], room.point)
            counts.rhs += jacobian(
                rhs, jac, has_jac, times[s // 2], room.point, params, room.units, stages.jacobian
            )
            control[KEPT], control[LENGTH], control[REDUCED], fresh = 1.0, 0.0, 0.0, True
        if control[LENGTH] != h:
            control[LENGTH] = 0.0
            if newton.solver(FACTORISE, p, stages) != 0:
                control[KEPT] = 0.0  # it may hold what is no number
                return False
            control[LENGTH], previous = h, np.inf
        forces(rhs, params, times, x, f, room)
        counts.rhs += s
        residuals(base, operators, kinds, p, x, f, residual)
        solve_newton(newton, residual, change)
        size = take_change(change, goal, p)
        if not size < np.inf:
            control[KEPT] = 0.0
            return False
        put_matrix(x, before)
        positions(h, p, x_start, second, integral, x)
        rate = contraction_rate(size, previous, h, contraction)
        if size * min(1.0, 4.0 * rate) < 1.0:
            set_scales(stages.jacobian, x, newton)
            correct_forces(stages.jacobian, before, x, f)
            return True
        if previous < np.inf and rate > _SLOW:
            if rate > 0.9 and sweep > 5:
                control[KEPT] = 0.0
                return False
            if not fresh:  # one of an earlier step
                control[KEPT] = 0.0
        previous = size
    control[KEPT] = 0.0
    return False


@inner
def read_many(modes, to_nodes, out):
    """Read the modes by a matrix product."""
    if modes.shape[0] == out.shape[0]:
        product(modes, to_nodes, out)
    else:
        read_modes(modes, to_nodes, out)


@inner
def set_pencil(h, matrices, integral, second, pencil):
    """Set matrices with which the residuals of component c change by ``M x_c - sum_e J_ce G x_e``.

    M and both G are those of the kind of c, G for x_e that are values of y and for those of y'.
    Returns whether they were others: orders that vary change them at any length.
    """
    # matrices (., 3, s, s), second (n,), pencil (n, 3, s, s)
    s, changed, speeds = integral.shape[0], False, False
    for kind in range(second.shape[0]):
        speeds = speeds or second[kind] == 1
    for kind in range(second.shape[0]):
        own, out = matrices[kind], pencil[kind]
        for i in range(s):
            for j in range(s):
                gain, rest = 0.0, 0.0
                for k in range(s if speeds else 0):
                    gain += h * own[FORCE, i, k] * integral[k, j]
                    rest += h * own[POSITION, i, k] * integral[k, j]
                rest = rest if second[kind] == 1 else own[POSITION, i, j]
                rest = (1.0 if i == j else 0.0) - own[PRIMARY, i, j] - rest
                changed = changed or out[OF_VALUES, i, j] != own[FORCE, i, j]
                changed = changed or out[OF_SPEEDS, i, j] != gain or out[REST, i, j] != rest
                out[OF_VALUES, i, j], out[OF_SPEEDS, i, j] = own[FORCE, i, j], gain
                out[REST, i, j] = rest
    return changed


@allocating
def set_scales(j_f, x, newton):
    """Set |J| |y|, with y at the last node, the size of the summands of f, and |J| |y(0)|."""
    d, starts = newton.starts.shape[0], newton.starts
    newton.force_scales[:], newton.start_scales[:] = 0.0, 0.0
    ends = np.abs(x[:, -1])
    for c in range(0 if is_sparse(j_f, d) else d):
        newton.force_scales[c], newton.start_scales[c] = sums_of_sizes(j_f[c], ends, starts)
    for k in range(j_f.shape[1] if is_sparse(j_f, d) else 0):
        c, e, size = int(j_f[ROWS, k]), int(j_f[COLUMNS, k]), abs(j_f[VALUES, k])
        newton.force_scales[c] += size * ends[e]
        newton.start_scales[c] += size * starts[e]


@allocating
def correct_forces(j_f, before, x, f):
    """Correct f (d, s) to first order from y = `before` to y = x."""
    d = x.shape[0]
    moved = x - before
    if not is_sparse(j_f, d):
        more = np.empty(x.shape)
        product(j_f, moved, more)
        f += more
        return
    for k in range(j_f.shape[1]):
        c, e, value = int(j_f[ROWS, k]), int(j_f[COLUMNS, k]), j_f[VALUES, k]
        for i in range(x.shape[1]):
            f[c, i] += value * moved[e, i]


@allocating
def solve_many_tangents(
    rhs, jac, has_jac, params, times, h, base, x_start, second, operators, kinds, integral, values,
    counts, newton,
):  # fmt: skip
    """As `solve_tangents`, by the orbit's systems, until the Jacobians of all stages hold."""
    d, s = second.shape[0], base.shape[2]
    residual, change = np.empty(d * s), np.empty(d * s)
    shape = newton.stages.jacobian.shape
    jacobians, more, units = np.empty((s, shape[0], shape[1])), np.empty(d), newton.room.units
    for i in range(s):
        jacobians[i] = newton.stages.jacobian
        point = values[0, POSITION, :, i].copy()
        counts.rhs += jacobian(rhs, jac, has_jac, times[i], point, params, units, jacobians[i])
    for column in range(1, base.shape[0]):
        f, p, x = values[column, FORCE], values[column, PRIMARY], values[column, POSITION]
        p[:], done = 0.0, False
        for _ in range(_TANGENT_SWEEPS):
            positions(h, p, x_start[column], second, integral, x)
            for i in range(s):
                multiply(jacobians[i], x[:, i].copy(), more)
                put(more, f[:, i])
            if done:
                break
            residuals(base[column], operators, kinds, p, x, f, residual)
            solve_newton(newton, residual, change)
            moved, size = 0.0, 0.0
            for c in range(d):
                for i in range(s):
                    p[c, i] -= change[c * s + i]
                    moved = max(moved, abs(change[c * s + i]))
                    size = max(size, abs(p[c, i]))
            done = moved <= _TANGENT_GOAL * size
            if not moved < np.inf:
                return False
        if not done:
            return False
    return True
