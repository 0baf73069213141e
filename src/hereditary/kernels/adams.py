"""The block march of Adams-type schemes in integral form (floor 1).

``x_(n+1) = x_n + shift + lead f(t_(n+1), x_(n+1)) + near f_n + lag_n`` with shift = h x'(0) for
orders above 1, solved by Newton's method or approached by prediction and correction. The pieces of
memory are the values of f from f_1 on; f_0, whose weights are others, is the start value.
"""

import numpy as np

from .._jit import entry, kernel
from .block import (
    BLOWN_UP,
    NOT_SOLVED,
    RUNNING,
    begin_memory,
    bounded,
    open_block,
    write_rows,
)
from .jacobian import jacobian
from .newton import solve_step
from .signatures import MARCH
from .tangent import evaluate, solve_tangents


@entry(*MARCH)
def march_adams(rhs, jac, has_jac, params, exchange, tables, memory, scheme, state, output, n_end):
    """March to step `n_end`; return how it ended (kernels/block.py)."""
    # scheme: [h, corrections (0: implicit)], layout, classes, unused, weights and start weights
    #   (C, B + 2), rows [lead, near] (2, W)
    # state: counters (5,) [step, rows written, unused, block opened, calls], x, u, change of u
    #   (W,), lag (W, B), pieces (W, B + 1), [f, what the last step lacks, unused] (W, 3),
    #   shift (W, 1)
    # output: positions (k,), rows of x, rows of x' (k, d), Jacobians (samples, d, d)
    numbers, layout, classes, _, weights, start_weights, columns = scheme
    h, corrections = numbers[0], int(numbers[1])
    lead, near = columns[0], columns[1]
    counters, x, u, d, lag, pieces, latest, shift = state
    positions, rows, slopes, jacobians = output
    n_block = lag.shape[1]
    width, n_orbit, every = x.shape[0], layout[0], n_block * layout[1]
    first_sample = (counters[0] + every - 1) // every if every > 0 else 0
    known, new, point = np.empty(width), np.empty(width), np.empty(width)
    f, ones, zeros = np.empty(width), np.ones(width), np.zeros(width)
    orbit, j_f = x[:n_orbit], np.empty((n_orbit, n_orbit))
    counters[1] = 0
    while counters[0] < n_end:
        n = counters[0]
        p = n % n_block
        if p == 0 and counters[3] != n:
            open_block(lag, pieces, n, classes, weights, exchange, tables, memory)
            if n == 0:
                evaluate(rhs, jac, has_jac, params, 0.0, x, j_f, f, counters)
                for c in range(width):
                    latest[c, 0] = f[c]
                    begin_memory(lag, memory[1], f[c], c, start_weights[classes[c]], 0)
            counters[3] = n
        if every > 0 and n % every == 0:
            sample = jacobians[n // every - first_sample]
            counters[4] += jacobian(rhs, jac, has_jac, n * h, orbit, params, sample)
        t = (n + 1) * h
        for c in range(width):
            # the last step was made with a value of f that its own evaluation then replaced
            known[c] = shift[c, 0] + near[c] * pieces[c, p] + lag[c, p] + latest[c, 1]
            new[c] = known[c] + lead[c] * latest[c, 0]  # prediction: f as it was
            latest[c, 1] = 0.0
        if corrections > 0:
            for _ in range(corrections):
                point[:] = x + new
                evaluate(rhs, jac, has_jac, params, t, point, j_f, f, counters)
                correct(known, lead, f, new, latest)
        else:
            known[:] = -known
            if not solve_step(
                rhs, jac, has_jac, params, t, orbit, 1.0, zeros, ones, known, lead, new, counters
            ) or (width > n_orbit and not solve_tangents(
                rhs, jac, has_jac, params, t, x, j_f, 1.0, zeros, ones, known, lead, new, counters
            )):  # fmt: skip
                return NOT_SOLVED
        point[:] = x + new
        evaluate(rhs, jac, has_jac, params, t, point, j_f, f, counters)
        for c in range(width):
            d[c] = 0.0 if n == 0 else new[c] - u[c]
            u[c], x[c], latest[c, 0] = new[c], point[c], f[c]
            latest[c, 1] += lead[c] * f[c] if corrections > 0 else 0.0
            pieces[c, p + 1] = f[c]
            weight = weights[classes[c]]
            for i in range(2, n_block - p):
                lag[c, p + i] += weight[i] * f[c]
        counters[0] = n + 1
        counters[1] = write_rows(n + 1, counters[1], positions, rows, slopes, x, u, d, h)
        if not bounded(orbit):
            return BLOWN_UP
    return RUNNING


@kernel
def correct(known, lead, f, new, latest):
    """A corrector sweep; what it took for the newest f goes, negated, to latest[:, 1]."""
    for c in range(new.shape[0]):
        new[c] = known[c] + lead[c] * f[c]
        latest[c, 1] = -lead[c] * f[c]
