"""Solution of one implicit step by Newton's method.

The linear solver is a function that the march gets from Python.
"""

import math

import numpy as np

from ..compiled.functions import set_force
from ..compiled.jacobian import (
    COLUMNS,
    ROWS,
    VALUES,
    add_derivative_by,
    is_sparse,
    magnitudes,
    multiply,
)
from ..compiled.jit import inner, plug_in
from ..compiled.linalg import clear, largest_of, solve_in_place
from ..compiled.newton import ACCEPT, CHECK, FAIL, ITERATE, REFRESH, RESTART
from ..compiled.reach import set_reach
from ..compiled.signatures import FACTORISE, SUBSTITUTE
from .step import set_argument

# Newton iterations after which a step counts as not solved.
_STEP_NEWTON_MAXITER = 38
# Ratio of sizes of components up to which rows of Newton's matrix are left as they are.
_ALIKE_SIZES = 1e3
# Factor of what others make of a component in its unit. Without it, entries off the diagonal could
# be as large as those on it.
_MARGIN = 16.0
# Largest binary exponent of a factor of rows.
_MAX_EXPONENT = 900
# Most halvings of a Newton correction, or of the first guess of w, that leaves the domain of f.
_MAX_HALVINGS_OF_CORRECTION = 8
# Ratio of successive Newton corrections above which the Jacobian is computed again.
_MAX_CORRECTION_RATIO = 0.1
# The same ratio for a Jacobian of an earlier step, in systems of few components (at most FEW,
# compiled/jacobian.py). There a new Jacobian is cheap.
_MAX_CORRECTION_RATIO_OF_EARLIER = 1e-3
# Number of steps that each get a new Jacobian, after the Jacobian of an earlier step converged
# slowly in a system of few components.
_STEPS_WITH_NEW_JACOBIAN = 16
# Factor of the allowed error if the Jacobian is that of an earlier step, in systems of few
# components. With a new Jacobian the error of Newton's method is far below its estimate. With an
# earlier one the error equals the estimate and has the same sign in every step. Equations of order
# above 1 sum this error twice, and in stiff equations it acts like a change of f.
_TOL_FACTOR_OF_EARLIER = 1e-6
# Largest ratio of successive Newton corrections at which the kept factors count as exact for a
# linear equation. Then one iteration solves a step.
_MAX_RATIO_OF_EXACT_FACTORS = 1e-8
# Ratio of a Newton correction to its residual above which the matrix counts as nearly singular.
_MAX_GROWTH_OF_CORRECTION = 1e6
# Allowed error of the increment w of a component, relative to w. A step is solved if the estimated
# error is below this part plus the parts by _ROUNDING_RTOL and _UNDERFLOW_ATOL.
_INCREMENT_RTOL = 1e-13
# Allowed error of the increment by rounding of the solution, relative to the solution.
_ROUNDING_RTOL = 2e-16
# Allowed absolute error of the increment, which covers underflow.
_UNDERFLOW_ATOL = 1e-280
# Size up to which a component may be rounding of others that has added up, in errors by rounding of
# one step.
_OF_NOISE = 1e3
# A residual below this fraction of its summands is a rounding error.
_ROUNDING_OF_RESIDUAL = 4e-15
# Residuals are compared with rounding errors only if a Newton correction is below this fraction of
# the solution.
_MAX_CORRECTION_IN_ROUNDING = 1e-3
# Residuals are compared with rounding errors only if the ratio of successive Newton corrections
# exceeds this value.
_MIN_RATIO_IN_ROUNDING = 0.5


