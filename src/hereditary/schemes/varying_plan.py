"""Orders that vary: the weights of each step, computed for a batch of steps at a time.

A scheme sees the operators at t_n + offset h, with the orders there.
"""

import math

import numpy as np
from scipy.special import rgamma

from ..compiled.order_weights import fill_term, invert_lead
from ..compiled.signatures import StepRows
from ..compiled.watch import SLOWEST
from ..equation.orders import OrderFailed
from ..equation.system import System
from ..kernels.special import power_second_differences
from ..support.checks import complaint
from .riemann_liouville import first_samples
from .scheme import Plan, distinct_columns

# Steps at which orders are looked at before a run.
_LOOKED_AT = 1001
# Steps whose weights are worked out at once; a multiple begins each stretch, so that a run that is
# resumed works them out in the same arrays. With half as many the run takes a tenth longer.
_STRETCH = 16384
# Steps that are worked out together at the end of a run, more than NumPy treats at once.
_GROUP = 64
# Exponents 1 - p that rounding takes for 0 count as this: then too their share stays what it is.
LEAST = 1e-290


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
    groups : ndarray of int64, shape (d,)
        Group of each component, of the same terms.
    derivatives : ndarray, shape (C, T)
        m of each term of each group; 0 for none.
    theta : float
    rows : StepRows
        Of the newest batch of steps.
    size : int
        Number of rows of a batch.
    amplitudes, powers, kernels : ndarray, shape (C T, n)
        ``coefficient h**-alpha / Gamma(p + 1)`` over the leading weight, p, and the former times
        ``sin(pi p) / pi``-like shares of the kernel as an integral over its rates.
    """

    def __init__(self, system: System, h: float, theta: float, explicit: bool):
        found, self.groups = distinct_columns(system)
        distinct, reads = zip(*found, strict=True)
        # an explicit step leaves memory that f reads for the next one, where t x'(0) is a step on
        self._late = [float(explicit and read) for read in reads]
        self.theta, self._h, self._explicit = theta, h, explicit
        self._offset, self._drifts = 0.0 if explicit else theta, system.m == 2
        self._terms = distinct
        self.derivatives = np.zeros((len(distinct), max(map(len, distinct))))
        for row, terms in zip(self.derivatives, self._terms, strict=True):
            row[: len(terms)] = [operator.derivative for _, operator in terms]
        ones, table = np.ones(_STRETCH), np.zeros((3, len(distinct), _STRETCH))
        self._lead, self._near, scale = table
        scale[:] = 1.0
        from_zero = any(operator.from_zero for terms in distinct for _, operator in terms)
        # factors of x'(0), and of x(0) in Riemann-Liouville terms
        self._drift = np.zeros((1 + from_zero, len(distinct), _STRETCH))
        self.rows = StepRows(
            first=0,
            last=_STRETCH - 1,
            times=np.zeros(0),
            theta=self._offset * ones,
            unit=h * ones,
            length=ones,
            ratio=ones,
            lead=self._lead,
            near=self._near,
            scale=scale,
            drift=self._drift.reshape(-1, _STRETCH),
        )
        self.size, self._room = 0, np.zeros((4, _STRETCH))
        shape = (3, self.derivatives.size, _STRETCH)
        self.amplitudes, self.powers, self.kernels = np.zeros(shape)
        self._n_end, self._known, self._trouble = 0, (0, 0, 0), ""

    def prepare(self, n_end: int) -> None:
        """Check the orders at about a thousand steps up to `n_end`, before the run begins.

        Raises `OrderFailed` where one is outside its range, or its function raises.
        """
        if n_end <= self._n_end:
            return
        steps = np.unique(np.linspace(0, n_end - 1, _LOOKED_AT).astype(int))
        *_, trouble = self._sampled(steps)
        if trouble:
            raise OrderFailed(trouble)
        self._n_end = n_end

    def reach(self, n: int):
        """Fill the rows of the batch of steps that contains step n, unless they are in place.

        Returns
        -------
        end : int
            First step after the filled ones.
        rows : StepRows
            Another tuple than before where this call filled them.
        """
        first, last, n_end = self._known
        # beyond the run's end, as it was then, orders were not asked for
        if not first <= n < min(last, n_end):
            first = n // _STRETCH * _STRETCH
            # whole groups, so that a longer run works these steps out in the same way
            self.size = min(_STRETCH, math.ceil((self._n_end - first) / _GROUP) * _GROUP)
            last = first + self._fill(first, self.size)
            self._known = (first, last, self._n_end)
            self.rows = self.rows._replace(first=first)
        if n >= last:
            raise OrderFailed(self._trouble)
        return min(last, self._known[2]), self.rows

    def direct(self, first, last, k_end):
        """Return weights of u_(n-k), 2 <= k < k_end, at steps n of the batch."""
        rows = slice(first - self.rows.first, last - self.rows.first)
        n_groups, n_terms = self.derivatives.shape
        found, k = np.zeros((n_groups, last - first, k_end)), np.arange(2.0, k_end)
        for index, m in enumerate(self.derivatives.ravel()):
            p, share = (table[index, rows, None] for table in (self.powers, self.amplitudes))
            at = k - 1 + self.theta
            if m == 2:
                weights = power_second_differences(p, k_end)[:, 2:]
            else:
                weights = np.expm1(p * np.log1p(1 / at))
                weights *= np.exp(p * np.log(at))
            if m > 0:
                weights *= share
                found[index // n_terms, :, 2:] += weights
        return found

    def has_memory(self) -> bool:
        """Return True: orders that vary have weights beyond k = 1."""
        return True

    def exact(self, n):
        """Return no weights: a block has one step."""
        return (np.zeros((len(self.derivatives), 0)),) * 2

    def check(self, history):
        """Refuse a history that takes constant orders only."""
        if not history.takes_varying:
            required = "be Direct or SumOfExponentials where orders vary"
            raise ValueError(complaint("history", required, repr(history)))

    def _sampled(self, steps):
        """Return p = m - alpha of each order at `steps`, the number of good ones, and a fault."""
        times = (steps + self._offset) * self._h
        found, n_good, trouble = {}, steps.size, ""
        for operator in dict.fromkeys(operator for terms in self._terms for _, operator in terms):
            found[operator], reason = operator.powers(times[:n_good])
            if reason:
                n_good, trouble = found[operator].size, reason
        return {operator: p[:n_good] for operator, p in found.items()}, n_good, trouble

    def _fill(self, first, size):
        """Work out `size` steps from the first one on; return how many of them are good.

        Steps beyond the run's end are given the orders of the last step before it.
        """
        n = np.arange(first, first + size)
        with np.errstate(all="ignore"):  # a weight that is none ends the run below
            steps = np.minimum(n, self._n_end - 1)
            powers, n_good, self._trouble = self._sampled(steps)
            for a in range(len(self._terms)):
                self._fill_group(a, powers, steps[:n_good])
                sound = self._normalise(a, n_good)
                if sound < n_good:
                    n_good = sound
                    required = "give a finite, nonzero leading weight"
                    at = f"{1 / self._lead[a, sound]} at t = {steps[sound] * self._h:.6g}"
                    self._trouble = complaint("terms", required, at, "take another step")
        return n_good

    def _normalise(self, a, n):
        """Divide the rows of a group by its leading weight; return how many steps that suits."""
        lead, n_terms = self._lead[a, :n], self.derivatives.shape[1]
        sound = invert_lead(lead)
        for rows in (self._near, *self._drift):
            rows[a, :n] *= lead
        for row in range(a * n_terms, (a + 1) * n_terms):
            self.amplitudes[row, :n] *= lead
            self.kernels[row, :n] *= lead
        return sound

    def _fill_group(self, a, powers, steps):
        """Fill the rows of a group, not yet divided by its leading weight."""
        h, theta, terms = self._h, self.theta, self._terms[a]
        n, n_terms = steps.size, self.derivatives.shape[1]
        lead, near = self._lead[a, :n], self._near[a, :n]
        drifts = self._drift[0, a, :n]
        lead[:], near[:], self._drift[:, a] = 0.0, 0.0, 0.0
        # rooms of their own: fresh ones of this size are handed back to the system each time
        first, second, elapsed, scale = self._room[:, :n]
        for row, (c, operator) in enumerate(terms, a * n_terms):
            p, m = powers[operator], operator.derivative
            at = 1.0 if m == 2 else theta  # where the nearest interval ends
            _power(at, p, first)
            _power(1 + at, p, second)
            if not self._explicit:
                second -= first if m == 1 else 2.0
            elif m == 2:  # solved for w_n - w_(n-1), so W_0 + W_1 is near
                second -= 1.0
            drift = elapsed[:0]
            if m == 1 and self._drifts:  # t x'(0), which the increments leave out
                drift = np.power(steps + self._offset + self._late[a], p, out=elapsed)
            _power(h, p, scale)
            self.powers[row, :n] = p
            fill_term(
                p, scale, c * np.exp(-m * np.log(h)), first, second, drift, LEAST, lead, near,
                drifts, self.amplitudes[row, :n], self.kernels[row, :n],
            )  # fmt: skip
            if operator.from_zero:
                self._drift[1, a, :n] += c * self._initial(a, 1 - p, steps)

    def _initial(self, a, gamma, steps):
        """Return ``t**-gamma / Gamma(1-gamma)`` of each step, not at 0, the first one corrected."""
        times = (steps + self._offset) * self._h
        values = np.where(times > 0, times, np.inf) ** -gamma * rgamma(1 - gamma)
        # an explicit step of order above 1 is given the first increment
        at = int(self._explicit and self.derivatives[a].max() == 2) - int(steps[0])
        if 0 <= at < steps.size:
            (more,) = first_samples(float(gamma[at]), self._offset, 1)
            values[at] += more * self._h ** -gamma[at] * rgamma(1 - gamma[at])
        return values


def _power(base, p, out):
    """Return base**p for all p; 1 if the base is 1."""
    if base == 1.0:
        out[:] = 1.0
        return
    np.multiply(p, np.log(base), out=out)
    np.exp(out, out=out)


def varying_plan(system, h, theta, explicit):
    """Return the plan of a scheme on an equation with orders that vary."""
    if any(operator.kernel is not None for operator, _ in system.left):
        required = "be Caputo operators on given steps where an order varies"
        raise ValueError(complaint("terms", required, "one with a kernel", "use Collocation"))
    schedule = Schedule(system, h, theta, explicit)
    shift = h * system.y0[1] if system.m == 2 else np.zeros(system.d)
    return Plan(
        past=schedule,
        rows=schedule.rows,
        groups=schedule.groups,
        initial=system.at_start,
        increments=shift,
        shift=shift,
        given=(system.highest_orders() > 1).astype(np.int64) if explicit else None,
        slowest=SLOWEST if explicit else 0.0,
        drift=system.y0[:1] if any(operator.from_zero for operator, _ in system.left) else None,
    )
