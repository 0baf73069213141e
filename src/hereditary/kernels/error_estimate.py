"""Errors of a collocation step, compared with its tolerance (floor 1)."""

import numpy as np

from .._jit import kernel
from .collocation import FORCE, POSITION, PRIMARY, forces, residuals
from .linalg import substitute

# Tangents that have decayed are known to their rounding alone, which grows as they are stretched:
# no step is refused for less than this.
_TANGENT = 1e-9
# Share of p(0) below which no error of p can be told.
_ROUNDING = 1e-14
# Share of what f is off its polynomial between the nodes that its integrals keep. Where f is smooth
# the rule's nodes make it less, and the tail of the polynomial tells it; where f jumps this does.
_OFF = 0.3
# Share of |J| |y| that is rounding of f, enlarged by a polynomial through its values.
_NOISE = 2e-14
# Goals of Newton's method, each a hundredth of a step's tolerance: how many f must be off for its
# result to be looked at again, and how many that may then be off.
_FAR, _NOT_MET = 100.0, 10.0
# Tolerances of a step that its polynomial may miss the start by: less is rounding of stiff systems.
_MISSED = 10.0


@kernel
def estimate(h, equations, legendre, local, matrices, values, newton, errors):
    """Set the error of p by each integrand: the Legendre coefficient after the last, integrated.

    It counts by what the equations leave of it, little where they are stiff, and not for more than
    it is. Nor may p itself, as the dense output interpolates it, be further off.
    """
    # local (n_k, s, s), matrices (R, 3, s, s), values (3 or 4, d, s), errors (d,)
    terms, orders = equations.terms, equations.orders
    d, s, n_a = errors.shape[0], values.shape[2], orders.shape[0]
    defect, left = np.empty(d * s), np.empty(d * s)
    for c in range(d):
        last, shrink = tail(legendre, values[PRIMARY, c])
        errors[c] = abs(last) * shrink * shrink
    for integrand in range(values.shape[0]):
        defect[:] = 0.0
        for n in range(terms.shape[0]):
            c, q, k = terms[n].row, terms[n].integrand, terms[n].index
            if q != integrand:
                continue
            last, shrink = tail(legendre, values[q, c % d])
            size = 1.0
            if k >= n_a:
                size = np.max(np.abs(local[k - n_a, -1]))
            elif k >= 0:
                size = h ** orders[k]
            if c >= d:
                size *= np.max(np.abs(matrices[c - d, FORCE, -1]))
            for i in range(s):
                defect[(c % d) * s + i] += terms[n].coefficient * size * last * shrink
        if not np.any(defect):
            continue
        leave(defect, newton, left)
        for c in range(d):
            errors[c] += np.max(np.abs(left[c * s : (c + 1) * s]))


@kernel
def leave(defect, newton, left):
    """Solve for the error that a defect at all nodes, (d s,), makes: no more than the defect."""
    substitute(newton.matrix, newton.order, defect, left)
    # a matrix next to singular would make rounding of it
    left *= min(1.0, np.max(np.abs(defect)) / max(np.max(np.abs(left)), 1e-300))


@kernel
def off_nodes(rhs, params, times, h, rule, x_start, p0, second, values, limits, off):
    """Set how far f is from its polynomial, where the solution's is between the nodes, (d,).

    A right-hand side that jumps, or that comes and goes between the nodes, shows there alone. Both
    polynomials are those through the nodes: a linear f is none off its own. Where they miss the
    start, the first of the times, by far more than the tolerance, f is looked at from there too.
    """
    # times (m,), x_start, p0 (d,), values (3 or 4, d, s)
    d, s = second.shape[0], rule.extended.shape[1]
    point, missed = np.empty(d), False
    for i in range(times.shape[0]):
        for c in range(d):
            total = 0.0
            if second[c] == 0:
                for j in range(s):
                    total += rule.extended[i, j] * values[PRIMARY, c, j]
            else:
                for j in range(s):
                    total += rule.risen[i, j] * values[PRIMARY, c, j]
                total = x_start[c] + h * total
            point[c] = total
            size = max(abs(x_start[c]), abs(p0[c]))  # the step out of 0 may err by as much
            allowed = _MISSED * (limits.atol + limits.rtol * size)
            missed = missed or (i == 0 and abs(total - x_start[c]) > allowed)
        off_there(rhs, params, times[i], point, rule.extended[i], values, off)
    if missed:
        off_there(rhs, params, times[0], x_start, rule.extended[0], values, off)


