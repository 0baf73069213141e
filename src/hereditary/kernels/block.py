"""Common parts of all block marches (floor 1): open a block, start the memory, write rows."""

from .._jit import inlined, kernel

# how a march ended
RUNNING, BLOWN_UP, NOT_SOLVED = 0, 1, 2


@kernel
def open_block(lag, pieces, n, groups, weights, exchange, tables, memory):
    """Lag of everything older for the block from step n on; the newest piece moves to its front."""
    newest = pieces.shape[1] - 1
    for c in range(lag.shape[0]):
        w = weights[groups[c]]
        lag[c, 0] = 0.0  # the nearest weight is the scheme's own
        for i in range(1, lag.shape[1]):
            lag[c, i] = w[i + 1] * pieces[c, newest]
    exchange(lag, pieces, n, groups, tables, memory)
    for c in range(lag.shape[0]):
        pieces[c, 0] = pieces[c, newest]


@kernel
def begin_memory(lag, memory, value, c, weights, first):
    """Store a column's start value, and add it to the first block from step `first` on."""
    # weights: the column's start weights (B + 2,)
    begin_one(lag, memory, value, c, weights, first, 0, 1)


@kernel
def begin_one(lag, memory, value, c, weights, first, v, n_values):
    """Do the same for number v of several start values of a column."""
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
