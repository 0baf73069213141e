"""The functions of the first step: sums of powers kept to rounding, integrated and differentiated.

A power t**e counts where e is a sum of generators; t = 0 and the tiniest t are always among the
points, for there the solution of a stiff equation of small order has most of its changes.
"""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import erfcx, gamma, rgamma

from hereditary.collocation.power_basis import (
    LEFT_OUT,
    PowerBasis,
    choose_map_rates,
    graded_rule,
    power_basis,
)

GENERATORS = [
    (1.0,),
    (0.5,),
    (0.3, 1.0),
    (0.7, 1.0),
    (0.8, 1.0),
    (0.999, 1.0),
    (0.6, 0.7),
    (0.6, 0.7, 1.0),
    (0.35, 0.4, 0.9, 1.0),
    (0.02, 1.0),
    (0.024, 0.7173, 1.0),
    (1e-3, 1.0),
    (1e-6, 1.0),
    (1e-6, 0.5),
    (1e-3, 0.999),
    (1e-5, 0.99999, 1.0),
    (1e-9, 1e-4, 0.057, 1.0),
]
POINTS = np.concatenate([[0.0, 1e-300], np.geomspace(1e-40, 1, 300), np.linspace(0, 1, 301)])
# Between nearly dependent functions roundings are enlarged by some hundred.
ROUNDING = 3e-12


# 1 is not a multiple of it: then it would be no generator (collocation/equations.py).
APART = st.floats(0.12, 0.95).filter(lambda g: abs(1 / g - round(1 / g)) > 1e-8)


def small_sums(generators, n=12):
    """The n smallest sums of generators, 0 among them; tiny ones count for more than they are."""
    sums = {(0.0, 0.0)}
    for g in generators:
        steps = [(k * max(g, 0.12), k * g) for k in range(2 * n)]
        sums = {(round(a + c, 12), round(b + d, 12)) for a, b in sums for c, d in steps}
    return [e for _, e in sorted(sums)[:n]]


def powers(exponent, t):
    return np.asarray(t) ** exponent if exponent else np.ones(np.shape(t))


def at_nodes(basis, exponent):
    """t**exponent at the nodes, the first one 0, also where these are too small for a float."""
    return at_logs(basis.logs[: basis.nodes.size], exponent)


def at_between(basis, exponent):
    """The same between the nodes."""
    return at_logs(basis.logs[basis.nodes.size :], exponent)


def at_logs(logs, exponent):
    return np.exp(exponent * logs) if exponent else np.ones(logs.size)


@pytest.mark.parametrize("generators", GENERATORS, ids=repr)
def test_nodes(generators):
    """Ascending from 0 to 1, and other points between them."""
    basis = power_basis(generators)
    assert np.all(np.diff(basis.nodes) >= 0)
    assert np.all((basis.nodes >= 0) & (basis.nodes <= 1))
    assert (basis.nodes[0], basis.nodes[-1]) == (0.0, 1.0)
    assert basis.nodes.size - 1 <= basis.between.size <= basis.nodes.size + 4
    assert not np.isin(basis.between[basis.between > 1e-300], basis.nodes).any()


@pytest.mark.parametrize("generators", GENERATORS, ids=repr)
def test_powers_are_interpolated(generators):
    basis = power_basis(generators)
    for e in small_sums(generators):
        values = at_nodes(basis, e)
        assert np.abs(basis.interpolate(values, POINTS) - powers(e, POINTS)).max() < ROUNDING
        between = basis.interpolate_between(values)
        assert np.abs(between - at_between(basis, e)).max() < ROUNDING


NEAR_ONE = [(0.884, 1.0), (1.0, 1.06), (0.884, 1.0, 1.4), (0.8, 0.83, 1.0)]


@pytest.mark.parametrize("generators", GENERATORS + NEAR_ONE, ids=repr)
def test_roundings_of_values_hardly_grow_anywhere(generators):
    """Without a node at t = 0 they grew by thousands next to it."""
    basis = power_basis(generators)
    grown = np.abs(basis.at(POINTS)).sum(axis=1)
    assert 1 <= grown.max() < (5 if len(generators) == 1 else 200)


@pytest.mark.parametrize("generators", [(1.0,), (0.5,), (0.7, 1.0), (0.8, 1.0), (0.6, 0.7)])
def test_other_powers_are_not(generators):
    """The two-sided half: what is no sum of generators shows as an error, near 0 above all."""
    basis = power_basis(generators)
    for e in (0.1, 0.437):
        off = basis.interpolate(powers(e, basis.nodes), POINTS) - powers(e, POINTS)
        assert np.abs(off).max() > 1e-4
        off = basis.interpolate_between(powers(e, basis.nodes)) - powers(e, basis.between)
        assert np.abs(off).max() > 1e-6


