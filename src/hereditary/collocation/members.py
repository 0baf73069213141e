"""Members of an ensemble: marches one after the other in compiled code, over shared tables.

It is the march of `AdaptiveStepper` for equations with few components, whose memory is that of
constant orders alone, from the start to the end. A member that needs anything else is left to it.

Letters of shapes: d components, n nodes of the first step, n_t times, M modes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

import numpy as np
from numba import types

from ..compiled.delayed_values import PIECES, USED, Delays, add_step, set_value
from ..compiled.jit import (
    I8,
    Cube,
    Integers,
    Matrix,
    Vector,
    checked,
    compiled_type,
    entry,
    inner,
    loop_value,
)
from ..compiled.linalg import add_rows, all_finite, clear, put
from ..compiled.records import zeros
from ..compiled.reference import FunctionField, Reference
from ..compiled.units import set_units_of
from .edge import begins_at_edge
from .equations import Form
from .first_rule import Variable, first_rule, known_at_nodes
from .march import FULL, REACHED, TOO_CLOSE, march_adaptive, set_first_jacobian
from .mode_tables import (
    FIRST_PER_OCTAVE,
    N_TABLE_LENGTHS,
    floor_to,
    place_of,
    set_mode_weights,
)
from .modes import Modes, closest_lag, opened_once, over_step
from .operators import FORCE, PRIMARY, number_of
from .orbit import OrbitAndTangents, round_to_decades
from .singular_start import TRIAL_LENGTH_RATIO, first_length, rate_of_few
from .structures import (
    ADAPTIVE_MARCH,
    AdaptiveMarch,
    ExponentialBasis,
    FirstJacobian,
    Limits,
    OrbitArrays,
    Rule,
    Steps,
    StepTables,
)
from .tolerances import of_first_step
from .workspace import take_workspace

# How the march of a member goes on: it is at its end; the length of its first step has no place; it
# goes on with further steps; or another march has to tell how it ends.
AT_END, NO_LENGTH, MARCHING, LEFT = range(4)
# What a member has done already.
NOTHING, FIRST_STEP, BATCH = range(3)
# Most batches of steps in which a march covers what is left, at the speed of the last one.
_MOST_BATCHES = 4000
# Lengths of first steps with a place, more than a decade has.
_FIRST_LENGTHS = 256
# Decades of first lengths whose tables are kept; those of one take about 3 MB.
_MOST_PLANS = 8
# Indices of `MemberRun.counts`.
STEPS, CALLS, N_ROWS = range(3)
# Returns the number of steps, and the status.
_MARCH_SIG = types.UniTuple(I8, 2)(ADAPTIVE_MARCH)


class MemberMarch(NamedTuple):
    """The march of members, which share all arrays; K lengths of first steps have a place."""

    march: Annotated[Any, FunctionField(_MARCH_SIG)]
    start: FirstJacobian
    first: AdaptiveMarch  # of the first step
    later: AdaptiveMarch  # of all others
    lengths: Annotated[Vector, "K"]  # of first steps [time]; 0 for none
    gains: Annotated[Cube, "K n M"]  # from values at the nodes to the integral of each mode
    integrals: Annotated[Matrix, "K M"]  # that of 1
    leading: Annotated[Vector, "d"]  # coefficients of the highest orders
    offset_of: Annotated[Integers, "n"]  # constant subtracted from each integrand, as in `Form`
    values: Delays  # the last step as a polynomial, for y
    speeds: Delays  # and for p
    has_jac: int  # 1 if the Jacobian is given
    order: float  # smallest order of integration of f
    longest: float  # first step [time]
    least: float  # length that every step exceeds [time]
    at_rest: float  # longest first step of a solution at rest [time]
    shortest: float  # step for which the modes are accurate [time]


class MemberRun(NamedTuple):
    """Arguments and results of one member."""

    params: Annotated[Vector, "p"]
    y0: Annotated[Matrix, "m d"]
    times: Annotated[Vector, "n_t"]  # times of rows, from the start
    y: Annotated[Matrix, "n_t d"]
    ydot: Annotated[Matrix, "n_t d_s"]  # empty if y' is no unknown
    length: Annotated[Vector, "1"]  # of the first step [time]
    counts: Annotated[Integers, "3"]  # steps, calls of f, and rows


@entry(Reference(compiled_type(MemberMarch)), Reference(compiled_type(MemberRun)), I8)
def march_member(march, run, after):
    """March a member on after nothing, its first step or a batch; return how it goes on."""
    state = march.start.state
    if after == NOTHING:
        begin(march, run.params, run.y0)
        run.length[0] = first_step(march)
        if run.length[0] == 0.0:
            return LEFT
    if after != BATCH:
        if not begin_modes(march, run.length[0]):
            return NO_LENGTH
        run.counts[N_ROWS] = 0
        fill_rows(march, run, march.first.work, 1)
        set_step(state.control, run.length[0], run.length[0], march.shortest, 0.0)
    before, stop = state.control.time, march.later.work.limits.stop
    n_steps, status = march.march(march.later)
    fill_rows(march, run, march.later.work, n_steps)
    run.counts[STEPS], run.counts[CALLS] = state.counts.accepted, state.counts.rhs
    if state.counts.accepted > march.later.work.limits.tolerance.max_steps:
        return LEFT
    if status == FULL:
        slow = (state.control.time - before) * _MOST_BATCHES < stop - state.control.time
        return LEFT if slow else MARCHING
    return AT_END if status == REACHED else LEFT


@inner
def begin(march, params, y0):
    """Set all arrays to the start of a member with these parameters (p,) and y0 (m, d)."""
    # the state is that of a march that has not begun
    start, orbit, state = march.start, march.first.work.orbit, march.start.state
    terms, equations, units = start.equations.terms, start.equations, start.equations.units
    for k in range(params.shape[0]):
        start.right.force.functions.params[k] = params[k]
    for c in range(y0.shape[1]):
        y, size = y0[0, c], abs(y0[0, c])
        p = y0[-1, c] if equations.above_one[c] == 1 else y
        orbit.x[0, c], orbit.p[0, c], orbit.initial[0, c] = y, p, p
        state.largest[c], state.sizes[c] = abs(p), size
        state.reach[c], state.growth[c] = size, size
    if march.has_jac == 0:
        set_units_of(
            start.right.force, y0[0], march.later.work.limits.t_end, equations.rates, units
        )
        for c in range(units.shape[0]):
            units[c] = units[c] if units[c] > 0.0 else 1.0
    for n in range(terms.shape[0]):
        c, which = terms[n].row % y0.shape[1], march.offset_of[n]
        constant = orbit.p[0, c] if which == 1 else orbit.x[0, c]
        equations.offsets[0, n] = constant if which > 0 else 0.0
    clear(march.first.work.stages.control)
    clear(march.later.work.stages.control)


@inner
def set_step(control, t, h, shortest, begins):
    """Let the next step begin at time t, with the length h."""
    control.time, control.next, control.last, control.rejected = t, h, 0.0, 0.0
    control.shortest, control.begins = shortest, begins


@inner(allocates=True)
def first_step(march):
    """Solve the first step, and return its length; 0 if it is left to another march."""
    work, start = march.first.work, march.start
    state, d = start.state, start.x.shape[0]
    jacobian, reached = np.empty((d, d)), np.zeros(d)
    state.counts.rhs += 1
    set_first_jacobian(start, jacobian)
    for c in range(d):
        for k in range(d):
            reached[c] += abs(jacobian[c, k]) * start.units[k]
    if not all_finite(reached) or begins_at_edge(
        start.right.force, start.t, start.x, start.units, reached
    ):
        return 0.0
    rate, values = rate_of_few(jacobian, march.leading), work.orbit.last[0]
    h = floor_to(first_length(rate, march.order, march.longest), FIRST_PER_OCTAVE)
    while h > march.least:
        set_step(state.control, 0.0, h, h, 1.0)
        work.tables.lengths[0] = h
        _, status = march.march(march.first)
        if status == FULL:
            return 0.0 if h > march.at_rest and is_at_rest(values) else h
        if status != TOO_CLOSE:
            return 0.0
        h *= TRIAL_LENGTH_RATIO
    return 0.0


@inner
def is_at_rest(values):
    """Return whether f is 0, and p constant, at all nodes; values (n_q, d, n)."""
    for c in range(values.shape[1]):
        for i in range(values.shape[2]):
            if values[FORCE, c, i] != 0.0 or values[PRIMARY, c, i] != values[PRIMARY, c, 0]:
                return False
    return True


@inner
def begin_modes(march, h):
    """Set the modes to those at the end of a first step of length h; return if it has a place."""
    first, later = march.first.work, march.later.work
    index = place_of(h, march.lengths, FIRST_PER_OCTAVE)
    if march.lengths[index] != h:
        return False
    set_mode_weights(later.equations, later.basis.weights, later.varying.of_varying, later.weights)
    gains, integrals, values = march.gains[index], march.integrals[index], first.orbit.last[0]
    found, kinds, d = later.orbit.modes[0], later.equations.kinds, values.shape[1]
    weights, used, offsets = later.weights.integrands, later.weights.used, later.weights.offsets
    part = later.weights.part
    for c in range(found.shape[0]):
        kind = c // d * number_of(kinds) + kinds[c % d]
        for e in range(found.shape[1]):
            found[c, e] = offsets[0, c, e] * integrals[e] if offsets.shape[1] > 0 else 0.0
        for q in range(values.shape[0]):
            if used[kind, q] == 1:
                clear(part)
                add_rows(part, values[q, c % d], gains)
                for e in range(found.shape[1]):
                    found[c, e] += weights[kind, q, e] * part[e]
    return True


@inner
def fill_rows(march, run, work, n_steps):
    """Set the rows of a member within these steps."""
    steps, times, end, n = work.steps, run.times, work.limits.stop, run.counts[N_ROWS]
    if n < times.shape[0] and times[n] == 0.0:
        put(steps.at_starts[0, 0], run.y[n])
        put(steps.at_starts[0, 1], run.ydot[n])
        n += 1
    for row in range(n_steps):
        t = steps.starts[row] + steps.lengths[row]
        t = end if t + 1e-14 * end >= end else t
        if n == times.shape[0] or (times[n] > t and t < end):
            continue
        set_piece(march.values, work.rule, steps, row)
        if run.ydot.shape[1] > 0:
            set_piece(march.speeds, work.rule, steps, row)
        while n < times.shape[0] and (times[n] <= t or t == end):
            set_value(march.values, 0, times[n], True, run.y[n])
            if run.ydot.shape[1] > 0:
                set_value(march.speeds, 0, times[n], True, run.ydot[n])
            n += 1
    run.counts[N_ROWS] = n


@inner
def set_piece(pieces, rule, steps, row):
    """Set the only one of `pieces` to a row of `steps`."""
    pieces.counts[PIECES], pieces.counts[USED] = 0, 0
    add_step(pieces, rule, steps, row)


class Members:
    """Members of an ensemble: `march` marches the one of a `MemberRun`, and fills its rows."""

    def __init__(
        self, form: Form, orbit: OrbitAndTangents, rule: Rule, start: FirstJacobian,
        run: MemberRun, how: tuple[float, float, float], n_steps: int,
        marching: Callable[..., AdaptiveMarch], **numbers: Any,
    ) -> None:  # fmt: skip
        # how: largest time lags of the modes and of the run, and the modes' error; n_steps: of a
        # batch; marching(steps, limits, rule, basis, tables, arrays, workspace): a march; numbers:
        # further fields of `MemberMarch`
        self._form, self._orbit, self._rule, self._how = form, orbit, rule, how
        self._run, self._marching, self._start = checked(run), marching, start
        self._batch = n_steps
        owners: Any = (a if a.dtype.names is None else a.base for a in start.state)
        self._state = [(owner, owner.copy()) for owner in owners]
        self._plans: dict[float, tuple[MemberMarch, Modes]] = {}
        variable = self._variable = Variable.of(form.generators)
        n, s = variable.n, rule.nodes.size
        of_first = of_first_step(start.limits.tolerance, variable.q)
        limits = start.limits._replace(tolerance=checked(of_first))
        basis, tables = known_at_nodes(n, form.orders.size, 0)
        tables = tables._replace(lengths=np.zeros(1))
        first = first_rule(variable, form.powers), basis, tables, self._arrays(n, n)
        values, speeds = (_piece(a, max(n, s) + 1) for a in (form.above_one, 0 * form.above_one))
        self._shared = numbers | {
            "march": loop_value(march_adaptive, _MARCH_SIG),
            "start": start,
            "first": self._of(1, n, limits, *first),
            "offset_of": form.offset_of,
            "values": values,
            "speeds": speeds,
        }
        self._last = self._plan(floor_to(numbers["longest"], FIRST_PER_OCTAVE))

    def _arrays(self, n_modes: int, n: int) -> OrbitArrays:
        """Return the arrays of a march with so many modes, and steps of n nodes."""
        orbit, form = self._orbit, self._form
        modes, last = np.zeros((1, form.n_rows, n_modes)), np.zeros((1, 3, orbit.x.shape[1], n))
        return OrbitArrays(orbit.initial, orbit.x, orbit.p, modes, modes.copy(), last)

    def _of(
        self, n_steps: int, s: int, limits: Limits, rule: Rule, basis: ExponentialBasis,
        tables: StepTables, arrays: OrbitArrays,
    ) -> AdaptiveMarch:  # fmt: skip
        """Return the march of steps with s nodes, at most `n_steps` at once."""
        steps = zeros(Steps, n=n_steps, D=self._start.units.size, s=s)
        workspace = take_workspace(self._form, arrays.modes, s, True)[1]
        return self._marching(steps, limits, rule, basis, tables, arrays, workspace)

    def _plan(self, h: float) -> MemberMarch:
        """Return the march of members whose first step has the length h."""
        farthest, known, tol = self._how
        closest = round_to_decades(closest_lag(self._rule, h), farthest)
        if closest not in self._plans:
            if len(self._plans) == _MOST_PLANS:
                self._plans.clear()
            s = self._rule.nodes.size
            modes = opened_once(self._form, s, closest, farthest, known, tol)
            n_modes = modes.of_varying.size
            tables = checked(zeros(StepTables, K=N_TABLE_LENGTHS, M=n_modes, s=s, n_k=0))
            later = self._of(
                self._batch, s, self._start.limits, self._rule, modes.basis, tables,
                self._arrays(n_modes, s),
            )  # fmt: skip
            first = np.zeros((_FIRST_LENGTHS, self._variable.n, n_modes))
            fields = {"later": later, "shortest": closest / self._rule.nodes[0], "gains": first}
            fields |= {"lengths": np.zeros(len(first)), "integrals": first[:, 0].copy()}
            self._plans[closest] = checked(MemberMarch(**self._shared, **fields)), modes
        march, modes = self._plans[closest]
        place = place_of(h, march.lengths, FIRST_PER_OCTAVE)
        step = over_step(modes.bank, self._variable, h)
        march.gains[place], march.integrals[place] = step.gains, step.integrals
        march.lengths[place] = h
        self._last = march
        return march

    def march(self, asked: Callable[[], bool]) -> int:
        """March the member of the run; return `AT_END`, `LEFT`, or `MARCHING` if that is asked."""
        run = self._run
        for now, at_start in self._state:
            now[...] = at_start
        ended = march_member(self._last, run, NOTHING)
        if ended == NO_LENGTH:
            ended = march_member(self._plan(float(run.length[0])), run, FIRST_STEP)
        while ended == MARCHING and not asked():
            ended = march_member(self._last, run, BATCH)
        return ended


def _piece(by_means: np.ndarray, width: int) -> Delays:
    """Return a record of one piece with so many coefficients; by_means (d,) as in `Delays`."""
    arrays = np.zeros(by_means.size * width), np.zeros(1), np.zeros(width)
    made = zeros(Delays, k=0, n=0, m=1, d=by_means.size)._replace(by_means=by_means)
    return made._replace(**dict(zip(("numbers", "read_at", "polynomials"), arrays, strict=True)))
