"""Error estimates of a collocation step, and their ratio to the tolerance.

Letters of shapes: d components, s nodes, M modes, n_k general kernels, n_q integrands (f, p and y,
and p' if needed). Components of one kind have the same terms and share the K rows of matrices. The
primary unknown p is y, or y' for orders above 1. `m` is an `AdaptiveWork`, `m.workspace` its
workspace. The defect of f is the difference of f and its polynomial through the nodes. Row d + c
has the terms that are subtracted from f of component c.
"""

import math

import numpy as np

from ..compiled.jacobian import LEAST
from ..compiled.jit import inner
from ..compiled.linalg import clear, dot, largest_of, put, put_matrix
from .found_jumps import ROUNDING_OF_F, look
from .newton import (
    CHECK_BEYOND,
    ROUNDING_OF_SYSTEM,
    contraction_rate,
    correct_forces,
    force_on_its_side,
    forces,
    nodal_slopes,
    positions,
    residuals,
    solve_for_orbit,
    take_change,
)
from .operators import FORCE, POSITION, PRIMARY, SLOPE, subtract_from_forces
from .structures import ALGEBRAIC, AT_EDGE
from .tolerances import ROUNDING_OF_SUMS, allowed_error, error_of_growth, error_of_young

# Smallest relative tolerance of tangents. Decayed tangents consist of rounding errors, which grow
# when tangents are normalised.
_TANGENT = 1e-9
# Least size of a derivative by a parameter p, as fraction of y / p. Difference quotients of f have
# errors of 1e-10 of f / p, which may exceed the tolerance of a small derivative.
_OF_QUOTIENT = 0.1
# Rounding error of p, as a fraction of p(0).
_ROUNDING_OF_P = 1e-14
# Largest decay from one Legendre coefficient to the next that is assumed if rounding hides both.
_MAX_HIDDEN_DECAY = 0.03
# Fraction of the defect of f between the nodes that enters the error, for an f that jumps. For a
# smooth f the last Legendre coefficients estimate the error, because the integrals are more
# accurate than f.
_DEFECT_WEIGHT = 0.3
# Change of p that Newton's method requires after this second evaluation of the equations, in units
# of Newton's tolerance. Above it the step is rejected.
_MAX_RESIDUAL_CHANGE = 10.0
# Ratio of such a change to the one before up to which it is one more iteration, and no rejection.
_MAX_RESIDUAL_CONTRACTION = 1e-2
# Distance of the step's polynomial from y at the start, in tolerances, above which f at the start
# enters the defect. Stiff systems miss the start by rounding.
_MAX_START_MISMATCH = 10.0
# Largest error of a step, in tolerances of y at its start. In a first step y may grow by decades.
# Without this limit, orders 0.0158 and 1 - 1e-8 err by 1.8 tolerances at early times.
_AT_START = 5.0
# Ratio of relative errors of two trial steps above which the shorter step does not reduce them.
NO_LESS = 0.5
# Largest error by rounding of f, as a fraction of |J| |y| summed over the step.
_ROUNDING_OF_SUM = 1e-13
# Rounding error of y, as a fraction of the largest y of a step.
_ROUNDING_OF_STEP = 1e-13


