"""The output of a run: its rows, its dense output and its events.

A row is a time with y and y' at this time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..given.first_steps import FirstSteps
from ..stepping.dense import Dense, Piece, StepPieces
from ..stepping.stepper import Stepper
from ..stepping.times import ONE_TIME
from ..support.checks import complaint
from ..support.machine import machine_storage
from .events import Events

# Number of rows that are allocated at first if the number of steps is unknown.
_SOME = 512
# Relative distance up to which a time of `t_eval` counts as the end of a step: both are rounded.
_STEP_END_RTOL = 8 * np.finfo(float).eps


class Kept(NamedTuple):
    """Which rows and components a run keeps; there is no dense output of chosen components."""

    every: int  # rows of every n-th step
    times: np.ndarray | None = None  # or rows at times (k,)
    components: np.ndarray | None = None  # their numbers; None for all


class Output:
    """Collector of the rows, the dense output and the events of a run, piece by piece."""

    def __init__(self, stepper: Stepper, stop: float, kept: Kept, events: Events) -> None:
        # stop: position of the end; end: time reached; ended: whether an event ended the run
        self._stepper, self._stop, self._on_given_steps = stepper, stop, stepper.on_given_steps
        self._every, times, self.components = kept
        self._frame, self._asked, self.events = stepper.system.frame, times, events
        self._wanted = np.empty(0) if times is None else times - self._frame.start
        # number of steps: of all runs with given steps, of this run with adaptive ones
        self._n = self._first = int(stepper.position) if self._on_given_steps else 0
        self._starting: FirstSteps | None = None
        # whether rows have y': always with given steps, whose dense output needs it
        speeds = bool(self._frame.speeds)
        self._sloped = self._on_given_steps or stepper.system.m == 2 or speeds
        self.end, self.ended = stepper.t, False
        self.jumps: list[float] = []  # times at which y jumped
        self._newest: Piece | None = None
        y, ydot, n, every = stepper.y, stepper.ydot, self._first, self._every
        self._dense = Dense(y.size, self._frame)
        most = _SOME if times is None else self._wanted.size
        if times is None and self._on_given_steps:
            most = int(stop) // every - n // every + (stop % every > 0) + 2
        width = y.size if self.components is None else self.components.size
        self._rows: Any = room_for(most, width, times is None)
        self._size = 0
        if times is None:
            self._add(np.array([stepper.t]), y[None], ydot[None])
        elif self._wanted[0] <= stepper.t:
            self._add(self._wanted[:1], y[None], ydot[None])
            self._wanted = self._wanted[1:]

    def _add(self, t: np.ndarray, y: np.ndarray, ydot: np.ndarray) -> None:
        """Append k rows: times (k,), y (k, d) and y' (k, d)."""
        end = self._size + t.size
        if end > self._rows[0].size:
            self._rows = tuple(
                np.concatenate([part, np.empty((end, *part.shape[1:]))]) for part in self._rows
            )
        if self.components is not None:
            y, ydot = y[:, self.components], ydot[:, self.components]
        for part, values in zip(self._rows, (t, y, ydot), strict=True):
            part[self._size : end] = values
        self._size = end

    def take(self, piece: Piece, start: float) -> None:
        """Add the solution on the steps since time `start`, up to an event that ends the run."""
        edges = np.concatenate((piece.edges(), (self._stepper.t,)))
        end = None
        if self.events.any:
            end = self.events.look(edges, lambda t: piece.evaluate(t, 0))
        self.end, self.ended = edges[-1] if end is None else end, end is not None
        self._newest = piece
        self._starting = piece.starting or self._starting
        if self._asked is not None:
            self._take_wanted(piece)
            return
        if not self._on_given_steps and self.components is None:
            self._dense.add(piece, start)
        chosen = self._chosen(edges)
        self._add(edges[1:][chosen], *piece.at_ends(edges[1:], chosen, self._sloped))
        if self.events.interrupted and self._rows[0][self._size - 1] < self.end:
            self._add_last()

    def go_on(self, changed: bool | np.bool_) -> None:
        """Continue after an event at the stepper's time; `changed` is True if it changed y."""
        t, y = self._stepper.t, self._stepper.y
        self.ended = False
        if changed:
            self.jumps.append(t)
        if self._asked is not None:  # rows at the time of the event follow it
            at_once = int(np.searchsorted(self._wanted, t + self._near(t), side="right"))
            times, self._wanted = self._wanted[:at_once], self._wanted[at_once:]
            rows = np.ones((times.size, 1))
            self._add(times, rows * y, rows * self._stepper.ydot)
        if not changed or self._asked is not None:
            return
        self._add(np.array([t]), y[None], self._stepper.ydot[None])

    def _near(self, t: float) -> float:
        """Return the distance from an event at t up to which a row has its time."""
        return ONE_TIME * max(abs(t), abs(self._frame.start))

    def _chosen(self, edges: np.ndarray) -> slice | np.ndarray:
        """Return which steps between `edges` are kept: a slice, or an array of truth values."""
        first = self._n + 1
        reached = edges[1:] <= self.end
        self._n += int(np.count_nonzero(reached)) if self.ended else reached.size
        if self._on_given_steps and not self.ended:
            return slice(-first % self._every, None, self._every)
        # next to a singular start steps may be so short that both ends have the same rounded time
        chosen = reached & (edges[1:] > edges[:-1])
        if self._every == 1:
            return slice(None) if chosen.all() else chosen
        return chosen & (np.arange(first, first + chosen.size) % self._every == 0)

    def _take_wanted(self, piece: Piece) -> None:
        """Add the rows at those times of the user that the steps have reached."""
        last = self.end if self.ended else self.end * (1 + _STEP_END_RTOL)
        at_end = self._stepper.position == self._stop and not self.ended
        if self.events.interrupted:  # rows at the event's time follow it
            last = self.end - self._near(self.end)
        elif at_end:
            last = np.inf  # the last step may miss the end of the run by rounding
        ahead = int(np.searchsorted(self._wanted, last, side="right"))
        times, self._wanted = self._wanted[:ahead], self._wanted[ahead:]
        if times.size:
            self._add(times, *piece.evaluate_both(times, self._sloped))

    def close(self, t_end: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, Dense | None]:
        """Return the user's times (n,), y and y' (n, d) of the run, and dense output or None."""
        stepper, start = self._stepper, self._frame.start
        if self._asked is not None:
            _, y, ydot = (part[: self._size] for part in self._rows)
            return self._asked[: self._size], y, ydot, None
        if self._rows[0][self._size - 1] < self.end:
            self._add_last()
        t, y, ydot = [part[: self._size] for part in self._rows]
        at_end = stepper.position == self._stop and not self.ended
        if at_end:
            t[-1] = t_end - start  # n h may miss it by rounding
        dense = self._dense if self.components is None else None
        if dense and self._on_given_steps:
            dense = dense if self._every == 1 and t.size > 1 else None
            if dense:
                dense.add(StepPieces(t, y, ydot, self._starting, int(self._first)), t[0])
        if start != 0:
            t = t + start
            t[-1] = t_end if at_end else t[-1]
        return t, y, ydot, dense

    def _add_last(self) -> None:
        """Add the row at the end of the run."""
        last, piece = np.array([self.end]), self._newest
        if piece is not None and (self.ended or not self._on_given_steps):
            self._add(last, *piece.evaluate_both(last, self._sloped))
        else:
            self._add(last, self._stepper.y[None], self._stepper.ydot[None])


def room_for(size: Any, d: int, every: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return empty arrays (size,), (size, d), (size, d); a refusal names save_every or t_eval."""
    n_bytes = 8.0 * size * (1 + 2 * d)
    try:
        if n_bytes > machine_storage():
            raise MemoryError
        return np.empty(size), np.empty((size, d)), np.empty((size, d))
    except MemoryError as error:
        required = "keep as many rows as fit in memory"
        got = f"{size:.3g} rows of {d} components, {n_bytes:.1e} bytes"
        argument = "save_every" if every else "t_eval"
        raise ValueError(complaint(argument, required, got, "keep fewer")) from error
