"""Check a given Jacobian against differences of the right-hand side; find units of components.

The unit of a component is the least size that steps of differences take it to have.
"""

from contextlib import suppress
from typing import Any

import numpy as np

from ..compiled.jacobian import FEW, LEAST, VALUES, extend, jacobian_at, right_side
from ..support.checks import complaint

# Steps of two difference quotients that are compared, in units of the size of a component.
_STEPS = 1e-4, 1e-5
# Relative difference of an entry of a dense Jacobian from difference quotients that rounding and
# truncation do not explain.
_OF_ENTRY = 1e-3
# Relative difference, unexplained likewise, of a product of the given sparse entries with a
# direction.
_OF_GIVEN = 1e-6
# Relative difference, unexplained likewise, of a product of sparse entries by differences with a
# direction.
_OF_DIFFERENCES = 1e-9
# A component below this fraction of the largest one counts as next to 0.
_SMALL = 1e-3
# Times at which a force that is 0 at the start is evaluated, because it may have set in.
_LATER = (1e-3, 1e-2, 0.1, 1.0, 10.0)
# First step that is tried for a component next to 0, as a fraction of f.
_FIRST_STEP = 1e-3
# Ratio of two consecutive steps that are tried.
_APART = 1024.0
# Most steps that are tried.
_MOST_TRIALS = 12
# Relative change of f that exceeds rounding for certain.
_CLEAR = 1e-5


def check_jacobian(
    rhs: Any, jac: Any, y0: np.ndarray, params: np.ndarray, structure: Any = None
) -> None:
    """Refuse a Jacobian that is not the derivative of the right-hand side near y0, at t = 0."""
    if found := wrong_jacobian(rhs, jac, y0, params, structure):
        raise ValueError(found)


def wrong_jacobian(
    rhs: Any, jac: Any, y0: np.ndarray, params: np.ndarray, structure: Any = None, t: float = 0.0
) -> str:
    """Return a complaint if the Jacobian is not the derivative of `rhs` near y0; otherwise "".

    Products of the Jacobian with directions are compared with differences of `rhs` along these
    directions. For a dense Jacobian the directions are the axes; with a `structure` there is one
    random direction. Without `jac` the entries of the structure are differences, and the check
    finds entries that the structure lacks.

    A product is wrong at a point if it misses a difference by too much. That is ten times the
    distance of two differences, of longer and of shorter steps. The Jacobian is refused if a
    product is wrong at two of three points. Therefore a corner or a jump of `rhs` does not refuse
    it, nor does a point outside of the domain of `rhs`.

    Parameters
    ----------
    rhs, jac : callable
        Compiled functions, which fill their third argument.
    y0, params : ndarray, shape (d,) and (p,)
    structure : Structure, optional
    t : float
        Time since the start [time].
    """
    random = np.random.default_rng(0)
    units = units_of(rhs, params, y0)
    units[units == 0] = 1.0
    scale = np.maximum(np.abs(y0), 0.1 * units)
    aside = random.uniform(0.5, 1.0, (2, y0.size)) * 0.03 * scale
    found = []
    for y in (y0, y0 + aside[0], y0 - aside[1]):
        if structure is None:
            directions, lengths = np.eye(y0.size), np.maximum(np.abs(y), units)
        else:
            signs = random.choice([-1.0, 1.0], y0.size)
            directions = (signs * random.uniform(0.5, 1.0, y0.size) * scale)[None]
            lengths = np.ones(1)
        trial = _deviation(rhs, jac, structure, t, y, params, units, directions, lengths)
        if trial is not None:
            found.append(trial)
    counts = np.sum([wrong for wrong, _, _ in found], axis=0) if found else np.zeros((1, 1))
    if counts.max() < 2:
        return ""
    where = "near y0 at the start" if t == 0 else "where the run ends"
    i, j = np.unravel_index(np.argmax(counts), counts.shape)
    if structure is None:
        given, expected = next((g[i, j], e[i, j]) for wrong, g, e in found if wrong[i, j])
        got = f"{given:.6g} in row {i}, column {j}, {where}"
        required = f"hold d rhs[i] / d y[j] = {expected:.6g}"
        remedy = "check signs and whether it is transposed, or leave jac out for differences"
    else:
        got = f"others in row {i}, {where}"
        required = "hold every entry of d rhs / d y that differs from 0"
        remedy = "differences along a random direction tell so"
    name = "jac_sparsity or bandwidth" if jac is None else "jac"
    return complaint(name, required, got, remedy)


