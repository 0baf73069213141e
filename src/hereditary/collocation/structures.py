"""Named groups of arrays that compiled collocation works on, and their compiled types.

The primary unknown p of a component is y, or y' for orders above 1. Letters of axes are:

- d components, s nodes of a step, M exponential modes, k tangents;
- R rows: row c < d is p of component c, row d + c the terms subtracted from its right-hand side;
- R_m rows of modes: these R rows, then d rows for each integrand of terms with varying orders;
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
from ..stepping.tolerance import Tolerance

# Record of a convolution term: its row, its integrand, the index of its order or kernel, and its
# coefficient.
TERM = np.dtype(
    [("row", "i8"), ("integrand", "i8"), ("index", "i8"), ("coefficient", "f8")], align=True
)
# Record of the step control.
_TIMES = (
    "time",  # present time since the origin
    "next",  # length of the next step
    "last",  # length of the last accepted step
    "shortest",  # length of the shortest step for which the exponential modes are accurate
    "rejected",  # 1 if the last trial step was rejected
    "origin",  # time from which steps are counted
    "worst",  # component with the largest ratio of error to tolerance in the last trial step
    "missed",  # time in a rejected step at which f differed from its polynomial, or 0
    "jump",  # time of the last jump of f that was found, or 0
    "tried",  # length of the last rejected step
    "begins",  # 1 in a first step, where components may grow from nothing
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
    """Integral equations of all components (collocation/equations.py), with n terms."""

    terms: Annotated[Records, "n"]  # convolution terms, records `TERM`
    orders: Annotated[Vector, "n_a"]  # orders of the fractional integrals
    above_one: Annotated[Integers, "d"]  # 1 if the primary unknown is y'
    offsets: Annotated[Matrix, "1+k n"]  # constant subtracted from the integrand of each term
    # 1 if p follows from the balance of right-hand side and terms; `ALGEBRAIC` without terms; or 0
    implicit: Annotated[Integers, "d"]
    # integrands of terms with varying orders, whose modes are stored without weights
    unweighted: Annotated[Integers, "."]
    kinds: Annotated[Integers, "d"]  # number of the kind; components of a kind have the same terms
    units: Annotated[Vector, "d"]  # sizes, for the increments of difference quotients of f
    rates: Annotated[Vector, "d"]  # f over the y that it makes in the run, if it is constant
    sources: Annotated[Integers, "d"]  # component that bounds the size of each from below
    least: Annotated[Vector, "d"]  # least size of each, relative to that of its source
    divisors: Annotated[Vector, "d"]  # least number by which an implicit row is divided


class Rule(NamedTuple):
    """Quadrature of one step: nodes, and matrices that act on values at the nodes.

    There are m = 2 check points off the nodes, which enter the error of a step.
    """

    nodes: Annotated[Vector, "s"]  # in (0, 1]
    integrals: Annotated[Cube, "n_a s s"]  # fractional integrals from the start to each node
    legendre: Annotated[Matrix, "s s"]  # Legendre coefficients of the polynomial through the values
    inverse: Annotated[Matrix, "s s"]  # inverse of the integrals of order 1
    check_points: Annotated[Vector, "m"]
    check_integrals: Annotated[Matrix, "m s"]  # integral of this polynomial to each check point
    check_values: Annotated[Matrix, "m s"]  # value of this polynomial at each check point
    variable: Annotated[Vector, "3"]  # the numbers q, m and c of a first step's `Variable`


class ExponentialBasis(NamedTuple):
    """Rates of all modes, and the kernels as weighted sums of them.

    The M = n + 2 m modes are in the order of kernels/mode_bank.py.
    """

    rates: Annotated[Vector, "n"]  # the real rates
    pairs: Annotated[ComplexVector, "m"]  # rate with positive imaginary part of each conjugate pair
    weights: Annotated[Matrix, "n_a+n_k M"]  # of the modes, for fractional integrals and kernels
    masses: Annotated[Vector, "n_k"]  # point masses of the kernels at time lag 0
    # matrix i maps values at the nodes to Legendre coefficients on the interval [0, node i]
    transforms: Annotated[Cube, "s s s"]


class StepTables(NamedTuple):
    """Factors of the modes for K step lengths, computed once for each length."""

    lengths: Annotated[Vector, "K"]  # of the steps [time]; 0 for none
    to_nodes: Annotated[Cube, "K M s"]  # decay of each mode from the start of the step to the nodes
    to_end: Annotated[Matrix, "K M"]  # decay of each mode from the start to the end of the step
    moments: Annotated[Cube, "K s M"]  # integrals of the Legendre polynomials times exponentials
    # convolutions over the step with general kernels, then with the kernels of varying orders
    local: Annotated[Cubes, "K n_k s s"]


class ModeWeights(NamedTuple):
    """Weights with which a step adds its integrals to the modes (collocation/mode_tables.py).

    K_m counts the rows of modes that differ: components of one kind share their rows.
    """

    integrands: Annotated[Cube, "K_m n_q M"]  # weight of each integrand in each mode
    used: Annotated[IntegerMatrix, "K_m n_q"]  # 1 if an integrand has a nonzero weight in any mode
    offsets: Annotated[Cube, "1+k R_o M"]  # of constant offsets; R_o is R_m, or 0 if all are 0
    part: Annotated[Vector, "M"]  # work array
    coefficients: Annotated[Vector, "s"]  # work array


class VaryingOrders(NamedTuple):
    """Tables of the varying orders for one step."""

    tabulated: Tabulated  # the step that the tables are valid for
    integrals: Annotated[Cube, "n_v s s"]  # over the step, with the order at each node
    weights: Annotated[Cube, "n_v M s"]  # weights of the modes, with the order at each node
    of_varying: Annotated[Vector, "M"]  # 1 for the modes of varying orders, 0 for others


class OrbitArrays(NamedTuple):
    """The orbit and its tangents: present values, initial values and history."""

    # p(0) plus the content of modes of rate 0, or 0 where p is implicit
    initial: Annotated[Matrix, "1+k d"]
    x: Annotated[Matrix, "1+k d"]  # y at the present time
    p: Annotated[Matrix, "1+k d"]  # the primary unknown at the present time
    modes: Annotated[Cube, "1+k R_m M"]  # modes at the end of the last step
    before: Annotated[Cube, "1+k R_m M"]  # modes at the start of the last step
    last: Annotated[Cubes, "1+k n_q d s"]  # the integrands at the nodes of the last step


class MarchState(NamedTuple):
    """Step control, counts and contraction of Newton's method."""

    control: Control
    counts: Counts
    contraction: Contraction
    largest: Annotated[Vector, "d"]  # the largest |y'| so far, where p is y'
    sizes: Annotated[Vector, "d"]  # the largest |y| so far
    reach: Annotated[Vector, "d"]  # what others could make of each in the run (compiled/reach.py)
    growth: Annotated[Vector, "d"]  # what each makes of itself by growing as a power of time
    reads: Annotated[Vector, "d"]  # largest change of f by delayed values, in units of f
    # largest |J| |y| summed over a step, so that its rounding is that of y by f
    scales: Annotated[Vector, "d"]
    noisy: Annotated[Vector, "d"]  # 1 if the error is rounding, which no shorter step reduces
    # errors of the last rejected step, relative to p in it; infinite if there is none
    tried: Annotated[Vector, "d"]
    # length of the first of the rejected steps in which this error has not fallen
    since: Annotated[Vector, "d"]


