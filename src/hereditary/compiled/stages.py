"""Newton's method for a collocation step of many components, one Jacobian for all its stages.

Where components share their terms, the derivative of the residuals of nodal values x (d, s) is ``x
M^T - J x G^T`` with matrices M and G (s, s) of all components and one Jacobian J for all nodes.
With ``M^-1 G = V Lambda V^-1`` that is solved by systems ``(1 - lambda_k J) z = r`` of size d, one
for each pair of complex eigenvalues. V may be ill-conditioned: residuals are those of the equations
themselves, so that its rounding errors leave with the next iteration. Source: [HairerWanner1996],
section IV.8, for M = 1.

For components whose terms differ the derivative is ``M_c x_c - sum_e J_ce G_ce x_e`` with matrices
of the kinds of components. Those of one kind would be diagonal in a common basis, those of several
have none, so the system of size d s is solved as it is: s times the diagonals of a banded J, s**2
times its entries.
"""

import numpy as np

from .callbacks import PythonRaised, call_at, call_lapack
from .collocation import (
    contraction_rate,
    empty_room,
    forces,
    positions,
    residuals,
    solve_newton,
    take_change,
)
from .jacobian import COLUMNS, ROWS, VALUES, is_sparse, jacobian, multiply
from .jit import allocating, compiled, inner, reordered
from .linalg import (
    dense_solver,
    product,
    put,
    put_matrix,
    solve_in_place,
    sums_of_sizes,
    transposed_product,
)
from .mode_tables import read_modes
from .rows import FORCE, POSITION, PRIMARY
from .signatures import FACTORISE, LinearSolver
from .sparse_solvers import banded_solver, sparse_solver, substitute_band
from .structures import KEPT, LENGTH, OF_SPEEDS, OF_VALUES, REDUCED, REST, SYSTEMS, StageFactors

# LAPACK's letters: left eigenvectors are not wanted, right ones are.
_WITHOUT, _WITH = ord("N"), ord("V")


@allocating
def transform(stage):
    """Set the eigenvalues that are needed, and both transforms; False where there are none."""
    gain, rest = stage.pencil[0, stage.second[0]], stage.pencil[0, REST]
    s = gain.shape[0]
    inverse = np.empty((s, s))
    for j in range(s):
        column = np.zeros(s)
        column[j] = 1.0
        if not solve_in_place(rest.copy(), column):
            return False
        inverse[:, j] = column
    product = inverse @ gain
    values, imaginary, vectors = np.empty(s), np.empty(s), np.empty((s, s))
    if not eigenvectors(stage.lapack_values, product, values, imaginary, vectors):
        return False
    # a pair of vectors v +- i w is held as v and w, so that this inverse is real as well
    back, kept = np.linalg.inv(vectors).T.copy() @ inverse, 0
    for k in range(s):
        if imaginary[k] < 0.0:  # the conjugate of the one before
            continue
        stage.shifts[kept] = complex(values[k], imaginary[k])
        for i in range(s):
            if imaginary[k] > 0.0:
                stage.forth[i, kept] = complex(vectors[k, i], vectors[k + 1, i])
                stage.back[kept, i] = complex(back[k, i], -back[k + 1, i])
            else:
                stage.forth[i, kept], stage.back[kept, i] = vectors[k, i], back[k, i]
        kept += 1
    stage.control[SYSTEMS] = kept
    return True


@allocating
def eigenvectors(lapack, matrix, values, imaginary, vectors):
    """Set both parts of the eigenvalues, (s,), and the eigenvectors by LAPACK; False if it fails.

    Vectors are rows, (s, s): the real part of a pair and then its imaginary part, of the eigenvalue
    above the real axis, which comes first.
    """
    s = values.shape[0]
    for value in matrix.ravel():
        if not abs(value) < np.inf:
            return False
    # the columns of a square, and room; sizes, what LAPACK returns, and two letters: both arrays
    # are alive until LAPACK returns
    room, numbers = np.empty((s + 8, s)), np.empty(5, dtype=np.int32)
    for i in range(s):
        for k in range(s):
            room[k, i] = matrix[i, k]
    numbers[0], numbers[1], numbers[2], numbers[3], numbers[4] = s, 8 * s, 0, _WITHOUT, _WITH
    at, turned, work = numbers.ctypes.data, room.ctypes.data, room[s:].ctypes.data
    call_lapack(  # type: ignore[call-arg]
        lapack,
        (at + 12, at + 16, at, turned, at, values.ctypes.data, imaginary.ctypes.data, work, at,
         vectors.ctypes.data, at, work, at + 4, at + 8),
    )  # fmt: skip
    return numbers[2] == 0 and room[0, 0] == room[0, 0]


