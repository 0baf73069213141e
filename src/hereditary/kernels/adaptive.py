"""The adaptive march of collocation steps (floor 1)."""

import numpy as np

from .._jit import I8, VEC, entry, kernel
from .collocation import (
    POSITION,
    PRIMARY,
    SLOPE,
    fold_known,
    local_operators,
    newton_room,
    slopes,
    solve_stages,
    solve_tangents,
    step_operators,
    take_from_forces,
)
from .error_estimate import (
    add_unseen,
    confirmed,
    estimate,
    exceeds,
    off_nodes,
    over_tolerance,
    worst_tangent,
)
from .mode_tables import combined_weights, move_modes, on_grid, read_modes, slot_of
from .signatures import JAC, RHS
from .structures import BASIS, EQUATIONS, LIMITS, RULE, RUN, STEPS, STRANDS, TABLES, VARYING

# How a march ended: at its stop, with its rows full, where the modes do not reach close enough,
# where no step is small enough for the error or for Newton's method, where it is to be told of the
# orders that vary in its next step, where the right-hand side jumps, or where it gets nowhere.
REACHED, FULL, TOO_CLOSE, TOO_ROUGH, NOT_SOLVED, UNTOLD, JUMPING, CRAWLING = range(8)
# Largest and smallest change of a step, what is aimed at as share of the tolerance, and Newton's.
_GROW, _SHRINK, _SAFETY, _NEWTON = 3.0, 0.2, 0.8, 0.01
# A step whose error is below this share of the tolerance says nothing of how long the next may be.
_DORMANT = 1e-3
# Highest degree that is extrapolated for a first guess.
_GUESS = 3


@entry(RHS, JAC, I8, VEC, EQUATIONS, RULE, BASIS, TABLES, VARYING, STRANDS, RUN, STEPS, LIMITS)
def march_adaptive(
    rhs, jac, has_jac, params, equations, rule, basis, tables, varying, strands, run, steps, limits
):
    """March to where `limits` says; return the number of rows filled and how it ended."""
    nodes, legendre = rule.nodes, rule.legendre
    control, counts = run.control, run.counts
    s, n_strands = nodes.shape[0], strands.x.shape[0]
    n_rows = strands.modes.shape[1] - equations.raw.shape[0] * strands.x.shape[1]
    operators, base = step_operators(n_strands, n_rows, s), np.empty((n_strands, n_rows, s))
    values, newton = np.empty(strands.last.shape), newton_room(strands.x.shape[1], s)
    driven, idle = weights_of_modes(equations, basis, varying, strands)
    lowest, row, made = lowest_order(equations), 0, -1.0
    rejected, end = control.refused == 1.0, limits.stop - control.origin
    while control.time < end:
        if row == steps.starts.shape[0]:
            return row, FULL
        t, left, h = next_step(control, end)
        if not t + 0.01 * h > t:
            return row, TOO_ROUGH
        if nodes[0] * h < control.closest:
            return row, TOO_CLOSE
        if not told(t, h, varying):
            return row, UNTOLD
        slot = slot_of(h, nodes, basis, tables)
        local = tables.local[slot]
        if h != made or equations.raw.shape[0] > 0:
            local[local.shape[0] - varying.integrals.shape[0] :] = varying.integrals
            local_operators(h, equations, rule.integrals, rule.inverse, local, operators)
        made = h
        known_part(strands, tables.reads[slot], equations, varying, operators, base)
        times = times_inside(control.origin, t, h, nodes, limits.stop)
        last = strands.last[0, PRIMARY]
        guess(nodes, legendre, last, h, control.last, strands.p[0], values[0, PRIMARY])
        looks = times_inside(control.origin, t, h, rule.points, limits.stop)
        ratio, unseen, solved = orbit_ratio(
            rhs, jac, has_jac, params, times, looks, h, base, equations, rule, operators.matrices,
            local, values, strands, run, newton, limits,
        )  # fmt: skip
        if ratio <= 1.0 and n_strands > 1:
            more = tangents_ratio(
                rhs, jac, has_jac, params, times, h, base, equations, rule, operators.matrices,
                local, values, strands, run, newton, limits,
            )  # fmt: skip
            ratio, solved = max(ratio, more), more < np.inf
        most = limits.longest_idle if ratio < _DORMANT else limits.longest
        control.next = min(next_length(h, control.next, ratio, rejected, s + lowest), on_grid(most))
        rejected = not ratio <= 1.0
        control.refused = 1.0 if rejected else 0.0
        if rejected:
            counts.refused += 1
            counts.off_nodes += int(unseen)
            if not t + 0.01 * control.next > t:
                return row, why_no_step(unseen, solved)
            continue
        counts.accepted += 1
        steps.starts[row], steps.lengths[row] = control.origin + t, h
        steps.errors[row] = ratio
        keep_row(values[0], strands, equations.second, run.largest, steps.p[row], steps.begins[row])
        fold(basis.rates, strands)
        strands.before[:], strands.last[:] = strands.modes, values
        move_on(h, tables.keeps[slot], tables.moments[slot], driven, idle, legendre, strands)
        row += 1
        control.time, control.last = (end if h == left else t + h), h
    return row, REACHED


