"""Newton's method for one implicit step."""

import numpy as np

from .jacobian import COLUMNS, ROWS, VALUES, differences, is_sparse, jacobian, multiply
from .jit import allocating, inlined, inner
from .linalg import solve_in_place
from .signatures import FACTORISE, SUBSTITUTE
from .step import BASE, FIRST, GAIN, KNOWN, LEAD, MOVED, POINT, SCALE, SHIFT, UNITS, F, W, look

# Simplified Newton steps (one Jacobian) before the full method takes over, and full ones before a
# step is given up.
_SIMPLIFIED, _FULL = 8, 30
# Components above which factors are kept over steps, and contraction from which they are not.
KEPT_FROM, _SLOW = 9, 0.1
# Contraction from which the Jacobian of an earlier step is not kept of few components, and steps
# that then take their own (counts.factored counts them from below 0). Share of the error that is
# allowed with it: Newton's method leaves far less than its estimate, a kept Jacobian all of it,
# with equal sign in every step, which orders above 1 add up twice, and stiff ones take for f.
_SLOW_OF_FEW, _OWN, _OF_KEPT = 1e-3, -16, 1e-6
# counts.factored where factors of a linear step have been seen to solve it at once: to this rate,
# and without a residual that grew by this much, as by a matrix that is nearly singular.
AT_ONCE, _AT_ONCE_BELOW, _MOST_GROWN = 2, 1e-8, 1e6
# The step is solved when the estimated error of the increment is below this share of it, or below
# rounding of the solution, or below what floats can resolve.
_TOLERANCE, _ROUNDING, _UNDERFLOW = 1e-13, 2e-16, 1e-300
# A residual below this share of its summands is rounding, which is looked for where changes stay
# below this share of the solution.
_RESIDUAL, _SMALL = 4e-15, 1e-3


@inner
def solve_step(
    rhs, jac, has_jac, params, t, d, sources, room, point, f, work, counts, solver, linear
):  # fmt: skip
    """Solve ``scale w + known = lead f(t, base + gain w)`` for w, and so for tangents.

    The first d components have an equation; f reads all, at the w of their sources. The Jacobian of
    an earlier step is kept while it contracts well: counts.factored is 1 where there is one.
    Returns False where the iteration does not converge; calls of `rhs` are counted.
    """
    # room (N_ROOM, >= n): rows of a step; point, f (n,): its rows of these names; work (2, n, n):
    # Jacobian and room for Newton's matrix
    if linear.order.shape[0] > 0:
        return solve_with_factors(
            rhs, jac, has_jac, params, t, d, sources, room, work, counts, solver, linear
        )
    n, previous, kept, iteration = point.shape[0], np.inf, counts.factored == 1, 0
    for c in range(d if kept else 0):
        room[FIRST, c] = room[W, c]
    while iteration < _SIMPLIFIED + _FULL:
        for c in range(n):
            point[c] = room[BASE, c] + room[GAIN, c] * room[W, sources[c]]
        if not kept and (iteration == 0 or iteration >= _SIMPLIFIED):
            if has_jac == 1:
                jac(t, point, work[0], params)
            else:
                differences(rhs, t, point, params, room[UNITS], work[0], f, room[MOVED])
                counts.rhs += 2 * n
        rhs(t, point, f, params)
        counts.rhs += 1
        set_newton_system(n, d, sources, room, f, work)
        counts.factorised += 1
        solvable, size, largest, reference = eliminate(n, work, room), 0.0, 0.0, 0.0
        for c in range(d):
            room[W, c] += room[MOVED, c]
            size = max(size, abs(room[MOVED, c]))
            largest = max(largest, abs(room[W, c]) + abs(room[SHIFT, c]))
            reference = max(reference, abs(room[BASE, c]))
        solvable = solvable and size < np.inf
        # a contraction by `rate` leaves an error of rate / (1 - rate) times the last change
        rate = size / previous if iteration > 0 else 1.0
        left = size * rate / (1.0 - rate) if rate < 1.0 else size
        allowed = _TOLERANCE * largest + _ROUNDING * reference + _UNDERFLOW
        if solvable and left <= (_OF_KEPT * allowed if kept else allowed):
            # one that takes a third call has become old: the next step takes its own
            counts.factored += (iteration < 2) - 1 if kept else 1
            return room.shape[1] == n or solve_tangents(
                rhs, jac, has_jac, params, t, d, sources, room, work, counts
            )
        previous, iteration = size, iteration + 1
        if kept and not (solvable and (iteration == 1 or rate < _SLOW_OF_FEW)):
            for c in range(d):
                room[W, c] = room[FIRST, c]
            kept, iteration, previous, counts.factored = False, 0, np.inf, _OWN
        elif not solvable:
            return False
    return False


