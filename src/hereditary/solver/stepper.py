"""The stepper: one march over given steps, advanced a stretch at a time."""

import math
import time

import numpy as np

from ..compiled.block import BLOWN_UP, NOT_SOLVED, RUNNING
from ..compiled.march import MARCHES
from ..compiled.signatures import COUNTS, MONITOR, March, Output, StepTable
from ..compiled.structures import plain, record
from ..memory_kernel import warn_of_fit
from ..schemes.scheme import refuse_late
from ..system import shifted, variational
from .first_steps import first_steps
from .identity import check_identity, described, identity
from .state import State, check_sound, frozen, sealed
from .stops import before_break, rows_beside

# Steps in a block. Measured with 56 modes: 74, 75 and 85 ns a step at 16, 32 and 64, where the
# in-block sums take over; below 16 the calls of the history do.
BLOCK = 32
# Steps after which a march reads no data but the lasting ones.
_FIRST_STEPS = 8


class Stepper:
    """A march of one equation with one scheme and one history on given steps.

    Tangents may go alongside: the derivative of every step along given directions. All that is
    linear in them can be replaced by linear combinations at any step.

    Parameters
    ----------
    equation : System
    scheme : Scheme
    history : History
    steps : UniformSteps or MeshSteps
    n_steps : int
        Steps the whole run is going to take; histories prepare for that many.
    directions : ndarray, shape (n_data, k), optional
        Derivatives of the initial data along k directions: those of y(0), and behind them those of
        y'(0) for each component of order above 1.
    block : int
        Steps in a block; results depend on it by rounding alone.
    """

    no_step, adaptive = "", False

    def __init__(self, equation, scheme, history, steps, n_steps, directions=None, block=BLOCK):
        scheme.check_terms(equation)
        refuse_late(equation, steps.time(n_steps))
        self.equation, self.scheme, self.history = equation, scheme, history
        self.steps, self._given, self._origin = steps, equation, 0.0
        self._span = steps.span
        if steps.h > 0:
            horizon = getattr(history, "horizon", None) or 0.0
            self._span = max(int(n_steps), math.ceil(horizon / steps.h * (1 - 1e-12)))
        self._with_speed = np.flatnonzero(equation.highest_orders() > 1)
        if directions is None:
            directions = np.zeros((self.n_data, 0))
        self.n_tangents = directions.shape[1]
        plan = self._plan(directions)
        self._block = 1 if plan.rows.last > 1 else block
        self.memory = self._open(plan)
        warn_of_fit(self.memory.kernel_error, getattr(history, "tol", 0.0))
        self._begin(plan)
        self.largest_ratio, self.blown_up, self.not_solved = 0.0, False, False
        self.breaks: frozenset[int] = frozenset()

    def _plan(self, directions):
        """The scheme's plan for orbit and tangents."""
        equation = self.equation
        system = self._system = self.scheme.reduction(equation) or equation.enlarged
        self._sources = system.sources
        if self.n_tangents == 0:
            return self.steps.plan(self.scheme, system)
        rows = np.zeros((system.m, system.d, self.n_tangents))
        rows[0, : equation.d] = directions[: equation.d]
        rows[1:, self._with_speed] = directions[equation.d :]
        beside = variational(system, rows[:, system.sources])
        self._sources = beside.sources
        return self.steps.plan(self.scheme, beside)

    def _open(self, plan):
        """A fresh memory."""
        return plan.past.open(self.history, plan.groups.size, self._block, self._span)

    def _begin(self, plan):
        """Arrays of a march that stands at step 0."""
        self._loop = MARCHES[self.scheme.solve, self.memory.inlined]
        d, width = self._system.d, plan.groups.size
        self._past, self._rows, self._lasting = plan.past, plan.rows, plan.lasting
        self._region = plan.region and plan.region.orbit(d, self._system.sources)
        none = np.zeros((0, width))
        self._table = StepTable(
            h=self.steps.h,
            slowest=plan.slowest,
            sweeps=plan.sweeps,
            integral=int(plan.integral),
            n_orbit=d,
            n_solved=int(np.sum(~self._system.read)),
            every=self._block * self._region.every if self._region else 0,
            groups=plan.groups,
            sources=self._sources,
            given=np.zeros(width, dtype=np.int64) if plan.given is None else plan.given,
            weights=self.memory.block_weights,
            start_weights=self.memory.block_start_weights,
            limits=np.zeros(width) if plan.limits is None else plan.limits,
            powers=none if plan.powers is None else plan.powers,
        )
        monitor = np.zeros(d, MONITOR).view(np.recarray)
        monitor.turns[: self.equation.d] = -1.0 * (self.equation.highest_orders() == 2)
        self._march = March(
            counts=record(COUNTS, zigzag=-1, opened=-1, growth=-1),
            x=plan.initial.copy(),
            increment=plan.increments.copy(),
            change=np.zeros(width),
            lag=np.zeros((width, self._block)),
            pieces=np.zeros((width, self._block + 1)),
            monitor=monitor,
            shift=plan.shift.copy(),
            drift=_by_columns(plan.drift, none),
            first=np.zeros(width) if plan.first is None else plan.first.copy(),
            corrections=_by_columns(plan.corrections, none),
            starts=_by_columns(plan.starts, none),
            force=np.zeros(width),
            lacks=np.zeros(width),
        )
        self.memory.begin(self._march.shift, self._march.starts)

    @property
    def h(self):
        """Step of uniform ones; 0 on a mesh."""
        return self.steps.h

    @property
    def n(self):
        """Steps made."""
        return int(self._march.counts.step)

    @property
    def rows_written(self):
        """Rows that the last `advance` filled; fewer than asked for where it stopped early."""
        return int(self._march.counts.rows)

    @property
    def t(self):
        """Time reached."""
        return self._origin + self.steps.time(self.n)

    @property
    def y(self):
        """Solution at `t`, shape (d,); a copy."""
        return self._march.x[: self.equation.d].copy()

    @property
    def ydot(self):
        """First derivative at `t`, from the newest two increments, shape (d,)."""
        slope = self._slopes()[: self.equation.d]
        # before the first step only components with an initial derivative have one
        known = self.n > 0 or self.equation.m == 1
        return slope if known else np.where(self.equation.highest_orders() > 1, slope, np.nan)

    @property
    def n_data(self):
        """Number of initial data: d, and one more for each component of order above 1."""
        return self.equation.d + self._with_speed.size

    @property
    def tangent(self):
        """Derivatives of y, and of ydot where the order is above 1, shape (n_data, k); a copy."""
        d = self._system.d
        values, slopes = (
            columns[d:].reshape(self.n_tangents, d).T for columns in (self._march.x, self._slopes())
        )
        return np.vstack([values[: self.equation.d], slopes[self._with_speed]])

    def transform_tangent(self, matrix):
        """Replace the tangents by linear combinations, ``tangent <- tangent @ matrix``.

        Everything that is linear in them goes along: initial values, increments, the block under
        way, and all of the memory. So the combinations are what a march from the combined initial
        directions would have given.

        Parameters
        ----------
        matrix : ndarray, shape (k, k)
        """
        d = self._system.d
        if self.n > _FIRST_STEPS:
            # what is not used any more would grow without end as tangents decay
            self._march.starts[d:] = 0.0
            if not self._lasting:
                self._march.first[d:] = 0.0
                self._march.corrections[d:] = 0.0
        if self.n_tangents == 1:
            for array in self.parts():
                array[d:] *= matrix[0, 0]
            return
        mixed = matrix[:, None, :, None] * np.eye(d)[:, None, :]  # np.kron takes ten times as long
        large = mixed.reshape(self.n_tangents * d, -1)
        self.memory.combine(large, first=d)
        for array in self._linear():
            array[d:] = large.T @ array[d:]

    def parts(self):
        """Every array of the march and its memory that is linear in the solution; not copies."""
        return [*self._linear(), *self.memory.arrays]

    def _linear(self):
        """Return the arrays of the march that are linear in the solution."""
        march = self._march
        return [part for part in march if part is not march.counts and part is not march.monitor]

    def restart(self):
        """Forget the past: the present values, also of the tangents, become initial ones at step 0.

        This is another problem than the one begun, whose memory reaches back to time 0.
        """
        initial = np.zeros_like(self.equation.y0)
        initial[0] = self.y
        initial[1:, self._with_speed] = self.ydot[self._with_speed]
        tangent, calls = self.tangent, self.n_rhs
        self._origin = self.t
        self.equation = shifted(self._given, self._origin, initial)
        plan = self._plan(tangent)
        if self._block == 1:  # whose sums are those of later times
            self.memory = self._open(plan)
        self.memory.clear()
        self._begin(plan)
        self._march.counts.rhs = calls

    def _slopes(self):
        """First derivative of all columns."""
        return (self._march.increment + 0.5 * self._march.change) / self.steps.unit(self.n)

    @property
    def n_modes(self):
        """Modes held for each component."""
        return self.memory.n_modes

    @property
    def n_rhs(self):
        """Calls of the right-hand side."""
        return int(self._march.counts.rhs)

    @property
    def zigzag(self):
        """Step at which a sustained step-to-step zigzag was seen, or None."""
        n = int(self._march.counts.zigzag)
        return None if n < 0 else n

    @property
    def growth(self):
        """Step at which turns of a few steps each were seen to have grown, or None."""
        n = int(self._march.counts.growth)
        return None if n < 0 else n

    def seconds_of_rhs(self):
        """Time that one call of the right-hand side takes, a few microseconds of entry included."""
        system = self._system
        y, dy = self._march.x[: system.d].copy(), np.empty(system.d)
        began = time.perf_counter()
        system._rhs(self.t - self._origin, y, dy, system._params)
        return time.perf_counter() - began

    def prepare(self, n_end):
        """Make room for a march up to step `n_end`."""
        refuse_late(self.equation, self.steps.time(n_end))
        self._past.prepare(n_end)
        self.memory.prepare(n_end)

    def advance(self, n_more, positions, rows, slopes):
        """Make up to `n_more` steps and write the rows asked for on the way.

        Parameters
        ----------
        n_more : int
        positions : ndarray, shape (k,)
            Where rows are wanted, in steps, ascending, within the stretch.
        rows, slopes : ndarray, shape (k, d)
            Filled with the solution and its first derivative there.

        Raises whatever the right-hand side raises; the steps before it are made and kept.
        """
        n_end = self.n + n_more
        self.prepare(n_end)
        self._march.counts.rows = written = 0
        starting = first_steps(self, positions)
        while self.n < n_end:
            known, size = self._past.reach(self.n)
            if size:
                self._rows = self._past.rows
                self.memory.follow(size)
            stop = min(n_end, known, self.memory.reach(self.n))
            if starting and self.n < 2:
                stop = self.n + 1
            stop = before_break(self.breaks, self.n, stop)
            self.memory.refresh(self.n, self._march.pieces, self._table.groups)
            part = slice(written, int(np.searchsorted(positions, stop, side="right")))
            try:
                status = self._advance(stop, positions[part], rows[part], slopes[part])
            finally:
                written += self.rows_written
                self._march.counts.rows = written
            if starting and self.n == stop <= 2:
                times = self.steps.times(positions[part])
                starting.fill(stop, self.y, times, rows[part], slopes[part])
            self.blown_up, self.not_solved = status == BLOWN_UP, status == NOT_SOLVED
            if status != RUNNING:
                return

    def _advance(self, n_end, positions, rows, slopes):
        """Enter the compiled march once; watch the stability along the orbit."""
        n, region = self.n, self._region
        every = self._block * region.every if region else n_end
        first = (n - 1) // every + 1
        n_samples = (n_end - 1) // every + 1 - first if region else 0
        n_stretches = (n_end - 1) // every + 1 - n // every if region and region.sweeps else 0
        system = self._system
        jacobians = np.zeros((n_samples + n_stretches, system.d, system.d))
        try:
            return self._loop(
                system._rhs,
                system._jac,
                int(system.has_jac),
                system._params,
                self.memory.exchange,
                self.memory.tables,
                self.memory.arrays,
                self._table,
                rows_beside(self.breaks, self.n, self._rows, self.steps),
                self._march,
                Output(positions, rows, slopes, jacobians),
                n_end,
            )
        finally:
            if region:
                made = (self.n - 1) // every + 1 - first
                steps = (first + np.arange(made)) * every
                self._note(region.ratios(jacobians[:made], steps), steps)
                taken = np.flatnonzero(jacobians[n_samples:].any(axis=(1, 2)))
                steps = (n // every + taken) * every
                self._note(region.ratios(jacobians[n_samples + taken], steps), steps)

    def checkpoint(self):
        """Return all that `rewind` needs to come back to this step."""
        march = March._make(part.copy() for part in self._march)
        return march, self.memory.state(), self.largest_ratio

    def rewind(self, checkpoint):
        """Come back to the step at which `checkpoint` was taken."""
        self._march, memory, self.largest_ratio = checkpoint
        self.memory.restore(memory)

    def _note(self, ratios, steps):
        """Keep the largest ratio so far and its step."""
        if ratios.max(initial=0.0) > self.largest_ratio:
            self.largest_ratio = float(ratios.max())
            self._march.counts.largest = steps[np.argmax(ratios)]

    @property
    def largest_ratio_step(self):
        """Step near which the Jacobian was largest in comparison with its limit."""
        return int(self._march.counts.largest)

    def state(self):
        """A `State` from which a later run goes on bit for bit."""
        state = State(
            t=self.t,
            n=self.n,
            steps=self.steps.until(self.n),
            y=frozen(self.y),
            scheme=self.scheme,
            history=self.history,
            identity=self._identity(self.t),
            block=self._block,
            march=tuple(frozen(plain(part)) for part in self._march),
            memory=tuple(map(frozen, self.memory.arrays)),
            memory_steps=self._span,
            largest_ratio=self.largest_ratio,
        )
        return sealed(state)

    def restore(self, state, allow_change=False):
        """Take over where `state` was taken, of another right-hand side where that is allowed."""
        check_sound(state)
        check_identity(state.identity, self._identity(state.t), allow_change)
        counts, *parts = state.march
        self._march = March(record(COUNTS, tuple(counts[0])), *(part.copy() for part in parts))
        monitor = np.array([tuple(row) for row in self._march.monitor], MONITOR)
        self._march = self._march._replace(monitor=monitor.view(np.recarray))
        self.memory.restore(state.memory)
        self.largest_ratio = state.largest_ratio

    def _identity(self, t):
        """Describe what a run to time t must share with one that resumes it."""
        how = {"scheme": described(self.scheme), "history": described(self.history)}
        return identity(self.equation, t, self.n_tangents, **how)


def _by_columns(rows, none):
    """Copy rows, (k, W), as columns (W, k)."""
    return np.array((none if rows is None else rows).T, order="C")
