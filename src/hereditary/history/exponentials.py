"""Sum of exponentials: the past as some fifty decaying modes, O(1) a step.

On a uniform mesh the weights W_k, k >= 2, of all terms of an equation are sums over one bank of
rates s_i, ``W_k = sum_i V_i q_i**(k-2)`` with q_i = exp(-s_i h). The modes ``Z_i = sum_m
q_i**(n-2-m) u_m`` then hold all there is to know about the past.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, NamedTuple

import numpy as np

from ..compiled.past import exchange_modes, exchange_rows
from ..compiled.signatures import Tables, held
from ..kernels.exponential_sum import fit_unit, tolerance
from ..kernels.memory_kernel import KernelErrors
from ..schemes.mesh_plan import MeshSums
from ..schemes.steps import Span
from ..schemes.varying_plan import Schedule
from ..support.checks import complaint, positive
from .history import History, Memory
from .varying_memory import VaryingModes

# Steps that every bank covers. A run may be resumed up to here whatever length it first had, and
# all shorter runs share one bank; longer ones take ten times as many, and so on. Against a bank
# for just 1e4 steps this costs a third of the modes at a tolerance of 1e-10.
_STEPS_COVERED = 2 * 10**7
# Steps of a mesh whose rows are worked out at once.
_ROWS = 256
# Modes are handled four at a time and padded to a multiple of eight, a SIMD register's width.
_PAD = 8


@dataclass(frozen=True)
class SumOfExponentials(History):
    """The past as decaying modes that all memory terms share; the default.

    Parameters
    ----------
    tol : float
        Relative error of the memory kernels, 1e-13 <= tol <= 0.1 [-].
    horizon : float, optional
        Time up to which the run may be resumed [time]. The default covers 2 * 10**7 steps, or the
        whole run if it has more, and ten times the length of a mesh. Kernels given as a function or
        a table cover only the first run by default.

    Error
    -----
    Each kernel is reproduced to `tol` relative at every distance from one step to the horizon; all
    weights but those of signed kernels are positive, so a decaying memory stays one for any `tol`
    (convergence/memory_is_nearly_free.py). A function or a table that no sum follows so closely is
    followed as closely as can be: a `KernelWarning` says so before the run, and
    ``stats["kernel_error"]`` how closely. A run with a function that is followed less closely than
    to `tol` and to 1e-6 ends as KERNEL_INACCURATE.

    Cost
    ----
    Two multiplications for each mode in a step. The number of modes grows like log(N) log(1/tol):
    56 at 1e-10 for up to 2 * 10**7 steps, with 8 bytes each for a component. If orders vary, there
    are 76 modes for all orders, with new weights in each step.

    Examples
    --------
    >>> import hereditary as hd
    >>> eq = hd.scenes.relaxation(alpha=0.5, rate=1.0, y0=1.0)
    >>> sol = hd.solve(eq, 1.0, n_steps=1000, history=hd.SumOfExponentials(tol=1e-8))
    >>> sol.stats["n_modes"] < 56
    True
    """

    tol: float = 1e-10
    horizon: float | None = None
    takes_kernels: ClassVar[bool] = True
    takes_varying: ClassVar[bool] = True
    takes_meshes: ClassVar[bool] = True

    def __post_init__(self):
        tolerance("tol", self.tol)
        if self.horizon is not None:
            positive("horizon", self.horizon)

    def memory(self, past, n_columns, n_block, span) -> Memory:
        """Make the memory of a past; see `History.memory`."""
        if isinstance(past, MeshSums):
            return _MeshModes(past, n_columns, self._span(past, span), float(self.tol))
        if isinstance(past, Schedule):
            covered = self._covered(span + 1, (), span)
            return VaryingModes(past, n_columns, covered, float(self.tol))
        # one block more than asked for: a lag is filled for whole blocks
        kernels = past.kernels()
        covered = self._covered(span + n_block, kernels, span)
        # kernels of the user's may change between runs, powers do not
        tabulate = _tabulated if kernels else _kept
        tables, blocks, pad, errors = tabulate(past, float(covered), self.tol, n_block)
        n = tables.weights.shape[1]
        arrays = held(n_columns, past.first_modal - 2, n, past.n_starts * n)
        return _Modes(tables, arrays, blocks, n - pad, covered, errors)

    def _covered(self, enough, kernels, n_steps):
        """Return how many steps a bank covers: only the run's for fitted kernels."""
        asked = max(n_steps, 1)
        if any(kernel.kernel.by_values for kernel in kernels):
            return asked
        covered = _STEPS_COVERED
        while covered < max(enough, asked):
            covered *= 10
        return covered

    def _span(self, past, span):
        """Return the shortest and longest time lag of modes on a mesh."""
        # a mesh of one step may go on, with steps that are no shorter
        shortest = span.shortest if np.isfinite(span.shortest) else past.rows.unit[0]
        return Span(shortest, max(span.farthest, self.horizon or 0.0))


