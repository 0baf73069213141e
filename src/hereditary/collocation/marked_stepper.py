"""Adaptive stepper that stops at evenly spaced marks, for analyses over given steps."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ..solver.dense import Dense
from ..solver.state import AdaptiveState
from .stepper import AdaptiveStepper

# No limit of steps, in practice.
_ANY = 10**9
# Steps of one call of the compiled march.
_ROWS = 256


@dataclass(frozen=True, eq=False)
class MarkedState:
    """State of the adaptive stepper at a mark.

    Attributes
    ----------
    t : float
    n : int
        Number of marks passed.
    h : float
        Distance of the marks [time].
    """

    adaptive: ClassVar[bool] = True
    t: float
    n: int
    h: float
    memory_steps: int = field(repr=False)
    inner: AdaptiveState = field(repr=False)


class MarkedStepper:
    """March by adaptive collocation that stops at marks, times n h.

    Parameters
    ----------
    equation : System
    scheme : Collocation
    tols : tuple of float
        Relative and absolute tolerance.
    h : float
        Distance of the marks [time]; the tolerance chooses the steps between them.
    n_marks : int
        Number of marks of the whole run.
    modes_tol : float, optional
        As for `AdaptiveStepper`.
    directions : ndarray, shape (n_data, k), optional
        As for `AdaptiveStepper`.
    """

    adaptive = True
    zigzag, growth, largest_ratio = None, None, 0.0

    def __init__(self, equation, scheme, tols, h, n_marks, modes_tol=None, directions=None):
        rtol, atol = tols
        t_end = h * n_marks
        self._inner = AdaptiveStepper(
            equation, scheme, t_end, rtol, atol, modes_tol, directions, max_steps=_ANY
        )
        self.equation, self.h, self.n, self._n_marks = equation, h, 0, n_marks

    def __getattr__(self, name):
        # everything but marks belongs to the adaptive stepper
        if name in _OWN:
            return getattr(self._inner, name)
        raise AttributeError(name)

    def prepare(self, n_end):
        """Do nothing, for nothing needs preparation."""

    def seconds_of_rhs(self):
        """Return a first guess of the time between two marks, in seconds."""
        return 1e-4

    def advance(self, n_more, positions, rows, slopes):
        """March over `n_more` marks; fill rows (k, d) with y at ascending `positions`, in marks."""
        inner, stop = self._inner, (self.n + n_more) * self.h
        dense = Dense(inner.second)
        while inner.t < stop:
            start = inner.t
            piece = inner.advance(stop, _ROWS)
            if piece is not None and positions.size:
                dense.add(piece, start)
            if inner.error is not None:
                raise inner.error
            if inner.blown_up or inner.not_solved or inner.no_step:
                return
        if positions.size:
            rows[:] = dense(np.minimum(positions * self.h, stop), 0, stop)
        self.n += n_more

    def state(self):
        """Return a `MarkedState` from which a later run continues."""
        return MarkedState(self.t, self.n, self.h, self._n_marks, self._inner.state())

    def restore(self, state):
        """Continue from `state`."""
        self._inner.restore(state.inner, self.h * self._n_marks)
        self.n = state.n


_OWN = frozenset(
    {"t", "y", "ydot", "tangent", "transform_tangent", "n_rhs", "n_modes", "blown_up", "not_solved"}
    | {"no_step"}
)
