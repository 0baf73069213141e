"""Orders of convergence with Riemann-Liouville terms, whose initial value is infinite at 0.

``D^alpha x + 0.7 D^gamma x = f`` with a linear and a nonlinear f. Explicit schemes and L1 keep
their orders for solutions like t**alpha. BDF(p) keeps p for linear f, and has
min(p, 1 + 2 (alpha - gamma)) for others. L2 and L12 have order 1 - gamma. L2 has 3 - alpha on
meshes ``graded(n, (3 - alpha) / (1 - gamma))``. Errors are against Collocation at rtol = 1e-12.
"""

from functools import partial

import numpy as np
from _study import order_claims, order_rows, orders, study

import hereditary as hd

CASES = {
    (2.0, 0.5): [1.0, 0.3],
    (1.7, 0.4): [1.0, 0.3],
    (1.0, 0.6): [1.0],
    (0.8, 0.5): [1.0],
}
SCHEMES = [
    hd.ExplicitCaputo(),
    hd.GrunwaldLetnikov(),
    hd.L1(),
    hd.BDF(2),
    hd.BDF(3),
    hd.L2(),
    hd.L12(),
]
T_END = 2.5


def linear(t, x):
    return -1.3 * x


def cubic(t, x):
    return np.cos(t) - x**3


def expected(scheme, alpha, gamma, force, graded):
    """Order that the docs claim."""
    if isinstance(scheme, hd.BDF):
        return min(scheme.formula, 9.0 if force is linear else 1 + 2 * (alpha - gamma))
    if isinstance(scheme, hd.L2 | hd.L12):
        return 3 - alpha if graded else 1 - gamma
    return 3 - alpha if isinstance(scheme, hd.L1) and alpha > 1 else 1.0


def errors(equation, exact, scheme, graded, quick):
    """Errors at the end for ever more steps, by their number."""
    found = {}
    for n in [400 * 2**k for k in range(5 if quick else 6)]:
        how = {"mesh": hd.graded(n, graded)} if graded else {"n_steps": n}
        history = hd.SumOfExponentials(1e-13)
        sol = hd.solve(equation, T_END, scheme=scheme, history=history, **how)
        found[n] = float(np.abs(sol.y[-1] - exact).max()), sol.stats["run_seconds"]
    return found


def measure(quick):
    rows = []
    for (alpha, gamma), y0 in CASES.items():
        for force in (linear, cubic):
            terms = hd.Caputo(alpha) + 0.7 * hd.RiemannLiouville(gamma)
            equation = hd.Equation(terms, force, y0)
            exact = hd.solve(equation, T_END, rtol=1e-12).y[-1]
            tried = [(scheme, 0.0) for scheme in SCHEMES if alpha <= scheme.orders[1]]
            if alpha <= 1:
                tried.append((hd.L2(), (3 - alpha) / (1 - gamma)))
            for scheme, graded in tried:
                order = expected(scheme, alpha, gamma, force, graded)
                name = repr(scheme) + (", graded" if graded else "")
                labels = {"alpha": alpha, "gamma": gamma, "force": force.__name__, "scheme": name}
                rows += order_rows(labels, order, errors(equation, exact, scheme, graded, quick))
    return rows


if __name__ == "__main__":
    labels = ("scheme", "alpha", "gamma", "force")
    study(measure, partial(order_claims, labels=labels), orders(panels=labels[1:]))
