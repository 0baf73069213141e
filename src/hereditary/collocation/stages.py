"""Linear systems of Newton's method for the s stages of a collocation step with d components.

Let x (d, s) be the values of the unknowns at the nodes. If all components have the same terms, the
residuals have the derivative ``x M^T - J x G^T``. All components share the matrices M and G (s, s),
and all nodes share one Jacobian J. With ``M^-1 G = V Lambda V^-1`` the system decouples into
systems ``(1 - lambda_k J) z = r`` of size d. One is solved for each pair of complex eigenvalues.

V may be ill-conditioned. The residuals are those of the original equations, so the next iteration
corrects the rounding errors of V. Source: [HairerWanner1996], section IV.8, for M = 1.

Components of one kind have the same terms. With several kinds the derivative is
``M_c x_c - sum_e J_ce G_ce x_e``, where M_c and G_ce depend on the kinds of components c and e. No
basis diagonalises the matrices of several kinds, so the system of size d s is solved directly. It
has s times as many diagonals as a banded J, and s**2 times as many entries as a sparse one. Few
components are solved directly as well, with a Jacobian at each node if Newton's method is slow.
"""

import math
from typing import Any

import numpy as np

from ..compiled.callbacks import PythonRaised, call_at, call_lapack
from ..compiled.jacobian import COLUMNS, LEAST, ROWS, VALUES
from ..compiled.jit import inner, plug_in
from ..compiled.linalg import (
    clear_matrix,
    factorise,
    factorise_large,
    product,
    put,
    put_matrix,
    solve_in_place,
    substitute,
    transpose,
    transposed_product,
)
from ..compiled.signatures import FACTORISE, LinearSolver
from ..compiled.sparse_solvers import (
    banded_solver,
    factorise_band,
    set_band,
    sparse_solver,
    substitute_band,
)
from .operators import FORCE, POSITION, PRIMARY
from .structures import OF_SPEEDS, OF_VALUES, REDUCED, REST, SYSTEMS

# Logarithm of the change of a scale with which a kept Jacobian gets new scales.
_CHANGED_MUCH = 7.0
# Option with which LAPACK computes no left eigenvectors.
_WITHOUT = ord("N")
# Option with which LAPACK computes right eigenvectors.
_WITH = ord("V")
# Option with which LAPACK balances a matrix by scaling, without permutations.
_SCALING = ord("S")


@inner(allocates=True)
def diagonalise_stages(stage):
    """Set the eigenvalues of M^-1 G and the transforms to and from its eigenvectors."""
    # one of each conjugate pair; False if M or the matrix of eigenvectors is singular
    s = stage.integral.shape[0]
    pencil = np.empty((3, s, s))
    set_pencil(stage.matrices[0], stage.integral, stage.above_one[0], pencil)
    gain, rest = pencil[stage.above_one[0]], pencil[REST]
    inverse, both, back = np.empty((s, s)), np.empty((s, s)), np.empty((s, s))
    if not set_inverse(rest, inverse):
        return False
    set_product(inverse, gain, both)
    values, imaginary, vectors = np.empty(s), np.empty(s), np.empty((s, s))
    if not eigenvectors(stage.lapack_values, both, values, imaginary, vectors):
        return False
    # a conjugate pair of vectors v +- i w is stored as v and w: the inverse is real as well
    if not set_inverse(vectors, both):
        return False
    transpose(both)
    set_product(both, inverse, back)
    kept = 0
    for k in range(s):
        if imaginary[k] < 0.0:  # the conjugate of eigenvalue k - 1
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


@inner(allocates=True)
def set_inverse(a, out):
    """Set `out` to the inverse of the matrix a (s, s); return False if a is singular."""
    # loops take less time to compile than NumPy's functions, and s is small
    s = a.shape[0]
    copied, column = np.empty((s, s)), np.empty(s)
    for j in range(s):
        for i in range(s):
            column[i] = 1.0 if i == j else 0.0
        put_matrix(a, copied)
        if not solve_in_place(copied, column):
            return False
        for i in range(s):
            out[i, j] = column[i]
    return True


@inner
def set_product(a, b, out):
    """Set ``out = a b`` for small matrices, (s, s)."""
    clear_matrix(out)
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]


