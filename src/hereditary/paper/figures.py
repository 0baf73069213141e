"""Figures 1 to 8 of the paper, with its own step and with converged steps.

Each function computes one figure, saves it with its table, and returns its results as lines of
text.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from .. import plots
from ..analysis.table import Table
from .job import Job, merged
from .runs import CLASSICAL, exponents, growth_exponent, orbit, signs

T_END = 100.0
# Number of steps of length tau = 0.005, with which the figures of the paper agree.
N_STEPS = 20_000
# Number of steps of a tenth of that length.
FINE_STEPS = 200_000
# Length of long runs [time].
LONG = 1000.0
# Relative tolerance of long runs.
LONG_RTOL = 1e-8
SPEEDS = np.linspace(0.5, 3.0, 51)
ADHESIONS = np.arange(1.0, 51.0)
FRICTIONS = np.linspace(0.0, 1.0, 21)
INERTIA_ORDERS = np.linspace(1.04, 1.8, 20)
FRICTION_ORDERS = np.append(np.linspace(0.21, 0.91, 8), 1.0)
HORIZONS = (100.0, 200.0, 400.0, 1600.0)


def figure_1(job: Job) -> list[str]:
    """Draw exponents over the spring speed b."""
    return _spectra(job, "figure_1", {"spring_speed": SPEEDS}, {"c = 50": {}})


def figure_3(job: Job) -> list[str]:
    """Draw exponents over the adhesion c."""
    return _spectra(job, "figure_3", {"adhesion": ADHESIONS}, {"b = 1": {}})


def figure_6(job: Job) -> list[str]:
    """Draw exponents over the friction lambda; signs of the paper are for b = 2.5."""
    speeds = {"b = 1": {}, "b = 2.5": {"spring_speed": 2.5}}
    return _spectra(job, "figure_6", {"friction": FRICTIONS}, speeds)


def figure_2(job: Job) -> list[str]:
    """Draw orbits at the spring speeds of the paper: 1, 2.5, and 0.25 (misprinted there)."""
    return _orbits(job, "figure_2", "spring_speed", "b", (0.25, 1.0, 2.5))


def figure_4(job: Job) -> list[str]:
    """Draw orbits at adhesions 10 and 7."""
    return _orbits(job, "figure_4", "adhesion", "c", (10.0, 7.0))


def figure_5(job: Job) -> list[str]:
    """Draw orbits at adhesions 50 and 70: the time in the first well."""
    return _orbits(job, "figure_5", "adhesion", "c", (50.0, 70.0))


def figure_7(job: Job) -> list[str]:
    """Draw orbits at frictions 0.1 and 0.5."""
    return _orbits(job, "figure_7", "friction", r"\lambda", (0.1, 0.5))


def figure_8(job: Job) -> list[str]:
    """Draw exponents over the orders, at the paper's 8,000 steps, at 200,000, and further on."""
    panels = {
        "beta": (INERTIA_ORDERS, {"gamma": 0.8}, r"$\gamma = 0.8$"),
        "gamma": (FRICTION_ORDERS, {"beta": 1.1}, r"$\beta = 1.1$"),
    }
    horizons = job.size(HORIZONS, (10.0, 20.0))
    h = T_END / job.size(FINE_STEPS, 5000)
    figure, axes = plt.subplots(2, 2, figsize=(10, 7), layout="constrained", sharex="col")
    lines = []
    for (name, (values, fixed, title)), (above, below) in zip(panels.items(), axes.T, strict=True):
        grid = {name: job.few(values)}
        coarse_steps = round(8000 * horizons[0] / T_END)
        coarse = job.sweep(growth_exponent, grid, t_end=horizons[0], n_steps=coarse_steps, **fixed)
        fine = job.sweep(exponents, grid, horizons=horizons, h=h, **fixed)
        table = merged({"coarse": coarse, "fine": fine})
        for k, t_end in enumerate(horizons):
            one = _column(table, "fine_exponent", k)
            plots.lyapunov_spectrum(one, ax=above, name=f"T = {t_end:g}")
            scaled = Table(one.axes, {"exponent": t_end * one["exponent"]}, one.status)
            plots.lyapunov_spectrum(scaled, ax=below)
            largest = float(np.max(one["exponent"]))
            spread = scaled["exponent"]
            lines.append(
                f"over {name}, T = {t_end:g}: {signs(zip(*_pair(one, 'exponent'), strict=True))}; "
                f"largest {largest:.4f}, T Lambda {spread.min():.1f} .. {spread.max():.1f}"
            )
        coarse_name = f"T = {horizons[0]:g}, N = {coarse_steps:,}"
        plots.lyapunov_spectrum(coarse, ax=above, name=coarse_name)
        above.lines[-1].set(ls="", marker="x", color="0.5")
        apart = np.abs(coarse["exponent"] - table["fine_exponent"][:, 0])
        lines.append(f"over {name}: 8,000 steps differ by {np.nanmax(apart):.4f} at most")
        verdicts, counts = np.unique(table["fine_verdict"][:, -1], return_counts=True)
        summary = ", ".join(f"{v} {n}" for v, n in zip(verdicts, counts, strict=True))
        lines.append(f"over {name}, late slopes at T = {horizons[-1]:g}: {summary}")
        above.set(title=title, xlabel="")
        below.set(ylabel=r"$T\,\Lambda$ [-]")
        above.get_legend().remove()
        job.save_table(f"figure_8_{name}", table)
    # both panels show the same series
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=len(names))
    job.save_figure("figure_8", figure)
    return lines


