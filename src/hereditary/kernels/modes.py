"""Exponential modes: the compiled half of the sum-of-exponentials history (floor 1).

A mode of rate s holds ``Z = sum_k q**(k_newest - k) u_k`` with q = exp(-s h); the memory of a
block's worth of steps ahead is one product of mode amplitudes with a table of powers of q.
"""

import numpy as np

from .._jit import kernel


@kernel
def exchange_modes(lag, pieces, n, classes, tables, memory):
    """Take the finished block's pieces in and add the lag of all of them to the next block."""
    # lag (W, B), pieces (W, B + 1); memory: modes, start modes (W, M)
    # tables: weights, start weights (C, M), ahead (M, B), back (B + 1, M) with last row q**B
    weights, start_weights, ahead, back = tables
    modes, start = memory
    n_block = lag.shape[1]
    amplitudes = np.empty(modes.shape[1])
    for c in range(lag.shape[0]):
        w, s = weights[classes[c]], start_weights[classes[c]]
        if n > 0:
            for i in range(amplitudes.shape[0]):
                modes[c, i] *= back[n_block, i]
                start[c, i] *= back[n_block, i]
            add_rows(modes[c], pieces[c, :n_block], back[:n_block])
        for i in range(amplitudes.shape[0]):
            amplitudes[i] = w[i] * modes[c, i] + s[i] * start[c, i]
        add_rows(lag[c], amplitudes, ahead)


@kernel
def add_rows(out, factors, rows):
    """out += factors @ rows, four rows at a time.

    The inner loop runs along `out`, so it is vectorised without reordering any sum.
    """
    # out (n,), factors (m,), rows (m, n)
    fours = factors.shape[0] // 4 * 4
    for k in range(0, fours, 4):
        f0, f1, f2, f3 = factors[k], factors[k + 1], factors[k + 2], factors[k + 3]
        r0, r1, r2, r3 = rows[k], rows[k + 1], rows[k + 2], rows[k + 3]
        for j in range(out.shape[0]):
            out[j] += (f0 * r0[j] + f1 * r1[j]) + (f2 * r2[j] + f3 * r3[j])
    for k in range(fours, factors.shape[0]):
        for j in range(out.shape[0]):
            out[j] += factors[k] * rows[k, j]
