"""Delayed values: the solution of earlier times as polynomials, which a march writes and f reads.

A piece is a polynomial in the variable u of a step (collocation/first_rule.py), or a past or a
delay as polynomials in time. A march appends a piece for each accepted step. Python makes room for
further ones, and drops those that no delay reads any more (solver/delayed_pieces.py).
"""

import math
from typing import Annotated, NamedTuple

import numpy as np

from .jit import F8, MAT, Integers, Matrix, Vector, compiled_type, entry, inner
from .reference import Reference

# Indices of `Delays.counts`: number of pieces, of numbers in use, and the first piece of the
# solution. Those before are delays that vary, and pasts.
PIECES, USED, FIRST = range(3)
# Distance of p at the start of a step from its polynomial through the nodes, over the largest of
# its last Legendre coefficients, above which p has jumped at the start; and their number.
JUMPED = 10.0
LAST = 4
# Relative distance of times that rounding makes of one.
_SAME_TIME = 1e-14
# Largest number of steps towards the longest step that a delay which varies admits.
_TOWARDS_DELAY = 20


class Delays(NamedTuple):
    """Delayed values y(t - tau) of n delays, and m pieces of delays, pasts and solution."""

    rows: Annotated[Integers, "k"]  # number of the delay of each row of memory, -1 for x itself
    taus: Annotated[Vector, "n"]  # the delays, NaN for those that vary
    windows: Annotated[Matrix, "n 2"]  # times between which each delay reads
    ranges: Annotated[Integers, "4*n"]  # first and end of pieces of each delay, and of its past
    starts: Annotated[Vector, "m"]  # of pieces [time]
    lengths: Annotated[Vector, "m"]  # of pieces [time]
    variables: Annotated[Matrix, "m 3"]  # the numbers q, m and c of the variable u of each piece
    places: Annotated[Integers, "m"]  # index of the first coefficient of a piece
    widths: Annotated[Integers, "m"]  # number of coefficients of each component
    numbers: Annotated[Vector, "."]  # Legendre coefficients, component after component
    # 1 where a step has y at its start, and then the mean of y'
    by_means: Annotated[Integers, "d"]
    counts: Annotated[Integers, "3"]
    displacements: Annotated[Matrix, "n d"]  # of pasts, for neighbouring orbits
    ends: Annotated[Vector, "."]  # times at which a step ends, increasing
    latest: Annotated[Matrix, "n d"]  # the values that were read last
    read_at: Annotated[Vector, "."]  # their time, or NaN; empty if several marches share the record
    factors: Annotated[Vector, "d"]  # of delayed values, 1 but in a test of what f reads
    polynomials: Annotated[Vector, "."]  # work array


_DELAYS = Reference(compiled_type(Delays))


@entry(_DELAYS, F8, MAT)
def read_delays(delays, t, out):
    """Set out (n, d) to the values of all delays at time t."""
    look_up_all(delays, t)
    for number in range(out.shape[0]):
        for c in range(out.shape[1]):
            out[number, c] = delays.latest[number, c]


@inner
def look_up_all(delays, t):
    """Set `delays.latest` to the values of all delays at time t, unless it has them."""
    alone = delays.read_at.shape[0] > 0
    if alone and delays.read_at[0] == t:
        return
    for number in range(delays.latest.shape[0]):
        look_up(delays, number, t, delays.latest[number])
    if alone:
        delays.read_at[0] = t


@inner
def next_end(delays, t):
    """Return the first of the times after t at which a step ends, or infinity."""
    n, t = delays.ends.shape[0], t + _SAME_TIME * abs(t)
    i = find_piece(delays.ends, 0, n, t)
    i += int(i < n and delays.ends[i] <= t)
    return delays.ends[i] if i < n else np.inf


@inner
def look_up(delays, number, t, out):
    """Set out (d,) to the value of a delay at time t."""
    low, high = delays.windows[number, 0], delays.windows[number, 1]
    s = t - delay_at(delays, number, t)
    s = min(max(s, low), high) if high < np.inf else s + _SAME_TIME * abs(s)  # rows of given steps
    first, end = delays.ranges[4 * number + 2], delays.ranges[4 * number + 3]
    of_step = s >= 0.0 or first == end
    if of_step:
        first, end = delays.counts[FIRST], delays.counts[PIECES]
    if first < end:
        set_value(delays, find_piece(delays.starts, first, end, s), s, of_step, out)
    for c in range(out.shape[0] if s < 0.0 else 0):
        out[c] += delays.displacements[number, c]
    for c in range(out.shape[0]):
        out[c] *= delays.factors[c]


