"""What a collocation step errs by, and how that compares with its tolerance (floor 1)."""

import numpy as np

from .._jit import kernel
from .collocation import FORCE, POSITION, PRIMARY
from .linalg import substitute

# Tangents that have decayed are known to their rounding alone, which grows as they are stretched:
# no step is refused for less than this.
_TANGENT = 1e-9
# Share of p(0) below which no error of p can be told.
_ROUNDING = 1e-14


@kernel
def estimate(h, channels, orders, legendre, local, drivers, values, newton, errors):
    """Error of p by each driver: the Legendre coefficient after the last, integrated.

    It counts by what the equations leave of it, little where they are stiff, and not for more than
    it is. Nor may p itself, as the dense output interpolates it, be further off.
    """
    # local (n_k, s, s), drivers (3 R, s, s), values (3 or 4, d, s), errors (d,)
    d, s, n_a = errors.shape[0], values.shape[2], orders.shape[0]
    matrix, order = newton
    defect, left = np.empty(d * s), np.empty(d * s)
    for c in range(d):
        last, shrink = tail(legendre, values[PRIMARY, c])
        errors[c] = abs(last) * shrink * shrink
    for driver in range(values.shape[0]):
        defect[:] = 0.0
        for row in range(channels.shape[0]):
            c, q, k = int(channels[row, 0]), int(channels[row, 1]), int(channels[row, 2])
            if q != driver:
                continue
            last, shrink = tail(legendre, values[q, c % d])
            size = 1.0
            if k >= n_a:
                size = np.max(np.abs(local[k - n_a, -1]))
            elif k >= 0:
                size = h ** orders[k]
            if c >= d:
                size *= np.max(np.abs(drivers[3 * (c - d) + FORCE, -1]))
            for i in range(s):
                defect[(c % d) * s + i] += channels[row, 3] * size * last * shrink
        if not np.any(defect):
            continue
        substitute(matrix, order, defect, left)
        # a matrix next to singular would make rounding of it
        share = min(1.0, np.max(np.abs(defect)) / max(np.max(np.abs(left)), 1e-300))
        for c in range(d):
            errors[c] += share * np.max(np.abs(left[c * s : (c + 1) * s]))


@kernel
def tail(legendre, values):
    """The last Legendre coefficient, and the size of its ratio to the one before, 1 at most."""
    # values (s,)
    s = values.shape[0]
    last, before = 0.0, 0.0
    for j in range(s):
        last += legendre[s - 1, j] * values[j]
        before += legendre[s - 2, j] * values[j]
    return last, (min(1.0, abs(last / before)) if before != 0.0 else 1.0)


@kernel
def worst_tangent(h, channels, orders, legendre, local, drivers, values, newton, rtol):
    """Largest ratio of a tangent's error to its tolerance, relative to all of the tangent."""
    worst, errors = 0.0, np.empty(values.shape[2])
    for strand in range(1, values.shape[0]):
        estimate(h, channels, orders, legendre, local, drivers, values[strand], newton, errors)
        size = np.max(np.abs(values[strand, PRIMARY:]))
        if not size < np.inf:
            return np.inf
        if size > 0.0:
            worst = max(worst, np.max(errors) / (max(rtol, _TANGENT) * size))
    return worst


@kernel
def over_tolerance(h, errors, values, second, largest, p0, rtol, atol):
    """Largest ratio of an error to its tolerance, over y and, where it is unknown, y'.

    p is p(0) and what the modes take from it again: it is known to the rounding of p(0) alone.
    """
    worst = 0.0
    for c in range(errors.shape[0]):
        size_p, size_x = 0.0, 0.0
        for i in range(values.shape[2]):
            size_p = max(size_p, abs(values[PRIMARY, c, i]))
            size_x = max(size_x, abs(values[POSITION, c, i]))
        if second[c] == 1:
            size_p = max(size_p, largest[c])
            worst = max(worst, h * errors[c] / (atol + rtol * size_x))
        worst = max(worst, errors[c] / max(atol + rtol * size_p, _ROUNDING * abs(p0[c])))
        if not errors[c] < np.inf:
            return np.inf
    return worst
