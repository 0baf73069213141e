"""Adaptive stepper: the march of an equation by collocation, and the limits of its steps.

Letters of shapes: d components, s nodes of a step, k tangents, n_q integrands (f, p and y, and p'
if an equation needs it). The primary unknown p is y, or y' for orders above 1.
"""

from __future__ import annotations

import copy
import math
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np

from ..compiled.delayed_values import Delays, next_end, within_delays
from ..compiled.jacobian import LEAST, VALUES
from ..compiled.jit import checked
from ..compiled.reach import NOISE, SMALL, YOUNG
from ..compiled.records import plain, zeros
from ..equation.system import System, refuse_late, with_pieces
from ..functions.differences import wrong_jacobian
from ..kernels.memory_kernel import warn_of_fit
from ..stepping.dense import Piece
from ..stepping.state import State, check_identity, identity, state_of
from ..stepping.status import Ending, Status, failed
from ..stepping.stepper import Diagnostics, JumpingStepper, ResumableStepper, TangentStepper
from ..stepping.times import breaks_ahead, together
from ..stepping.tolerance import Tolerance
from ..support.checks import refuse
from .algebraic import became_singular, settle_tangents, settled
from .edge import edge_at
from .endings import (
    NO_SLOPE_AT_START,
    OUTSIDE,
    ROUGH_TABLE,
    SINGULAR_ROWS,
    TOO_STEEP,
    UNSOLVED,
    after_steps,
    ending,
    leaves_domain,
    of_near_orders,
    of_rounded_rows,
    of_small_component,
)
from .equations import integral_form
from .first_rule import Variable, convolutions, first_rule, known_at_nodes, node_logs
from .jumps import jacobian_beside_jump, jump
from .march import (
    CRAWLING,
    CROSSED,
    FOUND,
    FULL,
    JUMPING,
    ORDERS_NEEDED,
    REACHED,
    TOO_CLOSE,
    TOO_ROUGH,
    jacobian_at_start,
    march_adaptive,
    march_of,
)
from .members import MemberRun, Members
from .method import Collocation
from .mode_tables import N_TABLE_LENGTHS, floor_to_grid, spare_tables
from .modes import closest_lag
from .operators import FORCE, PRIMARY
from .orbit import OrbitAndTangents, initial_unknowns
from .pieces import FirstPiece, PolynomialPieces
from .quadrature import rule_of
from .reading import Plain, Reading, is_read
from .singular_start import VANISHING, is_usual, order_of, trials
from .stage_solver import StageSolver, has_stages, stage_solver
from .step_limits import Progress, limits_of
from .structures import (
    AT_EDGE,
    AdaptiveMarch,
    AdaptiveWork,
    ExponentialBasis,
    FirstJacobian,
    Limits,
    OrbitArrays,
    Rule,
    Steps,
    StepTables,
    initial_state,
    restored_state,
)
from .tolerances import STEP_FRACTION, of_first_step, of_modes, undamped
from .varying import OrderTables
from .workspace import Workspace, give_back, take_workspace

# Longest first step of a solution at rest, as a fraction of the longest step at rest: the nodes of
# first steps are further apart.
_FIRST_AT_REST = 1 / 16


# Latest time up to which a run may be resumed, as multiple of the first run's length.
_REACH = 10.0
# Largest ratio of the farthest to the closest distance of the modes.
_LARGEST_RATIO = 1e305
# Largest number of steps before an early end whose reason may be the memory of a table: its first
# steps are as short as rounding allows.
_STEPS_AT_START = 3
# Distance from a kink, over its time, at which rounding may end a run.
_NEXT_TO_KINK = 1e-9
# Distance from the start, over the run, at which an infinite derivative may end a run.
_NEXT_TO_START = 1e-20
# Tolerance at which rows whose rounding is known complete, over this rounding.
_OVER_ROUNDING = 20.0
# Largest number of steps in one call of the compiled march.
_MAX_STEPS_PER_MARCH = 256
# Closest distance of fits that are made before the run begins, as a fraction of the run.
_MIN_FIRST_FIT_DISTANCE = 1e-6
# Time within which f jumps three times by y if the solution slides, as fraction of the time.
_PILED = 1e-9
# Number of jumps within a short time, as fraction of the run, from which f is noise.
_CROWD = 60
_CROWDED = 1e-6
# Unit of rounding of a component that no rejected step has shown to be rounding, as a part of the
# unit of one that is.
_UNTOLD = 0.05
# Most steps of one call of the compiled march if an event may cut it short.
_MAX_STEPS_BEFORE_EVENTS = 8


