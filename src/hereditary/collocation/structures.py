"""Named groups of arrays that compiled collocation works on, and their compiled types.

Letters of shapes: d components, R rows of integral equations, s nodes of a step, M modes, n_a
fractional integrals, n_v varying orders. Then n_k general kernels and then varying orders, n_q
integrands (3, or 4 with p'), k tangents. An axis of length 1 + k has the orbit and then its
tangents (docs/notation.md).
"""

from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
from numba import from_dtype, types

from ..compiled.jit import (
    F8,
    I8,
    MAT,
    ComplexCube,
    ComplexMatrix,
    ComplexVector,
    Cube,
    Cubes,
    Integers,
    Matrix,
    Vector,
    compiled_type,
)
from ..compiled.records import record
from ..compiled.reference import FunctionField, Reference
from ..compiled.signatures import RightSide

# Convolution term: its row, integrand, index of the order or kernel, and coefficient.
TERM = np.dtype(
    [("row", "i8"), ("integrand", "i8"), ("index", "i8"), ("coefficient", "f8")], align=True
)
# Step control: present time since the origin, lengths of the next and of the last step, that of the
# shortest step for which the modes hold, 1 if the last trial was refused, the origin [time], the
# component with the largest error of the last trial, and the last time at which a look found f
# unlike its polynomial, or 0.
_TIMES = "time", "next", "last", "shortest", "refused", "origin", "worst", "missed"
CONTROL = np.dtype([(name, "f8") for name in _TIMES], align=True)
# Calls of the right-hand side, and steps accepted, refused, and refused by the defect of f alone.
COUNTS = np.dtype(
    [("rhs", "i8"), ("accepted", "i8"), ("refused", "i8"), ("by_defect", "i8")], align=True
)
# Contraction of Newton's method: its rate, the change of p at which it was observed, and the step
# length there.
CONTRACTION = np.dtype([("rate", "f8"), ("change", "f8"), ("length", "f8")], align=True)
# Start time since the origin, and length, of the step that the tables are computed for, and of the
# step that is requested.
TABULATED = np.dtype(
    [("start", "f8"), ("length", "f8"), ("next_start", "f8"), ("next_length", "f8")], align=True
)
Control: TypeAlias = Annotated[np.void, from_dtype(CONTROL)]
Counts: TypeAlias = Annotated[np.void, from_dtype(COUNTS)]
Contraction: TypeAlias = Annotated[np.void, from_dtype(CONTRACTION)]
Tabulated: TypeAlias = Annotated[np.void, from_dtype(TABULATED)]
IntegerMatrix: TypeAlias = Annotated[np.ndarray, types.Array(I8, 2, "C")]
Records: TypeAlias = Annotated[np.ndarray, types.Array(from_dtype(TERM), 1, "C")]

# Mark of a component whose row is 0 = f, among the marks of components whose p follows from a
# balance.
ALGEBRAIC = 2


class Equations(NamedTuple):
    """Integral equations of all components (collocation/equations.py).

    - terms (n,): of `TERM`; orders (n_a,): of the fractional integrals.
    - second (d,): 1 if the primary unknown is y'.
    - offsets (1 + k, n): constants subtracted from the integrands.
    - implicit (d,): 1 if p follows from the balance of right-hand side and terms, `ALGEBRAIC` if
      there are no terms.
    - unweighted: integrands of terms with varying orders, whose modes are stored without weights.
    - kinds (d,): number of each component's kind; components of one kind have the same terms.
    - units (d,): for differences of f.
    - quantities (d,): components with one number are sizes of one quantity.
    """

    terms: Records
    orders: Vector
    second: Integers
    offsets: Matrix
    implicit: Integers
    unweighted: Integers
    kinds: Integers
    units: Vector
    quantities: Integers


class Rule(NamedTuple):
    """Quadrature of one step: nodes, and matrices that act on values at the nodes.

    - nodes (s,); integrals (n_a, s, s): the fractional integrals at the nodes.
    - legendre (s, s): Legendre coefficients; inverse (s, s): of the integrals of order 1.
    - check_points (m,): off the nodes, m = 2 + s; two of them count for the error of a step.
    - check_integrals, check_values (m, s): integral from the start and value of the polynomial.
    """

    nodes: Vector
    integrals: Cube
    legendre: Matrix
    inverse: Matrix
    check_points: Vector
    check_integrals: Matrix
    check_values: Matrix


