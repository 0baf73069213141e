"""Covariance of parameters that least squares found, and a warning of those it cannot know."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from .warning import warn

# Ratio of singular values below which data do not determine a combination of parameters.
_UNDETERMINED = 1e-4
# A parameter has no error if its coefficient in an undetermined combination exceeds this.
_MAX_UNDETERMINED_SHARE = 0.01


class IdentifiabilityWarning(UserWarning):
    """Data do not determine all parameters: a combination of them does not change the residuals."""


def covariance_of(
    found: Any,
    scale: np.ndarray,
    at_bound: np.ndarray,
    estimated: bool,
    names: list[str] | Literal[False],
) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance of parameters, and the singular values for changes by their scale.

    Entries are NaN for a parameter at a bound, and for one in a combination that does not change
    residuals. The function warns of such combinations if `names` are given.
    """
    free = np.flatnonzero(~at_bound)
    jacobian = found.jac[:, free] * scale[free]
    sizes = np.linalg.norm(jacobian, axis=0)
    dead = sizes <= _UNDETERMINED * sizes.max(initial=0.0)
    sizes[dead] = 1.0
    _, singular, rows = np.linalg.svd(np.where(dead, 0.0, jacobian) / sizes, full_matrices=False)
    determined = singular > _UNDETERMINED * singular.max(initial=0.0)
    shares = np.linalg.norm(rows[~determined], axis=0)
    unknown = shares > _MAX_UNDETERMINED_SHARE
    if names and unknown.any():
        parts = " and ".join(names[k] for k in free[unknown])
        warn(f"data do not tell {parts}: fix one of them, or measure more", IdentifiabilityWarning)
    inverse = np.where(determined, 1 / np.where(determined, singular, 1.0), 0.0)
    half = (rows.T * inverse) * (scale[free] / sizes)[:, None]
    spread = half @ half.T
    if estimated:
        freedom = found.jac.shape[0] - free.size
        spread *= 2 * found.cost / freedom if freedom > 0 else np.nan
    spread[unknown] = spread[:, unknown] = np.nan
    covariance = np.full((scale.size, scale.size), np.nan)
    covariance[np.ix_(free, free)] = spread
    return covariance, singular
