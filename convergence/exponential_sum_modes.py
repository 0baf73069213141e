"""`fit_exponentials` meets its tolerance with close to the fewest modes possible, in milliseconds.

Exponents are 1e-6 to 1.99, t_max/t_min from 10 to 1e12 and tolerances 1e-3 to 1e-13. Rows have the
largest relative error on 20,001 log-spaced points. They have the number of modes against the best
possible count ``ceil(log(4 R) / h)`` and the set-up time without the cache.
"""

import math
import statistics
import time

import numpy as np
from _study import Claim, curves, study

import hereditary as hd
from hereditary.kernels.exponential_sum import fit_unit, trapezoid_step

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


def claims(rows):
    for row in rows:
        where = f"t**-{row['exponent']:g}, tol {row['tol']:g}"
        yield Claim("largest error over the tolerance", row["error_over_tol"], 1, small=True)
        excess = row["modes"] - row["best"]
        yield Claim("modes above the fewest possible", excess, 12, where=where, small=True)
    setup = statistics.median(row["milliseconds"] for row in rows)
    yield Claim("median set-up [ms]", setup, 5)


if __name__ == "__main__":
    draw = curves("ratio", ("modes", "best"), ("tol",), ("exponent",), log="x")
    study(measure, claims, draw)
