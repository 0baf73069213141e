"""Records of marches on given steps, and what marches and histories exchange.

A march advances in blocks of B steps over W columns. Between two blocks it hands the finished
block's pieces to the history and gets the lag of everything older than the next one. Every history
offers one such function, with its own tables and memory behind it as 2-D arrays. So marches and
histories are compiled once each and pair freely.
"""

from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
from numba import from_dtype, types

from ..compiled.jit import F8, I8, IVEC, MAT, VEC, Cube, Integers, Matrix, Vector, compiled_type
from ..compiled.reference import FunctionField, Reference
from ..compiled.signatures import SOLVER_SIG, LinearSolver, RightSide

_EMPTY = np.zeros((1, 0))


class Tables(NamedTuple):
    """Tables of a memory; each history sets the tables that it reads (given/past.py).

    - first, rows: the first step with its own rows, and the number of rows of each group.
    - length: the number of pieces, of modes of one kind, or of real rates.
    - weights, start_weights: weights of pieces or modes, and of start values.
    - keep, take, ahead: factors of a mode and of a new piece in a step; powers of `keep`.
    - corrections: corrections of the first weights.
    - derivatives, amplitudes, room: of steps with their own rows, the derivatives in the terms,
      amplitudes of modes, and working storage.
    """

    first: int = 0
    rows: int = 1
    length: int = 0
    weights: Matrix = _EMPTY
    start_weights: Matrix = _EMPTY
    keep: Matrix = _EMPTY
    take: Matrix = _EMPTY
    ahead: Matrix = _EMPTY
    corrections: Matrix = _EMPTY
    derivatives: Matrix = _EMPTY
    amplitudes: Matrix = _EMPTY
    room: Matrix = _EMPTY


class Held(NamedTuple):
    """Contents of a memory for each of W columns, all linear in the solution.

    - pieces, modes (W, .).
    - starts (W, .): start values or their modes, which the march sets.
    - pending (W, .): sums for later steps.
    """

    pieces: Matrix
    modes: Matrix
    starts: Matrix
    pending: Matrix


def held(n_columns, pieces=0, modes=0, starts=0, pending=0):
    """Return a `Held` of zeros with these numbers of entries for each column."""
    return Held(*(np.zeros((n_columns, size)) for size in (pieces, modes, starts, pending)))


# References to the tables of a history, and to the contents of its memory.
HISTORY_TABLES = Reference(compiled_type(Tables))
MEMORY = Reference(compiled_type(Held))
# lag (W, B), pieces (W, B + 1), first step of the block, group of each column (W,), tables, memory:
# takes all pieces but the last into memory (none at step 0), adds to lag
EXCHANGE_SIG = types.void(MAT, MAT, I8, IVEC, HISTORY_TABLES, MEMORY)


class MarchMemory(NamedTuple):
    """The memory of a march: the function of its history, its tables and contents."""

    exchange: Annotated[Any, FunctionField(EXCHANGE_SIG)]
    tables: Tables
    arrays: Held


# Counts of a march.
MARCH_COUNTS = np.dtype(
    [
        ("step", "i8"),  # steps made
        ("zigzag", "i8"),  # step at which a zigzag had lasted, -1 for none
        ("opened", "i8"),  # step whose block is open
        ("rhs", "i8"),  # calls of the right-hand side
        ("growth", "i8"),  # step at which turns had grown, -1 for none
        ("kept", "i8"),  # whether the Jacobian of an earlier step and its factors are kept
        ("at_once", "i8"),  # whether these factors solve a linear step at once
        ("renewed", "i8"),  # steps that still need a Jacobian of their own
        ("factorised", "i8"),  # matrices that were factorised
    ],
    align=True,
)


# Watches of each component (given/watch.py).
MONITOR = np.dtype(
    [
        ("alternating", "f8"),  # length of the present alternation
        ("largest", "f8"),  # largest increment of its present batch
        ("before", "f8"),  # largest increment of the batch before
        ("turned", "f8"),  # step of the last turn, where increments change sign
        ("change", "f8"),  # change of increments there
        ("growth", "f8"),  # growth of these changes
        ("least", "f8"),  # smallest increment of the present short batch
        ("most", "f8"),  # largest increment of the present short batch
        ("turns", "f8"),  # turns in quick succession, -1 where they may last
        ("turning", "f8"),  # largest change in the present batch of turns
        ("turning_before", "f8"),  # largest change in the batch of turns before
    ],
    align=True,
)


Counts: TypeAlias = Annotated[np.record, from_dtype(MARCH_COUNTS)]


Monitors: TypeAlias = Annotated[np.ndarray, types.Array(from_dtype(MONITOR), 1, "C")]


class StepTable(NamedTuple):
    """Coefficients that all steps of a run share, for W columns in C groups and blocks of B steps.

    - h: the step, 0 on a mesh; sweeps: corrections of a predictor.
    - slowest: the most steps between two turns that are watched (0: none).
    - integral: whether pieces are values of f instead of increments.
    - n_orbit: components of the orbit, which are the first columns. The first n_solved of them have
      an equation; the others are memory that f reads.
    - every: steps between two Jacobians that are kept (0: none).
    - groups (W,); sources (W,): the column whose increments each column uses.
    - given (W,): whether the first increment is given.
    - weights (C, B + 2), start_weights (V C, B + 2): inside a block.
    - powers (r, W): of the known terms.
    """

    h: float
    slowest: float
    sweeps: int
    integral: int
    n_orbit: int
    n_solved: int
    every: int
    groups: Integers
    sources: Integers
    given: Integers
    weights: Matrix
    start_weights: Matrix
    powers: Matrix


