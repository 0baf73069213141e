"""The adaptive stepper (floor 4): collocation steps as long as the tolerance allows."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.special import rgamma

from .._checks import complaint
from ..history.bank import Bank, open_bank
from ..kernels.adaptive import FULL, NOT_SOLVED, REACHED, TOO_CLOSE, march_adaptive
from ..kernels.collocation import FORCE, POSITION, PRIMARY, solve_once
from ..schemes.collocation import integral_form
from ..schemes.power_basis import LEFT_OUT, graded_rule, power_basis
from ..schemes.quadrature import radau_integrals, radau_nodes, to_legendre
from .dense import PolynomialPieces, PowerPiece

# Share of the tolerance that one step may err by, and that the modes may: errors add up along
# periodic and chaotic orbits (convergence/collocation.py).
_SHARE, _SHARE_OF_MODES = 0.1, 0.3
# Steps after the first one are at least this many times shorter than it before the modes must be
# refitted, and as many again each time.
_ROOM = 32.0
# Runs can be resumed up to this many times their length.
_FAR = 10.0
# What a state and a run must agree in.
_NAMES = ("number of nodes", "tolerances", "orders", "coefficients")
# The first step is made this many times smaller each time it is refused.
_SHORTER = 0.3


@dataclass(frozen=True, eq=False)
class AdaptiveState:
    """Everything an adaptive run needs to go on, as plain arrays; it pickles.

    Attributes
    ----------
    t : float
        Time reached.
    y : ndarray, shape (d,)
        Solution at `t`.
    identity : tuple
        Scheme, tolerances and terms of the run; checked on resuming.
    """

    t: float
    y: np.ndarray
    identity: tuple
    run: tuple = field(repr=False)
    bank: Bank = field(repr=False)
    last: tuple = field(repr=False)


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
        Relative error of the modes; by default what the tolerance allows.
    """

    zigzag, largest_ratio = None, 0.0

    def __init__(self, equation, scheme, t_end, rtol, atol, modes_tol=None):
        self.equation, self._scheme = equation, scheme
        self._tolerances = (rtol, atol)
        self._rtol, self._atol = _SHARE * rtol, _SHARE * atol
        own = max(1e-13, min(1e-3, _SHARE_OF_MODES * self._rtol))
        self._modes_tol = own if modes_tol is None else modes_tol
        self._far = max(_FAR * t_end, scheme.horizon or 0.0)
        s = self._s = scheme.nodes_for(rtol)
        self._form = form = integral_form(equation)
        self.second = form.second == 1
        singular = np.array([radau_integrals(s, a) for a in form.orders])
        self._rule = tuple(np.array(a) for a in (radau_nodes(s), singular, to_legendre(s)))
        self._kernel_form = (form.channels, form.orders, form.second, form.initial)
        self._basis = power_basis(form.generators)
        self._bank = Bank((), 0.0, 0.0, 0.0, np.zeros(0), np.zeros((0, 0)))
        d = equation.d
        self._run = (
            np.array([0.0, t_end, 0.0, 0.0]),
            np.array([0.0, 0.0, 1.0, 1.0]),
            np.zeros(2, dtype=np.int64),
            equation.y0[0].copy(),
            form.initial.copy(),
            np.abs(form.initial),
            *(np.zeros((d, 0)) for _ in range(2)),
            np.zeros((3, d, s)),
        )
        self._last: tuple | None = None
        self._at_corner, self._largest_error = True, 0.0
        self.blown_up = self.not_solved = False

    @property
    def t(self):
        """Time reached."""
        return float(self._run[0][0])

    @property
    def n(self):
        """Steps made."""
        return int(self._run[2][0])

    @property
    def n_rejected(self):
        """Steps refused and made again, shorter."""
        return int(self._run[2][1])

    @property
    def n_rhs(self):
        """Calls of the right-hand side."""
        return int(self._run[1][0])

    @property
    def y(self):
        """Solution at `t`, shape (d,); a copy."""
        return self._run[3].copy()

    @property
    def ydot(self):
        """First derivative at `t` where it is an unknown, NaN elsewhere; shape (d,)."""
        return np.where(self.second, self._run[4], np.nan)

    def advance(self, t_stop, n_rows):
        """March towards `t_stop` by at most `n_rows` steps; the piece of dense output made.

        Where no step is small enough `not_solved` or `blown_up` is set, and None may come back.
        """
        if self._at_corner:
            return self._step_out(t_stop)
        d = self.equation.d
        track = tuple(
            np.empty(shape)
            for shape in ((n_rows,), (n_rows,), (n_rows, d, self._s), (n_rows, 2 * d), (n_rows,))
        )
        equation, n, status = self.equation, 0, TOO_CLOSE
        while status == TOO_CLOSE and n == 0:
            bank = (self._bank.rates, self._bank.weights)
            n, status = march_adaptive(
                equation._rhs, equation._jac, int(equation.has_jac), equation.params,
                self._kernel_form, self._rule, bank, self._run, track, t_stop, self._rtol,
                self._atol,
            )  # fmt: skip
            if n:
                self._last = (None, self._run[0][2], self._run[8])
            if status == TOO_CLOSE:
                self._come_closer(self._rule[0][0] * self._run[0][1])
        if status not in (REACHED, FULL, TOO_CLOSE):
            self.not_solved, self.blown_up = status == NOT_SOLVED, status != NOT_SOLVED
        if n == 0:
            return None
        self._largest_error = max(self._largest_error, float(track[4][:n].max()))
        return PolynomialPieces(*(array[:n] for array in track[:4]))

    def leave_corner(self):
        """Make the next step out of a point where the solution is not smooth."""
        self._at_corner = True

    def stats(self):
        """Counts for the solution's stats."""
        return {
            "n_steps": self.n,
            "n_rejected": self.n_rejected,
            "n_rhs": self.n_rhs,
            "n_modes": self._bank.rates.size,
            "history_bytes": self._run[6].nbytes,
            "error_estimate": self._largest_error * self._tolerances[0],
        }

    def state(self):
        """An `AdaptiveState` from which a later run goes on; None before the first step."""
        if self._last is None:
            return None
        run = tuple(array.copy() for array in self._run)
        return AdaptiveState(self.t, self.y, self._identity(), run, self._bank, self._last)

    def restore(self, state, t_end):
        """Take over where `state` was taken."""
        for name, theirs, mine in zip(_NAMES, state.identity, self._identity(), strict=True):
            if theirs != mine:
                required = f"come from a run with the same {name}, here {mine}"
                remedy = "start anew, or change it back"
                raise ValueError(complaint("resume", required, theirs, remedy))
        if t_end > state.bank.farthest:
            required = f"stay within t = {state.bank.farthest}, as far as its history reaches"
            remedy = f"begin the run with Collocation(horizon={t_end})"
            raise ValueError(complaint("resume", required, f"a run to {t_end}", remedy))
        self._run = tuple(array.copy() for array in state.run)
        self._bank, self._last, self._at_corner = state.bank, state.last, False

    def _identity(self):
        equation = self.equation
        numbers = (equation.orders.tolist(), equation.coefficients.tolist())
        return (repr(self._s), repr(self._tolerances), *numbers)

    def _step_out(self, t_stop):
        """Step out of a point where the solution is not smooth; the piece made."""
        _, _, steps, _, p, largest, *_ = self._run
        basis, t = self._basis, self.t
        points = np.concatenate([basis.nodes, basis.between])
        operators = basis.integrals(tuple(self._form.orders.tolist()))
        tolerance = self._atol + self._rtol * np.maximum(np.abs(p), largest)
        values = np.empty((3, p.size, basis.nodes.size))
        h = self._first_length(t_stop - t)
        while t + h > t:
            values[PRIMARY] = p[:, None]
            # just after the corner and before the stop: the right-hand side may jump at both
            first = np.nextafter(t, np.inf) if t > 0 else 0.0
            times = np.clip(t + h * points, first, np.nextafter(t_stop, 0.0))
            if self._stages(times, h, self._past(h * points), operators, tolerance, values):
                piece = PowerPiece(t, h, basis, values)
                self._take(piece, t_stop)
                return piece
            h *= _SHORTER
            steps[1] += 1
        self.blown_up = True
        return None

    def _first_length(self, left):
        """A length over which the solution changes by some half of itself, as a first trial."""
        form, size = self._form, np.abs(self.equation.jacobian(self.t, self.y)).max()
        forces = form.channels[form.channels[:, 1] == FORCE]
        order = (form.orders[forces[:, 2].astype(int)] + form.second).min()
        return left if size * left**order < 0.5 else (0.5 / size) ** (1 / order)

    def _stages(self, times, h, base, operators, tolerance, values):
        """Solve for the values (3, d, n) at the basis' nodes; whether they hold in between too."""
        equation, form, n = self.equation, self._form, self._basis.nodes.size
        solved = solve_once(
            equation._rhs, equation._jac, int(equation.has_jac), equation.params, form.channels,
            form.orders, form.second, times[:n], np.ascontiguousarray(operators[:, :n]), h,
            np.ascontiguousarray(base[:, :n]), self._run[3], 1e-3 * tolerance, values, self._run[1],
        )  # fmt: skip
        if not solved:
            return False
        defect = self._defect(times[n:], h, base[:, n:], operators[:, n:], values)
        return bool(np.all(defect <= tolerance))  # False where it is not finite

    def _defect(self, times, h, base, operators, values):
        """How far the equation, integrated, and the basis are off between the nodes, (d,)."""
        equation, form = self.equation, self._form
        p = base.copy()
        for c, q, k, kappa, offset in _rows(form):
            p[c] += kappa * h ** form.orders[k] * (operators[k] @ (values[q, c] - offset))
        x = self._run[3][:, None] + h * (values[PRIMARY] @ operators[-1].T)
        x = np.where(self.second[:, None], x, p)
        f, out = np.empty_like(x), np.empty(p.shape[0])
        for i, t in enumerate(times):
            equation._rhs(t, np.ascontiguousarray(x[:, i]), out, equation.params)
            f[:, i] = out
        self._run[1][0] += times.size
        off = np.abs(np.array([f, p, x]) - self._basis.interpolate_between(values)).max(axis=2)
        defect = np.zeros(p.shape[0])
        for c, q, k, kappa, _ in _rows(form):
            defect[c] += abs(kappa) * h ** form.orders[k] * off[q, c]
        # the basis itself shows in the dense output alone
        return np.maximum(defect, _SHARE * off[1:].max(axis=0))

    def _past(self, distances):
        """p(0) and what lies before, as p sees it `distances` after the present, shape (d, k)."""
        form = self._form
        base = np.repeat(form.initial[:, None], distances.size, axis=1)
        if self._last is None:
            return base
        # the last step exactly, for the modes do not reach so close; all before it by its modes
        length, drivers = self._last_drivers()
        end = self._last[2][:, :, -1]
        base += self._run[7] @ np.exp(-np.multiply.outer(self._bank.rates, length + distances))
        _, v, weights = graded_rule()
        x = distances / length
        for c, q, k, kappa, offset in _rows(form):
            a = form.orders[k]
            seen = (weights * np.add.outer(x, v) ** (a - 1)) @ (drivers[q, c] - offset)
            seen += (end[q, c] - offset) * ((LEFT_OUT + x) ** a - x**a) / a
            base[c] += kappa * length**a * rgamma(a) * seen
        return base

    def _last_drivers(self):
        """Length of the last step, and f, p, y at the points of the graded rule, (3, d, k)."""
        basis, length, values = self._last  # type: ignore[misc]
        u, _, _ = graded_rule()
        at = legvander(2 * u - 1, self._s - 1) @ self._rule[2] if basis is None else basis.at(u)
        return length, values @ at.T

    def _take(self, piece, t_stop):
        """Move to the end of a step out of a corner."""
        clock, _, steps, x, p, largest, modes, *_ = self._run
        h, values = piece.length, piece.values
        closest = self._rule[0][0] * h / _ROOM
        if self._last is None:
            closest, far = _decades(closest, self._far)
            self._bank = open_bank(self._form.orders.tolist(), closest, far, self._modes_tol)
            modes = np.zeros((x.size, self._bank.rates.size))
        elif closest < self._bank.closest:
            self._come_closer(closest)
            modes = self._run[6]
        self._last, self._at_corner = (piece.basis, h, values), False
        x[:], p[:] = values[POSITION, :, -1], values[PRIMARY, :, -1]
        speeds = np.maximum(largest, np.abs(values[PRIMARY]).max(axis=1))
        largest[:] = np.where(self.second, speeds, 0.0)
        end = t_stop if h == t_stop - piece.start else piece.start + h
        clock[:] = end, h, 0.0, self._bank.closest
        steps[0] += 1
        self._run = (*self._run[:6], self._moved(modes), modes, self._run[8])

    def _moved(self, modes):
        """What modes before the last step are after it."""
        form, bank = self._form, self._bank
        length, drivers = self._last_drivers()
        _, v, weights = graded_rule()
        damped = np.exp(-np.multiply.outer(bank.rates * length, v)) * weights
        moved = modes * np.exp(-bank.rates * length)
        for c, q, k, kappa, offset in _rows(form):
            moved[c] += length * kappa * bank.weights[k] * (damped @ (drivers[q, c] - offset))
        return moved

    def _come_closer(self, closest):
        """Refit the modes to reach closer; the new, fast ones have seen the last step alone."""
        n = self._bank.rates.size
        self._bank = self._bank.closer(closest / _ROOM)
        more = ((0, 0), (0, self._bank.rates.size - n))
        modes, before = (np.pad(array, more) for array in self._run[6:8])
        modes[:, n:] = self._moved(np.zeros_like(modes))[:, n:]
        self._run[0][3] = self._bank.closest
        self._run = (*self._run[:6], modes, before, self._run[8])


def _rows(form):
    """Component, driver, index of the order, kappa and offset of each integral."""
    return [(int(c), int(q), int(k), kappa, o) for c, q, k, kappa, o in form.channels]


def _decades(closest, farthest):
    """The same interval, widened so that many runs share one bank."""
    ratio = 10.0 ** math.ceil(math.log10(max(farthest / closest, 10.0)))
    return farthest / ratio, farthest
