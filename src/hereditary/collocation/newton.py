"""Equations of one collocation step and their solution by Newton's method.

Every component has a primary unknown p: y itself or, for orders above 1, its first derivative. It
satisfies ``p(t) = p(0) + sum_k c_k J**a_k (q_k - o_k)`` with orders of integration 0 < a <= 1,
coefficients c, integrands q among f, p and y, and constants o. On a step the integrands are
polynomials through their values at s nodes, whose fractional integrals over the step are exact. The
history before the step is a sum of exponential modes, advanced by exact moments.

Letters of shapes: d components, s nodes, R rows of the equations, k tangents. `m` is an
`AdaptiveWork`, and `m.workspace` its workspace. x is y at the nodes. An *algebraic row* is 0 = f,
the equation of a component without a derivative.
"""

import numpy as np

from ..compiled.functions import set_force
from ..compiled.jacobian import COLUMNS, ROWS, VALUES, add_derivative_by, is_sparse, magnitudes
from ..compiled.jit import inner
from ..compiled.linalg import (
    all_finite,
    clear,
    clear_matrix,
    dot,
    factorise,
    largest_of,
    put,
    put_cube,
    put_matrix,
)
from ..compiled.newton import ACCEPT, FAIL, ITERATE, REFRESH
from ..compiled.signatures import FACTORISE, SUBSTITUTE
from .operators import FORCE, POSITION, PRIMARY
from .stages import set_scales, stage_matrix, substitute_scaled
from .structures import ALGEBRAIC, KEPT, LENGTH, REDUCED

# Largest number of Newton iterations; a step that needs more is rejected.
_STAGE_NEWTON_MAXITER = 12
# Contraction rate of Newton's method above which a Jacobian of an earlier step is evaluated again.
_MAX_CONTRACTION_RATE = 0.05
# Contraction rate above which Newton's method fails after iteration _EARLY.
_MAX_FAILING_RATE = 0.9
# Last iteration, counted from 0, in which any contraction rate is accepted.
_EARLY = 5
# Estimated error after a Newton change, over the change and the contraction rate.
_PER_RATE = 4.0
# Newton iteration, counted from 0, from which each node has its own Jacobian if components are few.
_FIRST_NODAL_ITERATION = 5
# Number of times that a Newton change of p is halved at nodes where f is not finite after it. Then
# p returns to its value before the change there. The step from p at the start of the step to the
# first guess counts as a change.
_MAX_HALVINGS_AT_NODES = 4
# Largest number of iterations for a tangent of many components; a step that needs more is rejected.
_TANGENT_NEWTON_MAXITER = 30
# Relative change of a tangent that ends the iterations for it.
_TANGENT_NEWTON_RTOL = 1e-11
# Change of p at which Newton's method converges, as fraction of the largest |p| at the nodes, for
# components without a size.
_MIN_NEWTON_RTOL = 1e-10
# Rounding error of p, as fraction of its largest value at the nodes.
_ROUNDING_OF_PRIMARY = 4e-16
# Rounding error of f, as fraction of |J| |y|, to which Newton's method need not converge.
_ROUNDING_BY_F = 4e-15
# Change of p by a wrong f, in units of Newton's tolerance, above which f is evaluated again.
CHECK_BEYOND = 30.0
# Least unit of a component, as fraction of what f makes of it in the step.
_OF_FORCE = 1e-9
# Rounding error of a linear system's solution, as fraction of its largest entry in units of scales.
ROUNDING_OF_SYSTEM = 1e-15
# Least absolute change of p at which Newton's method converges; a component whose tolerance is
# below this has no size yet.
_MIN_NEWTON_ATOL = 1e-202


@inner
def nodal_slopes(h, inverse, start, p, out):
    """Set `out` (d, s) to p' at the nodes of a step of length h, from the polynomial of p."""
    # p (d, s) at the nodes, start (d,) at the start; inverse (s, s): of the integrals of order 1
    for c in range(p.shape[0]):
        for i in range(p.shape[1]):
            total = 0.0
            for j in range(p.shape[1]):
                total += inverse[i, j] * (p[c, j] - start[c])
            out[c, i] = total / h


