"""`fit_exponentials` meets its tolerance with close to the fewest modes possible, in milliseconds.

For exponents 1e-6 to 1.99, t_max/t_min from 10 to 1e12 and tolerances 1e-3 to 1e-13: the largest
relative error on 20,001 log-spaced points, the number of modes against the best possible count
``ceil(log(4 R) / h)`` and the set-up time without the cache.
"""

import math
import statistics
import time

import matplotlib.pyplot as plt
import numpy as np
from _study import Study, check

import hereditary as hd
from hereditary.exponential_sum import fit_unit, trapezoid_step

EXPONENTS = (1e-6, 0.1, 0.5, 0.9, 1.0, 1.5, 1.99)
DECADES = (1, 3, 5, 7, 9, 12)
TOLERANCES = (1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-13)


def measure(quick):
    rows = []
    for exponent in EXPONENTS[::3] if quick else EXPONENTS:
        for decades in DECADES:
            ratio = 10.0**decades
            t = np.exp(np.linspace(0, math.log(ratio), 20_001))
            t[-1] = ratio
            for tol in TOLERANCES:
                fit_unit.cache_clear()
                began = time.perf_counter()
                fit = hd.fit_exponentials(hd.PowerLaw(exponent), 1.0, ratio, tol)
                seconds = time.perf_counter() - began
                error = np.abs(fit(t) * t**exponent - 1).max()
                rows.append(
                    {
                        "exponent": exponent,
                        "ratio": f"{ratio:.0e}",
                        "tol": f"{tol:.0e}",
                        "error_over_tol": f"{error / tol:.4f}",
                        "modes": fit.n_modes,
                        "best": math.ceil(math.log(4 * ratio) / trapezoid_step(exponent, tol)),
                        "milliseconds": f"{1e3 * seconds:.3f}",
                    }
                )
    return rows


def draw(rows):
    figure, ax = plt.subplots(figsize=(6, 4), layout="constrained")
    for tol in TOLERANCES:
        mine = [row for row in rows if row["tol"] == tol and row["exponent"] == 1e-6]
        mine = [row for row in rows if row["tol"] == tol and row["exponent"] == 0.9] or mine
        ratio = [row["ratio"] for row in mine]
        (line,) = ax.semilogx(ratio, [row["modes"] for row in mine], "o-", label=f"{tol:.0e}")
        ax.semilogx(ratio, [row["best"] for row in mine], ":", color=line.get_color())
    ax.set(
        xlabel="$t_{max}/t_{min}$",
        ylabel="modes",
        title="Modes against the best possible count (dotted), $t^{-0.9}$",
    )
    ax.grid(alpha=0.3)
    ax.legend(title="tolerance")
    return figure


def main():
    study = Study(__file__, __doc__)
    study.write(measure(study.quick))
    rows = study.read()
    worst = max(row["error_over_tol"] for row in rows)
    excess = max(row["modes"] - row["best"] for row in rows)
    setup = statistics.median(row["milliseconds"] for row in rows)
    check(f"largest error {worst:.3f} tol (at most 1)", worst <= 1)
    check(f"at most {excess:.0f} modes above the best possible count (12)", excess <= 12)
    check(f"median set-up {setup:.2f} ms (below 5)", setup < 5, study.quick)
    study.save(draw(rows))


if __name__ == "__main__":
    main()
