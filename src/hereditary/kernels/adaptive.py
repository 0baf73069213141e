"""The adaptive march of collocation steps (floor 1)."""

import numpy as np
from numba import types

from .._jit import CUBE, CUBES, F8, I8, IVEC, MAT, VEC, entry, kernel
from .collocation import (
    FORCE,
    POSITION,
    PRIMARY,
    SLOPE,
    fold_known,
    local_operators,
    newton_room,
    slopes,
    solve_stages,
    solve_tangents,
    take_from_forces,
)
from .error_estimate import add_unseen, estimate, off_nodes, over_tolerance, worst_tangent
from .mode_tables import BANK, TABLES, combined_weights, move_modes, on_grid, read_modes, slot_of
from .signatures import JAC, RHS

# How a march ended: at its stop, with its rows full, where the modes do not reach close enough,
# where no step is small enough for the error or for Newton's method, where it is to be told of the
# orders that vary in its next step, or where the right-hand side jumps on every step.
REACHED, FULL, TOO_CLOSE, TOO_ROUGH, NOT_SOLVED, UNTOLD, JUMPING = 0, 1, 2, 3, 4, 5, 6
# Largest and smallest change of a step, what is aimed at as share of the tolerance, and Newton's.
_GROW, _SHRINK, _SAFETY, _NEWTON = 3.0, 0.2, 0.8, 0.01
# A step whose error is below this share of the tolerance says nothing of how long the next may be.
_DORMANT = 1e-3
# Highest degree that is extrapolated for a first guess.
_GUESS = 3

# Strands are the orbit and then k tangents.
# channels, orders, whether second (d,), offsets (1 + k, n), whether implicit (d,), drivers with
# orders that vary
FORM = types.Tuple((MAT, VEC, IVEC, MAT, IVEC, IVEC))
# nodes (s,), integrals (n_a, s, s), values to Legendre coefficients (s, s), inverse of the last
# integrals (s, s); points off the nodes (m,) and, at them, the integral of the polynomial through
# the nodes, and that itself (m, s)
RULE = types.Tuple((VEC, CUBE, MAT, MAT, VEC, MAT, MAT))
# what a step knows of n_v orders that vary: start and length it holds for, and those wanted (4,);
# integrals (n_v, s, s), weights of modes at the nodes (n_v, M, s), 1 for such modes (M,)
VARYING = types.Tuple((VEC, CUBE, CUBE, VEC))
# clock [time since origin, h, last step, closest distance, whether it was refused, origin], notes,
# steps [accepted, rejected, those for what f is off its nodes], largest |p| of velocities (d,); for
# all strands p0, x, p (1 + k, d), modes now and before the last step (1 + k, R, M), and f, p, x, p'
# at the last step's nodes (1 + k, 3 or 4, d, s)
RUN = types.Tuple((VEC, VEC, IVEC, VEC, MAT, MAT, MAT, CUBE, CUBE, CUBES))
# starts and lengths of steps (k,), p at the nodes (k, d, s), y and p at the start (k, 2 d), error
# over tolerance (k,)
TRACK = types.Tuple((VEC, VEC, CUBE, MAT, VEC))


