"""Parts of the march: open a block, add known terms, start the memory, write rows."""

from .._jit import compiled, inlined
from .jacobian import jacobian
from .tangent import evaluate

# Fraction of the limit from which a Jacobian tells for sure; one is taken again at twice as much.
LOOK_FROM = 0.9
# how a march ended
RUNNING, BLOWN_UP, NOT_SOLVED = 0, 1, 2


@compiled
def open_block(lag, pieces, n, groups, weights, exchange, tables, memory):
    """Set the lag of the block from step n on, and move the newest piece to its front."""
    newest = pieces.shape[1] - 1
    for c in range(lag.shape[0]):
        w = weights[groups[c]]
        lag[c, 0] = 0.0  # the nearest weight is the scheme's own
        for i in range(1, lag.shape[1]):
            lag[c, i] = w[i + 1] * pieces[c, newest]
    exchange(lag, pieces, n, groups, tables, memory)
    for c in range(lag.shape[0]):
        pieces[c, 0] = pieces[c, newest]


@compiled
def samples(n, n_end, every):
    """Return what to subtract from n // every for the place of the regular Jacobian of step n.

    And for the place of the Jacobian of its stretch; these stand behind the regular ones.
    """
    if every == 0:
        return 0, 0
    first = (n + every - 1) // every
    return first, n // every - ((n_end - 1) // every + 1 - first)


@compiled
def keep_jacobian(rhs, jac, has_jac, params, t, orbit, k, output, counts):
    """Keep the Jacobian of a step at which one is taken for sure, as number k."""
    counts.rhs += jacobian(rhs, jac, has_jac, t, orbit, params, output.jacobians[k])
    counts.nearest = 0.5 * LOOK_FROM


@compiled
def begin_starts(rhs, jac, has_jac, params, memory, table, state, j_f, f):
    """Store the start values and add them to the first block.

    That is all (W, V) of them but the first, which is known after the first step alone; in integral
    form the right-hand side at 0.
    """
    weights, starts, groups, lag = table.start_weights, state.starts, table.groups, state.lag
    if weights.shape[1] == 0:  # the history takes them by itself
        return
    n_starts = max(1, starts.shape[1])
    n_groups = weights.shape[0] // n_starts
    if table.integral == 1:
        evaluate(rhs, jac, has_jac, params, 0.0, state.x, j_f, f, state.counts)
        for c in range(lag.shape[0]):
            state.force[c] = f[c]
            begin_one(lag, memory, f[c], c, weights[groups[c]], 0, 0, 1)
        return
    for c in range(lag.shape[0]):
        for v in range(1, n_starts):
            own = weights[v * n_groups + groups[c]]
            begin_one(lag, memory, starts[c, v], c, own, 0, v, n_starts)


@compiled
def begin_first(memory, table, state):
    """Store the first start value, an increment, after the first step."""
    if table.integral == 1 or table.start_weights.shape[1] == 0:
        return
    for c in range(state.x.shape[0]):
        value = state.starts[c, 0] if table.start_known == 1 else state.pieces[c, 1]
        own = table.start_weights[table.groups[c]]
        begin_one(state.lag, memory, value, c, own, 1, 0, state.starts.shape[1])


@compiled
def begin_one(lag, memory, value, c, weights, first, v, n_values):
    """Store number v of a column's start values, and add it to the first block from `first` on."""
    _, start, _ = memory
    length = start.shape[1] // n_values
    for i in range(v * length, (v + 1) * length):
        start[c, i] = value
    for i in range(first, lag.shape[1]):
        lag[c, i] += weights[i] * value


@inlined
def write_rows(n, first, output, x, y, d, h):
    """Write the rows asked for up to step n, from the parabola through the last three values.

    Positions count in steps and ascend; returns the number of rows written so far.
    """
    positions, rows, slopes = output.positions, output.rows, output.slopes
    k = first
    while k < positions.shape[0] and positions[k] <= n:
        back = positions[k] - n  # in (-1, 0]; zero on the mesh, where the row is x itself
        for c in range(rows.shape[1]):
            rows[k, c] = x[c] + back * (y[c] + 0.5 * (1.0 + back) * d[c])
            slopes[k, c] = (y[c] + (0.5 + back) * d[c]) / h
        k += 1
    return k


@inlined
def bounded(x):
    """Whether all of x is finite and far from overflow."""
    for c in range(x.shape[0]):  # noqa: SIM110 (numba takes no generator here)
        if not abs(x[c]) < 1e300:
            return False
    return True