class StepRows(NamedTuple):
    """Coefficients of single steps: those of step n are row ``min(n - first, last)``.

    Uniform steps share their last row. On meshes, and if orders vary, every step has its own.

    - times (R,): start times of the steps; empty on uniform steps.
    - theta (R,): the fraction of a step at which the equation holds.
    - unit (R,): step sizes [time]; length (R,): step sizes in the unit of shift.
    - ratio (R,): a step size over the one before.
    - lead, near, scale (C, R): factors of f, of the newest piece and of the increment.
    - drift: factors of shift, (C, R) or (C, 0). If terms use x(0), its factors follow, (2 C, R).
    """

    first: int
    last: int
    times: Vector
    theta: Vector
    unit: Vector
    length: Vector
    ratio: Vector
    lead: Matrix
    near: Matrix
    scale: Matrix
    drift: Matrix

    @property
    def shared(self) -> bool:
        """Whether all steps but the first have one row."""
        return self.last == 1

    @property
    def alike(self) -> bool:
        """Whether all steps are solved with the same matrix."""
        each = (self.theta[None], self.lead, self.scale)
        return self.shared and all(np.all(part == part[:, :1]) for part in each)


class March(NamedTuple):
    """State of a march; all but counts, monitor and newton is linear in the solution.

    The W columns are the components of the orbit, then those of each tangent.

    - x, increment, change (W,): the solution, with memory that an explicit step reads; the newest
      increment; its change.
    - lag (W, B), pieces (W, B + 1): of the open block.
    - monitor (d,): records.
    - shift (W,): x'(0) times the unit of lengths, which pieces do not include.
    - drift (W, r): amplitudes of known terms, or x(0) if rows have factors for it.
    - corrections (W, k): of the right-hand side in the first steps; starts (W, V): start values.
    - force (W,): the newest right-hand side; lacks (W,): lead times its change in the last sweep.
    - newton (2, ., .): a Jacobian and room for Newton's matrix, or the matrix whose factors are
      kept, for many components (given/newton.py). (3, ., .) with room for the tangents' matrix.
    """

    counts: Counts
    x: Vector
    increment: Vector
    change: Vector
    lag: Matrix
    pieces: Matrix
    monitor: Monitors
    shift: Vector
    drift: Matrix
    corrections: Matrix
    starts: Matrix
    force: Vector
    lacks: Vector
    newton: Cube


class MarchOutput(NamedTuple):
    """Arrays for the row of each step from `first` on, y and its slopes (k, d), or none.

    There may also be an array for Jacobians (n, d, d) of these steps.
    """

    rows: Matrix
    slopes: Matrix
    jacobians: Cube
    first: int


class StepArrays(NamedTuple):
    """Room for one step of W columns, d of them the orbit.

    - known (W,): what is known of the step's left side; shift (W,): the increment of t x'(0).
    - scale, lead, near (W,): factors of the increment, of f and of the newest piece.
    - w, f (W,): increments without shift, and f; moved (W,): what a sweep changed.
    - point (W,): where f is taken, at base + gain w of base and gain (W,).
    - first (W,): the increments that Newton's method begins with.
    - units (d,): of components, for differences of f.
    """

    known: Vector
    shift: Vector
    scale: Vector
    lead: Vector
    near: Vector
    w: Vector
    f: Vector
    moved: Vector
    point: Vector
    base: Vector
    gain: Vector
    first: Vector
    units: Vector


class GivenWork(NamedTuple):
    """All that a step works on, in one record that is handed on by reference.

    Python makes its arrays (compiled/reference.py). `solver` solves with Newton's matrix.
    """

    right: RightSide
    memory: MarchMemory
    solver: Annotated[Any, FunctionField(SOLVER_SIG)]
    linear: LinearSolver
    table: StepTable
    rows: StepRows
    state: March
    room: StepArrays
    output: MarchOutput


MARCH_MEMORY = Reference(compiled_type(MarchMemory))
MARCH_STATE = Reference(compiled_type(March))
GIVEN_WORK = Reference(compiled_type(GivenWork))
# work, time, columns (W,) where f is taken, right-hand sides (W,)
PUSH_SIG = types.void(GIVEN_WORK, F8, VEC, VEC)
# work, time: whether the equations of the tangents were solved
SOLVE_TANGENTS_SIG = types.boolean(GIVEN_WORK, F8)


class GivenMarch(NamedTuple):
    """A march: what it works on, and functions for tangents, which few runs need.

    `push` sets the right-hand sides of tangents, `solve_tangents` their increments in an implicit
    step.
    """

    work: GivenWork
    push: Annotated[Any, FunctionField(PUSH_SIG)]
    solve_tangents: Annotated[Any, FunctionField(SOLVE_TANGENTS_SIG)]


GIVEN_MARCH = Reference(compiled_type(GivenMarch))
# march, step to end at: how it ended (given/block.py)
MARCH_SIG = I8(GIVEN_MARCH, I8)
