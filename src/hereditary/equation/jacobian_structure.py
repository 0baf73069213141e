"""Entries of a Jacobian that may differ from 0: bands, patterns, and functions that set them."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..compiled.functions import Functions, mapped
from ..compiled.jacobian import COLUMNS, CONSTANTS, FEW, GROUPS, N_ENTRY_ROWS, ROWS
from ..functions.build import Start, arity_of
from ..functions.reads import reads_argument
from ..support.checks import complaint, count, refuse, refuse_masked, shown

# Most diagonals of a pattern that is factorised as a band, after its components are reordered. With
# more diagonals SuperLU takes less time.
_WIDEST = 64


class Band(NamedTuple):
    """Diagonals below and above the main one, and the place of each component, (n,)."""

    lower: int
    upper: int
    order: np.ndarray


class Structure:
    """Entries of a square Jacobian of n components, and the constant ones among their summands."""

    def __init__(
        self, n: int, rows: np.ndarray, columns: np.ndarray, constants: np.ndarray | None = None,
        places: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        # rows, columns (k,) int64: places of the entries, each once, the diagonal among them;
        # constants (k,): summands that given Jacobians leave out, 0 by default; places (k,) int64:
        # position of each entry in the array of a given Jacobian, -1 for none, None for differences
        self.n, self.rows, self.columns = n, rows, columns
        self.constants = np.zeros(rows.size) if constants is None else constants
        self.places = places

    @classmethod
    def of(
        cls, n: int, rows: np.ndarray, columns: Any, places: np.ndarray | None = None,
        linear: Any = None,
    ) -> Structure:  # fmt: skip
        """Return the structure of these entries, of the diagonal and of a SciPy matrix `linear`."""
        found = [(rows, columns), (np.arange(n), np.arange(n))]
        if linear is not None:
            linear = linear.tocoo()
            found.append((linear.row.astype(np.int64), linear.col.astype(np.int64)))
        keys = np.concatenate([row * n + column for row, column in found])
        unique, numbers = np.unique(keys, return_inverse=True)
        constants = np.zeros(unique.size)
        if linear is not None:
            np.add.at(constants, numbers[rows.size + n :], linear.data)
        known = None
        if places is not None:
            known = np.full(unique.size, -1)
            known[numbers[: rows.size]] = places
        return cls(n, unique // n, unique % n, constants, known)

    @cached_property
    def entries(self) -> np.ndarray:
        """Return the entries as compiled code takes them, (5, k) (compiled/jacobian.py)."""
        found = np.zeros((N_ENTRY_ROWS, self.rows.size))
        groups = self._groups[self.columns] if self.places is None else self.places
        order = np.argsort(groups, kind="stable") if self.places is None else slice(None)
        for row, values in (
            (ROWS, self.rows), (COLUMNS, self.columns), (GROUPS, groups),
            (CONSTANTS, self.constants),
        ):  # fmt: skip
            found[row] = values[order]
        return found

    def matrix(self, values: np.ndarray) -> Any:
        """Return the matrix whose entries, in the order of `entries`, have these values."""
        rows, columns = self.entries[[ROWS, COLUMNS]].astype(np.int64)
        return _sparse().csr_array((values, (rows, columns)), shape=(self.n, self.n))

    @cached_property
    def _groups(self) -> np.ndarray:
        """Number of the group of each column; columns of one group share no row."""
        pattern = self.matrix_of_ones
        neighbours = (pattern.T @ pattern).tocsr()
        groups = np.full(self.n, -1)
        for j in range(self.n):
            beside = neighbours.indices[neighbours.indptr[j] : neighbours.indptr[j + 1]]
            taken = set(groups[beside].tolist())
            groups[j] = next(g for g in range(len(taken) + 1) if g not in taken)
        return groups

    @property
    def matrix_of_ones(self) -> Any:
        """The pattern as a matrix."""
        ones = np.ones(self.rows.size)
        return _sparse().csr_array((ones, (self.rows, self.columns)), shape=(self.n, self.n))

    @cached_property
    def band(self) -> Band | None:
        """The band that contains all entries of reordered components; None if it would be wide."""
        for order in (np.arange(self.n), self._narrow_order()):
            offsets = order[self.rows] - order[self.columns]
            lower, upper = int(offsets.max(initial=0)), int(-offsets.min(initial=0))
            if lower + upper <= _WIDEST:
                return Band(lower, upper, order)
        return None

    def _narrow_order(self) -> np.ndarray:
        """Return the place of each component in the order of Cuthill and McKee, reversed."""
        graphs = importlib.import_module("scipy.sparse.csgraph")
        pattern = self.matrix_of_ones
        order = np.empty(self.n, dtype=np.int64)
        found = graphs.reverse_cuthill_mckee((pattern + pattern.T).tocsr(), True)
        order[found] = np.arange(self.n)
        return order

    def by_blocks(self, s: int) -> Structure:
        """Return the structure in which each entry is a full block (s, s), entry after entry."""
        own = np.arange(s)
        rows, columns = self.entries[[ROWS, COLUMNS]].astype(np.int64)
        rows = (rows[:, None, None] * s + own[:, None] + 0 * own).ravel()
        columns = (columns[:, None, None] * s + 0 * own[:, None] + own).ravel()
        return Structure(self.n * s, rows, columns, places=np.full(rows.size, -1))

    def with_velocities(self) -> Structure:
        """Return the structure of pairs (x, w) whose first half is w and whose second half f(x)."""
        n, own = self.n, np.arange(self.n)
        rows = np.concatenate([own, n + self.rows])
        return Structure.of(2 * n, rows, np.concatenate([n + own, self.columns]))


class JacobianInfo(NamedTuple):
    """Statements of an equation about its Jacobian."""

    rows: np.ndarray | None  # (k,), of entries of d rhs / d y that may differ from 0; None for all
    columns: np.ndarray | None
    shape: tuple  # of the array that `jac` fills
    places: np.ndarray | None  # (k,), positions of the entries in it
    linear: Any  # the constant matrix as SciPy's CSR array, or None

    def values_of(self, jac: Callable | None, start: Start) -> Callable | None:
        """Return a Jacobian that returns values of entries, from one that may return matrices."""
        if jac is None or len(self.shape) > 1:
            return jac
        arity = arity_of("jac", "data", jac, start)
        try:
            found = jac(start.t, start.y.copy(), start.params.copy()) if arity == 3 else None
            found = jac(start.t, start.y.copy()) if arity == 2 else found
        except Exception:  # reported when all functions are tried
            return jac
        return OnPattern(jac, self.rows, self.columns) if hasattr(found, "tocsr") else jac

    def constants(self) -> tuple[np.ndarray, ...]:
        """Return the arrays that a state of a run must share."""
        linear = self.linear
        return () if linear is None else (linear.data, linear.indices, linear.indptr)

    def assembled(self, functions: Functions, d: int) -> tuple[Functions, Structure | None]:
        """Return the functions of a system and its structure, from the user's functions."""
        linear, given = self.linear, functions.has_jac
        structure = None
        if self.rows is not None and d > FEW:
            places = self.places if given else None
            structure = Structure.of(d, self.rows, self.columns, places, linear)
        if given and structure is None and self.rows is not None:  # of few components
            table = Structure.of(d, self.rows, self.columns, self.places, None).entries
            rows, columns, places = table[[ROWS, COLUMNS, GROUPS]].astype(np.int64)
            functions = functions._replace(rows=rows, columns=columns, places=places)
        if linear is not None:
            rows = np.repeat(np.arange(d), np.diff(linear.indptr))
            functions = mapped(functions, d, d, np.c_[rows, linear.indices, linear.data])
        return functions, structure


