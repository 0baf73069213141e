"""Jumps of the right-hand side that nobody named: looks between the nodes, and times of jumps.

f is looked at between the nodes of each step, at times that do not depend on the steps. A step in
which f is far from its polynomial there is rejected. Where steps are rejected, bisection tells
whether f jumps, and when. The march restarts there, as at a named break.

Letters of shapes: d components, s nodes. `m` is an `AdaptiveWork`, `m.workspace` its workspace.
"""

import math

import numpy as np

from ..compiled.functions import set_force
from ..compiled.jacobian import LEAST
from ..compiled.jit import inner
from ..compiled.linalg import dot, largest_of, put
from .newton import force_on_its_side
from .operators import FORCE, POSITION, PRIMARY
from .tolerances import error_of_growth

# Rounding error of f as fraction of |J| |y|, where J is the Jacobian. It includes the growth of the
# error by interpolation.
ROUNDING_OF_F = 2e-14
# Ratio of the defect of f at a look to the defect at the check points that enter the error. Only
# above it the step has missed a force.
_MIN_DEFECT_RATIO = 30.0
# Change of p over the step by such a defect, in units of Newton's tolerance. Only above it the step
# has missed a force. One tolerance is 1,000 of these units.
_MIN_CHANGE = 1000.0
# Place of looks between multiples of their distance. It is irrational, so that they share no period
# of f.
_PHASE = (5**0.5 - 1) / 2
# Largest distance between neighbouring nodes, over the length of a step and the number of nodes.
_OF_NODES = 0.5
# Halvings of an interval after which f does not jump if its difference has shrunk to a fraction.
_HALVINGS_IF_SMOOTH = 8
_SMOOTH = 0.05
# Most halvings: from 1e300 to neighbouring numbers.
_MOST_HALVINGS = 1100
# Least way beyond a jump by y, as fraction of the change of y over the last step.
_LEAST_SHARE = 1e-4
# Least difference of f at neighbouring times at a jump, as fraction of that at the first ones.
_OF_JUMP = 0.5


@inner(allocates=True)
def look(m, h):
    """Return a time of a solved step at which f is far from its polynomial, or 0."""
    # at times a part of the run apart that do not depend on the steps, not where nodes are closer
    workspace, limits, spacing = m.workspace, m.limits, m.limits.looks
    start = m.state.control.origin + m.state.control.time
    k, end = math.floor(start / spacing - _PHASE) + 1, min(start + h, limits.latest)
    y, point, first = workspace.values[0, POSITION], workspace.point, m.state.control.begins == 1.0
    d, s = y.shape
    if h <= _OF_NODES * s * spacing:
        return 0.0
    of_y, of_f, legendre = np.zeros((d, s + 1)), np.empty((d, s)), np.empty(s + 1)
    for c in range(d):
        set_coefficients(m, h, c, of_y[c], of_f[c])
    while (k + _PHASE) * spacing < end:
        t = (k + _PHASE) * spacing
        k += 1
        if t <= limits.earliest:
            continue
        u = variable_at(math.log((t - start) / h), m.rule.variable) if first else (t - start) / h
        set_legendre(2.0 * u - 1.0, legendre)
        for c in range(d):
            point[c] = dot(of_y[c], legendre, 0, s + 1)
        if first:
            force_on_its_side(m, t, y, point, workspace.f_at_point)
        else:
            set_force(m.right.force, t, point, workspace.f_at_point)
        m.state.counts.rhs += 1
        for c in range(d):
            if is_off(m, h, c, dot(of_f[c], legendre, 0, s)):
                return t
    return 0.0


@inner
def variable_at(log, variable):
    """Return the variable u of a first step at a time with this logarithm, as `Variable.at`."""
    q, m, c = variable
    bend = (1.0 + c * math.exp(log * (m / q))) / (1.0 + c)
    return math.exp(log / q) / bend ** (1.0 / m)