def _deviation(
    rhs: Any,
    jac: Any,
    structure: Any,
    t: float,
    y: np.ndarray,
    params: np.ndarray,
    units: np.ndarray,
    directions: np.ndarray,
    lengths: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return which products are wrong, the products, and differences, (d, n); None if unknown.

    Parameters
    ----------
    directions, lengths : ndarray, shape (n, d) and (n,)
        Steps of difference quotients are proportional to direction times length.
    """
    entries = np.empty((y.size, y.size)) if structure is None else structure.entries.copy()
    values, shifts = np.empty((2, 2, *directions.shape)), lengths[:, None] * directions
    try:
        if jac is None:
            jacobian_at(right_side(rhs, None, params, sparse=True), t, y, units, entries)
        else:
            jac(t, y.copy(), entries, params)
        for step, (above, below) in zip(_STEPS, values, strict=True):
            for up, down, shift in zip(above, below, step * shifts, strict=True):
                rhs(t, y + shift, up, params)
                rhs(t, y - shift, down, params)
                if not np.isfinite(up - down).all():
                    extend(rhs, t, y, params, up, down)
    except Exception:  # y lies outside of the domain of the functions
        return None
    given, sizes = entries, np.abs(entries)
    with np.errstate(all="ignore"):
        if structure is not None:
            matrix = structure.matrix(entries[VALUES])
            given, sizes = matrix @ directions.T, abs(matrix) @ np.abs(directions.T)
        changes = (values[:, 0] - values[:, 1]).transpose(0, 2, 1)
        far, near = changes / (2 * lengths * np.array(_STEPS)[:, None, None])
    if not all(np.all(np.isfinite(a)) for a in (given, far, near)):
        return None
    sizes = np.maximum(sizes, np.abs(near))
    noise = 1e-14 * (np.abs(values).max(axis=(0, 1)).T / lengths + sizes) / _STEPS[1]
    share = _OF_ENTRY if structure is None else _OF_DIFFERENCES if jac is None else _OF_GIVEN
    allowed = share * (sizes + 1e-3 * sizes.max(axis=1, keepdims=True))
    return np.abs(given - near) > allowed + 10 * np.abs(far - near) + noise, given, near


def units_of(rhs: Any, params: np.ndarray, y0: np.ndarray) -> np.ndarray:
    """Return units of components, (d,), for steps of difference quotients where y is small.

    The unit is the size of y0. For a component that is 0 at the start, or next to 0, it is a step
    that moves f clearly and in proportion. It is 0 if there is no such step. In large systems all
    components have the largest size, or that of f.
    """
    units = np.abs(y0)
    small = np.flatnonzero(units <= _SMALL * units.max())
    if y0.size > FEW:  # one unit for all components of a large system
        units[:] = units.max() or np.abs(_moved(rhs, params, y0)).max()
        small = small[:0]
    with np.errstate(all="ignore"):  # steps may grow beyond all numbers
        for c in small.tolist():
            units[c] = _visible_step(rhs, params, y0, c)
    # powers of two, with which scaling is exact
    known = (units > LEAST) & (units < np.inf)
    return np.ldexp(known.astype(float), np.frexp(np.where(known, units, 1.0))[1] - 1)


def _visible_step(rhs: Any, params: np.ndarray, y0: np.ndarray, c: int) -> float:
    """Return a step of component c that changes f clearly and proportionally at t = 0.

    Returns 0 if no trial step does.
    """
    force, found, shrunk = _moved(rhs, params, y0), 0.0, False
    size = max(abs(y0[c]), _FIRST_STEP * abs(force[c]))
    size = size if size > LEAST else _FIRST_STEP * np.abs(y0).max()
    if size == 0:  # f_c = 0 at first: it may start later, or depend on others only
        later = [abs(_moved(rhs, params, y0, t=t)[c]) for t in _LATER]
        size = _FIRST_STEP * (np.nanmax([0.0, *later]) or np.abs(force).max())
    step = size
    for _ in range(_MOST_TRIALS if 0 < step < np.inf else 0):
        change, twice = (_moved(rhs, params, y0, c, by) - force for by in (step, 2 * step))
        linear = np.abs(twice - 2 * change) <= 0.1 * np.abs(twice) + 1e-13 * np.abs(force)
        # f must be linear in the component in its own equation if it occurs there: other rows may
        # contain its square alone
        if not (linear[c] if change[c] else linear.all()):
            if found:
                return found
            step, shrunk = step / _APART, True
            continue
        clear = np.abs(change) >= _CLEAR * np.abs(force)
        seen = clear | (change == 0)
        if seen[c] if change[c] else seen.all():
            found = found or step
            if shrunk or clear.all():
                return step if change.any() and linear.all() else found
        step *= _APART  # rounding of f may hide the change
    return found


def _moved(
    rhs: Any, params: np.ndarray, y0: np.ndarray, c: int = 0, step: float = 0.0, t: float = 0.0
) -> np.ndarray:
    """Return f (d,) at y0 with component c changed by `step`.

    If f is not finite there, component c is changed by -`step` instead. The result may be NaN.
    """
    found = np.full(y0.size, np.nan)
    for by in (step, -step):
        y = y0.copy()
        y[c] += by
        with suppress(Exception):
            rhs(t, y, found, params)
        if np.isfinite(found).all():
            break
    return found
