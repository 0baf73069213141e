"""Estimates of the error of first-order runs, from companions: two runs with fewer steps."""

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
    """Ratio of the numbers of steps of the run, its finer and its coarser companion."""

    run: int
    fine: int
    coarse: int


# First pair of companions: a tenth and a twentieth of the run's steps.
_CHEAP = _Companions(20, 2, 1)
# Smallest number of steps of a run for which the first pair is computed.
_FEWEST = 400
# Second pair of companions: a half and a third of the run's steps.
_CLOSE = _Companions(6, 3, 2)
# Smallest number of steps of a run for which the second pair is computed.
_LEAST = 60
# Number of first steps of the run whose errors do not count: in them relaxations of an order alpha
# below 1 have errors like h**alpha instead of h. With 20 in place of 40 the estimate is up to 150
# times the error.
_SETTLED = 40
# Number of values of the coarser companion that are computed between two comparisons: fewer take
# more time, more take more storage.
_NUMBERS = 65_536
# Largest difference of two companions that gives an estimate, as fraction of the solution's size.
_ALIKE = 1.0
# Largest estimated error without a warning, as fraction of the solution's size.
_LARGE = 0.05
# Largest stiffness ratio of companions (1 at the stability limit) whose difference gives an
# estimate. Near the limit relaxations alternate in sign: for order 1/2 the difference is 180 times
# the error of the run at a ratio of 0.92, and 40 times at 0.65.
_STABLE = 0.75
_LEFT_OUT = "estimate=False leaves this estimate out"

_off = ThreadSwitch()


def no_estimates() -> AbstractContextManager[None]:
    """Return a context in which this thread computes no estimates, as in sweeps of many runs."""
    return _off.set()


def note_error(solution: Solution, stepper: FixedStepper, n_steps: int) -> None:
    """Set the estimated error of a first-order run in its stats, and warn if it is large.

    ``stats["error_estimate"]`` is None if the run has too few steps, or if its companions are
    unstable. It is also None, with a warning, if they differ by more than the size of the solution.
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
    """Return the largest error after 40 steps, relative to the size of each component, or None.

    The estimate is the difference of two companions, scaled. The first two companions have a tenth
    and a twentieth of the steps. Two others, with a half and a third of the steps, are used if the
    run has fewer than 400 steps. They are also used if one of the first two is unstable, or if
    these differ by more than the size of the solution. If no pair gives an estimate because its
    two runs differ as much, there is a warning.
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
    """Return the largest difference of two companions, relative to sizes of components.

    Returns None if a companion is unstable or stops early.
    """
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
    """Return a stepper for the same run with `n_steps` steps."""
    steps = UniformSteps(stepper.t / n_steps)
    return FixedStepper(stepper.system, stepper.scheme, stepper.history, steps, n_steps)


def _rows(stepper: FixedStepper, end: int) -> np.ndarray:
    """Return the solution (k, d) at the next steps up to `end`, or up to a step that fails."""
    rows = [np.zeros((0, stepper.system.n_solved))]
    while stepper.position < end and stepper.trouble is None:
        piece = stepper.advance(end)
        if piece is None:
            break
        rows.append(piece.rows[1:])
    return np.concatenate(rows)