@inner
def solve_step(march, t):
    """Solve ``scale w + known = lead f(t, base + gain w)`` for w; return whether this succeeded."""
    # Then solve for the increments of the tangents. The first n_solved components have an equation;
    # the others are memory that f reads, and use the w of their source. Jacobian and factors of an
    # earlier step are used while the iteration converges fast (counts.kept).
    # state.newton (2, ., .), or (3, ., .) with tangents: the Jacobian, Newton's matrix, and the
    # matrix of the tangents' equations
    m = march.work
    right, workspace, counts, work = m.right, m.workspace, m.state.counts, m.state.newton
    row_factors = m.state.row_factors
    n, d, few = m.table.n_orbit, m.table.n_solved, m.linear.few == 1
    base, scale, lead, known = workspace.base, workspace.scale, workspace.lead, workspace.known
    w, first, shift, change = workspace.w, workspace.first, workspace.shift, workspace.moved[:n]
    per_unit = workspace.per_unit
    point, f = workspace.point[:n], workspace.f[:n]
    previous, residual, grown = np.inf, 0.0, 0.0
    fresh, stalled, done = False, False, False
    for c in range(d):
        first[c] = change[c] = w[c]
        size = abs(w[c]) + abs(shift[c]) + abs(base[c])
        size = size if size > _UNDERFLOW_ATOL else workspace.units[c]
        per_unit[c] = 1.0 if d == 1 else 1.0 / size
        workspace.noise[c] = 0.0
    if counts.renewed > 0:
        counts.renewed, counts.kept = counts.renewed - 1, 0
    for iteration in range(_STEP_NEWTON_MAXITER):
        set_argument(m, n)
        set_force(right.force, t, point, f)
        counts.rhs += 1
        if not is_finite(f, d) and not step_back(m, t):
            break
        if counts.kept == 0:
            counts.rhs += right.jacobian(right.force, t, point, workspace.units, work[0])
            set_row_factors(m, 0)
            if not few and not set_factors(m, 0):
                return False
            counts.kept, counts.at_once, fresh, previous = 1, 0, True, np.inf
        for c in range(n):
            change[c] = lead[c] * f[c] - known[c] - scale[c] * w[c] if c < d else 0.0
        if stalled and grown < _MAX_GROWTH_OF_CORRECTION:
            done = within_rounding(m, change)
        for c in range(d if previous == np.inf and not few else 0):
            residual = max(residual, abs(change[c]) * (per_unit[c] / abs(scale[c])))
        for c in range(d):
            change[c] *= row_factors[0, c]
        if not few:
            m.solver(SUBSTITUTE, 0, work[1], change, m.linear)
        else:
            set_matrix(m, row_factors[0], work[1])
            if not solve_in_place(work[1], change):
                change[0] = np.inf
            counts.factorised += 1
        for c in range(d):
            w[c] += change[c]
        size, allowed = size_of(m, change)
        slow = _MAX_CORRECTION_RATIO_OF_EARLIER if few and not fresh else _MAX_CORRECTION_RATIO
        if d > 1 and previous < np.inf and size > slow * previous and find_noise(m):
            size, allowed = size_of(m, change)
        grown = max(grown, size / residual) if residual > 0.0 else grown
        residual = 0.0
        allowed *= _TOL_FACTOR_OF_EARLIER if few and not fresh else 1.0
        unchecked = not stalled and shrank(m, change)
        answer = verdict(size, previous, allowed, slow, fresh, unchecked)
        if done or (counts.at_once == 1 and size < np.inf):
            answer = ACCEPT
        if answer == ACCEPT:
            exact = m.linear.exact == 1 and previous < np.inf and grown < _MAX_GROWTH_OF_CORRECTION
            if exact and size / previous <= _MAX_RATIO_OF_EXACT_FACTORS:
                counts.at_once = 1
            if few and not fresh and iteration > 1:
                counts.kept = 0  # a Jacobian that needs a third iteration has become too old
            return w.shape[0] == n or march.solve_tangents(m, t)
        if answer == FAIL:
            break
        for c in range(d if answer == RESTART else 0):
            w[c] = change[c] = first[c]
        if answer in (REFRESH, RESTART):
            counts.kept = 0
            if few and not fresh:
                counts.renewed = _STEPS_WITH_NEW_JACOBIAN
        stalled, previous = stalled or answer == CHECK, size
    counts.kept = 0
    return False