@reordered
def project(k, values, stage, out):
    """Set the right-hand side of system k, (d,), from nodal values (d, s)."""
    real, imaginary = stage.back[k].real.copy(), stage.back[k].imag.copy()
    for c in range(out.shape[0]):
        a, b = 0.0, 0.0
        for i in range(real.shape[0]):
            a += real[i] * values[c, i]
            b += imaginary[i] * values[c, i]
        out[c] = complex(a, b)


@allocating
def add_solution(k, solution, stage, out):
    """Add the solution of system k, (d,), to nodal values (d, s)."""
    real, imaginary = stage.forth[:, k].real.copy(), stage.forth[:, k].imag.copy()
    for c in range(solution.shape[0]):
        a, b = solution[c].real, solution[c].imag
        for i in range(real.shape[0]):
            out[c, i] += real[i] * a - imaginary[i] * b


@compiled
def no_stages(task, values, stage):
    """Do nothing, in place of a solver: steps are solved as one system."""
    return 1


@compiled
def dense_stages(task, values, stage):
    """Factorise all systems of a dense Jacobian, or solve them for nodal values; 0 if done.

    With ``J = Q H Q^T``, H being zero below its first subdiagonal, every system costs d**2.
    """
    # dense (2 + 2 K, n, n): H, Q, and real and imaginary part of each system's factors, whose
    # subdiagonal holds the multipliers; factors (K, 1, n): 1 where rows were exchanged
    n = stage.order.shape[0]
    if task == FACTORISE:
        if not transform(stage) or (stage.control[REDUCED] == 0.0 and not reduce(stage)):
            return 1
        stage.control[REDUCED] = 1.0
        for k in range(int(stage.control[SYSTEMS])):
            real, imaginary = stage.dense[2 + 2 * k], stage.dense[3 + 2 * k]
            if not eliminate(stage.shifts[k], stage.dense[0], real, imaginary, stage.factors[k, 0]):
                return 1
        return 0
    turned, found = np.empty(values.shape), np.zeros(values.shape)
    transposed_product(stage.dense[1], values, turned)
    right = np.empty(n, dtype=np.complex128)
    for k in range(int(stage.control[SYSTEMS])):
        project(k, turned, stage, right)
        real, imaginary = stage.dense[2 + 2 * k], stage.dense[3 + 2 * k]
        substitute_hessenberg(real, imaginary, stage.factors[k, 0], right)
        add_solution(k, right, stage, found)
    product(stage.dense[1], found, values)
    return 0


@allocating
def reduce(stage):
    """Set H and Q of ``J = Q H Q^T`` by LAPACK; False where J is not finite."""
    n = stage.order.shape[0]
    h, q = stage.dense[0], stage.dense[1]
    for i in range(n):
        for j in range(n):
            q[j, i] = stage.jacobian[i, j]  # LAPACK's matrices have their columns in a row
            if not abs(q[j, i]) < np.inf:
                return False
    numbers, room = np.empty(4, dtype=np.int32), np.empty(65 * n)
    numbers[0], numbers[1], numbers[2], numbers[3] = n, 1, 64 * n, 0
    at, tau = numbers.ctypes.data, room.ctypes.data
    work = tau + 8 * n
    for step in range(2):
        address = stage.lapack if step == 0 else stage.lapack_solve
        call_lapack(  # type: ignore[call-arg]
            address, (at, at + 4, at, q.ctypes.data, at, tau, work, at + 8, at + 12)
        )
        for i in range(n if step == 0 else 0):
            for j in range(n):
                h[i, j] = q[j, i] if i <= j + 1 else 0.0
    for i in range(n):
        for j in range(i):
            q[i, j], q[j, i] = q[j, i], q[i, j]
    return numbers[3] == 0 and room[0] == room[0]


