"""The block march of the explicit scheme (floor 1).

``d_n = lead f(t_n, x_n) - near y_(n-1) - lag_n``, ``y_n = y_(n-1) + d_n``, ``x_(n+1) = x_n + y_n``:
solving for the second difference d keeps rounding at 1e-13 where x_(n+1) - 2 x_n + x_(n-1) would
lose it. The lag of older blocks comes from the history; inside a block each new increment is
spread over the steps ahead of it. All arithmetic hangs on absolute step numbers, so a march does
not depend on where it was interrupted.
"""

import numpy as np

from .._jit import entry, kernel
from .block import BLOWN_UP, RUNNING, begin_one, bounded, open_block, write_rows
from .jacobian import jacobian
from .signatures import MARCH
from .tangent import push_tangents
from .watch import SLOWEST, watch_turn


@entry(*MARCH)
def march_explicit(rhs, jac, has_jac, params, exchange, tables, memory, step, march, output, n_end):
    """March to step `n_end`; return how it ended (kernels/block.py)."""
    h, lead, near, groups, weights = step.h, step.lead, step.near, step.groups, step.weights
    counts, x, y, d = march.counts, march.x, march.increment, march.change
    lag, pieces = march.lag, march.pieces
    n_block = lag.shape[1]
    first_sample = (counts.step + step.every - 1) // step.every
    width, n_orbit = x.shape[0], step.n_orbit
    f, j_f = np.empty(width), np.empty((n_orbit, n_orbit))
    orbit, f_orbit = x[:n_orbit], f[:n_orbit]
    counts.rows = 0
    while counts.step < n_end:
        n = counts.step
        p = n % n_block
        if p == 0 and counts.opened != n:  # the right-hand side may have raised since
            open_block(lag, pieces, n, groups, weights, exchange, tables, memory)
            if n == 0:
                begin_starts(lag, memory, march.starts, groups, step.start_weights)
            counts.opened = n
        if n % step.every == 0:
            sample = output.jacobians[n // step.every - first_sample]
            counts.rhs += jacobian(rhs, jac, has_jac, n * h, orbit, params, sample)
        rhs(n * h, orbit, f_orbit, params)
        counts.rhs += 1
        if width > n_orbit:
            counts.rhs += jacobian(rhs, jac, has_jac, n * h, orbit, params, j_f)
            push_tangents(j_f, x, f)
        for c in range(width):
            y_old = y[c]
            change = lead[c] * f[c] - near[c] * y_old - lag[c, p]
            if n == 0 and step.given[c] == 1:
                change = 0.0  # y holds h x'(0) already: the scheme's x_1 = x_0 + h x'(0)
            y_new = y_old + change
            x_new = x[c] + y_new
            x[c], y[c], d[c], pieces[c, p + 1] = x_new, y_new, change, y_new
            if n == 0:
                d[c] = 0.0  # no second difference yet
            w = weights[groups[c]]
            for i in range(2, n_block - p):
                lag[c, p + i] += w[i] * y_new
            if y_old * y_new < 0.0 and c < n_orbit:
                own = march.monitor[c]
                watch_turn(own, y_new - y_old, y_new, x_new, SLOWEST, counts)
        counts.step = n + 1
        counts.rows = write_rows(n + 1, counts.rows, output, x, y, d, h)
        if not bounded(orbit):
            return BLOWN_UP
    return RUNNING


@kernel
def begin_starts(lag, memory, starts, groups, start_weights):
    """Store all start values (W, V) of the columns, and add them to the first block."""
    n_groups, n_starts = start_weights.shape[0] // max(1, starts.shape[1]), starts.shape[1]
    for c in range(lag.shape[0]):
        for v in range(n_starts):
            own = start_weights[v * n_groups + groups[c]]
            begin_one(lag, memory, starts[c, v], c, own, 1 - v, v, n_starts)
