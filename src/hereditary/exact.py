"""Exact solutions of linear Caputo problems, which need the extra ``exact``.

Each function returns a callable ``solution(t)``, with t >= 0 a number or of shape (n,) and a value
of shape (d,) or (n, d). Equations of one order and diagonalised systems have Mittag-Leffler
functions as solutions, which pymittagleffler evaluates. Several terms have the Laplace transform
``Y(s) = P(log s) / (s F(log s))``. F and P are sums of exponentials, because s**alpha =
exp(alpha u) with u = log s. The transform is inverted along a hyperbola, after its poles are split
off. Source: [Diethelm2010].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gamma as gamma_function

from .equation.orders import derivative_order, orders_up_to_2
from .equation.statement import initial_values
from .kernels.laplace import WEIGHTS, ZETA
from .support.checks import real, real_array, refuse, within

try:
    from pymittagleffler import mittag_leffler
except ImportError as error:
    raise ImportError("no pymittagleffler found: pip install hereditary[exact]") from error

__all__ = ["mittag_leffler", "oscillator", "relaxation", "several_terms", "system"]

ExactSolution = Callable[[ArrayLike], np.ndarray]

# Scales of the hyperbola. At each time the scale is used whose nodes are farthest from the poles.
_SCALES = (6.0, 7.2, 8.6, 10.3, 12.4)
# Poles whose argument exceeds this are left of every hyperbola.
_TOP = math.pi - 0.03
# Poles of modulus below this, in units of scale / t, are left of the hyperbola as well.
_SMALL_POLE = 0.1
# Poles closer than this in log s are refused: their residues lose eps / distance**2.
_MIN_POLE_DISTANCE = 1e-3
# Largest condition of a matrix of eigenvectors.
_MAX_CONDITION = 1e8


def __dir__() -> list[str]:
    return __all__


def relaxation(alpha: float = 0.5, rate: float = 1.0, y0: ArrayLike = 1.0) -> ExactSolution:
    """Make the solution of the fractional relaxation ``D^alpha y = -rate y``.

    ``y(t) = y(0) E_alpha(-rate t**alpha) + y'(0) t E_(alpha,2)(-rate t**alpha)``, the second term
    for alpha > 1 only.

    Parameters
    ----------
    alpha : float
        Order, 0 < alpha <= 2 [-].
    rate : float
        Of either sign; a negative one makes the solution grow [1/time**alpha].
    y0 : array_like, shape (m, d)
        y(0) and, for alpha > 1, y'(0), m = ceil(alpha); shorthands as in `Equation`.

    Returns
    -------
    callable
        With the errors of `system`.

    Examples
    --------
    >>> from hereditary import exact
    >>> exact.relaxation(alpha=0.5)([0.0, 1.0]).round(6).tolist()
    [[1.0], [0.427584]]
    """
    start = _initial(y0, within("alpha", alpha, math.ulp(0.0), 2.0, "(0, 2]"))
    return system(alpha, -real("rate", rate) * np.eye(start.shape[1]), start)


def oscillator(
    beta: float = 1.8,
    gamma: float = 0.8,
    friction: float = 0.25,
    omega: float = 1.0,
    x0: float = 1.0,
    v0: float = 0.0,
) -> ExactSolution:
    """Make the solution of the oscillator ``D^beta x + friction D^gamma x + omega**2 x = 0``.

    Parameters
    ----------
    beta, gamma : float
        Orders, 1 < beta <= 2 and 0 < gamma <= 1 [-].
    friction, omega, x0, v0 : float
        As in `hereditary.scenes.oscillator`; x0 = x(0), v0 = x'(0).

    Returns
    -------
    callable
        With the errors of `several_terms`.

    Examples
    --------
    >>> from hereditary import exact
    >>> exact.oscillator(beta=2.0, gamma=1.0, friction=0.0)(3.0).round(6).tolist()
    [-0.989992]
    """
    beta = within("beta", beta, math.nextafter(1.0, 2.0), 2.0, "(1, 2]")
    gamma = within("gamma", gamma, math.ulp(0.0), 1.0, "(0, 1]")
    coefficients, start = [1.0, real("friction", friction)], [real("x0", x0), real("v0", v0)]
    return several_terms([beta, gamma], coefficients, start, rate=real("omega", omega) ** 2)


def several_terms(
    orders: ArrayLike,
    coefficients: ArrayLike,
    y0: ArrayLike,
    rate: float = 0.0,
    forcing: Iterable[tuple[float, float]] = (),
) -> ExactSolution:
    """Make the solution of ``sum_j c_j D^(alpha_j) y + rate y = sum_i a_i t**p_i``.

    Parameters
    ----------
    orders, coefficients : array_like, shape (n_terms,)
        alpha_j in (0, 2] [-] and c_j, not 0 at the highest order.
    y0 : array_like, shape (m, d)
        As in `relaxation`, m = ceil(highest order).
    rate : float
        Coefficient of y.
    forcing : sequence of (float, float)
        Amplitudes a_i, powers p_i > -1 with p_i + highest order > 0; the same for all components.

    Returns
    -------
    callable

    Error
    -----
    Below 1e-12 of the solution's scale for powers up to 4, mostly 1e-14 (tests/test_exact.py). A
    pole s of Y off the negative axis adds eps ``abs(s) t``. Two poles at a relative distance z add
    eps / z**2; distances below 1e-3 are refused. Out of range: inf or nan. Cost: 20 ms to find the
    poles, then 20 microseconds for each time.

    Examples
    --------
    >>> from hereditary import exact
    >>> solution = exact.several_terms([1.5, 0.5], [1.0, 0.5], [1.0, 0.0], rate=1.0)
    >>> solution([0.0, 2.0]).round(6).tolist()
    [[1.0], [0.143913]]
    """
    a, c = _merged(orders, coefficients)
    start, rate = _initial(y0, a[-1]), real("rate", rate)
    powers, sizes = _forces(forcing, a[-1])
    if rate != 0:
        a, c = np.insert(a, 0, 0.0), np.insert(c, 0, rate)
    force = _Exponentials(-powers, sizes * gamma_function(powers + 1))
    above = [*[_halves(a, c, 0), _halves(a, c, 1)][: len(start)], (force, force)]
    rows = np.vstack([start, np.ones(start.shape[1])])
    return _callable(_Transform(_Exponentials(a, c), above, rows), start)


def system(
    alpha: float, matrix: ArrayLike, y0: ArrayLike, forcing: ArrayLike = 0.0
) -> ExactSolution:
    """Make the solution of the linear system ``D^alpha y = matrix y + forcing``.

    ``y(t) = E_alpha(A) y(0) + t E_(alpha,2)(A) y'(0) + t**alpha E_(alpha,alpha+1)(A) forcing``
    with ``A = t**alpha matrix``, by diagonalisation.

    Parameters
    ----------
    alpha : float
        Order, 0 < alpha <= 2 [-].
    matrix : array_like, shape (d, d)
        Real and diagonalisable; complex eigenvalues are allowed [1/time**alpha].
    y0 : array_like, shape (m, d)
        y(0) and, for alpha > 1, y'(0), m = ceil(alpha); shorthands as in `Equation`.
    forcing : array_like, shape (d,)
        Constant; a number is the same for all.

    Returns
    -------
    callable

    Error
    -----
    Below 1e-12 of the solution's scale, times the condition number of the eigenvectors (refused
    above 1e8); an eigenvalue w adds eps ``abs(w)**(1/alpha) t``. Out of range: inf or nan.

    Examples
    --------
    >>> from hereditary import exact
    >>> rotation = exact.system(1.0, [[0.0, 1.0], [-1.0, 0.0]], [1.0, 0.0])
    >>> rotation(1.0).round(6).tolist()
    [0.540302, -0.841471]
    """
    alpha = within("alpha", alpha, math.ulp(0.0), 2.0, "(0, 2]")
    start = _initial(y0, alpha)
    a, force, d = real_array("matrix", matrix), real_array("forcing", forcing), start.shape[1]
    if a.shape != (d, d):
        refuse("matrix", f"have shape ({d}, {d}) by y0", f"shape {a.shape}")
    if force.shape not in ((), (d,)):
        refuse("forcing", f"have shape ({d},) by y0", f"shape {force.shape}")
    eigenvalues, vectors = np.linalg.eigh(a) if np.array_equal(a, a.T) else np.linalg.eig(a)
    if np.linalg.cond(vectors) > _MAX_CONDITION:
        got = f"eigenvectors of condition number {np.linalg.cond(vectors):.1e}"
        refuse("matrix", "be diagonalisable", got, "perturb an entry")
    modes = np.linalg.solve(vectors, np.transpose([*start, force + np.zeros(d)])).T
    kinds = [*[(0.0, 1.0), (1.0, 2.0)][: len(start)], (alpha, alpha + 1)]

    def at(t: np.ndarray) -> np.ndarray:
        z = np.multiply.outer(t**alpha, eigenvalues)
        y = np.zeros(z.shape, dtype=complex)
        with np.errstate(over="ignore", invalid="ignore"):
            for (power, b), mode in zip(kinds, modes, strict=True):
                if mode.any():
                    y += t[:, None] ** power * _mittag_leffler(z, alpha, b) * mode
            return (y @ vectors.T).real

    return _callable(at, start)


def _mittag_leffler(z: np.ndarray, a: float, b: float) -> np.ndarray:
    """Return E_(a,b)(z), by elementary functions for integer a."""
    if a == 1:
        return np.exp(z) if b == 1 else np.where(z == 0, 1, np.expm1(z) / np.where(z == 0, 1, z))
    if a == 2:
        half = np.sqrt(z + 0j) / max(1, b - 1)
        mean = np.where(half == 0, 1, np.sinh(half) / np.where(half == 0, 1, half))
        return mean ** (b - 1) / (b - 1) if b > 1 else np.cosh(half)
    return mittag_leffler(z, a, b)


def _initial(y0: ArrayLike, order: float) -> np.ndarray:
    return initial_values(real_array("y0", y0), derivative_order(order))


def _merged(orders: ArrayLike, coefficients: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return the distinct orders, increasing, and their coefficients, without zeros."""
    a = np.atleast_1d(orders_up_to_2(orders))
    c = np.atleast_1d(real_array("coefficients", coefficients))
    if c.shape != a.shape:
        refuse("coefficients", f"have shape {a.shape}", f"shape {c.shape}")
    distinct, which = np.unique(a, return_inverse=True)
    total = np.bincount(which, weights=c)
    if total[-1] == 0:
        refuse("coefficients", "not be 0 at the highest order", f"{c.tolist()}")
    return distinct[total != 0], total[total != 0]