@inner(allocates=True)
def eigenvectors(lapack, matrix, values, imaginary, vectors):
    """Compute eigenvalues and right eigenvectors of a matrix (s, s) by LAPACK, or return False."""
    # values, imaginary (s,): parts of eigenvalues, that above the real axis first; rows of vectors
    # (s, s): eigenvectors, of a pair its real and imaginary part
    s = values.shape[0]
    for i in range(s):
        for k in range(s):
            if not abs(matrix[i, k]) < np.inf:
                return False
    # `workspace` has the matrix by columns and LAPACK's workspace; `numbers` has sizes, the status
    # and two options. Both variables keep their arrays alive until LAPACK returns.
    workspace, numbers = np.empty((s + 8, s)), np.empty(5, dtype=np.int32)
    for i in range(s):
        for k in range(s):
            workspace[k, i] = matrix[i, k]
    numbers[0], numbers[1], numbers[2], numbers[3], numbers[4] = s, 8 * s, 0, _WITHOUT, _WITH
    at, turned, work = numbers.ctypes.data, workspace.ctypes.data, workspace[s:].ctypes.data
    call_lapack(  # type: ignore[call-arg]
        lapack,
        (at + 12, at + 16, at, turned, at, values.ctypes.data, imaginary.ctypes.data, work, at,
         vectors.ctypes.data, at, work, at + 4, at + 8),
    )  # fmt: skip
    return numbers[2] == 0 and workspace[0, 0] == workspace[0, 0]


@inner(reorders=True)
def project(k, values, stage, out):
    """Set `out` (d,) to the complex right-hand side of system k, from nodal values (d, s)."""
    real, imaginary = stage.back[k].real.copy(), stage.back[k].imag.copy()
    for c in range(out.shape[0]):
        a, b = 0.0, 0.0
        for i in range(real.shape[0]):
            a += real[i] * values[c, i]
            b += imaginary[i] * values[c, i]
        out[c] = complex(a, b)


@inner(allocates=True)
def add_solution(k, solution, stage, out):
    """Add what the solution of system k, (d,), contributes to the nodal values `out` (d, s)."""
    real, imaginary = stage.forth[:, k].real.copy(), stage.forth[:, k].imag.copy()
    for c in range(solution.shape[0]):
        a, b = solution[c].real, solution[c].imag
        for i in range(real.shape[0]):
            out[c, i] += real[i] * a - imaginary[i] * b


@plug_in
def no_stages(task, values, stage):
    """Do nothing: few components are solved in newton.py, without a function value."""
    return 1


@plug_in
def dense_stages(task, values, stage):
    """Factorise all decoupled systems of a dense Jacobian J, or solve them; return 0 on success."""
    # The solution replaces the nodal values (d, s). J is reduced once to Hessenberg form, D^-1 J D
    # = Q H Q^T, D diagonal; each system then takes O(d**2) operations.
    # dense (2 + 2 K, n, n): H, Q, then the real and the imaginary part of each system's factors,
    # with the multipliers on the subdiagonal. factors (K, 1, n): 1 where rows were exchanged.
    n = stage.order.shape[0]
    if task == FACTORISE:
        if not diagonalise_stages(stage) or (stage.control[REDUCED] == 0.0 and not reduce(stage)):
            return 1
        stage.control[REDUCED] = 1.0
        for k in range(int(stage.control[SYSTEMS])):
            real, imaginary = stage.dense[2 + 2 * k], stage.dense[3 + 2 * k]
            if not eliminate(stage.shifts[k], stage.dense[0], real, imaginary, stage.factors[k, 0]):
                return 1
        return 0
    turned, found = np.empty(values.shape), np.zeros(values.shape)
    scale(stage, values, True)
    transposed_product(stage.dense[1], values, turned)
    right = np.empty(n, dtype=np.complex128)
    for k in range(int(stage.control[SYSTEMS])):
        project(k, turned, stage, right)
        real, imaginary = stage.dense[2 + 2 * k], stage.dense[3 + 2 * k]
        substitute_hessenberg(real, imaginary, stage.factors[k, 0], right)
        add_solution(k, right, stage, found)
    product(stage.dense[1], found, values)
    scale(stage, values, False)
    return 0


