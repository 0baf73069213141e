"""Groups of arrays that compiled collocation works on (floor 1): their fields, and their types.

Letters of shapes: d components, R rows of integral equations, s nodes of a step, M modes, n_a
fractional integrals, n_k general kernels and then orders that vary, k tangents beside the orbit.
"""

from typing import NamedTuple

import numpy as np
from numba import from_dtype, types

from .._jit import CUBE, CUBES, F8, IVEC, MAT, VEC

# One convolution of a row: which integrand, with which order or kernel, times what.
TERM = np.dtype(
    [("row", "i8"), ("integrand", "i8"), ("index", "i8"), ("coefficient", "f8")], align=True
)
# Times [time]: present time since the origin, length of the next step and of the last one, closest
# distance that the modes hold at, whether the last trial was refused, and the origin itself.
_TIMES = "time", "next", "last", "closest", "refused", "origin"
CONTROL = np.dtype([(name, "f8") for name in _TIMES], align=True)
# Calls of the right-hand side, steps accepted, refused, and refused for what f is off its nodes.
COUNTS = np.dtype(
    [("rhs", "i8"), ("accepted", "i8"), ("refused", "i8"), ("off_nodes", "i8")], align=True
)
# How Newton's method contracted, the change that was seen at, and the length of that step.
CONTRACTION = np.dtype([("rate", "f8"), ("change", "f8"), ("length", "f8")], align=True)
# Start, since the origin, and length of the step that is known, and of the one that is wanted.
KNOWN = np.dtype(
    [("start", "f8"), ("length", "f8"), ("next_start", "f8"), ("next_length", "f8")], align=True
)


class Equations(NamedTuple):
    """Integral equations of all components (collocation/equations.py).

    terms (n,) of `TERM`; orders (n_a,) of the fractional integrals; second (d,), whether the
    primary unknown is y'; offsets (1 + k, n), what is taken from each integrand; implicit (d,),
    whether p is what makes right-hand side and terms equal; raw, integrands with orders that vary.
    """

    terms: np.ndarray
    orders: np.ndarray
    second: np.ndarray
    offsets: np.ndarray
    implicit: np.ndarray
    raw: np.ndarray


class Rule(NamedTuple):
    """Nodes of a step and what belongs to their polynomials.

    nodes (s,); integrals (n_a, s, s) from values to integrals at the nodes; legendre (s, s) from
    values to coefficients; inverse (s, s) of the last integrals; points (m,) off the nodes; risen
    and extended (m, s), from values to the integral from the start, and to values, there.
    """

    nodes: np.ndarray
    integrals: np.ndarray
    legendre: np.ndarray
    inverse: np.ndarray
    points: np.ndarray
    risen: np.ndarray
    extended: np.ndarray


class ExponentialBasis(NamedTuple):
    """Rates (M,) of all modes, and kernels as sums of them.

    weights (n_a + n_k, M); masses (n_k,) at distance 0; transforms (s, s, s), from values at the
    nodes to Legendre coefficients on [0, node i].
    """

    rates: np.ndarray
    weights: np.ndarray
    masses: np.ndarray
    transforms: np.ndarray


class StepTables(NamedTuple):
    """Factors of steps of some lengths (K,): decay to the nodes and to the end, and moments.

    reads (K, M, s), keeps (K, M); moments (K, s, M) of Legendre polynomials; local (K, n_k, s, s),
    matrices of general kernels within the step.
    """

    lengths: np.ndarray
    reads: np.ndarray
    keeps: np.ndarray
    moments: np.ndarray
    local: np.ndarray


class VaryingOrders(NamedTuple):
    """Orders that vary, as one step sees them.

    known: a record `KNOWN`; integrals (n_v, s, s); weights (n_v, M, s) of the modes at the nodes;
    own (M,), 1 for the modes of such orders.
    """

    known: np.record
    integrals: np.ndarray
    weights: np.ndarray
    own: np.ndarray