class ExponentialBasis(NamedTuple):
    """Rates of all modes, and the kernels as weighted sums of them.

    - rates (n,): real ones; pairs (m,): of each conjugate pair that of positive imaginary part. The
      M = n + 2 m modes are in the order of kernels/mode_bank.py.
    - weights (n_a + n_k, M); masses (n_k,): point masses of the kernels at time lag 0.
    - transforms (s, s, s): from values at the nodes to Legendre coefficients on [0, node i].
    """

    rates: Vector
    pairs: ComplexVector
    weights: Matrix
    masses: Vector
    transforms: Cube


class StepTables(NamedTuple):
    """Factors of the modes for K step lengths, computed once for each length.

    - lengths (K,); to_nodes (K, M, s): decay from the start to the nodes.
    - to_end (K, M): decay to the end.
    - moments (K, s, M): of the Legendre polynomials.
    - local (K, n_k, s, s): convolutions with general kernels and varying orders over the step.
    """

    lengths: Vector
    to_nodes: Cube
    to_end: Matrix
    moments: Cube
    local: Cubes


class ModeWeights(NamedTuple):
    """Weights with which the modes absorb what a step adds to them (collocation/mode_tables.py).

    - integrands (K, n_q, M): for the rows of each kind of components.
    - used (K, n_q): 1 if one of them is not 0.
    - offsets (1 + k, R, M): or (1 + k, 0, M) if all offsets are 0.
    - part (M,), coefficients (s,): room.
    """

    integrands: Cube
    used: IntegerMatrix
    offsets: Cube
    part: Vector
    coefficients: Vector


class VaryingOrders(NamedTuple):
    """Tables of the varying orders for one step.

    - tabulated: a record `TABULATED`, the step of the tables.
    - integrals (n_v, s, s); weights (n_v, M, s): of the modes at the nodes.
    - of_varying (M,): 1 for the modes of such orders.
    """

    tabulated: Tabulated
    integrals: Cube
    weights: Cube
    of_varying: Vector


class OrbitArrays(NamedTuple):
    """The orbit and its tangents: present values, initial values and history.

    - initial, x, p (1 + k, d).
    - modes (1 + k, R, M); before: the modes at the start of the last step.
    - last (1 + k, n_q, d, s): the integrands f, p, y and, if needed, p' at the nodes of the last
      step.
    """

    initial: Matrix
    x: Matrix
    p: Matrix
    modes: Cube
    before: Cube
    last: Cubes


class MarchState(NamedTuple):
    """Step control, counts and contraction of Newton's method.

    - largest (d,): the largest |y'| so far; sizes (d,): the largest |y| so far.
    """

    control: Control
    counts: Counts
    contraction: Contraction
    largest: Vector
    sizes: Vector


class Steps(NamedTuple):
    """Accepted steps as dense output needs them, of the orbit and perhaps of its tangents.

    - starts, lengths (n,); p (n, D, s): at the nodes.
    - at_starts (n, 2, D): y and then p at the starts.
    - errors (n,): each divided by its tolerance.

    D is d, or (1 + k) d: the orbit's components, then those of each tangent.
    """

    starts: Vector
    lengths: Vector
    p: Cube
    at_starts: Cube
    errors: Vector


def empty_steps(n, d, s):
    """Return room for n steps of d components with s nodes."""
    shapes = (n,), (n,), (n, d, s), (n, 2, d), (n,)
    return Steps(*(np.empty(shape) for shape in shapes))


class Limits(NamedTuple):
    """Time to stop at, longest step, longest step while the solution is at rest, and tolerances.

    f may be called between `earliest` and `latest`. `t_end` is the length of the run. The tolerance
    of y is atol, (d,), + rtol |y| + by_size times the size of the component.
    """

    stop: float
    earliest: float
    latest: float
    longest: float
    longest_idle: float
    rtol: float
    atol: Vector
    by_size: float
    t_end: float


