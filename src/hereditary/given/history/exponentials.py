"""Sums of exponentials: about fifty decaying modes replace the past, O(1) operations a step.

All terms share one set of rates s_i, the bank. On uniform steps the weights are
``W_k = sum_i V_i q_i**(k-2)``, k >= 2, with q_i = exp(-s_i h). So the lag of a step is a weighted
sum of the modes ``Z_i = sum_m q_i**(n-2-m) u_m``, where u_m are the pieces. No pieces need to be
stored.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ...kernels.exponential_sum import (
    SLOW_NODES,
    SMALLEST,
    bank_of_all_orders,
    fit_unit,
    tolerance,
    weights_of_moments,
)
from ...kernels.memory_kernel import KernelErrors
from ...kernels.mode_bank import Bank, damping
from ...support.checks import positive, refuse
from ..past import LANES, STARTS, exchange_modes, exchange_nothing, exchange_rows, set_amplitudes
from ..plan import Convolution
from ..power_series import inverse_gamma
from ..row_plan import ROWS_AT_ONCE, RowSums
from ..signatures import HistoryArrays, Tables, held
from ..steps import Span
from .history import History, OpenHistory

# Steps that a bank covers at least; longer runs get a bank for ten times as many. All runs up to
# this step share one bank. A bank for 1e4 steps would have a third fewer modes at 1e-10.
_STEPS_COVERED = 2 * 10**7
# Number of steps of a mesh whose tables are computed at a time.
_MESH_STEPS_AT_ONCE = 256
# On uniform steps with constant orders the number of rates is a multiple of this number, the width
# of a SIMD register.
_PAD = 8
# If orders vary, the number of rates exp(x + h j) is a multiple of this number.
_FOURS = 4 * LANES
# Last clause of a message that refuses to resume a run.
_REMEDY = "begin the run with SumOfExponentials(horizon=), the time it is to reach"


@dataclass(frozen=True)
class SumOfExponentials(History):
    """A sum of exponentials in place of each memory kernel; all terms share the decaying modes.

    This is the default history.

    Parameters
    ----------
    tol : float
        Relative error of the memory kernels, 1e-13 <= tol <= 0.1 [-].
    horizon : float, optional
        Time up to which the run may be resumed [time]. The default covers 2 * 10**7 steps, or the
        whole run if it has more. On a mesh it covers ten times the time of the run. With kernels
        given as a function or a table it covers only the first run.

    Error
    -----
    The sum of exponentials has a relative error of `tol` at every time lag from one step to the
    horizon. Its weights are positive unless a kernel changes sign, so a decaying memory remains
    decaying for any `tol` (convergence/memory_is_nearly_free.py).

    If no sum fits a kernel given as a function or a table to `tol`, the best fit is used. A
    `KernelWarning` reports it before the run, and ``stats["kernel_error"]`` has its error. The run
    ends as KERNEL_INACCURATE if the error exceeds both `tol` and 1e-6 for a function, or 0.1 for a
    table.

    Cost
    ----
    Two multiplications for each mode in a step, and 8 bytes for each mode and component. For N
    steps the number of modes grows like log(N) log(1/tol). It is 56 at 1e-10 for up to 2 * 10**7
    steps. If orders vary, 76 modes serve all orders, and each step computes new weights.

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

    def __post_init__(self) -> None:
        tolerance("tol", self.tol)
        if self.horizon is not None:
            positive("horizon", self.horizon)

    def memory(self, past: Any, n_columns: int, n_block: int, span: Any) -> OpenHistory:
        """Return a new memory that stores modes; see `History.memory`."""
        if isinstance(past, RowSums):
            mesh = past.steps.mesh
            covered = self._covered(span + 1, (), span) if mesh is None else self._span(mesh, span)
            memory_class = _ModesOfAllOrders if past.varies else _FittedModes
            return memory_class(past, n_columns, covered, float(self.tol))
        # cover one more block than the run has, because lags are computed for whole blocks
        kernels = past.kernels
        covered = self._covered(span + n_block, kernels, span)
        # a user's kernels may change between runs; tables of power laws are cached
        tabulate = _tabulated if kernels else _kept
        tables, blocks, pad, errors = tabulate(past, float(covered), self.tol, n_block)
        n = tables.weights.shape[1]
        arrays = held(n_columns, past.first_modal - 2, n, past.n_starts * n)
        return _Modes(tables, arrays, blocks, n - pad, covered, errors)

    def _covered(self, enough: int, kernels: tuple[Any, ...], n_steps: int) -> int:
        """Return how many steps a bank covers: `enough`, or `n_steps` for fitted kernels."""
        # fitted kernels are those that are given as a function or a table
        asked = max(n_steps, 1)
        if any(kernel.kernel.by_values for kernel in kernels):
            return asked
        covered = _STEPS_COVERED
        while covered < max(enough, asked):
            covered *= 10
        return covered

    def _span(self, mesh: np.ndarray, span: Span) -> Span:
        """Return the shortest and the longest time lag that modes cover on a mesh."""
        # if a run has one step, the steps of a resumed run must not be shorter
        shortest = span.shortest if np.isfinite(span.shortest) else mesh[1]
        return Span(shortest, max(span.farthest, self.horizon or 0.0))


