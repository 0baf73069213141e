"""Named groups of arrays that compiled collocation works on, and their compiled types.

The primary unknown p of a component is y, or y' for orders above 1. Letters of shapes are:

- d components, s nodes of a step, M exponential modes, k tangents;
- R rows: row c < d is p of component c, row d + c the terms subtracted from its right-hand side;
- n_q integrands: f, p and y, and p' if an equation needs it;
- n_a fractional integrals, n_v varying orders, n_k general kernels and varying orders together.

An axis of length 1 + k has the orbit and then its tangents (docs/notation.md).
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
    checked,
    compiled_type,
)
from ..compiled.records import record
from ..compiled.reference import FunctionField, Reference
from ..compiled.signatures import RightSide

# Record of a convolution term: its row, its integrand, the index of its order or kernel, and its
# coefficient.
TERM = np.dtype(
    [("row", "i8"), ("integrand", "i8"), ("index", "i8"), ("coefficient", "f8")], align=True
)
# Fields of the step control. Lengths and times have the unit of time.
# - time: present time since the origin; origin: the time from which steps are counted.
# - next, last: lengths of the next step and of the last accepted step.
# - shortest: length of the shortest step for which the exponential modes are accurate.
# - rejected: 1 if the last trial step was rejected.
# - worst: component with the largest ratio of error to tolerance in the last trial step.
# - tried: length of the last rejected step.
# - begins: 1 in a first step, where components may grow from nothing.
# - missed: time in a rejected step at which f differed from its polynomial, or 0.
# - jump: time of the last jump of f that was found, or 0.
_TIMES = (
    "time",
    "next",
    "last",
    "shortest",
    "rejected",
    "origin",
    "worst",
    "missed",
    "jump",
    "tried",
    "begins",
)
CONTROL = np.dtype([(name, "f8") for name in _TIMES], align=True)
# Record of counts: calls of the right-hand side, accepted steps, rejected steps, and steps rejected
# for the defect of f between the nodes alone.
COUNTS = np.dtype(
    [("rhs", "i8"), ("accepted", "i8"), ("rejected", "i8"), ("by_defect", "i8")], align=True
)
# Record of the contraction of Newton's method: its rate, the change of p and the step length at
# which the rate was observed, and the last change. Changes are in units of Newton's tolerance.
CONTRACTION = np.dtype(
    [("rate", "f8"), ("change", "f8"), ("length", "f8"), ("last", "f8")], align=True
)
# Record of two steps: the one that the tables of varying orders are valid for, and the one for
# which the march requests them. Starts are times since the origin.
TABULATED = np.dtype(
    [("start", "f8"), ("length", "f8"), ("next_start", "f8"), ("next_length", "f8")], align=True
)
Control: TypeAlias = Annotated[np.void, from_dtype(CONTROL)]
Counts: TypeAlias = Annotated[np.void, from_dtype(COUNTS)]
Contraction: TypeAlias = Annotated[np.void, from_dtype(CONTRACTION)]
Tabulated: TypeAlias = Annotated[np.void, from_dtype(TABULATED)]
IntegerMatrix: TypeAlias = Annotated[np.ndarray, types.Array(I8, 2, "C")]
Records: TypeAlias = Annotated[np.ndarray, types.Array(from_dtype(TERM), 1, "C")]

# Value of `Equations.implicit` for a component whose equation is 0 = f, without any term.
ALGEBRAIC = 2


class Equations(NamedTuple):
    """Integral equations of all components (collocation/equations.py).

    - terms (n,): convolution terms, records `TERM`.
    - orders (n_a,): orders of the fractional integrals.
    - above_one (d,): 1 if the primary unknown is y'.
    - offsets (1 + k, n): constant subtracted from the integrand of each term.
    - implicit (d,): 1 if p follows from the balance of right-hand side and terms, `ALGEBRAIC` if
      the component has no terms, 0 otherwise.
    - unweighted: integrands of terms with varying orders; their modes are stored without weights.
    - kinds (d,): number of each component's kind; components of one kind have the same terms.
    - units (d,): size of each component, for the increments of difference quotients of f.
    - rates (d,): f of a component over the y that it makes in the run, if it is constant.
    - sources, least (d,): the size of a component is at least this multiple of its source's size.
    - divisors (d,): least number by which an implicit row is divided.
    """

    terms: Records
    orders: Vector
    above_one: Integers
    offsets: Matrix
    implicit: Integers
    unweighted: Integers
    kinds: Integers
    units: Vector
    rates: Vector
    sources: Integers
    least: Vector
    divisors: Vector


class Rule(NamedTuple):
    """Quadrature of one step: nodes, and matrices that act on values at the nodes.

    - nodes (s,): in (0, 1].
    - integrals (n_a, s, s): fractional integrals from the start to each node.
    - legendre (s, s): Legendre coefficients of the polynomial through the values.
    - inverse (s, s): inverse of the integrals of order 1.
    - check_points (m,): m = 2 points off the nodes that enter the error of a step.
    - check_integrals, check_values (m, s): integral from the start to each check point, and value
      there, of the polynomial through the values.
    - variable (3,): the numbers q, m and c of a first step's `Variable`.
    """

    nodes: Vector
    integrals: Cube
    legendre: Matrix
    inverse: Matrix
    check_points: Vector
    check_integrals: Matrix
    check_values: Matrix
    variable: Vector


class ExponentialBasis(NamedTuple):
    """Rates of all modes, and the kernels as weighted sums of them.

    - rates (n,): the real rates.
    - pairs (m,): the rate with positive imaginary part of each conjugate pair. The M = n + 2 m
      modes are in the order of kernels/mode_bank.py.
    - weights (n_a + n_k, M): weights of the modes for each fractional integral and kernel.
    - masses (n_k,): point masses of the kernels at time lag 0.
    - transforms (s, s, s): matrix i maps values at the nodes to Legendre coefficients on the
      interval [0, node i].
    """

    rates: Vector
    pairs: ComplexVector
    weights: Matrix
    masses: Vector
    transforms: Cube


class StepTables(NamedTuple):
    """Factors of the modes for K step lengths, computed once for each length.

    - lengths (K,): lengths of the steps.
    - to_nodes (K, M, s): decay of each mode from the start of the step to the nodes.
    - to_end (K, M): decay of each mode from the start to the end of the step.
    - moments (K, s, M): integrals of the Legendre polynomials times each exponential.
    - local (K, n_k, s, s): convolutions over the step itself with general kernels, then with the
      kernels of varying orders.
    """

    lengths: Vector
    to_nodes: Cube
    to_end: Matrix
    moments: Cube
    local: Cubes


class ModeWeights(NamedTuple):
    """Weights with which a step adds its integrals to the modes (collocation/mode_tables.py).

    K counts the rows that differ: components of one kind share their rows.

    - integrands (K, n_q, M): weight of each integrand in each mode.
    - used (K, n_q): 1 if an integrand has a nonzero weight in any mode.
    - offsets (1 + k, R, M): weights of the constant offsets; (1 + k, 0, M) if all offsets are 0.
    - part (M,), coefficients (s,): work arrays.
    """

    integrands: Cube
    used: IntegerMatrix
    offsets: Cube
    part: Vector
    coefficients: Vector


class VaryingOrders(NamedTuple):
    """Tables of the varying orders for one step.

    - tabulated: record `TABULATED` with the step that the tables are valid for.
    - integrals (n_v, s, s): fractional integrals over the step, with the order at each node.
    - weights (n_v, M, s): weights of the modes, with the order at each node.
    - of_varying (M,): 1 for the modes of varying orders, 0 for others.
    """

    tabulated: Tabulated
    integrals: Cube
    weights: Cube
    of_varying: Vector


class OrbitArrays(NamedTuple):
    """The orbit and its tangents: present values, initial values and history.

    - initial (1 + k, d): p(0) plus the content of modes of rate 0, or 0 where p is implicit.
    - x, p (1 + k, d): y and the primary unknown at the present time.
    - modes, before (1 + k, R, M): modes at the end and at the start of the last step.
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

    - control, counts, contraction: records `CONTROL`, `COUNTS` and `CONTRACTION`.
    - largest (d,): the largest |y'| so far, where p is y'.
    - sizes (d,): the largest |y| so far.
    - reach (d,): what other components could make of each during the run (compiled/reach.py).
    - growth (d,): what each makes of itself by growing as a power of time (compiled/reach.py).
    - reads (d,): largest change of f by delayed values, in units of f.
    - scales (d,): largest |J| |y| summed over a step, so that its rounding is that of y by f.
    - noisy (d,): 1 for components whose error is rounding, which no shorter step reduces.
    - tried (d,): errors of the last rejected step, relative to p in it; infinite if there is none.
    - since (d,): length of the first of the rejected steps in which this error has not fallen.
    """

    control: Control
    counts: Counts
    contraction: Contraction
    largest: Vector
    sizes: Vector
    reach: Vector
    growth: Vector
    reads: Vector
    scales: Vector
    noisy: Vector
    tried: Vector
    since: Vector


class Steps(NamedTuple):
    """Data of n accepted steps for dense output of the orbit, and of its tangents if requested.

    - starts, lengths (n,): of the steps [time].
    - p (n, D, s): the primary unknown at the nodes.
    - at_starts (n, 2, D): y and then p at the starts of the steps.
    - errors (n,): estimated error of each step, divided by its tolerance.

    D is d without tangents. It is (1 + k) d with them: the orbit's components come first.
    """

    starts: Vector
    lengths: Vector
    p: Cube
    at_starts: Cube
    errors: Vector


def empty_steps(n: int, d: int, s: int) -> Steps:
    """Return uninitialised `Steps` for n steps of d components with s nodes."""
    starts, lengths, errors = np.empty((3, n))
    return Steps(starts, lengths, np.empty((n, d, s)), np.empty((n, 2, d)), errors)


class Limits(NamedTuple):
    """Limits of a march: its stop, its longest steps, and its tolerances.

    - stop: time at which the march ends.
    - earliest, latest: times between which f may be called.
    - longest, longest_idle: longest step [time], in general and where the solution is at rest.
    - rtol, atol (d,), by_size: a component y may err by ``atol + rtol |y| + by_size size``. Its
      size is the largest |y| so far (see `StageWorkspace.sizes`).
    - t_end: length of the run.
    - looks: distance of the times at which f is looked at between the nodes.
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
    looks: float


