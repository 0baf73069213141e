"""Error of first-order runs on given steps, from two companions with fewer steps."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import NamedTuple

import numpy as np

from ..given.fixed_stepper import FixedStepper
from ..given.steps import UniformSteps
from ..stepping.status import SolveWarning, Status
from ..support.warning import ThreadSwitch, silence, warn
from .solution import Solution


class _Companions(NamedTuple):
    """Numbers of steps of a run over those of its finer and of its coarser companion."""

    run: int
    fine: int
    coarse: int


# Companions with a tenth and a twentieth of the steps.
_CHEAP = _Companions(20, 2, 1)
# Fewest steps of their run.
_FEWEST = 400
# Companions with a half and a third of the steps.
_CLOSE = _Companions(6, 3, 2)
# Fewest steps of their run.
_LEAST = 60
# Steps of the run whose errors do not count: relaxations of order below 1 err by h**alpha instead
# of h in the first ones. With 20 in place of 40 the estimate is up to 150 times the error.
_SETTLED = 40
# Numbers of the coarser companion between comparisons: fewer take longer, more take room.
_NUMBERS = 65_536
# Largest difference of companions from which an error follows, as fraction of the solution's size.
_ALIKE = 1.0
# Largest error without a warning, as fraction of the solution's size.
_LARGE = 0.05
# Largest fraction of the stability limit in companions whose difference gives the error, for
# relaxations next to the limit alternate: their differences are 180 times the error of the run at
# 0.92 of it, 40 times at 0.65 (order 1/2).
_STABLE = 0.75
_LEFT_OUT = "estimate=False leaves this estimate out"

_off = ThreadSwitch()


def no_estimates() -> AbstractContextManager[None]:
    """Suppress error estimates in this thread, in a ``with`` statement: sweeps make many runs."""
    return _off.set()


def note_error(solution: Solution, stepper: FixedStepper, n_steps: int) -> None:
    """Add the error estimate of a first-order run to its stats, and warn of a large error.

    ``stats["error_estimate"]`` is None if the run has too few steps, if its companions are
    unstable, or if they differ by the size of the solution. The last case causes a warning.
    """
    off = _off.value or not solution.success
    found = None if off else estimated_error(stepper, n_steps)
    if found is not None and found > _LARGE:
        warn(
            f"errors are about {100 * found:.0f} % of the solution's size with {n_steps} steps of "
            f"the first-order scheme {stepper.scheme!r}: take rtol=1e-6, scheme=BDF(2) or more "
            f"steps; {_LEFT_OUT}",
            SolveWarning,
        )
    solution.stats["error_estimate"] = found


def estimated_error(stepper: FixedStepper, n_steps: int) -> float | None:
    """Return the largest error from 40 steps on relative to the size of each component, or None.

    Cheap companions have a tenth and a twentieth of the steps. If they are unstable or differ by
    the size of the solution, companions with a half and a third of the steps are run. If these
    differ as much, this causes a warning.
    """
    unlike = ""
    for pair, fewest in ((_CHEAP, _FEWEST), (_CLOSE, _LEAST)):
        apart = _difference(stepper, pair, n_steps) if n_steps >= fewest else None
        if apart is None:
            continue
        k = n_steps // pair.run
        if apart <= _ALIKE:
            return apart * k / n_steps / (1 / pair.coarse - 1 / pair.fine)
        unlike = (
            f"runs of {pair.fine * k} and {pair.coarse * k} steps differ by {100 * apart:.0f} %"
        )
    if unlike:
        warn(
            f"{unlike} of the solution's size, so this run of {n_steps} steps is not resolved or "
            f"the solution is chaotic: rtol= shows which; {_LEFT_OUT}",
            SolveWarning,
        )
    return None


def _difference(stepper: FixedStepper, pair: _Companions, n_steps: int) -> float | None:
    """Return the largest difference of companions relative to sizes; None if one is unstable."""
    d, n, done = stepper.system.n_solved, n_steps // pair.run, 0
    difference, first = np.zeros(d), -(-_SETTLED // pair.run)
    with silence():
        fine, coarse = (_companion(stepper, many * n) for many in (pair.fine, pair.coarse))
        size = np.abs(fine.y)
        while done < n:
            end = min(done + max(1, _NUMBERS // d), n)
            rows, others = _rows(fine, pair.fine * end), _rows(coarse, pair.coarse * end)
            missed = len(rows) < pair.fine * (end - done)
            if missed or len(others) < pair.coarse * (end - done):
                return None
            apart = np.abs(
                rows[pair.fine - 1 :: pair.fine] - others[pair.coarse - 1 :: pair.coarse]
            )
            apart = apart[max(0, first - 1 - done) :]
            difference = np.maximum(difference, apart.max(axis=0, initial=0.0))
            size = np.maximum(size, np.abs(rows).max(axis=0))
            done = end
        ratios = [companion.stats()["stiffness_ratio"] for companion in (fine, coarse)]
    apart = float(np.max(difference / np.where(size > 0, size, np.inf)))
    limit = _STABLE if apart <= _ALIKE else 1.0
    unstable = coarse.health.instability is Status.ZIGZAG or np.nanmax([0.0, *ratios]) > limit
    return None if unstable else apart


def _companion(stepper: FixedStepper, n_steps: int) -> FixedStepper:
    """Return a stepper of the same run with n_steps steps."""
    steps = UniformSteps(stepper.t / n_steps)
    return FixedStepper(stepper.system, stepper.scheme, stepper.history, steps, n_steps)


def _rows(stepper: FixedStepper, end: int) -> np.ndarray:
    """Return the solution at the steps up to `end`, (k, d); fewer if the march cannot go on."""
    rows = [np.zeros((0, stepper.system.n_solved))]
    while stepper.position < end and stepper.trouble is None:
        piece = stepper.advance(end)
        if piece is None:
            break
        rows.append(piece.rows[1:])
    return np.concatenate(rows)
