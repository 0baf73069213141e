"""The equations of one collocation step, and their solution (floor 1).

Every component has a primary unknown p, y itself or, for orders above 1, its first derivative v:
``p(t) = p0 + sum_k kappa_k J**a_k (q_k - o_k)`` with orders 0 < a <= 1 of integration, integrands q
that are f, p or x = y, and constants o. On a step the integrands are polynomials through their
values at s nodes; their singular integrals over the step are exact, and everything before the step
is a sum of exponential modes, moved on by exact moments of the polynomials.
"""

import numpy as np

from .._jit import CUBE, CUBES, F8, I8, MAT, VEC, entry, kernel
from .jacobian import jacobian
from .linalg import factorise, substitute
from .signatures import JAC, RHS
from .structures import CONTRACTION_RECORD, COUNTS_RECORD, EQUATIONS, Factors, Operators

# Drivers of the integrals: f, p, y, and p' where it is asked for.
FORCE, PRIMARY, POSITION, SLOPE = 0, 1, 2, 3
# Stands for no order and no kernel: the driver itself.
ITSELF = -1
# Newton sweeps before a step is given up.
_SWEEPS = 12


@kernel
def local_operators(h, equations, integrals, inverse, local, operators):
    """Set what values at the nodes contribute to every row at the nodes, in a step of length h.

    Row c < d is p of component c, row d + c what is taken from its right-hand side; p' is that of
    the polynomial through p at the start and at the nodes.
    """
    # integrals (n_a, s, s), inverse (s, s) of the last of these, local (n_k, s, s)
    terms, orders, offsets = equations.terms, equations.orders, equations.offsets
    operators.matrices[:] = 0.0
    operators.starts[:] = 0.0
    operators.constant[:] = 0.0
    s, d = operators.constant.shape[2], equations.second.shape[0]
    for n in range(terms.shape[0]):
        c, q, k = terms[n].row, terms[n].integrand, terms[n].index
        factor = terms[n].coefficient
        own = integrals[0]
        if k >= orders.shape[0]:
            own = local[k - orders.shape[0]]
        elif k >= 0:
            own = integrals[k]
            factor *= h ** orders[k]
        for i in range(s):
            for j in range(s):
                share = factor * own[i, j]
                if k == ITSELF:
                    share = factor if i == j else 0.0
                if q == SLOPE:
                    for e in range(s):
                        operators.matrices[c, PRIMARY, i, e] += share * inverse[j, e] / h
                        operators.starts[c, i] -= share * inverse[j, e] / h
                    continue
                operators.matrices[c, q, i, j] += share
                for strand in range(offsets.shape[0]):
                    operators.constant[strand, c, i] -= share * offsets[strand, n]
    for c in range(d):
        if equations.implicit[c] == 1:
            equate(d, c, operators.matrices)
    fold_operators(d, operators.matrices)


@kernel
def equate(d, c, matrices):
    """Let row c be p plus right-hand side less terms, in units of p."""
    s = matrices.shape[2]
    size = abs(matrices[d + c, PRIMARY, s - 1, s - 1])
    for i in range(s):
        matrices[c, PRIMARY, i, i] = 1.0
        matrices[c, FORCE, i, i] = 1.0 / size if size > 0.0 else 1.0


@kernel
def slopes(h, inverse, start, p, out):
    """p' at the nodes, of the polynomial through p at the start (d,) and at the nodes (d, s)."""
    for c in range(p.shape[0]):
        for i in range(p.shape[1]):
            total = 0.0
            for j in range(p.shape[1]):
                total += inverse[i, j] * (p[c, j] - start[c])
            out[c, i] = total / h