@inner
def set_coefficients(m, h, c, of_y, of_f):
    """Set the Legendre coefficients of y_c (s + 1,) and f_c (s,) in a solved step of length h."""
    # y is the integral of p = y'; in a first step, whose variable is not time, it is taken as a
    # polynomial
    values, legendre, s = m.workspace.values[0], m.rule.legendre, of_f.shape[0]
    integrated = m.equations.above_one[c] == 1 and m.state.control.begins == 0.0
    for k in range(s):
        of_f[k] = dot(legendre[k], values[FORCE, c], 0, s)
        if not integrated:
            of_y[k] = dot(legendre[k], values[POSITION, c], 0, s)
            continue
        coefficient = dot(legendre[k], values[PRIMARY, c], 0, s)
        # the integral of P_k is (P_k+1 - P_k-1) / (4 k + 2), that of P_0 (P_1 + P_0) / 2
        part = h * coefficient / (4 * k + 2)
        of_y[k + 1] += part
        of_y[max(k - 1, 0)] += part if k == 0 else -part
    if integrated:
        of_y[0] += m.orbit.x[0, c]


@inner
def set_legendre(x, out):
    """Set `out` (n,) to the Legendre polynomials at x."""
    out[0], out[1] = 1.0, x
    for k in range(1, out.shape[0] - 1):
        product = x * out[k]
        out[k + 1] = product + (product - out[k - 1]) * (k / (k + 1))


@inner
def is_off(m, h, c, expected):
    """Return whether f_c at the point of a look, `m.workspace.f_at_point`, is far from expected."""
    workspace, sums, kinds = m.workspace, m.operators.sums, m.equations.kinds
    defect = abs(workspace.f_at_point[c] - expected)
    alike = max(abs(workspace.defect[c]), ROUNDING_OF_F * workspace.force_scales[c])
    if defect <= _MIN_DEFECT_RATIO * alike:
        return False
    moved = defect * largest_of(sums[kinds[c]], 0, sums.shape[1])
    return not (moved <= _MIN_CHANGE * workspace.newton_tol[c] or moved <= error_of_growth(m, h, c))


@inner
def find_jump(m, solved):
    """Return the time at which f jumps within a rejected step, or 0, and whether by y."""
    # y is that of the step, or the line through the last step: a jump by y bends y of the step
    # itself. m.workspace.point becomes y beyond the jump.
    t, by_y = search(m) if solved else (0.0, True)
    if not by_y:
        return t, by_y
    go_straight(m, m.workspace.values[0, POSITION])
    straight, by_y = search(m)
    return (straight, by_y) if straight > 0.0 else (t, True)


@inner(allocates=True)
def search(m):
    """Return the time at which f jumps along y at the nodes, or 0, and whether by y."""
    # The interval between nodes in which f differs most is halved until its ends are neighbouring
    # numbers; y is linear in it. A look that found a force ends it.
    workspace, control, limits = m.workspace, m.state.control, m.limits
    x, times, d = workspace.values[0, POSITION], workspace.times, workspace.point.shape[0]
    start = max(limits.earliest, control.origin + control.time)
    before, after = m.orbit.x[0].copy(), np.empty(d)
    f_before, f_after, largest, t = np.empty(d), np.empty(d), 0.0, start
    set_force(m.right.force, start, before, f_before)
    first, last = np.empty((2, d)), np.empty((2, d))  # y and f at the ends of the interval
    low = high = start
    m.state.counts.rhs += times.shape[0] + 1
    for i in range(times.shape[0]):
        looked = t < control.missed < times[i]
        end = control.missed if looked else times[i]
        for c in range(d):
            share = (end - t) / (times[i] - t) if times[i] > t else 1.0
            after[c] = before[c] + share * (x[c, i] - before[c])
        set_force(m.right.force, end, after, f_after)
        size = apart(m, f_before, f_after)
        if looked or size > 2.0 * largest:
            low, high, largest = t, end, size
            for c in range(d):
                first[0, c], first[1, c] = before[c], f_before[c]
                last[0, c], last[1, c] = after[c], f_after[c]
        if looked:
            break
        t = end
        for c in range(d):
            before[c], f_before[c] = after[c], f_after[c]
    return bisect(m, low, high, first, last) if largest > 0.0 else (0.0, False)


