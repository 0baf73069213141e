"""Exponential modes of a collocation step: reading, advancing, and tables of their factors.

A step reads the modes at its nodes and advances them to its end, by factors that depend on the
step's length alone. Lengths lie on a grid (`floor_to_grid`), so few different lengths occur in a
run. Each index of a table has the factors of one length. The order of modes is that of
kernels/mode_bank.py.

Letters of shapes: d components, R rows of the equations, s nodes, M modes, n_a fractional
integrals, n_k kernels, k tangents. There are n_q integrands: f, p and y, and p' if needed. `m` is
an `AdaptiveWork`. A column is an index of the orbit, 0, or a tangent, 1 to k.
"""

import math

import numpy as np

from ..compiled.jit import inner, plug_in
from ..compiled.linalg import add_rows, clear, clear_matrix, multiply_modes, put
from ..support.pool import Pool
from .operators import first_of_kind, number_of

# Number of step lengths between two powers of 2: lengths are 2**(n / _PER_OCTAVE), rounded up.
_PER_OCTAVE = 8
# The same for first steps. Their error is of high order in the length, so on a coarse grid the unit
# of time would decide which of them are rejected.
FIRST_PER_OCTAVE = 64
# A step length in [2**k, 2**(k + 1)) is a multiple of 2**k over this number, so sums of lengths are
# exact. Rounding errors of equal steps would accumulate to a drift of time.
_LENGTHS_PER_BINADE = 2.0**12
# Number of step lengths of a table; step lengths whose ratio is a power of 2**(N_TABLE_LENGTHS /
# _PER_OCTAVE) share an index.
N_TABLE_LENGTHS = 64
# Largest number of tables that remain in storage for later runs. Each table has the factors of up
# to 64 step lengths, a few hundred kB.
_TABLES_MAX = 8
# Argument z from which exp(-z) is replaced by 0.
_EXP_UNDERFLOW = 700.0
# Argument x below which, up to rounding, the scaled Bessel functions of orders 0, 1 and higher are
# 1 - x, x / 3 and 0.
_SMALL_BESSEL_ARGUMENT = 1e-8
# First value of the downward recurrence of the scaled Bessel functions. The recurrence is accurate
# for arguments from 1e-8 on.
_SEED = 1e-200 + 0j


@inner
def floor_to_grid(h):
    """Return the largest step length on the grid that does not exceed h, up to rounding."""
    return floor_to(h, _PER_OCTAVE)


@inner
def floor_to(h, per_octave):
    """Return the largest length of a grid with so many in an octave that does not exceed h."""
    power = math.floor(per_octave * math.log2(h)) / per_octave
    octave = math.floor(power)
    return (
        math.ceil(2.0 ** (power - octave) * _LENGTHS_PER_BINADE) / _LENGTHS_PER_BINADE * 2.0**octave
    )


@inner
def place_of(h, lengths, per_octave):
    """Return the index of a length in an array of `lengths`, on a grid with so many an octave."""
    return math.floor(per_octave * math.log2(h) + 0.5) % lengths.shape[0]


@inner
def find_factors(march, h):
    """Return the index of the factors for a step of length h; compute missing factors."""
    lengths = march.work.tables.lengths
    table_index = place_of(h, lengths, _PER_OCTAVE)
    if lengths[table_index] != h:
        lengths[table_index] = 0.0
        fill_factors(march.work, h, table_index)
        if march.work.basis.masses.shape[0] > 0:
            march.fill_kernels(march.work, h, table_index)
        lengths[table_index] = h
    return table_index


@inner
def fill_factors(m, h, table_index):
    """Compute the factors of modes with real rates for a step of length h."""
    rates, nodes, tables, real = m.basis.rates, m.rule.nodes, m.tables, m.weights.coefficients
    s = nodes.shape[0]
    to_nodes = tables.to_nodes[table_index]
    to_end, moments = tables.to_end[table_index], tables.moments[table_index]
    for e in range(rates.shape[0]):
        for i in range(s):
            to_nodes[e, i] = decay(rates[e] * (h * nodes[i]))
        to_end[e] = decay(rates[e] * h)
        exponential_legendre(rates[e] * h, s, real)
        put(real, moments[:, e])


