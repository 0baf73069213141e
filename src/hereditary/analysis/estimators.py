"""Estimators of growth over a stepper: tangents and pairs of orbits."""

import numpy as np

from ..compiled.growing_march import due, measure, note
from ..equation.system import displaced
from ..solver.status import Status


class Tangents:
    """The derivative of every step along k directions, made orthonormal with all of its memory.

    Parameters
    ----------
    open_stepper : callable
        ``open_stepper(equation, directions=...)``: a stepper.
    equation : System
    directions : ndarray, shape (n_data, k)
        Orthonormal initial directions.
    """

    # what is said where tangents cannot be made orthonormal
    lost = "tangents overflowed or vanished; shorten renorm"

    def __init__(self, open_stepper, equation, directions):
        self.stepper = open_stepper(equation, directions=directions)
        self._steps: list[int] = []
        self._logs: list[np.ndarray] = []
        self._failed = False

    def follow(self, pace, last, unit):
        """Make tangents orthonormal when `pace` says, in a run to step `last`.

        `unit` is the length of a step in positions.
        """
        self._pace, self._last, self._unit = pace, last, unit

    @property
    def failed(self):
        """Whether tangents cannot be made orthonormal."""
        return self._failed

    @property
    def steppers(self):
        """All steppers that are at work, the orbit's own first."""
        return [self.stepper]

    @property
    def position(self):
        """Position of the orbit, in steps or in time."""
        return self.stepper.position

    @property
    def n_rhs(self):
        """Calls of the right-hand side."""
        return sum(stepper.n_rhs for stepper in self.steppers)

    @property
    def trouble(self):
        """Status and detail where the march cannot go on, else None."""
        found = next((stepper.trouble for stepper in self.steppers if stepper.trouble), None)
        return (Status.BLOWN_UP, self.lost) if self.failed and not found else found

    def prepare(self, n_end):
        """Make room for a march up to step `n_end`."""
        for stepper in self.steppers:
            stepper.prepare(n_end)

    def advance(self, stop, keep):
        """March some way towards `stop`; return the dense output of the orbit where it is kept."""
        n = int(due(self._pace, self._last))
        stop = min(stop, n * self._unit)
        orbit, *others = self.steppers
        piece = orbit.advance(stop, keep)
        for other in others:
            while other.position < orbit.position and not other.trouble:
                other.advance(orbit.position, keep=False)
        if orbit.position >= n * self._unit and not self.trouble:
            self._renormalise(n)
        return piece

    def grown(self):
        """Return steps (n,) and logarithms of the growth up to them (n, k), since the last call."""
        steps, logs = self._steps, self._logs
        self._steps, self._logs = [], []
        return np.array(steps, dtype=np.int64), np.array(logs)

    def _renormalise(self, n):
        """Make the tangents orthonormal at step n, and note their growth."""
        columns = self._columns()
        inverse = np.empty((columns.shape[1], columns.shape[1]))
        if not measure(columns, inverse):
            self._failed = True
            return
        self._transform(inverse)
        logs = -np.log(np.diag(inverse))
        note(self._pace, n, logs)
        self._steps.append(n)
        self._logs.append(logs)

    def _columns(self):
        """Return what is made orthonormal, (n_data, k)."""
        return self.stepper.tangent

    def _transform(self, matrix):
        """Replace what is made orthonormal by combinations, memory included."""
        self.stepper.transform_tangent(matrix)


class StepTangents(Tangents):
    """Tangents on given steps, made orthonormal in compiled code."""

    def follow(self, pace, last, unit):
        """Make tangents orthonormal when `pace` says, in a run to step `last`."""
        self.stepper.renormalise(pace, last)

    def advance(self, stop, keep):
        """March some way towards `stop`; return the dense output of the orbit where it is kept."""
        return self.stepper.advance(stop, keep)

    @property
    def failed(self):
        """Whether tangents cannot be made orthonormal."""
        return self.stepper.lost

    def grown(self):
        """Return steps (n,) and logarithms of the growth up to them (n, k), since the last call."""
        return self.stepper.grown()


class Pairs(Tangents):
    """Orbits side by side, whose whole histories are drawn back to a small distance.

    The differences of everything that is linear in the solution take the place of tangents, so no
    derivative is needed; of the right-hand side's values only the differences are rescaled.

    Parameters
    ----------
    separation : float
        Distance that the orbits are drawn back to.
    """

    lost = "orbits overflowed or fell together; shorten renorm or take a larger separation"

    def __init__(self, open_stepper, equation, directions, separation):
        super().__init__(lambda system, **_: open_stepper(system), equation, directions)
        self._separation = separation
        d, with_speed = equation.d, equation.highest_orders() > 1
        self._others = []
        for direction in separation * directions.T:
            y0 = equation.y0.copy()
            y0[0] += direction[:d]
            y0[1:, with_speed] += direction[d:]
            self._others.append(open_stepper(displaced(equation, y0)))

    @property
    def steppers(self):
        """The orbit's stepper, and those beside it."""
        return [self.stepper, *self._others]

    def _columns(self):
        """Return the distances of the other orbits, in units of the separation."""
        origin = _values(self.stepper)
        apart = [(_values(other) - origin) / self._separation for other in self._others]
        return np.ascontiguousarray(np.array(apart).T)

    def _transform(self, matrix):
        """Draw the other orbits back."""
        for base, *others in zip(*(stepper.parts() for stepper in self.steppers), strict=True):
            drawn = np.tensordot(matrix.T, np.array(others) - base, axes=1)
            for array, difference in zip(others, drawn, strict=True):
                array[...] = base + difference


def _values(stepper):
    """Return y, and ydot where the order is above 1, shape (n_data,): later initial data."""
    with_speed = stepper.equation.highest_orders() > 1
    return np.concatenate([stepper.y, stepper.ydot[with_speed]])
