"""Error of first-order runs on given steps, from two companions with fewer steps."""

from __future__ import annotations

from contextlib import contextmanager
from threading import local

import numpy as np

from .._warning import silence, warn
from ..meshes import UniformSteps
from .solution import SolveWarning
from .stepper import Stepper

# Steps of the run for one of each companion; fewest steps of a run that is estimated.
_RATIOS, _FEWEST = (10, 20), 400
# Numbers of the coarser companion between comparisons: fewer take longer, more take room.
_NUMBERS = 65_536
# Largest difference of companions that is no sign of chaos, and largest error without a warning,
# as fractions of the solution's size.
_CHAOS, _LARGE = 1.0, 0.05

_off = local()


@contextmanager
def no_estimates():
    """Leave estimates out in this thread: sweeps make many runs."""
    before, _off.now = getattr(_off, "now", False), True
    try:
        yield
    finally:
        _off.now = before


def note_error(solution, stepper, n_steps):
    """Estimate the error of a first-order run in its stats, and warn of a large one.

    ``stats["error_estimate"]`` is None where there is no estimate.
    """
    off = getattr(_off, "now", False) or not solution.success
    found = None if off else estimated_error(stepper, n_steps)
    solution.stats["error_estimate"] = found
    if found is not None and found > _LARGE:
        warn(
            f"errors are about {100 * found:.0f} % of the solution's size with {n_steps} steps of "
            f"the first-order scheme {stepper.scheme!r}: take rtol=1e-6, scheme=BDF(2) or more "
            "steps; estimate=False leaves this estimate out",
            SolveWarning,
        )


def estimated_error(stepper, n_steps):
    """Return the largest error of a run relative to the size of each component, or None.

    Companions with a tenth and a twentieth of the steps differ by about ten times the error of the
    run. At the first step of orders below 1 the error falls as h**alpha instead of h.
    """
    n = n_steps // _RATIOS[1]
    if n_steps < _FEWEST:
        return None
    equation, t_end = stepper.equation, stepper.t
    difference, size = np.zeros((2, equation.d))
    first: np.ndarray | None = None
    with silence():
        how = equation, stepper.scheme, stepper.history
        fine, coarse = (Stepper(*how, UniformSteps(t_end / k), k) for k in (2 * n, n))
        begun = 0
        while begun < n:
            end = min(begun + max(1, _NUMBERS // equation.d), n)
            rows, others = _rows(fine, 2 * end), _rows(coarse, end)
            if len(rows) != 2 * len(others) or len(others) != end - begun:
                return None
            apart = np.abs(rows[1::2] - others)
            first = apart[0] if first is None else first
            difference = np.maximum(difference, apart.max(axis=0))
            size = np.maximum(size, np.abs(rows).max(axis=0))
            begun = end
        if fine.largest_ratio > 1 or coarse.largest_ratio > 1 or coarse.zigzag is not None:
            return None
    size = np.where(size > 0, size, np.inf)
    if not np.all(difference <= _CHAOS * size):
        return None
    orders = np.minimum(equation.highest_orders()[: difference.size], 1.0)
    ratio = n_steps / (2 * n)
    return float(np.max(np.maximum(difference / ratio, first / ratio**orders) / size))


def _rows(stepper, end):
    """Return the solution at the steps up to `end`, fewer where the march cannot go on, (k, d)."""
    rows = [np.zeros((0, stepper.equation.d))]
    while stepper.n < end and stepper.trouble is None:
        piece = stepper.advance(end)
        if piece is None:
            break
        rows.append(piece.rows[1:])
    return np.concatenate(rows)
