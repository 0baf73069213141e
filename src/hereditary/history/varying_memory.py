"""Modes for every order, for equations whose orders vary.

The weights of the past differ at each step, but the modes need not: on a grid of rates ``exp(h j)``
every kernel ``t**-a`` has the amplitudes ``h/Gamma(a) exp(a h j)``. Infinitely many rates are too
slow to be distinguished. Three nodes that all orders share, at 0 and two others, replace these
rates. Their weights preserve the first three moments, which are geometric sums as well.
"""

import math
from functools import lru_cache

import numpy as np
from scipy.special import gammainccinv, gammaln, rgamma

from ..compiled.order_weights import fill_starts
from ..compiled.past import LANES, STARTS, exchange_nothing
from ..compiled.signatures import Tables, held
from ..kernels.exponential_sum import trapezoid_step
from ..kernels.special import mean_exponential
from ..schemes.varying_plan import LEAST
from ..support.checks import complaint
from .history import Memory

# Modes are summed so many at a time.
_PAD = 4 * LANES
# Shares of the tolerance: fast end, slow end; the trapezoid rule has the rest.
_FAST, _SLOW = 0.05, 0.05
# Nodes of the slow end in units of its fastest rate, those of Chebyshev and Radau: with three of
# them all weights are positive, with more they are not for every order.
SLOW_NODES = 3
_NODES = (1 - np.cos(2 * np.pi * np.arange(SLOW_NODES) / (2 * SLOW_NODES - 1))) / 2


class VaryingModes(Memory):
    """Modes for all orders, which the march reads by itself."""

    def __init__(self, schedule, n_columns, covered, tol):
        rates, h, x = bank_of_all_orders(covered, tol)
        self._covered, self._tol = covered, tol
        n_grid = rates.size - SLOW_NODES
        n_powers = _PAD * math.ceil(rates.size / _PAD)
        # shares of a mode in the weight of u_(n-2), as in schemes/weights.py
        mean = h * mean_exponential(rates)
        shares = np.array(
            [
                mean * np.exp(-rates * (1 + schedule.theta)),
                mean * np.exp(-rates) * np.expm1(-rates),
            ]
        )
        self.n_modes = rates.size
        table = np.zeros((3, n_powers))
        table[0, : rates.size] = np.exp(-rates)
        table[1:, :n_grid] = shares[:, :n_grid]
        self._grid = h, x, shares[:, n_grid:, None] * _from_moments(), n_powers // LANES
        self._schedule, self._rows = schedule, None
        tables = Tables(
            length=n_grid,
            keep=table,
            derivatives=schedule.derivatives,
            amplitudes=np.zeros((schedule.derivatives.size * STARTS, schedule.powers.shape[1])),
            room=np.zeros((1, n_powers // LANES)),
        )
        arrays = held(n_columns, modes=n_powers)
        super().__init__(exchange_nothing, tables, arrays, *schedule.exact(0))

    def prepare(self, n_end):
        """Refuse steps that the exponential sums do not reach."""
        if n_end > self._covered:
            remedy = "begin the run with SumOfExponentials(horizon=), the time it is to reach"
            required = f"stay within the {self._covered} steps its history covers"
            raise ValueError(complaint("resume", required, f"a run to step {n_end}", remedy))

    def reach(self, n, pieces, groups):
        """Work out the amplitudes of steps whose rows are new."""
        if self._rows is not self._schedule.rows:
            self._rows = self._schedule.rows
            self.tables = self.tables._replace(first=self._rows.first)
            self._fill(self._schedule.size)
        return super().reach(n, pieces, groups)

    def _fill(self, size):
        """Set each term's first amplitude on the grid, their ratio, and the slow end's weights.

        A kernel ``t**-a`` has the amplitudes ``exp(a h j)`` on the grid; the slow end holds all
        those before it, whose moments are ``exp(a x) / (1 - exp(-(a + k) h))``.
        """
        h, x, from_moments, length = self._grid
        schedule = self._schedule
        decays = np.exp(-h * np.arange(1.0, SLOW_NODES))
        for index, m in enumerate(schedule.derivatives.ravel().astype(int)):
            if m == 0:
                continue
            own = self.tables.amplitudes[STARTS * index :][:STARTS, :size]
            exponent = np.subtract(1, schedule.powers[index, :size], out=own[5])
            np.maximum(exponent, LEAST, out=exponent)
            for k, factor in enumerate((x, h, h * length)):
                np.multiply(exponent, factor, out=own[k])
                np.exp(own[k], out=own[k])
            np.multiply(exponent, -h, out=own[3])
            np.expm1(own[3], out=own[3])  # exp(-a h) - 1, to all its digits
            fill_starts(own, schedule.kernels[index, :size], from_moments[m - 1], decays)


@lru_cache(maxsize=16)
def bank_of_all_orders(ratio, tol):
    """Return rates of sums for ``t**-a`` on [1, ratio], the same for every a in (0, 1].

    Returns
    -------
    rates : ndarray, shape (M,)
        Those of the grid, ascending, and then of the slow end.
    h, x : float
        Distance of the grid's logarithms, and the one before its first.
    """
    a = np.append(1e-9, np.linspace(0.01, 1.0, 100))
    h = min(trapezoid_step(value, tol / 1.01) for value in (1e-3, 0.5, 1.0))
    fast = max(1.0, float(gammainccinv(1.0, _FAST * tol)))
    # what three nodes leave of exp(-t s), s up to kappa / t, times the mass there
    u = np.linspace(0.0, 1.0, 513)
    left = np.abs(np.prod(u[:, None] - _NODES, axis=1)).max() / math.factorial(SLOW_NODES)
    mass = np.log(h) - gammaln(a) - np.log(-np.expm1(-a * h))
    log_kappa = ((math.log(_SLOW * tol / left) - mass) / (a + SLOW_NODES)).min()
    j_slow = math.floor((log_kappa - math.log(ratio)) / h)
    grid = h * np.arange(j_slow + 1, math.ceil(math.log(fast) / h) + 1)
    rates = np.concatenate([np.exp(grid), _NODES * math.exp(h * j_slow)])
    rates.flags.writeable = False
    return rates, h, h * j_slow


def weights_of_orders(a, ratio, tol):
    """Return weights of these rates for kernels ``t**-a``, a (k,) in (0, 1], shape (M, k)."""
    rates, h, x = bank_of_all_orders(ratio, tol)
    a = np.maximum(a, LEAST)
    k = np.arange(SLOW_NODES)[:, None]
    moments = np.exp(a * x) / -np.expm1(-(a + k) * h)
    grid = np.exp(a * (x + h * np.arange(1, rates.size - SLOW_NODES + 1)[:, None]))
    return h * rgamma(a) * np.concatenate([grid, _from_moments() @ moments])


@lru_cache(maxsize=1)
def _from_moments():
    """Return the matrix that maps moments to weights of the nodes."""
    return np.linalg.inv(np.vander(_NODES, increasing=True).T)