@inner
def eliminate(shift, h, real, imaginary, exchanged):
    """Set the factors of ``1 - shift H``, pivots inverted, rows exchanged where that is needed."""
    n = h.shape[0]
    set_shifted_row(0, shift, h, real, imaginary)
    for j in range(n):
        below = 0.0
        if j < n - 1:  # each row just before it is needed: it stays in the near cache
            set_shifted_row(j + 1, shift, h, real, imaginary)
            below = abs(real[j + 1, j]) + abs(imaginary[j + 1, j])
        exchanged[j] = 0.0
        if below > abs(real[j, j]) + abs(imaginary[j, j]):
            exchanged[j] = 1.0
            for k in range(j, n):
                real[j, k], real[j + 1, k] = real[j + 1, k], real[j, k]
                imaginary[j, k], imaginary[j + 1, k] = imaginary[j + 1, k], imaginary[j, k]
        pivot = complex(real[j, j], imaginary[j, j])
        if not 0.0 < abs(pivot) < np.inf:
            return False
        inverse = 1.0 / pivot
        real[j, j], imaginary[j, j] = inverse.real, inverse.imag
        if j == n - 1:
            break
        factor = complex(real[j + 1, j], imaginary[j + 1, j]) * inverse
        a, b = factor.real, factor.imag
        real[j + 1, j], imaginary[j + 1, j] = a, b
        upper, upper_i, lower, lower_i = real[j], imaginary[j], real[j + 1], imaginary[j + 1]
        for k in range(j + 1, n):
            lower[k] -= a * upper[k] - b * upper_i[k]
            lower_i[k] -= a * upper_i[k] + b * upper[k]
    return True


@inner
def set_shifted_row(i, shift, h, real, imaginary):
    """Set a row of ``1 - shift H``."""
    a, b = shift.real, shift.imag
    own, row, row_i = h[i], real[i], imaginary[i]
    for j in range(max(0, i - 1), h.shape[0]):
        row[j], row_i[j] = -a * own[j], -b * own[j]
    row[i] += 1.0


@allocating
def substitute_hessenberg(real, imaginary, exchanged, x):
    """Solve for x (n,) with the factors of `eliminate`."""
    n = x.shape[0]
    x_real, x_imaginary = np.empty(n), np.empty(n)
    for j in range(n - 1):
        if exchanged[j].real == 1.0:
            x[j], x[j + 1] = x[j + 1], x[j]
        x[j + 1] -= complex(real[j + 1, j], imaginary[j + 1, j]) * x[j]
    for j in range(n - 1, -1, -1):
        a, b = complex_dot(real[j], imaginary[j], x_real, x_imaginary, j + 1, n)
        x[j] = (x[j] - complex(a, b)) * complex(real[j, j], imaginary[j, j])
        x_real[j], x_imaginary[j] = x[j].real, x[j].imag


@reordered
def complex_dot(real, imaginary, x_real, x_imaginary, first, end):
    """Return both parts of the sum of products of two complex vectors."""
    a, b = 0.0, 0.0
    c, d = real[first:end], imaginary[first:end]
    x, y = x_real[first:end], x_imaginary[first:end]
    for k in range(c.shape[0]):  # from 0 on: vectorised
        a += c[k] * x[k] - d[k] * y[k]
        b += c[k] * y[k] + d[k] * x[k]
    return a, b