def _forces(
    forcing: Iterable[tuple[float, float]], highest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return powers and amplitudes of the forcing, without zeros."""
    required = "be pairs (amplitude, power), with power above -1 and above minus the highest order"
    pairs = real_array("forcing", [*forcing] or np.zeros((0, 2)), required)
    if pairs.shape[1:] != (2,) or np.any(pairs[:, 1] <= -min(1.0, highest)):
        refuse("forcing", required, f"{pairs.tolist()}")
    sizes, powers = pairs.T
    return powers[sizes != 0], sizes[sizes != 0]


def _callable(at: Callable[[np.ndarray], np.ndarray], start: np.ndarray) -> ExactSolution:
    """Return a solution for all t >= 0 from a function for t > 0 and the values at the start."""

    def solution(t: ArrayLike) -> np.ndarray:
        required = "be finite numbers of at least 0, one or of shape (n,)"
        times = real_array("t", t, required)
        if times.ndim > 1 or np.any(times < 0):
            refuse("t", required, f"{times.tolist()}")
        y = np.repeat(start[:1], times.size, axis=0)
        later = times.ravel() > 0
        y[later] = at(times.ravel()[later])
        return y if times.ndim else y[0]

    return solution


@dataclass(frozen=True)
class _Exponentials:
    """``sum_j coefficients[j] exp(exponents[j] u)``, with values divided by exp(log_scale)."""

    exponents: np.ndarray
    coefficients: np.ndarray

    def log_terms(self, x: np.ndarray) -> np.ndarray:
        """Return the logarithm of the size of each term, shape (..., n_terms)."""
        return np.log(np.abs(self.coefficients)) + np.multiply.outer(x, self.exponents)

    def log_size(self, x: np.ndarray) -> np.ndarray:
        """Return the logarithm of the size of the largest term."""
        return self.log_terms(x).max(axis=-1, initial=-np.inf)

    def at(self, u: np.ndarray, log_scale: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Return the sum or its derivative at points u, shape (n,)."""
        phase = 1j * np.multiply.outer(u.imag, self.exponents)
        terms = np.exp(self.log_terms(u.real) - log_scale[:, None] + phase)
        return terms @ (np.sign(self.coefficients) * self.exponents**derivative)

    def along(self, x: np.ndarray, v: np.ndarray, log_scale: np.ndarray) -> np.ndarray:
        """Return the sum at all x[i] + v[k], real x and complex v."""
        table = np.exp(np.multiply.outer(self.exponents, v))
        return (np.exp(self.log_terms(x) - log_scale[:, None]) * np.sign(self.coefficients)) @ table


def _halves(a: np.ndarray, c: np.ndarray, m: int) -> tuple[_Exponentials, _Exponentials]:
    """Return ``P = sum c_j s**(a_j - m)`` over a_j > m, and the form of P at zeros of F."""
    high = a > m
    return _Exponentials(a[high] - m, c[high]), _Exponentials(a[~high] - m, -c[~high])


class _Transform:
    """``Y(s) = sum_k P_k(log s) rows[k] / (s F(log s))``, rows of shape (n, d)."""

    def __init__(
        self, below: _Exponentials, above: Sequence[tuple[_Exponentials, _Exponentials]],
        rows: np.ndarray,
    ) -> None:  # fmt: skip
        self.below, self.above, self.rows = below, [p for p, _ in above], rows
        u = _zeros(below)
        scale = below.log_size(u.real)
        # of two forms of P that are equal at a pole, the one that cancels less
        values = [
            np.where(p.log_size(u.real) <= o.log_size(u.real), p.at(u, scale), o.at(u, scale))
            for p, o in above
        ]
        residues = np.stack(values, axis=1) / below.at(u, scale, derivative=1)[:, None]
        self.poles, self.residues = np.exp(u), residues @ rows

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """Return the solution at times t > 0 of shape (n,), shape (n, d)."""
        value = np.empty((t.size, self.rows.shape[1]))
        block = max(1, 4000 // (1 + self.poles.size))  # a million complex numbers at a time
        for start in range(0, t.size, block):
            z = np.multiply.outer(t[start : start + block], self.poles)
            # distances of the nodes from the poles that are split off, relative to these poles
            far = [np.where(np.abs(z) > _SMALL_POLE * s, z, 1e6)[..., None] for s in _SCALES]
            gaps = [np.abs(ZETA * s / p - 1) for s, p in zip(_SCALES, far, strict=True)]
            best = np.argmax([g.min(axis=(1, 2), initial=1.0) for g in gaps], axis=0)
            for k in np.unique(best):
                i = np.flatnonzero(best == k)
                value[start + i] = self.invert(t[start + i], z[i], _SCALES[k])
        return value

    def invert(self, t: np.ndarray, z: np.ndarray, scale: float) -> np.ndarray:
        """Return the integral of ``exp(s t) (Y - split poles)`` plus that of the poles, (n, d)."""
        x, v = math.log(scale) - np.log(t), np.log(ZETA)
        log_scale = self.below.log_size(x)
        shape = np.exp(scale * ZETA) * WEIGHTS
        ratio = shape / ZETA / self.below.along(x, v, log_scale)
        sums = [(p.along(x, v, log_scale) * ratio).sum(axis=1) for p in self.above]
        split = np.abs(z) > _SMALL_POLE * scale
        cauchy = np.where(split, (1 / (ZETA - z[..., None] / scale)) @ shape, 0)
        smooth = (np.stack(sums, axis=1) @ self.rows - cauchy @ self.residues).real
        with np.errstate(over="ignore", invalid="ignore"):
            grown = np.where(split, np.exp(z.real), 0)[..., None] * np.abs(self.residues)
            turning = np.cos(z.imag[..., None] + np.angle(self.residues))
            return smooth + (grown * turning).sum(axis=1)


def _zeros(f: _Exponentials) -> np.ndarray:
    """Return all zeros of F with abs(Im u) < _TOP, as many as the argument principle counts."""
    if f.exponents.size == 1:
        return np.zeros(0, dtype=complex)
    size, a, margin = np.log(np.abs(f.coefficients)), f.exponents, math.log(2 * f.exponents.size)
    # outside of [low, high] one term exceeds the sum of all others; exp(+-300) is beyond any time
    high = min(300.0, ((size[:-1] - size[-1] + margin) / (a[-1] - a[:-1])).max())
    low = max(-300.0, ((size[0] - size[1:] - margin) / (a[1:] - a[0])).min())
    # F is real on the real axis, so the upper half plane suffices
    corners = pairwise([high, high + 1j * _TOP, low + 1j * _TOP, low])
    expected = 2 * sum(_turns(f, z, w) for z, w in corners)
    crossings = np.concatenate([(size[:j] - size[j]) / (a[j] - a[:j]) for j in range(1, a.size)])
    for n in (9, 40, 150):
        x = np.concatenate([crossings, np.linspace(low, high, n)])
        u = _newton(f, np.add.outer(x, 1j * np.linspace(0, _TOP, 2 * n + 1)).ravel())
        zeros: list[complex] = []
        for z in u[(u.real > low) & (u.real < high) & (np.abs(u.imag) < _TOP)]:
            if all(abs(z - zero) > _MIN_POLE_DISTANCE for zero in zeros):
                zeros.append(z)
        if len(zeros) == round(expected):
            return np.array(zeros, dtype=complex)
    required = "give the Laplace transform separate poles off the negative axis"
    got = f"{round(expected)} poles, of which {len(zeros)} differ, s = {np.exp(zeros).tolist()}"
    refuse("coefficients", required, got, "change one of them a little")


def _turns(f: _Exponentials, start: complex, end: complex) -> float:
    """Return how often F turns around 0 from start to end, by small intervals."""
    z = np.linspace(start, end, 400)
    for _ in range(40):
        value = f.at(z, f.log_size(z.real))
        turn = np.angle(value[1:] / value[:-1])
        wide = np.flatnonzero(np.abs(turn) > 0.5)
        if wide.size == 0:
            break
        z = np.insert(z, wide + 1, (z[wide] + z[wide + 1]) / 2)
    return turn.sum() / (2 * math.pi)


def _newton(f: _Exponentials, u: np.ndarray) -> np.ndarray:
    """Return the limits of Newton's iteration from all starts, and their conjugates."""
    for _ in range(80):
        scale = f.log_size(u.real)
        step = f.at(u, scale) / (f.at(u, scale, derivative=1) + 1e-200)
        step /= np.maximum(1, 2 * np.abs(step))
        u = np.clip((u - step).real, -400, 400) + 1j * np.clip((u - step).imag, -4, 4)
    u = u[np.abs(step) < 1e-8]
    u = np.where(np.abs(u.imag) < 1e-8, u.real, u)
    return np.concatenate([u, u.conj()])
