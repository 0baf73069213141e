"""Tables of a collocation step: nodes, integrals, lengths, exponentials, against closed forms."""

import math
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from functools import cache

import mpmath
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.polynomial import legendre as leg
from scipy.special import rgamma

import hereditary as hd
from hereditary.collocation import modes, workspace
from hereditary.collocation.equations import integral_form
from hereditary.collocation.exponential_basis import power_law_basis
from hereditary.collocation.mode_tables import exponential_legendre, floor_to_grid
from hereditary.collocation.quadrature import (
    polynomial_integrals,
    radau_integrals,
    radau_nodes,
    to_legendre,
)
from hereditary.collocation.varying import varying_basis
from hereditary.support.pool import Pool

NUMBERS = (2, 3, 4, 6, 8, 12)
ORDERS = (1e-6, 0.02, 0.5, 0.999999, 1.0)


def integral_of_power(p, a, t):
    """``J**a t**p`` by the Gamma function, in 30 digits."""
    with mpmath.workdps(30):
        factor = mpmath.gamma(p + 1) / mpmath.gamma(p + 1 + mpmath.mpf(float(a)))
        return np.array([float(factor * mpmath.mpf(float(x)) ** (p + a)) for x in t])


def integral_of_node_polynomial(s, a):
    """``J**a`` of ``prod_j (t - c_j)`` at the nodes, in 60 digits."""
    nodes = radau_nodes(s)
    with mpmath.workdps(60):
        powers = [mpmath.mpf(1)]  # coefficients, the highest power first
        for c in nodes:
            shifted = [-mpmath.mpf(float(c)) * k for k in powers]
            powers = [u + v for u, v in zip([*powers, 0], [0, *shifted], strict=True)]
        order = mpmath.mpf(float(a))
        return np.array(
            [
                float(
                    sum(
                        k * mpmath.gamma(p + 1) / mpmath.gamma(p + 1 + order) * c ** (p + order)
                        for k, p in zip(powers, range(s, -1, -1), strict=True)
                    )
                )
                for c in map(mpmath.mpf, map(float, nodes))
            ]
        )


@pytest.mark.parametrize("s", NUMBERS)
def test_nodes_are_the_zeros_of_a_difference_of_neighbouring_legendre_polynomials(s):
    nodes = radau_nodes(s)
    assert nodes.shape == (s,)
    assert np.all(np.diff(nodes) > 0)
    assert nodes[0] > 0
    assert nodes[-1] == 1.0
    difference = np.zeros(s + 1)
    difference[s - 1 :] = -1.0, 1.0
    assert np.abs(leg.legval(2 * nodes - 1, difference)).max() < 2e-14


@pytest.mark.parametrize("s", NUMBERS)
def test_rules_cannot_be_written_to(s):
    """They are shared by all runs."""
    for array in (radau_nodes(s), radau_integrals(s, 0.5), to_legendre(s)):
        with pytest.raises(ValueError, match="read-only"):
            array[:] = 0.0


@pytest.mark.parametrize("a", ORDERS)
@pytest.mark.parametrize("s", NUMBERS)
def test_integrals_of_powers_are_exact_below_the_number_of_nodes(s, a):
    nodes = radau_nodes(s)
    for p in range(s):
        exact, found = integral_of_power(p, a, nodes), radau_integrals(s, a) @ nodes**p
        # rounded nodes alone leave 2.4e-15, with any inverse of their Legendre polynomials
        np.testing.assert_allclose(found, exact, rtol=1e-13, atol=3e-15)


@pytest.mark.parametrize("a", ORDERS)
@pytest.mark.parametrize("s", NUMBERS[:-1])
def test_integrals_of_the_next_power_miss_that_of_the_node_polynomial(s, a):
    """t**s and its interpolant differ by ``prod_j (t - c_j)``, whose integral is not 0."""
    nodes = radau_nodes(s)
    missed = integral_of_power(s, a, nodes) - radau_integrals(s, a) @ nodes**s
    expected = integral_of_node_polynomial(s, a)
    np.testing.assert_allclose(missed, expected, rtol=0, atol=3e-15)
    assert np.abs(missed).max() > 1e3 * 3e-15


@pytest.mark.parametrize("s", NUMBERS)
def test_the_whole_integral_is_exact_up_to_twice_the_number_of_nodes_less_two(s):
    """Radau's rule: the node polynomial is orthogonal to all polynomials of degree s - 2."""
    nodes, weights = radau_nodes(s), radau_integrals(s, 1.0)[-1]
    assert np.all(weights > 0)
    for p in range(2 * s - 1):
        assert weights @ nodes**p == pytest.approx(1 / (p + 1), rel=1e-13)
    if s <= 8:
        p = 2 * s - 1
        assert abs(weights @ nodes**p - 1 / (p + 1)) > 1e-10


