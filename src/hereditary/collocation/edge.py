"""First steps from an edge: f is finite along the solution, its slope by y is infinite at y(0).

An example is an empty tank whose inflow begins at 0: ``D^a y = t - sqrt(y)``. No first step is so
short that its equations are nearly linear. So the equations are solved by a damped Newton's method
with a Jacobian at each node, from a point next to y(0). The distance of y from y(0) changes its
sign nowhere, and has a small relative error at each node.

Letters of shapes as in newton.py: d components, s nodes.
"""

import numpy as np

from ..compiled.functions import set_force
from ..compiled.jacobian import LEAST, magnitudes
from ..compiled.jit import F8, VEC, entry, inner
from ..compiled.linalg import clear_matrix, put, solve_in_place
from ..compiled.signatures import RIGHT_SIDE
from .newton import factorise_newton, forces, positions, residuals, solve_newton
from .operators import FORCE, POSITION, PRIMARY
from .structures import LENGTH

# Largest number of Newton iterations. The distance from the edge grows from 1e-200 by a power in
# each of them: for a slope like y^-0.7, fifteen iterations are needed.
_EDGE_NEWTON_MAXITER = 60
# Least ratio of the distance from the edge to the one before an iteration.
_MIN_DISTANCE_RATIO = 1e-3
# Ratio of successive distances from the edge in the search of one above the solution, and the
# largest of them.
_ABOVE = 10.0
_LARGEST_ABOVE = 1e100
# Relative change of the distance from the edge at which the iterations end. They converge
# quadratically, so its square remains.
_EDGE_NEWTON_RTOL = 1e-5
# Increment of difference quotients, as fraction of the distance from the edge.
_EDGE_INCREMENT = 1e-6
# Least increment of difference quotients, as fraction of y.
_MIN_EDGE_INCREMENT = 1e-10
# Rounding error of y, as fraction of y.
_ROUNDING_OF_EDGE = 2e-16
# Change of f, and of y, that the iterations may leave, as fraction of its largest value times rtol.
_EDGE_TOL_FRACTION = 1e-2
# Increments at which slopes are compared, as fractions of the units of components.
_INCREMENTS = 1e-5, 1e-9
# Ratio of the slopes at these increments from which a slope is infinite: it is 2.5 for y^0.9.
_INFINITE_SLOPE_RATIO = 2.0
# Ratio of the changes of f over these increments from which f jumps: it is 0.4 for y^0.1.
_JUMP_CHANGE_RATIO = 0.5


