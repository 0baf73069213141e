"""The march on given steps: one source, compiled apart for each way of solving a step.

Here ``x_(n+1) = x_n + shift + w_n``, with shift = x'(0) times the step's length where the pieces
leave it out. Every step is opened, which gives what is known of it, solved for w_n,

    scale w_n + near p_(n-1) + lag_n + lead forcing = lead f(t, x_n + theta (shift + w_n)),

and closed: the piece p_n, which is w_n or the value of f, is spread over the steps ahead in its
block. The history adds what is older than a block. The explicit step, theta = 0 and scale = 1, is
solved for ``w_n - w_(n-1)``. So rounding stays at 1e-13 where x_(n+1) - 2 x_n + x_(n-1) would lose
it.

Memory that f reads stands in columns behind those with an equation. They take the increments of
their sources, so what these columns know of a step is the derivative: ``scale w_n + ... = lead
D^gamma x``. It is read at the step's own time, or, in an explicit step, left for the next one. All
arithmetic hangs on absolute step numbers, so a march does not depend on where it was interrupted.

Arrays of every step are named here one by one: to hand groups of them to functions takes longer
than most steps do.
"""

from ..compiled.jacobian import evaluate, jacobian, push_tangents
from ..compiled.jit import entry
from ..compiled.linalg import put
from .block import (
    BLOWN_UP,
    NOT_SOLVED,
    RUNNING,
    begin_others,
    begin_start,
    bounded,
    keep_jacobian,
    open_block,
    write_row,
)
from .newton import guess, solve_linearly, solve_step
from .past import read_rows
from .signatures import MARCH
from .step import (
    BASE,
    GAIN,
    KNOWN,
    LEAD,
    MOVED,
    NEAR,
    POINT,
    SCALE,
    SHIFT,
    UNITS,
    F,
    W,
    add_drift,
    add_powers,
    change,
    close,
    correct,
    first_value,
    know,
    look,
    predict,
    see,
    settle,
    take_row,
)
from .watch import watch_turn

_WAYS = {
    "explicit": "explicit", "newton": "implicit", "imex": "implicit-explicit",
    "sweeps": "predictor-corrector",
}  # fmt: skip


