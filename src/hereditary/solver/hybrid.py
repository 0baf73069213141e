"""Hybrid runs: y changes at events or at stated times, and the right-hand side jumps at switches.

A run is marched from one interruption to the next. If several occur at one time, each acts once.
First switches change their side. Then y changes as stated for that time, then by events in the
order in which these are given. A terminal event ends the run.

Right-hand sides that jump are evaluated on one side until the run has located the change of sign.
Trial points of a step may be beyond the switch. There the right-hand side has the value of the
nearest point on the side of the march. Steps therefore meet no jump, and their polynomials cross
the switch where the solution does.

After a zero the sign of a function is that of its value. This holds if a change led the value away
from 0 by more than rounding. Otherwise the motion tells whether the function crosses or turns back,
and it is disarmed until its sign is certain. Where the motion is unknown, and for switches, certain
means beyond the errors that the tolerance allows. On given steps it means beyond the value at the
step that acted.
An event that turned back and leaves to the other side piles up. A switch slides if on either side
the solution leaves to the other. By a tolerance f is then a linear blend of both sides, so that the
solution stays on the switch. The side of arrival has all weight at first. The blend ends where one
side has all weight again.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..compiled.functions import with_switches
from ..equation.system import System
from ..functions.assemble import switch_of
from ..stepping.scheme import Scheme
from ..stepping.status import Ending, SolveWarning, Status
from ..stepping.stepper import JumpingStepper, Stepper
from ..stepping.times import ONE_TIME, together
from ..stepping.tolerance import OF_SIZE
from ..support.checks import real, refuse, shown
from ..support.warning import warn
from .events import Events, inner_event, value_of
from .output import Output
from .run import Drive

# Changes by one event accumulate without end if two consecutive intervals are shorter than this
# fraction of the longest interval, and the second is the shorter one.
_ACCUMULATION_RATIO = 1e-6
# Ratio of two intervals below which the second is the shorter one. Equal ones are those of resets.
_SHORTER = 0.999
# Changes also accumulate if a single interval is shorter than this fraction of the longest.
_SINGLE_ACCUMULATION_RATIO = 1e-9
# On given steps changes also accumulate if two intervals have one step each, and the longest more
# steps than this.
_ACCUMULATION_STEPS = 100
# Changes also accumulate if this many of them are within the fraction _ACCUMULATION_FRACTION of the
# run.
_ACCUMULATION_CHANGES = 10_000
# Fraction of the run in which _ACCUMULATION_CHANGES changes are too many.
_ACCUMULATION_FRACTION = 0.03
# Least length of the longest interval, as a fraction of the run.
_LONG = 0.03

# Fractions of the first step after a change at which event functions are evaluated as well.
_NEXT = 10.0 ** np.arange(-9, 0)
# Relative distance from a start up to which the sign of an event function is rounding.
_ROUNDED_TIME = 64 * np.finfo(float).eps
# Time for which the motion after a change is predicted, relative to the present time.
_AHEAD = 1e-8
# Numbers of given steps for which it is predicted where the event has no slope.
_STEPS_AHEAD = 2.0 ** np.arange(-1, 6)
# Rounding errors of y for which the sign of an event is uncertain, relative to |y|.
_ROUNDING = 8 * np.finfo(float).eps

# Half of the width of a blend of both sides, as a fraction of the error of the switch that the
# tolerance allows; and for orders above 1, where y meets the switch with a speed, or below
# `_LOW_ORDER`, where rounding of f is a larger part of y.
_WIDTHS = 0.1, 0.4
_LOW_ORDER = 0.7
# Least width, relative to the terms of the switch: rounding of f is 3e-9 of its jump then.
_LEAST_WIDTH = 3e-8
# Share beyond one side at which a blend ends, as a multiple of sqrt(rtol), for each begin at one
# time: errors lead back what is closer.
_BEYOND = 0.03
# Most blends that begin at one time.
_MOST_RETURNS = 20
# Blends that are too many if they begin within the fraction `_SLIDES_WITHIN` of the run.
_MANY_SLIDES = 100
_SLIDES_WITHIN = 0.02
# Most switches of which f is a blend at once: f is called for all sides of them.
_MOST_BLENDS = 6


@dataclass(frozen=True)
class _Blend:
    """The function of a switch while f is a blend of its sides; it is 0 where the blend ends."""

    function: Callable[[float, np.ndarray], float]  # of the switch
    center: float
    width: float
    beyond: float
    since: float  # time of its begin

    def __call__(self, t: float, y: np.ndarray) -> float:
        """Return a distance, positive as long as f is a blend."""
        return (1.0 + self.beyond) * self.width - abs(value_of(self.function, t, y) - self.center)

    def side(self, t: float, y: np.ndarray) -> float:
        """Return the side of the switch to which the solution leaves."""
        return math.copysign(1.0, value_of(self.function, t, y) - self.center)


class Hybrid:
    """The interruptions of a run, and their effects; its `system` sees one side of each switch."""

    def __init__(
        self, system: System, scheme: Scheme, events: Sequence[Callable],
        switches: Sequence[Callable], changes: Mapping[float, Callable],
    ) -> None:  # fmt: skip
        self._functions = events
        self._changes = [getattr(function, "change", None) for function in events]
        for change in self._changes:
            if change is not None and not callable(change):
                required = "have a function change(t, y), or none"
                refuse("events", required, repr(change), kind=TypeError)
        self._timed_changes = _timed_changes(changes, system.frame.start)
        self._switches = switches
        self._slides: list[tuple[int, float, float]] = []  # switch, begin, end [time]
        self._begins: deque[float] = deque(maxlen=_MANY_SLIDES)  # times of the last
        self._ended: dict[int, tuple[float, int]] = {}  # time of the last end, and begins there
        self._times: list[list[float]] = [[] for _ in events]
        self.system = system
        if switches:
            self.system = one_sided(system, switches, scheme)

    def open(
        self, stepper: JumpingStepper, t_end: float, breaks: np.ndarray, signs: dict[str, float],
        rtol: float | None = None,
    ) -> Events:  # fmt: skip
        """Return the `Events` of a run to t_end, whose stepper is at its start."""
        # breaks (k,): times at which f jumps; signs: those of a state; rtol: None on given steps
        self._rtol = rtol
        self._stepper, self._start, self._span = stepper, stepper.t, t_end - stepper.t
        self._longest, self._crowded = [0.0 for _ in self._functions], set[int]()
        origin = stepper.system.frame.start
        known = np.append(t_end, breaks)  # which come second where they are one time
        next_change = [(nearest(t, known, origin), change) for t, change in self._timed_changes]
        self._due = [
            (t, change)
            for t, change in next_change
            if self._start < t <= t_end and not together(t, self._start, origin)
        ]
        of_y = bool(self._due) or any(change is not None for change in self._changes)
        if of_y or self._switches:
            stepper.expect_jumps(of_y)
        inside = partial(inner_event, stepper)
        functions = [*map(inside, self._functions), *map(inside, self._switches)]
        acting = [change is not None for change in self._changes] + [True] * len(self._switches)
        known = np.append(known, [t for t, _ in self._due])
        self._events = HybridEvents(functions, acting, len(self._functions), stepper, signs, known)
        self._take_sides()
        return self._events

    def march(self, output: Output, drive: Drive, stop: float) -> Ending | None:
        """March to `stop` over all interruptions; return the `Ending` if the run ends before."""
        stepper, events = self._stepper, self._events
        while True:
            due = self._due[0][0] if self._due else math.inf
            events.next_change = stepper.stop_at(due).t if self._due else math.inf
            target = min(stop, stepper.stop_at(due).position) if self._due else stop
            ended = drive.to(target)
            if ended and ended.status is not Status.EVENT:
                return ended
            ended = stepper.failure or self._act(output)
            if ended:
                return ended
            if events.over:
                return Ending(Status.EVENT)
            if stepper.position >= stop:
                return None

    def _act(self, output: Output) -> Ending | None:
        """Execute what is due now, in the module's order; return an `Ending` or None."""
        stepper, events, t = self._stepper, self._events, self._stepper.t
        fired, stuck, before = events.fired, events.stuck, stepper.y
        fresh = set[int]()
        if stuck in fired and stuck >= len(self._functions) and stuck not in events.blends:
            if why := self._blend(stuck):
                events.take_back(stuck)
                return Ending(Status.SLIDING, why)
            fresh.add(stuck)
        if not stepper.on_given_steps and any(number < len(self._functions) for number in fired):
            # y where the zero was found, which a shorter last step may have missed by the tolerance
            apart = np.abs(events.row - before) > _ROUNDING * np.abs(before)
            stepper.set_y(np.where(apart, events.row, before))
            before = stepper.y
        moved = False
        while self._due and stepper.stop_at(self._due[0][0]).t <= t:
            moved, failure = True, self._change(self._due.pop(0)[1])
            if failure:
                return failure
        for number in fired:
            if number < len(self._functions):
                if stuck == number or self._piles_up(number):
                    events.take_back(number)
                    return Ending(Status.PILED_UP, self._name(number))
                failure = self._change(self._changes[number])
                if failure:
                    return failure
        if moved or fired:
            output.go_on(np.any(stepper.y != before))
            self._end_blends(set(events.blends) - fresh)
            events.go_on(before, stepper)
            self._take_sides()
        return Ending(Status.EVENT_FAILED, events.failure) if events.failure else None

    def _take_sides(self) -> None:
        """Let the right-hand side be evaluated on the side of each switch where y is now."""
        for number, side in enumerate(self._events.sides, len(self._functions)):
            blend = self._events.blends.get(number)
            place = (blend.center, blend.width) if blend else (0.0, 0.0)
            self._stepper.set_side(number - len(self._functions), side, *place)

    def _blend(self, number: int) -> str:
        """Let f be a blend of the sides of a switch from now on; return why it cannot, else ""."""
        stepper, events, t, y = self._stepper, self._events, self._stepper.t, self._stepper.y
        if self._rtol is None:
            return "a run by rtol= follows it"
        if stepper.system.structure is not None or stepper.system.has_algebraic:
            return "it is followed without bandwidth=, jac_sparsity= and algebraic rows"
        value = partial(value_of, events.function(number))
        errors, units = stepper.uncertainty, stepper.system.units(self._span)[: y.size]
        errors = np.where(errors > 0.0, errors, OF_SIZE * self._rtol * units)  # it starts at rest
        allowed = 0.5 * _difference(value, t, y, Errors(0.0, errors))
        terms = 0.5 * _difference(value, t, y, Errors(0.0, np.abs(y)))
        orders = stepper.system.highest_orders()[: y.size]
        share = _WIDTHS[int(orders.max() > 1.0 or orders.min() < _LOW_ORDER)]
        width = max(share * allowed, _LEAST_WIDTH * terms)
        if not 0.0 < 2.0 * width <= allowed:
            return "rounding hides it at this tolerance; a larger rtol follows it"
        if len(events.blends) == _MOST_BLENDS:
            return f"and {_MOST_BLENDS} others"
        ended, count = self._ended.get(number, (-1.0, 0))
        count = count + 1 if together(t, ended, stepper.system.frame.start) else 0
        if count > _MOST_RETURNS:
            return "and leaves it again and again"
        self._ended[number] = ended, count
        self._begins.append(t)
        if t - self._begins[0] < _SLIDES_WITHIN * self._span and len(self._begins) == _MANY_SLIDES:
            return "and leaves it again and again"
        side = events.sides[number - len(self._functions)]
        center = value(t, y) - side * width
        beyond = (1 + count) * _BEYOND * math.sqrt(self._rtol)
        events.blends[number] = _Blend(events.function(number), center, width, beyond, t)
        return ""

    def _end_blends(self, numbers: set[int]) -> None:
        """End those of these blends that the solution has left."""
        t, y, events = self._stepper.t, self._stepper.y, self._events
        for number in numbers:
            blend = events.blends[number]
            if number in events.fired or blend(t, y) < 0.0:
                del events.blends[number]
                events.left[number] = blend.side(t, y)
                self._ended[number] = t, self._ended[number][1]
                self._note(number, blend.since, t)

    def _note(self, number: int, begin: float, end: float) -> None:
        start = self._stepper.system.frame.start
        self._slides.append((number - len(self._functions), begin + start, end + start))

    def close(self) -> list[tuple[int, float, float]]:
        """Return the slides of the run: switch, begin and end."""
        for number, blend in self._events.blends.items():
            self._note(number, blend.since, self._stepper.t)
        return sorted(self._slides, key=lambda slide: slide[1])

    def _name(self, number: int) -> str:
        """Return the name of an event."""
        return getattr(self._functions[number], "__name__", repr(self._functions[number]))

    def _piles_up(self, number: int) -> bool:
        """Record a change by an event; return whether its changes accumulate without end."""
        times, t = self._times[number], self._stepper.t
        times.append(t)
        first = times[-2] if len(times) > 1 else self._start
        self._longest[number] = longest = max(self._longest[number], t - first)
        if len(times) < 3:
            return False
        last, before = t - first, first - times[-3]
        h, size = self._events.step, max(longest, _LONG * self._span)
        if (
            len(times) > _ACCUMULATION_CHANGES
            and t - times.pop(0) <= _ACCUMULATION_FRACTION * self._span
        ):
            return True
        if max(last, before) <= 1.5 * h:
            if longest > _ACCUMULATION_STEPS * h:
                return True
            if number not in self._crowded:  # acts at one given step after the other
                self._crowded.add(number)
                t += self._stepper.system.frame.start
                warn(
                    f"{self._name(number)} changes y at one step after the other from t = {t:g}, "
                    "and acts once a step only; take more steps, or rtol",
                    SolveWarning,
                )
        shorter = last < _SHORTER * before and before <= _ACCUMULATION_RATIO * size
        return shorter or last <= _SINGLE_ACCUMULATION_RATIO * size

    def _change(self, change: Any) -> Ending | None:
        """Set y to the value of ``change(t, y)``; return the `Ending` if that fails."""
        stepper = self._stepper
        frame, inside = stepper.system.frame, stepper.y
        y = frame.values(inside)
        try:
            given = np.asarray(change(stepper.t + frame.start, y.copy()))
            kinds = "biufc" if frame.paired else "biuf"
            usable = given.shape == y.shape and given.dtype.kind in kinds
            if not usable or not np.all(np.isfinite(given)):
                refuse("change", f"return a new y, finite and of shape {y.shape}", shown(given))
        except Exception as error:
            return Ending(Status.EVENT_FAILED, f"change: {type(error).__name__}: {error}")
        stepper.set_y(frame.moved(inside, given))
        return None