@inlined
def set_newton_system(n, d, sources, room, f, work):
    """As `newton_matrix` and `set_residual`, without views of the rows, which take 60 ns a step.

    Components beyond d have no equation: their w is left as it is.
    """
    for i in range(n):
        for k in range(n):
            work[1, i, k] = 0.0
        for k in range(n if i < d else 0):
            work[1, i, sources[k]] -= room[GAIN, k] * room[LEAD, i] * work[0, i, k]
        work[1, i, i] += room[SCALE, i] if i < d else 1.0
        room[MOVED, i] = 0.0
        if i < d:
            known = room[KNOWN, i] + room[SCALE, i] * room[W, i]
            room[MOVED, i] = room[LEAD, i] * f[i] - known


@inlined
def eliminate(n, work, room):
    """Solve Newton's system of few components, whose solution replaces the residual.

    Returns whether no pivot vanishes.
    """
    if n == 1:
        room[MOVED, 0] /= work[1, 0, 0]
        return abs(work[1, 0, 0]) > 0.0
    return solve_in_place(work[1], room[MOVED][:n])


@allocating
def solve_with_factors(
    rhs, jac, has_jac, params, t, d, sources, room, work, counts, solver, linear
):  # fmt: skip
    """As `solve_step`, with factors that are kept from step to step while they contract.

    They are in force where counts.factored is not 0, and then those of work[1].
    """
    # work (2, ., .), or (3, ., .) with tangents: Jacobian, Newton's matrix, that of the tangents
    known, shift, scale, lead, w = room[KNOWN], room[SHIFT], room[SCALE], room[LEAD], room[W]
    base, gain, n = room[BASE], room[GAIN], linear.order.shape[0]
    point, f, change = room[POINT][:n], room[F][:n], room[MOVED][:n]
    first, previous, fresh = w[:n].copy(), np.inf, False
    residual, grown, stalled, done = 0.0, 0.0, False, False
    for _ in range(_SIMPLIFIED + _FULL):
        look(base, gain, sources, w, point)
        if counts.factored == 0:
            counts.rhs += jacobian(rhs, jac, has_jac, t, point, params, room[UNITS], work[0])
            newton_matrix_of_many(work[0], n, d, sources, gain, scale, lead, work[1])
            if solver(FACTORISE, 0, work[1], change, linear) != 0:
                return False
            counts.factored, counts.factorised, fresh = 1, counts.factorised + 1, True
            previous = np.inf
        rhs(t, point, f, params)
        counts.rhs += 1
        set_residual(d, lead, f, known, scale, w, change)
        if stalled and grown < _MOST_GROWN:
            done = within_rounding(work[0], d, lead, f, known, scale, w, point, change)
        if counts.factored != AT_ONCE and previous == np.inf:
            for c in range(n):
                residual = max(residual, abs(change[c]))
        solver(SUBSTITUTE, 0, work[1], change, linear)
        size, largest, reference = apply_change(d, change, shift, base, w)
        rate = size / previous if previous < np.inf else 1.0
        if counts.factored == AT_ONCE and linear.exact == 1:
            rate = 0.0
        grown = max(grown, size / residual) if residual > 0.0 else grown
        residual = 0.0
        small = size <= _SMALL * (largest + reference)
        if small and previous < np.inf and rate > 0.5 and not stalled:
            stalled, previous = True, size  # perhaps by rounding
            continue
        if not done and (not size < np.inf or (rate >= 1.0 and previous < np.inf)):
            if fresh and not size < np.inf:
                return False
            counts.factored = 0
            if not fresh:
                for c in range(n):
                    w[c] = first[c]
            continue
        error = size * rate / (1.0 - rate) if rate < 1.0 else size
        if done or error <= _TOLERANCE * largest + _ROUNDING * reference + _UNDERFLOW:
            if linear.exact == 1 and rate <= _AT_ONCE_BELOW and grown < _MOST_GROWN:
                counts.factored = AT_ONCE
            return room.shape[1] == n or solve_tangents_with_factors(
                rhs, jac, has_jac, params, t, d, sources, room, work, counts, solver, linear
            )
        if rate < 1.0 and rate > _SLOW:
            counts.factored = 0
        previous = size
    counts.factored = 0
    return False


@allocating
def within_rounding(j_f, d, lead, f, known, scale, w, point, residual):
    """Whether the residuals of the d components are rounding errors of their summands."""
    n = point.shape[0]
    sizes = np.zeros(n)  # |J| |y|, of the summands of f
    if is_sparse(j_f, n):
        for k in range(j_f.shape[1]):
            sizes[int(j_f[ROWS, k])] += abs(j_f[VALUES, k] * point[int(j_f[COLUMNS, k])])
    else:
        for i in range(n):
            for k in range(n):
                sizes[i] += abs(j_f[i, k] * point[k])
    for i in range(d):
        size = abs(lead[i]) * (sizes[i] + abs(f[i])) + abs(known[i]) + abs(scale[i] * w[i])
        if not abs(residual[i]) <= _RESIDUAL * size:
            return False
    return True


