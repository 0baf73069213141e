"""Marches whose orders change from step to step, and how their past is summed (floor 1).

With ``x_(n+1) = x_n + shift + w_n``, shift = h x'(0) for orders above 1, every Caputo term of a
step is ``share sum_k W_k(p) w_(n-k)`` with its own share and p. Terms with y' weigh by ``W_k =
(k+theta)**p - (k-1+theta)**p``, terms with y'' by ``W_k = b_k - b_(k-1)``, b_k = (k+1)**p - k**p.
No weight lasts longer than a step, so these marches go in blocks of one step: the nearest two
weights are the scheme's, the history sums those from k = 2 on. Weights of terms with other kernels
do last, but for the leading weight that all of a step is divided by.

A history's first two tables are the schedule of the steps ahead and the derivative in each term:
steps (1 + C (4 + 3 T), n), whose rows are the step's number and for each of C classes lead, near,
drift (of x'(0)), value (of x(0)) and then share, p and kernel (the share of ``t**(p-1)`` as an
integral over its rates) of each of T terms; derivatives (C, T), 0 where a class has fewer terms.
The other three are its own. Modes (W, M), where there are any, are the second array of the memory
and are weighed here: handing all these arrays to a function value at every step takes longer than
what it has to do. The third array holds what terms with other kernels need of each column, shift
and x(0), and has no columns without such terms.
"""

import math

import numpy as np

from .._jit import entry, inlined, kernel
from .block import BLOWN_UP, NOT_SOLVED, RUNNING, bounded, write_rows
from .jacobian import jacobian
from .newton import solve_step
from .signatures import MARCH
from .tangent import push_tangents, solve_tangents
from .watch import SLOWEST, watch_turn

# rows of a class before those of its terms, rows of a term
HEAD, PER_TERM = 4, 3
# rows of a term in what the modes' weights begin with
STARTS = 6
# modes of power laws are summed in so many parts side by side
LANES = 4


