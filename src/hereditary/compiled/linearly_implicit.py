"""Implicit-explicit steps: a constant matrix implicitly, the rest of the right-hand side not."""

from .jacobian import multiply, newton_matrix
from .jit import inner
from .signatures import FACTORISE, SUBSTITUTE
from .step import BASE, GAIN, KNOWN, LEAD, MOVED, POINT, SCALE, F, W

# Share of a step after its begin at which the explicit part is taken: beyond rounding of times, so
# that a jump at a break is behind it.
_ASIDE = 1e-9


@inner
def solve_linearly(
    rhs, jac, params, t, i, rows, x, sources, force, room, work, counts, solver, linear
):
    """Solve ``scale w + known = lead (A (base + gain w) + g)`` for w.

    ``g = f + theta ratio (f - f_before)`` extrapolates f = rhs - A y from t_n and the step before
    to t, with theta and the lengths' ratio of row i; A is the Jacobian, which is constant. `force`
    (d,) is f of the step before, NaN where that is another function. Returns False where the
    matrix is singular.
    """
    # room (N_ROOM, d): rows of a step; work (2, ., .): A, and the matrix whose factors are kept
    n, moved, f, point = x.shape[0], room[MOVED], room[F], room[POINT]
    known, scale, lead, base, gain = room[KNOWN], room[SCALE], room[LEAD], room[BASE], room[GAIN]
    if counts.kept == 0 or differs(i, rows):
        jac(t, x, work[0], params)
        newton_matrix(work[0], n, n, sources, gain, scale, lead, work[1])
        counts.kept, counts.factorised = 0, counts.factorised + 1
        if solver(FACTORISE, 0, work[1], moved, linear) != 0:
            return False
        counts.kept = 1
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
    """Whether row i has other coefficients than the row before."""
    if i == 0 or rows.theta[i] != rows.theta[i - 1]:
        return True
    for a in range(rows.lead.shape[0]):
        if rows.lead[a, i] != rows.lead[a, i - 1] or rows.scale[a, i] != rows.scale[a, i - 1]:
            return True
    return False
