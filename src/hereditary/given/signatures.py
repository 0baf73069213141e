"""Records of marches on given steps, and the arrays that marches and histories exchange.

A march has W columns: the components of the orbit, then those of each tangent. It advances by
blocks of B steps. The piece of a step is its increment, or the value of f in integral form. Between
two blocks the march calls a function of the history, which stores the pieces of the finished block.
This function then sets the lag of the next block, the weighted sum over all stored pieces. All
histories share its signature. So marches and histories are compiled separately, and any two work
together.

Components with the same terms form one of C groups, with the same weights. Each column has V start
values, whose weights differ from those of pieces.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
from numba import from_dtype, types

from ..compiled.jit import F8, I8, IVEC, MAT, VEC, Cube, Integers, Matrix, Vector, compiled_type
from ..compiled.reference import FunctionField, Reference
from ..compiled.signatures import SOLVER_SIG, LinearSolver, RightSide

_EMPTY = np.zeros((1, 0))


class Tables(NamedTuple):
    """Tables of a history; a history sets those that its functions read (given/past.py).

    - first, rows: if weights differ from step to step, the first step of the tables, and the number
      of steps in them.
    - length: steps of a batch, modes of terms with y', or modes with real rates.
    - weights, start_weights: weights of pieces or modes, and of start values.
    - keep, take: if weights differ from step to step, a mode becomes keep times the mode plus take
      times a piece. Otherwise keep is the decay of modes and pieces over the finished block.
    - ahead: decay of the modes up to each step of the next block.
    - corrections: corrections of the first weights, which are no sums of exponentials.
    - derivatives, amplitudes: if orders vary, the derivative in each term, and the amplitudes of
      modes at each step.
    - room: working storage.
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


class HistoryArrays(NamedTuple):
    """Contents of a history's memory for each of W columns, all linear in the solution.

    - pieces (W, .): stored pieces; modes (W, .): modes of a sum of exponentials.
    - starts (W, .): start values or their modes, which the march sets.
    - pending (W, .): the part of the lag of later steps that is already summed.
    """

    pieces: Matrix
    modes: Matrix
    starts: Matrix
    pending: Matrix


def held(
    n_columns: int, pieces: int = 0, modes: int = 0, starts: int = 0, pending: int = 0
) -> HistoryArrays:
    """Return `HistoryArrays` of zeros; the arguments are its numbers of columns and entries."""
    sizes = pieces, modes, starts, pending
    return HistoryArrays(*[np.zeros((n_columns, size)) for size in sizes])


# Numba types of references to the tables of a history and to the contents of its memory.
HISTORY_TABLES = Reference(compiled_type(Tables))
MEMORY = Reference(compiled_type(HistoryArrays))
# Signature of a history's function. Its arguments are lag (W, B), pieces (W, B + 1), a step,
# groups (W,), tables and memory. The step is the first one of the next block; groups has the group
# of each column. The function stores all pieces but the last (none at step 0), and adds to lag.
EXCHANGE_SIG = types.void(MAT, MAT, I8, IVEC, HISTORY_TABLES, MEMORY)


class MarchMemory(NamedTuple):
    """The history of a march: its compiled function, its tables, and the contents of its memory."""

    exchange: Annotated[Any, FunctionField(EXCHANGE_SIG)]
    tables: Tables
    arrays: HistoryArrays


# Record with counts of a march. Zigzags and turns are explained in given/watch.py.
MARCH_COUNTS = np.dtype(
    [
        ("step", "i8"),  # number of steps made
        ("zigzag", "i8"),  # step at which the watch noted a lasting zigzag, -1 for none
        ("opened", "i8"),  # first step of the block that was opened last
        ("rhs", "i8"),  # number of calls of the right-hand side
        ("growth", "i8"),  # step at which the watch noted growth from turn to turn, -1 for none
        ("diverged", "i8"),  # step at which it noted that corrector sweeps diverge, -1 for none
        ("kept", "i8"),  # whether the next step may use the last Jacobian and its factors
        ("at_once", "i8"),  # whether the factors of Newton's matrix solve a linear step at once
        ("renewed", "i8"),  # number of coming steps that each compute a new Jacobian
        ("factorised", "i8"),  # number of factorised matrices
        ("extrapolates", "i8"),  # whether the next IMEX step may use f of the last step
    ],
    align=True,
)


