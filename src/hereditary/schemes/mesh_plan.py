"""Plans on meshes of any steps.

A piece of the solution on [t_j, t_(j+1)] has the slope ``mean + lean (s - middle)``. Seen from t it
contributes ``mean m_0 + lean m_1`` with the moments of the kernel ``p T**(p-1)``, T = t - s:
``m_0 = int p T**(p-1) dT`` and ``m_1 = int p T**(p-1) (middle - T) dT``. Above order 1 the velocity
is a line between the middles of two steps, and its slope takes the place of the mean.
"""

from __future__ import annotations

from math import factorial

import numpy as np

from ..compiled.signatures import StepRows
from ..kernels.special import gauss_unit, mean_exponential
from ..support.checks import complaint
from .scheme import Plan, distinct_components
from .uniform_plan import drift_of_speed

# Steps so many times longer or shorter than the one before have a corner between them, or begin at
# a singular point: lines, for a parabola would lean on the other.
_STEEPEST = 30.0


def moments(low, width, p, bent=True):
    """Return m_0, and m_1 if `bent`, else 0, over distances [low, low + width].

    The width is an argument because far from a tiny step both ends have the same distance.
    """
    high, nearest = low + width, low == 0.0
    if p == 0.0:  # a point mass at distance 0
        return np.where(nearest, 1.0, 0.0), np.where(nearest, 0.5 * width, 0.0)
    beyond = np.where(nearest, 1.0, low)
    m_0 = np.where(nearest, high**p, beyond**p * np.expm1(p * np.log1p(width / beyond)))
    if not bent:
        return m_0, 0.0
    middle, m_1 = low + 0.5 * width, 0.0
    for node, weight in zip(*gauss_unit(16), strict=True):
        # less its value in the middle, whose moment is 0: what is left cancels nowhere
        bend = np.expm1((p - 1.0) * np.log1p((node - 0.5) * width / middle))
        m_1 = m_1 + weight * (0.5 - node) * bend
    m_1 = p * width * width * middle ** (p - 1.0) * m_1
    # wide: the closed form does not cancel
    closed = middle * m_0 - p / (p + 1.0) * (high ** (p + 1.0) - low ** (p + 1.0))
    return m_0, np.where(width > 2.0 * low, closed, m_1)


def _tilt(z, average, decay):
    """Return ``int_0^1 (1/2 - v) exp(-z v) dv``, from the mean of the exponential and its end."""
    square, series = np.minimum(z, 0.5) ** 2, np.zeros_like(z)
    for k in range(5, -1, -1):  # leaves 1e-17 below z = 0.5
        series *= square
        series += 1 / (factorial(2 * k + 1) * (2 * k + 3) * 4 ** (k + 1))
    closed = 0.5 * average - (average - decay) / np.maximum(z, 0.5)
    return np.where(z < 0.5, np.sqrt(decay) * z * series, closed)


def parabolas_fit(steps):
    """Return whether the steps k and k + 1 are alike enough for a parabola, (n - 1,)."""
    ratio = steps[1:] / steps[:-1]
    return (ratio <= _STEEPEST) & (_STEEPEST * ratio >= 1.0)


