"""March of collocation steps whose lengths keep the tolerance.

Letters of shapes: d components, R rows of the equations, s nodes, M modes, k tangents. There are
n_q integrands: f, p and y, and p' if needed. Row c < d is p of component c, row d + c the terms
subtracted from its f. The primary unknown p is y, or y' for orders above 1. `m` is an
`AdaptiveWork`, `m.workspace` its workspace.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from ..compiled.delayed_values import add_step, next_end, within_delays
from ..compiled.functions import set_force
from ..compiled.jacobian import LEAST
from ..compiled.jit import MAT, as_value, compiled_type, entry, inner, plug_in
from ..compiled.linalg import bounded, clear_matrix, largest_of, put, put_cube, put_matrix
from ..compiled.reach import set_moved, set_reach
from ..compiled.reference import Reference
from .edge import solve_at_edge
from .error_estimate import NO_LESS, orbit_error, tangents_error
from .found_jumps import find_jump, step_over
from .mode_tables import (
    advance_modes,
    fill_kernels,
    fill_nothing,
    find_factors,
    floor_to_grid,
    read_modes,
    read_nothing,
    read_varying,
    set_mode_weights,
)
from .newton import solve_stages, solve_tangent_stages
from .operators import (
    POSITION,
    PRIMARY,
    assemble_operators,
    eliminate_known,
    number_of,
)
from .structures import (
    ADAPTIVE_MARCH,
    AT_EDGE,
    FILLING_SIG,
    HELD,
    KEPT,
    LENGTH,
    READ_VARYING_SIG,
    TANGENTS_SIG,
    AdaptiveMarch,
    AdaptiveWork,
    FirstJacobian,
)
from .tolerances import (
    any_is_little,
    begin_growth,
    begin_sizes,
    note_growth,
    note_rounding,
    raise_sizes,
    raise_to_least,
    set_newton_tol,
)


@inner
def attempt(march, t, h, table_index):
    """Solve a step of length h from t by tables `table_index`; f, p, y are in `values`."""
    # returns the ratio of error to tolerance, whether Newton's method converged, and whether the
    # ratio exceeds 1 only for the defect of f between the nodes
    m = march.work
    orbit, state = m.orbit, m.state
    workspace, equations, limits = m.workspace, m.equations, m.limits
    n_columns, values, origin = orbit.x.shape[0], workspace.values, state.control.origin
    for column in range(n_columns):
        read_modes(orbit.modes[column], m.tables.to_nodes[table_index], workspace.base[column])
        if m.varying.integrals.shape[0] > 0:
            march.read_varying(m, table_index, column)
    set_known_part(m)
    set_times(origin, t, h, m.rule.nodes, limits, workspace.times)
    set_times(origin, t, h, m.rule.check_points, limits, workspace.check_times)
    extrapolate(m, h)
    first = state.control.begins == 1.0
    if first:
        begin_growth(orbit.x[0], state.growth)
    put(state.sizes, workspace.sizes)
    begins = raise_to_least(equations, state, workspace.sizes)
    put(workspace.sizes, workspace.sizes_before)
    set_starts(orbit, equations.above_one, workspace.starts)
    solved, again = False, True
    while again:
        set_units(equations, workspace.sizes, orbit.x[0], limits.tolerance, workspace.units)
        set_newton_tol(m, h)
        solved = solve_at_edge(m, h) if m.stages.control[AT_EDGE] == 1.0 else solve_stages(m, h)
        if not solved:
            break
        # a size of 0 is set by a first solution, and remains if the step is rejected
        again = begins and begin_sizes(values[0], state.sizes)
        again = (first and any_is_little(state, values[0])) or again
        if again:  # sizes, reach and scales of linear systems are those of this solution
            put(state.sizes, workspace.sizes)
            m.stages.control[KEPT] = 0.0
        raise_sizes(values[0], workspace.sizes)
        if first:
            if again:
                set_reach(m.stages.jacobians[0], equations.rates, workspace.sizes, state.reach)
            note_growth(m, h)
        raise_to_least(equations, state, workspace.sizes)
        if first and not again:  # no component is young
            set_newton_tol(m, h)
        begins = first = False
    ratio, by_defect = np.inf, False
    if solved:
        ratio, by_defect = orbit_error(m, h, table_index)
    if ratio <= 1.0 and n_columns > 1:
        more = march.solve_for_tangents(m, h, table_index)
        ratio, solved = max(ratio, more), more < np.inf
    return ratio, solved, by_defect


@inner
def set_times(origin, t, h, nodes, limits, times):
    """Set the times of the nodes; they stay between `limits.earliest` and `limits.latest`."""
    # strictly inside the interval between origin and stop, where f may jump; t is counted from the
    # origin
    for i in range(nodes.shape[0]):
        time = min(origin + (t + h * nodes[i]), limits.latest)
        times[i] = max(time, limits.earliest)


@inner
def set_known_part(m):
    """Add initial values and offsets to the history in `m.workspace.base` (1 + k, R, s)."""
    # it becomes the known part of each row, that does not depend on the solution of this step
    initial, p, kinds, base = m.orbit.initial, m.orbit.p, m.equations.kinds, m.workspace.base
    constant, start_weights = m.operators.constant, m.operators.start_weights
    d, n_kinds = p.shape[1], number_of(kinds)
    for column in range(base.shape[0]):
        for c in range(base.shape[1]):
            row = c // d * n_kinds + kinds[c % d]
            for i in range(base.shape[2]):
                base[column, c, i] += constant[column, c, i]
                base[column, c, i] += start_weights[row, i] * p[column, c % d]
                if c < d:
                    base[column, c, i] += initial[column, c]
    eliminate_known(kinds, m.operators.matrices, base)


@inner
def set_starts(orbit, above_one, starts):
    """Set `starts` (d,) to |p(0)| for components with p = y, to 0 for others."""
    for c in range(starts.shape[0]):
        starts[c] = abs(orbit.initial[0, c]) if above_one[c] == 0 else 0.0


@inner
def set_units(equations, sizes, x, tolerance, out):
    """Set the units of components, (d,), for the increments of difference quotients of f."""
    # The size of the component, or by an absolute tolerance the present |y|, at least atol / rtol.
    # Of a component without a size it is that of equations.units.
    for c in range(out.shape[0]):
        by_atol = max(abs(x[c]), tolerance.atol[c] / tolerance.rtol)
        unit = sizes[c] if tolerance.by_size > 0.0 else by_atol
        out[c] = unit if unit > LEAST else equations.units[c]


@entry(Reference(compiled_type(FirstJacobian)), MAT)
def jacobian_at_start(start, out):
    """Set `out` to the Jacobian of f before a first step, the units of `start`, and the reach."""
    set_first_jacobian(start, out)


@inner(allocates=True)
def set_first_jacobian(start, out):
    """Do what `jacobian_at_start` does, for compiled code."""
    equations, state = start.equations, start.state
    set_units(equations, state.sizes, start.x, start.limits.tolerance, start.units)
    start.right.jacobian(start.right.force, start.t, start.x, start.units, out)
    later = min(start.t + _LATER_START * start.limits.t_end, start.limits.latest)
    moved = np.empty(start.x.shape[0])
    set_force(start.right.force, later, start.x, moved)
    set_moved(out, equations.rates, state.sizes, moved)
    set_reach(out, equations.rates, moved, state.reach)
    for c in range(start.x.shape[0]):
        state.tried[c] = np.inf


@inner
def extrapolate(m, h):
    """Extrapolate p of the last step to the nodes of the next one of length h, a first guess."""
    # Differences from p at the last end are extrapolated, so a constant is exact.
    # m.workspace.change (d s,) becomes p at the last end minus the result.
    # last, out (d, s): p at the nodes of the last and of the next step; reached (s, s): weights
    nodes, legendre, p, h_last = m.rule.nodes, m.rule.legendre, m.orbit.p[0], m.state.control.last
    last, out = m.orbit.last[0, PRIMARY], m.workspace.values[0, PRIMARY]
    reached, change = m.workspace.reached, m.workspace.change
    d, s = out.shape
    clear_matrix(reached)
    for i in range(s if 0.0 < h < _FARTHEST_GUESS * h_last else 0):
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
            out[c, i], change[c * s + i] = total, p[c] - total


# Status codes of a march.
# - REACHED: the march reached the stop. FULL: the arrays of accepted steps are full.
# - TOO_CLOSE: the next step is too short for the modes.
# - TOO_ROUGH: no step is short enough for the tolerance. NEWTON_FAILED: none for Newton's method.
# - ORDERS_NEEDED: the next step needs tables of varying orders, which Python fills.
# - JUMPING: the right-hand side jumps. CRAWLING: steps stay short without progress.
# - FOUND: the right-hand side jumps at the time `control.jump`, before the end of the step.
# - CROSSED: the right-hand side jumps by y just ahead; y beyond the jump is `workspace.point`.
REACHED, FULL, TOO_CLOSE, TOO_ROUGH, NEWTON_FAILED = range(5)
ORDERS_NEEDED, JUMPING, CRAWLING, FOUND, CROSSED = range(5, 10)
# Largest ratio of the next step's length to the present one.
_MAX_FACTOR = 3.0
# Smallest ratio of the next step's length to the present one.
_MIN_FACTOR = 0.2
# Length of a step, relative to the last one, from which the first guess is constant: next to two
# kinks that rounding sets apart a step is so short that its polynomial extrapolates rounding.
_FARTHEST_GUESS = 100.0
# Length of the next step, relative to that at which the error would be the tolerance.
_SAFETY = 0.8
# Number of steps after which the reach of components is found again, if no size grows.
_STEPS_PER_REACH = 8
# Distance from a jump by y, over its time, at which the march restarts beyond the jump.
_AT_JUMP = 1e-13
# Length of a step that ends before a jump by y, as a fraction of the distance to it.
_SHORT_OF_JUMP = 0.9
# Ratio of error to tolerance from which a jump is searched after the first rejection of a step.
_JUMPY = 1e4
# Largest number of searches for a jump between two accepted steps.
_SEARCHES = 4
# Time just after the start at which f makes the first reach, as a fraction of the run. At the start
# itself f may be 0 or infinite.
_LATER_START = 1e-3
# Ratio of step lengths from which a longer step is always worth a new factorisation, for many
# components with a dense Jacobian.
_MIN_WORTHWHILE_FACTOR = 2.0


@inner
def take_steps(march):
    """Make steps until the stop, or until Python has to act; return their number and the status."""
    m = march.work
    rule, equations, varying, orbit, limits = m.rule, m.equations, m.varying, m.orbit, m.limits
    control, counts, stages = m.state.control, m.state.counts, m.stages
    local, values, s = m.tables.local, m.workspace.values, rule.nodes.shape[0]
    lowest, row, assembled_for = lowest_order(equations), 0, -1.0
    delays = m.right.force.functions.delays
    was_rejected, searches = control.rejected == 1.0, 0
    while control.time < limits.stop - control.origin:
        if row == m.steps.starts.shape[0]:
            return row, FULL
        end = min(limits.stop, next_end(delays, control.origin + control.time)) - control.origin
        t, left, h = next_step(control, end)
        known = within_delays(delays, control.origin + t, h)
        h = h if known == h else floor_to_grid(known)
        if not t + 0.01 * h > t:
            return row, TOO_ROUGH
        if h < control.shortest:
            return row, TOO_CLOSE
        if not orders_tabulated(t, h, varying):
            return row, ORDERS_NEEDED
        table_index = find_factors(march, h)
        if h != assembled_for or equations.unweighted.shape[0] > 0:
            first = local.shape[1] - varying.integrals.shape[0]
            put_cube(varying.integrals, local[table_index, first:])
            assemble_operators(h, equations, rule, local[table_index], m.operators)
        if equations.unweighted.shape[0] > 0:  # varying orders change the matrices in every step
            stages.control[LENGTH] = 0.0
        assembled_for = h
        ratio, solved, by_defect = attempt(march, t, h, table_index)
        factor = _SAFETY * max(ratio, 1e-12) ** (-1.0 / (s + lowest))
        # an error that allows more growth than _MAX_FACTOR does not show what a longer step would
        # miss
        idle = factor > _MAX_FACTOR
        longest = floor_to_grid(limits.longest_idle if idle else limits.longest)
        planned = next_length(h, control.next, ratio, was_rejected, factor)
        planned = worth_new_factors(h, planned, ratio, stages)
        control.next = min(planned, longest)
        twice, was_rejected = was_rejected, not ratio <= 1.0
        control.rejected = 1.0 if was_rejected else 0.0
        if was_rejected:
            counts.rejected += 1
            counts.by_defect += int(by_defect)
            if solved:
                note_errors(m, h)
            likely = by_defect or twice or ratio > _JUMPY
            if control.begins == 0.0 and likely and searches < _SEARCHES:
                searches += 1
                status = stop_before_jump(m, t, h, solved)
                if status != REACHED:
                    return row, status
            overflows = not ratio < np.inf and not (bounded(orbit.x[0]) and bounded(orbit.p[0]))
            if overflows or not t + 0.01 * control.next > t:
                return row, reason_of_refusal(by_defect, solved)
            continue
        counts.accepted, searches = counts.accepted + 1, 0
        if raise_sizes(values[0], m.state.sizes) or counts.accepted % _STEPS_PER_REACH == 0:
            set_reach(stages.jacobians[0], equations.rates, m.state.sizes, m.state.reach)
        note_growth(m, h)
        note_rounding(m)
        record_step(m, t, h, ratio, row)
        if delays.taus.shape[0] > 0:
            add_step(delays, rule, m.steps, row)
        absorb_constant_mode(m.basis.rates, orbit)
        put_cube(orbit.modes, orbit.before)
        for column in range(values.shape[0]):
            put_cube(values[column], orbit.last[column])
        advance_orbit(m, h, table_index)
        row += 1
        control.time, control.last = (end if h == left else t + h), h
        control.begins = 0.0
    return row, REACHED


@inner
def stop_before_jump(m, t, h, solved):
    """Search a jump of f in a rejected step; return FOUND, CROSSED, or REACHED if steps go on."""
    # before a jump by y the next step ends short of it
    control = m.state.control
    control.jump, by_y = find_jump(m, solved)
    left = control.jump - control.origin - t
    if control.jump == 0.0:
        return REACHED
    if not by_y:
        return FOUND
    if left <= _AT_JUMP * control.jump and step_over(m, control.jump):
        return CROSSED
    if left < h:
        control.next = _SHORT_OF_JUMP * left
    return REACHED


@inner
def note_errors(m, h):
    """Store the errors of a rejected step of length h, relative to the largest |p| in it."""
    p, tried, errors = m.workspace.values[0, PRIMARY], m.state.tried, m.workspace.errors
    m.state.control.tried = h
    for c in range(p.shape[0]):
        largest = largest_of(p[c], 0, p.shape[1])
        share = errors[c] / largest if largest > 0.0 else np.inf
        if tried[c] == np.inf or share < NO_LESS * tried[c]:
            m.state.since[c] = h
        tried[c] = share


@entry(ADAPTIVE_MARCH, announced="the march of collocation", allocates=False)
def march_adaptive(march):
    """March until `limits.stop`; return the number of accepted steps and a status code."""
    m = march.work
    set_mode_weights(m.equations, m.basis.weights, m.varying.of_varying, m.weights)
    return take_steps(march)


@plug_in
def solve_for_tangents(m, h, table_index):
    """Solve a step of length h for the tangents; return error over tolerance, or infinity."""
    return tangents_error(m, h, table_index) if solve_tangent_stages(m, h) else np.inf


@plug_in
def no_tangents(m, h, table_index):
    """Do nothing, in place of `solve_for_tangents`, if a march has no tangents."""
    return 0.0


def march_of(work: AdaptiveWork) -> AdaptiveMarch:
    """Return the `AdaptiveMarch` of an `AdaptiveWork`, with the functions that its arrays need."""
    # functions for tangents, varying orders and general kernels do nothing if there are none
    has_tangents, varies = work.orbit.x.shape[0] > 1, work.varying.integrals.shape[0] > 0
    return AdaptiveMarch(work, *_functions(has_tangents, varies, work.basis.masses.size > 0))


@lru_cache(maxsize=8)
def _functions(has_tangents: bool, varies: bool, has_kernels: bool) -> tuple[Any, Any, Any]:
    tangents = solve_for_tangents if has_tangents else no_tangents
    reading = read_varying if varies else read_nothing
    filling = fill_kernels if has_kernels else fill_nothing
    how = as_value(tangents, TANGENTS_SIG), as_value(reading, READ_VARYING_SIG)
    return *how, as_value(filling, FILLING_SIG)


@inner
def worth_new_factors(h, planned, ratio, stages):
    """Return the length of the next step: the planned one, or h again if that saves factors."""
    # a length below _MIN_WORTHWHILE_FACTOR times h is postponed for stages.hold steps at most
    held = stages.control[HELD]
    if stages.hold > held and ratio <= 1.0 and h < planned < _MIN_WORTHWHILE_FACTOR * h:
        stages.control[HELD] = held + 1.0
        return h
    stages.control[HELD] = 0.0
    return planned


@inner
def reason_of_refusal(by_defect, solved):
    """Return the status code for a rejected step that cannot be shortened further."""
    if by_defect:
        return JUMPING
    return TOO_ROUGH if solved else NEWTON_FAILED


@inner
def next_step(control, end):
    """Return start of the next step, time to `end`, and the step's length."""
    # it ends at `end` or at most half-way, so no tiny step remains
    left = end - control.time
    h = left if control.next >= left else min(control.next, 0.5 * left)
    return control.time, left, h


