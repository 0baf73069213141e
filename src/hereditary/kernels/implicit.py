"""The block march of implicit schemes in derivative form (floor 1).

With x_(n+1) = x_n + shift + w_n, where shift = h x'(0) for orders above 1, every step solves
``w_n + near w_(n-1) + lag_n + lead forcing(t) = lead f(t, x_n + theta (shift + w_n))``,
t = t_n + theta h. The pieces of memory are the w_n.
"""

import numpy as np

from .._jit import entry, kernel
from .block import BLOWN_UP, NOT_SOLVED, RUNNING, begin_memory, open_block, write_rows
from .newton import solve_step
from .signatures import MARCH


@entry(*MARCH)
def march_implicit(
    rhs, jac, has_jac, params, exchange, tables, memory, scheme, state, output, n_end
):
    """March to step `n_end`; return how it ended (kernels/block.py)."""
    # scheme: [h, theta, corrected steps], classes, given (W,): whether the first increment is
    #   known, weights and start weights (C, B + 2), rows [lead, near, shift, weight of w_0 in the
    #   first step, w_0, corrections], forcing (2 r, W): amplitudes and powers
    # state: counters (5,) [step, rows written, unused, block opened, calls], x, u, change of u
    #   (W,), lag (W, B), pieces (W, B + 1), unused
    # output: positions (k,), rows of x, rows of x' (k, d), unused
    numbers, classes, given, weights, start_weights, columns, forcing = scheme
    h, theta = numbers[0], numbers[1]
    lead, near, shift = columns[0], columns[1], columns[2]
    counters, x, u, d, lag, pieces, _ = state
    positions, rows, slopes, _ = output
    n_block = lag.shape[1]
    known, w, ones = np.empty(x.shape[0]), np.empty(x.shape[0]), np.ones(x.shape[0])
    counters[1] = 0
    while counters[0] < n_end:
        n = counters[0]
        p = n % n_block
        if p == 0 and counters[3] != n:
            open_block(lag, pieces, n, classes, weights, exchange, tables, memory)
            counters[3] = n
        t = (n + theta) * h
        for c in range(x.shape[0]):
            w[c] = pieces[c, p]  # the increment before as first guess
            known[c] = near[c] * w[c] + lag[c, p] + lead[c] * forced(forcing, c, t)
            if n < numbers[2]:
                known[c] -= lead[c] * columns[5 + n, c]
        if n == 0 and given[0] == 1:
            w[:] = columns[4]
        elif not solve_step(
            rhs, jac, has_jac, params, t, x, theta, shift,
            columns[3] if n == 0 else ones, known, lead, w, counters,
        ):  # fmt: skip
            return NOT_SOLVED
        finite = True
        for c in range(x.shape[0]):
            new = shift[c] + w[c]
            d[c] = 0.0 if n == 0 else new - u[c]
            u[c] = new
            x[c] += new
            pieces[c, p + 1] = w[c]
            weight = weights[classes[c]]
            for i in range(2, n_block - p):
                lag[c, p + i] += weight[i] * w[c]
            if n == 0:
                begin_memory(lag, memory[1], w[c], c, start_weights[classes[c]], 1)
            finite = finite and abs(x[c]) < 1e300
        counters[0] = n + 1
        counters[1] = write_rows(n + 1, counters[1], positions, rows, slopes, x, u, d, h)
        if not finite:
            return BLOWN_UP
    return RUNNING


@kernel
def forced(forcing, c, t):
    """Sum of the known terms of a component at time t."""
    total = 0.0
    for i in range(0, forcing.shape[0], 2):
        if forcing[i, c] != 0.0:
            total += forcing[i, c] * t ** forcing[i + 1, c]
    return total
