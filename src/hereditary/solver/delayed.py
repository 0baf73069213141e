"""The march of an equation with delays, by the method of steps.

The stepper of an equation without delays marches as far as delayed values are known. Then these
values are written into the tables that the right-hand side reads (equation/delay.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from ..equation.delay import N_COEFFICIENTS, NODES, TO_COEFFICIENTS, Delayed
from ..equation.system import System
from ..stepping.dense import Piece, StepPieces
from ..stepping.state import State, layout_of
from ..stepping.status import Ending, failed
from ..stepping.stepper import JumpingStepper, ResumableStepper
from ..support.checks import refuse
from .events import bracketed_root

# Points in [-1, 1], the interval of a polynomial, at which it is compared with the solution.
_LOOKS = np.array([-0.95, -0.4, 0.15, 0.8])
# Largest difference there, as a fraction of the largest value of the component.
_ROUNDING = 1e-13
# An interval is halved again if the last halving multiplied the difference by less than this. Next
# to a start the solution is no polynomial, and halving does not help against rounding.
_FALLS = 0.95
# Least size of a component, so that one that is 0 everywhere can be divided by its size.
_TINY = 1e-300
# Exponent of t from which on a kink is no break: so many derivatives are continuous there.
_SMOOTH = 8.0
# Most kinks of a run: several delays have many sums.
_MOST_KINKS = 1000
# Times whose relative difference is below this count as equal.
_ALIKE = 1e-12


class Solved(NamedTuple):
    """Dense output between two times."""

    start: float
    end: float
    piece: Piece


class Remembered(NamedTuple):
    """Data that a march with delays stores beside its inner stepper.

    - solved: dense output that a delay still reads.
    - roots: times after which kinks follow, one delay later and so on.
    - until: time up to which the tables have delayed values.
    - tables: for each delay the times and polynomials of its table.
    - lifts: for each delay the displacement of y before the start, (d,).
    """

    solved: tuple[Solved, ...]
    roots: tuple[float, ...]
    until: float
    tables: tuple[tuple[np.ndarray, np.ndarray], ...]
    lifts: tuple[np.ndarray, ...]


class DelayedStepper(ResumableStepper, JumpingStepper):
    """A stepper whose right-hand side reads the solution of earlier times.

    Parameters
    ----------
    inner : FixedStepper or AdaptiveStepper
        The march without delays, at the start of a run or where a state was taken.
    delays : tuple of Delayed
    t_end : float
        End of the run.
    """

    def __init__(self, inner: Any, delays: tuple[Delayed, ...], t_end: float) -> None:
        self._inner, self._delays, self._t_end = inner, delays, t_end
        self.system, self.counted = inner.system, inner.counted
        self._breaks = np.zeros(0)
        self._solved: list[Solved] = []
        self._roots: list[float] = [0.0]
        self._error: Exception | None = None
        self._until = inner.t  # time up to which the tables hold
        self._reach()

    def _at(self, delay: Delayed, times: np.ndarray) -> np.ndarray:
        """Return y at earlier times (n,), shape (n, d); before the start from the delay's past."""
        d = self.system.n_solved
        found, before = np.empty((times.size, d)), times < 0
        if before.any():
            found[before] = delay.before(times[before])
        starts = np.array([each.start for each in self._solved])
        where = np.maximum(np.searchsorted(starts, times, side="right") - 1, 0)
        for k in np.unique(where[~before]):
            chosen = ~before & (where == k)
            if not self._solved:
                found[chosen] = self.system.y0[0, :d]
            else:
                piece = self._solved[k].piece
                found[chosen] = piece.evaluate(times[chosen], self.system.second, 0)
        return found

    def _prepare(self) -> None:
        """Fill the tables from the present time to the last one whose delayed values are known."""
        t = self._inner.t
        until = min(_when(delay, t, t, self._t_end) for delay in self._delays)
        tables = []
        for delay in self._delays:
            times, values = self._table(delay, t, until)
            if len(values) > delay.capacity:
                times, values = times[: delay.capacity + 1], values[: delay.capacity]
                until = min(until, float(times[-1]))
            tables.append((times, values))
        params = self._inner.live_params
        for delay, (times, values) in zip(self._delays, tables, strict=True):
            delay.fill(params, times, values)
        self._until = until

    def _reach(self) -> Any:
        """Return the last position that the tables cover; fill them if the march has got there."""
        position = self._last_position()
        if position <= self._inner.position:
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
        found = self._inner.stop_at(t)
        return found.position - int(self.counted and found.t > t * (1 + _ALIKE))

    def _table(self, delay: Delayed, start: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Return a table of y(t - tau) from `start` to `end`.

        These are times (n + 1,), and Chebyshev coefficients (n, d, N_COEFFICIENTS) between them.
        """
        known = [0.0, *(edge for each in self._solved for edge in each.piece.edges())]
        first, last = delay.ago(np.array([start, end])).tolist()
        if not first < last:
            origin = delay.past.origin
            got = f"t - tau(t) = {first + origin:g} and then {last + origin:g}"
            refuse("tau", "grow slower than t", got)
        inside = sorted({edge for edge in known if first < edge < last})
        edges = np.unique([start, *(_when(delay, edge, start, end) for edge in inside), end])
        low, high = edges[:-1], edges[1:]
        found: list[tuple[np.ndarray, np.ndarray]] = []
        sizes = np.ones(1)
        last = np.full(low.size, np.inf)  # the difference before an interval was halved
        while True:
            middle, half = 0.5 * (low + high)[:, None], 0.5 * (high - low)[:, None]
            points = np.concatenate([NODES, _LOOKS])
            values = self._at(delay, delay.ago((middle + half * points).ravel()))
            values = values.reshape(low.size, points.size, -1)
            at_nodes, seen = values[:, : NODES.size], values[:, NODES.size :]
            polynomials = np.einsum("ij,njd->nid", TO_COEFFICIENTS, at_nodes)
            missed = np.abs(chebvander(_LOOKS, N_COEFFICIENTS - 1) @ polynomials - seen)
            if np.isinf(last[0]):
                sizes = np.maximum(np.abs(values).max(axis=(0, 1)), _TINY)
            missed = (missed.max(axis=1) / sizes).max(axis=1)
            rough = (missed > _ROUNDING) & (missed < _FALLS * last)
            rough &= high - low > 64 * np.spacing(high)
            found += zip(low[~rough], np.moveaxis(polynomials[~rough], 2, 1), strict=True)
            if not rough.any():
                break
            low, high, middle = low[rough], high[rough], middle[rough, 0]
            low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
            last = np.tile(missed[rough], 2)
        found.sort(key=lambda pair: pair[0])
        return np.array([*(pair[0] for pair in found), end]), np.array([p for _, p in found])

    def set_breaks(self, times: np.ndarray, t_end: float) -> None:
        """Let steps see jumps at these times, and the kinks that follow them by delays."""
        self._breaks, self._t_end = times, t_end
        self._set_kinks()

    def _set_kinks(self) -> None:
        """Let steps chosen by a tolerance end at kinks; given steps see the user's breaks alone."""
        if self.counted:
            self._inner.set_breaks(self._breaks, self._t_end)
            return
        roots = [*self._roots, *self._breaks.tolist()]
        kinks = np.array(_kinks(self._delays, self.system, roots, self._t_end))
        self._inner.set_breaks(np.union1d(self._breaks, kinks), self._t_end)

    def stop_at(self, t: float) -> Any:
        """Return the position of a march that stops at time t, or at the first step not before."""
        return self._inner.stop_at(t)

    def advance(self, stop: float, keep: bool = True) -> Piece | None:
        """March towards position `stop`, at most to the last known delayed value."""
        start = self._inner.t
        try:
            last = self._reach()
        except Exception as error:  # of a past, or of a delay that varies
            self._error = error
            return None
        piece = self._inner.advance(min(stop, last))
        if piece is not None:
            self._solved.append(Solved(start, self._inner.t, piece))
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
    health = property(lambda self: self._inner.health)
    uncertainty = property(lambda self: self._inner.uncertainty)

    @property
    def trouble(self) -> Ending | None:
        """Why the march cannot go on, else None."""
        return self._inner.trouble if self._error is None else failed(self._error)

    def stats(self) -> dict[str, Any]:
        """Return the counts of the inner stepper."""
        return self._inner.stats()

    def parts(self) -> list[np.ndarray]:
        """Return every array that is linear in the solution, with rows that delays read.

        This is for given steps. The caller may overwrite these arrays, and the next step fills the
        tables anew. From then on delays read parabolas also inside the first two steps of a run.
        """
        self._until = self._inner.t
        parts = [*self._inner.parts(), *(delay.lift for delay in self._delays)]
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
        tables = tuple(delay.content(self._inner.live_params) for delay in self._delays)
        lifts = tuple(delay.lift.copy() for delay in self._delays)
        return Remembered(tuple(self._solved), tuple(self._roots), self._until, tables, lifts)

    def remember(self, remembered: Remembered) -> None:
        """Restore tables and dense output; the inner stepper has already been restored."""
        self._solved, self._roots = list(remembered.solved), list(remembered.roots)
        self._until = remembered.until
        for delay, table, lift in zip(
            self._delays, remembered.tables, remembered.lifts, strict=True
        ):
            delay.fill(self._inner.live_params, *table)
            delay.lift[:] = lift

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

    def set_y(self, y: np.ndarray) -> None:
        """Let y jump to these values, (d,)."""
        self._inner.set_y(y)
        self._jumped()

    def set_parameter(self, number: int, value: float) -> None:
        """Set a parameter of the right-hand side, which jumps."""
        self._inner.set_parameter(number, value)
        self._jumped()

    def _jumped(self) -> None:
        """Record that the solution has a kink at the present time."""
        self._roots.append(self._inner.t)
        self._set_kinks()


def _when(delay: Delayed, t: float, low: float, high: float) -> float:
    """Return the time s at which a delay reads time t, ``s - tau(s) = t``; at most `high`."""

    def ahead(s: float) -> float:
        return float(delay.ago(np.array([s]))[0]) - t

    if not callable(delay.past.delay.tau):
        return t + delay.past.delay.tau
    if ahead(high) <= 0:
        return high
    return bracketed_root(ahead, low, high)


def _kinks(
    delays: Sequence[Delayed], system: System, roots: Sequence[float], t_end: float
) -> list[float]:
    """Return the times of kinks: those that read a root, or an earlier kink, by a delay.

    The first power of t at a kink has the exponent of the kink before plus the order.
    """
    orders = system.highest_orders()[: system.n_solved]
    order = float(np.min(orders[orders > 0], initial=_SMOOTH))
    found: list[float] = []
    present, exponent = list(roots), order
    while present and exponent < _SMOOTH and len(found) < _MOST_KINKS:
        later = {_when(delay, s, s, t_end) for s in present for delay in delays}
        later = {s for s in later if s < t_end}
        present = []
        for s in sorted(later):
            if not present or s - present[-1] > _ALIKE * s:
                present.append(s)
        found += present
        exponent += order
    return found
