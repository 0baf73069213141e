"""Allowed errors of a run by collocation: of the run, of a step, of its modes, of Newton's method.

Letters of shapes: d components. The primary unknown p is y, or y' for orders above 1. `m` is an
`AdaptiveWork`, `m.workspace` its workspace.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled.jacobian import LEAST
from ..compiled.jit import inner
from ..compiled.linalg import largest_of
from ..compiled.reach import HORIZON, SMALL, YOUNG
from ..stepping.tolerance import Tolerance
from .operators import POSITION, PRIMARY

# Largest error of one step, as fraction of the tolerance of a run. With 1, undamped pairs of order
# 0.95 err by 1.6 tolerances after 900 periods at rtol 1e-2, and P4 and P6 take more steps there.
STEP_FRACTION = 0.1
# Fraction of the error of a step for that of the modes, whose errors add up along undamped orbits.
# With 1e-2, D^0.5 y = 10 (y1 - y2, y1 + y2) errs by 23 tolerances after 3,180 periods. The problems
# of convergence/work_precision.py need the same time.
_MODES_FRACTION = 1e-4
# Without damping, errors of the modes add up to this multiple of the error of their fit, for each
# size of y by which y moves (convergence/undamped.py).
_OF_MODES = 5.0
# Relative error that rounding adds in each step of an undamped solution.
_ROUNDING_PER_STEP = 1e-15
# First steps use the variable u with t = u**q. From this q on errors are estimated too small,
# because u**q changes only near the end. The tolerance of the step is then multiplied by this
# number over q.
_MAX_RESOLVED_Q = 10.0
# Least factor by which the tolerance of a first step is multiplied.
_MIN_FIRST_TOL_FACTOR = 5e-3
# Least rtol of a first step because of rounding (measured for orders 1 + 1e-9 to 1.003, and y' at
# rtol 1e-4 to 1e-10).
_MIN_RTOL_OF_FIRST_STEPS = 5e-14
# Error of p that Newton's method may leave (its tolerance), as fraction of the error that a step
# may make.
_NEWTON_TOL_FRACTION = 0.01
# Error of a young component, as fraction of the size at which it no longer is young. A larger one
# would count as a size.
_OF_YOUNG = 0.01
# Rounding error of linear systems in a young component, as fraction of this error.
_ROUNDING_OF_YOUNG = 0.01
# Largest power of time with which a component is assumed to grow.
_LARGEST_POWER = 100.0
# Rounding error of integrals of y over a step, as a fraction of y, where p is y'.
ROUNDING_OF_SUMS = 1e-15
# Change of y over the run that the allowed error of y' may cause, in units of the tolerance of y
# relative to its size.
OF_SPEED = 4.0


def of_modes(tolerance: Tolerance) -> float:
    """Return the relative error of the modes for the tolerance of a run."""
    # with larger errors of the modes the solution would look rough, and no step would be short
    # enough
    allowed = max(1e-14, min(1e-3, _MODES_FRACTION * (STEP_FRACTION * tolerance.rtol)))
    return min(allowed, tolerance.modes)


def of_first_step(of_step: Tolerance, q: float) -> Tolerance:
    """Return the tolerance of a first step in the variable u, where t = u**q."""
    rounding = _MIN_RTOL_OF_FIRST_STEPS / of_step.rtol
    return of_step.times(min(1.0, max(_MAX_RESOLVED_Q / q, _MIN_FIRST_TOL_FACTOR, rounding)))


def undamped(estimate: float, of_fit: float, moved: float, n_steps: int) -> float:
    """Return the estimated relative error of a run in which errors add up."""
    # estimate: of a damped run; of_fit: error of the modes' fit; moved: way of y, in sizes of y
    return float(estimate + _OF_MODES * of_fit * moved + _ROUNDING_PER_STEP * n_steps)


@inner
def raise_to_least(equations, state, sizes):
    """Raise sizes (d,) to their least ones, by those of others; return whether any is still 0."""
    begins = False
    for c in range(sizes.shape[0]):
        sizes[c] = max(sizes[c], SMALL * min(state.reach[c], state.growth[c]))
    for c in range(sizes.shape[0]):
        sizes[c] = max(sizes[c], equations.least[c] * sizes[equations.sources[c]])
        begins = begins or sizes[c] <= LEAST
    return begins


@inner
def raise_sizes(values, sizes):
    """Raise `sizes` (d,) to the largest |y| at the nodes; return whether any doubled."""
    # values (n_q, d, s) has y in it
    grew = False
    for c in range(sizes.shape[0]):
        before = sizes[c]
        for i in range(values.shape[2]):
            size = abs(values[POSITION, c, i])
            sizes[c] = size if sizes[c] < size < np.inf else sizes[c]
        grew = grew or sizes[c] > 2.0 * before
    return grew


@inner
def begin_sizes(values, sizes):
    """Set sizes (d,) that are 0 to the largest |y| at the nodes; return whether any changed."""
    changed = False
    for c in range(sizes.shape[0]):
        largest = 0.0
        for i in range(values.shape[2] if sizes[c] <= LEAST else 0):
            size = abs(values[POSITION, c, i])
            largest = size if largest < size < np.inf else largest
        if largest > LEAST:
            sizes[c], changed = largest, True
    return changed


@inner
def begin_growth(x, growth):
    """Set the growth (d,) before a first step: |y| (d,), or unlimited for components that are 0."""
    # those that were 0 before, and still are young, remain so
    for c in range(growth.shape[0]):
        if abs(x[c]) <= LEAST or growth[c] < np.inf:
            growth[c] = abs(x[c]) if abs(x[c]) > LEAST else np.inf


@inner
def any_is_little(state, values):
    """Return whether any component of a solved step, (n_q, d, s), is below a part of its reach."""
    for c in range(values.shape[1]):
        own = max(state.sizes[c], largest_of(values[POSITION, c], 0, values.shape[2]))
        if own < SMALL * state.reach[c]:
            return True
    return False


@inner
def note_growth(m, h):
    """Set the growth of components, from their powers of time in a solved step of length h."""
    # a component that begins at 0 has the power of the second half of its first step
    state, x_start, t = m.state, m.orbit.x[0], m.state.control.time
    x, first = m.workspace.values[0, POSITION], state.control.begins == 1.0
    for c in range(x.shape[0]):
        before, now = abs(x_start[c]), abs(x[c, -1])
        own = max(state.sizes[c], now)
        if state.growth[c] == np.inf and own <= YOUNG * state.reach[c]:
            continue
        state.growth[c], power = own, 0.0
        if own < SMALL * state.reach[c] and now == own:
            if first and before <= LEAST:
                power = power_of_time(m.rule.nodes, x[c])
            elif before < now and t > 0.0:
                power = math.log(now / before) / math.log((t + h) / t) if before > LEAST else np.inf
            left = max(1.0, min(HORIZON, m.limits.t_end / (t + h)))
            state.growth[c] = own * left ** min(power, _LARGEST_POWER)


@inner
def power_of_time(nodes, values):
    """Return the power of time of |values| (s,) in the second half of a first step, at least 0."""
    half = 0
    for i in range(nodes.shape[0]):
        half = i if abs(nodes[i] - 0.5) < abs(nodes[half] - 0.5) else half
    now, before = abs(values[-1]), abs(values[half])
    return math.log(now / before) / -math.log(nodes[half]) if 0.0 < before < now else 0.0


@inner
def error_of_growth(m, h, c):
    """Return the tolerance of what component c became in longer trials of a first step."""
    # By the power of time of the second half of this step. 0 in other steps, without a longer
    # trial, and for a component that begins not from 0, or that no other drives.
    state, p = m.state, m.workspace.values[0, PRIMARY, c]
    largest = largest_of(p, 0, p.shape[0])
    driven = abs(m.orbit.p[0, c]) <= LEAST < state.reach[c]
    if state.control.begins == 0.0 or not driven or not h < state.since[c] < np.inf:
        return 0.0
    power = power_of_time(m.rule.nodes, p)
    return m.limits.tolerance.rtol * largest * (state.since[c] / h) ** power


@inner
def note_rounding(m):
    """Raise the largest |J| |y| summed over a step, by that of an accepted step."""
    # no more counts than the reach, because damping acts on rounding too
    state, sums, kinds = m.state, m.operators.sums, m.equations.kinds
    force_scales = m.workspace.force_scales
    for c in range(kinds.shape[0]):
        state.tried[c] = np.inf
        summed = force_scales[c] * abs(sums[kinds[c], -1])
        state.scales[c] = max(state.scales[c], min(summed, max(state.reach[c], state.sizes[c])))


@inner
def allowed_error(c, value, size, is_speed, end, limits):
    """Return the tolerance of component y_c, or of y_c' if `is_speed` is 1."""
    # value: |y_c| or |y_c'|, size: that of y_c. The relative part of y' is that of y. Others are
    # those of y over the time in which the error of y' moves y: the run, or end [time] for the
    # absolute one.
    tolerance = limits.tolerance
    atol, rtol, by_size = tolerance.atol[c], tolerance.rtol, tolerance.by_size
    if is_speed == 1:
        return atol / max(1.0, end) + OF_SPEED * by_size * size / limits.t_end + rtol * value
    return atol + by_size * size + rtol * value


