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
from ..compiled.mode_tables import floor_to_grid
from ..compiled.operators import PRIMARY
from ..compiled.structures import ExponentialBasis, Steps, initial_state, restored_state
from ..memory_kernel import warn_of_fit
from .equations import integral_form
from .jumps import jump
from .kept_tables import kept_tables
from .orbit import OrbitAndTangents, initial_values
from .order_tables import OrderTables
from .pace import TOO_STEEP, UNSOLVED, Ending, Pace, ending
from .pieces import PolynomialPieces, PowerPiece
from .quadrature import rule_of, shortened_legendre
from .singular_start import SingularStart
from .stages import has_stages, stage_solver

# Fraction of the tolerance that one step may err by, and fraction of that for the modes: errors add
# up along periodic and chaotic orbits (convergence/collocation.py).
STEP_FRACTION, _MODES_FRACTION = 0.1, 0.01
# Least relative tolerance of a singular start: rounding allows no less.
_ROUNDING = 5e-13
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
        rtol and atol.
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
        self._rtol, self._atol = (STEP_FRACTION * tolerance for tolerance in tolerances)
        default_tol = max(1e-14, min(1e-3, _MODES_FRACTION * self._rtol))
        # larger errors of the modes would look like a rough solution, and no step would suffice
        self.modes_tol = default_tol if modes_tol is None else min(default_tol, modes_tol)
        self._known = known = max(t_end, horizon)
        self._farthest = max(min(_REACH * t_end, 1e307), known)
        s = self._s = n_nodes
        self._form = form = integral_form(system)
        if not has_stages(form):
            system = self._system = system.dense()
        self._stages = stage_solver(system.structure, form, s)
        self._rule = rule_of(s, tuple(form.orders.tolist()), system.linear_alone)
        # such equations have no power basis and begin with ordinary steps, the first one tiny
        self._graded = bool(form.implicit.any() or form.varying)
        self._orders = OrderTables(form.varying, s)
        self._transforms = shortened_legendre(s)
        self._orbit = OrbitAndTangents(
            form, initial_values(system, form.second == 1, directions), s
        )
        self._state = initial_state(t_end, np.abs(self._orbit.p[0]))
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
            if not self._graded:
                return self._singular_step(t_stop)
            self._begin_graded(t_stop)
            if self.ending.status is not None:
                return None
        d, s, counts = self._system.d, self._s, self._state.counts
        shapes = (n_rows,), (n_rows,), (n_rows, d, s), (n_rows, 2, d), (n_rows,)
        steps = Steps(*(np.empty(shape) for shape in shapes))
        n, status, before, origin = 0, TOO_CLOSE, (self.t, counts.copy()), self._control["origin"]
        limits = self.pace.limits(self._system, origin, t_stop, (self._rtol, self._atol))
        while (status == TOO_CLOSE and n == 0) or status == ORDERS_NEEDED:
            first = self.n_steps
            try:
                if status == ORDERS_NEEDED:
                    self._orders.fill(self._orbit, origin, limits)
                _, status = self._march(Steps(*(array[n:] for array in steps)), limits)
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
        stretch = *before, self.t, counts, t_stop, steps.at_starts[:n]
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

    def _march(self, steps, limits):
        """March to a stop in compiled code, filling `steps`; return rows filled and status."""
        equation, orbit = self._system, self._orbit
        basis = ExponentialBasis(orbit.rates, orbit.weights, orbit.masses, self._transforms)
        march = MARCHES[self._stages.many]
        taken = _, tables = kept_tables.take(basis, self._s, len(self._form.varying))
        try:
            return march(
                equation._rhs, equation._jac, int(equation.has_jac), equation._params,
                self._stages.solver, self._stages.stages, orbit.equations(), self._rule, basis,
                tables, self._orders.compiled(orbit.of_varying), orbit.march_arrays(),
                self._state, steps, limits)  # fmt: skip
        finally:
            kept_tables.give_back(taken)

    def _go_on_from(self, kept, orbit):
        """Take over the state and the orbit of a march."""
        self._state, self._orbit = restored_state(kept), orbit
        self._orbit.adopt(self._form)
        self._orders.clear()
        self.ending, self.error = Ending(), None

    def _singular_step(self, t_stop):
        """Make the step of a singular start; return its dense output, or None and set `ending`."""
        orbit, t = self._orbit, self.t
        tolerances = max(self._rtol, _ROUNDING), self._atol
        problem = self._form, orbit, t, t_stop, self._farthest / _LARGEST_RATIO
        how = tolerances, self._state, self.pace.longest[0]
        start = SingularStart(self._system, *problem, *how)
        found = start.step()
        self._state.counts["refused"] += start.n_refused
        if found is None:
            self.ending = TOO_STEEP if start.solved else UNSOLVED
            return None
        h, basis, values = found
        at_start = orbit.x[0].copy()
        self._finish_singular_start(t, h, basis, values, t_stop)
        return PowerPiece(t, h, basis, values[0], start.means(basis, values[0]), at_start)

    def _finish_singular_start(self, t, h, basis, values, t_stop):
        """Move to the end of the step of a singular start and begin ordinary steps."""
        orbit, closest, largest = self._orbit, self._closest(h), self._state.largest
        if self.n_modes == 0:
            orbit.open_modes(closest, self._farthest, self._known, self.modes_tol)
        elif closest < orbit.closest:
            self._refine_modes(closest)
        orbit.finish_singular_start(basis, h, values)
        speeds = np.maximum(largest, np.abs(values[0, PRIMARY]).max(axis=1))
        largest[:] = np.where(self._form.second == 1, speeds, 0.0)
        self._begin_steps(h)
        self._set_origin(*((t_stop,) if h == t_stop - t else (t, h)))
        self._state.counts["accepted"] += 1
        self._at_singular_start = False

    def _begin_graded(self, t_stop):
        """Begin with ordinary steps, the first so short that the solution hardly changes."""
        self._set_origin(self.t)
        least = 1e5 * self._farthest / _LARGEST_RATIO
        h = self._form.graded_first_step(self.t, t_stop - self.t, self._atol, least)
        closest = self._closest(h)
        if self.n_modes == 0:
            self._orbit.open_modes(closest, self._farthest, self._known, self.modes_tol)
        if closest < self._orbit.closest:
            self._refine_modes(closest)
        # the right-hand side may jump here
        settled = jump(self._system, self._form, self._orbit, self.t, self._state.counts)
        self.ending = Ending() if settled else UNSOLVED
        self._state.largest[:] = np.where(self._form.second == 1, self._state.largest, 0.0)
        self._begin_steps(floor_to_grid(h))
        self._at_singular_start = False

    def _begin_steps(self, h):
        """Begin ordinary steps, the first of length h."""
        control = self._control
        control["next"], control["last"], control["refused"] = h, 0.0, 0.0
        control["closest"] = self._orbit.closest

    def _prefit_kernels(self, t_end):
        """Fit kernels known by their values, for steps as short as are to be expected."""
        closest = _CLOSE * t_end
        if self._graded and not self._form.varying:
            closest = self._closest(self._form.graded_first_step(0.0, t_end, self._atol))
        errors = self._orbit.prefit_kernels(closest, self._farthest, self._known, self.modes_tol)
        warn_of_fit(errors.measured, self._tolerances[0])

    def _refine_modes(self, closest):
        """Refine the modes to hold at the distance `closest`."""
        self._orbit.refine(closest)
        self._control["closest"] = self._orbit.closest
