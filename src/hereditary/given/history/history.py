"""The interface of histories, which sum over the past of a run.

A `History` is a description; `History.open` returns an `OpenHistory`, which stores the past of one
run. In each step m every one of W columns has a piece u_m, its increment or the value of f. Before
a block of steps an `OpenHistory` adds ``sum_m W_m u_m`` over all earlier pieces to the block's lag.
On uniform steps the weights in step n are W_(n-m). Otherwise a block has one step, and each step
has weights of its own. The march calls a compiled function with plain arrays for this. All arrays
are linear in the pieces. Between blocks Python may copy, store, restore or linearly combine them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np

from ...compiled.jit import as_value
from ...kernels.memory_kernel import NO_ERRORS, KernelErrors
from ..past import exchange_nothing
from ..plan import Convolution
from ..row_plan import RowSums
from ..signatures import EXCHANGE_SIG, HistoryArrays, Tables, held
from ..steps import Span

Past = Convolution | RowSums


class OpenHistory(ABC):
    """The memory of one march, in blocks of B steps, with W columns in C groups of equal terms.

    Attributes
    ----------
    exchange : compiled function
        Function with the signature `EXCHANGE_SIG` (given/signatures.py), which stores the pieces of
        a block and adds to the lag of the next one.
    tables : Tables
        Tables that `exchange` reads.
    arrays : HistoryArrays
        Arrays that `exchange` changes; the march sets `starts`.
    block_weights : ndarray, shape (C, B + 2)
        The history's approximations of the weights W_k, k = 2 .. B + 1, for sums inside a block.
        Because sums inside and outside agree, results do not depend on where blocks begin.
    block_start_weights : ndarray, shape (V C, B + 2)
        The weights of V start values in the steps of the first block.
    """

    n_modes: int = 0
    # largest relative errors of the sums of exponentials that replace kernels, power laws excepted
    kernel_errors: KernelErrors = NO_ERRORS

    def __init__(
        self, exchange: Any, tables: Tables, arrays: HistoryArrays, block_weights: np.ndarray,
        block_start_weights: np.ndarray,
    ) -> None:  # fmt: skip
        self.exchange = as_value(exchange, EXCHANGE_SIG)
        self.block_weights = np.ascontiguousarray(block_weights)
        self.block_start_weights = np.ascontiguousarray(block_start_weights)
        self.tables = tables
        self.arrays = arrays

    @abstractmethod
    def prepare(self, n_end: int) -> None:
        """Allocate storage for a march up to step `n_end`; raise ValueError if that is too far."""

    def reach(self, n: int, pieces: np.ndarray, groups: np.ndarray) -> int:
        """Prepare the tables for step n; return the step up to which they are valid.

        `pieces` (W, B + 1) are those of the block that ended at step n, which are not yet stored.
        `groups` (W,) is the group of each column. By default tables are valid for all steps.
        """
        return n + 2**62

    @property
    def nbytes(self) -> int:
        """Bytes of `arrays`, without tables."""
        return sum([array.nbytes for array in self.arrays])

    def clear(self) -> None:
        """Set all arrays to 0, as before the first step."""
        for array in self.arrays:
            array[...] = 0.0

    def state(self) -> tuple[np.ndarray, ...]:
        """Return copies of the arrays as a tuple, for `restore`."""
        return tuple(array.copy() for array in self.arrays)

    def restore(self, state: tuple[np.ndarray, ...]) -> None:
        """Set the arrays to copies of those that `state` returned."""
        self.arrays = HistoryArrays(
            *(np.ascontiguousarray(array, dtype=float).copy() for array in state)
        )


class NoMemory(OpenHistory):
    """The empty memory of an equation whose terms all have integer orders."""

    def __init__(self, n_columns: int, *weights: np.ndarray) -> None:
        # weights: block_weights and block_start_weights
        super().__init__(exchange_nothing, Tables(), held(n_columns), *weights)

    def prepare(self, n_end: int) -> None:
        """Do nothing: a march of any length needs no storage."""


class History(ABC):
    """A method of summing over the past of a run; subclasses are frozen dataclasses, one per file.

    Attributes
    ----------
    takes_kernels : bool
        Whether terms may have kernels other than power laws.
    takes_varying : bool
        Whether orders may vary.
    takes_meshes : bool
        Whether steps may differ in length.
    """

    takes_kernels: ClassVar[bool] = False
    takes_varying: ClassVar[bool] = False
    takes_meshes: ClassVar[bool] = False

    def open(self, past: Past, n_columns: int, n_block: int, span: int | Span) -> OpenHistory:
        """Return a new, empty `OpenHistory` for one run.

        Parameters
        ----------
        past : Convolution or RowSums
            The sums that the history computes.
        n_columns : int
            Number of columns W: components of the orbit and of all tangents.
        n_block : int
            Number of steps in a block.
        span : int or Span
            Number of steps that the history must cover, or the range of time lags on a mesh.
        """
        past.check(self)
        if not past.has_memory():
            return NoMemory(n_columns, *past.exact(n_block + 2))
        return self.memory(past, n_columns, n_block, span)

    @abstractmethod
    def memory(self, past: Past, n_columns: int, n_block: int, span: Any) -> OpenHistory:
        """Return a new `OpenHistory` for sums with more than the newest two pieces; see `open`."""
