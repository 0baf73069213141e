"""The variable of the first step: sums of powers kept to rounding, integrated and differentiated.

A power t**e counts where e is a sum of generators; t = 0 and the tiniest t are among the points,
for there the solution of a stiff equation of small order has most of its changes.
"""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import gamma, rgamma

from hereditary.collocation.first_rule import (
    LEFT_OUT,
    Variable,
    first_rule,
    functions,
    graded_rule,
    means_at_nodes,
    rule_of_modes,
)
from hereditary.collocation.quadrature import check_points_of, radau_nodes
from hereditary.exact import relaxation

GENERATORS = [
    (1.0,),
    (0.5,),
    (0.3, 1.0),
    (0.7, 1.0),
    (0.8, 1.0),
    (0.999, 1.0),
    (0.6, 0.7),
    (0.02, 1.0),
    (1e-6, 1.0),
]
LOGS = np.log(np.concatenate([[1e-300], np.geomspace(1e-40, 1, 300), np.linspace(1e-3, 1, 301)]))


def resolved(generators):
    """A variable and the sums of generators of which u is a power low enough for its nodes."""
    variable = Variable.of(generators)
    first, second = generators[0], generators[-1]
    sums = {round(i * first + j * second, 12) for i in range(6) for j in range(6)}
    return variable, [e for e in sorted(sums) if variable.q * e <= 17]


def node_logs(variable):
    return variable.logs(radau_nodes(variable.n))


@pytest.mark.parametrize("generators", GENERATORS, ids=repr)
def test_the_powers_of_a_solution_are_smooth_in_the_variable(generators):
    variable = Variable.of(generators)
    for exponent in (variable.q * g for g in generators):
        assert exponent > 5.29 or exponent == pytest.approx(round(exponent), abs=1e-9)


@pytest.mark.parametrize("c", [0.0, 64.0])
@pytest.mark.parametrize("generators", GENERATORS, ids=repr)
def test_variable_and_time_are_inverse_to_each_other(generators, c):
    variable, u = Variable.of(generators, c), np.linspace(0.01, 1.0, 100)
    np.testing.assert_allclose(variable.at(variable.logs(u)), u, rtol=1e-12)
    assert variable.logs(np.ones(1)) == 0.0
    # du/dt by differences of log(t)
    logs, t, step = np.linspace(-5.0, -0.1, 20), np.exp(np.linspace(-5.0, -0.1, 20)), 1e-5
    rise = (variable.at(logs + step) - variable.at(logs - step)) / (2 * step)
    np.testing.assert_allclose(t * variable.slopes(t), rise, rtol=1e-6, atol=1e-10)


@pytest.mark.parametrize("generators", GENERATORS, ids=repr)
def test_powers_are_interpolated(generators):
    variable, exponents = resolved(generators)
    assert len(exponents) > 2
    for e in exponents:
        off = functions(variable, LOGS) @ np.exp(e * node_logs(variable)) - np.exp(e * LOGS)
        assert np.abs(off).max() < 1e-11


@pytest.mark.parametrize("generators", [(1.0,), (0.5,), (0.7, 1.0), (0.8, 1.0), (0.6, 0.7)])
def test_other_powers_are_not(generators):
    """The two-sided half: what is no sum of generators shows as an error, near 0 above all."""
    variable = Variable.of(generators)
    off = functions(variable, LOGS) @ np.exp(0.0437 * node_logs(variable)) - np.exp(0.0437 * LOGS)
    assert np.abs(off).max() > 1e-4


@pytest.mark.parametrize("orders", [(1e-6, 1.0), (0.02, 0.5), (0.3, 0.999999, 1.0)], ids=repr)
@pytest.mark.parametrize("generators", GENERATORS, ids=repr)
def test_integrals_of_powers(generators, orders):
    """``J**a t**e = Gamma(e+1) / Gamma(e+a+1) t**(e+a)``, at the nodes and the looks."""
    variable, exponents = resolved(generators)
    rule, logs = first_rule(variable, orders), node_logs(variable)
    for a, integral in zip(orders, rule.integrals, strict=True):
        for e in exponents:
            exact = gamma(e + 1) * rgamma(e + a + 1) * np.exp((e + a) * logs)
            assert np.abs(integral @ np.exp(e * logs) - exact).max() < 1e-12
    for e in exponents:
        seen, looks = np.exp(e * logs), variable.logs(check_points_of(variable.n))
        at = np.exp(e * looks) if e else np.ones(looks.size)
        integrals = np.exp((e + 1) * looks) / (e + 1)
        np.testing.assert_allclose(rule.check_integrals @ seen, integrals, atol=3e-12)
        np.testing.assert_allclose(rule.check_values @ seen, at, atol=1e-11)
        np.testing.assert_allclose(means_at_nodes(variable) @ seen, seen / (e + 1), atol=3e-12)