@inner(allocates=True)
def reduce(stage):
    """Reduce a dense J to Hessenberg form H, ``D^-1 J D = Q H Q^T``; False if J is not finite."""
    # D: scales of components times powers of 2 that balance rows and columns; all by LAPACK
    n = stage.order.shape[0]
    h, q, scales = stage.dense[0], stage.dense[1], stage.scales
    for i in range(n):
        inverse = 1.0 / scales[i]
        for j in range(n):  # LAPACK stores matrices by columns
            q[j, i] = stage.jacobians[0, i, j] * (scales[j] * inverse)
            if not abs(q[j, i]) < np.inf:
                return False
    numbers, workspace = np.empty(6, dtype=np.int32), np.empty(66 * n)
    numbers[0], numbers[1], numbers[2], numbers[3], numbers[4] = n, 1, 64 * n, 0, _SCALING
    at, tau = numbers.ctypes.data, workspace.ctypes.data
    work, columns, balance = tau + 8 * n, q.ctypes.data, workspace[65 * n :]
    call_lapack(  # type: ignore[call-arg]
        stage.lapack_balance,
        (at + 16, at, columns, at, at + 4, at + 20, balance.ctypes.data, at + 12),
    )  # fmt: skip
    for c in range(n):
        scales[c] *= balance[c]
    for step in range(2):
        address = stage.lapack if step == 0 else stage.lapack_solve
        call_lapack(  # type: ignore[call-arg]
            address, (at, at + 4, at, columns, at, tau, work, at + 8, at + 12)
        )
        for i in range(n if step == 0 else 0):
            for j in range(n):
                h[i, j] = q[j, i] if i <= j + 1 else 0.0
    for i in range(n):
        for j in range(i):
            q[i, j], q[j, i] = q[j, i], q[i, j]
    return numbers[3] == 0 and workspace[0] == workspace[0]


@inner
def eliminate(shift, h, real, imaginary, exchanged):
    """Factorise the complex matrix ``1 - shift H``, H Hessenberg; False if it is singular."""
    # real, imaginary (n, n): upper factor with inverted pivots, multipliers on the subdiagonal;
    # exchanged (n,): 1 where row j was exchanged with row j + 1
    n = h.shape[0]
    set_shifted_row(0, shift, h, real, imaginary)
    for j in range(n):
        below = 0.0
        if j < n - 1:  # a row is set just before it is used, so it is still in the cache
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
    """Set row i of ``1 - shift H``: its real and its imaginary part, from column i - 1 on."""
    a, b = shift.real, shift.imag
    own, row, row_i = h[i], real[i], imaginary[i]
    for j in range(max(0, i - 1), h.shape[0]):
        row[j], row_i[j] = -a * own[j], -b * own[j]
    row[i] += 1.0


@inner(allocates=True)
def substitute_hessenberg(real, imaginary, exchanged, x):
    """Solve a system by the factors of `eliminate`; x (n,) is its right-hand side, then x."""
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


@inner(reorders=True)
def complex_dot(real, imaginary, x_real, x_imaginary, first, end):
    """Return the real and the imaginary part of ``sum_k a_k x_k`` for first <= k < end."""
    a, b = 0.0, 0.0
    c, d = real[first:end], imaginary[first:end]
    x, y = x_real[first:end], x_imaginary[first:end]
    for k in range(c.shape[0]):  # a loop from 0 on is vectorised
        a += c[k] * x[k] - d[k] * y[k]
        b += c[k] * y[k] + d[k] * x[k]
    return a, b


@plug_in
def banded_stages(task, values, stage):
    """Factorise all decoupled systems of a banded Jacobian, or solve them; return 0 on success."""
    # the solution replaces the nodal values (d, s)
    # factors (K, n, 2 lower + upper + 2): K systems of n components, layout as `set_band`
    n, place, lower, upper = stage.order.shape[0], stage.order, stage.lower, stage.upper
    if task == FACTORISE:
        if not diagonalise_stages(stage):
            return 1
        entries = scaled_entries(stage)
        for k in range(int(stage.control[SYSTEMS])):
            factors = stage.factors[k]
            if not set_band(entries, -stage.shifts[k], place, lower, upper, factors):
                return 1
            for j in range(n):
                factors[j, lower + upper] += 1.0
            if factorise_band(factors, lower, upper, stage.lapack) != 0:
                return 1
        return 0
    right, ordered = np.empty((2, n), dtype=np.complex128)
    found = np.zeros(values.shape)
    scale(stage, values, True)
    for k in range(int(stage.control[SYSTEMS])):
        project(k, values, stage, right)
        for i in range(n):
            ordered[place[i]] = right[i]
        substitute_band(stage.factors[k], lower, upper, ordered)
        for i in range(n):
            right[i] = ordered[place[i]]
        add_solution(k, right, stage, found)
    put_matrix(found, values)
    scale(stage, values, False)
    return 0


