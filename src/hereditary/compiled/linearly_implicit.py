"""Implicit-explicit steps: a constant matrix implicitly, the rest of the right-hand side not."""

from .jacobian import multiply
from .jit import inner
from .newton import set_factors
from .signatures import SUBSTITUTE
from .step import BASE, KNOWN, LEAD, MOVED, POINT, F, W

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
    """Whether row i has other coefficients than the row before."""
    if i == 0 or rows.theta[i] != rows.theta[i - 1]:
        return True
    for a in range(rows.lead.shape[0]):
        if rows.lead[a, i] != rows.lead[a, i - 1] or rows.scale[a, i] != rows.scale[a, i - 1]:
            return True
    return False