@inner
def positions(m, h, p, x_start, x):
    """Set x (d, s) to y at the nodes: p (d, s) or, where p is y', `x_start` plus its integral."""
    # x_start (d,): y at the start of the step; integral (s, s): integrals of order 1
    above_one, integral = m.equations.above_one, m.rule.integrals[m.equations.orders.shape[0] - 1]
    for c in range(p.shape[0]):
        for i in range(p.shape[1]):
            if above_one[c] == 0:
                x[c, i] = p[c, i]
                continue
            total = 0.0
            for j in range(p.shape[1]):
                total += integral[i, j] * p[c, j]
            x[c, i] = x_start[c] + h * total


@inner
def forces(m, x, f):
    """Set f (d, s) to the right-hand side at y = x (d, s) at all nodes; return if f is finite."""
    # times (s,): of the nodes
    times = m.workspace.times
    point, f_at_point, finite = m.workspace.point, m.workspace.f_at_point, True
    for i in range(times.shape[0]):
        for c in range(point.shape[0]):
            point[c] = x[c, i]
        finite = force_on_its_side(m, times[i], x, point, f_at_point) and finite
        for c in range(point.shape[0]):
            f[c, i] = f_at_point[c]
    return finite


@inner
def force_on_its_side(m, t, x, point, f):
    """Set f (d,) to the right-hand side at y = point (d,) in a step; return if it is finite."""
    # If not, in a first step components beyond y at the start by their error only are moved there.
    # The side of y = x (d, s) at the last node is the right one. A high power of time is smaller
    # than the errors of its polynomial at early times.
    x_start = m.orbit.x[0]
    set_force(m.right.force, t, point, f)
    finite, moved = all_finite(f), False
    for c in range(0 if finite or m.state.control.begins == 0.0 else f.shape[0]):
        along, change = point[c] - x_start[c], x[c, -1] - x_start[c]
        if along * change < 0.0 and abs(along) <= m.limits.tolerance.rtol * abs(change):
            point[c], moved = x_start[c], True
    if moved:
        m.state.counts.rhs += 1
        set_force(m.right.force, t, point, f)
        finite = all_finite(f)
    return finite


@inner
def factorise_newton(m, h, p, jacobians):
    """Factorise Newton's matrix for a step of length h; return if it is regular."""
    # jacobians: one for all nodes, or one for each; of p (d, s) only the shape counts
    stages, matrices, over_step = m.stages, m.operators.matrices, m.stages.integral
    integral = m.rule.integrals[m.equations.orders.shape[0] - 1]  # integrals of order 1
    few = stages.jacobians.shape[0] > 1
    for kind in range(stages.above_one.shape[0]):
        put_cube(matrices[kind], stages.matrices[kind])
    for i in range(integral.shape[0]):
        for j in range(integral.shape[0]):
            over_step[i, j] = integral[i, j] if few else h * integral[i, j]
    if few:  # factorised here, because the call of a function value takes longer
        stage_matrix(stages, h, jacobians, stages.dense[0, 1], stages.joint)
        return factorise(stages.joint, stages.dense[0, 0])
    return m.solver(FACTORISE, p, stages) == 0


@inner
def solve_newton(m):
    """Solve Newton's linear system: `change` (d s,) from `residual`, both in the workspace."""
    residual, change, stages = m.workspace.residual, m.workspace.change, m.stages
    if stages.jacobians.shape[0] == 1:
        put(residual, change)
        m.solver(SUBSTITUTE, m.workspace.nodal_change, stages)
    else:
        substitute_scaled(stages.joint, stages.dense[0, 0], stages.scales, residual, change)


