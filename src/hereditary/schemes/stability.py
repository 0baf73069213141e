"""Where an explicit scheme is stable (floor 2).

Inserting x_n = zeta**n and f = mu x into a convolution scheme gives the curve mu(zeta); a mode that
decays in the equation grows in the scheme when mu lies beyond the curve of |zeta| = 1.
"""

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
    """

    limits: np.ndarray
    angles: np.ndarray
    radii: np.ndarray
    first_angle: float

    def orbit(self, d):
        """The region of the first d components."""
        return replace(self, limits=self.limits[:d])

    @property
    def every(self):
        """Blocks between two Jacobians: by differences one costs 2 d right-hand sides."""
        return (self.limits.size + 1) // 2

    def ratio(self, jacobians, steps=None):
        """Largest ratio of an eigenvalue to its limit over some Jacobians; unstable above 1.

        Parameters
        ----------
        jacobians : ndarray, shape (k, d, d)
        steps : ndarray, shape (k,), optional
            Where they were taken; these limits are the same everywhere.

        Returns
        -------
        float
            Non-finite Jacobians are passed over. Where components have different terms only real
            eigenvalues of -J / limits are seen.
        """
        scaled = -jacobians / self.limits[:, None]
        finite = np.isfinite(scaled).all(axis=(1, 2))
        scaled = scaled[finite]
        if scaled.size == 0:
            return 0.0
        if scaled.shape[1] == 1:
            return max(0.0, float(scaled.max()))
        values = np.linalg.eigvals(scaled)
        real = np.abs(values.imag) <= 1e-9 * np.abs(values)
        largest = float(np.where(real, values.real, 0.0).max(initial=0.0))
        if self.angles.size:
            spiral = -values[~real] * self.limits[0]
            angle = np.abs(np.angle(spiral))
            share = np.abs(spiral) / np.interp(angle, self.angles, self.radii)
            largest = max(largest, float(share[angle > self.first_angle].max(initial=0.0)))
        return largest


def stability_region(limits, factors, orders):
    """Region of a scheme with weights b_k (orders up to 1) or b_k - b_(k-1) (above).

    Parameters
    ----------
    limits : ndarray, shape (d,)
        Limits of real eigenvalues.
    factors : sequence of float, or None
        Leading weights A of the terms that all components share; None where they differ.
    orders : sequence of float
        Orders of these terms.
    """
    nothing = np.zeros(0)
    if factors is None or len(limits) == 1:
        return StabilityRegion(limits, nothing, nothing, np.pi)
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
    """``sum_k ((k+1)**p - k**p) z**k`` = (1 - z)/z Li_(-p)(z) for 0 < |z| <= 1, z != 1.

    The polylogarithm by its expansion in log z, which converges for |log z| < 2 pi.
    """
    m = np.log(z)
    k = np.arange(60)
    coefficients = zeta(-p - k) / factorial(k)
    regular = np.polynomial.polynomial.polyval(m, coefficients)
    polylogarithm = gamma(1 + p) * (-m) ** (-p - 1) + regular
    return (1 - z) / z * polylogarithm
