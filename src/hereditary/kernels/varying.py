"""Marches whose orders change from step to step, and how their past is summed (floor 1).

With ``x_(n+1) = x_n + shift + w_n``, shift = h x'(0) for orders above 1, every term of a step is
``share sum_k W_k(p) w_(n-k)`` with its own share and p. Terms with y' weigh by ``W_k = (k+theta)**p
- (k-1+theta)**p``, terms with y'' by ``W_k = b_k - b_(k-1)``, b_k = (k+1)**p - k**p. No weight
lasts longer than a step, so these marches go in blocks of one step: the nearest two weights are the
scheme's, the history sums those from k = 2 on.

A history's first two tables are the schedule of the steps ahead and the derivative in each term:
steps (1 + C (3 + 3 T), n), whose rows are the step's number and for each of C classes lead, near,
drift and then share, p and kernel (the share of ``t**(p-1)`` as an integral over its rates) of each
of T terms; derivatives (C, T), 0 where a class has fewer terms. The other three are its own. Modes
(W, M), where there are any, are the second array of the memory and are weighed here: handing all
these arrays to a function value at every step takes longer than what it has to do.
"""

import math

import numpy as np

from .._jit import entry, inlined, kernel
from .block import BLOWN_UP, NOT_SOLVED, RUNNING, bounded, write_rows
from .jacobian import jacobian
from .march import watch_zigzag
from .newton import solve_step
from .signatures import MARCH
from .tangent import push_tangents, solve_tangents

# rows of a class before those of its terms, rows of a term
HEAD, PER_TERM = 3, 3
# rows of a term in what the modes' weights begin with
STARTS = 5


@entry(*MARCH)
def march_varying_explicit(
    rhs, jac, has_jac, params, exchange, tables, memory, scheme, state, output, n_end
):
    """March of the explicit scheme to step `n_end`; return how it ended (kernels/block.py)."""
    # scheme: [h], layout, classes, second (W,), others unused
    # state: as in kernels/march.py with blocks of one step; the pieces are w, data (W, 1) = shift
    numbers, layout, classes, second, _, _, _ = scheme
    h, every = numbers[0], layout[1]
    counters, x, u, d, lag, pieces, monitor, data = state
    positions, rows, slopes, jacobians = output
    steps, derivatives, table, starts, size = tables
    modes, per_class = memory[1], HEAD + PER_TERM * derivatives.shape[1]
    first_sample = (counters[0] + every - 1) // every
    width, n_orbit = x.shape[0], layout[0]
    f, j_f = np.empty(width), np.empty((n_orbit, n_orbit))
    weights, powers = np.empty((derivatives.shape[0], modes.shape[1])), np.empty(modes.shape[1])
    orbit, f_orbit = x[:n_orbit], f[:n_orbit]
    counters[1] = 0
    while counters[0] < n_end:
        n = counters[0]
        i = n - int(steps[0, 0])
        if counters[3] != n:  # the right-hand side may have raised since
            for c in range(width):
                lag[c, 0] = 0.0
            if modes.shape[1] > 0:
                weigh_modes(weights, i, derivatives, table, starts, size, powers)
                read_modes(lag, pieces, classes, weights, table, modes, powers)
            else:
                exchange(lag, pieces, n, classes, tables, memory)
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
            row = 1 + per_class * classes[c]
            lead, near, drift = steps[row, i], steps[row + 1, i], steps[row + 2, i]
            w_old, u_old = pieces[c, 1], u[c]
            change = lead * f[c] - near * w_old - drift * data[c, 0] - lag[c, 0]
            if n == 0 and second[c] == 1:
                change = 0.0  # u holds h x'(0) already: the scheme's x_1 = x_0 + h x'(0)
            u_new = u_old + change
            x[c] += u_new
            u[c], d[c] = u_new, change
            if n == 0:
                d[c] = 0.0  # no second difference yet
            pieces[c, 0], pieces[c, 1] = w_old, w_old + change
            if u_old * u_new < 0.0 and c < n_orbit:
                watch_zigzag(monitor, c, abs(u_new), abs(x[c]), counters)
            else:
                monitor[c, 0] = 0.0
        counters[0] = n + 1
        counters[1] = write_rows(n + 1, counters[1], positions, rows, slopes, x, u, d, h)
        if not bounded(orbit):
            return BLOWN_UP
    return RUNNING