@inner
def solve_for_orbit(m):
    """Solve as `solve_newton`; a component without size and residual stays at 0."""
    # otherwise the rounding of others would move it
    residual, change, newton_tol = m.workspace.residual, m.workspace.change, m.workspace.newton_tol
    solve_newton(m)
    s, implicit = residual.shape[0] // newton_tol.shape[0], m.equations.implicit
    for c in range(newton_tol.shape[0]):
        begins = newton_tol[c] <= _MIN_NEWTON_ATOL and implicit[c] == 0
        if begins and largest_of(residual, c * s, s) == 0.0:
            for i in range(c * s, c * s + s):
                change[i] = 0.0


@inner
def solve_stages(m, h):
    """Solve a step of length h for p at the nodes by Newton's method; return if it converged."""
    # m.workspace.values has the first guess of p, m.workspace.change (d s,) p at the start minus
    # it. Converged if p is accurate to m.workspace.newton_tol (d,). Sets y, and f to first order
    # for the last change of p; m.state.contraction records the contraction. Many components use a
    # Jacobian in several steps while the method converges fast, and its factors while the length is
    # the same.
    workspace, stages = m.workspace, m.stages
    counts, contraction = m.state.counts, m.state.contraction
    values, x_start = workspace.values[0], m.orbit.x[0]
    control, newton_tol = stages.control, workspace.newton_tol
    f, p, x = values[FORCE], values[PRIMARY], values[POSITION]
    s, few = p.shape[1], stages.jacobians.shape[0] > 1
    change, before = workspace.change, workspace.before
    previous, fresh = np.inf, False
    jacobians = stages.jacobians[:1]
    positions(m, h, p, x_start, x)
    clear(workspace.rounding)
    for sweep in range(_STAGE_NEWTON_MAXITER):
        counts.rhs += s
        halved = 0
        while not forces(m, x, f):
            if halved > _MAX_HALVINGS_AT_NODES:
                control[KEPT] = 0.0
                return False
            take_back_at_nodes(f, 0.5 if halved < _MAX_HALVINGS_AT_NODES else 1.0, change, p)
            positions(m, h, p, x_start, x)
            counts.rhs += s
            halved += 1
        if few and (sweep == 0 or sweep == _FIRST_NODAL_ITERATION):
            control[KEPT] = 0.0
            jacobians = stages.jacobians[: 1 if sweep == 0 else s]
        if control[KEPT] == 0.0:
            if sweep == 0:  # at the guess: a diverged iterate would allow any unit
                raise_units(m, h, f)
            counts.rhs += stage_jacobians(m, x, jacobians)
            control[KEPT], control[LENGTH], control[REDUCED], fresh = 1.0, 0.0, 0.0, True
        if control[LENGTH] != h:
            if set_scales(m.state, workspace.sizes, stages, control[REDUCED] == 0.0):
                control[REDUCED] = 0.0  # a reduced Jacobian has scales
            control[LENGTH] = 0.0
            if not factorise_newton(m, h, p, jacobians):
                control[KEPT] = 0.0  # the Jacobian may contain NaN
                if sweep > 0 or not iterate_once(m, p, x, f):
                    return False
                positions(m, h, p, x_start, x)
                jacobians = stages.jacobians
                continue
            control[LENGTH], previous = h, np.inf
        if previous == np.inf:  # scales at the guess: a stiff y may be far below its start
            for c in range(workspace.starts.shape[0]):
                noise = m.state.noisy[c] * m.state.scales[c]  # rounding of y_c is that of this
                workspace.point[c] = max(abs(x[c, s - 1]), noise)
            magnitudes(jacobians[0], workspace.point, workspace.force_scales)
            magnitudes(jacobians[0], workspace.starts, workspace.start_scales)
            for c in range(workspace.starts.shape[0]):
                workspace.force_scales[c] += m.state.reads[c]
        residuals(m, workspace.base[0], p, x, f)
        solve_for_orbit(m)
        size = take_change(change, newton_tol, workspace.rounding, stages.scales, p)
        if sweep == 0:  # at the guess: a diverged iterate would allow any change
            set_rounding(m)
        if not size < np.inf:
            control[KEPT] = 0.0
            return False
        put_matrix(x, before)
        positions(m, h, p, x_start, x)
        rate = contraction_rate(size, previous, h, contraction)
        answer = verdict(size, previous, rate, sweep, fresh)
        if answer == ACCEPT:
            correct_forces(jacobians, before, x, f, workspace.moved)
            if (sweep > 0 and fresh) or holds_at_end(m, x, f):
                return True
            if sweep > 0:  # changes by a Jacobian from before a jump may be small for ever
                control[KEPT] = 0.0
        elif answer != ITERATE:
            control[KEPT] = 0.0
        if answer == FAIL:
            return False
        previous = size
    control[KEPT] = 0.0
    return False


