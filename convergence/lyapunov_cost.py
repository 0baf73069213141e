"""A tangent costs little more than the orbit: one at most 4, two at most 6 times a plain run.

The hereditary stick-slip oscillator (beta 1.8, gamma 0.8, b 1, c 50, T 100) with modes; the claim
is about the explicit scheme at N = 200,000, where `lyapunov` with its default settings is compared
to `solve` keeping every 1000th row. Shorter runs and implicit schemes (L1, BDF(2)) are measured
beside it. Seconds are whole calls, the best of several, taken in turns.
"""

import time

import matplotlib.pyplot as plt
import numpy as np
from _study import Study, check

import hereditary as hd

T_END = 100.0
N_MAIN, N_SHORT = 200_000, 20_000
SCHEMES = [hd.ExplicitCaputo(), hd.L1(), hd.BDF(2)]
MAIN = (repr(SCHEMES[0]), N_MAIN)
BOUNDS = {1: 4.0, 2: 6.0}
LABELS = {0: "plain run", 1: "one tangent", 2: "two tangents"}


def seconds(equation, n, k, scheme):
    """Of one whole call; k = 0 is a plain run."""
    began = time.perf_counter()
    if k == 0:
        result = hd.solve(equation, T_END, n, scheme=scheme, save_every=1000)
    else:
        result = hd.lyapunov(equation, T_END, n, k, scheme=scheme, progress=False)
    spent = time.perf_counter() - began
    if not result.success:
        raise RuntimeError(f"{scheme} with {n} steps: {result.message}")
    return spent


def measure(quick):
    """Rows for every scheme, number of steps and number of tangents."""
    equation = hd.scenes.stick_slip()
    rows = []
    for scheme in SCHEMES:
        for k in LABELS:  # compiled before it is timed
            seconds(equation, 8000, k, scheme)
        for n in (8000, N_SHORT) if quick else (N_SHORT, N_MAIN):
            repeats = 3 if quick else 20 if n == N_MAIN else 40
            runs = [[seconds(equation, n, k, scheme) for k in LABELS] for _ in range(repeats)]
            best = np.min(runs, axis=0)
            for k in LABELS:
                rows.append(
                    {
                        "scheme": repr(scheme),
                        "n_steps": n,
                        "tangents": k,
                        "seconds": f"{best[k]:.4g}",
                        "ns_per_step": f"{best[k] / n * 1e9:.0f}",
                        "ratio": f"{best[k] / best[0]:.2f}",
                        "bound": BOUNDS.get(k, "") if (repr(scheme), n) == MAIN else "",
                    }
                )
    return rows


def draw(rows):
    figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
    cases = list(dict.fromkeys((row["scheme"], row["n_steps"]) for row in rows))
    x = np.arange(len(cases))
    for k, label in LABELS.items():
        heights = [row["ns_per_step"] for row in rows if row["tangents"] == k]
        bars = ax.bar(x + 0.27 * (k - 1), heights, 0.25, label=label)
        ratios = [f"{row['ratio']:.1f}" for row in rows if row["tangents"] == k]
        if k:
            ax.bar_label(bars, ratios, fontsize=8)
    ax.set_xticks(x, [f"{scheme}\nN = {n:,.0f}" for scheme, n in cases], fontsize=8)
    ax.set(ylabel="ns a step", title="Hereditary stick-slip, T = 100 (times a plain run)")
    ax.margins(y=0.1)
    ax.grid(alpha=0.3, axis="y")
    ax.legend()
    return figure


def main():
    study = Study(__file__, __doc__)
    study.write(measure(study.quick))
    rows = study.read()
    for k, bound in BOUNDS.items():
        ratios = [row["ratio"] for row in rows if row["tangents"] == k and row["scheme"] == MAIN[0]]
        statement = f"{LABELS[k]}: {ratios[-1]:.2f} times a plain run (at most {bound:g})"
        check(statement, ratios[-1] <= bound, study.quick)
    study.save(draw(rows))


if __name__ == "__main__":
    main()