@given(st.sampled_from(NUMBERS), st.floats(1e-9, 1.0), st.data())
def test_integrals_of_any_polynomial_up_to_any_end(s, a, data):
    """Also from 0 to 0, and for orders so small that they hardly integrate."""
    amplitudes = hnp.arrays(float, s, elements=st.floats(-10, 10))
    coefficients = data.draw(amplitudes)
    ends = np.array([0.0, 1e-6, data.draw(st.floats(0, 1)), 1.0])
    values = np.polyval(coefficients, radau_nodes(s))
    powers = np.arange(s - 1, -1, -1)
    factors = np.array([float(mpmath.gamma(p + 1)) for p in powers]) * rgamma(powers + 1 + a)
    exact = (ends[:, None] ** (powers + a)) @ (factors * coefficients)
    found = polynomial_integrals(s, a, ends) @ values
    allowed = 1e-12 * np.abs(coefficients).max() + 1e-300  # the smallest numbers have no digits
    np.testing.assert_allclose(found, exact, rtol=0, atol=allowed)


@given(st.sampled_from(NUMBERS), st.data())
def test_interpolation_is_exact_below_the_number_of_nodes_alone(s, data):
    coefficients = data.draw(hnp.arrays(float, s, elements=st.floats(-10, 10)))
    found = to_legendre(s) @ leg.legval(2 * radau_nodes(s) - 1, coefficients)
    scale = 1 + np.abs(coefficients).max()
    np.testing.assert_allclose(found, coefficients, rtol=0, atol=1e-13 * scale)
    next_one = np.eye(s + 1)[s]  # P_s, which equals P_(s-1) at the nodes
    assert (to_legendre(s) @ leg.legval(2 * radau_nodes(s) - 1, next_one))[-1] == pytest.approx(1)


# Lengths of steps

# Between neighbours of the grid lies a factor of 2**(1/8); its lengths are rounded up to 13 digits.
FACTOR, ROUNDED = 2 ** (1 / 8), 1 + 2.0**-12


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


# Moments

# Around the changes of method, z = 4 n and the smallest arguments, and everywhere else.
ARGUMENTS = [0.0, 5e-324, 1e-300, 1e-20, 1e-8, 1e-3, 0.1, 1.0, 5.0, 15.9, 16.1, 20.0, 25.0, 31.9]
ARGUMENTS += [32.1, 34.0, 47.9, 48.1, 50.0, 100.0, 745.0, 1e3, 1e4, 1e6, 1e12]


def legendre_moments(z, n=12):
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
    np.testing.assert_allclose(legendre_moments(z, n), exact_moments(z, n), rtol=rtol, atol=1e-300)


@given(st.floats(0, 1e6), st.integers(1, 12))
def test_moments_are_those_of_exponentials(z, n):
    """For any z, against Gauss' rule where the exponential is not steep; fewer are the same."""
    found = legendre_moments(z)
    np.testing.assert_allclose(legendre_moments(z, n), found[:n], rtol=5e-14)
    assert np.all((found >= 0) & (found <= found[0]))
    if z < 50:
        x, weights = np.polynomial.legendre.leggauss(60)
        values = np.polynomial.legendre.legvander(x, 11)
        expected = 0.5 * (weights * np.exp(-z * (1 - x) / 2)) @ values
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-14)


SETS_OF_ORDERS = st.lists(st.floats(0.001, 1.0), min_size=1, max_size=3, unique=True).map(sorted)
EXPONENTS = st.floats(-13, -3)


def errors_of(basis, closest=None, farthest=None, n=4000):
    """Relative errors of each kernel at n distances between the closest and the farthest."""
    t = np.geomspace(closest or basis.closest, farthest or basis.farthest, n)
    sums = basis.weights @ np.exp(-np.multiply.outer(basis.rates, t))
    a = np.array(basis.orders)[:, None]
    return np.abs(sums / (t ** (a - 1) * rgamma(a)) - 1)