@kernel
def why_no_step(unseen, solved):
    """Why the last step was refused."""
    if unseen:
        return JUMPING
    return TOO_ROUGH if solved else NOT_SOLVED


@kernel
def weights_of_modes(equations, basis, varying, strands):
    """Return the weights with which every row's modes take in its integrands, and 1."""
    modes, last = strands.modes, strands.last
    driven = np.empty((modes.shape[1], last.shape[1], modes.shape[2]))
    idle = np.empty(modes.shape)
    combined_weights(equations, basis.weights, varying.own, driven, idle)
    return driven, idle


@kernel
def times_inside(origin, t, h, nodes, t_stop):
    """Times of the nodes, after the origin and before the stop: right-hand sides may jump there."""
    times = np.minimum(origin + (t + h * nodes), np.nextafter(t_stop, 0.0))
    return np.maximum(times, np.nextafter(origin, np.inf))


@kernel
def next_step(control, end):
    """Return start of the next step, time left, and its length: no crumb is left at the end."""
    left = end - control.time
    h = left if control.next >= left else min(control.next, 0.5 * left)
    return control.time, left, h


@kernel
def told(t, h, varying):
    """Whether the orders that vary are known for this step; if not, it is noted as wanted."""
    known = varying.known
    if varying.integrals.shape[0] == 0 or (known.start == t and known.length == h):
        return True
    known.next_start, known.next_length = t, h
    return False


@kernel
def known_part(strands, reads, equations, varying, operators, base):
    """Set what every strand's rows are made of besides the step itself, (1 + k, R, s)."""
    initial, p, modes = strands.initial, strands.p, strands.modes
    d = p.shape[1]
    for strand in range(base.shape[0]):
        read_modes(modes[strand], reads, base[strand])
        if varying.integrals.shape[0] > 0:
            read_varying(modes[strand], reads, equations, varying, base[strand])
        for c in range(base.shape[1]):
            for i in range(base.shape[2]):
                base[strand, c, i] += operators.constant[strand, c, i]
                base[strand, c, i] += operators.starts[c, i] * p[strand, c % d]
                if c < d:
                    base[strand, c, i] += initial[strand, c]
    fold_known(d, operators.matrices, base)


@kernel
def read_varying(modes, reads, equations, varying, out):
    """Add the past of orders that vary: modes without weights, by the weights at each node."""
    # modes (R, M), reads (M, s), out (R, s)
    terms, weights, raw = equations.terms, varying.weights, equations.raw
    d, first = equations.second.shape[0], 1 - weights.shape[0]
    for n in range(terms.shape[0]):  # their indices are the last
        first = max(first, terms[n].index + 1 - weights.shape[0])
    for n in range(terms.shape[0]):
        k = terms[n].index - first
        if k < 0:
            continue
        c, q = terms[n].row, terms[n].integrand
        for b in range(raw.shape[0]):
            if raw[b] != q:
                continue
            for m in range(reads.shape[0]):
                held = terms[n].coefficient * modes[(2 + b) * d + c % d, m]
                for i in range(reads.shape[1]):
                    out[c, i] += held * weights[k, m, i] * reads[m, i]


@kernel
def next_length(h, planned, ratio, rejected, order):
    """Length of the step after one whose error was `ratio` times its tolerance.

    A step made shorter than planned, to end at a stop, says little about the next one.
    """
    if ratio <= 1.0 and h < planned:
        return planned
    if not ratio < np.inf:
        return 0.25 * h
    factor = _SAFETY * max(ratio, 1e-12) ** (-1.0 / order)
    return on_grid(h * max(_SHRINK, min(1.0 if rejected else _GROW, factor)))


@kernel
def lowest_order(equations):
    """Return the smallest order of integration."""
    terms, lowest = equations.terms, 1.0
    for n in range(terms.shape[0]):
        if 0 <= terms[n].index < equations.orders.shape[0]:
            lowest = min(lowest, equations.orders[terms[n].index])
    return lowest


