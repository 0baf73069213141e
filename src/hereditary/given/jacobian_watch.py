"""Watch of the stability of a march by Jacobians along the orbit, and remedies for instability."""

import numpy as np

from ..compiled.jacobian import FEW, VALUES
from .stability import longest_step

# Most components for which stability is watched by dense Jacobians. Beyond it they would take more
# time and storage than the march.
_MOST = 2000
# The step that a message recommends, as a fraction of the longest stable step. Rounded to two
# digits it is still stable.
_BELOW = 0.9
# Shortest step that a message recommends, as a fraction of the run's step.
_LEAST = 1e-6


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

    def __init__(self, region, system, block):
        known, d = system.structure, system.d
        self.watches = region is None or known is not None or d <= _MOST
        self._region = region.orbit(d, system.sources) if region and self.watches else None
        self._structure, self._shape = known, (d, d)
        self.every = block * self._region.every if self._region else 0
        self.largest, self.step = 0.0, 0

    def room(self, n, n_end):
        """Return an array for the Jacobians that the march computes in steps n to n_end - 1."""
        if self._region is None:
            return np.zeros((0, 0, 0))
        self._first = self._before(n)
        count = self._before(n_end) - self._first
        if self._structure is None:
            return np.zeros((count, *self._shape))
        return np.tile(self._structure.entries, (count, 1, 1))

    def note(self, jacobians, n):
        """Update the largest ratio from the Jacobians that the march to step n has computed.

        `jacobians` is the array that `room` returned.
        """
        made = self._before(n) - self._first if self._region else 0
        if self._region is None or made == 0:
            return
        jacobians = jacobians[:made]
        if self._structure is not None:
            jacobians = [self._structure.matrix(entries[VALUES]) for entries in jacobians]
        ratios = self._region.ratios(jacobians)
        if ratios.max(initial=0.0) > self.largest:
            self.largest = float(ratios.max())
            self.step = int((self._first + np.argmax(ratios)) * self.every)

    def _before(self, n):
        """Return the number of Jacobians that are computed in steps 0 to n - 1."""
        return (n - 1) // self.every + 1


def remedy_of(system, scheme, h, watch, zigzag, growth):
    """Return a clause of a message: how steps h showed their instability, and what to use instead.

    `zigzag` is the step at which the watch noted a lasting zigzag of the increments. `growth` is
    the step at which it noted that increments had grown from turn to turn. Both are -1 if the watch
    noted nothing (given/watch.py).
    """
    found, start = [], system.frame.start
    if zigzag >= 0:
        found.append(f"a step-to-step zigzag had lasted at t = {start + zigzag * h:g}")
    if growth >= 0:
        at = f"by t = {start + growth * h:g}"
        found.append(f"increments that turn within a few steps had grown {at}")
    if watch.largest > 1:
        at = f"near t = {start + watch.step * h:g}"
        found.append(f"d rhs/d y reached {watch.largest:.4g} times its limit {at}")
    seen = " and ".join(found) + f" at h = {h:g}; take "
    smaller = "smaller steps"
    if scheme.solve == "newton":
        return seen + smaller
    if watch.largest > 1:
        step = longest_step(scheme, system, h, watch.largest)
        # the message names no shorter step: it would come from a blow-up, or take days
        smaller += f", h = {_BELOW * step:.2g} would do" if step > _LEAST * h else ""
    implicit = "BDF(2)" if system.constant else "L1()"
    if system.n_solved > FEW and system.structure is None:
        implicit += f", with linear= or bandwidth= for {system.n_solved} components"
    return seen + f"{smaller}, or Collocation() with rtol=1e-6, or {implicit}"