@inner
def size_of(m, change):
    """Return the largest correction of w (d,), in units of components, and the allowed error."""
    # Allowed is the size times the least ratio of a component's allowed error to its correction.
    # Components that are rounding of others do not count.
    workspace, d, size, ratio = m.workspace, m.table.n_solved, 0.0, np.inf
    w, shift, base, per_unit = workspace.w, workspace.shift, workspace.base, workspace.per_unit
    for c in range(d):
        moved = abs(change[c])
        if workspace.noise[c] == 0.0:
            error = _INCREMENT_RTOL * (abs(w[c]) + abs(shift[c])) + _ROUNDING_RTOL * abs(base[c])
            error += _UNDERFLOW_ATOL
            if d == 1:
                return moved, error
            size = moved * per_unit[c] if not moved * per_unit[c] <= size else size
            ratio = min(ratio, error / moved) if moved > 0.0 else ratio
    return size, size * ratio if size > 0.0 else 0.0


@inner
def shrank(m, change):
    """Return whether a correction of w, (d,), is small in all components but rounding of others."""
    workspace, small = m.workspace, True
    for c in range(m.table.n_solved):
        reference = abs(workspace.w[c]) + abs(workspace.shift[c]) + abs(workspace.base[c])
        counts = workspace.noise[c] == 0.0
        small = small and not (counts and abs(change[c]) > _MAX_CORRECTION_IN_ROUNDING * reference)
    return small


@inner
def find_noise(m):
    """Set `workspace.noise` (W,) to |y| where it is rounding of others, else 0; return if any."""
    # Rounding of one step adds up to _OF_NOISE times its size. A component that is moved by
    # rounding alone is rounding as well.
    workspace, n, d, more, found = m.workspace, m.table.n_orbit, m.table.n_solved, True, False
    lead, f, gain, scale = workspace.lead, workspace.f, workspace.gain, workspace.scale
    point, noise, sizes, moved = workspace.point, workspace.noise, workspace.sizes, workspace.passed
    magnitudes(m.state.newton[0], point[:n], sizes)  # sizes of the summands of f
    while more:
        more = False
        magnitudes(m.state.newton[0], noise[:n], moved)
        for c in range(d):
            rounding = _ROUNDING_OF_RESIDUAL * (sizes[c] + abs(f[c])) + moved[c]
            rounding *= _OF_NOISE * abs(gain[c] * lead[c] / scale[c])
            if noise[c] == 0.0 and 0.0 < abs(point[c]) <= rounding:
                noise[c], more, found = abs(point[c]), True, True
    return found


@inner
def verdict(size, previous, allowed, slow, fresh, unchecked):
    """Return what follows a Newton correction, as a verdict of compiled/newton.py."""
    # The rate is the ratio of two corrections; the error is rate / (1 - rate) times the last one:
    # [HairerWanner1996], section IV.8. size, previous (infinite for the first one with a new
    # Jacobian) and allowed are in units of components. slow: rate above which the Jacobian is
    # computed again; fresh: it is one of this step; unchecked: no residual was compared with
    # rounding yet.
    rate = size / previous if previous < np.inf else 1.0
    if not size < np.inf:
        return FAIL if fresh else RESTART
    if (size * rate / (1.0 - rate) if rate < 1.0 else size) <= allowed:
        return ACCEPT
    if unchecked and previous < np.inf and rate > _MIN_RATIO_IN_ROUNDING:
        return CHECK  # rounding may be the reason
    if rate >= 1.0 and previous < np.inf:
        return REFRESH if fresh else RESTART
    return REFRESH if slow < rate < 1.0 else ITERATE


@inner
def is_finite(f, d):
    """Return whether the first d values are finite."""
    finite = True
    for c in range(d):
        finite = finite and abs(f[c]) < np.inf
    return finite