@kernel
def orbit_ratio(
    rhs, jac, has_jac, params, times, looks, h, base, equations, rule, matrices, local, values,
    strands, run, newton, limits,
):  # fmt: skip
    """Solve the step for the orbit.

    Returns its error over its tolerance, whether that is too large for what f is off the nodes
    alone, and whether the step was solved.
    """
    second, largest, start = equations.second, run.largest, strands.initial[0]
    rtol, atol = limits.rtol, limits.atol
    whole = rule.integrals[equations.orders.shape[0] - 1]  # of order 1
    goal = _NEWTON * (atol + rtol * np.maximum(largest, np.abs(strands.p[0])))
    solved = solve_stages(
        rhs, jac, has_jac, params, times, h, base[0], strands.x[0], second, matrices, whole, goal,
        values[0], run.counts, run.contraction, newton,
    )  # fmt: skip
    if not solved:
        return np.inf, False, False
    errors, off = np.empty(second.shape[0]), np.zeros(second.shape[0])
    x_start = strands.x[0]
    off_nodes(rhs, params, looks, h, rule, x_start, start, second, values[0], limits, off)
    run.counts.rhs += looks.shape[0]
    if exceeds(off, matrices, goal, newton):
        run.counts.rhs += times.shape[0]
        if not confirmed(rhs, params, times, base[0], matrices, goal, values[0], newton):
            return np.inf, True, True
    take_from_forces(second.shape[0], matrices, base, values[:1])
    if values.shape[1] > SLOPE:
        slopes(h, rule.inverse, strands.p[0], values[0, PRIMARY], values[0, SLOPE])
    estimate(h, equations, rule.legendre, local, matrices, values[0], newton, errors)
    end = run.control.origin + run.control.time + h
    seen = over_tolerance(h, end, errors, values[0], second, largest, start, rtol, atol)
    add_unseen(off, matrices, newton, errors)
    ratio = over_tolerance(h, end, errors, values[0], second, largest, start, rtol, atol)
    return ratio, seen <= 1.0 and not ratio <= 1.0, True


@kernel
def tangents_ratio(
    rhs, jac, has_jac, params, times, h, base, equations, rule, matrices, local, values, strands,
    run, newton, limits,
):  # fmt: skip
    """Solve the step for the tangents; their largest error over its tolerance, inf if singular."""
    second, legendre, x, p = equations.second, rule.legendre, strands.x, strands.p
    whole = rule.integrals[equations.orders.shape[0] - 1]
    if not solve_tangents(
        rhs, jac, has_jac, params, times, h, base, x, second, matrices, whole, values, run.counts
    ):
        return np.inf
    take_from_forces(second.shape[0], matrices, base[1:], values[1:])
    if values.shape[1] > SLOPE:
        for strand in range(1, x.shape[0]):
            slopes(h, rule.inverse, p[strand], values[strand, PRIMARY], values[strand, SLOPE])
    return worst_tangent(h, equations, legendre, local, matrices, values, newton, limits.rtol)


@kernel
def fold(rates, strands):
    """Let a mode that does not decay be part of p(0).

    In a classical equation the two would grow apart, and what they leave of a tangent that decays
    would be lost in their rounding.
    """
    if rates.shape[0] > 0 and rates[0] == 0.0:
        initial, modes = strands.initial, strands.modes
        d = initial.shape[1]
        initial += modes[:, :d, 0]
        modes[:, :d, 0] = 0.0


@kernel
def move_on(h, keeps, moments, driven, idle, legendre, strands):
    """Move every strand to the end of the step, whose values at the nodes are its `last`."""
    values = strands.last
    for strand in range(values.shape[0]):
        modes = strands.modes[strand]
        move_modes(h, keeps, moments, driven, idle[strand], legendre, values[strand], modes)
        strands.x[strand] = values[strand, POSITION, :, -1]
        strands.p[strand] = values[strand, PRIMARY, :, -1]


@kernel
def keep_row(values, strands, second, largest, nodal, begin):
    """Note a step's start and p at its nodes, and the largest p so far where it is a velocity."""
    # values (3 or 4, d, s), nodal (d, s), begin (2, d)
    x, p = strands.x[0], strands.p[0]
    d, s = nodal.shape
    nodal[:] = values[PRIMARY]
    for c in range(d):
        begin[0, c], begin[1, c] = x[c], p[c]
        for i in range(s):
            if second[c] == 1:
                largest[c] = max(largest[c], abs(nodal[c, i]))


@kernel
def guess(nodes, legendre, last, h, h_last, p, out):
    """p at the next step's nodes from the last step's polynomial, its high degrees left out."""
    # last, out (d, s), p (d,)
    d, s = out.shape
    if h_last == 0.0:
        for c in range(d):
            out[c, :] = p[c]
        return
    degree = min(s - 1, _GUESS if h <= 1.5 * h_last else 1)
    for c in range(d):
        offset = 0.0
        for i in range(-1, s):
            # from the end of the last step, which the truncated polynomial misses a little
            u = 1.0 + 2.0 * h / h_last * (nodes[i] if i >= 0 else 0.0)
            before, now, total = 1.0, u, 0.0
            for k in range(degree + 1):
                coefficient = 0.0
                for j in range(s):
                    coefficient += legendre[k, j] * last[c, j]
                total += coefficient * before
                before, now = now, ((2 * k + 3) * u * now - (k + 1) * before) / (k + 2)
            if i < 0:
                offset = p[c] - total
            else:
                out[c, i] = total + offset
