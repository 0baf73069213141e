"""Linear solvers for Newton's matrix, with their tables and matrices."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ..compiled.callbacks import lapack_address
from ..compiled.jacobian import COLUMNS, FEW, ROWS, VALUES
from ..compiled.jit import as_value, checked
from ..compiled.linalg import address_of_factors, dense_solver, no_solver
from ..compiled.signatures import SOLVER_SIG, LinearSolver
from ..compiled.sparse_solvers import SparseFactors, banded_solver, sparse_solver
from ..equation.jacobian_structure import Structure
from .signatures import March


class NewtonSetup(NamedTuple):
    """Linear solver of Newton's method."""

    solver: Any  # the compiled function
    tables: LinearSolver
    workspace: np.ndarray  # `March.newton`, for the Jacobian and the matrices
    held: Any = None  # keeps a reference to the Python function that `solver` may call

    def taken_over(self, march: March) -> np.ndarray:
        """Return `workspace` with the matrices of a restored march."""
        # factors of a sparse Jacobian with entries at other places are invalid: the next step makes
        # new ones
        kept, workspace = march.newton, self.workspace
        if kept.shape == workspace.shape and kept.shape[1] == kept.shape[2]:
            return kept
        places = slice(ROWS, COLUMNS + 1)
        if kept.shape == workspace.shape and np.array_equal(kept[:, places], workspace[:, places]):
            workspace[:, VALUES] = kept[:, VALUES]
        else:
            march.counts["kept"] = 0
        return workspace


def newton_of(
    structure: Structure | None, d: int, tangents: bool, solve: str, exact: bool
) -> NewtonSetup:
    """Return the `NewtonSetup` for d components of an orbit, with tangents or without."""
    # solve: that of the scheme; exact: one iteration solves a step. With at most FEW components the
    # solver is for tangents only. The workspace is empty if no step needs a Jacobian.
    implicit = solve in ("newton", "imex")
    n_matrices = 1 + int(tangents)
    if structure is None and not implicit and not tangents:
        return _nothing()
    if structure is not None:
        return _of_structure(structure, n_matrices, implicit, int(exact))
    few = d <= FEW and solve == "newton"
    n = d if implicit and (tangents or not few) else 0
    size = d if implicit or tangents else 0
    tables = LinearSolver(
        factors=np.zeros((n_matrices if n else 0, n + 2, n)),
        order=np.arange(n),
        lapack=address_of_factors(n),
        exact=int(exact and not few),
        few=int(few),
    )
    solver = as_value(dense_solver if n else no_solver, SOLVER_SIG)
    return NewtonSetup(solver, tables, np.zeros((1 + n_matrices, size, size)))


@lru_cache(maxsize=1)
def _nothing() -> NewtonSetup:
    """Return the `NewtonSetup` of a march that solves no equations."""
    tables = checked(LinearSolver(np.zeros((0, 2, 0)), np.arange(0)))
    return NewtonSetup(as_value(no_solver, SOLVER_SIG), tables, np.zeros((2, 0, 0)))


def _of_structure(structure: Structure, n_matrices: int, implicit: bool, exact: int) -> NewtonSetup:
    """Return `NewtonSetup` for Jacobians of a structure, with factors of `n_matrices` matrices."""
    band, held, solver = structure.band, None, no_solver
    workspace = np.tile(structure.entries, (1 + n_matrices if implicit else 1, 1, 1))
    tables = LinearSolver(np.zeros((0, 0, 0)), np.arange(0), exact=exact)
    if implicit and band is None:
        held, solver = SparseFactors(structure, float), sparse_solver
        tables = tables._replace(order=np.arange(structure.n), python=held.address)
    elif implicit and band is not None:
        solver, (lower, upper, order) = banded_solver, band
        factors = np.zeros((n_matrices, order.size, 2 * lower + upper + 2))
        lapack = lapack_address("dgbtrf")
        places = order.astype(np.int64)
        tables = LinearSolver(factors, places, lower, upper, lapack, exact=exact)
    return NewtonSetup(as_value(solver, SOLVER_SIG), tables, workspace, held)
