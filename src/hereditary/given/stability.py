"""Regions of stability of explicit schemes.

Inserting x_n = zeta**n and f = mu x into a convolution scheme gives the curve mu(zeta). If mu lies
outside the curve of |zeta| = 1, a mode that decays in the equation grows in the scheme.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import factorial, gamma, zeta

from ..compiled.linalg import eigenvalues
from ..equation.system import System

# Growth factor of a mode in one step above which an oscillatory mode counts as unstable. Schemes of
# first order let a weakly damped oscillation grow slowly at any step size. This is an error of the
# scheme, not an instability.
_GROWTH = 1.1
# Number of points on the curve mu(zeta) that are computed.
_N_ANGLES = 512
# Largest number of components for which the eigenvalues of every Jacobian are computed. In larger
# systems norms bound the eigenvalues, and only those of the Jacobian with the largest bound are
# computed.
TOGETHER = 32


@dataclass(frozen=True, eq=False)
class StabilityRegion:
    """The part of the complex plane in which a scheme is stable for eigenvalues of the Jacobian.

    Attributes
    ----------
    limits : ndarray, shape (d,)
        Largest stable value of -d f / d y of each component by itself; sharp.
    angles, radii : ndarray, shape (k,)
        Arguments of eigenvalues in (0, pi). At the modulus in `radii` a mode grows by a tenth in a
        step. Both are empty if components differ in their terms.
    first_angle : float
        Eigenvalues with a smaller argument than this grow in the equation itself.
    gains : ndarray, shape (d,), optional
        Value of memory that f reads, for the mode at the limit of stability and a source of size 1.
        By default `limits`, which holds for explicit schemes.
    sources : ndarray of int64, shape (d,), optional
        As in `System`; None if no component is memory.
    """

    limits: np.ndarray
    angles: np.ndarray
    radii: np.ndarray
    first_angle: float
    gains: np.ndarray | None = None
    sources: np.ndarray | None = None

    def orbit(self, d: int, sources: np.ndarray | None) -> StabilityRegion:
        """Return the region of stability of the first d components, which have these `sources`."""
        limits, gains = self.limits[:d], self.limits if self.gains is None else self.gains
        curve = self.angles, self.radii, self.first_angle
        return StabilityRegion(limits, *curve, gains[:d], sources)

    @property
    def every(self) -> int:
        """Number of blocks between two Jacobians, about d / 2 for d components.

        A Jacobian by differences costs 2 d right-hand sides.
        """
        return (self.limits.size + 1) // 2

    def ratios(self, jacobians: Any) -> np.ndarray:
        """Return the largest ratio of an eigenvalue to its limit, for each Jacobian.

        A run is unstable if this ratio exceeds 1.

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

    def _ratios_where_largest(self, bounds: np.ndarray, worst: Any) -> np.ndarray:
        """Return ratios of eigenvalues to limits, for k Jacobians with many components.

        Upper bounds of the ratios, (k,), cut off at 1, replace the ratios. If the largest bound may
        mean instability, the eigenvalues of its scaled Jacobian, `worst`, give its ratio.
        """
        least = self.radii.min() / self.limits[0] if self.radii.size else 1.0
        ratios = np.minimum(bounds, 1.0)
        if worst is not None and bounds.max() > min(1.0, least):
            values = eigenvalues(worst)[None]
            ratios[np.argmax(bounds)] = self._ratios_of(values)[0]
        return ratios

    def _ratios_of(self, values: np.ndarray) -> np.ndarray:
        """Return the largest ratio to the limits for each of k Jacobians.

        `values` (k, n) are the n eigenvalues of each negated Jacobian, scaled by `limits`.
        """
        real = np.abs(values.imag) <= 1e-9 * np.abs(values)  # real up to rounding errors
        ratios = np.where(real, values.real, 0.0).max(axis=1, initial=0.0)
        if self.angles.size:
            spiral = -values * self.limits[0]
            angle = np.abs(np.angle(spiral))
            share = np.abs(spiral) / np.interp(angle, self.angles, self.radii)
            share[real | (angle <= self.first_angle)] = 0.0
            ratios = np.maximum(ratios, share.max(axis=1))
        return ratios


