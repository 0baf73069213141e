"""Sizes of components, to which the errors of a run are relative, whatever their units.

The size of a component is its own largest |y| so far. While it grows from little it is at least a
part, `SMALL`, of its *reach*: what other components could make of it during the run. A component
grows as a power of time. Its reach counts up to what this power makes of it at `HORIZON` times the
present time. So a component that does not grow has its own size, whatever its reach. A component
that began at 0 is *young* up to a part of its reach, `YOUNG`: it may be rounding, and has no power.

Component e makes
``g_ce |y_e|`` of component c, with the gain ``g_ce = |J_ce| / (rate_c + damping_c)``. J is the
Jacobian of f, and `rate_c` is the f that moves y_c by 1 during the run. The damping is |J_cc|
without what returns from components that c drives. The largest product of gains along a chain of
components counts.

Components that drive each other form a *circle*. No gain within a circle counts as more than 1, or
gains would multiply in each turn. This holds in units in which the largest gain into each component
equals the largest gain out of it.

Letters of shapes: d components, n entries of the Jacobian. Gains, units and the reach are stored as
logarithms; that of 0 is -inf.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np

from .jacobian import COLUMNS, ROWS, VALUES, is_sparse
from .jit import Integers, Vector, inner

# Least size of a component, as a part of its reach. With 1e-5 a component of 1e-8 of others errs by
# 1.1 tolerances instead of 0.02 (six problems in random units).
SMALL = 1e-6
# Time up to which a component is assumed to grow as a power of time, in present times.
HORIZON = 100.0
# Size of a component that began at 0, as a part of its reach, up to which it may be rounding.
YOUNG = 1e-12
# Size of a component up to which it is rounding of f, in units of |J| |y| summed over a step.
NOISE = 2e-13
# Largest number of sweeps over all components in each of two loops.
_MAX_SWEEPS = 8
# Change of the logarithm of a unit or of a reach at which sweeps end.
_CHANGE = 0.1
# Rate of an algebraic row, as a part of the diagonal entry of the Jacobian.
_ALGEBRAIC_RATE = 1e-9
# Largest logarithm of a reach.
_LARGEST_LOGARITHM = 690.0


class Links(NamedTuple):
    """The n nonzero entries of the Jacobian off its diagonal, by the components that they link.

    The entries of row c have the numbers ``by_row[row[c] : row[c + 1]]``. So have columns.
    """

    rows: Annotated[Integers, "n"]
    columns: Annotated[Integers, "n"]
    gains: Annotated[Vector, "n"]  # the entries
    row: Annotated[Integers, "d+1"]
    column: Annotated[Integers, "d+1"]
    by_row: Annotated[Integers, "n"]
    by_column: Annotated[Integers, "n"]


@inner(allocates=True)
def set_reach(j_f, rates, sizes, reach):
    """Set `reach` (d,): what others could make of each component, or its own size if larger."""
    # a single component has none; j_f: Jacobian of f, dense or sparse; rates (d,): of the run
    d = sizes.shape[0]
    if d == 1:
        reach[0] = 0.0
        return
    slow, damping, kept, units = np.empty(d), np.empty(d), np.empty(d), np.empty(d)
    links = links_of(j_f, rates, slow, damping)
    rows, columns, gains = links.rows, links.columns, links.gains
    circles, order = np.empty(d, dtype=np.int64), np.empty(d, dtype=np.int64)
    find_circles(links, units, circles, order)
    balance(links, circles, units)
    for c in range(d):
        kept[c] = damping[c]
    for k in range(rows.shape[0]):
        c, e = rows[k], columns[k]
        if kept[c] > 0.0 and circles[c] == circles[e]:
            kept[c] -= (slow[c] + damping[c]) * math.exp(gains[k] + units[e] - units[c])
    for k in range(rows.shape[0]):
        c, e = rows[k], columns[k]
        if damping[c] > 0.0:
            gains[k] += math.log((slow[c] + damping[c]) / (slow[c] + max(kept[c], 0.0)))
        if circles[c] == circles[e]:
            gains[k] = min(gains[k], units[c] - units[e])
    for c in range(d):
        reach[c] = math.log(sizes[c]) if sizes[c] > 0.0 else -np.inf
    spread(links, order, reach)
    for c in range(d):
        reach[c] = math.exp(min(reach[c], _LARGEST_LOGARITHM))


@inner
def set_moved(j_f, rates, sizes, moved):
    """Replace f in `moved` (d,) by f over rate and damping, or by the size (d,) if larger."""
    d = sizes.shape[0]
    sparse = is_sparse(j_f, d)
    for k in range(j_f.shape[1] if sparse else d):
        c, e = (int(j_f[ROWS, k]), int(j_f[COLUMNS, k])) if sparse else (k, k)
        if c == e:
            speed = rates[c] + abs(j_f[VALUES, k] if sparse else j_f[c, c])
            made = abs(moved[c]) / speed if speed > 0.0 else 0.0
            moved[c] = max(sizes[c], made if made < np.inf else 0.0)


@inner(allocates=True)
def links_of(j_f, rates, slow, damping):
    """Return the `Links` of a Jacobian, with gains that the whole damping reduces."""
    # damping (d,) becomes moduli of the diagonal; slow (d,) rates, or small parts of the damping
    # for algebraic rows
    d = slow.shape[0]
    sparse, n = is_sparse(j_f, d), 0
    entries = j_f.shape[1] if sparse else d * d
    rows, columns = np.empty((2, entries), dtype=np.int64)
    gains = np.empty(entries)
    for c in range(d):
        damping[c] = 0.0
    for k in range(entries):
        c, e = (int(j_f[ROWS, k]), int(j_f[COLUMNS, k])) if sparse else (k // d, k % d)
        value = abs(j_f[VALUES, k] if sparse else j_f[c, e])
        if c == e:
            damping[c] = value
        elif 0.0 < value < np.inf:
            rows[n], columns[n], gains[n] = c, e, value
            n += 1
    for c in range(d):
        slow[c] = max(rates[c], _ALGEBRAIC_RATE * damping[c])
    for k in range(n):
        gain = gains[k] / (slow[rows[k]] + damping[rows[k]])
        gains[k] = math.log(gain) if 0.0 < gain < np.inf else -np.inf
    row, by_row = in_groups(rows[:n], d)
    column, by_column = in_groups(columns[:n], d)
    return Links(rows[:n], columns[:n], gains[:n], row, column, by_row, by_column)


@inner(allocates=True)
def in_groups(numbers, d):
    """Return the places (n,) of numbers below d in ascending order, and where each begins."""
    first, places = np.zeros(d + 1, dtype=np.int64), np.empty(numbers.shape[0], dtype=np.int64)
    for k in range(numbers.shape[0]):
        first[numbers[k] + 1] += 1
    for c in range(d):
        first[c + 1] += first[c]
    for k in range(numbers.shape[0] - 1, -1, -1):
        first[numbers[k] + 1] -= 1
        places[first[numbers[k] + 1]] = k
    for c in range(d):  # each place was counted down to the beginning of its number
        first[c] = first[c + 1]
    first[d] = numbers.shape[0]
    return first, places


@inner(allocates=True)
def find_circles(links, units, circles, order):
    """Set numbers of circles of components, units within them, and an order of components, (d,)."""
    # in order, components follow those that drive them, but for circles; Kosaraju's algorithm
    d = circles.shape[0]
    stack, place, last = np.empty(d, dtype=np.int64), np.empty(d, dtype=np.int64), d
    for c in range(d):
        place[c], circles[c], units[c] = -1, -1, 0.0
    for root in range(d):  # depth first along columns; a component is listed after all it drives
        depth = 0
        if place[root] < 0:
            stack[0], place[root], depth = root, links.column[root], 1
        while depth > 0:
            e = stack[depth - 1]
            if place[e] == links.column[e + 1]:
                depth, last = depth - 1, last - 1
                order[last] = e
                continue
            k = links.by_column[place[e]]
            place[e] += 1
            c = links.rows[k]
            if links.gains[k] > -np.inf and place[c] < 0:
                stack[depth], place[c], depth = c, links.column[c], depth + 1
    for i in range(d):  # along rows, to all that drive a component and are not of other circles
        depth = 0
        if circles[order[i]] < 0:
            stack[0], depth, circles[order[i]] = order[i], 1, order[i]
        while depth > 0:
            depth -= 1
            c = stack[depth]
            for j in range(links.row[c], links.row[c + 1]):
                k = links.by_row[j]
                e = links.columns[k]
                if links.gains[k] > -np.inf and circles[e] < 0:
                    circles[e] = circles[c]
                    units[e] = balanced(e, links, circles, units)
                    stack[depth], depth = e, depth + 1


@inner
def balanced(c, links, circles, units):
    """Return the unit of component c that makes the largest gains into and out of it equal."""
    # only gains within a circle that is known count
    into, out_of = -np.inf, -np.inf
    for i in range(links.row[c], links.row[c + 1]):
        k = links.by_row[i]
        if circles[links.columns[k]] == circles[c]:
            into = max(into, links.gains[k] + units[links.columns[k]])
    for i in range(links.column[c], links.column[c + 1]):
        k = links.by_column[i]
        if circles[links.rows[k]] == circles[c]:
            out_of = max(out_of, links.gains[k] - units[links.rows[k]])
    if into > -np.inf and out_of > -np.inf:
        return 0.5 * (into - out_of)
    return into if into > -np.inf else -out_of if out_of > -np.inf else units[c]


@inner
def balance(links, circles, units):
    """Balance the units (d,) of all components with those of their circles."""
    for _ in range(_MAX_SWEEPS):
        largest = 0.0
        for c in range(units.shape[0]):
            unit = balanced(c, links, circles, units)
            largest, units[c] = max(largest, abs(unit - units[c])), unit
        if largest <= _CHANGE:
            break


@inner
def spread(links, order, reach):
    """Raise the reach (d,) to the largest products of gains and sizes along chains."""
    # sweeps go along order and back in turn
    d = order.shape[0]
    for sweep in range(_MAX_SWEEPS):
        largest = 0.0
        for i in range(d):
            c = order[i if sweep % 2 == 0 else d - 1 - i]
            for j in range(links.row[c], links.row[c + 1]):
                k = links.by_row[j]
                made = links.gains[k] + reach[links.columns[k]]
                if made > reach[c]:
                    largest, reach[c] = max(largest, made - reach[c]), made
        if largest <= _CHANGE:
            break