@inner
def go_straight(m, x):
    """Set y = x (d, s) at the nodes to the line through both ends of the last step, if any."""
    start, last, times = (
        m.state.control.origin + m.state.control.time,
        m.orbit.last[0],
        m.workspace.times,
    )
    for c in range(x.shape[0]):
        for i in range(x.shape[1]):
            x[c, i] = m.orbit.x[0, c]
            if m.state.control.last > 0.0:
                speed = (x[c, i] - last[POSITION, c, 0]) / m.state.control.last
                x[c, i] += speed * (times[i] - start)


@inner(allocates=True)
def bisect(m, low, high, first, last):
    """Return the time of a jump of f between two times, or 0, and whether by y."""
    # first, last (2, d): y and f at both times
    y, start, end, before = m.workspace.point, low, high, apart(m, first[1], last[1])
    f, f_low, f_high, size = np.empty(first.shape[1]), first[1].copy(), last[1].copy(), before
    for halving in range(_MOST_HALVINGS):
        middle = low + 0.5 * (high - low)
        if not low < middle < high:
            break
        put_between(first[0], last[0], (middle - start) / (end - start), y)
        set_force(m.right.force, middle, y, f)
        m.state.counts.rhs += 1
        earlier, later = apart(m, f_low, f), apart(m, f, f_high)
        if later > 2.0 * earlier:
            low, size = middle, later
            put(f, f_low)
        else:
            high, size = middle, earlier
            put(f, f_high)
        if halving == _HALVINGS_IF_SMOOTH and size < _SMOOTH * before:
            return 0.0, False
    if not size > _OF_JUMP * before:
        return 0.0, False
    put_between(first[0], last[0], (low - start) / (end - start), y)
    set_force(m.right.force, high, y, f)
    m.state.counts.rhs += 1
    by_y = apart(m, f_low, f) < apart(m, f, f_high)
    put_between(first[0], last[0], (high - start) / (end - start), y)
    return high, by_y


@inner(allocates=True)
def step_over(m, t):
    """Move `m.workspace.point` (d,) along the last step to where f jumped; return if it did."""
    # the point beyond the jump at time t that was found lies on a path which the jump has bent
    point, x, last = m.workspace.point, m.orbit.x[0], m.orbit.last[0, POSITION]
    f, f_before, share = np.empty(x.shape[0]), np.empty(x.shape[0]), _LEAST_SHARE
    set_force(m.right.force, t, point, f)
    set_force(m.right.force, t, x, f_before)
    size = apart(m, f, f_before)
    m.state.counts.rhs += 2
    while size > 0.0 and share < 1.0:
        for c in range(x.shape[0]):
            point[c] = x[c] + share * (x[c] - last[c, 0])
        set_force(m.right.force, t, point, f)
        m.state.counts.rhs += 1
        if apart(m, f, f_before) > _OF_JUMP * size:
            return True
        share *= 2.0
    return False


@inner
def put_between(first, last, share, out):
    """Set `out` (d,) to the vector at a share of the way from one to another."""
    for c in range(out.shape[0]):
        out[c] = first[c] + share * (last[c] - first[c])


@inner
def apart(m, f, other):
    """Return the largest change of p over the step by a difference of f, in Newton's tolerances."""
    sums, kinds, largest = m.operators.sums, m.equations.kinds, 0.0
    for c in range(f.shape[0]):
        moved = abs(f[c] - other[c]) * largest_of(sums[kinds[c]], 0, sums.shape[1])
        largest = max(largest, moved / max(m.workspace.newton_tol[c], LEAST))
    return largest
