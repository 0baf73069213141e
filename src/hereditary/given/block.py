"""Parts of a march outside a step: open a block, store start values, write the solution."""

from ..compiled.jit import I8, IVEC, MAT, VEC, entry, inner
from .signatures import MARCH_MEMORY

# Largest ratio of the sizes of two neighbouring steps at which the slope of the solution is that of
# a parabola. Beyond this ratio it is the slope of the line through the last two values.
_MAX_RATIO_OF_PARABOLIC_SLOPE = 8.0
# Statuses that a march returns.
RUNNING = 0  # the march can go on
BLOWN_UP = 1  # the solution is not bounded
NOT_SOLVED = 2  # the equations of a step could not be solved


@inner
def open_block(lag, pieces, n, groups, weights, memory):
    """Set the lag (W, B) of the block from step n on, and move the newest piece to its front."""
    # pieces (W, B + 1) of the finished block, weights (C, B + 2) inside a block
    newest = pieces.shape[1] - 1
    for c in range(lag.shape[0]):
        w = weights[groups[c]]
        lag[c, 0] = 0.0  # the step itself weighs its newest piece, by `near`
        for i in range(1, lag.shape[1]):
            lag[c, i] = w[i + 1] * pieces[c, newest]
    memory.exchange(lag, pieces, n, groups, memory.tables, memory.arrays)
    for c in range(lag.shape[0]):
        pieces[c, 0] = pieces[c, newest]


@inner
def begin_start(m, v, values, first):
    """Store start value v of each column; it changes lags of the first block from `first` on."""
    # values (W,), lag (W, B), start (W, V length): the history's memory of V start values
    # weights (V C, B + 2), or (V C, 0) if start values have no weights in a block
    groups, weights = m.table.groups, m.table.start_weights
    lag, start, n_starts = m.state.lag, m.memory.arrays.starts, max(1, m.state.starts.shape[1])
    length, n_groups = start.shape[1] // n_starts, weights.shape[0] // n_starts
    for c in range(lag.shape[0] if weights.shape[1] > 0 else 0):
        for i in range(v * length, (v + 1) * length):
            start[c, i] = values[c]
        for i in range(first, lag.shape[1]):
            lag[c, i] += weights[v * n_groups + groups[c], i] * values[c]


@inner
def begin_others(m):
    """Store all start values of each column except the first, and add them to the first block."""
    starts, values = m.state.starts, m.workspace.known
    for v in range(1, starts.shape[1]):
        for c in range(values.shape[0]):
            values[c] = starts[c, v]
        begin_start(m, v, values, 0)


@inner
def write_row(m, k, h, ratio):
    """Write the solution and its slope at the end of a step of size h to row k of the output."""
    # The slope is that of the parabola through the last three values. If sizes of steps differ by
    # more than _MAX_RATIO_OF_PARABOLIC_SLOPE, it is that of the last line.
    rows, slopes = m.output.rows, m.output.slopes
    x, u, d = m.state.x, m.state.increment, m.state.change
    lean = (
        0.5
        if ratio <= _MAX_RATIO_OF_PARABOLIC_SLOPE and _MAX_RATIO_OF_PARABOLIC_SLOPE * ratio >= 1.0
        else 0.0
    )
    for c in range(rows.shape[1]):
        rows[k, c], slopes[k, c] = x[c], (u[c] + lean * d[c]) / h


@entry(MAT, MAT, I8, IVEC, MAT, MARCH_MEMORY)
def open_lag(lag, pieces, n, groups, weights, memory):
    """Set the lag of a block as `open_block` does; this function is for calls from Python."""
    open_block(lag, pieces, n, groups, weights, memory)


@entry(I8, VEC, VEC, MAT, MAT)
def close_piece(p, weights, piece, lag, pieces):
    """Store the piece (W,) of step p of a block, and add it to later lags in the block."""
    # weights W_k inside a block (B + 2,), lag (W, B), pieces (W, B + 1)
    for c in range(piece.shape[0]):
        pieces[c, p + 1] = piece[c]
        for k in range(2, lag.shape[1] - p):
            lag[c, p + k] += weights[k] * piece[c]