@inner
def estimate_error(m, h, local, values, p0, errors):
    """Set `errors` (d,) to estimates of the error of p over a step of length h."""
    # The first omitted Legendre coefficient of each integrand is extrapolated and integrated. Stiff
    # equations damp the resulting residual; none amplifies it. Coefficients of f within its
    # rounding are ignored, because no shorter step makes them smaller. At least the interpolation
    # error of p in dense output.
    # local (n_k, s, s): convolutions over the step; matrices (K, 3, s, s); values (n_q, d, s): the
    # integrands; p0 (d,): p(0)
    equations, legendre = m.equations, m.rule.legendre
    matrices, workspace = m.operators.matrices, m.workspace
    terms, orders, kinds = equations.terms, equations.orders, equations.kinds
    start_scales, force_scales = workspace.start_scales, workspace.force_scales
    d, s, n_a = errors.shape[0], values.shape[2], orders.shape[0]
    defect, nodal_errors = workspace.residual, workspace.change
    for c in range(d):
        last, decay = legendre_tail(legendre, values[PRIMARY, c], _ROUNDING_OF_P * abs(p0[c]))
        errors[c] = abs(last) * decay * decay
    for integrand in range(values.shape[0]):
        clear(defect)
        for n in range(terms.shape[0]):
            c, q, k = terms[n].row, terms[n].integrand, terms[n].index
            if q != integrand:
                continue
            rounding = 0.0
            if q == PRIMARY:
                rounding = _ROUNDING_OF_P * abs(p0[c % d])
            elif q == FORCE:
                rounding = _ROUNDING_OF_P * start_scales[c % d]
            elif q == POSITION:
                rounding = ROUNDING_OF_SUMS * abs(values[q, c % d, -1])
            last, decay = legendre_tail(legendre, values[q, c % d], rounding)
            if q == FORCE and abs(last) <= ROUNDING_OF_F * force_scales[c % d]:
                continue
            size = 1.0
            if k >= n_a:
                size = largest_of(local[k - n_a, -1], 0, s)
            elif k >= 0:
                size = h ** orders[k]
            if c >= d:
                size *= largest_of(matrices[kinds[c - d], FORCE, -1], 0, s)
            for i in range(s):
                defect[(c % d) * s + i] += terms[n].coefficient * size * last * decay
        if largest_of(defect, 0, d * s) == 0.0:
            continue
        solve_for_error(m)
        for c in range(d):
            errors[c] += largest_of(nodal_errors, c * s, s)


@inner
def solve_for_error(m):
    """Solve for the error of p, `m.workspace.change`, by `m.workspace.residual`, both (d s,)."""
    # In units of Newton's tolerance it is at most the largest residual: a nearly singular matrix
    # would amplify rounding. No limit if an algebraic row has a residual, which has the unit of f
    # and not of p.
    solve_for_orbit(m)
    defect, nodal_errors = m.workspace.residual, m.workspace.change
    newton_tol, of_defect, of_error = m.workspace.newton_tol, 0.0, 0.0
    s = defect.shape[0] // newton_tol.shape[0]
    for c in range(newton_tol.shape[0]):
        unit = max(newton_tol[c], LEAST)
        if m.equations.implicit[c] == ALGEBRAIC:
            of_defect = np.inf if largest_of(defect, c * s, s) > 0.0 else of_defect
            continue
        of_defect = max(of_defect, largest_of(defect, c * s, s) / unit)
        of_error = max(of_error, largest_of(nodal_errors, c * s, s) / unit)
    for i in range(defect.shape[0] if of_defect < of_error else 0):
        nodal_errors[i] *= of_defect / of_error


@inner
def measure_force_defect(m, h):
    """Set `m.workspace.defect` (d,) to the largest error of the polynomial of f off the nodes."""
    # Only off the nodes one sees that f jumps, or acts between them. Its argument y is the
    # polynomial through the same nodes, so a linear f has no defect. If the polynomial misses y at
    # the start, the first check point, by far more than the tolerance, f at the true y counts too.
    # x_start (d,): y at the start of the step; p0 (d,): p(0)
    x_start, p0 = m.orbit.x[0], m.orbit.initial[0]
    point, sizes = m.workspace.point, m.workspace.sizes
    misses_start = False
    clear(m.workspace.defect)
    for i in range(m.workspace.check_times.shape[0]):
        set_point(m, h, i)
        for c in range(point.shape[0] if i == 0 else 0):
            size = max(abs(x_start[c]), abs(p0[c]))  # p(0) as well, for a singular start
            allowed = _MAX_START_MISMATCH * allowed_error(c, size, sizes[c], 0, 1.0, m.limits)
            misses_start = misses_start or abs(point[c] - x_start[c]) > allowed
        if i == 0 and m.stages.control[AT_EDGE] == 1.0:
            put(x_start, point)
        update_force_defect(m, i, point)
    if misses_start:
        update_force_defect(m, 0, x_start)


