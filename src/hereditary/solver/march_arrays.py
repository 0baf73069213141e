"""Arrays of a march on given steps, from the plan of its scheme."""

import numpy as np

from ..compiled.signatures import COUNTS, MONITOR, March, StepTable
from ..compiled.step import N_ROOM, UNITS
from ..compiled.structures import record


def step_table(plan, memory, system, sources, every, h):
    """Make the coefficients of all steps; `sources` (W,) are of `system` and its tangents.

    A Jacobian is kept every so many steps; h is 0 on a mesh.
    """
    width = plan.groups.size
    return StepTable(
        h=h,
        slowest=plan.slowest,
        sweeps=plan.sweeps,
        integral=int(plan.integral),
        n_orbit=system.d,
        n_solved=int(np.sum(~system.read)),
        every=every,
        groups=plan.groups,
        sources=sources,
        given=np.zeros(width, dtype=np.int64) if plan.given is None else plan.given,
        weights=memory.block_weights,
        start_weights=memory.block_start_weights,
        powers=np.zeros((0, width)) if plan.powers is None else plan.powers,
    )


def initial_march(plan, d, n_block, newton, columns=slice(None)):
    """State of a march at step 0, with d components of the orbit and blocks of `n_block` steps.

    `newton` is the room of Newton's method for many components; `columns` are those of the plan.
    """
    x = plan.initial[columns].copy()
    width = x.size
    none = np.zeros((0, plan.initial.size))
    return March(
        counts=record(COUNTS, zigzag=-1, opened=-1, growth=-1),
        x=x,
        increment=plan.increments[columns].copy(),
        change=np.zeros(width),
        lag=np.zeros((width, n_block)),
        pieces=np.zeros((width, n_block + 1)),
        monitor=np.zeros(d, MONITOR).view(np.recarray),
        shift=plan.shift[columns].copy(),
        drift=_by_columns(plan.drift, none, columns),
        corrections=_by_columns(plan.corrections, none, columns),
        starts=_by_columns(plan.starts, none, columns),
        force=np.zeros(width),
        lacks=np.zeros(width),
        newton=newton,
    )


def renew_force(system, t, table, march):
    """Let the newest piece be f behind a jump of y at time t, where pieces are values of f.

    Of components of order 1 alone, whose last step keeps what it made of the old one. Where f
    raises the march meets it again, and keeps what was computed.
    """
    n, newest = table.n_orbit, int(march.counts["step"]) - 1
    if table.integral == 0 or newest < 0:
        return
    march.counts["rhs"] += 1
    try:
        force = system.force(t, march.x[:n])
    except Exception:
        return
    own = table.sources[:n] == np.arange(n)  # memory that f reads has increments for pieces
    p, first_order = newest % march.lag.shape[1], own & (system.highest_orders()[:n] == 1)
    jump = np.where(first_order, force - march.pieces[:n, p + 1], 0.0)
    march.pieces[:n, p + 1] += jump
    march.force[:n] = np.where(first_order, force, march.force[:n])
    ahead = march.lag[:n, p + 2 :]
    ahead += table.weights[table.groups[:n], 2 : 2 + ahead.shape[1]] * jump[:, None]


def room_of_step(march, units):
    """Return room for one step of a march, whose components have these units, (d,)."""
    room = np.empty((N_ROOM, march.x.size))
    room[UNITS, : units.size] = units
    return room


def restored_march(kept):
    """Return the `March` whose parts were stored as arrays of numbers."""
    counts, *parts = kept
    march = March(record(COUNTS, tuple(counts[0])), *(part.copy() for part in parts))
    monitor = np.array([tuple(row) for row in march.monitor], MONITOR)
    return march._replace(monitor=monitor.view(np.recarray))


def linear_parts(march):
    """Return the arrays of a march that are linear in the solution."""
    others = {id(part) for part in (march.counts, march.monitor, march.newton)}
    return [part for part in march if id(part) not in others]


def _by_columns(rows, none, columns):
    """Copy columns of rows (k, W), as (W, k)."""
    return np.array((none if rows is None else rows)[:, columns].T, order="C")