@inner(allocates=True)
def scaled_entries(stage):
    """Return the entries of the sparse Jacobian of y over the scales of its components."""
    entries, scales = stage.jacobians[0].copy(), stage.scales
    for k in range(entries.shape[1]):
        entries[VALUES, k] *= scales[int(entries[COLUMNS, k])] / scales[int(entries[ROWS, k])]
    return entries


@plug_in
def sparse_stages(task, values, stage):
    """Factorise all decoupled systems of a sparse Jacobian, or solve them; return 0 on success."""
    # by a sparse solver in Python; the solution replaces the nodal values (d, s)
    n, found = stage.order.shape[0], np.zeros(values.shape)
    if task == FACTORISE and not diagonalise_stages(stage):
        return 1
    right, entries = np.empty(n, dtype=np.complex128), scaled_entries(stage)
    if task != FACTORISE:
        scale(stage, values, True)
    for k in range(int(stage.control[SYSTEMS])):
        given, wanted = entries.ctypes.data, right.ctypes.data
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
        put_matrix(found, values)
        scale(stage, values, False)
    return 0


@inner(allocates=True)
def linear_solver(stage):
    """Return the record of a real linear solver for the single system of all unknowns (d s,)."""
    return LinearSolver(
        stage.dense, stage.order, stage.lower, stage.upper, stage.lapack, stage.python, 0, 0
    )


@inner
def stage_matrix(stage, h, jacobians, at_nodes, out):
    """Set `out` (d s, d s) to the derivative of the residuals with respect to p at the nodes."""
    # By component, then by node; residuals and p are over the scales of components. jacobians (m,
    # d, d): m = 1 for all nodes, or s. Integrals of p over the step are h stage.integral.
    # at_nodes (>= s,) is a work array
    matrices, kinds, integral = stage.matrices, stage.kinds, stage.integral
    above_one, scales = stage.above_one, stage.scales
    d, s, each = kinds.shape[0], integral.shape[0], jacobians.shape[0] > 1
    for c in range(d):
        kind = matrices[kinds[c]]
        for e in range(d):
            ratio, own = scales[e] / scales[c], 1.0 if c == e else 0.0
            for k in range(s):
                at_nodes[k] = jacobians[k if each else 0, c, e] * ratio
            for i in range(s):
                row = out[c * s + i, e * s : (e + 1) * s]
                force, primary, place = kind[FORCE, i], kind[PRIMARY, i], kind[POSITION, i]
                for j in range(s if above_one[kinds[e]] == 0 else 0):
                    row[j] = -force[j] * at_nodes[j] - own * (place[j] + primary[j])
                if above_one[kinds[e]] == 1:
                    for j in range(s):
                        row[j] = -own * primary[j]
                    for k in range(s):
                        factor = h * (force[k] * at_nodes[k] + own * place[k])
                        for j in range(s):
                            row[j] -= factor * integral[k, j]
                    row[i] += own
                elif c == e:  # in an algebraic row the bracket is exactly 0
                    row[i] = (1.0 - (place[i] + primary[i])) - force[i] * at_nodes[i]


@inner
def set_pencil(own, integral, is_speed, out):
    """Set the matrices M and G of one kind, for residuals ``M x_c - sum_e J_ce G x_e``."""
    # x_c (s,): unknowns of component c; one G for x_e whose unknown is y, another for y'
    # own (3, s, s): matrices of f, p and y of the kind. integral (s, s): integrals to each node.
    # out (3, s, s): indexed by OF_VALUES, OF_SPEEDS and REST.
    force, place, s = own[FORCE], own[POSITION], integral.shape[0]
    for i in range(s):
        for j in range(s):
            gain, rest = 0.0, 0.0
            for k in range(s):
                gain += force[i, k] * integral[k, j]
                rest += place[i, k] * integral[k, j]
            rest = rest if is_speed == 1 else place[i, j]
            out[OF_VALUES, i, j], out[OF_SPEEDS, i, j] = force[i, j], gain
            out[REST, i, j] = (1.0 if i == j else 0.0) - own[PRIMARY, i, j] - rest


