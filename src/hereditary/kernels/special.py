"""Power-law weights without cancellation, and exponential moments.

These functions are missing in SciPy. All weights of schemes with constant pieces follow from the
numbers ``b_k(p) = (k+1)**p - k**p``, 0 <= p < 1, their differences and their alternating sum.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import bernoulli, binom, factorial, zeta


def power_differences(p: float | np.ndarray, n: int) -> np.ndarray:
    """Return ``b_k = (k+1)**p - k**p`` for k < n and 0 <= p < 1, to a few units of rounding."""
    b = np.ones((*np.shape(p)[:-1], n))
    if n > 1:
        k = np.arange(1.0, n)
        b[..., 1:] = k**p * np.expm1(p * np.log1p(1 / k))
    return b


def hurwitz_zeta(s: float, q: float) -> float:
    """Return Hurwitz's ``sum_(k >= 0) (k + q)**-s``, q > 0, continued to s below 1."""
    # by the Euler-Maclaurin formula after 12 summands, to about 1e-13; SciPy has s above 1
    n = 12
    end, total = n + q, np.sum((np.arange(n) + q) ** -s)
    total += end ** (1 - s) / (s - 1) + 0.5 * end**-s
    rising = s
    for j in range(1, 9):
        total += bernoulli(2 * j)[2 * j] / factorial(2 * j) * rising * end ** (1 - s - 2 * j)
        rising *= (s + 2 * j - 1) * (s + 2 * j)
    return float(total)


def power_second_differences(p: float | np.ndarray, n: int) -> np.ndarray:
    """Return 1 and then ``b_k - b_(k-1)`` for k = 1..n-1, with b_k of `power_differences`."""
    # p (k, 1) gives (k, n). The difference of three powers loses all digits near k = 1e8. Beyond
    # k = 16 it is k**p * 2 * sum_m binom(p, 2m) k**-2m instead, to 1e-14. Its eight terms reach
    # 17**-16 = 2e-20, as four do beyond k = 128.
    c = np.ones((*np.shape(p)[:-1], n))
    few = min(n, 17)
    c[..., 1:few] = np.diff(power_differences(p, few))
    for terms, first, end in ((8, 17, min(n, 128)), (4, 128, n)):
        k = np.arange(float(first), max(first, end))
        u, series = k**-2, np.zeros_like(c[..., first:end])
        for m in range(terms, 0, -1):
            series += binom(p, 2 * m)
            series *= u
        c[..., first:end] = 2 * k**p * series
    return c


def alternating_power_sum(p: float) -> float:
    """Return ``sum_k (-1)**k b_k`` = 2 eta(-p), Dirichlet's eta, b_k of `power_differences`."""
    return 2 * (1 - 2 ** (1 + p)) * zeta(-p)


def alternating_sum(terms: np.ndarray) -> float:
    """Sum ``(-1)**k terms[k]`` over infinitely many completely monotone terms, by the first n."""
    # algorithm 1 of [CohenVillegasZagier2000]; the error is 5.8**-n of the sum
    n = len(terms)
    d = (3 + np.sqrt(8.0)) ** n
    d = (d + 1 / d) / 2
    b, c, total = -1.0, -d, 0.0
    for k in range(n):
        c = b - c
        total += c * terms[k]
        b *= (k + n) * (k - n) / ((k + 0.5) * (k + 1))
    return total / d


def mean_exponential(z: ArrayLike) -> np.ndarray:
    """Return ``(1 - exp(-z)) / z``, the mean of exp(-z u) over 0 <= u <= 1."""
    z = np.asarray(z)
    safe = np.where(z == 0, 1.0, z)
    return np.where(z == 0, 1.0, -np.expm1(-safe) / safe)


def first_moment_exponential(z: ArrayLike) -> np.ndarray:
    """Return ``int_0^1 u exp(-z u) du`` = (1 - (1 + z) exp(-z)) / z**2 for z >= 0."""
    # below z = 0.5 by its series sum_j (-z)**j / (j! (j + 2)), whose fifteen terms leave 1e-16
    z = np.asarray(z, dtype=float)
    series = np.zeros_like(z)
    for j in range(14, -1, -1):
        series = series * -z / (j + 1) + 1 / (j + 2)
    safe = np.where(z < 0.5, 1.0, z)
    closed = (-np.expm1(-safe) - safe * np.exp(-safe)) / safe**2
    return np.where(z < 0.5, series, closed)


@lru_cache(maxsize=8)
def gauss_unit(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights of the n-point Gauss-Legendre rule on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    return (nodes + 1) / 2, weights / 2


@lru_cache(maxsize=8)
def graded_unit(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights on [0, 1]: Gauss rules on 51 panels that halve towards 0."""
    # the widest panel has n nodes, each next panel has half as many, and at least 16
    ends = np.append(0.0, 0.5 ** np.arange(50, -1, -1))
    panels = [
        (low + (high - low) * u, (high - low) * weights)
        for k, (low, high) in enumerate(pairwise(ends))
        for u, weights in [gauss_unit(max(16, n >> (50 - k)))]
    ]
    nodes, weights = map(np.concatenate, zip(*panels, strict=True))
    return nodes, weights
