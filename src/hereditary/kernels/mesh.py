"""Memory on meshes of any steps (floor 1): moments, the two histories, and the march.

A piece of the solution on [t_k, t_(k+1)] has the slope ``mean + lean (s - middle)``. Seen from t
it contributes ``mean m_0 + lean m_1`` with the moments of the kernel ``p T**(p-1)``, T = t - s:
``m_0 = int p T**(p-1) dT`` and ``m_1 = int p T**(p-1) (middle - T) dT``.
"""

import math

import numpy as np

from .._jit import entry, kernel
from .block import BLOWN_UP, NOT_SOLVED, RUNNING, write_rows
from .newton import solve_step
from .signatures import MESH_MARCH

# A step longer than this many times the one before gets a line, not a parabola that leans on it.
STEEPEST = 30.0


@kernel
def moments(low, width, p, nodes, weights):
    """m_0 and m_1 over distances [low, low + width]; `nodes`, `weights`: Gauss rule on [0, 1].

    The width is given by itself: far from a tiny step both ends have the same distance.
    """
    high = low + width
    if p == 0.0:  # a point mass at distance 0
        return (1.0, 0.5 * width) if low == 0.0 else (0.0, 0.0)
    if low == 0.0:
        power = high**p
        return power, power * high * (1.0 - p) / (2.0 * (1.0 + p))
    m_0 = low**p * math.expm1(p * math.log1p(width / low))
    if width > 2.0 * low:  # wide: the closed form does not cancel
        middle = 0.5 * (low + high)
        return m_0, middle * m_0 - p / (p + 1.0) * (high ** (p + 1.0) - low ** (p + 1.0))
    middle, m_1 = low + 0.5 * width, 0.0
    for i in range(nodes.shape[0]):
        # less its value in the middle, whose moment is 0: what is left cancels nowhere
        bend = math.expm1((p - 1.0) * math.log1p((nodes[i] - 0.5) * width / middle))
        m_1 += weights[i] * (0.5 - nodes[i]) * bend
    return m_0, p * width * width * middle ** (p - 1.0) * m_1


@kernel
def recall_direct(lag, pieces, n_pieces, t, classes, tables, memory):
    """Store the pieces just finished and sum over all of them as seen from t."""
    # pieces (2, W): mean and lean of piece n_pieces - 1; tables: times (1, N + 1), factors and
    #   powers (C, T), Gauss nodes and weights (2, 16); memory: means, leans (W, N), unused
    times, factors, powers, rule, _ = tables
    means, leans, _ = memory
    for c in range(lag.shape[0]):
        if n_pieces > 0:
            means[c, n_pieces - 1], leans[c, n_pieces - 1] = pieces[0, c], pieces[1, c]
        total = 0.0
        for j in range(factors.shape[1]):
            factor, p = factors[classes[c], j], powers[classes[c], j]
            if factor != 0.0 and p > 0.0:
                for k in range(n_pieces):
                    low, step = t - times[0, k + 1], times[0, k + 1] - times[0, k]
                    m_0, m_1 = moments(low, step, p, rule[0], rule[1])
                    total += factor * (means[c, k] * m_0 + leans[c, k] * m_1)
        lag[c] = total


@kernel
def recall_modes(lag, pieces, n_pieces, t, classes, tables, memory):
    """Decay the modes over the newest piece, take it in, and read all of them at t."""
    # tables: times (1, N + 1), rates (1, M), weights (C, M), unused; memory: modes (W, M), unused
    times, rates, weights, _, _ = tables
    modes = memory[0]
    width, end = 0.0, times[0, n_pieces]
    if n_pieces > 0:
        width = end - times[0, n_pieces - 1]
    lag[:] = 0.0
    for i in range(rates.shape[1]):
        rate = rates[0, i]
        if n_pieces > 0:
            z = rate * width
            keep = math.exp(-z)
            mean, ramp = exponential_moments(z, keep)
            for c in range(lag.shape[0]):
                fresh = pieces[0, c] * mean + pieces[1, c] * width * (0.5 * mean - ramp)
                modes[c, i] = modes[c, i] * keep + width * fresh
        seen = math.exp(-rate * (t - end))
        for c in range(lag.shape[0]):
            lag[c] += weights[classes[c], i] * seen * modes[c, i]


