"""The march of an equation with delays: another stepper, and tables of what it has solved.

By the method of steps a march goes on only as far as delayed values are known. Before it does, they
are written into the tables of the right-hand side (equation/delay.py).
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

# Where polynomials of a table are compared with the solution, and the difference that is allowed,
# as fraction of the largest value.
_LOOKS = np.array([-0.95, -0.4, 0.15, 0.8])
_ROUNDING = 1e-13
# A polynomial is halved while that makes the difference fall by this factor: next to a start the
# solution is no polynomial, and rounding does not fall.
_FALLS = 0.95
# Stands for 0 among sizes.
_TINY = 1e-300
# A kink of the solution is a break until so many powers of t are smooth behind it.
_SMOOTH = 8.0
# Most kinks: with several delays their sums are many.
_MOST_KINKS = 1000
# Times this close, relatively, are one.
_ALIKE = 1e-12


class _Solved(NamedTuple):
    """A piece of the solution, between two times."""

    start: float
    end: float
    piece: Piece


class _Remembered(NamedTuple):
    """The past of a march with delays, and its tables.

    - solved, roots: pieces that a delay reaches, and times behind which kinks follow.
    - until: time up to which the tables hold; tables: their times and polynomials, for each delay.
    - lifts: by how much the past of each delay is displaced.
    """

    solved: tuple[_Solved, ...]
    roots: tuple[float, ...]
    until: float
    tables: tuple[tuple[np.ndarray, np.ndarray], ...]
    lifts: tuple[np.ndarray, ...]


class DelayedStepper(ResumableStepper, JumpingStepper):
    """A stepper whose right-hand side reads the solution of earlier times.

    Parameters
    ----------
    inner : FixedStepper or AdaptiveStepper
        At the start of a run, or where `state` was taken.
    delays : tuple of Delayed
    t_end : float
        End of the run.
    """

    def __init__(self, inner: Any, delays: tuple[Delayed, ...], t_end: float) -> None:
        self._inner, self._delays, self._t_end = inner, delays, t_end
        self.system, self.counted = inner.system, inner.counted
        self._breaks = np.zeros(0)
        self._solved: list[_Solved] = []
        self._roots: list[float] = [0.0]
        self._error: Exception | None = None
        self._until = inner.t  # time up to which the tables hold
        self._reach()

    def _at(self, delay: Delayed, times: np.ndarray) -> np.ndarray:
        """Return y at earlier times (n,), shape (n, d); before the start as a delay says."""
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
        """Fill the tables from here to where delayed values are no longer known."""
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
        """Return the last position at which the tables hold; fill them where that is here."""
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
        """Return the last position up to which the tables are filled."""
        t = min(self._until, self._t_end)
        found = self._inner.stop_at(t)
        return found.position - int(self.counted and found.t > t * (1 + _ALIKE))

    def _table(self, delay: Delayed, start: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Return times (n + 1,) and polynomials (n, d, N_COEFFICIENTS) of the delayed solution."""
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
        """Let steps see jumps at these times, and what follows from them after each delay."""
        self._breaks, self._t_end = times, t_end
        self._set_kinks()

    def _set_kinks(self) -> None:
        """Let steps that a tolerance chooses begin anew where the solution is not smooth."""
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
        """March towards position `stop`, at most as far as delayed values are known."""
        start = self._inner.t
        try:
            last = self._reach()
        except Exception as error:  # of a past, or of a delay that varies
            self._error = error
            return None
        piece = self._inner.advance(min(stop, last))
        if piece is not None:
            self._solved.append(_Solved(start, self._inner.t, piece))
        return piece if keep else None

    def _forget(self) -> None:
        """Drop what no delay reaches any more."""
        t = np.array([self._inner.t])
        first = min(float(delay.ago(t)[0]) for delay in self._delays)
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
        """Return those of the inner stepper."""
        return self._inner.stats()

    def parts(self) -> list[np.ndarray]:
        """Return every array that is linear in the solution, also of delayed rows, on given steps.

        Their numbers may be replaced: the next step fills the tables anew. From then on the first
        two steps of a run are parabolas for delays too, as all others are.
        """
        self._until = self._inner.t
        parts = [*self._inner.parts(), *(delay.lift for delay in self._delays)]
        if not self._solved:
            return parts
        first = min(float(delay.ago(np.array([self._until]))[0]) for delay in self._delays)
        pieces: list[Any] = [each.piece for each in self._solved]
        times, rows, slopes = (
            np.concatenate([getattr(pieces[0], name)[:1], *(getattr(p, name)[1:] for p in pieces)])
            for name in ("times", "rows", "slopes")
        )
        start = max(int(np.searchsorted(times, first, side="right")) - 1, 0)
        piece = StepPieces(times[start:], rows[start:], slopes[start:])
        self._solved = [_Solved(float(times[start]), self._until, piece)]
        return [*parts, piece.rows, piece.slopes]

    def checkpoint(self) -> tuple:
        """Return copies of all that the march consists of."""
        return self._inner.checkpoint(), self._remembered()

    def _remembered(self) -> _Remembered:
        """Return what delays reach, and the tables."""
        tables = tuple(delay.content(self._inner.live_params) for delay in self._delays)
        lifts = tuple(delay.lift.copy() for delay in self._delays)
        return _Remembered(tuple(self._solved), tuple(self._roots), self._until, tables, lifts)

    def remember(self, remembered: _Remembered) -> None:
        """Take over what delays reach; the inner stepper is already there."""
        self._solved, self._roots = list(remembered.solved), list(remembered.roots)
        self._until = remembered.until
        for delay, table, lift in zip(
            self._delays, remembered.tables, remembered.lifts, strict=True
        ):
            delay.fill(self._inner.live_params, *table)
            delay.lift[:] = lift

    def come_back(self, checkpoint: tuple) -> None:
        """Come back to where `checkpoint` was taken."""
        self._inner.come_back(checkpoint[0])
        self.remember(checkpoint[1])

    def state(self) -> State:
        """Return a state from which another run goes on."""
        self._forget()
        inner = self._inner.state()
        state = replace(inner, checkpoint=(inner.checkpoint, self._remembered()))
        return replace(state, layout=layout_of(state))

    def restore(self, state: State, allow_change: bool = False) -> None:
        """Go on from `state`; `allow_change` admits another right-hand side or parameters."""
        self._inner.restore(replace(state, checkpoint=state.checkpoint[0]), allow_change)
        self.remember(state.checkpoint[1])

    def expect_jumps(self, of_y: bool) -> None:
        """Prepare for jumps of f, and of y if `of_y`."""
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
        """Note that the solution has a kink here."""
        self._roots.append(self._inner.t)
        self._set_kinks()


def _when(delay: Delayed, t: float, low: float, high: float) -> float:
    """Return the time at which a delay reads time t, between two times, or the later of these."""

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
    """Return times at which the solution is not smooth, for it was not a delay before.

    Each delay raises the exponent of what is not smooth by the order.
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
