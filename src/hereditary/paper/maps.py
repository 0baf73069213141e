"""Bifurcation diagrams and maps of dynamic regimes, which the paper announces as future work."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from .. import plots
from .job import Job, merged
from .regimes import Regime
from .runs import CLASSICAL, regime, section

# Length of a run of a bifurcation diagram [time]. Samples come from its second half: 143 at b = 3.
T_DIAGRAM = 600.0
# Most samples of one run of a bifurcation diagram.
N_SAMPLES = 150
# Number of steps of a run in diagrams over the orders. They are given, because collocation finds no
# steps for orders of inertia near 1.
STEPS_DIAGRAM = 120_000
# Length of a run in a map of regimes [time].
T_MAP = 400.0
# Number of steps of a run in a map of regimes.
STEPS_MAP = 20_000
_MEMORY = r"$\beta = 1.8$, $\gamma = 0.8$"


def bifurcation_b(job: Job) -> list[str]:
    """Draw samples over the spring speed, classical and with memory."""
    panels = {"classical, $c = 50$": CLASSICAL, f"{_MEMORY}, $c = 50$": {}}
    return _diagram(job, "bifurcation_b", "spring_speed", np.linspace(0.5, 3.0, 201), panels)


def bifurcation_c(job: Job) -> list[str]:
    """Draw samples over the adhesion, classical and with memory."""
    panels = {"classical, $b = 1$": CLASSICAL, f"{_MEMORY}, $b = 1$": {}}
    return _diagram(job, "bifurcation_c", "adhesion", np.linspace(1.0, 50.0, 197), panels)


def bifurcation_lambda(job: Job) -> list[str]:
    """Draw samples over the friction, classical and with memory."""
    fast = {"spring_speed": 2.5}
    panels = {
        "classical, $b = 2.5$, $c = 50$": CLASSICAL | fast,
        f"{_MEMORY}, $b = 2.5$, $c = 50$": fast,
    }
    return _diagram(job, "bifurcation_lambda", "friction", np.linspace(0.0, 1.0, 201), panels)


def bifurcation_beta(job: Job) -> list[str]:
    """Draw samples over the order of inertia: the paper's orbit and an irregular one."""
    panels = {
        r"$\gamma = 0.8$, $c = 50$": {},
        r"$\gamma = 1$, $c = 7$": {"gamma": 1.0, "adhesion": 7.0},
    }
    return _diagram(
        job, "bifurcation_beta", "beta", np.linspace(1.04, 2.0, 193), panels, STEPS_DIAGRAM
    )


def bifurcation_gamma(job: Job) -> list[str]:
    """Draw samples over the order of friction: the paper's orbit and an irregular one."""
    panels = {
        r"$\beta = 1.8$, $c = 50$": {},
        r"$\beta = 2$, $c = 7$": {"beta": 2.0, "adhesion": 7.0},
    }
    return _diagram(
        job, "bifurcation_gamma", "gamma", np.linspace(0.05, 1.0, 191), panels, STEPS_DIAGRAM
    )


def regimes_b_c(job: Job) -> list[str]:
    """Draw regimes over spring speed and adhesion, classical."""
    grid = {"adhesion": np.linspace(0.5, 50.0, 100), "spring_speed": np.linspace(0.03, 3.0, 100)}
    return _map(job, "regimes_b_c", grid, {r"classical, $\lambda = 0.25$": CLASSICAL})


def regimes_lambda_c(job: Job) -> list[str]:
    """Draw regimes over friction and adhesion, classical, at two spring speeds."""
    grid = {"adhesion": np.linspace(0.5, 50.0, 60), "friction": np.linspace(0.0, 1.0, 60)}
    panels = {
        "classical, $b = 1$": CLASSICAL,
        "classical, $b = 2.5$": CLASSICAL | {"spring_speed": 2.5},
    }
    return _map(job, "regimes_lambda_c", grid, panels)


def regimes_beta_gamma(job: Job) -> list[str]:
    """Draw regimes over both orders, for the paper's adhesion and an irregular one."""
    grid = {"gamma": np.linspace(0.05, 1.0, 60), "beta": np.linspace(1.05, 2.0, 60)}
    panels = {"$b = 1$, $c = 50$": {}, "$b = 1$, $c = 7$": {"adhesion": 7.0}}
    return _map(job, "regimes_beta_gamma", grid, panels)


def _diagram(
    job: Job, name: str, axis: str, values: np.ndarray, panels: Mapping[str, Mapping[str, Any]],
    n_steps: int | None = None,
) -> list[str]:  # fmt: skip
    """Draw positions in the well, sampled once a period, one panel above the other."""
    grid = {axis: job.few(values, 4)}
    t_end, count = job.size(T_DIAGRAM, 60.0), job.size(N_SAMPLES, 20)
    n_steps = n_steps and job.size(n_steps, 6000)
    figure, axes = plt.subplots(
        len(panels), 1, figsize=(8, 7), layout="constrained", sharex=True, squeeze=False
    )
    tables, lines = {}, []
    for k, ((title, fixed), ax) in enumerate(zip(panels.items(), axes[:, 0], strict=True)):
        table = job.sweep(section, grid, t_end=t_end, count=count, n_steps=n_steps, **fixed)
        tables[f"panel_{k + 1}"] = table
        plots.bifurcation(table, ax=ax, ylabel=r"$x \,\mathrm{mod}\, 2\pi$ [-]")
        ax.set(title=title, ylim=(0, 2 * np.pi))
        n_samples = int(np.isfinite(table["place"]).sum())
        lines.append(f"{title}: {table.status.size} points, {n_samples} samples")
    axes[0, 0].set(xlabel="")
    job.save_table(name, merged(tables))
    job.save_figure(name, figure)
    return lines


def _map(
    job: Job, name: str, grid: Mapping[str, np.ndarray], panels: Mapping[str, Mapping[str, Any]]
) -> list[str]:
    """Draw regimes over two parameters, in panels next to each other."""
    grid = {axis: job.few(values) for axis, values in grid.items()}
    t_end, n_steps = job.size(T_MAP, 40.0), job.size(STEPS_MAP, 4000)
    figure, axes = plt.subplots(
        1, len(panels), figsize=(1 + 6 * len(panels), 5.6), layout="constrained", squeeze=False
    )
    tables, lines = {}, []
    for k, ((title, fixed), ax) in enumerate(zip(panels.items(), axes[0], strict=True)):
        began = time.perf_counter()
        table = job.sweep(regime, grid, t_end=t_end, n_steps=n_steps, **fixed)
        seconds = time.perf_counter() - began
        tables[f"panel_{k + 1}"] = table
        plots.regime_map(table, ax=ax)
        rows_of_legend = -(-len(ax.get_legend().get_texts()) // 3)
        ax.set_title(f"{title}, T = {t_end:g}", pad=10 + 13 * rows_of_legend)
        sure = table["certainty"] > 0.9
        shares = ", ".join(
            f"{kind} {np.mean(table['regime'] == kind):.1%} "
            f"(sure {np.mean((table['regime'] == kind) & sure):.1%})"
            for kind in Regime
        )
        lines.append(f"{title}: {table.status.size} cells in {seconds:.0f} s; {shares}")
    job.save_table(name, merged(tables))
    job.save_figure(name, figure)
    return lines
