"""The past where orders vary: direct sums, and modes that are weighed anew at each step.

With ``x_(n+1) = x_n + shift + w_n``, shift = h x'(0) for orders above 1, every Caputo term of a
step is ``amplitude sum_k W_k(p) w_(n-k)`` with its own amplitude and p. Terms with y' weigh by
``W_k = (k+theta)**p - (k-1+theta)**p``, terms with y'' by ``W_k = b_k - b_(k-1)``, b_k = (k+1)**p -
k**p. No weight lasts longer than a step, so blocks are of one step: the nearest two weights are the
scheme's, the history sums those from k = 2 on.

Tables of both histories begin with the number of each step ahead (1, n), the inverse (C, n) of the
leading weights, amplitudes and p (C T, n) of the terms of each group, and the derivative in each
term (C, T), 0 where a group has fewer terms.
"""

import math
from functools import partial

from .jit import compiled, embedded, inner

# rows of a term in the weights of its modes
STARTS = 6
# modes of power laws are summed in so many parts side by side
LANES = 4


@compiled
def exchange_varying_direct(lag, pieces, n, groups, tables, memory):
    """Store u_(n-2) and add ``sum_(k>=2) W_k u_(n-k)`` with the weights of step n."""
    # lag (W, 1), pieces (W, 2); last tables: logs (4, > n) of k, 1 + 1/k and of k - 1 + theta,
    #   1 + 1/(k - 1 + theta), room (1, > n) for weights, unused
    # memory: stored (W, > n) with u_m at m + 1, unused twice
    numbers, _, amplitudes, powers, derivatives, logs, room, _ = tables
    stored, _, _ = memory
    if n < 2:
        return
    stored[:, n - 1] = pieces[:, 0]
    i = n - int(numbers[0, 0])
    weights = room[0]
    n_groups, n_terms = derivatives.shape
    for a in range(n_groups):
        for j in range(n_terms):
            if derivatives[a, j] == 0.0:
                continue
            amplitude, p = amplitudes[a * n_terms + j, i], powers[a * n_terms + j, i]
            second = derivatives[a, j] == 2.0
            first = 0 if second else 2
            for k in range(2, n + 1):
                weights[k] = math.exp(p * logs[first, k]) * math.expm1(p * logs[first + 1, k])
            for c in range(lag.shape[0]):
                if groups[c] != a:
                    continue
                total = weighed(weights, stored[c], n, second)
                if second:
                    # d_(n-1) = w_(n-1) - w_(n-2), the first of which the scheme weighs
                    total -= math.expm1(p * math.log(2.0)) * stored[c, n - 1]
                lag[c, 0] += amplitude * total


@inner
def weighed(weights, stored, n, differences):
    """``sum_(k=2)^n weights_k u_(n-k)``, or of the differences of u, by Knuth's two-sum."""
    total, lost = 0.0, 0.0
    for k in range(2, n + 1):
        piece = stored[n - k + 1]
        if differences:
            piece -= stored[n - k]  # u_(-1) = 0 stands first
        term = weights[k] * piece
        new = total + term
        part = new - total
        lost += (total - (new - part)) + (term - part)
        total = new
    return total + lost


@partial(embedded, fused=True)
def read_varying(lag, pieces, n, groups, tables, memory):
    """Take u_(n-2) into the modes and set the lag to what they give.

    On the grid of rates exp(h j) a kernel's amplitudes are a geometric sequence whatever its order,
    so their sum is a polynomial in its ratio: Horner's rule, first on the quarters of the modes,
    side by side, then on every fourth of what is left. No product waits long for another, and no
    weight is written down.
    """
    # pieces (W, 2); derivatives (C, T)
    # table (3, M): decay q, what a rate's amplitude is multiplied by for terms with y' and with y''
    # starts (6 C T, n): for each term the first amplitude, the ratio, its power M / 4, and the
    #   weights of the slow end
    # size (2, > M / 4): number of modes, a multiple of 16, and where the slow end stands behind the
    #   grid; room
    numbers, _, _, _, derivatives, table, starts, size = tables
    _, modes, _ = memory
    i = n - int(numbers[0, 0])
    n_powers, behind = int(size[0, 0]), int(size[0, 1])
    lanes, quarter = size[1], n_powers // LANES
    n_terms = derivatives.shape[1] if n_powers > 0 else 0
    for c in range(lag.shape[0]):
        piece, total = pieces[c, 0], 0.0
        for m in range(n_powers):
            modes[c, m] = table[0, m] * modes[c, m] + piece
        term = STARTS * n_terms * groups[c]
        for j in range(n_terms):
            kind = int(derivatives[groups[c], j])
            if kind > 0:
                ratio, long = starts[term + 1, i], starts[term + 2, i]
                for m in range(quarter):
                    upper = table[kind, 3 * quarter + m] * modes[c, 3 * quarter + m] * long
                    upper += table[kind, 2 * quarter + m] * modes[c, 2 * quarter + m]
                    lower = table[kind, quarter + m] * modes[c, quarter + m]
                    lower += upper * long
                    lanes[m] = table[kind, m] * modes[c, m] + lower * long
                square = ratio * ratio
                fourth, held = square * square, 0.0
                for m in range(quarter - LANES, -1, -LANES):
                    pair = lanes[m] + ratio * lanes[m + 1]
                    pair += square * (lanes[m + 2] + ratio * lanes[m + 3])
                    held = held * fourth + pair
                total += starts[term, i] * held
                for k in range(3):
                    total += starts[term + 3 + k, i] * modes[c, behind + k]
            term += STARTS
        lag[c, 0], pieces[c, 0] = total, pieces[c, 1]
