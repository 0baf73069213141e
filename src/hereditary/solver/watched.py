"""Steps that events are looked for in."""

import numpy as np

from .first_steps import starting_steps
from .step_pieces import StepPieces


class Watched:
    """Makes steps, looks for events in them, and keeps the rows up to the one that ends the run.

    Parameters
    ----------
    stepper : Stepper
    wanted : Rows
    events : Events

    Attributes
    ----------
    ended : bool
        Whether a terminal event, or one that failed, has ended the run.
    """

    def __init__(self, stepper, wanted, events):
        self._stepper, self._wanted, self._events = stepper, wanted, events
        self.ended = False

    def __call__(self, n_more):
        """Make `n_more` steps, or fewer where the run ends."""
        stepper, n = self._stepper, self._stepper.n
        d, before = stepper.equation.d, stepper.checkpoint()
        starting = starting_steps(stepper, stepper.t)
        rows, slopes = np.empty((2, n_more + 1, d))
        rows[0], slopes[0] = stepper.y, stepper.ydot
        positions = np.arange(n + 1.0, n + n_more + 1)
        try:
            stepper.advance(n_more, positions, rows[1:], slopes[1:])
        finally:
            made = stepper.n - n
            if made:
                times = stepper.steps.times(np.arange(n, n + made + 1.0))
                piece = StepPieces(times, rows[: made + 1], slopes[: made + 1], starting)
                self._look(piece, n, before)

    def _look(self, piece, n, before):
        """Look for events in a piece that begins at step n, and keep its rows."""
        stepper, wanted, above = self._stepper, self._wanted, None
        end = self._events.look(piece.times, lambda t: piece.evaluate(t, above, 0))
        last = piece.times[-1] if end is None else end
        positions, rows, slopes = wanted.positions(n, stepper.n)
        times = stepper.steps.times(positions)
        k = int(np.searchsorted(times, last, side="right"))
        if k:
            rows[:k], slopes[:k] = (piece.evaluate(times[:k], above, m) for m in (0, 1))
        wanted.keep(positions, k)
        if end is None:
            return
        self.ended = True
        at = np.array([end])
        wanted.end(end, *(piece.evaluate(at, above, m)[0] for m in (0, 1)))
        # a later run goes on from the first step that is not before the event
        n_end = n + int(np.searchsorted(piece.times, end))
        if n_end < stepper.n:
            stepper.rewind(before)
            nothing = np.empty((0, stepper.equation.d))
            stepper.advance(n_end - n, np.empty(0), nothing, nothing)
