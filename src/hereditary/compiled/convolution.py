"""Direct sums: the compiled half of the reference history, and the empty history."""

import numpy as np

from .jit import allocating, compiled


@compiled
def exchange_direct(lag, pieces, n, groups, tables, memory):
    """Store the finished block's pieces, and add ``sum_m W_(n+i-m) u_m`` to the next block."""
    add_direct(lag, pieces, n, 0, groups, tables, memory)


@compiled
def exchange_pending(lag, pieces, n, groups, tables, memory):
    """Sum directly over the present stretch alone, and add the rest from `pending`."""
    # memory: stored pieces, start values, pending (W, capacity)
    _, _, pending = memory
    _, _, stretch, _, _, _, _, _ = tables
    length = int(stretch[0, 0])
    add_direct(lag, pieces, n, n // length * length, groups, tables, memory)
    for c in range(lag.shape[0]):
        for i in range(lag.shape[1]):
            lag[c, i] += pending[c, n + i]


@allocating
def add_direct(lag, pieces, n, first, groups, tables, memory):
    """Store the finished block's pieces, and sum those stored from index `first` on.

    The sums are compensated by Knuth's two-sum: being the reference, they must not lose digits as
    they grow longer, nor where a term exceeds the sum so far (Kahan's rule would), as increments
    of an oscillation do. All of it runs along the block, so the loop is still vectorised.
    """
    # lag (W, B), pieces (W, B + 1); tables: weights (C, >= n + B), start weights (V C, >= n + B)
    # memory: stored (W, capacity) with u_m at m + 1, start values (W, V), unused
    weights, start_weights, _, _, _, _, _, _ = tables
    stored, start, _ = memory
    n_block = lag.shape[1]
    lost = np.empty(n_block)
    for c in range(lag.shape[0]):
        w, u, out = weights[groups[c]], stored[c], lag[c]
        if n > 0:
            for k in range(n_block):  # u_(n-1) stays outside: its nearest weight is the scheme's
                u[n - n_block + k] = pieces[c, k]
        lost[:] = 0.0
        for m in range(first, n):
            piece = u[m]
            ahead = w[n - m + 1 : n - m + 1 + n_block]
            for i in range(n_block):
                term = ahead[i] * piece
                total = out[i] + term
                part = total - out[i]
                lost[i] += (out[i] - (total - part)) + (term - part)
                out[i] = total
        for i in range(n_block):
            out[i] += lost[i]
        for v in range(start.shape[1]):
            if start[c, v] != 0.0:
                s = start_weights[v * weights.shape[0] + groups[c]]
                for i in range(n_block):
                    out[i] += s[n + i] * start[c, v]


@compiled
def exchange_nothing(lag, pieces, n, groups, tables, memory):
    """The history of an equation whose terms are all classical."""
