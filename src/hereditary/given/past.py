"""Functions of histories: sums over the past by modes of exponentials, or term by term.

W columns (components and tangents) form C groups with the same weights; each has V start values.
Blocks have B steps. On uniform steps all steps have one row of weights. On meshes, and if orders
vary, a block is one step. Then tables have a row for each of R steps, beginning with step `first`.
"""

import numpy as np

from ..compiled.jit import compiled, inner
from ..compiled.linalg import add_rows, multiply_modes

# Rows that each term has in Tables.amplitudes, if orders vary.
STARTS = 6
# Number of partial sums that Horner's rule computes in parallel for the modes of a power law.
LANES = 4


@compiled
def exchange_nothing(lag, pieces, n, groups, tables, memory):
    """Do nothing: all orders are integers, or the march sums the modes itself (`read_rows`)."""


@compiled
def exchange_modes(lag, pieces, n, groups, tables, memory):
    """Add the finished block's pieces to the modes, and the sum over modes to the next lag."""
    # The mode of rate s is Z = sum_k q**(k_newest - k) u_k with pieces u_k and q = exp(-s h). The
    # lag of a block is the product of weighted modes and a table of powers of q. First weights that
    # are no sums of exponentials are corrected by a window of the newest pieces.
    # lag (W, B), pieces (W, B + 1), M modes of which the first `length` have real rates
    # memory: modes (W, M), modes of start values (W, V M), pieces (W, L), the window
    # tables:
    #   weights (C, M), start_weights (V C, M), ahead (M, B)
    #   keep (B + 1, M), powers of q; the last row is q**B
    #   corrections (C, L + 2), of the weights with k = 2 .. L + 1
    weights, start_weights, ahead, back = (
        tables.weights, tables.start_weights, tables.ahead, tables.keep,
    )  # fmt: skip
    modes, start, window, corrections = (
        memory.modes, memory.starts, memory.pieces, tables.corrections,
    )  # fmt: skip
    n_block, n_modes, n_groups = lag.shape[1], modes.shape[1], weights.shape[0]
    amplitudes, product = np.empty(n_modes), np.empty(n_modes)
    n_starts, n_real = start_weights.shape[0] // n_groups, tables.length
    if not np.any(start_weights):
        n_starts = 0
    for c in range(lag.shape[0]):
        if n > 0:
            multiply_modes(modes[c], back[n_block], n_real, modes[c])
            add_rows(modes[c], pieces[c, :n_block], back[:n_block])
        multiply_modes(modes[c], weights[groups[c]], n_real, amplitudes)
        for v in range(n_starts):
            mine = start[c, v * n_modes : (v + 1) * n_modes]
            if n > 0:
                multiply_modes(mine, back[n_block], n_real, mine)
            multiply_modes(mine, start_weights[v * n_groups + groups[c]], n_real, product)
            for i in range(n_modes):
                amplitudes[i] += product[i]
        add_rows(lag[c], amplitudes, ahead)
        if window.shape[1] > 0:
            slide(window[c], pieces[c, :n_block])
            add_corrections(lag[c], window[c], corrections[groups[c]])


@compiled
def exchange_rows(lag, pieces, n, groups, tables, memory):
    """Add u_(n-2) to the modes, and the sum of weighted modes to the lag of step n."""
    # lag (W, 1), pieces (W, 2), M modes
    # tables: keep, take (R, M), weights (C R, M)
    # memory: modes (W, M)
    if n < 2:
        return
    i, modes = n - tables.first, memory.modes
    keep, take = tables.keep[i], tables.take[i]
    for c in range(lag.shape[0]):
        weights, total = tables.weights[groups[c] * tables.rows + i], 0.0
        for m in range(modes.shape[1]):
            modes[c, m] = keep[m] * modes[c, m] + take[m] * pieces[c, 0]
            total += weights[m] * modes[c, m]
        lag[c, 0] += total