@settings(max_examples=20)
@given(APART, st.integers(0, 11), st.floats(-10, 10), st.floats(-10, 10))
def test_sums_of_powers_for_any_generator(g, number, first, second):
    basis, e = PowerBasis((g, 1.0)), small_sums((g, 1.0))[number]
    values, exact = (first * powers(g, t) + second * powers(e, t) for t in (basis.nodes, POINTS))
    assert np.abs(basis.interpolate(values, POINTS) - exact).max() < 20 * ROUNDING


@given(st.sampled_from(GENERATORS), st.floats(-1e6, 1e6))
def test_constants_stay_as_they_are(generators, constant):
    """Bit for bit: a solution at rest stays at rest."""
    basis = power_basis(generators)
    values = np.full((2, basis.nodes.size), constant)
    assert np.all(basis.interpolate(values, POINTS) == constant)
    assert np.all(basis.interpolate_between(values) == constant)


@pytest.mark.parametrize("generators", GENERATORS, ids=repr)
def test_the_end_of_a_step_is_as_exact_as_its_values(generators):
    basis = power_basis(generators)
    for e in small_sums(generators):
        end = basis.interpolate(3.0 * at_nodes(basis, e), np.array([1.0]))
        assert end == pytest.approx(3.0, abs=1e-13)


@pytest.mark.parametrize("orders", [(1e-6, 1.0), (0.02, 0.5), (0.3, 0.999999, 1.0)], ids=repr)
@pytest.mark.parametrize("generators", GENERATORS, ids=repr)
def test_integrals_of_powers(generators, orders):
    """``J**a t**e = Gamma(e+1) / Gamma(e+a+1) t**(e+a)``, at the nodes and between."""
    basis = power_basis(generators)
    integrals = basis.integrals(orders)
    n = basis.nodes.size
    assert integrals.shape == (len(orders), n + basis.between.size, n)
    for a, integral in zip(orders, integrals, strict=True):
        for e in small_sums(generators):
            risen = np.concatenate([at_nodes(basis, e + a), at_between(basis, e + a)])
            exact = gamma(e + 1) * rgamma(e + a + 1) * risen
            off = np.abs(integral @ at_nodes(basis, e) - exact)
            assert off.max() < (ROUNDING if a < 0.1 else 1e-12)


@pytest.mark.parametrize("generators", GENERATORS, ids=repr)
def test_slopes_of_powers(generators):
    """``e t**(e-1)``, relative to what a change of 1 over t would be."""
    basis = power_basis(generators)
    t = np.geomspace(1e-6, 1, 100)
    for e in small_sums(generators):
        off = np.abs(basis.slopes(t) @ at_nodes(basis, e) - e * t ** (e - 1))
        assert (t * off).max() < 3 * ROUNDING


def test_a_solution_of_order_one_half():
    """y = erfcx(sqrt(t)): its values, its slope y - 1 / sqrt(pi t), and ``J**0.5 y = 1 - y``."""
    basis, t = power_basis((0.5,)), np.geomspace(1e-12, 1, 200)
    values = erfcx(np.sqrt(basis.nodes))
    np.testing.assert_allclose(basis.interpolate(values, t), erfcx(np.sqrt(t)), atol=3e-14)
    exact = erfcx(np.sqrt(t)) - 1 / np.sqrt(np.pi * t)
    np.testing.assert_allclose(t * (basis.slopes(t) @ values), t * exact, atol=3e-12)
    ends = np.concatenate([basis.nodes, basis.between])
    integral = basis.integrals((0.5,))[0] @ values
    np.testing.assert_allclose(integral, 1 - erfcx(np.sqrt(ends)), atol=3e-14)


def test_slopes_at_0_are_infinite_for_powers_below_1_alone():
    smooth, rough = power_basis((1.0,)), power_basis((0.5,))
    assert smooth.slopes(np.zeros(1)) @ smooth.nodes == pytest.approx(1.0, abs=1e-11)
    with np.errstate(invalid="ignore"):
        assert not np.isfinite(rough.slopes(np.zeros(1)) @ np.sqrt(rough.nodes)).all()


