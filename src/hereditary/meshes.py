"""Meshes that are not uniform (floor 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ._checks import complaint, count, positive, real_array, shown


@dataclass(frozen=True)
class Graded:
    """A mesh ``t_k = t_end (k / n)**exponent``, k = 0..n; made by `graded`."""

    n: int
    exponent: float

    def times(self, t_end: float) -> np.ndarray:
        """The mesh on [0, t_end], shape (n+1,)."""
        return t_end * (np.arange(self.n + 1) / self.n) ** self.exponent


def graded(n: int, exponent: float) -> Graded:
    """A mesh refined towards t = 0, ``t_k = t_end (k / n)**exponent``.

    Solutions that start like t**alpha keep a scheme's full order p on it with exponent p / alpha.

    Parameters
    ----------
    n : int
        Number of steps.
    exponent : float
        1 gives uniform steps; larger ones refine the start [-].

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


def mesh_times(mesh: Graded | ArrayLike, t_end: float) -> np.ndarray:
    """Times of a mesh on [0, t_end], checked."""
    times = mesh.times(t_end) if isinstance(mesh, Graded) else real_array("mesh", mesh)
    required = f"be times that increase from 0 to t_end = {t_end}"
    remedy = "pass hereditary.graded(n, exponent) or an array"
    if times.ndim != 1 or times.size < 2:
        raise ValueError(complaint("mesh", required, f"shape {times.shape}", remedy))
    if times[0] != 0 or abs(times[-1] - t_end) > 1e-12 * t_end or np.any(np.diff(times) <= 0):
        raise ValueError(complaint("mesh", required, shown(times), remedy))
    return times