@inner
def orders_tabulated(t, h, varying):
    """Return whether the tables of varying orders are valid for the step of length h from t."""
    # if not, they are requested from Python
    tabulated = varying.tabulated
    if varying.integrals.shape[0] == 0 or (tabulated.start == t and tabulated.length == h):
        return True
    tabulated.next_start, tabulated.next_length = t, h
    return False


@inner
def next_length(h, planned, ratio, was_rejected, factor):
    """Return the length of the next step after a step of length h."""
    # h times the factor that its error allows, within limits, down to the grid of lengths. ratio:
    # error over tolerance. A quarter of h if the step was not solved (ratio infinite). The length
    # planned before if the accepted step was shortened to end at a stop.
    if ratio <= 1.0 and h < planned:
        return planned
    if not ratio < np.inf:
        return 0.25 * h
    return floor_to_grid(h * max(_MIN_FACTOR, min(1.0 if was_rejected else _MAX_FACTOR, factor)))


@inner
def lowest_order(equations):
    """Return the smallest order of the fractional integrals in the equations, at most 1."""
    terms, lowest = equations.terms, 1.0
    for n in range(terms.shape[0]):
        if 0 <= terms[n].index < equations.orders.shape[0]:
            lowest = min(lowest, equations.orders[terms[n].index])
    return lowest


