"""Weights keep their digits at N = 1e5, where differences of powers as they are printed lose them.

Relative errors of three families of weights at growing k, as computed here and by the literal
formula in double precision, both against 60 digits: second differences (explicit scheme, L1 above
order 1), parabola moments (L2), hat weights (Adams, product trapezoid).
"""

import mpmath
import numpy as np
from _study import Claim, curves, study

from hereditary.schemes.adams import hat_weights
from hereditary.schemes.weights import parabola_start
from hereditary.step_kernel import PowerSteps

P = 0.3  # kernel p t**(p-1): order 0.7, and for the hats alpha = 1.3
KERNEL = PowerSteps(P)


def second_difference(k, number):
    """(k+1)**p - 2 k**p + (k-1)**p."""
    p = number(P)
    return number(k + 1) ** p - 2 * number(k) ** p + number(k - 1) ** p


def moment(k, number):
    """[(k+1)**(p+1) - k**(p+1)] / (p+1) - [(k+1)**p + k**p] / 2."""
    p = number(P)
    a, b = number(k + 1), number(k)
    return (a ** (p + 1) - b ** (p + 1)) / (p + 1) - (a**p + b**p) / 2


def hat(k, number):
    """Third difference of k**(alpha+1)."""
    e = number(2) + number(P)
    powers = [number(abs(k + j)) ** e for j in (1, 0, -1, -2)]
    return powers[0] - 3 * powers[1] + 3 * powers[2] - powers[3]


def ours(name, ks):
    n = max(ks) + 2
    table = {
        "second differences": lambda: KERNEL.differences(n),
        "parabola moments": lambda: -parabola_start(1.0).exact(KERNEL, n),
        "hat weights": lambda: hat_weights(1 + P, n),
    }[name]()
    # the moment over [k, k+1] is the start weight of k
    return [float(table[k]) for k in ks]


FAMILIES = {
    "second differences": second_difference,
    "parabola moments": moment,
    "hat weights": hat,
}


def measure(quick):
    ks = [10**e for e in range(1, 5 if quick else 6)]
    rows = []
    for name, formula in FAMILIES.items():
        found = ours(name, [k - 1 if name == "parabola moments" else k for k in ks])
        for k, value in zip(ks, found, strict=True):
            with mpmath.workdps(60):
                exact = formula(k, mpmath.mpf)
            rows.append(
                {
                    "weights": name,
                    "k": k,
                    "ours": f"{abs(value / float(exact) - 1):.1e}",
                    "literal": f"{abs(formula(k, np.float64) / float(exact) - 1):.1e}",
                }
            )
    return rows


def claims(rows):
    for row in rows:
        yield Claim("largest relative error", row["ours"], 1e-12, where=row["weights"], small=True)
    lost = max(row["literal"] for row in rows)
    yield Claim("the literal formulas lose up to", lost, at_least=1e-9)


if __name__ == "__main__":
    study(measure, claims, curves("k", ("ours", "literal"), ("weights",)))
