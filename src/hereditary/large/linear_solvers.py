"""Linear solvers of Newton's matrix for sparse Jacobians: banded by LAPACK, others by SuperLU."""

from typing import Any

import numpy as np

from ..compiled.callbacks import lapack_address
from ..compiled.jit import as_value
from ..compiled.linalg import no_solver
from ..compiled.signatures import SOLVER_SIG, LinearSolver
from ..compiled.sparse_solvers import SparseFactors, banded_solver, sparse_solver
from ..given.linear_solvers import NewtonSetup


def newton_of_structure(structure: Any, slots: int, implicit: bool, exact: int) -> NewtonSetup:
    """Return `NewtonSetup` for Jacobians of a structure, with factors of `slots` matrices."""
    band, held, solver = structure.band, None, no_solver
    room = np.tile(structure.entries, (1 + slots if implicit else 1, 1, 1))
    tables = LinearSolver(np.zeros((0, 0, 0)), np.arange(0), exact=exact)
    if implicit and band is None:
        held, solver = SparseFactors(structure, float), sparse_solver
        tables = tables._replace(order=np.arange(structure.n), python=held.address)
    elif implicit:
        solver, (lower, upper, order) = banded_solver, band
        factors = np.zeros((slots, order.size, 2 * lower + upper + 2))
        lapack = lapack_address("dgbtrf")
        places = order.astype(np.int64)
        tables = LinearSolver(factors, places, lower, upper, lapack, exact=exact)
    return NewtonSetup(as_value(solver, SOLVER_SIG), tables, room, held)
