"""Sums over the past by FFT, exact up to rounding errors, O(N log(N)**2) for N steps.

Pairs of a piece and a later step are sorted into squares. After j batches of R steps, let 2**m be
the largest power of two that divides j. One FFT product then adds the newest R 2**m pieces to the
sums of the next R 2**m steps, which is one square. Every pair is in exactly one square, or in the
triangle of pairs inside one batch. Pairs in triangles are summed directly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from ..past import exchange_pending
from ..plan import Convolution
from ..signatures import Tables, held
from .history import History, OpenHistory

# Number of blocks in the shortest batch. Below it direct sums are faster than calls of Python.
_BLOCKS_OF_SHORTEST_BATCH = 32


@dataclass(frozen=True)
class FFT(History):
    """The past summed with exact weights by fast Fourier transforms.

    Error
    -----
    Rounding errors, about 1e-16 times the largest weight times the largest increment.

    Cost
    ----
    O(N log(N)**2) operations and 16 N bytes for each component, for N steps. `FFT` is faster than
    `Direct` from about 2,000 steps on. `SumOfExponentials` is faster than `FFT`, with an error up
    to its tolerance (convergence/histories.py).

    Source
    ------
    [HairerLubichSchlichte1985].

    Examples
    --------
    >>> import hereditary as hd
    >>> eq = hd.scenes.relaxation(alpha=0.5, rate=1.0, y0=1.0)
    >>> fast = hd.solve(eq, 1.0, n_steps=3000, history=hd.FFT()).y
    >>> direct = hd.solve(eq, 1.0, n_steps=3000, history=hd.Direct()).y
    >>> bool(abs(fast - direct).max() < 1e-14)
    True
    """

    takes_kernels: ClassVar[bool] = True

    def memory(self, past: Any, n_columns: int, n_block: int, span: Any) -> OpenHistory:
        """Return a new memory of pieces and of sums for later steps; see `History.memory`."""
        return _Pending(past, n_columns, n_block)


class _Pending(OpenHistory):
    """All pieces, and sums of pieces of finished batches for later steps."""

    def __init__(self, convolution: Convolution, n_columns: int, n_block: int) -> None:
        self._convolution = convolution
        self._n_block = n_block
        self._batch = _BLOCKS_OF_SHORTEST_BATCH * n_block
        tables, arrays = Tables(length=self._batch), held(n_columns, starts=convolution.n_starts)
        super().__init__(exchange_pending, tables, arrays, *convolution.exact(n_block + 2))

    def prepare(self, n_end: int) -> None:
        """Allocate arrays, and compute tables of weights, for steps up to `n_end`."""
        capacity = n_end + self._n_block
        grown = [_grown(getattr(self.arrays, name), capacity) for name in ("pieces", "pending")]
        self.arrays = self.arrays._replace(pieces=grown[0], pending=grown[1])
        # the largest square that ends before step n_end needs weights of twice its length
        blocks = (n_end - 1) // self._batch
        square = self._batch << (blocks.bit_length() - 1) if blocks else 0
        self._tabulate(max(capacity + self._n_block, 2 * square) + 1)

    def _tabulate(self, n: int) -> None:
        if self.tables.weights.shape[1] < n:
            weights, start_weights = self._convolution.exact(n)
            self.tables = self.tables._replace(weights=weights, start_weights=start_weights)

    def reach(self, n: int, pieces: np.ndarray, groups: np.ndarray) -> int:
        """Add the pieces of a finished square to later steps; return the end of the next batch."""
        if n > 0 and n % self._batch == 0:
            self._act(n, pieces, groups)
        return (n // self._batch + 1) * self._batch

    def _act(self, n: int, pieces: np.ndarray, groups: np.ndarray) -> None:
        j = n // self._batch
        length = self._batch * (j & -j)
        stored, pending = self.arrays.pieces, _grown(self.arrays.pending, n + length)
        self.arrays = self.arrays._replace(pending=pending)
        stored[:, n - self._n_block : n] = pieces[:, : self._n_block]
        self._tabulate(2 * length + 1)
        # stored[s] is u_(s-1), whose weight at step n' is that of k = n' - s + 1
        size = next_fast_len(2 * length, real=True)
        kernel = rfft(self.tables.weights[:, 1 : 2 * length + 1], size, axis=1)
        product = rfft(stored[:, n - length : n], size, axis=1) * kernel[groups]
        pending[:, n : n + length] += irfft(product, size, axis=1)[:, length : 2 * length]


def _grown(array: np.ndarray, n: int) -> np.ndarray:
    """Return an array of at least n columns; new columns are 0."""
    return np.pad(array, ((0, 0), (0, max(0, n - array.shape[1]))))
