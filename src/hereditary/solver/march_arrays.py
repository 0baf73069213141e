"""Arrays of a march on given steps, from the plan of its scheme."""

import numpy as np

from ..compiled.signatures import COUNTS, MONITOR, March, StepTable
from ..compiled.structures import record


def step_table(plan, memory, system, sources, every, h):
    """Coefficients that all steps share; `sources` (W,) are those of `system` and of its tangents.

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
        limits=np.zeros(width) if plan.limits is None else plan.limits,
        powers=np.zeros((0, width)) if plan.powers is None else plan.powers,
    )


def initial_march(plan, d, n_block):
    """State of a march at step 0, with d components of the orbit and blocks of `n_block` steps."""
    width = plan.groups.size
    none = np.zeros((0, width))
    return March(
        counts=record(COUNTS, zigzag=-1, opened=-1, growth=-1),
        x=plan.initial.copy(),
        increment=plan.increments.copy(),
        change=np.zeros(width),
        lag=np.zeros((width, n_block)),
        pieces=np.zeros((width, n_block + 1)),
        monitor=np.zeros(d, MONITOR).view(np.recarray),
        shift=plan.shift.copy(),
        drift=_by_columns(plan.drift, none),
        first=np.zeros(width) if plan.first is None else plan.first.copy(),
        corrections=_by_columns(plan.corrections, none),
        starts=_by_columns(plan.starts, none),
        force=np.zeros(width),
        lacks=np.zeros(width),
    )


def _by_columns(rows, none):
    """Copy rows, (k, W), as columns (W, k)."""
    return np.array((none if rows is None else rows).T, order="C")
