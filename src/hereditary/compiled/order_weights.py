"""Weights of operators whose orders vary, for a batch of steps at a time."""

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from scipy.special import rgamma

from .jit import compiled, inner

# Degree at which the polynomials below are right to rounding.
_DEGREE = 18


def _sine(p):
    """Return sin(pi p) / (pi p (1 - p)), even about 1/2."""
    least = np.minimum(p, 1 - p)
    return np.sinc(least) / (1 - least)


def _polynomial(function):
    """Return coefficients in 2 p - 1 of a function of p in [0, 1], ascending."""
    fit = Chebyshev.interpolate(function, _DEGREE, (0, 1))
    return Chebyshev(fit.coef).convert(kind=Polynomial).coef


# 1/Gamma(p + 1), and what makes sin(pi p)/pi of p (1 - p): a third of the time of SciPy's
_FITS = np.array([_polynomial(lambda p: rgamma(p + 1)), _polynomial(_sine)])


@compiled
def fill_term(p, scale, factor, first, second, drift, least, lead, near, drifts, share, kernels):
    """Set the factor of one term at n steps, and add its weights of the newest pieces.

    Weights of increments in Caputo's derivative are integrals of ``p t**(p-1)`` times the factor
    ``coefficient h**-alpha / Gamma(p + 1)``.

    Parameters
    ----------
    p : ndarray, shape (n,)
        p = m - alpha at each step.
    scale, factor : ndarray, shape (n,), and float
        h**p, and the term's coefficient times h**-m: their product is that with h**-alpha.
    first, second, drift : ndarray, shape (n,)
        Integrals for the newest increment, for the one before and for x'(0); the last is empty
        where x'(0) has no weight.
    least : float
        What 1 - p counts as at least: where rounding makes it 0 it would take the modes away.
    lead, near, drifts : ndarray, shape (n,)
        Weights of these three, to which the term's are added.
    share : ndarray, shape (n,)
        Set to the factor.
    kernels : ndarray, shape (n,)
        Set to the factor of ``t**(p-1)`` as an integral over the rates of exponentials.
    """
    for i in range(p.shape[0]):
        u = 2 * p[i] - 1
        one, other = _FITS[0, _DEGREE], _FITS[1, _DEGREE]
        for k in range(_DEGREE - 1, -1, -1):
            one = one * u + _FITS[0, k]
            other = other * u + _FITS[1, k]
        share[i] = factor * scale[i] * one
        # 1/(Gamma(p) Gamma(1 - p)) = sin(pi p)/pi
        kernels[i] = factor * scale[i] * other * p[i] * max(1 - p[i], least)
    # a loop with more arrays would not be vectorised: each may lie over the others
    add_product(lead, share, first)
    add_product(near, share, second)
    if drift.shape[0] > 0:
        add_product(drifts, share, drift)


@inner
def add_product(out, a, b):
    """Add the product of a and b, element by element, to `out`; all (n,)."""
    for i in range(out.shape[0]):
        out[i] += a[i] * b[i]


@compiled
def invert_lead(lead):
    """Replace leading weights by their inverses.

    Returns the first step at which one cannot be divided by, or the number of steps.
    """
    # lead (n,)
    n_good = lead.shape[0]
    for i in range(lead.shape[0] - 1, -1, -1):
        lead[i] = 1 / lead[i]
        if not (abs(lead[i]) < np.inf and lead[i] != 0.0):
            n_good = i
    return n_good


@compiled
def fill_starts(own, kernels, factors, decays):
    """Set the weights with which a sum of exponentials stands for ``t**-a`` at each of n steps.

    The rates are ``exp(x + q j)``, j = 0, 1, .., whose weights grow by exp(a q) from one to the
    next; the first of them is set. All slower rates, j < 0, are replaced by three rates with the
    same moments k = 0, 1, 2 of their weights, ``before / (1 - exp(-(a + k) q))`` with `before` the
    weight at j = -1; the weights of these three are set.

    Parameters
    ----------
    own : ndarray, shape (6, n)
        Given exp(a x), exp(a q), anything and exp(-a q) - 1 in rows 0 to 3; set to the first weight
        in row 0 and to the weights of the three rates in rows 3 to 5.
    kernels : ndarray, shape (n,)
        Coefficient of ``t**-a`` as an integral over rates, from `fill_term`.
    factors : ndarray, shape (3, 3)
        Weights of the three rates for a unit of each moment.
    decays : ndarray, shape (2,)
        exp(-k q) for k = 1, 2.
    """
    begin, ratio, fall = own[0], own[1], own[3]
    first, second, third = own[3], own[4], own[5]
    for i in range(kernels.shape[0]):
        begin[i] *= kernels[i]
    for i in range(kernels.shape[0]):
        before, keep = begin[i], 1 + fall[i]
        m0 = -before / fall[i]
        m1, m2 = before / (1 - keep * decays[0]), before / (1 - keep * decays[1])
        first[i] = factors[0, 0] * m0 + factors[0, 1] * m1 + factors[0, 2] * m2
        second[i] = factors[1, 0] * m0 + factors[1, 1] * m1 + factors[1, 2] * m2
        third[i] = factors[2, 0] * m0 + factors[2, 1] * m1 + factors[2, 2] * m2
    for i in range(kernels.shape[0]):
        begin[i] *= ratio[i]
