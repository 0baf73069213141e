"""The block march of the explicit scheme (floor 1).

``d_n = lead f(t_n, x_n) - near y_(n-1) - lag_n``, ``y_n = y_(n-1) + d_n``, ``x_(n+1) = x_n + y_n``:
solving for the second difference d keeps rounding at 1e-13 where x_(n+1) - 2 x_n + x_(n-1) would
lose it. The lag of older blocks comes from the history; inside a block each new increment is
spread over the steps ahead of it. All arithmetic hangs on absolute step numbers, so a march does
not depend on where it was interrupted.
"""

import numpy as np

from .._jit import entry
from .block import BLOWN_UP, RUNNING, begin_one, bounded, open_block, write_rows
from .jacobian import jacobian
from .signatures import MARCH
from .tangent import push_tangents
from .watch import SLOWEST, watch_turn


@entry(*MARCH)
def march_explicit(
    rhs, jac, has_jac, params, exchange, tables, memory, scheme, state, output, n_end
):
    """March to step `n_end`; return 0, or 1 where the solution stopped being finite."""
    # scheme: [h], layout, classes, second (W,), weights and start weights (C, B + 2), rows [lead,
    #   near] (2, W)
    # state: counters (7,) [step, rows written, zigzag step, block opened, calls, unused, growth
    #   step], x, y, d (W,), lag (W, B), pieces (W, B + 1), monitor (kernels/watch.py), start
    #   values (W, V)
    # output: positions (k,), rows of x, rows of x' (k, d), Jacobians (blocks, d, d)
    numbers, layout, classes, second, weights, start_weights, columns = scheme
    n_classes = weights.shape[0]
    h, lead, near = numbers[0], columns[0], columns[1]
    counters, x, y, d, lag, pieces, monitor, start = state
    positions, rows, slopes, jacobians = output
    n_block = lag.shape[1]
    every = n_block * layout[1]
    first_sample = (counters[0] + every - 1) // every
    width, n_orbit = x.shape[0], layout[0]
    f, j_f = np.empty(width), np.empty((n_orbit, n_orbit))
    orbit, f_orbit = x[:n_orbit], f[:n_orbit]
    counters[1] = 0
    while counters[0] < n_end:
        n = counters[0]
        p = n % n_block
        if p == 0 and counters[3] != n:  # the right-hand side may have raised since
            open_block(lag, pieces, n, classes, weights, exchange, tables, memory)
            if n == 0:
                for c in range(width):
                    for v in range(start.shape[1]):
                        own = start_weights[v * n_classes + classes[c]]
                        begin_one(lag, memory[1], start[c, v], c, own, 1 - v, v, start.shape[1])
            counters[3] = n
        if n % every == 0:
            sample = jacobians[n // every - first_sample]
            counters[4] += jacobian(rhs, jac, has_jac, n * h, orbit, params, sample)
        rhs(n * h, orbit, f_orbit, params)
        counters[4] += 1
        if width > n_orbit:
            counters[4] += jacobian(rhs, jac, has_jac, n * h, orbit, params, j_f)
            push_tangents(j_f, x, f)
        for c in range(width):
            y_old = y[c]
            change = lead[c] * f[c] - near[c] * y_old - lag[c, p]
            if n == 0 and second[c] == 1:
                change = 0.0  # y holds h x'(0) already: the scheme's x_1 = x_0 + h x'(0)
            y_new = y_old + change
            x_new = x[c] + y_new
            x[c], y[c], d[c], pieces[c, p + 1] = x_new, y_new, change, y_new
            if n == 0:
                d[c] = 0.0  # no second difference yet
            w = weights[classes[c]]
            for i in range(2, n_block - p):
                lag[c, p + i] += w[i] * y_new
            if y_old * y_new < 0.0 and c < n_orbit:
                watch_turn(monitor, c, y_new - y_old, y_new, x_new, SLOWEST, counters)
        counters[0] = n + 1
        counters[1] = write_rows(n + 1, counters[1], positions, rows, slopes, x, y, d, h)
        if not bounded(orbit):
            return BLOWN_UP
    return RUNNING