@kernel
def subtract_image(matrix, vector, out):
    """out -= matrix @ vector."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            out[i] -= matrix[i, j] * vector[j]


@kernel
def subtract_product(left, right, out):
    """out -= left @ right."""
    for i in range(left.shape[0]):
        for k in range(left.shape[1]):
            for j in range(right.shape[1]):
                out[i, j] -= left[i, k] * right[k, j]


@kernel
def fold_operators(d, matrices):
    """Let what kernels take from a right-hand side act on p at once."""
    for c in range(matrices.shape[0] - d):
        for q in (PRIMARY, POSITION):
            subtract_product(matrices[c, FORCE], matrices[d + c, q], matrices[c, q])


@kernel
def fold_known(d, matrices, known):
    """Do the same for what is known of the step beforehand, (1 + k, R, s)."""
    for strand in range(known.shape[0]):
        for c in range(known.shape[1] - d):
            subtract_image(matrices[c, FORCE], known[strand, d + c], known[strand, c])


@kernel
def take_from_forces(d, matrices, known, values):
    """Take from the right-hand sides what kernels do, p and y being known; values (k, 3, d, s)."""
    for strand in range(values.shape[0]):
        for c in range(known.shape[1] - d):
            force = values[strand, FORCE, c]
            for i in range(force.shape[0]):
                force[i] -= known[strand, d + c, i]
            for q in (PRIMARY, POSITION):
                subtract_image(matrices[d + c, q], values[strand, q, c], force)


@kernel
def positions(h, p, x_start, second, whole, x):
    """y at the nodes: the primary unknown itself, or its integral from `x_start` on."""
    # p, x (d, s), x_start (d,), second (d,), whole (s, s): integrals of order 1
    for c in range(p.shape[0]):
        for i in range(p.shape[1]):
            if second[c] == 0:
                x[c, i] = p[c, i]
                continue
            total = 0.0
            for j in range(p.shape[1]):
                total += whole[i, j] * p[c, j]
            x[c, i] = x_start[c] + h * total


@kernel
def forces(rhs, params, times, x, f):
    """The right-hand side at all nodes."""
    # times (s,), x, f (d, s)
    point, value = np.empty(x.shape[0]), np.empty(x.shape[0])
    for i in range(times.shape[0]):
        point[:] = x[:, i]
        rhs(times[i], point, value, params)
        f[:, i] = value


@kernel
def newton_matrix(h, matrices, whole, second, jacobians, out):
    """Derivative of the residuals with respect to p at the nodes, in the order (c, i)."""
    # matrices (R, 3, s, s), whole (s, s), jacobians (s, d, d), out (d s, d s)
    d, s = second.shape[0], whole.shape[0]
    for c in range(d):
        force, primary, place = matrices[c, FORCE], matrices[c, PRIMARY], matrices[c, POSITION]
        for e in range(d):
            for i in range(s):
                for j in range(s):
                    total = 0.0
                    if second[e] == 0:
                        total = force[i, j] * jacobians[j, c, e]
                        if c == e:
                            total += place[i, j]
                    else:
                        for k in range(s):
                            share = force[i, k] * jacobians[k, c, e]
                            if c == e:
                                share += place[i, k]
                            total += share * whole[k, j]
                        total *= h
                    if c == e:
                        total += primary[i, j]
                        if i == j:
                            total -= 1.0
                    out[c * s + i, e * s + j] = -total


@kernel
def newton_room(d, s):
    """Return room for the factors of Newton's matrix."""
    return Factors(np.empty((d * s, d * s)), np.empty(d * s, dtype=np.int64), np.zeros(d))


@kernel
def solve_stages(
    rhs, jac, has_jac, params, times, h, base, x_start, second, matrices, whole, goal, values,
    counts, seen, newton,
):  # fmt: skip
    """Solve for p at the nodes by Newton's method from its present values.

    Returns whether p is exact to `goal` (d,). With it go x and, corrected to first order for the
    last change, f; `seen` keeps how the method contracted.
    """
    # base (>= d, s), values (3 or 4, d, s): f, p and y; newton: factorised here
    f, p, x = values[FORCE], values[PRIMARY], values[POSITION]
    d, s = p.shape
    residual, change = np.empty(d * s), np.empty(d * s)
    jacobians, before = np.empty((s, d, d)), np.empty((d, s))
    previous, rate = np.inf, 1.0
    positions(h, p, x_start, second, whole, x)
    for sweep in range(_SWEEPS):
        if sweep == 0 or sweep == 3:
            # one Jacobian for all nodes at first: as good where little changes over the step
            calls = stage_jacobians(rhs, jac, has_jac, params, times, x, sweep > 0, jacobians)
            counts.rhs += calls
            newton_matrix(h, matrices, whole, second, jacobians, newton.matrix)
            if not factorise(newton.matrix, newton.order):
                return False
            add_up(jacobians[0], x, newton.sizes)
            previous = np.inf
        forces(rhs, params, times, x, f)
        counts.rhs += s
        residuals(base, matrices, p, x, f, residual)
        substitute(newton.matrix, newton.order, residual, change)
        size = 0.0
        for c in range(d):
            for i in range(s):
                p[c, i] -= change[c * s + i]
                size = max(size, abs(change[c * s + i]) / goal[c])
        if not size < np.inf:
            return False
        before[:] = x
        positions(h, p, x_start, second, whole, x)
        if previous < np.inf:
            rate = size / previous
            seen.rate, seen.change = max(rate, 0.1 * seen.rate), max(previous, 0.1 * seen.change)
            seen.length = h
        else:  # as in steps before, worse the further the guess was off and the longer the step
            rate = seen.rate * max(1.0, size / seen.change) * max(1.0, h / seen.length) ** 2
        if size * min(1.0, 4.0 * rate) < 1.0:
            correct_forces(jacobians, before, x, f)
            return True
        if rate > 0.9 and sweep > 5:
            return False
        previous = size
    return False


@kernel
def stage_jacobians(rhs, jac, has_jac, params, times, x, every, out):
    """Jacobians at all nodes, or the middle one's for all; returns calls of `rhs`."""
    # x (d, s), out (s, d, d)
    s = times.shape[0]
    point, calls = np.empty(x.shape[0]), 0
    for i in range(s):
        if i > 0 and not every:
            out[i] = out[0]
            continue
        k = i if every else s // 2
        point[:] = x[:, k]
        calls += jacobian(rhs, jac, has_jac, times[k], point, params, out[i])
    return calls


