"""The stepper on meshes of any steps (floor 4)."""

import numpy as np

from ..kernels.block import BLOWN_UP, NOT_SOLVED
from ..kernels.mesh import march_mesh
from ..kernels.signatures import COUNTS, MeshMarch, MeshTable, Output
from ..kernels.structures import record
from ..special import gauss_unit
from .first_steps import FirstSteps
from .stepper import seconds_of_rhs


class MeshStepper:
    """A march of one equation with one scheme and one history along given times.

    It offers what `Stepper` offers, but for its state: such a run cannot be resumed.

    Parameters
    ----------
    equation : Equation
    scheme : Scheme
    history : History
    times : ndarray, shape (n+1,)
        The mesh, from 0 on [time].
    """

    zigzag, growth, largest_ratio, no_step = None, None, 0.0, ""

    def __init__(self, equation, scheme, history, times):
        scheme.check_terms(equation)
        self.equation = equation
        self._times = times
        self._system = system = scheme.reduction(equation) or equation
        plan = scheme.mesh_plan(system, times)
        self.memory = history.open_mesh(plan)
        given = plan.first is not None
        self._table = MeshTable(
            times=times,
            theta=plan.theta,
            parabolas=plan.parabolas,
            given=int(given),
            groups=plan.classes,
            factors=plan.factors,
            powers=plan.powers,
            rule=np.array(gauss_unit(16)),
            first=plan.first if given else np.zeros(system.d),
            speeds=plan.speeds,
        )
        self._march = MeshMarch(
            counts=record(COUNTS),
            x=system.y0[0].copy(),
            increment=np.zeros(system.d),
            pieces=np.zeros((2, system.d)),
        )
        self.blown_up = self.not_solved = False
        self._starting = FirstSteps(equation, times[1:3])

    @property
    def n(self):
        """Steps made."""
        return int(self._march.counts.step)

    @property
    def n_rhs(self):
        """Calls of the right-hand side."""
        return int(self._march.counts.rhs)

    @property
    def rows_written(self):
        """Rows that the last `advance` filled."""
        return int(self._march.counts.rows)

    @property
    def t(self):
        """Time reached."""
        return float(self._times[self.n])

    @property
    def y(self):
        """Solution at `t`, shape (d,); a copy."""
        return self._march.x[: self.equation.d].copy()

    @property
    def ydot(self):
        """Slope of the newest step, shape (d,); y'(0), or 0, before the first."""
        step = self._times[self.n] - self._times[self.n - 1] if self.n else 1.0
        return (self._march.increment / step + self._table.speeds)[: self.equation.d]

    def times(self, positions):
        """Times of positions counted in steps."""
        return np.interp(positions, np.arange(self._times.size), self._times)

    def positions(self, times):
        """Positions of times, counted in steps."""
        return np.interp(times, self._times, np.arange(self._times.size))

    def prepare(self, n_end):
        """Everything is prepared from the start."""

    def seconds_of_rhs(self):
        """Time that one call of the right-hand side takes."""
        return seconds_of_rhs(self)

    def advance(self, n_more, positions, rows, slopes):
        """Make up to `n_more` steps; as `Stepper.advance`."""
        n_end, written = self.n + n_more, 0
        while self.n < n_end and not (self.blown_up or self.not_solved):
            stop = n_end if self.n > 1 else self.n + 1
            part = slice(written, int(np.searchsorted(positions, stop, side="right")))
            try:
                self._advance(stop, positions[part], rows[part], slopes[part])
            finally:
                written += self.rows_written
                self._march.counts.rows = written
            if self.n == stop <= 2:
                times = self.times(positions[part])
                self._starting.fill(stop, self.y, times, rows[part], slopes[part])

    def _advance(self, n_end, positions, rows, slopes):
        """Enter the compiled march once."""
        system = self._system
        status = march_mesh(
            system._rhs,
            system._jac,
            int(system.has_jac),
            system._params,
            self.memory.recall,
            self.memory.tables,
            self.memory.arrays,
            self._table,
            self._march,
            Output(positions, rows, slopes, np.zeros((0, 0, 0))),
            n_end,
        )
        self.blown_up, self.not_solved = status == BLOWN_UP, status == NOT_SOLVED

    def state(self):
        """None: a run on a mesh begins at 0."""
