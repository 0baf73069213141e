"""The past on meshes of any steps: moments, weights of the newest pieces, and two histories.

A piece of the solution on [t_k, t_(k+1)] has the slope ``mean + lean (s - middle)``. Seen from t
it contributes ``mean m_0 + lean m_1`` with the moments of the kernel ``p T**(p-1)``, T = t - s:
``m_0 = int p T**(p-1) dT`` and ``m_1 = int p T**(p-1) (middle - T) dT``.
"""

import math

import numpy as np

from .._jit import kernel

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
def piece_of(newer, older, n, times, parabolas):
    """Slope and lean of the piece on the step before the newest one, that from t_(n-2) on."""
    # newer, older: increments of the newest step, from t_(n-1) on, and of the one before
    step, before = times[n] - times[n - 1], times[n - 1] - times[n - 2]
    mean = older / before
    if parabolas == 0 or step > STEEPEST * before:
        return mean, 0.0
    return mean, 2.0 * (newer / step - mean) / (step + before)


@kernel
def exchange_mesh_direct(lag, pieces, n, groups, tables, memory):
    """Store the piece just finished and sum over all of them as seen in step n."""
    # lag (W, 1), pieces (W, 2): u_(n-2) and u_(n-1)
    # tables: times (1, N + 1), inverse leading weights (C, N), theta (1, N), factors and powers
    #   (C, T), Gauss nodes and weights (2, 16), kind of the pieces (1, 1), unused
    # memory: means, start values (W, 0), leans (W, N)
    mesh, leads, theta, factors, powers, rule, kind, _ = tables
    means, _, leans = memory
    if n < 2:
        return
    times = mesh[0]
    t = times[n] + theta[0, n] * (times[n + 1] - times[n])
    for c in range(lag.shape[0]):
        a, total = groups[c], 0.0
        mean, lean = piece_of(pieces[c, 1], pieces[c, 0], n, times, int(kind[0, 0]))
        means[c, n - 2], leans[c, n - 2] = mean, lean
        for j in range(factors.shape[1]):
            factor, p = factors[a, j], powers[a, j]
            if factor != 0.0 and p > 0.0:
                for k in range(n - 1):
                    low, step = t - times[k + 1], times[k + 1] - times[k]
                    m_0, m_1 = moments(low, step, p, rule[0], rule[1])
                    total += factor * (means[c, k] * m_0 + leans[c, k] * m_1)
        lag[c, 0] += leads[a, n] * total


@kernel
def exchange_mesh_modes(lag, pieces, n, groups, tables, memory):
    """Decay the modes over the step before the newest, take its piece in, and read them all."""
    # tables: as above, with rates (1, M) and weights (C, M) in place of factors and powers
    # memory: modes (W, M), start values (W, 0), unused
    mesh, leads, theta, rates, weights, _, kind, _ = tables
    modes, _, _ = memory
    if n < 2:
        return
    times = mesh[0]
    width = times[n - 1] - times[n - 2]
    ahead = times[n] + theta[0, n] * (times[n + 1] - times[n]) - times[n - 1]
    total = np.zeros(lag.shape[0])
    mean, lean = np.empty(lag.shape[0]), np.empty(lag.shape[0])
    for c in range(lag.shape[0]):
        mean[c], lean[c] = piece_of(pieces[c, 1], pieces[c, 0], n, times, int(kind[0, 0]))
    for i in range(rates.shape[1]):
        rate = rates[0, i]
        keep = math.exp(-rate * width)
        average, ramp = exponential_moments(rate * width, keep)
        seen = math.exp(-rate * ahead)
        for c in range(lag.shape[0]):
            fresh = mean[c] * average + lean[c] * width * (0.5 * average - ramp)
            modes[c, i] = modes[c, i] * keep + width * fresh
            total[c] += weights[groups[c], i] * seen * modes[c, i]
    for c in range(lag.shape[0]):
        lag[c, 0] += leads[groups[c], n] * total[c]


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


@kernel
def fill_mesh(times, theta, parabolas, factors, powers, rule, lead, near):
    """Fill the inverse leading weights, and the weights of the increment before over them."""
    # times (N + 1,), theta (N,); factors, powers (C, T); rule (2, 16); lead, near (C, N)
    for n in range(theta.shape[0]):
        step = times[n + 1] - times[n]
        before = times[n] - times[n - 1] if n > 0 else 0.0
        for a in range(factors.shape[0]):
            now, then = near_weights(
                factors[a], powers[a], theta[n] * step, step, before, parabolas, rule
            )
            lead[a, n], near[a, n] = 1.0 / now, then / now


@kernel
def near_weights(factors, powers, ahead, step, before, parabolas, rule):
    """Weights of the newest increment and of the one before it in the derivative."""
    now, then = 0.0, 0.0
    for j in range(factors.shape[0]):
        if factors[j] == 0.0:
            continue
        m_0, m_1 = moments(0.0, ahead, powers[j], rule[0], rule[1])
        now += factors[j] * m_0 / step
        if before > 0.0:
            b_0, b_1 = moments(ahead, before, powers[j], rule[0], rule[1])
            lean = 2.0 * (b_1 + (m_1 if parabolas == 2 else 0.0)) / (step + before)
            if parabolas == 0 or step > STEEPEST * before:
                lean = 0.0
            now += factors[j] * lean / step
            then += factors[j] * (b_0 - lean) / before
    return now, then
