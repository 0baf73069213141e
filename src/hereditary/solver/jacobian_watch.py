"""Watch of the stability of explicit steps by Jacobians along the orbit."""

import numpy as np

from ..compiled.jacobian import VALUES

# Components beyond which dense Jacobians would take longer than the march, and more memory.
_MOST = 2000


class JacobianWatch:
    """Jacobians at regular steps of a march.

    Parameters
    ----------
    region : StabilityRegion or None
        Of the scheme's stability; None where every step is stable.
    system : System
    block : int
        Steps in a block of the march.

    Attributes
    ----------
    every : int
        Steps between two Jacobians; 0 for none.
    largest : float
        Largest ratio of an eigenvalue to its limit so far, as one Jacobian after the other told.
    step : int
        Step near which it was found.
    watches : bool
        Whether anything can be told: False for very many components whose entries are not known.
    """

    def __init__(self, region, system, block):
        known, d = system.structure, system.d
        self.watches = region is None or known is not None or d <= _MOST
        self._region = region.orbit(d, system.sources) if region and self.watches else None
        self._structure, self._shape = known, (d, d)
        self.every = block * self._region.every if self._region else 0
        self.largest, self.step = 0.0, 0

    def room(self, n, n_end):
        """Return room for the Jacobians of the steps from n to before n_end."""
        if self._region is None:
            return np.zeros((0, 0, 0))
        self._first = (n - 1) // self.every + 1
        count = self._last(n_end) - self._first
        if self._structure is None:
            return np.zeros((count, *self._shape))
        return np.tile(self._structure.entries, (count, 1, 1))

    def note(self, jacobians, n):
        """Take in what the march up to step n left in the room."""
        if self._region is None:
            return
        made = self._last(n) - self._first
        self._look(self._region, jacobians[:made], self._first + np.arange(made))

    def _look(self, region, jacobians, places):
        """Look at Jacobians taken at these multiples of `every`."""
        if len(jacobians) == 0:
            return
        steps = places * self.every
        if self._structure is not None:
            jacobians = [self._structure.matrix(entries[VALUES]) for entries in jacobians]
        ratios = region.ratios(jacobians)
        if ratios.max(initial=0.0) > self.largest:
            self.largest, self.step = float(ratios.max()), int(steps[np.argmax(ratios)])

    def _last(self, n):
        """Return the number of the last regular step before n, and 1."""
        return (n - 1) // self.every + 1
