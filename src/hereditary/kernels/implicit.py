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
def march_implicit(rhs, jac, has_jac, params, exchange, tables, memory, step, march, output, n_end):
    """March to step `n_end`; return how it ended (kernels/block.py)."""
    h, theta, lead, groups, weights = step.h, step.theta, step.lead, step.groups, step.weights
    counts, x, u, d = march.counts, march.x, march.increment, march.change
    lag, pieces, n_starts = march.lag, march.pieces, 1 + march.starts.shape[1]
    shift, n_block = march.shift.copy(), lag.shape[1]
    width, n_orbit = x.shape[0], step.n_orbit
    known, w, ones = np.empty(width), np.empty(width), np.ones(width)
    orbit, j_f = x[:n_orbit], np.empty((n_orbit, n_orbit))
    counts.rows = 0
    while counts.step < n_end:
        n = counts.step
        p = n % n_block
        if p == 0 and counts.opened != n:
            open_block(lag, pieces, n, groups, weights, exchange, tables, memory)
            if n == 0:
                begin_more(lag, memory, march.starts, groups, step.start_weights)
            counts.opened = n
        t = (n + theta) * h
        scale = step.scale if n == 0 else ones
        for c in range(width):
            w[c] = pieces[c, p]  # the increment before as first guess
            known[c] = step.near[c] * w[c] + lag[c, p]
            known[c] += lead[c] * forced(march.drift, step.powers, c, t)
            if n < march.corrections.shape[1]:
                known[c] -= lead[c] * march.corrections[c, n]
        if n == 0 and step.given[0] == 1:
            w[:] = march.first
        else:
            if not solve_step(
                rhs, jac, has_jac, params, t, orbit, theta, shift, scale, known, lead, w, counts
            ):
                return NOT_SOLVED
            if width > n_orbit and not solve_tangents(
                rhs, jac, has_jac, params, t, x, j_f, theta, shift, scale, known, lead, w, counts
            ):
                return NOT_SOLVED
        for c in range(width):
            new = shift[c] + w[c]
            d[c] = 0.0 if n == 0 else new - u[c]
            u[c] = new
            x[c] += new
            pieces[c, p + 1] = w[c]
            weight = weights[groups[c]]
            for i in range(2, n_block - p):
                lag[c, p + i] += weight[i] * w[c]
            if n == 0:
                begin_one(lag, memory, w[c], c, step.start_weights[groups[c]], 1, 0, n_starts)
        counts.step = n + 1
        counts.rows = write_rows(n + 1, counts.rows, output, x, u, d, h)
        if not bounded(orbit):
            return BLOWN_UP
    return RUNNING


@kernel
def begin_more(lag, memory, starts, groups, start_weights):
    """Store the start values from the second on, (W, V - 1)."""
    n_starts = 1 + starts.shape[1]
    n_groups = start_weights.shape[0] // n_starts
    for v in range(1, n_starts):
        for c in range(lag.shape[0]):
            own = start_weights[v * n_groups + groups[c]]
            begin_one(lag, memory, starts[c, v - 1], c, own, 0, v, n_starts)


@kernel
def forced(drift, powers, c, t):
    """Sum the known terms of a column at time t."""
    total = 0.0
    for i in range(drift.shape[1]):
        if drift[c, i] != 0.0:
            total += drift[c, i] * t ** powers[i, c]
    return total
