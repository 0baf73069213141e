"""The figures of the README and of Getting started: ``python docs/pictures.py``.

figures/memory.svg has the equation of the README beside the same equation without memory.
figures/errors.svg has the Brusselator of order 0.8 from ``convergence/results/peers.csv``, written
by ``convergence/peers.py``. Both are as wide as half a page, or the screen of a telephone.
figures/start.svg has the oscillator of Getting started.
"""

import csv
import pathlib

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

DOCS = pathlib.Path(__file__).parent
GREY = "#808080"  # legible on white and on black
STYLE = {
    "axes.edgecolor": GREY,
    "axes.facecolor": "none",
    "axes.labelcolor": GREY,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "font.size": 13,
    "lines.linewidth": 1.8,
    "savefig.transparent": True,
    "svg.hashsalt": "front",
    "text.color": GREY,
    "xtick.color": GREY,
    "ytick.color": GREY,
}
CODES = {
    "Collocation": ("hereditary, rtol=", "#0072b2", "o"),
    "BDF(2)": ("hereditary, BDF(2)", "#009e73", "s"),
    "pycaputo PECE": ("pycaputo, PECE", "#d55e00", "^"),
}


def draw_memory(ax):
    """Draw the oscillator with memory and without."""
    times = np.linspace(0.0, 50.0, 600)
    for orders, label, color in (
        ((1.8, 0.8), "with memory, orders 1.8 and 0.8", "#0072b2"),
        ((2, 1), "without, orders 2 and 1", "#d55e00"),
    ):
        terms = hd.Caputo(orders[0]) + 0.25 * hd.Caputo(orders[1])
        eq = hd.Equation(terms, lambda t, x: np.sin(t) - x, y0=[0.2, 0.3])
        ax.plot(times, hd.solve(eq, 50.0, rtol=1e-8)(times)[:, 0], color=color, label=label)
    ax.set(xlabel="t", ylabel="x(t)", ylim=(-4.5, 6.5))
    ax.legend(frameon=False, loc="upper left")


def draw_errors(ax):
    """Draw error against time of three codes."""
    lines = (DOCS.parent / "convergence" / "results" / "peers.csv").read_text().splitlines()
    rows = [row for row in csv.DictReader(lines[1:]) if row["problem"] == "P4"]
    for code, (label, color, marker) in CODES.items():
        points = [(float(row["ms"]), float(row["error"])) for row in rows if row["code"] == code]
        ax.loglog(*zip(*points, strict=True), color=color, marker=marker, label=label)
    ax.set(xlabel="time of a call [ms]", ylabel="error at t = 100")
    ax.legend(frameon=False, loc="lower right")


def draw_start(left, right):
    """Draw the oscillator of Getting started over time and in its phase plane."""
    eq = hd.Equation(hd.Caputo(1.8) + 0.25 * hd.Caputo(0.8), lambda t, x: -x, y0=[1.0, 0.0])
    sol = hd.solve(eq, 20.0, rtol=1e-6)
    hd.plots.oscillogram(sol, left, color="#0072b2", lw=1.8)
    hd.plots.phase_portrait(sol, right, color="#0072b2", lw=1.8)


def main():
    """Write the figures."""
    with plt.rc_context(STYLE):
        for name, draw in (("memory", draw_memory), ("errors", draw_errors)):
            with plt.rc_context({"font.size": 9, "lines.linewidth": 1.2, "lines.markersize": 4}):
                figure, ax = plt.subplots(figsize=(3.7, 3.1), layout="constrained")
                draw(ax)
                figure.savefig(DOCS / "figures" / f"{name}.svg", metadata={"Date": None})
        figure, axes = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
        draw_start(*axes)
        figure.savefig(DOCS / "figures" / "start.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
