"""FFT history: direct sums rearranged, exact to rounding, O(N log(N)**2).

The sum over the past is cut into squares: after j stretches of R steps, with 2**m the largest power
of two that divides j, the newest R 2**m pieces act on the coming R 2**m steps by one FFT product.
Every pair of a piece and a later step falls into exactly one square, or into the triangle of its
own stretch, which is summed directly.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from ..compiled.convolution import exchange_pending
from ..schemes.scheme import Convolution
from .history import History, Memory, NoMemory

# Blocks in the shortest stretch: below, direct sums are faster than entering Python again.
_BLOCKS = 32


@dataclass(frozen=True)
class FFT(History):
    """The past summed with exact weights by fast Fourier transforms.

    Error
    -----
    Rounding: about 1e-16 of the largest weight times the largest increment.

    Cost
    ----
    O(N log(N)**2) for N steps, and 16 N bytes for each component. Faster than `Direct` from some
    5,000 steps on (convergence/histories.py); where a tolerance will do, `SumOfExponentials` is
    faster still.

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

    def open(self, convolution: Convolution, n_columns: int, n_block: int, n_steps: int) -> Memory:
        """A fresh memory; see `History.open`."""
        if not convolution.has_memory():
            return NoMemory(n_columns, *convolution.exact(n_block + 2))
        return _Pending(convolution, n_columns, n_block)


class _Pending(Memory):
    """All pieces, and what those of finished stretches add to steps to come."""

    def __init__(self, convolution, n_columns, n_block):
        self._convolution = convolution
        self._n_block = n_block
        self._stretch = _BLOCKS * n_block
        arrays = tuple(np.zeros((n_columns, k)) for k in (0, convolution.n_starts, 0))
        none = np.zeros((1, 0))
        tables = none, none, np.full((1, 1), float(self._stretch))
        super().__init__(exchange_pending, tables, arrays, *convolution.exact(n_block + 2))

    def prepare(self, n_end):
        """Grow arrays and tables to hold steps up to `n_end`."""
        capacity = n_end + self._n_block
        self.arrays = tuple(
            np.pad(array, ((0, 0), (0, max(0, capacity - array.shape[1])))) if grows else array
            for array, grows in zip(self.arrays, (True, False, True), strict=True)
        )
        # the largest square that ends before step n_end asks for weights of twice its length
        blocks = (n_end - 1) // self._stretch
        square = self._stretch << (blocks.bit_length() - 1) if blocks else 0
        n_tables = max(capacity + self._n_block, 2 * square) + 1
        if self.tables[0].shape[1] < n_tables:
            self.tables = (*self._convolution.exact(n_tables), *self.tables[2:])

    def reach(self, n):
        """The end of the stretch that step n lies in."""
        return (n // self._stretch + 1) * self._stretch

    def refresh(self, n, pieces, groups):
        """Let the pieces of a finished square act on the steps to come."""
        stored, _, pending = self.arrays
        if n == 0 or n % self._stretch:
            return
        j = n // self._stretch
        length = self._stretch * (j & -j)
        stored[:, n - self._n_block : n] = pieces[:, : self._n_block]
        if pending.shape[1] < n + length:
            pending = np.pad(pending, ((0, 0), (0, n + length - pending.shape[1])))
            self.arrays = (stored, self.arrays[1], pending)
        if self.tables[0].shape[1] < 2 * length + 1:
            self.tables = (*self._convolution.exact(2 * length + 1), *self.tables[2:])
        # stored[s] is u_(s-1): it acts on step n' with the weight of k = n' - s + 1
        size = next_fast_len(2 * length, real=True)
        kernel = rfft(self.tables[0][:, 1 : 2 * length + 1], size, axis=1)
        product = rfft(stored[:, n - length : n], size, axis=1) * kernel[groups]
        pending[:, n : n + length] += irfft(product, size, axis=1)[:, length : 2 * length]