class _Tabulated(NamedTuple):
    """Tables and errors of a sum of exponentials on uniform steps."""

    tables: Tables  # those of `exchange_modes`
    blocks: tuple  # weights of pieces and start values inside blocks
    pad: int  # number of rates that only fill up a multiple of `_PAD`
    errors: KernelErrors  # those of the kernels


def _tabulated(convolution: Convolution, covered: float, tol: float, n_block: int) -> _Tabulated:
    """Return the `_Tabulated` of a convolution over `covered` steps, in blocks of `n_block`."""
    exponents, kernels, tol = convolution.exponents, convolution.kernels, float(tol)
    fits = [kernel.exponentials(covered, tol) for kernel in kernels]
    sums = [fit_unit(exponents, covered, tol), *fits]
    pad = -sum(each.rates.size for each in sums) % _PAD
    bank = Bank.of([*sums, Bank(np.zeros(pad), np.zeros((0, pad)))])
    rates, by_key = bank.rates, dict(zip((*exponents, *kernels), bank.weights, strict=True))
    shares, start_shares = convolution.modal(rates, by_key, 2, 0)
    ahead = damping(rates, np.arange(n_block + 1))
    block_weights, block_start_weights = convolution.exact(n_block + 2)
    first = convolution.first_modal
    corrections = np.zeros((shares.shape[0], first))
    corrections[:, 2:] = convolution.exact(first)[0][:, 2:]
    corrections[:, 2:] -= (shares @ damping(rates, np.arange(first - 2))).real
    block_weights[:, 2:] = (shares @ ahead[:, :-1]).real
    n_short = min(first, n_block + 2)
    block_weights[:, :n_short] += corrections[:, :n_short]
    block_start_weights[:, 2:n_block] = (start_shares @ ahead[:, :-1]).real[:, 2:]
    # the march sets real and imaginary parts of all modes of a start value to this value
    start_shares = start_shares / np.where(rates.imag != 0, 1 + 1j, 1)
    back = np.vstack([ahead[:, :-1].T[::-1], ahead[:, -1]])
    weights, start_weights, keep = map(bank.real_modes, (shares, start_shares, back))
    tables = Tables(0, 1, bank.n_real, weights, start_weights, keep)
    ahead = bank.real_modes(ahead[:, :-1].conj(), axis=0)
    tables = tables._replace(ahead=ahead, corrections=corrections)
    errors = KernelErrors.of([each.kernel for each in kernels], fits)
    return _Tabulated(tables, (block_weights, block_start_weights), pad, errors)


_kept = lru_cache(maxsize=64)(_tabulated)