class Operators(NamedTuple):
    """Matrices from nodal values to the rows of the equations at the nodes of one step.

    - matrices (K, 3, s, s): one for each of f, p and y. First for the rows of each kind of
      components, then for the rows subtracted from their right-hand sides.
    - start_weights (K, s): of p at the start; constant (1 + k, R, s): parts of the offsets.
    - columns (K, 3, s, s): the transposed matrices.
    - alone (K,): 1 if p and y do not enter; sums (K, s): the integrals of f = 1.
    """

    matrices: Cubes
    start_weights: Matrix
    constant: Cube
    columns: Cubes
    alone: Integers
    sums: Matrix


class Stages(NamedTuple):
    """Linear systems of a step (collocation/stages.py).

    If many components share their terms:

    - factors (K, ., .): of up to K = s systems of size d; order (d,): place of each component.
    - dense (2 + 2 K, d, d): a reduced dense Jacobian and its factors.
    - shifts (K,); back (K, s) and forth (s, K): transforms of nodal values.

    If terms differ, or components are few:

    - order (d s,): place of each unknown; joint (d s, d s): the matrix, or its entries.
    - dense (1, ., .): the factors, or room for them.

    In both cases:

    - scales (d,): powers of 2, of y or to balance a dense Jacobian; lower, upper: diagonals of a
      band.
    - lapack, lapack_solve, lapack_values, lapack_balance, python: addresses of functions.
    - hold: steps of one length before new factors for a longer one pay.
    - kinds (d,): of the components; second (n,): 1 for kinds whose primary unknown is y'.
    - matrices (n, 3, s, s): of f, p and y for each kind; integral (s, s): over the step.
    - jacobians (m, d, d): of few components one for each of m = s nodes. Otherwise one for all
      nodes, or the entries of a sparse one.
    - control (6,).
    """

    factors: ComplexCube
    order: Integers
    lower: int
    upper: int
    lapack: int
    lapack_solve: int
    lapack_values: int
    lapack_balance: int
    python: int
    hold: int
    kinds: Integers
    second: Integers
    matrices: Cubes
    integral: Matrix
    shifts: ComplexVector
    back: ComplexMatrix
    forth: ComplexMatrix
    jacobians: Cube
    scales: Vector
    dense: Cube
    joint: Matrix
    control: Vector


class StepRoom(NamedTuple):
    """Room for one step of d components with s nodes; nothing in it is kept for the next.

    - times (s,), check_times (m,): of the nodes and of m points between them.
    - base (1 + k, R, s): the known part of the rows; values (1 + k, n_q, d, s): the integrands.
    - jacobians (s, ., .): for tangents, one at each node.
    - residual, change (d s,): of the equations; nodal_change (d, s): the same change by nodes.
    - before (d, s), moved (s, d): y before a change, and its change; reached (s, s): the weights of
      an extrapolation.
    - forced (d, s): of a tangent, the derivative of f by a parameter.
    - point, force (d,): a point and f there.
    - goal, errors, defect (d,): Newton's accuracy, the errors and the defect of f.
    - hidden (d,): the largest p of the same quantity, whose rounding a small component may be.
    - sizes, sizes_before (d,): of y, to which its errors are relative, and those before the step.
    - units (d,): for differences of f.
    - force_scales, starts, start_scales (d,): of rounding.

    Summands of f are as large as its scale |J| |y|, so the rounding error of f is that of the
    scale. If y is found as a difference from y(0), its rounding error adds that of the scale |J|
    |y(0)|. `starts` has the sizes of y(0) for such components, otherwise 0.
    """

    times: Vector
    check_times: Vector
    residual: Vector
    change: Vector
    nodal_change: Matrix
    before: Matrix
    moved: Matrix
    reached: Matrix
    forced: Matrix
    point: Vector
    force: Vector
    goal: Vector
    errors: Vector
    defect: Vector
    hidden: Vector
    sizes: Vector
    sizes_before: Vector
    units: Vector
    force_scales: Vector
    starts: Vector
    start_scales: Vector
    base: Cube
    values: Cubes
    jacobians: Cube