@inner
def step_back(m, t):
    """Halve the last Newton correction of w until f is finite; return whether f became finite."""
    # If it never does, the correction of functional iteration replaces Newton's, and is halved too.
    # Newton's method may leave the domain of f near an edge where its slope is infinite.
    force, workspace, n, d = m.right.force, m.workspace, m.table.n_orbit, m.table.n_solved
    w, change = workspace.w, workspace.moved
    lead, known, scale = workspace.lead, workspace.known, workspace.scale
    point, f = workspace.point[:n], workspace.f[:n]
    for trial in range(2 * _MAX_HALVINGS_OF_CORRECTION + 1):
        for c in range(d):
            change[c] *= 0.5 if trial != _MAX_HALVINGS_OF_CORRECTION else 1.0
            w[c] -= change[c]
        set_argument(m, n)
        set_force(force, t, point, f)
        m.state.counts.rhs += 1
        if is_finite(f, d) == (trial != _MAX_HALVINGS_OF_CORRECTION):
            return trial != _MAX_HALVINGS_OF_CORRECTION
        for c in range(d if trial == _MAX_HALVINGS_OF_CORRECTION else 0):
            change[c] = 2.0 * ((lead[c] * f[c] - known[c]) / scale[c] - w[c])
            w[c] += change[c]
    return False


@inner
def set_row_factors(m, number):
    """Set the factors of the rows of Newton's matrix (number 0) or the tangents' (1)."""
    # Pivots by the largest entry of a column would mix rounding of large components into small
    # ones, so rows are in units: the size, or what the others make of the component if that is
    # more. Without that part driven components would come before those that drive them. A component
    # without a size has the smallest unit. The factors are powers of 2.
    workspace, factors, n = m.workspace, m.state.row_factors[number], m.table.n_orbit
    w, shift, base, d = workspace.w, workspace.shift, workspace.base, m.table.n_solved
    sizes, units, least, largest = workspace.sizes[:n], workspace.passed[:n], np.inf, 0.0
    for c in range(n):
        sizes[c], factors[c] = 0.0, 1.0
        if c < d:
            size = abs(w[c]) + abs(shift[c]) + abs(base[c])
            sizes[c] = size if size < np.inf else 0.0
            least, largest = min(least, sizes[c]), max(largest, sizes[c])
    if largest <= _ALIKE_SIZES * least:
        return
    matrix, least = m.state.newton[1 + number], np.inf
    set_matrix(m, factors, matrix)
    for k in range(matrix.shape[1] if is_sparse(matrix, n) else n):
        if not is_sparse(matrix, n):
            matrix[k, k] /= _MARGIN
        elif matrix[ROWS, k] == matrix[COLUMNS, k]:
            matrix[VALUES, k] /= _MARGIN
    clear(workspace.moved[:n])
    set_reach(matrix, workspace.moved[:n], sizes, units)
    for c in range(d):
        least = min(least, units[c]) if units[c] > 0.0 else least
    for c in range(d):
        units[c] = units[c] if units[c] > 0.0 else least
    magnitudes(matrix, units, sizes)
    exponent = math.frexp(largest_of(sizes, 0, d))[1]
    for c in range(d):
        factors[c] = math.ldexp(1.0, min(exponent - math.frexp(sizes[c])[1], _MAX_EXPONENT))