@inner
def set_point(m, h, i):
    """Set `m.workspace.point` (d,) to y at check point i, by the step's polynomial of p."""
    weights, integrals = m.rule.check_values[i], m.rule.check_integrals[i]
    p, point, s = m.workspace.values[0, PRIMARY], m.workspace.point, weights.shape[0]
    for c in range(point.shape[0]):
        if m.equations.above_one[c] == 0:
            point[c] = dot(weights, p[c], 0, s)
        else:
            point[c] = m.orbit.x[0, c] + h * dot(integrals, p[c], 0, s)


@inner
def update_force_defect(m, i, point):
    """Raise `m.workspace.defect` (d,) to f at `point` (d,) less its polynomial at point i."""
    f_at_point = m.workspace.f_at_point
    force_defect, forces = m.workspace.defect, m.workspace.values[0, FORCE]
    check_values = m.rule.check_values[i]
    y = m.workspace.values[0, POSITION]
    force_on_its_side(m, m.workspace.check_times[i], y, point, f_at_point)
    for c in range(point.shape[0]):
        total = f_at_point[c]
        for j in range(check_values.shape[0]):
            total -= check_values[j] * forces[c, j]
        if not abs(total) <= abs(force_defect[c]):  # NaN counts as the largest
            force_defect[c] = total


@inner
def defect_matters(m):
    """Return whether the defect of f, integrated over h, moves p far beyond Newton's tolerance."""
    # damping by the equations, and defects within the rounding of f, do not count
    sums, kinds, force_scales = m.operators.sums, m.equations.kinds, m.workspace.force_scales
    force_defect, newton_tol = m.workspace.defect, m.workspace.newton_tol
    for c in range(force_defect.shape[0]):
        size = largest_of(sums[kinds[c]], 0, sums.shape[1])
        if (
            abs(force_defect[c]) > ROUNDING_OF_F * force_scales[c]
            and abs(force_defect[c]) * size > CHECK_BEYOND * newton_tol[c]
        ):
            return True
    return False


@inner
def equations_hold(m, h):
    """Evaluate f at the nodes again; return whether p there satisfies the equations."""
    # Quotients across a jump of f give a huge Jacobian, with which Newton's method makes small
    # changes and seems to have converged. If the changes contract, this is one more iteration.
    workspace, values, contraction = m.workspace, m.workspace.values[0], m.state.contraction
    f, p, x, before = values[FORCE], values[PRIMARY], values[POSITION], workspace.before
    previous = contraction.last
    forces(m, x, before)
    residuals(m, workspace.base[0], p, x, before)
    solve_for_orbit(m)
    tolerances = workspace.newton_tol, workspace.rounding
    size = take_change(workspace.change, *tolerances, m.stages.scales, p)
    if not size <= max(_MAX_RESIDUAL_CHANGE, _MAX_RESIDUAL_CONTRACTION * previous):
        return False
    put_matrix(before, f)
    put_matrix(x, before)
    positions(m, h, p, m.orbit.x[0], x)
    correct_forces(m.stages.jacobians[:1], before, x, f, workspace.moved)
    contraction_rate(size, previous, h, contraction)
    return True


@inner
def add_force_defect(m):
    """Raise `m.workspace.errors` (d,) to a part of p's error by the defect of f above rounding."""
    sums, kinds, force_scales = m.operators.sums, m.equations.kinds, m.workspace.force_scales
    errors, force_defect = m.workspace.errors, m.workspace.defect
    d, s = kinds.shape[0], sums.shape[1]
    defect, nodal_errors = m.workspace.residual, m.workspace.change
    for c in range(d):
        excess = force_defect[c]
        if abs(excess) <= ROUNDING_OF_F * force_scales[c]:
            excess = 0.0
        for i in range(s):
            defect[c * s + i] = excess * sums[kinds[c], i]
    if largest_of(defect, 0, d * s) == 0.0:
        return
    solve_for_error(m)
    for c in range(d):
        error = _DEFECT_WEIGHT * largest_of(nodal_errors, c * s, s)
        if not error <= errors[c]:
            errors[c] = error


