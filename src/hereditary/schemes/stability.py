"""Where an explicit scheme is stable.

Inserting x_n = zeta**n and f = mu x into a convolution scheme gives the curve mu(zeta); a mode that
decays in the equation grows in the scheme when mu lies beyond the curve of |zeta| = 1.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import factorial, gamma, zeta

# Oscillatory modes count as unstable when they grow by more than this a step. A first-order scheme
# lets every weakly damped oscillation grow a little, at any step: an error, but no instability.
_GROWTH = 1.1
_N_ANGLES = 512


@dataclass(frozen=True, eq=False)
class StabilityRegion:
    """The part of the complex plane that eigenvalues of the Jacobian must keep to.

    Attributes
    ----------
    limits : ndarray, shape (d,)
        Largest stable value of -d f / d y of each component by itself; sharp.
    angles, radii : ndarray, shape (k,)
        For systems whose components all have the same terms: modulus at which an eigenvalue of
        that argument in (0, pi) grows by a tenth a step. Empty where components differ.
    first_angle : float
        Eigenvalues of a smaller argument grow in the equation itself.
    modes : callable, or None
        ``modes(d)``: the `Modes` of the first d components, where no such curve is known.
    sweeps : bool
        Whether the march adds a Jacobian to each stretch in which its sweeps hardly contracted.
    """

    limits: np.ndarray
    angles: np.ndarray
    radii: np.ndarray
    first_angle: float
    modes: Callable | None = None
    sweeps: bool = False

    def orbit(self, d):
        """The region of the first d components."""
        return replace(self, limits=self.limits[:d])

    @property
    def every(self):
        """Blocks between two Jacobians: by differences one costs 2 d right-hand sides."""
        return (self.limits.size + 1) // 2

    def ratios(self, jacobians, steps=None):
        """Largest ratio of an eigenvalue to its limit, for each Jacobian; unstable above 1.

        Parameters
        ----------
        jacobians : ndarray, shape (k, d, d)
        steps : ndarray, shape (k,), optional
            Where they were taken; these limits are the same everywhere.

        Returns
        -------
        ndarray, shape (k,)
            0 where a Jacobian is not finite.
        """
        finite = np.isfinite(jacobians).all(axis=(1, 2))
        jacobians = np.where(finite[:, None, None], jacobians, 0.0)
        scaled = -jacobians / self.limits[:, None]
        if scaled.shape[1] == 1:
            return np.maximum(0.0, scaled[:, 0, 0])
        values = np.linalg.eigvals(scaled)
        real = np.abs(values.imag) <= 1e-9 * np.abs(values)
        ratios = np.where(real, values.real, 0.0).max(axis=1, initial=0.0)
        if self.angles.size:
            spiral = -values * self.limits[0]
            angle = np.abs(np.angle(spiral))
            share = np.abs(spiral) / np.interp(angle, self.angles, self.radii)
            share[real | (angle <= self.first_angle)] = 0.0
            ratios = np.maximum(ratios, share.max(axis=1))
        if self.modes is not None:
            ratios = np.maximum(ratios, self.modes(self.limits.size).ratios(jacobians))
        return ratios

    def ratio(self, jacobians):
        """The largest of them."""
        return float(self.ratios(jacobians).max(initial=0.0))


def stability_region(limits, factors, orders, modes):
    """Region of a scheme with weights b_k (orders up to 1) or b_k - b_(k-1) (above).

    Parameters
    ----------
    limits : ndarray, shape (d,)
        Limits of real eigenvalues.
    factors : sequence of float, or None
        Leading weights A of the terms that all components share; None where they differ.
    orders : sequence of float
        Orders of these terms.
    modes : callable
        ``modes(d)``: the `Modes` of the first d components, where these differ.
    """
    nothing = np.zeros(0)
    if len(limits) == 1:
        return StabilityRegion(limits, nothing, nothing, np.pi)
    if factors is None:
        return StabilityRegion(limits, nothing, nothing, np.pi, modes)
    step = _GROWTH * np.exp(1j * np.linspace(0, np.pi, _N_ANGLES + 2)[1:-1])
    curve = np.zeros(_N_ANGLES, dtype=complex)
    for factor, alpha in zip(factors, orders, strict=True):
        p = np.ceil(alpha) - alpha
        difference = (step - 1) if alpha <= 1 else (step - 1) * (1 - 1 / step)
        curve += factor * difference * _power_series(p, 1 / step)
    angles = np.angle(curve)
    order = np.argsort(angles)
    return StabilityRegion(
        limits, angles[order], np.abs(curve)[order], min(np.pi, np.pi / 2 * max(orders))
    )


def _power_series(p, z):
    """``sum_k ((k+1)**p - k**p) z**k`` = (1 - z)/z Li_(-p)(z) for 0 < |z| <= 1, z != 1."""
    return (1 - z) / z * polylogarithm(p, z)


def polylogarithm(p, z):
    """``Li_(-p)(z)`` by its expansion in log z, which converges for |log z| < 2 pi."""
    m = np.log(z)
    k = np.arange(60)
    coefficients = zeta(-p - k) / factorial(k)
    regular = np.polynomial.polynomial.polyval(m, coefficients)
    return gamma(1 + p) * (-m) ** (-p - 1) + regular
