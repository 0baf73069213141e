"""Exponential modes: the compiled half of the sum-of-exponentials history.

A mode of rate s holds ``Z = sum_k q**(k_newest - k) u_k`` with q = exp(-s h); the memory of a
block's worth of steps ahead is one product of mode amplitudes with a table of powers of q. Where a
scheme's first weights are no sum of exponentials, a window of the newest pieces adds what lacks.
"""

import numpy as np

from .jit import compiled, inner


@compiled
def exchange_modes(lag, pieces, n, groups, tables, memory):
    """Take the finished block's pieces in and add the lag of all of them to the next block."""
    # lag (W, B), pieces (W, B + 1); memory: modes (W, M), modes of each start value (W, V M),
    #   window (W, L)
    # tables: weights (C, M), start weights (V C, M), ahead (M, B), back (B + 1, M) with last row
    #   q**B, corrections (C, L + 2) of the weights k = 2 .. L + 1
    weights, start_weights, ahead, back, corrections, _, _, _ = tables
    modes, start, window = memory
    n_block, n_modes, n_groups = lag.shape[1], modes.shape[1], weights.shape[0]
    amplitudes, n_starts = np.empty(n_modes), start_weights.shape[0] // n_groups
    if not np.any(start_weights):
        n_starts = 0
    for c in range(lag.shape[0]):
        w = weights[groups[c]]
        if n > 0:
            for i in range(n_modes):
                modes[c, i] *= back[n_block, i]
            add_rows(modes[c], pieces[c, :n_block], back[:n_block])
        for i in range(n_modes):
            amplitudes[i] = w[i] * modes[c, i]
        for v in range(n_starts):
            s = start_weights[v * n_groups + groups[c]]
            mine = start[c, v * n_modes : (v + 1) * n_modes]
            for i in range(n_modes):
                if n > 0:
                    mine[i] *= back[n_block, i]
                amplitudes[i] += s[i] * mine[i]
        add_rows(lag[c], amplitudes, ahead)
        if window.shape[1] > 0:
            slide(window[c], pieces[c, :n_block])
            correct(lag[c], window[c], corrections[groups[c]])


@inner
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


@inner
def slide(window, pieces):
    """Move the newest pieces into the window's end."""
    length, more = window.shape[0], pieces.shape[0]
    for k in range(length - more):
        window[k] = window[k + more]
    for k in range(max(0, length - more), length):
        window[k] = pieces[k - length + more]


@inner
def correct(lag, window, corrections):
    """Add what the weights of the window's pieces differ by from their exponential sums."""
    # window[L - 1] is u_(n-2): k = 2 for the first step of the block
    length = window.shape[0]
    for k in range(length):
        age = length + 1 - k
        for i in range(min(lag.shape[0], length + 2 - age)):
            lag[i] += corrections[age + i] * window[k]
