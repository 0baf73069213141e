"""Harmonic balance: equations for the harmonics of a periodic solution."""

from __future__ import annotations

import numpy as np

from .._checks import complaint, shown
from .._jit import F8, I8, MAT, VEC, entry
from ..compiled.jacobian import jacobian
from ..compiled.signatures import JAC, RHS

# Samples of a period for each harmonic and at least, and relative change of a frequency in
# differences.
_SAMPLES, _FEWEST, _CHANGE = 8, 129, 1e-6


@entry(RHS, JAC, I8, VEC, F8, MAT, MAT, MAT)
def _over_a_period(rhs, jac, has_jac, params, omega, y, f, j_f):
    """Set f (N, d), and its Jacobian, flat (N, d d), at equal times of a period and y (N, d)."""
    n, d = y.shape
    out = np.empty((d, d))
    for i in range(n):
        t = 2.0 * np.pi * i / (n * omega)
        rhs(t, y[i], f[i], params)
        jacobian(rhs, jac, has_jac, t, y[i], params, out)
        for a in range(d):
            for b in range(d):
                j_f[i, a * d + b] = out[a, b]


class Balance:
    """Equations of the harmonics: their residual, and its derivative.

    Unknowns x (d, 2 H + 1), flat, are the mean and then cosine and sine of each harmonic.
    """

    def __init__(self, equation, frequency, harmonics):
        self._system, self._frequency = equation.dense(), frequency
        self._params, self._h, self.d = equation._params.copy(), harmonics, equation.d
        self.size, self._n = self.d * (2 * harmonics + 1), max(_SAMPLES * harmonics + 1, _FEWEST)
        angles = 2 * np.pi * np.outer(np.arange(self._n), np.arange(1, harmonics + 1)) / self._n
        columns = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(self._n, -1)
        self._basis = np.hstack([np.ones((self._n, 1)), columns])
        self._project = 2.0 / self._n * self._basis.T
        self._project[0] /= 2

    def check_period(self, omegas):
        """Refuse right-hand sides without the period 2 pi / omega."""
        system, params = self._system, self._params
        y0 = system.y0[0]
        for omega in omegas:
            params[self._frequency] = omega
            for y in (y0, y0 + 1.0):
                times = 2 * np.pi / omega * np.array([[0.0, 0.31, 0.83], [1.0, 1.31, 1.83]])
                values = np.array([[self._force(t, y) for t in row] for row in times])
                apart = np.abs(values[1] - values[0]).max()
                if not apart <= 1e-6 * np.abs(values).max():
                    required = "have period 2 pi / omega in t, omega being params"
                    required += f"[{self._frequency}]"
                    raise ValueError(complaint("rhs", required, f"values {shown(values.ravel())}"))

    def _force(self, t, y):
        """Return the right-hand side, (d,)."""
        found = np.empty(self.d)
        self._system._rhs(t, y.copy(), found, self._params)
        return found

    def coefficients(self, x):
        """Return complex amplitudes (n, d, H + 1) of unknowns (n, size)."""
        parts = x.reshape(-1, self.d, 2 * self._h + 1)
        harmonic = parts[..., 1::2] - 1j * parts[..., 2::2]
        return np.concatenate([parts[..., :1].astype(complex), harmonic], axis=2)

    def _operators(self, omega):
        """Return the matrices of the left side, (d, 2 H + 1, 2 H + 1)."""
        k = np.arange(1, self._h + 1)
        symbol = np.zeros((self.d, self._h), complex)
        for operator, c in self._system.left:
            symbol += np.multiply.outer(c, (1j * k * omega) ** operator.order)
        found = np.zeros((self.d, 2 * self._h + 1, 2 * self._h + 1))
        for j in range(self._h):  # on (cos, sin) of a cos + b sin = Re (a - i b) exp
            real, imaginary = symbol[:, j].real, symbol[:, j].imag
            a, b = 2 * j + 1, 2 * j + 2
            found[:, a, a], found[:, a, b] = real, imaginary
            found[:, b, a], found[:, b, b] = -imaginary, real
        return found

    def residual(self, x, omega, derivative=True):
        """Return the residual (size,), and its derivative (size, size)."""
        m, d = 2 * self._h + 1, self.d
        rows = x.reshape(d, m)
        y = np.ascontiguousarray((rows @ self._basis.T).T)
        f, j_f = np.empty((self._n, d)), np.empty((self._n, d * d))
        self._params[self._frequency] = omega
        system = self._system
        how = int(system.has_jac), self._params, float(omega), y, f, j_f
        _over_a_period(system._rhs, system._jac, *how)
        left = self._operators(omega)
        found = (left @ rows[..., None])[..., 0] - (self._project @ f).T
        if not derivative:
            return found.ravel(), None
        slopes = j_f.T.reshape(d, d, self._n)
        blocks = (self._project * slopes[:, :, None]) @ self._basis  # (d, d, 2 H + 1, 2 H + 1)
        matrix = -np.ascontiguousarray(np.moveaxis(blocks, 1, 2))
        for c in range(d):
            matrix[c, :, c, :] += left[c]
        return found.ravel(), matrix.reshape(self.size, self.size)

    def by_frequency(self, x, omega):
        """Return the derivative of the residual by omega, (size,)."""
        step = _CHANGE * omega
        above, below = (self.residual(x, omega + by, False)[0] for by in (step, -step))
        return (above - below) / (2 * step)
