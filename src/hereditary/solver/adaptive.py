"""The adaptive driver: from t = 0 or a state to the end, through breaks and events."""

import time
from dataclasses import replace

import numpy as np

from .._checks import complaint, positive, shown, within
from ..collocation.pace import MAX_STEPS
from ..collocation.stepper import AdaptiveStepper
from ..history.exponentials import SumOfExponentials
from ..orders import OrderFailed
from .dense import Dense
from .drive import failed
from .events import Events
from .progress import Interruption, ProgressBar
from .solution import Solution, Status, warn_of
from .stops import APART, checked_breaks

# Below this the rounding of double precision, not the scheme, decides.
TOLERANCE_FLOOR = 1e-12
# Time to the highest order, if that is above 1, must stay below this.
_FARTHEST = 1e300
# Steps between two looks at Ctrl-C and the progress bar.
_ROWS = 256


def solve_adaptively(
    equation, t_end, scheme, history, rtol, atol, save_every, t_eval, breaks, events, progress,
    resume, allow_change, max_step=None, max_steps=MAX_STEPS,
):  # fmt: skip
    """Solve with steps chosen by the tolerance; the arguments of `solve`, some of them checked."""
    began = time.perf_counter()
    farthest = _FARTHEST ** (1 / max(1.0, float(equation.highest_orders().max())))
    interval = f"[{1 / _FARTHEST:g}, {farthest:g}]"
    within("t_end", t_end, 1 / _FARTHEST, farthest, interval, "take another unit of time")
    modes_tol, signs = modes_tolerance(history), {}
    if resume is not None:
        rtol = resume.rtol if rtol is None else rtol
        atol = resume.atol if atol is None else atol
        modes_tol = resume.modes_tol if history is None else modes_tol
        signs = resume.event_signs
    rtol, atol = tolerances(rtol, atol)
    limits = None, max_step, max_steps
    stepper = AdaptiveStepper(equation, scheme, t_end, rtol, atol, modes_tol, *limits)
    if resume is not None:
        _resume(stepper, resume, t_end, allow_change)
    stops = _stops(breaks, stepper, t_end)
    found = Events(events, stepper.t, stepper.y, signs)
    keeper = _Keeper(stepper, save_every, t_eval, found)
    ready = time.perf_counter()
    status, detail = _run(stepper, stops, keeper, progress)
    seconds = (ready - began, time.perf_counter() - ready)
    return keeper.solution(status, detail, seconds)


def tolerances(rtol, atol):
    """Relative and absolute tolerance, checked, or what stands for them by default."""
    interval, remedy = f"[{TOLERANCE_FLOOR:g}, 0.1]", "double precision allows no less"
    rtol = 1e-6 if rtol is None else rtol
    rtol = within("rtol", rtol, TOLERANCE_FLOOR, 0.1, interval, remedy)
    return rtol, 1e-2 * rtol if atol is None else positive("atol", atol)


def _resume(stepper, state, t_end, allow_change):
    if t_end <= state.t:
        raise ValueError(complaint("t_end", f"exceed the state's time {state.t}", t_end))
    if not np.all(np.isfinite(state.y)):
        raise ValueError(complaint("resume", "hold a finite solution", f"y = {shown(state.y)}"))
    if stepper.modes_tol != state.modes_tol:
        required = f"be left out or ask for modes as the state has them, to {state.modes_tol:g}"
        raise ValueError(complaint("history", required, f"to {stepper.modes_tol:g}"))
    stepper.restore(state, t_end, allow_change)


def modes_tolerance(history):
    """Tolerance of the modes that a history asks for, None where it asks for none."""
    if not isinstance(history, SumOfExponentials | None):
        required = "be left out with Collocation, or be SumOfExponentials(tol)"
        raise ValueError(complaint("history", required, repr(history)))
    return None if history is None else history.tol


def _stops(breaks, stepper, t_end):
    """Breaks ahead, and the end; one at the present time is a singular start."""
    times = checked_breaks(breaks)
    if np.any(np.abs(times - stepper.t) < APART * stepper.t):
        stepper.begin_singular()
    ahead = (times > stepper.t * (1 + APART)) & (times < t_end * (1 - APART))
    return [*times[ahead].tolist(), t_end]