class Steps(NamedTuple):
    """Data of n accepted steps for dense output of the orbit, and of its tangents if requested.

    D is d without tangents. It is (1 + k) d with them: the orbit's components come first.
    """

    starts: Annotated[Vector, "n"]  # of the steps [time]
    lengths: Annotated[Vector, "n"]  # of the steps [time]
    p: Annotated[Cube, "n D s"]  # the primary unknown at the nodes
    at_starts: Annotated[Cube, "n 2 D"]  # y and then p at the starts of the steps
    errors: Annotated[Vector, "n"]  # estimated error of each step, divided by its tolerance


class Limits(NamedTuple):
    """Limits of a march: its stop, its longest steps, and the allowed errors of a step."""

    stop: float  # time at which the march ends
    earliest: float  # time from which f may be called
    latest: float  # time up to which f may be called
    longest: float  # longest step [time]
    longest_idle: float  # longest step [time] where the solution is at rest
    t_end: float  # length of the run
    looks: float  # distance of the times at which f is looked at between the nodes
    tolerance: Tolerance  # of a step; it refers to `StageWorkspace.sizes`


class FirstJacobian(NamedTuple):
    """Arguments of the Jacobian of f before a first step."""

    right: RightSide
    equations: Equations
    limits: Limits
    t: float  # time
    x: Annotated[Vector, "d"]  # y
    state: MarchState
    # sizes for the increments of difference quotients of f, which are set
    units: Annotated[Vector, "d"]


class Operators(NamedTuple):
    """Matrices from nodal values to the rows of the equations at the nodes of one step.

    Components of one kind share their rows. The K different rows are first those of p for each
    kind, then the terms subtracted from the right-hand side for each kind.
    """

    matrices: Annotated[Cubes, "K 3 s s"]  # one matrix for each of f, p and y
    start_weights: Annotated[Matrix, "K s"]  # weights of p at the start of the step
    constant: Annotated[Cube, "1+k R s"]  # contribution of the offsets
    columns: Annotated[Cubes, "K 3 s s"]  # the transposed matrices
    alone: Annotated[Integers, "K"]  # 1 if the row depends on f alone, not on p or y
    sums: Annotated[Matrix, "K s"]  # the row for f = 1, the sums of the matrix of f over columns


