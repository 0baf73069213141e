"""A problem, which any scheme solves; and its run, from the stepper to the `Solution`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..equation.system import System
from ..given.history.history import History
from ..stepping.scheme import Scheme
from ..stepping.state import State
from ..stepping.stepper import ResumableStepper
from .events import Events, inner_event
from .hybrid import Hybrid
from .opening import Policy, open_stepper
from .output import Kept, Output
from .run import Drive, run
from .solution import Solution

# Number of values that a run computes between two looks at its time: 256 steps of 8 components.
_VALUES_BETWEEN_LOOKS = 2048
# Least number of steps between two looks.
_LEAST_ROWS = 8


class Outcome(NamedTuple):
    """A solution, its stepper, and the times (k,) of jumps of y, from the start of the equation."""

    solution: Solution
    stepper: ResumableStepper
    jumps: np.ndarray


@dataclass(frozen=True, eq=False)
class Problem:
    """A system, the end of its run, and all that acts on the way."""

    system: System
    t_end: float  # the user's time
    breaks: np.ndarray  # (k,), times at which f jumps, from the start
    events: tuple[Any, ...]
    switches: tuple[Callable, ...]
    changes: Mapping[float, Callable]

    def solved(
        self, scheme: Scheme, policy: Policy, kept: Kept, history: History | None = None,
        resume: State | None = None, allow_change: bool = False, progress: bool = False,
        late: Callable[[ResumableStepper], bool] | None = None,
    ) -> Outcome:  # fmt: skip
        """Solve the problem by a scheme, from the start or from a state."""
        # late(stepper): called between parts of a run of `Collocation`, which ends where it is True
        began = time.perf_counter()
        system, hybrid, t_end = self.system, None, self.t_end - self.system.frame.start
        changing = any(getattr(event, "change", None) is not None for event in self.events)
        if self.switches or self.changes or changing:
            hybrid = Hybrid(system, scheme, self.events, self.switches, self.changes)
            system = hybrid.system
        stepper, stop = open_stepper(system, scheme, history, policy, t_end, resume, allow_change)
        if late is not None:
            stepper.limit_rows(max(_LEAST_ROWS, _VALUES_BETWEEN_LOOKS // system.d))
        stepper.set_breaks(self.breaks, t_end)
        signs = {} if resume is None else resume.event_signs
        if hybrid:
            rtol = getattr(policy, "rtol", None)
            found = hybrid.open(stepper, t_end, self.breaks, signs, rtol)
        else:
            found = Events(map(partial(inner_event, stepper), self.events), stepper, signs)
        output = Output(stepper, stop, kept, found)
        march = partial(hybrid.march, output) if hybrid else Drive.to
        solution = run(stepper, stop, self.t_end, output, progress, began, march, late)
        if hybrid and self.switches:
            solution.stats["slides"] = hybrid.close()
        return Outcome(solution, stepper, np.array(output.jumps))
