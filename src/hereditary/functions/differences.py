"""A given Jacobian against differences of its right-hand side."""

from contextlib import suppress

import numpy as np

from .._checks import complaint
from .._jit import JAC_SIG, as_value
from ..compiled.error_estimate import LEAST
from ..compiled.jacobian import VALUES, jacobian_at, no_jacobian

# Steps of the two differences, in units of the size of a component.
_STEPS = 1e-4, 1e-5
# Relative deviation that rounding and truncation cannot explain.
_TOLERANCE = 1e-3
# Components that have units of their own, and the fraction of the largest below which a component
# is next to 0.
_FEW, _SMALL = 9, 1e-3
# Times at which a force that is 0 at first may have set in.
_LATER = (1e-3, 1e-2, 0.1, 1.0, 10.0)
# First trial of a step, as fraction of f; ratio of trials and their number; fraction of f that is
# clear of rounding.
_FIRST_STEP, _APART, _MOST_TRIALS, _CLEAR = 1e-3, 1024.0, 12, 1e-5
# The same of products with a direction, in comparison with the summands of their rows: of a given
# Jacobian, and of one by differences.
_OF_GIVEN, _OF_DIFFERENCES = 1e-6, 1e-9


def check_jacobian(rhs, jac, y0, params):
    """Refuse a Jacobian that is not the derivative of the right-hand side near y0, at t = 0.

    An entry is refused where two points of three find it wrong beyond doubt: it misses two
    differences, of longer and of shorter steps, by more than ten times what these are apart. So
    corners, jumps and points outside the domain of `rhs` refuse nothing.

    Parameters
    ----------
    rhs, jac : callable
        Compiled, filling their third argument.
    y0, params : ndarray, shape (d,) and (p,)
    """
    aside = np.random.default_rng(0).uniform(0.5, 1.0, (2, y0.size))
    units = units_of(rhs, params, y0)
    units[units == 0] = 1.0
    scale = np.maximum(np.abs(y0), 0.1 * units)
    points = [y0, y0 + 0.03 * scale * aside[0], y0 - 0.03 * scale * aside[1]]
    found = [trial for y in points if (trial := _deviation(rhs, jac, y, params, units))]
    counts = sum((wrong.astype(int) for wrong, _, _ in found), np.zeros((y0.size, y0.size), int))
    if counts.max() < 2:
        return
    i, j = np.unravel_index(np.argmax(counts), counts.shape)
    _, given, expected = next(trial for trial in found if trial[0][i, j])
    got = f"{given[i, j]:.6g} in row {i}, column {j}, near y0 at the start"
    required = f"hold d rhs[i] / d y[j] = {expected[i, j]:.6g}"
    remedy = "check signs and whether it is transposed, or leave jac out for differences"
    raise ValueError(complaint("jac", required, got, remedy))


def check_entries(rhs, jac, structure, y0, params):
    """Refuse entries of a Jacobian that miss some near y0, or are wrong, by random directions.

    Products of the entries, given or by differences, with a direction are compared with
    differences of `rhs` along it, as in `check_jacobian`.
    """
    random = np.random.default_rng(0)
    units = units_of(rhs, params, y0)
    units[units == 0] = 1.0
    scale = np.maximum(np.abs(y0), 0.1 * units)
    aside = random.uniform(0.5, 1.0, (2, y0.size)) * 0.03 * scale
    found = []
    for y in (y0, y0 + aside[0], y0 - aside[1]):
        direction = random.choice([-1.0, 1.0], y0.size) * random.uniform(0.5, 1.0, y0.size)
        trial = _missed(rhs, jac, structure, y, params, units, direction * scale)
        if trial is not None:
            found.append(trial)
    wrong = np.flatnonzero(sum(trial.astype(int) for trial in found) >= 2 if found else 0)
    if wrong.size:
        name = "jac_sparsity or bandwidth" if jac is None else "jac"
        required = "hold every entry of d rhs / d y that differs from 0"
        remedy = "differences along a random direction tell so"
        got = f"others in row {wrong[0]}, near y0 at the start"
        raise ValueError(complaint(name, required, got, remedy))


def units_of(rhs, params, y0):
    """Return units of components, (d,), for the steps of differences where y is small.

    Sizes of y0; of a component that begins at 0, or next to it, a step that moves f clearly and in
    proportion, or 0 where none is found. Many components share the largest size, or that of f.
    """
    units = np.abs(y0)
    small = np.flatnonzero(units <= _SMALL * units.max())
    if y0.size > _FEW:
        units[:] = units.max() or np.abs(_moved(rhs, params, y0)).max()
        small = small[:0]
    for c in small:
        units[c] = _visible_step(rhs, params, y0, c)
    # powers of two, with which scaling is exact
    known = (units > LEAST) & (units < np.inf)
    return np.ldexp(known.astype(float), np.frexp(np.where(known, units, 1.0))[1] - 1)


