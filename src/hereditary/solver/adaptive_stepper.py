"""The adaptive stepper (floor 4): collocation steps as long as the tolerance allows."""

import copy
import math
from dataclasses import dataclass, field

import numpy as np

from .._checks import complaint
from ..kernels.adaptive import FULL, NOT_SOLVED, REACHED, TOO_CLOSE, march_adaptive
from ..kernels.collocation import FORCE, POSITION, PRIMARY, solve_once
from ..schemes.collocation import integral_form
from ..schemes.power_basis import power_basis
from ..schemes.quadrature import radau_integrals, radau_nodes, to_legendre
from .dense import PolynomialPieces, PowerPiece
from .strands import Strands, rows

# Share of the tolerance that one step may err by, and that the modes may: errors add up along
# periodic and chaotic orbits (convergence/collocation.py).
_SHARE, _SHARE_OF_MODES = 0.1, 0.01
# Steps after the first one are at least this many times shorter than it before the modes must be
# refitted, and as many again each time.
_ROOM = 32.0
# Runs can be resumed up to this many times their length.
_FAR = 10.0
# What a state and a run must agree in.
_NAMES = ("number of nodes", "tolerances", "orders", "coefficients", "tangents")
# The first step is made this many times smaller each time it is refused.
_SHORTER = 0.3


