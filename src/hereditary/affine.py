"""Right-hand sides ``B x + A f(t, S x)`` that are made of a right-hand side f.

Their Jacobians are ``B + A J S``. Behind the parameters of f stand the entries of S, B and A as
triples (row, column, value), then the number of values of f, and where each matrix begins.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from .compiled.jit import JAC_SIG, RHS_SIG, as_value, compiled, derived, inner

# Numbers behind the triples.
_SIZES = 4


def affine(functions, n_f, b, a=(), s=()) -> tuple[np.ndarray, Any, Any]:
    """Return params, right-hand side, and Jacobian or None, of ``B x + A f(t, S x)``.

    Parameters
    ----------
    functions : (ndarray, callable, callable or None)
        Those of f.
    n_f : int
        Number of values that f reads, and returns.
    b, a, s : array_like, shape (k, 3)
        Row, column and value of entries, which add up where one place has several. Without any of
        `s`, f reads the first components; without any of `a`, its values belong to the last ones.
    """
    params, rhs, jac = functions
    parts = [params, *(np.ravel(part) for part in (s, b, a))]
    begins = np.cumsum([part.size for part in parts])[:3]
    return np.concatenate([*parts, [n_f], begins]), _side(rhs), jac and _slopes(jac)


@lru_cache(maxsize=64)
def _side(rhs):
    """Return ``B x + A f(t, S x)``."""

    def side(t, x, out, params):
        z, force, own = _arguments(x, out, params)
        rhs(t, z, force, own)
        _combine(x, force, out, params)

    return as_value(derived(side), RHS_SIG)


@lru_cache(maxsize=64)
def _slopes(jac):
    """Return ``B + A J S``."""

    def slopes(t, x, out, params):
        z, _, own = _arguments(x, x, params)
        block = _square(z)
        jac(t, z, block, own)
        _combine_slopes(block, out, params)

    return as_value(derived(slopes), JAC_SIG)


# What follows is the same for every f, and kept on disk.


@compiled
def _arguments(x, out, params):
    """Return S x, where f sets its values, and its parameters."""
    n_f, s, b, a = int(params[-4]), int(params[-3]), int(params[-2]), int(params[-1])
    z, force = x[:n_f], out[out.shape[0] - n_f :]
    if s < b:
        z = np.zeros(n_f)
        _add_product(params, s, b, x, z)
    if a < params.shape[0] - _SIZES:
        force = np.empty(n_f)
    return z, force, params[:s]


@compiled
def _square(z):
    """Return room for the Jacobian of f."""
    return np.empty((z.shape[0], z.shape[0]))


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
    n, s, b, a = out.shape[0], int(params[-3]), int(params[-2]), int(params[-1])
    for i in range(n):
        for j in range(n):
            out[i, j] = 0.0
    for p in range(b, a, 3):
        out[int(params[p]), int(params[p + 1])] += params[p + 2]
    for p in range(a, params.shape[0] - _SIZES, 3):
        _add_row(params, s, b, params[p + 2], block[int(params[p + 1])], out[int(params[p])])
    last = block.shape[0] if a == params.shape[0] - _SIZES else 0
    for k in range(last):
        _add_row(params, s, b, 1.0, block[k], out[n - last + k])


@inner
def _add_product(params, begin, end, x, out):
    """Add the product with x of the matrix whose triples stand there in params."""
    for p in range(begin, end, 3):
        out[int(params[p])] += params[p + 2] * x[int(params[p + 1])]


@inner
def _add_row(params, s, b, factor, slopes, out):
    """Add a multiple of a row of J S, of which J has these slopes."""
    for j in range(slopes.shape[0] if s == b else 0):
        out[j] += factor * slopes[j]
    for p in range(s, b, 3):
        out[int(params[p + 1])] += factor * slopes[int(params[p])] * params[p + 2]