@inner
def holds_at_end(m, x, f):
    """Return whether f (d, s) at the last node, corrected after one iteration, is that at y = x."""
    # between the first guess and y, (d, s), the right-hand side may jump
    point, f_at_point, last = m.workspace.point, m.workspace.f_at_point, x.shape[1] - 1
    for c in range(point.shape[0]):
        point[c] = x[c, last]
    m.state.counts.rhs += 1
    set_force(m.right.force, m.workspace.times[last], point, f_at_point)
    for c in range(point.shape[0]):
        moved = abs((f_at_point[c] - f[c, last]) * m.operators.sums[m.equations.kinds[c], last])
        if not moved <= CHECK_BEYOND * m.workspace.newton_tol[c]:
            return False
    return True


@inner
def set_rounding(m):
    """Set the change of p by rounding of f, `m.workspace.rounding` (d,), after an iteration."""
    # in a first iteration changes of this size may still be those of the solution
    sums, kinds, workspace = m.operators.sums, m.equations.kinds, m.workspace
    for c in range(kinds.shape[0]):
        summed = workspace.force_scales[c] * abs(sums[kinds[c], -1])
        workspace.rounding[c] = _ROUNDING_BY_F * summed


@inner
def verdict(size, previous, rate, sweep, fresh):
    """Return what follows a Newton change of finite size, as a verdict of compiled/newton.py."""
    # size and previous: changes in units of the tolerance; previous is infinite for the first one
    # with new factors. rate: of `contraction_rate`; the error is at most _PER_RATE times rate times
    # the last change. sweep: number of the iteration, from 0. fresh: the Jacobian is one of this
    # step.
    if size * min(1.0, _PER_RATE * rate) < 1.0:
        return ACCEPT
    if previous == np.inf or rate <= _MAX_CONTRACTION_RATE:
        return ITERATE
    if rate > _MAX_FAILING_RATE and sweep > _EARLY:
        return FAIL
    return ITERATE if fresh else REFRESH


@inner
def iterate_once(m, p, x, f):
    """Make one fixed-point iteration for explicit rows; return whether any row is algebraic."""
    # Such rows may be independent of their unknowns while all memory is 0: Newton's matrix,
    # singular at the first guess, may be regular after it. p, which is changed, x (= y) and f (d,
    # s) are at the nodes.
    implicit, residual, s, found = m.equations.implicit, m.workspace.residual, p.shape[1], False
    residuals(m, m.workspace.base[0], p, x, f)
    for c in range(p.shape[0]):
        found = found or implicit[c] == ALGEBRAIC
        for i in range(s if implicit[c] == 0 else 0):
            p[c, i] -= residual[c * s + i]
    return found


@inner
def raise_units(m, h, f):
    """Raise the units of components, (d,), to a part of what f (d, s) makes of them in the step."""
    # where a force sets in, rounding of f would hide the differences over smaller increments
    sums, kinds, above_one = m.operators.sums, m.equations.kinds, m.equations.above_one
    for c in range(kinds.shape[0]):
        made = largest_of(f[c], 0, f.shape[1]) * abs(sums[kinds[c], -1])
        made = _OF_FORCE * made * (h if above_one[c] == 1 else 1.0)
        m.workspace.units[c] = (
            made if m.workspace.units[c] < made < np.inf else m.workspace.units[c]
        )


