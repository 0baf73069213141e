"""Observed orders of convergence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..support.checks import complaint, real_array


@dataclass(frozen=True, eq=False)
class OrderTable:
    """Errors against step counts, with the orders they show.

    Attributes
    ----------
    n_steps : ndarray, shape (k,)
        Increasing numbers of steps.
    errors : ndarray, shape (k,)
        Error of each run, above 0.
    pairwise : ndarray, shape (k-1,)
        Order between neighbours, ``log(e_i / e_(i+1)) / log(n_(i+1) / n_i)``.
    slope : float
        Least-squares order over all of them.
    """

    n_steps: np.ndarray
    errors: np.ndarray
    pairwise: np.ndarray
    slope: float


def observed_order(n_steps: ArrayLike, errors: ArrayLike) -> OrderTable:
    """Orders of convergence from errors at several step counts.

    Parameters
    ----------
    n_steps : array_like, shape (k,)
        Numbers of steps, increasing, k >= 2; coarse ones where the order still moves are the
        caller's to leave out.
    errors : array_like, shape (k,)
        Errors, above 0.

    Returns
    -------
    OrderTable

    Examples
    --------
    >>> from hereditary.analysis.order import observed_order
    >>> round(observed_order([100, 200, 400], [4e-2, 2e-2, 1e-2]).slope, 12)
    1.0
    """
    n = real_array("n_steps", n_steps)
    e = real_array("errors", errors)
    if n.ndim != 1 or n.shape != e.shape or n.size < 2:
        required = "hold one value for each of at least two step counts"
        raise ValueError(complaint("errors", required, f"shapes {n.shape} and {e.shape}"))
    if np.any(n <= 0) or np.any(np.diff(n) <= 0) or np.any(e <= 0):
        required = "be positive, with increasing n_steps"
        raise ValueError(complaint("n_steps and errors", required, f"{n.tolist()}, {e.tolist()}"))
    log_n, log_e = np.log(n), np.log(e)
    return OrderTable(
        n_steps=n,
        errors=e,
        pairwise=-np.diff(log_e) / np.diff(log_n),
        slope=-float(np.polyfit(log_n, log_e, 1)[0]),
    )
