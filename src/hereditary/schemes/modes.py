"""Modes that a scheme lets grow while they turn, for systems of any Jacobian.

With x_n = zeta**n v a scheme asks for ``C(zeta) v = 0``, C being a matrix of the step's weights and
of the Jacobian that tends to 1 far out. So the turns of det C along the edge of a region tell how
many modes it holds. The region here is ``|zeta| > R, |arg zeta| > angle``, modes that grow by more
than R a step and make less than 2 pi / angle steps a turn, and with it all that turn and more than
double each step; no resolved solution does either.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

# Points on the ray from infinity and on half the circle.
_N_RAY, _N_ARC = 32, 97
# Growth a step from which modes of any angle but this small one count.
_FAST, _STRAIGHT = 2.0, 0.02
# Jacobians of a stretch that are looked at: the largest ones.
_MOST = 2
# Jacobians that are looked at together.
_AT_ONCE = 64
# Components beyond which this would take longer than the march.
_LARGEST = 12


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of a scheme beyond an edge.

    Attributes
    ----------
    matrix : callable
        ``matrix(jacobians)``, (n, d, d): C along the edge for each, shape (n, k, d, d).
    reach : callable
        ``reach(jacobians)``, shape (n,): a bound of C - 1 on the edge and beyond it; below 1 there
        is no mode.
    """

    matrix: Callable
    reach: Callable

    def ratios(self, jacobians, runs=None):
        """Ratio of Jacobians (n, d, d) to their largest stable multiples; 0 up to 1.

        `runs` (n,) numbers the runs that they are of, by default one.
        """
        ratios = np.zeros(len(jacobians))
        if jacobians.shape[1] > _LARGEST:
            return ratios
        reach, chosen = self.reach(np.abs(jacobians)), []
        looked: Counter = Counter()
        for n in np.argsort(-reach).tolist():
            run = 0 if runs is None else runs[n]
            looked[run] += 1
            if reach[n] > 1 and looked[run] <= _MOST:
                chosen.append(n)
        for k in range(0, len(chosen), _AT_ONCE):
            some = np.array(chosen[k : k + _AT_ONCE])
            for n in some[self._grow(jacobians[some])]:
                ratios[n] = self._excess(jacobians[n])
        return ratios

    def _excess(self, jacobian):
        low, high = -np.log(self.reach(np.abs(jacobian[None]))[0]), 0.0  # logs of the share
        for _ in range(12):
            middle = (low + high) / 2
            if self._grow(np.exp(middle) * jacobian[None])[0]:
                high = middle
            else:
                low = middle
        return np.exp(-low)

    def _grow(self, jacobians):
        """Whether a mode grows, for each Jacobian."""
        c = self.matrix(jacobians)
        if c.shape[-1] == 2:  # in a tenth of the time
            signs = c[..., 0, 0] * c[..., 1, 1] - c[..., 0, 1] * c[..., 1, 0]
        else:
            signs, _ = np.linalg.slogdet(c)
        phases = np.unwrap(np.angle(signs))
        return np.rint((phases[:, -1] - phases[:, 0]) / np.pi) != 0


def edge(growth, angle):
    """Points along the upper half of the region's edge, from far out to -growth."""
    far, near = np.geomspace(1e8, 1.0, _N_RAY), np.linspace(_FAST, growth, 17)
    inner, outer = np.linspace(_STRAIGHT, angle, 17), np.linspace(angle, np.pi, _N_ARC)
    return np.concatenate(
        [
            _FAST * far * np.exp(1j * _STRAIGHT),
            _FAST * np.exp(1j * inner[1:]),
            near[1:] * np.exp(1j * angle),
            growth * np.exp(1j * outer[1:]),
        ]
    )


def series(weights, zeta):
    """``sum_k w_k zeta**-k`` for weights (..., n); shape (..., k)."""
    return np.polynomial.polynomial.polyval(1 / zeta, np.moveaxis(weights, -1, 0))