# Record of the stability watch for one component (given/watch.py). A turn is a step at which the
# increment changes its sign. An alternation is a sequence of steps that are all turns.
MONITOR = np.dtype(
    [
        ("alternating", "f8"),  # number of steps of the present alternation
        ("largest", "f8"),  # largest increment in the present batch of ZIGZAG_WINDOW steps
        ("before", "f8"),  # largest increment in the batch of ZIGZAG_WINDOW steps before
        ("turned", "f8"),  # step of the last turn
        ("change", "f8"),  # change of the increment at the last turn
        ("growth", "f8"),  # growth of the change at turns, over the present series of turns
        ("least", "f8"),  # smallest increment in the present batch of SHORT_WINDOW steps
        ("most", "f8"),  # largest increment in the present batch of SHORT_WINDOW steps
        ("turns", "f8"),  # number of turns in quick succession; -1 if they are not watched
        ("turning", "f8"),  # largest change of an increment in the present batch of turns
        ("turning_before", "f8"),  # largest change of an increment in the batch of turns before
        ("diverging", "f8"),  # number of steps in a row whose last corrector sweep diverged
    ],
    align=True,
)


Counts: TypeAlias = Annotated[np.record, from_dtype(MARCH_COUNTS)]


Monitors: TypeAlias = Annotated[np.ndarray, types.Array(from_dtype(MONITOR), 1, "C")]


class StepTable(NamedTuple):
    """Coefficients that all steps of a run share, for W columns in C groups and blocks of B steps.

    - h: the step, 0 on a mesh; sweeps: number of corrector sweeps in a step.
    - slowest: turns of increments are watched if they are at most this many steps apart (0: none).
    - integral: whether pieces are values of f instead of increments.
    - n_orbit: components of the orbit, which are the first columns. The first n_solved of them have
      an equation; the others are memory that f reads.
    - groups (W,): the group of each column.
    - sources (W,): the column whose increments each column uses.
    - given (W,): whether the first increment is given instead of solved for.
    - weights (C, B + 2), start_weights (V C, B + 2): weights of the pieces of the open block, and
      of V start values.
    - powers (r, W): exponents of r known terms ``amplitude t**power``.
    """

    h: float
    slowest: float
    sweeps: int
    integral: int
    n_orbit: int
    n_solved: int
    groups: Integers
    sources: Integers
    given: Integers
    weights: Matrix
    start_weights: Matrix
    powers: Matrix


class StepRows(NamedTuple):
    """Coefficients of R steps for C groups of columns; step n has row ``min(n - first, last)``.

    All uniform steps but the first share one row. On meshes, and if orders vary, every step has its
    own row.

    - times (R,): start times of the steps; empty on uniform steps.
    - theta (R,): the fraction of a step at which the equation holds.
    - unit (R,): step sizes [time]; length (R,): factor of March.shift that gives the increment of
      t x'(0).
    - ratio (R,): the size of a step over that of the step before.
    - lead, near, scale (C, R): factors of f, of the newest piece and of the increment.
    - drift (C, R): factors of March.shift; (C, 0) if there are none. If terms use x(0), C rows of
      factors of x(0) follow, (2 C, R).
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
        """Whether all steps but the first share one row."""
        return self.last == 1

    @property
    def alike(self) -> bool:
        """Whether all steps have the same Newton matrix if the Jacobian is constant."""
        each = (self.theta[None], self.lead, self.scale)
        return self.shared and all(np.all(part == part[:, :1]) for part in each)


class March(NamedTuple):
    """State of a march; all but counts, monitor, newton and factors is linear in the solution.

    The W columns are the components of the orbit, then those of each tangent.

    - x (W,): the solution, and in its own columns the memory that f reads.
    - increment, change (W,): the newest increment, and its change from the increment before.
    - lag (W, B), pieces (W, B + 1): lag and pieces of the open block of B steps.
    - monitor (d,): records of the stability watch for the d components of the orbit.
    - shift (W,): x'(0), in the unit that StepRows.length needs, if pieces leave out t x'(0).
    - drift (W, r): amplitudes of r known terms, or x(0) if StepRows.drift has factors of x(0).
    - corrections (W, k): corrections of the right-hand side in the first k steps.
    - starts (W, V): V start values of each column.
    - last_f (W,): the newest right-hand side.
    - lacks (W,): lead times the change of f by the last corrector sweep.
    - newton (2, ., .): the Jacobian, and Newton's matrix, whose factors may be kept
      (given/newton.py). (3, ., .) with the matrix of the tangents' equations.
    - row_factors (2, d): factors of the rows of the two matrices, for d components of the orbit.
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
    last_f: Vector
    lacks: Vector
    newton: Cube
    row_factors: Matrix