class Strands(NamedTuple):
    """The orbit and its tangents: present values, initial values, and the past.

    initial, x, p (1 + k, d); modes, and those before the last step (1 + k, R, M); last (1 + k, 3 or
    4, d, s): f, p and y, and p' where it is an integrand, at the nodes of the last step.
    """

    initial: np.ndarray
    x: np.ndarray
    p: np.ndarray
    modes: np.ndarray
    before: np.ndarray
    last: np.ndarray


class Run(NamedTuple):
    """Counts and controls of a march, as records; the largest p so far where it is y', (d,)."""

    control: np.record
    counts: np.record
    contraction: np.record
    largest: np.ndarray


class Steps(NamedTuple):
    """Steps made, as dense output needs them.

    starts and lengths (n,); p at the nodes (n, d, s); y at the start and then p (n, 2, d); error
    over tolerance (n,).
    """

    starts: np.ndarray
    lengths: np.ndarray
    p: np.ndarray
    begins: np.ndarray
    errors: np.ndarray


class Limits(NamedTuple):
    """Where a march stops, its longest step, there where nothing happens too, and tolerances."""

    stop: float
    longest: float
    longest_idle: float
    rtol: float
    atol: float


class Operators(NamedTuple):
    """How values at the nodes enter each row at the nodes, within one step.

    matrices (R, 3, s, s), one for each of f, p and y; starts (R, s), shares of p at the start;
    constant (1 + k, R, s), what the offsets take.
    """

    matrices: np.ndarray
    starts: np.ndarray
    constant: np.ndarray


class Factors(NamedTuple):
    """A factorised Newton matrix (d s, d s), the order of its rows (d s,), and |J| |y|, (d,).

    The last tells how large what a right-hand side adds up is, whose rounding it cannot lose.
    """

    matrix: np.ndarray
    order: np.ndarray
    sizes: np.ndarray


CONTROL_RECORD, COUNTS_RECORD = from_dtype(CONTROL), from_dtype(COUNTS)
CONTRACTION_RECORD, KNOWN_RECORD = from_dtype(CONTRACTION), from_dtype(KNOWN)
TERMS = types.Array(from_dtype(TERM), 1, "C")
EQUATIONS = types.NamedTuple((TERMS, VEC, IVEC, MAT, IVEC, IVEC), Equations)
RULE = types.NamedTuple((VEC, CUBE, MAT, MAT, VEC, MAT, MAT), Rule)
BASIS = types.NamedTuple((VEC, MAT, VEC, CUBE), ExponentialBasis)
TABLES = types.NamedTuple((VEC, CUBE, MAT, CUBE, CUBES), StepTables)
VARYING = types.NamedTuple((KNOWN_RECORD, CUBE, CUBE, VEC), VaryingOrders)
STRANDS = types.NamedTuple((MAT, MAT, MAT, CUBE, CUBE, CUBES), Strands)
RUN = types.NamedTuple((CONTROL_RECORD, COUNTS_RECORD, CONTRACTION_RECORD, VEC), Run)
STEPS = types.NamedTuple((VEC, VEC, CUBE, CUBE, VEC), Steps)
LIMITS = types.NamedUniTuple(F8, 5, Limits)


def record(dtype, values=None, **fields):
    """Return a record that compiled code may change: of these values, or 0 but for some fields."""
    found = np.array([values] if values else [(0,) * len(dtype)], dtype).view(np.recarray)[0]
    for name, value in fields.items():
        setattr(found, name, value)
    return found


def plain(part):
    """Return a record, or an array of them, as an array of numbers; anything else as it is."""
    named = part.dtype.names
    return part if named is None else np.array(part.tolist(), dtype=float).reshape(-1, len(named))


def begin_run(h, largest):
    """Return what a march counts and controls, its first step being of length h."""
    seen = record(CONTRACTION, rate=1.0, change=1.0, length=1.0)
    return Run(record(CONTROL, next=h), record(COUNTS), seen, largest)


def run_of(kept):
    """Return the `Run` whose parts were kept as arrays of numbers."""
    control, counts, seen, largest = kept
    return Run(
        record(CONTROL, tuple(control[0])),
        record(COUNTS, tuple(counts[0])),
        record(CONTRACTION, tuple(seen[0])),
        largest.copy(),
    )
