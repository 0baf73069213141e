"""Solution of one implicit step, with the linear solver that a march is handed.

By Newton's method, or at once where only a constant matrix is taken implicitly.
"""

import numpy as np

from ..compiled.jacobian import jacobian, magnitudes, multiply, newton_matrix
from ..compiled.jit import allocating, inlined, inner
from ..compiled.linalg import solve_in_place
from ..compiled.signatures import FACTORISE, SUBSTITUTE
from .step import BASE, FIRST, GAIN, KNOWN, LEAD, MOVED, POINT, SCALE, SHIFT, UNITS, F, W, look

# Iterations before a step is given up.
_MOST = 38
# Times that a change, or the first guess of w, is halved where it leads out of the domain of f.
_HALVED = 8
# Contraction from which a Jacobian is renewed.
_SLOW = 0.1
# Contraction from which a Jacobian of an earlier step is renewed, where renewing is cheap.
_SLOW_OF_EARLIER = 1e-3
# Steps with a new Jacobian each, after one of an earlier step was slow, where renewing is cheap.
_RENEWED = 16
# Fraction of the allowed error with a Jacobian of an earlier step. The error of Newton's method is
# far below its estimate with a new Jacobian. With an earlier one it equals the estimate, with equal
# sign in every step. Orders above 1 sum it twice, and stiff equations mistake it for f.
_OF_EARLIER = 1e-6
# Factors solve a linear step at once if they contract to this rate.
_AT_ONCE = 1e-8
# They do not if a residual grew by this factor, as it does by a nearly singular matrix.
_MOST_GROWN = 1e6
# Allowed error of the increment, as a fraction of it. A step is solved when the estimated error is
# below the sum of this one and the next two.
_TOLERANCE = 1e-13
# Allowed error by rounding of the solution, as a fraction of the solution.
_ROUNDING = 2e-16
# Allowed error below what floats can resolve.
_UNDERFLOW = 1e-300
# A residual below this fraction of its summands is rounding.
_RESIDUAL = 4e-15
# Such residuals are sought only where a change is below this fraction of the solution.
_SMALL = 1e-3
# They are sought only where the ratio of successive changes is above this.
_STALLED = 0.5