def bounds_of(jacobians: Any, limits: list[np.ndarray]) -> tuple[Any, ...]:
    """Return upper bounds of the ratios of eigenvalues to limits, from norms of k Jacobians.

    `limits` has an array (d,) for each Jacobian, whose rows are divided by it.

    Returns
    -------
    bounds : ndarray, shape (k,)
        0 where a Jacobian is not finite.
    worst : ndarray or sparse array, shape (d, d), or None
        The negated Jacobian over its limits, for the largest bound.
    """
    bounds, worst = np.zeros(len(jacobians)), None
    for k, (jacobian, limit) in enumerate(zip(jacobians, limits, strict=True)):
        scaled = -jacobian / limit[:, None] if isinstance(jacobian, np.ndarray) else None
        if scaled is None:
            scaled = jacobian.multiply(-1 / limit[:, None]).tocsr()
        sizes = abs(scaled)
        # upper bound of the spectral norm
        bound = np.sqrt(sizes.sum(axis=0).max() * sizes.sum(axis=1).max())
        bounds[k] = bound if np.isfinite(bound) else 0.0
        if bounds[k] > bounds[:k].max(initial=0.0):
            worst = scaled
    return bounds, worst


def folded(jacobians: np.ndarray, gains: np.ndarray | None, sources: np.ndarray) -> np.ndarray:
    """Return k Jacobians of the components with an equation, after elimination of other components.

    The other components are memory that f reads. `gains`, (d,) or (k, d), are their values for a
    source of size 1. `jacobians` is (k, d, d).
    """
    own = sources == np.arange(sources.size)
    if own.all():
        return jacobians
    total = jacobians[:, own][:, :, own].copy()
    for c in np.flatnonzero(~own):
        total[:, :, sources[c]] += jacobians[:, own, c] * np.asarray(gains)[..., c, None]
    return total


def largest_step(limits: Callable[..., Any], stiffness: float) -> float:
    """Return the step h at which the smallest of ``limits(h)``, (d,), equals `stiffness`."""
    low, high = -700.0, 700.0  # bounds of log h for the bisection
    for _ in range(200):
        middle = (low + high) / 2
        if limits(np.exp(middle)).min() > stiffness:
            low = middle
        else:
            high = middle
    return float(np.exp(low))


def longest_step(scheme: Any, system: System, h: float, ratio: float) -> float:
    """Return the step whose limits of stability are `ratio` times those at step h; 0 if unknown."""
    if system.varies or system.is_memory.any():
        return 0.0
    if not hasattr(scheme, "step_limit"):  # such schemes take one term per component
        return h * ratio ** (-1 / float(system.highest_orders().min()))
    stiffness = ratio * scheme._limits(system, h).min()
    return largest_step(lambda step: scheme._limits(system, step), stiffness)


def stability_region(
    limits: np.ndarray, orders: list[float], curve: Callable[..., Any] | None
) -> StabilityRegion:
    """Return the region of stability of an explicit scheme with the same weights in every step.

    Parameters
    ----------
    limits : ndarray, shape (d,)
        Limits of real eigenvalues.
    orders : list of float
        Orders of the terms that all components have in common.
    curve : callable or None
        ``curve(zeta)``: the left side for x_n = zeta**n, divided by zeta**n, for an array of zeta.
        None if components have different terms; then only real eigenvalues are checked.
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


def polylogarithm(p: float, z: np.ndarray) -> np.ndarray:
    """Return ``Li_(-p)(z)`` by its expansion in log z, which converges for |log z| < 2 pi."""
    m = np.log(z)
    k = np.arange(60)
    coefficients = zeta(-p - k) / factorial(k)
    regular = np.polynomial.polynomial.polyval(m, coefficients)
    return gamma(1 + p) * (-m) ** (-p - 1) + regular