@plug_in
def fill_kernels(m, h, table_index):
    """Compute the factors of complex modes and the convolutions with general kernels."""
    basis, nodes, tables, s = m.basis, m.rule.nodes, m.tables, m.rule.nodes.shape[0]
    to_nodes = tables.to_nodes[table_index]
    to_end, moments = tables.to_end[table_index], tables.moments[table_index]
    pairs, turned, n_rates = basis.pairs, np.empty(s, dtype=np.complex128), basis.rates.shape[0]
    for n in range(pairs.shape[0]):
        e, other = n_rates + n, n_rates + pairs.shape[0] + n
        for i in range(s):
            factor = turning_decay(pairs[n] * (h * nodes[i]))
            to_nodes[e, i], to_nodes[other, i] = factor.real, -factor.imag
        end = turning_decay(pairs[n] * h)
        to_end[e], to_end[other] = end.real, end.imag
        turning_legendre(pairs[n] * h, s, turned)
        put(turned.real, moments[:, e])
        put(turned.imag, moments[:, other])
    n_kernels = basis.masses.shape[0]
    first = basis.weights.shape[0] - n_kernels
    for k in range(n_kernels):
        weights, matrix = basis.weights[first + k], tables.local[table_index, k]
        set_kernel_matrix(h, nodes, basis, weights, basis.masses[k], matrix)


@plug_in
def fill_nothing(m, h, table_index):
    """Do nothing, in place of `fill_kernels`, if there is no general kernel."""


@inner
def decay(z):
    """Return exp(-z), or 0 if exp(-z) would underflow; an underflow takes ten times as long."""
    return math.exp(-z) if z < _EXP_UNDERFLOW else 0.0


@inner
def turning_decay(z):
    """Return exp(-z) for complex z."""
    return decay(z.real) * complex(math.cos(z.imag), -math.sin(z.imag))


@inner(allocates=True)
def set_kernel_matrix(h, nodes, basis, weights, mass, out):
    """Set `out` (s, s) to the matrix of a kernel's convolution over one step of length h."""
    # out[i, j]: weight of node j at node i. The kernel is the sum of exponentials of basis with
    # weights (M,), and a point mass at time lag 0.
    rates, pairs, s = basis.rates, basis.pairs, nodes.shape[0]
    real, turned, total = np.empty(s), np.empty(s, dtype=np.complex128), np.empty(s)
    clear_matrix(out)
    for i in range(s):
        t = h * nodes[i]
        clear(total)
        for m in range(rates.shape[0]):
            if weights[m] != 0.0:
                exponential_legendre(rates[m] * t, s, real)
                for k in range(s):
                    total[k] += weights[m] * t * real[k]
        for n in range(pairs.shape[0]):
            m = rates.shape[0] + n
            weight = complex(weights[m], weights[m + pairs.shape[0]])
            if weight != 0.0:
                turning_legendre(pairs[n] * t, s, turned)
                for k in range(s):
                    total[k] += (weight * t * turned[k]).real
        add_rows(out[i], total, basis.transforms[i])
        out[i, i] += mass


@inner
def read_modes(modes, to_nodes, out):
    """Set out[c, i] = ``sum_m modes[c, m] to_nodes[m, i]``, the history of row c at node i."""
    # modes (R, M); to_nodes (M, s): decay of the modes to the nodes; out (R, s)
    clear_matrix(out)
    for c in range(out.shape[0]):
        add_rows(out[c], modes[c], to_nodes)


@plug_in
def read_varying(m, table_index, column):
    """Add the history of terms with varying orders to `m.workspace.base` of one column."""
    # their modes have no weights; those of the order at each node are in m.varying
    # modes (R, M); to_nodes (M, s): decay of the modes to the nodes; out (R, s)
    modes = m.orbit.modes[column]
    to_nodes, out = m.tables.to_nodes[table_index], m.workspace.base[column]
    terms, weights, unweighted = m.equations.terms, m.varying.weights, m.equations.unweighted
    d, first = m.equations.above_one.shape[0], 1 - weights.shape[0]
    for n in range(terms.shape[0]):  # varying orders have the last indices
        first = max(first, terms[n].index + 1 - weights.shape[0])
    for n in range(terms.shape[0]):
        k = terms[n].index - first
        if k < 0:
            continue
        c, q = terms[n].row, terms[n].integrand
        for b in range(unweighted.shape[0]):
            if unweighted[b] != q:
                continue
            for e in range(to_nodes.shape[0]):
                held = terms[n].coefficient * modes[(2 + b) * d + c % d, e]
                for i in range(to_nodes.shape[1]):
                    out[c, i] += held * weights[k, e, i] * to_nodes[e, i]


@plug_in
def read_nothing(m, table_index, column):
    """Do nothing, in place of `read_varying`, if no order varies."""


