"""Records and signatures of right-hand sides, of Jacobians, and of linear solvers."""

from typing import Annotated, Any, NamedTuple

from .jit import F8, I8, JAC_SIG, MAT, RHS_SIG, VEC, Cube, Integers, Vector, compiled_type
from .reference import FunctionField, Reference


class UserFunctions(NamedTuple):
    """The right-hand side of an equation, its Jacobian if that is given, and the parameters."""

    rhs: Annotated[Any, FunctionField(RHS_SIG)]
    jac: Annotated[Any, FunctionField(JAC_SIG)]
    params: Vector


# functions, t, y (d,), units (d,) of differences, Jacobian; the number of calls of `rhs`
JACOBIAN_SIG = I8(Reference(compiled_type(UserFunctions)), F8, VEC, VEC, MAT)


class RightSide(NamedTuple):
    """The right-hand side of an equation, and how its Jacobian is computed.

    The first `by_params` tangents are derivatives by the first parameters, one by each.
    """

    user: UserFunctions
    jacobian: Annotated[Any, FunctionField(JACOBIAN_SIG)]
    by_params: int = 0


RIGHT_SIDE = Reference(compiled_type(RightSide))


# Tasks of a linear solver, for Newton's matrix (number 0) or that of the tangents (number 1).
FACTORISE = 0  # factorise the matrix
SUBSTITUTE = 1  # solve with its factors


class LinearSolver(NamedTuple):
    """Storage and tables of a linear solver for n components; n = 0 for none.

    - factors (m, ., .): of Newton's matrix and, if m = 2, of the matrix of the tangents.
    - order (n,): the place of each component; lower, upper: diagonals of a band.
    - lapack, python: addresses of LAPACK's factorisation and of a function that enters Python.
    - exact: 1 if the right-hand side is linear and all steps have one matrix, so that one iteration
      solves a step.
    - few: 1 if Newton's method eliminates without the solver, which is for the tangents alone.
    """

    factors: Cube
    order: Integers
    lower: int = 0
    upper: int = 0
    lapack: int = 0
    python: int = 0
    exact: int = 0
    few: int = 0


LINEAR = Reference(compiled_type(LinearSolver))
# task, number, matrix, vector that the solution replaces; 0 where it is done
SOLVER_SIG = I8(I8, I8, MAT, VEC, LINEAR)
