"""The adaptive march of collocation steps (floor 1)."""

import numpy as np
from numba import types

from .._jit import CUBE, CUBES, F8, I8, IVEC, MAT, VEC, entry, kernel
from .collocation import (
    FORCE,
    POSITION,
    PRIMARY,
    estimate,
    fold_known,
    local_operators,
    newton_room,
    solve_stages,
    solve_tangents,
    take_from_forces,
)
from .mode_tables import BANK, TABLES, combined_weights, move_modes, on_grid, read_modes, slot_of
from .signatures import JAC, RHS

# How a march ended: at its stop, with its rows full, where the modes do not reach close enough, or
# where no step is small enough for the error or for Newton's method.
REACHED, FULL, TOO_CLOSE, TOO_ROUGH, NOT_SOLVED = 0, 1, 2, 3, 4
# Largest and smallest change of a step, what is aimed at as share of the tolerance, and Newton's.
_GROW, _SHRINK, _SAFETY, _NEWTON = 3.0, 0.2, 0.8, 0.01
# Tangents that have decayed are known to their rounding alone, which grows as they are stretched:
# no step is refused for less than this.
_TANGENT = 1e-9
# Share of p(0) below which no error of p can be told.
_ROUNDING = 1e-14
# Highest degree that is extrapolated for a first guess.
_GUESS = 3

# Strands are the orbit and then k tangents.
# channels, orders, whether second (d,), offsets (1 + k, n)
FORM = types.Tuple((MAT, VEC, IVEC, MAT))
# nodes (s,), integrals (n_a, s, s), values to Legendre coefficients (s, s)
RULE = types.Tuple((VEC, CUBE, MAT))
# clock [t, h, last step, closest distance], notes, steps [accepted, rejected], largest |p| (d,);
# for all strands p0, x, p (1 + k, d), modes now and before the last step (1 + k, R, M), and f, p,
# x at the last step's nodes (1 + k, 3, d, s)
RUN = types.Tuple((VEC, VEC, IVEC, VEC, MAT, MAT, MAT, CUBE, CUBE, CUBES))
# starts and lengths of steps (k,), p at the nodes (k, d, s), y and p at the start (k, 2 d), error
# over tolerance (k,)
TRACK = types.Tuple((VEC, VEC, CUBE, MAT, VEC))


@entry(RHS, JAC, I8, VEC, FORM, RULE, BANK, TABLES, RUN, TRACK, F8, F8, F8)
def march_adaptive(
    rhs, jac, has_jac, params, form, rule, bank, tables, run, track, t_stop, rtol, atol
):  # fmt: skip
    """March to t_stop; the number of rows and how it ended."""
    channels, orders, second, offsets = form
    nodes, singular, legendre = rule
    rates, weights, _, _ = bank
    clock, notes, steps, largest, p0, x, p, modes, before, last = run
    starts, lengths, rows, begins, ratios = track
    (n_strands, d), s, n_rows = x.shape, nodes.shape[0], modes.shape[1]
    whole = singular[orders.shape[0] - 1]  # the last order is 1
    drivers, constant = np.empty((3 * n_rows, s, s)), np.empty((n_strands, n_rows, s))
    driven, idle = np.empty((n_rows, 3, rates.shape[0])), np.empty((n_strands, *modes.shape[1:]))
    combined_weights(channels, offsets, weights, driven, idle)
    base, values = np.empty((n_strands, n_rows, s)), np.empty((n_strands, 3, d, s))
    errors, lowest = np.empty(d), lowest_order(channels, orders)
    newton, row, rejected, made = newton_room(d, s), 0, False, -1.0
    while clock[0] < t_stop:
        if row == starts.shape[0]:
            return row, FULL
        t, left, h = next_step(clock, t_stop)
        if not t + 0.01 * h > t:
            return row, TOO_ROUGH
        if nodes[0] * h < clock[3]:
            return row, TOO_CLOSE
        slot = slot_of(h, nodes, bank, tables)
        local = tables[4][slot]
        if h != made:
            local_operators(h, d, channels, offsets, orders, singular, local, drivers, constant)
        made = h
        known_part(modes, tables[1][slot], p0, constant, drivers, base)
        goal = _NEWTON * (atol + rtol * np.maximum(largest, np.abs(p[0])))
        # just before the stop, where the right-hand side may jump
        times = np.minimum(t + h * nodes, np.nextafter(t_stop, 0.0))
        guess(nodes, legendre, last[0, PRIMARY], h, clock[2], p[0], values[0, PRIMARY])
        solved = solve_stages(
            rhs, jac, has_jac, params, times, h, base[0], x[0], second, drivers, whole, goal,
            values[0, PRIMARY], values[0, POSITION], values[0, FORCE], notes, newton,
        )  # fmt: skip
        take_from_forces(d, drivers, base, values[:1])
        estimate(h, channels, orders, legendre, local, drivers, values[0], newton, errors)
        ratio = over_tolerance(h, errors, values[0], second, largest, p0[0], rtol, atol)
        ratio = ratio if solved else np.inf
        if ratio <= 1.0 and n_strands > 1:
            more = tangents_ratio(
                rhs, jac, has_jac, params, times, h, base, x, form, drivers, whole, local, legendre,
                values, rtol, notes, newton,
            )  # fmt: skip
            ratio, solved = max(ratio, more), more < np.inf
        clock[1] = next_length(h, clock[1], ratio, rejected, s + lowest)
        rejected = not ratio <= 1.0
        steps[int(rejected)] += 1
        if rejected:
            if not t + 0.01 * clock[1] > t:
                return row, (TOO_ROUGH if solved else NOT_SOLVED)
            continue
        starts[row], lengths[row], ratios[row] = t, h, ratio
        keep_row(values[0], x[0], p[0], second, largest, rows[row], begins[row])
        fold(rates, modes, p0)
        before[:], last[:] = modes, values
        move_on(h, tables[2][slot], tables[3][slot], driven, idle, legendre, values, x, p, modes)
        row += 1
        clock[0], clock[2] = (t_stop if h == left else t + h), h
    return row, REACHED