class OnPattern:
    """A Jacobian of values of a pattern's entries, from one that returns matrices."""

    def __init__(self, jac: Callable, rows: Any, columns: Any) -> None:
        self._jac, self._rows, self._columns = jac, rows, columns
        self.__signature__ = inspect.signature(jac)
        self.__name__ = getattr(jac, "__name__", repr(jac))

    def __call__(self, *arguments: Any) -> np.ndarray:
        matrix = self._jac(*arguments).tocsr()
        values = np.asarray(matrix[self._rows, self._columns]).ravel()
        if np.abs(matrix).sum() > np.abs(values).sum() * (1 + 1e-12):
            matrix[self._rows, self._columns] = 0.0
            row, column = (int(places[0]) for places in matrix.nonzero())
            required = "return matrices without entries outside jac_sparsity"
            refuse("jac", required, f"one at [{row}, {column}]")
        return values


def copied(given: Any) -> Any:
    """Return a copy of an array or matrix; any other value unchanged."""
    return given.copy() if hasattr(given, "copy") else given


def jacobian_info(
    d: int, rhs: Callable | None, jac: Callable | None, rearranged: bool, bandwidth: Any = None,
    jac_sparsity: Any = None, linear: Any = None,
) -> JacobianInfo:  # fmt: skip
    """Check what an equation of d components states of its Jacobian, and return it."""
    # rearranged: whether the system that is solved has other components than y
    given = {"bandwidth": bandwidth, "jac_sparsity": jac_sparsity, "linear": linear}
    named = [name for name, part in given.items() if part is not None]
    if named and rearranged:
        required = "be left out with memory, complex y, orders above 2 and matrices"
        refuse(named[0], required, shown(given[named[0]]), "write a system of real y")
    alone = rhs is None
    if alone and (linear is None or jac is not None):
        refuse("rhs", "be a function", "None", "rhs=None means linear @ y", kind=TypeError)
    if bandwidth is not None and jac_sparsity is not None:
        remedy = "each of them states which entries may differ from 0"
        refuse("jac_sparsity", "come without bandwidth", f"bandwidth={bandwidth}", remedy)
    matrix: Any = None if linear is None else _linear(linear, d)
    rows = columns = places = None
    shape: tuple[int, ...] = (d, d)
    if alone or (named == ["linear"] and jac is None and not reads_argument(rhs, 1)):
        offsets = matrix.tocoo().row - matrix.tocoo().col
        dense = np.ptp(np.append(offsets, 0)) > min(_WIDEST, d // 4)
        if not (isinstance(linear, np.ndarray) and dense):
            rows = columns = places = np.zeros(0, dtype=np.int64)
    elif bandwidth is not None:
        lower, upper = _widths(bandwidth, d)
        shape = (lower + upper + 1, d)
        diagonals, columns = (part.ravel() for part in np.indices(shape))
        rows = diagonals + columns - upper
        inside = (rows >= 0) & (rows < d)
        places = np.flatnonzero(inside)
        rows, columns = rows[inside], columns[inside]
    elif jac_sparsity is not None:
        rows, columns = _pattern(jac_sparsity, d)
        places, shape = np.arange(rows.size), (rows.size,)
    return JacobianInfo(rows, columns, shape, places, matrix)


def _widths(bandwidth: Any, d: int) -> list[int]:
    """Return the numbers of diagonals below and above the main one."""
    try:
        lower, upper = bandwidth
    except (TypeError, ValueError) as error:
        required = "be (lower, upper), the diagonals below and above the main one"
        raise TypeError(complaint("bandwidth", required, repr(bandwidth))) from error
    widths = [count("bandwidth", width, "pass (lower, upper)", least=0) for width in (lower, upper)]
    return [min(width, d - 1) for width in widths]


def _pattern(pattern: Any, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and columns of the entries of a pattern, in the order of its data."""
    required = f"be a pattern of shape ({d}, {d}), SciPy's sparse or an array"
    if not hasattr(pattern, "tocsr"):
        pattern = _as_matrix("jac_sparsity", pattern, required)
    if pattern.shape != (d, d):
        refuse("jac_sparsity", required, f"shape {pattern.shape}")
    found = (pattern if pattern.format in ("coo", "csc") else pattern.tocsr()).tocoo()
    rows, columns = found.row.astype(np.int64), found.col.astype(np.int64)
    entries, times = np.unique(rows * d + columns, return_counts=True)
    if entries.size < rows.size:
        row, column = divmod(int(entries[times > 1][0]), d)
        required, got = "hold each entry once", f"[{row}, {column}] more than once"
        refuse("jac_sparsity", required, got, "call sum_duplicates()")
    return rows, columns


def _linear(linear: Any, d: int) -> Any:
    """Return the constant matrix as SciPy's CSR array."""
    required = f"be a matrix of shape ({d}, {d}), an array or SciPy's sparse one"
    if not hasattr(linear, "tocsr"):
        linear = _as_matrix("linear", linear, required)
    if linear.shape != (d, d):
        refuse("linear", required, f"shape {linear.shape}")
    if linear.dtype.kind not in "biuf" or not np.all(np.isfinite(linear.data)):
        got = f"{shown(linear.data)} of dtype {linear.dtype}"
        refuse("linear", "hold finite real numbers", got)
    matrix = _sparse().csr_array(linear.tocsr(), dtype=float, copy=True)
    matrix.sum_duplicates()
    return matrix


def _as_matrix(name: str, given: Any, required: str) -> Any:
    """Return an array as a sparse matrix."""
    refuse_masked(name, given, required)
    try:
        values = np.asarray(given)
    except ValueError:  # rows of unequal length
        values = np.asarray(None)
    if values.ndim != 2 or values.dtype.kind not in "biuf":
        refuse(name, required, f"shape {values.shape} of {values.dtype}")
    return _sparse().csr_array(values)


def _sparse() -> Any:
    """Import SciPy's sparse matrices, which takes a long time."""
    return importlib.import_module("scipy.sparse")
