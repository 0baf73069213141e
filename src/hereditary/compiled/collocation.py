"""Equations of one collocation step and their solution by Newton's method.

Every component has a primary unknown p: y itself or, for orders above 1, its first derivative. It
satisfies ``p(t) = p(0) + sum_k c_k J**a_k (q_k - o_k)`` with orders of integration 0 < a <= 1,
coefficients c, integrands q among f, p and y, and constants o. On a step the integrands are
polynomials through their values at s nodes, whose fractional integrals over the step are exact; the
history before the step is a sum of exponential modes, advanced by exact moments.
"""

import numpy as np
from numba.extending import overload

from .jacobian import jacobian
from .jit import allocating, inlined, inner
from .linalg import clear_matrix, factorise, put_matrix, substitute
from .rows import FORCE, POSITION, PRIMARY
from .signatures import SUBSTITUTE
from .structures import Factors, StageFactors, StepRoom

# Newton iterations before a step is refused.
_SWEEPS = 12
# Relative and absolute change of p that rounding leaves.
_ROUNDING, _LEAST = 1e-14, 1e-202


@inner
def nodal_slopes(h, inverse, start, p, out):
    """Set `out` (d, s) to p' at the nodes, of the polynomial with these values of p.

    p (d, s) are its values at the nodes, `start` (d,) that at the step's start; `inverse` (s, s) is
    that of the matrix of integrals of order 1.
    """
    for c in range(p.shape[0]):
        for i in range(p.shape[1]):
            total = 0.0
            for j in range(p.shape[1]):
                total += inverse[i, j] * (p[c, j] - start[c])
            out[c, i] = total / h


@inner
def positions(h, p, x_start, second, integral, x):
    """Set y at the nodes: p itself, or the integral of p from `x_start` where p is y'."""
    # p, x (d, s), x_start (d,), second (d,), integral (s, s) of order 1
    for c in range(p.shape[0]):
        for i in range(p.shape[1]):
            if second[c] == 0:
                x[c, i] = p[c, i]
                continue
            total = 0.0
            for j in range(p.shape[1]):
                total += integral[i, j] * p[c, j]
            x[c, i] = x_start[c] + h * total


@inner
def forces(rhs, params, times, x, f, room):
    """Set f to the right-hand side at all nodes of a step, where y is x."""
    # times (s,), x and f (d, s)
    point, force = room.point, room.force
    for i in range(times.shape[0]):
        for c in range(point.shape[0]):
            point[c] = x[c, i]
        rhs(times[i], point, force, params)
        for c in range(point.shape[0]):
            f[c, i] = force[c]


@inner
def newton_matrix(h, matrices, kinds, integral, second, jacobians, scales, out):
    """Set the derivative of the residuals with respect to p at the nodes, in the order (c, i).

    Residuals and p are in units of the scales of their components.
    """
    # matrices (K, 3, s, s), integral (s, s), jacobians (s, d, d), scales (d,), out (d s, d s)
    d, s = second.shape[0], integral.shape[0]
    for c in range(d):
        own = matrices[kinds[c]]
        force, primary, place = own[FORCE], own[PRIMARY], own[POSITION]
        for e in range(d):
            ratio = scales[e] / scales[c]
            for i in range(s):
                for j in range(s):
                    total = 0.0
                    if second[e] == 0:
                        total = force[i, j] * (jacobians[j, c, e] * ratio)
                        if c == e:
                            total += place[i, j]
                    else:
                        for k in range(s):
                            weight = force[i, k] * (jacobians[k, c, e] * ratio)
                            if c == e:
                                weight += place[i, k]
                            total += weight * integral[k, j]
                        total *= h
                    if c == e:
                        total += primary[i, j]
                        if i == j:
                            total -= 1.0
                    out[c * s + i, e * s + j] = -total


@allocating
def empty_room(d, s, n_checks):
    """Allocate the room of a step."""
    return StepRoom(
        np.empty(s), np.empty(n_checks), np.empty(d * s), np.empty(d * s), np.empty((d, s)),
        np.empty((s, s)), np.empty(d), np.empty(d), np.empty(d), np.empty(d), np.empty(d),
        np.empty(d), np.ones(d), np.ones(d),
    )  # fmt: skip


