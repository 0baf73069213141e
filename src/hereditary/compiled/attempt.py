"""An attempt at one collocation step: its equations solved, and the error estimated."""

import numpy as np

from .collocation import nodal_slopes
from .copying import clear_matrix
from .error_estimate import (
    LEAST,
    ROUNDING_OF_SUMS,
    add_force_defect,
    allowed_error,
    defect_matters,
    equations_hold,
    error_ratio,
    estimate_error,
    measure_force_defect,
    tangent_error_ratio,
)
from .jit import compiled, embedded, inlined, inner
from .mode_tables import read_varying
from .rows import POSITION, PRIMARY, SLOPE, eliminate_known, number_of, subtract_from_forces

# Goal of Newton's method, in tolerances.
_NEWTON = 0.01


def attempting(solve, solve_for_tangents, read):
    """Return an attempt for one way of solving the equations of a step and reading the modes."""

    @embedded
    def attempt(
        rhs, jac, has_jac, params, t, h, slot, equations, rule, tables, varying, orbit, state,
        limits, newton, base, operators, values,
    ):  # fmt: skip
        """Solve a step from t of length h for f, p and y at the nodes, `values` (1 + k, n_q, d, s).

        Returns the ratio of its error to the tolerance, whether the equations were solved, and
        whether the defect of f alone makes the error too large. base (1 + k, R, s) is room for what
        is known of the rows; slot is the place of tables for h.
        """
        nodes, kinds, local = rule.nodes, equations.kinds, tables.local[slot]
        control, counts, origin = state.control, state.counts, state.control.origin
        n_columns, last = orbit.x.shape[0], orbit.last[0, PRIMARY]
        integral = rule.integrals[equations.orders.shape[0] - 1]  # of order 1
        for column in range(n_columns):
            read(orbit.modes[column], tables.to_nodes[slot], base[column])
        set_known_part(orbit, tables.to_nodes[slot], equations, varying, operators, base)
        room = newton.room
        set_times(origin, t, h, nodes, limits, room.times)
        set_times(origin, t, h, rule.check_points, limits, room.check_times)
        extrapolate(
            nodes, rule.legendre, last, h, control.last, orbit.p[0], room.reached,
            values[0, PRIMARY],
        )  # fmt: skip
        for c in range(room.sizes.shape[0]):
            room.sizes[c] = max(state.sizes[c], state.floors[c])
            if limits.by_size > 0.0:
                room.units[c] = unit_of(equations.units[c], room.sizes[c])
        set_newton_goal(h, equations, orbit, state, limits, room)
        set_starts(orbit, equations.second, newton.starts)
        solved = solve(
            rhs, jac, has_jac, params, room.times, h, base[0], orbit.x[0], equations.second,
            operators, kinds, integral, room.goal, values[0], counts, state.contraction,
            newton,
        )  # fmt: skip
        ratio, by_defect = np.inf, False
        if solved:
            raise_sizes(values[0], room.sizes)
            ratio, by_defect = orbit_error(
                rhs, params, h, base, equations, rule, operators, local, values, orbit, state,
                newton, limits,
            )  # fmt: skip
        if ratio <= 1.0 and n_columns > 1:
            solved = solve_for_tangents(
                rhs, jac, has_jac, params, room.times, h, base, orbit.x, equations.second,
                operators, kinds, integral, values, counts, newton,
            )  # fmt: skip
            more = np.inf
            if solved:
                more = tangents_error(
                    h, base, equations, rule, operators.matrices, local, values, orbit, newton,
                    limits,
                )  # fmt: skip
            ratio, solved = max(ratio, more), more < np.inf
        return ratio, solved, by_defect

    return attempt


@compiled
def set_times(origin, t, h, nodes, limits, times):
    """Set the times of the nodes, kept strictly between origin and stop, where f may jump."""
    for i in range(nodes.shape[0]):
        time = min(origin + (t + h * nodes[i]), limits.latest)
        times[i] = max(time, limits.earliest)


@inner
def set_known_part(orbit, to_nodes, equations, varying, operators, base):
    """Complete what every row is known to be before the step is solved, (1 + k, R, s).

    Initial values, offsets, and history of orders that vary are added to the other history.
    """
    initial, p, modes, kinds = orbit.initial, orbit.p, orbit.modes, equations.kinds
    d, n_kinds = p.shape[1], number_of(kinds)
    for column in range(base.shape[0]):
        if varying.integrals.shape[0] > 0:
            read_varying(modes[column], to_nodes, equations, varying, base[column])
        for c in range(base.shape[1]):
            row = c // d * n_kinds + kinds[c % d]
            for i in range(base.shape[2]):
                base[column, c, i] += operators.constant[column, c, i]
                base[column, c, i] += operators.start_weights[row, i] * p[column, c % d]
                if c < d:
                    base[column, c, i] += initial[column, c]
    eliminate_known(kinds, operators.matrices, base)


