"""Compilation ahead of all that a first run would otherwise wait for."""

import sys
from functools import partial
from typing import Any

import numpy as np

from .analysis.lyapunov import lyapunov
from .ensemble import ensemble
from .equation.equation import Equation
from .equation.operators import Caputo
from .history.direct import Direct
from .history.fft import FFT
from .large.imex import IMEX
from .schemes.adams import Adams
from .schemes.bdf import BDF
from .schemes.explicit import ExplicitCaputo
from .schemes.l1 import L1
from .schemes.steps import graded
from .solver.progress import ProgressBar
from .solver.solve import solve

# Components, more than those of which a step is one dense system (structure.FEW).
_MANY = 12


def _decay(t, y):
    return -y


def _half(t):
    return 0.5 + 0.0 * t


def _runs():
    """List short runs that need all compiled loops, one after the other."""
    one = Equation(Caputo(0.5), _decay, 1.0)
    varying = Equation(Caputo(_half), _decay, 1.0)
    wave = np.ones(_MANY)
    dense = Equation(Caputo(0.5), _decay, wave)
    band = Equation(Caputo(0.5), _decay, wave, bandwidth=(0, 0))
    mixed = [
        Equation(Caputo(np.linspace(0.5, 0.9, _MANY)), _decay, wave, bandwidth=width)
        for width in (None, (0, 0))
    ]
    linear = Equation(Caputo(0.5), _decay, wave, linear=-np.eye(_MANY))
    steps = {"n_steps": 40}
    runs: list[tuple[Equation, dict[str, Any]]] = [
        *((one, steps | {"scheme": scheme}) for scheme in (ExplicitCaputo(), L1(), Adams())),
        *((one, steps | {"history": history}) for history in (Direct(), FFT())),
        (one, {"mesh": graded(40, 2.0), "scheme": L1()}),
        *((varying, steps | {"scheme": scheme}) for scheme in (ExplicitCaputo(), L1())),
        *((eq, steps | {"scheme": BDF(2)}) for eq in (dense, band)),
        (linear, steps | {"scheme": IMEX(BDF(2))}),
        *((eq, {"rtol": 1e-4}) for eq in (one, dense, band, *mixed)),
    ]
    return [
        *(partial(solve, equation, 1.0, **how) for equation, how in runs),
        partial(ensemble, one, 1.0, 40, y0=[1.0, 2.0]),
        partial(lyapunov, one, 1.0, 40),
    ]


def compile_ahead():
    """Compile all that takes seconds into the cache on disk; return the exit status of a command.

    SuperLU's solvers, direct sums on meshes and of orders that vary, memory terms that others step
    and the divergence of orbits are left: a second each at most.
    """
    runs, bar = _runs(), ProgressBar(True)
    for number, run in enumerate(runs):
        found = run()
        if not np.all(found.success):
            print(f"hereditary: {found}", file=sys.stderr)
            return 1
        bar.update((number + 1) / len(runs))
    bar.close()
    print(f"compiled: {len(runs)} runs are ready")
    return 0