@kernel
def off_there(rhs, params, t, point, extended, values, off):
    """Let `off` be no less than what f at a point is from its polynomial at a time."""
    force = np.empty(point.shape[0])
    rhs(t, point, force, params)
    for c in range(point.shape[0]):
        total = force[c]
        for j in range(extended.shape[0]):
            total -= extended[j] * values[FORCE, c, j]
        if not abs(total) <= abs(off[c]):  # not a number counts as most
            off[c] = total


@kernel
def exceeds(off, matrices, goal, newton):
    """Whether f, off its nodes by so much, would move p beyond Newton's goal, were it not stiff."""
    for c in range(off.shape[0]):
        size = np.max(np.abs(np.sum(matrices[c, FORCE], axis=1)))
        if abs(off[c]) > _NOISE * newton.sizes[c] and abs(off[c]) * size > _FAR * goal[c]:
            return True
    return False


@kernel
def confirmed(rhs, params, times, base, matrices, goal, values, newton):
    """Whether p, as Newton's method left it, meets the equations with f as it is there.

    A Jacobian that was differenced across a jump makes any equation look stiff, and solved.
    """
    f, p, x = np.empty(values[FORCE].shape), values[PRIMARY], values[POSITION]
    residual, change = np.empty(p.size), np.empty(p.size)
    forces(rhs, params, times, x, f)
    residuals(base, matrices, p, x, f, residual)
    substitute(newton.matrix, newton.order, residual, change)
    s = p.shape[1]
    for c in range(p.shape[0]):
        for i in range(s):
            if not abs(change[c * s + i]) <= _NOT_MET * goal[c]:
                return False
    return True


@kernel
def add_unseen(off, matrices, newton, errors):
    """Let errors (d,) be no less than what f, off its nodes by so much, makes p err by.

    As far as rounding of f does not explain it.
    """
    d, s = off.shape[0], matrices.shape[2]
    defect, left = np.empty(d * s), np.empty(d * s)
    for c in range(d):
        beyond = off[c]
        if abs(beyond) <= _NOISE * newton.sizes[c]:
            beyond = 0.0
        for i in range(s):
            defect[c * s + i] = beyond * np.sum(matrices[c, FORCE, i])
    leave(defect, newton, left)
    for c in range(d):
        unseen = _OFF * np.max(np.abs(left[c * s : (c + 1) * s]))
        if not unseen <= errors[c]:
            errors[c] = unseen


@kernel
def tail(legendre, values):
    """The last Legendre coefficient, and the size of its ratio to the one before, 1 at most."""
    # values (s,)
    s = values.shape[0]
    last, before = 0.0, 0.0
    for j in range(s):
        last += legendre[s - 1, j] * values[j]
        before += legendre[s - 2, j] * values[j]
    return last, (min(1.0, abs(last / before)) if before != 0.0 else 1.0)


@kernel
def worst_tangent(h, equations, legendre, local, matrices, values, newton, rtol):
    """Largest ratio of a tangent's error to its tolerance, relative to all of the tangent."""
    worst, errors = 0.0, np.empty(values.shape[2])
    for strand in range(1, values.shape[0]):
        estimate(h, equations, legendre, local, matrices, values[strand], newton, errors)
        size = np.max(np.abs(values[strand, PRIMARY:]))
        if not size < np.inf:
            return np.inf
        if size > 0.0:
            worst = max(worst, np.max(errors) / (max(rtol, _TANGENT) * size))
    return worst


@kernel
def over_tolerance(h, end, errors, values, second, largest, p0, rtol, atol):
    """Largest ratio of an error to its tolerance, over y and, where it is unknown, y'.

    p is p(0) and what the modes take from it again: it is known to the rounding of p(0) alone.
    A velocity may err absolutely by what moves y as far as y may err until the step's end: over
    long times that is little.
    """
    worst = 0.0
    for c in range(errors.shape[0]):
        size_p, size_x, least = 0.0, 0.0, atol
        for i in range(values.shape[2]):
            size_p = max(size_p, abs(values[PRIMARY, c, i]))
            size_x = max(size_x, abs(values[POSITION, c, i]))
        if second[c] == 1:
            size_p, least = max(size_p, largest[c]), atol / max(1.0, end)
            worst = max(worst, h * errors[c] / (atol + rtol * size_x))
        worst = max(worst, errors[c] / max(least + rtol * size_p, _ROUNDING * abs(p0[c])))
        if not errors[c] < np.inf:
            return np.inf
    return worst