class FirstJacobian(NamedTuple):
    """Arguments of the Jacobian of f before a first step.

    - right, equations, limits: as in `AdaptiveWork`; t: time.
    - x (d,): y.
    - state: as there.
    - units (d,): sizes for the increments of difference quotients of f, which are set.
    """

    right: RightSide
    equations: Equations
    limits: Limits
    t: float
    x: Vector
    state: MarchState
    units: Vector


class Operators(NamedTuple):
    """Matrices from nodal values to the rows of the equations at the nodes of one step.

    Components of one kind share their rows. The K different rows are first those of p for each
    kind, then the terms subtracted from the right-hand side for each kind.

    - matrices (K, 3, s, s): one matrix for each of f, p and y.
    - start_weights (K, s): weights of p at the start of the step.
    - constant (1 + k, R, s): contribution of the offsets.
    - columns (K, 3, s, s): the transposed matrices.
    - alone (K,): 1 if the row depends on f alone, not on p or y.
    - sums (K, s): the row for f = 1, the sums of the matrix of f over its columns.
    """

    matrices: Cubes
    start_weights: Matrix
    constant: Cube
    columns: Cubes
    alone: Integers
    sums: Matrix


class Stages(NamedTuple):
    """Linear systems of Newton's method in one step (collocation/stages.py).

    If many components share their terms, the stages decouple into K <= s systems of size d:

    - factors (K, ., .): factors of each system.
    - order (d,): position of each component in the ordering of a band.
    - dense (2 + 2 K, d, d): a dense Jacobian in Hessenberg form, and factors of each system.
    - shifts (K,): eigenvalues of the matrix of the stages.
    - back (K, s), forth (s, K): from nodal values to coefficients of its eigenvectors, and from
      these to nodal values.

    If terms differ, or components are few, there is one system of size d s for all stages:

    - order (d s,): position of each unknown in the ordering of the matrix.
    - joint (d s, d s): the matrix, or the entries of a sparse one.
    - dense (1, ., .): factors or pivots of this matrix.

    In both cases:

    - scales (d,): powers of 2, the units of y or those that balance a dense Jacobian.
    - lower, upper: numbers of diagonals of a band below and above the main one.
    - lapack, lapack_solve, lapack_values, lapack_balance, python: addresses of functions.
    - hold: number of steps of one length before factors for a longer step are worth their time.
    - kinds (d,): kind of each component; above_one (n,): 1 if the primary unknown of a kind is y'.
    - matrices (n, 3, s, s): matrices of f, p and y for each kind.
    - integral (s, s): integrals of order 1 to the nodes.
    - jacobians (m, d, d): Jacobians at m = s nodes if components are few. Otherwise there is one
      for all nodes, possibly as the entries of a sparse matrix.
    - control (5,): numbers indexed by `LENGTH` to `REDUCED`.
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
    above_one: Integers
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


class StageWorkspace(NamedTuple):
    """Workspace of one step of d components with s nodes; the next step overwrites it.

    - times (s,), check_times (m,): times of the nodes and of the m check points off the nodes.
    - base (1 + k, R, s): known part of the rows: initial values, history and offsets.
    - values (1 + k, n_q, d, s): the integrands at the nodes.
    - jacobians (s, ., .): Jacobian at each node, for tangents.
    - residual, change (d s,): residual of the equations and change of p by Newton's method.
    - nodal_change (d, s): the array `change` in another shape.
    - before (d, s), moved (s, d): y before an iteration, and its change in this iteration.
    - reached (s, s): weights that extrapolate the last step's polynomial to the nodes.
    - forced (d, s): derivative of f by a parameter, for the tangent of this parameter.
    - point, f_at_point (d,): a value of y, and f there.
    - newton_tol (d,): error of p that Newton's method may leave.
    - errors, defect (d,): estimated error of p, and defect of f between the nodes.
    - sizes, sizes_before (d,): sizes of y to which errors are relative, now and before the step.
    - units (d,): size of each component, for the increments of difference quotients of f.
    - force_scales, start_scales (d,): scales |J| |y| and |J| |y(0)| of the rounding error of f.
    - starts (d,): |y(0)| if y is computed as y(0) plus integrals, otherwise 0.
    - rounding (d,): change of p by rounding of f, up to which Newton's method has converged.

    Summands of f are as large as |J| |y|, so f has the rounding error of a number of this size. If
    y is computed as y(0) plus integrals, the rounding of y(0) adds the scale |J| |y(0)|.
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
    f_at_point: Vector
    newton_tol: Vector
    errors: Vector
    defect: Vector
    sizes: Vector
    sizes_before: Vector
    units: Vector
    force_scales: Vector
    starts: Vector
    start_scales: Vector
    rounding: Vector
    base: Cube
    values: Cubes
    jacobians: Cube


