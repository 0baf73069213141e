"""Steps given in advance, uniform or on a mesh, and the steps that end at jumps of f."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..equation.system import System
from ..stepping.scheme import Scheme
from ..support.checks import count, positive, real_array, refuse, shown
from .plan import Plan
from .signatures import StepRows


@dataclass(frozen=True)
class Graded:
    """A mesh ``t_k = t_end (k / n)**exponent``, k = 0..n, made by `graded`."""

    n: int
    exponent: float

    def times(self, t_end: float) -> np.ndarray:
        """Return the mesh on [0, t_end], shape (n+1,)."""
        return t_end * (np.arange(self.n + 1) / self.n) ** self.exponent


def graded(n: int, exponent: float) -> Graded:
    """Define a mesh refined towards t = 0, ``t_k = t_end (k / n)**exponent``.

    If a solution starts like t**alpha, a scheme has its full order p with the exponent p / alpha.

    Parameters
    ----------
    n : int
        Number of steps.
    exponent : float
        1 gives uniform steps; larger values refine the start [-].

    Returns
    -------
    Graded
        For ``solve(..., mesh=graded(n, exponent))``.

    Examples
    --------
    >>> import hereditary as hd
    >>> hd.graded(4, 2.0).times(1.0).tolist()
    [0.0, 0.0625, 0.25, 0.5625, 1.0]
    """
    return Graded(count("n", n), positive("exponent", exponent))


# A run on a mesh can be resumed up to this factor times its end time.
_RESUMPTION_FACTOR = 10.0
# Most steps of a run. Larger whole numbers are not all floats.
COUNTED = 2**53
# Largest distance of a break from the end of a step, as a fraction of the step.
_MAX_BREAK_OFFSET = 1e-6
# A step next to a jump of f takes f this far from the jump, relative to the time.
_JUMP_OFFSET = 8 * np.finfo(float).eps


class Span(NamedTuple):
    """Shortest step of a mesh apart from its last step, and the last time of any resumed run."""

    shortest: float
    farthest: float


def mesh_steps(
    mesh: Graded | ArrayLike, t_end: float, so_far: MeshSteps | None = None, origin: float = 0.0
) -> MeshSteps:
    """Check a mesh to t_end, and return its steps behind those so far."""
    # messages add origin to times
    start = 0.0 if so_far is None else float(so_far.mesh[-1])
    if isinstance(mesh, Graded):
        times = start + mesh.times(t_end - start)
    else:
        times = real_array("mesh", mesh)
    required = f"be times that increase from {origin + start:g} to t_end = {origin + t_end}"
    remedy = "pass hereditary.graded(n, exponent) or an array"
    if times.ndim != 1 or times.size < 2:
        refuse("mesh", required, f"shape {times.shape}", remedy)
    ends = abs(times[0] - start) <= 1e-12 * start and abs(times[-1] - t_end) <= 1e-12 * t_end
    if not ends or np.any(np.diff(times) <= 0):
        refuse("mesh", required, shown(origin + times), remedy)
    if so_far is not None:
        return MeshSteps(np.concatenate([so_far.mesh, times[1:]]), so_far.span)
    shortest = float(np.diff(times)[:-1].min(initial=np.inf))
    return MeshSteps(times, Span(shortest, _RESUMPTION_FACTOR * t_end))


@dataclass(frozen=True)
class UniformSteps:
    """Steps of one length from 0 on."""

    h: float  # [time]
    n: int = 0  # of the run
    span: int = 0  # number that the history covers; 0 before the run begins

    def covered(self, n_steps: int, horizon: float) -> int:
        """Return the number of steps that the history must cover: the run's, or up to `horizon`."""
        return max(self.span or int(n_steps), math.ceil(horizon / self.h * (1 - 1e-12)))

    def time(self, n: int) -> float:
        """Return t_n, the time after n steps."""
        return n * self.h

    def until(self, n: int) -> UniformSteps:
        """Return the first n steps."""
        return replace(self, n=n)

    def unit(self, n: int) -> float:
        """Return the length of the step from t_(n-1) to t_n."""
        return self.h

    def times(self, positions: np.ndarray) -> np.ndarray:
        """Return times of positions; the position of t_n is n."""
        return positions * self.h

    def positions(self, times: np.ndarray) -> np.ndarray:
        """Return positions ``times / h``; rounding errors of whole numbers are removed."""
        positions = times / self.h
        mesh = np.rint(positions)
        near = np.abs(positions - mesh) <= 8 * np.finfo(float).eps * mesh
        return np.where(near, mesh, positions)

    def first_from(self, t: float) -> int:
        """Return the least n with t_n >= t."""
        return int(np.ceil(self.positions(np.array([t]))[0]))

    def plan(self, scheme: Scheme, system: System) -> Plan:
        """Return the plan of a scheme for a system on these steps."""
        return scheme.plan(system, self.h)


