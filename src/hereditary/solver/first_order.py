"""Error of first-order runs on given steps, from two companions with fewer steps."""

from __future__ import annotations

import numpy as np

from ..schemes.steps import UniformSteps
from ..support.warning import ThreadSwitch, silence, warn
from .fixed_stepper import FixedStepper
from .solution import SolveWarning
from .status import Status

# Steps of the run for one of each companion; fewest steps of a run that is estimated.
_RATIOS, _FEWEST = (10, 20), 400
# Numbers of the coarser companion between comparisons: fewer take longer, more take room.
_NUMBERS = 65_536
# Largest difference of companions that is no sign of chaos, and largest error without a warning,
# as fractions of the solution's size.
_CHAOS, _LARGE = 1.0, 0.05
# Largest fraction of the stability limit in a companion: relaxations next to the limit alternate.
# Their differences are 180 times the error of the run at 0.92 of it, 40 times at 0.65 (order 1/2).
_STABLE = 0.75

_off = ThreadSwitch()


def no_estimates():
    """Leave estimates out in this thread, within a ``with`` statement: sweeps make many runs."""
    return _off.set()


def note_error(solution, stepper, n_steps):
    """Estimate the error of a first-order run in its stats, and warn of a large one.

    ``stats["error_estimate"]`` is None where there is no estimate.
    """
    off = _off.value or not solution.success
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
    """Return the largest error beyond 40 steps relative to the size of each component, or None.

    Companions with a tenth and a twentieth of the steps differ by about ten times the error of the
    run. Their first common step is left out: next to the start, relaxations of order below 1 err by
    h**alpha instead of h.
    """
    n = n_steps // _RATIOS[1]
    if n_steps < _FEWEST:
        return None
    equation, t_end = stepper.equation, stepper.t
    difference = np.zeros(equation.d)
    with silence():
        how = equation, stepper.scheme, stepper.history
        fine, coarse = (FixedStepper(*how, UniformSteps(t_end / k), k) for k in (2 * n, n))
        size = np.abs(fine.y)
        begun = 0
        while begun < n:
            end = min(begun + max(1, _NUMBERS // equation.d), n)
            rows, others = _rows(fine, 2 * end), _rows(coarse, end)
            if len(rows) != 2 * len(others) or len(others) != end - begun:
                return None
            settled = 1 if begun == 0 else 0
            apart = np.abs(rows[1::2] - others)[settled:]
            difference = np.maximum(difference, apart.max(axis=0, initial=0.0))
            size = np.maximum(size, np.abs(rows).max(axis=0))
            begun = end
        ratios = [stepper.stats()["stiffness_ratio"] for stepper in (fine, coarse)]
        if coarse.instability is Status.ZIGZAG or np.nanmax([0.0, *ratios]) > _STABLE:
            return None
    size = np.where(size > 0, size, np.inf)
    if not np.all(difference <= _CHAOS * size):
        return None
    return float(np.max(difference * (2 * n / n_steps) / size))


def _rows(stepper, end):
    """Return the solution at the steps up to `end`, fewer where the march cannot go on, (k, d)."""
    rows = [np.zeros((0, stepper.equation.d))]
    while stepper.n < end and stepper.trouble is None:
        piece = stepper.advance(end)
        if piece is None:
            break
        rows.append(piece.rows[1:])
    return np.concatenate(rows)
