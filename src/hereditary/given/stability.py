"""Where an explicit scheme is stable.

Inserting x_n = zeta**n and f = mu x into a convolution scheme gives the curve mu(zeta). A mode that
decays in the equation grows in the scheme when mu lies beyond the curve of |zeta| = 1.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import factorial, gamma, zeta

from ..compiled.linalg import eigenvalues

# Oscillatory modes count as unstable when they grow by more than this a step. A first-order scheme
# lets every weakly damped oscillation grow a little, at any step: an error, but no instability.
_GROWTH = 1.1
_N_ANGLES = 512
# Most components for which eigenvalues of all Jacobians are computed. With more, norms are compared
# first, and eigenvalues are those of the Jacobian with the largest norm.
TOGETHER = 32


@dataclass(frozen=True, eq=False)
class StabilityRegion:
    """The part of the complex plane in which eigenvalues of the Jacobian must be.

    Attributes
    ----------
    limits : ndarray, shape (d,)
        Largest stable value of -d f / d y of each component by itself; sharp.
    angles, radii : ndarray, shape (k,)
        For systems whose components all have the same terms. It is the modulus at which an
        eigenvalue of that argument in (0, pi) grows by a tenth a step. Empty where components
        differ.
    first_angle : float
        Eigenvalues of a smaller argument grow in the equation itself.
    gains : ndarray, shape (d,), optional
        Value that memory read by the right-hand side has for the mode at the limit of its source's
        size. By default it is `limits`, as an explicit scheme reads it.
    sources : ndarray of int64, shape (d,), optional
        As in `System`.
    """

    limits: np.ndarray
    angles: np.ndarray
    radii: np.ndarray
    first_angle: float
    gains: np.ndarray | None = None
    sources: np.ndarray | None = None

    def orbit(self, d, sources):
        """Return the region of the first d components; `sources` as in `System`."""
        gains = self.limits if self.gains is None else self.gains
        return replace(self, limits=self.limits[:d], gains=gains[:d], sources=sources)

    @property
    def every(self):
        """Blocks between two Jacobians: by differences one costs 2 d right-hand sides."""
        return (self.limits.size + 1) // 2

    def ratios(self, jacobians):
        """Return the largest ratio of an eigenvalue to its limit, for each Jacobian.

        A run is unstable above 1.

        Parameters
        ----------
        jacobians : ndarray, shape (k, d, d), or list of SciPy's sparse arrays

        Returns
        -------
        ndarray, shape (k,)
            0 where a Jacobian is not finite.
        """
        if isinstance(jacobians, list):
            bounds, worst = bounds_of(jacobians, [self.limits] * len(jacobians))
            return self._ratios_where_largest(bounds, worst)
        finite = np.isfinite(jacobians).all(axis=(1, 2))
        jacobians = np.where(finite[:, None, None], jacobians, 0.0)
        if self.sources is not None:
            jacobians = folded(jacobians, self.gains, self.sources)
        limits = self.limits[: jacobians.shape[1]]
        scaled = -jacobians / limits[:, None]
        if scaled.shape[1] == 1:
            return np.maximum(0.0, scaled[:, 0, 0])
        if scaled.shape[1] > TOGETHER:
            bounds, worst = bounds_of(jacobians, [limits] * len(jacobians))
            return self._ratios_where_largest(bounds, worst)
        return self._ratios_of(np.linalg.eigvals(scaled))

    def _ratios_where_largest(self, bounds, worst):
        """Return ratios of Jacobians of many components: bounds if these are below 1.

        Where the largest bound is above 1, the eigenvalues of its Jacobian, `worst`, decide.
        """
        least = self.radii.min() / self.limits[0] if self.radii.size else 1.0
        ratios = np.minimum(bounds, 1.0)
        if worst is not None and bounds.max() > min(1.0, least):
            values = eigenvalues(worst)[None]
            ratios[np.argmax(bounds)] = self._ratios_of(values)[0]
        return ratios

    def _ratios_of(self, values):
        """Return the largest ratios from eigenvalues over limits, (k, n)."""
        real = np.abs(values.imag) <= 1e-9 * np.abs(values)  # but for rounding
        ratios = np.where(real, values.real, 0.0).max(axis=1, initial=0.0)
        if self.angles.size:
            spiral = -values * self.limits[0]
            angle = np.abs(np.angle(spiral))
            share = np.abs(spiral) / np.interp(angle, self.angles, self.radii)
            share[real | (angle <= self.first_angle)] = 0.0
            ratios = np.maximum(ratios, share.max(axis=1))
        return ratios


def bounds_of(jacobians, limits):
    """Return bounds of the ratios of many components, by norms of Jacobians over their limits (d,).

    Returns
    -------
    bounds : ndarray, shape (k,)
        0 where a Jacobian is not finite.
    worst : ndarray or sparse array, shape (d, d), or None
        That of the largest bound, over its limits and negated.
    """
    bounds, worst = np.zeros(len(jacobians)), None
    for k, (jacobian, limit) in enumerate(zip(jacobians, limits, strict=True)):
        scaled = -jacobian / limit[:, None] if isinstance(jacobian, np.ndarray) else None
        if scaled is None:
            scaled = jacobian.multiply(-1 / limit[:, None]).tocsr()
        sizes = abs(scaled)
        # of the spectral norm
        bound = np.sqrt(sizes.sum(axis=0).max() * sizes.sum(axis=1).max())
        bounds[k] = bound if np.isfinite(bound) else 0.0
        if bounds[k] > bounds[:k].max(initial=0.0):
            worst = scaled
    return bounds, worst


def folded(jacobians, gains, sources):
    """Return Jacobians (k, d, d) of the components with an equation, memory included.

    `gains` (d,) or (k, d) are its values where its source is 1.
    """
    own = sources == np.arange(sources.size)
    if own.all():
        return jacobians
    total = jacobians[:, own][:, :, own].copy()
    for c in np.flatnonzero(~own):
        total[:, :, sources[c]] += jacobians[:, own, c] * np.asarray(gains)[..., c, None]
    return total


def largest_step(limits, stiffness):
    """Return the step h at which the smallest of ``limits(h)`` (d,) is the stiffness."""
    low, high = -700.0, 700.0  # log h
    for _ in range(200):
        middle = (low + high) / 2
        if limits(np.exp(middle)).min() > stiffness:
            low = middle
        else:
            high = middle
    return float(np.exp(low))


def longest_step(scheme, system, h, ratio):
    """Return the step whose limits are `ratio` times those at step h; 0 if it is unknown."""
    if system.varies or system.read.any():
        return 0.0
    if not hasattr(scheme, "step_limit"):  # one term a component
        return h * ratio ** (-1 / float(system.highest_orders().min()))
    stiffness = ratio * scheme._limits(system, h).min()
    return largest_step(lambda step: scheme._limits(system, step), stiffness)


def stability_region(limits, orders, curve):
    """Return the region of an explicit scheme with the same weights in every step.

    Parameters
    ----------
    limits : ndarray, shape (d,)
        Limits of real eigenvalues.
    orders : list of float
        Orders of the terms that all components have.
    curve : callable or None
        ``curve(zeta)``: the left side of x_n = zeta**n over zeta**n, for an array; None where terms
        of components differ, whose eigenvalues count if real.
    """
    nothing = np.zeros(0)
    if len(limits) == 1 or curve is None:
        return StabilityRegion(limits, nothing, nothing, np.pi)
    turns = np.linspace(0, np.pi, _N_ANGLES + 2)[1:-1]
    values = curve(_GROWTH * np.exp(1j * turns))
    angles = np.angle(values)
    order = np.argsort(angles)
    first_angle = min(np.pi, np.pi / 2 * max(orders))
    return StabilityRegion(limits, angles[order], np.abs(values)[order], first_angle)


def polylogarithm(p, z):
    """Return ``Li_(-p)(z)`` by its expansion in log z, which converges for |log z| < 2 pi."""
    m = np.log(z)
    k = np.arange(60)
    coefficients = zeta(-p - k) / factorial(k)
    regular = np.polynomial.polynomial.polyval(m, coefficients)
    return gamma(1 + p) * (-m) ** (-p - 1) + regular
