"""Users' functions: all shapes accepted, all mistakes told with line and remedy before a run."""

import gc
import math
import re

import numpy as np
import pytest
import scipy.special
from numba import njit

import hereditary as hd

pytestmark = pytest.mark.core

PARAMS = (2.0, 0.5)


def two(t, y):
    return -2.0 * y + 0.5 * t


def three(t, y, params):
    return -params[0] * y + params[1] * t


def in_place(t, y, dy, params):
    for j in range(y.size):
        dy[j] = -params[0] * y[j] + params[1] * t


@njit
def jitted(t, y, params):
    return -params[0] * y + params[1] * t


@njit
def jitted_in_place(t, y, dy, params):
    dy[:] = -params[0] * y + params[1] * t


def as_list(t, y):
    return [-2.0 * y[0] + 0.5 * t, -2.0 * y[1] + 0.5 * t]


def as_tuple(t, y):
    return -2.0 * y[0] + 0.5 * t, -2.0 * y[1] + 0.5 * t


def with_default(t, y, params=None):
    return -2.0 * y + 0.5 * t


SHAPES = [two, three, in_place, jitted, jitted_in_place, as_list, as_tuple, with_default]


def equation(rhs, y0=(1.0, 2.0), params=PARAMS, **kwargs):
    return hd.Equation(hd.Caputo(0.8), rhs, list(y0), params, **kwargs)


@pytest.mark.parametrize("rhs", SHAPES)
def test_all_shapes_give_the_same_solution(rhs):
    expected = hd.solve(equation(three), 1.0, 50).y
    np.testing.assert_array_equal(hd.solve(equation(rhs), 1.0, 50).y, expected)


@njit("float64[::1](float64, float64[::1])")
def of_one_signature(t, y):
    return -y


@pytest.mark.parametrize(
    "rhs",
    [
        lambda t, y: -y,
        lambda t, y: -y[0],
        lambda t, y: -1 * y[0],
        lambda t, y: [-y[0]],
        lambda t, y, p: -p[0] * y[0] / 2.0,
        of_one_signature,
    ],
)
def test_one_component_may_return_a_number(rhs):
    sol = hd.solve(hd.Equation(hd.Caputo(0.8), rhs, 1.0, PARAMS), 1.0, 50)
    np.testing.assert_allclose(sol.y, hd.solve(hd.scenes.relaxation(0.8), 1.0, 50).y, rtol=1e-13)


def test_numbers_that_happen_to_be_whole():
    sol = hd.solve(hd.Equation(hd.Caputo(1.0), lambda t, y: 3, 0.0), 1.0, 10)
    assert sol.y[-1, 0] == pytest.approx(3.0)


def jac_in_place(t, y, jacobian, params):
    jacobian[:] = 0.0
    jacobian[0, 0] = jacobian[1, 1] = -params[0]


def test_jacobians_of_all_shapes():
    by_differences = equation(two).jacobian(0.0, np.ones(2))
    for jac in (lambda t, y: -2.0 * np.eye(2), lambda t, y, p: -p[0] * np.eye(2), jac_in_place):
        found = equation(two, jac=jac).jacobian(0.0, np.ones(2))
        np.testing.assert_allclose(found, by_differences, rtol=1e-8, atol=1e-8)
    scalar = hd.Equation(hd.Caputo(1.5), lambda t, x: -x, [1.0, 0.0], jac=lambda t, x: -1.0)
    assert hd.solve(scalar, 1.0, 50).success


def uncompilable_call(t, y):
    scale = 1.0
    return -y * len(sorted([scale], key=str))


def uncompilable_statement(t, y):
    scale = 1.0
    assert all(isinstance(v, float) for v in y)
    return -y * scale


def uncompilable_library(t, y):
    scale = 1.0
    return -y * scipy.special.gamma(scale)


@njit
def uncompilable_in_place(t, y, dy, params):
    dy[:] = scipy.special.gamma(y)


def catches(t, y):
    try:
        scale = 1 / t
    except ZeroDivisionError:
        scale = 0.0
    return -y * scale


def formats(t, y):
    s = f"{t:.2f}"
    return -y * len(s)


@pytest.mark.parametrize(
    ("rhs", "reason", "line"),
    [
        (uncompilable_call, "Key must be None or a Numba JIT", "len(sorted([scale], key=str))"),
        (uncompilable_statement, "", "assert all(isinstance(v, float) for v in y)"),
        (uncompilable_library, "gamma", "return -y * scipy.special.gamma(scale)"),
        (uncompilable_in_place, "gamma", "dy[:] = scipy.special.gamma(y)"),
        (catches, "Exception matching is limited to", "except ZeroDivisionError:"),
        (formats, "format spec in f-strings|FORMAT_WITH_SPEC", 's = f"{t:.2f}"'),
    ],
)
def test_uncompilable_functions_are_told_with_their_line_and_the_reason(rhs, reason, line):
    with pytest.warns(hd.PythonFunctionWarning, match="numba cannot compile it") as caught:
        equation(rhs)
    message = str(caught[-1].message)  # on Python 3.13 numba warns of its own before
    assert re.search(reason, message)
    assert f"of {__file__}" in message
    assert line in message
    assert "use arithmetic, math and NumPy functions" in message


def test_compilation_leaves_the_collection_of_garbage_as_it_was():
    before = gc.get_threshold()
    try:
        for threshold in (before, (0, 10, 10), (300_000, 7, 7)):
            gc.set_threshold(*threshold)
            allowed = float(threshold[0])
            hd.Equation(hd.Caputo(0.5), lambda t, y: -y - allowed, 1.0)  # noqa: B023
            assert gc.get_threshold() == threshold
    finally:
        gc.set_threshold(*before)


def closure(rate):
    return lambda t, y: -rate * y


def test_a_function_and_equal_closures_are_compiled_once():
    def code(rhs, **given):
        return equation(rhs, **given).system.functions.rhs

    assert code(three) is code(three, params=(1.0, 1.0)) is code(three, y0=(1.0, 2.0, 3.0))
    assert code(jitted_in_place) is code(jitted_in_place)
    assert code(closure(2.0)) is code(closure(2.0)) is not code(closure(2))
    assert code(closure(3.0)) is not code(closure(2.0))
    table = np.array([2.0])
    assert code(closure(table)) is code(closure(table.copy()))


def divides_whole_numbers(t, y):
    total = 0.0
    for k in range(1, 4):
        total += k**-1
    return -total * y


def test_whole_numbers_that_numba_takes_otherwise():
    with pytest.warns(hd.PythonFunctionWarning, match=r"compiled it gives .*: write 1.0 for 1"):
        eq = equation(divides_whole_numbers)
    values = eq.system.rhs(0.0, np.array([1.0, 2.0]))
    assert values.tolist() == list(divides_whole_numbers(0.0, np.array([1.0, 2.0])))


def test_changed_module_attributes_are_seen(monkeypatch):
    def rhs(t, y):
        return -math.pi * y

    before = hd.solve(equation(rhs), 1.0, 50).y[-1, 0]
    monkeypatch.setattr(math, "pi", 1.0)
    assert hd.solve(equation(rhs), 1.0, 50).y[-1, 0] > 1.5 * before