@settings(max_examples=30)
@given(SETS_OF_ORDERS, st.floats(-12, 0), st.floats(1, 15), EXPONENTS)
def test_kernels_at_all_distances(orders, low, decades, log_tol):
    closest, tol = 10.0**low, 10.0**log_tol
    basis = power_law_basis(orders, closest, closest * 10**decades, tol)
    assert errors_of(basis).max() <= tol + 2e-15
    assert basis.orders == tuple(orders)
    assert basis.weights.shape == (len(orders), basis.rates.size)
    assert np.all(basis.weights >= 0)
    assert np.all(basis.rates >= 0)
    assert np.all(np.diff(basis.rates) >= 0)


@pytest.mark.parametrize("orders", [[0.5], [0.2, 0.8], [1e-3, 0.999]])
def test_beyond_its_distances_a_basis_does_not_hold(orders):
    """The two-sided half: it would be too large if it held much further than asked for."""
    basis = power_law_basis(orders, 1e-3, 1e3, 1e-8)
    assert np.all(errors_of(basis, 1e-6, 2e-6).max(axis=1) > 1e-8)
    assert np.all(errors_of(basis, 1e7, 2e7).max(axis=1) > 1e-8)


@settings(max_examples=30)
@given(SETS_OF_ORDERS, st.floats(1, 10), EXPONENTS, st.floats(0.01, 6))
def test_a_refined_basis_extends_the_old_one(orders, decades, log_tol, log_factor):
    """It reaches down to what was asked, to the same tolerance, and old modes keep their rates."""
    old = power_law_basis(orders, 1e-2, 1e-2 * 10**decades, 10.0**log_tol)
    wanted = 1e-2 / 10**log_factor
    new = old.refine(wanted)
    assert new.closest <= wanted * (1 + 1e-12)
    assert (new.orders, new.farthest, new.tol) == (old.orders, old.farthest, old.tol)
    n = old.rates.size
    np.testing.assert_allclose(new.rates[:n], old.rates, rtol=1e-6)
    assert np.all(new.rates[n:] > old.rates[-1])
    assert errors_of(new).max() <= new.tol + 2e-15


def test_a_basis_keeps_its_grid_where_its_tolerance_is_that_of_rounding():
    """There a fit may need another share of its tolerance than one that reaches closer."""
    orders, tol, alone = [0.0031612884040537552, 1.0], 2e-14, []
    for closest in np.geomspace(1e-1, 1e-6, 40):
        old = power_law_basis(orders, closest, 4.2e5, tol)
        new = old.refine(closest / 100)
        assert new.fraction == old.fraction
        np.testing.assert_allclose(new.rates[: old.rates.size], old.rates, rtol=1e-6)
        alone.append(power_law_basis(orders, new.closest, 4.2e5, tol).fraction - old.fraction)
    assert min(alone) < 0 < max(alone)  # by which machines round, at other distances


def test_closer_and_closer():
    """A thousand times closer in many small reaches, as in one; and where it is, it stays."""
    basis = power_law_basis([0.3, 0.7], 1.0, 1e4, 1e-10)
    assert np.array_equal(basis.refine(basis.closest).rates, basis.rates)
    one = basis.refine(1e-3)
    for reach in np.geomspace(0.5, 1e-3, 12):
        basis = basis.refine(reach)
    assert abs(basis.rates.size - one.rates.size) <= 1
    assert errors_of(basis).max() <= 1e-10


@pytest.mark.parametrize("orders", [[1.0], [0.4, 1.0]])
def test_a_constant_kernel_is_one_mode_that_does_not_decay(orders):
    for basis in (
        power_law_basis(orders, 1e-3, 1e3, 1e-8),
        power_law_basis(orders, 1.0, 1e3, 1e-8).refine(0.1),
    ):
        assert basis.rates[0] == 0.0
        assert basis.weights[-1].tolist() == [1.0] + [0.0] * (basis.rates.size - 1)
        assert np.all(basis.weights[:-1, 0] == 0.0)
        assert errors_of(basis).max() <= 1e-8


def test_a_tighter_tolerance_takes_more_modes_and_shared_rates_fewer():
    sizes = [power_law_basis([0.5], 1e-3, 1e3, tol).rates.size for tol in (1e-4, 1e-8, 1e-12)]
    assert sizes == sorted(sizes)
    assert sizes[0] < sizes[2] <= 60
    alone = [power_law_basis([a], 1e-3, 1e3, 1e-8).rates.size for a in (0.3, 0.6)]
    assert power_law_basis([0.3, 0.6], 1e-3, 1e3, 1e-8).rates.size < sum(alone)


