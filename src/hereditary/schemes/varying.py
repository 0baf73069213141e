"""Orders that vary (floor 2): the weights of each step, worked out a stretch of steps at a time.

A scheme sees the operators at t_n + offset h, with the orders there. What its march needs of a
step, kernels/varying.py tells.
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from scipy.special import gamma

from .._checks import complaint
from ..kernels.varying import HEAD, PER_TERM
from ..operators import OrderFailed, VaryingOrder, derivative_order
from ..special import alternating_power_sum
from ..system import System
from .scheme import Plan, distinct_components

# Steps at which orders are looked at before a run.
_LOOKED_AT = 1001
# Exponents 1 - p that rounding takes for 0 count as this: then too their share stays what it is.
LEAST = 1e-290
# The alternating sum of the weights as a polynomial, to 1e-13: zeta itself takes ten times as long.
_ALTERNATING = Chebyshev.interpolate(alternating_power_sum, 10, (0, 1)).convert(kind=Polynomial)


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
    theta : float
    """

    def __init__(self, system: System, h: float, theta: float, explicit: bool):
        distinct, self.classes = distinct_components(system)
        self.theta, self._h, self._explicit = theta, h, explicit
        self._table = np.zeros((1, 0))
        self._offset, self._drifts = 0.0 if explicit else theta, system.m == 2
        self._terms = [[(c, _Order.of(order)) for c, order in key] for key in distinct]
        self.derivatives = np.zeros((len(distinct), max(map(len, distinct))))
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
                total = self._fill_class(block, terms, powers, steps[:n_good])
                sound = (total != 0) & np.isfinite(total)
                if not sound.all():
                    n_good = int(np.argmin(sound))
                    required = "give a finite, nonzero leading weight"
                    at = f"{total[n_good]} at t = {steps[n_good] * self._h:.6g}"
                    trouble = complaint("terms", required, at, "take another step")
        self._table = table
        return n_good, trouble

    def limits(self, steps: np.ndarray) -> np.ndarray:
        """Stiffness at which the explicit scheme zigzags, orders frozen, shape (n, d).

        For steps of the table that was filled last.
        """
        seen = self._table[:, steps - int(self._table[0, 0])]
        limits = np.zeros((steps.size, len(self._terms)))
        for a, terms in enumerate(self._terms):
            block = seen[1 + a * self._per_class :]
            for j, (_, order) in enumerate(terms):
                share, p = block[HEAD + PER_TERM * j], block[HEAD + PER_TERM * j + 1]
                limits[:, a] += share * _ALTERNATING(p) * 2 * order.derivative
            limits[:, a] /= block[0]
        return limits[:, self.classes]

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

    def _fill_class(self, block, terms, powers, steps):
        """Fill the rows of a class; return its leading weight at each step."""
        h, theta = self._h, self.theta
        block[...] = 0.0
        for j, (c, order) in enumerate(terms):
            p, m = powers[order], order.derivative
            scale = c * np.exp((p - m) * np.log(h))
            weight = scale / gamma(p + 1)
            at = 1.0 if m == 2 else theta  # where the nearest interval ends
            first = at**p if at < 1 else 1.0
            second = np.exp(p * np.log(1 + at))
            # the nearest weight W_0 adds to the lead, W_1 to what is near
            block[0] += weight * first
            if self._explicit:  # solved for w_n - w_(n-1), so W_0 + W_1 is near
                block[1] += weight * (second if m == 1 else second - 1)
            else:
                block[1] += weight * (second - first if m == 1 else second - 2)
            if m == 1 and self._drifts:  # t x'(0), which the increments leave out
                block[2] += weight * (steps + self._offset) ** p
            own = block[HEAD + PER_TERM * j :]
            # 1/(Gamma(p) Gamma(1-p)) = sin(pi p)/pi, by NumPy's tangent, four times as fast
            half = np.tan(0.5 * np.pi * np.minimum(p, np.maximum(1 - p, LEAST)))
            own[0], own[1], own[2] = weight, p, scale * half / (0.5 * np.pi * (1 + half * half))
        total = block[0].copy()
        block[1:HEAD] /= total
        block[HEAD::PER_TERM] /= total
        block[HEAD + 2 :: PER_TERM] /= total
        block[0] = 1 / total
        return total


@dataclass(frozen=True)
class _Order:
    """An order, constant or not."""

    derivative: int
    constant: float
    varying: VaryingOrder | None

    @classmethod
    def of(cls, order):
        """That of a term in `distinct_components`."""
        if isinstance(order, VaryingOrder):
            return cls(order.derivative, 0.0, order)
        return cls(derivative_order(order), order, None)

    def powers(self, times):
        """p = m - alpha at some times up to the first bad one, and what is wrong with that."""
        if self.varying is None:
            return np.full(times.size, self.derivative - self.constant), ""
        values, trouble = self.varying.sampled(times)
        return self.derivative - values, trouble


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

    def orbit(self, d):
        """The region of the first d components."""
        # as in systems of constant orders: one Jacobian by differences takes 2 d calls
        return FrozenLimits(self.schedule, d, 32 * ((d + 1) // 2))

    def ratio(self, jacobians, steps):
        """Largest ratio of a real eigenvalue to its limit over Jacobians (k, d, d) at `steps`."""
        if steps.size == 0:
            return 0.0
        scaled = -jacobians / self.schedule.limits(steps)[:, : self.d, None]
        scaled = scaled[np.isfinite(scaled).all(axis=(1, 2))]
        if self.d == 1:
            return max(0.0, float(scaled.max(initial=0.0)))
        values = np.linalg.eigvals(scaled)
        real = np.abs(values.imag) <= 1e-9 * np.abs(values)
        return max(0.0, float(np.where(real, values.real, 0.0).max(initial=0.0)))


def varies(system):
    """Whether an order varies."""
    return any(isinstance(term, VaryingOrder) for term, _ in system.memories)


def varying_plan(system, h, theta, march, explicit):
    """Plan of a scheme on an equation with orders that vary, for `march`."""
    schedule = Schedule(system, h, theta, explicit)
    shift = h * system.y0[1] if system.m == 2 else np.zeros(system.d)
    return Plan(
        convolution=None,
        classes=schedule.classes,
        numbers=np.array([h, theta]),
        flags=(system.highest_orders() > 1).astype(np.int64),
        columns=np.zeros((0, system.d)),
        data=shift[None],
        n_lasting=1,
        initial=system.y0[0],
        increments=shift.copy(),
        region=FrozenLimits(schedule, system.d, 0) if explicit else None,
        schedule=schedule,
        march=march,
    )