# Indices of `Stages.control`. It is an array because a record would not pass through a function
# value in compiled code.
# - LENGTH: step length of the present factors, 0 if there are none.
# - KEPT: 1 if the next step may use the present Jacobian.
# - SYSTEMS: number of decoupled systems.
# - HELD: number of steps for which a longer step was postponed.
# - REDUCED: 1 if the dense Jacobian is in Hessenberg form already.
LENGTH, KEPT, SYSTEMS, HELD, REDUCED, AT_EDGE, N_CONTROL = range(7)
# Indices of the matrices G and M (collocation/stages.py) for one kind of components. The two G act
# on components with p = y and on those with p = y'; REST is M.
OF_VALUES, OF_SPEEDS, REST = range(3)
STAGES = Reference(compiled_type(Stages))
# Arguments: task, nodal values (d, s), which the solution replaces, and `Stages`. Returns 0 on
# success.
STAGES_SIG = I8(I8, MAT, STAGES)


class AdaptiveWork(NamedTuple):
    """All arrays and functions of a march, in one record that is passed by reference.

    Python allocates the arrays (compiled/reference.py). The function `solver` factorises and solves
    the linear systems of the stages.
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
    workspace: StageWorkspace


WORK = Reference(compiled_type(AdaptiveWork))
# Arguments: work, step length, index of the tables. Returns the ratio of the tangents' error to its
# tolerance.
TANGENTS_SIG = F8(WORK, F8, I8)
# Arguments: work, index of the tables, and column: 0 for the orbit, 1 to k for a tangent.
READ_VARYING_SIG = types.void(WORK, I8, I8)
# Arguments: work, step length, index of the tables.
FILLING_SIG = types.void(WORK, F8, I8)


class AdaptiveMarch(NamedTuple):
    """A march: its arrays, and functions for features that few runs need (collocation/march.py)."""

    work: AdaptiveWork
    solve_for_tangents: Annotated[Any, FunctionField(TANGENTS_SIG)]
    read_varying: Annotated[Any, FunctionField(READ_VARYING_SIG)]
    fill_kernels: Annotated[Any, FunctionField(FILLING_SIG)]


ADAPTIVE_MARCH = Reference(compiled_type(AdaptiveMarch))


# Fields of `StageWorkspace` with one number for each component.
_BY_COMPONENT = (
    "point", "f_at_point", "newton_tol", "errors", "defect", "sizes", "sizes_before",
    "units", "force_scales", "starts", "start_scales", "rounding",
)  # fmt: skip


def empty_workspace(
    columns: tuple[int, int], values: tuple[int, int, int, int], stages: Stages, n_checks: int
) -> StageWorkspace:
    """Return an uninitialised `StageWorkspace`, the workspace of one step.

    `columns` is (1 + k, R), and `values` is the shape (1 + k, n_q, d, s) of the integrands. The
    number of check points off the nodes is `n_checks`.
    """
    d, s = values[2:]
    each, none = stages.jacobians, np.empty((0, 0, 0))
    if len(each) == 1:  # the stages of many components share one Jacobian
        each = np.empty((s, *each.shape[1:])) if values[0] > 1 else none
    by_component = {name: np.zeros(d) for name in _BY_COMPONENT}
    change = np.empty(d * s)
    return StageWorkspace(
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


def initial_state(h: float, largest: np.ndarray, sizes: np.ndarray) -> MarchState:
    """Return the `MarchState` of a march that begins with a step of length h.

    `largest` and `sizes` (d,) are the initial values of the fields with these names.
    """
    contraction = record(CONTRACTION, (1.0, 1.0, 1.0, 0.0))
    control, d = record(CONTROL, next=h), sizes.size
    by_component = sizes.copy(), sizes.copy(), *np.zeros((3, d)), *np.full((2, d), np.inf)
    return checked(MarchState(control, record(COUNTS), contraction, largest, sizes, *by_component))


def restored_state(kept: tuple[np.ndarray, ...]) -> MarchState:
    """Return the `MarchState` from its fields, which a checkpoint stores as plain arrays."""
    control, counts, contraction, *sizes = kept
    return checked(
        MarchState(
            record(CONTROL, tuple(control[0])),
            record(COUNTS, tuple(counts[0])),
            record(CONTRACTION, tuple(contraction[0])),
            *(part.copy() for part in sizes),
        )
    )