@inner(allocates=True)
def set_entries(stage):
    """Set the nonzero entries of the matrix of `stage_matrix`, from those of a sparse Jacobian."""
    entries, kinds, above_one, out = stage.jacobians[0], stage.kinds, stage.above_one, stage.joint
    s, scales, number = stage.integral.shape[0], stage.scales, 0
    pencil = np.empty((above_one.shape[0], 3, s, s))
    for kind in range(above_one.shape[0]):
        set_pencil(stage.matrices[kind], stage.integral, above_one[kind], pencil[kind])
    for k in range(entries.shape[1]):
        c, e = int(entries[ROWS, k]), int(entries[COLUMNS, k])
        gain, rest = pencil[kinds[c], above_one[kinds[e]]], pencil[kinds[c], REST]
        value = entries[VALUES, k] * (scales[e] / scales[c])
        for i in range(s):
            for j in range(s):
                own = rest[i, j] if c == e else 0.0
                out[VALUES, number] = own - value * gain[i, j]
                number += 1


@inner
def set_scales(state, sizes, stage, anew):
    """Set scales to powers of 2, of the sizes (d,) to which components seem to grow.

    If not `anew`, only where one has changed much; return whether scales were set. A component
    without a size has the smallest scale: what it drives may be small.
    """
    scales, least, far = stage.scales, np.inf, anew
    for c in range(sizes.shape[0]):
        size = max(sizes[c], min(state.reach[c], state.growth[c]))
        least = min(least, size) if size > LEAST else least
        far = far or (size > LEAST and abs(math.log(size / scales[c])) > _CHANGED_MUCH)
    for c in range(sizes.shape[0] if far else 0):
        size = max(sizes[c], min(state.reach[c], state.growth[c]))
        size = size if size > LEAST else least if least < np.inf else 1.0
        scales[c] = math.ldexp(1.0, math.frexp(size)[1] - 1)
    return far


@inner
def scale(stage, values, inverse):
    """Multiply nodal values (d, s) by their components' scales; divide them if `inverse`."""
    for c in range(values.shape[0]):
        factor = 1.0 / stage.scales[c] if inverse else stage.scales[c]
        for i in range(values.shape[1]):
            values[c, i] *= factor


@inner
def substitute_scaled(matrix, order, scales, b, x):
    """Solve for x (d s,) by the factors of a scaled matrix; b (d s,) is the right-hand side."""
    # residuals and unknowns of it are over the scales (d,), powers of 2
    s = b.shape[0] // scales.shape[0]
    for c in range(scales.shape[0]):
        inverse = 1.0 / scales[c]
        for i in range(c * s, c * s + s):
            b[i] *= inverse
    substitute(matrix, order, b, x)
    for c in range(scales.shape[0]):
        for i in range(c * s, c * s + s):
            b[i] *= scales[c]
            x[i] *= scales[c]


@plug_in
def joint_dense(task, values, stage):
    """Factorise the single dense system of all stages, or solve it; return 0 on success."""
    # the solution replaces the nodal values (d, s)
    # joint (n, n), n = d s: the matrix, then its factors; dense (1, 2, n): order of the rows, and a
    # work array
    order, workspace, matrix = stage.dense[0, 0], stage.dense[0, 1], stage.joint
    if task == FACTORISE:
        stage_matrix(stage, 1.0, stage.jacobians, workspace, matrix)
        if stage.lapack != 0:
            return 0 if factorise_large(matrix, order, stage.lapack) else 1
        return 0 if factorise(matrix, order) else 1
    x = values.reshape(values.size)
    put(x, workspace)
    substitute_scaled(matrix, order, stage.scales, workspace, x)
    return 0


def joint_stages(name: str, solver: Any) -> Any:
    """Return a function `name` that solves all stages at once by a banded or sparse `solver`."""

    def solve(task, values, stage):
        if task == FACTORISE:
            set_entries(stage)
        else:
            scale(stage, values, True)
        found = solver(task, 0, stage.joint, values.reshape(values.size), linear_solver(stage))
        if task != FACTORISE:
            scale(stage, values, False)
        return found

    solve.__name__ = solve.__qualname__ = name
    solve.__doc__ = "Factorise the system of all stages, or solve it for nodal values; 0 if done."
    return plug_in(solve)


joint_banded = joint_stages("joint_banded", banded_solver)
joint_sparse = joint_stages("joint_sparse", sparse_solver)
