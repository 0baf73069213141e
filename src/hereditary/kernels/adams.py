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

# columns of the monitor behind those of kernels/watch.py: f, what the last step lacks (it was made
# with a value of f that its own evaluation then replaced), and in the first row how nearly the
# sweeps failed to contract since the last regular Jacobian
F, LACKS, NEAREST = 11, 12, 13
# Share of the limit from which a Jacobian tells for sure; one is taken again at twice as much.
LOOK_FROM = 0.9
# Sweeps that change less than this, relative to the solution, contract by rounding.
MOVED = 1e-9


@entry(*MARCH)
def march_adams(rhs, jac, has_jac, params, exchange, tables, memory, scheme, state, output, n_end):
    """March to step `n_end`; return how it ended (kernels/block.py)."""
    # scheme: [h, corrections (0: implicit)], layout, classes, unused, weights and start weights
    #   (C, B + 2), rows [lead, near, limit of lead times -J] (3, W)
    # state: counters (7,) [step, rows written, zigzag step, block opened, calls, unused, growth
    #   step], x, u, change of u (W,), lag (W, B), pieces (W, B + 1), monitor, shift (W, 1)
    # output: positions (k,), rows of x, rows of x' (k, d), Jacobians (samples, d, d): the regular
    #   ones, then one for each stretch between them
    numbers, layout, classes, _, weights, start_weights, columns = scheme
    h, corrections = numbers[0], int(numbers[1])
    lead, near, limits = columns[0], columns[1], columns[2]
    counters, x, u, d, lag, pieces, latest, shift = state
    positions, rows, slopes, jacobians = output
    n_block = lag.shape[1]
    width, n_orbit, every = x.shape[0], layout[0], n_block * layout[1]
    first_sample, first_stretch = samples(counters[0], n_end, every)
    known, new, point, f = np.empty(width), np.empty(width), np.empty(width), np.empty(width)
    moved, ones = np.zeros(width), np.ones(width)
    orbit, j_f = x[:n_orbit], np.empty((n_orbit, n_orbit))
    counters[1] = 0
    while counters[0] < n_end:
        n = counters[0]
        p = n % n_block
        if p == 0 and counters[3] != n:
            open_block(lag, pieces, n, classes, weights, exchange, tables, memory)
            if n == 0:
                evaluate(rhs, jac, has_jac, params, 0.0, x, j_f, f, counters)
                begin_values(lag, memory, f, latest, classes, start_weights)
            counters[3] = n
        if every > 0 and n % every == 0:
            sample = jacobians[n // every - first_sample]
            counters[4] += jacobian(rhs, jac, has_jac, n * h, orbit, params, sample)
            latest[0, NEAREST] = 0.5 * LOOK_FROM
        t = (n + 1) * h
        for c in range(width):
            known[c] = shift[c, 0] + near[c] * pieces[c, p] + lag[c, p] + latest[c, LACKS]
            new[c] = known[c] + lead[c] * latest[c, F]  # prediction: f as it was
            latest[c, LACKS] = 0.0
        for _ in range(corrections):
            point[:] = x + new
            evaluate(rhs, jac, has_jac, params, t, point, j_f, f, counters)
            correct(known, lead, f, new, latest, moved)
        if corrections == 0 and not solve_all(
            rhs, jac, has_jac, params, t, x, j_f, ones, known, lead, new, counters
        ):
            return NOT_SOLVED
        point[:] = x + new
        evaluate(rhs, jac, has_jac, params, t, point, j_f, f, counters)
        found = contraction(n_orbit, point, lead, f, moved, latest, limits)
        if found > 2.0 * latest[0, NEAREST]:
            latest[0, NEAREST] = found
            middle = point[:n_orbit] - 0.5 * moved[:n_orbit]  # of the last two sweeps
            sample = jacobians[n // every - first_stretch]
            counters[4] += jacobian(rhs, jac, has_jac, t, middle, params, sample)
        for c in range(width):
            d[c] = 0.0 if n == 0 else new[c] - u[c]
            if u[c] * new[c] < 0.0 and c < n_orbit:
                watch_turn(latest, c, new[c] - u[c], new[c], point[c], QUICK, counters)
            u[c], x[c], latest[c, F], pieces[c, p + 1] = new[c], point[c], f[c], f[c]
            latest[c, LACKS] += lead[c] * f[c] if corrections > 0 else 0.0
            weight = weights[classes[c]]
            for i in range(2, n_block - p):
                lag[c, p + i] += weight[i] * f[c]
        counters[0] = n + 1
        counters[1] = write_rows(n + 1, counters[1], positions, rows, slopes, x, u, d, h)
        if not bounded(orbit):
            return BLOWN_UP
    return RUNNING


@kernel
def samples(n, n_end, every):
    """What a step's number, in stretches of `every`, lies ahead of its regular Jacobian's place.

    And of that of its stretch; these stand behind the regular ones.
    """
    if every == 0:
        return 0, 0
    first = (n + every - 1) // every
    return first, n // every - ((n_end - 1) // every + 1 - first)


@kernel
def begin_values(lag, memory, f, latest, classes, start_weights):
    """Store the right-hand side at 0."""
    for c in range(lag.shape[0]):
        latest[c, F] = f[c]
        begin_memory(lag, memory[1], f[c], c, start_weights[classes[c]], 0)


@kernel
def solve_all(rhs, jac, has_jac, params, t, x, j_f, ones, known, lead, new, counters):
    """The implicit step of orbit and tangents; `known` changes sign."""
    zeros = np.zeros(x.shape[0])
    known[:] = -known
    solved = solve_step(
        rhs, jac, has_jac, params, t, x[: j_f.shape[0]], 1.0, zeros, ones, known, lead, new,
        counters,
    )  # fmt: skip
    if not solved or x.shape[0] == j_f.shape[0]:
        return solved
    return solve_tangents(
        rhs, jac, has_jac, params, t, x, j_f, 1.0, zeros, ones, known, lead, new, counters
    )


@kernel
def correct(known, lead, f, new, latest, moved):
    """A corrector sweep, and what it changes; what it took for f goes, negated, to `LACKS`."""
    for c in range(new.shape[0]):
        corrected = known[c] + lead[c] * f[c]
        moved[c] = corrected - new[c]
        new[c] = corrected
        latest[c, LACKS] = -lead[c] * f[c]


@inlined
def contraction(n_orbit, x, lead, f, moved, latest, limits):
    """Share of its limit by which one more sweep would move a component, the largest of all."""
    largest = 0.0
    for c in range(n_orbit):
        if abs(moved[c]) > MOVED * abs(x[c]):
            more = abs(lead[c] * f[c] + latest[c, LACKS])
            largest = max(largest, more / (abs(moved[c]) * limits[c]))
    return largest