@inner
def legendre_tail(legendre, values, rounding):
    """Return a polynomial's last Legendre coefficient, and the decay to the next one, in [0, 1]."""
    # values (s,) at the nodes. A coefficient may be small by chance, and collocation makes the last
    # one small, so the decay is from the larger of the two before the last two to the larger of
    # these. The last one is at least the one before times the decay. Within the error `rounding` of
    # values the decay is unknown and limited, or steps would be rejected that no shorter step
    # improves.
    s = values.shape[0]
    last, before, earlier, decay = 0.0, 0.0, 0.0, 1.0
    for k in range(max(0, s - 4), s):
        total = 0.0
        for j in range(s):
            total += legendre[k, j] * values[j]
        if k < s - 2:
            earlier = max(earlier, abs(total))
        else:
            before, last = last, total
    if s > 3 and earlier > 0.0:
        decay = min(1.0, math.sqrt(max(abs(last), abs(before)) / earlier))
    elif s <= 3 and before != 0.0:
        decay = min(1.0, abs(last / before))
    if abs(last) < decay * abs(before):
        last = decay * before
    hidden = abs(last) <= rounding * decay
    return last, (min(decay, _MAX_HIDDEN_DECAY) if hidden else decay)


@inner
def tangent_error_ratio(m, h, table_index):
    """Return the largest ratio of a tangent's error to its tolerance, over all tangents."""
    # Relative to the tangent's size. Size and error are the largest among components over their
    # units. The derivative by a parameter p has at least the size _OF_QUOTIENT / |p|.
    values, p0 = m.workspace.values, m.orbit.initial
    errors, units = m.workspace.errors, m.workspace.units
    worst, rtol = 0.0, max(m.limits.tolerance.rtol, _TANGENT)
    for column in range(1, values.shape[0]):
        estimate_error(m, h, m.tables.local[table_index], values[column], p0[column], errors)
        size = 0.0
        for q in range(PRIMARY, values.shape[1]):
            for c in range(errors.shape[0]):
                own = largest_of(values[column, q, c], 0, values.shape[3])
                if not own < np.inf:
                    return np.inf
                size = max(size, own / units[c])
        if column <= m.right.by_params:
            p = abs(m.right.force.functions.params[column - 1])
            size = max(size, _OF_QUOTIENT / (p if p > 0.0 else 1.0))
        if size > 0.0:
            for c in range(errors.shape[0]):
                worst = max(worst, errors[c] / units[c] / (rtol * size))
    return worst


@inner
def error_ratio(m, h):
    """Return the largest ratio of a step's error to its tolerance, over all components."""
    # Of y, and of y' where it is the unknown p. The tolerance of p is at least Newton's, and the
    # rounding of p(0), because p is a difference of p(0) and terms of the same size. Errors that no
    # shorter step reduces do not count.
    limits, errors = m.limits, m.workspace.errors
    above_one, values = m.equations.above_one, m.workspace.values[0]
    sizes, newton_tol = m.workspace.sizes, m.workspace.newton_tol
    p0, largest = m.orbit.initial[0], m.state.largest
    control, worst, before = m.state.control, 0.0, m.workspace.sizes_before
    end = control.origin + control.time + h
    for c in range(errors.shape[0]):
        size_p, size_x, size = 0.0, 0.0, sizes[c]
        for i in range(values.shape[2]):
            size_p = max(size_p, abs(values[PRIMARY, c, i]))
            size_x = max(size_x, abs(values[POSITION, c, i]))
        own, ratio = size_p, 0.0
        if above_one[c] == 1:
            size_p = max(size_p, largest[c])
            allowed = max(allowed_error(c, size_x, size, 0, end, limits), LEAST)
            ratio = h * errors[c] / allowed
        allowed = allowed_error(c, size_p, size, above_one[c], end, limits)
        if above_one[c] == 0 and before[c] > LEAST:
            at_start = _AT_START * allowed_error(c, before[c], before[c], 0, end, limits)
            allowed = min(allowed, max(at_start, _ROUNDING_OF_STEP * size_p))
        rounding = max(_ROUNDING_OF_P * abs(p0[c]), ROUNDING_OF_SYSTEM * m.stages.scales[c])
        allowed = max(allowed, rounding, newton_tol[c], LEAST)
        ratio = max(ratio, errors[c] / allowed)
        if ratio > worst and counts(m, h, c, own, allowed):
            worst, control.worst = ratio, c
        if not errors[c] < np.inf:
            return np.inf
    return worst


