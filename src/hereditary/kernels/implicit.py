"""The block march of implicit schemes in derivative form (floor 1).

With x_(n+1) = x_n + shift + w_n, where shift = h x'(0) for orders above 1, every step solves
``w_n + near w_(n-1) + lag_n + lead forcing(t) = lead f(t, x_n + theta (shift + w_n))``,
t = t_n + theta h. The pieces of memory are the w_n.
"""

import numpy as np

from .._jit import entry, kernel
from .block import BLOWN_UP, NOT_SOLVED, RUNNING, begin_one, bounded, open_block, write_rows
from .newton import solve_step
from .signatures import MARCH
from .tangent import solve_tangents


@entry(*MARCH)
def march_implicit(
    rhs, jac, has_jac, params, exchange, tables, memory, scheme, state, output, n_end
):
    """March to step `n_end`; return how it ended (kernels/block.py)."""
    # scheme: [h, theta, corrected steps, r, start values V], layout, classes, given (W,): whether
    #   the first increment is known, weights (C, B + 2), start weights (V C, B + 2), rows [lead,
    #   near, weight of w_0 in the first step, r powers of the forcing] (3 + r, W)
    # state: counters (5,) [step, rows written, unused, block opened, calls], x, u, change of u
    #   (W,), lag (W, B), pieces (W, B + 1), unused, data [shift, r amplitudes of the forcing, w_0,
    #   corrections, start values from the second on] (W, k)
    # output: positions (k,), rows of x, rows of x' (k, d), unused
    numbers, layout, classes, given, weights, start_weights, columns = scheme
    h, theta, n_forcing, n_starts = numbers[0], numbers[1], int(numbers[3]), int(numbers[4])
    lead, near = columns[0], columns[1]
    counters, x, u, d, lag, pieces, _, data = state
    shift = data[:, 0].copy()
    positions, rows, slopes, _ = output
    n_block = lag.shape[1]
    width, n_orbit = x.shape[0], layout[0]
    known, w, ones = np.empty(width), np.empty(width), np.ones(width)
    orbit, j_f = x[:n_orbit], np.empty((n_orbit, n_orbit))
    counters[1] = 0
    while counters[0] < n_end:
        n = counters[0]
        p = n % n_block
        if p == 0 and counters[3] != n:
            open_block(lag, pieces, n, classes, weights, exchange, tables, memory)
            if n == 0:
                begin_more(lag, memory[1], data, classes, start_weights, n_starts)
            counters[3] = n
        t = (n + theta) * h
        scale = columns[2] if n == 0 else ones
        for c in range(width):
            w[c] = pieces[c, p]  # the increment before as first guess
            known[c] = near[c] * w[c] + lag[c, p] + lead[c] * forced(data, columns, n_forcing, c, t)
            if n < numbers[2]:
                known[c] -= lead[c] * data[c, 2 + n_forcing + n]
        if n == 0 and given[0] == 1:
            w[:] = data[:, 1 + n_forcing]
        else:
            if not solve_step(
                rhs, jac, has_jac, params, t, orbit, theta, shift, scale, known, lead, w, counters
            ):
                return NOT_SOLVED
            if width > n_orbit and not solve_tangents(
                rhs, jac, has_jac, params, t, x, j_f, theta, shift, scale, known, lead, w, counters
            ):
                return NOT_SOLVED
        for c in range(width):
            new = shift[c] + w[c]
            d[c] = 0.0 if n == 0 else new - u[c]
            u[c] = new
            x[c] += new
            pieces[c, p + 1] = w[c]
            weight = weights[classes[c]]
            for i in range(2, n_block - p):
                lag[c, p + i] += weight[i] * w[c]
            if n == 0:
                begin_one(lag, memory[1], w[c], c, start_weights[classes[c]], 1, 0, n_starts)
        counters[0] = n + 1
        counters[1] = write_rows(n + 1, counters[1], positions, rows, slopes, x, u, d, h)
        if not bounded(orbit):
            return BLOWN_UP
    return RUNNING


@kernel
def begin_more(lag, start, data, classes, start_weights, n_starts):
    """Store the start values from the second on, which stand last in data (W, k)."""
    n_classes = start_weights.shape[0] // n_starts
    for v in range(1, n_starts):
        for c in range(lag.shape[0]):
            own = start_weights[v * n_classes + classes[c]]
            begin_one(lag, start, data[c, v - n_starts], c, own, 0, v, n_starts)


@kernel
def forced(data, columns, n_terms, c, t):
    """Sum of the known terms of a column at time t."""
    total = 0.0
    for i in range(n_terms):
        if data[c, 1 + i] != 0.0:
            total += data[c, 1 + i] * t ** columns[3 + i, c]
    return total