class MarchOutput(NamedTuple):
    """Arrays that a call of the march fills, beginning with step `first`.

    - rows, slopes (k, d): y and y' of d components at the ends of k steps; k = 0 if not wanted.
    """

    rows: Matrix
    slopes: Matrix
    first: int


class StepWorkspace(NamedTuple):
    """Working arrays of one step, for W columns; the first d columns are the orbit.

    - known (W,): the part of the left side that does not depend on this step's increment.
    - shift (W,): the increment of t x'(0).
    - scale, lead, near (W,): factors of the increment, of f and of the newest piece.
    - w, f (W,): increments without shift, and the right-hand side.
    - moved (W,): the change of w in a corrector sweep or a Newton iteration.
    - point, base, gain (W,): f is taken at ``point = base + gain w``.
    - first (W,): the first guess of w in Newton's method.
    - per_unit (W,): 1 over the sizes in which corrections of Newton's method are compared.
    - sizes, passed (d,): sizes of the summands of f, all of them and those that are rounding.
    - noise (d,): |y| of components that are rounding of others, 0 for others.
    - units (d,): a typical size of each component, for difference quotients of f.
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
    per_unit: Vector
    sizes: Vector
    passed: Vector
    noise: Vector
    units: Vector


class GivenWork(NamedTuple):
    """All functions and arrays that a step uses, in one record that is passed by reference.

    Python allocates the arrays (compiled/reference.py). `solver` factorises Newton's matrix and
    solves with its factors; `linear` has its tables.
    """

    right: RightSide
    memory: MarchMemory
    solver: Annotated[Any, FunctionField(SOLVER_SIG)]
    linear: LinearSolver
    table: StepTable
    rows: StepRows
    state: March
    workspace: StepWorkspace
    output: MarchOutput


MARCH_MEMORY = Reference(compiled_type(MarchMemory))
MARCH_STATE = Reference(compiled_type(March))
GIVEN_WORK = Reference(compiled_type(GivenWork))
# Signature of functions that set the right-hand sides of tangents. Their arguments are the work,
# the time, the columns (W,) where f is taken, and the right-hand sides (W,).
PUSH_SIG = types.void(GIVEN_WORK, F8, VEC, VEC)
# Signature of functions that solve an implicit step of the tangents. Their arguments are the work
# and the time; they return whether the equations were solved.
SOLVE_TANGENTS_SIG = types.boolean(GIVEN_WORK, F8)


class GivenMarch(NamedTuple):
    """A march: its functions and arrays, and two functions for tangents.

    `push` sets the right-hand sides of the tangents. `solve_tangents` sets their increments in an
    implicit step. Both do nothing in a run without tangents.
    """

    work: GivenWork
    push: Annotated[Any, FunctionField(PUSH_SIG)]
    solve_tangents: Annotated[Any, FunctionField(SOLVE_TANGENTS_SIG)]


GIVEN_MARCH = Reference(compiled_type(GivenMarch))
# Signature of a march. Its arguments are the march and the step to end at; it returns a status of
# given/block.py.
MARCH_SIG = I8(GIVEN_MARCH, I8)