@entry(*MARCH, fused=True)
def march_varying_explicit(
    rhs, jac, has_jac, params, exchange, tables, memory, step, march, output, n_end
):
    """March of the explicit scheme to step `n_end`; return how it ended (kernels/block.py).

    Blocks are of one step, and pieces the increments without shift.
    """
    h, every, groups = step.h, step.every, step.groups
    counts, x, u, d = march.counts, march.x, march.increment, march.change
    lag, pieces, shift, value = march.lag, march.pieces, march.shift, march.starts
    steps, derivatives, table, starts, size = tables
    _, modes, _ = memory
    per_class = HEAD + PER_TERM * derivatives.shape[1]
    asks = begin(memory, march, counts.step)
    first_sample = (counts.step + every - 1) // every
    width, n_orbit = x.shape[0], step.n_orbit
    f, j_f = np.empty(width), np.empty((n_orbit, n_orbit))
    lanes = np.empty(int(size[0, 0]) // LANES)
    orbit, f_orbit = x[:n_orbit], f[:n_orbit]
    counts.rows = 0
    while counts.step < n_end:
        n = counts.step
        i = n - int(steps[0, 0])
        if counts.opened != n:  # the right-hand side may have raised since
            read_modes(lag, pieces, i, groups, derivatives, table, starts, size, modes, lanes)
            if asks:
                exchange(lag, pieces, n, groups, tables, memory)
            counts.opened = n
        if n % every == 0:
            sample = output.jacobians[n // every - first_sample]
            counts.rhs += jacobian(rhs, jac, has_jac, n * h, orbit, params, sample)
        rhs(n * h, orbit, f_orbit, params)
        counts.rhs += 1
        if width > n_orbit:
            counts.rhs += jacobian(rhs, jac, has_jac, n * h, orbit, params, j_f)
            push_tangents(j_f, x, f)
        for c in range(width):
            row = 1 + per_class * groups[c]
            w_old, u_old = pieces[c, 1], u[c]
            known = steps[row + 1, i] * w_old + steps[row + 2, i] * shift[c]
            known += steps[row + 3, i] * value[c, 0]
            change = steps[row, i] * f[c] - known - lag[c, 0]
            if n == 0 and step.given[c] == 1:
                change = 0.0  # u holds h x'(0) already: the scheme's x_1 = x_0 + h x'(0)
            u_new = u_old + change
            x[c] += u_new
            u[c], d[c] = u_new, change
            if n == 0:
                d[c] = 0.0  # no second difference yet
            pieces[c, 0], pieces[c, 1] = w_old, w_old + change
            if u_old * u_new < 0.0 and c < n_orbit:
                watch_turn(march.monitor[c], u_new - u_old, u_new, x[c], SLOWEST, counts)
        counts.step = n + 1
        counts.rows = write_rows(n + 1, counts.rows, output, x, u, d, h)
        if not bounded(orbit):
            return BLOWN_UP
    return RUNNING


@entry(*MARCH, fused=True)
def march_varying_implicit(
    rhs, jac, has_jac, params, exchange, tables, memory, step, march, output, n_end
):
    """March of an implicit scheme to step `n_end`; return how it ended (kernels/block.py)."""
    h, theta, groups = step.h, step.theta, step.groups
    counts, x, u, d = march.counts, march.x, march.increment, march.change
    lag, pieces, value = march.lag, march.pieces, march.starts
    steps, derivatives, table, starts, size = tables
    _, modes, _ = memory
    per_class = HEAD + PER_TERM * derivatives.shape[1]
    asks = begin(memory, march, counts.step)
    width, n_orbit = x.shape[0], step.n_orbit
    known, lead, w = np.empty(width), np.empty(width), np.empty(width)
    lanes = np.empty(int(size[0, 0]) // LANES)
    ones, shift = np.ones(width), march.shift.copy()
    orbit, j_f = x[:n_orbit], np.empty((n_orbit, n_orbit))
    counts.rows = 0
    while counts.step < n_end:
        n = counts.step
        i = n - int(steps[0, 0])
        if counts.opened != n:  # the right-hand side may have raised since
            read_modes(lag, pieces, i, groups, derivatives, table, starts, size, modes, lanes)
            if asks:
                exchange(lag, pieces, n, groups, tables, memory)
            counts.opened = n
        t = (n + theta) * h
        for c in range(width):
            row = 1 + per_class * groups[c]
            w[c] = pieces[c, 1]  # the increment before as first guess
            lead[c] = steps[row, i]
            known[c] = steps[row + 1, i] * w[c] + steps[row + 2, i] * shift[c]
            known[c] += steps[row + 3, i] * value[c, 0] + lag[c, 0]
        if not solve_step(
            rhs, jac, has_jac, params, t, orbit, theta, shift, ones, known, lead, w, counts
        ):
            return NOT_SOLVED
        if width > n_orbit and not solve_tangents(
            rhs, jac, has_jac, params, t, x, j_f, theta, shift, ones, known, lead, w, counts
        ):
            return NOT_SOLVED
        for c in range(width):
            new = shift[c] + w[c]
            d[c] = 0.0 if n == 0 else new - u[c]
            u[c] = new
            x[c] += new
            pieces[c, 0], pieces[c, 1] = pieces[c, 1], w[c]
        counts.step = n + 1
        counts.rows = write_rows(n + 1, counts.rows, output, x, u, d, h)
        if not bounded(orbit):
            return BLOWN_UP
    return RUNNING


@kernel
def begin(memory, march, n):
    """Hand shift and x(0) over at step 0; tell whether the history must be called at each step."""
    _, modes, begun = memory
    if n == 0 and begun.shape[1] > 0:
        for c in range(begun.shape[0]):
            begun[c, 0], begun[c, 1] = march.shift[c], march.starts[c, 0]
    return modes.shape[1] == 0 or begun.shape[1] > 0


@kernel
def exchange_varying_direct(lag, pieces, n, classes, tables, memory):
    """Store u_(n-2) and add ``sum_(k>=2) W_k u_(n-k)`` with the weights of step n."""
    # lag (W, 1), pieces (W, 2); tables: schedule, derivatives, logs (4, > n) of k, 1 + 1/k and of
    #   k - 1 + theta, 1 + 1/(k - 1 + theta), weights (1 + 3 C, > n): room, and for each class those
    #   of other kernels, of w, of shift and of x(0); the last as in `read_modes`, zeros
    # memory: stored (W, > n) with u_m at m + 1, unused, shift and x(0) (W, 2) for other kernels
    steps, derivatives, logs, others, _ = tables
    stored, _, begun = memory
    if n < 2:
        return
    stored[:, n - 1] = pieces[:, 0]
    i = n - int(steps[0, 0])
    weights = others[0]
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
    if begun.shape[1] > 0:
        for c in range(lag.shape[0]):
            a = classes[c]
            total = weighed(others[1 + 3 * a], stored[c], n, False)
            total += others[2 + 3 * a, n] * begun[c, 0] + others[3 + 3 * a, n] * begun[c, 1]
            lag[c, 0] += steps[1 + (HEAD + PER_TERM * n_terms) * a, i] * total


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
def read_modes(lag, pieces, i, classes, derivatives, table, starts, size, modes, lanes):
    """Take u_(n-2) into the modes of power laws; set the lag to what they give, 0 without any.

    On the grid of rates exp(h j) a kernel's amplitudes are a geometric sequence whatever its order,
    so their sum is a polynomial in its ratio: Horner's rule, first on the quarters of the modes,
    side by side, then on every fourth of what is left. No product waits long for another, and no
    weight is written down.
    """
    # pieces (W, 2); derivatives (C, T); i: column of the schedule; lanes: room (M / 4,)
    # table (5 + C, M): decay q, what a rate's amplitude is multiplied by for terms with y' and with
    #   y'', two rows for other kernels, then the weights of their modes for each class
    # starts (6 C T, n): for each term the first amplitude, the ratio, its power M / 4, and the
    #   weights of the slow end
    # size (1, 3): modes of power laws, a multiple of 16, where the slow end stands behind the grid,
    #   whether other kernels leave out the first whole increment
    n_powers, behind, quarter = int(size[0, 0]), int(size[0, 1]), lanes.shape[0]
    n_terms = derivatives.shape[1] if n_powers > 0 else 0
    for c in range(lag.shape[0]):
        piece, total = pieces[c, 0], 0.0
        for m in range(n_powers):
            modes[c, m] = table[0, m] * modes[c, m] + piece
        term = STARTS * n_terms * classes[c]
        for j in range(n_terms):
            kind = int(derivatives[classes[c], j])
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
        lag[c, 0] = total


@kernel
def exchange_kernel_modes(lag, pieces, n, classes, tables, memory):
    """Take u_(n-2) into the modes of other kernels, whose weights last, and add them to the lag.

    Where they remember y' or y they are driven by whole increments, shift included, from u_1 or u_0
    on; x(0), where y itself is remembered, is there from k = 2 on.
    """
    # tables: as in `read_modes`; rows 3 and 4: what a mode takes of shift and x(0)
    steps, derivatives, table, _, size = tables
    _, modes, begun = memory
    i = n - int(steps[0, 0])
    first, late = int(size[0, 0]), int(size[0, 2])
    per_class = HEAD + PER_TERM * derivatives.shape[1]
    for c in range(lag.shape[0]):
        shift = begun[c, 0] if n >= 2 + late else 0.0
        value = begun[c, 1] if n == 2 else 0.0
        row, total = 5 + classes[c], 0.0
        for m in range(first, modes.shape[1]):
            more = pieces[c, 0] + table[3, m] * shift + table[4, m] * value
            modes[c, m] = table[0, m] * modes[c, m] + more
        for m in range(first, modes.shape[1]):
            total += table[row, m] * modes[c, m]
        lag[c, 0] += steps[1 + per_class * classes[c], i] * total
