"""What stored machine code depends on, and what code without counts of references may do."""

import numpy as np
import pytest

from hereditary._cache import reached_digest
from hereditary._jit import allocating, compiled, inner, reordered


def _scaled(x, factor):
    for i in range(x.shape[0]):
        x[i] *= factor


def _caller_of(helper):
    def caller(x):
        helper(x, 2.0)

    return caller


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