class AdaptiveStepper(ResumableStepper, TangentStepper, JumpingStepper):
    """March of one equation by collocation; it chooses its steps to keep the tolerance."""

    on_given_steps = False
    t = 0.0
    _error: Exception | None = None
    _ending: Ending | None

    def __init__(
        self,
        system: System,
        scheme: Collocation,
        t_end: float,
        tolerance: Tolerance,
        directions: np.ndarray | None = None,
    ) -> None:
        # t_end: modes are accurate to ten times that, or to the scheme's horizon. directions
        # (n_data, k) of initial data: each has a tangent, whose error limits the steps as well.
        # found: times at which the right-hand side jumps and nobody said so.
        scheme.check_terms(system)
        self.system, self._scheme, self._breaks = system, scheme, np.zeros(0)
        self.found: list[float] = []
        self._crossed = False  # whether the march is just beyond a jump by y
        self._view = view = (Reading if is_read(system) else Plain)(system)
        marched = view.system
        refuse_late(system, t_end)
        self._t_end, self._rows = t_end, _MAX_STEPS_PER_MARCH
        self.tolerance = tolerance._replace(modes=of_modes(tolerance))
        self._of_run = self.tolerance.of_march(marched, system.frame)
        self._of_step = checked(self._of_run.times(STEP_FRACTION))
        self._known = known = max(t_end, scheme.horizon or 0.0)
        self._farthest = max(min(_REACH * t_end, 1e307), known)
        s = self._s = int(scheme.nodes)
        self._form = form = integral_form(marched)
        self._marched = marched = marched if has_stages(form) else marched.dense()
        self._stages = stage_solver(marched.structure, form, s) if has_stages(form) else None
        self._rule = rule_of(s, form.powers)
        self._graded = form.begins_graded
        self._orders = OrderTables(form.varying, s)
        y0 = initial_unknowns(marched, form.above_one == 1, view.directions(directions))
        settle_tangents(system, y0)
        self._orbit = OrbitAndTangents(form, y0, s)
        self._state = initial_state(t_end, *np.abs([self._orbit.p[0], self._orbit.x[0]]))
        self._control = self._state.control  # a record `CONTROL`
        self._read_progress()
        self._at_singular_start, self._largest_error, self._kept = True, 0.0, 1
        self._peak = np.zeros((2, marched.d))  # largest |p| and |y| at starts of steps
        self._moved = np.zeros(marched.d)  # sum of |changes of y|
        self._last_way = np.zeros(marched.d)  # change of y over the last jump by y
        self._ending = None
        self._limit_steps(t_end)
        self._prefit_kernels(t_end)
        self._bounds = t_end, self._least

    def _limit_steps(self, t_end: float) -> None:
        """Set the longest step and the largest number of steps from the present time to t_end."""
        self._progress = Progress(self.n_steps + self.tolerance.max_steps)
        in_python = bool(self._marched.callbacks)
        self._of_march = limits_of(self._of_step, self.t, t_end, in_python)
        longest = floor_to_grid(self._of_march.longest)
        self._control["next"] = min(self._control["next"], longest)

    # progress of the march
    form = property(attrgetter("_form"))
    position = property(attrgetter("t"))

    def _read_progress(self) -> None:
        """Set `t` and `n_steps` to what the march has reached; records are slow to read."""
        control = self._state.control
        self.t = float(control["origin"] + control["time"])
        self.n_steps = int(self._state.counts["accepted"])

    @property
    def n_modes(self) -> int:
        """Number of exponential modes with which the memory of each component is computed."""
        return self._orbit.of_varying.size

    def _steps(self, t_stop: float) -> FirstPiece | PolynomialPieces | None:
        """March towards `t_stop` by a limited number of steps; return dense output or None."""
        n_rows = min(self._rows, self._progress.last_step - self.n_steps)
        if n_rows == 0:
            return None
        if self._at_singular_start:
            self._settle()
            if not self._graded:
                return self._singular_step(t_stop)
            self._begin_graded(t_stop)
            if self._ending:
                return None
        d, s, counts = self._marched.d, self._s, self._state.counts
        steps = zeros(Steps, n=n_rows, D=self._kept * d, s=s)
        n, status, before, origin = 0, TOO_CLOSE, (self.t, counts.copy()), self._control["origin"]
        limits = self._limits(t_stop)
        while (status == TOO_CLOSE and n == 0) or status == ORDERS_NEEDED:
            first = self.n_steps
            try:
                if status == ORDERS_NEEDED:
                    self._orders.fill(self._orbit, origin, limits)
                status = self._march_on(Steps(*[array[n:] for array in steps]), limits)
            except Exception as error:
                # the steps before the exception are accepted
                self._error, status = error, REACHED
            if self.n_steps > first:
                self._orbit.record_step(float(self._control["last"]), float(self._control["time"]))
            n += self.n_steps - first
            if status == TOO_CLOSE:
                # the march returned before the step that lacks closer modes
                h = min(float(self._control["next"]), t_stop - self.t)
                closest = closest_lag(self._rule, self._within_delays(h))
                if closest < self._farthest / _LARGEST_RATIO:
                    status = TOO_ROUGH
                else:
                    self._refine_modes(closest)
        if status == REACHED and self._error is None:
            self._set_origin(t_stop)
        if status in (FOUND, CROSSED):
            status = self._note_jump(status)
        at_starts = steps.at_starts[:n, :, :d]  # y of the orbit, then p
        if status in (FULL, TOO_CLOSE) and self._progress.is_stalled(
            *before, self.t, counts, t_stop, at_starts, self._still_sizes()
        ):
            status = CRAWLING
        self._peak = np.maximum(self._peak, np.abs(at_starts).max(axis=0, initial=0.0)[::-1])
        if self.n_steps > _MAX_STEPS_PER_MARCH:  # over fewer steps errors of modes hardly add up
            self._moved += np.abs(np.diff(at_starts[:, 0], axis=0)).sum(axis=0)
        if status not in (REACHED, FULL, TOO_CLOSE, FOUND, CROSSED):
            lengths, last = (self._control["last"], self._control["next"]), self._orbit.last[0]
            is_noise = self._state.sizes <= NOISE * self._noise
            self._ending = ending(
                status, self._marched, self.t, *lengths, last, self._peak, is_noise
            )
            if became_singular(self.system, self.t, self._view.seen(self._orbit.x[0])):
                self._ending = SINGULAR_ROWS
        if n == 0:
            return None
        *piece, errors = [array[:n] for array in steps]
        self._largest_error = max(self._largest_error, float(errors.max()))
        return PolynomialPieces(self._above_one, *piece)

    def _note_jump(self, status: int) -> int:
        """Let the march restart at a jump of f that it found; return the status to go on with."""
        # a jump by y is just ahead: the march restarts beyond it
        t = float(self._control["jump"])
        if status == CROSSED and self._form.solves_slopes:
            return JUMPING
        if status == FOUND and t in self._breaks:
            return JUMPING
        if len(self.found) > _CROWD and t - self.found[-_CROWD] < _CROWDED * self._t_end:
            return JUMPING
        self.found.append(t)
        if status == FOUND:
            same = together(self._breaks, t, self.system.frame.start)  # rounded otherwise by f
            self._breaks = np.union1d(self._breaks[~same], t)
            if together(np.array(t), self.t, self.system.frame.start):  # the march is there
                self._set_origin(t)
                self._at_singular_start = True
            return status
        way, before = self._beyond - self._orbit.x[0], self._last_way
        piled = len(self.found) > 2 and self.t - self.found[-3] <= _PILED * self.t
        if piled and not way @ before < 0:
            return JUMPING
        self._orbit.shift(way)
        self._at_singular_start, self._crossed, self._last_way = True, True, way
        if piled:  # both sides push back
            self._ending = Ending(Status.SLIDING)
        return status

    @property
    def _sizes(self) -> np.ndarray:
        """Sizes of the components, (d,): the largest |y| so far, or a part of their reach."""
        state = self._state
        return np.maximum(state.sizes, SMALL * np.minimum(state.reach, state.growth))

    @property
    def _noise(self) -> np.ndarray:
        """Units of rounding of components, (d,), for comparison with sizes."""
        state = self._state
        found = np.where(state.noisy == 1, 1.0, _UNTOLD) * state.scales
        return np.where(np.isinf(state.growth), YOUNG / NOISE * state.reach, found)

    def _still_sizes(self) -> np.ndarray:
        """Return the sizes of y, and of the unknown p, that tolerances refer to, (2, d)."""
        sizes = self._of_step.sizes_of(self._sizes)
        return np.array([sizes, np.where(self._form.above_one == 1, 0.0, sizes)])

    def _set_origin(self, t: float, since: float = 0.0) -> None:
        """Count time from t, so that rounding does not hide short steps next to a start."""
        self._control["time"], self._control["origin"] = since, t
        self.t = float(t + since)
        self._orders.clear()

    def _within_delays(self, h: float) -> float:
        """Return h, or less if delayed values are known or smooth in a shorter step only."""
        pieces, t = self._marched.functions.delays, self.t
        return float(within_delays(pieces, t, min(h, next_end(pieces, t) - t)))

    def _limits(self, t_stop: float) -> Limits:
        """Return the `Limits` of a march from the origin to `t_stop`."""
        beside, origin = self._marched.beside, self._control["origin"]
        earliest, latest = beside(origin, 1), beside(t_stop, -1)
        return self._of_march._replace(stop=t_stop, earliest=earliest, latest=latest)

    def _march_on(self, steps: Steps, limits: Limits) -> int:
        """March by ordinary steps in compiled code, filling `steps`; return the status code."""
        orbit, s = self._orbit, self._s
        sums, arrays = orbit.sums, orbit.march_arrays()
        sizes = {"K": N_TABLE_LENGTHS, "M": sums.of_varying.size, "s": s, "n_k": sums.masses.size}
        taken = spare_tables.acquire(sums.key, lambda: checked(zeros(StepTables, **sizes)))
        try:
            return self._march(
                self._marched, steps, limits, self._rule, sums.basis, taken[1], arrays, self._stages
            )
        finally:
            spare_tables.release(taken)

    def _march(
        self,
        marched: System,
        steps: Steps,
        limits: Limits,
        rule: Rule,
        basis: ExponentialBasis,
        tables: StepTables,
        arrays: OrbitArrays,
        solver: StageSolver | None,
    ) -> int:
        """March a system by any rule in compiled code, filling `steps`; return the status code."""
        # solver None: one that has no factors yet is taken
        offsets = self._orbit.equations(marched, *self._bounds)[1]
        taken = take_workspace(self._form, arrays.modes, arrays.last.shape[3], offsets, solver)
        march = self._marching(marched, steps, limits, rule, basis, tables, arrays, taken[1])
        try:
            _, status = march_adaptive(march)
            if status == CROSSED:
                self._beyond = taken[1].workspace.point.copy()
            return status
        finally:
            self._read_progress()
            give_back(taken)

    def _marching(
        self, marched: System, steps: Steps, limits: Limits, rule: Rule, basis: ExponentialBasis,
        tables: StepTables, arrays: OrbitArrays, taken: Workspace,
    ) -> AdaptiveMarch:  # fmt: skip
        """Return the arguments of the compiled march, from those of `_march` and a workspace."""
        own, operators, weights, workspace = taken
        equations, _ = self._orbit.equations(marched, *self._bounds)
        varying = self._orders.compiled(self._orbit.of_varying)
        return march_of(AdaptiveWork(
            marched.compiled, equations, rule, basis, tables, varying, arrays,
            self._state, steps, limits, own.solver, own.stages, operators, weights, workspace,
        ))  # fmt: skip

    def _go_on_from(self, kept: tuple[np.ndarray, ...], orbit: OrbitAndTangents) -> None:
        """Continue from the stored state and orbit of a march."""
        self._state, self._orbit = restored_state(kept), orbit
        self._control = self._state.control
        self._read_progress()
        self._orbit.adopt(self._form)
        self._orders.clear()
        self._ending, self._error = None, None

    def members(self, run: MemberRun) -> Members | None:
        """Return what marches members of an ensemble, or None if each needs a stepper."""
        form, system, orbit, t_end = self._form, self._marched, self._orbit, self._t_end
        if is_read(system) or self._stages or system.structure is not None or not is_usual(form):
            return None
        limits, units = self._limits(t_end), np.empty(system.d)
        equations, _ = orbit.equations(system, *self._bounds)
        parts = system.compiled, equations, limits, 0.0, orbit.x[0], self._state, units
        return Members(
            form, orbit, self._rule, FirstJacobian(*parts), run,
            (self._farthest, self._known, self.tolerance.modes), _MAX_STEPS_PER_MARCH,
            partial(self._marching, system),
            leading=np.abs(system.leading),
            has_jac=int(system.has_jac),
            order=order_of(form),
            longest=min(t_end / 16, limits.longest),
            least=self._farthest / _LARGEST_RATIO,
            at_rest=_FIRST_AT_REST * limits.longest_idle,
        )  # fmt: skip

    def _settle(self) -> None:
        """Solve the algebraic rows at the present time for their unknowns."""
        if self.t > 0 and self.system.algebraic.any():
            x = self._view.seen(self._orbit.x[0])
            found = settled(self.system, self.system.beside(self.t, 1), x)
            self._orbit.shift(self._view.widened(found - x))

    def _singular_step(self, t_stop: float) -> FirstPiece | None:
        """Make the first step after a singular start; return its dense output, None if all fail."""
        # `_ending` then has the reason
        orbit, form, t, left = self._orbit, self._form, self.t, t_stop - self.t
        self._set_origin(t)
        of_run, jacobian, units = self._at_start(t_stop)
        longest, idle = self._of_march.longest, self._of_march.longest_idle
        least = self._farthest / _LARGEST_RATIO
        self._ending, at_rest = TOO_STEEP, _FIRST_AT_REST * idle
        of_first = jacobian, units, self._state.reach.copy()
        for trial in trials(self._marched, form, orbit, t, left, longest, least, *of_first):
            h, variable, sizes = trial.length, trial.variable, self._state.sizes.copy()
            # the last two steps are equal, so that no tiny step remains before the stop
            h = self._within_delays(min(h, 0.5 * left) if h < left else h)
            steps, values = self._try_step(h, variable, of_run, trial.at_edge)
            if values is not None and h > at_rest:
                f, p = values[0, FORCE], values[0, PRIMARY]  # at the nodes, (d, s)
                if not f.any() and not np.ptp(p, axis=1).any():
                    continue
            if values is not None:
                self._largest_error = max(self._largest_error, float(steps.errors[0]))
                self._ending, self._crossed = None, False
                self._finish_singular_start(h, variable, values, t_stop)
                start = variable, t, h, steps.p[0], *steps.at_starts[0]
                return FirstPiece(self._above_one, *start)
            if trial.at_edge:  # a longer step may have let y grow by decades
                self._state.sizes[:] = sizes
            # when Newton's method fails, the next step is a quarter of the last
            self._ending = UNSOLVED if self._control["next"] == 0.25 * h else TOO_STEEP
        speed = np.where(form.above_one == 1, orbit.p[0], self._marched.rhs(t, orbit.x[0]))
        if leaves_domain(self._marched, t, orbit.x[0], left * speed):
            self._ending = OUTSIDE
        elif self._ending is TOO_STEEP and not form.kernels and form.generators[0] < VANISHING:
            self._ending = of_near_orders(form.generators[0])
        return None

    def _at_start(self, t_stop: float) -> tuple[Limits, Any, np.ndarray]:
        """Return `Limits` of a first step, the Jacobian of f there, and units of differences."""
        system, orbit, structure = self._marched, self._orbit, self._marched.structure
        equations, _ = orbit.equations(system, *self._bounds)
        limits, units, t = self._limits(t_stop), np.empty(system.d), self.t
        self._state.counts["rhs"] += 1
        out = np.empty((system.d, system.d)) if structure is None else structure.entries.copy()
        start = FirstJacobian(
            right=system.compiled,
            equations=equations,
            limits=limits,
            t=system.beside(t, 1) if t > 0 else 0.0,
            x=orbit.x[0],
            state=self._state,
            units=units,
        )
        jacobian_at_start(start, out)
        if self._crossed and structure is None and not system.has_jac:
            out = jacobian_beside_jump(system, start.t, start.x, units)
            self._state.counts["rhs"] += 2 * system.d + 1
        return limits, out if structure is None else structure.matrix(out[VALUES]), units

    def _try_step(
        self, h: float, variable: Variable, limits: Limits, at_edge: bool
    ) -> tuple[Steps, np.ndarray | None]:
        """Try a first step of length h, with polynomials in the variable u of `variable`."""
        # the compiled march tries it, with the history at the nodes in place of modes
        orbit, form, n = self._orbit, self._form, variable.n
        rule = first_rule(variable, form.powers)
        history = orbit.history(math.log(h) + node_logs(variable))
        n_kernels, d = len(form.kernels), self._marched.d
        basis, tables = known_at_nodes(n, form.orders.size + n_kernels, n_kernels)
        tables = tables._replace(lengths=np.array([h]))
        if n_kernels:
            kernels = [orbit.kernel(k) for k in range(n_kernels)]
            local = np.array([convolutions(variable, kernel, h) for kernel in kernels])
            tables = tables._replace(local=local[None])
        values = np.zeros((orbit.x.shape[0], 3, d, n))
        before = np.zeros(history.shape)
        arrays = OrbitArrays(orbit.initial, orbit.x, orbit.p, history, before, values)
        self._begin_steps(h, h, begins=True)
        steps = zeros(Steps, n=1, D=self._kept * d, s=n)
        marched, solver = self._marched, None
        if at_edge or has_stages(form):
            marched = marched.dense() if at_edge else marched
            solver = stage_solver(marched.structure, form, n, at_edge)
            solver.stages.control[AT_EDGE] = float(at_edge)
        limits = limits._replace(tolerance=of_first_step(self._of_step, variable.q))
        status = self._march(marched, steps, limits, rule, basis, tables, arrays, solver)
        return steps, values if status in (FULL, REACHED) else None

    def _finish_singular_start(
        self, h: float, variable: Variable, values: np.ndarray, t_stop: float
    ) -> None:
        """Move to the end of the first step after a singular start, and begin ordinary steps."""
        orbit, closest, t = self._orbit, closest_lag(self._rule, h), self.t
        if self.n_modes == 0:
            orbit.open_modes(closest, self._farthest, self._known, self.tolerance.modes)
        elif closest < orbit.closest:
            orbit.refine(closest)
        orbit.finish_singular_start(variable, h, values)
        self._begin_steps(h, self._shortest)
        self._set_origin(*((t_stop,) if t == t_stop else (self._control["origin"], h)))
        self._at_singular_start = False

    def _begin_graded(self, t_stop: float) -> None:
        """Begin ordinary steps; the first is so short that the solution hardly changes."""
        self._set_origin(self.t)
        least = 1e5 * self._farthest / _LARGEST_RATIO
        h = self._form.graded_first_step(self.t, t_stop - self.t, self._of_step.least, least)
        closest = closest_lag(self._rule, h)
        self._at_start(t_stop)
        if self.n_modes == 0:
            self._orbit.open_modes(closest, self._farthest, self._known, self.tolerance.modes)
        if closest < self._orbit.closest:
            self._refine_modes(closest)
        # the right-hand side may jump here
        settled = jump(self._marched, self._form, self._orbit, self.t, self._state.counts)
        self._ending = None if settled else UNSOLVED
        self._state.largest[:] = np.where(self._form.above_one == 1, self._state.largest, 0.0)
        self._begin_steps(floor_to_grid(h), self._shortest, begins=True)
        self._at_singular_start = False

    def _begin_steps(self, h: float, shortest: float, begins: bool = False) -> None:
        """Set the length h of the next step, and whether components begin in it."""
        # steps below the length shortest need more modes
        control = self._control
        control["next"], control["last"], control["rejected"] = h, 0.0, 0.0
        control["shortest"], control["begins"] = shortest, float(begins)

    @property
    def _shortest(self) -> float:
        """Length of the shortest step for which the modes are accurate."""
        return self._orbit.closest / self._rule.nodes[0]

    def _prefit_kernels(self, t_end: float) -> None:
        """Fit kernels known by their values down to the shortest distance that steps may have."""
        closest = _MIN_FIRST_FIT_DISTANCE * t_end
        if self._form.solves_slopes and not self._form.varying:
            first = self._form.graded_first_step(0.0, t_end, self._of_step.least)
            closest = closest_lag(self._rule, first)
        reach = closest, self._farthest, self._known
        errors = self._orbit.prefit_kernels(*reach, self.tolerance.modes)
        warn_of_fit(errors.noise, self.tolerance.rtol)
        self._least = self._view.least(t_end, max(errors), self._of_step.by_size)

    def take_delays(self, delays: Delays) -> None:
        """Let f read delayed values from these pieces."""
        self.system = with_pieces(self.system, delays)
        self._marched = with_pieces(self._marched, delays)

    def note_reads(self, change: np.ndarray) -> None:
        """Note the change (d,) of f by delayed values: its rounding is at least that of this."""
        seen = self._view.widened(np.where(np.isfinite(change), change, 0.0))
        np.maximum(self._state.reads, seen, out=self._state.reads)

    def _refine_modes(self, closest: float) -> None:
        """Refine the modes so that they are accurate from the time lag `closest` on."""
        self._orbit.refine(closest)
        self._control["shortest"] = self._shortest

    @property
    def y(self) -> np.ndarray:
        """Solution at the present time `t`, shape (d,); a copy."""
        return self._view.values(self._orbit.x[0], self._orbit.p[0])[0]

    @property
    def uncertainty(self) -> np.ndarray:
        """Errors of y that the tolerance allows at the present time, (d,)."""
        errors = self._of_run.at(self._orbit.x[0], self._sizes)
        return self._view.values(errors, errors)[0]

    @property
    def sizes_and_noise(self) -> np.ndarray:
        """Largest |y| of each component since t = 0, and its unit of rounding, (2, d)."""
        found = np.array([self._state.sizes, self._noise])
        return self._view.values(found, found)[0]

    @property
    def ydot(self) -> np.ndarray:
        """First derivative at the present time `t`, shape (d,); NaN if y' is no unknown."""
        return self._view.values(self._orbit.x[0], self._orbit.p[0])[1]

    @property
    def tangent(self) -> np.ndarray:
        """Tangents, shape (n_data, k), a copy: derivatives of y, then of y' for orders above 1."""
        values, speeds = self._view.values(self._orbit.x[1:], self._orbit.p[1:])
        return np.vstack([values.T, speeds[:, self.system.above_one].T])

    @property
    def _above_one(self) -> np.ndarray:
        """True for components of orbit and kept tangents whose p is y'."""
        above_one = self._form.above_one == 1
        return above_one if self._kept == 1 else np.tile(above_one, self._kept)

    def keep_tangents(self) -> None:
        """Let dense output include the tangents: d components of each follow those of the orbit."""
        self._kept = self._orbit.x.shape[0]

    def transform_tangent(self, matrix: np.ndarray) -> None:
        """Replace the tangents and their history by ``tangent @ matrix``, matrix (k, k)."""
        self._orbit.transform(matrix)

    def advance(self, stop: float, keep: bool = True) -> Piece | None:
        """March towards time `stop` by a limited number of steps; return dense output or None."""
        # if the march cannot go on, or the right-hand side raised, `failure` has the reason
        ahead = self._breaks[self._breaks > self.t]
        t_stop = min(stop, ahead[0]) if ahead.size else stop
        try:
            piece = self._steps(t_stop)
        except Exception as error:
            self._error, piece = error, None
        if ahead.size and self.t == ahead[0]:
            self._at_singular_start = True
        return None if piece is None else self._view.piece(piece)

    @property
    def failure(self) -> Ending | None:
        """Reason why the march cannot go on, an `Ending`; None if it can."""
        if self._error is not None:
            return failed(self._error)
        ended = self._ending
        if ended is None and self.n_steps >= self._progress.last_step and self.t < self._t_end:
            ended = after_steps(self.n_steps)
        if ended is None:
            return None
        if ended.status is Status.BLOWN_UP and self.t >= _NEXT_TO_START * self._t_end:
            return ended
        if self.n_steps <= _STEPS_AT_START and self._reads_table:
            return ROUGH_TABLE
        if self._begins_at_edge:
            return NO_SLOPE_AT_START
        if (rounding := self._rounding_of_rows) > self._of_step.rtol:
            return of_rounded_rows(self.t + self.system.frame.start, _OVER_ROUNDING * rounding)
        found = [part for part in (ended.detail, self._small_component()) if part]
        ended = ended._replace(detail="; ".join(found))
        if not self._marched.has_jac:
            return ended
        wrong = wrong_jacobian(
            self._marched.functions, self._orbit.x[0], self._marched.structure, self.t
        )
        return ended._replace(detail=wrong or ended.detail)

    @property
    def _reads_table(self) -> bool:
        """Whether f reads the memory of a measured kernel."""
        return is_read(self.system) and any(kernel.measured for kernel in self._form.kernels)

    @property
    def _begins_at_edge(self) -> bool:
        """Whether f has no derivative at y(0), and the march is next to it."""
        system, start = self._marched, self._orbit.initial[0]
        reached = np.full(system.d, np.inf)  # its slopes are unknown
        return self.t < _NEXT_TO_START * self._t_end and edge_at(
            system.compiled, 0.0, start, system.units(), reached
        )

    @property
    def _rounding_of_rows(self) -> float:
        """Change of algebraic rows within the rounding of a kink next to the present time, or 0."""
        # as a fraction of their change over as long a time as that to the kink
        kink = self._control["origin"]
        if not (kink > 0 and self._form.algebraic.any() and self.t - kink < _NEXT_TO_KINK * kink):
            return 0.0
        rounding = self.system.beside(kink, 1) / kink - 1
        return float(rounding ** self._form.generators[0])

    def _small_component(self) -> str:
        """Return a clause on the component with the largest error, if it may be rounding."""
        c = int(self._control["worst"])
        if self._of_step.by_size == 0 or self._state.sizes[c] >= self._sizes[c]:
            return ""
        return of_small_component(self._marched.of_y[c] // (2 if self.system.frame.paired else 1))

    @property
    def diagnostics(self) -> Diagnostics:
        """Misfit of the kernels to the tolerance."""
        # memory that f reads has the tolerance of a step, because its errors add up: in renewal
        # equations over 8 to 30 generations y errs by up to 11 errors of the kernel
        allowed = self._of_step if is_read(self.system) else self._of_run
        misfit = self._orbit.kernels.errors.misfit(allowed.rtol)
        return Diagnostics(misfit=misfit)

    def set_breaks(self, times: np.ndarray, t_end: float) -> None:
        """Set the times at which the march makes a singular start, because f may jump there."""
        times = np.union1d(times, self.found) if self.found else times
        at_once, self._breaks = breaks_ahead(times, self.t, t_end, self.system.frame.start)
        self._at_singular_start |= at_once

    def stats(self) -> dict[str, Any]:
        """Return the counts and error estimates that `Solution.stats` has."""
        return {
            "n_steps": self.n_steps,
            "n_rejected": int(self._state.counts["rejected"]),
            "n_rhs": int(self._state.counts["rhs"]),
            "n_modes": self.n_modes,
            "history_bytes": self._orbit.modes.nbytes,
            "kernel_error": self._orbit.kernels.errors.reported,
            "error_estimate": self._error_estimate(),
            "jumps": [t + self.system.frame.start for t in sorted(self.found)],
        }

    def _error_estimate(self) -> float:
        """Return the largest error of a step, plus the errors that add up without damping."""
        estimate = max(self._largest_error, STEP_FRACTION) * self.tolerance.rtol
        if self.n_steps <= _MAX_STEPS_PER_MARCH:
            return estimate
        moved = np.max(self._moved / np.maximum(self._sizes, LEAST))
        return undamped(estimate, self._orbit.power_laws.error, moved, self.n_steps)

    def state(self) -> State:
        """Return a `State` from which a later run can continue."""
        return state_of(self, self._scheme, self.tolerance)

    def restore(self, state: State, allow_change: bool = False) -> None:
        """Continue from `state`; `allow_change` admits a changed right-hand side or parameters."""
        changed = check_identity(state.identity, self.identity(state.t), allow_change)
        reach = state.checkpoint[1].farthest
        refuse_late(self.system, self._t_end)
        if reach and self._t_end > reach:
            required = f"stay within t = {reach}, the end of its history"
            remedy = f"begin the run with Collocation(horizon={self._t_end}), or with the end of"
            refuse("resume", required, f"a run to {self._t_end}", f"{remedy} later runs")
        self.come_back(state.checkpoint)
        self._at_singular_start |= changed
        self._limit_steps(self._t_end)

    def checkpoint(self) -> tuple[tuple[np.ndarray, ...], OrbitAndTangents, bool]:
        """Return copies of everything that a step changes, for `come_back` and `state`."""
        kept = tuple(plain(part).copy() for part in self._state)
        return kept, copy.deepcopy(self._orbit), self._at_singular_start

    def come_back(self, checkpoint: tuple[tuple[np.ndarray, ...], OrbitAndTangents, bool]) -> None:
        """Return to the time at which `checkpoint` was taken."""
        kept, orbit, self._at_singular_start = checkpoint
        self._go_on_from(kept, copy.deepcopy(orbit))
        self.found = [t for t in self.found if t <= self.t]

    def expect_jumps(self, of_y: bool) -> None:
        """Prepare for jumps of f, and of y if `of_y`: make few steps at once, or refuse."""
        self._rows = _MAX_STEPS_BEFORE_EVENTS
        kinds, moving = "a change of y" if of_y else "a switch", "events, changes and switches"
        if self._form.solves_slopes:
            required = "change or switch nothing where a component's highest order varies or is a "
            refuse(moving, required + "kernel's", kinds)
        if of_y and self.system.frame.speeds and self.system.algebraic.any():
            required = "change no y where the matrix in front of a derivative has rows of zeros"
            refuse(moving, required, kinds, "state coefficients of shape (d,)")
        for operator, _ in self.system.left:
            if of_y and operator.derivative and not operator.definition.subtracts_start:
                required = f"change no y beside {operator}, which takes jumps for derivatives"
                refuse(moving, required, kinds)

    def limit_rows(self, most: int) -> None:
        """Let `advance` make at most so many steps, so that a run looks at its time more often."""
        self._rows = min(self._rows, most)

    def set_y(self, y: np.ndarray) -> None:
        """Let y jump to these values, (d,), at the present time; memory does not see the jump."""
        self._orbit.shift(self._view.widened(y - self.y))
        self._at_singular_start = True
        self._settle()

    def set_side(self, number: int, sign: float, center: float = 0.0, width: float = 0.0) -> None:
        """Evaluate f on the side `sign` of a switch, or as a blend, and begin anew as f jumps."""
        switches = self._marched.functions.switches
        switches.signs[number], switches.blends[number] = sign, (center, width)
        self._at_singular_start = True
        self._settle()

    def identity(self, t: float) -> dict[str, Any]:
        """Return the properties that a run to time t shares with a run that resumes it."""
        how = {"number of nodes": self._s, "tolerances": self.tolerance[:2]}
        return identity(self.system, t, **how)
