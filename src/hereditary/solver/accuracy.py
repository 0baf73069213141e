"""Errors of a run: its differences from an accurate run of the same problem.

The accurate run is one of `Collocation` to a tolerance. The error of a run on given steps is its
difference from a run to 1e-4, wherever it is above 2e-4 (convergence/estimates.py).
"""

from __future__ import annotations

import signal
import time
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import wraps
from typing import Any, cast

import numpy as np

from ..collocation.method import Collocation
from ..compiled.reach import NOISE
from ..stepping.scheme import Scheme
from ..stepping.state import State
from ..stepping.status import SolveWarning, Status
from ..stepping.stepper import ResumableStepper
from ..stepping.times import together
from ..stepping.tolerance import TOLERANCE_FLOOR
from ..support.checks import refuse
from ..support.html import paragraph, table_html
from ..support.warning import ThreadSwitch, silence, warn
from .opening import chooses_steps, how_to_step
from .output import Kept
from .problem import Outcome, Problem
from .progress import Interruption
from .solution import Solution

# Tolerance of the accurate run of an estimate: ten times as much would leave errors of 1e-3, which
# users ask for, unknown.
_RTOL = 1e-4
# Default tolerance of the accurate run of `check`, for runs on given steps.
_CHECK_RTOL = 1e-6
# Time after a jump of f, over the whole time, in which rows are not compared: the solution may grow
# there like a power of the time since, which rounding changes.
_AFTER_BREAK = 1e-8
# Least default tolerance of it for runs that slide along switches.
_SLIDING_FLOOR = 1e-7
# A run by a tolerance is checked with this fraction of the tolerance.
_TIGHTER = 1e-2
# Number of steps that every accurate run of an estimate may take.
_MIN_STEPS_ALLOWED = 200
# Steps of a run for each step of the accurate run: with fewer a run is hardly resolved. 31 of 500
# random problems had fewer, and half of them erred by more than 13 % (convergence/estimates.py).
_STEPS_PER_ACCURATE_STEP = 4
# Least seconds after which the accurate run of an estimate is given up: 1,000 to 2,000 steps of one
# component.
_MIN_SECONDS_ALLOWED = 0.05
# Part of the run from which the number of steps of an accurate run is extrapolated. The first steps
# are short: 15 of 27 in the first 0.5 % of diffusion of order 0.5 (docs/gallery).
_MIN_PART_EXTRAPOLATED = 0.25
# Seconds of an accurate run of d components without a structure, over d**3: 1.5e-9 for d = 400 and
# seven steps.
_FACTORED = 2e-9
# Number of first rows that are compared: solutions that start like t**alpha err most in them.
_FIRST_ROWS_COMPARED = 100
# Number of rows, spread evenly over the run, that are compared: 1.3 ms for one component.
_SPREAD_ROWS_COMPARED = 2000
# Largest error without a warning, as fraction of the solution's size.
_MAX_ERROR_WITHOUT_WARNING = 0.05
# Difference from which two runs are as different as unrelated ones, as fraction of the size.
_UNRELATED = 0.5
_ACCURATE = "a run to rtol=1e-4"
_LONGER = f"{_ACCURATE} takes longer than this run; check() makes it"
_MORE = f"{_ACCURATE} takes more than"
_ENDS = f"{_ACCURATE} ends at"
_LEFT_OUT = "estimate=False leaves this estimate out"
# Number of components that the table of an `Accuracy` shows.
_MAX_COMPONENTS_SHOWN = 20
_HEADS = "component", "largest", "at t", "at the end"

_off = ThreadSwitch()