@inner
def solve_step(
    rhs, jac, has_jac, params, t, d, sources, room, point, f, work, counts, solver, linear
):  # fmt: skip
    """Solve ``scale w + known = lead f(t, base + gain w)`` for w, and so for tangents.

    The first d components have an equation; f reads all, at the w of their sources. The Jacobian
    and the factors of an earlier step are kept while they contract (counts.kept). Return False if
    the iteration does not converge; count the calls of `rhs`.
    """
    # room (N_ROOM, >= n): rows of a step; point, f (n,): its rows of these names; work (2, ., .),
    # or (3, ., .) with tangents: Jacobian, Newton's matrix, that of the tangents
    base, gain, scale, lead, known = room[BASE], room[GAIN], room[SCALE], room[LEAD], room[KNOWN]
    n, w, first, change = point.shape[0], room[W], room[FIRST], room[MOVED][: point.shape[0]]
    few, previous, residual, grown = linear.few == 1, np.inf, 0.0, 0.0
    fresh, stalled, done = False, False, False
    for c in range(d):
        first[c] = change[c] = w[c]
    if counts.renewed > 0:
        counts.renewed, counts.kept = counts.renewed - 1, 0
    for iteration in range(_MOST):
        look(base, gain, sources, w, point)
        rhs(t, point, f, params)
        counts.rhs += 1
        if not is_finite(f, d) and not step_back(
            rhs, params, t, d, sources, room, change, point, f, counts
        ):
            break
        if counts.kept == 0:
            counts.rhs += jacobian(rhs, jac, has_jac, t, point, params, room[UNITS], work[0])
            if not few and not set_factors(0, n, d, sources, room, work, counts, solver, linear):
                return False
            counts.kept, counts.at_once, fresh, previous = 1, 0, True, np.inf
        for c in range(n):
            change[c] = lead[c] * f[c] - known[c] - scale[c] * w[c] if c < d else 0.0
        if stalled and grown < _MOST_GROWN:
            done = within_rounding(work[0], d, lead, f, known, scale, w, point, change)
        for c in range(d if previous == np.inf and not few else 0):
            residual = max(residual, abs(change[c]))
        if not few:
            solver(SUBSTITUTE, 0, work[1], change, linear)
        else:
            newton_matrix(work[0], n, d, sources, gain, scale, lead, work[1])
            if not solve_in_place(work[1], change):
                change[0] = np.inf
            counts.factorised += 1
        size, largest, reference = 0.0, 0.0, 0.0
        for c in range(d):
            w[c] += change[c]
            size = max(size, abs(change[c]))
            largest = max(largest, abs(w[c]) + abs(room[SHIFT, c]))
            reference = max(reference, abs(base[c]))
        # a contraction by `rate` leaves an error of rate / (1 - rate) times the last change
        rate = size / previous if previous < np.inf else 1.0
        if counts.at_once == 1:
            rate = 0.0
        grown = max(grown, size / residual) if residual > 0.0 else grown
        residual = 0.0
        small = size <= _SMALL * (largest + reference)
        if small and previous < np.inf and rate > _STALLED and not stalled:
            stalled, previous = True, size  # perhaps by rounding
            continue
        error = size * rate / (1.0 - rate) if rate < 1.0 else size
        allowed = _TOLERANCE * largest + _ROUNDING * reference + _UNDERFLOW
        allowed *= _OF_EARLIER if few and not fresh else 1.0
        if done or (size < np.inf and error <= allowed):
            if linear.exact == 1 and rate <= _AT_ONCE and grown < _MOST_GROWN:
                counts.at_once = 1
            if few and not fresh and iteration > 1:
                counts.kept = 0  # one that takes a third call has become old
            return room.shape[1] == n or solve_tangents(
                rhs, jac, has_jac, params, t, d, sources, room, point, work, counts, solver, linear
            )
        wrong = not size < np.inf or (rate >= 1.0 and previous < np.inf)
        if wrong and fresh and not size < np.inf:
            break
        for c in range(d if wrong and not fresh else 0):
            w[c] = change[c] = first[c]
        slow = _SLOW_OF_EARLIER if few and not fresh else _SLOW
        if wrong or slow < rate < 1.0:
            counts.kept = 0
            if few and not fresh:
                counts.renewed = _RENEWED
        previous = size
    counts.kept = 0
    return False


@inlined
def is_finite(f, d):
    """Return whether the first d values are finite."""
    finite = True
    for c in range(d):
        finite = finite and abs(f[c]) < np.inf
    return finite


@inner
def step_back(rhs, params, t, d, sources, room, change, point, f, counts):
    """Take back half of the last change of w until f is finite; return whether it is.

    If it never is, the change is replaced by that of functional iteration. Next to an edge where
    the slope of f is infinite Newton's method may point out of the domain.
    """
    w = room[W]
    for trial in range(2 * _HALVED + 1):
        for c in range(d):
            change[c] *= 0.5 if trial != _HALVED else 1.0
            w[c] -= change[c]
        look(room[BASE], room[GAIN], sources, w, point)
        rhs(t, point, f, params)
        counts.rhs += 1
        if is_finite(f, d) == (trial != _HALVED):
            return trial != _HALVED
        for c in range(d if trial == _HALVED else 0):
            change[c] = 2.0 * ((room[LEAD, c] * f[c] - room[KNOWN, c]) / room[SCALE, c] - w[c])
            w[c] += change[c]
    return False


@inner
def set_factors(number, n, d, sources, room, work, counts, solver, linear):
    """Factorise Newton's matrix of this number by the Jacobian in work[0]; False if singular."""
    matrix = work[1 + number]
    newton_matrix(work[0], n, d, sources, room[GAIN], room[SCALE], room[LEAD], matrix)
    counts.factorised += 1
    return solver(FACTORISE, number, matrix, room[MOVED][:n], linear) == 0