class MeshSums:
    """Sums over pieces of the solution on a mesh, which are lines or parabolas.

    Parameters
    ----------
    system : System
    times : ndarray, shape (n+1,)
        The mesh.
    theta : float or ndarray, shape (n,)
        Where in each step the equation holds.
    parabolas : int
        0 for lines, 1 for parabolas on all steps but the newest, 2 on that too.

    Attributes
    ----------
    groups : ndarray of int64, shape (d,)
        Group of each component, of the same terms.
    factors, powers, derivatives : ndarray, shape (C, T)
        ``coefficient / Gamma(p + 1)``, p = m - alpha and m of each group's terms; 0 for none.
    rows : StepRows
    """

    def __init__(self, system, times, theta, parabolas):
        distinct, self.groups = distinct_components(system)
        shape = (len(distinct), max(map(len, distinct)))
        self.factors, self.powers, self.derivatives = np.zeros((3, *shape))
        for i, key in enumerate(distinct):
            for j, (c, operator) in enumerate(key):
                self.factors[i, j], self.powers[i, j] = c * operator.factor(1.0), operator.power
                self.derivatives[i, j] = operator.derivative
        steps, self._parabolas = np.diff(times), parabolas
        self.times, self._steps = times, steps
        self._theta = np.broadcast_to(theta, steps.size) * 1.0
        self._seen = times[:-1] + self._theta * steps
        # slope of the lean of each step over the difference of its mean and the next one's
        fit = parabolas_fit(steps) & (parabolas > 0)
        self._slopes = np.append(np.where(fit, 2.0 / (steps[1:] + steps[:-1]), 0.0), 0.0)
        # middles from that of a step before the first, as long as that, on, and between them
        self._middles = np.append(times[0] - 0.5 * steps[0], times[:-1] + 0.5 * steps)
        self._between = 0.5 * (steps + np.append(steps[0], steps[:-1]))
        now, near = np.moveaxis(self.weights(0, steps.size, 2), 2, 0)
        ratio = np.ones(steps.size)
        ratio[1:] = steps[1:] / steps[:-1]
        self.rows = StepRows(
            first=0,
            last=steps.size - 1,
            times=times[:-1].copy(),
            theta=self._theta,
            unit=steps,
            length=steps,
            ratio=ratio,
            lead=1.0 / now,
            near=near / now,
            scale=np.ones_like(now),
            drift=np.zeros((len(distinct), 0)),
        )

    def weights(self, first, last, k_end):
        """Return weights of u_(n-k) in the derivative at steps n from `first` to `last`, k < k_end.

        Shape (C, last - first, k_end); not divided by the leading weight.
        """
        n = np.arange(first, last)[:, None]
        j = n - np.arange(k_end + 1)
        there, j = j >= 0, np.maximum(j, 0)
        steps, bent = self._steps[j], self._parabolas > 0
        far = np.where(there, self._seen[n] - self.times[j + 1], 1.0)
        far[:, 0], width = 0.0, steps.copy()
        width[:, 0] *= self._theta[first:last]
        behind = np.where(there, self._seen[n] - self._middles[j + 1], 1.0)
        behind[:, 0], between = 0.0, self._between[j]
        found, of_terms = np.zeros((len(self.factors), last - first, k_end)), {}
        for (a, i), factor in np.ndenumerate(self.factors):
            p, m = key = self.powers[a, i], self.derivatives[a, i]
            if factor == 0.0:
                continue
            if key not in of_terms and m == 2:
                own = there * moments(behind, between, p, False)[0] / between
                own[:, 1:] -= own[:, :-1].copy()
                of_terms[key] = (own / steps)[:, :-1]
            elif key not in of_terms:
                own, lean = (there * part for part in moments(far, width, p, bent))
                lean[:, 1] += (self._parabolas == 2) * lean[:, 0]
                lean[:, 1:] *= self._slopes[j[:, 1:]] * there[:, 1:]
                own[:, 1:] -= lean[:, 1:]
                of_terms[key] = (own[:, :-1] + lean[:, 1:]) / steps[:, :-1]
            found[a] += factor * of_terms[key]
        return found

    def direct(self, first, last, k_end):
        """Return `weights` over the leading weight."""
        return self.weights(first, last, k_end) * self.rows.lead[:, first:last, None]

    def decays(self, rates, m, first, last):
        """Return the changes of modes of terms with derivative m, steps `first` to `last`.

        Returns
        -------
        keep, take, seen : ndarray, shape (last - first, M)
            Factors of a mode, of u_(n-2) that it takes, and of the mode in the sum at step n.
        """
        n = np.arange(first, last)[:, None]
        j, newest = np.maximum(n - 2, 0), np.maximum(n - 1, 0)
        if m == 2:
            z, later = (rates * self._between[k] for k in (j, newest))
            average, end = mean_exponential(z), self._middles[newest + 1]
            take = average * np.expm1(-later) + (average - mean_exponential(later))
            keep = np.exp(-later)
        else:
            end, pairs = self.times[newest], np.maximum(np.arange(first - 3, last - 2), 0)[:, None]
            steps = self._steps[pairs]
            z = rates * steps
            lost = np.expm1(-z)
            decay, average = 1 + lost, lost / -z
            keep, take = decay[1:], (steps * average)[1:]
            if self._parabolas:
                lean = self._slopes[pairs] * steps**2 * _tilt(z, average, decay)
                take -= lean[1:]
                take += (j > 0) * lean[:-1] * keep
        return keep, take / self._steps[j], np.exp(-rates * (self._seen[n] - end))

    def has_memory(self) -> bool:
        """Return whether there are weights beyond k = 1 at all."""
        return bool(np.any(self.powers > 0))

    def exact(self, n):
        """Return no weights: a block has one step."""
        return (np.zeros((len(self.factors), 0)),) * 2

    def prepare(self, n_end: int) -> None:
        """Do nothing: nothing is left to prepare."""

    def reach(self, n: int):
        """Return all steps, which are computed; see `Schedule.reach`."""
        return self._steps.size, None

    def check(self, history):
        """Refuse a history that takes uniform steps only."""
        if not history.takes_meshes:
            required = f"be left out with {type(history).__name__}, which takes uniform steps"
            got = f"{self._steps.size} steps"
            raise ValueError(complaint("mesh", required, got, "or use SumOfExponentials or Direct"))


def mesh_plan(scheme, equation, times, theta, parabolas):
    """Return the plan of a scheme on a mesh of any steps."""
    name, up_to = type(scheme).__name__, scheme.meshes_up_to
    if not equation.constant:
        required = f"be Caputo operators of constant order for {name} on a mesh"
        raise ValueError(complaint("terms", required, "another", "take uniform steps"))
    highest = float(equation.highest_orders().max())
    if highest > up_to:
        required = f"lie in (0, {up_to:g}] for {name} on a mesh"
        raise ValueError(complaint("order", required, highest, "take uniform steps"))
    sums = MeshSums(equation, times, theta, parabolas)
    shift = equation.y0[1] if equation.m == 2 else np.zeros(equation.d)
    amplitudes, powers = drift_of_speed(equation)
    return Plan(
        past=sums,
        rows=sums.rows,
        groups=sums.groups,
        initial=equation.at_start,
        increments=shift * (times[1] - times[0]),
        shift=shift,
        powers=powers,
        drift=amplitudes,
    )
