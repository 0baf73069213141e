"""The march on given steps: one source, compiled once for each way of solving a step.

The solution is ``x_(n+1) = x_n + shift + w_n``. shift is x'(0) times the step's length if the
pieces leave out t x'(0), otherwise 0. A step computes its known terms and solves for w_n:

    scale w_n + near p_(n-1) + lag_n + lead forcing = lead f(t, x_n + theta (shift + w_n))

Its piece p_n is w_n, or the value of f. The piece is then added to the lags of later steps in the
same block. The history adds the pieces of earlier blocks. Explicit steps have theta = 0 and
scale = 1, and are solved for ``w_n - w_(n-1)``. This keeps rounding errors at 1e-13, where
computing x_(n+1) - 2 x_n + x_(n-1) would lose digits.

Memory that f reads has columns of its own, behind those with an equation. Such a column uses the
increments of its source, and its sum is the memory: ``scale w_n + ... = lead D^gamma x``. An
implicit step reads this memory at its own time. An explicit step computes it for the next step.
Blocks depend on absolute step numbers, so results do not depend on where a march was interrupted.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..compiled.jit import I8, as_value, entry
from ..compiled.linalg import bounded, put
from .block import (
    BLOWN_UP,
    NOT_SOLVED,
    RUNNING,
    begin_others,
    begin_start,
    open_block,
    write_row,
)
from .imex_step import solve_linearly
from .newton import guess, no_tangents_solved, solve_step, solve_tangents
from .past import read_rows
from .signatures import GIVEN_MARCH, PUSH_SIG, SOLVE_TANGENTS_SIG, GivenMarch, GivenWork
from .step import (
    add_drift,
    add_powers,
    change,
    close,
    correct,
    evaluate,
    first_value,
    keep_last_f,
    load_coefficients,
    predict,
    push_nothing,
    push_tangents,
    set_argument,
    set_argument_map,
    set_known_terms,
)
from .watch import watch_sweep, watch_turn

# Text that is shown while a march is compiled, for each way of solving a step.
_ANNOUNCED = {
    "explicit": "the march of explicit schemes",
    "newton": "the march of implicit schemes",
    "imex": "the march of implicit-explicit schemes",
    "sweeps": "the march of predictor-corrector schemes",
}


def marching(name: str, way: str) -> Callable[..., Any]:
    """Return the march, compiled as `name` for one way of solving steps, a key of `MARCHES`."""
    explicit, newton, imex = (way == name for name in ("explicit", "newton", "imex"))

    def march(march, end):
        m = march.work
        table, rows, state, workspace, memory = m.table, m.rows, m.state, m.workspace, m.memory
        h, integral, slowest = table.h, table.integral, table.slowest
        counts, x, u, d = state.counts, state.x, state.increment, state.change
        lag, pieces, groups, weights = state.lag, state.pieces, table.groups, table.weights
        theta, unit, ratio, width = rows.theta, rows.unit, rows.ratio, x.shape[0]
        f, point, row = workspace.f, workspace.point, -1
        orbit, starting = x[: table.n_orbit], table.start_weights.shape[1] > 0
        by_rows = memory.tables.room.shape[1] > 0  # inline, as a history's call would take 45 ns
        known_terms = table.powers.shape[0] > 0
        while counts.step < end:
            n = counts.step
            p, i = n % lag.shape[1], min(n - rows.first, rows.last)
            t = (n + theta[i]) * h if h > 0.0 else rows.times[i] + theta[i] * unit[i]
            if p == 0 and counts.opened != n:  # open only once, even if f raised after opening
                if by_rows:
                    read_rows(lag, pieces, n, groups, memory.tables, memory.arrays)
                else:
                    open_block(lag, pieces, n, groups, weights, memory)
                if n == 0 and integral == 0:  # step 0 itself gives the first start value
                    begin_others(m)
                elif n == 0 and not explicit:
                    evaluate(march, 0.0, x, state.last_f)
                    begin_start(m, 0, state.last_f, 0)
                counts.opened = n
            if i != row:  # uniform steps share one row of coefficients
                load_coefficients(m, i)
                row = i
            set_known_terms(m, p)
            if rows.drift.shape[1] > 0:
                add_drift(m, i)
            if known_terms or n < state.corrections.shape[1]:
                add_powers(m, n, t)
            if not explicit:
                set_argument_map(m, theta[i])
            if explicit:
                evaluate(march, t, x, f)
                change(m, n, p)
            elif newton:
                guess(m, p, ratio[i])
                if not solve_step(march, t):
                    return NOT_SOLVED
                if integral == 1:
                    set_argument(m, width)
                    evaluate(march, t, point, f)
                    put(f, state.last_f)
            elif imex:
                if not solve_linearly(m, t, i):
                    return NOT_SOLVED
            else:
                predict(m)
                set_argument(m, width)
                for _ in range(table.sweeps):
                    evaluate(march, t, point, f)
                    correct(m)
                    set_argument(m, width)
                evaluate(march, t, point, f)
                keep_last_f(m)
            close(m, n, p, ratio[i], explicit)
            for c in range(0 if explicit or newton or imex else table.n_solved):
                watch_sweep(state.monitor[c], workspace.moved[c], state.lacks[c], u[c], counts)
            for c in range(table.n_solved if slowest > 0.0 else 0):
                if (u[c] - d[c]) * u[c] < 0.0:  # a turn: the increment changed its sign
                    watch_turn(state.monitor[c], d[c], u[c], x[c], slowest, counts)
            if n == 0 and integral == 0 and starting:
                first_value(m, explicit)
                begin_start(m, 0, workspace.known, 1)
            counts.step = n + 1
            if m.output.rows.shape[0] > 0:
                write_row(m, n - m.output.first, unit[i], ratio[i])
            if not bounded(orbit):
                return BLOWN_UP
        return RUNNING

    march.__name__ = march.__qualname__ = name
    march.__doc__ = "March to step `end`; return how it ended (given/block.py)."
    return entry(GIVEN_MARCH, I8, announced=_ANNOUNCED[way], allocates=False)(march)


# Compiled marches by the way in which they solve a step (`Scheme.solve`).
MARCHES = {
    "explicit": marching("march_explicit", "explicit"),
    "newton": marching("march_newton", "newton"),
    "sweeps": marching("march_sweeps", "sweeps"),
    "imex": marching("march_imex", "imex"),
}


def march_of(work: GivenWork, way: str) -> GivenMarch:
    """Return a `GivenMarch` of work and tangents' functions; `way` is a key of `MARCHES`."""
    tangents = work.state.x.size > work.table.n_orbit
    solve = solve_tangents if tangents and way == "newton" else no_tangents_solved
    push = push_tangents if tangents else push_nothing
    return GivenMarch(work, as_value(push, PUSH_SIG), as_value(solve, SOLVE_TANGENTS_SIG))
