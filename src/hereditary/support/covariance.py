"""Covariance of parameters that least squares found, and a warning of those it cannot know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.special import stdtrit

from .checks import within
from .warning import warn

# Ratio of singular values below which data do not determine a combination of parameters.
_UNDETERMINED = 1e-4
# A parameter has no error if its coefficient in an undetermined combination exceeds this.
_MAX_UNDETERMINED_SHARE = 0.01


class IdentifiabilityWarning(UserWarning):
    """Data do not determine all parameters: a combination of them does not change the residuals."""


def covariance_of(
    optimum: Any, scale: np.ndarray, at_bound: np.ndarray, estimated: bool,
    names: list[str] | Literal[False],
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the covariance of parameters, and the singular values for changes by their scale."""
    # Entries are NaN for a parameter at a bound, and for one in a combination that does not change
    # residuals. The function warns of such combinations if `names` are given.
    free = np.flatnonzero(~at_bound)
    jacobian = optimum.jac[:, free] * scale[free]
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
        freedom = optimum.jac.shape[0] - free.size
        spread *= 2 * optimum.cost / freedom if freedom > 0 else np.nan
    spread[unknown] = spread[:, unknown] = np.nan
    covariance = np.full((scale.size, scale.size), np.nan)
    covariance[np.ix_(free, free)] = spread
    return covariance, singular


@dataclass(frozen=True, eq=False, repr=False)
class Estimates:
    """Parameters that least squares found, m of them, and how well they are known.

    Attributes
    ----------
    parameters, standard_errors : dict
        By name. Errors are by the linear theory of least squares. They are NaN at a bound, and if
        the data do not determine the parameter. `hereditary.IdentifiabilityWarning` names the
        latter.
    covariance, correlation : ndarray, shape (m, m)
        In the order of `parameters`; NaN if the standard error is NaN.
    at_bound : list of str
        Names of parameters at a bound.
    freedom : float
        Number of data less that of free parameters; infinite if deviations of the data are given.
    cost : float
        Half the sum of squares of residuals, over sigma if it is given.
    success : bool
        Whether the optimiser converged, and all runs with these parameters complete.
    message : str
        The optimiser's reason to stop, or why a run failed, and the parameters at a bound.
    """

    parameters: dict[str, float]
    standard_errors: dict[str, float]
    covariance: np.ndarray
    correlation: np.ndarray
    at_bound: list[str]
    freedom: float
    cost: float
    success: bool
    message: str

    def __repr__(self) -> str:
        suffixes = {name: f" +- {error:.2g}" for name, error in self.standard_errors.items()}
        suffixes |= {
            name: " (undetermined)" for name, text in suffixes.items() if text == " +- nan"
        }
        suffixes |= dict.fromkeys(self.at_bound, " (at a bound)")
        estimates = (
            f"{name} = {value:.6g}{suffixes[name]}" for name, value in self.parameters.items()
        )
        kind = type(self).__name__
        return f"{kind}({', '.join(estimates)}; cost {self.cost:.4g}; {self.message})"

    def intervals(self, confidence: float = 0.95) -> dict[str, tuple[float, float]]:
        """Return confidence intervals by name, from Student's distribution of the residuals.

        Parameters
        ----------
        confidence : float
            Probability that an interval holds the true value, between 0 and 1 [-].

        Returns
        -------
        dict of str to (float, float)
            (NaN, NaN) if the standard error is NaN.
        """
        low, high = np.nextafter([0.0, 1.0], 0.5).tolist()
        within("confidence", confidence, low, high, "(0, 1)")
        width = float(stdtrit(self.freedom, 0.5 + 0.5 * confidence))
        estimates = zip(self.parameters.items(), self.standard_errors.values(), strict=True)
        return {name: (p - width * error, p + width * error) for (name, p), error in estimates}


def estimates_of(
    names: list[str], values: np.ndarray, covariance: np.ndarray, at_bound: np.ndarray, message: str
) -> dict[str, Any]:
    """Return the fields of `Estimates` that follow from parameters (m,) and their covariance."""
    errors = np.sqrt(np.diag(covariance))
    bound = np.array(names)[at_bound].tolist()
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / np.outer(errors, errors)
    return {
        "parameters": dict(zip(names, values.tolist(), strict=True)),
        "standard_errors": dict(zip(names, errors.tolist(), strict=True)),
        "covariance": covariance,
        "correlation": correlation,
        "at_bound": bound,
        "message": message + (f" At a bound: {', '.join(bound)}." if bound else ""),
    }