@allocating
def within_rounding(j_f, d, lead, f, known, scale, w, point, residual):
    """Return whether the residuals of the d components are rounding errors of their summands."""
    sizes = np.empty(point.shape[0])
    magnitudes(j_f, point, sizes)  # of the summands of f
    for i in range(d):
        size = abs(lead[i]) * (sizes[i] + abs(f[i])) + abs(known[i]) + abs(scale[i] * w[i])
        if not abs(residual[i]) <= _RESIDUAL * size:
            return False
    return True


@inner
def solve_tangents(
    rhs, jac, has_jac, params, t, d, sources, room, point, work, counts, solver, linear
):  # fmt: skip
    """Solve ``scale w + known = lead J (base + gain w)`` for every tangent's w.

    J is the Jacobian where the orbit's own w, which is given, solves the step. Return False if the
    equations are singular; count the calls of `rhs`.
    """
    n, base, w, change = point.shape[0], room[BASE], room[W], room[MOVED][: point.shape[0]]
    look(base, room[GAIN], sources, w, point)
    counts.rhs += jacobian(rhs, jac, has_jac, t, point, params, room[UNITS], work[0])
    if not set_factors(1, n, d, sources, room, work, counts, solver, linear):
        return False
    for first in range(n, base.shape[0], n):
        multiply(work[0], base[first : first + n], change)
        for i in range(n):
            change[i] = room[LEAD, i] * change[i] - room[KNOWN, first + i] if i < d else 0.0
        solver(SUBSTITUTE, 1, work[2], change, linear)
        for i in range(d):
            w[first + i] = change[i]
    return True


@inlined
def guess(p, integral, ratio, lead, known, force, pieces, w):
    """Set w to a first guess: with f as it was, or the increment before."""
    for c in range(w.shape[0]):
        w[c] = lead[c] * force[c] - known[c] if integral == 1 else ratio * pieces[c, p]


# Share of a step after its begin at which the explicit part is taken: beyond rounding of times, so
# that a jump at a break is behind it.
_ASIDE = 1e-9


@inner
def solve_linearly(
    rhs, jac, params, t, i, rows, x, sources, force, room, work, counts, solver, linear
):
    """Solve ``scale w + known = lead (A (base + gain w) + g)`` for w.

    ``g = f + theta ratio (f - f_before)`` extrapolates f = rhs - A y from t_n and the step before
    to t, with theta and the lengths' ratio of row i. A is the Jacobian, which is constant. `force`
    (d,) is f of the step before, NaN where that is another function. Returns False where the matrix
    is singular.
    """
    # room (N_ROOM, d): rows of a step; work (2, ., .): A, and the matrix whose factors are kept
    n, moved, f, point = x.shape[0], room[MOVED], room[F], room[POINT]
    known, lead, base = room[KNOWN], room[LEAD], room[BASE]
    if counts.kept == 0 or differs(i, rows):
        jac(t, x, work[0], params)
        counts.kept = int(set_factors(0, n, n, sources, room, work, counts, solver, linear))
        if counts.kept == 0:
            return False
    rhs(t - (rows.theta[i] - _ASIDE) * rows.unit[i], x, f, params)
    counts.rhs += 1
    multiply(work[0], x, moved)
    ahead = rows.theta[i] * rows.ratio[i] if counts.step > 0 and force[0] == force[0] else 0.0
    for c in range(n):
        point[c] = base[c] - x[c]
        moved[c] = f[c] - moved[c]
        f[c] += ahead * (moved[c] - force[c]) if ahead > 0.0 else 0.0
        force[c] = moved[c]
    multiply(work[0], point, moved)
    for c in range(n):
        moved[c] = lead[c] * (f[c] + moved[c]) - known[c]
    solver(SUBSTITUTE, 0, work[1], moved, linear)
    for c in range(n):
        room[W, c] = moved[c]
    return True


@inner
def differs(i, rows):
    """Return whether row i has other coefficients than the row before."""
    if i == 0 or rows.theta[i] != rows.theta[i - 1]:
        return True
    for a in range(rows.lead.shape[0]):
        if rows.lead[a, i] != rows.lead[a, i - 1] or rows.scale[a, i] != rows.scale[a, i - 1]:
            return True
    return False