class _Tabulated(NamedTuple):
    """Tables of `exchange_modes`, block weights, modes of the padding, and the kernels' errors."""

    tables: Tables
    blocks: tuple
    pad: int
    errors: KernelErrors


def _tabulated(convolution, covered, tol, n_block):
    """Work out the tables of a convolution over so many steps, for blocks of `n_block` steps."""
    rates, bank, pad, errors = _bank(convolution, covered, float(tol))
    shares, start_shares = convolution.modal(bank, 2, 0)
    ahead = _powers(rates, n_block)
    block_weights, block_start_weights = convolution.exact(n_block + 2)
    first = convolution.first_modal
    corrections = np.zeros((shares.shape[0], first))
    corrections[:, 2:] = convolution.exact(first)[0][:, 2:]
    corrections[:, 2:] -= (shares @ _powers(rates, first)[:, : first - 2]).real
    block_weights[:, 2:] = (shares @ ahead[:, :-1]).real
    n_short = min(first, n_block + 2)
    block_weights[:, :n_short] += corrections[:, :n_short]
    block_start_weights[:, 2:n_block] = (start_shares @ ahead[:, :-1]).real[:, 2:]
    # the march sets all modes of a start value to it, also the imaginary parts
    start_shares = start_shares / np.where(rates.imag != 0, 1 + 1j, 1)
    back = np.vstack([ahead[:, :-1].T[::-1], ahead[:, -1]])
    n_real = rates.size - np.count_nonzero(rates.imag)
    weights, start_weights, keep, ahead = (
        np.ascontiguousarray(np.hstack([table.real, table.imag[:, n_real:]]))
        for table in (shares, start_shares, back, ahead[:, :-1].T.conj())
    )
    tables = Tables(
        length=n_real,
        weights=weights,
        start_weights=start_weights,
        keep=keep,
        ahead=np.ascontiguousarray(ahead.T),
        corrections=corrections,
    )
    return _Tabulated(tables, (block_weights, block_start_weights), pad, errors)


_kept = lru_cache(maxsize=64)(_tabulated)


def _mesh_modes(sums, m, nearest, farthest, tol):
    """Return rates (M,) of the modes of terms with derivative m, and weights by group."""
    used = (sums.factors != 0) & (sums.powers > 0) & (sums.derivatives == m)
    exponents = tuple(sorted({1 - p for p in sums.powers[used]}))
    if not exponents:
        return np.zeros(0), np.zeros((len(used), 0))
    fit = fit_unit(exponents, max(2.0, farthest / nearest), tol)
    weights = np.zeros((len(used), fit.rates.size))
    for i, j in zip(*np.nonzero(used), strict=True):
        a = 1 - sums.powers[i, j]
        # p t**(p-1) in units of the nearest distance
        own = (1 - a) * fit.weights[exponents.index(a)] * nearest**-a
        weights[i] += sums.factors[i, j] * own
    return fit.rates / nearest, weights