class _RowModes(OpenHistory):
    """Memory of modes whose decay and weights, which subclasses define, each step computes."""

    _exchange: ClassVar[Callable]

    @abstractmethod
    def _bank(self) -> tuple[np.ndarray, int]:
        """Return the rates, times the shortest time lag, and the number of modes to report."""

    @abstractmethod
    def _weighed(self, decays: np.ndarray, here: slice) -> dict:
        """Return fields of `Tables` with the weights of modes in the steps `here`."""
        # here: slice of the rows of `past.rows`; seen: decays from `RowSums.decays`

    def __init__(self, past: RowSums, n_columns: int, covered: Any, tol: float) -> None:
        self._past, self._covered, self._tol, self._rows = past, covered, tol, past.rows
        # the derivative, 1 or 2, in each term of each group; 0 for terms without memory
        derivatives = np.zeros((len(past.terms), max(map(len, past.terms))))
        for row, terms in zip(derivatives, past.terms, strict=True):
            row[: len(terms)] = [0 if op.classical else op.derivative for _, op in terms]
        self._kinds, mesh = np.unique(derivatives[derivatives > 0]).astype(int), past.steps.mesh
        # above order 1 velocities are lines between middles of steps: the least lag is half a step
        self._nearest = past.steps.h if mesh is None else covered.shortest / self._kinds[-1]
        self._ratio = covered if mesh is None else max(2.0, covered.farthest / self._nearest)
        n_sets = 1 if mesh is None else self._kinds.size
        rates, n_modes = self._bank()
        self._rates, self.n_modes = rates / self._nearest, n_sets * n_modes
        rows = ROWS_AT_ONCE if mesh is None else _MESH_STEPS_AT_ONCE
        length = rates.size if n_sets == 2 else 0
        tables = Tables(first=-1, rows=rows, length=length, derivatives=derivatives)
        arrays = held(n_columns, modes=n_sets * rates.size)
        super().__init__(self._exchange, tables, arrays, *past.exact(0))

    def reach(self, n: int, pieces: np.ndarray, groups: np.ndarray) -> int:
        """Compute decay and weights of the modes for the batch of steps with step n, if unknown."""
        end, rows = self._past.reach(n)
        first = n // self.tables.rows * self.tables.rows
        last = min(first + self.tables.rows, rows.first + rows.theta.size)
        if rows is not self._rows or first != self.tables.first:
            self._rows = rows
            keep, take, decays = self._past.decays(self._rates, self._kinds, first, last)
            tables = self._weighed(decays, slice(first - rows.first, last - rows.first))
            self.tables = self.tables._replace(first=first, keep=keep, take=take, **tables)
        return min(end, last)

    def prepare(self, n_end: int) -> None:
        """Refuse a march to step `n_end` with time lags that the modes do not cover."""
        times, covered = self._past.steps.mesh, self._covered
        if times is None:
            return _refuse_beyond(covered, n_end)
        shortest = float(np.diff(times[:n_end]).min(initial=np.inf))
        if shortest < covered.shortest * (1 - 1e-9):
            required = f"have no steps below {covered.shortest:g}, the shortest of the first run"
            refuse("mesh", required, f"one of {shortest:g}")
        if times[n_end] > covered.farthest:
            required = f"stay within t = {covered.farthest:g}, the end of its history"
            refuse("resume", required, f"{times[n_end]:g}", _REMEDY)


class _FittedModes(_RowModes):
    """Memory of modes on a mesh for constant orders, with weights fitted to each order."""

    _exchange = staticmethod(exchange_rows)

    def _bank(self) -> tuple[np.ndarray, int]:
        operators = [op for terms in self._past.terms for _, op in terms if not op.classical]
        powers = sorted({operator.power for operator in operators}, reverse=True)
        fit = fit_unit(tuple(1 - p for p in powers), self._ratio, self._tol)
        self._fitted = dict(zip(powers, fit.weights, strict=True))
        return fit.rates, fit.rates.size

    def _weighed(self, decays: np.ndarray, here: slice) -> dict[str, Any]:
        size, n_modes = self._rates.size, self.arrays.modes.shape[1]
        weights = np.zeros((len(self._past.terms), self.tables.rows, n_modes))
        for row, terms in zip(weights, self._past.terms, strict=True):
            for c, operator in terms:
                if not operator.classical:
                    p, kind = operator.power, operator.derivative - 1
                    # the kernel c p t**(p-1) / Gamma(p + 1), with the shortest lag as unit of t
                    scale = c * p * operator.factor(1.0) * self._nearest ** (p - 1)
                    columns = slice(kind * self.tables.length, kind * self.tables.length + size)
                    row[: decays.shape[1], columns] += scale * self._fitted[p] * decays[kind]
        weights[:, : decays.shape[1]] *= self._rows.lead[:, here, None]
        return {"weights": weights.reshape(-1, n_modes)}


