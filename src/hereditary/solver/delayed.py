"""The march of an equation with delays, whose delayed values come from the march's own steps.

The stepper of an equation without delays marches, and its right-hand side reads the solution of
earlier steps in compiled code (compiled/delayed_values.py). This file knows the kinks that delays
make of a start or a jump. Before a march begins it writes pasts, and delays that vary, as pieces.

A kink of f with the exponent e makes a kink of the solution with e plus the lowest order. With
exponents up to 1 there the march begins anew. Otherwise a step ends at the kink, if 1e-4**e exceeds
rtol or e is below 1; and a kink with a larger e is nothing.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..compiled.delayed_values import Delays, read_delays, within_delays
from ..equation.delay import TOUCHES, Delayed
from ..equation.system import System
from ..stepping.dense import Piece
from ..stepping.state import State, layout_of
from ..stepping.status import Ending, SolveWarning, failed
from ..stepping.stepper import JumpingStepper, ResumableStepper
from ..stepping.times import together
from ..support.checks import refuse
from ..support.warning import warn
from .delayed_pieces import (
    appended,
    contents,
    drop_before,
    first_pieces,
    roomy,
    set_last,
    solved,
    with_contents,
)
from .events import bracketed_root
from .piecewise import FitTolerance, Piecewise, piecewise

# Exponents from which on a kink of f is nothing: for each decimal digit of rtol, and at least. On
# the drawn systems of convergence/delays.py twice both takes seven times the steps and errs alike.
_SMOOTH_EXPONENT_PER_DIGIT = 0.25
_MIN_SMOOTH_EXPONENT = 1.0
# Exponents of the solution below which the march begins anew at a kink.
_SINGULAR_EXPONENT = 1.0
# Exponents below this are those of jumps.
_OF_JUMPS = 1e-9
# Most kinks that are known before a march: several delays have many sums. Later ones are found by
# the error of a step, as jumps are that nobody named.
_MOST_KINKS = 2000
# Times whose relative difference is below this count as equal.
_ALIKE = 1e-12
# Samples of a past; of a delay that varies over the run at least, for each delay, and at most.
_MIN_PAST_SAMPLES = 1000
_FOR_EACH = 20
_MAX_PAST_SAMPLES = 50_000
# Times at which a past is called twice: one that is random has no polynomials, and takes minutes.
_AGAIN = 4
# Difference of a past from its polynomials, as a fraction of rtol.
_OF_RTOL = 1e-4
# The same on given steps, and the least with a tolerance: a fraction of the size of a component.
_ON_STEPS = 1e-10
_MIN_PAST_TOL = 1e-13
# Least delay that varies, as a fraction of the run.
_LEAST_DELAY = 1e-9
# Steps of a search for the least delay.
_HALVINGS_TO_LEAST_DELAY = 80
# Largest relative change of delayed values that shows by how much f depends on them.
_FACTOR = 0.01
# Points, in units of 1 and of the components, at which algebraic rows are asked what they read.
_ASKED = (0.0, 0.37, -0.61)


class Remembered(NamedTuple):
    """Data that a march with delays stores beside its inner stepper."""

    jumps: tuple[float, ...]  # times at which y jumps
    kinks: tuple[tuple[float, float], ...]  # time and exponent of each kink of f
    pieces: tuple[np.ndarray, ...]  # of the solution, and displacements of pasts


class DelayedStepper(ResumableStepper, JumpingStepper):
    """A stepper whose right-hand side reads the solution of earlier times."""

    def __init__(
        self, inner: Any, delays: tuple[Delayed, ...], t_end: float, rtol: float | None = None
    ) -> None:
        # inner: the march without delays, at the start or at a state; rtol: None on given steps
        self._inner, self._delays, self._t_end = inner, delays, t_end
        self.on_given_steps = inner.on_given_steps
        self._origin = self.system.frame.start
        self._breaks = np.zeros(0)
        self._marks = np.zeros(0)  # breaks, kinks and the end of the run
        self._jumps: list[float] = []  # times at which y jumps
        self._until = -1.0  # time up to which the windows of delays hold
        self._error: Exception | None = None
        self._gain = _gain(self.system)
        digits = -np.log10(rtol or 1.0)
        self._smooth = max(_MIN_SMOOTH_EXPONENT, _SMOOTH_EXPONENT_PER_DIGIT * digits)
        self._singular = 0.0 if rtol is None else self._singular_below()
        tol = _ON_STEPS if rtol is None else max(_OF_RTOL * rtol, _MIN_PAST_TOL)
        self._taus = [self._tau_of(delay, tol) for delay in delays]
        self._pasts = [self._past_of(delay, tol) for delay in delays]
        d, known = self.system.n_solved, self.system.functions.delays
        by_means = np.ones(d, np.int64) if rtol is None else inner.form.above_one[:d].copy()
        start = self.system.at_start[:d] if rtol is None else None
        self.pieces = first_pieces(known, by_means, delays, self._taus, self._pasts, start)
        inner.take_delays(self.pieces)
        self._roots, self._sides = self._of_start()  # kinks of f; jumps that each delay reads
        self._kinks = self._later(self._roots)
        if self.on_given_steps:
            self._last_step()

    def _singular_below(self) -> float:
        """Return the exponent of f below which the march begins anew at a kink."""
        form = self._inner.form
        jumps = form.algebraic.any() or form.kernels  # with f, or the solution is no power of time
        return max(_SINGULAR_EXPONENT - form.generators[0], _OF_JUMPS if jumps else 0.0)

    def _fit_tolerance(self, tol: float, low: float, high: float) -> FitTolerance:
        """Return the accuracy with which a function of the user is met between two times."""
        orders = self.system.highest_orders()[: self.system.n_solved]
        largest = max(abs(self._origin + low), abs(self._origin + high), high - low)
        return FitTolerance(tol, min(float(orders.min()), 1.0), 64 * np.spacing(largest))

    def _tau_of(self, delay: Delayed, tol: float) -> Piecewise | None:
        """Return a delay that varies as polynomials; refuse one that grows faster than t."""
        start, end, origin = self._inner.t, self._t_end, self._origin
        if not callable(delay.past.delay.tau):
            return None
        seen: list[tuple[np.ndarray, np.ndarray]] = []

        def tau(t: np.ndarray) -> np.ndarray:
            seen.append((t, delay.taus(t)))
            return seen[-1][1][:, None]

        first = float(delay.taus(np.array([start]))[0])
        many = np.clip(_FOR_EACH * (end - start) / first, _MIN_PAST_SAMPLES, _MAX_PAST_SAMPLES)
        found = piecewise(tau, start, end, int(many), self._fit_tolerance(tol, start, end))
        times, taus = (np.concatenate(part) for part in zip(*seen, strict=True))
        times, order = np.unique(times, return_index=True)
        taus = taus[order]
        _refuse_vanishing(delay, times, taus, end - start)
        ago = times - taus
        rounding = 8 * np.spacing(max(abs(end), abs(origin)) + taus.max())
        if (np.diff(ago) < -rounding).any() or not ago[0] < ago[-1]:
            k = int(np.argmin(np.diff(ago)))
            got = " and then ".join(
                f"t - tau(t) = {ago[i] + origin:.8g} at t = {times[i] + origin:.8g}"
                for i in (k, k + 1)
            )
            refuse("tau", "grow slower than t", got)
        self._note_missed("delay", found)
        return found

    def _note_missed(self, name: str, found: Piecewise) -> None:
        """Warn if a function of the user varies too fast for polynomials."""
        if found.missed:
            warn(
                f"the {name} varies too fast: at t = {found.where + self._origin:g} it is "
                f"missed by {found.missed:.1g} of its size; give a smoother one",
                SolveWarning,
            )

    def _past_of(self, delay: Delayed, tol: float) -> Piecewise | None:
        """Return the past that a delay still reads as polynomials, or None for a constant."""
        first, last = np.minimum(delay.ago(np.array([self._inner.t, self._t_end])), 0.0).tolist()
        if not callable(delay.past.delay.past) or first >= last:
            return None
        some = np.linspace(first, last, _AGAIN, endpoint=False)
        if not np.array_equal(delay.before(some), delay.before(some)):
            remedy = "interpolate values that are drawn once, by numpy.interp"
            refuse("past", "return equal values at equal times", "others in a second call", remedy)
        found = piecewise(
            delay.before, first, last, _MIN_PAST_SAMPLES, self._fit_tolerance(tol, first, last)
        )
        self._note_missed("past of a delay", found)
        return found

    def _of_start(self) -> tuple[list[tuple[float, float]], list[list[float]]]:
        """Return kinks of f by the start, by pasts and by delays that vary; and jumps of pasts."""
        d = self.system.n_solved
        found, sides = [pair for tau in self._taus if tau for pair in tau.kinks], []
        for delay, past in zip(self._delays, self._pasts, strict=True):
            at = np.zeros(1)
            end = past(at, at)[0] if past else delay.before(at - np.spacing(1.0))[0]
            met = np.allclose(end, self.system.at_start[:d], rtol=1e-12, atol=0.0)
            kinks = [*(past.kinks if past else []), (0.0, self._gain if met else 0.0)]
            found += [(_when(delay, t, 0.0, self._t_end), exponent) for t, exponent in kinks]
            sides.append([t for t, exponent in kinks if self._stops(exponent)])
        return found, sides

    def _stops(self, exponents: Any) -> Any:
        """Return whether the march stops at kinks of f with these exponents."""
        return exponents < max(self._singular, _OF_JUMPS)

    def delayed(self, t: float) -> np.ndarray:
        """Return what the right-hand side reads at a time of the march: k delays, (k, d)."""
        out = np.empty((len(self._delays), self.system.n_solved))
        read_delays(self.pieces, t, out)
        return out

    def _prepare(self) -> None:
        """Make room for pieces, and set the windows of delays up to the next stop."""
        t, pieces = self._inner.t, self.pieces
        ahead = self._stops_at[(self._stops_at > t) & ~together(self._stops_at, t, self._origin)]
        until = float(ahead[0]) if ahead.size else self._t_end
        if until != self._until:
            self._until = until
            middle = np.array([0.5 * (t + until)])
            for delay, known in zip(self._delays, self._known_sides, strict=True):
                known = known if t < self._known_until else known[[0, -1]]
                i = int(np.searchsorted(known, delay.ago(middle)[0], side="right"))
                pieces.windows[delay.number] = known[i - 1], np.nextafter(known[i], -np.inf)
        self._take(roomy(pieces, self._earliest()))
        self.pieces.read_at[:] = np.nan
        last = within_delays(self.pieces, t, until - t)
        self._inner.note_reads(self._change_by_delays(t + 0.5 * last))

    def _take(self, pieces: Delays) -> None:
        """Let f read these pieces."""
        if pieces is not self.pieces:
            self.pieces = pieces
            self._inner.take_delays(pieces)

    def _change_by_delays(self, t: float) -> np.ndarray:
        """Return how much f changes by delayed values at time t, (d,), as units of its rounding."""
        # by factors that differ for each component, so that terms that cancel count
        system, factors = self._inner.system, self.pieces.factors
        y = np.append(self._inner.y, np.zeros(system.d - system.n_solved))  # other memory is 0
        f = system.rhs(t, y)
        factors += _FACTOR / np.sqrt(2.0 + np.arange(factors.size))
        self.pieces.read_at[:] = np.nan
        changed = system.rhs(t, y)
        factors[:], self.pieces.read_at[:] = 1.0, np.nan
        return np.abs(changed - f) / _FACTOR

    def set_breaks(self, times: np.ndarray, t_end: float) -> None:
        """Let steps see jumps at these times, and the kinks that follow them by delays."""
        self._breaks, self._t_end = times, t_end
        if self.on_given_steps:
            self._inner.set_breaks(times, t_end)
            return
        self._kinks = self._later([*self._kinks, *((t, 0.0) for t in times.tolist())])
        self._set_marks(t_end)

    def _later(self, kinks: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
        """Return the kinks, and those that follow by delays; none on given steps."""
        if self.on_given_steps:
            return []
        return _kinks(self._delays, kinks, self._gain, self._smooth, self._t_end, self._origin)

    def _set_marks(self, first: float) -> None:
        """Let steps end at breaks and kinks; equal times become one, which is `first` if it can."""
        kinks = np.array(self._kinks).reshape(-1, 2)
        times = np.concatenate([[first, self._t_end], self._breaks, kinks[:, 0]])
        exponents = np.full(times.size, np.inf)
        exponents[2:] = np.append(np.full(self._breaks.size, -1.0), kinks[:, 1])
        order = np.argsort(times, kind="stable")
        apart = ~together(times[order][1:], times[order][:-1], self._origin)
        begins = np.flatnonzero(np.append(True, apart))
        self._marks = times[np.minimum.reduceat(order, begins)]
        lowest = np.minimum.reduceat(exponents[order], begins)
        many = len(self._kinks) == _MOST_KINKS
        self._known_until = self._kinks[-1][0] if many else self._t_end
        again = lowest < self._singular
        stops = self._stops(lowest) | together(self._marks, self._known_until, self._origin)
        self._stops_at, self._until = self._marks[stops], -1.0
        later = np.maximum(lowest, 0.0) + self._gain
        seen = np.union1d(self._marks[self._stops(later)], self._jumps)
        seen = np.append(seen, [-np.inf, np.inf])
        self._known_sides = [np.union1d(seen, own) for own in self._sides]
        self._take(self.pieces._replace(ends=self._marks[~stops]))
        self._inner.set_breaks(self._marks[again], self._t_end)

    def advance(self, stop: float, keep: bool = True) -> Piece | None:
        """March towards position `stop`, at most to the next kink."""
        if self.on_given_steps:
            return self._advance_given(stop, keep)
        same = self._marks[together(self._marks, stop, self._origin)]
        if same.size and same[0] != stop:
            self._set_marks(stop)
        try:
            self._prepare()
        except Exception as error:  # of a past, or of a delay that varies
            self._error = error
            return None
        n_found = len(self._inner.found)
        piece = self._inner.advance(min(stop, self._until))
        found = self._inner.found[n_found:]
        if found:
            self._breaks = np.union1d(self._breaks, found)
            self._kinks = self._later([*self._kinks, *((t, 0.0) for t in found)])
            self._set_marks(self._t_end)
        return piece if keep else None

    def _advance_given(self, stop: float, keep: bool) -> Piece | None:
        """March by given steps towards step `stop`, at most to the last known delayed value."""
        inner, n = self._inner, self._inner.position
        self.pieces.read_at[:] = np.nan
        try:
            last = self._last_step()
        except Exception as error:
            self._error = error
            return None
        earliest = self._earliest()  # events read delayed values at times of these steps
        piece = inner.advance(min(stop, last))
        if piece is not None:
            self._take(appended(self.pieces, piece, n, earliest))
        return piece if keep else None

    def _last_step(self) -> int:
        """Return the last given step whose delayed values are known."""
        inner, t = self._inner, self._inner.t
        until = min(min(_when(delay, t, t, self._t_end) for delay in self._delays), self._t_end)
        found = inner.stop_at(until)
        last = int(found.position) - int(found.t > until * (1 + _ALIKE))
        if last <= inner.position < inner.stop_at(self._t_end).position:
            required = "be at least a step h on given steps"
            refuse("tau", required, f"{until - t:g} at t = {t:g}", "take more steps")
        return last

    def linear_arrays(self) -> list[np.ndarray]:
        """Return every array that is linear in the solution, with pieces that delays read."""
        return [*self._inner.linear_arrays(), *solved(self.pieces)]

    def _earliest(self) -> float:
        """Return the earliest time that a delay reads at the present time."""
        t = np.array([self._inner.t])
        return min(float(delay.ago(t)[0]) for delay in self._delays)

    system = property(lambda self: self._inner.system)
    position = property(lambda self: self._inner.position)
    t = property(lambda self: self._inner.t)
    y = property(lambda self: self._inner.y)
    ydot = property(lambda self: self._inner.ydot)
    diagnostics = property(lambda self: self._inner.diagnostics)
    uncertainty = property(lambda self: self._inner.uncertainty)
    sizes_and_noise = property(lambda self: self._inner.sizes_and_noise)
    # methods
    stop_at = property(lambda self: self._inner.stop_at)
    stats = property(lambda self: self._inner.stats)
    expect_jumps = property(lambda self: self._inner.expect_jumps)
    limit_rows = property(lambda self: self._inner.limit_rows)

    @property
    def failure(self) -> Ending | None:
        """Why the march cannot go on, else None."""
        return self._inner.failure if self._error is None else failed(self._error)

    def checkpoint(self) -> tuple:
        """Return copies of everything that a step changes."""
        return self._inner.checkpoint(), self._remembered()

    def _remembered(self) -> Remembered:
        """Return copies of the kinks that may have later ones, and of pieces."""
        earliest = self._earliest()
        kinks = tuple(pair for pair in self._kinks if pair[0] >= earliest)
        return Remembered(tuple(self._jumps), kinks, contents(self.pieces))

    def remember(self, remembered: Remembered) -> None:
        """Restore kinks and pieces; the inner stepper has already been restored."""
        self._jumps = list(remembered.jumps)
        self._kinks = self._later([*self._roots, *remembered.kinks])
        self._take(with_contents(self.pieces, remembered.pieces))
        self._until = -1.0

    def come_back(self, checkpoint: tuple) -> None:
        """Return to the time at which `checkpoint` was taken."""
        self._inner.come_back(checkpoint[0])
        self.remember(checkpoint[1])

    def state(self) -> State:
        """Return a state from which another run continues."""
        drop_before(self.pieces, self._earliest())
        inner = self._inner.state()
        state = replace(inner, checkpoint=(inner.checkpoint, self._remembered()))
        return replace(state, layout=layout_of(state))

    def restore(self, state: State, allow_change: bool = False) -> None:
        """Continue from `state`; `allow_change` admits another right-hand side or parameters."""
        self._inner.restore(replace(state, checkpoint=state.checkpoint[0]), allow_change)
        self.remember(state.checkpoint[1])

    def set_y(self, y: np.ndarray) -> None:
        """Let y jump to these values, (d,)."""
        self._inner.set_y(y)
        self._jumped()

    def set_side(self, number: int, sign: float, center: float = 0.0, width: float = 0.0) -> None:
        """Evaluate the right-hand side on another side of a switch."""
        self._inner.set_side(number, sign, center, width)
        self._jumped()

    def _jumped(self) -> None:
        """Record that the solution has a jump at the present time."""
        if self.on_given_steps:
            set_last(self.pieces, self._inner.y)
            return
        t = self._inner.t
        later = [(_when(delay, t, t, self._t_end), 0.0) for delay in self._delays]
        self._jumps.append(t)
        ahead = [pair for pair in self._kinks if pair[0] >= self._earliest()]
        self._kinks = self._later([*ahead, *later])
        self._set_marks(self._t_end)


def _gain(system: System) -> float:
    """Return by how much the exponent of a kink is larger one delay later."""
    # the lowest order; 0 if an algebraic row reads a delayed algebraic one, as smooth as the kink
    d, orders = system.n_solved, system.highest_orders()
    gain = float(np.min(orders[:d], where=orders[:d] > 0, initial=np.inf))
    if not system.algebraic.any():
        return gain
    asked = replace(system, functions=system.functions.for_a_march())
    numbers = asked.functions.delays.numbers
    aside = 0.1 * np.sqrt(2.0 + np.arange(numbers.size)).reshape(-1, d) * system.algebraic[:d]

    def forces(share: float, by: float) -> np.ndarray:
        y = asked.at_start + share * (1.0 + np.abs(asked.at_start))
        numbers[:] = (y[:d] + by * aside * (1.0 + np.abs(y[:d]))).ravel()
        return asked.rhs(0.5, y)[:d][system.algebraic]

    try:
        unread = all((forces(share, 1.0) == forces(share, 0.0)).all() for share in _ASKED)
    except Exception:  # the march meets it again
        unread = False
    return gain if unread else 0.0


def _refuse_vanishing(delay: Delayed, times: np.ndarray, taus: np.ndarray, span: float) -> None:
    """Refuse a delay whose least value, searched next to the least of `taus` (n,), is about 0."""
    k = int(np.argmin(taus))
    before, after = max(k - 1, 0), min(k + 1, times.size - 1)
    if taus[k] > max(taus[before], taus[after]) - taus[k]:
        return
    low, high = times[before], times[after]
    for _ in range(_HALVINGS_TO_LEAST_DELAY):
        thirds = low + (high - low) * np.array([1 / 3, 2 / 3])
        at_thirds = delay.taus(thirds)
        low, high = (low, thirds[1]) if at_thirds[0] < at_thirds[1] else (thirds[0], high)
        if not at_thirds.min() > _LEAST_DELAY * span:
            t = thirds[np.argmin(at_thirds)] + delay.past.origin
            refuse("tau", "stay above 0", f"tau({t:.10g}) = {at_thirds.min():.1g}", TOUCHES)


def _when(delay: Delayed, t: float, low: float, high: float) -> float:
    """Return the time s at which a delay reads time t, ``s - tau(s) = t``; at most `high`."""

    def ahead(s: float) -> float:
        return float(delay.ago(np.array([s]))[0]) - t

    if not callable(delay.past.delay.tau):
        return t + delay.past.delay.tau
    if ahead(high) <= 0:
        return high
    if ahead(low) >= 0:
        return low
    return bracketed_root(ahead, low, high)


def _kinks(
    delays: tuple[Delayed, ...], roots: Iterable[tuple[float, float]], gain: float, smooth: float,
    t_end: float, origin: float,
) -> list[tuple[float, float]]:  # fmt: skip
    """Return kinks of f before `t_end`: of the roots, and of those that read a kink."""
    # Roots are pairs of a time and of the exponent of the first power of t there, 0 for a jump. One
    # delay later the exponent is larger by `gain`. From the exponent `smooth` on they are no kinks.
    ahead = [(t, exponent) for t, exponent in roots if t < t_end]
    heapq.heapify(ahead)
    times: list[float] = []
    found: list[tuple[float, float]] = []
    lowest = np.inf  # exponent at the last of the times
    while ahead and len(times) < _MOST_KINKS:
        t, exponent = heapq.heappop(ahead)
        if times and together(t, times[-1], origin):
            if exponent >= lowest:
                continue
            found[-1] = (times[-1], exponent)
        else:
            times.append(t)
            found.append((t, exponent))
        lowest = exponent
        if exponent + gain < smooth:
            for delay in delays:
                later = _when(delay, t, t, t_end)
                if later < t_end:
                    heapq.heappush(ahead, (later, exponent + gain))
    return found
