"""Algebraic rows 0 = f(t, y, memory), and consistent values of their unknowns.

An algebraic row is the equation of a component without a derivative. Its unknown is the component
itself or, if f reads Caputo derivatives of it, the highest of them. The rows have index 1 if they
can be solved for their unknowns: the Jacobian with respect to the unknowns is regular.

Letters of shapes: k algebraic rows; d arguments of f, the components of y and then memory.
"""

import numpy as np

from ..compiled.jacobian import LEAST
from ..equation.system import System
from ..stepping.status import SolveWarning
from ..stepping.tolerance import Tolerance
from ..support.checks import refuse
from ..support.scaling import condition, inverse
from ..support.warning import warn

# Largest number of Newton iterations for consistent values.
_CONSISTENCY_MAXITER = 50
# Relative change of the unknowns at which Newton's method for consistent values ends.
_CONSISTENCY_RTOL = 1e-13
# Largest condition number of a regular Jacobian. Difference quotients err by 1e-10.
_MAX_CONDITION_OF_ROWS = 1e9
# Ratio of the least singular value of the rows' Jacobian to that at the start, below which the rows
# become singular. Runs end at 1e-6 where two solutions of the rows meet.
_MIN_SINGULAR_VALUE_RATIO = 1e-4
# Distance from y(0) at which a singular Jacobian is evaluated again, over the sizes of arguments.
_BESIDE = 0.01
# Ratio of a component's coefficients to the largest of other components, and to what f demands in
# the run, below which they may stand for 0.
_NEGLIGIBLE_COEFFICIENT_RATIO = 1e-15


def _unknowns(system: System) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of the algebraic rows and of their unknowns, (k,) each."""
    # an unknown's number is its index among the arguments of f: y, then memory
    rows = np.flatnonzero(system.algebraic)
    columns, highest = rows.copy(), np.zeros(rows.size)
    for operator, coefficients in system.left:
        for c in np.flatnonzero(coefficients).tolist() if operator.constant else ():
            for i in np.flatnonzero(rows == system.sources[c]):
                if operator.order > highest[i]:
                    columns[i], highest[i] = c, operator.order
    return rows, columns


def _jacobian(system: System, t: float, x: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the given rows of the Jacobian of f at x (d,), as a dense matrix (k, d)."""
    found = system.derivative(t, x)
    return (found if system.structure is None else found.toarray())[rows]


