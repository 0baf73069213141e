"""References of the field's models that do without this library: series, thresholds, edges."""

import math

import mpmath
import numpy as np
from scipy.optimize import brentq, root


def airy_series(beta, t):
    """Solution of ``D^beta x + t x = 0``, x(0) = 1, x'(0) = 0, at one time."""
    with mpmath.workdps(60):
        power, total, term, n = mpmath.mpf(beta) + 1, mpmath.mpf(1), mpmath.mpf(1), 0
        while abs(term) > 1e-40:
            n += 1
            term *= -mpmath.gamma(n * power + 2 - power) / mpmath.gamma(n * power + 1)
            term *= mpmath.mpf(t) ** power
            total += term
        return float(total)


def riccati_series(alpha, t, linear=2.0, n=80):
    """Solution of ``D^alpha y = 1 + linear y - y**2``, y(0) = 0, where its series converges."""
    c = [0.0]
    for k in range(n):
        square = sum(c[i] * c[k - i] for i in range(k + 1))
        source = (k == 0) + linear * c[k] - square
        c.append(source * math.gamma(k * alpha + 1) / math.gamma((k + 1) * alpha + 1))
    return sum(value * t ** (alpha * k) for k, value in enumerate(c))


def onset(friction, stiffness, order, guess):
    """Order of inertia, and frequency, at which a linear oscillator begins to oscillate.

    Of ``D^beta x + friction D^order x + stiffness x = 0``: zeros of its characteristic function on
    the imaginary axis.
    """

    def zero(u):
        beta, omega = u
        s = 1j * omega
        value = s**beta + friction * s**order + stiffness
        return [value.real, value.imag]

    return root(zero, guess, tol=1e-13).x


def nerve_at_rest(a=0.7, b=0.8, c=3.0, stimulus=-0.4):
    """Place of FitzHugh and Nagumo's nerve at rest, and friction and stiffness there."""
    x = float(max(np.roots([b / 3, 0.0, 1 - b, -a - b * stimulus]).real))
    return x, c * (x**2 - 1 + b / c**2), b * x**2 + 1 - b


def selkov_onset(a, b):
    """Order above which Selkov's equilibrium is unstable, by Matignon's criterion."""
    by_x, by_y = 2 * b * b / (a + b**2), a + b**2
    trace, determinant = by_x - 1 - by_y, by_y
    return 2 / math.pi * math.atan(math.sqrt(4 * determinant - trace**2) / trace)


def _hill(stiffness, depth, friction, order, n=15):
    """Determinant of the harmonics k/2, k odd: 0 at the edges of instability at half frequency."""
    k = np.arange(-2 * n - 1, 2 * n + 2, 2) / 2
    diagonal = stiffness - k**2 + friction * (1j * k) ** order
    beside = np.full(k.size - 1, depth / 2)
    found = np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1)
    return np.linalg.det(found / np.maximum(1, k**2)[:, None]).real


def mathieu_edges(depth, friction, order, near):
    """Stiffness at both edges of instability, near two first guesses."""
    rest = depth, friction, order
    return [brentq(_hill, x - 0.03, x + 0.02, args=rest, xtol=1e-14) for x in near]
