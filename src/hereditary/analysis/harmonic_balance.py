"""Harmonic balance: equations for the harmonics of a periodic solution."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiled.functions import set_force
from ..compiled.jacobian import force_at
from ..compiled.jit import F8, MAT, VEC, entry
from ..compiled.signatures import RIGHT_SIDE
from ..equation.equation import Equation
from ..equation.system import with_params
from ..support.checks import refuse, shown

# Samples of a period per harmonic.
_SAMPLES_PER_HARMONIC = 8
# Fewest samples of a period, whatever the number of harmonics.
_MIN_SAMPLES_PER_PERIOD = 129
# A derivative by the mean counts as 0 below this fraction of the largest derivative: differences
# have errors of 1e-10.
_FREE = 1e-7


@entry(RIGHT_SIDE, F8, MAT, VEC, MAT, MAT)
def _over_a_period(
    right: Any, omega: float, y: np.ndarray, units: np.ndarray, f: np.ndarray, j_f: np.ndarray
) -> None:
    """Set f (N, d) and, if it has rows, its Jacobian j_f (N, d d) at equal times and y (N, d)."""
    n, d = y.shape
    out = np.empty((d, d))
    for i in range(n):
        t = 2.0 * np.pi * i / (n * omega)
        set_force(right.force, t, y[i], f[i])
        if i >= j_f.shape[0]:
            continue
        right.jacobian(right.force, t, y[i], units, out)
        for a in range(d):
            for b in range(d):
                j_f[i, a * d + b] = out[a, b]


class Balance:
    """Equations of the harmonics: their residual, and its derivative."""

    def __init__(self, equation: Equation, frequency: int, along: int, harmonics: int) -> None:
        # Unknowns x (d, 2 H + 1), flat, are the mean and then cosine and sine of each harmonic.
        # They are in units of the components, as residuals are. Components of memory that the
        # right-hand side reads follow those of y, and are linear in y. `along` is the parameter
        # whose values the curve follows: `frequency`, or another one.
        self._system = equation.system.dense()
        self._units = self._system.units()
        self._frequency, self._along = frequency, along
        self._params, self._h, self.d = self._system.params.copy(), harmonics, equation.d
        self._right = with_params(self._system, self._params).compiled
        self.size = self.d * (2 * harmonics + 1)
        self._n = max(_SAMPLES_PER_HARMONIC * harmonics + 1, _MIN_SAMPLES_PER_PERIOD)
        angles = 2 * np.pi * np.outer(np.arange(self._n), np.arange(1, harmonics + 1)) / self._n
        columns = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(self._n, -1)
        self._basis = np.hstack([np.ones((self._n, 1)), columns])
        self._project = 2.0 / self._n * self._basis.T
        self._project[0] /= 2
        self._free, self._fixed_means = np.zeros((0, self.d)), np.zeros((self.d, self.d))

    def check_period(self, values: np.ndarray) -> None:
        """Refuse right-hand sides without the period 2 pi / omega."""
        y0 = self._system.y0[0]
        for value in values:
            omega = self._omega(value)
            for y in (y0, y0 + self._units):
                times = 2 * np.pi / omega * np.array([[0.0, 0.31, 0.83], [1.0, 1.31, 1.83]])
                forces = np.array([[self._force(t, y) for t in row] for row in times])
                if not np.isfinite(forces).all():
                    refuse("rhs", "be finite over a period", f"params {shown(self._params)}")
                apart = np.abs(forces[1] - forces[0]).max()
                if not apart <= 1e-6 * np.abs(forces).max():
                    required = "have period 2 pi / omega in t, omega being params"
                    required += f"[{self._frequency}]"
                    refuse("rhs", required, f"values {shown(forces.ravel())}")

    def hold_means(self, value: float) -> bool:
        """Fix the means of y that no equation depends on; return whether there are any."""
        # The product of each such mean with a left null vector is added to the derivatives of the
        # equations of the means. Then Newton's matrix is regular, and these means stay 0.
        m, places = 2 * self._h + 1, np.outer([0.0, 1.0], np.ones(self.size))
        matrices = [self.residual(x, value)[1] for x in places]
        if not np.isfinite(matrices).all():
            return False
        _, sizes, means = np.linalg.svd(np.vstack([matrix[:, ::m] for matrix in matrices]))
        self._free = means[sizes <= _FREE * sizes[0]]
        left = np.linalg.svd(matrices[1][::m, ::m])[0][:, self.d - len(self._free) :]
        self._fixed_means = left @ self._free
        return len(self._free) > 0

    def _force(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return the right-hand side, (d,)."""
        force = np.empty(self._system.d)
        force_at(self._right, t, y.copy(), force)
        return force

    def _omega(self, value: float) -> float:
        """Set the parameter along the curve; return the frequency."""
        self._params[self._along] = value
        return float(self._params[self._frequency])

    def omegas(self, values: np.ndarray) -> np.ndarray:
        """Return the frequency for each value of the parameter along the curve."""
        return np.array([self._omega(value) for value in values])

    def coefficients(self, x: np.ndarray) -> np.ndarray:
        """Return complex amplitudes (n, d, H + 1) of unknowns (n, size)."""
        parts = x.reshape(-1, self.d, 2 * self._h + 1).copy()
        parts[..., 0] -= parts[..., 0] @ self._free.T @ self._free  # which rounding moves
        parts *= self._units[: self.d, None]
        harmonic = parts[..., 1::2] - 1j * parts[..., 2::2]
        return np.concatenate([parts[..., :1].astype(complex), harmonic], axis=2)

    def _operators(self, omega: float) -> np.ndarray:
        """Return matrices of the left sides, and then of memory, (n, 2 H + 1, 2 H + 1)."""
        s = 1j * omega * np.arange(self._h + 1)
        symbol = np.zeros((self._system.d, self._h + 1), complex)
        operator: Any  # of no order that varies
        for operator, c in self._system.left:
            symbol += c[:, None] * operator.symbol(s)
        matrices = np.zeros((self._system.d, 2 * self._h + 1, 2 * self._h + 1))
        matrices[:, 0, 0] = symbol[:, 0].real
        a = np.arange(1, 2 * self._h, 2)  # on (cos, sin) of a cos + b sin = Re (a - i b) exp
        matrices[:, a, a] = matrices[:, a + 1, a + 1] = symbol[:, 1:].real
        matrices[:, a, a + 1], matrices[:, a + 1, a] = symbol[:, 1:].imag, -symbol[:, 1:].imag
        return matrices

    def residual(
        self, x: np.ndarray, value: float, derivative: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return the residual (size,), and its derivative (size, size)."""
        m, d, system = 2 * self._h + 1, self.d, self._system
        scale = self._units[:d, None]
        rows, omega = x.reshape(d, m) * scale, self._omega(value)
        left = self._operators(omega)
        sources = system.sources[d:]
        beside = (left[d:] @ rows[sources, :, None])[..., 0]
        y = np.ascontiguousarray((np.vstack([rows, beside]) @ self._basis.T).T)
        f, j_f = np.empty(y.shape), np.empty((self._n if derivative else 0, system.d**2))
        units = np.maximum(np.abs(y).max(axis=0), self._units)
        _over_a_period(self._right, omega, y, units, f, j_f)
        residuals = ((left[:d] @ rows[..., None])[..., 0] - (self._project @ f[:, :d]).T) / scale
        if not derivative:
            return residuals.ravel(), None
        slopes = j_f.T.reshape(system.d, system.d, self._n)[:d]
        blocks = (self._project * slopes[:, :, None]) @ self._basis  # (d, n, 2 H + 1, 2 H + 1)
        matrix = -np.ascontiguousarray(np.moveaxis(blocks[:, :d], 1, 2))
        for c in range(d):
            matrix[c, :, c, :] += left[c]
        for c, source in enumerate(sources, d):
            matrix[:, :, source, :] -= blocks[:, c] @ left[c]
        matrix *= scale / scale[..., None, None]
        matrix[:, 0, :, 0] += self._fixed_means
        return residuals.ravel(), matrix.reshape(self.size, self.size)
