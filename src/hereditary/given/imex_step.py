"""Solution of one IMEX step: one linear system, because only a constant matrix is implicit."""

from ..compiled.functions import set_force
from ..compiled.jacobian import multiply
from ..compiled.jit import inner
from ..compiled.signatures import SUBSTITUTE
from .newton import set_factors, set_row_factors

# An IMEX step takes its explicit part at this fraction of the step after its start. The distance
# exceeds rounding errors of times, so a jump of f at the start of the step is already over.
_IMEX_OFFSET = 1e-9


@inner
def solve_linearly(m, t, i):
    """Solve ``scale w + known = lead (A (base + gain w) + g)`` for w; return False if singular."""
    # A is the constant Jacobian of the implicit part. The explicit part f = rhs - A y is
    # extrapolated from t_n and t_(n-1) to t, g = f + theta ratio (f - f_before). Row i of the
    # coefficients has theta and the ratio of step sizes; f_before is state.force (d,), if
    # counts.extrapolates is 1.
    # state.newton (2, ., .): A, and the matrix of the step, whose factors are kept
    right, workspace = m.right, m.workspace
    rows, counts, work = m.rows, m.state.counts, m.state.newton
    x, last_f, w = m.state.x, m.state.last_f, workspace.w
    moved, f, point = workspace.moved, workspace.f, workspace.point
    known, lead, base = workspace.known, workspace.lead, workspace.base
    if counts.kept == 0 or differs(i, rows):
        right.jacobian(right.force, t, x, workspace.units, work[0])
        set_row_factors(m, 0)
        counts.kept = int(set_factors(m, 0))
        if counts.kept == 0:
            return False
    set_force(right.force, t - (rows.theta[i] - _IMEX_OFFSET) * rows.unit[i], x, f)
    counts.rhs += 1
    multiply(work[0], x, moved)
    ahead = rows.theta[i] * rows.ratio[i] if counts.extrapolates == 1 else 0.0
    for c in range(x.shape[0]):
        point[c] = base[c] - x[c]
        moved[c] = f[c] - moved[c]
        f[c] += ahead * (moved[c] - last_f[c]) if ahead > 0.0 else 0.0
        last_f[c] = moved[c]
    counts.extrapolates = 1
    multiply(work[0], point, moved)
    for c in range(x.shape[0]):
        moved[c] = m.state.row_factors[0, c] * (lead[c] * (f[c] + moved[c]) - known[c])
    m.solver(SUBSTITUTE, 0, work[1], moved, m.linear)
    for c in range(x.shape[0]):
        w[c] = moved[c]
    return True


@inner
def differs(i, rows):
    """Return whether row i of the step coefficients needs another matrix than row i - 1."""
    if i == 0 or rows.theta[i] != rows.theta[i - 1]:
        return True
    for a in range(rows.lead.shape[0]):
        if rows.lead[a, i] != rows.lead[a, i - 1] or rows.scale[a, i] != rows.scale[a, i - 1]:
            return True
    return False
