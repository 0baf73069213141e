"""What stored code depends on, and what functions without counts, or handed on, may do."""

import numpy as np
import pytest
from numba import types

from hereditary._cache import reached_digest
from hereditary._jit import F8, I8, allocating, as_value, compiled, entry, inner, reordered
from hereditary.compiled.numba_internals import LINKED


def _scaled(x, factor):
    for i in range(x.shape[0]):
        x[i] *= factor


def _caller_of(helper):
    def caller(x):
        helper(x, 2.0)

    return caller


@pytest.mark.skipif(not LINKED, reason="plain numba compiles these alike")
def test_an_entry_depends_on_how_the_functions_it_reaches_are_compiled():
    kinds = [inner, allocating, reordered]
    found = [reached_digest(_caller_of(kind(_scaled))) for kind in kinds]
    assert len(set(found)) == len(kinds)
    assert found == [reached_digest(_caller_of(kind(_scaled))) for kind in kinds]


def test_functions_without_counts_work_on_their_caller_s_arrays():
    helper = inner(_scaled)

    @compiled
    def scaled(n):
        x = np.ones(n)
        for _ in range(3):
            helper(x[1:], 2.0)
        return x

    assert scaled(4).tolist() == [1.0, 8.0, 8.0, 8.0]


@pytest.mark.parametrize("in_tuple", [False, True])
def test_a_function_without_counts_that_returns_an_array_is_refused(in_tuple):
    @inner
    def same(x):
        return (1.0, x) if in_tuple else x

    @compiled
    def caller(x):
        return same(x)

    with pytest.raises(Exception, match=r"allocating|returning of array"):
        caller(np.ones(2))


@entry(F8, types.FunctionType(F8(F8)))
def _twice(x, fun):
    return fun(fun(x))


def test_a_function_is_handed_on_for_its_signature_alone():
    @compiled
    def halved(x):
        return 0.5 * x

    @compiled
    def rounded(x):
        return int(x)

    assert _twice(3.0, as_value(halved, F8(F8))) == 0.75
    with pytest.raises(TypeError, match=r"must be .* -> float64; it returns int64"):
        as_value(rounded, F8(F8))
    with pytest.raises(TypeError):
        _twice(3.0, as_value(rounded, I8(F8)))