@kernel
def next_step(clock, t_stop):
    """Start of the next step, time left, and the step's length: no crumb is left at the stop."""
    left = t_stop - clock[0]
    return clock[0], left, left if clock[1] >= left else min(clock[1], 0.5 * left)


@kernel
def known_part(modes, reads, p0, constant, drivers, base):
    """What every strand's rows are made of besides the step itself, (1 + k, R, s)."""
    for strand in range(base.shape[0]):
        read_modes(modes[strand], reads, base[strand])
        for c in range(base.shape[1]):
            for i in range(base.shape[2]):
                base[strand, c, i] += constant[strand, c, i]
                if c < p0.shape[1]:
                    base[strand, c, i] += p0[strand, c]
    fold_known(p0.shape[1], drivers, base)


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
def lowest_order(channels, orders):
    """The smallest order of integration."""
    lowest = 1.0
    for row in range(channels.shape[0]):
        if channels[row, 2] < orders.shape[0]:
            lowest = min(lowest, orders[int(channels[row, 2])])
    return lowest


@kernel
def tangents_ratio(
    rhs, jac, has_jac, params, times, h, base, x, form, drivers, whole, local, legendre, values,
    rtol, notes, newton,
):  # fmt: skip
    """Solve the step for the tangents; their largest error over its tolerance, inf if singular."""
    channels, orders, second, _ = form
    if not solve_tangents(
        rhs, jac, has_jac, params, times, h, base, x, second, drivers, whole, values, notes
    ):
        return np.inf
    take_from_forces(x.shape[1], drivers, base[1:], values[1:])
    return worst_tangent(h, channels, orders, legendre, local, drivers, values, newton, rtol)


@kernel
def worst_tangent(h, channels, orders, legendre, local, drivers, values, newton, rtol):
    """Largest ratio of a tangent's error to its tolerance, relative to all of the tangent."""
    worst, errors = 0.0, np.empty(values.shape[2])
    for strand in range(1, values.shape[0]):
        estimate(h, channels, orders, legendre, local, drivers, values[strand], newton, errors)
        size = np.max(np.abs(values[strand, PRIMARY:]))
        if not size < np.inf:
            return np.inf
        if size > 0.0:
            worst = max(worst, np.max(errors) / (max(rtol, _TANGENT) * size))
    return worst


@kernel
def fold(rates, modes, p0):
    """Let a mode that does not decay be part of p(0).

    In a classical equation the two would grow apart, and what they leave of a tangent that decays
    would be lost in their rounding.
    """
    if rates.shape[0] > 0 and rates[0] == 0.0:
        d = p0.shape[1]
        p0 += modes[:, :d, 0]
        modes[:, :d, 0] = 0.0


@kernel
def move_on(h, keeps, moments, driven, idle, legendre, values, x, p, modes):
    """Every strand to the end of the step."""
    for strand in range(x.shape[0]):
        move_modes(h, keeps, moments, driven, idle[strand], legendre, values[strand], modes[strand])
        x[strand] = values[strand, POSITION, :, -1]
        p[strand] = values[strand, PRIMARY, :, -1]


@kernel
def keep_row(values, x, p, second, largest, nodal, begin):
    """Note a step's start and p at its nodes, and the largest p so far where it is a velocity."""
    # values (3, d, s), x, p (d,), nodal (d, s), begin (2 d,)
    d, s = nodal.shape
    nodal[:] = values[PRIMARY]
    for c in range(d):
        begin[c], begin[d + c] = x[c], p[c]
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


@kernel
def over_tolerance(h, errors, values, second, largest, p0, rtol, atol):
    """Largest ratio of an error to its tolerance, over y and, where it is unknown, y'.

    p is p(0) and what the modes take from it again: it is known to the rounding of p(0) alone.
    """
    worst = 0.0
    for c in range(errors.shape[0]):
        size_p, size_x = 0.0, 0.0
        for i in range(values.shape[2]):
            size_p = max(size_p, abs(values[PRIMARY, c, i]))
            size_x = max(size_x, abs(values[POSITION, c, i]))
        if second[c] == 1:
            size_p = max(size_p, largest[c])
            worst = max(worst, h * errors[c] / (atol + rtol * size_x))
        worst = max(worst, errors[c] / max(atol + rtol * size_p, _ROUNDING * abs(p0[c])))
        if not errors[c] < np.inf:
            return np.inf
    return worst
