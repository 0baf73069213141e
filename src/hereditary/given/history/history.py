"""The history contract.

A `History` is a description; `open` turns it into an `OpenHistory` that stores the past of a run.
The past is a sequence of pieces u_m, one for each of W columns. The memory adds ``sum_m W_m u_m``
over all pieces older than a block to the lag of that block. On uniform steps the weights are
W_(n-m). On other steps each step has weights of its own, in blocks of one step. The march uses a
compiled function and plain arrays for this. Between blocks Python may copy, store, restore or
linearly combine the arrays. All of them are linear in the pieces.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from ...compiled.jit import as_value
from ...kernels.memory_kernel import NO_ERRORS, KernelErrors
from ..past import exchange_nothing
from ..plan import Convolution
from ..row_plan import RowSums
from ..signatures import EXCHANGE_SIG, Held, Tables, held
from ..steps import Span

Past = Convolution | RowSums


class OpenHistory(ABC):
    """The running memory of one march.

    Attributes
    ----------
    exchange : compiled function
        Of signature `EXCHANGE_SIG`, compiled/signatures.py.
    tables : Tables
        Tables that `exchange` reads.
    arrays : Held
        Arrays that `exchange` changes; the march sets `starts`.
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
        self.tables = tables
        self.arrays = arrays

    @abstractmethod
    def prepare(self, n_end: int) -> None:
        """Allocate storage for a march up to step `n_end`; raise ValueError if that fails."""

    def reach(self, n: int, pieces: np.ndarray, groups: np.ndarray) -> int:
        """Compute the tables of step n; return the step up to which the march may continue.

        `pieces` (W, B + 1) are those of the block that ended at step n, not yet exchanged, `groups`
        (W,) the group of each column.
        """
        return n + 2**62

    @property
    def nbytes(self):
        """Bytes of the memory, without its tables."""
        return sum(array.nbytes for array in self.arrays)

    def clear(self) -> None:
        """Set the memory to that of a start."""
        for array in self.arrays:
            array[...] = 0.0

    def state(self) -> tuple[np.ndarray, ...]:
        """Return the contents of the memory as a tuple of copies."""
        return tuple(array.copy() for array in self.arrays)

    def restore(self, state) -> None:
        """Set the contents of the memory to those that `state` returned."""
        self.arrays = Held(*(np.ascontiguousarray(array, dtype=float).copy() for array in state))


class NoMemory(OpenHistory):
    """The memory of an equation whose terms are all classical."""

    def __init__(self, n_columns, block_weights, block_start_weights):
        none = exchange_nothing, Tables(), held(n_columns)
        super().__init__(*none, block_weights, block_start_weights)

    def prepare(self, n_end: int) -> None:
        """Do nothing: runs of any length need no storage."""


class History(ABC):
    """A way to sum the past; subclasses are final frozen dataclasses, one file each.

    Attributes
    ----------
    takes_kernels : bool
        Whether terms may have kernels other than Caputo's.
    takes_varying : bool
        Whether orders may vary.
    takes_meshes : bool
        Whether steps may differ in length.
    """

    takes_kernels: ClassVar[bool] = False
    takes_varying: ClassVar[bool] = False
    takes_meshes: ClassVar[bool] = False

    def open(self, past: Past, n_columns: int, n_block: int, span: int | Span) -> OpenHistory:
        """Open a fresh `OpenHistory` for one run.

        Parameters
        ----------
        past : Convolution or RowSums
            The sums to make.
        n_columns : int
            Number of columns W.
        n_block : int
            Steps in a block.
        span : int or Span
            Steps the run is going to take, or the distances on its mesh.
        """
        past.check(self)
        if not past.has_memory():
            return NoMemory(n_columns, *past.exact(n_block + 2))
        return self.memory(past, n_columns, n_block, span)

    @abstractmethod
    def memory(self, past: Past, n_columns: int, n_block: int, span) -> OpenHistory:
        """Make the memory of a past that has weights beyond k = 1; see `open`."""
