"""Prediction and corrector sweeps, for pieces that are values of f."""

import numpy as np

from .._jit import allocating, inlined
from .jacobian import jacobian
from .step import UNITS

# Sweeps that change less than this, relative to the solution, contract by rounding.
MOVED = 1e-9


@inlined
def predict(lead, known, force, lacks, w):
    """Predict w with the last f, and add what the last sweep lacked of lead times f."""
    for c in range(w.shape[0]):
        known[c] -= lacks[c]
        w[c] = lead[c] * force[c] - known[c]
        lacks[c] = 0.0


@inlined
def correct(lead, known, f, lacks, w, moved):
    """Make a corrector sweep; `lacks` is, negated, what it took for f."""
    for c in range(w.shape[0]):
        corrected = lead[c] * f[c] - known[c]
        moved[c] = corrected - w[c]
        w[c] = corrected
        lacks[c] = -lead[c] * f[c]


@inlined
def settle(lead, f, force, lacks):
    """Keep f, and lead times what the last sweep lacked of it."""
    for c in range(f.shape[0]):
        force[c] = f[c]
        lacks[c] += lead[c] * f[c]


@allocating
def look_again(rhs, jac, has_jac, params, t, point, moved, k, output, counts):
    """Keep the Jacobian in the middle of the last two sweeps, as number k."""
    sample = output.jacobians[k]
    middle = np.empty(point.shape[0])
    for c in range(middle.shape[0]):
        middle[c] = point[c] - 0.5 * moved[c]
    units = output.room[UNITS]
    counts.rhs += jacobian(rhs, jac, has_jac, t, middle, params, units, sample)


@inlined
def contraction(n_solved, x, lead, f, moved, lacks, limits, counts):
    """Return whether sweeps contract by far less than they have in this stretch.

    That is the fraction of its limit by which one more sweep would move a component, the largest of
    all.
    """
    largest = 0.0
    for c in range(n_solved):
        if abs(moved[c]) > MOVED * abs(x[c]):
            more = abs(lead[c] * f[c] + lacks[c])
            largest = max(largest, more / (abs(moved[c]) * limits[c]))
    less = largest > 2.0 * counts.nearest
    if less:
        counts.nearest = largest
    return less
