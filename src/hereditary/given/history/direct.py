"""Direct sums over the past, exact up to rounding errors, in O(N**2) operations for N steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..past import exchange_direct
from ..plan import Convolution
from ..signatures import Tables, held
from .history import History, OpenHistory, Past

# Most steps whose weights are computed at a time, if weights differ from step to step.
_MAX_ROWS_AT_ONCE = 64
# Largest number of weights that are computed at a time, if weights differ from step to step.
_MAX_WEIGHTS_AT_ONCE = 2**15


@dataclass(frozen=True)
class Direct(History):
    """The past summed term by term with exact weights; the reference for every other history.

    Error
    -----
    Rounding errors only.

    Cost
    ----
    For each component, n multiplications at step n, N**2 / 2 for N steps, and 8 N bytes of storage.
    If orders vary, each step computes all its weights, which takes about twenty times as long.

    Examples
    --------
    >>> import hereditary as hd
    >>> eq = hd.scenes.relaxation(alpha=0.5, rate=1.0, y0=1.0)
    >>> hd.solve(eq, 1.0, n_steps=100, history=hd.Direct()).stats["n_modes"]
    0
    """

    takes_kernels: ClassVar[bool] = True
    takes_varying: ClassVar[bool] = True
    takes_meshes: ClassVar[bool] = True

    def memory(self, past: Past, n_columns: int, n_block: int, span: Any) -> OpenHistory:
        """Return a new memory that stores all pieces; see `History.memory`."""
        memory_class = _Pieces if isinstance(past, Convolution) else _PiecesByRows
        return memory_class(past, n_columns, n_block)


class _Pieces(OpenHistory):
    """Memory of all pieces of a run on uniform steps, in arrays that grow by doubling."""

    def __init__(self, past: Any, n_columns: int, n_block: int) -> None:
        self._past, self._n_block = past, n_block
        arrays = held(n_columns, starts=getattr(past, "n_starts", 0))
        super().__init__(exchange_direct, Tables(), arrays, *past.exact(n_block + 2))

    def prepare(self, n_end: int) -> None:
        """Allocate arrays of pieces, and compute tables of weights, for steps up to `n_end`."""
        pieces = self.arrays.pieces
        if pieces.shape[1] < n_end + 1:
            more = max(n_end + 1, 2 * pieces.shape[1]) - pieces.shape[1]
            self.arrays = self.arrays._replace(pieces=np.pad(pieces, ((0, 0), (0, more))))
        self._tabulate(max(n_end + 1, self.arrays.pieces.shape[1]) + self._n_block)

    def _tabulate(self, n: int) -> None:
        if self.tables.weights.shape[1] < n:
            weights, start_weights = self._past.exact(n)
            self.tables = Tables(weights=weights, start_weights=start_weights)


class _PiecesByRows(_Pieces):
    """Memory of all pieces of a run whose steps each have weights of their own."""

    def _tabulate(self, n: int) -> None:
        """Do nothing: `reach` computes the weights."""

    def reach(self, n: int, pieces: np.ndarray, groups: np.ndarray) -> int:
        """Compute the weights of step n and of some later steps; return the step behind these."""
        first, end = self.tables.first, self.tables.first + self.tables.rows
        if not (first <= n < end and self.tables.weights.size):
            size = min(_MAX_ROWS_AT_ONCE, max(1, _MAX_WEIGHTS_AT_ONCE // (n + 1)))
            end = min(n + size, self._past.reach(n)[0])
            weights = self._past.direct(n, end, end + 2)
            weights = np.ascontiguousarray(weights.reshape(-1, end + 2))
            self.tables = Tables(first=n, rows=end - n, weights=weights)
        return end
