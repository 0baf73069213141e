"""State of an adaptive march: the orbit and tangents alongside (floor 4).

Strand 0 is the orbit, the others its derivatives along some directions. Each has its present
values, initial values, and the past: modes, and the last step, which they do not see closely.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.special import rgamma

from ..kernels.collocation import ITSELF, POSITION, PRIMARY, SLOPE
from ..kernels.structures import Equations
from ..kernels.structures import Strands as CompiledStrands
from .exponential_basis import Bank, OrderBank, open_bank, open_kernels, open_order_bank
from .power_basis import LEFT_OUT, graded_rule
from .quadrature import to_legendre


class Strands:
    """Arrays whose first axis runs over the orbit and k tangents.

    Parameters
    ----------
    form : Form
    y0 : ndarray, shape (1 + k, m, d)
        Initial values of the orbit and their derivatives along each direction.
    n_nodes : int
        Nodes of an ordinary step.

    Attributes
    ----------
    x, p : ndarray, shape (1 + k, d)
        y, and the primary unknown, at present.
    initial, offsets : ndarray, shape (1 + k, d) and (1 + k, n)
        p(0) with all of the past that does not fade, none where p is implicit, and what is taken
        from each integral's driver.
    modes, before : ndarray, shape (1 + k, R, M)
        Modes of each row of the form, now and before the last step, and behind them those without
        weights for the drivers of orders that vary; the modes of general kernels, and then of such
        orders, last.
    last : ndarray, shape (1 + k, 3 or 4, d, s)
        f, p and y, and p' where it is a driver, at the nodes of the last ordinary step.
    bank : Bank
    kernels : KernelBank
    varying : OrderBank
    rates, own : ndarray, shape (M,)
        Of all modes; 1 for those of orders that vary.
    weights, masses : ndarray, shape (n_a + n_k, M) and (n_k,)
        Of all modes in each fractional integral and general kernel, and point masses of the latter;
        orders that vary have zeros behind these.
    """

    def __init__(self, form, y0, n_nodes):
        self._form = form
        n_strands, _, d = y0.shape
        self.x = y0[:, 0].copy()
        self.initial = np.where(form.second == 1, y0[:, -1], y0[:, 0])
        self.p = self.initial.copy()
        starts = np.array([0 * self.initial, self.initial, y0[:, 0]])
        components = form.terms.row % d
        self.offsets = np.ascontiguousarray(starts[form.offset_of, :, components].T)
        self.initial[:, form.implicit == 1] = 0.0
        self._n_rows = form.n_rows + d * form.raw.size
        self.modes = self.before = np.zeros((n_strands, self._n_rows, 0))
        self.last = np.zeros((n_strands, form.n_drivers, d, n_nodes))
        self.bank = Bank((), np.inf, 0.0, 0.0, np.zeros(0), np.zeros((0, 0)), 1.0)
        self.kernels = open_kernels((), 1.0, 1.0, 1.0, 0.1)
        self.varying = OrderBank(np.inf, 0.0, 0.0, np.zeros(0))
        self._length, self._corner, self._foreseen = 0.0, None, None
        self._join()

    @property
    def farthest(self):
        """Distance up to which all modes hold; 0 where there are none."""
        return min(self.bank.farthest, self.kernels.farthest)

    @property
    def closest(self):
        """Distance that all modes reach down to."""
        return max(self.bank.closest, self.varying.closest if self._form.varying else 0.0)

    def __getstate__(self):
        """All but what the banks hold anyway, and the form, for functions need not pickle."""
        left_out = ("rates", "weights", "masses", "own", "_form")
        return {name: value for name, value in vars(self).items() if name not in left_out}

    def adopt(self, form):
        """Go on, from a state, with the form that the state left out."""
        self._form = form
        self._join()

    def _join(self):
        """Put the modes of all banks side by side."""
        banks = (self.bank, self.kernels, self.varying)
        self.rates = np.concatenate([bank.rates for bank in banks])
        (n_a, m), (n_k, more) = self.bank.weights.shape, self.kernels.weights.shape
        n_varying = len(self._form.varying)
        self.weights = np.zeros((n_a + n_k + n_varying, self.rates.size))
        self.weights[:n_a, :m] = self.bank.weights
        self.weights[n_a : n_a + n_k, m : m + more] = self.kernels.weights
        self.masses = np.append(self.kernels.masses, np.zeros(n_varying))
        self.own = np.repeat([0.0, 1.0], [m + more, self.varying.rates.size])

    def equations(self):
        """Return the integral equations as compiled code takes them."""
        form = self._form
        parts = form.terms, form.orders, form.second, self.offsets, form.implicit, form.raw
        return Equations(*parts)

    def compiled(self):
        """Return all strands as compiled code takes and changes them."""
        present = self.initial, self.x, self.p
        return CompiledStrands(*present, self.modes, self.before, self.last)

    def arrays(self):
        """Everything that is linear in a strand."""
        own = [self.x, self.p, self.initial, self.offsets, self.modes, self.before, self.last]
        return own if self._corner is None else [*own, self._corner[1]]

    def transform(self, matrix):
        """Replace the tangents by linear combinations, ``tangent <- tangent @ matrix``."""
        for array in self.arrays():
            array[1:] = np.tensordot(matrix.T, array[1:], axes=1)

    def step(self, length):
        """Note that the last step was an ordinary one of this length."""
        self._length, self._corner = length, None

    def foresee(self, closest, farthest, t_end, tol):
        """Fit kernels known by their values before anything is solved; the largest error."""
        if not any(kernel.by_values for kernel in self._form.kernels):
            return 0.0
        closest = _decades(closest, farthest)
        found = open_kernels(self._form.kernels, closest, farthest, t_end, tol)
        self._foreseen = closest, found
        return found.error

    def begin(self, closest, farthest, t_end, tol):
        """Open the modes."""
        closest = _decades(closest, farthest)
        self.bank = open_bank(self._form.orders.tolist(), closest, farthest, tol)
        if self._foreseen and self._foreseen[0] <= closest:
            self.kernels = self._foreseen[1]
        else:
            self.kernels = open_kernels(self._form.kernels, closest, farthest, t_end, tol)
        if self._form.varying:
            self.varying = open_order_bank(closest, farthest, tol)
        self._join()
        self.modes = np.zeros((self.x.shape[0], self._n_rows, self.rates.size))
        self.before = self.modes.copy()

    def leave(self, basis, length, values):
        """Move to the end of a step out of a corner, f, p and y at its nodes (1 + k, 3, d, n)."""
        self._length, self._corner = length, (basis, values)
        self.x[:], self.p[:] = values[:, POSITION, :, -1], values[:, PRIMARY, :, -1]
        if self.bank.rates.size and self.bank.rates[0] == 0.0:  # as in kernels/adaptive.py
            d = self.x.shape[1]
            self.initial += self.modes[:, :d, 0]
            self.modes[:, :d, 0] = 0.0
        self.before = self.modes
        self.modes = self._moved(self.before)

    def take_jump(self, p, x):
        """Go to these values, (1 + k, d), at once; the modes take in the jump of p."""
        d = x.shape[1]
        for c, q, k, kappa in rows(self._form):
            if q == SLOPE and k != ITSELF:
                self.modes[:, c] += kappa * self.weights[k] * (p - self.p)[:, c % d, None]
        self.p, self.x = p, x

    def come_closer(self, closest):
        """Refit the modes to reach closer; the new, fast ones have seen the last step alone."""
        n, end = self.bank.rates.size, self.rates.size
        self.bank = self.bank.closer(closest)
        if self._form.varying:
            self.varying = self.varying.closer(closest)
        self._join()
        n_new = self.bank.rates.size
        gaps = [np.zeros((*self.modes.shape[:2], n_new - n))]
        gaps.append(np.zeros((*self.modes.shape[:2], self.rates.size - end - n_new + n)))
        self.modes, self.before = (
            np.concatenate([old[..., :n], gaps[0], old[..., n:], gaps[1]], axis=2)
            for old in (self.modes, self.before)
        )
        added = np.r_[n:n_new, end + n_new - n : self.rates.size]
        self.modes[..., added] = self._moved(np.zeros_like(self.modes))[..., added]

    def past(self, log_distances):
        """p(0) and what lies before, as rows see it from these distances, shape (1 + k, R, n).

        By their logarithms: tiny powers tell distances apart that are too small for a float.
        """
        n_strands, d = self.x.shape
        distances = np.exp(log_distances)
        base = np.zeros((n_strands, self._form.n_rows, distances.size))
        base[:, :d] += self.initial[..., None]
        if self._length == 0.0:
            return base
        n = self.bank.rates.size
        base += self.modes[..., n:] @ np.exp(-np.multiply.outer(self.kernels.rates, distances))
        # the last step exactly, for these modes do not reach so close; all before it by its modes
        ages = np.multiply.outer(self.bank.rates, self._length + distances)
        base += self.before[..., :n] @ np.exp(-ages)
        _, v, weights = graded_rule()
        log_u, drivers = log_distances - np.log(self._length), self._drivers()
        u = np.exp(log_u)
        for row, (c, q, k, kappa) in enumerate(rows(self._form)):
            if k >= self._form.orders.size:
                continue  # seen already
            a, offset = self._form.orders[k], self.offsets[:, row, None]
            kernel = weights * np.add.outer(u, v) ** (a - 1)
            seen = (drivers[:, q, c] - offset) @ kernel.T
            end = (self.x if q == POSITION else self._ends(q))[:, c, None] - offset
            seen += end * ((LEFT_OUT + u) ** a - np.exp(a * log_u)) / a
            base[:, c] += kappa * self._length**a * rgamma(a) * seen
        return base

    def _ends(self, q):
        values = self.last if self._corner is None else self._corner[1]
        return values[:, q, :, -1]

    def _drivers(self):
        """Drivers of the last step at the points of the graded rule, (1 + k, 3 or 4, d, n)."""
        u, _, _ = graded_rule()
        if self._corner is not None:
            basis, values = self._corner
            return values @ basis.at(u).T
        s = self.last.shape[-1]
        return self.last @ (legvander(2 * u - 1, s - 1) @ to_legendre(s)).T

    def _moved(self, modes):
        """Move modes from before the last step to after it."""
        rates, drivers = self.rates * self._length, self._drivers()
        weights, d = self.weights, self.x.shape[1]
        _, v, rule = graded_rule()
        damped = np.exp(-np.multiply.outer(rates, v)) * rule
        moved = modes * np.exp(-rates)
        for b, q in enumerate(self._form.raw):
            share = drivers[:, q] @ damped.T
            moved[:, (2 + b) * d : (3 + b) * d] += self._length * self.own * share
        for row, (c, q, k, kappa) in enumerate(rows(self._form)):
            if k == ITSELF:
                continue
            share = (drivers[:, q, c % d] - self.offsets[:, row, None]) @ damped.T
            moved[:, c] += self._length * kappa * weights[k] * share
        return moved


def rows(form):
    """Row, driver, index of the order or kernel and kappa of each integral."""
    return form.terms.tolist()


def _decades(closest, farthest):
    """A distance that is no farther, such that many runs share one bank."""
    return farthest / 10.0 ** math.ceil(math.log10(max(farthest / closest, 10.0)))


def starts(equation, second, directions):
    """Initial values of orbit and tangents, shape (1 + k, m, d)."""
    if directions is None:
        return equation.y0[None]
    values = np.zeros((1 + directions.shape[1], *equation.y0.shape))
    values[0] = equation.y0
    values[1:, 0] = directions[: equation.d].T
    if equation.m == 2:
        values[1:, 1, second] = directions[equation.d :].T
    return values
