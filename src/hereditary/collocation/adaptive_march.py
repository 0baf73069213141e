"""March of a system by collocation steps as long as the tolerance allows."""

from __future__ import annotations

import numpy as np

from ..compiled.adaptive import (
    CRAWLING,
    FULL,
    MARCHES,
    ORDERS_NEEDED,
    REACHED,
    TOO_CLOSE,
    TOO_ROUGH,
)
from ..compiled.error_estimate import LEAST
from ..compiled.mode_tables import floor_to_grid
from ..compiled.structures import (
    ExponentialBasis,
    OrbitArrays,
    Steps,
    StepTables,
    empty_steps,
    initial_state,
    restored_state,
)
from ..kernels.memory_kernel import warn_of_fit
from .equations import integral_form
from .first_rule import convolutions, first_rule
from .jumps import jump
from .kept_tables import kept_tables
from .orbit import OrbitAndTangents, initial_values
from .order_tables import OrderTables
from .pace import TOO_STEEP, UNSOLVED, Ending, Pace, ending
from .pieces import FirstPiece, PolynomialPieces
from .quadrature import radau_nodes, rule_of, shortened_legendre
from .singular_start import trials
from .sizes import begins_at_rest, floors_of
from .stage_solver import has_stages, stage_solver

# Fraction of the tolerance that one step may err by, and fraction of that for the modes: errors add
# up along periodic and chaotic orbits (convergence/collocation.py).
STEP_FRACTION, _MODES_FRACTION = 0.1, 0.01
# Fraction of rtol that counts relative to the size of a component, where no atol is given.
OF_SIZE = 0.01
# Power q of the variable from which on errors are estimated too small, for u**q changes next to the
# end alone: the first step keeps to this over q of its tolerance, to the second at least, and to no
# less than this rtol, for rounding (orders 1 + 1e-9 to 1.003, y' at rtol 1e-4 to 1e-10).
_RESOLVED, _UNRESOLVED, _ROUNDING = 10.0, 5e-3, 5e-14
# Modes are fitted, and refined each time, for steps this many times shorter than the present one.
_REFINE_BY = 32.0
# Ratio of the time up to which a run may be resumed to its length; largest ratio of distances.
_REACH, _LARGEST_RATIO = 10.0, 1e305
# Steps of one call of the compiled march.
_ROWS = 256
# Closest distance expected, as fraction of the run, for fits before the run begins.
_CLOSE = 1e-6


