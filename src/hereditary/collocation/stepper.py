"""The adaptive stepper (floor 4): collocation steps as long as the tolerance allows."""

import copy

import numpy as np

from ..kernels.adaptive import (
    CRAWLING,
    FULL,
    REACHED,
    TOO_CLOSE,
    TOO_ROUGH,
    UNTOLD,
    march_adaptive,
)
from ..kernels.collocation import PRIMARY
from ..kernels.mode_tables import empty_tables, on_grid
from ..kernels.structures import (
    ExponentialBasis,
    Limits,
    Rule,
    Steps,
    VaryingOrders,
    begin_run,
    plain,
    run_of,
)
from ..memory_kernel import told_error, warn_of_fit
from ..schemes.scheme import refuse_late
from ..solver.identity import check_identity, identity
from ..solver.state import AdaptiveState, check_reach, check_sound, frozen, sealed
from .equations import integral_form
from .jumps import jump
from .orbit import Strands, starts
from .order_tables import OrderTables
from .pace import MAX_STEPS, ROUNDS, Ending, Pace, ending
from .pieces import PolynomialPieces, PowerPiece
from .quadrature import (
    looks_off_nodes,
    radau_integrals,
    radau_nodes,
    shortened_legendre,
    to_legendre,
)
from .singular_start import Corner

# Share of the tolerance that one step may err by, and that the modes may: errors add up along
# periodic and chaotic orbits (convergence/collocation.py).
_SHARE, _SHARE_OF_MODES = 0.1, 0.01
# The step out of a corner errs once, and no less than rounding lets it.
_ROUNDING = 5e-13
# Steps after the first one are at least this many times shorter than it before the modes must be
# refitted, and as many again each time.
_ROOM = 32.0
# Runs can be resumed up to this many times their length. The modes span this ratio at most.
_FAR, _MOST = 10.0, 1e305
# Share of the run that steps are expected to read at the closest, where kernels are fitted.
_CLOSE = 1e-6