class _ModesOfAllOrders(_RowModes):
    """Memory of modes for varying orders, which the march sums itself (`read_rows`)."""

    _exchange = staticmethod(exchange_nothing)

    def _bank(self) -> tuple[np.ndarray, int]:
        rates, self._h, x = bank_of_all_orders(self._ratio, self._tol)
        # extend the grid of rates to a multiple of _FOURS
        n_grid = _FOURS * math.ceil((rates.size - SLOW_NODES) / _FOURS)
        # For the kernel t**-a, a times the first number is the logarithm of the amplitude before
        # the grid. With the second number it is that of the ratio of two amplitudes. With the third
        # number it is that of this ratio to the power n_grid / LANES.
        self._logs = x - math.log(self._nearest), self._h, self._h * n_grid / LANES
        self._room = np.zeros((1, n_grid // LANES))
        self._decays = np.exp(-self._h * np.arange(1.0, SLOW_NODES))
        grid = np.exp(x + self._h * np.arange(1, n_grid + 1))
        return np.maximum(np.append(grid, rates[-SLOW_NODES:]), SMALLEST), rates.size

    def _weighed(self, decays: np.ndarray, here: slice) -> dict[str, Any]:
        """Return fields of `Tables`, with amplitudes of ``c p t**(p-1) / Gamma(p + 1)``."""
        # the unit of t is the shortest time lag
        shape = *self.tables.derivatives.shape, STARTS, self.tables.rows
        if not self.tables.amplitudes.size:
            self.tables = self.tables._replace(
                amplitudes=np.zeros((math.prod(shape[:3]), shape[3]))
            )
        amplitudes = self.tables.amplitudes.reshape(shape)[..., : here.stop - here.start]
        for a, number in np.argwhere(self.tables.derivatives):
            starts, (c, operator) = amplitudes[a, number], self._past.terms[a][number]
            p, factor = (values[here] for values in self._past.powers[operator])
            exponent = np.maximum(1 - p, SMALLEST)
            for row, log in zip(starts, self._logs, strict=False):
                np.exp(np.multiply(exponent, log, out=row), out=row)
            np.expm1(np.multiply(exponent, -self._h, out=starts[3]), out=starts[3])
            scale = inverse_gamma(exponent)
            for values in (exponent, p, factor, self._rows.lead[a, here], c * self._h):
                scale *= values
            set_amplitudes(scale, weights_of_moments(), self._decays, starts)
        return {"weights": decays.reshape(-1, decays.shape[2]), "room": self._room}


class _Modes(OpenHistory):
    """Modes of pieces and of start values on uniform steps, and a window of exact weights."""

    def __init__(
        self, tables: Tables, arrays: HistoryArrays, blocks: tuple[np.ndarray, np.ndarray],
        n_modes: int, covered: int, kernel_errors: KernelErrors,
    ) -> None:  # fmt: skip
        # pieces drive their modes; modes of start values only decay
        super().__init__(exchange_modes, tables, arrays, *blocks)
        self.n_modes, self.kernel_errors = n_modes, kernel_errors
        self._covered = covered

    def prepare(self, n_end: int) -> None:
        """Refuse a march to step `n_end` if the sum of exponentials covers fewer steps."""
        _refuse_beyond(self._covered, n_end)


def _refuse_beyond(covered: int, n_end: int) -> None:
    if n_end > covered:
        required = f"stay within the {covered} steps its history covers"
        refuse("resume", required, f"a run to step {n_end}", _REMEDY)