@inner
def set_matrix(m, row_factors, out):
    """Set Newton's matrix, the derivative of ``scale w - lead f(t, base + gain w)`` by w."""
    # Rows are multiplied by row_factors (n,). The Jacobian of f is state.newton[0], dense or
    # sparse, as out is. Components without an equation get rows of the unit matrix.
    workspace, j_f, sources = m.workspace, m.state.newton[0], m.table.sources
    n, d = m.table.n_orbit, m.table.n_solved
    gain, scale, lead = workspace.gain, workspace.scale, workspace.lead
    if is_sparse(j_f, n):
        for k in range(j_f.shape[1]):
            i, j = int(j_f[ROWS, k]), int(j_f[COLUMNS, k])
            value = (scale[i] if i == j else 0.0) - gain[j] * lead[i] * j_f[VALUES, k]
            out[VALUES, k] = value * row_factors[i]
        return
    for i in range(n):
        row, factor = out[i], row_factors[i]  # a power of 2, whose products are exact
        clear(row)
        for k in range(n if i < d else 0):
            row[sources[k]] -= gain[k] * (lead[i] * factor) * j_f[i, k]
        row[i] += scale[i] * factor if i < d else 1.0


@inner
def set_factors(m, number):
    """Factorise Newton's matrix (number 0) or the tangents' (1); return False if it is singular."""
    matrix = m.state.newton[1 + number]
    set_matrix(m, m.state.row_factors[number], matrix)
    m.state.counts.factorised += 1
    return m.solver(FACTORISE, number, matrix, m.workspace.moved[: m.table.n_orbit], m.linear) == 0


@inner
def within_rounding(m, residual):
    """Return whether all residuals (n,) are as small as rounding errors of their summands."""
    workspace, n = m.workspace, m.table.n_orbit
    lead, f, sizes = workspace.lead, workspace.f, workspace.sizes
    known, scale, w, noise = workspace.known, workspace.scale, workspace.w, workspace.noise
    magnitudes(m.state.newton[0], workspace.point[:n], sizes)  # sizes of the summands of f
    for i in range(m.table.n_solved):
        size = abs(lead[i]) * (sizes[i] + abs(f[i])) + abs(known[i]) + abs(scale[i] * w[i])
        if noise[i] == 0.0 and not abs(residual[i]) <= _ROUNDING_OF_RESIDUAL * size:
            return False
    return True


@plug_in
def no_tangents_solved(m, t):
    """Do nothing: the march has no tangents, or its scheme solves no equations for them."""
    return True


@plug_in
def solve_tangents(m, t):
    """Solve ``scale w + known = lead (J (base + gain w) + df / dp)`` for the w of every tangent."""
    # J is that at the solution of the orbit's step; only derivatives by a parameter p have df / dp
    right, workspace = m.right, m.workspace
    n, d, work = m.table.n_orbit, m.table.n_solved, m.state.newton
    base, w = workspace.base, workspace.w
    lead, known, change = workspace.lead, workspace.known, workspace.moved[:n]
    set_argument(m, n)
    m.state.counts.rhs += right.jacobian(
        right.force, t, workspace.point[:n], workspace.units, work[0]
    )
    set_row_factors(m, 1)
    if not set_factors(m, 1):
        return False
    for first in range(n, base.shape[0], n):
        multiply(work[0], base[first : first + n], change)
        k = first // n - 1
        if k < right.by_params:
            calls = add_derivative_by(k, right.force, t, workspace.point[:n], change)
            m.state.counts.rhs += calls
        for i in range(n):
            change[i] = lead[i] * change[i] - known[first + i] if i < d else 0.0
            change[i] *= m.state.row_factors[1, i]
        m.solver(SUBSTITUTE, 1, work[2], change, m.linear)
        for i in range(d):
            w[first + i] = change[i]
    return True


@inner
def guess(m, p, ratio):
    """Set w to the first guess of Newton's method."""
    # With values of f as pieces it solves the step with the last f. Else it is the last increment,
    # of index p, times `ratio` of the step sizes.
    lead, known, w, last_f, pieces = (
        m.workspace.lead,
        m.workspace.known,
        m.workspace.w,
        m.state.last_f,
        m.state.pieces,
    )
    integral = m.table.integral
    for c in range(w.shape[0]):
        w[c] = lead[c] * last_f[c] - known[c] if integral == 1 else ratio * pieces[c, p]
