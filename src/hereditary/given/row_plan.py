"""Plans of schemes whose weights differ from step to step: on a mesh, and if orders vary.

At time s in [t_j, t_(j+1)] the solution has the slope ``mean + lean (s - middle)``. This interval
adds ``mean m_0 + lean m_1`` to the derivative at time t. Here m_0 and m_1 are moments of the kernel
``p T**(p-1)``, T = t - s: ``m_0 = int p T**(p-1) dT``, ``m_1 = int p T**(p-1) (middle - T) dT``.
Above order 1 the velocity is a line between the middles of two steps. Its slope replaces the mean.
If an order varies, its value at the time of the right-hand side gives all weights of a step.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np

from ..equation.orders import OrderFailed
from ..equation.system import System
from ..equation.terms import derivative_of_one
from ..kernels.special import gauss_unit, mean_exponential
from ..stepping.scheme import Scheme
from ..support.checks import complaint, refuse
from .plan import Plan, distinct_columns
from .power_series import inverse_gamma
from .riemann_liouville import first_samples
from .signatures import StepRows
from .watch import SLOWEST

# Largest ratio of the lengths of two neighbouring steps at which the solution is a parabola. Beyond
# this ratio it is a line, because such steps meet at a corner or a singular point of the solution.
# A parabola would use values from the other side of this point.
_MAX_RATIO_OF_PARABOLA = 30.0
# Number of steps at which varying orders are checked before a run.
_LOOKED_AT = 1001
# Number of steps whose coefficients are computed together. Each batch starts at a multiple of this
# number, so that a resumed run computes the same floats.
ROWS_AT_ONCE = 16384
# The last batch of a run is rounded up to a multiple of this number of steps. NumPy's vector
# instructions treat fewer at once, so the length of a run does not change its coefficients.
_GROUP = 64


def moments(
    low: np.ndarray, width: np.ndarray, p: np.ndarray, bent: bool = True
) -> tuple[Any, ...]:
    """Return the moments m_0 and m_1 of ``p T**(p-1)`` over distances T in [low, low + width]."""
    # m_1 is 0 unless bent; low + width would round to low for a tiny step far away
    low = np.atleast_1d(low)
    high, nearest = low + width, low == 0.0
    beyond = np.where(nearest, 1.0, low)
    m_0, growth = p * np.log(np.where(nearest, high, beyond)), p * np.log1p(width / beyond)
    # in place, because new arrays of this size return to the operating system after each use
    np.copyto(np.expm1(growth, out=growth), 1.0, where=nearest)
    np.multiply(np.exp(m_0, out=m_0), growth, out=m_0)
    if not bent:
        return m_0, 0.0
    middle, m_1 = low + 0.5 * width, 0.0
    for node, weight in zip(*gauss_unit(16), strict=True):
        # the kernel's value in the middle has no first moment: subtracted, it avoids cancellation
        bend = np.expm1((p - 1.0) * np.log1p((node - 0.5) * width / middle))
        m_1 = m_1 + weight * (0.5 - node) * bend
    m_1 = p * width * width * middle ** (p - 1.0) * m_1
    # on wide intervals the closed form does not cancel
    closed = middle * m_0 - p / (p + 1.0) * (high ** (p + 1.0) - low ** (p + 1.0))
    return m_0, np.where(width > 2.0 * low, closed, m_1)


def _tilt(z: np.ndarray, average: np.ndarray, decay: np.ndarray) -> np.ndarray:
    """Return ``int_0^1 (1/2 - v) exp(-z v) dv``."""
    # average: mean of exp(-z v) over v in [0, 1]; decay: its value at v = 1
    square, series = np.minimum(z, 0.5) ** 2, np.zeros_like(z)
    for k in range(5, -1, -1):  # the rest of the series is below 1e-17 for z < 0.5
        series *= square
        series += 1 / (math.factorial(2 * k + 1) * (2 * k + 3) * 4 ** (k + 1))
    closed = 0.5 * average - (average - decay) / np.maximum(z, 0.5)
    return np.where(z < 0.5, np.sqrt(decay) * z * series, closed)


class _Uniform:
    """Distances between uniform steps: multiples of h instead of differences of times."""

    mesh: ClassVar = None

    def __init__(self, h: float, theta: float, offset: float) -> None:
        # step n takes first derivatives at t_n + theta h, and the right-hand side at t_n + offset h
        self.h, self._theta, self._offset = h, theta, offset

    def rows(self, n: np.ndarray) -> dict[str, Any]:
        """Return the fields of `StepRows` for steps n, (R,), that do not depend on the terms."""
        ones = np.ones(n.size)
        unit, theta = self.h * ones, self._offset * ones
        return {"times": np.zeros(0), "theta": theta, "unit": unit, "length": unit, "ratio": ones}

    def times(self, n: np.ndarray) -> np.ndarray:
        """Return the times at which steps n take their right-hand sides."""
        return (n + self._offset) * self.h

    def first_sample(self, gamma: Any) -> Any:
        """Return the correction of the first sample of ``t**-gamma``; see `first_samples`."""
        return self.h**-gamma * first_samples(gamma, self._offset, 1)[0]

    def intervals(self, n: np.ndarray, size: int, order: Any) -> tuple[Any, ...]:
        """Return distances and lengths of earlier steps; see `_Mesh.intervals`."""
        k, h = np.arange(float(size))[None], self.h
        far, width = np.maximum(k - 1 + self._theta, 0.0), np.where(k == 0, self._theta, 1.0)
        return np.ones((1, size)), h * far, h * width, h * k, h, h, 0.0

    def decays(
        self, rates: np.ndarray, kinds: np.ndarray, n: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return factors of modes; see `_Mesh.decays`."""
        # all steps share one row, and terms with y' and y'' the modes
        z = rates * self.h
        mean, keep = mean_exponential(z), np.exp(-z)
        seen = mean * np.exp(-z * (1 + self._theta)), mean * keep * np.expm1(-z) / self.h
        return keep[None], np.ones((1, z.size)), np.array(seen)[:, None]