# Control of stages: step length that the factors hold for (0: none), 1 where the Jacobian is to be
# kept, the number of systems, the steps for which a longer one was put off, and 1 where a dense
# Jacobian is reduced. A record would not pass through a function value.
LENGTH, KEPT, SYSTEMS, HELD, REDUCED, N_CONTROL = range(6)
# Matrices of the pencil of a kind: G of components whose unknowns are values of y, G of those
# whose unknowns are y', and M.
OF_VALUES, OF_SPEEDS, REST = range(3)
STAGES = Reference(compiled_type(Stages))
# task, nodal values (d, s), which the result replaces; 0 where it is done
STAGES_SIG = I8(I8, MAT, STAGES)


class AdaptiveWork(NamedTuple):
    """All that a step works on, in one record that is handed on by reference.

    Python makes its arrays (compiled/reference.py). `solver` solves the systems of the stages.
    """

    right: RightSide
    equations: Equations
    rule: Rule
    basis: ExponentialBasis
    tables: StepTables
    varying: VaryingOrders
    orbit: OrbitArrays
    state: MarchState
    steps: Steps
    limits: Limits
    solver: Annotated[Any, FunctionField(STAGES_SIG)]
    stages: Stages
    operators: Operators
    weights: ModeWeights
    room: StepRoom


WORK = Reference(compiled_type(AdaptiveWork))
# work, step length, slot of the tables: the ratio of the tangents' error to its tolerance
TANGENTS_SIG = F8(WORK, F8, I8)
# work, slot of the tables, column of the orbit or a tangent
READING_SIG = types.void(WORK, I8, I8)
# work, step length, slot of the tables
FILLING_SIG = types.void(WORK, F8, I8)


class AdaptiveMarch(NamedTuple):
    """A march: what it works on, and functions for what few runs need (collocation/march.py)."""

    work: AdaptiveWork
    solve_for_tangents: Annotated[Any, FunctionField(TANGENTS_SIG)]
    read_varying: Annotated[Any, FunctionField(READING_SIG)]
    fill_kernels: Annotated[Any, FunctionField(FILLING_SIG)]


ADAPTIVE_MARCH = Reference(compiled_type(AdaptiveMarch))


# Fields of the workspace with one number for each component.
_BY_COMPONENT = (
    "point", "force", "goal", "errors", "defect", "hidden", "sizes", "sizes_before", "units",
    "force_scales", "starts", "start_scales",
)  # fmt: skip


def empty_room(columns, values, stages, n_checks):
    """Return the room of steps: `columns` (1 + k, R), shape of the values (1 + k, n_q, d, s)."""
    d, s = values[2:]
    each, none = stages.jacobians, np.empty((0, 0, 0))
    if len(each) == 1:  # of many components the stages have one Jacobian
        each = np.empty((s, *each.shape[1:])) if values[0] > 1 else none
    by_component = {name: np.zeros(d) for name in _BY_COMPONENT}
    change = np.empty(d * s)
    return StepRoom(
        times=np.empty(s),
        check_times=np.empty(n_checks),
        residual=np.empty(d * s),
        change=change,
        nodal_change=change.reshape(d, s),
        before=np.empty((d, s)),
        moved=np.empty((s, d)),
        reached=np.empty((s, s)),
        forced=np.empty((d, s)),
        base=np.empty((*columns, s)),
        values=np.empty(values),
        jacobians=each,
        **by_component,
    )


def initial_state(h, largest, sizes):
    """Return the state of a march that begins with a step of length h."""
    contraction = record(CONTRACTION, rate=1.0, change=1.0, length=1.0)
    return MarchState(record(CONTROL, next=h), record(COUNTS), contraction, largest, sizes)


def restored_state(kept):
    """Return the `MarchState` whose parts were stored as arrays of numbers."""
    control, counts, contraction, *sizes = kept
    return MarchState(
        record(CONTROL, tuple(control[0])),
        record(COUNTS, tuple(counts[0])),
        record(CONTRACTION, tuple(contraction[0])),
        *(part.copy() for part in sizes),
    )