@entry(*MARCH)
def march_varying_implicit(
    rhs, jac, has_jac, params, exchange, tables, memory, scheme, state, output, n_end
):
    """March of an implicit scheme to step `n_end`; return how it ended (kernels/block.py)."""
    # scheme: [h, theta], layout, classes, others unused; state: as above
    numbers, layout, classes, _, _, _, _ = scheme
    h, theta = numbers[0], numbers[1]
    counters, x, u, d, lag, pieces, _, data = state
    positions, rows, slopes, _ = output
    steps, derivatives, table, starts, size = tables
    modes, per_class = memory[1], HEAD + PER_TERM * derivatives.shape[1]
    width, n_orbit = x.shape[0], layout[0]
    known, lead, w = np.empty(width), np.empty(width), np.empty(width)
    weights, powers = np.empty((derivatives.shape[0], modes.shape[1])), np.empty(modes.shape[1])
    ones, shift = np.ones(width), data[:, 0].copy()
    orbit, j_f = x[:n_orbit], np.empty((n_orbit, n_orbit))
    counters[1] = 0
    while counters[0] < n_end:
        n = counters[0]
        i = n - int(steps[0, 0])
        if counters[3] != n:  # the right-hand side may have raised since
            for c in range(width):
                lag[c, 0] = 0.0
            if modes.shape[1] > 0:
                weigh_modes(weights, i, derivatives, table, starts, size, powers)
                read_modes(lag, pieces, classes, weights, table, modes, powers)
            else:
                exchange(lag, pieces, n, classes, tables, memory)
            counters[3] = n
        t = (n + theta) * h
        for c in range(width):
            row = 1 + per_class * classes[c]
            w[c] = pieces[c, 1]  # the increment before as first guess
            lead[c] = steps[row, i]
            known[c] = steps[row + 1, i] * w[c] + steps[row + 2, i] * shift[c] + lag[c, 0]
        if not solve_step(
            rhs, jac, has_jac, params, t, orbit, theta, shift, ones, known, lead, w, counters
        ):
            return NOT_SOLVED
        if width > n_orbit and not solve_tangents(
            rhs, jac, has_jac, params, t, x, j_f, theta, shift, ones, known, lead, w, counters
        ):
            return NOT_SOLVED
        for c in range(width):
            new = shift[c] + w[c]
            d[c] = 0.0 if n == 0 else new - u[c]
            u[c] = new
            x[c] += new
            pieces[c, 0], pieces[c, 1] = pieces[c, 1], w[c]
        counters[0] = n + 1
        counters[1] = write_rows(n + 1, counters[1], positions, rows, slopes, x, u, d, h)
        if not bounded(orbit):
            return BLOWN_UP
    return RUNNING


@kernel
def exchange_varying_direct(lag, pieces, n, classes, tables, memory):
    """Store u_(n-2) and add ``sum_(k>=2) W_k u_(n-k)`` with the weights of step n."""
    # lag (W, 1), pieces (W, 2); tables: schedule, derivatives, logs (4, > n) of k, 1 + 1/k and of
    #   k - 1 + theta, 1 + 1/(k - 1 + theta), room (1, > n), unused
    # memory: stored (W, > n) with u_m at m + 1, others unused
    steps, derivatives, logs, room, _ = tables
    stored = memory[0]
    if n < 2:
        return
    stored[:, n - 1] = pieces[:, 0]
    weights = room[0]
    i = n - int(steps[0, 0])
    n_classes, n_terms = derivatives.shape
    for a in range(n_classes):
        for j in range(n_terms):
            if derivatives[a, j] == 0.0:
                continue
            row = 1 + (HEAD + PER_TERM * n_terms) * a + HEAD + PER_TERM * j
            share, p = steps[row, i], steps[row + 1, i]
            second = derivatives[a, j] == 2.0
            first = 0 if second else 2
            for k in range(2, n + 1):
                weights[k] = math.exp(p * logs[first, k]) * math.expm1(p * logs[first + 1, k])
            for c in range(lag.shape[0]):
                if classes[c] != a:
                    continue
                total = weighed(weights, stored[c], n, second)
                if second:
                    # d_(n-1) = w_(n-1) - w_(n-2), the first of which the scheme weighs
                    total -= math.expm1(p * math.log(2.0)) * stored[c, n - 1]
                lag[c, 0] += share * total


@kernel
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


@inlined
def weigh_modes(weights, i, derivatives, table, starts, size, powers):
    """Weights of all modes for every class and column i of the schedule.

    On the grid of rates exp(h j) a kernel's amplitudes are a geometric sequence whatever its order,
    sixteen at a time: one after the other they would wait for each other.
    """
    # weights (C, M); derivatives (C, T); table (3, M): decay q, what a rate's amplitude is
    #   multiplied by for terms with y' and with y''; starts (5 C T, n): for each term the first
    #   amplitude, the ratio, and the weights of the slow end, which stands behind the grid
    term, behind = 0, int(size[0, 0])
    for a in range(derivatives.shape[0]):
        for j in range(derivatives.shape[1]):
            kind = int(derivatives[a, j])
            if kind > 0:
                power = starts[term + 1, i]
                powers[0] = starts[term, i]
                for length in (1, 2, 4, 8):
                    for m in range(length):
                        powers[length + m] = powers[m] * power
                    power *= power
                for m in range(16, powers.shape[0], 16):
                    for k in range(16):
                        powers[m + k] = powers[m - 16 + k] * power
                if j == 0:
                    for m in range(powers.shape[0]):
                        weights[a, m] = powers[m] * table[kind, m]
                else:
                    for m in range(powers.shape[0]):
                        weights[a, m] += powers[m] * table[kind, m]
                for k in range(3):
                    weights[a, behind + k] += starts[term + 2 + k, i]
            term += STARTS


@inlined
def read_modes(lag, pieces, classes, weights, table, modes, sums):
    """Take u_(n-2) into the modes (W, M) and add what they weigh to the lag."""
    for c in range(lag.shape[0]):
        a, piece = classes[c], pieces[c, 0]
        for m in range(modes.shape[1]):
            modes[c, m] = table[0, m] * modes[c, m] + piece
        # sixteen sums side by side: the terms of one sum wait for each other
        for m in range(16):
            sums[m] = weights[a, m] * modes[c, m]
        for m in range(16, modes.shape[1], 16):
            for k in range(16):
                sums[k] += weights[a, m + k] * modes[c, m + k]
        for half in (8, 4, 2, 1):
            for k in range(half):
                sums[k] += sums[half + k]
        lag[c, 0] += sums[0]
