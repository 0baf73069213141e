"""Direct sums: the reference history, exact to rounding, O(N**2)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..compiled.convolution import exchange_direct
from ..compiled.mesh_sums import exchange_mesh_direct
from ..schemes.mesh_plan import MeshSums
from ..schemes.scheme import Convolution
from ..schemes.steps import Span
from ..schemes.varying_plan import Schedule
from .history import History, Memory, NoMemory
from .mesh_memory import MeshMemory
from .varying_memory import VaryingPieces


@dataclass(frozen=True)
class Direct(History):
    """The past summed term by term with exact weights; the reference for every other history.

    Error
    -----
    Rounding alone.

    Cost
    ----
    n multiplications at step n, N**2 / 2 in all, and 8 N bytes for each component. Where orders
    vary, every weight is new at every step, which takes some twenty times as long.

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

    def open(self, convolution: Convolution, n_columns: int, n_block: int, n_steps: int) -> Memory:
        """A fresh memory; see `History.open`."""
        if not convolution.has_memory():
            return NoMemory(n_columns, *convolution.exact(n_block + 2))
        return _Pieces(convolution, n_columns, n_block)

    def open_varying(self, schedule: Schedule, n_columns: int, n_steps: int) -> Memory:
        """A fresh memory where orders vary; see `History.open_varying`."""
        return VaryingPieces(schedule, n_columns)

    def open_mesh(self, sums: MeshSums, n_columns: int, span: Span) -> Memory:
        """A fresh memory on a mesh of any steps; see `History.open_mesh`."""
        n = sums.theta.size
        kinds = sums.factors, sums.powers, sums.derivatives
        arrays = tuple(np.zeros((n_columns, k)) for k in (n, 0, n))
        return MeshMemory(exchange_mesh_direct, sums, kinds, arrays)


class _Pieces(Memory):
    """All pieces ever absorbed, in arrays that grow by doubling."""

    def __init__(self, convolution, n_columns, n_block):
        self._convolution = convolution
        self._n_block = n_block
        arrays = tuple(np.zeros((n_columns, k)) for k in (0, convolution.n_starts, 0))
        none = np.zeros((1, 0))
        super().__init__(exchange_direct, (none, none), arrays, *convolution.exact(n_block + 2))

    def prepare(self, n_end):
        """Grow the arrays and tables to hold steps up to `n_end`."""
        pieces, *others = self.arrays
        n_tables = n_end + self._n_block + 1
        if pieces.shape[1] < n_end + 1:
            capacity = max(n_end + 1, 2 * pieces.shape[1])
            grown = np.zeros((pieces.shape[0], capacity))
            grown[:, : pieces.shape[1]] = pieces
            self.arrays = (grown, *others)
            n_tables = capacity + self._n_block + 1
        if self.tables[0].shape[1] < n_tables:
            self.tables = (*self._convolution.exact(n_tables), *self.tables[2:])
