"""Least squares with non-negative weights, for columns that are nearly equal."""

import math

import numpy as np

_RIDGE = 1e-15


def nonnegative_least_squares(a, b, start):
    """``min |a x - b|`` over x >= 0 by Lawson's and Hanson's active sets, begun at a mask."""
    used, x = _feasible(a, b, start.copy())
    best, refused = float(np.linalg.norm(b - a @ x)), np.zeros(x.size, dtype=bool)
    for _ in range(4 * x.size):
        gain = a.T @ (b - a @ x)
        gain[used | refused] = -1.0
        j = int(np.argmax(gain))
        if gain[j] <= 1e-16 * np.linalg.norm(b):
            break
        trial, z = _admit(a, b, used, x, j)
        norm = math.inf if z is None else float(np.linalg.norm(b - a @ z))
        if norm >= best:
            refused[j] = True
            continue
        if norm < 0.999 * best:
            refused[:] = False
        used, x, best = trial, z, norm
    return x


def _feasible(a, b, used):
    """The first positive solution on a subset of `used`; what comes out negative is dropped."""
    while used.any():
        z = _least_squares(a, b, used)
        if (z[used] > 0).all():
            return used, z
        used &= z > 0
    return used, np.zeros(a.shape[1])


def _admit(a, b, used, x, j):
    """The solution with column j admitted, or None where rounding alone asked for it."""
    used, x = used.copy(), x.copy()
    used[j] = True
    while True:
        z = _least_squares(a, b, used)
        negative = used & (z <= 0)
        if not negative.any():
            return used, z
        if negative[j] and x[j] == 0:
            return used, None
        x = _as_far_as_positive(x, z, negative)
        used &= x > 0


def fewer_positive(a, b, x):
    """From a solution x >= 0 to one with fewer columns and no larger ``|a x - b|``.

    Towards the least squares on the columns in use, dropping those that reach 0 on the way.
    """
    used = x > 0
    while True:
        z = _least_squares(a, b, used)
        negative = used & (z <= 0)
        if not negative.any():
            return z
        x = _as_far_as_positive(x, z, negative)
        used &= x > 0


def _as_far_as_positive(x, z, negative):
    """The point on the way from x to z where the first columns reach 0."""
    reach = np.full(x.size, np.inf)
    reach[negative] = x[negative] / (x[negative] - z[negative])
    x = np.maximum(x + reach.min() * (z - x), 0.0)
    x[reach <= reach.min() * (1 + 1e-12)] = 0.0
    return x


def _least_squares(a, b, used):
    """Least squares on the columns used, with a ridge at rounding against equal columns."""
    n = int(np.count_nonzero(used))
    q, r = np.linalg.qr(np.concatenate([a[:, used], _RIDGE * np.eye(n)]))
    z = np.zeros(a.shape[1])
    z[used] = np.linalg.solve(r, q[: b.size].T @ b)
    return z
