"""Records and signatures of right-hand sides, Jacobians and linear solvers in compiled code."""

from typing import Annotated, Any, NamedTuple

from .functions import Force
from .jit import F8, I8, MAT, VEC, Cube, Integers, compiled_type
from .reference import FunctionField, Reference

# Signature of ``jacobian(force, t, y, units, out)``, which fills `out` and returns the number of
# calls of f; y (d,) and units (d,), the least sizes of components for steps of differences.
JACOBIAN_SIG = I8(Reference(compiled_type(Force)), F8, VEC, VEC, MAT)


class RightSide(NamedTuple):
    """The right-hand side of an equation, and how its Jacobian is computed.

    Tangent k is the derivative by parameter k, for k below `by_params`. The other tangents are
    derivatives along directions of the initial values.
    """

    force: Force
    jacobian: Annotated[Any, FunctionField(JACOBIAN_SIG)]
    by_params: int = 0


RIGHT_SIDE = Reference(compiled_type(RightSide))


# Tasks of a linear solver. Its matrix number 0 is Newton's, number 1 that of the tangents.
FACTORISE = 0  # factorise the matrix
SUBSTITUTE = 1  # solve with the factors


class LinearSolver(NamedTuple):
    """Workspace and tables of a linear solver for n components; n = 0 if there is no solver."""

    # factors of Newton's matrix and, if m = 2, of the matrix of the tangents
    factors: Annotated[Cube, "m . ."]
    order: Annotated[Integers, "n"]  # of the components, so that the band is narrow
    lower: int = 0  # number of diagonals of a banded matrix below the main one
    upper: int = 0  # number of diagonals of a banded matrix above the main one
    lapack: int = 0  # address of LAPACK's factorisation
    python: int = 0  # address of a function that enters Python
    # 1 if f is linear and all steps have one matrix, so that one iteration solves a step
    exact: int = 0
    # 1 if Newton's method eliminates without this solver, which then serves the tangents only
    few: int = 0


LINEAR = Reference(compiled_type(LinearSolver))
# Signature of a solver ``solve(task, number, matrix, x, linear)``. `number` is that of the matrix;
# the solution replaces the right-hand side in x. It returns 0 for success.
SOLVER_SIG = I8(I8, I8, MAT, VEC, LINEAR)
