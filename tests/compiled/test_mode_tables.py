"""The tables of exponential modes: lengths of steps, factors kept for each, and moments."""

import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.polynomial.legendre import leggauss, legvander

from hereditary.collocation.quadrature import radau_nodes, to_legendre
from hereditary.compiled.mode_tables import (
    SLOTS,
    advance_modes,
    empty_tables,
    exponential_legendre,
    find_slot,
    floor_to_grid,
)
from hereditary.compiled.structures import ExponentialBasis, ModeWeights

# Between neighbours of the grid lies a factor of 2**(1/8); its lengths are rounded up to 13 digits.
FACTOR, ROUNDED = 2 ** (1 / 8), 1 + 2.0**-12

# Lengths of steps


@given(st.floats(1e-290, 1e300))
@example(1.0)
@example(np.nextafter(1.0, 0.0))
@example(2.0 ** (1 / 8))
@example(1e-290)
def test_the_next_smaller_length_of_the_grid(h):
    found = floor_to_grid(h)
    assert h / FACTOR / (1 + 1e-12) < found <= h * ROUNDED
    assert floor_to_grid(found) == found
    mantissa, _ = math.frexp(found)
    assert mantissa * 2**13 == int(mantissa * 2**13)


def test_an_octave_holds_eight_lengths():
    found = {floor_to_grid(h) for h in np.linspace(1.0, 1.9999, 2000)}
    assert len(found) == 8
    ratios = np.array(sorted(found)) / FACTOR ** np.arange(8)
    assert np.all((ratios >= 1 - 1e-15) & (ratios <= ROUNDED))


@given(st.floats(1e-200, 1e200), st.integers(1, 10**6))
def test_many_equal_steps_end_where_one_long_one_does(h, n):
    h = floor_to_grid(h)
    assert np.cumsum(np.full(min(n, 5000), h))[-1] == min(n, 5000) * h
    assert Fraction(n * h) == n * Fraction(h)


@given(st.lists(st.floats(1e-6, 1.0), min_size=1, max_size=300))
def test_times_are_exact_sums_of_steps(lengths):
    t, exact = 0.0, Fraction(0)
    for h in map(floor_to_grid, lengths):
        t, exact = t + h, exact + Fraction(h)
    assert Fraction(t) == exact


# Factors of a length

RATES = np.array([0.0, 1e-12, 0.3, 7.0, 1e3, 1e9])
# A general kernel: weights of these rates, and a point mass at distance 0.
WEIGHTS, MASS = np.array([2.0, 0.0, 1.0, 0.5, 3.0, 0.0]), 0.25


def basis(s):
    """The rates with a fractional integral, which has no part in this, and the general kernel."""
    nodes = radau_nodes(s)
    cardinal = np.linalg.inv(legvander(2 * nodes - 1, s - 1))
    # values at the nodes, to values at c times the nodes, to coefficients on [0, c]
    check_points = [legvander(2 * c * nodes - 1, s - 1) @ cardinal for c in nodes]
    transforms = np.array([cardinal @ at for at in check_points])
    weights = np.array([np.ones(RATES.size), WEIGHTS])
    return ExponentialBasis(RATES, weights, np.array([MASS]), transforms)


def slot_for(h, tables):
    s = tables.to_nodes.shape[2]
    return find_slot(h, radau_nodes(s).copy(), basis(s), tables)


def check_slot(h, tables):
    """The slot holds the factors of this length."""
    nodes, slot = radau_nodes(tables.to_nodes.shape[2]), slot_for(h, tables)
    lengths, to_nodes, to_end, moments, _ = tables
    assert lengths[slot] == h
    decays = np.exp(-np.outer(RATES, h * nodes))  # 0 where they nearly underflow
    np.testing.assert_allclose(to_nodes[slot], decays, rtol=1e-15, atol=1e-304)
    np.testing.assert_allclose(to_end[slot], np.exp(-RATES * h), rtol=1e-15, atol=1e-304)
    column = np.empty(nodes.size)
    for m, rate in enumerate(RATES):
        exponential_legendre(rate * h, nodes.size, column)
        assert np.array_equal(moments[slot, :, m], column)
    return slot


@given(st.lists(st.floats(1e-9, 1e3), min_size=1, max_size=8), st.integers(2, 12))
def test_a_slot_holds_the_factors_of_its_length(lengths, s):
    """Whatever came before, on the grid or not, as the last steps before a stop are."""
    tables = empty_tables(RATES.size, s, 1)
    for h in lengths:
        check_slot(floor_to_grid(h), tables)
        check_slot(h, tables)


def test_lengths_that_share_a_slot_take_turns():
    tables = empty_tables(RATES.size, 6, 1)
    one, other = 1.0, 2.0 ** -(SLOTS / 8)
    slot = check_slot(one, tables)
    assert check_slot(other, tables) == slot
    assert check_slot(one, tables) == slot
    kept = tables[3][slot].copy()
    tables[3][slot, 0, 0] = -7.0  # not computed again while the length is the same
    assert slot_for(one, tables) == slot
    assert tables[3][slot, 0, 0] == -7.0
    tables[3][slot, 0, 0] = kept[0, 0]
    neighbours = {check_slot(floor_to_grid(1.01 * FACTOR**k), tables) for k in range(SLOTS)}
    assert len(neighbours) == SLOTS


