"""The block march of Adams-type schemes in integral form (floor 1).

``x_(n+1) = x_n + shift + lead f(t_(n+1), x_(n+1)) + near f_n + lag_n`` with shift = h x'(0) for
orders above 1, solved by Newton's method or approached by prediction and correction. The pieces of
memory are the values of f from f_1 on; f_0, whose weights are others, is the start value.
"""

import numpy as np

from .._jit import entry, kernel
from .block import BLOWN_UP, NOT_SOLVED, RUNNING, begin_memory, open_block, write_rows
from .jacobian import jacobian
from .newton import solve_step
from .signatures import MARCH


@entry(*MARCH)
def march_adams(rhs, jac, has_jac, params, exchange, tables, memory, scheme, state, output, n_end):
    """March to step `n_end`; return how it ended (kernels/block.py)."""
    # scheme: [h, corrections (0: implicit), blocks between Jacobians (0: none)], classes, unused,
    #   weights and start weights (C, B + 2), rows [lead, near, shift], no forcing
    # state: counters (5,) [step, rows written, unused, block opened, calls], x, u, change of u
    #   (W,), lag (W, B), pieces (W, B + 1), [f, what the last
    #   step lacks, unused] (W, 3)
    # output: positions (k,), rows of x, rows of x' (k, d), Jacobians (samples, d, d)
    numbers, classes, _, weights, start_weights, columns, _ = scheme
    h, corrections = numbers[0], int(numbers[1])
    lead, near, shift = columns[0], columns[1], columns[2]
    counters, x, u, d, lag, pieces, latest = state
    positions, rows, slopes, jacobians = output
    n_block = lag.shape[1]
    width = x.shape[0]
    every = n_block * int(numbers[2])
    first_sample = (counters[0] + every - 1) // every if every > 0 else 0
    known, new, point = np.empty(width), np.empty(width), np.empty(width)
    f, ones, zeros = np.empty(width), np.ones(width), np.zeros(width)
    counters[1] = 0
    while counters[0] < n_end:
        n = counters[0]
        p = n % n_block
        if p == 0 and counters[3] != n:
            if n == 0:
                rhs(0.0, x, f, params)
                counters[4] += 1
            open_block(lag, pieces, n, classes, weights, exchange, tables, memory)
            counters[3] = n
            if n == 0:
                latest[:, 0] = f
                for c in range(width):
                    begin_memory(lag, memory[1], f[c], c, start_weights[classes[c]], 0)
        if every > 0 and n % every == 0:
            sample = jacobians[n // every - first_sample]
            counters[4] += jacobian(rhs, jac, has_jac, n * h, x, params, sample)
        t = (n + 1) * h
        for c in range(width):
            # the last step was made with a value of f that its own evaluation then replaced
            known[c] = shift[c] + near[c] * pieces[c, p] + lag[c, p] + latest[c, 1]
            new[c] = known[c] + lead[c] * latest[c, 0]  # prediction: f as it was
            latest[c, 1] = 0.0
        if corrections > 0:
            correct(rhs, params, t, x, corrections, known, lead, new, latest, counters)
        else:
            known[:] = -known
            if not solve_step(
                rhs, jac, has_jac, params, t, x, 1.0, zeros, ones, known, lead, new, counters
            ):
                return NOT_SOLVED
        point[:] = x + new
        rhs(t, point, f, params)
        counters[4] += 1
        finite = True
        for c in range(width):
            d[c] = 0.0 if n == 0 else new[c] - u[c]
            u[c], x[c], latest[c, 0] = new[c], point[c], f[c]
            latest[c, 1] += lead[c] * f[c] if corrections > 0 else 0.0
            pieces[c, p + 1] = f[c]
            weight = weights[classes[c]]
            for i in range(2, n_block - p):
                lag[c, p + i] += weight[i] * f[c]
            finite = finite and abs(x[c]) < 1e300
        counters[0] = n + 1
        counters[1] = write_rows(n + 1, counters[1], positions, rows, slopes, x, u, d, h)
        if not finite:
            return BLOWN_UP
    return RUNNING


@kernel
def correct(rhs, params, t, x, corrections, known, lead, new, latest, counters):
    """Corrector sweeps; what the last one took for the newest f goes, negated, to latest[:, 1]."""
    point, f = np.empty(x.shape[0]), np.empty(x.shape[0])
    for _ in range(corrections):
        for c in range(x.shape[0]):
            point[c] = x[c] + new[c]
        rhs(t, point, f, params)
        counters[4] += 1
        for c in range(x.shape[0]):
            new[c] = known[c] + lead[c] * f[c]
            latest[c, 1] = -lead[c] * f[c]
