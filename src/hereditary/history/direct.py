"""Direct sums (floor 3): the reference history, exact to rounding, O(N**2)."""

from dataclasses import dataclass

import numpy as np

from ..kernels.convolution import exchange_direct
from ..schemes.scheme import Convolution
from .history import History, Memory, NoMemory


@dataclass(frozen=True)
class Direct(History):
    """The past summed term by term with exact weights; the reference for every other history.

    Error
    -----
    Rounding alone.

    Cost
    ----
    n multiplications at step n, N**2 / 2 in all, and 8 N bytes for each component.

    Examples
    --------
    >>> import hereditary as hd
    >>> eq = hd.scenes.relaxation(alpha=0.5, rate=1.0, y0=1.0)
    >>> hd.solve(eq, 1.0, n_steps=100, history=hd.Direct()).stats["n_modes"]
    0
    """

    def open(
        self, convolution: Convolution, start: np.ndarray, n_block: int, n_steps: int
    ) -> Memory:
        """A fresh memory; see `History.open`."""
        if not convolution.exponents():
            return NoMemory(start.size, convolution.exact(n_block + 2)[0])
        return _Pieces(convolution, start, n_block)


class _Pieces(Memory):
    """All pieces ever absorbed, in arrays that grow by doubling."""

    def __init__(self, convolution, start, n_block):
        self._convolution = convolution
        self._n_block = n_block
        empty = np.zeros((1, 0))
        arrays = (np.zeros((start.size, 0)), start.reshape(-1, 1).copy())
        block_weights = convolution.exact(n_block + 2)[0]
        super().__init__(exchange_direct, (empty,) * 4, arrays, block_weights)

    def prepare(self, n_end):
        """Grow the arrays and tables to hold steps up to `n_end`."""
        pieces, start = self.arrays
        n_tables = n_end + self._n_block + 1
        if pieces.shape[1] < n_end + 1:
            capacity = max(n_end + 1, 2 * pieces.shape[1])
            grown = np.zeros((pieces.shape[0], capacity))
            grown[:, : pieces.shape[1]] = pieces
            self.arrays = (grown, start)
            n_tables = capacity + self._n_block + 1
        if self.tables[0].shape[1] < n_tables:
            unused = np.zeros((1, 0))
            self.tables = (*self._convolution.exact(n_tables), unused, unused)

    def copy(self):
        """An independent memory with the same pieces."""
        twin = _Pieces(self._convolution, self.arrays[1][:, 0], self._n_block)
        twin.tables = self.tables
        twin.restore(self.state())
        return twin