@given(st.floats(-0.9, 2), st.floats(-0.9, 2))
def test_the_graded_rule_is_for_functions_singular_at_both_ends(p, q):
    """``int u**p (1-u)**q du``, the stretches left out next to both ends in closed form."""
    u, v, weights = graded_rule()
    np.testing.assert_allclose(u + v, 1, atol=1e-15)
    ends = LEFT_OUT ** (p + 1) / (p + 1) + LEFT_OUT ** (q + 1) / (q + 1)
    exact = gamma(p + 1) * gamma(q + 1) * rgamma(p + q + 2)
    assert weights @ (u**p * v**q) + ends == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("n", [24, 48])
@pytest.mark.parametrize("fastest", [0.0, 1.0, 300.0, 2e4, 1e9, 1e30])
def test_the_rule_of_modes_is_for_powers_and_decays_up_to_a_rate(n, fastest):
    """``int u**p exp(-z (1-u)) du = M(1, p + 2, -z) / (p + 1)`` is Kummer's function."""
    _, u, v, weights = rule_of_modes(n, fastest)
    for p in (0.0, 0.3, 2.0):
        for z in fastest * np.array([1e-4, 0.1, 1.0]):
            with mpmath.workdps(30):
                exact = float(mpmath.hyp1f1(1, p + 2, -mpmath.mpf(z)) / (p + 1))
            assert weights @ (u**p * np.exp(-z * v)) == pytest.approx(exact, rel=1e-12, abs=1e-16)


# Variables that are bent


@pytest.mark.parametrize("a", [0.02, 0.5, 1.0])
@pytest.mark.parametrize(("g", "c"), [(0.1, 16.0), (0.02, 4.0**8), (1e-6, 64.0)])
def test_integrals_of_bent_functions(g, c, a):
    """``J**a w = t**a / Gamma(a+1) int_0^1 w(t (1 - s**(1/a))) ds``, by mpmath's quadrature."""
    variable = Variable.of((g, 1.0), c)
    logs = node_logs(variable)
    values = 1 / (1 + c * np.exp(g * logs))
    off = functions(variable, LOGS) @ values - 1 / (1 + c * np.exp(g * LOGS))
    assert np.abs(off).max() < 1e-11
    end = first_rule(variable, (a, 1.0)).integrals[0, -1] @ values
    with mpmath.workdps(30):
        pieces = [0, *(1 - mpmath.mpf(2) ** -k for k in range(1, 60, 4)), 1]

        def inner(s):
            return 1 / (1 + c * (1 - s ** (1 / mpmath.mpf(a))) ** mpmath.mpf(g)) if s < 1 else 1

        exact = mpmath.rgamma(1 + mpmath.mpf(a)) * mpmath.quad(inner, pieces)
    assert end == pytest.approx(float(exact), abs=1e-11)


def test_a_stiff_relaxation_of_a_tiny_order_is_a_bent_function():
    """y = E(-K t**a) at all times at once, where powers fail."""
    solution, logs = relaxation(0.02, 1e4), np.log(np.geomspace(1e-300, 1.0, 400))
    off = []
    for c in (1e4, 0.0):
        variable = Variable.of((0.02,), c)
        # at nodes too small for a float: the solution at 1 for a rate that is smaller instead
        rates = 1e4 * np.exp(0.02 * node_logs(variable))
        values = np.array([relaxation(0.02, rate)(np.ones(1))[0, 0] for rate in rates])
        found = functions(variable, logs) @ values
        off.append(np.abs(found - solution(np.exp(logs))[:, 0]).max())
    assert off[0] < 1e-9
    assert off[1] > 1e-3
