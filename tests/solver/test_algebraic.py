"""Rows without a derivative, and memory of functions of the solution, to a tolerance."""

import math

import numpy as np
import pytest

import hereditary as hd

FIRST = np.array([1.0, 0.0])
SECOND = np.array([0.0, 1.0])
G = math.gamma(1.7)


def linear():
    def rhs(t, y):
        return np.array([1 - y[0] - y[1], y[0] - y[1]])

    return hd.Equation(FIRST * hd.Caputo(0.5), rhs, [1.0, 1.0])


def polynomial():
    def rhs(t, y):
        x, w = y
        return np.array([G + w - x**2, x**2 + x**6 / 10 - w - w**3 / 10])

    return hd.Equation(FIRST * hd.Caputo(0.7), rhs, [1.0, 1.0])


def circuit():
    def rhs(t, v):
        return np.array([v[1] / 2, v[0] - np.sin(t)])

    matrix = np.array([[1.0, -1.0], [0.0, 0.0]])
    return hd.Equation(matrix * hd.Caputo(0.7), rhs, [0.0, 0.0])


def square():
    def rhs(t, y, memory):
        return np.array([np.cos(t) - memory[0, 1] - y[0], y[0] ** 2 - y[1]])

    memory = SECOND * hd.Memory(hd.TemperedPowerLaw(0.5, 1.0), 0)
    return hd.Equation(0 * hd.Caputo(1), rhs, [1.0, 1.0], memory=memory)


def renewal():
    def rhs(t, y, memory):
        return np.array([-y[1], y[0] * (2 * memory[0, 1] + 1e-4 * np.exp(-t)) - y[1]])

    memory = SECOND * hd.Memory(hd.GammaDensity(5.0, 5.0), 0)
    return hd.Equation(FIRST * hd.Caputo(1), rhs, [1.0, 1e-4], memory=memory)


def delayed():
    memory = hd.Memory(hd.GammaDensity(1.5, 1.0), 0)
    return hd.Equation(hd.Caputo(1), lambda t, y, memory: -memory[0], 1.0, memory=memory)


CASES = [
    (linear, 2.0, [0.594410641301969] * 2),
    (polynomial, 2.0, [1 + 2**0.7, (1 + 2**0.7) ** 2]),
    (circuit, 10.0, [math.sin(10), -0.62347142013735]),
    (square, 1.0, [0.28581642948650]),
    (square, 2.0, [-0.90715423688777]),
    (renewal, 20.0, [0.2044015705677]),
    (delayed, 1.0, [0.803792100113431]),
    (delayed, 10.0, [0.0153484396603218]),
]


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize(("equation", "t_end", "expected"), CASES)
def test_the_tolerance_holds(equation, t_end, expected, rtol):
    solved = hd.solve(equation(), t_end, rtol=rtol)
    assert solved.success
    found = solved.y[-1, : len(expected)]
    np.testing.assert_allclose(found, expected, rtol=10 * rtol, atol=0)
    assert solved.stats["n_steps"] < 100


def test_inconsistent_values_are_refused_with_consistent_ones():
    equation = linear().replace(y0=[1.0, 0.5])
    with pytest.raises(ValueError, match=r"a residual of 0.5; .* y0\[0, 1\] = 1"):
        hd.solve(equation, 2.0)


def test_an_index_above_1_is_refused():
    def rhs(t, y):
        return np.array([y[1], y[0] - np.sin(t)])

    with pytest.raises(ValueError, match=r"index above 1.*differentiate"):
        hd.solve(hd.Equation(FIRST * hd.Caputo(0.5), rhs, [0.0, 1.0]), 2.0)


def test_given_steps_refuse_rows_without_a_derivative():
    with pytest.raises(ValueError, match="none for component 1; solve algebraic rows with rtol="):
        hd.solve(linear(), 2.0, 100)