@inner
def set_starts(orbit, second, starts):
    """Set |p(0)|, (d,), where p is y."""
    for c in range(starts.shape[0]):
        starts[c] = abs(orbit.initial[0, c]) if second[c] == 0 else 0.0


@inlined
def unit_of(unit, size):
    """Return the unit of a component of this size: the larger one, or 1 if both are next to 0."""
    largest = max(unit, size)
    return largest if largest > LEAST else 1.0


@inner
def raise_sizes(values, sizes):
    """Raise the sizes of y, (d,), to those at the nodes; values (n_q, d, s)."""
    for c in range(sizes.shape[0]):
        for i in range(values.shape[2]):
            size = abs(values[POSITION, c, i])
            sizes[c] = size if sizes[c] < size < np.inf else sizes[c]


@inner
def set_newton_goal(h, equations, orbit, state, limits, room):
    """Set the error of p that Newton's method may leave, (d,).

    It is at least what the rounding of y leaves in p = y' through terms of y itself, and that at
    most what changes y by as much over the step.
    """
    terms, orders, goal = equations.terms, equations.orders, room.goal
    second, d = equations.second, goal.shape[0]
    for c in range(d):
        size = max(state.largest[c], abs(orbit.p[0, c]))
        goal[c] = _NEWTON * allowed_error(size, room.sizes[c], second[c], 1.0, limits)
    for n in range(terms.shape[0]):
        c, k = terms[n].row, terms[n].index
        if terms[n].integrand == POSITION and 0 <= k < orders.shape[0] and c < d:
            gain = min(abs(terms[n].coefficient) * h ** orders[k], 1 / h)
            goal[c] = max(goal[c], ROUNDING_OF_SUMS * abs(orbit.x[0, c]) * gain)


@inner
def orbit_error(
    rhs, params, h, base, equations, rule, operators, local, values, orbit, state, newton, limits
):
    """Estimate the error of a solved step, and subtract terms from f.

    Returns the ratio of error to tolerance, and whether the defect of f between the nodes alone
    makes it too large.
    """
    second, largest, start = equations.second, state.largest, orbit.initial[0]
    room, kinds, matrices = newton.room, equations.kinds, operators.matrices
    errors, x_start = room.errors, orbit.x[0]
    measure_force_defect(rhs, params, h, rule, x_start, start, second, values[0], limits, room)
    state.counts.rhs += room.check_times.shape[0]
    if defect_matters(operators.sums, kinds, newton):
        state.counts.rhs += room.times.shape[0]
        if not equations_hold(rhs, params, base[0], operators, kinds, values[0], newton):
            return np.inf, True
    subtract_from_forces(kinds, matrices, base, values[:1])
    if values.shape[1] > SLOPE:
        nodal_slopes(h, rule.inverse, orbit.p[0], values[0, PRIMARY], values[0, SLOPE])
    estimate_error(h, equations, rule.legendre, local, matrices, values[0], start, newton, errors)
    end = state.control.origin + state.control.time + h
    ratio_at_nodes = error_ratio(h, end, errors, values[0], second, largest, start, limits, room)
    add_force_defect(operators.sums, kinds, newton, errors)
    ratio = error_ratio(h, end, errors, values[0], second, largest, start, limits, room)
    return ratio, ratio_at_nodes <= 1.0 and not ratio <= 1.0


@inner
def tangents_error(h, base, equations, rule, matrices, local, values, orbit, newton, limits):
    """Return the largest ratio of error to tolerance of solved tangents; subtract terms from f."""
    legendre, p = rule.legendre, orbit.p
    subtract_from_forces(equations.kinds, matrices, base[1:], values[1:])
    if values.shape[1] > SLOPE:
        for column in range(1, p.shape[0]):
            nodal_slopes(h, rule.inverse, p[column], values[column, PRIMARY], values[column, SLOPE])
    return tangent_error_ratio(
        h, equations, legendre, local, matrices, values, orbit.initial, newton, limits.rtol
    )


@inner
def extrapolate(nodes, legendre, last, h, h_last, p, reached, out):
    """Extrapolate the polynomial p of the last step to the nodes of the next.

    Differences from p at the end of the last step are extrapolated, so that a constant is exact.
    """
    # last, out (d, s), p (d,); reached (s, s), from the last values to the nodes ahead, is room
    d, s = out.shape
    clear_matrix(reached)
    for i in range(s if h_last > 0.0 else 0):
        u = 1.0 + 2.0 * h / h_last * nodes[i]
        before, now = 1.0, u
        for k in range(s):
            for j in range(s):
                reached[i, j] += before * legendre[k, j]
            before, now = now, ((2 * k + 3) * u * now - (k + 1) * before) / (k + 2)
    for c in range(d):
        for i in range(s):
            total = p[c]
            for j in range(s):
                total += reached[i, j] * (last[c, j] - p[c])
            out[c, i] = total
