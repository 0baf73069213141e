"""The past on meshes of any steps: stored pieces, or modes."""

import numpy as np

from ..support.checks import complaint
from .history import Memory


class MeshMemory(Memory):
    """The running memory of a march on a mesh of any steps.

    Parameters
    ----------
    exchange : compiled function
    sums : MeshSums
    kinds : tuple of three ndarrays
        Factors, powers and derivatives of the terms, or rates, weights and derivatives of modes.
    arrays : tuple of three ndarrays
    n_modes : int
        Modes held for each component.
    covers : Span, optional
        Distances that the modes hold at.
    """

    def __init__(self, exchange, sums, kinds, arrays, n_modes=0, covers=None):
        kind, theta = np.full((1, 1), float(sums.parabolas)), sums.theta.reshape(1, -1)
        times = np.ascontiguousarray(sums.times.reshape(1, -1))
        first, second, derivatives = kinds
        tables = (times, sums.rows.lead, theta, first, second, sums.rule, kind, derivatives)
        none = np.zeros((len(sums.factors), 0))
        super().__init__(exchange, tables, arrays, none, none)
        self.n_modes, self._covers, self._mesh = n_modes, covers, sums.times

    def prepare(self, n_end):
        """Refuse steps that the modes do not reach."""
        if self._covers is None:
            return
        shortest = float(np.diff(self._mesh[:n_end]).min(initial=np.inf))
        if shortest < self._covers.shortest * (1 - 1e-9):
            required = (
                f"have no steps below {self._covers.shortest:g}, the shortest of the run begun"
            )
            raise ValueError(complaint("mesh", required, f"one of {shortest:g}"))
        if self._mesh[n_end] > self._covers.farthest:
            required = f"stay within t = {self._covers.farthest:g}, as far as its history reaches"
            remedy = "begin the run with SumOfExponentials(horizon=), the time it is to reach"
            raise ValueError(complaint("resume", required, f"{self._mesh[n_end]:g}", remedy))

    def restore(self, state):
        """Take the contents from what `state` returned, with room for the rest of the mesh."""
        super().restore(state)
        n = self._mesh.size - 1 if self.n_modes == 0 else 0
        self.arrays = tuple(
            np.pad(array, ((0, 0), (0, max(0, n - array.shape[1])))) if array.shape[1] else array
            for array in self.arrays
        )
