"""Every scheme shows its proven order, for smooth solutions and for solutions like t**alpha.

Uniform steps. Smooth: D^alpha y + y with y = 1 + t**3, largest error over all times, so that a
start of lower order cannot hide. Singular: relaxation and oscillation, error at a fixed time. The
last pairwise order lies within 0.15 of the proven one. Where a second term of nearly the same order
goes along (order 1.2), that takes more steps.
"""

import sys
from pathlib import Path

from _study import Study, last_order, last_order_claims, last_orders, study
from problems import errors, singular_problem, smooth_problem

import hereditary as hd

ORDERS = (0.1, 0.3, 0.5, 0.8, 0.95)
ABOVE_ONE = (1.2, 1.5, 1.8, 1.95)
SCHEMES = {
    hd.ExplicitCaputo(): ORDERS + ABOVE_ONE,
    hd.GrunwaldLetnikov(): ORDERS + ABOVE_ONE,
    hd.L1(): ORDERS + ABOVE_ONE,
    hd.L12(): ORDERS,
    hd.L2(): ORDERS,
    hd.L2Sigma(): ORDERS + ABOVE_ONE,
    hd.BDF(2): ORDERS + ABOVE_ONE,
    hd.BDF(3): ORDERS,
    hd.Adams(): ORDERS + ABOVE_ONE,
    hd.Adams(corrections=3): ORDERS,
    hd.ProductTrapezoid(): ORDERS + ABOVE_ONE,
}
# Errors below this are rounding or the tolerance of the exponential sum.
_FLOOR = 1e-11


def measure(quick):
    rows = []
    for scheme, orders in SCHEMES.items():
        for alpha in orders[::4] if quick else orders:
            for kind, problem, which in (
                ("smooth", smooth_problem(alpha), 1),
                ("singular", singular_problem(alpha), 0),
            ):
                counts = [200 * 2**k for k in range(4 if quick else 9)]
                found = [
                    errors(problem, scheme, hd.SumOfExponentials(1e-13), n)[which] for n in counts
                ]
                rows.append(last_order(scheme, alpha, kind, counts, found, _FLOOR))
    return rows


def page():
    """docs/orders.md: the last observed order of every case beside the proven one."""
    lines = ["# Orders of convergence", "", "Written by `convergence/orders.py` from"]
    lines += ["`results/orders.csv`: the last observed order, in brackets the proven one,"]
    lines += ["and the error.", ""]
    lines += ["| scheme | alpha | smooth | error | singular | error |", "|---|---|---|---|---|---|"]
    rows = Study(__file__, __doc__).read()
    for smooth, singular in zip(rows[::2], rows[1::2], strict=True):
        cells = [f"`{smooth['scheme']}`", f"{smooth['alpha']:g}"]
        for row in (smooth, singular):
            cells += [f"{row['order']:.2f} ({row['proven']:.2f})", f"{row['error']:.0e}"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    study(measure, last_order_claims, last_orders)
    if "--quick" not in sys.argv:
        (Path(__file__).parent.parent / "docs" / "orders.md").write_text(page())
