"""Right-hand sides ``B x + A f(t + t_0, S x)``, affine transformations of a right-hand side f.

Their Jacobians are ``B + A J S``, with the Jacobian J of f. One array has all parameters: those of
f, the matrices S, B and A, and five numbers. These are t_0, the number of values of f, and the
index of each matrix in the array. A matrix of n rows is stored as n + 1 offsets, followed by pairs
of column and value, row by row. An offset is the position, from the beginning of the matrix, at
which the pairs of a row begin. The last offset is the position at which all pairs end.

S and A are stored empty if f reads the first components of x and gives the last values of the
result. Then f writes its values directly into the result.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..compiled.jit import JAC_SIG, RHS_SIG, as_value, compiled, derived, inner

# Number of parameters after the matrices: t_0, the number of values of f, and three indices.
_SIZES = 5


def affine(
    functions: tuple[np.ndarray, Any, Any],
    n: int,
    n_f: int,
    b: ArrayLike = (),
    a: ArrayLike | None = None,
    s: ArrayLike | None = None,
    t_0: float = 0.0,
) -> tuple[np.ndarray, Any, Any]:
    """Return params, right-hand side, and Jacobian or None, of ``B x + A f(t + t_0, S x)``.

    Parameters
    ----------
    functions : (ndarray, callable, callable or None)
        Parameters of f, f itself, and its Jacobian or None.
    n, n_f : int
        Number of components x. Number of values that f reads, which is that of its results too.
    b, a, s : array_like, shape (k, 3), optional
        Matrices B, A and S as k entries (row, column, value); values of equal row and column add
        up. B is 0 by default. By default f reads the first components, and gives the last values.
    t_0 : float, optional
        Shift of the time.
    """
    params, rhs, jac = functions
    own, ones = np.arange(n_f), np.ones(n_f)
    first, last = np.c_[own, own, ones], np.c_[n - n_f + own, own, ones]
    s, a = first if s is None else s, last if a is None else a
    in_place = np.array_equal(s, first) and np.array_equal(a, last)
    parts = [params, _by_rows(s, n_f), _by_rows(b, n), _by_rows(a, n)]
    if in_place:
        parts[1] = parts[3] = np.zeros(0)
    begins = np.cumsum([part.size for part in parts])[:3]
    values = np.concatenate([*parts, [t_0, n_f], begins])
    return values, _side(rhs, in_place), jac and slopes(jac)


def _by_rows(triples: ArrayLike, n: int) -> np.ndarray:
    """Return a matrix of n rows as offsets and pairs, from its entries (row, column, value)."""
    triples = np.reshape(triples, (-1, 3))
    triples = triples[np.argsort(triples[:, 0], kind="stable")]
    begins = n + 1 + 2 * np.searchsorted(triples[:, 0], np.arange(n + 1))
    return np.concatenate([begins, triples[:, 1:].ravel()])


@inner
def own_size(params: np.ndarray) -> int:
    """Return the number of parameters of f."""
    return int(params[-3])


@inner
def later(t: float, params: np.ndarray) -> float:
    """Return the time t + t_0 at which f is evaluated."""
    return t + params[-5]


@lru_cache(maxsize=64)
def _side(rhs: Any, in_place: bool) -> Any:
    """Return the compiled function ``B x + A f(t + t_0, S x)``, where f is `rhs`."""

    def last(t: float, x: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
        n_f = int(params[-4])
        force = out[out.shape[0] - n_f :]
        rhs(later(t, params), x[:n_f], force, params[: own_size(params)])
        _combine(x, force, out, params)

    def anywhere(t: float, x: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
        z = _arguments(x, params)
        force = np.empty(z.shape[0])
        rhs(later(t, params), z, force, params[: own_size(params)])
        _combine(x, force, out, params)

    return as_value(derived(last, allocates=False) if in_place else derived(anywhere), RHS_SIG)


@lru_cache(maxsize=64)
def slopes(jac: Any) -> Any:
    """Return the compiled Jacobian ``B + A J S``, where J is `jac`; see `affine`."""

    def all_slopes(t: float, x: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
        z = _arguments(x, params)
        block = np.empty((z.shape[0], z.shape[0]))
        jac(later(t, params), z, block, params[: own_size(params)])
        _combine_slopes(block, out, params)

    return as_value(derived(all_slopes), JAC_SIG)


# The following functions do not depend on f, so their machine code is stored on disk.


@compiled
def _arguments(x: np.ndarray, params: np.ndarray) -> np.ndarray:
    """Return S x, the components that f reads."""
    n_f, s, b = int(params[-4]), int(params[-3]), int(params[-2])
    if s == b:
        return x[:n_f]
    z = np.zeros(n_f)
    _add_product(params[s:], x, z)
    return z


@compiled
def _combine(x: np.ndarray, force: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
    """Set out = B x + A f, where f is the vector `force`."""
    b, a = int(params[-2]), int(params[-1])
    in_place = a == params.shape[0] - _SIZES
    for i in range(out.shape[0] - force.shape[0] if in_place else out.shape[0]):
        out[i] = 0.0
    _add_product(params[b:], x, out)
    if not in_place:
        _add_product(params[a:], force, out)


@compiled
def _combine_slopes(block: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
    """Set out = B + A J S, where J is the matrix `block`."""
    n, n_f = out.shape[0], block.shape[0]
    s, b, a = int(params[-3]), int(params[-2]), int(params[-1])
    in_place, read, own, before = s == b, params[s:], params[b:], params[a:]
    for i in range(n):
        for j in range(n):
            copied = in_place and i >= n - n_f and j < n_f
            out[i, j] = block[i - n + n_f, j] if copied else 0.0
        for p in range(int(own[i]), int(own[i + 1]), 2):
            out[i, int(own[p])] += own[p + 1]
        if in_place:
            continue
        for p in range(int(before[i]), int(before[i + 1]), 2):
            for k in range(n_f):
                change = before[p + 1] * block[int(before[p]), k]
                for q in range(int(read[k]), int(read[k + 1]), 2):
                    out[i, int(read[q])] += change * read[q + 1]


@inner
def _add_product(matrix: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    """Add the product of a matrix, stored as offsets and pairs, with x to `out`."""
    for i in range(out.shape[0]):
        total = 0.0
        for p in range(int(matrix[i]), int(matrix[i + 1]), 2):
            total += matrix[p + 1] * x[int(matrix[p])]
        out[i] += total
