"""The history contract.

A `History` is a description; `open` turns it into a `Memory` that holds the past of one run. On a
uniform mesh the past is a sequence of pieces u_m, one for each of W columns, and the memory adds
``sum_m W_(n-m) u_m`` over everything older than a block to that block's lag. It does so through a
compiled function and plain arrays, which the march uses by itself; between blocks Python may copy,
store, restore or linearly combine what is held. Everything is linear in the pieces.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from ..compiled.convolution import exchange_nothing
from ..compiled.jit import as_value
from ..compiled.signatures import EXCHANGE_SIG, TABLES
from ..kernels.memory_kernel import NO_ERRORS, KernelErrors
from ..schemes.mesh_plan import MeshSums
from ..schemes.scheme import Convolution
from ..schemes.steps import Span
from ..schemes.varying_plan import Schedule
from ..support.checks import complaint

# Tables of a memory.
N_TABLES = len(TABLES)


class Memory(ABC):
    """The running memory of one march.

    Attributes
    ----------
    exchange : compiled function
        Of signature `EXCHANGE_SIG`, compiled/signatures.py.
    tables : tuple of eight ndarrays
        Tables that it reads.
    arrays : tuple of three ndarrays
        Arrays that it changes; the first axis runs over the W columns. The second one holds the
        start values and is filled by the march.
    block_weights : ndarray, shape (C, B + 2)
        The weights W_k as this history sees them, k = 2 .. B + 1, for the sums inside a block: with
        them a result does not depend on where blocks begin.
    block_start_weights : ndarray, shape (C, B + 2)
        The start weights of the first block's steps.
    """

    n_modes: int = 0
    # largest relative errors of the sums that stand for kernels other than power laws
    kernel_errors: KernelErrors = NO_ERRORS

    def __init__(self, exchange, tables, arrays, block_weights, block_start_weights):
        self.exchange = as_value(exchange, EXCHANGE_SIG)
        self.block_weights = np.ascontiguousarray(block_weights)
        self.block_start_weights = np.ascontiguousarray(block_start_weights)
        self.tables = (*tables, *(np.zeros((1, 0)),) * (N_TABLES - len(tables)))
        self.arrays = arrays

    @abstractmethod
    def prepare(self, n_end: int) -> None:
        """Make room for a march up to step `n_end`; raise ValueError where there is none."""

    def follow(self, size: int) -> None:  # noqa: B027
        """Work out tables of the `size` steps whose rows are new; nothing by default."""

    def reach(self, n: int) -> int:
        """Step up to which a march may go from step n before `refresh` must be called."""
        return n + 2**62

    def refresh(self, n: int, pieces: np.ndarray, groups: np.ndarray) -> None:  # noqa: B027
        """Do what cannot be done in compiled code before a march from step n; nothing by default.

        `pieces` (W, B + 1) are those of the block that ended at step n, not yet exchanged,
        `groups` (W,) the group of each column.
        """

    @property
    def nbytes(self):
        """Bytes of the memory itself, tables not counted."""
        return sum(array.nbytes for array in self.arrays)

    def clear(self) -> None:
        """Forget everything."""
        for array in self.arrays:
            array[...] = 0.0

    def state(self) -> tuple[np.ndarray, ...]:
        """The contents as a tuple of independent arrays."""
        return tuple(array.copy() for array in self.arrays)

    def restore(self, state) -> None:
        """Take the contents from what `state` returned."""
        self.arrays = tuple(np.ascontiguousarray(array, dtype=float).copy() for array in state)


class NoMemory(Memory):
    """The memory of an equation whose terms are all classical."""

    def __init__(self, n_columns, block_weights, block_start_weights):
        empty = np.zeros((n_columns, 0))
        super().__init__(exchange_nothing, (), (empty,) * 3, block_weights, block_start_weights)

    def prepare(self, n_end: int) -> None:
        """Any length will do."""


class History(ABC):
    """How the past is summed; subclasses are final frozen dataclasses, one file each.

    Attributes
    ----------
    takes_kernels : bool
        Whether terms may have kernels other than Caputo's.
    takes_varying : bool
        Whether orders may vary: `open_varying` gives a memory.
    takes_meshes : bool
        Whether steps may differ in length: `open_mesh` gives a memory.
    """

    takes_kernels: ClassVar[bool] = False
    takes_varying: ClassVar[bool] = False
    takes_meshes: ClassVar[bool] = False

    @abstractmethod
    def open(self, convolution: Convolution, n_columns: int, n_block: int, n_steps: int) -> Memory:
        """A fresh `Memory` for one run.

        Parameters
        ----------
        convolution : Convolution
            The weights to sum with.
        n_columns : int
            Number of columns W.
        n_block : int
            Steps in a block.
        n_steps : int
            Steps the run is going to take.
        """

    def open_varying(self, schedule: Schedule, n_columns: int, n_steps: int) -> Memory:
        """A fresh memory for one run of an equation whose orders vary, in blocks of one step."""
        required = "be Direct or SumOfExponentials where orders vary"
        raise ValueError(complaint("history", required, repr(self)))

    def open_mesh(self, sums: MeshSums, n_columns: int, span: Span) -> Memory:
        """A fresh memory for one run on a mesh of any steps, in blocks of one step."""
        required = f"be left out with {type(self).__name__}, which takes uniform steps"
        got = f"{sums.theta.size} steps"
        raise ValueError(complaint("mesh", required, got, "or use SumOfExponentials or Direct"))
