"""A few separate rates, found to rounding: neighbours joined, then rates and weights moved.

Least squares on a grid of rates shows a lone rate as a pair of neighbours, and comes no closer to
it than the square root of rounding. Near the solution the problem in log rates and log weights is
smooth, and some steps of Gauss and Newton solve it.
"""

import math

import numpy as np

# More rates than this are a continuous spectrum, which joining its rates does not help.
FEW = 12
# Steps until rounding, ten times what is seen.
_STEPS = 20
# Damping to begin with and at least, relative to the squares of the columns.
_DAMPING, _LEAST = 1e-6, 1e-24


def few_rates(samples, v, weights, gap):
    """Log rates and weights of a fit with a rate for each cluster of rates, or None.

    Parameters
    ----------
    samples : Samples
        The kernel.
    v, weights : ndarray, shape (n,)
        Log rates, -inf for rate 0, and weights of a fit that is close already.
    gap : float
        Log rates no farther apart than this are one cluster.

    Returns
    -------
    tuple of ndarray, or None
        None where clusters are more than a few.
    """
    v, weights = _joined(v, weights, gap)
    return _moved(samples, v, weights) if 0 < v.size <= FEW else None


def _joined(v, weights, gap):
    """One rate for each cluster, at the mean of its log rates; rate 0 stays by itself."""
    order = np.argsort(v, kind="stable")
    v, weights = v[order], weights[order]
    zero = v == -np.inf
    apart = np.diff(np.where(zero, 0.0, v)) > gap
    cluster = np.cumsum(np.append(0, apart | zero[:-1]))[: v.size]
    total = np.bincount(cluster, weights)
    mean = np.bincount(cluster, weights * np.where(zero, 0.0, v)) / total
    mean[cluster[zero]] = -np.inf
    return mean, total


def _moved(samples, v, weights):
    """Levenberg's and Marquardt's steps in log rates and log weights, while the misfit falls."""
    misfit, damping = samples.emphasis * samples.error(v, weights), _DAMPING
    for _ in range(_STEPS):
        derivatives, size = _derivatives(samples, v, weights)
        best = np.linalg.norm(misfit)
        for _ in range(6):
            step = _step(derivatives, misfit, damping) / size
            weights_step, rates_step = step[: v.size], step[v.size :]
            if np.abs(step).max() < 2:
                trial = v.copy()
                trial[v > -np.inf] += rates_step
                heavier = weights * np.exp(weights_step)
                error = samples.emphasis * samples.error(trial, heavier)
                if np.linalg.norm(error) < best:
                    break
            damping *= 100
        else:
            break
        v, weights, misfit = trial, heavier, error
        damping = max(1e-3 * damping, _LEAST)
        if np.linalg.norm(misfit) > 0.99 * best:
            break
    return v, weights


def _derivatives(samples, v, weights):
    """Those of the misfit by log weights and finite log rates, as unit columns, and their sizes."""
    by_weight = samples.emphasis[:, None] * samples.columns(v) * weights
    finite = v > -np.inf
    by_rate = -np.multiply.outer(samples.t, np.exp(v[finite])) * by_weight[:, finite]
    columns = np.hstack([by_weight, by_rate])
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return columns / size, size


def _step(derivatives, misfit, damping):
    """The damped least-squares step against the misfit."""
    ridge = math.sqrt(damping) * np.eye(derivatives.shape[1])
    q, r = np.linalg.qr(np.concatenate([derivatives, ridge]))
    return -np.linalg.solve(r, q[: misfit.size].T @ misfit)
