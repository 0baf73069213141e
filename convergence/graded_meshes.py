"""On a mesh graded by order / alpha, singular solutions keep each scheme's full order at all times.

Relaxation D^alpha y = -y, whose solution starts like 1 - c t**alpha. The largest error over all
times against the number of steps, uniform and graded by ``t_k = (k / n)**(order / alpha)``. Without
grading the order is alpha. With it the full order holds to n = 4,000 even at alpha = 0.3, where the
smallest step is 1e-32. Moments of the kernel are computed without cancellation.
"""

import numpy as np
from _study import Claim, chosen, orders, study
from problems import errors_on_mesh, singular_problem

import hereditary as hd
from hereditary.analysis.convergence import observed_order

ALPHAS = (0.3, 0.5, 0.8)
SCHEMES = (hd.L1(), hd.L2(), hd.L2Sigma())


def measure(quick):
    counts = [125 * 2**k for k in range(3 if quick else 6)]
    history = hd.SumOfExponentials(1e-13)
    rows = []
    for alpha in ALPHAS:
        problem = singular_problem(alpha)
        for scheme in SCHEMES:
            full = scheme.order(alpha)
            for kind, exponent, proven in (("uniform", 1.0, alpha), ("graded", full / alpha, full)):
                meshes = [hd.graded(n, exponent) for n in counts]
                found = [errors_on_mesh(problem, scheme, history, mesh) for mesh in meshes]
                orders = [np.nan, *observed_order(counts, found)[0]]
                for n, error, order in zip(counts, found, orders, strict=True):
                    rows.append(
                        {
                            "alpha": alpha,
                            "scheme": repr(scheme),
                            "mesh": kind,
                            "n_steps": n,
                            "error": f"{error:.3e}",
                            "order": f"{order:.3f}",
                            "proven": f"{proven:.2f}",
                        }
                    )
    return rows


def claims(rows):
    last = max(row["n_steps"] for row in rows)
    for row in chosen(rows, n_steps=last):
        off, where = abs(row["order"] - row["proven"]), f"{row['scheme']}, alpha {row['alpha']:g}"
        yield Claim(f"orders off the proven ones, {row['mesh']} meshes", off, 0.15, where=where)


if __name__ == "__main__":
    study(measure, claims, orders(("scheme", "mesh"), ("alpha",)))