@entry(RHS, JAC, I8, VEC, FORM, RULE, BANK, TABLES, VARYING, RUN, TRACK, F8, VEC, F8, F8)
def march_adaptive(
    rhs, jac, has_jac, params, form, rule, bank, tables, varying, run, track, t_stop, longest,
    rtol, atol,
):  # fmt: skip
    """March to t_stop; the number of rows and how it ended.

    longest (2,): the longest step, and the longest where nothing happens.
    """
    channels, orders, second, offsets, implicit, raw = form
    nodes, singular, legendre, inverse = rule[:4]
    clock, _, steps, largest, p0, x, p, modes, before, last = run
    starts, lengths, rows, begins, ratios = track
    d, s, n_strands = x.shape[1], nodes.shape[0], x.shape[0]
    drivers, constant, jumps, base, values, newton = step_room(form, run)
    driven, idle = weights_of_modes(form, bank, varying, run)
    lowest, row, rejected, made = lowest_order(channels, orders), 0, clock[4] == 1.0, -1.0
    end = t_stop - clock[5]
    while clock[0] < end:
        if row == starts.shape[0]:
            return row, FULL
        t, left, h = next_step(clock, end)
        if not t + 0.01 * h > t:
            return row, TOO_ROUGH
        if nodes[0] * h < clock[3]:
            return row, TOO_CLOSE
        if not told(t, h, varying):
            return row, UNTOLD
        slot = slot_of(h, nodes, bank, tables)
        local = tables[4][slot]
        if h != made or raw.shape[0] > 0:
            local[local.shape[0] - varying[1].shape[0] :] = varying[1]
            local_operators(
                h, d, channels, offsets, orders, implicit, singular, inverse, local, drivers, jumps,
                constant,
            )  # fmt: skip
        made = h
        known_part(modes, tables[1][slot], p0, p, form, varying, constant, drivers, jumps, base)
        times = times_inside(clock[5], t, h, nodes, t_stop)
        guess(nodes, legendre, last[0, PRIMARY], h, clock[2], p[0], values[0, PRIMARY])
        looks = times_inside(clock[5], t, h, rule[4], t_stop)
        ratio, unseen, solved = orbit_ratio(
            rhs, jac, has_jac, params, times, looks, h, base, form, rule, drivers, local, values,
            run, newton, rtol, atol,
        )  # fmt: skip
        if ratio <= 1.0 and n_strands > 1:
            more = tangents_ratio(
                rhs, jac, has_jac, params, times, h, base, form, rule, drivers, local, values, run,
                newton, rtol,
            )  # fmt: skip
            ratio, solved = max(ratio, more), more < np.inf
        most = longest[1] if ratio < _DORMANT else longest[0]
        clock[1] = min(next_length(h, clock[1], ratio, rejected, s + lowest), on_grid(most))
        rejected = not ratio <= 1.0
        clock[4] = 1.0 if rejected else 0.0
        steps[int(rejected)] += 1
        if rejected:
            steps[2] += int(unseen)
            if not t + 0.01 * clock[1] > t:
                return row, why_no_step(unseen, solved)
            continue
        starts[row], lengths[row], ratios[row] = clock[5] + t, h, ratio
        keep_row(values[0], x[0], p[0], second, largest, rows[row], begins[row])
        fold(bank[0], modes, p0)
        before[:], last[:] = modes, values
        move_on(h, tables[2][slot], tables[3][slot], driven, idle, legendre, values, x, p, modes)
        row += 1
        clock[0], clock[2] = (end if h == left else t + h), h
    return row, REACHED


@kernel
def why_no_step(unseen, solved):
    """Why the last step was refused."""
    if unseen:
        return JUMPING
    return TOO_ROUGH if solved else NOT_SOLVED


@kernel
def step_room(form, run):
    """Room for matrices, what is known, values at the nodes, and Newton's matrix."""
    _, d, s = run[9].shape[1:]
    n_rows, n_strands = run[7].shape[1] - form[5].shape[0] * d, run[5].shape[0]
    return (
        np.empty((3 * n_rows, s, s)),
        np.empty((n_strands, n_rows, s)),
        np.empty((n_rows, s)),
        np.empty((n_strands, n_rows, s)),
        np.empty(run[9].shape),
        newton_room(d, s),
    )


@kernel
def weights_of_modes(form, bank, varying, run):
    """With which every row's modes take in its drivers, and 1."""
    channels, _, _, offsets, _, raw = form
    modes, last = run[7], run[9]
    driven = np.empty((modes.shape[1], last.shape[1], modes.shape[2]))
    idle = np.empty(modes.shape)
    combined_weights(channels, offsets, bank[1], raw, varying[3], driven, idle)
    return driven, idle


@kernel
def times_inside(origin, t, h, nodes, t_stop):
    """Times of the nodes, after the origin and before the stop: right-hand sides may jump there."""
    times = np.minimum(origin + (t + h * nodes), np.nextafter(t_stop, 0.0))
    return np.maximum(times, np.nextafter(origin, np.inf))


@kernel
def next_step(clock, end):
    """Start of the next step, time left, and the step's length: no crumb is left at the end."""
    left = end - clock[0]
    return clock[0], left, left if clock[1] >= left else min(clock[1], 0.5 * left)


@kernel
def told(t, h, varying):
    """Whether the orders that vary are known for this step; if not, it is noted as wanted."""
    known = varying[0]
    if varying[1].shape[0] == 0 or (known[0] == t and known[1] == h):
        return True
    known[2], known[3] = t, h
    return False