def _timed_changes(changes: Mapping[float, Callable], start: float) -> list[tuple[float, Callable]]:
    """Return the times of stated changes, counted from `start`, and their functions, in order."""
    required = "map times to functions change(t, y)"
    found = []
    for time, change in changes.items():
        t = real("times of changes", time) - start
        if not callable(change):
            refuse("changes", required, repr(change), "e.g. {12.0: dose}", kind=TypeError)
        if t <= 0:
            remedy = "a change at the start belongs into y0"
            refuse("changes", f"lie above {start:g}", f"{time:g}", remedy)
        found.append((t, change))
    return sorted(found, key=lambda pair: pair[0])


def nearest(t: float, times: np.ndarray, origin: float) -> float:
    """Return the element of `times` (k,) that counts as equal to t, or t itself."""
    same = times[together(times, t, origin)]
    return float(same[0]) if same.size else t


class HybridEvents(Events):
    """Zeros of event functions along a run that continues after some of them."""

    any = True

    def __init__(
        self, functions: Sequence[Callable], acting: Sequence[bool], n_events: int,
        stepper: JumpingStepper, signs: dict[str, float], known: np.ndarray,
    ) -> None:  # fmt: skip
        # functions: events, then switches; acting: which of them interrupt the march; known (k,):
        # times at which the run stops in any case; sides: signs of switches after the present time
        self._acting, self._start = acting, stepper.t
        self._known, self._origin = known, stepper.system.frame.start
        self._stop_at, self.next_change = stepper.stop_at, math.inf
        self.stuck: int | None = None  # a switch that slides, or an event that piles up
        self.step = 0.0  # length of the given step that ends at next_change [time]
        self.fired: dict[int, float] = {}  # acting where `look` ended, with signs after
        self.blends: dict[int, _Blend] = {}  # switches of which f is a blend of both sides
        self.left: dict[int, float] = {}  # sides of those whose blend ends now
        self._zeroed: set[int] = set()
        self._last: set[int] = set()
        self._disarmed: dict[int, Disarmed] = {}
        self._armed: dict[int, float] = {}
        self._back: set[int] = set()
        self._again: set[int] = set()
        super().__init__(functions, stepper, signs, n_events)

    def go_on(self, before: np.ndarray, stepper: JumpingStepper) -> None:
        """Continue with components that were `before` (d,); disarm zeros here of uncertain sign."""
        t, y = stepper.t, stepper.y
        values, known, disarmed, self._again = [], [], {}, set()
        self._functions = [self.function(number) for number in range(len(self._functions))]
        for number, blend in self.blends.items():
            self._functions[number] = blend
        for number, function in enumerate(self._functions):
            value = partial(value_of, function)
            then, now = self._seen(function, [t, t], [before, y]).tolist()
            sign = self._after[number] if now == then else 0.0
            kept = None if number in self._armed else self._disarmed.get(number)
            if number in self.blends:
                sign, kept = 1.0, None
            elif number in self.left:
                sign = self.left.pop(number)
                kept = Disarmed(Errors(0.0, stepper.uncertainty), 0.0, sign)
            elif number >= self.n_events and kept and number not in self.fired:
                if kept.hides(value, t, y, now):
                    sign = self.sides[number - self.n_events]
            elif number in self.fired or number in self._zeroed:
                zero = _Zero(value, before, then, now, self._after[number])
                find = self._behind_switch if number >= self.n_events else self._behind_event
                sign, kept = find(number, zero, stepper)
            if kept and (self._on_given_steps or kept.hides(value, t, y, now)):
                disarmed[number] = kept
            values.append(now)
            known.append(sign)
        self._begin(t, values, known, disarmed)

    def _behind_switch(
        self, number: int, zero: _Zero, stepper: JumpingStepper
    ) -> tuple[float, Disarmed]:
        """Return the sign with which a switch goes on after its zero, and how it is disarmed."""
        band = abs(zero.then) if self._on_given_steps and zero.now * zero.then > 0.0 else 0.0
        back = number in self._back
        return zero.sign, Disarmed(Errors(0.0, stepper.uncertainty), band, zero.sign, back)

    def _behind_event(
        self, number: int, zero: _Zero, stepper: JumpingStepper
    ) -> tuple[float, Disarmed | None]:
        """Return the sign with which an event goes on after its zero, and how it is disarmed."""
        # its value has the sign if the change led it away from the zero, otherwise the motion does
        value, t, y, now = zero.value, stepper.t, stepper.y, zero.now
        given, moved, rounded = self._on_given_steps, abs(now - zero.then), self._errors
        allowed = rounded._replace(of_y=np.maximum(rounded.of_y, stepper.uncertainty))
        unmoved = moved <= _difference(value, t, y, rounded)
        hidden = is_hidden(value, t, y, now, rounded) or (
            unmoved and is_hidden(value, t, y, now, allowed)
        )
        led_away = now * zero.sign < 0.0 or (not unmoved and abs(now) > abs(zero.then))
        if not hidden and (not given or led_away):
            return float(np.sign(now)), None
        ahead = sign_ahead(zero, stepper, self.step)
        if not given:
            errors = rounded if ahead else allowed
            return ahead, Disarmed(errors, 0.0, ahead if ahead == -zero.sign else 0.0)
        if _difference(value, t, y, Errors(0.0, np.where(y == 0.0, 1.0, 2.0 * np.abs(y)))) == 0.0:
            ahead = zero.sign  # a function of time alone
        if ahead == zero.sign and not hidden:
            if not unmoved and abs(now) < abs(zero.then):
                self._again.add(number)  # led back, but by less than the step went beyond
            return ahead, None
        side, until = ahead if ahead == -zero.sign else 0.0, t + 2.0 * self.step * _STEPS_AHEAD[-1]
        return ahead, Disarmed(rounded, abs(zero.then), side, until=until)

    def _begin(
        self,
        t: float,
        values: list[float],
        after: list[float],
        disarmed: dict[int, Disarmed] | None = None,
    ) -> None:
        """Start at time t, as `Events` do, with these functions `disarmed`."""
        self._disarmed, self._armed = dict(disarmed or {}), {}
        self._last = set(self.fired) | (self._last if t == self._start else set())
        self.fired, self._zeroed, self._back = {}, set(), set()
        signs = list(after)
        for number in range(self.n_events, len(values)):
            if values[number] == 0 and not signs[number]:  # either side may be the right one
                self._disarmed[number], signs[number] = _UNDECIDED, 1.0
        super()._begin(t, values, signs)
        self.sides = self._after[self.n_events :]

    def look(self, edges: np.ndarray, at: Callable) -> float | None:
        """Locate zeros between `edges` as `Events` do, and also end where a function acts."""
        end = super().look(edges, at)
        reached = edges[-1] if end is None else end
        if self._on_given_steps:
            last = max(int(np.searchsorted(edges, reached)), 1)
            self.step = float(edges[last] - edges[last - 1])
        self.interrupted = bool(self.fired) or bool(together(reached, self.next_change))
        return end

    def _looked_at(self, times: np.ndarray, edges: np.ndarray) -> np.ndarray:
        """Return the times, between these edges, at which functions are evaluated."""
        self._returns: list[tuple[float, int, float]] = []
        self.stuck = None
        if edges[0] == self._start and self._last and not self._on_given_steps:
            # just after a change two zeros may be arbitrarily close to each other
            times = np.union1d(times, edges[0] + (edges[1] - edges[0]) * _NEXT)
            near = (times > edges[0]) & (times < edges[0] * (1 + _ROUNDED_TIME))
            times = times[~(near & (times < edges[1]))]
        return times

    def _zeros_of(
        self, number: int, times: np.ndarray, values: np.ndarray, at: Callable, edges: np.ndarray
    ) -> Iterator[tuple[float, float]]:
        """Yield the zeros of a function up to the first one at which it acts."""
        kept, until = self._disarmed.get(number), 0
        if kept and number not in self._armed:
            until = self._hidden_until(number, kept, times, values, at)
            values[:until] = 0.0  # without signs there are no zeros
        self._values[number] = values[-1]
        if kept and 0 < until < values.size and kept.side * values[until] < 0.0:
            t = float(times[until - 1] if self._on_given_steps else edges[0])
            if number < self.n_events or kept.back:
                self.stuck = number
                self._returns.append((t, number, -kept.side))
            else:  # perhaps it did not cross: the other side is tried
                self._back.add(number)
                yield t, -kept.side
            return
        if number in self._again:
            self._again.discard(number)
            yield float(times[1]), float(np.sign(values[1]))
            return
        for t, sign in self._zeros(self._functions[number], times, values, at):
            if self._acting[number]:
                t = nearest(t, self._known, self._origin)
                if not self._on_given_steps and edges[0] > self._start:
                    t = nearest(t, edges[:1], self._origin)  # no step reaches a time so close
            if t <= self._start or together(t, self._start, self._origin):
                t = self._start
                if number in self._last:
                    self.stuck = number
                    self._returns.append((t, number, sign))
                    return
                if number < self.n_events and self._is_known(number, t):
                    continue
            if self._acting[number]:  # a step at the very time may be earlier by rounding
                t = min(t, self._stop_at(t).t)
            yield t, sign
            if self._acting[number]:
                return

    def _hidden_until(
        self, number: int, kept: Disarmed, times: np.ndarray, values: np.ndarray, at: Callable
    ) -> int:
        """Return the index of the first of `times` after the first at which a sign is certain."""
        value = partial(value_of, self._functions[number])
        for i in range(1, times.size):
            try:
                if not kept.hides(value, times[i], at(times[i : i + 1])[0], values[i]):
                    self._armed[number] = float(times[i])
                    return i
            except Exception:
                continue
        return times.size

    def _end(self, end: float, found: list[tuple[float, int, float]], edges: np.ndarray) -> float:
        """Return the time at which the march ends, by a terminal event or a function that acts."""
        acting = [one for one in found if self._acting[one[1]]] + self._returns
        stands = self._stop_at(min(acting)[0]).t if acting else math.inf
        last = self._stop_at(end).t if acting and end < math.inf else end
        if acting and (stands <= last or together(stands, last)):
            over = end < math.inf and (last <= stands or bool(together(last, stands)))
            self.fired = {n: sign for t, n, sign in acting if t <= stands or together(t, stands)}
            # zeros at the time of the interruption belong to it
            for i, (t, number, sign) in enumerate(found):
                found[i] = (stands if together(t, stands) else t, number, sign)
            end = stands
        else:
            over = end < math.inf
        end = super()._end(end, found, edges)
        self.over = over and not self.failure
        if self.failure:
            self.fired = {}
        return end

    def _keep(self, found: list[tuple[float, int, float]], end: float, at: Callable) -> None:
        """Store zeros up to `end`, and the signs just after it."""
        super()._keep(found, end, at)
        dt = 2.0 * ONE_TIME * max(abs(end), abs(self._origin))
        self.row, beside = at(np.array([end, max(end - dt, self._start)]))
        self._errors = Errors(dt, _ROUNDING * np.abs(self.row) + np.abs(self.row - beside))
        self._zeroed = {number for t, number, _ in found if t == end}
        for number in self.fired:
            if number >= self.n_events:  # whose zero may lie at the end itself
                self._after[number] = -self.sides[number - self.n_events]

    def function(self, number: int) -> Callable:
        """Return an event or a switch, also while f is a blend of its sides."""
        function = self._functions[number]
        return function.function if isinstance(function, _Blend) else function

    def signs(self) -> dict[str, float]:
        """Return the signs of functions as `Events` does, without those of blends."""
        for number in self.blends:
            self._after[number] = 0.0
        return super().signs()

    def take_back(self, number: int) -> None:
        """Let the run find the last zero of a function again when it continues."""
        self._after[number] = -self.fired[number]