@inner
def slide(window, pieces):
    """Shift the window of stored pieces, and append the newest pieces at its end."""
    length, more = window.shape[0], pieces.shape[0]
    for k in range(length - more):
        window[k] = window[k + more]
    for k in range(max(0, length - more), length):
        window[k] = pieces[k - length + more]


@inner
def add_corrections(lag, window, corrections):
    """Add to the lag (B,) the window's pieces times exact weights less exponential sums."""
    # the last entry of the window is u_(n-2), which has k = 2 in the first step of the block
    length = window.shape[0]
    for k in range(length):
        age = length + 1 - k
        for i in range(min(lag.shape[0], length + 2 - age)):
            lag[i] += corrections[age + i] * window[k]


@compiled
def exchange_direct(lag, pieces, n, groups, tables, memory):
    """Store the finished block's pieces u_m; add ``sum_m W_(n+i-m) u_m`` to the next lag, i < B."""
    add_direct(lag, pieces, n, groups, tables, memory)


@compiled
def exchange_pending(lag, pieces, n, groups, tables, memory):
    """Sum over the pieces of the present batch only; add the sum over older ones from `pending`."""
    # memory: pieces, start values, and pending (W, capacity), the sum over older pieces by step
    pending = memory.pending
    add_direct(lag, pieces, n, groups, tables, memory)
    for c in range(lag.shape[0]):
        for i in range(lag.shape[1]):
            lag[c, i] += pending[c, n + i]


@inner
def two_sum(total, lost, term):
    """Return ``total + term``, and `lost` plus the rounding error of this sum (Knuth)."""
    new = total + term
    part = new - total
    return new, lost + ((total - (new - part)) + (term - part))


@inner(allocates=True)
def add_direct(lag, pieces, n, groups, tables, memory):
    """Store the finished block's pieces, and add the sum over stored pieces to the next lag."""
    # If tables.length > 0, only over pieces of the present batch of so many steps. Sums are the
    # reference of other histories, so Knuth's two-sum compensates rounding. Kahan's rule would lose
    # digits where a term exceeds the sum, as in an oscillation. The inner loop runs over the steps
    # of the block and is vectorised.
    # lag (W, B), pieces (W, B + 1)
    # tables: weights (C R, > n + B), start_weights (V C, > n + B)
    # memory: pieces (W, capacity) with u_m at index m + 1, starts (W, V)
    weights, start_weights, stored, start = (
        tables.weights, tables.start_weights, memory.pieces, memory.starts,
    )  # fmt: skip
    n_block, row = lag.shape[1], min(n - tables.first, tables.rows - 1)
    n_groups, batch = weights.shape[0] // tables.rows, tables.length
    lost, first = np.empty(n_block), n // batch * batch if batch > 0 else 0
    for c in range(lag.shape[0]):
        w, u, out = weights[groups[c] * tables.rows + row], stored[c], lag[c]
        if n > 0:
            for k in range(n_block):  # without u_(n-1), whose first weight the march itself applies
                u[n - n_block + k] = pieces[c, k]
        lost[:] = 0.0
        total, rest = 0.0, 0.0
        for m in range(first, n if n_block == 1 else first):  # scalars stay in registers
            total, rest = two_sum(total, rest, w[n - m + 1] * u[m])
        out[0] += total + rest
        for m in range(first, n if n_block > 1 else first):
            piece = u[m]
            ahead = w[n - m + 1 : n - m + 1 + n_block]
            for i in range(n_block):
                out[i], lost[i] = two_sum(out[i], lost[i], ahead[i] * piece)
        for i in range(n_block):
            out[i] += lost[i]
        for v in range(start.shape[1]):
            if start[c, v] != 0.0:
                s = start_weights[v * n_groups + groups[c]]
                for i in range(n_block):
                    out[i] += s[n + i] * start[c, v]


