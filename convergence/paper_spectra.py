"""The source's spectra take seconds: 122 classical points within 5 s, ten times the steps 30 s.

The 122 exponents of Figs 1, 3 and 6 (T = 100, k = 1). N is 20,000, the source's tau = 0.005, and
200,000. The 29 points of Fig. 8 (T = 100) at N = 200,000 within 15 s. A map of regimes of 100 x 100
cells over spring speed and adhesion, T = 400 and N = 20,000. A cell is an orbit, a second one with
twice the step, and an exponent. Processes on all cores, compiled before.
"""

import os
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
from _study import Claim, bars, study

import hereditary as hd
from hereditary.paper import figures
from hereditary.paper.maps import STEPS_MAP, T_MAP
from hereditary.paper.runs import CLASSICAL, growth_exponent, regime

CLASSICAL_AXES = {
    "spring_speed": figures.SPEEDS,
    "adhesion": figures.ADHESIONS,
    "friction": figures.FRICTIONS,
}
ORDER_AXES = {"beta": figures.INERTIA_ORDERS, "gamma": figures.FRICTION_ORDERS}
OTHER_ORDER = {"beta": {"gamma": 0.8}, "gamma": {"beta": 1.1}}
SPECTRA, FINE, ORDERS, MAP = "Figs 1, 3, 6", "Figs 1, 3, 6, fine", "Fig. 8", "map of regimes"
BOUNDS = {SPECTRA: 5.0, FINE: 30.0, ORDERS: 15.0}


def spectra(axes, n_steps, fixed, pool):
    """Seconds and number of points of sweeps over each of the axes."""
    began, n_points = time.perf_counter(), 0
    for name, values in axes.items():
        point = partial(growth_exponent, t_end=100.0, n_steps=n_steps, **fixed(name))
        table = hd.sweep(point, {name: values}, executor=pool)
        if not table.success.all():
            raise RuntimeError(f"{name}: {set(table.status.ravel())}")
        n_points += table.status.size
    return time.perf_counter() - began, n_points


def regimes(n, pool):
    """Seconds and number of cells of a map."""
    grid = {"adhesion": np.linspace(0.5, 50.0, n), "spring_speed": np.linspace(0.03, 3.0, n)}
    point = partial(regime, t_end=T_MAP, n_steps=STEPS_MAP, **CLASSICAL)
    began = time.perf_counter()
    table = hd.sweep(point, grid, executor=pool)
    return time.perf_counter() - began, table.status.size


def measure(quick):
    """Rows of what was computed and how long it took."""
    rows = []

    def add(what, n_steps, found):
        seconds, points = found
        rows.append(
            {
                "what": what,
                "points": points,
                "n_steps": n_steps,
                "seconds": f"{seconds:.3g}",
                "ms_per_point": f"{1e3 * seconds / points:.3g}",
                "bound": BOUNDS.get(what, ""),
                "processes": os.cpu_count(),
            }
        )

    def ends(axes):
        return {name: values[[0, -1]] for name, values in axes.items()} if quick else axes

    with ProcessPoolExecutor(os.cpu_count()) as pool:
        # every worker loads its compiled loops
        spectra({"adhesion": np.linspace(1.0, 50.0, 8)}, 2000, lambda name: CLASSICAL, pool)
        spectra({"adhesion": np.linspace(1.0, 50.0, 8)}, 2000, lambda name: {}, pool)
        regimes(3, pool)
        for what, n_steps in ((SPECTRA, figures.N_STEPS), (FINE, figures.FINE_STEPS)):
            runs = spectra(ends(CLASSICAL_AXES), n_steps, lambda name: CLASSICAL, pool)
            add(what, n_steps, runs)
        runs = spectra(ends(ORDER_AXES), figures.FINE_STEPS, OTHER_ORDER.get, pool)
        add(ORDERS, figures.FINE_STEPS, runs)
        add(MAP, STEPS_MAP, regimes(4 if quick else 100, pool))
    return rows


def claims(rows):
    for row in rows:
        bound = np.inf if row["bound"] == "" else row["bound"]
        yield Claim(f"{row['what']}, {row['points']:g} points [s]", row["seconds"], bound)


if __name__ == "__main__":
    study(measure, claims, bars("seconds", ("what", "points", "n_steps"), log="x"))
