"""Check a given Jacobian against differences of the right-hand side."""

from typing import Any

import numpy as np

from ..compiled.functions import Functions
from ..compiled.jacobian import VALUES, extend, force_at, jacobian_at, right_side
from ..compiled.signatures import RightSide
from ..compiled.units import units_of
from ..support.checks import complaint

# Two steps of the differences that check a Jacobian, relative to the size of a component.
_CHECK_STEPS = 1e-4, 1e-5
# Relative deviation of an entry of a dense Jacobian that rounding and truncation cannot explain.
_OF_ENTRY = 1e-3
# Such a deviation for the product of a given sparse Jacobian with a direction, relative to moduli.
_OF_GIVEN = 1e-6
# Such a deviation for the product of a sparse Jacobian by differences with a direction.
_OF_DIFFERENCES = 1e-9
# Ratio of one trial step to the next one.
_TRIAL_STEP_RATIO = 1024.0
# Largest number of trial steps of a component.
_MOST_TRIALS = 12


def check_jacobian(functions: Functions, y0: np.ndarray, structure: Any = None) -> None:
    """Refuse a Jacobian that is not the derivative of the right-hand side near y0, at t = 0."""
    if found := wrong_jacobian(functions, y0, structure):
        raise ValueError(found)


def wrong_jacobian(
    functions: Functions, y0: np.ndarray, structure: Any = None, t: float = 0.0
) -> str:
    """Return a complaint of a Jacobian that is not the derivative of f near y0; else ""."""
    # Products with directions are compared with differences of `rhs` along them: axes for a dense
    # Jacobian, a random one with a structure, also to find entries that it lacks. A product is
    # wrong if it misses two differences, of a longer and a shorter step, by over ten times their
    # distance. The Jacobian is refused if wrong at two of three points, so no corner or jump of
    # `rhs`, nor a point outside of its domain, refuses it. One point is y0; others differ by up to
    # 3 % of the larger of size and a tenth of the unit. A dense Jacobian is refused if an entry
    # errs by over 1 % of the largest of its row, and accepted if all err by less than 0.1 % of
    # themselves, over this neighbourhood. Errors within the rounding of differences are not found.
    # y0 (d,); t: since the start [time].
    random = np.random.default_rng(0)
    right = right_side(functions, structure is not None)
    units = np.empty(y0.size)
    units_of(right, y0, 1.0, np.ones(y0.size), units)
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
        trial = _deviation(right, structure, t, y, units, directions, lengths)
        if trial is not None:
            found.append(trial)
    counts = np.sum([wrong for wrong, _, _ in found], axis=0) if found else np.zeros((1, 1))
    if counts.max() < 2:
        return ""
    where = "near y0 at the start" if t == 0 else "where the run ends"
    i, j = np.unravel_index(np.argmax(counts), counts.shape)
    name = "jac" if functions.has_jac else "jac_sparsity or bandwidth"
    if structure is None:
        given, expected = next((g[i, j], e[i, j]) for wrong, g, e in found if wrong[i, j])
        of_memory = j >= functions.n
        name, of = ("jac_memory", "memory") if of_memory else (name, "y")
        got = f"{given:.6g} in row {i}, column {j - functions.n * of_memory}, {where}"
        required = f"hold d rhs[i] / d {of}[j] = {expected:.6g}"
        remedy = "check signs and whether it is transposed, or leave jac out for differences"
    else:
        got = f"others in row {i}, {where}"
        required = "hold every entry of d rhs / d y that differs from 0"
        remedy = "differences along a random direction tell so"
    return complaint(name, required, got, remedy)


def _deviation(
    right: RightSide,
    structure: Any,
    t: float,
    y: np.ndarray,
    units: np.ndarray,
    directions: np.ndarray,
    lengths: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return which products are wrong, given products and differences, (d, n); None if f fails."""
    # Each is judged by the step with the least sum of truncation and rounding; steps grow until
    # rounding no longer limits. A step is proportional to lengths (n,) times directions (n, d).
    entries = np.empty((y.size, y.size)) if structure is None else structure.entries.copy()
    try:
        jacobian_at(right, t, y.copy(), units, entries)
    except Exception:  # y lies outside of the domain of the Jacobian
        return None
    given, sizes = entries, np.abs(entries)
    if structure is not None:
        with np.errstate(all="ignore"):
            matrix = structure.matrix(entries[VALUES])
            given, sizes = matrix @ directions.T, abs(matrix) @ np.abs(directions.T)
    of_product = _OF_GIVEN if right.force.functions.has_jac else _OF_DIFFERENCES
    share = _OF_ENTRY if structure is None else of_product
    found, least = np.zeros_like(given), np.full(given.shape, np.inf)
    longest = np.abs(y).max() / np.abs(directions).max(axis=1)
    for _ in range(_MOST_TRIALS):
        values = _values(right, t, y, lengths[:, None] * directions)
        if values is None:
            break
        with np.errstate(all="ignore"):
            changes = (values[:, 0] - values[:, 1]).transpose(0, 2, 1)
            far, near = changes / (2 * lengths * np.array(_CHECK_STEPS)[:, None, None])
        if not all(np.all(np.isfinite(a)) for a in (given, far, near)):
            break
        moduli = np.maximum(sizes, np.abs(near))
        noise = 1e-14 * (np.abs(values).max(axis=(0, 1)).T / lengths + moduli) / _CHECK_STEPS[1]
        allowed = share * (moduli + 1e-3 * moduli.max(axis=1, keepdims=True))
        error = allowed + 10 * np.abs(far - near) + noise
        found, least = np.where(error < least, near, found), np.minimum(error, least)
        longer = np.any(noise > allowed, axis=0) & (_TRIAL_STEP_RATIO * lengths <= longest)
        if not longer.any():
            break
        lengths = np.where(longer, _TRIAL_STEP_RATIO * lengths, lengths)
    if np.isinf(least).any():
        return None
    return np.abs(given - found) > least, given, found


def _values(right: RightSide, t: float, y: np.ndarray, shifts: np.ndarray) -> np.ndarray | None:
    """Return f beside y, (2, 2, n, d): for both steps above and below y; None if f raises."""
    # shifts (n, d) are multiplied by the steps of the differences
    values = np.empty((2, 2, *shifts.shape))
    try:
        for step, (above, below) in zip(_CHECK_STEPS, values, strict=True):
            for up, down, shift in zip(above, below, step * shifts, strict=True):
                force_at(right, t, y + shift, up)
                force_at(right, t, y - shift, down)
                if not np.isfinite(up - down).all():
                    middle = np.empty(y.size)
                    force_at(right, t, y, middle)
                    extend(middle, up, down)
    except Exception:  # y lies outside of the domain of f
        return None
    return values
