"""Compilation, in advance, of the machine code for which first runs would wait."""

import multiprocessing
import os
import shutil
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import hereditary as hd

from .compiled.cache import note_target

# Number of components above `FEW` (compiled/jacobian.py), up to which a step is one dense system.
_COMPONENTS_ABOVE_FEW = 12


def precompile() -> int:
    """Compile the loops that take seconds into the cache on disk; return the number of runs."""
    # Not those that take at most a second each: SuperLU's solvers, direct sums on meshes and of
    # orders that vary, memory terms of other programs, the divergence of orbits.
    spawn, n_runs = multiprocessing.get_context("spawn"), 0
    with ProcessPoolExecutor(2, mp_context=spawn) as processes:
        # the second pair of lists finds the loops of the first one in the cache
        for pair in (_by_tolerance, _on_given_steps), (_stages, _analyses):
            n_runs += sum(processes.map(_run_all, pair))
    return n_runs


def precompile_into(folder: str) -> None:
    """Compile into a folder that becomes part of the package."""
    with tempfile.TemporaryDirectory() as cache:
        os.environ["NUMBA_CACHE_DIR"] = cache  # of the two processes
        precompile()
        for path in Path(cache).rglob("*.nb[ci]"):
            shutil.move(path, folder)
    note_target(folder)


def _run_all(listed: Callable[[], list[Callable[[], Any]]]) -> int:
    """Make the runs that a function lists; return how many there are."""
    runs = listed()
    for run in runs:
        found = run()
        if not np.all(getattr(found, "success", True)):
            raise RuntimeError(f"{run} has failed: {found}")
    return len(runs)


def _equation(order: Any, y0: Any = 1.0, **given: Any) -> hd.Equation:
    return hd.Equation(hd.Caputo(order), lambda t, y: -y, y0, **given)


def _few_and_many() -> tuple[hd.Equation, hd.Equation, hd.Equation]:
    """Return equations of one component, of many, and of many with a banded Jacobian."""
    wave = np.ones(_COMPONENTS_ABOVE_FEW)
    return _equation(0.5), _equation(0.5, wave), _equation(0.5, wave, bandwidth=(0, 0))


def _composed() -> tuple[hd.Equation, hd.Equation]:
    """Return equations with a given Jacobian: of few components and a delay, of many and a band."""
    late = hd.Equation(
        hd.Caputo(0.9), lambda t, y, memory: -memory[0], 1.0, memory=hd.Delay(0.5),
        jac=lambda t, y, memory: np.zeros((1, 1)),
        jac_memory=lambda t, y, memory: -np.ones((1, 1)),
    )  # fmt: skip
    diagonal = -np.ones((1, _COMPONENTS_ABOVE_FEW))
    return late, _equation(
        0.5, np.ones(_COMPONENTS_ABOVE_FEW), bandwidth=(0, 0), jac=lambda t, y: diagonal
    )


def _by_tolerance() -> list[Callable[[], Any]]:
    """List a run of the march of `rtol=`: it takes as long as all loops of given steps."""
    return [partial(hd.solve, _equation(0.5), 1.0, rtol=1e-4)]


def _stages() -> list[Callable[[], Any]]:
    """List short runs that call what else the march of `rtol=` calls."""
    wave, orders = np.ones(_COMPONENTS_ABOVE_FEW), np.linspace(0.5, 0.9, _COMPONENTS_ABOVE_FEW)
    one, *many = _few_and_many()
    late, given = _composed()
    swinging = hd.Memory(hd.Prony([1.0 - 3.0j, 1.0 + 3.0j], [0.5, 0.5]), 0)
    equations = [
        *many,
        late,
        given,
        _equation(orders, wave),
        _equation(orders, wave, bandwidth=(0, 0)),
        _equation(lambda t: 0.5 + 0.0 * t),
        _equation(0.5, jac=lambda t, y: -np.ones((1, 1))),
        hd.Equation(hd.Caputo(1.0) + swinging, lambda t, y: -y, 1.0),
    ]
    return [
        *(partial(hd.solve, equation, 1.0, rtol=1e-4) for equation in equations),
        partial(hd.solve, one, 1.0, rtol=1e-4, switches=[_beyond]),
        partial(hd.solve, late, 1.0, rtol=1e-4, events=[_late]),
    ]


def _beyond(t: float, y: np.ndarray) -> float:
    return y[0] - 2.0


def _late(t: float, y: np.ndarray, memory: np.ndarray) -> float:
    return memory[0, 0] - 2.0


def _on_given_steps() -> list[Callable[[], Any]]:
    """List short runs that call all loops of given steps."""
    (one, dense, band), varying = _few_and_many(), _equation(lambda t: 0.5 + 0.0 * t)
    linear = _equation(0.5, np.ones(_COMPONENTS_ABOVE_FEW), linear=-np.eye(_COMPONENTS_ABOVE_FEW))
    steps, explicit, implicit = {"n_steps": 40}, hd.ExplicitCaputo(), hd.L1()
    runs: list[tuple[hd.Equation, dict[str, Any]]] = [
        *((one, steps | {"scheme": scheme}) for scheme in (explicit, implicit, hd.Adams())),
        *((one, steps | {"history": history}) for history in (hd.Direct(), hd.FFT())),
        (one, {"mesh": hd.graded(40, 2.0), "scheme": implicit}),
        *((varying, steps | {"scheme": scheme}) for scheme in (explicit, implicit)),
        *((eq, steps | {"scheme": hd.BDF(2)}) for eq in (dense, band, *_composed())),
        (linear, steps | {"scheme": hd.IMEX(hd.BDF(2))}),
    ]
    return [
        partial(hd.solve, equation, 1.0, estimate=False, **arguments)
        for equation, arguments in runs
    ]


def _analyses() -> list[Callable[[], Any]]:
    """List ensembles and analyses that call all other compiled loops."""
    force = [hd.Caputo(2.0), hd.Caputo(1.0)], lambda t, y, p: -y + np.cos(p[0] * t), [0.0, 0.0]
    one, swing = _equation(0.5), hd.Equation(*force, params=[1.0])
    return [
        partial(hd.ensemble, one, 1.0, rtol=1e-4, y0=[1.0, 2.0]),
        partial(hd.ensemble, one, 1.0, 40, y0=[1.0, 2.0]),
        partial(hd.lyapunov, one, 1.0, rtol=1e-4),
        partial(hd.lyapunov, one, 1.0, 40),
        partial(hd.lyapunov, one, 1.0, 40, scheme=hd.BDF(2)),
        partial(hd.frequency_response, swing, [1.0]),
    ]