@kernel
def add_up(jacobian_there, x, sizes):
    """Set |J| |y|, (d,), at the last node."""
    for c in range(sizes.shape[0]):
        sizes[c] = 0.0
        for e in range(sizes.shape[0]):
            sizes[c] += abs(jacobian_there[c, e] * x[e, -1])


@kernel
def correct_forces(jacobians, before, x, f):
    """Carry f (d, s) from the positions `before` to x by the Jacobians (s, d, d)."""
    for i in range(x.shape[1]):
        for c in range(x.shape[0]):
            for e in range(x.shape[0]):
                f[c, i] += jacobians[i, c, e] * (x[e, i] - before[e, i])


@kernel
def residuals(base, matrices, p, x, f, out):
    """Set p - base - integrals, at all nodes, in the order (c, i)."""
    d, s = p.shape
    for c in range(d):
        force, primary, place = matrices[c, FORCE], matrices[c, PRIMARY], matrices[c, POSITION]
        for i in range(s):
            total = p[c, i] - base[c, i]
            for j in range(s):
                total -= force[i, j] * f[c, j] + primary[i, j] * p[c, j] + place[i, j] * x[c, j]
            out[c * s + i] = total


@kernel
def solve_tangents(
    rhs, jac, has_jac, params, times, h, base, x_start, second, matrices, whole, values, counts
):  # fmt: skip
    """Solve the step for the tangents, the strands after the first; False where it is singular.

    The orbit's values, strand 0, solve the step; its Jacobians make that of each tangent linear.
    """
    # base (1 + k, R, s), x_start (1 + k, d), values (1 + k, 3, d, s)
    d, s = second.shape[0], base.shape[2]
    newton = newton_room(d, s)
    known, found = np.empty(d * s), np.empty(d * s)
    jacobians, start = np.empty((s, d, d)), np.empty((d, s))
    orbit = values[0, POSITION]
    counts.rhs += stage_jacobians(rhs, jac, has_jac, params, times, orbit, True, jacobians)
    newton_matrix(h, matrices, whole, second, jacobians, newton.matrix)
    if not factorise(newton.matrix, newton.order):
        return False
    for strand in range(1, base.shape[0]):
        f, p, x = values[strand, FORCE], values[strand, PRIMARY], values[strand, POSITION]
        # from p = 0 on one Newton step is exact
        p[:] = 0.0
        positions(h, p, x_start[strand], second, whole, x)
        f[:] = 0.0
        start[:] = 0.0
        correct_forces(jacobians, start, x, f)
        residuals(base[strand], matrices, p, x, f, known)
        substitute(newton.matrix, newton.order, known, found)
        for c in range(d):
            for i in range(s):
                p[c, i] = -found[c * s + i]
        positions(h, p, x_start[strand], second, whole, x)
        f[:] = 0.0
        correct_forces(jacobians, start, x, f)
    return True


@entry(
    RHS, JAC, I8, VEC, EQUATIONS, VEC, CUBE, CUBE, F8, CUBE, MAT, VEC, CUBES, COUNTS_RECORD,
    CONTRACTION_RECORD,
)  # fmt: skip
def solve_once(
    rhs, jac, has_jac, params, equations, times, integrals, local, h, base, x_start, goal, values,
    counts, seen,
):  # fmt: skip
    """Solve one step from Python, of equations without p' among the integrands.

    base (1 + k, R, s) holds p(0) and the past of every strand; values (1 + k, 3, d, s) takes f, p
    and y at the nodes, p of strand 0 holding a first guess.
    """
    n_nodes, d, n_rows = times.shape[0], equations.second.shape[0], base.shape[1]
    operators, inverse = step_operators(base.shape[0], n_rows, n_nodes), np.empty((0, 0))
    local_operators(h, equations, integrals, inverse, local, operators)
    known = base + operators.constant
    fold_known(d, operators.matrices, known)
    whole = integrals[equations.orders.shape[0] - 1]
    if not solve_stages(
        rhs, jac, has_jac, params, times, h, known[0], x_start[0], equations.second,
        operators.matrices, whole, goal, values[0], counts, seen, newton_room(d, n_nodes),
    ):  # fmt: skip
        return False
    if x_start.shape[0] > 1 and not solve_tangents(
        rhs, jac, has_jac, params, times, h, known, x_start, equations.second,
        operators.matrices, whole, values, counts,
    ):  # fmt: skip
        return False
    take_from_forces(d, operators.matrices, known, values)
    return True


@kernel
def step_operators(n_strands, n_rows, s):
    """Return room for the operators of a step."""
    matrices, starts = np.empty((n_rows, 3, s, s)), np.empty((n_rows, s))
    return Operators(matrices, starts, np.empty((n_strands, n_rows, s)))