@compiled
def set_amplitudes(scale, from_moments, decays, own):
    """Set amplitudes of a sum of exponentials that approximates ``t**-a`` in each of n steps."""
    # The rates are exp(x + h j), j = 1, 2, .., and each amplitude is exp(a h) times the one before.
    # Only that at j = 1 is set. Three rates replace all with j <= 0, with the same moments k = 0,
    # 1, 2 of the amplitudes, before / (1 - exp(-(a + k) h)), before being that at j = 0. scale
    # (n,): factor of amplitudes; from_moments (3, 3): amplitudes for a unit of each moment; decays
    # (2,): exp(-k h), k = 1, 2. Rows 0, 1, 3 of own (6, n) are exp(a x), exp(a h), exp(-a h) - 1;
    # then row 0 is the amplitude at j = 1, and rows 3 to 5 are those of the slow rates.
    for i in range(scale.shape[0]):
        before, fall = own[0, i] * scale[i], own[3, i]
        m0 = -before / fall
        m1, m2 = before / (1 - (1 + fall) * decays[0]), before / (1 - (1 + fall) * decays[1])
        for k in range(3):
            at = from_moments[k]
            own[3 + k, i] = at[0] * m0 + at[1] * m1 + at[2] * m2
        own[0, i] = before * own[1, i]


@inner(fuses=True)
def read_rows(lag, pieces, n, groups, tables, memory):
    """Add u_(n-2) to the modes, and set the lag of step n to the sum of weighted modes."""
    # Amplitudes of a power law on the rates exp(h j) are geometric, so the weighted sum of modes is
    # a polynomial in their ratio. Horner's rule combines the four quarters of the modes in
    # parallel, then every fourth of the partial sums. So few products wait for the one before, and
    # no weights are stored.
    # T terms in a group, G rates on the grid and three slow rates behind them, M = G + 3
    # pieces (W, 2)
    # memory: modes (W, M), or (W, 2 M) if terms with y'' have their own modes, from `length` on
    # tables:
    #   derivatives (C, T), keep and take (R or 1, .), room (1, G / 4)
    #   weights (2 R or 2, M): decay of modes up to step n for terms with y', then with y''
    #   amplitudes (6 C T, R): for each term the first amplitude, the ratio, the ratio to the power
    #     G / 4, and the amplitudes of the three slow rates
    keep, take, seen, modes = tables.keep, tables.take, tables.weights, memory.modes
    derivatives, starts, lanes = tables.derivatives, tables.amplitudes, tables.room[0]
    i, n_rows, n_terms = n - tables.first, keep.shape[0], derivatives.shape[1]
    j, quarter = min(i, n_rows - 1), lanes.shape[0]
    for c in range(lag.shape[0]):
        piece, total, all_modes, keep_i, take_i = pieces[c, 0], 0.0, modes[c], keep[j], take[j]
        for m in range(all_modes.shape[0]):
            all_modes[m] = keep_i[m] * all_modes[m] + take_i[m] * piece
        for k in range(n_terms):
            kind, term = int(derivatives[groups[c], k]), STARTS * (n_terms * groups[c] + k)
            if kind > 0:
                factors, own = (
                    seen[(kind - 1) * n_rows + j],
                    all_modes[(kind - 1) * tables.length :],
                )
                ratio, long = starts[term + 1, i], starts[term + 2, i]
                for m in range(quarter):
                    upper = factors[3 * quarter + m] * own[3 * quarter + m] * long
                    upper += factors[2 * quarter + m] * own[2 * quarter + m]
                    lower = factors[quarter + m] * own[quarter + m] + upper * long
                    lanes[m] = factors[m] * own[m] + lower * long
                square = ratio * ratio
                fourth, held = square * square, 0.0
                for m in range(quarter - LANES, -1, -LANES):
                    pair = lanes[m] + ratio * lanes[m + 1]
                    pair += square * (lanes[m + 2] + ratio * lanes[m + 3])
                    held = held * fourth + pair
                total += starts[term, i] * held
                for m in range(3):
                    at = LANES * quarter + m
                    total += starts[term + 3 + m, i] * factors[at] * own[at]
        lag[c, 0], pieces[c, 0] = total, pieces[c, 1]