@inner
def absorb_constant_mode(rates, orbit):
    """Move the content of a mode of rate 0 into p(0), for the orbit and the tangents."""
    # in a classical equation both would grow without bound and cancel; their rounding would hide a
    # decaying tangent
    if rates.shape[0] > 0 and rates[0] == 0.0:
        initial, modes = orbit.initial, orbit.modes
        d = initial.shape[1]
        for column in range(modes.shape[0]):
            for c in range(d):
                initial[column, c] += modes[column, c, 0]
                modes[column, c, 0] = 0.0


@inner
def advance_orbit(m, h, table_index):
    """Advance y, p and the modes of the orbit and its tangents to the end of the solved step."""
    x, p, values = m.orbit.x, m.orbit.p, m.orbit.last
    for column in range(values.shape[0]):
        advance_modes(m, h, table_index, column)
        own = values[column]
        put(own[POSITION, :, -1], x[column])
        put(own[PRIMARY, :, -1], p[column])


@inner
def record_step(m, t, h, ratio, row):
    """Store an accepted step in a row of `m.steps`; update the largest |p| so far if p is y'."""
    steps, above_one, largest = m.steps, m.equations.above_one, m.state.largest
    x, p, nodal, at_start = m.orbit.x, m.orbit.p, steps.p[row], steps.at_starts[row]
    d, s = x.shape[1], nodal.shape[1]
    steps.starts[row], steps.lengths[row], steps.errors[row] = m.state.control.origin + t, h, ratio
    for column in range(nodal.shape[0] // d):
        first = d * column
        put_matrix(m.workspace.values[column, PRIMARY], nodal[first : first + d])
        for c in range(d):
            at_start[0, first + c], at_start[1, first + c] = x[column, c], p[column, c]
    for c in range(d):
        for i in range(s):
            if above_one[c] == 1:
                largest[c] = max(largest[c], abs(nodal[c, i]))
