"""The linear system of all stages of a collocation step, for components whose terms differ.

Of nodal values x_c (s,) of each component c the derivative of the residuals is ``M_c x_c - sum_e
J_ce G_ce x_e`` with matrices (s, s) of the kinds of components and one Jacobian J for all nodes.
The matrices of one kind would be diagonal in a common basis, those of several have none, so the
system of size d s is solved as it is: s times the diagonals of a banded J, s**2 times its entries.
"""

from .jacobian import COLUMNS, ROWS, VALUES, is_sparse
from .jit import allocating, compiled, inner
from .linalg import dense_solver
from .signatures import FACTORISE, LinearSolver
from .sparse_solvers import banded_solver, sparse_solver
from .structures import REST


@inner
def set_joint(stage):
    """Set the matrix of all stages, unknowns in the order (c, i)."""
    jacobian, kinds, pencil, out = stage.jacobian, stage.kinds, stage.pencil, stage.joint
    d, s = kinds.shape[0], pencil.shape[2]
    if not is_sparse(jacobian, d):
        for c in range(d):
            for e in range(d):
                block = out[c * s : (c + 1) * s, e * s : (e + 1) * s]
                gain = pencil[kinds[c], stage.second[kinds[e]]]
                for i in range(s):
                    for j in range(s):
                        block[i, j] = -jacobian[c, e] * gain[i, j]
                        if c == e:
                            block[i, j] += pencil[kinds[c], REST, i, j]
        return
    number = 0
    for entry in range(jacobian.shape[1]):
        c, e = int(jacobian[ROWS, entry]), int(jacobian[COLUMNS, entry])
        gain, rest = pencil[kinds[c], stage.second[kinds[e]]], pencil[kinds[c], REST]
        for i in range(s):
            for j in range(s):
                own = rest[i, j] if c == e else 0.0
                out[VALUES, number] = own - jacobian[VALUES, entry] * gain[i, j]
                number += 1


@allocating
def linear_solver(stage):
    """Room of a real linear solver for all unknowns."""
    return LinearSolver(
        stage.dense, stage.order, stage.lower, stage.upper, stage.lapack, stage.python, 0, 0
    )


def joint_stages(name, solver):
    """Compile the solution of the system by one of the real linear solvers."""

    def solve(task, values, stage):
        if task == FACTORISE:
            set_joint(stage)
        return solver(task, 0, stage.joint, values.reshape(values.size), linear_solver(stage))

    solve.__name__ = solve.__qualname__ = name
    solve.__doc__ = "Factorise the system of all stages, or solve it for nodal values; 0 if done."
    return compiled(solve)


joint_dense = joint_stages("joint_dense", dense_solver)
joint_banded = joint_stages("joint_banded", banded_solver)
joint_sparse = joint_stages("joint_sparse", sparse_solver)
