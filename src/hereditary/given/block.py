"""Parts of the march: open a block, add known terms, start the memory, write rows."""

from ..compiled.jacobian import jacobian
from ..compiled.jit import I8, IVEC, MAT, VEC, entry, inlined, inner
from .signatures import EXCHANGE, HISTORY_TABLES, MEMORY
from .step import UNITS

# Ratio of neighbouring steps from which no parabola tells the slope.
_STEEP = 8.0
# Statuses of a march.
RUNNING = 0  # no trouble so far
BLOWN_UP = 1  # the solution is not bounded
NOT_SOLVED = 2  # the equations of a step could not be solved


@inner
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


@inner
def keep_jacobian(rhs, jac, has_jac, params, t, orbit, k, output, counts):
    """Keep the Jacobian of a step as number k."""
    units = output.room[UNITS]
    counts.rhs += jacobian(rhs, jac, has_jac, t, orbit, params, units, output.jacobians[k])


@inner
def begin_start(v, values, first, n_starts, groups, weights, lag, start):
    """Store start value v of each column, and add it to the first block from step `first` on."""
    # values (W,), weights (V C, B + 2), or (V C, 0) where the history takes them by itself
    # lag (W, B), start (W, V length): memory of start values
    length, n_groups = start.shape[1] // n_starts, weights.shape[0] // n_starts
    for c in range(lag.shape[0] if weights.shape[1] > 0 else 0):
        for i in range(v * length, (v + 1) * length):
            start[c, i] = values[c]
        for i in range(first, lag.shape[1]):
            lag[c, i] += weights[v * n_groups + groups[c], i] * values[c]


@inner
def begin_others(starts, values, first, n_starts, groups, weights, lag, start):
    """Store all start values but the first one, of each column, with `values` (W,) as room."""
    for v in range(1, n_starts):
        for c in range(values.shape[0]):
            values[c] = starts[c, v]
        begin_start(v, values, first, n_starts, groups, weights, lag, start)


@inlined
def write_row(k, rows, slopes, x, u, d, h, ratio):
    """Write row k, with the slope at its end of the parabola through the last three values.

    Where steps grow or shrink by more than _STEEP at once, that of a line.
    """
    lean = 0.5 if ratio <= _STEEP and _STEEP * ratio >= 1.0 else 0.0
    for c in range(rows.shape[1]):
        rows[k, c], slopes[k, c] = x[c], (u[c] + lean * d[c]) / h


@inlined
def bounded(x):
    """Return whether all of x is finite and far from overflow."""
    for c in range(x.shape[0]):  # noqa: SIM110 (numba takes no generator here)
        if not abs(x[c]) < 1e300:
            return False
    return True


@entry(MAT, MAT, I8, IVEC, MAT, EXCHANGE, HISTORY_TABLES, MEMORY)
def open_lag(lag, pieces, n, groups, weights, exchange, tables, memory):
    """Set the lag (W, B) of the block from step n on, and move the newest piece to its front."""
    open_block(lag, pieces, n, groups, weights, exchange, tables, memory)


@entry(I8, VEC, VEC, MAT, MAT)
def close_piece(p, weights, piece, lag, pieces):
    """Keep the piece (W,) of step p in its block, and spread it over the steps ahead."""
    for c in range(piece.shape[0]):
        pieces[c, p + 1] = piece[c]
        for k in range(2, lag.shape[1] - p):
            lag[c, p + k] += weights[k] * piece[c]
