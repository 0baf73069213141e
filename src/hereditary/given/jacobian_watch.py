"""Watch of the stability of a march by Jacobians along the orbit."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiled.jacobian import VALUES
from ..equation.system import System
from .stability import StabilityRegion

# Most components for which stability is watched by dense Jacobians. Beyond it they would take more
# time and storage than the march.
_MAX_WATCHED_COMPONENTS = 2000


class JacobianWatch:
    """Jacobians of f at regular steps of a march, and their eigenvalues relative to the limits.

    Parameters
    ----------
    region : StabilityRegion or None
        Region of stability of the scheme; None for a scheme without a step limit.
    system : System
    block : int
        Steps in a block of the march.

    Attributes
    ----------
    every : int
        Steps between two Jacobians; 0 for no Jacobians.
    largest : float
        Largest ratio of an eigenvalue to its limit, of all Jacobians so far.
    step : int
        Step near which the largest ratio was found.
    watches : bool
        False if no ratios are computed, because dense Jacobians of so many components would be too
        large.
    """

    def __init__(self, region: StabilityRegion | None, system: System, block: int) -> None:
        known, d = system.structure, system.d
        self.watches = region is None or known is not None or d <= _MAX_WATCHED_COMPONENTS
        sources = system.sources if system.reads else None
        self._region = region.orbit(d, sources) if region and self.watches else None
        self._structure, self._shape = known, (d, d)
        self.every = block * self._region.every if self._region else 0
        self.largest, self.step = 0.0, 0

    def workspace(self, n: int, n_end: int) -> np.ndarray:
        """Return an array for the Jacobians that the march computes in steps n to n_end - 1."""
        if self._region is None:
            return np.zeros((0, 0, 0))
        self._first = self._before(n)
        count = self._before(n_end) - self._first
        if self._structure is None:
            return np.zeros((count, *self._shape))
        return np.tile(self._structure.entries, (count, 1, 1))

    def note(self, jacobians: np.ndarray, n: int) -> None:
        """Update the largest ratio from the Jacobians that the march to step n has computed.

        `jacobians` is the array that `workspace` returned.
        """
        made = self._before(n) - self._first if self._region else 0
        if self._region is None or made == 0:
            return
        found: Any = jacobians[:made]
        if self._structure is not None:
            found = [self._structure.matrix(entries[VALUES]) for entries in found]
        ratios = self._region.ratios(found)
        worst = int(ratios.argmax())
        if ratios[worst] > self.largest:
            self.largest = float(ratios[worst])
            self.step = (self._first + worst) * self.every

    def _before(self, n: int) -> int:
        """Return the number of Jacobians that are computed in steps 0 to n - 1."""
        return (n - 1) // self.every + 1
