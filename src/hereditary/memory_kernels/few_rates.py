"""A few separate rates, found to rounding: one more at a time, then all of them moved.

Least squares on a grid of rates shows a lone rate as a pair of neighbours, and comes no closer to
it than the square root of rounding. With the weights eliminated (variable projection) the problem
in log rates is smooth, and Levenberg's and Marquardt's steps solve it; a further rate begins where
the misfit asks for it most.
"""

import math

import numpy as np

from .least_squares import nonnegative_least_squares

# More rates than this are a continuous spectrum, which moving them does not help.
FEW = 12
# Steps until rounding, three times what is seen, and slow ones in a row that end them.
_STEPS, _SLOW = 150, 15
# Damping to begin with and at least, relative to the squares of the columns.
_DAMPING, _LEAST = 1e-3, 1e-28
# Longest step in a log rate.
_REACH = 1.0
# A rate that wanders so far below the slowest of the grid, in its logarithm, is 0.
_STILL = 14.0
# Rates whose weights come out negative are dropped, and the others moved again, so often at most.
_ROUNDS = 4


def few_rates(samples, grid, good_enough):
    """Log rates and weights of a fit with as few rates as will do, or None.

    Parameters
    ----------
    samples : Samples
        The kernel.
    grid : ndarray, shape (n,)
        Log rates where a rate may begin, -inf for rate 0.
    good_enough : callable
        Whether a relative error, shape (k,), is small enough.

    Returns
    -------
    tuple of ndarray, or None
        None where more than a few are needed.
    """
    columns = samples.emphasis[:, None] * samples.columns(grid)
    size = np.linalg.norm(columns, axis=0)
    grid, columns = grid[size > 1e-250], (columns / np.maximum(size, 1e-300))[:, size > 1e-250]
    v, weights, ends = (
        np.zeros(0),
        np.zeros(0),
        (grid[grid > -np.inf].min() - _STILL * (not samples.fading), grid.max()),
    )
    for _ in range(FEW):
        wish = -(samples.emphasis * samples.error(v, weights)) @ columns
        v, weights = _settled(samples, np.append(v, grid[np.argmax(wish)]), ends)
        if good_enough(samples.error(v, weights)):
            return _without_needless(samples, v, weights, ends, good_enough)
    return None


def _settled(samples, v, ends):
    """Rates moved from `v` to the least misfit, and their positive weights."""
    for _ in range(_ROUNDS):
        v = _moved(samples, v, ends)
        if not samples.fading:
            v = np.where(v <= ends[0], -np.inf, v)
        v = np.unique(v)
        table, target, size = _unit_columns(samples, v)
        q, r = np.linalg.qr(table)
        x = nonnegative_least_squares(r, q.T @ target, np.ones(v.size, dtype=bool))
        used = x > 0
        if used.all() or not used.any():
            break
        v, x, size = v[used], x[used], size[used]
    return v[x > 0], (x / size)[x > 0]


def _without_needless(samples, v, weights, ends, good_enough):
    """Without rates that the others, once moved, can do without; the lightest go first."""
    k = 0
    while v.size > 1 and k < v.size:
        lightest = np.argsort(weights * samples.columns(v).max(axis=0))
        fewer = _settled(samples, np.delete(v, lightest[k]), ends)
        k += 1
        if fewer[0].size < v.size and good_enough(samples.error(*fewer)):
            (v, weights), k = fewer, 0
    return v, weights


def _moved(samples, v, ends):
    """Levenberg's and Marquardt's steps in the log rates, inside `ends`, while the misfit falls."""
    (basis, weights, misfit), damping, slow = _projected(samples, v), _DAMPING, 0
    finite = v > -np.inf
    n = np.count_nonzero(finite)
    for _ in range(_STEPS if n else 0):
        slopes = -np.multiply.outer(samples.t, np.exp(v[finite])) * weights[finite]
        slopes *= samples.emphasis[:, None] * samples.columns(v[finite])
        slopes -= basis @ (basis.T @ slopes)
        size = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
        best = np.linalg.norm(misfit)
        for _ in range(8):
            trial = v.copy()
            step = _step(slopes / size, misfit, damping) / size
            step *= min(1.0, _REACH / max(np.abs(step).max(), 1e-300))
            trial[finite] = np.clip(v[finite] + step, *ends)
            found = _projected(samples, trial)
            if np.linalg.norm(found[2]) < best:
                break
            damping *= 30
        else:
            break
        v, (basis, weights, misfit) = trial, found
        damping = max(0.03 * damping, _LEAST)
        slow = slow + 1 if np.linalg.norm(misfit) > 0.9 * best else 0
        if slow > _SLOW:
            break
    return v


def _projected(samples, v):
    """Basis of the columns' span, the best weights of any sign, and the misfit that they leave."""
    table, target, size = _unit_columns(samples, v)
    basis, r = np.linalg.qr(table)
    # columns that are nearly equal leave a singular triangle
    weights = np.linalg.lstsq(r, basis.T @ target, rcond=1e-15)[0]
    return basis, weights / size, table @ weights - target


def _unit_columns(samples, v):
    """Columns of norm 1, the target, and the columns' norms."""
    table = samples.emphasis[:, None] * samples.columns(v)
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    return table / size, samples.emphasis * samples.values / samples.scale, size


def _step(slopes, misfit, damping):
    """The damped least-squares step against the misfit."""
    ridge = math.sqrt(damping) * np.eye(slopes.shape[1])
    q, r = np.linalg.qr(np.concatenate([slopes, ridge]))
    return -np.linalg.solve(r, q[: misfit.size].T @ misfit)