@dataclass(frozen=True, eq=False)
class MeshSteps:
    """Steps between the times of a mesh."""

    mesh: np.ndarray  # times t_0 = 0 to t_n, (n+1,) [time]
    span: Span  # time lags that the history must cover

    h: ClassVar[float] = 0.0

    @property
    def n(self) -> int:
        """Number of steps."""
        return self.mesh.size - 1

    def covered(self, n_steps: int, horizon: float) -> Span:
        """Return the range of time lags that the history must cover."""
        return self.span

    def time(self, n: int) -> float:
        """Return t_n, the time after n steps."""
        return float(self.mesh[n])

    def until(self, n: int) -> MeshSteps:
        """Return the first n steps."""
        return replace(self, mesh=self.mesh[: n + 1].copy())

    def unit(self, n: int) -> float:
        """Return the length of the step from t_(n-1) to t_n; that of the first step for n = 0."""
        n = max(n, 1)
        return float(self.mesh[n] - self.mesh[n - 1])

    def times(self, positions: np.ndarray) -> np.ndarray:
        """Return times of positions; the position of t_n is n, linear in between."""
        return np.interp(positions, np.arange(self.mesh.size), self.mesh)

    def positions(self, times: np.ndarray) -> np.ndarray:
        """Return positions of times; the position of t_n is n, linear in between."""
        return np.interp(times, self.mesh, np.arange(self.mesh.size))

    def first_from(self, t: float) -> int:
        """Return the least n with t_n >= t."""
        return int(np.searchsorted(self.mesh, t))

    def plan(self, scheme: Scheme, system: System) -> Plan:
        """Return the plan of a scheme for a system on this mesh."""
        return scheme.mesh_plan(system, self.mesh)


def steps_in(name: str, length: float, h: float) -> int:
    """Return ``length / h`` rounded to a whole number of steps; refuse more than `COUNTED`."""
    if not length / h <= COUNTED:
        refuse(name, f"be at most {COUNTED:.0e} steps h = {h:g}", f"{length:g}")
    return round(length / h)


def break_steps(
    times: np.ndarray, start: float, t_end: float, steps: Any, origin: float
) -> frozenset[int]:
    """Return the numbers n of all breaks t_n in [start, t_end], as a frozenset."""
    # refuses breaks that are not at ends of steps; the message adds origin to times
    times = times[(times >= start) & (times <= t_end)]
    if times.size == 0:
        return frozenset()
    positions = steps.positions(times)
    numbers = np.rint(positions)
    off = np.abs(positions - numbers) > _MAX_BREAK_OFFSET
    if np.any(off):
        required = "be times of steps, which see the jump from its own side each"
        remedy = "take as many steps that one ends there, or a mesh through it"
        refuse("breaks", required, shown(origin + times[off]), remedy)
    return frozenset(int(n) for n in numbers)


def before_break(breaks: frozenset[int], n: int, stop: int) -> int:
    """Return the step to which a call may go from n: steps next to breaks need their own."""
    if not breaks:
        return stop
    if breaks & {n, n + 1}:
        return n + 1
    return min([stop, *(number - 1 for number in breaks if number > n)])


def rows_beside(
    breaks: frozenset[int], n: int, rows: StepRows, steps: Any, origin: float
) -> StepRows:
    """Return `rows`, with f taken slightly inside step n if a break is at its end."""
    # breaks: numbers n of all breaks t_n. Otherwise a step might take f on the wrong side of the
    # jump. The shift exceeds the rounding of the user's times, which add origin.
    if not breaks:
        return rows
    theta = rows.theta
    for beside, seen, sign in ((n + 1 in breaks, 1.0, -1.0), (n in breaks, 0.0, 1.0)):
        if beside and np.all(theta == seen):
            t = steps.time(n + 1)
            theta = theta + sign * _JUMP_OFFSET * max(t, abs(origin), abs(origin + t)) / steps.unit(
                n + 1
            )
    return rows._replace(theta=theta)


def kept_steps(times: np.ndarray, h: float, start: float) -> np.ndarray:
    """Return the numbers n with ``start + n h`` equal to the given times; refuse other times."""
    positions = (times - start) / h
    numbers = np.rint(positions)
    if np.any(np.abs(positions - numbers) > _MAX_BREAK_OFFSET):
        required = f"be times of steps, whole multiples of h = {h:g} from t_start on"
        refuse("t_eval", required, shown(times))
    return numbers.astype(np.int64)