class AdaptiveStepper:
    """A march of one equation by collocation, with steps chosen by the tolerance.

    Parameters
    ----------
    equation : System
    scheme : Collocation
    t_end : float
        End of the run; the modes reach ten times as far, or to the scheme's horizon.
    rtol, atol : float
    modes_tol : float, optional
        Relative error of the modes, where it is to be less than the tolerance allows.
    directions : ndarray, shape (n_data, k), optional
        Derivatives of the initial data along k directions, whose tangents go alongside; the steps
        are chosen for the orbit.
    max_step : float, optional
        Longest step [time].
    max_steps : int, optional
        Most steps of this run.
    """

    zigzag, growth, largest_ratio = None, None, 0.0

    def __init__(
        self, equation, scheme, t_end, rtol, atol, modes_tol=None, directions=None, max_step=None,
        max_steps=MAX_STEPS,
    ):  # fmt: skip
        scheme.check_terms(equation)
        self.equation, self._scheme = equation, scheme
        self._tolerances = (rtol, atol)
        self._rtol, self._atol = _SHARE * rtol, _SHARE * atol
        own = max(1e-14, min(1e-3, _SHARE_OF_MODES * self._rtol))
        # looser modes would look like a rough solution, and no step would be small enough
        self.modes_tol = own if modes_tol is None else min(own, modes_tol)
        refuse_late(equation, t_end)
        self._known = max(t_end, scheme.horizon or 0.0)
        self._far = max(min(_FAR * t_end, 1e307), self._known)
        s = self._s = scheme.nodes_for(rtol)
        self._form = form = integral_form(equation)
        self.second = form.second == 1
        singular = np.array([radau_integrals(s, a) for a in form.orders])
        rule = (radau_nodes(s), singular, to_legendre(s), np.linalg.inv(singular[-1]))
        self._rule = Rule(*(np.array(a) for a in rule + looks_off_nodes(s)))
        # no basis is made for these, where they begin: ordinary steps, the first of them tiny
        self._graded = bool(form.implicit.any() or form.varying)
        self._orders = OrderTables(form.varying, s)
        self._transforms = shortened_legendre(s)
        self._strands = Strands(form, starts(equation, self.second, directions), s)
        self._run = begin_run(t_end, np.abs(self._strands.p[0]))
        self._at_corner, self._largest_error, self._tables = True, 0.0, None
        self._peak = np.zeros((2, equation.d))  # of p and y at the starts of steps
        self.ending = Ending()
        self.error: Exception | None = None
        self.pace = Pace(max_step, max_steps)
        self._limit_steps(t_end)
        self._foresee(t_end)

    def _limit_steps(self, t_end):
        """Set the longest steps, and the last, of a run from here to t_end."""
        self.pace.begin(self.t, t_end, self.n_steps)
        self._control.next = min(self._control.next, on_grid(self.pace.longest[0]))

    @property
    def t(self):
        """Time reached."""
        return float(self._control.origin + self._control.time)

    @property
    def n_steps(self):
        """Steps made."""
        return int(self._run.counts.accepted)

    @property
    def n_rhs(self):
        """Calls of the right-hand side."""
        return int(self._run.counts.rhs)

    @property
    def n_modes(self):
        """Modes held for each component."""
        return self._strands.rates.size

    @property
    def y(self):
        """Solution at `t`, shape (d,); a copy."""
        return self._strands.x[0].copy()

    @property
    def ydot(self):
        """First derivative at `t` where it is an unknown, NaN elsewhere; shape (d,)."""
        return np.where(self.second, self._strands.p[0], np.nan)

    @property
    def tangent(self):
        """Derivatives of y, and of y' where the order is above 1, shape (n_data, k); a copy."""
        strands = self._strands
        return np.vstack([strands.x[1:].T, strands.p[1:, self.second].T])

    def transform_tangent(self, matrix):
        """Replace the tangents, with all of their memory, by ``tangent @ matrix``, (k, k)."""
        self._strands.transform(matrix)

    def advance(self, t_stop, n_rows):
        """March towards `t_stop` by at most `n_rows` steps; the piece of dense output made.

        Where it cannot go on `ending` says why, `pace` whether all steps allowed are made, and
        `error` is what the right-hand side raised; None may come back then.
        """
        n_rows = min(n_rows, self.pace.last_step - self.n_steps)
        if n_rows == 0:
            return None
        if self._at_corner:
            if not self._graded:
                return self._step_out(t_stop)
            self._grade(t_stop)
            if self.ending.not_solved:
                return None
        d, s, counts = self.equation.d, self._s, self._run.counts
        shapes = (n_rows,), (n_rows,), (n_rows, d, s), (n_rows, 2, d), (n_rows,)
        steps = Steps(*(np.empty(shape) for shape in shapes))
        n, status, begun = 0, TOO_CLOSE, (self.t, counts.copy())
        while (status == TOO_CLOSE and n == 0) or status == UNTOLD:
            made = self.n_steps
            try:
                if status == UNTOLD:
                    self._orders.tell(self._strands, self._control.origin, t_stop)
                _, status = self._march(Steps(*(array[n:] for array in steps)), t_stop)
            except Exception as error:
                # the steps before it are made and kept
                self.error, status = error, REACHED
            if self.n_steps > made:
                self._strands.step(float(self._control.last))
            n += self.n_steps - made
            if status == TOO_CLOSE:
                # the march stood before this step when it turned back
                closest = self._closest(min(self._control.next, t_stop - self.t))
                if closest < self._far / _MOST:
                    status = TOO_ROUGH
                else:
                    self._come_closer(closest)
        if status == REACHED and self.error is None:
            self._begin_at(t_stop)
        if status in (FULL, TOO_CLOSE):
            since, earlier = begun
            made, refused = counts.accepted - earlier.accepted, counts.refused - earlier.refused
            ahead = self.t - since, t_stop - self.t
            if self.pace.hopeless(made, refused, self.n_steps, *ahead, steps.begins[:n]):
                status = CRAWLING
        begins = np.abs(steps.begins[:n]).max(axis=0, initial=0.0)  # y, then p
        self._peak = np.maximum(self._peak, begins[::-1])
        if status not in (REACHED, FULL, TOO_CLOSE):
            lengths, last = (self._control.last, self._control.next), self._strands.last[0]
            self.ending = ending(status, self.equation, self.t, *lengths, last, self._peak)
        if n == 0:
            return None
        *made, errors = (array[:n] for array in steps)
        self._largest_error = max(self._largest_error, float(errors.max()))
        return PolynomialPieces(*made)

    @property
    def blown_up(self):
        """Whether the solution grows without bound."""
        return self.ending.blown_up

    @property
    def not_solved(self):
        """Whether Newton's method failed."""
        return self.ending.not_solved

    @property
    def no_step(self):
        """A clause about steps that are never small enough; empty where they are."""
        return self.ending.no_step

    def _begin_at(self, t, since=0.0):
        """Count the time from t on: next to a corner its rounding would hide the steps."""
        self._control.time, self._control.origin = since, t
        self._orders.forget()

    @property
    def _control(self):
        return self._run.control

    def _closest(self, h):
        """Distance that the modes must hold at for steps of length h, and shorter ones to come."""
        return self._rule.nodes[0] * h / _ROOM

    def _march(self, steps, t_stop):
        equation, strands = self.equation, self._strands
        longest, idle = self.pace.longest.tolist()
        return march_adaptive(
            equation._rhs,
            equation._jac,
            int(equation.has_jac),
            equation._params,
            strands.equations(),
            self._rule,
            ExponentialBasis(strands.rates, strands.weights, strands.masses, self._transforms),
            self._kept_tables(),
            self._varying_orders(),
            strands.compiled(),
            self._run,
            steps,
            Limits(t_stop, longest, idle, self._rtol, self._atol),
        )

    def _kept_tables(self):
        """Tables of the bank in use for steps of lengths that occurred."""
        n, s = self.n_modes, self._s
        if self._tables is None or self._tables.keeps.shape[1] != n:
            self._tables = empty_tables(n, s, len(self._form.kernels) + len(self._form.varying))
        return self._tables

    def _varying_orders(self):
        """Return tables of the orders that vary, for the step that they are known for."""
        orders, own = self._orders, self._strands.own
        if orders.weights.shape[1] != own.size:
            orders.forget()
            orders.weights = np.zeros((len(orders.weights), own.size, self._s))
        return VaryingOrders(orders.known, orders.integrals, orders.weights, own)

    def leave_corner(self):
        """Make the next step out of a point where the solution is not smooth."""
        self._at_corner = True

    def stats(self):
        """Counts for the solution's stats."""
        return {
            "n_steps": self.n_steps,
            "n_rejected": int(self._run.counts.refused),
            "n_rhs": self.n_rhs,
            "n_modes": self.n_modes,
            "history_bytes": self._strands.modes.nbytes,
            # a step out of a corner may err by its share
            "kernel_error": told_error(self._strands.kernels.error),
            "error_estimate": max(self._largest_error, _SHARE) * self._tolerances[0],
        }

    def state(self):
        """An `AdaptiveState` from which a later run goes on."""
        rtol, atol = self._tolerances
        state = AdaptiveState(
            t=self.t,
            y=frozen(self.y),
            scheme=self._scheme,
            rtol=rtol,
            atol=atol,
            modes_tol=self.modes_tol,
            identity=self._identity(self.t),
            run=tuple(frozen(plain(part)) for part in self._run),
            strands=copy.deepcopy(self._strands),
            at_corner=self._at_corner,
        )
        return sealed(state)

    def restore(self, state, t_end, allow_change=False):
        """Take over where `state` was taken, of another right-hand side where that is allowed."""
        check_sound(state)
        changed = check_identity(state.identity, self._identity(state.t), allow_change)
        refuse_late(self.equation, t_end)
        check_reach(state, t_end)
        self._run = run_of(state.run)
        self._strands, self._at_corner = copy.deepcopy(state.strands), state.at_corner or changed
        self._strands.adopt(self._form)
        self._tables = None  # they belong to the modes, and so do these
        self._orders.forget()
        self._limit_steps(t_end)

    def _identity(self, t):
        """Describe what a run to time t must share with one that resumes it."""
        how = {"number of nodes": self._s, "tolerances": self._tolerances}
        return identity(self.equation, t, len(self._strands.x) - 1, **how)

    def _step_out(self, t_stop):
        """Step out of a point where the solution is not smooth; the piece made."""
        strands, t = self._strands, self.t
        tolerances = max(self._rtol, _ROUNDING), self._atol
        state = self._form, strands, t, t_stop, self._far / _MOST
        longest = self.pace.longest[0]
        corner = Corner(self.equation, *state, tolerances, self._run, longest)
        found = corner.leave()
        self._run.counts.refused += corner.n_refused
        if found is None:
            self.ending = Ending(no_step=ROUNDS) if corner.solved else Ending(not_solved=True)
            return None
        h, basis, values = found
        begin = strands.x[0].copy()
        self._leave(t, h, basis, values, t_stop)
        return PowerPiece(t, h, basis, values[0], corner.means(basis, values[0]), begin)

    def _leave(self, t, h, basis, values, t_stop):
        """Move to the end of a step out of a corner."""
        strands, closest, largest = self._strands, self._closest(h), self._run.largest
        if self.n_modes == 0:
            strands.begin(closest, self._far, self._known, self.modes_tol)
        elif closest < strands.closest:
            self._come_closer(closest)
        strands.leave(basis, h, values)
        speeds = np.maximum(largest, np.abs(values[0, PRIMARY]).max(axis=1))
        largest[:] = np.where(self.second, speeds, 0.0)
        self._begin_steps(h)
        self._begin_at(*((t_stop,) if h == t_stop - t else (t, h)))
        self._run.counts.accepted += 1
        self._at_corner = False

    def _grade(self, t_stop):
        """Make ready to begin by ordinary steps, the first so small that the solution is still."""
        self._begin_at(self.t)
        h = self._form.tiny(self.t, t_stop - self.t, self._atol, 1e5 * self._far / _MOST)
        closest = self._closest(h)
        if self.n_modes == 0:
            self._strands.begin(closest, self._far, self._known, self.modes_tol)
        if closest < self._strands.closest:
            self._come_closer(closest)
        # the right-hand side may jump here
        settled = jump(self.equation, self._form, self._strands, self.t, self._run.counts)
        self.ending = Ending(not_solved=not settled)
        self._run.largest[:] = np.where(self.second, self._run.largest, 0.0)
        self._begin_steps(on_grid(h))
        self._at_corner = False

    def _begin_steps(self, h):
        """Begin ordinary steps, the first of length h."""
        control = self._control
        control.next, control.last, control.refused = h, 0.0, 0.0
        control.closest = self._strands.closest

    def _foresee(self, t_end):
        """Fit kernels known by their values for steps as short as are to be expected."""
        closest = _CLOSE * t_end
        if self._graded and not self._form.varying:
            closest = self._closest(self._form.tiny(0.0, t_end, self._atol))
        error = self._strands.foresee(closest, self._far, self._known, self.modes_tol)
        warn_of_fit(error, self._tolerances[0])

    def _come_closer(self, closest):
        self._strands.come_closer(closest)
        self._control.closest = self._strands.closest