class _Zero(NamedTuple):
    """A zero of an event at the present time: value and y, (d,), around a change of y."""

    value: Callable[[float, np.ndarray], float]  # value(t, y)
    before: np.ndarray
    then: float  # value before the change
    now: float  # value after the change
    sign: float  # after the zero, without the change


class Errors(NamedTuple):
    """Errors of the time t, and of y at it, (d,), by which the value of an event is uncertain."""

    of_t: float
    of_y: np.ndarray


class Disarmed(NamedTuple):
    """A function that has no zeros until its sign is certain."""

    errors: Errors
    band: float  # largest |value| that is uncertain in any case, at given steps
    side: float  # sign that is expected, 0 if either is; the other sign means a return
    back: bool = False  # whether a switch has returned once
    until: float = math.inf  # end of the wait of a step function for its return, at given steps

    def hides(
        self, value: Callable[[float, np.ndarray], float], t: float, y: np.ndarray, now: float
    ) -> bool:
        """Return whether the sign of the value `now` at time t is uncertain."""
        waits = abs(now) == self.band and now * self.side < 0.0 and t <= self.until
        if self.band and (abs(now) < self.band or waits):
            return True
        return is_hidden(value, t, y, now, self.errors)


# A switch that begins at its zero.
_UNDECIDED = Disarmed(Errors(0.0, np.zeros(1)), 0.0, 1.0)