@dataclass(frozen=True, eq=False)
class AdaptiveState:
    """Everything an adaptive run needs to go on; it pickles.

    Attributes
    ----------
    t : float
        Time reached.
    y : ndarray, shape (d,)
        Solution at `t`.
    identity : tuple
        Number of nodes, tolerances, terms and tangents of the run; checked on resuming.
    """

    t: float
    y: np.ndarray
    identity: tuple
    run: tuple = field(repr=False)
    strands: Strands = field(repr=False)
    at_corner: bool = field(repr=False)


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
    """

    zigzag, largest_ratio = None, 0.0

    def __init__(self, equation, scheme, t_end, rtol, atol, modes_tol=None, directions=None):
        self.equation, self._scheme = equation, scheme
        self._tolerances = (rtol, atol)
        self._rtol, self._atol = _SHARE * rtol, _SHARE * atol
        own = max(1e-14, min(1e-3, _SHARE_OF_MODES * self._rtol))
        # looser modes would look like a rough solution, and no step would be small enough
        self._modes_tol = own if modes_tol is None else min(own, modes_tol)
        self._far = max(_FAR * t_end, scheme.horizon or 0.0)
        s = self._s = scheme.nodes_for(rtol)
        self._form = form = integral_form(equation)
        self.second = form.second == 1
        singular = np.array([radau_integrals(s, a) for a in form.orders])
        self._rule = tuple(np.array(a) for a in (radau_nodes(s), singular, to_legendre(s)))
        self._basis = power_basis(form.generators)
        self._strands = Strands(form, self._starts(directions), s)
        self._clock = np.array([0.0, t_end, 0.0, 0.0])
        self._notes = np.array([0.0, 0.0, 1.0, 1.0])
        self._steps = np.zeros(2, dtype=np.int64)
        self._largest = np.abs(self._strands.initial[0])
        self._at_corner, self._largest_error = True, 0.0
        self.blown_up = self.not_solved = False
        self.error: Exception | None = None

    def _starts(self, directions):
        """Initial values of orbit and tangents, shape (1 + k, m, d)."""
        equation = self.equation
        if directions is None:
            return equation.y0[None]
        starts = np.zeros((1 + directions.shape[1], *equation.y0.shape))
        starts[0] = equation.y0
        starts[1:, 0] = directions[: equation.d].T
        if equation.m == 2:
            starts[1:, 1, self.second] = directions[equation.d :].T
        return starts

    @property
    def t(self):
        """Time reached."""
        return float(self._clock[0])

    @property
    def n_steps(self):
        """Steps made."""
        return int(self._steps[0])

    @property
    def n_rhs(self):
        """Calls of the right-hand side."""
        return int(self._notes[0])

    @property
    def n_modes(self):
        """Modes held for each component."""
        return self._strands.bank.rates.size

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

        Where no step is small enough `not_solved` or `blown_up` is set, where the right-hand side
        raises, `error`; None may come back then.
        """
        if self._at_corner:
            return self._step_out(t_stop)
        d = self.equation.d
        track = tuple(
            np.empty(shape)
            for shape in ((n_rows,), (n_rows,), (n_rows, d, self._s), (n_rows, 2 * d), (n_rows,))
        )
        n, status = 0, TOO_CLOSE
        while status == TOO_CLOSE and n == 0:
            made = self.n_steps
            try:
                _, status = self._march(track, t_stop)
            except Exception as error:
                # the steps before it are made and kept
                self.error, status = error, REACHED
            n = self.n_steps - made
            if n:
                self._strands.step(self._clock[2])
            if status == TOO_CLOSE:
                # the march stood before this step when it turned back
                step = min(self._clock[1], t_stop - self.t)
                self._come_closer(self._rule[0][0] * step / _ROOM)
        if status not in (REACHED, FULL, TOO_CLOSE):
            self.not_solved, self.blown_up = status == NOT_SOLVED, status != NOT_SOLVED
        if n == 0:
            return None
        self._largest_error = max(self._largest_error, float(track[4][:n].max()))
        return PolynomialPieces(*(array[:n] for array in track[:4]))

    def _march(self, track, t_stop):
        equation, form, strands = self.equation, self._form, self._strands
        return march_adaptive(
            equation._rhs,
            equation._jac,
            int(equation.has_jac),
            equation.params,
            (form.channels, form.orders, form.second, strands.offsets),
            self._rule,
            (strands.bank.rates, strands.bank.weights),
            (self._clock, self._notes, self._steps, self._largest, *self._moving()),
            track,
            t_stop,
            self._rtol,
            self._atol,
        )

    def _moving(self):
        strands = self._strands
        moving = (strands.x, strands.p, strands.modes, strands.before, strands.last)
        return strands.initial, *moving

    def leave_corner(self):
        """Make the next step out of a point where the solution is not smooth."""
        self._at_corner = True

    def stats(self):
        """Counts for the solution's stats."""
        return {
            "n_steps": self.n_steps,
            "n_rejected": int(self._steps[1]),
            "n_rhs": self.n_rhs,
            "n_modes": self.n_modes,
            "history_bytes": self._strands.modes.nbytes,
            "error_estimate": self._largest_error * self._tolerances[0],
        }

    def state(self):
        """An `AdaptiveState` from which a later run goes on."""
        run = (self._clock, self._notes, self._steps, self._largest)
        return AdaptiveState(
            self.t,
            self.y,
            self._identity(),
            tuple(array.copy() for array in run),
            copy.deepcopy(self._strands),
            self._at_corner,
        )

    def restore(self, state, t_end):
        """Take over where `state` was taken."""
        for name, theirs, mine in zip(_NAMES, state.identity, self._identity(), strict=True):
            if theirs != mine:
                required = f"come from a run with the same {name}, here {mine}"
                remedy = "start anew, or change it back"
                raise ValueError(complaint("resume", required, theirs, remedy))
        reached = state.strands.bank.farthest
        if reached and t_end > reached:
            required = f"stay within t = {reached}, as far as its history reaches"
            remedy = f"begin the run with Collocation(horizon={t_end})"
            raise ValueError(complaint("resume", required, f"a run to {t_end}", remedy))
        run = (array.copy() for array in state.run)
        self._clock, self._notes, self._steps, self._largest = run
        self._strands, self._at_corner = copy.deepcopy(state.strands), state.at_corner

    def _identity(self):
        equation, n_tangents = self.equation, self._strands.x.shape[0] - 1
        numbers = (equation.orders.tolist(), equation.coefficients.tolist(), n_tangents)
        return (self._s, self._tolerances, *numbers)

    def _step_out(self, t_stop):
        """Step out of a point where the solution is not smooth; the piece made."""
        basis, strands, t = self._basis, self._strands, self.t
        points = np.concatenate([basis.nodes, basis.between])
        operators = basis.integrals(tuple(self._form.orders.tolist()))
        tolerance = self._atol + self._rtol * np.maximum(np.abs(strands.p[0]), self._largest)
        values = np.empty((strands.x.shape[0], 3, self.equation.d, basis.nodes.size))
        h = self._first_length(t_stop - t)
        while t + h > t:
            # no crumb is left before the stop
            h = min(h, 0.5 * (t_stop - t)) if h < t_stop - t else h
            values[0, PRIMARY] = strands.p[0][:, None]
            # just after the corner and before the stop: the right-hand side may jump at both
            first = np.nextafter(t, np.inf) if t > 0 else 0.0
            times = np.clip(t + h * points, first, np.nextafter(t_stop, 0.0))
            if self._stages(times, h, strands.past(h * points), operators, tolerance, values):
                self._leave(t, h, values, t_stop)
                return PowerPiece(t, h, basis, values[0])
            h *= _SHORTER
            self._steps[1] += 1
        self.blown_up = True
        return None

    def _first_length(self, left):
        """A length over which the solution changes by some half of itself, as a first trial."""
        form, size = self._form, np.abs(self.equation.jacobian(self.t, self.y)).max()
        forces = form.channels[form.channels[:, 1] == FORCE]
        order = (form.orders[forces[:, 2].astype(int)] + form.second).min()
        most = left / 16  # a right-hand side of time alone says nothing about itself
        # tiny orders change at once and then hardly: the check between the nodes decides there
        order = max(order, 0.1)
        return most if size * most**order < 0.5 else (0.5 / size) ** (1 / order)

    def _stages(self, times, h, base, operators, tolerance, values):
        """Solve for the values at the basis' nodes; whether the orbit's hold in between too."""
        equation, form, strands = self.equation, self._form, self._strands
        n = self._basis.nodes.size
        solved = solve_once(
            equation._rhs, equation._jac, int(equation.has_jac), equation.params, form.channels,
            strands.offsets, form.orders, form.second, times[:n],
            np.ascontiguousarray(operators[:, :n]), h, np.ascontiguousarray(base[:, :, :n]),
            strands.x, 1e-3 * tolerance, values, self._notes,
        )  # fmt: skip
        if not solved:
            return False
        defect = self._defect(times[n:], h, base[0, :, n:], operators[:, n:], values[0])
        return bool(np.all(defect <= tolerance))  # False where it is not finite

    def _defect(self, times, h, base, operators, values):
        """How far the equation, integrated, and the basis are off between the nodes, (d,)."""
        equation, form, strands = self.equation, self._form, self._strands
        p = base.copy()
        for row, (c, q, k, kappa) in enumerate(rows(form)):
            driver = values[q, c] - strands.offsets[0, row]
            p[c] += kappa * h ** form.orders[k] * (operators[k] @ driver)
        x = strands.x[0][:, None] + h * (values[PRIMARY] @ operators[-1].T)
        x = np.where(self.second[:, None], x, p)
        f, out = np.empty_like(x), np.empty(p.shape[0])
        for i, t in enumerate(times):
            equation._rhs(t, np.ascontiguousarray(x[:, i]), out, equation.params)
            f[:, i] = out
        self._notes[0] += times.size
        off = np.abs(np.array([f, p, x]) - self._basis.interpolate_between(values)).max(axis=2)
        defect = np.zeros(p.shape[0])
        for c, q, k, kappa in rows(form):
            defect[c] += abs(kappa) * h ** form.orders[k] * off[q, c]
        # the basis itself shows in the dense output alone
        return np.maximum(defect, _SHARE * off[PRIMARY : POSITION + 1].max(axis=0))

    def _leave(self, t, h, values, t_stop):
        """Move to the end of a step out of a corner."""
        strands, closest = self._strands, self._rule[0][0] * h / _ROOM
        if self.n_modes == 0:
            closest, far = _decades(closest, self._far)
            strands.begin(closest, far, self._modes_tol)
        elif closest < strands.bank.closest:
            self._come_closer(closest)
        strands.leave(self._basis, h, values)
        speeds = np.maximum(self._largest, np.abs(values[0, PRIMARY]).max(axis=1))
        self._largest[:] = np.where(self.second, speeds, 0.0)
        end = t_stop if h == t_stop - t else t + h
        self._clock[:] = end, h, 0.0, strands.bank.closest
        self._steps[0] += 1
        self._at_corner = False

    def _come_closer(self, closest):
        self._strands.come_closer(closest)
        self._clock[3] = self._strands.bank.closest


def _decades(closest, farthest):
    """The same interval, widened so that many runs share one bank."""
    ratio = 10.0 ** math.ceil(math.log10(max(farthest / closest, 10.0)))
    return farthest / ratio, farthest