@inner
def error_of_young(state, c, is_speed, limits):
    """Return the error that changes nothing in young component c, or c' if `is_speed` is 1."""
    # 0 for one that is not young, or has no reach
    if state.growth[c] < np.inf:
        return 0.0
    return _OF_YOUNG * YOUNG * state.reach[c] / (limits.t_end if is_speed == 1 else 1.0)


@inner
def set_newton_tol(m, h):
    """Set the error of p that Newton's method may leave, `m.workspace.newton_tol` (d,)."""
    # A fraction of the tolerance. Where the equation for p = y' has terms of y, at least the error
    # of p by rounding of y, up to the one that changes y by its rounding over the step.
    equations, orbit = m.equations, m.orbit
    state, limits, workspace = m.state, m.limits, m.workspace
    terms, orders, above_one = equations.terms, equations.orders, equations.above_one
    newton_tol, d = workspace.newton_tol, workspace.newton_tol.shape[0]
    for c in range(d):
        far_below = above_one[c] == 0 and limits.tolerance.by_size == 0.0  # y may be, of y(0)
        size = max(0.0 if far_below else state.largest[c], abs(orbit.p[0, c]))
        newton_tol[c] = _NEWTON_TOL_FRACTION * allowed_error(
            c, size, workspace.sizes[c], above_one[c], 1.0, limits
        )
        young = error_of_young(state, c, above_one[c], limits)
        if young > 0.0:
            newton_tol[c] = min(max(newton_tol[c], _ROUNDING_OF_YOUNG * young), young)
    for n in range(terms.shape[0]):
        c, k = terms[n].row, terms[n].index
        if terms[n].integrand == POSITION and 0 <= k < orders.shape[0] and c < d:
            gain = min(abs(terms[n].coefficient) * h ** orders[k], 1 / h)
            newton_tol[c] = max(newton_tol[c], ROUNDING_OF_SUMS * abs(orbit.x[0, c]) * gain)