@inner(allocates=True)
def begins_at_edge(force, t, y, units, reached):
    """Return whether f is small at y, and its slope by a component that is 0 is infinite."""
    # f is small if it is less than its changes over increments of y (d,). units (d,): sizes of
    # components; reached (d,): |J| units for the Jacobian J at (t, y), which may be infinite.
    d, (far, near) = y.shape[0], _INCREMENTS
    f, moved, point, steep = np.empty(d), np.empty(d), y.copy(), np.empty((2, d))
    set_force(force, t, y, f)
    small = False
    for c in range(d):
        small = small or not abs(f[c]) > far * reached[c]
    for j in range(d if small else 0):
        clear_matrix(steep)
        for side in range(4 if y[j] == 0.0 else 0):
            increment = (far if side < 2 else near) * units[j]
            point[j] = increment if side % 2 == 0 else -increment
            set_force(force, t, point, moved)
            for c in range(d):
                change = abs(moved[c] - f[c])
                if change < np.inf:
                    steep[side // 2, c] = max(steep[side // 2, c], change)
        point[j] = y[j]
        for c in range(d):
            infinite = _INFINITE_SLOPE_RATIO * near / far * steep[0, c] < steep[1, c]
            jumps = not steep[1, c] < _JUMP_CHANGE_RATIO * steep[0, c]
            if infinite and not jumps and abs(f[c]) < steep[0, c]:
                return True
    return False


@entry(RIGHT_SIDE, F8, VEC, VEC, VEC)
def edge_at(right, t, y, units, reached):
    """Return `begins_at_edge`; this is the entry for Python."""
    return begins_at_edge(right.force, t, y, units, reached)


@inner(allocates=True)
def solve_at_edge(m, h):
    """Solve a first step of length h for p and y at the nodes; return if the method converged."""
    # as `solve_stages`, with f at the last y
    workspace, x_start, values = m.workspace, m.orbit.x[0], m.workspace.values[0]
    f, p, x = values[FORCE], values[PRIMARY], values[POSITION]
    d, s = p.shape
    jacobians, done = m.stages.jacobians, False
    for attempt in range(2):
        for c in range(d):
            for i in range(s):
                p[c, i] = m.orbit.p[0, c]
        positions(m, h, p, x_start, x)
        if attempt == 0:
            begin_above(m, x)
        for _ in range(_EDGE_NEWTON_MAXITER):
            m.state.counts.rhs += s
            reflect(x_start, x)
            set_primary(m, h, x, p)
            if done or not forces(m, x, f):
                break
            for i in range(s):
                slopes_at_node(m, i, x, f, jacobians[i])
            if not factorise_newton(m, h, p, jacobians):
                break
            residuals(m, workspace.base[0], p, x, f)
            solve_newton(m)
            done = take_limited_change(m, h, p, x, f)
            set_primary(m, h, x, p)
        if done:
            break
    for c in range(d):
        workspace.point[c] = x[c, s - 1]
    magnitudes(jacobians[s - 1], workspace.point, workspace.force_scales)
    magnitudes(jacobians[s - 1], workspace.starts, workspace.start_scales)
    m.stages.control[LENGTH] = h
    return done


@inner
def begin_above(m, x):
    """Move y = x (d, s) from an edge at 0 to where f carries it less far in the step."""
    # Where f grows like sqrt(y), the solution lies between. From there Newton's method converges;
    # from the edge it would go back. If f leads down, y is below 0.
    point, f, sums = m.workspace.point, m.workspace.f_at_point, m.operators.sums
    d, s = x.shape
    for c in range(d):
        if m.orbit.x[0, c] != 0.0:
            continue
        for e in range(d):
            point[e] = m.orbit.x[0, e]
        side, size, moved = 1.0, LEAST, 0.0
        while not 0.0 < moved <= size and (size < _LARGEST_ABOVE or side > 0.0):
            side, size = (side, _ABOVE * size) if size < _LARGEST_ABOVE else (-1.0, LEAST)
            point[c] = side * size
            set_force(m.right.force, m.workspace.times[s - 1], point, f)
            m.state.counts.rhs += 1
            moved = side * sums[m.equations.kinds[c], -1] * f[c]
        for i in range(s if 0.0 < moved <= size else 0):
            x[c, i] = side * size


@inner
def slopes_at_node(m, i, x, f, out):
    """Set `out` (d, d) to the Jacobian of f at node i, by differences away from the edge."""
    # x, f (d, s) are y and f at the nodes; where f is not finite on that side of y(0), the other
    # side is taken
    workspace, x_start = m.workspace, m.orbit.x[0]
    point, f_at_point, t = workspace.point, workspace.f_at_point, workspace.times[i]
    for c in range(point.shape[0]):
        point[c] = x[c, i]
    for e in range(point.shape[0]):
        moved = x[e, i] - x_start[e]
        width = max(_EDGE_INCREMENT * abs(moved), max(_MIN_EDGE_INCREMENT * abs(x[e, i]), LEAST))
        width = -width if moved < 0.0 else width
        for _ in range(2):
            point[e] = x[e, i] + width
            set_force(m.right.force, t, point, f_at_point)
            m.state.counts.rhs += 1
            finite = True
            for c in range(point.shape[0]):
                out[c, e] = (f_at_point[c] - f[c, i]) / (point[e] - x[e, i])
                finite = finite and abs(f_at_point[c]) < np.inf
            if finite:
                break
            width = -width
        point[e] = x[e, i]


@inner
def reflect(x_start, x):
    """Move y = x (d, s) at each node to the side of y(0) where it is at the last node."""
    # At the first nodes rounding decides the side, since powers of t are smallest there. An f like
    # sqrt(max(y, 0)) is finite on the wrong side, but has no slope there.
    for c in range(x.shape[0]):
        beyond = x[c, -1] < x_start[c]
        for i in range(x.shape[1]):
            if (x[c, i] < x_start[c]) != beyond:
                x[c, i] = 2.0 * x_start[c] - x[c, i]


@inner
def take_limited_change(m, h, p, x, f):
    """Subtract Newton's `m.workspace.change` from y = x (d, s); return if it is small."""
    # The distance of y from y(0) keeps its sign, and decreases to a thousandth at most. p and f (d,
    # s) are those before the change.
    above_one, integral = m.equations.above_one, m.rule.integrals[m.equations.orders.shape[0] - 1]
    x_start, change, (d, s), small = m.orbit.x[0], m.workspace.change, p.shape, True
    for c in range(d):
        speed, largest = 0.0, 0.0
        for i in range(s):
            speed = max(speed, abs(p[c, i])) if above_one[c] == 1 else 0.0
            largest = max(largest, abs(x[c, i] - x_start[c]))
        for i in range(s):
            moved = change[c * s + i]
            if above_one[c] == 1:
                moved = 0.0
                for j in range(s):
                    moved += h * integral[i, j] * change[c * s + j]
            before = x[c, i] - x_start[c]
            after = before - moved
            if before != 0.0 and after / before < _MIN_DISTANCE_RATIO:
                after = _MIN_DISTANCE_RATIO * before
            x[c, i] = x_start[c] + after
            moved = abs(before - after)
            rounding = _ROUNDING_OF_EDGE * (abs(x_start[c]) + h * m.rule.nodes[i] * speed)
            if moved > max(_EDGE_NEWTON_RTOL * abs(after), rounding + LEAST):
                small = small and moved <= _EDGE_TOL_FRACTION * m.limits.tolerance.rtol * largest
                small = small and is_small(m, c, i, moved, f)
    return small


@inner
def is_small(m, c, i, moved, f):
    """Return whether a change of component c at node i changes f by a part of its tolerance."""
    slopes, small = m.stages.jacobians[i], True
    for e in range(f.shape[0]):
        largest = 0.0
        for j in range(f.shape[1]):
            largest = max(largest, abs(f[e, j]))
        allowed = _EDGE_TOL_FRACTION * m.limits.tolerance.rtol * largest
        small = small and abs(slopes[e, c]) * moved <= allowed
    return small


@inner(allocates=True)
def set_primary(m, h, x, p):
    """Set p (d, s) at the nodes to y = x (d, s), or to y', whose integral is y - y(0)."""
    above_one, integral = m.equations.above_one, m.rule.integrals[m.equations.orders.shape[0] - 1]
    (d, s), x_start = p.shape, m.orbit.x[0]
    matrix, slopes = np.empty((s, s)), np.empty(s)
    for c in range(d):
        if above_one[c] == 0:
            put(x[c], p[c])
            continue
        for i in range(s):
            node = m.rule.nodes[i]
            slopes[i] = (x[c, i] - x_start[c]) / (h * node)
            for j in range(s):
                matrix[i, j] = integral[i, j] / node
        solve_in_place(matrix, slopes)
        put(slopes, p[c])
