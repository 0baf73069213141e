"""Implicit-explicit steps have the order of their scheme, where f is smooth in t.

Two components with a constant matrix and a nonlinear rest; solutions 1 + t**3 and 1 + t**alpha +
t**(2 alpha). Where they start like t**alpha, extrapolating the rest leaves order 1 + alpha, so that
``IMEX(BDF(2))`` has min(2, 1 + alpha). Last pairwise orders lie within 0.15 of the proven ones.
"""

import numpy as np
from _study import last_order, last_order_claims, last_orders, study
from problems import linear_and_rest

import hereditary as hd

ALPHAS = (0.4, 0.6, 0.8, 1.4, 1.6, 1.8)
SCHEMES = (hd.L1(), hd.BDF(1), hd.BDF(2))
# Errors below this are rounding or the tolerance of the exponential sum.
_FLOOR = 1e-11


def measure(quick):
    for scheme in map(hd.IMEX, SCHEMES):
        for alpha in ALPHAS[1::3] if quick else ALPHAS:
            for kind in ("smooth", "singular"):
                powers = [3.0] if kind == "smooth" else [alpha, 2 * alpha]
                equation, exact = linear_and_rest(alpha, powers)
                counts = [400 * 2**k for k in range(3 if quick else 8)]
                how = {"scheme": scheme, "history": hd.SumOfExponentials(1e-13)}
                ends = [hd.solve(equation, 1.0, n, **how, save_every=n).y[-1] for n in counts]
                errors = np.abs(np.array(ends) - exact).max(axis=1)
                yield last_order(scheme, alpha, kind, counts, errors, _FLOOR)


if __name__ == "__main__":
    study(measure, last_order_claims, last_orders)