@given(st.floats(1e-6, 10.0), st.integers(2, 8), st.integers(0, 2**32 - 1))
def test_matrices_of_a_general_kernel(h, s, seed):
    """Its convolution with a polynomial on the step, at the nodes, by Gauss' rule."""
    tables, nodes = empty_tables(RATES.size, s, 1), radau_nodes(s)
    matrix = tables[4][slot_for(h, tables), 0]
    coefficients = np.random.default_rng(seed).normal(size=s)
    values = legvander(2 * nodes - 1, s - 1) @ coefficients
    x, weights = leggauss(60)
    expected = MASS * values
    for i, c in enumerate(nodes):
        # the factor next to the node by pieces, for it may be steep
        ends = c * np.concatenate([[0.0], 1 - 0.5 ** np.arange(1, 50), [1.0]])
        for start, width in zip(ends[:-1], np.diff(ends), strict=True):
            u = start + width * (1 + x) / 2
            kernel = np.exp(-np.outer(h * (c - u), RATES)) @ WEIGHTS
            polynomial = legvander(2 * u - 1, s - 1) @ coefficients
            expected[i] += h * width / 2 * (weights * kernel) @ polynomial
    np.testing.assert_allclose(matrix @ values, expected, atol=1e-11)


def mode_weights(integrands, offsets, s):
    """Weights of the modes of one column, with room for a step of s nodes."""
    used = np.any(integrands, axis=2).astype(int)
    room = np.full(integrands.shape[2], np.nan), np.full(s, np.nan)
    return ModeWeights(integrands, used, offsets[None], *room)


def test_a_mode_of_a_polynomial_is_its_integral():
    """``int_0^h exp(-rate (h - u)) u**2 du``, whatever the rate."""
    h, s = 0.5, 4
    tables = empty_tables(RATES.size, s, 1)
    slot = slot_for(h, tables)
    values, input_weights = np.zeros((3, 1, s)), np.zeros((1, 3, RATES.size))
    values[2, 0], input_weights[0, 2] = (h * radau_nodes(s)) ** 2, 1.0
    modes, offset_weights = np.zeros((2, 1, RATES.size))
    _, _, to_end, moments, _ = (table[slot] for table in tables)
    absorbed = mode_weights(input_weights, offset_weights, s), 0, np.arange(1)
    advance_modes(h, to_end, moments, *absorbed, to_legendre(s).copy(), values, modes)
    with mpmath.workdps(60):
        exact = [
            h**3 / 3 if r == 0 else (h * h - 2 * h / r + 2 / r**2 * (1 - mpmath.exp(-r * h))) / r
            for r in map(mpmath.mpf, RATES.tolist())
        ]
    np.testing.assert_allclose(modes[0], np.array(exact, dtype=float), rtol=1e-13)


# Moments

# Around the changes of method, z = 4 n and the smallest arguments, and everywhere else.
ARGUMENTS = [0.0, 5e-324, 1e-300, 1e-20, 1e-8, 1e-3, 0.1, 1.0, 5.0, 15.9, 16.1, 20.0, 25.0, 31.9]
ARGUMENTS += [32.1, 34.0, 47.9, 48.1, 50.0, 100.0, 745.0, 1e3, 1e4, 1e6, 1e12]


def moments(z, n=12):
    out = np.full(n, np.nan)
    exponential_legendre(z, n, out)
    return out


def exact_moments(z, n=12):
    """``exp(-x) i_k(x)``, x = z/2, with modified spherical Bessel functions in 60 digits."""
    if z == 0:
        return np.eye(n)[0]
    with mpmath.workdps(60):
        x = mpmath.mpf(z) / 2
        factor = mpmath.sqrt(mpmath.pi / (2 * x)) * mpmath.exp(-x)
        half = mpmath.mpf(1) / 2
        return np.array([float(factor * mpmath.besseli(k + half, x)) for k in range(n)])


@pytest.mark.parametrize("n", [2, 4, 6, 8, 12])
@pytest.mark.parametrize("z", ARGUMENTS)
def test_moments_of_legendre_polynomials(z, n):
    """The high ones are tiny for small z, and no digit of them is lost; some are of the twelfth."""
    rtol = 5e-15 if n <= 8 else 5e-14
    np.testing.assert_allclose(moments(z, n), exact_moments(z, n), rtol=rtol, atol=1e-300)


@given(st.floats(0, 1e4))
def test_moments_of_any_argument(z):
    np.testing.assert_allclose(moments(z, 8), exact_moments(z, 8), rtol=5e-15, atol=1e-300)


@given(st.floats(0, 1e6), st.integers(1, 12))
def test_moments_are_those_of_exponentials(z, n):
    """For any z, against Gauss' rule where the exponential is not steep; fewer are the same."""
    found = moments(z)
    np.testing.assert_allclose(moments(z, n), found[:n], rtol=5e-14)
    assert np.all((found >= 0) & (found <= found[0]))
    if z < 50:
        x, weights = np.polynomial.legendre.leggauss(60)
        values = np.polynomial.legendre.legvander(x, 11)
        expected = 0.5 * (weights * np.exp(-z * (1 - x) / 2)) @ values
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize("z", [1e-9, 0.3, 30.0, 1e5])
def test_moments_obey_the_recurrence_of_bessel_functions(z):
    """``i_(k-1)(x) - i_(k+1)(x) = (2 k + 1) / x i_k(x)``."""
    m, x, k = moments(z), z / 2, np.arange(1, 11)
    np.testing.assert_allclose(m[:-2] - m[2:], (2 * k + 1) / x * m[1:-1], rtol=1e-12, atol=1e-15)
