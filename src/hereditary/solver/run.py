"""The run: a stepper marches to the end, with checks of Ctrl-C and updates of the progress bar."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..compiled.callbacks import PythonRaised, pass_on
from ..compiled.jacobian import FEW
from ..stepping.state import State
from ..stepping.status import Ending, SolveWarning, StabilityWarning, Status
from ..stepping.stepper import Diagnostics, ResumableStepper, Stepper
from ..support.warning import warn
from .output import Output
from .progress import Interruption, ProgressBar
from .solution import Solution

# Statuses of runs that ended as the user wanted, without a warning.
_QUIET = (Status.COMPLETED, Status.EVENT, Status.INTERRUPTED)
# Largest size in bytes of a history for which a solution keeps its stepper and makes its state
# later.
_LITTLE = 100_000


class Drive:
    """Marches a stepper to given positions, and reports how the run ends if it stops earlier."""

    def __init__(
        self, march: Stepper, end: float, advance: Callable[[Any], Ending | None],
        interruption: Interruption, bar: ProgressBar,
    ) -> None:  # fmt: skip
        # end: of the whole run; advance(stop): marches a part of the way, returns None or `Ending`
        self._march, self._first, self._end = march, march.position, end
        self._advance, self._interruption, self._bar = advance, interruption, bar

    def to(self, stop: float) -> Ending | None:
        """March to position `stop`; return None there, or an `Ending` if the run ends earlier."""
        march = self._march
        while march.position < stop:
            ended = self._advance(stop) or march.failure
            if ended:
                return ended
            self._bar.update((march.position - self._first) / (self._end - self._first))
            if self._interruption.asked and march.position < self._end:
                self._interruption.heeded = True
                return Ending(Status.INTERRUPTED)
        return None


def run(
    stepper: ResumableStepper, stop: float, t_end: float, output: Output, progress: bool,
    began: float, march: Callable[[Drive, Any], Ending | None] = Drive.to,
    late: Callable[[ResumableStepper], bool] | None = None,
) -> Solution:  # fmt: skip
    """March to position `stop`, the user's time `t_end`, and return the `Solution` up to there."""
    # began: time.perf_counter() when the preparation began; march(drive, stop): marches to `stop`;
    # late(stepper): the run ends where it is True after a part
    ready = time.perf_counter()
    events = output.events

    def advance(stop: float) -> Ending | None:
        start = stepper.t
        before: Any = stepper.checkpoint() if events.any else None
        piece = stepper.advance(stop)
        if piece is not None:
            output.take(piece, start)
        if not output.ended:
            return Ending(Status.INTERRUPTED) if late and late(stepper) else None
        go_back(stepper, before, output.end)
        if events.failure:
            return Ending(Status.EVENT_FAILED, events.failure)
        return stepper.failure or Ending(Status.EVENT)

    bar = ProgressBar(progress)
    with Interruption() as interruption:
        try:
            ended = march(Drive(stepper, stop, advance, interruption, bar), stop)
        finally:
            bar.close()
        diagnostics = stepper.diagnostics
        ended = ended or Ending(reached_end(diagnostics))
        if diagnostics.misfit and ended.status is Status.EVENT:
            ended = Ending(Status.KERNEL_INACCURATE)
        signs = events.signs()
        t, y, ydot, dense = output.close(t_end)
        seconds = {"setup_seconds": ready - began, "run_seconds": time.perf_counter() - ready}
        system, stats, n_events = stepper.system, stepper.stats() | seconds, events.n_events
        frame, small = system.frame, system.n_solved <= FEW and stats["history_bytes"] <= _LITTLE

        def left() -> State:
            return replace(stepper.state(), event_signs=signs)

        solution = Solution(
            t=t,
            y=frame.values(y),
            ydot=frame.slopes(y, ydot) if system.m == 2 or frame.speeds else None,
            status=ended.status,
            message=report(stepper, ended, diagnostics),
            stats=stats,
            # making a state takes as long as several steps: a small one is made when asked for,
            # and until then the solution keeps the stepper
            left=left if small else left(),
            dense=dense,
            t_events=[np.array(times) + frame.start for times in events.times[:n_events]],
            y_events=[
                frame.values(np.array(rows).reshape(-1, stepper.y.size))
                for rows in events.values[:n_events]
            ],
            components=output.components,
        )
        interruption.result = solution
    pass_on(ended.error, solution)
    return solution


def go_back(stepper: Stepper, checkpoint: tuple, t: float) -> None:
    """Restore a stepper from `checkpoint`, and march it to the first stop not before time t."""
    stepper.come_back(checkpoint)
    stop = stepper.stop_at(t).position
    while stepper.position < stop and stepper.failure is None:
        stepper.advance(stop, keep=False)


def reached_end(diagnostics: Diagnostics) -> Status:
    """Return the status of a run that reached its end."""
    inaccurate = Status.KERNEL_INACCURATE if diagnostics.misfit else None
    return diagnostics.instability or inaccurate or Status.COMPLETED


def report(stepper: Stepper, ended: Ending, diagnostics: Diagnostics) -> str:
    """Return the message of a run with its numbers; warn if it ended early or is unstable."""
    # no warning if a function called in Python raised: its exception is raised again later
    inaccurate, (status, detail, error) = Status.KERNEL_INACCURATE, ended
    detail = diagnostics.misfit if status is inaccurate else detail
    message = status.sentence + (f": {detail}" if detail else "")
    if diagnostics.misfit and status is not inaccurate:
        message += f"; {inaccurate.sentence}: {diagnostics.misfit}"
    if status is not Status.COMPLETED:
        t = stepper.t + stepper.system.frame.start
        message += f" (t = {t:g} after {stepper.stats()['n_steps']} steps)"
    unstable = diagnostics.instability is not None
    if unstable:
        message += f"; {diagnostics.remedy}"
    if not isinstance(error, PythonRaised) and (unstable or status not in _QUIET):
        warn(message, StabilityWarning if unstable else SolveWarning)
    return message
