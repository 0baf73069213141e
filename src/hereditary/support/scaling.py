"""Condition and inverse of matrices whose rows and columns have any units."""

import numpy as np

# Number of sweeps over rows and columns in search of their factors.
_SWEEPS = 40


def condition(matrix: np.ndarray) -> float:
    """Return the condition number of a scaled matrix; infinity if its rows are dependent."""
    if not matrix.size:
        return 1.0
    rows, columns = _factors(matrix)
    sizes = np.linalg.svd(rows * matrix * columns, compute_uv=False)
    return float(sizes[0] / sizes[-1]) if sizes[-1] > 0 else np.inf


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Return the inverse of a square matrix, with the rounding errors of a scaled matrix."""
    rows, columns = _factors(matrix)
    return columns.T * np.linalg.inv(rows * matrix * columns) * rows.T


def _factors(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return factors of rows (m, 1) and of columns (1, n) that make nonzero entries about 1."""
    # The logarithms of the entries are as small as possible in the least-squares sense. The factors
    # are powers of 2, so that they cause no rounding errors. A. R. Curtis, J. K. Reid, On the
    # automatic scaling of matrices for Gaussian elimination, IMA J. Appl. Math. 10 (1972).
    exists = matrix != 0
    entries = np.log2(np.abs(matrix), where=exists, out=np.zeros(matrix.shape))
    of_rows = np.maximum(exists.sum(axis=1, keepdims=True), 1)
    of_columns = np.maximum(exists.sum(axis=0, keepdims=True), 1)
    rows, columns = np.zeros(of_rows.shape), np.zeros(of_columns.shape)
    for _ in range(_SWEEPS):
        rows = -np.where(exists, entries + columns, 0.0).sum(axis=1, keepdims=True) / of_rows
        columns = -np.where(exists, entries + rows, 0.0).sum(axis=0, keepdims=True) / of_columns
    return np.exp2(np.round(rows)), np.exp2(np.round(columns))
