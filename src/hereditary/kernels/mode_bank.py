"""One bank of modes for several sums of exponentials.

The sums are real, so one complex mode suffices for a conjugate pair of rates. An array of M real
modes has the modes of real rates first. Then come the real parts of all complex modes, and then the
imaginary parts. `multiply_modes` (compiled/linalg.py) multiplies such arrays.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

# Least logarithm of a factor, 1e-261. Numbers that underflow take ten times as long, and products
# with subnormal ones a hundred times.
_MIN_LOG_FACTOR = -600.0


class Bank(NamedTuple):
    """Sums of exponentials over one set of rates, the real parts of ``weights @ exp(-rates t)``."""

    rates: np.ndarray  # (n,): real ones, then of each pair the one with imaginary part > 0
    weights: np.ndarray  # (k, n): a row for each sum, with the weight of a pair doubled

    @classmethod
    def of(cls, sums: Iterable[Any]) -> Bank:
        """Merge sums with `rates` (m,) and `weights` (m,) or (j, m), which share no rates."""
        sums, row, column = list(sums), 0, 0
        rates = np.concatenate([each.rates for each in sums])
        blocks = [np.atleast_2d(each.weights) for each in sums]
        weights = np.zeros((sum(map(len, blocks)), rates.size), rates.dtype)
        for block in blocks:
            last, end = row + block.shape[0], column + block.shape[1]
            weights[row:last, column:end] = block
            row, column = last, end
        if not rates.imag.any():
            return cls(rates.real, weights.real)
        kept = np.append(np.flatnonzero(rates.imag == 0), np.flatnonzero(rates.imag > 0))
        twice = weights * np.where(rates.imag > 0, 2, 1)
        return cls(rates[kept], np.take(twice, kept, axis=1))

    @property
    def n_real(self) -> int:
        """Number of real rates."""
        n = self.rates.size
        return n if self.rates.dtype.kind != "c" else n - int(np.count_nonzero(self.rates.imag))

    @property
    def n_modes(self) -> int:
        """Number of real modes M."""
        return 2 * self.rates.size - self.n_real

    def real_modes(self, values: np.ndarray, axis: int = -1) -> np.ndarray:
        """Return values of all rates along an axis as an array of M real modes."""
        real = values.real
        if self.rates.dtype.kind == "c":
            turning = np.split(values.imag, [self.n_real], axis)[1]
            real = np.concatenate([real, turning], axis)
        return np.ascontiguousarray(real)

    def complex_modes(self, modes: np.ndarray) -> np.ndarray:
        """Return an array of real modes (..., M) as values of all rates."""
        if self.rates.dtype.kind != "c":
            return modes
        n = self.rates.size
        values = modes[..., :n].astype(complex)
        values.imag[..., self.n_real :] = modes[..., n:]
        return values


def damping(rates: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return ``exp(-rate * time)``, shape (n_rates, n_times), not below 1e-261 in size."""
    logs = np.multiply.outer(-rates.real, times)
    damped = np.exp(np.maximum(logs, _MIN_LOG_FACTOR, out=logs), out=logs)
    if rates.dtype.kind != "c":
        return damped
    return damped * np.exp(-1j * np.multiply.outer(rates.imag, times))