class CollocationMarch:
    """Orbit and tangents of a system, and the steps that move them on.

    Parameters
    ----------
    system : System
    t_end : float
        End of the run.
    horizon : float
        Time that the modes hold for at least; they hold up to ten times the run.
    n_nodes : int
    tolerances : (float, float)
        rtol and atol; with None for atol errors are relative to the sizes of components.
    modes_tol : float, optional
        Relative error of the modes, where it is to be smaller than the tolerance requires.
    directions : ndarray, shape (n_data, k), optional
        Directions of initial data of the system, one tangent for each.
    pace : Pace
    """

    def __init__(
        self, system, t_end, horizon, n_nodes, tolerances, modes_tol, directions, pace: Pace
    ):
        self._system, self._tolerances = system, tolerances
        rtol, atol = tolerances
        self._t_end, self._allowed = t_end, allowed_errors(rtol, atol)
        default_tol = max(1e-14, min(1e-3, _MODES_FRACTION * self._allowed[0]))
        # larger errors of the modes would look like a rough solution, and no step would suffice
        self.modes_tol = default_tol if modes_tol is None else min(default_tol, modes_tol)
        self._known = known = max(t_end, horizon)
        self._farthest = max(min(_REACH * t_end, 1e307), known)
        s = self._s = n_nodes
        self._form = form = integral_form(system)
        if not has_stages(form):
            system = self._system = system.dense()
        self._stages = stage_solver(system.structure, form, s)
        self._rule = rule_of(s, tuple(form.orders.tolist()))
        self._graded = form.begins_graded
        self._orders = OrderTables(form.varying, s)
        self._transforms = shortened_legendre(s)
        self._orbit = OrbitAndTangents(
            form, initial_values(system, form.second == 1, directions), s
        )
        self._units = system.units if atol is None else np.ones(system.d)
        self._state = initial_state(t_end, *np.abs([self._orbit.p[0], self._orbit.x[0]]))
        self._at_singular_start, self._largest_error = True, 0.0
        self._peak = np.zeros((2, system.d))  # of p and y at the starts of steps
        self.ending = Ending()
        self.error: Exception | None = None
        self.pace, self._rows = pace, _ROWS
        self._limit_steps(t_end)
        self._prefit_kernels(t_end)

    def _limit_steps(self, t_end):
        """Set the longest steps and the last step of a run from here to t_end."""
        self.pace.begin(self.t, t_end, self.n_steps)
        self._control["next"] = min(self._control["next"], floor_to_grid(self.pace.longest[0]))

    @property
    def t(self):
        """Time reached."""
        return float(self._control["origin"] + self._control["time"])

    position = t  # how far the march is

    @property
    def n_steps(self):
        """Number of accepted steps."""
        return int(self._state.counts["accepted"])

    @property
    def n_rhs(self):
        """Number of calls of the right-hand side."""
        return int(self._state.counts["rhs"])

    @property
    def n_modes(self):
        """Number of exponentials whose sums carry the past of each component."""
        return self._orbit.rates.size

    def _steps(self, t_stop):
        """March towards `t_stop` by as many steps as one call makes; return their dense output."""
        n_rows = min(self._rows, self.pace.last_step - self.n_steps)
        if n_rows == 0:
            return None
        if self._at_singular_start:
            self._set_floors()
            if not self._graded:
                return self._singular_step(t_stop)
            self._begin_graded(t_stop)
            if self.ending.status is not None:
                return None
        d, s, counts = self._system.d, self._s, self._state.counts
        steps = empty_steps(n_rows, d, s)
        n, status, before, origin = 0, TOO_CLOSE, (self.t, counts.copy()), self._control["origin"]
        limits = self._limits(t_stop)
        while (status == TOO_CLOSE and n == 0) or status == ORDERS_NEEDED:
            first = self.n_steps
            try:
                if status == ORDERS_NEEDED:
                    self._orders.fill(self._orbit, origin, limits)
                status = self._march_on(Steps(*(array[n:] for array in steps)), limits)
            except Exception as error:
                # the steps before the failure are accepted
                self.error, status = error, REACHED
            if self.n_steps > first:
                self._orbit.record_step(float(self._control["last"]))
            n += self.n_steps - first
            if status == TOO_CLOSE:
                # the march returned before this step
                closest = self._closest(min(self._control["next"], t_stop - self.t))
                if closest < self._farthest / _LARGEST_RATIO:
                    status = TOO_ROUGH
                else:
                    self._refine_modes(closest)
        if status == REACHED and self.error is None:
            self._set_origin(t_stop)
        stretch = *before, self.t, counts, t_stop, steps.at_starts[:n], self._sizes()
        if status in (FULL, TOO_CLOSE) and self.pace.is_stalled(*stretch):
            status = CRAWLING
        at_starts = np.abs(steps.at_starts[:n]).max(axis=0, initial=0.0)  # y, then p
        self._peak = np.maximum(self._peak, at_starts[::-1])
        if status not in (REACHED, FULL, TOO_CLOSE):
            lengths, last = (self._control["last"], self._control["next"]), self._orbit.last[0]
            self.ending = ending(status, self._system, self.t, *lengths, last, self._peak)
        if n == 0:
            return None
        *piece, errors = (array[:n] for array in steps)
        self._largest_error = max(self._largest_error, float(errors.max()))
        return PolynomialPieces(*piece)

    def _sizes(self):
        """Return the sizes of y, and of p where it is y, to which the tolerance refers, (2, d)."""
        rtol, atol, by_size = self._allowed
        sizes = np.maximum(self._state.sizes, self._state.floors)
        sizes = sizes if by_size > 0 else np.full(sizes.size, atol / (OF_SIZE * rtol))
        return np.array([sizes, np.where(self._form.second == 1, 0.0, sizes)])

    def _set_origin(self, t, since=0.0):
        """Measure time from t, since rounding would hide steps next to a singular start."""
        self._control["time"], self._control["origin"] = since, t
        self._orders.clear()

    @property
    def _control(self):
        """Step control of the march, a record."""
        return self._state.control

    def _closest(self, h):
        """Return the distance down to which modes must hold for steps of length h and shorter."""
        return self._rule.nodes[0] * h / _REFINE_BY

    def _limits(self, t_stop):
        """Return the `Limits` of a march to a stop."""
        return self.pace.limits(self._system, self._control["origin"], t_stop, self._allowed)

    def _march_on(self, steps, limits):
        """March by ordinary steps; return the status."""
        orbit = self._orbit
        rates = orbit.rates.astype(complex)
        basis = ExponentialBasis(rates, orbit.gains, orbit.weights, orbit.masses, self._transforms)
        taken = _, tables = kept_tables.take(basis, self._s, len(self._form.varying))
        how = self._stages, self._rule, basis, tables, orbit.march_arrays()
        try:
            return self._march(steps, limits, *how)
        finally:
            kept_tables.give_back(taken)

    def _march(self, steps, limits, stages, rule, basis, tables, arrays):
        """March to a stop in compiled code, filling `steps`; return the status."""
        orbit = self._orbit
        _, status = MARCHES[stages.many](
            *self._system.compiled, stages.solver, stages.stages, orbit.equations(self._units),
            rule, basis, tables, self._orders.compiled(orbit.of_varying), arrays, self._state,
            steps, limits)  # fmt: skip
        return status

    def _go_on_from(self, kept, orbit):
        """Take over the state and the orbit of a march."""
        self._state, self._orbit = restored_state(kept), orbit
        self._orbit.adopt(self._form)
        self._orders.clear()
        self.ending, self.error = Ending(), None

    def _set_floors(self):
        """Set the floors of components that begin at rest, where errors are relative to sizes."""
        x = self._orbit.x[0]
        if self.t == 0.0 and self._allowed[2] > 0.0 and begins_at_rest(x):
            how = self._stages.many, self._t_end
            self._state.floors[:], calls = floors_of(self._system, *how)
            self._state.counts["rhs"] += calls

    def _singular_step(self, t_stop):
        """Make the step of a singular start; return its dense output, or None and set `ending`."""
        orbit, form, t, left = self._orbit, self._form, self.t, t_stop - self.t
        sizes = np.maximum(self._state.sizes, self._state.floors)
        units = np.maximum(self._units, sizes if self._allowed[2] > 0 else 0.0)
        units = np.where(units > LEAST, units, 1.0)
        limits = self.pace.longest[0], self._farthest / _LARGEST_RATIO
        how = t, left, *limits, self._state.counts, units
        self.ending = TOO_STEEP
        self._set_origin(t)
        for h, variable in trials(self._system, form, orbit, *how):
            # no tiny remainder is left before the stop
            h = min(h, 0.5 * left) if h < left else h
            steps, values = self._try_step(h, variable, t_stop)
            if values is not None:
                self._largest_error = max(self._largest_error, float(steps.errors[0]))
                self.ending = Ending()
                self._finish_singular_start(h, variable, values, t_stop)
                return FirstPiece(variable, t, h, steps.p[0], *steps.at_starts[0])
            # Newton's method asks for a quarter
            self.ending = UNSOLVED if self._control["next"] == 0.25 * h else TOO_STEEP
        return None

    def _try_step(self, h, variable, t_stop):
        """Try a step of length h in a variable; return its row, and f, p and y at its nodes.

        The compiled march tries it, with the history at the nodes in place of modes.
        """
        orbit, form, n = self._orbit, self._form, variable.n
        rule = first_rule(variable, tuple(form.orders.tolist()))
        logs = variable.logs(radau_nodes(n))
        history = orbit.history(np.log(h) + logs)
        n_kernels, d = len(form.kernels), self._system.d
        local = np.array([convolutions(variable, kernel, h) for kernel in form.kernels])
        tables = StepTables(
            np.array([h]), np.eye(n)[None], np.zeros((1, 2, n)), np.zeros((1, n, n)),
            local.reshape(1, n_kernels, n, n),
        )  # fmt: skip
        ones = np.ones(n, dtype=complex)
        basis = ExponentialBasis(
            ones, ones, np.zeros((form.orders.size + n_kernels, n)), np.zeros(n_kernels),
            np.zeros((n, n, n)),
        )  # fmt: skip
        values = np.zeros((orbit.x.shape[0], 3, d, n))
        arrays = OrbitArrays(orbit.initial, orbit.x, orbit.p, history, 0.0 * history, values)
        self._begin_steps(h, h)
        steps = empty_steps(1, d, n)
        solver = stage_solver(self._system.structure, form, n)
        how = solver, rule, basis, tables, arrays
        limits = self._limits(t_stop)
        share = min(1.0, max(_RESOLVED / variable.q, _UNRESOLVED, _ROUNDING / limits.rtol))
        tolerances = share * np.array([limits.rtol, limits.atol, limits.by_size])
        limits = limits._replace(rtol=tolerances[0], atol=tolerances[1], by_size=tolerances[2])
        status = self._march(steps, limits, *how)
        return steps, values if status in (FULL, REACHED) else None

    def _finish_singular_start(self, h, variable, values, t_stop):
        """Move to the end of the step of a singular start and begin ordinary steps."""
        orbit, closest, t = self._orbit, self._closest(h), self.t
        if self.n_modes == 0:
            orbit.open_modes(closest, self._farthest, self._known, self.modes_tol)
        elif closest < orbit.closest:
            orbit.refine(closest)
        orbit.finish_singular_start(variable, h, values)
        self._begin_steps(h, self._shortest)
        self._set_origin(*((t_stop,) if t == t_stop else (self._control["origin"], h)))
        self._at_singular_start = False

    def _begin_graded(self, t_stop):
        """Begin with ordinary steps, the first so short that the solution hardly changes."""
        self._set_origin(self.t)
        least = 1e5 * self._farthest / _LARGEST_RATIO
        h = self._form.graded_first_step(self.t, t_stop - self.t, sum(self._allowed[1:]), least)
        closest = self._closest(h)
        if self.n_modes == 0:
            self._orbit.open_modes(closest, self._farthest, self._known, self.modes_tol)
        if closest < self._orbit.closest:
            self._refine_modes(closest)
        # the right-hand side may jump here
        settled = jump(self._system, self._form, self._orbit, self.t, self._state.counts)
        self.ending = Ending() if settled else UNSOLVED
        self._state.largest[:] = np.where(self._form.second == 1, self._state.largest, 0.0)
        self._begin_steps(floor_to_grid(h), self._shortest)
        self._at_singular_start = False

    def _begin_steps(self, h, shortest):
        """Begin steps, the first of length h; shorter ones than `shortest` need other modes."""
        control = self._control
        control["next"], control["last"], control["refused"] = h, 0.0, 0.0
        control["shortest"] = shortest

    @property
    def _shortest(self):
        """Length of the shortest step for which the modes hold."""
        return self._orbit.closest / self._rule.nodes[0]

    def _prefit_kernels(self, t_end):
        """Fit kernels known by their values, for steps as short as are to be expected."""
        closest = _CLOSE * t_end
        if self._form.implicit.any() and not self._form.varying:
            first = self._form.graded_first_step(0.0, t_end, sum(self._allowed[1:]))
            closest = self._closest(first)
        errors = self._orbit.prefit_kernels(closest, self._farthest, self._known, self.modes_tol)
        warn_of_fit(errors.measured, self._tolerances[0])

    def _refine_modes(self, closest):
        """Refine the modes to hold at the distance `closest`."""
        self._orbit.refine(closest)
        self._control["shortest"] = self._shortest


def allowed_errors(rtol, atol):
    """Return the errors a step may make: relative to y, absolute, relative to sizes."""
    by_size, atol = (OF_SIZE * rtol, 0.0) if atol is None else (0.0, atol)
    return STEP_FRACTION * rtol, STEP_FRACTION * atol, STEP_FRACTION * by_size