@inner
def advance_modes(m, h, table_index, column):
    """Advance the modes of one column over a step of length h."""
    # They decay, and integrals of the integrands' polynomials are added. Row c has integrands of
    # component c modulo d.
    # to_end (M,): decay; moments (s, M): integrals of Legendre polynomials; values (n_q, d, s):
    # integrands at the nodes; modes (R, M)
    values, modes = m.orbit.last[column], m.orbit.modes[column]
    to_end = m.tables.to_end[table_index]
    moments, legendre = m.tables.moments[table_index], m.rule.legendre
    kinds, weights, offsets, used = m.equations.kinds, m.weights, m.weights.offsets, m.weights.used
    integrands, part, coefficients = weights.integrands, weights.part, weights.coefficients
    d, s, n_kinds, n_real = values.shape[1], values.shape[2], number_of(kinds), m.basis.rates.size
    for c in range(modes.shape[0]):
        own, kind = modes[c], c // d * n_kinds + kinds[c % d]
        multiply_modes(own, to_end, n_real, own)
        if offsets.shape[1] > 0:
            multiply_modes(moments[0], offsets[column, c], n_real, part)
            for n in range(part.shape[0]):
                own[n] += h * part[n]
        for q in range(values.shape[0]):
            if used[kind, q] == 0:
                continue
            nodal, of_integrand = values[q, c % d], integrands[kind, q]
            for k in range(s):
                total = 0.0
                for j in range(s):
                    total += legendre[k, j] * nodal[j]
                coefficients[k] = h * total
            clear(part)
            add_rows(part, coefficients, moments)
            multiply_modes(part, of_integrand, n_real, part)
            for n in range(part.shape[0]):
                own[n] += part[n]


@inner
def set_mode_weights(equations, weights, of_varying, found):
    """Set the `ModeWeights` found: coefficients of the terms times weights of their kernels."""
    # modes of varying orders have weight 1, in rows after the others, one for each component and
    # integrand
    # weights (n_a + n_k, M); of_varying (M,): 1 for the modes of varying orders
    input_weights, offset_weights, used = found.integrands, found.offsets, found.used
    terms, offsets, unweighted = equations.terms, equations.offsets, equations.unweighted
    for row in range(input_weights.shape[0]):
        clear_matrix(input_weights[row])
    for column in range(offset_weights.shape[0]):
        clear_matrix(offset_weights[column])
    d, n_kinds = equations.kinds.shape[0], number_of(equations.kinds)
    for b in range(unweighted.shape[0]):
        for row in range((2 + b) * n_kinds, (3 + b) * n_kinds):
            put(of_varying, input_weights[row, unweighted[b]])
    for n in range(terms.shape[0]):
        c, q, k = terms[n].row, terms[n].integrand, terms[n].index
        kind = equations.kinds[c % d]
        for m in range(weights.shape[1] if k >= 0 else 0):
            weight = terms[n].coefficient * weights[k, m]
            if first_of_kind(equations.kinds, kind) == c % d:
                input_weights[c // d * n_kinds + kind, q, m] += weight
            for column in range(offsets.shape[0] if offset_weights.shape[1] > 0 else 0):
                offset_weights[column, c, m] -= weight * offsets[column, n]
    for kind in range(used.shape[0]):
        for q in range(used.shape[1]):
            used[kind, q] = 0
            for m in range(weights.shape[1]):
                if input_weights[kind, q, m] != 0.0:
                    used[kind, q] = 1


@inner
def exponential_legendre(z, n, out):
    """Set out[k] = ``int_0^1 exp(-z (1 - u)) P_k(2 u - 1) du``, k < n, for z >= 0."""
    # P_k is the Legendre polynomial: scaled modified spherical Bessel functions of z / 2. For n
    # small against z / 2 by upward recurrence from k = 0 and 1, else their ratios by a continued
    # fraction with positive terms.
    x = 0.5 * z
    out[0] = 1.0 if z == 0.0 else -math.expm1(-z) / z
    if n == 1:
        return
    if x > 2.0 * n:
        out[1] = (0.5 * (1.0 + decay(z)) - out[0]) / x
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


@inner
def turning_legendre(z, n, out):
    """Set out[k] to the integrals of `exponential_legendre`, k < n, for complex z and n > 1."""
    # For n small against z / 2 by upward recurrence. Else by downward recurrence up to a factor,
    # which sum_k (2 k + 1) out[k] = 1 determines.
    x = 0.5 * z
    if abs(x) > 2.0 * n:
        end = turning_decay(z)
        out[0] = (1.0 - end) / z
        out[1] = (0.5 * (1.0 + end) - out[0]) / x
        for k in range(1, n - 1):
            out[k + 1] = out[k - 1] - (2 * k + 1) / x * out[k]
        return
    out[:] = 0.0
    if abs(x) < _SMALL_BESSEL_ARGUMENT:
        out[0], out[1] = 1.0 - x, x / 3.0
        return
    above, value, total = 0j, _SEED, 0j
    for k in range(20 + int(2.5 * abs(x)), 0, -1):
        total += (2 * k + 1) * value
        if k < n:
            out[k] = value
        above, value = value, above + (2 * k + 1) / x * value
    out[0] = value
    for k in range(n):
        out[k] /= total + value


# Tables that no march uses at present. Factors depend only on the step length, the nodes, the rates
# and the kernels, which are the key of a table. So results do not depend on which lengths a table
# contains already.
spare_tables = Pool(_TABLES_MAX)