class Stages(NamedTuple):
    """Linear systems of Newton's method in one step (collocation/stages.py).

    If many components share their terms, the stages decouple into K <= s systems of size d. If
    terms differ, or components are few, there is one system of size d s for all stages.
    """

    factors: Annotated[ComplexCube, ". . ."]  # factors of each decoupled system
    # position of each component, or of each unknown of one system, in the ordering of the matrix
    order: Annotated[Integers, "."]
    lower: int  # number of diagonals of a band below the main one
    upper: int  # number of diagonals of a band above the main one
    lapack: int  # addresses of functions
    lapack_solve: int
    lapack_values: int
    lapack_balance: int
    python: int
    hold: int  # steps of one length before factors for a longer step are worth their time
    kinds: Annotated[Integers, "d"]  # kind of each component
    above_one: Annotated[Integers, "n"]  # 1 if the primary unknown of a kind is y'
    matrices: Annotated[Cubes, "n 3 s s"]  # matrices of f, p and y for each kind
    integral: Annotated[Matrix, "s s"]  # integrals of order 1 to the nodes
    shifts: Annotated[ComplexVector, "s"]  # eigenvalues of the matrix of the stages, in K entries
    back: Annotated[ComplexMatrix, "s s"]  # K rows: from nodal values to eigenvectors' coefficients
    forth: Annotated[ComplexMatrix, "s s"]  # K columns: from these coefficients to nodal values
    # s Jacobians if components are few; else one for all nodes, or the entries of a sparse one
    jacobians: Annotated[Cube, ". . ."]
    scales: Annotated[Vector, "d"]  # powers of 2: units of y, or what balances a dense Jacobian
    # decoupled: a dense Jacobian in Hessenberg form and factors of each system, (2 + 2 K, d, d);
    # of one system: factors or pivots, (1, ., .)
    dense: Annotated[Cube, ". . ."]
    joint: Annotated[Matrix, ". ."]  # matrix of one system, (d s, d s), or entries of a sparse one
    control: Annotated[Vector, "n_c"]  # numbers indexed by `LENGTH` to `AT_EDGE`


class StageWorkspace(NamedTuple):
    """Workspace of one step of d components with s nodes; the next step overwrites it.

    Summands of f are as large as |J| |y|, so f has the rounding error of a number of this size. If
    y is computed as y(0) plus integrals, the rounding of y(0) adds the scale |J| |y(0)|.
    """

    times: Annotated[Vector, "s"]  # times of the nodes
    check_times: Annotated[Vector, "m"]  # times of the check points off the nodes
    residual: Annotated[Vector, "d*s"]  # residual of the equations
    change: Annotated[Vector, "d*s"]  # change of p by Newton's method
    nodal_change: Annotated[Matrix, "d s"]  # the array `change` in another shape
    before: Annotated[Matrix, "d s"]  # y before an iteration
    moved: Annotated[Matrix, "s d"]  # change of y in this iteration
    reached: Annotated[Matrix, "s s"]  # weights that extrapolate the last polynomial to the nodes
    forced: Annotated[Matrix, "d s"]  # derivative of f by a parameter, for its tangent
    point: Annotated[Vector, "d"]  # a value of y
    f_at_point: Annotated[Vector, "d"]  # f there
    newton_tol: Annotated[Vector, "d"]  # error of p that Newton's method may leave
    errors: Annotated[Vector, "d"]  # estimated error of p
    defect: Annotated[Vector, "d"]  # defect of f between the nodes
    sizes: Annotated[Vector, "d"]  # sizes of y to which errors are relative
    sizes_before: Annotated[Vector, "d"]  # these sizes before the step
    units: Annotated[Vector, "d"]  # sizes, for the increments of difference quotients of f
    force_scales: Annotated[Vector, "d"]  # |J| |y|, the scale of the rounding error of f
    starts: Annotated[Vector, "d"]  # |y(0)| if y is computed as y(0) plus integrals, otherwise 0
    start_scales: Annotated[Vector, "d"]  # |J| |y(0)|, the scale of the rounding error of y(0)
    # change of p by rounding of f, up to which Newton's method has converged
    rounding: Annotated[Vector, "d"]
    base: Annotated[Cube, "1+k R s"]  # known part of the rows: initial values, history, offsets
    values: Annotated[Cubes, "1+k n_q d s"]  # the integrands at the nodes
    jacobians: Annotated[Cube, ". . ."]  # Jacobian at each node, for tangents


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