def is_hidden(
    value: Callable[[float, np.ndarray], float], t: float, y: np.ndarray, now: float, errors: Errors
) -> bool:
    """Return whether an event may have another sign than that of `now`."""
    values = [now, *(v for v in _beside(value, t, y, errors) if math.isfinite(v))]
    return min(values) <= 0.0 <= max(values)


def _difference(
    value: Callable[[float, np.ndarray], float], t: float, y: np.ndarray, errors: Errors
) -> float:
    """Return the largest difference of the values of an event by errors."""
    values = [v for v in _beside(value, t, y, errors) if math.isfinite(v)]
    return max(values) - min(values) if values else math.inf


def _beside(
    value: Callable[[float, np.ndarray], float], t: float, y: np.ndarray, errors: Errors
) -> list[float]:
    """Return values of an event, where defined, for errors of equal and of opposite signs."""
    together, apart = np.ones(y.size), (-1.0) ** np.arange(y.size)
    sides = (1, together), (-1, -together), (1, apart), (-1, -apart)
    try:
        with np.errstate(all="ignore"):
            return [value(t + k * errors.of_t, y + side * errors.of_y) for k, side in sides]
    except Exception:
        return []


def sign_ahead(zero: _Zero, stepper: Stepper, step: float) -> float:
    """Return the sign of an event after a change of y; 0 if it is unknown."""
    # It is the sign of the slope of the event along the motion. A motion that comes to rest has
    # turned back. A component of an order below 1 is led by the jump of its derivative. An event
    # without a slope turns back if the motion leads it back in some given steps, of length `step`.
    t, y, system, slopes = stepper.t, stepper.y, stepper.system, []
    if system.reads:
        return 0.0
    dt, orders = _AHEAD * t, system.highest_orders()
    try:
        with np.errstate(all="ignore"):
            start = system.motion(t, zero.before, stepper.ydot)
            motion = system.motion(t, y, stepper.ydot)
            for there, moved in (zero.before, start), (y, motion):
                led = np.where(orders < 1.0, (moved - start) * dt**orders, moved * dt)
                slope = zero.value(t + dt, there + led) - zero.value(t, there)
                slopes.append(float(np.sign(slope)))
            if step > 0.0 and slopes == [0.0, 0.0]:
                later = [zero.value(t + dt, y + motion * dt) for dt in step * _STEPS_AHEAD]
                return -zero.sign if min(zero.sign * v for v in later) < 0.0 else zero.sign
    except Exception:  # the march meets it again
        return 0.0
    before, after = slopes
    if before == after:
        return zero.sign
    return after or -zero.sign if before in (zero.sign, 0.0) else 0.0


def one_sided(system: System, functions: Sequence[Callable], scheme: Scheme) -> System:
    """Return the system whose right-hand side is evaluated on one side of each switch."""
    if not scheme.takes_switches:
        required = f"be left out with {type(scheme).__name__}"
        refuse("switches", required, f"{len(functions)}", "use L1 or BDF(2)")
    frame = system.frame
    n_user = len(frame.speeds) or system.n_solved
    y0 = frame.values(system.at_start[: system.n_solved])
    values = tuple(switch_of(function, y0, frame.start) for function in functions)
    sides = [math.copysign(1.0, value_of(each, frame.start, y0)) for each in functions]
    sided = with_switches(system.functions, values, sides, n_user)
    return replace(system, matrix=None, linear_alone=False, functions=sided, switches=values)
