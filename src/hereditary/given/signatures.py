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

    If weights differ from step to step, a mode becomes keep times the mode plus take times a piece.
    Otherwise keep is the decay of modes and pieces over the finished block.
    """

    first: int = 0  # first step of the tables, if weights differ from step to step
    rows: int = 1  # number of steps in the tables
    length: int = 0  # steps of a batch, modes of terms with y', or modes with real rates
    weights: Matrix = _EMPTY  # weights of pieces or modes
    start_weights: Matrix = _EMPTY  # weights of start values
    keep: Matrix = _EMPTY
    take: Matrix = _EMPTY
    ahead: Matrix = _EMPTY  # decay of the modes up to each step of the next block
    corrections: Matrix = _EMPTY  # of the first weights, which are no sums of exponentials
    derivatives: Matrix = _EMPTY  # if orders vary, the derivative in each term
    amplitudes: Matrix = _EMPTY  # if orders vary, the amplitudes of modes at each step
    room: Matrix = _EMPTY  # working storage


class HistoryArrays(NamedTuple):
    """Contents of a history's memory for each of W columns, all linear in the solution."""

    pieces: Annotated[Matrix, "W ."]  # stored pieces
    modes: Annotated[Matrix, "W ."]  # modes of a sum of exponentials
    starts: Annotated[Matrix, "W ."]  # start values or their modes, which the march sets
    pending: Annotated[Matrix, "W ."]  # the part of the lag of later steps that is already summed


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

    The first columns are the components of the orbit. The first n_solved of them have an equation;
    the others are memory that f reads.
    """

    h: float  # the step, 0 on a mesh
    slowest: float  # largest number of steps between turns that are watched, 0 for none
    sweeps: int  # number of corrector sweeps in a step
    integral: int  # whether pieces are values of f instead of increments
    n_orbit: int  # number of components of the orbit
    n_solved: int
    groups: Annotated[Integers, "W"]  # the group of each column
    sources: Annotated[Integers, "W"]  # the column whose increments each column uses
    given: Annotated[Integers, "W"]  # whether the first increment is given instead of solved for
    weights: Annotated[Matrix, "C B+2"]  # weights of the pieces of the open block
    start_weights: Annotated[Matrix, "V*C B+2"]  # weights of V start values
    powers: Annotated[Matrix, "r W"]  # exponents of r known terms ``amplitude t**power``


class StepRows(NamedTuple):
    """Coefficients of R steps for C groups of columns; step n has row ``min(n - first, last)``.

    All uniform steps but the first share one row. On meshes, and if orders vary, every step has its
    own row.
    """

    first: int
    last: int
    times: Annotated[Vector, "R"]  # start times of the steps; empty on uniform steps
    theta: Annotated[Vector, "R"]  # the fraction of a step at which the equation holds
    unit: Annotated[Vector, "R"]  # step sizes [time]
    length: Annotated[Vector, "R"]  # factor of March.shift that gives the increment of t x'(0)
    ratio: Annotated[Vector, "R"]  # the size of a step over that of the step before
    lead: Annotated[Matrix, "C R"]  # factors of f
    near: Annotated[Matrix, "C R"]  # factors of the newest piece
    scale: Annotated[Matrix, "C R"]  # factors of the increment
    # factors of March.shift, (C, R) or (C, 0); if terms use x(0), factors of x(0) follow, (2 C, R)
    drift: Annotated[Matrix, ". ."]

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

    The W columns are the components of the orbit, then those of each tangent. Blocks have B steps.
    """

    counts: Counts
    x: Annotated[Vector, "W"]  # the solution, and in its own columns the memory that f reads
    increment: Annotated[Vector, "W"]  # the newest increment
    change: Annotated[Vector, "W"]  # its change from the increment before
    lag: Annotated[Matrix, "W B"]  # lag of the open block
    pieces: Annotated[Matrix, "W B+1"]  # pieces of the open block
    monitor: Annotated[Monitors, "d"]  # of the stability watch, for the d components of the orbit
    # x'(0), in the unit that StepRows.length needs, if pieces leave out t x'(0)
    shift: Annotated[Vector, "W"]
    # amplitudes of r known terms, or x(0) if StepRows.drift has factors of x(0)
    drift: Annotated[Matrix, "W r"]
    corrections: Annotated[Matrix, "W k"]  # of the right-hand side in the first k steps
    starts: Annotated[Matrix, "W V"]  # start values of each column
    last_f: Annotated[Vector, "W"]  # the newest right-hand side
    lacks: Annotated[Vector, "W"]  # lead times the change of f by the last corrector sweep
    # the Jacobian, Newton's matrix (given/newton.py), and that of the tangents if there are any
    newton: Annotated[Cube, ". . ."]
    row_factors: Annotated[Matrix, "2 d"]  # factors of the rows of these two matrices


class MarchOutput(NamedTuple):
    """Arrays that a call of the march fills, beginning with step `first`."""

    rows: Annotated[Matrix, "k d"]  # y at the ends of k steps; k = 0 if not wanted
    slopes: Annotated[Matrix, "k d"]  # y' there
    first: int


class StepWorkspace(NamedTuple):
    """Working arrays of one step, for W columns; the first d columns are the orbit."""

    known: Annotated[Vector, "W"]  # part of the left side without this step's increment
    shift: Annotated[Vector, "W"]  # the increment of t x'(0)
    scale: Annotated[Vector, "W"]  # factor of the increment
    lead: Annotated[Vector, "W"]  # factor of f
    near: Annotated[Vector, "W"]  # factor of the newest piece
    w: Annotated[Vector, "W"]  # increments without shift
    f: Annotated[Vector, "W"]  # the right-hand side
    moved: Annotated[Vector, "W"]  # change of w in a corrector sweep or a Newton iteration
    point: Annotated[Vector, "W"]  # f is taken at ``point = base + gain w``
    base: Annotated[Vector, "W"]
    gain: Annotated[Vector, "W"]
    first: Annotated[Vector, "W"]  # the first guess of w in Newton's method
    per_unit: Annotated[Vector, "W"]  # 1 over the sizes in which corrections of w are compared
    sizes: Annotated[Vector, "d"]  # sizes of the summands of f
    passed: Annotated[Vector, "d"]  # sizes of the summands of f that are rounding
    noise: Annotated[Vector, "d"]  # |y| of components that are rounding of others, 0 for others
    units: Annotated[Vector, "d"]  # typical sizes, for difference quotients of f


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
