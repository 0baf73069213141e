"""Given steps: uniform ones, and meshes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..support.checks import complaint, count, positive, real_array, shown


@dataclass(frozen=True)
class Graded:
    """Mesh ``t_k = t_end (k / n)**exponent``, k = 0..n, made by `graded`."""

    n: int
    exponent: float

    def times(self, t_end: float) -> np.ndarray:
        """Return the mesh on [0, t_end], shape (n+1,)."""
        return t_end * (np.arange(self.n + 1) / self.n) ** self.exponent


def graded(n: int, exponent: float) -> Graded:
    """Define a mesh refined towards t = 0, ``t_k = t_end (k / n)**exponent``.

    For solutions that start like t**alpha, the exponent p / alpha restores a scheme's full order p.

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


class Span(NamedTuple):
    """Shortest step of a mesh but for the last one, and the farthest time it may be resumed to."""

    shortest: float
    farthest: float


# Runs on a mesh can be resumed up to this many times their length.
_FAR = 10.0


def mesh_steps(
    mesh: Graded | ArrayLike, t_end: float, begun: MeshSteps | None = None, origin: float = 0.0
) -> MeshSteps:
    """Steps of a mesh on [0, t_end], checked; those of a run begun stand before them.

    Messages name times from `origin` on.
    """
    start = 0.0 if begun is None else float(begun.mesh[-1])
    if isinstance(mesh, Graded):
        times = start + mesh.times(t_end - start)
    else:
        times = real_array("mesh", mesh)
    required = f"be times that increase from {origin + start:g} to t_end = {origin + t_end}"
    remedy = "pass hereditary.graded(n, exponent) or an array"
    if times.ndim != 1 or times.size < 2:
        raise ValueError(complaint("mesh", required, f"shape {times.shape}", remedy))
    ends = abs(times[0] - start) <= 1e-12 * start and abs(times[-1] - t_end) <= 1e-12 * t_end
    if not ends or np.any(np.diff(times) <= 0):
        raise ValueError(complaint("mesh", required, shown(origin + times), remedy))
    if begun is not None:
        return MeshSteps(np.concatenate([begun.mesh, times[1:]]), begun.span)
    shortest = float(np.diff(times)[:-1].min(initial=np.inf))
    return MeshSteps(times, Span(shortest, _FAR * t_end))


@dataclass(frozen=True)
class UniformSteps:
    """Steps of one length from 0 on.

    Attributes
    ----------
    h : float
        Step [time].
    """

    h: float

    def covered(self, n_steps: int, horizon: float) -> int:
        """Return the number of steps that a history is to cover, at least to `horizon`."""
        return max(int(n_steps), math.ceil(horizon / self.h * (1 - 1e-12)))

    def time(self, n: int) -> float:
        """Time of step n."""
        return n * self.h

    def until(self, n: int) -> UniformSteps:
        """Return the first n steps, which tell all others."""
        return self

    def unit(self, n: int) -> float:
        """Length of the step that ends at step n."""
        return self.h

    def times(self, positions: np.ndarray) -> np.ndarray:
        """Times of positions counted in steps."""
        return positions * self.h

    def positions(self, times: np.ndarray) -> np.ndarray:
        """Positions of times, counted in steps; times of the steps give whole numbers."""
        positions = times / self.h
        mesh = np.rint(positions)
        near = np.abs(positions - mesh) <= 8 * np.finfo(float).eps * mesh
        return np.where(near, mesh, positions)

    def first_from(self, t: float) -> int:
        """Return the number of the first step that is not before t."""
        return int(np.ceil(self.positions(np.array([t]))[0]))

    def plan(self, scheme, system):
        """Plan of a scheme for a system on these steps."""
        return scheme.plan(system, self.h)


@dataclass(frozen=True, eq=False)
class MeshSteps:
    """Steps between given times.

    Attributes
    ----------
    mesh : ndarray, shape (n+1,)
        Times, from 0 on [time].
    span : Span
    """

    mesh: np.ndarray
    span: Span

    h: ClassVar[float] = 0.0

    def covered(self, n_steps: int, horizon: float) -> Span:
        """Return the distances that a history is to cover."""
        return self.span

    def time(self, n: int) -> float:
        """Time of step n."""
        return float(self.mesh[n])

    def until(self, n: int) -> MeshSteps:
        """Return the first n steps."""
        return replace(self, mesh=self.mesh[: n + 1].copy())

    def unit(self, n: int) -> float:
        """Length of the step that ends at step n; of the first one for n = 0."""
        n = max(n, 1)
        return float(self.mesh[n] - self.mesh[n - 1])

    def times(self, positions: np.ndarray) -> np.ndarray:
        """Times of positions counted in steps."""
        return np.interp(positions, np.arange(self.mesh.size), self.mesh)

    def positions(self, times: np.ndarray) -> np.ndarray:
        """Positions of times, counted in steps."""
        return np.interp(times, self.mesh, np.arange(self.mesh.size))

    def first_from(self, t: float) -> int:
        """Return the number of the first step that is not before t."""
        return int(np.searchsorted(self.mesh, t))

    def plan(self, scheme, system):
        """Plan of a scheme for a system on this mesh."""
        return scheme.mesh_plan(system, self.mesh)
