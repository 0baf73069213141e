"""Every memory kernel becomes a sum of positive exponentials, down to 1e-10 over six decades.

Tempered, Mittag-Leffler, stretched and distributed-order kernels, and two given as functions, on
[1e-4, 1e2] in units of their own time: the largest error on 20,001 log-spaced points relative to
the kernel, at least to a thousandth of its mean from 0 to t, the modes beside those of the power
law ``t**-0.5``, and the set-up time.
"""

import time

import matplotlib.pyplot as plt
import numpy as np
from _study import Study, check

import hereditary as hd
from hereditary.memory_kernels import (
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


def draw(rows):
    figure, ax = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for i, name in enumerate(dict.fromkeys(row["kernel"] for row in rows)):
        mine = [row for row in rows if row["kernel"] == name]
        style = "k--" if name.startswith("power") else "os^vD<>PdX*"[i % 11] + "-"
        ax.loglog([r["tol"] for r in mine], [r["modes"] for r in mine], style, label=name)
    ax.set(
        xlabel="tolerance",
        ylabel="modes",
        title="Modes for six decades of time, $10^{-4}$ to $10^{2}$",
    )
    ax.invert_xaxis()
    ax.set_yticks([10, 20, 30, 50, 70, 100, 200, 300], labels=[10, 20, 30, 50, 70, 100, 200, 300])
    ax.minorticks_off()
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def main():
    study = Study(__file__, __doc__)
    study.write(measure(study.quick))
    rows = study.read()
    worst = max(row["error_over_tol"] for row in rows)
    check(f"largest error {worst:.3f} tol (at most 1.02)", worst <= 1.02)
    check("all weights positive", all(row["smallest_weight_positive"] for row in rows))
    lone = max(row["modes"] for row in rows if row["kernel"] == "two rates")
    check(f"two rates of a function are {lone:.0f} modes at all tolerances (2 to 4)", lone <= 4)
    most = max(row["modes"] for row in rows)
    check(f"at most {most:.0f} modes (70)", most <= 70)
    smooth = [r for r in rows if r["tol"] >= 1e-8]
    excess = max(r["modes"] / r["power_law_modes"] for r in smooth)
    check(f"to 1e-8 at most {excess:.2f} times the power law's modes (2)", excess <= 2)
    study.save(draw(rows))


if __name__ == "__main__":
    main()