def _pair(table: Table, value: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the only axis of a table, and one of its values."""
    (x,) = table.axes.values()
    return x, table[value]


def _column(table: Table, value: str, k: int) -> Table:
    """Return the k-th entry of a value that is an array, under the name "exponent"."""
    return Table(table.axes, {"exponent": table[value][:, k]}, table.status)


def _spectra(
    job: Job, name: str, grid: Mapping[str, np.ndarray], panels: Mapping[str, Mapping[str, Any]]
) -> list[str]:
    """Draw spectra over one parameter: at T = 100 above, late slopes of long runs below."""
    grid = {axis: job.few(values) for axis, values in grid.items()}
    t_end, long = job.size(T_END, 10.0), job.size(LONG, 20.0)
    runs = {
        "paper": {"t_end": t_end, "n_steps": job.size(N_STEPS, 2000)},
        "fine": {"t_end": t_end, "n_steps": job.size(FINE_STEPS, 4000)},
        "converged": {"t_end": t_end, "rtol": 1e-9},
        "long": {"t_end": long, "rtol": LONG_RTOL},
    }
    names = (r"$\tau = 0.005$", r"$\tau = 0.0005$", "collocation")
    figure, axes = plt.subplots(
        2, len(panels), figsize=(4 + 3.5 * len(panels), 6.5), layout="constrained",
        squeeze=False, sharex=True, sharey="row",
    )  # fmt: skip
    lines = []
    for (title, fixed), (above, below) in zip(panels.items(), axes.T, strict=True):
        tables = {
            run: job.sweep(growth_exponent, grid, **settings, **CLASSICAL, **fixed)
            for run, settings in runs.items()
        }
        table = merged(tables)
        for run, label in zip(runs, names, strict=False):
            plots.lyapunov_spectrum(table, f"{run}_exponent", ax=above, name=label)
        plots.lyapunov_spectrum(
            table, "long_slope", "long_slope_stderr", below,
            name=f"late slope, {long / 2:g} to {long:g}",
        )  # fmt: skip
        plots.lyapunov_spectrum(table, "long_exponent", ax=below, name=f"mean, 0 to {long:g}")
        above.set(title=f"T = {t_end:g}, {title}", xlabel="")
        lines += _signs_of_runs(table, list(runs), title)
        suffix = "" if len(panels) == 1 else "_" + title.replace(" ", "").replace("=", "_")
        job.save_table(name + suffix, table)
    job.save_figure(name, figure)
    return lines


def _signs_of_runs(table: Table, parts: list[str], title: str) -> list[str]:
    """Return in words the signs of exponents in each run, and where growth is certain."""
    summary = [
        f"{title}, {part}: {signs(zip(*_pair(table, f'{part}_exponent'), strict=True))}"
        for part in parts
    ]
    x, verdicts = _pair(table, "long_verdict")
    growing = ", ".join(f"{v:g}" for v in x[verdicts == "exponential growth"].round(6))
    return [*summary, f"{title}, long, exponential growth: {growing or 'nowhere'}"]


def _orbits(
    job: Job, name: str, parameter: str, symbol: str, values: Sequence[float], **fixed: Any
) -> list[str]:
    """Draw oscillogram, velocity and phase portrait, a column for each value of a parameter."""
    times = np.linspace(0.0, T_END, job.size(N_STEPS, 5000) + 1)
    orbits, stays, coarse = [], [], []
    rows: Any  # of an orbit, then of the table
    for value in values:
        chosen = {parameter: value, **CLASSICAL, **fixed}
        *rows, intervals = orbit(times=times, **chosen)
        orbits.append(rows)
        stays.append(intervals)
        coarse.append(orbit(times=times, n_steps=N_STEPS, **chosen))
    figure, axes = plt.subplots(
        3, len(values), figsize=(1 + 3.6 * len(values), 7.5), layout="constrained",
        squeeze=False, height_ratios=(1, 1, 1.3),
    )  # fmt: skip
    lines = []
    for k, value in enumerate(values):
        _one_orbit(axes[:, k], times, orbits[k], coarse[k], f"${symbol} = {value:g}$")
        apart = np.abs(orbits[k][0] - coarse[k][0])
        ends = [s[0][1] for s in (stays[k], coarse[k][2])]
        lines.append(
            f"{parameter} {value:g}: first stay ends at {ends[0]:.4f} (tau = 0.005: {ends[1]:.4f});"
            f" stays {', '.join(f'{a:.2f} .. {b:.2f}' for a, b in stays[k])};"
            f" at tau = 0.005 places differ by {apart.max():.2g} at most,"
            f" {apart[-1]:.2g} at the end"
        )
    rows = {
        "place": [rows[0] for rows in orbits],
        "velocity": [rows[1] for rows in orbits],
        "paper_place": [rows[0] for rows in coarse],
        "paper_velocity": [rows[1] for rows in coarse],
    }
    arrays = {key: np.array(value) for key, value in rows.items()}
    shape = arrays["place"].shape
    first_stay = [[s[0][1]] * times.size for s in stays]
    arrays["first_stay"] = np.array(first_stay)
    axes_of = {parameter: np.array(values), "t": times}
    job.save_table(name, Table(axes_of, arrays, np.full(shape, "completed")))
    job.save_figure(name, figure)
    return lines


def _one_orbit(
    axes: np.ndarray,
    times: np.ndarray,
    rows: Sequence[np.ndarray],
    coarse: Sequence[Any],
    title: str,
) -> None:
    """Draw a column of a figure of orbits: collocation in front, the paper's step wide behind."""
    place, speed = rows
    for ax, values, behind in zip(axes[:2], rows, coarse[:2], strict=True):
        ax.plot(times, behind, lw=3.0, color="#F0B27A", label=r"$\tau = 0.005$")
        ax.plot(times, values, lw=0.7, color="#0072B2", label="collocation")
        ax.set(xlabel="$t$ [time]")
        ax.margins(x=0)
    axes[2].plot(place, speed, lw=0.5, color="#0072B2")
    axes[0].set(title=title, ylabel="$x$ [-]")
    axes[1].set(ylabel=r"$\dot x$ [1/time]")
    axes[2].set(xlabel="$x$ [-]", ylabel=r"$\dot x$ [1/time]")
    axes[0].legend(fontsize="x-small")