def _residual(
    system: System, t: float, x: np.ndarray, rows: np.ndarray, rtol: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return f in the given rows, and the error of f if x errs by rtol |x|, (k,) each."""
    with np.errstate(all="ignore"):
        noise = rtol * (np.abs(_jacobian(system, t, x, rows)) @ np.abs(x))
    return system.rhs(t, x)[rows], noise + LEAST


def _solve(
    system: System, t: float, x: np.ndarray, rows: np.ndarray, columns: np.ndarray
) -> np.ndarray | None:
    """Return arguments of f, x (d,), that solve the rows by Newton's method, or None."""
    # columns: indices of the unknowns in x
    x = x.copy()
    for _ in range(_CONSISTENCY_MAXITER):
        with np.errstate(all="ignore"):
            f_rows = system.rhs(t, x)[rows]
            matrix = _jacobian(system, t, x, rows)[:, columns]
        if not (np.isfinite(f_rows).all() and np.isfinite(matrix).all()) or not _regular(matrix):
            return None
        change = inverse(matrix) @ f_rows
        x[columns] -= change
        if np.all(np.abs(change) <= _CONSISTENCY_RTOL * np.abs(x[columns])):
            return x
    return None


def _regular(matrix: np.ndarray) -> bool:
    """Return whether a matrix is regular; units do not matter."""
    return condition(matrix) <= _MAX_CONDITION_OF_ROWS


def check_start(system: System, t_end: float, tolerance: Tolerance) -> None:
    """Refuse algebraic rows that do not determine their unknowns, or that y(0) contradicts."""
    # warns if initial values contradict a row whose coefficients are next to 0 in a run to t_end
    rtol = tolerance.rtol
    if system.d > 1:
        _name_tiny(system, t_end, rtol)
    if not system.has_algebraic:
        return
    rows, columns = _unknowns(system)
    x, t = system.at_start, system.beside(0.0, 1)
    _check_index(system, t, x, rows, columns)
    f_rows, noise = _residual(system, t, x, rows, rtol)
    y = system.y0[0]
    with np.errstate(all="ignore"):
        at_once = np.minimum(np.abs(f_rows), np.abs(system.rhs(0.0, x)[rows]))
    if np.all(at_once <= noise):
        return
    found = _solve(system, t, x, rows, columns)
    own = rows[rows == columns]
    if found is not None:
        matrix = np.abs(_jacobian(system, t, found, own))
        with np.errstate(all="ignore"):  # rounding of the rows moves their unknowns by so much
            rounding = matrix @ np.abs(found) / matrix[np.arange(own.size), own]
        allowed = rtol * np.maximum(np.abs(y), np.abs(found))[own] + LEAST
        allowed += _CONSISTENCY_RTOL * np.nan_to_num(rounding, posinf=0.0)
        allowed += np.asarray(tolerance.of_march(system, system.frame).atol)[own]
        wrong = own[np.abs(found[own] - y[own]) > allowed]
        if wrong.size == 0:
            return
    else:
        wrong = rows[np.abs(f_rows) > noise]
    c, pairs = int(wrong[0]), 2 if system.frame.paired else 1
    required = f"satisfy 0 = rhs(t, y), the row of component {c // pairs}, which has no derivative"
    got = f"a residual of {f_rows[np.flatnonzero(rows == c)[0]]:.3g}"
    remedy = "give consistent values"
    if found is not None:
        values = ", ".join(f"y0[0, {j // pairs}] = {found[j]:.15g}" for j in wrong[:3])
        remedy = f"they are consistent with {values}"
    refuse("y0", required, got, "" if pairs == 2 else remedy)


def _name_tiny(system: System, t_end: float, rtol: float) -> None:
    """Warn of a row with coefficients next to 0 that the initial values do not satisfy."""
    d, x, t = system.n_solved, system.at_start, system.beside(0.0, 1)
    largest = np.max([np.abs(coefficients[:d]) for _, coefficients in system.left], axis=0)
    (tiny,) = np.nonzero((largest > 0) & (largest < _NEGLIGIBLE_COEFFICIENT_RATIO * largest.max()))
    if tiny.size == 0:
        return
    with np.errstate(all="ignore"):
        own = np.abs(_jacobian(system, t, x, tiny)[np.arange(tiny.size), tiny])
    orders = np.minimum(system.highest_orders()[tiny], 1.0)
    f_rows, noise = _residual(system, t, x, tiny, rtol)
    wrong = np.abs(f_rows) > noise
    wrong &= largest[tiny] < _NEGLIGIBLE_COEFFICIENT_RATIO * own * t_end**orders
    if wrong.any():
        c, residual = tiny[wrong][0], f_rows[wrong][0]
        warn(
            f"the coefficients of component {c // (2 if system.frame.paired else 1)} are at most "
            f"{largest[c]:.3g}, and its row has a residual of {residual:.3g} at the start: if they "
            "stand for 0, write 0, so that the initial values are checked",
            SolveWarning,
        )


def _check_index(
    system: System, t: float, x: np.ndarray, rows: np.ndarray, columns: np.ndarray
) -> None:
    """Refuse rows that cannot be solved for their unknowns, neither at y(0) nor close to it."""
    random = np.random.default_rng(0)
    for distance in (0.0, _BESIDE):
        sizes = np.maximum(np.abs(x), system.units())
        moved = distance * sizes * random.uniform(-1.0, 1.0, x.size)
        with np.errstate(all="ignore"):
            matrix = _jacobian(system, t, x + moved, rows)[:, columns]
        if not np.isfinite(matrix).all() or _regular(matrix):
            return
    pairs = 2 if system.frame.paired else 1
    names = ", ".join(str(c) for c in sorted({int(c) // pairs for c in rows}))
    required = f"determine the components without a derivative, {names}, by their own rows"
    got = "a singular Jacobian with respect to them (an index above 1)"
    refuse("rhs", required, got, "differentiate these rows, and state what follows")


def settled(system: System, t: float, x: np.ndarray) -> np.ndarray:
    """Return the arguments of f, x (d,), with consistent unknowns of the algebraic rows."""
    # x itself if Newton's method does not converge: the next step then solves for the unknowns
    found = _solve(system, t, x, *_unknowns(system))
    return x if found is None else found


def became_singular(system: System, t: float, x: np.ndarray) -> bool:
    """Return whether the rows hardly determine unknowns at x (d,), compared with the start."""
    # columns of J are times the largest components at both times, rows over their largest entries
    rows, columns = _unknowns(system)
    if rows.size == 0:
        return False
    sizes, least = np.maximum(np.abs(x), np.abs(system.at_start)), []
    for time, place in ((system.beside(0.0, 1), system.at_start), (t, x)):
        with np.errstate(all="ignore"):
            matrix = sizes * _jacobian(system, time, place, rows)
        if not np.isfinite(matrix).all():
            return False
        matrix /= np.abs(matrix).max(axis=1, keepdims=True) + LEAST
        least.append(np.linalg.svd(matrix[:, columns], compute_uv=False)[-1])
    return bool(least[1] < _MIN_SINGULAR_VALUE_RATIO * least[0])


def settle_tangents(system: System, values: np.ndarray) -> None:
    """Change initial tangents so that they satisfy the linearised algebraic rows."""
    # values (1 + k, m, d) of the orbit and k tangents, changed in place; not if f reads memory,
    # because unknowns may then be derivatives
    if len(values) == 1 or system.reads or not system.has_algebraic:
        return
    bare = np.flatnonzero(system.algebraic)
    t, y, tangents = system.beside(0.0, 1), values[0, 0], values[1:, 0]
    rows = _jacobian(system, t, y, bare)
    if not _regular(rows[:, bare]):  # the rows may be singular at the start alone
        return
    tangents[:, bare] = 0.0
    forces = tangents @ rows.T
    forces[: system.by_params] += system.derivatives_by_parameters(t, y)[:, bare]
    tangents[:, bare] = -forces @ inverse(rows[:, bare]).T


def derivatives_at_start(system: System) -> dict[int, float]:
    """Return the derivatives that algebraic rows determine at the start: {component: value}."""
    # they are the unknowns of rows whose f reads derivatives of the row's component
    rows, columns = _unknowns(system)
    found = _solve(system, system.beside(0.0, 1), system.at_start, rows, columns)
    if found is None:
        return {}
    factors = np.sum([coefficients for _, coefficients in system.left], axis=0)
    derived = columns[columns != rows]
    return {int(system.sources[c]): float(found[c] / factors[c]) for c in derived}
