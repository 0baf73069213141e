"""How growth is measured over a stepper: by tangents, pairs of orbits, or restarts."""

import math

import numpy as np

from .._checks import complaint
from ..system import displaced


class Tangents:
    """The derivative of every step along k directions, made orthonormal with all of its memory.

    Parameters
    ----------
    open_stepper : callable
        ``open_stepper(equation, directions=...)``: a `Stepper` or the like.
    equation : System
    directions : ndarray, shape (n_data, k)
        Orthonormal initial directions.
    """

    # why `renormalise` finds nothing
    lost = "tangents overflowed or vanished; shorten renorm"

    def __init__(self, open_stepper, equation, directions):
        self.stepper = open_stepper(equation, directions=directions)

    @property
    def steppers(self):
        """All steppers that are at work, the orbit's own first."""
        return [self.stepper]

    @property
    def position(self):
        """How far the orbit is, in steps or in time."""
        return self.stepper.position

    @property
    def n_rhs(self):
        """Calls of the right-hand side."""
        return sum(stepper.n_rhs for stepper in self.steppers)

    @property
    def trouble(self):
        """Status and detail where a stepper cannot go on, else None."""
        return next((stepper.trouble for stepper in self.steppers if stepper.trouble), None)

    def prepare(self, n_end):
        """Make room for a march up to step `n_end`."""
        for stepper in self.steppers:
            stepper.prepare(n_end)

    def advance(self, stop, keep):
        """March some way towards `stop`; return the dense output of the orbit where it is kept."""
        orbit, *others = self.steppers
        piece = orbit.advance(stop, keep)
        for other in others:
            while other.position < orbit.position and not other.trouble:
                other.advance(orbit.position, keep=False)
        return piece

    def renormalise(self):
        """Make the tangents orthonormal; the logarithms of their growth (k,), None where lost."""
        lengths, inverse = _triangle(self.stepper.tangent)
        if lengths is None:
            return None
        self.stepper.transform_tangent(inverse)
        return np.log(lengths)

    def state(self):
        """States of all steppers."""
        return tuple(stepper.state() for stepper in self.steppers)

    def restore(self, state):
        """Take over where `state` was taken."""
        for stepper, part in zip(self.steppers, state, strict=True):
            stepper.restore(part)


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
        self.stepper = open_stepper(equation)
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

    def renormalise(self):
        """Draw the other orbits back; the logarithms of their growth (k,), None where lost."""
        origin = _values(self.stepper)
        apart = [(_values(other) - origin) / self._separation for other in self._others]
        lengths, inverse = _triangle(np.array(apart).T)
        if lengths is None:
            return None
        for base, *others in zip(*(stepper.parts() for stepper in self.steppers), strict=True):
            drawn = np.tensordot(inverse.T, np.array(others) - base, axes=1)
            for array, difference in zip(others, drawn, strict=True):
                array[...] = base + difference
        return np.log(lengths)


class Restarted(Tangents):
    """Tangents whose memory, and that of the orbit, is cut off at every renormalisation.

    A published algorithm, for comparison with published numbers: not exponents of the equation.
    """

    def __init__(self, open_stepper, equation, directions):
        super().__init__(open_stepper, equation, directions)
        self._n_before = 0

    @property
    def position(self):
        """Steps made, those before the restarts included."""
        return self._n_before + self.stepper.n

    def advance(self, stop, keep):
        """March some way towards `stop`, counted from the first start."""
        return super().advance(stop - self._n_before, keep)

    def prepare(self, n_end):
        """Nothing: the memory never holds more than one interval."""

    def renormalise(self):
        """Make the tangents orthonormal and begin anew; the logarithms of their growth (k,)."""
        logs = super().renormalise()
        if logs is not None:
            self._n_before += self.stepper.n
            self.stepper.restart()
        return logs

    def state(self):
        """None: where the memory is cut off there is nothing to resume."""

    def restore(self, state):
        """Refuse."""
        required = 'be left out with mode="restart"'
        raise ValueError(complaint("resume", required, type(state).__name__))


def _values(stepper):
    """Return y, and ydot where the order is above 1, shape (n_data,): later initial data."""
    with_speed = stepper.equation.highest_orders() > 1
    return np.concatenate([stepper.y, stepper.ydot[with_speed]])


def _triangle(columns):
    """Diagonal (k,), above 0, and inverse (k, k) of R in ``columns = Q R``; None where lost."""
    if columns.shape[1] == 1:
        length = math.hypot(*columns[:, 0])
        known = 0 < length < math.inf
        return (np.array([length]), np.array([[1 / length]])) if known else (None, None)
    if not np.all(np.isfinite(columns)):
        return None, None
    r = np.linalg.qr(columns)[1]
    triangle = r * np.where(np.diag(r) < 0, -1.0, 1.0)[:, None]
    lengths = np.diag(triangle)
    if not np.all(lengths > 0):
        return None, None
    return lengths, np.linalg.inv(triangle)