@kernel
def exponential_moments(z, keep):
    """``int_0^1 exp(-z v) dv`` and ``int_0^1 v exp(-z v) dv``; keep = exp(-z)."""
    if z > 0.5:
        mean = -math.expm1(-z) / z
        return mean, (mean - keep) / z
    mean, ramp = 0.0, 0.0
    for j in range(15, -1, -1):  # leaves 1e-17
        mean = mean * -z / (j + 1.0) + 1.0 / (j + 1.0)
        ramp = ramp * -z / (j + 1.0) + 1.0 / (j + 2.0)
    return mean, ramp


@entry(*MESH_MARCH)
def march_mesh(rhs, jac, has_jac, params, recall, tables, memory, mesh, march, output, n_end):
    """March to mesh point `n_end`; return how it ended (kernels/block.py)."""
    times, theta, parabolas, groups = mesh.times, mesh.theta, mesh.parabolas, mesh.groups
    counts, x, u, pieces = march.counts, march.x, march.increment, march.pieces
    width = x.shape[0]
    lag, known, lead, w = np.empty(width), np.empty(width), np.empty(width), np.empty(width)
    ones, zeros, shift, new = np.ones(width), np.zeros(width), np.empty(width), np.empty(width)
    counts.rows = 0
    while counts.step < n_end:
        n = counts.step
        step = times[n + 1] - times[n]
        before = times[n] - times[n - 1] if n > 0 else 0.0
        t = times[n] + theta[n] * step
        n_pieces = n if parabolas == 0 else max(0, n - 1)
        recall(lag, pieces, n_pieces, t, groups, tables, memory)
        for c in range(width):
            i, ahead = groups[c], theta[n] * step
            factors, powers = mesh.factors[i], mesh.powers[i]
            now, then = near_weights(factors, powers, ahead, step, before, parabolas, mesh.rule)
            lead[c] = 1.0 / now
            known[c] = (lag[c] + then * u[c]) / now
            w[c] = u[c] * step / before if n > 0 else 0.0
            shift[c] = step * mesh.speeds[c]
        if n == 0 and mesh.given == 1:
            w[:] = mesh.first
        elif not solve_step(
            rhs, jac, has_jac, params, t, x, theta[n], shift, ones, known, lead, w, counts
        ):
            return NOT_SOLVED
        finite = True
        for c in range(width):
            if parabolas == 0:
                pieces[0, c], pieces[1, c] = w[c] / step, 0.0
            elif n > 0:
                pieces[0, c] = u[c] / before
                steep = step > STEEPEST * before
                bend = 0.0 if steep else 2.0 * (w[c] / step - u[c] / before) / (step + before)
                pieces[1, c] = bend
            u[c] = w[c]
            new[c] = shift[c] + w[c]
            x[c] += new[c]
            finite = finite and abs(x[c]) < 1e300
        counts.step = n + 1
        counts.rows = write_rows(n + 1, counts.rows, output, x, new, zeros, step)
        if not finite:
            return BLOWN_UP
    return RUNNING


@kernel
def near_weights(factors, powers, ahead, step, before, parabolas, rule):
    """Weights of the newest increment and of the one before it in the derivative."""
    now, then = 0.0, 0.0
    for j in range(factors.shape[0]):
        if factors[j] == 0.0:
            continue
        m_0, m_1 = moments(0.0, ahead, powers[j], rule[0], rule[1])
        now += factors[j] * m_0 / step
        if parabolas > 0 and before > 0.0:
            b_0, b_1 = moments(ahead, before, powers[j], rule[0], rule[1])
            lean = 2.0 * (b_1 + (m_1 if parabolas == 2 else 0.0)) / (step + before)
            if step > STEEPEST * before:
                lean = 0.0
            now += factors[j] * lean / step
            then += factors[j] * (b_0 - lean) / before
    return now, then
