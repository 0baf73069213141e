"""Implicit-explicit steps have the order of their scheme, where f is smooth in t.

Two components with a constant matrix and a nonlinear rest; solutions 1 + t**3 and 1 + t**alpha +
t**(2 alpha). Where they start like t**alpha, extrapolating the rest leaves order 1 + alpha, so that
``IMEX(BDF(2))`` has min(2, 1 + alpha). Last pairwise orders lie within 0.15 of the proven ones.
"""

import matplotlib.pyplot as plt
import numpy as np
from _study import Study, check, last_order
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


def main():
    study = Study(__file__, __doc__)
    study.write(list(measure(study.quick)))
    rows = study.read()
    off = max(abs(row["order"] - row["proven"]) for row in rows)
    check(f"all orders within {off:.2f} of the proven ones", off <= 0.15, study.quick)
    figure, axes = plt.subplots(1, 2, figsize=(9, 4), sharey=True, layout="constrained")
    for axis, kind in zip(axes, ("smooth", "singular"), strict=True):
        for number, scheme in enumerate(f"IMEX(scheme={inner!r})" for inner in SCHEMES):
            mine = [r for r in rows if (r["scheme"], r["solution"]) == (scheme, kind)]
            alpha = [row["alpha"] for row in mine]
            axis.plot(
                alpha,
                [r["order"] for r in mine],
                f"oC{number}",
                label=scheme.replace("scheme=", ""),
            )
            for part in ([r for r in mine if r["alpha"] < 1], [r for r in mine if r["alpha"] > 1]):
                x = [row["alpha"] for row in part]
                axis.plot(x, [row["proven"] for row in part], f"-C{number}", lw=0.8)
        axis.set(xlabel=r"$\alpha$", title=f"{kind} solutions")
    axes[0].set_ylabel("order: observed (marks), proven (lines)")
    axes[0].legend(fontsize=8)
    study.save(figure)


if __name__ == "__main__":
    main()
