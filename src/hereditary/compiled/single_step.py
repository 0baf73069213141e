"""One collocation step on any nodes, as a singular start has them."""

import numpy as np

from .collocation import empty_factors, solve_stages, solve_tangents
from .copying import put
from .jit import CUBE, CUBES, F8, I8, MAT, VEC, entry
from .many_stages import solve_many, solve_many_tangents, stage_factors
from .rows import assemble_operators, eliminate_known, empty_operators, subtract_from_forces
from .signatures import JAC, RHS
from .structures import CONTRACTION_RECORD, COUNTS_RECORD, EQUATIONS, STAGE_SOLVER, STAGES

_SINGLE_STEP = (
    RHS, JAC, I8, VEC, STAGE_SOLVER, STAGES, EQUATIONS, VEC, CUBE, CUBE, F8, CUBE, MAT, VEC, CUBES,
    COUNTS_RECORD, CONTRACTION_RECORD,
)  # fmt: skip


def single_step(name, solve, solve_for_tangents, factors, told):
    """Compile the solution of one step for one way of solving its equations."""

    def step(
        rhs, jac, has_jac, params, solver, stages, equations, times, integrals, local, h, base,
        x_start, goal, values, counts, contraction,
    ):  # fmt: skip
        kinds = equations.kinds
        n_nodes, d, n_rows = times.shape[0], equations.second.shape[0], base.shape[1]
        operators = empty_operators(base.shape[0], n_rows, kinds, n_nodes)
        inverse = np.empty((0, 0))
        assemble_operators(h, equations, integrals, inverse, local, operators)
        known, newton = base + operators.constant, factors(d, n_nodes, 0, solver, stages)
        put(equations.units, newton.room.units)
        put(equations.units, newton.room.scales)
        eliminate_known(kinds, operators.matrices, known)
        integral = integrals[equations.orders.shape[0] - 1]
        if not solve(
            rhs, jac, has_jac, params, times, h, known[0], x_start[0], equations.second,
            operators, kinds, integral, goal, values[0], counts, contraction, newton,
        ):  # fmt: skip
            return False
        if x_start.shape[0] > 1 and not solve_for_tangents(
            rhs, jac, has_jac, params, times, h, known, x_start, equations.second,
            operators, kinds, integral, values, counts, newton,
        ):  # fmt: skip
            return False
        subtract_from_forces(kinds, operators.matrices, known, values)
        return True

    step.__name__ = step.__qualname__ = name
    step.__doc__ = """Solve one step of equations without p' among the integrands.

    base (1 + k, R, s) holds p(0) and the history of the orbit and its tangents; values (1 + k, 3,
    d, s) receives f, p and y at the nodes and holds a first guess of the orbit's p.
    """
    return entry(*_SINGLE_STEP, told=told)(step)


_FEW = solve_stages, solve_tangents, empty_factors, "the first step of collocation"
_MANY = solve_many, solve_many_tangents, stage_factors, f"{_FEW[-1]} of many components"
SINGLE_STEPS = {
    False: single_step("solve_single_step", *_FEW),
    True: single_step("solve_single_step_of_many", *_MANY),
}