class _MeshModes(Memory):
    """Modes on a mesh of any steps."""

    def __init__(self, sums, n_columns, covers, tol):
        self._sums, self._covers = sums, covers
        # velocities of order above 1 are seen from the middle of a step on
        nearest = (1, covers.shortest), (2, 0.5 * covers.shortest)
        found = [(m, *_mesh_modes(sums, m, least, covers.farthest, tol)) for m, least in nearest]
        self._modes = [(m, rates, weights) for m, rates, weights in found if rates.size]
        self.n_modes = sum(rates.size for _, rates, _ in self._modes)
        arrays = held(n_columns, modes=self.n_modes)
        super().__init__(exchange_rows, Tables(rows=0), arrays, *sums.exact(0))

    def reach(self, n, pieces, groups):
        """Work out what modes keep and take, and how they are weighed, in steps from n on."""
        first, end = self.tables.first, self.tables.first + self.tables.rows
        if not first <= n < end:
            first = n // _ROWS * _ROWS
            end = min(first + _ROWS, self._sums.reach(n)[0])
            parts = []
            for m, rates, weights in self._modes:
                keep, take, seen = self._sums.decays(rates, m, first, end)
                parts.append((keep, take, weights[:, None] * seen))
            keep, take, read = (np.concatenate(part, axis=-1) for part in zip(*parts, strict=True))
            read *= self._sums.rows.lead[:, first:end, None]
            read = np.ascontiguousarray(read.reshape(-1, self.n_modes))
            self.tables = Tables(first, end - first, weights=read, keep=keep, take=take)
        return end

    def prepare(self, n_end):
        """Refuse steps that the modes do not reach."""
        times = self._sums.times
        shortest = float(np.diff(times[:n_end]).min(initial=np.inf))
        if shortest < self._covers.shortest * (1 - 1e-9):
            required = (
                f"have no steps below {self._covers.shortest:g}, the shortest of the first run"
            )
            raise ValueError(complaint("mesh", required, f"one of {shortest:g}"))
        if times[n_end] > self._covers.farthest:
            required = f"stay within t = {self._covers.farthest:g}, the end of its history"
            remedy = "begin the run with SumOfExponentials(horizon=), the time it is to reach"
            raise ValueError(complaint("resume", required, f"{times[n_end]:g}", remedy))


class _Modes(Memory):
    """Modes driven by the pieces, undriven ones for the start values, and a window."""

    def __init__(self, tables, arrays, blocks, n_modes, covered, kernel_errors):
        super().__init__(exchange_modes, tables, arrays, *blocks)
        self.n_modes, self.kernel_errors = n_modes, kernel_errors
        self._covered = covered

    def prepare(self, n_end):
        """Refuse steps that the exponential sum does not reach."""
        if n_end > self._covered:
            remedy = "begin the run with SumOfExponentials(horizon=), the time it is to reach"
            required = f"stay within the {self._covered} steps its history covers"
            raise ValueError(complaint("resume", required, f"a run to step {n_end}", remedy))


def _bank(convolution, covered, tol):
    """Return rates of all modes, their weights for each kernel, and two results more.

    These are the number of modes used for the padding, and the largest errors of the other kernels.
    Power laws share their rates; every other kernel has its own.
    """
    exponents, kernels = convolution.exponents(), convolution.kernels()
    fits = [fit_unit(exponents, covered, tol)[:2]]
    sums = [kernel.exponentials(covered, tol) for kernel in kernels]
    fits += [_one_of_each_pair(found.rates, found.weights[None]) for found in sums]
    pad = -sum(rates.size + np.count_nonzero(rates.imag) for rates, _ in fits) % _PAD
    rates = np.concatenate([*(rates for rates, _ in fits), np.zeros(pad)])
    order = np.argsort(rates.imag != 0, kind="stable")
    bank, offset = {}, 0
    for keys, (own, weights) in zip((exponents, *((k,) for k in kernels)), fits, strict=True):
        for key, row in zip(keys, weights, strict=True):
            every = np.zeros(rates.size, dtype=rates.dtype)
            every[offset : offset + own.size] = row
            bank[key] = rates[order], every[order]
        offset += own.size
    return rates[order], bank, pad, KernelErrors.of([own.kernel for own in kernels], sums)


def _one_of_each_pair(rates, weights):
    """Return real rates and one of each conjugate pair, which weighs twice in real parts."""
    kept = rates.imag >= 0
    return rates[kept], (weights * np.where(rates.imag > 0, 2, 1))[:, kept]


def _powers(rates, n):
    """Return powers q**0 .. q**n of ``q = exp(-rates)``, shape (M, n + 1)."""
    powers = np.exp(-np.multiply.outer(rates, np.arange(n + 1)))
    # products with subnormal numbers take a hundred times as long
    powers[np.abs(powers) < 1e-290] = 0.0
    return powers