class _Mesh:
    """Distances and lengths of the steps of a mesh, and the parabolas on these steps."""

    def __init__(self, times: np.ndarray, theta: float, parabolas: int) -> None:
        steps, self._parabolas = np.diff(times), parabolas
        self.mesh, self._steps = times, steps
        self._theta = np.broadcast_to(theta, steps.size) * 1.0
        self._seen = times[:-1] + self._theta * steps
        self._ratios = np.append(1.0, steps[1:] / steps[:-1])
        # lean of each step, over the difference between the mean slopes of the next step and it
        ratio = self._ratios[1:]
        fit = (
            (ratio <= _MAX_RATIO_OF_PARABOLA)
            & (_MAX_RATIO_OF_PARABOLA * ratio >= 1.0)
            & (parabolas > 0)
        )
        self._slopes = np.append(np.where(fit, 2.0 / (steps[1:] + steps[:-1]), 0.0), 0.0)
        # middles of all steps, and distances between them; the first middle is that of an imagined
        # step before 0, as long as the first step
        self._middles = np.append(times[0] - 0.5 * steps[0], times[:-1] + 0.5 * steps)
        self._between = 0.5 * (steps + np.append(steps[0], steps[:-1]))

    def rows(self, n: np.ndarray) -> dict[str, Any]:
        """Return the fields of `StepRows` for steps n, (R,), that do not depend on the terms."""
        times, theta, unit = self.mesh[n], self._theta[n], self._steps[n]
        ratio = self._ratios[n]
        return {"times": times, "theta": theta, "unit": unit, "length": unit, "ratio": ratio}

    def times(self, n: np.ndarray) -> np.ndarray:
        """Return the times at which steps n take their right-hand sides."""
        return self._seen[n]

    def first_sample(self, gamma: Any) -> Any:
        """Return the mean of ``t**-gamma`` over the first step, less its value at the sample."""
        return self._steps[0] ** -gamma * (1 / (1 - gamma) - self._theta[0] ** -gamma)

    def intervals(self, n: np.ndarray, size: int, order: Any) -> tuple[np.ndarray, ...]:
        """Return distances and lengths of steps n - k, k < size, for R steps n."""
        # all (R, size), in the layout `order`; distances are from the time of the right-hand side
        # of step n: there (n - k >= 0), far (to the end of step n - k), width (its length up to
        # that time), behind (to its middle), between (from there to the middle before), steps (its
        # length), slopes (its lean over a difference of mean slopes)
        n = np.array(np.broadcast_to(n[:, None], (n.size, size)), order=order)
        j = n - np.arange(size)
        there, j = j >= 0, np.maximum(j, 0)
        far = np.where(there, self._seen[n] - self.mesh[j + 1], 1.0)
        behind = np.where(there, self._seen[n] - self._middles[j + 1], 1.0)
        far[:, 0], behind[:, 0], steps = 0.0, 0.0, self._steps[j]
        width = steps.copy()
        width[:, 0] *= self._theta[n[:, 0]]
        return there, far, width, behind, self._between[j], steps, self._slopes[j]

    def decays(
        self, rates: np.ndarray, kinds: np.ndarray, n: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return factors of M modes at R steps n, for terms with y' and y''."""
        # kinds: 1 if y' occurs, 2 if y'' does; each has M modes, those of the first kind come
        # first. A mode Z becomes keep Z + take u_(n-2), keep and take (R, .); seen (2, R, M) are
        # its factors in the sum of step n, for terms with y' and y''.
        n = n[:, None]
        j, newest = np.maximum(n - 2, 0), np.maximum(n - 1, 0)
        keeps, takes, seen = [], [], np.zeros((2, n.size, rates.size))
        for kind in kinds:
            if kind == 2:
                z, later = (rates * self._between[k] for k in (j, newest))
                average, end = mean_exponential(z), self._middles[newest + 1]
                take = average * np.expm1(-later) + (average - mean_exponential(later))
                keep = np.exp(-later)
            else:
                end, pairs = self.mesh[newest], np.maximum(np.append(n[:1] - 3, n - 2, axis=0), 0)
                steps = self._steps[pairs]
                z = rates * steps
                lost = np.expm1(-z)
                decay, average = 1 + lost, lost / -z
                keep, take = decay[1:], (steps * average)[1:]
                if self._parabolas:
                    lean = self._slopes[pairs] * steps**2 * _tilt(z, average, decay)
                    take -= lean[1:]
                    take += (j > 0) * lean[:-1] * keep
            keeps.append(keep)
            takes.append(take / self._steps[j])
            seen[kind - 1] = np.exp(-rates * (self._seen[n] - end))
        return np.hstack(keeps), np.hstack(takes), seen


class RowSums:
    """Sums over earlier increments, with weights that are computed for each step."""

    def __init__(
        self, system: System, steps: Any, parabolas: int = 0, explicit: bool = False
    ) -> None:
        # R steps, C groups of components with the same terms, groups (d,). parabolas: 0 lines, 1
        # parabolas but on the newest step, 2 on all, which needs a mesh. explicit: the right-hand
        # side is taken where the step begins, and steps are solved for the change of the increment.
        # powers: p = m - alpha and 1 / Gamma(p + 1) (R,) by operators of order alpha, acting on the
        # derivative m. rows: coefficients of the last batch.
        distinct, self.groups = distinct_columns(system)
        self.terms, is_memory = zip(*distinct, strict=True)
        self.steps, self._parabolas, self._explicit = steps, parabolas, explicit
        # an explicit step computes the memory that f reads in the next step: t x'(0) is that of the
        # next step, too
        self._is_memory, self._late = is_memory, np.array(is_memory) * explicit
        self._operators = list(dict.fromkeys(op for terms in self.terms for _, op in terms))
        self.varies, self._above = system.varies, system.m == 2
        self._adds_start = not system.subtracts_start
        self.powers: dict = {}
        self._known, self._n_end, self._trouble = (0, 0), 0, ""
        self.rows = self._rows(np.arange(0), *np.ones((2, len(self.terms), 0)))

    def prepare(self, n_end: int) -> None:
        """Check the orders at about a thousand steps up to `n_end`, before the run begins."""
        # raises `OrderFailed` if an order is outside its range, or if its function raises
        if n_end > self._n_end:
            some = np.unique(np.linspace(0, n_end - 1, _LOOKED_AT).astype(int))
            *_, failure = self._sampled(some)
            if failure:
                raise OrderFailed(failure)
            self._n_end = n_end

    def reach(self, n: int) -> tuple[int, StepRows]:
        """Compute the batch with step n, if unknown; return the step behind it, and its rows."""
        # a new tuple of rows if this call computed them, else that of the last call
        last, n_end = self._known
        # rows beyond the former end of the run are copies: if the run goes on, compute them
        if not self.rows.first <= n < min(last, n_end):
            first = n // ROWS_AT_ONCE * ROWS_AT_ONCE
            # whole groups, so that a longer run computes the same floats for these steps
            size = min(ROWS_AT_ONCE, math.ceil((self._n_end - first) / _GROUP) * _GROUP)
            with np.errstate(all="ignore"):  # a weight that is not finite ends the run below
                last = first + self._fill(np.arange(first, first + size))
            self._known = last, n_end = last, self._n_end
        if n >= last:
            raise OrderFailed(self._trouble)
        return min(last, n_end), self.rows

    def _sampled(self, n: np.ndarray) -> tuple[dict, int, str]:
        """Return p of each operator at steps n, how many are valid, and a message or ""."""
        # the message describes the first invalid order
        times, found, n_good, failure = self.steps.times(n), {}, n.size, ""
        for operator in self._operators:
            found[operator], reason = operator.powers(times[:n_good])
            if reason:
                n_good, failure = found[operator].size, reason
        return found, n_good, failure

    def _fill(self, n: np.ndarray) -> int:
        """Compute the coefficients of steps n; return how many steps have valid ones."""
        # steps beyond the run's end get the coefficients of its last step
        first, n = int(n[0]), np.minimum(n, self._n_end - 1)
        powers, n_good, self._trouble = self._sampled(n)
        self.powers = {op: (p[:n_good], inverse_gamma(p[:n_good])) for op, p in powers.items()}
        n = n[:n_good]
        now, near = np.moveaxis(self._weights(n, 2, 0, "F"), 2, 0)
        self.rows = self._rows(n, now, near)._replace(first=first)
        sound = (np.isfinite(now) & np.isfinite(self.rows.lead)).all(axis=0)
        if sound.all():
            return n_good
        bad = int(np.argmin(sound))
        got = f"{now[:, bad].tolist()} at t = {self.steps.times(n[bad]):.6g}"
        required = "give finite, nonzero leading weights"
        self._trouble = complaint("terms", required, got, "take another step")
        return bad

    def _rows(self, n: np.ndarray, now: np.ndarray, near: np.ndarray) -> StepRows:
        """Return coefficients of steps n from the weights (C, R) of their newest two increments."""
        lead = 1 / now
        return StepRows(
            first=0,
            last=n.size - 1,
            **self.steps.rows(n),
            lead=lead,
            near=near * lead + self._explicit,
            scale=np.ones(lead.shape),
            drift=self._drift(n, lead),
        )

    def _drift(self, n: np.ndarray, lead: np.ndarray) -> np.ndarray:
        """Return factors of x'(0), which increments omit, and of x(0) if a term acts on x."""
        # (C, R), (2 C, R) if a term acts on x itself, and (C, 0) without any factor
        if not (self._above or self._adds_start):
            return np.zeros((len(lead), 0))
        found = np.zeros((1 + self._adds_start, *lead.shape))
        for a, terms in enumerate(self.terms if n.size else ()):
            above = any(operator.derivative == 2 for _, operator in terms)
            for c, operator in terms:
                p, factor = self.powers[operator]
                # the derivative of t x'(0); equations of half the order (reduce_order) omit it
                if operator.derivative == 1 and (above or self._is_memory[a]):
                    times = self.steps.times(n + self._late[a])
                    found[0, a] += c * factor * times**p
                if not operator.definition.subtracts_start:
                    found[1, a] += c * self._initial(n, 1 - p, int(self._explicit and above))
        return (found * lead).reshape(len(found) * len(lead), n.size)

    def _initial(self, n: np.ndarray, order: Any, first: int) -> np.ndarray:
        """Return what a start value of 1 adds at steps n, (R,), with a correction in one step."""
        # The derivative of 1, but 0 at t = 0. first: step of the correction, 1 if an explicit
        # scheme gets the increment of step 0 from the initial values, else 0.
        (factors, exponents), first = derivative_of_one(order), first - int(n[0])
        times = self.steps.times(n)
        values = np.where(times > 0, times, np.inf) ** exponents
        if 0 <= first < n.size:
            values[first] += self.steps.first_sample(-float(exponents[first]))
        return values * factors

    def weights(self, first: int, last: int, k_end: int) -> Any:
        """Return weights of increments u_(n-k), k < k_end, for steps n from `first` to `last`."""
        # (C, last - first, k_end), not divided by the leading weight
        return self._weights(np.arange(first, last), k_end, first - self.rows.first)

    def direct(self, first: int, last: int, k_end: int) -> Any:
        """Return the result of `weights`, divided by the leading weight of each step."""
        lead = self.rows.lead[:, first - self.rows.first : last - self.rows.first]
        return self.weights(first, last, k_end) * lead[..., None]

    def _weights(self, n: np.ndarray, k_end: int, at: int, order: Any = "C") -> np.ndarray:
        """Return `weights` at steps n, from index `at` of `powers` on, in the layout `order`."""
        bent = self._parabolas > 0
        shape = n.size, k_end + bent
        there, far, width, behind, between, steps, slopes = self.steps.intervals(n, shape[1], order)
        found, of_terms = np.zeros((len(self.terms), n.size, k_end)), {}
        if order == "F":
            found = np.moveaxis(np.zeros((len(self.terms), k_end, n.size)), 1, 2)
        for operator, powers in self.powers.items():
            p, factor = (part[at : at + n.size, None] for part in powers)
            p = np.array(np.broadcast_to(p, shape), order=order)
            if operator.derivative == 2:
                own = moments(behind, between, p, False)[0]
                own /= between
                own[:, 1:] -= own[:, :-1].copy()
            else:
                own, lean = moments(far, width, p, bent)
            if bent and operator.derivative == 1:
                lean[:, 1] += (self._parabolas == 2) * lean[:, 0]
                lean[:, 1:] *= slopes[:, 1:] * there[:, 1:]
                own[:, 1:] -= lean[:, 1:]
                own[:, :-1] += lean[:, 1:]
            own *= factor
            of_terms[operator] = own[:, :k_end]
        for a, terms in enumerate(self.terms):
            for c, operator in terms:
                found[a] += c * of_terms[operator]
        found *= (there / steps)[:, :k_end]
        return found

    def decays(
        self, rates: np.ndarray, kinds: np.ndarray, first: int, last: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return factors of modes at steps from `first` to `last`; see `_Mesh.decays`."""
        return self.steps.decays(rates, kinds, np.minimum(np.arange(first, last), self._n_end - 1))

    def has_memory(self) -> bool:
        """Return whether increments u_(n-k) with k > 1 have weights at all."""
        return not all(operator.classical for operator in self._operators)

    def exact(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Return empty weights, because a block of one step needs none inside itself."""
        return (np.zeros((len(self.terms), 0)),) * 2

    def check(self, history: Any) -> None:
        """Refuse a history that cannot sum varying orders or a mesh, if these occur."""
        if self.varies and not history.takes_varying:
            refuse("history", "be Direct or SumOfExponentials if orders vary", repr(history))
        if self.steps.mesh is not None and not history.takes_meshes:
            required = f"be left out with {type(history).__name__}, which takes uniform steps"
            got = f"{self.steps.mesh.size - 1} steps"
            refuse("mesh", required, got, "or use SumOfExponentials or Direct")


def varying_plan(system: System, h: float, theta: float, explicit: bool) -> Plan:
    """Make the plan of a scheme on uniform steps, for an equation with varying orders."""
    # y' is taken at t_n + theta h, f at t_n by an explicit scheme and at t_n + theta h by an
    # implicit one
    sums = RowSums(system, _Uniform(h, theta, 0.0 if explicit else theta), explicit=explicit)
    given = (system.highest_orders() > 1).astype(np.int64) if explicit else None
    return _plan(system, sums, h, given=given, slowest=SLOWEST if explicit else 0.0)


def mesh_plan(
    scheme: Scheme, system: System, times: np.ndarray, theta: Any, parabolas: int
) -> Plan:
    """Make the plan of a scheme on a mesh of any steps."""
    # the equation holds at the fraction theta of each step; parabolas as in `RowSums`
    highest, up_to = float(system.highest_orders().max()), scheme.meshes_up_to
    if highest > up_to:
        required = f"lie in (0, {up_to:g}] for {type(scheme).__name__} on a mesh"
        refuse("order", required, highest, "take uniform steps")
    return _plan(system, RowSums(system, _Mesh(times, theta, parabolas), parabolas), times[1])


def _plan(system: System, sums: RowSums, first: float, **more: Any) -> Plan:
    """Make the plan of `sums`, a `RowSums`, if the first step has the length `first`."""
    for operator, _ in system.left:
        if operator.kernel is not None:
            required = "be Caputo operators on a mesh, and on given steps if an order varies"
            refuse("terms", required, f"{operator}", "use Collocation")
    speed = system.y0[1] if system.m == 2 else np.zeros(system.d)
    return Plan(
        past=sums,
        rows=sums.rows,
        groups=sums.groups,
        initial=system.at_start,
        increments=first * speed,
        shift=speed,
        drift=None if system.subtracts_start else system.y0[:1],
        **more,
    )
