"""The past on meshes of any steps: moments, weights of the newest pieces, and two histories.

A piece of the solution on [t_k, t_(k+1)] has the slope ``mean + lean (s - middle)``. Seen from t
it contributes ``mean m_0 + lean m_1`` with the moments of the kernel ``p T**(p-1)``, T = t - s:
``m_0 = int p T**(p-1) dT`` and ``m_1 = int p T**(p-1) (middle - T) dT``. Above order 1 the velocity
is a line between the middles of two steps, and its slope takes the place of the mean.
"""

import math

import numpy as np

from .jit import compiled, inner

# Steps so many times longer or shorter than the one before have a corner between them, or begin at
# a singular point: lines, for a parabola would lean on the other.
_STEEPEST = 30.0


@compiled
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


@inner
def is_parabola(step, before, parabolas):
    """Whether the solution on the step before the newest one is a parabola, and not a line."""
    return parabolas != 0 and step <= _STEEPEST * before and before <= _STEEPEST * step


@inner
def piece_of(newer, older, n, times, parabolas):
    """Slope and lean of the piece on the step before the newest one, that from t_(n-2) on."""
    # newer, older: increments of the newest step, from t_(n-1) on, and of the one before
    step, before = times[n] - times[n - 1], times[n - 1] - times[n - 2]
    mean = older / before
    if not is_parabola(step, before, parabolas):
        return mean, 0.0
    return mean, 2.0 * (newer / step - mean) / (step + before)


@inner
def bend_of(newer, older, n, times):
    """Slope of the velocity between the middles of the newest step and of the one before.

    As on uniform steps, the one before the first is as long as that, and its velocity x'(0).
    """
    step, before = times[n] - times[n - 1], times[n - 1] - times[max(n - 2, 0)]
    if n == 1:
        return newer / (step * step)
    return 2.0 * (newer / step - older / before) / (step + before)


@inner
def middle_of(n, times):
    """Middle of step n; the one before the first is as long as that."""
    return 0.5 * (times[n] + times[n + 1]) if n >= 0 else 0.5 * (times[0] - times[1])


@compiled
def exchange_mesh_direct(lag, pieces, n, groups, tables, memory):
    """Store the pieces just finished and sum over all of them as seen in step n."""
    # lag (W, 1), pieces (W, 2): u_(n-2) and u_(n-1)
    # tables: times (1, N + 1), inverse leading weights (C, N), theta (1, N), factors and powers
    #   (C, T), Gauss nodes and weights (2, 16), kind of the pieces (1, 1), derivatives (C, T)
    # memory: means, start values (W, 0), leans, of lines the slopes of velocities (W, N)
    mesh, leads, theta, factors, powers, rule, kind, derivatives = tables
    means, _, leans = memory
    if n < 1:
        return
    times = mesh[0]
    t = times[n] + theta[0, n] * (times[n + 1] - times[n])
    for c in range(lag.shape[0]):
        a, total = groups[c], 0.0
        if n > 1:
            mean, lean = piece_of(pieces[c, 1], pieces[c, 0], n, times, int(kind[0, 0]))
            means[c, n - 2] = mean
            if kind[0, 0] > 0.0:
                leans[c, n - 2] = lean
        if kind[0, 0] == 0.0:
            leans[c, n - 1] = bend_of(pieces[c, 1], pieces[c, 0], n, times)
        for j in range(factors.shape[1]):
            factor, p, second = factors[a, j], powers[a, j], derivatives[a, j] == 2.0
            if factor == 0.0 or p == 0.0:
                continue
            for k in range(n if second else n - 1):
                if second:
                    start, end = middle_of(k - 1, times), middle_of(k, times)
                    m_0, _ = moments(t - end, end - start, p, rule[0], rule[1])
                    total += factor * leans[c, k] * m_0
                else:
                    low, step = t - times[k + 1], times[k + 1] - times[k]
                    m_0, m_1 = moments(low, step, p, rule[0], rule[1])
                    bend = leans[c, k] if kind[0, 0] > 0.0 else 0.0
                    total += factor * (means[c, k] * m_0 + bend * m_1)
        lag[c, 0] += leads[a, n] * total