@compiled
def banded_stages(task, values, stage):
    """Factorise all systems of a banded Jacobian, or solve them for nodal values; 0 if done."""
    # factors (K, n, 2 lower + upper + 2), see `substitute_band`
    n, place, lower, upper = stage.order.shape[0], stage.order, stage.lower, stage.upper
    width, entries = stage.factors.shape[2] - 1, stage.jacobian
    if task == FACTORISE:
        pivots, numbers = np.empty(n, dtype=np.int32), np.empty(5, dtype=np.int32)
        numbers[0], numbers[1], numbers[2], numbers[3] = n, lower, upper, width + 1
        numbers[4], at = 0, numbers.ctypes.data
        if not transform(stage):
            return 1
        for k in range(int(stage.control[SYSTEMS])):
            factors = stage.factors[k]
            factors[:] = 0.0
            for e in range(entries.shape[1]):
                i, j = place[int(entries[ROWS, e])], place[int(entries[COLUMNS, e])]
                factors[j, lower + upper + i - j] -= stage.shifts[k] * entries[VALUES, e]
            for j in range(n):
                factors[j, lower + upper] += 1.0
            call_lapack(  # type: ignore[call-arg]
                stage.lapack,
                (at, at, at + 4, at + 8, factors.ctypes.data, at + 12, pivots.ctypes.data,
                 at + 16),
            )  # fmt: skip
            if numbers[4] != 0:
                return 1
            for j in range(n):
                factors[j, width] = pivots[j] - 1
                factors[j, lower + upper] = 1.0 / factors[j, lower + upper]
        return 0
    right, ordered = np.empty((2, n), dtype=np.complex128)
    found = np.zeros(values.shape)
    for k in range(int(stage.control[SYSTEMS])):
        project(k, values, stage, right)
        for i in range(n):
            ordered[place[i]] = right[i]
        substitute_band(stage.factors[k], lower, upper, ordered)
        for i in range(n):
            right[i] = ordered[place[i]]
        add_solution(k, right, stage, found)
    values[:] = found
    return 0


@compiled
def sparse_stages(task, values, stage):
    """Factorise all systems of a sparse Jacobian in Python, or solve them; 0 if done."""
    n, found = stage.order.shape[0], np.zeros(values.shape)
    if task == FACTORISE and not transform(stage):
        return 1
    right = np.empty(n, dtype=np.complex128)
    for k in range(int(stage.control[SYSTEMS])):
        given, wanted = stage.jacobian.ctypes.data, right.ctypes.data
        if task == FACTORISE:
            right[0] = stage.shifts[k]
        else:
            project(k, values, stage, right)
        status: int = call_at(stage.python, 2.0 * k + task, given, wanted)  # type: ignore[call-arg]
        if status < 0:
            raise PythonRaised
        if status > 0:
            return status
        if task != FACTORISE:
            add_solution(k, right, stage, found)
    if task != FACTORISE:
        values[:] = found
    return 0


@inner
def set_joint(stage):
    """Set the matrix of all stages, unknowns in the order (c, i)."""
    jacobian, kinds, pencil, out = stage.jacobian, stage.kinds, stage.pencil, stage.joint
    d, s = kinds.shape[0], pencil.shape[2]
    if not is_sparse(jacobian, d):
        for c in range(d):
            for e in range(d):
                block = out[c * s : (c + 1) * s, e * s : (e + 1) * s]
                gain = pencil[kinds[c], stage.second[kinds[e]]]
                for i in range(s):
                    for j in range(s):
                        block[i, j] = -jacobian[c, e] * gain[i, j]
                        if c == e:
                            block[i, j] += pencil[kinds[c], REST, i, j]
        return
    number = 0
    for entry in range(jacobian.shape[1]):
        c, e = int(jacobian[ROWS, entry]), int(jacobian[COLUMNS, entry])
        gain, rest = pencil[kinds[c], stage.second[kinds[e]]], pencil[kinds[c], REST]
        for i in range(s):
            for j in range(s):
                own = rest[i, j] if c == e else 0.0
                out[VALUES, number] = own - jacobian[VALUES, entry] * gain[i, j]
                number += 1


@allocating
def linear_solver(stage):
    """Allocate a real linear solver for all unknowns."""
    return LinearSolver(
        stage.dense, stage.order, stage.lower, stage.upper, stage.lapack, stage.python, 0, 0
    )


def joint_stages(name, solver):
    """Compile the solution of the system by one of the real linear solvers."""

    def solve(task, values, stage):
        if task == FACTORISE:
            set_joint(stage)
        return solver(task, 0, stage.joint, values.reshape(values.size), linear_solver(stage))

    solve.__name__ = solve.__qualname__ = name
    solve.__doc__ = "Factorise the system of all stages, or solve it for nodal values; 0 if done."
    return compiled(solve)


joint_dense = joint_stages("joint_dense", dense_solver)
joint_banded = joint_stages("joint_banded", banded_solver)
joint_sparse = joint_stages("joint_sparse", sparse_solver)


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
    """Solve the tangents by the orbit's systems, to the Jacobians of all stages."""
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