@inner
def stage_jacobians(m, x, out):
    """Set the Jacobian of f at each node, or at the middle node only; return the calls of `rhs`."""
    # x (d, s): y at the nodes; out (s, d, d), or (1, ., .) for the middle node only
    times, point, units = m.workspace.times, m.workspace.point, m.workspace.units
    s, calls = times.shape[0], 0
    for i in range(out.shape[0]):
        k = i if out.shape[0] > 1 else s // 2
        for c in range(point.shape[0]):
            point[c] = x[c, k]
        calls += m.right.jacobian(m.right.force, times[k], point, units, out[i])
    return calls


@inner
def correct_forces(jacobians, before, x, f, moved):
    """Correct f (d, s) to first order by J (x - before), from y = `before` to y = x, (d, s)."""
    # jacobians: J of all nodes or of each; moved (s, d): work array
    d, s = x.shape
    sparse, by_nodes, entries = is_sparse(jacobians[0], d), jacobians.shape[0] > 1, jacobians[0]
    for k in range(entries.shape[1] if sparse else 0):
        c, e = int(entries[ROWS, k]), int(entries[COLUMNS, k])
        for i in range(s):
            value = jacobians[i if by_nodes else 0, VALUES, k]
            f[c, i] += value * (x[e, i] - before[e, i])
    for c in range(0 if sparse else d):
        for i in range(s):
            moved[i, c] = x[c, i] - before[c, i]
    for c in range(0 if sparse else d):
        for i in range(s):
            f[c, i] += dot(jacobians[i if by_nodes else 0, c], moved[i], 0, d)


@inner
def take_back_at_nodes(f, share, change, p):
    """Undo the fraction `share` of the last change of p at nodes where f (d, s) is not finite."""
    # change (d s,) was subtracted from p (d, s), and is reduced as well
    d, s = p.shape
    for i in range(s):
        finite = True
        for c in range(d):
            finite = finite and abs(f[c, i]) < np.inf
        for c in range(0 if finite else d):
            p[c, i] += share * change[c * s + i]
            change[c * s + i] *= 1.0 - share


@inner
def take_change(change, newton_tol, rounding, scales, p):
    """Subtract a change (d s,) from p (d, s); return its largest ratio to the tolerance (d,)."""
    # at least the rounding of p: its own, rounding (d,), and that of a linear system in units of
    # scales (d,), which mixes all changes
    size, mixed, s = 0.0, 0.0, p.shape[1]
    for c in range(p.shape[0] if p.shape[0] > 1 else 0):
        mixed = max(mixed, largest_of(change, c * s, s) / scales[c])
    for c in range(p.shape[0]):
        largest = 0.0
        for i in range(s):
            p[c, i] -= change[c * s + i]
            largest = max(largest, abs(p[c, i]))
        allowed = max(_MIN_NEWTON_RTOL * largest, _MIN_NEWTON_ATOL)
        if newton_tol[c] > _MIN_NEWTON_ATOL:  # else it begins at 0 and has no size yet
            allowed = max(newton_tol[c], rounding[c], _ROUNDING_OF_PRIMARY * largest)
        allowed = max(allowed, ROUNDING_OF_SYSTEM * mixed * scales[c])
        ratio = largest_of(change, c * s, s) / allowed
        size = size if ratio <= size else ratio  # also NaN
    return size


@inner
def contraction_rate(size, previous, h, contraction):
    """Return the contraction rate of Newton's method, the ratio of two successive changes."""
    # In units of the tolerance; it is recorded in contraction. After the first change, with
    # previous infinite, it is estimated from earlier steps.
    contraction.last = size
    if previous < np.inf:
        rate = size / previous
        contraction.rate = max(rate, 0.1 * contraction.rate)
        contraction.change = max(previous, 0.1 * contraction.change)
        contraction.length = h
        return rate
    # the recorded rate of earlier steps, larger for a worse first guess and for a longer step
    rate = contraction.rate * max(1.0, size / contraction.change)
    return rate * max(1.0, h / contraction.length) ** 2


