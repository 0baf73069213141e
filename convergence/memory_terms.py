"""Orders of convergence where the right-hand side reads memory: a forced van der Pol-Airy equation.

The right-hand side reads the friction ``(x**2 - 1) D^gamma x``, which starts like
``t**(alpha - gamma)`` with the highest order alpha. BDF(p) has min(p, 1 + 2 alpha - gamma). Adams
has min(2 - gamma, 1 + alpha), and the first order for gamma above 1. GrunwaldLetnikov has
min(1, 2 - gamma). L1 keeps its order, and L2 and the explicit scheme have the first order. Errors
are against Collocation at rtol = 1e-12.
"""

from functools import partial

import numpy as np
from _study import order_claims, order_rows, orders, study

import hereditary as hd

CASES = {
    (1.8, 0.6): [0.5, 0.1],
    (1.6, 0.7): [0.5, 0.1],
    (1.5, 1.2): [0.5, 0.1],
    (0.9, 0.4): 0.5,
    (0.9, 0.7): 0.5,
}
SCHEMES = [
    hd.ExplicitCaputo(),
    hd.GrunwaldLetnikov(),
    hd.L1(),
    hd.L2(),
    hd.BDF(2),
    hd.BDF(3),
    hd.Adams(),
    hd.ProductTrapezoid(),
]
T_END = 2.0


def airy(t, x, memory):
    return np.cos(t) + (1 - x[0] ** 2) * memory[0, 0] - (1 + t) * x[0]


def expected(scheme, alpha, gamma):
    """Order that the docs claim."""
    if isinstance(scheme, hd.BDF):
        return min(scheme.formula, 1 + 2 * alpha - gamma)
    if isinstance(scheme, hd.Adams | hd.ProductTrapezoid):
        return min(2 - gamma, 1 + alpha) if gamma <= 1 else 1.0
    if isinstance(scheme, hd.GrunwaldLetnikov):
        return min(1.0, 2 - gamma)
    return 3 - alpha if isinstance(scheme, hd.L1) and alpha > 1 else 1.0


def measure(quick):
    rows = []
    for (alpha, gamma), y0 in CASES.items():
        equation = hd.Equation(hd.Caputo(alpha), airy, y0, memory=hd.Caputo(gamma))
        exact = hd.solve(equation, T_END, rtol=1e-12).y[-1]
        for scheme in SCHEMES:
            if alpha > scheme.orders[1]:
                continue
            found = {}
            for n in [1600 * 2**k for k in range(4 if quick else 6)]:
                history = hd.SumOfExponentials(1e-13)
                sol = hd.solve(equation, T_END, n, scheme=scheme, history=history)
                found[n] = float(np.abs(sol.y[-1] - exact).max()), sol.stats["run_seconds"]
            labels = {"alpha": alpha, "gamma": gamma, "scheme": repr(scheme)}
            rows += order_rows(labels, expected(scheme, alpha, gamma), found)
    return rows


if __name__ == "__main__":
    labels = ("scheme", "alpha", "gamma")
    study(measure, partial(order_claims, labels=labels), orders(panels=labels[1:]))