@inner
def solve_tangents(rhs, jac, has_jac, params, t, d, sources, room, work, counts):
    """Solve ``scale w + known = lead J (base + gain w)`` for every tangent's w.

    J is the Jacobian where the orbit's own w, which is given, solves the step.
    Returns False where the equations are singular; calls of `rhs` are counted.
    """
    j_f, matrix = work[2], work[1]  # the Jacobian of the orbit may be kept
    n = j_f.shape[0]
    known, scale, lead, w = room[KNOWN], room[SCALE], room[LEAD], room[W]
    base, gain = room[BASE], room[GAIN]
    point, change = room[POINT][:n], room[MOVED][:n]
    look(base, gain, sources, w, point)
    counts.rhs += jacobian(rhs, jac, has_jac, t, point, params, room[UNITS], j_f)
    for first in range(n, base.shape[0], n):
        for i in range(n):
            change[i] = 0.0
        for i in range(d):
            total = 0.0
            for k in range(n):
                total += j_f[i, k] * base[first + k]
            change[i] = lead[i] * total - known[first + i]
        newton_matrix(j_f, n, d, sources, gain, scale, lead, matrix)
        if not solve_in_place(matrix, change):
            return False
        for i in range(d):
            w[first + i] = change[i]
    return True


@inner
def solve_tangents_with_factors(
    rhs, jac, has_jac, params, t, d, sources, room, work, counts, solver, linear
):  # fmt: skip
    """As `solve_tangents`, for many components: one factorisation for all tangents."""
    j_f, matrix, n = work[0], work[2], linear.order.shape[0]
    base, gain, w = room[BASE], room[GAIN], room[W]
    point, change = room[POINT][:n], room[MOVED][:n]
    look(base, gain, sources, w, point)
    counts.rhs += jacobian(rhs, jac, has_jac, t, point, params, room[UNITS], j_f)
    newton_matrix_of_many(j_f, n, d, sources, gain, room[SCALE], room[LEAD], matrix)
    if solver(FACTORISE, 1, matrix, change, linear) != 0:
        return False
    for first in range(n, base.shape[0], n):
        multiply(j_f, base[first : first + n], change)
        for i in range(n):
            change[i] = room[LEAD][i] * change[i] - room[KNOWN][first + i] if i < d else 0.0
        solver(SUBSTITUTE, 1, matrix, change, linear)
        for i in range(d):
            w[first + i] = change[i]
    return True


@inlined
def newton_matrix(j_f, n, d, sources, gain, scale, lead, matrix):
    """Set the derivative of ``scale w - lead f(t, base + gain w)`` by w, (n, n).

    Components beyond d have no equation: their w is left as it is.
    """
    for i in range(n):
        for k in range(n):
            matrix[i, k] = 0.0
        for k in range(n if i < d else 0):
            matrix[i, sources[k]] -= gain[k] * lead[i] * j_f[i, k]
        matrix[i, i] += scale[i] if i < d else 1.0


@inner
def newton_matrix_of_many(j_f, n, d, sources, gain, scale, lead, matrix):
    """As `newton_matrix`, of a sparse Jacobian where it is one."""
    if is_sparse(j_f, n):
        for k in range(j_f.shape[1]):
            i, j = int(j_f[ROWS, k]), int(j_f[COLUMNS, k])
            matrix[VALUES, k] = (scale[i] if i == j else 0.0) - gain[j] * lead[i] * j_f[VALUES, k]
    else:
        newton_matrix(j_f, n, d, sources, gain, scale, lead, matrix)


@inlined
def set_residual(d, lead, f, known, scale, w, out):
    """Set ``lead f - known - scale w`` of the d components with an equation, 0 of others."""
    for i in range(out.shape[0]):
        out[i] = lead[i] * f[i] - known[i] - scale[i] * w[i] if i < d else 0.0


@inlined
def apply_change(d, change, shift, base, w):
    """Add a change to w; return the largest change, increment and value of the d components."""
    size, largest, reference = 0.0, 0.0, 0.0
    for c in range(d):
        w[c] += change[c]
        size = max(size, abs(change[c]))
        largest = max(largest, abs(w[c]) + abs(shift[c]))
        reference = max(reference, abs(base[c]))
    return size, largest, reference


@inlined
def guess(p, integral, ratio, lead, known, force, pieces, w):
    """Set w to a first guess: with f as it was, or the increment before."""
    for c in range(w.shape[0]):
        w[c] = lead[c] * force[c] - known[c] if integral == 1 else ratio * pieces[c, p]