@inner
def delay_at(delays, number, t):
    """Return a delay at time t."""
    first, end = delays.ranges[4 * number], delays.ranges[4 * number + 1]
    if first == end:
        return delays.taus[number]
    piece = find_piece(delays.starts, first, end, t)
    weigh(delays, piece, t)
    place, total = delays.places[piece], 0.0
    for k in range(delays.widths[piece]):
        total += delays.polynomials[k] * delays.numbers[place + k]
    return total


@inner
def find_piece(starts, first, end, t):
    """Return the last piece from `first` to `end` that does not start after t, or the first one."""
    while end - first > 1:
        middle = (first + end) // 2
        if starts[middle] <= t:
            first = middle
        else:
            end = middle
    return first


@inner
def weigh(delays, piece, t):
    """Set `delays.polynomials` to Legendre polynomials at time t of a piece."""
    values, width, u = delays.polynomials, delays.widths[piece], 0.0
    if width > 1:
        u = min(max((t - delays.starts[piece]) / delays.lengths[piece], 0.0), 1.0)
    q, m, c = delays.variables[piece, 0], delays.variables[piece, 1], delays.variables[piece, 2]
    if u > 0.0 and (q != 1.0 or c != 0.0):
        log = math.log(u)
        u = math.exp(log / q)
        if c != 0.0:
            u /= ((1.0 + c * math.exp(log * (m / q))) / (1.0 + c)) ** (1.0 / m)
        u = min(u, 1.0)
    x = 2.0 * u - 1.0
    values[0], values[1] = 1.0, x
    for k in range(2, width):
        product, ratio = x * values[k - 1], (k - 1) / k
        values[k] = (product - values[k - 2]) * ratio + product


@inner
def set_value(delays, piece, t, of_step, out):
    """Set out (d,) to the values of a piece at time t; `of_step` if it is not a past."""
    weigh(delays, piece, t)
    values, width, place = delays.polynomials, delays.widths[piece], delays.places[piece]
    since = t - delays.starts[piece]
    since = since if since > 4.0 * _SAME_TIME * abs(t) else 0.0
    for c in range(out.shape[0]):
        row, total = delays.numbers[place + c * width : place + (c + 1) * width], 0.0
        if of_step and delays.by_means[c] == 1:
            for k in range(1, width):
                total += values[k - 1] * row[k]
            out[c] = row[0] + since * total
        else:
            for k in range(width):
                total += values[k] * row[k]
            out[c] = total


@inner
def within_delays(delays, t, h):
    """Return the longest step from t, up to h, in which all delayed values are known."""
    for number in range(delays.taus.shape[0]):
        if delays.ranges[4 * number] == delays.ranges[4 * number + 1]:
            h = min(h, delays.taus[number])
            continue
        for _ in range(_TOWARDS_DELAY):
            tau = delay_at(delays, number, t + h)
            if h <= tau:
                break
            h = tau
        if h > delay_at(delays, number, t + h):
            h *= 0.5
    return h


@inner
def add_step(delays, rule, steps, row):
    """Append the piece of an accepted step, a row of `steps`."""
    p, x_start, p_start = steps.p[row], steps.at_starts[row, 0], steps.at_starts[row, 1]
    numbers, nodes, legendre = delays.numbers, rule.nodes, rule.legendre
    integral, s = rule.integrals[rule.integrals.shape[0] - 1], nodes.shape[0]
    piece, place, width = delays.counts[PIECES], delays.counts[USED], s + 1
    for c in range(delays.by_means.shape[0]):
        of_c = numbers[place + c * width : place + (c + 1) * width]
        for k in range(width):
            of_c[k] = 0.0
        if delays.by_means[c] == 1:
            of_c[0] = x_start[c]
            for i in range(s):
                mean = 0.0
                for j in range(s):
                    mean += integral[i, j] * p[c, j]
                mean = mean / nodes[i] if nodes[i] > 0.0 else p[c, i]
                for k in range(s):
                    of_c[1 + k] += legendre[k, i] * mean
            continue
        # the polynomial goes through p at the start, too, unless p jumps there
        limit, last, sign = 0.0, 0.0, 1.0
        for k in range(s):
            for i in range(s):
                of_c[k] += legendre[k, i] * p[c, i]
            limit += sign * of_c[k]
            sign = -sign
            last = max(last, abs(of_c[k])) if k >= s - LAST else 0.0
        if abs(limit - p_start[c]) <= JUMPED * last:
            part = 0.5 * sign * (p_start[c] - limit)
            of_c[s] += part
            of_c[s - 1] -= part
    delays.starts[piece], delays.lengths[piece] = steps.starts[row], steps.lengths[row]
    for k in range(3):
        delays.variables[piece, k] = rule.variable[k]
    delays.places[piece], delays.widths[piece] = place, width
    delays.counts[PIECES], delays.counts[USED] = piece + 1, place + width * delays.by_means.shape[0]
    delays.read_at[0] = np.nan