@compiled
def exchange_mesh_modes(lag, pieces, n, groups, tables, memory):
    """Decay the modes over the newest pieces' steps, take these in, and read them all."""
    # tables: as above, with rates (1, M), weights (C, M) and derivatives (1, M) of the modes in
    #   place of those of the terms; memory: modes (W, M), start values (W, 0), unused
    mesh, leads, theta, rates, weights, _, kind, derivatives = tables
    modes, _, _ = memory
    if n < 1:
        return
    times, total = mesh[0], np.zeros(lag.shape[0])
    width_of = lag.shape[0]
    mean, lean, bend = np.zeros(width_of), np.zeros(width_of), np.zeros(width_of)
    for c in range(lag.shape[0]):
        if n > 1:
            mean[c], lean[c] = piece_of(pieces[c, 1], pieces[c, 0], n, times, int(kind[0, 0]))
        bend[c] = bend_of(pieces[c, 1], pieces[c, 0], n, times)
    t = times[n] + theta[0, n] * (times[n + 1] - times[n])
    for i in range(rates.shape[1]):
        second = derivatives[0, i] == 2.0
        if n < 2 and not second:
            continue
        end = middle_of(n - 1, times) if second else times[n - 1]
        width = end - (middle_of(n - 2, times) if second else times[n - 2])
        keep = math.exp(-rates[0, i] * width)
        average, ramp = exponential_moments(rates[0, i] * width, keep)
        seen = math.exp(-rates[0, i] * (t - end))
        for c in range(lag.shape[0]):
            fresh = mean[c] * average + lean[c] * width * (0.5 * average - ramp)
            if second:
                fresh = bend[c] * average
            modes[c, i] = modes[c, i] * keep + width * fresh
            total[c] += weights[groups[c], i] * seen * modes[c, i]
    for c in range(lag.shape[0]):
        lag[c, 0] += leads[groups[c], n] * total[c]


@inner
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


@compiled
def fill_mesh(times, theta, parabolas, factors, powers, derivatives, rule, lead, near):
    """Fill the inverse leading weights, and the weights of the increment before over them."""
    # times (N + 1,), theta (N,); factors, powers, derivatives (C, T); rule (2, 16)
    # lead, near (C, N)
    for n in range(theta.shape[0]):
        step = times[n + 1] - times[n]
        before = times[n] - times[n - 1] if n > 0 else 0.0
        for a in range(factors.shape[0]):
            now, then = near_weights(
                factors[a], powers[a], derivatives[a], theta[n] * step, step, before, parabolas,
                rule,
            )  # fmt: skip
            lead[a, n], near[a, n] = 1.0 / now, then / now


@inner
def near_weights(factors, powers, derivatives, ahead, step, before, parabolas, rule):
    """Weights of the newest increment and of the one before it in the derivative."""
    now, then = 0.0, 0.0
    for j in range(factors.shape[0]):
        if factors[j] == 0.0:
            continue
        if derivatives[j] == 2.0:  # a line of velocities between the middles
            apart = 0.5 * (step + (before if before > 0.0 else step))
            m_0, _ = moments(0.0, apart, powers[j], rule[0], rule[1])
            now += factors[j] * m_0 / (apart * step)
            if before > 0.0:
                then -= factors[j] * m_0 / (apart * before)
            continue
        m_0, m_1 = moments(0.0, ahead, powers[j], rule[0], rule[1])
        now += factors[j] * m_0 / step
        if before > 0.0:
            b_0, b_1 = moments(ahead, before, powers[j], rule[0], rule[1])
            lean = 2.0 * (b_1 + (m_1 if parabolas == 2 else 0.0)) / (step + before)
            if not is_parabola(step, before, parabolas):
                lean = 0.0
            now += factors[j] * lean / step
            then += factors[j] * (b_0 - lean) / before
    return now, then
