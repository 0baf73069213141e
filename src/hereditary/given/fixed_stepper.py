"""The stepper for steps given in advance: each call advances one march by many steps."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import lru_cache, partial
from operator import attrgetter
from typing import Any

import numpy as np

from ..compiled.delayed_values import Delays
from ..compiled.jacobian import FEW
from ..compiled.jit import checked, loop_value
from ..compiled.records import plain, record, records, zeros
from ..compiled.reference import by_reference
from ..compiled.signatures import FACTORISE, LINEAR
from ..equation.system import System, refuse_late, variational, with_pieces
from ..equation.terms import SystemTerm
from ..kernels.memory_kernel import misfit_on_given_steps
from ..stepping.dense import StepPieces
from ..stepping.scheme import Scheme
from ..stepping.state import State, check_identity, described, identity, state_of
from ..stepping.status import Ending, Status, failed
from ..stepping.stepper import (
    Diagnostics,
    Grown,
    JumpingStepper,
    ResumableStepper,
    Stop,
    TangentStepper,
)
from ..stepping.times import ONE_TIME
from ..support.checks import refuse
from .block import RUNNING
from .endings import ending, remedy_of
from .first_steps import FirstSteps, starting_steps
from .growing_march import LOST, Renormalisations, grow, transform_march
from .history.history import History
from .linear_solvers import newton_of
from .march import MARCHES, march_of
from .plan import Plan
from .riemann_liouville import with_initial_values
from .signatures import (
    MARCH_COUNTS,
    MARCH_SIG,
    MONITOR,
    GivenMarch,
    GivenWork,
    March,
    MarchMemory,
    MarchOutput,
    StepTable,
    StepWorkspace,
)
from .steps import MeshSteps, UniformSteps, before_break, break_steps, rows_beside

# Steps in a block. With 56 modes a step took 74, 75 and 85 ns in blocks of 16, 32 and 64 steps. In
# blocks of 64 steps the sums inside the block dominate, in blocks below 16 the calls of the
# history.
BLOCK = 32
# Length of a run, in first steps, for units of components that are 0. It is not that of the run,
# because a resumed run repeats all bits.
_STEPS_OF_UNITS = 1e4
# Rounding error of y, relative to y.
_ROUNDING_OF_Y = 1e-13
# Seconds that one call of the compiled march lasts, between two checks for Ctrl-C and the progress
# bar. Entering the march costs 0.04 ms.
_SECONDS_PER_CALL = 0.1
# Most steps in one call of the compiled march, times components. The solution of all these steps
# then fits in a near cache of the processor.
_MAX_NUMBERS_PER_CALL = 1 << 15
# One call of the compiled march may make this many steps even if `_MAX_NUMBERS_PER_CALL` allows
# fewer.
_MIN_STEPS_PER_CALL = 32
# Number of plans that remain in storage for later runs.
_PLANS_MAX = 64
# Most steps in one call of the compiled march if an event may end the call early.
_MAX_STEPS_WITH_EVENTS = 256


class FixedStepper(ResumableStepper, TangentStepper, JumpingStepper):
    """March of one equation, and tangents along given directions, by one scheme on given steps."""

    t = 0.0

    def __init__(
        self,
        system: System,
        scheme: Scheme,
        history: History,
        steps: UniformSteps | MeshSteps,
        n_steps: int,
        directions: np.ndarray | None = None,
        block: int = BLOCK,
    ) -> None:
        # n_steps: of the whole run, which the history must cover. directions (n_data, k):
        # derivatives of the initial data, rows for y(0), then for y'(0) of each component of order
        # above 1. block: steps in a block, which changes results by rounding errors only.
        scheme.check_terms(system)
        refuse_late(system, steps.time(n_steps))
        self.system, self.scheme, self.history = system, scheme, history
        self.steps, self.h = steps, steps.h
        self._span = steps.covered(n_steps, getattr(history, "horizon", None) or 0.0)
        self._with_speed = np.flatnonzero(system.above_one)
        marched = self._marched = self._inside(system)
        directions = np.zeros((self.n_data, 0)) if directions is None else directions
        self.n_tangents = directions.shape[1]
        if self.n_tangents:
            if not scheme.takes_tangents:
                refuse("scheme", "give tangents and exponents", f"{scheme!r}")
            rows = np.zeros((marched.m, marched.d, self.n_tangents))
            rows[0, : system.n_solved] = directions[: system.n_solved]
            rows[1:, self._with_speed] = directions[system.n_solved :]
            marched = variational(marched, rows[:, marched.sources])
        self._sources, plan = marched.sources, self._planned(marched)
        self._block = block if plan.rows.shared else 1
        self._begin(plan)
        self._misfit = misfit_on_given_steps(self.memory.kernel_errors, history)
        self._status, self._jumped = RUNNING, False
        self._starting: FirstSteps | None = None
        # seconds that a step takes; most steps in one call
        self._seconds, self._most = 0.0, _MAX_NUMBERS_PER_CALL
        self._error: Exception | None = None
        self._breaks: frozenset[int] = frozenset()

    def _inside(self, system: System) -> System:
        """Return the system that the march solves: the scheme's reduced one, or `system`."""
        return self.scheme.reduction(system) or system

    def _planned(self, system: System) -> Plan:
        """Return the scheme's plan for a system, with y(0) in its Riemann-Liouville terms."""
        order = self.scheme.order(self.system.highest_order)
        if not (self.scheme.plans_by_terms and system.constant and self.h and system.d <= FEW):
            return with_initial_values(self.steps.plan(self.scheme, system), system, order)
        y0 = system.y0.shape, system.y0.tobytes(), system.sources.tobytes()
        return _kept_plan(self.scheme, self.h, order, system.terms_key, *y0)

    def _begin(self, plan: Plan) -> None:
        """Open the history's memory for a plan, and set up the march at step 0."""
        self.memory = self.history.open(plan.past, plan.groups.size, self._block, self._span)
        self._loop, system = MARCHES[self.scheme.solve], self._marched
        self._past, self._rows, self._lasting = plan.past, plan.rows, plan.lasting
        width = plan.groups.size
        table = StepTable(
            h=self.h,
            slowest=plan.slowest,
            sweeps=plan.sweeps,
            integral=int(plan.integral),
            n_orbit=system.d,
            n_solved=system.n_solved,
            groups=plan.groups,
            sources=self._sources,
            given=np.zeros(width, dtype=np.int64) if plan.given is None else plan.given,
            weights=self.memory.block_weights,
            start_weights=self.memory.block_start_weights,
            powers=np.zeros((0, width)) if plan.powers is None else plan.powers,
        )
        self._table = checked(table)
        exact = system.linear_alone and plan.rows.alike
        self._newton = newton_of(
            system.structure, system.d, self.n_tangents > 0, self.scheme.solve, exact
        )
        self._stand_at_start(plan)

    def _stand_at_start(self, plan: Plan, columns: slice = slice(None)) -> None:
        """Set the march to step 0 with an empty memory, from the selected columns of a plan."""
        orders, x = self.system.highest_orders(), plan.initial[columns].copy()
        width, none = x.size, np.zeros((0, plan.initial.size))
        drift, corrections, starts = [
            np.array((none if rows is None else rows)[:, columns].T, order="C")
            for rows in (plan.drift, plan.corrections, plan.starts)
        ]
        self.memory.clear()
        self._march = March(
            counts=record(MARCH_COUNTS, zigzag=-1, opened=-1, growth=-1, diverged=-1),
            x=x,
            increment=plan.increments[columns].copy(),
            change=np.zeros(width),
            lag=np.zeros((width, self._block)),
            pieces=np.zeros((width, self._block + 1)),
            monitor=records(np.zeros(self._marched.d, MONITOR), MONITOR),
            shift=plan.shift[columns].copy(),
            drift=drift,
            corrections=corrections,
            starts=starts,
            last_f=np.zeros(width),
            lacks=np.zeros(width),
            newton=self._newton.workspace,
            row_factors=np.ones((2, self._marched.d)),
        )
        self.n, self.t = 0, 0.0
        self._march.monitor["turns"][: orders.size] = np.where(orders == 2, -1.0, 0.0)
        units = self._marched.units(_STEPS_OF_UNITS * self.steps.unit(1))
        self._workspace = zeros(StepWorkspace, W=width, d=units.size)._replace(units=units)
        self._right = self._marched.compiled

    def take_delays(self, pieces: Delays) -> None:
        """Let f read delayed values from these pieces."""
        self.system = with_pieces(self.system, pieces)
        self._marched = with_pieces(self._marched, pieces)
        self._right = self._marched.compiled

    def set_breaks(self, times: np.ndarray, t_end: float) -> None:
        """Let each step next to a jump of f evaluate f on its own side of the jump."""
        # times (k,) of the jumps up to t_end
        self._breaks = break_steps(times, self.t, t_end, self.steps, self.system.frame.start)

    def prepare(self, n_end: int) -> None:
        """Allocate storage for a march up to step `n_end`."""
        refuse_late(self.system, self.steps.time(n_end))
        self._past.prepare(n_end)
        self.memory.prepare(n_end)

    def advance(self, stop: float, keep: bool = True) -> StepPieces | None:
        """Make steps towards step `stop`, as many as take about a tenth of a second."""
        # None if no step was made or keep is false. If the right-hand side raises, the steps before
        # the failing one stay, and `failure` reports it.
        n, d = self.n, self.system.n_solved
        n_more = min(int(stop) - n, self._steps_at_once())
        began = time.perf_counter()
        rows, slopes = np.empty((2, n_more + 1 if keep else 0, d))
        if keep:
            rows[0], slopes[0] = self.y, self.ydot
        if n == 0 or self._starting is None:
            self._starting = starting_steps(self)
        starting = self._starting if keep and n <= 1 and not self._jumped else None
        try:
            self._march_to(n + n_more, rows[1:], slopes[1:])
        except Exception as error:
            self._error = error
        made = self.n - n
        self._seconds = max(time.perf_counter() - began, 1e-9) / max(made, 1)
        if not keep or made == 0:
            return None
        times = self.steps.times(np.arange(n, n + made + 1.0))
        return StepPieces(times, rows[: made + 1], slopes[: made + 1], starting, n)

    def _steps_at_once(self) -> int:
        """Return the number of steps to make in one call of the compiled march."""
        # by the measured time of earlier steps, or before them by that of one call of f
        system = self._marched
        if self._seconds == 0.0:
            began = time.perf_counter()
            try:
                system.rhs(0.0, system.at_start)
            except Exception:  # the march calls f again, and reports the exception
                return 1
            self._seconds = max(time.perf_counter() - began, 1e-9)
        most = min(max(_MAX_NUMBERS_PER_CALL // system.d, _MIN_STEPS_PER_CALL), self._most)
        return int(min(max(_SECONDS_PER_CALL / self._seconds, 1), most))

    def _march_to(self, n_end: int, rows: np.ndarray, slopes: np.ndarray) -> None:
        """March to step `n_end`; write solution and slopes of its k steps, or none for k = 0."""
        # rows and slopes (k, d): one row for the end of each step
        self.prepare(n_end)
        first = self.n
        while self.n < n_end:
            known, others = self._past.reach(self.n)
            self._rows = others or self._rows
            reached = self.memory.reach(self.n, self._march.pieces, self._table.groups)
            stop = before_break(self._breaks, self.n, min(n_end, known, reached))
            part = slice(self.n - first, stop - first)
            self._status = self._enter(stop, rows[part], slopes[part])
            if self._status != RUNNING:
                return

    def _enter(self, n_end: int, rows: np.ndarray, slopes: np.ndarray) -> int:
        """Call the compiled march once."""
        memory, start = self.memory, self.system.frame.start
        if self.n in self._breaks:
            self._forget_explicit()
        try:
            return self._loop(march_of(GivenWork(
                right=self._right,
                memory=MarchMemory(memory.exchange, memory.tables, memory.arrays),
                solver=self._newton.solver,
                linear=self._newton.tables,
                table=self._table,
                rows=rows_beside(self._breaks, self.n, self._rows, self.steps, start),
                state=self._march,
                workspace=self._workspace,
                output=MarchOutput(rows, slopes, self.n),
            ), self.scheme.solve), n_end)  # fmt: skip
        finally:
            self._read_step()

    def _read_step(self) -> None:
        """Set `n` to the number of steps that the march has made, and `t` to their end."""
        self.n = int(self._march.counts["step"])  # counts.step would take ten times as long
        self.t = self.steps.time(self.n)

    # the position that the contract `Stepper` asks for
    position = property(attrgetter("n"))

    @property
    def y(self) -> np.ndarray:
        """Solution at `t`, (d,), in the components that have an equation; a copy."""
        return self._march.x[: self.system.n_solved].copy()

    @property
    def ydot(self) -> np.ndarray:
        """First derivative at `t`, from the newest two increments, shape (d,)."""
        slope = self._slopes()[: self.system.n_solved]
        # before the first step only components with an initial derivative have a slope
        known = self.n > 0 or (self.system.m == 1 and not self.system.frame.speeds)
        return slope if known else np.where(self.system.above_one, slope, np.nan)

    def _slopes(self) -> np.ndarray:
        """Return the first derivatives of all columns, those of orbit and tangents."""
        return (self._march.increment + 0.5 * self._march.change) / self.steps.unit(self.n)

    @property
    def failure(self) -> Ending | None:
        """Why the march cannot go on, as an `Ending`; None if it can."""
        if self._error is not None:
            return failed(self._error)
        tried, f = self._workspace.point[: self._marched.d], self._workspace.f[: self._marched.d]
        return ending(self._status, self.scheme, self.n, tried, f)

    @property
    def diagnostics(self) -> Diagnostics:
        """Whether steps exceed their stability limit, and whether kernels meet their tolerance."""
        status = self._instability()
        remedy, counts = "", self._march.counts
        if status:
            noted = [int(counts[name]) for name in ("zigzag", "growth", "diverged")]
            remedy = remedy_of(self.system, self.scheme, self.h, *noted)
        return Diagnostics(status, remedy, self._misfit)

    def _instability(self) -> Status | None:
        """Return the status of a march beyond its stability limit; None for a stable march."""
        if self.scheme.is_map:
            return None
        counts = self._march.counts
        if counts["zigzag"] >= 0:
            return Status.ZIGZAG
        grown = counts["growth"] >= 0 or counts["diverged"] >= 0
        return Status.STEP_TOO_LARGE if grown else None

    def stats(self) -> dict[str, Any]:
        """Return counts and errors for the `stats` of the solution."""
        return {
            "n_steps": self.n,
            "n_rhs": int(self._march.counts["rhs"]),
            "n_factorised": int(self._march.counts["factorised"]),
            "n_modes": self.memory.n_modes,
            "history_bytes": self.memory.nbytes,
            "kernel_error": self.memory.kernel_errors.reported,
        }

    def checkpoint(self) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """Return copies of the march's state and its memory."""
        return tuple(plain(part).copy() for part in self._march), self.memory.state()

    def come_back(self, checkpoint: tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]) -> None:
        """Return the march to the step at which `checkpoint` was taken."""
        (counts, *parts), memory = checkpoint
        march = March(record(MARCH_COUNTS, tuple(counts[0])), *(part.copy() for part in parts))
        monitor = records([tuple(row) for row in march.monitor], MONITOR)
        newton = self._newton.taken_over(march)
        self._march = march._replace(newton=newton, monitor=monitor)
        self._read_step()
        self.memory.restore(memory)
        self._error, self._status = None, RUNNING
        self._refactorise()

    def _refactorise(self) -> None:
        """Factorise the matrix of a restored march again, if its factors are in use."""
        if self._march.counts["kept"]:
            solver, tables = self._newton.solver, self._newton.tables
            workspace = np.empty(tables.order.size)
            solver(FACTORISE, 0, self._march.newton[1], workspace, by_reference(tables, LINEAR))

    def stop_at(self, t: float) -> Stop:
        """Return the first step n with t_n >= t, and t_n, as a `Stop`."""
        # the user's times count from `start`, whose rounding errors do not make a step later
        step = self.steps.first_from(t - ONE_TIME * abs(self.system.frame.start))
        return Stop(step, self.steps.time(step))

    def state(self) -> State:
        """Return a `State`; a run resumed from it gives the same floats as an unbroken run."""
        steps: Any = replace(self.steps.until(self.n), span=self._span)  # type: ignore[arg-type]
        return state_of(self, self.scheme, steps, self.history)

    def restore(self, state: State, allow_change: bool = False) -> None:
        """Go on from `state`; `allow_change` admits a right-hand side other than the state's."""
        changed = check_identity(state.identity, self.identity(state.t), allow_change)
        self.come_back(state.checkpoint)
        if changed:
            self._march.counts["kept"] = 0
            self._forget_explicit()

    def identity(self, t: float) -> dict[str, Any]:
        """Return a description of a run to time t, which a run that resumes it must match."""
        scheme, history = described(self.scheme), described(self.history)
        return identity(self.system, t, scheme=scheme, history=history)

    @property
    def n_data(self) -> int:
        """Number of initial data: d values of y, and one of y' for each order above 1."""
        return self.system.n_solved + self._with_speed.size

    @property
    def tangent(self) -> np.ndarray:
        """The k tangents, shape (n_data, k): derivatives of y, then of y' for orders above 1."""
        d = self._marched.d
        values, slopes = (
            columns[d:].reshape(self.n_tangents, d).T for columns in (self._march.x, self._slopes())
        )
        return np.vstack([values[: self.system.n_solved], slopes[self._with_speed]])

    def transform_tangent(self, matrix: np.ndarray) -> None:
        """Replace the tangents by linear combinations, ``tangent <- tangent @ matrix``."""
        # matrix (k, k). All that is linear in tangents is combined too, as if the march had started
        # from combined directions.
        matrix = np.ascontiguousarray(matrix, dtype=float)
        arrays, d = self.memory.arrays, self._marched.d
        transform_march(self._march, arrays, d, int(self._lasting), matrix)

    def grow(self, stop: float, schedule: Any) -> Grown:
        """Advance, orthonormalise tangents by the `schedule`; return rows and log growth."""
        schedule["lasting"] = self._lasting
        grown, march = [np.empty((0, 1 + self.n_tangents))], self._loop
        growth = Renormalisations(
            march=loop_value(march, MARCH_SIG),
            schedule=schedule,
            above=self._with_speed.astype(np.int64),
            columns=np.empty((self.n_data, self.n_tangents)),
            inverse=np.empty((self.n_tangents, self.n_tangents)),
            grown=grown[0],
        )
        self._loop = partial(_renormalising, growth, grown)
        try:
            piece = self.advance(stop)
        finally:
            self._loop = march
        return Grown(piece, np.vstack(grown), self._status == LOST)

    def linear_arrays(self) -> list[Any]:
        """Return the arrays of march and memory that are linear in the solution, not copies."""
        march = self._march
        others = march.counts, march.monitor, march.newton, march.row_factors
        left_out = {id(part) for part in others}
        return [*(part for part in march if id(part) not in left_out), *self.memory.arrays]

    @property
    def uncertainty(self) -> np.ndarray:
        """Estimated rounding errors of y, (d,)."""
        return _ROUNDING_OF_Y * np.abs(self.y)

    def expect_jumps(self, of_y: bool) -> None:
        """Prepare for jumps of f, and of y if `of_y`: make fewer steps in each call."""
        # jumps of y are refused if a term acts on y itself
        self._most = _MAX_STEPS_WITH_EVENTS
        acting = [op for op, _ in self.system.left if not op.definition.subtracts_start]
        if of_y and acting:
            required = f"change no y that {acting[0]} acts on, on given steps"
            refuse("events and changes", required, "a change of y")

    def set_y(self, y: np.ndarray) -> None:
        """Set y to these values, (d,), at the present time; the memory does not see the jump."""
        self._march.x[: self.system.n_solved], self._jumped = y, True
        self._forget_explicit()
        self._renew_force()

    def _renew_force(self) -> None:
        """Replace the newest piece by f after a jump of y, if the pieces are values of f."""
        # Only components of order 1; the step before the jump stays. If f raises, nothing is
        # changed, because the march calls f again and reports the exception.
        table, march, system = self._table, self._march, self._marched
        n, newest = table.n_orbit, self.n - 1
        if table.integral == 0 or newest < 0:
            return
        march.counts["rhs"] += 1
        try:
            f = system.rhs(self.t, march.x[:n])
        except Exception:
            return
        own = table.sources[:n] == np.arange(n)  # False for memory that f reads: no pieces of f
        p, first_order = newest % march.lag.shape[1], own & (system.highest_orders()[:n] == 1)
        jump = np.where(first_order, f - march.pieces[:n, p + 1], 0.0)
        march.pieces[:n, p + 1] += jump
        march.last_f[:n] = np.where(first_order, f, march.last_f[:n])
        ahead = march.lag[:n, p + 2 :]
        ahead += table.weights[table.groups[:n], 2 : 2 + ahead.shape[1]] * jump[:, None]

    def _forget_explicit(self) -> None:
        """Keep the next IMEX step from extrapolating f across a jump (given/imex_step.py)."""
        self._march.counts["extrapolates"] = 0

    def set_side(self, number: int, sign: float, center: float = 0.0, width: float = 0.0) -> None:
        """Evaluate f on the side `sign` of a switch; f may jump."""
        self._marched.functions.switches.signs[number] = sign


@lru_cache(maxsize=_PLANS_MAX)
def _kept_plan(
    scheme: Scheme, h: float, order: float, terms: Any, shape: Any, y0: bytes, sources: bytes
) -> Plan:
    """Return the plan of a scheme for uniform steps h, from the terms and initial values alone."""
    # the arguments are the key: y0 and sources are the bytes of the fields of a `System`
    left = [SystemTerm(operator, np.array(coefficients)) for operator, coefficients in terms]
    start, own = np.frombuffer(y0).reshape(shape), np.frombuffer(sources, np.int64)
    system = System(left, start, sources=own)
    return with_initial_values(scheme.plan(system, h), system, order)


def _renormalising(
    growth: Renormalisations, grown: list[np.ndarray], march: GivenMarch, end: int
) -> int:
    """Call `grow` in place of the march, and append its logarithms of growth to `grown`."""
    rows = np.empty((end - march.work.output.first, 1 + growth.columns.shape[1]))
    try:
        return grow(march, growth._replace(grown=rows), end)
    finally:
        grown.append(rows[: growth.schedule["made"]])
