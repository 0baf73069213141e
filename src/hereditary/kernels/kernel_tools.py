"""Parts of several memory kernels: special functions, a Gauss rule and argument checks."""

import math

import numpy as np
from scipy.special import gamma, gammainc

from ..support.checks import complaint, real, real_array

# Largest exponent below 1.
BELOW_ONE = math.nextafter(1.0, 0.0)
# exp(-700) is still a normal number: beyond, kernels and their sums are 0.
GONE = 700.0


def mean_of_decay(p, x):
    """``p int_0^1 u**(p-1) exp(-x u) du``, from 1 at x = 0, without loss anywhere.

    For x < p + 1 the series ``exp(-x) sum_k x**k / ((p+1)...(p+k))``, all of one sign.
    """
    x = np.asarray(x, dtype=float)
    small = x < p + 1
    near, far = np.where(small, x, 0.0), np.where(small, 1.0, x)
    term, total, k = np.ones_like(near), np.ones_like(near), 0
    while np.any(term > 1e-17 * total):
        k += 1
        term = term * near / (p + k)
        total = total + term
    closed = gamma(p + 1) * far**-p * gammainc(p, far) if not np.all(small) else total
    return np.where(small, np.exp(-near) * total, closed)


def gauss_rule(x, mass, m):
    """Return the m-point Gauss rule of the measure with atoms x in [0, 1] and positive masses.

    Lanczos' method with full reorthogonalisation on diag(x), started at sqrt(mass). The nodes are
    the eigenvalues of the tridiagonal matrix and lie inside [0, 1]; the weights are positive.
    """
    total = mass.sum()
    basis = np.zeros((m, x.size))
    basis[0] = np.sqrt(mass / total)
    jacobi = np.zeros((m, m))
    for k in range(m):
        v = x * basis[k]
        jacobi[k, k] = v @ basis[k]
        if k + 1 == m:
            break
        for _ in range(2):
            v -= basis[: k + 1].T @ (basis[: k + 1] @ v)
        norm = math.sqrt(v @ v)
        jacobi[k, k + 1] = jacobi[k + 1, k] = norm
        basis[k + 1] = v / norm
    nodes, vectors = np.linalg.eigh(jacobi)
    return np.maximum(nodes, 0.0), total * vectors[0] ** 2


def log_fastest(tol):
    """Return the logarithm of the fastest rate of sums, times t_min: it decays to exp(-3) tol."""
    return math.log(3.0 - math.log(tol))


def not_negative(argument, value):
    """Refuse what is no finite number of at least 0."""
    number = real(argument, value, "be a finite number of at least 0")
    if number < 0:
        raise ValueError(complaint(argument, "be a finite number of at least 0", number))


def matching(name, first, other, second):
    """Two arrays of one length, at least 1."""
    a, b = np.atleast_1d(real_array(name, first)), np.atleast_1d(real_array(other, second))
    if a.ndim != 1 or a.shape != b.shape or a.size == 0:
        required = f"have shape (n,) as {other}, n >= 1"
        raise ValueError(complaint(name, required, f"shapes {a.shape} and {b.shape}"))
    return a, b


def all_positive(name, values):
    """Refuse an array with entries of 0 or below."""
    if np.any(values <= 0):
        remedy = "leave out what has no weight" if np.any(values == 0) else ""
        raise ValueError(complaint(name, "be positive", values.tolist(), remedy))


def refuse_gone(decay, t_min):
    """Refuse a fit that begins where the kernel, exp(-decay), is 0 in rounding."""
    if decay > GONE:
        raise ValueError(complaint("t_min", "come before the kernel is 0 in rounding", t_min))
