"""Weights of operators whose orders vary, a stretch of steps at a time."""

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from scipy.special import rgamma

from .._jit import compiled, inner

# Degree at which the polynomials below are right to rounding.
_DEGREE = 18


def _sine(p):
    """sin(pi p) / (pi p (1 - p)), even about 1/2."""
    least = np.minimum(p, 1 - p)
    return np.sinc(least) / (1 - least)


def _polynomial(function):
    """Coefficients in 2 p - 1 of a function of p in [0, 1], ascending."""
    fit = Chebyshev.interpolate(function, _DEGREE, (0, 1))
    return Chebyshev(fit.coef).convert(kind=Polynomial).coef


# 1/Gamma(p + 1), and what makes sin(pi p)/pi of p (1 - p): a third of the time of SciPy's
_FITS = np.array([_polynomial(lambda p: rgamma(p + 1)), _polynomial(_sine)])


@compiled
def fill_term(p, scale, factor, first, second, drift, least, lead, near, drifts, share, kernels):
    """Work out one term's amplitudes at n steps, and add its nearest weights to its group's.

    The term's Caputo weights are multiples of its amplitude ``factor scale / Gamma(p + 1)``, which
    goes to `share`; its kernel as an integral over rates has the amplitude in `kernels`. Times
    `first`, `second` and `drift` it is added to the group's weights `lead` of the newest increment,
    `near` of the one before, and `drifts` of x'(0); `drift` is empty where x'(0) has no weight.
    Exponents 1 - p are at least `least`, so that amplitudes stay what they are where rounding takes
    an exponent for 0.
    """
    # p, scale, first, second, drift (n,); lead, near, drifts (n,) of the group; share, kernels (n,)
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
    """Work out one term's modes at n steps: its first amplitude on the grid, and the slow nodes'.

    On the grid of rates ``exp(h j)`` the kernel ``t**-a`` has amplitudes in geometric progression,
    with the ratio exp(a h) in row 1 of `own`; row 0 becomes the first of them. All slower rates
    are replaced by three nodes with the same moments k = 0, 1, 2, ``before / (1 - exp(-(a + k)
    h))`` where `before` is the amplitude one rate below the grid; rows 3 to 5 become the weights of
    these nodes.
    """
    # own (6, n): exp(a x), exp(a h), any, exp(-a h) - 1 and unused; factors (3, 3): what each
    #   moment gives to the nodes; decays (2,): exp(-k h)
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
