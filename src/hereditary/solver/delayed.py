"""The march of an equation with delays, by the method of steps.

The stepper of an equation without delays marches as far as delayed values are known. Then these
values are written into the tables that the right-hand side reads (equation/delay.py).
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.chebyshev import chebval, chebvander

from ..compiled.functions import N_COEFFICIENTS, Delays
from ..equation.delay import NODES, TOUCHES, Delayed
from ..equation.system import System
from ..stepping.dense import Piece, StepPieces
from ..stepping.state import State, layout_of
from ..stepping.status import Ending, SolveWarning, failed
from ..stepping.stepper import JumpingStepper, ResumableStepper
from ..stepping.times import ONE_TIME, together
from ..support.checks import refuse
from ..support.warning import warn
from .events import bracketed_root
from .piecewise import LEAST_SIZE, FitTolerance, Piecewise, piecewise, to_polynomials

# Points in [-1, 1], the interval of a polynomial, at which it is compared with the solution.
_COMPARISON_POINTS = np.array([-0.95, -0.4, 0.15, 0.8])
_AT_COMPARISON_POINTS = chebvander(_COMPARISON_POINTS, N_COEFFICIENTS - 1)
# Largest difference there, as a fraction of the largest value of the component.
_TABLE_ROUNDING = 1e-13
# An interval is halved again if the last halving multiplied the difference by less than this. Next
# to a start the solution is no polynomial, and halving does not help against rounding.
_FALLS = 0.95
# Exponents of t from which on a kink is no break: for each decimal digit of rtol, and at least.
# With half of them D^0.6 y = -y(t - 1) from 201 data errs by 1e-3 of rtol instead of 1e-5.
_SMOOTH_EXPONENT_PER_DIGIT = 0.75
_MIN_SMOOTH_EXPONENT = 3.0
# Most kinks of a run: several delays have many sums.
_MOST_KINKS = 10_000
# Times whose relative difference is below this count as equal.
_ALIKE = 1e-12
# Samples of a past; of a delay that varies over the run at least, for each delay, and at most.
_MIN_PAST_SAMPLES = 1000
_FOR_EACH = 20
_MAX_PAST_SAMPLES = 50_000
# Times at which a past is called twice: one that is random has no table, and takes minutes.
_AGAIN = 4
# Difference of a past from its table, as a fraction of rtol.
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


class Solved(NamedTuple):
    """Dense output between two times."""

    start: float
    end: float
    piece: Piece


class Remembered(NamedTuple):
    """Data that a march with delays stores beside its inner stepper."""

    solved: tuple[Solved, ...]  # dense output that a delay still reads
    roots: tuple[tuple[float, float], ...]  # time and exponent of each kink that later ones follow
    until: float  # time up to which the tables have delayed values
    tables: tuple[tuple[np.ndarray, np.ndarray], ...]  # times and polynomials, by delay
    displacements: tuple[np.ndarray, ...]  # of y before the start, (d,), by delay


class DelayedStepper(ResumableStepper, JumpingStepper):
    """A stepper whose right-hand side reads the solution of earlier times."""

    def __init__(
        self, inner: Any, delays: tuple[Delayed, ...], t_end: float, rtol: float | None = None
    ) -> None:
        # inner: the march without delays, at the start or at a state; rtol: None on given steps
        self._inner, self._delays, self._t_end = inner, delays, t_end
        self.system, self.on_given_steps = inner.system, inner.on_given_steps
        self._tables: Delays = inner.system.functions.delays
        self._origin = self.system.frame.start
        self._breaks = self._kinks = self._marks = np.zeros(0)
        self._solved: list[Solved] = []
        self._error: Exception | None = None
        self._until = inner.t  # time up to which the tables hold
        self._gain = _gain(self.system, delays)
        self._smooth = max(
            _MIN_SMOOTH_EXPONENT, -_SMOOTH_EXPONENT_PER_DIGIT * np.log10(rtol or 1.0)
        )
        tol = _ON_STEPS if rtol is None else max(_OF_RTOL * rtol, _MIN_PAST_TOL)
        self._bends = [self._corners_of(delay, tol) for delay in delays]
        self._pasts = [self._past_of(delay, tol) for delay in delays]
        self._roots = self._first_roots()
        self._reach()

    def _fit_tolerance(self, tol: float, low: float, high: float) -> FitTolerance:
        """Return the accuracy with which a function of the user is met between two times."""
        orders = self.system.highest_orders()[: self.system.n_solved]
        largest = max(abs(self._origin + low), abs(self._origin + high), high - low)
        return FitTolerance(tol, min(float(orders.min()), 1.0), 64 * np.spacing(largest))

    def _corners_of(self, delay: Delayed, tol: float) -> list[tuple[float, float]]:
        """Return kinks of tau(t), and their exponents; refuse a tau that grows faster than t."""
        start, end, origin = self._inner.t, self._t_end, self._origin
        if not callable(delay.past.delay.tau):
            return []
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
        return found.kinks

    def _past_of(self, delay: Delayed, tol: float) -> Piecewise | None:
        """Return the past that a delay still reads as polynomials, or None for a constant."""
        first = float(delay.ago(np.array([self._inner.t]))[0])
        if not callable(delay.past.delay.past) or first >= 0:
            return None
        some = np.linspace(first, 0.0, _AGAIN, endpoint=False)
        if not np.array_equal(delay.before(some), delay.before(some)):
            remedy = "interpolate values that are drawn once, by numpy.interp"
            refuse("past", "return equal values at equal times", "others in a second call", remedy)
        found = piecewise(
            delay.before, first, 0.0, _MIN_PAST_SAMPLES, self._fit_tolerance(tol, first, 0.0)
        )
        if found.missed:
            warn(
                f"the past of a delay varies too fast: at t = {found.where + self._origin:g} it is "
                f"missed by {found.missed:.1g} of its size; give a smoother past",
                SolveWarning,
            )
        return found

    def _first_roots(self) -> list[tuple[float, float]]:
        """Return kinks of f by the start, by pasts and by delays that vary, and their exponents."""
        d, found = self.system.n_solved, self._bends_ahead()
        for delay, past in (
            () if self.on_given_steps else zip(self._delays, self._pasts, strict=True)
        ):
            at = np.zeros(1)
            end = past(at, at)[0] if past else delay.before(at - np.spacing(1.0))[0]
            met = np.allclose(end, self.system.at_start[:d], rtol=1e-12, atol=0.0)
            kinks = [*(past.kinks if past else []), (0.0, self._gain if met else 0.0)]
            found += [(_when(delay, t, 0.0, self._t_end), exponent) for t, exponent in kinks]
        return found

    def _bends_ahead(self) -> list[tuple[float, float]]:
        """Return jumps and corners of delays that vary, and their exponents."""
        return [pair for bends in self._bends for pair in bends]

    def _at(self, number: int, times: np.ndarray, inside: np.ndarray) -> np.ndarray:
        """Return y (n, d) at times (n,): the past, or dense output at the times `inside`."""
        d, delay, past = self.system.n_solved, self._delays[number], self._pasts[number]
        found, before = np.empty((times.size, d)), inside < 0
        if before.any():
            at = times[before]
            found[before] = past(at, inside[before]) if past else delay.before(at)
            found[before] += delay.displacement
        starts = np.array([each.start for each in self._solved])
        where = np.maximum(np.searchsorted(starts, inside, side="right") - 1, 0)
        for k in np.unique(where[~before]):
            chosen = ~before & (where == k)
            if not self._solved:
                found[chosen] = self.system.y0[0, :d]
            else:
                found[chosen] = self._solved[k].piece.evaluate(times[chosen], 0)
        return found

    def delayed(self, t: float) -> np.ndarray:
        """Return what the right-hand side reads at a time of the tables: k delays, (k, d)."""
        found = []
        for number, n in enumerate(self._tables.n_pieces.tolist()):
            times = self._tables.times[number, : n + 1]
            i = min(max(int(np.searchsorted(times, t)) - 1, 0), n - 1)
            x = (2.0 * t - times[i] - times[i + 1]) / (times[i + 1] - times[i])
            found.append(chebval(x, self._tables.values[number, i].T))
        return np.array(found)

    def _prepare(self) -> None:
        """Fill the tables from the present time to the last one whose delayed values are known."""
        t = self._inner.t
        until = self._mark(min(_when(delay, t, t, self._t_end) for delay in self._delays))
        if not until > t:
            refuse("tau", "exceed the rounding of t", f"{until - t:g} at t = {t + self._origin:g}")
        tables, room = [], self._tables.values.shape[1]
        for number in range(len(self._delays)):
            times, values = self._table(number, t, until)
            if len(values) > room:
                times, values = times[: room + 1], values[:room]
                until = min(until, float(times[-1]))
            tables.append((times, values))
        for number, table in enumerate(tables):
            self._tables.fill(number, *table)
        self._until = until
        if not self.on_given_steps:
            self._inner.note_reads(self._change_by_delays(0.5 * (t + until)))

    def _change_by_delays(self, t: float) -> np.ndarray:
        """Return how much f changes by delayed values at time t, (d,), as units of its rounding."""
        # by factors that differ for each component, so that terms that cancel count
        system, values = self.system, self._tables.values
        before, f = values.copy(), system.rhs(t, self._inner.y)
        factors = 1.0 + _FACTOR / np.sqrt(2.0 + np.arange(values.shape[2]))
        values *= factors[:, None]
        changed = system.rhs(t, self._inner.y)
        values[:] = before
        return np.abs(changed - f) / _FACTOR

    def _reach(self) -> Any:
        """Return the last position that the tables cover; fill them if the march has got there."""
        position = self._last_position()
        here = self._inner.position
        if position <= here or (not self.on_given_steps and together(position, here, self._origin)):
            self._forget()
            self._prepare()
            position = self._last_position()
        if position <= self._inner.position < self._inner.stop_at(self._t_end).position:
            t, required = self._inner.t, "be at least a step h on given steps"
            refuse("tau", required, f"{self._until - t:g} at t = {t:g}", "take more steps")
        return position

    def _last_position(self) -> Any:
        """Return the last position whose time the tables cover."""
        t = min(self._until, self._t_end)
        if not self.on_given_steps:
            return self._mark(t)
        found = self._inner.stop_at(t)
        return found.position - int(found.t > t * (1 + _ALIKE))

    def _mark(self, t: float) -> float:
        """Return the break, the kink or the end of the run that is one time with t, or t itself."""
        same = self._marks[together(self._marks, t, self._origin)]
        return float(same[0]) if same.size else t

    def _edges(self, number: int, start: float, end: float, known: np.ndarray) -> np.ndarray:
        """Return times between which y(t - tau) is smooth; `known` are ends of polynomials of y."""
        delay, bends = self._delays[number], self._bends[number]
        first, last = delay.ago(np.array([start, end])).tolist()
        inside = known[(first < known) & (known < last)]
        if not callable(delay.past.delay.tau):
            times = inside + delay.past.delay.tau
        else:
            times = np.array([_when(delay, edge, start, end) for edge in inside.tolist()])
        if self.on_given_steps:
            return np.unique([start, *times, end])
        times = np.append(times, [kink for kink, _ in bends])
        apart = ONE_TIME * max(end, abs(self._origin))
        times = times[(start + apart < times) & (times < end - apart)]
        for mark in self._marks[(start < self._marks) & (self._marks < end)].tolist():
            times[np.abs(times - mark) <= apart] = mark
        return np.array([start, *np.unique(times), end])

    def _table(self, number: int, start: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Return times (n + 1,), and Chebyshev coefficients of y(t - tau) between them."""
        # coefficients (n, d, N_COEFFICIENTS)
        delay, past = self._delays[number], self._pasts[number]
        edges = {0.0, *(edge for each in self._solved for edge in each.piece.edges().tolist())}
        known = np.array(sorted(edges.union(past.edges.tolist() if past else ())))
        times = self._edges(number, start, end, known)
        low, high, ends = times[:-1], times[1:], np.concatenate([[-np.inf], known, [np.inf]])
        inside = delay.ago(0.5 * (low + high))  # a time in the polynomial that is read
        found: list[tuple[np.ndarray, np.ndarray]] = []
        sizes, rest = np.ones(1), None if self.on_given_steps else self._inner.y
        last = np.full(low.size, np.inf)  # the difference before an interval was halved
        while True:
            middle, half = 0.5 * (low + high)[:, None], 0.5 * (high - low)[:, None]
            points = np.concatenate([NODES, _COMPARISON_POINTS])
            read = np.repeat(inside, points.size)
            ago, which = delay.ago((middle + half * points).ravel()), np.searchsorted(ends, read)
            ago = np.minimum(np.maximum(ago, ends[which - 1]), ends[which])
            values = self._at(number, ago, read)
            values = values.reshape(low.size, points.size, -1)
            polynomials = to_polynomials(values[:, : NODES.size], rest)
            seen = np.moveaxis(values[:, NODES.size :], 1, 2)
            missed = np.abs(polynomials @ _AT_COMPARISON_POINTS.T - seen).max(axis=2)
            if np.isinf(last[0]):
                sizes = np.maximum(np.abs(values).max(axis=(0, 1)), LEAST_SIZE)
            missed = (missed / sizes).max(axis=1)
            rough = (missed > _TABLE_ROUNDING) & (missed < _FALLS * last)
            rough &= high - low > 64 * np.spacing(high)
            found += zip(low[~rough], polynomials[~rough], strict=True)
            if not rough.any():
                break
            low, high, middle = low[rough], high[rough], middle[rough, 0]
            low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
            inside, last = np.tile(inside[rough], 2), np.tile(missed[rough], 2)
        found.sort(key=lambda pair: pair[0])
        return np.array([*(pair[0] for pair in found), end]), np.array([p for _, p in found])

    def set_breaks(self, times: np.ndarray, t_end: float) -> None:
        """Let steps see jumps at these times, and the kinks that follow them by delays."""
        self._breaks, self._t_end = times, t_end
        self._roots += [(t, 0.0) for t in times.tolist()]
        self._kinks = self._later([*self._roots, *self._bends_ahead()])
        self._set_marks(np.append(times, t_end))

    def _later(self, roots: Iterable[tuple[float, float]]) -> np.ndarray:
        """Return times of given kinks, and of those that follow by delays; none on given steps."""
        if self.on_given_steps:
            return np.zeros(0)
        gain, smooth, t_end = self._gain, self._smooth, self._t_end
        return np.array(_kinks(self._delays, roots, gain, smooth, t_end, self._origin))

    def _set_marks(self, first: np.ndarray) -> None:
        """Let steps end at breaks and kinks; equal times become one, of `first` if possible."""
        if self.on_given_steps:
            self._inner.set_breaks(self._breaks, self._t_end)
            return
        times = np.concatenate([first, self._breaks, self._kinks])
        rank = np.arange(times.size)  # of equal times the one of the lowest rank remains
        order = np.lexsort((rank, times))
        times, rank = times[order], rank[order]
        group = np.cumsum(np.append(False, ~together(times[1:], times[:-1], self._origin)))
        order = np.lexsort((rank, group))
        _, leading = np.unique(group[order], return_index=True)
        self._marks = times[order][leading]
        self._inner.set_breaks(self._marks, self._t_end)

    def stop_at(self, t: float) -> Any:
        """Return the position of a march that stops at time t, or at the first step not before."""
        return self._inner.stop_at(t)

    def advance(self, stop: float, keep: bool = True) -> Piece | None:
        """March towards position `stop`, at most to the last known delayed value."""
        start = self._inner.t
        if not self.on_given_steps and self._mark(stop) != stop:
            self._set_marks(np.array([stop, self._t_end]))
        try:
            last = self._reach()
        except Exception as error:  # of a past, or of a delay that varies
            self._error = error
            return None
        n_found = 0 if self.on_given_steps else len(self._inner.found)
        piece = self._inner.advance(min(stop, last))
        if piece is not None:
            self._solved.append(Solved(start, self._inner.t, piece))
        found = [] if self.on_given_steps else self._inner.found[n_found:]
        if found:
            self._breaks = np.union1d(self._breaks, found)
            self._roots += [(t, 0.0) for t in found]
            self._kinks = np.union1d(self._kinks, self._later([(t, 0.0) for t in found]))
            self._set_marks(np.append(self._breaks, self._t_end))
        return piece if keep else None

    def _earliest(self) -> float:
        """Return the earliest time that a delay reads at the present time."""
        t = np.array([self._inner.t])
        return min(float(delay.ago(t)[0]) for delay in self._delays)

    def _forget(self) -> None:
        """Drop dense output that ends before the earliest time that a delay reads."""
        first = self._earliest()
        self._solved = [each for each in self._solved if each.end >= first]

    position = property(lambda self: self._inner.position)
    t = property(lambda self: self._inner.t)
    y = property(lambda self: self._inner.y)
    ydot = property(lambda self: self._inner.ydot)
    diagnostics = property(lambda self: self._inner.diagnostics)
    uncertainty = property(lambda self: self._inner.uncertainty)
    sizes_and_noise = property(lambda self: self._inner.sizes_and_noise)

    @property
    def failure(self) -> Ending | None:
        """Why the march cannot go on, else None."""
        return self._inner.failure if self._error is None else failed(self._error)

    def stats(self) -> dict[str, Any]:
        """Return the counts of the inner stepper."""
        return self._inner.stats()

    def linear_arrays(self) -> list[np.ndarray]:
        """Return every array that is linear in the solution, with rows that delays read."""
        # The caller may overwrite them, and the next step fills the tables anew. From then on
        # delays read parabolas also inside the first two steps of a run.
        self._until = self._inner.t
        parts = [*self._inner.linear_arrays(), *(delay.displacement for delay in self._delays)]
        if not self._solved:
            return parts
        pieces: list[Any] = [each.piece for each in self._solved]
        times, rows, slopes = (
            np.concatenate([getattr(pieces[0], name)[:1], *(getattr(p, name)[1:] for p in pieces)])
            for name in ("times", "rows", "slopes")
        )
        start = max(int(np.searchsorted(times, self._earliest(), side="right")) - 1, 0)
        piece = StepPieces(times[start:], rows[start:], slopes[start:])
        self._solved = [Solved(float(times[start]), self._until, piece)]
        return [*parts, piece.rows, piece.slopes]

    def checkpoint(self) -> tuple:
        """Return copies of everything that a step changes."""
        return self._inner.checkpoint(), self._remembered()

    def _remembered(self) -> Remembered:
        """Return copies of the tables and of the dense output that delays read."""
        tables = tuple(map(self._tables.content, range(len(self._delays))))
        displacements = tuple(delay.displacement.copy() for delay in self._delays)
        return Remembered(
            tuple(self._solved), tuple(self._roots), self._until, tables, displacements
        )

    def remember(self, remembered: Remembered) -> None:
        """Restore tables and dense output; the inner stepper has already been restored."""
        self._solved, self._roots = list(remembered.solved), list(remembered.roots)
        self._until = remembered.until
        for number, table in enumerate(remembered.tables):
            self._tables.fill(number, *table)
            self._delays[number].displacement[:] = remembered.displacements[number]

    def come_back(self, checkpoint: tuple) -> None:
        """Return to the time at which `checkpoint` was taken."""
        self._inner.come_back(checkpoint[0])
        self.remember(checkpoint[1])

    def state(self) -> State:
        """Return a state from which another run continues."""
        self._forget()
        inner = self._inner.state()
        state = replace(inner, checkpoint=(inner.checkpoint, self._remembered()))
        return replace(state, layout=layout_of(state))

    def restore(self, state: State, allow_change: bool = False) -> None:
        """Continue from `state`; `allow_change` admits another right-hand side or parameters."""
        self._inner.restore(replace(state, checkpoint=state.checkpoint[0]), allow_change)
        self.remember(state.checkpoint[1])

    def expect_jumps(self, of_y: bool) -> None:
        """Prepare the inner stepper for jumps of f, and of y if `of_y`."""
        self._inner.expect_jumps(of_y)

    def limit_rows(self, most: int) -> None:
        """Let the inner stepper make at most so many steps at once."""
        self._inner.limit_rows(most)

    def set_y(self, y: np.ndarray) -> None:
        """Let y jump to these values, (d,)."""
        self._inner.set_y(y)
        self._jumped()

    def set_side(self, number: int, sign: float) -> None:
        """Evaluate the right-hand side on another side of a switch."""
        self._inner.set_side(number, sign)
        self._jumped()

    def _jumped(self) -> None:
        """Record that the solution has a jump at the present time."""
        if self.on_given_steps:
            return
        t = self._inner.t
        roots = [(_when(delay, t, t, self._t_end), 0.0) for delay in self._delays]
        self._roots += roots
        ahead = self._kinks[self._kinks > t]
        self._kinks = np.concatenate([ahead, self._later(roots)])
        self._set_marks(np.append(self._breaks, self._t_end))