def _run(stepper, stops, keeper, progress):
    """March to the last stop; the status and a detail for it."""
    bar, begun = ProgressBar(progress), stepper.t
    before = None
    try:
        with Interruption() as interruption:
            for number, stop in enumerate(stops):
                if number:
                    stepper.begin_singular()
                while stepper.t < stop:
                    start = stepper.t
                    try:
                        before = stepper.state() if keeper.events.times else None
                        piece = stepper.advance(stop, _ROWS)
                        if piece is not None and keeper.keep(piece, start):
                            _go_back(stepper, before, keeper.end, stops)
                            failure = keeper.events.failure
                            return (Status.EVENT_FAILED if failure else Status.EVENT), failure
                        if stepper.error is not None:
                            raise stepper.error
                    except OrderFailed as error:
                        return Status.ORDER_FAILED, str(error)
                    except Exception as error:
                        return failed(error)
                    if stepper.blown_up:
                        return Status.BLOWN_UP, ""
                    if stepper.not_solved:
                        return Status.NOT_SOLVED, ""
                    if stepper.no_step:
                        return Status.STEP_TOO_SMALL, stepper.no_step
                    if stepper.pace.used_up(stepper.n_steps) and stepper.t < stops[-1]:
                        return Status.MAX_STEPS, f"{stepper.n_steps} in all"
                    bar.update((stepper.t - begun) / (stops[-1] - begun))
                    if interruption.asked and stepper.t < stops[-1]:
                        interruption.heeded = True
                        return Status.INTERRUPTED, ""
    finally:
        bar.close()
    return Status.COMPLETED, ""


def _go_back(stepper, before, t_event, stops):
    """March again, to the event, where a later run goes on."""
    stepper.restore(before, stops[-1])
    while stepper.t < t_event and stepper.advance(t_event, _ROWS) is not None:
        pass


class _Keeper:
    """The rows and the dense output of a run."""

    def __init__(self, stepper, save_every, t_eval, events):
        self._stepper, self._every, self._wanted, self.events = stepper, save_every, t_eval, events
        self._start, self.end, self._n_seen = stepper.t, stepper.t, 0
        self._dense = Dense(stepper.second)
        self._times: list = []
        self._rows: list = []
        self._slopes: list = []
        if t_eval is None:
            self._add(np.array([stepper.t]), stepper.y[None], stepper.ydot[None])
        elif t_eval[0] <= stepper.t:
            self._add(t_eval[:1], stepper.y[None], stepper.ydot[None])
            self._wanted = t_eval[1:]

    def _add(self, t, y, ydot):
        self._times.append(t)
        self._rows.append(y)
        self._slopes.append(ydot)

    def keep(self, piece, start):
        """Take in a piece; whether an event ends the run in it."""
        dense = Dense(self._stepper.second)  # of this piece alone
        dense.add(piece, start)
        if self._wanted is None:  # else rows at the given times are all that is kept
            self._dense.add(piece, start)
        edges = np.append(piece.edges(), self._stepper.t)
        end = None
        if self.events.times:
            end = self.events.look(edges, lambda t: dense(t, 0, edges[-1]))
        self.end = edges[-1] if end is None else end
        if self._wanted is None:
            n = np.arange(self._n_seen + 1, self._n_seen + edges.size)
            # steps next to a singular start may be too short for its time to change
            chosen = (n % self._every == 0) & (edges[1:] <= self.end) & (np.diff(edges) > 0)
            self._n_seen += edges.size - 1
            times = edges[1:][chosen]
        else:
            ahead = int(np.searchsorted(self._wanted, self.end, side="right"))
            times, self._wanted = self._wanted[:ahead], self._wanted[ahead:]
        if times.size:
            self._add(times, *(dense(times, k, edges[-1]) for k in (0, 1)))
        if end is not None or (self._wanted is None and self._stepper.t == self.end):
            self._last = (self.end, *(dense(self.end, k, edges[-1]) for k in (0, 1)))
        return end is not None

    def solution(self, status, detail, seconds):
        """The solution as far as it went."""
        stepper = self._stepper
        keeps_steps = self._wanted is None
        if keeps_steps and self._times[-1][-1] < self.end:
            t, y, ydot = self._last
            self._add(np.array([t]), y[None], ydot[None])
        message = status.sentence + (f": {detail}" if detail else "")
        if status is not Status.COMPLETED:
            message += f" (t = {self.end:g})"
        warn_of(status, message)
        slopes = np.concatenate(self._slopes) if self._slopes else np.zeros((0, stepper.equation.d))
        return Solution(
            t=np.concatenate(self._times) if self._times else np.zeros(0),
            y=np.concatenate(self._rows) if self._rows else np.zeros((0, stepper.equation.d)),
            ydot=slopes if stepper.equation.m == 2 else None,
            status=status,
            message=message,
            stats=stepper.stats() | {"setup_seconds": seconds[0], "run_seconds": seconds[1]},
            state=replace(stepper.state(), event_signs=self.events.signs()),
            dense=self._dense if keeps_steps else None,
            t_events=[np.array(times) for times in self.events.times],
            y_events=[np.array(rows).reshape(-1, stepper.y.size) for rows in self.events.values],
        )