def marching(name, way):
    """Compile the march for one way of solving a step: "explicit", "newton", "imex" or "sweeps"."""
    explicit, newton, imex = (way == name for name in ("explicit", "newton", "imex"))

    def march(rhs, jac, has_jac, params, exchange, tables, memory, solver, linear, table, rows,
              state, output, end):  # fmt: skip
        h, groups, weights, every = table.h, table.groups, table.weights, table.every
        counts, x, u, d, lag = state.counts, state.x, state.increment, state.change, state.lag
        pieces, force, lacks, speed = state.pieces, state.force, state.lacks, state.shift
        theta, unit, length, ratio = rows.theta, rows.unit, rows.length, rows.ratio
        leads, nears, scales, drifts = rows.lead, rows.near, rows.scale, rows.drift
        n_solved, n_orbit, start_weights = table.n_solved, table.n_orbit, table.start_weights
        amplitudes, corrections, sources = state.drift, state.corrections, table.sources
        starts, start, integral = state.starts, memory.starts, table.integral
        room, work, monitor, given = output.room, state.newton, state.monitor, table.given
        known, shift, scale, lead = room[KNOWN], room[SHIFT], room[SCALE], room[LEAD]
        near, w, f, n_starts = room[NEAR], room[W], room[F], max(1, starts.shape[1])
        point, base, gain, moved = room[POINT], room[BASE], room[GAIN], room[MOVED]
        units = room[UNITS]
        orbit, f_orbit, looked, row = x[:n_orbit], f[:n_orbit], point[:n_orbit], -1
        first_sample = (output.first + every - 1) // every if every > 0 else 0
        by_rows = tables.room.shape[1] > 0  # a call for each step would take 45 ns
        rows_out, slopes, first, j_f = output.rows, output.slopes, output.first, work[-1]
        while counts.step < end:
            n = counts.step
            p, i = n % lag.shape[1], min(n - rows.first, rows.last)
            t = (n + theta[i]) * h if h > 0.0 else rows.times[i] + theta[i] * unit[i]
            if p == 0 and counts.opened != n:  # the right-hand side may have raised since
                if by_rows:
                    read_rows(lag, pieces, n, groups, tables, memory)
                else:
                    open_block(lag, pieces, n, groups, weights, exchange, tables, memory)
                if n == 0 and integral == 0:  # the first start value waits for the step; p = 0
                    begin_others(starts, known, p, n_starts, groups, start_weights, lag, start)
                elif n == 0 and not explicit:
                    evaluate(rhs, jac, has_jac, params, 0.0, n_orbit, x, units, j_f, force, counts)
                    begin_start(p, force, p, n_starts, groups, start_weights, lag, start)
                counts.opened = n
            if every > 0 and n % every == 0:
                keep_jacobian(rhs, jac, has_jac, params, n * h, orbit, n // every - first_sample,
                              output, counts)  # fmt: skip
            if i != row:  # uniform steps share one
                take_row(i, groups, length, speed, leads, nears, scales, shift, lead, near, scale)
                row = i
            know(p, near, lag, pieces, known)
            if drifts.shape[1] > 0:
                add_drift(i, groups, drifts, speed, amplitudes, known)
            if table.powers.shape[0] > 0 or n < corrections.shape[1]:
                add_powers(n, t, amplitudes, table.powers, corrections, lead, known)
            if not explicit:
                see(theta[i], sources, x, shift, scale, known, lead, base, gain)
            if explicit:
                rhs(t, orbit, f_orbit, params)
                counts.rhs += 1
                if x.shape[0] > n_orbit:
                    counts.rhs += jacobian(rhs, jac, has_jac, t, orbit, params, units, j_f)
                    push_tangents(n_orbit, j_f, x, f)
                change(n, p, given, lead, known, shift, f, u, pieces, w, d)
            elif newton:
                guess(p, integral, ratio[i], lead, known, force, pieces, w)
                if not solve_step(rhs, jac, has_jac, params, t, n_solved, sources, room, looked,
                                  f_orbit, work, counts, solver, linear):  # fmt: skip
                    return NOT_SOLVED
                if integral == 1:
                    look(base, gain, sources, w, point)
                    evaluate(rhs, jac, has_jac, params, t, n_orbit, point, units, j_f, f, counts)
                    put(f, force)
            elif imex:
                if not solve_linearly(rhs, jac, params, t, i, rows, x, sources, force, room, work,
                                      counts, solver, linear):  # fmt: skip
                    return NOT_SOLVED
            else:
                predict(lead, known, force, lacks, w)
                look(base, gain, sources, w, point)
                for _ in range(table.sweeps):
                    evaluate(rhs, jac, has_jac, params, t, n_orbit, point, units, j_f, f, counts)
                    correct(lead, known, f, lacks, w, moved)
                    look(base, gain, sources, w, point)
                evaluate(rhs, jac, has_jac, params, t, n_orbit, point, units, j_f, f, counts)
                settle(lead, f, force, lacks)
            close(p, n, explicit, integral, ratio[i], groups, sources, weights, given, shift, known,
                  lead, base, gain, w, f, x, u, d, lag, pieces)  # fmt: skip
            for c in range(n_solved if table.slowest > 0.0 else 0):
                if (u[c] - d[c]) * u[c] < 0.0:  # a turn of the increments
                    watch_turn(monitor[c], d[c], u[c], x[c], table.slowest, counts)
            if n == 0 and integral == 0 and start_weights.shape[1] > 0:
                first_value(explicit, starts, w, known)
                begin_start(p, known, p + 1, n_starts, groups, start_weights, lag, start)
            counts.step = n + 1
            if rows_out.shape[0] > 0:
                write_row(n - first, rows_out, slopes, x, u, d, unit[i], ratio[i])
            if not bounded(orbit):
                return BLOWN_UP
        return RUNNING

    march.__name__ = march.__qualname__ = name
    march.__doc__ = "March to step `end`; return how it ended (given/block.py)."
    announced = f"the march of {_WAYS[way]} schemes"
    return entry(*MARCH, announced=announced, counted=False)(march)


MARCHES = {
    "explicit": marching("march_explicit", "explicit"),
    "newton": marching("march_newton", "newton"),
    "sweeps": marching("march_sweeps", "sweeps"),
    "imex": marching("march_imex", "imex"),
}