def test_a_basis_is_made_once():
    assert power_basis((0.5, 0.7)) is power_basis((0.5, 0.7))


@given(st.floats(-0.9, 2), st.floats(-0.9, 2))
def test_the_graded_rule_is_for_functions_singular_at_both_ends(p, q):
    """``int u**p (1-u)**q du``, the stretches left out next to both ends in closed form."""
    u, v, weights = graded_rule()
    np.testing.assert_allclose(u + v, 1, atol=1e-15)
    ends = LEFT_OUT ** (p + 1) / (p + 1) + LEFT_OUT ** (q + 1) / (q + 1)
    exact = gamma(p + 1) * gamma(q + 1) * rgamma(p + q + 2)
    assert weights @ (u**p * v**q) + ends == pytest.approx(exact, rel=1e-12)


# Bent functions

BENT = [((0.1, 1.0), 16.0), ((0.02, 1.0), 4.0), ((0.02, 1.0), 4.0**8), ((1e-3, 0.7, 1.0), 1024.0)]
BENT += [((1e-6, 1.0), 64.0), ((0.07, 0.9), 4.0**10)]


def mapped(t, g, c):
    """(1 + c) t**g / (1 + c t**g), t being a number or an array."""
    return (1 + c) * t**g / (1 + c * t**g)


def at_mapped_nodes(basis, g, c):
    u = np.exp(g * basis.logs[: basis.nodes.size])
    return (1 + c) * u / (1 + c * u)


@pytest.mark.parametrize(("generators", "c"), BENT, ids=repr)
def test_mapped_functions_are_polynomials_of_the_rational_map(generators, c):
    """Also near 1 / c, where a solution that they are for has its course, and times the others."""
    basis, g = power_basis(generators, (c,)), generators[0]
    x, w = at_mapped_nodes(basis, g, c), mapped(POINTS, g, c)
    for degree in (1, 2, 5):
        off = np.abs(basis.interpolate(x**degree, POINTS) - w**degree)
        assert off.max() < 10 * ROUNDING
    product = basis.interpolate(x * at_nodes(basis, generators[1]), POINTS)
    assert np.abs(product - w * powers(generators[1], POINTS)).max() < 10 * ROUNDING


@pytest.mark.parametrize(("generators", "c"), BENT[:3], ids=repr)
def test_mapped_functions_are_no_others(generators, c):
    """The other half: a far greater rate than theirs shows, and so do powers for a great one.

    Where t**g is about 1 / c; for the nodes then lie there.
    """
    basis, g = power_basis(generators, (c,)), generators[0]
    t = np.exp(np.linspace(-1e3, 0, 4001) / g / 50)
    greater = 1e4 * c
    off = basis.interpolate(at_mapped_nodes(basis, g, greater), t) - mapped(t, g, greater)
    assert np.abs(off).max() > 1e-5
    plain = PowerBasis(generators)
    off = plain.interpolate(at_mapped_nodes(plain, g, 4.0**8), t) - mapped(t, g, 4.0**8)
    assert np.abs(off).max() > 1e-3


