"""Linear solvers of Newton's matrix for many components, with their room."""

from typing import Any, NamedTuple

import numpy as np
from numba.extending import get_cython_function_address

from ..compiled.jacobian import COLUMNS, ROWS, VALUES
from ..compiled.jit import as_value
from ..compiled.signatures import SOLVER_SIG, LinearSolver
from ..compiled.solvers import banded_solver, dense_solver, no_solver, sparse_solver
from ..compiled.superlu import SparseFactors
from ..equation.structure import FEW


class Newton(NamedTuple):
    """Newton's method for many components: solver, its tables, and room for the matrices.

    held keeps alive what enters Python.
    """

    solver: Any
    tables: LinearSolver
    room: np.ndarray
    held: Any = None

    def taken_over(self, march):
        """Return the room with the matrices that a restored march kept.

        Where their entries are others, as of another equation, its factors are no longer in force.
        """
        kept, room = march.newton, self.room
        if kept.shape == room.shape and kept.shape[1] == kept.shape[2]:
            return kept
        places = slice(ROWS, COLUMNS + 1)
        if kept.shape == room.shape and np.array_equal(kept[:, places], room[:, places]):
            room[:, VALUES] = kept[:, VALUES]
        else:
            march.counts["kept"] = 0
        return room


def newton_of(structure, d, tangents, solve, exact):
    """Return `Newton` for d components of an orbit, with tangents or without.

    `solve` is the scheme's; `exact` tells whether one iteration is enough. Newton's method solves
    for few components by itself, and leaves their tangents to the solver. Room is empty where no
    Jacobian is taken.
    """
    implicit = solve in ("newton", "imex")
    slots = 1 + int(tangents)
    if structure is None:
        few = d <= FEW and solve == "newton"
        n = d if implicit and (tangents or not few) else 0
        size = d if implicit or tangents else 0
        room = np.zeros((1 + slots, size, size))
        tables = _tables(
            np.zeros((slots if n else 0, n + 2, n)), np.arange(n), exact and not few, few
        )
        solver = dense_solver if n else no_solver
        return Newton(as_value(solver, SOLVER_SIG), tables, room)
    room = np.tile(structure.entries, (1 + slots if implicit else 1, 1, 1))
    if not implicit:
        empty = _tables(np.zeros((0, 0, 0)), np.arange(0), exact)
        return Newton(as_value(no_solver, SOLVER_SIG), empty, room)
    band = structure.band
    if band is None:
        held = SparseFactors(structure, float)
        tables = _tables(np.zeros((0, 0, 0)), np.arange(d), exact, python=held.address)
        return Newton(as_value(sparse_solver, SOLVER_SIG), tables, room, held)
    factors = np.zeros((slots, d, 2 * band.lower + band.upper + 2))
    lapack = get_cython_function_address("scipy.linalg.cython_lapack", "dgbtrf")
    tables = _tables(factors, band.order, exact, False, band.lower, band.upper, lapack)
    return Newton(as_value(banded_solver, SOLVER_SIG), tables, room)


def _tables(factors, order, exact, few=False, lower=0, upper=0, lapack=0, python=0):
    """Return the tables of a solver."""
    places = order.astype(np.int64)
    return LinearSolver(factors, places, lower, upper, lapack, python, int(exact), int(few))