@allocating
def empty_factors(d, s, n_checks, solver, stages):
    """Allocate the factors of Newton's matrix, and the room of a step."""
    return Factors(
        np.empty((d * s, d * s)), np.empty(d * s), np.zeros(d), np.zeros(d), np.zeros(d),
        np.empty((s, d, d)), empty_room(d, s, n_checks),
    )  # fmt: skip


def solve_newton(newton, b, x):
    """Solve for x, (d s,), with the factors of Newton's matrix, of either kind."""
    (_solve_stages if isinstance(newton, StageFactors) else _solve_as_one)(newton, b, x)


@overload(solve_newton, jit_options={"nogil": True, "error_model": "numpy"})
def _of_either_kind(newton, b, x):
    """Choose by the type: a branch in compiled code would hand arrays of both kinds on."""
    return _solve_stages if newton.instance_class is StageFactors else _solve_as_one


def _solve_as_one(newton, b, x):
    substitute_scaled(newton.matrix, newton.order, newton.room.scales, b, x)


def _solve_stages(newton, b, x):
    for i in range(b.shape[0]):
        x[i] = b[i]
    d = newton.force_scales.shape[0]
    newton.solver(SUBSTITUTE, x.reshape((d, b.shape[0] // d)), newton.stages)


@inner
def substitute_scaled(matrix, order, scales, b, x):
    """Solve for x by the factors of a scaled matrix; scales (d,) are powers of two."""
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


@inner
def solve_stages(
    rhs, jac, has_jac, params, times, h, base, x_start, second, operators, kinds, integral, goal,
    values, counts, contraction, newton,
):  # fmt: skip
    """Solve for p at the nodes by Newton's method, starting from the given values.

    Returns whether p is accurate to `goal` (d,). Sets y, and f corrected to first order for the
    last change of p; `contraction` records how fast the method converged.
    """
    # base (>= d, s), values (n_q, d, s): f, p and y; newton: factorised here
    f, p, x = values[FORCE], values[PRIMARY], values[POSITION]
    room, jacobians = newton.room, newton.jacobians
    residual, change, before = room.residual, room.change, room.before
    previous, rate = np.inf, 1.0
    positions(h, p, x_start, second, integral, x)
    for sweep in range(_SWEEPS):
        if sweep == 0 or sweep == 3:
            # one Jacobian for all nodes first: it suffices where little changes over the step
            counts.rhs += stage_jacobians(
                rhs, jac, has_jac, params, times, x, sweep > 0, jacobians, room
            )
            newton_matrix(
                h, operators.matrices, kinds, integral, second, jacobians, room.scales,
                newton.matrix,
            )  # fmt: skip
            if not factorise(newton.matrix, newton.order):
                return False
            set_force_scales(jacobians[0], x, newton)
            previous = np.inf
        forces(rhs, params, times, x, f, room)
        counts.rhs += times.shape[0]
        residuals(base, operators, kinds, p, x, f, residual)
        substitute_scaled(newton.matrix, newton.order, room.scales, residual, change)
        size = take_change(change, goal, p)
        if not size < np.inf:
            return False
        put_matrix(x, before)
        positions(h, p, x_start, second, integral, x)
        rate = contraction_rate(size, previous, h, contraction)
        if size * min(1.0, 4.0 * rate) < 1.0:
            correct_forces(jacobians, before, x, f)
            return True
        if rate > 0.9 and sweep > 5:
            return False
        previous = size
    return False


@inlined
def take_change(change, goal, p):
    """Subtract a change, (d s,), from p; return the largest in units of the goal."""
    size = 0.0
    for c in range(p.shape[0]):
        allowed = goal[c]
        for i in range(p.shape[1]):
            p[c, i] -= change[c * p.shape[1] + i]
            if goal[c] <= _LEAST:  # a component at rest has no goal but its rounding
                allowed = max(_ROUNDING * abs(p[c, i]), _LEAST)
            size = max(size, abs(change[c * p.shape[1] + i]) / allowed)
    return size


@inner
def contraction_rate(size, previous, h, contraction):
    """Return how fast Newton's method converges, and record it where two changes tell."""
    if previous < np.inf:
        rate = size / previous
        contraction.rate = max(rate, 0.1 * contraction.rate)
        contraction.change = max(previous, 0.1 * contraction.change)
        contraction.length = h
        return rate
    # from earlier steps: slower for a worse guess and for a longer step
    rate = contraction.rate * max(1.0, size / contraction.change)
    return rate * max(1.0, h / contraction.length) ** 2


@inner
def stage_jacobians(rhs, jac, has_jac, params, times, x, every, out, room):
    """Set the Jacobians at all nodes, or the middle one's for all; return the calls of `rhs`."""
    # x (d, s), out (s, d, d)
    s, calls, point = times.shape[0], 0, room.point
    for i in range(s):
        if i > 0 and not every:
            put_matrix(out[0], out[i])
            continue
        k = i if every else s // 2
        for c in range(point.shape[0]):
            point[c] = x[c, k]
        calls += jacobian(rhs, jac, has_jac, times[k], point, params, room.units, out[i])
    return calls


@inner
def set_force_scales(jacobian_inside, x, newton):
    """Set |J| |y|, with y at the last node, the size of the summands of f, and |J| |y(0)|."""
    for c in range(x.shape[0]):
        newton.force_scales[c], newton.start_scales[c] = 0.0, 0.0
        for e in range(x.shape[0]):
            size = abs(jacobian_inside[c, e])
            newton.force_scales[c] += size * abs(x[e, -1])
            newton.start_scales[c] += size * newton.starts[e]


@inner
def correct_forces(jacobians, before, x, f):
    """Correct f (d, s) to first order from y = `before` to y = x, by the Jacobians (s, d, d)."""
    for i in range(x.shape[1]):
        for c in range(x.shape[0]):
            for e in range(x.shape[0]):
                f[c, i] += jacobians[i, c, e] * (x[e, i] - before[e, i])


@inner
def residuals(base, operators, kinds, p, x, f, out):
    """Set the residuals p - base - integrals at all nodes, in the order (c, i)."""
    d, s = p.shape
    for c in range(d):
        kind, first = kinds[c], c * s
        own, alone = operators.columns[kind], operators.alone[kind] == 1
        for i in range(s):
            out[first + i] = p[c, i] - base[c, i]
        for j in range(s if alone else 0):
            by_f, a = own[FORCE, j], f[c, j]
            for i in range(s):
                out[first + i] -= by_f[i] * a
        for j in range(0 if alone else s):  # f and terms may cancel: added first
            by_f, by_p, by_x = own[FORCE, j], own[PRIMARY, j], own[POSITION, j]
            a, b, e = f[c, j], p[c, j], x[c, j]
            for i in range(s):
                out[first + i] -= by_f[i] * a + by_p[i] * b + by_x[i] * e


@allocating
def solve_tangents(
    rhs, jac, has_jac, params, times, h, base, x_start, second, operators, kinds, integral, values,
    counts, newton,
):  # fmt: skip
    """Solve the step, linearised along the orbit, for the tangents' `values` at the nodes.

    These are the right-hand side f, the primary unknown p (y' where `second` is 1, else y) and y,
    columns 1 to k; column 0, the orbit, must solve the step already. Returns False where Newton's
    matrix is singular.
    """
    # base (1 + k, R, s), x_start (1 + k, d), values (1 + k, 3, d, s)
    d, s = second.shape[0], base.shape[2]
    matrix, order = np.empty(newton.matrix.shape), np.empty(d * s)
    known, found = np.empty(d * s), np.empty(d * s)
    jacobians, start = np.empty((s, d, d)), np.empty((d, s))
    orbit = values[0, POSITION]
    counts.rhs += stage_jacobians(
        rhs, jac, has_jac, params, times, orbit, True, jacobians, newton.room
    )
    scales = newton.room.scales
    newton_matrix(h, operators.matrices, kinds, integral, second, jacobians, scales, matrix)
    if not factorise(matrix, order):
        return False
    for column in range(1, base.shape[0]):
        f, p, x = values[column, FORCE], values[column, PRIMARY], values[column, POSITION]
        # one Newton step from p = 0 is exact, for the system is linear
        clear_matrix(p)
        positions(h, p, x_start[column], second, integral, x)
        clear_matrix(f)
        clear_matrix(start)
        correct_forces(jacobians, start, x, f)
        residuals(base[column], operators, kinds, p, x, f, known)
        substitute_scaled(matrix, order, scales, known, found)
        for c in range(d):
            for i in range(s):
                p[c, i] = -found[c * s + i]
        positions(h, p, x_start[column], second, integral, x)
        clear_matrix(f)
        correct_forces(jacobians, start, x, f)
    return True
