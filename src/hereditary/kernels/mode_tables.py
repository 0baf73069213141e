"""Exponential modes behind a collocation step: how they are read and moved on (floor 1).

Modes are read at the nodes of the step and moved to its end by factors that depend on its length
alone. Lengths lie on a grid (`on_grid`), so few of them occur in a run, and the factors of each are
kept in a slot of its own.
"""

import math

import numpy as np

from .._jit import kernel
from .structures import StepTables

# Lengths of steps are powers of two of the multiples of 1 / _PER_OCTAVE, rounded up to so few
# digits that adding them to a time is exact: the same rounding each time would make a drift.
_PER_OCTAVE, _DIGITS = 8, 2.0**12
# Slots; lengths that are powers of 2**(SLOTS / _PER_OCTAVE) apart share one.
SLOTS = 64


def empty_tables(n_modes, s, n_kernels):
    """Return tables that hold the factors of no length yet."""
    slots = (SLOTS, n_modes, s), (SLOTS, n_modes), (SLOTS, s, n_modes), (SLOTS, n_kernels, s, s)
    return StepTables(np.zeros(SLOTS), *(np.full(shape, np.nan) for shape in slots))


@kernel
def on_grid(h):
    """The next smaller length of the grid."""
    power = math.floor(_PER_OCTAVE * math.log2(h)) / _PER_OCTAVE
    octave = math.floor(power)
    return math.ceil(2.0 ** (power - octave) * _DIGITS) / _DIGITS * 2.0**octave


@kernel
def slot_of(h, nodes, basis, tables):
    """Return the slot with the factors of a step of length h, computed where it held another's."""
    rates, weights, masses = basis.rates, basis.weights, basis.masses
    slot = math.floor(_PER_OCTAVE * math.log2(h) + 0.5) % tables.lengths.shape[0]
    if tables.lengths[slot] == h:
        return slot
    column = np.empty(nodes.shape[0])
    for m in range(rates.shape[0]):
        for i in range(nodes.shape[0]):
            tables.reads[slot, m, i] = math.exp(-rates[m] * (h * nodes[i]))
        tables.keeps[slot, m] = math.exp(-rates[m] * h)
        exponential_legendre(rates[m] * h, nodes.shape[0], column)
        tables.moments[slot, :, m] = column
    for k in range(masses.shape[0]):
        own = weights[weights.shape[0] - masses.shape[0] + k]
        matrix = tables.local[slot, k]
        kernel_matrix(h, nodes, rates, own, masses[k], basis.transforms, matrix)
    tables.lengths[slot] = h
    return slot


@kernel
def kernel_matrix(h, nodes, rates, weights, mass, transforms, out):
    """out[i, j]: what value j contributes to the convolution with a kernel at node i of a step."""
    s = nodes.shape[0]
    column = np.empty(s)
    out[:] = 0.0
    for i in range(s):
        for m in range(rates.shape[0]):
            if weights[m] == 0.0:
                continue
            exponential_legendre(rates[m] * h * nodes[i], s, column)
            for k in range(s):
                share = weights[m] * h * nodes[i] * column[k]
                for j in range(s):
                    out[i, j] += share * transforms[i, k, j]
        out[i, i] += mass


@kernel
def read_modes(modes, reads, out):
    """out[c, i] = ``sum_m modes[c, m] reads[m, i]``."""
    # modes (d, M), reads (M, s), out (d, s)
    out[:] = 0.0
    for c in range(out.shape[0]):
        for m in range(reads.shape[0]):
            for i in range(out.shape[1]):
                out[c, i] += modes[c, m] * reads[m, i]


@kernel
def move_modes(h, keeps, moments, driven, idle, legendre, values, modes):
    """Let the modes decay over the step and take in the drivers' polynomials on it."""
    # keeps (M,), moments (s, M), driven (R, n_q, M), idle, modes (R, M), legendre (s, s): values
    # to coefficients, values (n_q, d, s); row c is driven by component c modulo d
    d, s = values.shape[1], values.shape[2]
    part = np.empty(keeps.shape[0])
    for c in range(modes.shape[0]):
        for m in range(keeps.shape[0]):
            modes[c, m] = modes[c, m] * keeps[m] + h * idle[c, m] * moments[0, m]
        for q in range(driven.shape[1]):
            if not np.any(driven[c, q]):
                continue
            part[:] = 0.0
            for k in range(s):
                coefficient = 0.0
                for j in range(s):
                    coefficient += legendre[k, j] * values[q, c % d, j]
                for m in range(keeps.shape[0]):
                    part[m] += coefficient * moments[k, m]
            for m in range(keeps.shape[0]):
                modes[c, m] += h * driven[c, q, m] * part[m]


@kernel
def combined_weights(equations, weights, own, driven, idle):
    """Set the weights with which modes take in integrands and, for the offsets, 1.

    driven (R, n_q, M) and idle (1 + k, R, M).

    Modes of orders that vary have none: they stand in rows behind the others, d for each driver.
    """
    # weights (n_a + n_k, M), own (M,): 1 for the modes of orders that vary
    terms, offsets, raw = equations.terms, equations.offsets, equations.raw
    driven[:] = 0.0
    idle[:] = 0.0
    d = driven.shape[0] // (2 + raw.shape[0])
    for b in range(raw.shape[0]):
        driven[(2 + b) * d : (3 + b) * d, raw[b]] = own
    for n in range(terms.shape[0]):
        c, q, k = terms[n].row, terms[n].integrand, terms[n].index
        for m in range(weights.shape[1] if k >= 0 else 0):
            share = terms[n].coefficient * weights[k, m]
            driven[c, q, m] += share
            for strand in range(offsets.shape[0]):
                idle[strand, c, m] -= share * offsets[strand, n]


@kernel
def exponential_legendre(z, n, out):
    """out[k] = ``int_0^1 exp(-z (1 - u)) P_k(2 u - 1) du``, k < n, for z >= 0.

    Scaled modified spherical Bessel functions of z / 2: upwards from the first two where none in
    use lies far beyond z / 2, else by their continued fraction, all of whose terms are positive.
    """
    x = 0.5 * z
    out[0] = 1.0 if z == 0.0 else -math.expm1(-z) / z
    if n == 1:
        return
    if x > 2.0 * n:
        out[1] = (0.5 * (1.0 + math.exp(-z)) - out[0]) / x
        for k in range(1, n - 1):
            out[k + 1] = out[k - 1] - (2 * k + 1) / x * out[k]
        return
    ratio = 0.0
    for k in range(n + 7 + int(2.5 * x), 0, -1):
        ratio = x / (2 * k + 1 + x * ratio)
        if k < n:
            out[k] = ratio
    for k in range(1, n):
        out[k] *= out[k - 1]