@pytest.mark.parametrize("a", [0.02, 0.5, 1.0])
@pytest.mark.parametrize(("generators", "c"), BENT, ids=repr)
def test_integrals_of_mapped_functions(generators, c, a):
    """``J**a w = t**a / Gamma(a+1) int_0^1 w(t (1 - s**(1/a))) ds``, by mpmath's quadrature."""
    basis, g = power_basis(generators, (c,)), generators[0]
    integral = basis.integrals((a, 1.0))[0] @ at_mapped_nodes(basis, g, c)
    ends = np.concatenate([basis.nodes, basis.between])
    with mpmath.workdps(30):
        pieces = [0, *(1 - mpmath.mpf(2) ** -k for k in range(1, 60, 4)), 1]
        for i in [-1, *np.flatnonzero(ends > 1e-200)[:: max(1, ends.size // 4)]]:
            t = mpmath.mpf(float(ends[i]))

            def inner(s, t=t):
                return mapped(t * (1 - s ** (1 / mpmath.mpf(a))), mpmath.mpf(g), c) if s < 1 else 0

            exact = t**a * mpmath.rgamma(1 + mpmath.mpf(a)) * mpmath.quad(inner, pieces)
            assert integral[i] == pytest.approx(float(exact), abs=10 * ROUNDING)


@pytest.mark.parametrize(("generators", "c"), BENT, ids=repr)
def test_slopes_of_mapped_functions(generators, c):
    """In closed form, and of any function of the basis by differences of log(t)."""
    basis, g, t = power_basis(generators, (c,)), generators[0], np.geomspace(1e-6, 1, 100)
    exact = g * mapped(t, g, c) / (1 + c * t**g)
    slopes = t * (basis.slopes(t) @ at_mapped_nodes(basis, g, c))
    assert np.abs(slopes - exact).max() < 10 * ROUNDING
    step, t = 1e-4, t[t < 0.99]
    values = np.cos(3 * at_mapped_nodes(basis, g, c)) + basis.nodes ** generators[-1]
    after, before = (basis.interpolate(values, t * np.exp(s)) for s in (step, -step))
    slopes = t * (basis.slopes(t) @ values)
    np.testing.assert_allclose(slopes, (after - before) / (2 * step), atol=3e-7)


def test_which_solutions_get_a_rational_map():
    """Solutions of a tiny order; rates of maps follow those of decay within half an octave."""
    assert choose_map_rates((0.5, 1.0), [1e6]) == choose_map_rates((0.02, 1.0), [0.09]) == ()
    for size in (0.2, 2.0, 10.0, 777.0, 1e6, 1e12):
        (map_rate,) = choose_map_rates((0.02, 1.0), [size])
        assert 0.7 * size < map_rate < 1.5 * size
        assert np.log2(map_rate) % 1 == 0
    assert choose_map_rates((0.02, 1.0), [1.0, 1e3, 0.0, 1.1e3]) == (1024.0, 1.0)
    assert len(choose_map_rates((0.02, 1.0), 10.0 ** np.arange(9))) == 3


@pytest.mark.parametrize("generators", [(0.02, 1.0), (1e-3, 0.6, 1.0)], ids=repr)
def test_several_maps(generators):
    """Sums of functions of each mapped power, and their integrals beside those of each alone."""
    map_rates, g = (4.0**8, 64.0), generators[0]
    both = power_basis(generators, map_rates)
    values = sum(at_mapped_nodes(both, g, c) ** 3 for c in map_rates)
    expected = sum(mapped(POINTS, g, c) ** 3 for c in map_rates)
    assert np.abs(both.interpolate(values, POINTS) - expected).max() < 10 * ROUNDING
    own = sum(
        (basis := power_basis(generators, (c,))).integrals((0.3, 1.0))[:, basis.nodes.size - 1]
        @ at_mapped_nodes(basis, g, c) ** 3
        for c in map_rates
    )
    ends = both.integrals((0.3, 1.0))[:, both.nodes.size - 1] @ values
    np.testing.assert_allclose(ends, own, rtol=100 * ROUNDING)


@pytest.mark.parametrize("c", [4.0**8, 4.0**10])
def test_what_fades_is_known_as_well_late_as_early(c):
    """c / (1 + c t**g), which falls from c to 1: its rounding falls with it, integrated as well."""
    g = 0.05
    basis = power_basis((g, 1.0), (c,))
    values = c / (1 + c * at_nodes(basis, g))
    t = np.geomspace(1e-6, 1, 50)
    np.testing.assert_allclose(basis.at(t) @ values, c / (1 + c * t**g), rtol=1e-11)
    # where c t**g is large already: int_0^1 of it
    with mpmath.workdps(30):
        exact = mpmath.quad(lambda s: c / (1 + c * s**g), [0, 1e-30, 1e-20, 1e-10, 1e-5, 1e-2, 1])
    end = basis.integrals((1.0,))[0, basis.nodes.size - 1] @ values
    assert end == pytest.approx(float(exact), rel=1e-11)


def test_a_stiff_relaxation_of_a_tiny_order_is_a_mapped_function():
    """y = E(-K t**a) at all times at once, where powers fail."""
    exact = pytest.importorskip("hereditary.exact")
    solution = exact.relaxation(0.02, 1e4)
    t = np.append(0.0, np.geomspace(1e-300, 1.0, 400))
    off = []
    for map_rates in (choose_map_rates((0.02, 1.0), [1e4]), ()):
        basis = power_basis((0.02, 1.0), map_rates)
        # at nodes too small for a float: the solution at 1 for a rate that is smaller instead
        rates = 1e4 * at_nodes(basis, 0.02)
        values = np.array([exact.relaxation(0.02, rate)(np.ones(1))[0, 0] for rate in rates])
        off.append(np.abs(basis.interpolate(values, t) - solution(t)[:, 0]).max())
    assert off[0] < 1e-9
    assert off[1] > 1e-3