def _gain(system: System, delays: tuple[Delayed, ...]) -> float:
    """Return by how much the exponent of a kink is larger one delay later."""
    # the lowest order; 0 if an algebraic row reads a delayed algebraic one, as smooth as the kink
    d = system.n_solved
    orders = system.highest_orders()[:d]
    gain, rows = (
        float(np.min(orders[orders > 0], initial=np.inf)),
        np.flatnonzero(system.algebraic),
    )
    if not rows.size:
        return gain
    asked = replace(system, functions=system.functions.for_a_march(1))
    tables = asked.functions.delays

    def forces(share: float, moved: int, delay: Delayed) -> np.ndarray:
        y = asked.at_start + share * (1.0 + np.abs(asked.at_start))
        for each in delays:
            constant = np.zeros((1, d, N_COEFFICIENTS))
            constant[0, :, 0] = y[:d]
            if each is delay:
                constant[0, moved : moved + 1, 0] += 0.1 * (1.0 + np.abs(y[moved : moved + 1]))
            tables.fill(each.number, np.array([0.0, 1.0]), constant)
        return asked.rhs(0.5, y)[rows]

    try:
        for share in _ASKED:
            for delay in delays:
                rest = forces(share, d, delay)
                if any((forces(share, c, delay) != rest).any() for c in rows.tolist()):
                    return 0.0
    except Exception:  # the march meets it again
        return 0.0
    return gain


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
) -> list[float]:  # fmt: skip
    """Return times of kinks of f before `t_end`: of the roots, and of those that read a kink."""
    # Roots are pairs of a time and of the exponent of the first power of t there, 0 for a jump. One
    # delay later the exponent is larger by `gain`. From the exponent `smooth` on they are no kinks.
    ahead = [(t, exponent) for t, exponent in roots if t < t_end]
    heapq.heapify(ahead)
    times: list[float] = []
    lowest = np.inf  # exponent at the last of the times
    while ahead and len(times) < _MOST_KINKS:
        t, exponent = heapq.heappop(ahead)
        if times and together(t, times[-1], origin):
            if exponent >= lowest:
                continue
        else:
            times.append(t)
        lowest = exponent
        if exponent + gain < smooth:
            for delay in delays:
                later = _when(delay, t, t, t_end)
                if later < t_end:
                    heapq.heappush(ahead, (later, exponent + gain))
    return times