@inner
def counts(m, h, c, largest, allowed):
    """Return whether the error of component c counts, whose largest |p| in the step is given."""
    error = m.workspace.errors[c]
    if error <= error_of_young(m.state, c, m.equations.above_one[c], m.limits):
        return False
    return not ((error > allowed or m.state.noisy[c] == 1.0) and is_least(m, h, c, largest))


@inner
def is_least(m, h, c, largest):
    """Return if no shorter step reduces the error of component c, relative to its largest |p|."""
    # So for rounding of f, and in a first step for a power of time that its polynomials do not
    # contain; a rejected step tells. The growing component may err by the tolerance of what it
    # becomes by this power.
    state, sums = m.state, m.operators.sums[m.equations.kinds[c]]
    error, tried = m.workspace.errors[c], state.tried[c]
    share = error / max(largest, LEAST)
    grown = error_of_growth(m, h, c)
    if grown > 0.0:
        return share >= NO_LESS * tried and error <= grown
    if error > _ROUNDING_OF_SUM * m.workspace.force_scales[c] * abs(sums[-1]):
        return False
    if share >= NO_LESS * tried * (h / state.control.tried):
        state.noisy[c] = 1.0
    return state.noisy[c] == 1.0


@inner
def orbit_error(m, h, table_index):
    """Return a solved step's error over the tolerance, and if only the defect makes it > 1."""
    # in m.workspace.values f becomes f minus the terms of rows d + c, and p' is set if needed
    workspace, values = m.workspace, m.workspace.values
    counts, start = m.state.counts, m.orbit.initial[0]
    measure_force_defect(m, h)
    counts.rhs += workspace.check_times.shape[0]
    # from an edge, the infinite slope of f turns a small error of y into a large one of f
    at_edge = m.stages.control[AT_EDGE] == 1.0
    m.state.control.missed = 0.0 if at_edge else look(m, h)
    if m.state.control.missed > 0.0:
        return np.inf, True
    if not at_edge and defect_matters(m):
        counts.rhs += workspace.times.shape[0]
        if not equations_hold(m, h):
            return np.inf, True
    subtract_from_forces(m.equations.kinds, m.operators.matrices, workspace.base, values[:1])
    if values.shape[1] > SLOPE:
        nodal_slopes(h, m.rule.inverse, m.orbit.p[0], values[0, PRIMARY], values[0, SLOPE])
    estimate_error(m, h, m.tables.local[table_index], values[0], start, workspace.errors)
    ratio_at_nodes = error_ratio(m, h)
    add_force_defect(m)
    ratio = error_ratio(m, h)
    return ratio, ratio_at_nodes <= 1.0 and not ratio <= 1.0


@inner
def tangents_error(m, h, table_index):
    """Return the largest ratio of error to tolerance of the solved tangents."""
    # in m.workspace.values f becomes f minus the terms of rows d + c, and p' is set if needed
    p, values, base = m.orbit.p, m.workspace.values, m.workspace.base
    subtract_from_forces(m.equations.kinds, m.operators.matrices, base[1:], values[1:])
    if values.shape[1] > SLOPE:
        for column in range(1, p.shape[0]):
            own = values[column]
            nodal_slopes(h, m.rule.inverse, p[column], own[PRIMARY], own[SLOPE])
    return tangent_error_ratio(m, h, table_index)
