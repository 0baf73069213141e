"""Sums of operators, and orders within rounding of an integer."""

import numpy as np
import pytest

import hereditary as hd

A, B, M = hd.Caputo(1.8), hd.Caputo(0.8), hd.Memory(hd.Prony([1.0], [1.0]), 1)


def rhs(t, y):
    return -y


def told(terms):
    return repr(hd.Equation(terms, rhs, [1.0, 0.0]))


@pytest.mark.parametrize(
    ("terms", "expected"),
    [
        (A + 0.25 * B, [A, 0.25 * B]),
        (A - 0.25 * B, [A, -0.25 * B]),
        (2 * A + B / 2 - M, [2 * A, 0.5 * B, -1 * M]),
        (-(A + B), [-A, -B]),
        (2 * (A + B) / 4, [0.5 * A, 0.5 * B]),
        (+A, [A]),
        (sum([A, B, M]), [A, B, M]),
        ([A + B, M], [A, B, M]),
        (np.array([2.0]) * (A + B), [[2.0] * A, [2.0] * B]),
    ],
)
def test_sums_are_the_list_of_their_terms(terms, expected):
    assert told(terms) == told(expected)


@pytest.mark.parametrize("near", [0.1 * 3 / 0.3, 1 + 1e-14, 1 - 1e-14, np.nextafter(1, 0)])
def test_orders_within_rounding_of_an_integer_are_that_integer(near):
    assert hd.Caputo(near).order == 1.0
    assert hd.Caputo(near).derivative == 1
    assert hd.Caputo(1.0 + near).order == 2.0
    assert hd.Caputo([near, 0.5]).order.tolist() == [1.0, 0.5]
    assert hd.Caputo(lambda t: near).derivative == 1
    sol = hd.solve(hd.Equation(hd.Caputo(near), rhs, 1.0), 1.0, 50)
    np.testing.assert_array_equal(sol.y, hd.solve(hd.Equation(hd.Caputo(1), rhs, 1.0), 1.0, 50).y)


@pytest.mark.parametrize("order", [1 + 1e-12, 1 - 1e-12, 2 - 1e-12, 1e-15])
def test_other_orders_stay(order):
    assert hd.Caputo(order).order == order


def test_orders_that_vary_may_reach_an_integer_with_rounding():
    def order(t):
        return 0.8 + 0.2 * t if t < 1.0 else 0.1 * 3 / 0.3

    assert order(1.0) > 1.0
    sol = hd.solve(hd.Equation(hd.Caputo(order), rhs, 1.0), 2.0, 50)
    assert sol.success


def test_orders_of_power_laws_are_rounded_too():
    nearly = hd.Equation(hd.Memory(hd.PowerLaw(1 - 1e-15), 1), rhs, 1.0)
    assert nearly.orders.tolist() == [[1.0]]


def test_orders_within_rounding_of_each_other_are_one():
    """Written as 0.1 * 3 in one term and as 0.3 in another, or in another component."""
    terms = [2.0 * hd.Caputo(0.1 * 3), hd.Caputo(0.3), hd.Caputo(0.7)]
    equation = hd.Equation(terms, lambda t, y: -y, 1.0)
    assert equation.orders.ravel().tolist() == [0.3, 0.3, 0.7]
    both = hd.Equation([3.0 * hd.Caputo(0.3), hd.Caputo(0.7)], lambda t, y: -y, 1.0)
    one, other = (hd.solve(e, 2.0, rtol=1e-10)(2.0) for e in (equation, both))
    assert one == pytest.approx(other, rel=1e-12)
    apart = hd.Equation(hd.Caputo([0.3, 0.3 + 1e-12]), lambda t, y: -y, [1.0, 1.0])
    assert np.ptp(apart.orders) > 0
