"""Right-hand sides ``B x + A f(t, S x)`` that are made of a right-hand side f.

Their Jacobians are ``B + A J S``. Behind the parameters of f stand the entries of S, B and A as
triples (row, column, value), then the number of values of f, and where each matrix begins. Where f
reads the first components and its values are those of the last ones, there are no entries of S and
A, and f sets its values in place.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from .compiled.jit import JAC_SIG, RHS_SIG, as_value, compiled, derived, inlined, inner

# Numbers behind the triples.
_SIZES = 4


def affine(functions, n, n_f, b, a=None, s=None) -> tuple[np.ndarray, Any, Any]:
    """Return params, right-hand side, and Jacobian or None, of ``B x + A f(t, S x)``.

    Parameters
    ----------
    functions : (ndarray, callable, callable or None)
        Those of f.
    n, n_f : int
        Number of components x, and of values that f reads, and returns.
    b, a, s : array_like, shape (k, 3)
        Row, column and value of entries, which add up where one place has several. By default f
        reads the first components, and its values are those of the last ones.
    """
    params, rhs, jac = functions
    own, ones = np.arange(n_f), np.ones(n_f)
    first, last = np.c_[own, own, ones], np.c_[n - n_f + own, own, ones]
    s, a = first if s is None else s, last if a is None else a
    in_place = np.array_equal(s, first) and np.array_equal(a, last)
    parts = [params, *map(np.ravel, ((), b, ()) if in_place else (s, b, a))]
    begins = np.cumsum([part.size for part in parts])[:3]
    values = np.concatenate([*parts, [n_f], begins])
    return values, _side(rhs, in_place), jac and slopes(jac)


@inlined
def own_size(params):
    """Number of parameters of f."""
    return int(params[-3])


@lru_cache(maxsize=64)
def _side(rhs, in_place):
    """Return ``B x + A f(t, S x)``."""

    def last(t, x, out, params):
        n_f = int(params[-4])
        force = out[out.shape[0] - n_f :]
        rhs(t, x[:n_f], force, params[: own_size(params)])
        _combine(x, force, out, params)

    def anywhere(t, x, out, params):
        z = _arguments(x, params)
        force = np.empty(z.shape[0])
        rhs(t, z, force, params[: own_size(params)])
        _combine(x, force, out, params)

    return as_value(derived(last, False) if in_place else derived(anywhere), RHS_SIG)


@lru_cache(maxsize=64)
def slopes(jac):
    """Return ``B + A J S``, where the parameters are those of `affine`."""

    def all_slopes(t, x, out, params):
        z = _arguments(x, params)
        block = np.empty((z.shape[0], z.shape[0]))
        jac(t, z, block, params[: own_size(params)])
        _combine_slopes(block, out, params)

    return as_value(derived(all_slopes), JAC_SIG)


# What follows is the same for every f, and kept on disk.


@compiled
def _arguments(x, params):
    """Return S x."""
    n_f, s, b = int(params[-4]), int(params[-3]), int(params[-2])
    if s == b:
        return x[:n_f]
    z = np.zeros(n_f)
    _add_product(params, s, b, x, z)
    return z


@compiled
def _combine(x, force, out, params):
    """Set out = B x + A f."""
    b, a, end = int(params[-2]), int(params[-1]), params.shape[0] - _SIZES
    for i in range(out.shape[0] if a < end else out.shape[0] - force.shape[0]):
        out[i] = 0.0
    _add_product(params, b, a, x, out)
    _add_product(params, a, end, force, out)


@compiled
def _combine_slopes(block, out, params):
    """Set out = B + A J S."""
    s, b, a = int(params[-3]), int(params[-2]), int(params[-1])
    n, n_f = out.shape[0], block.shape[0]
    for i in range(n):
        for j in range(n):
            in_place = s == b and i >= n - n_f and j < n_f
            out[i, j] = block[i - n + n_f, j] if in_place else 0.0
    for p in range(b, a, 3):
        out[int(params[p]), int(params[p + 1])] += params[p + 2]
    for p in range(a, params.shape[0] - _SIZES, 3):
        i, k = int(params[p]), int(params[p + 1])
        for q in range(s, b, 3):
            change = params[p + 2] * block[k, int(params[q])] * params[q + 2]
            out[i, int(params[q + 1])] += change


@inner
def _add_product(params, begin, end, x, out):
    """Add the product with x of the matrix whose triples stand there in params."""
    p = begin
    while p < end:
        row, total = params[p], 0.0
        while p < end and params[p] == row:
            total += params[p + 2] * x[int(params[p + 1])]
            p += 3
        out[int(row)] += total