@pytest.mark.parametrize("closest", [1e-3, 1e-7, 3e-20])
def test_a_basis_of_orders_that_vary_is_refined(closest):
    basis = varying_basis(1e-2, 1e3, 1e-9)
    closer = basis.refine(closest)
    assert closer.closest <= closest
    np.testing.assert_allclose(closer.rates[: basis.rates.size], basis.rates, rtol=1e-9)
    t = np.geomspace(closest, 1e3, 200)
    for a in (0.01, 0.3, 0.99):
        sums = np.exp(-np.multiply.outer(t, closer.rates)) @ closer.weights(np.array([a]))[:, 0]
        np.testing.assert_allclose(sums, t ** (a - 1) * rgamma(a), rtol=1e-9)


# What runs share, modes and workspaces, changes no result: neither order nor threads matter


@cache
def equations():
    return [
        hd.Equation(operator, lambda t, y, p: -p[0] * y, np.ones(d), params=[rate])
        for operator in (hd.Caputo(0.5), hd.Caputo(0.8), hd.Caputo(0.8) + 0.5 * hd.Caputo(0.3))
        for d, rate in ((1, 1.0), (1, 3.0), (3, 1.0))
    ]


def rows(equation, rtol=1e-6):
    solution = hd.solve(equation, 2.0, rtol=rtol)
    return solution.t.tobytes() + solution.y.tobytes()


def forget():
    modes.opened_once.cache_clear()
    modes._over_step.cache_clear()
    workspace.spare_workspaces._kept.clear()


@pytest.fixture(scope="module")
def alone():
    found = []
    for equation in equations():
        forget()
        found.append(rows(equation))
    return found


def test_a_run_after_others_equals_one_with_everything_new(alone):
    assert [rows(equation) for equation in equations() * 2] == alone * 2


def test_runs_in_threads_equal_those_alone(alone):
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(rows, equations() * 8)) == alone * 8


def test_workspaces_of_a_run_that_raised_serve_the_next_one(alone):
    def fails(t, y, p):
        if t > 1.0:
            raise ValueError("late")
        return -p[0] * y

    forget()
    with pytest.warns(hd.SolveWarning, match="late"):
        hd.solve(hd.Equation(hd.Caputo(0.5), fails, 1.0, params=[1.0]), 2.0, rtol=1e-6)
    assert rows(equations()[0]) == alone[0]


@pytest.mark.parametrize("changed", ["form", "s", "closest", "farthest", "tol"])
def test_changed_modes_are_made_anew(changed):
    forms = [integral_form(equation.system) for equation in equations()]
    first = {"form": forms[0], "s": 8, "closest": 1e-3, "farthest": 10.0, "t_end": 1.0, "tol": 1e-9}
    other = {"form": forms[3], "s": 6, "closest": 1e-4, "farthest": 20.0, "tol": 1e-8}
    known = modes.opened_once(**first)
    assert modes.opened_once(**first) is known
    new = modes.opened_once(**first | {changed: other[changed]})
    assert new.key != known.key or not np.array_equal(new.weights, known.weights)


def test_equations_with_the_same_terms_share_their_form():
    forms = [integral_form(equation.system) for equation in equations()]
    assert forms[0] is forms[1]
    assert forms[0] is integral_form(equations()[0].replace(params=[7.0]).system)
    assert len({id(form) for form in forms}) == 6


@pytest.mark.parametrize("changed", ["rates", "length", "variable"])
def test_a_changed_first_step_is_made_anew(changed):
    bank = modes.Bank(np.array([0.1, 1.0, 10.0]), np.zeros((0, 3)))
    given = {"bank": bank, "variable": modes.Variable(2.0), "length": 0.5}
    other = {"bank": bank._replace(rates=2 * bank.rates), "variable": modes.Variable(3.0)}
    known = modes.over_step(**given)
    assert modes.over_step(**given) is known
    name = "bank" if changed == "rates" else changed
    new = modes.over_step(**given | {name: (other | {"length": 0.25})[name]})
    assert not np.array_equal(new.gains, known.gains)


def test_a_pool_gives_each_object_to_one_user_and_keeps_the_newest():
    pool, made = Pool(2), []

    def make():
        made.append(object())
        return made[-1]

    taken = [pool.acquire("a", make) for _ in range(3)]
    assert len({id(one) for _, one in taken}) == 3
    for one in taken:
        pool.release(one)
    assert [pool.acquire("a", make)[1] for _ in range(2)] == [made[2], made[1]]
    assert pool.acquire("a", make)[1] is made[3]
    assert pool.acquire("b", make)[1] is made[4]