def _visible_step(rhs, params, y0, c):
    """Return a step of component c that moves f clearly and in proportion, at t = 0; 0 for none."""
    force, found, shrunk = _moved(rhs, params, y0), 0.0, False
    size = max(abs(y0[c]), _FIRST_STEP * abs(force[c]))
    size = size if size > LEAST else _FIRST_STEP * np.abs(y0).max()
    if size == 0:  # a force that sets in, or acts on another component
        later = [abs(_moved(rhs, params, y0, t=t)[c]) for t in _LATER]
        size = _FIRST_STEP * (np.nanmax([0.0, *later]) or np.abs(force).max())
    step = size
    for _ in range(_MOST_TRIALS if 0 < step < np.inf else 0):
        change, twice = (_moved(rhs, params, y0, c, by) - force for by in (step, 2 * step))
        linear = np.abs(twice - 2 * change) <= 0.1 * np.abs(twice) + 1e-13 * np.abs(force)
        # in its own equation, if it is there: other rows may hold its square alone
        if not (linear[c] if change[c] else linear.all()):
            if found:
                return found
            step, shrunk = step / _APART, True
            continue
        seen = (change == 0) | (np.abs(change) >= _CLEAR * np.abs(force))
        if seen[c] if change[c] else seen.all():
            found = found or step
            if shrunk or change[c] or not np.any((change == 0) & (force != 0)):
                return step if change.any() else size
        step *= _APART  # f may hide the change by its rounding
    return found


def _moved(rhs, params, y0, c=0, step=0.0, t=0.0):
    """Return f with a component moved, (d,); NaN outside of the domain of f."""
    y, found = y0.copy(), np.full(y0.size, np.nan)
    y[c] += step
    with suppress(Exception):
        rhs(t, y, found, params)
    return found


def _missed(rhs, jac, structure, y, params, units, direction):
    """Rows in which products with a direction are wrong; None where it cannot tell."""
    entries = structure.entries.copy()
    try:
        if jac is None:
            none = as_value(no_jacobian, JAC_SIG)
            jacobian_at(rhs, none, 0, 0.0, y, params, units, entries)
        else:
            jac(0.0, y.copy(), entries, params)
        values = np.empty((4, y.size))
        for row, step in zip(values, (_STEPS[0], -_STEPS[0], _STEPS[1], -_STEPS[1]), strict=True):
            rhs(0.0, y + step * direction, row, params)
    except Exception:  # y lies outside of the domain of the functions
        return None
    far, near = (values[::2] - values[1::2]) / (2 * np.array(_STEPS)[:, None])
    matrix = structure.matrix(entries[VALUES])
    given, sizes = matrix @ direction, abs(matrix) @ np.abs(direction)
    if not all(np.all(np.isfinite(a)) for a in (given, far, near)):
        return None
    noise = 1e-14 * (np.abs(values).max(axis=0) + sizes) / _STEPS[1]
    share = _OF_DIFFERENCES if jac is None else _OF_GIVEN
    return np.abs(given - near) > share * sizes + 10 * np.abs(far - near) + noise


def _deviation(rhs, jac, y, params, units):
    """Which entries are wrong at y, the given ones, and differences; None where it cannot tell."""
    given = np.empty((y.size, y.size))
    try:
        jac(0.0, y.copy(), given, params.copy())
        pairs = [_differences(rhs, y, params, units, step) for step in _STEPS]
    except Exception:  # y lies outside of the domain of the functions
        return None
    (far, _), (near, noise) = pairs
    if not all(np.all(np.isfinite(a)) for a in (given, far, near)):
        return None
    apart = np.abs(far - near)
    sizes = np.maximum(np.abs(given), np.abs(near))
    allowed = _TOLERANCE * (sizes + 1e-3 * sizes.max(axis=1, keepdims=True)) + 10 * apart + noise
    return np.abs(given - near) > allowed, given, near


def _differences(rhs, y, params, units, step):
    """Central differences d rhs / d y, shape (d, d), and a bound on their rounding, (d, 1)."""
    jacobian, largest = np.empty((y.size, y.size)), np.zeros(y.size)
    values = np.empty((2, y.size))
    for j, size in enumerate(np.maximum(np.abs(y), units)):
        for row, shift in zip(values, (step * size, -step * size), strict=True):
            moved = y.copy()
            moved[j] += shift
            rhs(0.0, moved, row, params.copy())
        jacobian[:, j] = (values[0] - values[1]) / (2 * step * size)
        largest = np.maximum(largest, np.abs(values).max(axis=0))
    return jacobian, (1e-14 * largest / step)[:, None]
