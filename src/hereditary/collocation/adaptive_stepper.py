"""Adaptive stepper: the march of an equation by collocation, as a run drives it."""

import copy
from typing import NamedTuple

import numpy as np

from ..compiled.structures import plain
from ..equation.system import refuse_late
from ..schemes.steps import breaks_ahead
from ..solver.state import (
    AdaptiveState,
    check_identity,
    check_reach,
    complete,
    identity,
)
from ..solver.status import Status, failed
from ..solver.stepper import Stepper
from ..support.checks import complaint
from .adaptive_march import OF_SIZE, STEP_FRACTION, CollocationMarch
from .pace import MAX_STEPS, Pace
from .reading import Plain, Reading

# Steps of one call of the compiled march where an event may cut it short; points of each step,
# besides its end, that events look at.
_FEW_ROWS, _LOOKS = 8, 8


class Tolerance(NamedTuple):
    """Tolerances by which a run chooses its steps.

    Tolerances rtol, and atol or None for errors relative to the largest size of each component so
    far; modes, the relative error of modes, or None for what the tolerances require; longest, the
    longest step [time] or None; most, the largest number of steps.
    """

    rtol: float
    atol: float | None = None
    modes: float | None = None
    longest: float | None = None
    most: int = MAX_STEPS


class AdaptiveStepper(CollocationMarch, Stepper):
    """March of one equation by collocation, with steps chosen by the tolerance.

    Parameters
    ----------
    equation : System
    scheme : Collocation
    t_end : float
        End of the run; the modes hold up to ten times as far, or to the scheme's horizon.
    tolerance : Tolerance
    directions : ndarray, shape (n_data, k), optional
        Directions of initial data, one tangent for each, whose errors count for the steps as well.
    """

    adaptive, looks, h = True, _LOOKS, 0.0

    def __init__(self, equation, scheme, t_end, tolerance, directions=None):
        scheme.check_terms(equation)
        self.equation, self._scheme = equation, scheme
        self._view = view = Plain(equation) if equation.enlarged is equation else Reading(equation)
        self.second = view.second
        refuse_late(equation, t_end)
        self._t_end, self._breaks = t_end, np.zeros(0)
        rtol, atol, modes_tol, *limits = tolerance
        steps = scheme.horizon or 0.0, int(scheme.nodes), (rtol, atol), modes_tol
        pace = Pace(*limits)
        super().__init__(view.system, t_end, *steps, view.directions(directions), pace)

    @property
    def y(self):
        """Solution at `t`, shape (d,); a copy."""
        return self._view.values(self._orbit.x[0], self._orbit.p[0])[0]

    @property
    def uncertainty(self):
        """Errors of y, (d,), that the tolerance allows here."""
        rtol, atol = self._tolerances
        sizes = self._view.values(self._state.sizes, self._state.sizes)[0]
        return rtol * np.abs(self.y) + (OF_SIZE * rtol * sizes if atol is None else atol)

    @property
    def ydot(self):
        """First derivative at `t` where it is an unknown, NaN elsewhere; shape (d,)."""
        return self._view.values(self._orbit.x[0], self._orbit.p[0])[1]

    @property
    def tangent(self):
        """Tangents: derivatives of y, and of y' for orders above 1, shape (n_data, k); a copy."""
        values, speeds = self._view.values(self._orbit.x[1:], self._orbit.p[1:])
        return np.vstack([values.T, speeds[:, self.second].T])

    def transform_tangent(self, matrix):
        """Replace the tangents and their history by ``tangent @ matrix``, matrix (k, k)."""
        self._orbit.transform(matrix)

    def advance(self, stop, keep=True):
        """March towards time `stop` by some steps at most; return their dense output or None.

        Where the march cannot go on `trouble` says why; an exception of the right-hand side is kept
        in `error`.
        """
        ahead = self._breaks[self._breaks > self.t]
        t_stop = min(stop, ahead[0]) if ahead.size else stop
        try:
            piece = self._steps(t_stop)
        except Exception as error:
            self.error, piece = error, None
        if ahead.size and self.t == ahead[0]:
            self._at_singular_start = True
        return None if piece is None else self._view.piece(piece)

    @property
    def trouble(self):
        """Status and detail where the march cannot go on, else None."""
        if self.error is not None:
            return failed(self.error)
        if self.ending.status is not None:
            return self.ending
        if self.pace.used_up(self.n_steps) and self.t < self._t_end:
            return Status.MAX_STEPS, f"{self.n_steps} in all"
        return None

    @property
    def misfit(self):
        """By how much kernels miss the tolerance; empty where they keep it."""
        return self._orbit.kernels.errors.misfit(self._tolerances[0])

    def set_breaks(self, times, t_end):
        """Begin the steps anew at these times."""
        at_once, self._breaks = breaks_ahead(times, self.t, t_end, self.equation.frame.start)
        self._at_singular_start |= at_once

    def stats(self):
        """Return counts and error estimates for the solution's stats."""
        return {
            "n_steps": self.n_steps,
            "n_rejected": int(self._state.counts["refused"]),
            "n_rhs": self.n_rhs,
            "n_modes": self.n_modes,
            "history_bytes": self._orbit.modes.nbytes,
            "kernel_error": self._orbit.kernels.errors.reported,
            "error_estimate": max(self._largest_error, STEP_FRACTION) * self._tolerances[0],
        }

    def state(self):
        """Return an `AdaptiveState` from which a later run continues."""
        rtol, atol = self._tolerances
        march, orbit, at_singular_start = self.checkpoint()
        state = AdaptiveState(
            t=self.t,
            y=self.y,
            scheme=self._scheme,
            rtol=rtol,
            atol=atol,
            modes_tol=self.modes_tol,
            identity=self._identity(self.t),
            march=march,
            orbit=orbit,
            at_singular_start=at_singular_start,
        )
        return complete(state)

    def restore(self, state, allow_change=False):
        """Continue from `state`; `allow_change` admits another right-hand side or parameters."""
        changed = check_identity(state.identity, self._identity(state.t), allow_change)
        refuse_late(self.equation, self._t_end)
        check_reach(state, self._t_end)
        self._at_singular_start = state.at_singular_start or changed
        self._go_on_from(state.march, copy.deepcopy(state.orbit))
        self._limit_steps(self._t_end)

    def checkpoint(self):
        """Return copies of all that the march consists of, for `go_back` and `state`."""
        kept = tuple(plain(part).copy() for part in self._state)
        return kept, copy.deepcopy(self._orbit), self._at_singular_start

    def go_back(self, checkpoint, t):
        """Come back to where `checkpoint` was taken, and march to time t."""
        kept, orbit, self._at_singular_start = checkpoint
        self._go_on_from(kept, orbit)
        while self.t < t and self.trouble is None:
            self.advance(t)

    def position_at(self, t):
        """Return the position of a march that stops at time t."""
        return t

    stands_at = position_at

    def expect_moves(self, of_y):
        """Make few steps at once, for f, and y if `of_y`, is going to jump; refuse if it cannot."""
        self._rows = _FEW_ROWS
        kinds, moving = "a change of y" if of_y else "a switch", "events, changes and switches"
        if self._form.implicit.any():
            required = "change or switch nothing where a component's highest order varies or is a "
            raise ValueError(complaint(moving, required + "kernel's", kinds))
        if of_y and any(operator.from_zero for operator, _ in self.equation.left):
            required = "change no y beside RiemannLiouville, which takes jumps for derivatives"
            raise ValueError(complaint(moving, required, kinds))

    def moved(self, y):
        """Let y jump to these values, (d,), here; the jump does not enter the memory."""
        self._orbit.shift(self._view.widened(y - self.y))
        self._at_singular_start = True

    def set_parameter(self, number, value):
        """Set a parameter of the right-hand side, which jumps."""
        self._system.compiled_params[number] = value
        self._at_singular_start = True

    def _identity(self, t):
        """Describe the traits that a run to time t shares with one that resumes it."""
        how = {"number of nodes": self._s, "tolerances": self._tolerances}
        return identity(self.equation, t, **how)
