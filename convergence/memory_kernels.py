"""Every memory kernel becomes a sum of positive exponentials, down to 1e-10 over six decades.

Kernels are tempered, Mittag-Leffler, stretched and distributed-order ones, and two given as
functions, on [1e-4, 1e2] in units of their own time. Errors are the largest on 20,001 log-spaced
points, relative to the kernel or at least to a thousandth of its mean from 0 to t. The number of
modes is compared with that of the power law ``t**-0.5``, and the set-up time is measured.
"""

import time

import numpy as np
from _study import Claim, curves, study

import hereditary as hd
from hereditary import (
    DistributedOrder,
    Kernel,
    MittagLeffler,
    StretchedExponential,
    TemperedPowerLaw,
)

KERNELS = {
    "power law 0.5": hd.PowerLaw(0.5),
    "tempered 0.5": TemperedPowerLaw(0.5, 1.0),
    "Mittag-Leffler 0.5": MittagLeffler(0.5, 1.0),
    "Mittag-Leffler 0.8": MittagLeffler(0.8, 1.0),
    "two rates": Kernel(lambda t: np.exp(-t) + 0.3 * np.exp(-50 * t)),
    "Mittag-Leffler 0.95": MittagLeffler(0.95, 1.0),
    "Mittag-Leffler 0.999": MittagLeffler(0.999, 1.0),
    "stretched 0.3": StretchedExponential(0.3, 1.0),
    "stretched 0.5": StretchedExponential(0.5, 1.0),
    "stretched 0.8": StretchedExponential(0.8, 1.0),
    "stretched 0.9": StretchedExponential(0.9, 1.0),
    "distributed 0 to 1": DistributedOrder.from_density(lambda a: 1.0),
    "distributed 0, 0.2, 0.9": DistributedOrder([0.0, 0.2, 0.9], [1.0, 1.0, 2.0]),
    "1/sqrt(t(1+t))": Kernel(lambda t: 1 / np.sqrt(t * (1 + t))),
}
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)
T_MIN, T_MAX = 1e-4, 1e2


def measure(quick):
    t = np.geomspace(T_MIN, T_MAX, 20_001)
    t[[0, -1]] = T_MIN, T_MAX
    rows = []
    for name, kernel in list(KERNELS.items())[:: 4 if quick else 1]:
        values = kernel(t)
        scale = np.maximum(values, 1e-3 * kernel.integral(t) / t)
        for tol in TOLERANCES:
            began = time.perf_counter()
            fit = hd.fit_exponentials(kernel, T_MIN, T_MAX, tol)
            seconds = time.perf_counter() - began
            error = (np.abs(fit(t) - values) / scale).max()
            power = hd.fit_exponentials(hd.PowerLaw(0.5), T_MIN, T_MAX, tol)
            rows.append(
                {
                    "kernel": name,
                    "tol": f"{tol:.0e}",
                    "error_over_tol": f"{error / tol:.4f}",
                    "modes": fit.n_modes,
                    "power_law_modes": power.n_modes,
                    "smallest_weight_positive": int(fit.weights.min() > 0),
                    "seconds": f"{seconds:.3f}",
                }
            )
    return rows


def claims(rows):
    for row in rows:
        kind = {"where": f"{row['kernel']}, {row['tol']:g}", "small": True}
        yield Claim("largest error over the tolerance", row["error_over_tol"], 1.02, **kind)
        yield Claim("weights positive", row["smallest_weight_positive"], at_least=1, **kind)
        yield Claim("modes at the most", row["modes"], 70, **kind)
        if row["kernel"] == "two rates":
            yield Claim("modes of two rates of a function", row["modes"], 4, **kind)
        if row["tol"] >= 1e-8:
            excess = row["modes"] / row["power_law_modes"]
            yield Claim("modes over the power law's, to 1e-8", excess, 2, **kind)


if __name__ == "__main__":
    study(measure, claims, curves("tol", "modes", ("kernel",)))