@kernel
def known_part(modes, reads, p0, p, form, varying, constant, drivers, jumps, base):
    """What every strand's rows are made of besides the step itself, (1 + k, R, s)."""
    d = p0.shape[1]
    for strand in range(base.shape[0]):
        read_modes(modes[strand], reads, base[strand])
        if varying[1].shape[0] > 0:
            read_varying(modes[strand], reads, form, varying, base[strand])
        for c in range(base.shape[1]):
            for i in range(base.shape[2]):
                base[strand, c, i] += constant[strand, c, i] + jumps[c, i] * p[strand, c % d]
                if c < d:
                    base[strand, c, i] += p0[strand, c]
    fold_known(d, drivers, base)


@kernel
def read_varying(modes, reads, form, varying, out):
    """The past of orders that vary: modes without weights, by the weights at each node."""
    # modes (R, M), reads (M, s), out (R, s)
    channels, _, second, _, _, raw = form
    weights, d = varying[2], second.shape[0]
    first = int(np.max(channels[:, 2])) + 1 - weights.shape[0]  # their indices are the last
    for row in range(channels.shape[0]):
        k = int(channels[row, 2]) - first
        if k < 0:
            continue
        c = int(channels[row, 0])
        for b in range(raw.shape[0]):
            if raw[b] != int(channels[row, 1]):
                continue
            for m in range(reads.shape[0]):
                held = channels[row, 3] * modes[(2 + b) * d + c % d, m]
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
def lowest_order(channels, orders):
    """The smallest order of integration."""
    lowest = 1.0
    for row in range(channels.shape[0]):
        if 0 <= channels[row, 2] < orders.shape[0]:
            lowest = min(lowest, orders[int(channels[row, 2])])
    return lowest


@kernel
def orbit_ratio(
    rhs, jac, has_jac, params, times, looks, h, base, form, rule, drivers, local, values, run,
    newton, rtol, atol,
):  # fmt: skip
    """Solve the step for the orbit.

    Returns its error over its tolerance, whether that is too large for what f is off the nodes
    alone, and whether the step was solved.
    """
    channels, orders, second = form[:3]
    legendre, inverse, whole = rule[2], rule[3], rule[1][orders.shape[0] - 1]  # of order 1
    notes, largest, p0, x, p = run[1], run[3], run[4], run[5], run[6]
    goal = _NEWTON * (atol + rtol * np.maximum(largest, np.abs(p[0])))
    solved = solve_stages(
        rhs, jac, has_jac, params, times, h, base[0], x[0], second, drivers, whole, goal,
        values[0, PRIMARY], values[0, POSITION], values[0, FORCE], notes, newton,
    )  # fmt: skip
    if not solved:
        return np.inf, False, False
    errors, off = np.empty(second.shape[0]), np.zeros(second.shape[0])
    off_nodes(rhs, params, looks, h, rule[5:], x[0], second, values[0], off)
    notes[0] += looks.shape[0]
    take_from_forces(second.shape[0], drivers, base, values[:1])
    if values.shape[1] > SLOPE:
        slopes(h, inverse, p[0], values[0, PRIMARY], values[0, SLOPE])
    estimate(h, channels, orders, legendre, local, drivers, values[0], newton, errors)
    end = run[0][5] + run[0][0] + h
    seen = over_tolerance(h, end, errors, values[0], second, largest, p0[0], rtol, atol)
    add_unseen(off, drivers, newton, errors)
    ratio = over_tolerance(h, end, errors, values[0], second, largest, p0[0], rtol, atol)
    return ratio, seen <= 1.0 and not ratio <= 1.0, True


@kernel
def tangents_ratio(
    rhs, jac, has_jac, params, times, h, base, form, rule, drivers, local, values, run, newton,
    rtol,
):  # fmt: skip
    """Solve the step for the tangents; their largest error over its tolerance, inf if singular."""
    channels, orders, second = form[:3]
    legendre, inverse, whole = rule[2], rule[3], rule[1][orders.shape[0] - 1]
    x, p = run[5], run[6]
    if not solve_tangents(
        rhs, jac, has_jac, params, times, h, base, x, second, drivers, whole, values, run[1]
    ):
        return np.inf
    take_from_forces(second.shape[0], drivers, base[1:], values[1:])
    if values.shape[1] > SLOPE:
        for strand in range(1, x.shape[0]):
            slopes(h, inverse, p[strand], values[strand, PRIMARY], values[strand, SLOPE])
    return worst_tangent(h, channels, orders, legendre, local, drivers, values, newton, rtol)


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
    # values (3 or 4, d, s), x, p (d,), nodal (d, s), begin (2 d,)
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
