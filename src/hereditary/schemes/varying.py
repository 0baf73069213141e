"""Orders that vary (floor 2): the weights of each step, worked out a stretch of steps at a time.

A scheme sees the operators at t_n + offset h, with the orders there. What its march needs of a
step, kernels/varying.py tells.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.polynomial.polynomial import polyval

from .._checks import complaint
from ..kernels.orders import divide_by_lead, fill_term
from ..kernels.varying import HEAD, PER_TERM
from ..orders import OrderFailed
from ..special import alternating_power_sum
from ..system import System
from .beside import KernelTerms
from .scheme import Plan, distinct_components

# Steps at which orders are looked at before a run.
_LOOKED_AT = 1001
# Exponents 1 - p that rounding takes for 0 count as this: then too their share stays what it is.
LEAST = 1e-290
# The alternating sum of the weights as a polynomial, to 1e-13: zeta itself takes ten times as long.
# Coefficients in 2 p - 1.
_ALTERNATING = (
    Chebyshev(Chebyshev.interpolate(alternating_power_sum, 10, (0, 1)).coef)
    .convert(kind=Polynomial)
    .coef
)


class Schedule:
    """The steps of one scheme on one equation with orders that vary.

    Parameters
    ----------
    system : System
    h : float
        Step [time].
    theta : float
        Where in a step the scheme sees first derivatives, (0, 1] [-].
    explicit : bool
        Whether the orders are those at t_n, and the march solves for changes of increments;
        otherwise those at t_n + theta h, and for the increments.

    Attributes
    ----------
    classes : ndarray of int64, shape (d,)
        Class of each component.
    derivatives : ndarray, shape (C, T)
        m of each term of each class; 0 for none.
    others : tuple of KernelTerms
        The terms of each class with other kernels.
    theta : float
    """

    def __init__(self, system: System, h: float, theta: float, explicit: bool):
        distinct, self.classes = distinct_components(system)
        self.theta, self._h, self._explicit = theta, h, explicit
        self._table, self._room = np.zeros((1, 0)), np.zeros((4, 0))
        self._offset, self._drifts = 0.0 if explicit else theta, system.m == 2
        self._terms, others = [], []
        for key in distinct:
            own = [(c, operator) for c, operator in key if operator.kernel is not None]
            others.append(KernelTerms.seen(own, h, theta, self._offset))
            self._terms.append([(c, operator) for c, operator in key if operator.kernel is None])
        self.others = tuple(others)
        self.derivatives = np.zeros((len(distinct), max(map(len, self._terms))))
        for row, terms in zip(self.derivatives, self._terms, strict=True):
            row[: len(terms)] = [order.derivative for _, order in terms]

    def check(self, n_end: int) -> None:
        """Look at the orders of a run to step `n_end`; raise `OrderFailed` where one is bad."""
        steps = np.unique(np.linspace(0, n_end - 1, _LOOKED_AT).astype(int))
        *_, trouble = self._powers(steps)
        if trouble:
            raise OrderFailed(trouble)

    def fill(self, table: np.ndarray, first: int, n_end: int) -> tuple[int, str]:
        """Fill the table of the steps from `first` on, as kernels/varying.py takes it.

        Steps beyond `n_end` are given the orders of the last step before it.

        Parameters
        ----------
        table : ndarray, shape (n_rows, n)
        first, n_end : int

        Returns
        -------
        n_good : int
            So many steps are good.
        trouble : str
            What is wrong with the next one; empty where all are good.
        """
        n = np.arange(first, first + table.shape[1])
        table[0] = n
        with np.errstate(all="ignore"):  # a weight that is none ends the run below
            steps = np.minimum(n, n_end - 1)
            powers, n_good, trouble = self._powers(steps)
            for a, terms in enumerate(self._terms):
                block = table[1 + a * self._per_class :][: self._per_class, :n_good]
                self._fill_class(block, terms, self.others[a], powers, steps[:n_good])
                sound = divide_by_lead(block, HEAD, PER_TERM)
                if sound < n_good:
                    n_good = sound
                    required = "give a finite, nonzero leading weight"
                    at = f"{1 / block[0, sound]} at t = {steps[sound] * self._h:.6g}"
                    trouble = complaint("terms", required, at, "take another step")
        self._table = table
        return n_good, trouble

    def limits(self, steps: np.ndarray) -> np.ndarray:
        """Stiffness at which the explicit scheme zigzags, orders frozen, shape (n, d).

        For steps of the table that was filled last.
        """
        at = steps - int(self._table[0, 0])
        limits = np.zeros((len(self._terms), steps.size))
        for a, terms in enumerate(self._terms):
            block = self._table[1 + a * self._per_class :]
            for j, (_, order) in enumerate(terms):
                share, p = (block[HEAD + PER_TERM * j + k, at] for k in (0, 1))
                limits[a] += share * polyval(2 * p - 1, _ALTERNATING) * (2 * order.derivative)
            limits[a] = limits[a] / block[0, at] + self.others[a].limit()
        return limits.T[:, self.classes]

    @property
    def n_rows(self) -> int:
        """Rows of the table."""
        return 1 + self.derivatives.shape[0] * self._per_class

    @property
    def _per_class(self):
        return HEAD + PER_TERM * self.derivatives.shape[1]

    def _powers(self, steps):
        """p = m - alpha of each order at `steps`, how many are good, and what then goes wrong."""
        times = (steps + self._offset) * self._h
        found, n_good, trouble = {}, steps.size, ""
        for order in dict.fromkeys(order for terms in self._terms for _, order in terms):
            found[order], reason = order.powers(times[:n_good])
            if reason:
                n_good, trouble = found[order].size, reason
        return {order: p[:n_good] for order, p in found.items()}, n_good, trouble

    def _fill_class(self, block, terms, others, powers, steps):
        """Fill the rows of a class, not yet divided by its leading weight."""
        h, theta = self._h, self.theta
        (lead, near), whole = others.nearest()
        block[0], block[1] = lead, near
        block[2:HEAD] = 0.0
        # rooms of their own: fresh ones of this size are handed back to the system each time
        first, second, elapsed, scale = self._rooms(steps.size)
        for j, (c, order) in enumerate(terms):
            p, m = powers[order], order.derivative
            at = 1.0 if m == 2 else theta  # where the nearest interval ends
            _power(at, p, first)
            _power(1 + at, p, second)
            if not self._explicit:
                second -= first if m == 1 else 2.0
            elif m == 2:  # solved for w_n - w_(n-1), so W_0 + W_1 is near
                second -= 1.0
            drift = elapsed[:0]
            if m == 1 and self._drifts:  # t x'(0), which the increments leave out
                drift = np.power(steps + self._offset, p, out=elapsed)
            _power(h, p, scale)
            own = block[HEAD + PER_TERM * j :][:PER_TERM]
            factor = c * np.exp(-m * np.log(h))
            fill_term(p, scale, factor, first, second, drift, LEAST, block[:HEAD], own)
        block[HEAD + PER_TERM * len(terms) :] = 0.0
        if self._explicit:
            block[1] += lead
        if others:
            # what is older than two increments is the history's
            block[2] += whole.sum()
            late = int(self._explicit)
            for n in np.flatnonzero(steps < 2):
                step = steps[n]
                block[2, n] += whole[: max(0, step + 1 - late)].sum() - whole.sum()
                block[3, n] = others.value(step)

    def _rooms(self, n):
        """Four rows of n numbers."""
        if self._room.shape[1] < n:
            self._room = np.zeros((4, n))
        return self._room[:, :n]


def _power(base, p, out):
    """base**p for all p; 1 where the base is."""
    if base == 1.0:
        out[:] = 1.0
        return
    np.multiply(p, np.log(base), out=out)
    np.exp(out, out=out)


@dataclass(frozen=True, eq=False)
class FrozenLimits:
    """Where the explicit scheme is stable when the orders are frozen at each step.

    Attributes
    ----------
    schedule : Schedule
    d : int
        Components of the orbit.
    every : int
        Steps between two Jacobians.
    """

    schedule: Schedule
    d: int
    every: int
    sweeps: ClassVar[bool] = False

    def orbit(self, d):
        """The region of the first d components."""
        # as in systems of constant orders: one Jacobian by differences takes 2 d calls
        return FrozenLimits(self.schedule, d, 32 * ((d + 1) // 2))

    def ratios(self, jacobians, steps):
        """Largest ratio of a real eigenvalue to its limit, for each of Jacobians at `steps`."""
        if steps.size == 0:
            return np.zeros(0)
        scaled = -jacobians / self.schedule.limits(steps)[:, : self.d, None]
        scaled = np.where(np.isfinite(scaled).all(axis=(1, 2))[:, None, None], scaled, 0.0)
        values = np.linalg.eigvals(scaled)
        real = np.abs(values.imag) <= 1e-9 * np.abs(values)
        return np.where(real, values.real, 0.0).max(axis=1, initial=0.0)


def varying_plan(system, h, theta, march, explicit):
    """Plan of a scheme on an equation with orders that vary, for `march`."""
    schedule = Schedule(system, h, theta, explicit)
    shift = h * system.y0[1] if system.m == 2 else np.zeros(system.d)
    none = np.zeros(system.d)
    return Plan(
        convolution=None,
        classes=schedule.classes,
        h=h,
        initial=system.y0[0],
        increments=shift,
        lead=none,
        near=none,
        scale=none,
        shift=shift,
        given=(system.highest_orders() > 1).astype(np.int64),
        first=none,
        starts=system.y0[:1],
        theta=theta,
        region=FrozenLimits(schedule, system.d, 0) if explicit else None,
        schedule=schedule,
        march=march,
    )