def no_estimates() -> AbstractContextManager[None]:
    """Return a context in which this thread computes no estimates, as in sweeps of many runs."""
    return _off.set()


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Errors of a run: its differences from an accurate run of the same problem.

    Attributes
    ----------
    t : ndarray, shape (k,)
        Times of the rows that were compared: the first hundred and 2,000 spread over the run, or
        all if there are fewer [time]. Where y jumps, rows between both times of the jump are left
        out.
    error : ndarray, shape (k, d)
        Rows of the run minus those of the accurate run, in units of y.
    size : ndarray, shape (d,)
        Largest abs(y) of each component of the accurate run: in these rows, or from t_start on if
        the run has fewer rows than steps. Where the accurate run is 0, it is the largest abs(y) of
        the run itself. Components below 1e-13 of what others could make of them during the run are
        rounding. They are left out, with size 0.
    rtol : float
        Tolerance of the accurate run. Relative errors below it are not known.
    n_steps : int
        Number of steps of the accurate run.
    ended : str
        Where and why the accurate run ended before this run, empty if it did not. Later errors are
        unknown.
    """

    t: np.ndarray
    error: np.ndarray
    size: np.ndarray
    rtol: float
    n_steps: int
    ended: str = ""

    @property
    def relative(self) -> np.ndarray:
        """Errors relative to the size of their component, shape (k, d) [-]."""
        return np.abs(self.error) / np.where(self.size > 0, self.size, np.inf)

    @property
    def largest(self) -> np.ndarray:
        """Largest relative error of each component, shape (d,) [-]."""
        return self.relative.max(axis=0, initial=0.0)

    @property
    def at_end(self) -> np.ndarray:
        """Relative error of each component in the last row, shape (d,) [-]."""
        return self.relative[-1]

    @property
    def worst(self) -> tuple[float, int]:
        """Time and component of the largest relative error."""
        row, c = np.unravel_index(np.argmax(self.relative), self.error.shape)
        return float(self.t[row]), int(c)

    def _cells(self) -> list[list[str]]:
        when = self.t[np.argmax(self.relative, axis=0)]
        values = list(zip(self.largest, when, self.at_end, strict=True))
        chosen = np.sort(np.argsort(-self.largest, kind="stable")[:_MAX_COMPONENTS_SHOWN])
        return [
            [str(c), f"{values[c][0]:.1e}", f"{values[c][1]:.4g}", f"{values[c][2]:.1e}"]
            for c in chosen
        ]

    def _sentence(self) -> str:
        (t, c), n = self.worst, self.size.size
        left_out = (
            f"; the {_MAX_COMPONENTS_SHOWN} largest of {n} components"
            if n > _MAX_COMPONENTS_SHOWN
            else ""
        )
        largest = (
            f"largest error {self.largest[c]:.1e} of the size of component {c}, at t = {t:.4g}"
        )
        noise = np.flatnonzero((self.size == 0) & self.error.any(axis=0)).tolist()
        if noise:
            left_out += f"; left out as rounding of others: {', '.join(map(str, noise))}"
        against = f"against {self.n_steps} steps to rtol={self.rtol:g}{left_out}"
        return "\n".join([largest, against, *filter(None, [self.ended])])

    def __repr__(self) -> str:
        rows = [list(_HEADS), *self._cells()]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(map(str.rjust, row, widths)) for row in rows]
        return "\n".join([*lines, self._sentence()])

    def _repr_html_(self) -> str:
        return paragraph(self._sentence()) + table_html([*_HEADS], self._cells())


@dataclass(frozen=True, eq=False)
class Provenance:
    """The problem of a solution, and what else an accurate run needs to know of it."""

    problem: Problem
    scheme: Scheme
    components: np.ndarray | None  # those that rows have
    jumps: np.ndarray  # (k,), times at which y jumped, from the start
    resume: State | None  # from which the run went on
    allow_change: bool

    def with_error(self, run: Outcome) -> Solution:
        """Return the solution of a run with its estimated error, or why that is unknown."""
        # after Ctrl-C a KeyboardInterrupt has the solution as its `result`
        solution = run.solution
        if _off.value or chooses_steps(self.scheme):
            return solution
        with Interruption() as interruption:
            interruption.result = solution
            interruption.result = solution = self._estimated(solution)
        return solution

    def _estimated(self, solution: Solution) -> Solution:
        if not solution.success:
            return _with_no_estimate(solution, "the run has no success, as its message says")
        n = self._steps(solution)
        most = max(_MIN_STEPS_ALLOWED, n // _STEPS_PER_ACCURATE_STEP)
        found = self._accurate_or_why(solution, most)
        if isinstance(found, str):
            return _with_no_estimate(solution, found)
        accuracy = self._compared(solution, found, _RTOL)
        unknown = self._lacking(found, most)
        jumps = solution.stats["jumps"] = found.solution.stats["jumps"]
        _warn(accuracy, f"{n} steps of {self.scheme!r}", unknown, jumps)
        if accuracy.t.size == 0:
            unknown = unknown or "every row is at a jump of y"
        if unknown:
            return _with_no_estimate(solution, unknown)
        solution.stats["error_estimate"] = max(float(accuracy.largest.max()), _RTOL)

        def left() -> State:
            return replace(cast(State, solution.state), accurate=found.solution.state)

        return replace(solution, accuracy=accuracy, left=left)

    def _accurate_or_why(self, solution: Solution, most: int) -> Outcome | str:
        """Return an accurate run of at most `most` steps, or why there is none."""
        if self.scheme.is_map:
            return "the equation is a map, whose steps have no error"
        if not self._has_rows(solution):
            return "no row is after the start"
        if self.resume is not None and self.resume.accurate is None:
            return "the run that this one resumes has no estimate"
        seconds = solution.stats["setup_seconds"] + solution.stats["run_seconds"]
        seconds, system = max(_MIN_SECONDS_ALLOWED, seconds), self.problem.system
        if system.structure is None and _FACTORED * system.d**3 > seconds:
            return _LONGER
        late = _Patience(seconds)
        try:
            with silence():
                options: Any = {"rtol": _RTOL, "max_steps": most, "late": late}
                # an event may have ended the run; another run may resume it
                horizon = self.problem.t_end - self._start
                found = self._accurate(solution, Collocation(horizon=horizon), **options)
            asked = found.solution.status is Status.INTERRUPTED and not late.over
            return f"Ctrl-C ended {_ACCURATE}" if asked else found
        except Exception as error:  # of arguments that Collocation refuses, or of user's functions
            refused = str(error).partition("; ")[0]  # without the remedy, which is for another run
            return f"{_ACCURATE} is not possible: {refused}"

    def _lacking(self, found: Outcome, most: int) -> str:
        """Return why an accurate run does not tell the error; empty if it does."""
        other, stepper = found.solution, found.stepper
        if other.success:
            return ""
        if other.status is Status.MAX_STEPS:
            return f"{_MORE} {most} steps"
        if other.status is Status.INTERRUPTED:
            resumed = self.resume and self.resume.accurate
            start = resumed.t if resumed else 0.0
            span = self.problem.t_end - self._start - start
            part = (stepper.t - start) / span
            if part > _MIN_PART_EXTRAPOLATED and other.stats["n_steps"] > most * part:
                return f"{_MORE} {most} steps"
            return _LONGER
        t = stepper.t + self._start
        return f"{_ENDS} t = {t:g}: {other.status.sentence}"

    def check(self, solution: Solution, rtol: float | None) -> Accuracy:
        """Return the errors of a solution against an accurate run, as `Solution.check` does."""
        if self.resume is not None:
            required = "be one of an unbroken run"
            refuse("solution", required, f"one resumed at t = {solution.t[0]:g}", "solve it anew")
        if self.scheme.is_map:
            refuse("solution", "have errors of steps", "one of a map")
        if not self._has_rows(solution):
            required, got = "have a row after the start", f"{solution.t.size} rows"
            refuse("solution", required, got, solution.message)
        scheme, others = Collocation(), dict[str, Any]()
        if isinstance(self.scheme, Collocation):
            own = cast(State, solution.state).how
            floor = _SLIDING_FLOOR if solution.stats.get("slides") else TOLERANCE_FLOOR
            rtol = max(_TIGHTER * own.rtol, floor) if rtol is None else rtol
            nodes = self.scheme.nodes
            scheme = Collocation(nodes + 2 if nodes <= 10 else nodes - 2)
            atol = None if own.atol is None else np.asarray(own.atol) * rtol / own.rtol
            max_step = own.max_step if own.max_step < np.inf else None
            others = {"atol": atol, "max_step": max_step}
        rtol = _CHECK_RTOL if rtol is None else rtol
        with silence():
            found = self._accurate(solution, scheme, rtol=rtol, **others)
        accuracy, other = self._compared(solution, found, rtol), found.solution
        if other.success:
            return accuracy
        ended = f"the run to rtol={rtol:g} ended early: {other.message}"
        if not (accuracy.t[-1:] > self._start).any():
            raise RuntimeError(f"{ended}; no row of this run is before that")
        warn(f"{ended}; errors after it are unknown", SolveWarning)
        return replace(accuracy, ended=ended)

    def _accurate(
        self, solution: Solution, scheme: Scheme, *, late: _Patience | None = None, **steps: Any
    ) -> Outcome:
        """Solve the problem of a solution by a tolerance, with rows at the times to compare."""
        problem = self.problem
        events = tuple(map(_endless, filter(_changes, problem.events)))
        problem = replace(problem, events=events, t_end=float(solution.t[-1]))
        t = solution.t[_rows(solution.t.size)]
        state = None if self.resume is None else self.resume.accurate
        if state is not None:
            t = t[t >= state.t + problem.system.frame.start]
        t_end = problem.t_end - problem.system.frame.start
        policy = how_to_step(problem.system, scheme, t_end, state, **steps)
        kept = Kept(1, t, self.components)
        found = problem.solved(scheme, policy, kept, None, state, self.allow_change, late=late)
        if found.solution.status is Status.INTERRUPTED and not (late and late.over):
            signal.raise_signal(signal.SIGINT)  # a loop of runs ends here
        return found

    def _compared(self, solution: Solution, found: Outcome, rtol: float) -> Accuracy:
        """Return the differences of a solution from an accurate run, up to where that ends."""
        other, rows = found.solution, _rows(solution.t.size)
        first = np.searchsorted(solution.t[rows], other.t[:1].min(initial=np.inf))
        rows = rows[first:][: other.t.size]
        y = solution.y[rows]
        apart, (size, noise) = y - other.y, self._sizes_and_noise(solution, found)
        own = np.abs(y).max(axis=0, initial=0.0)
        size = np.where(size > 0, size, own)
        size[np.maximum(size, own) <= NOISE * noise] = 0.0
        same = self._apart_from_breaks(other)
        same &= not found.jumps.size or self._outside_jumps(other.t, found.jumps)
        return Accuracy(other.t[same], apart[same], size, rtol, other.stats["n_steps"])

    @property
    def _start(self) -> float:
        """Time of the user at which the equation starts."""
        return self.problem.system.frame.start

    def _has_rows(self, solution: Solution) -> bool:
        """Return whether a solution has rows after the start of its equation."""
        return bool((solution.t[-1:] > self._start).any())

    def _steps(self, solution: Solution) -> int:
        """Return the number of steps of a solution, from the state on if it was resumed."""
        before = 0 if self.resume is None else self.resume.how.n
        return solution.stats["n_steps"] - before

    def _sizes_and_noise(self, solution: Solution, found: Outcome) -> np.ndarray:
        """Return the largest |y| of an accurate run, and its unit of rounding, (2, d)."""
        whole = self.problem.system.frame.values(cast(Any, found.stepper).sizes_and_noise)
        whole = np.maximum(np.abs(whole.real), np.abs(whole.imag))
        sizes, noise = whole if self.components is None else whole[:, self.components]
        size = np.abs(found.solution.y).max(axis=0, initial=0.0)
        # chosen rows may all be next to a zero of y, where the accurate run has no relative error
        if solution.t.size <= self._steps(solution):
            size = np.maximum(size, sizes)
        return np.array([size, noise])

    def _apart_from_breaks(self, accurate: Solution) -> np.ndarray:
        """Return which rows are not just after a jump of f, where times are rounded too much."""
        found = np.array(accurate.stats["jumps"]) - self._start
        jumps = np.union1d(self.problem.breaks, found)
        since = accurate.t - self._start - jumps[:, None]
        return ~np.any((since > 0) & (since <= _AFTER_BREAK * np.abs(accurate.t)), axis=0)

    def _outside_jumps(self, times: np.ndarray, others: np.ndarray) -> np.ndarray:
        """Return which times are not between a jump of this run and that of the accurate run."""
        shared, t = min(self.jumps.size, others.size), times - self._start
        same = np.ones(t.size, dtype=bool)
        for first, last in np.sort([self.jumps[:shared], others[:shared]], axis=0).T:
            same &= ((t < first) | (t > last)) & ~(together(t, first) | together(t, last))
        return same


class _Patience:
    """Whether a run has taken longer than some seconds of its thread, after its first part."""

    def __init__(self, seconds: float) -> None:
        # the first part of a run may compile functions, or load their machine code
        self._seconds, self._until, self.over = seconds, np.inf, False

    def __call__(self, stepper: ResumableStepper) -> bool:
        """Return whether the run is late."""
        now = time.thread_time()
        if self._until == np.inf:
            self._until = now + self._seconds
        self.over = now > self._until
        return self.over


def _with_no_estimate(solution: Solution, why: str) -> Solution:
    """Return the solution with the reason why its error is unknown."""
    solution.stats.update(error_estimate=None, error_unknown=why)
    return solution


def _warn(accuracy: Accuracy, steps: str, unknown: str, jumps: list[float]) -> None:
    """Warn of large errors, and if an accurate run takes many steps or ends early."""
    # unknown: why that run ended early, or empty; jumps: times of jumps of f that nobody stated
    if unknown == _LONGER:  # how far it came depends on the machine
        return
    largest, errors = float(accuracy.largest.max()), ""
    ended, more = unknown.startswith(_ENDS), unknown.startswith(_MORE)
    if not (largest > _MAX_ERROR_WITHOUT_WARNING or ended or more):
        return
    if accuracy.t.size > (ended or more):  # the first row may have no error
        last, end = 100 * float(accuracy.at_end.max()), accuracy.t[-1]
        end = f"at t = {end:.4g}, where that run ends" if unknown else "at the end"
        errors = (
            f"errors are about {100 * largest:.2g} % of the solution's size at t = "
            f"{accuracy.worst[0]:.4g}, and {last:.2g} % {end}"
        )
    if ended:
        text = f"{unknown}, which {steps} pass over; {errors}{errors and '; '}later errors are "
        text += "unknown: compare with twice the steps"
        warn(f"{text}; {_LEFT_OUT}", SolveWarning)
        return
    if more:
        text = f"{unknown}, so {steps} hardly resolve the solution{errors and ': '}{errors}"
    elif largest > _UNRELATED:
        text = (
            f"{steps} differ from {_ACCURATE} by the size of the solution: they do not resolve it, "
            "or it is chaotic, which it is if runs to rtol=1e-6 and rtol=1e-8 differ as much; "
            f"{errors}"
        )
    else:
        text = f"{errors}, with {steps}"
    if jumps:
        text += f"; the right-hand side jumps at t = {jumps[0]:.10g}, where they are of first order"
    warn(f"{text}; take rtol=1e-6, or more steps; {_LEFT_OUT}", SolveWarning)


def _rows(n: int) -> np.ndarray:
    """Return the numbers of the rows to compare, of n rows."""
    if n <= _SPREAD_ROWS_COMPARED:
        return np.arange(n)
    return np.union1d(
        np.arange(_FIRST_ROWS_COMPARED), np.linspace(0, n - 1, _SPREAD_ROWS_COMPARED).astype(int)
    )


def _changes(event: Any) -> bool:
    """Return whether an event changes y."""
    return getattr(event, "change", None) is not None


def _endless(event: Any) -> Any:
    """Return an event that never ends a run, with the same zeros and changes."""

    @wraps(event, updated=())
    def same(t: float, y: np.ndarray) -> Any:
        return event(t, y)

    vars(same).update(change=event.change, direction=getattr(event, "direction", 0.0))
    return same