@inner
def residuals(m, base, p, x, f):
    """Set `m.workspace.residual` (d s,): p - base - integrals at the nodes, or -f for 0 = f."""
    # By component, then by node; p, x (= y) and f (d, s) at the nodes. base (R, s): known part of
    # the rows.
    kinds, columns, out, (d, s) = (
        m.equations.kinds,
        m.operators.columns,
        m.workspace.residual,
        p.shape,
    )
    of_force_alone = m.operators.alone
    for c in range(d):
        kind, first = kinds[c], c * s
        if m.equations.implicit[c] == ALGEBRAIC:  # p, with the factor 0, would hide a small f
            for i in range(s):
                out[first + i] = -f[c, i]
            continue
        own, alone = columns[kind], of_force_alone[kind] == 1
        for i in range(s):
            out[first + i] = p[c, i] - base[c, i]
        for j in range(s if alone else 0):
            by_f, a = own[FORCE, j], f[c, j]
            for i in range(s):
                out[first + i] -= by_f[i] * a
        for j in range(0 if alone else s):  # f and terms may cancel: summed before the subtraction
            by_f, by_p, by_x = own[FORCE, j], own[PRIMARY, j], own[POSITION, j]
            a, b, e = f[c, j], p[c, j], x[c, j]
            for i in range(s):
                out[first + i] -= by_f[i] * a + by_p[i] * b + by_x[i] * e


@inner
def solve_tangent_stages(m, h):
    """Solve a step of length h, linearised along the orbit, for the tangents; False if it fails."""
    # m.workspace.values gets f, p and y of the k tangents in columns 1 to k; column 0 has the
    # orbit's. Few components factorise the matrix anew, with a Jacobian at each node, and one
    # iteration is exact. Many use the factors of the orbit, and iterate until they converge.
    workspace, values = m.workspace, m.workspace.values
    x_start, jacobians = m.orbit.x, m.workspace.jacobians
    s, few, of_orbit = values.shape[3], m.stages.jacobians.shape[0] > 1, m.stages.jacobians
    none, change = workspace.before, workspace.change
    for i in range(0 if few else s):
        put_matrix(of_orbit[0], jacobians[i])
    m.state.counts.rhs += stage_jacobians(m, values[0, POSITION], jacobians)
    if few and not factorise_newton(m, h, values[0, PRIMARY], jacobians):
        return False
    clear_matrix(none)
    for column in range(1, values.shape[0]):
        f, p, x = values[column, FORCE], values[column, PRIMARY], values[column, POSITION]
        clear_matrix(p)
        clear_matrix(workspace.forced)
        if column <= m.right.by_params:
            set_derivatives_by(column - 1, m)
        done = False
        for _ in range(_TANGENT_NEWTON_MAXITER):
            positions(m, h, p, x_start[column], x)
            put_matrix(workspace.forced, f)
            correct_forces(jacobians, none, x, f, workspace.moved)
            if done:
                break
            residuals(m, workspace.base[column], p, x, f)
            solve_newton(m)
            moved, size = 0.0, 0.0
            for c in range(p.shape[0]):
                for i in range(s):
                    p[c, i] -= change[c * s + i]
                    moved = max(moved, abs(change[c * s + i]))
                    size = max(size, abs(p[c, i]))
            done = few or moved <= _TANGENT_NEWTON_RTOL * size
            if not moved < np.inf:
                return False
        if not done:
            return False
    return True


@inner
def set_derivatives_by(k, m):
    """Set `m.workspace.forced` (d, s) to d f / d p_k at the orbit's nodes, for parameter k."""
    workspace, x = m.workspace, m.workspace.values[0, POSITION]
    for i in range(x.shape[1]):
        for c in range(x.shape[0]):
            workspace.point[c], workspace.f_at_point[c] = x[c, i], 0.0
        calls = add_derivative_by(
            k, m.right.force, workspace.times[i], workspace.point, workspace.f_at_point
        )
        m.state.counts.rhs += calls
        for c in range(x.shape[0]):
            workspace.forced[c, i] = workspace.f_at_point[c]
