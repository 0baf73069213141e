"""The block march of Adams-type schemes in integral form (floor 1).

``x_(n+1) = x_n + shift + lead f(t_(n+1), x_(n+1)) + near f_n + lag_n`` with shift = h x'(0) for
orders above 1, solved by Newton's method or approached by prediction and correction. The pieces of
memory are the values of f from f_1 on; f_0, whose weights are others, is the start value.
"""

import numpy as np

from .._jit import entry, inlined, kernel
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
from .watch import QUICK, watch_turn

# Share of the limit from which a Jacobian tells for sure; one is taken again at twice as much.
LOOK_FROM = 0.9
# Sweeps that change less than this, relative to the solution, contract by rounding.
MOVED = 1e-9


@entry(*MARCH)
def march_adams(rhs, jac, has_jac, params, exchange, tables, memory, step, march, output, n_end):
    """March to step `n_end`; return how it ended (kernels/block.py).

    The Jacobians of the output are the regular ones, then one for each stretch between them.
    """
    h, sweeps, lead, groups, weights = step.h, step.sweeps, step.lead, step.groups, step.weights
    counts, x, u, d = march.counts, march.x, march.increment, march.change
    lag, pieces, force, lacks = march.lag, march.pieces, march.force, march.lacks
    n_block, jacobians = lag.shape[1], output.jacobians
    width, n_orbit, every = x.shape[0], step.n_orbit, step.every
    first_sample, first_stretch = samples(counts.step, n_end, every)
    known, new, point, f = np.empty(width), np.empty(width), np.empty(width), np.empty(width)
    moved, ones = np.zeros(width), np.ones(width)
    orbit, j_f = x[:n_orbit], np.empty((n_orbit, n_orbit))
    counts.rows = 0
    while counts.step < n_end:
        n = counts.step
        p = n % n_block
        if p == 0 and counts.opened != n:
            open_block(lag, pieces, n, groups, weights, exchange, tables, memory)
            if n == 0:
                evaluate(rhs, jac, has_jac, params, 0.0, x, j_f, f, counts)
                begin_values(lag, memory, f, force, groups, step.start_weights)
            counts.opened = n
        if every > 0 and n % every == 0:
            sample = jacobians[n // every - first_sample]
            counts.rhs += jacobian(rhs, jac, has_jac, n * h, orbit, params, sample)
            counts.nearest = 0.5 * LOOK_FROM
        t = (n + 1) * h
        for c in range(width):
            known[c] = march.shift[c] + step.near[c] * pieces[c, p] + lag[c, p] + lacks[c]
            new[c] = known[c] + lead[c] * force[c]  # prediction: f as it was
            lacks[c] = 0.0
        for _ in range(sweeps):
            point[:] = x + new
            evaluate(rhs, jac, has_jac, params, t, point, j_f, f, counts)
            correct(known, lead, f, new, lacks, moved)
        if sweeps == 0 and not solve_all(
            rhs, jac, has_jac, params, t, x, j_f, ones, known, lead, new, counts
        ):
            return NOT_SOLVED
        point[:] = x + new
        evaluate(rhs, jac, has_jac, params, t, point, j_f, f, counts)
        found = contraction(n_orbit, point, lead, f, moved, lacks, step.limits)
        if found > 2.0 * counts.nearest:
            counts.nearest = found
            middle = point[:n_orbit] - 0.5 * moved[:n_orbit]  # of the last two sweeps
            sample = jacobians[n // every - first_stretch]
            counts.rhs += jacobian(rhs, jac, has_jac, t, middle, params, sample)
        for c in range(width):
            d[c] = 0.0 if n == 0 else new[c] - u[c]
            if u[c] * new[c] < 0.0 and c < n_orbit:
                watch_turn(march.monitor[c], new[c] - u[c], new[c], point[c], QUICK, counts)
            u[c], x[c], force[c], pieces[c, p + 1] = new[c], point[c], f[c], f[c]
            lacks[c] += lead[c] * f[c] if sweeps > 0 else 0.0
            weight = weights[groups[c]]
            for i in range(2, n_block - p):
                lag[c, p + i] += weight[i] * f[c]
        counts.step = n + 1
        counts.rows = write_rows(n + 1, counts.rows, output, x, u, d, h)
        if not bounded(orbit):
            return BLOWN_UP
    return RUNNING


@kernel
def samples(n, n_end, every):
    """Return what to subtract from n // every for the place of the regular Jacobian of step n.

    And for the place of the Jacobian of its stretch; these stand behind the regular ones.
    """
    if every == 0:
        return 0, 0
    first = (n + every - 1) // every
    return first, n // every - ((n_end - 1) // every + 1 - first)


@kernel
def begin_values(lag, memory, f, force, groups, start_weights):
    """Store the right-hand side at 0."""
    for c in range(lag.shape[0]):
        force[c] = f[c]
        begin_memory(lag, memory, f[c], c, start_weights[groups[c]], 0)


@kernel
def solve_all(rhs, jac, has_jac, params, t, x, j_f, ones, known, lead, new, counts):
    """The implicit step of orbit and tangents; `known` changes sign."""
    zeros = np.zeros(x.shape[0])
    known[:] = -known
    solved = solve_step(
        rhs, jac, has_jac, params, t, x[: j_f.shape[0]], 1.0, zeros, ones, known, lead, new,
        counts,
    )  # fmt: skip
    if not solved or x.shape[0] == j_f.shape[0]:
        return solved
    return solve_tangents(
        rhs, jac, has_jac, params, t, x, j_f, 1.0, zeros, ones, known, lead, new, counts
    )


@kernel
def correct(known, lead, f, new, lacks, moved):
    """Make a corrector sweep; `lacks` is, negated, what it took for f."""
    for c in range(new.shape[0]):
        corrected = known[c] + lead[c] * f[c]
        moved[c] = corrected - new[c]
        new[c] = corrected
        lacks[c] = -lead[c] * f[c]


@inlined
def contraction(n_orbit, x, lead, f, moved, lacks, limits):
    """Share of its limit by which one more sweep would move a component, the largest of all."""
    largest = 0.0
    for c in range(n_orbit):
        if abs(moved[c]) > MOVED * abs(x[c]):
            more = abs(lead[c] * f[c] + lacks[c])
            largest = max(largest, more / (abs(moved[c]) * limits[c]))
    return largest
