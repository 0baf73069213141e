"""Computations at one point of a figure.

The functions are at the top of a module, so that processes can import them. `parameters` are those
of the stick-slip scene, with the defaults of the paper: b 1, c 50, lambda 0.25, omega 1, x(0) 0.2,
x'(0) 0.3. The classical examples of the paper are `CLASSICAL`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ..analysis.growth import assess
from ..analysis.lyapunov import lyapunov, memory
from ..analysis.sections import stroboscopic, values_at
from ..collocation.method import Collocation
from ..given.schemes.bdf import BDF
from ..given.schemes.explicit import ExplicitCaputo
from ..scenes import PRINTED_WELL, stick_slip, sticking_intervals
from ..solver.solve import solve
from .regimes import classify

CLASSICAL = {"beta": 2.0, "gamma": 1.0}
# Distance of the barriers.
WELL = 2 * math.pi
# Initial tangent of the spectra: along x(0) alone, as in algorithms that begin with unit vectors.
# At T = 100 another tangent changes some of the signs. Figures compare several steps and horizons,
# so no run is repeated for verification.
ALONE: dict[str, Any] = {"directions": [[1.0], [0.0]], "verify": False}
# Largest slope of the force at a barrier over the weight of the scheme. Below 1 an implicit step
# has one solution. With 0.9 Newton's method fails in a tenth of the runs with beta from 1.1 to 1.4.
_GENTLE = 0.5
# Most steps between two renormalisations in runs whose exponents are read at several horizons.
_INTERVAL = 200
# Fraction of a record, its end, from which slopes are computed; as in `lyapunov`.
_WINDOW = 0.5
# Number of blocks of that part, for the standard error.
_BLOCKS_PER_WINDOW = 20


def wells_period(spring_speed: float = 1.0, omega: float = 1.0, **others: Any) -> float:
    """Return the time in which the pull passes one well, for parameters of the scene [time]."""
    return WELL * omega**2 / spring_speed


def growth_exponent(
    *, t_end: float, n_steps: int | None = None, rtol: float | None = None, **parameters: Any
) -> dict[str, Any]:
    """Return the leading exponent over [0, t_end], by the paper's scheme or collocation."""
    scheme = ExplicitCaputo() if rtol is None else Collocation()
    n_steps = n_steps if rtol is None else None
    equation = stick_slip(**parameters)
    run = lyapunov(equation, t_end, n_steps, scheme=scheme, rtol=rtol, **ALONE)
    return {
        "exponent": float(run.exponents[0]),
        "slope": float(run.slope[0]),
        "slope_stderr": float(run.slope_stderr[0]),
        "verdict": str(run.verdict),
        "status": run.status,
    }


def exponents(*, horizons: Sequence[float], h: float, **parameters: Any) -> dict[str, Any]:
    """Return the leading exponent at several ascending horizons of one run."""
    steps = [round(t_end / h) for t_end in horizons]
    equation, renorm = stick_slip(**parameters), h * math.gcd(*steps, _INTERVAL)
    run = lyapunov(
        equation, horizons[-1], steps[-1], scheme=ExplicitCaputo(), renorm=renorm, **ALONE
    )
    slopes: dict[str, Any] = {"exponent": [], "slope": [], "slope_stderr": [], "verdict": []}
    remembered = memory(equation.system)
    for n in steps:
        reached = run.times <= h * (n + 0.5)
        late = assess(
            run.times[reached], run.log_growth[reached], _WINDOW, _BLOCKS_PER_WINDOW, remembered
        )
        rates = run.trace[reached, 0]
        slopes["exponent"].append(float(rates[-1]) if rates.size else math.nan)
        slopes["slope"].append(float(late.slope[0]))
        slopes["slope_stderr"].append(float(late.slope_stderr[0]))
        slopes["verdict"].append(str(late.verdicts[0]))
    return slopes | {"status": run.status}


def orbit(
    *, times: np.ndarray, n_steps: int | None = None, rtol: float = 1e-10, **parameters: Any
) -> tuple[np.ndarray, np.ndarray, list[tuple[float, float]]]:
    """Return position and velocity at given times, and the stays in the wells [(start, end)]."""
    # by collocation, or with `n_steps` of the scheme of the paper
    tolerance, scheme = (rtol, None) if n_steps is None else (None, ExplicitCaputo())
    solution = solve(
        stick_slip(**parameters), float(times[-1]), n_steps, scheme=scheme, rtol=tolerance,
        estimate=False,
    )  # fmt: skip
    places, speeds = (values_at(solution, times, derivative)[:, 0] for derivative in (0, 1))
    return places, speeds, sticking_intervals(solution)


def section(
    *, t_end: float, count: int, n_steps: int | None = None, **parameters: Any
) -> dict[str, Any]:
    """Return the last samples once a period of the wells: position in the well, and velocity."""
    # by collocation, or with given steps of a scheme of second order
    rtol, scheme = (1e-7, None) if n_steps is None else (None, BDF(2))
    solution = solve(stick_slip(**parameters), t_end, n_steps, scheme=scheme, rtol=rtol)
    samples = stroboscopic(solution, wells_period(**parameters), t_end / 2, count)
    speeds = values_at(solution, samples.t[np.isfinite(samples.t)], 1)[:, 0]
    return {
        "place": samples.within(WELL)[:, 0],
        "velocity": np.append(speeds, np.full(count - speeds.size, np.nan)),
        "status": solution.status,
    }


def regime(*, t_end: float, n_steps: int, **parameters: Any) -> dict[str, Any]:
    """Return the regime of an orbit, checked by a run with twice the step."""
    # of second order: with these steps the scheme of the paper changes some verdicts
    equation, scheme = stick_slip(**parameters), BDF(2)
    n_steps = _solvable(n_steps, t_end, **parameters)
    # rows at a quarter of the duration of a slip suffice
    solution, check = (
        solve(equation, t_end, n, scheme=scheme, save_every=every)
        for n, every in ((n_steps, 4), (n_steps // 2, 2))
    )
    growth = lyapunov(equation, t_end, n_steps, scheme=scheme, verify=False)
    verdict = classify(solution, growth, period=wells_period(**parameters), check=check)
    return {
        "regime": str(verdict.regime),
        "certainty": verdict.certainty,
        "irregular": verdict.irregular,
        "recurrence": verdict.recurrence,
        "cycle": verdict.cycle,
        "longest_stay": verdict.longest_stay,
        "exponent": float(growth.exponents[0]),
        "slope": float(growth.slope[0]),
        "slope_stderr": float(growth.slope_stderr[0]),
        "status": growth.status if solution.success else solution.status,
    }


def _solvable(
    n_steps: int, t_end: float, beta: float = 1.8, adhesion: float = 50.0, **others: Any
) -> int:
    """Return n_steps, doubled until twice the step also has one solution at a barrier."""
    # An implicit step has several solutions if the force rises faster than the weight of the
    # scheme, (3 / 2 / h)**beta. Orders of inertia near 1 need short steps.
    steepest = adhesion * sum(n * a for n, a in enumerate(PRINTED_WELL, 1))
    while (4 / 3 * t_end / n_steps) ** beta * steepest > _GENTLE:
        n_steps *= 2
    return n_steps


def signs(values: Iterable[tuple[float, float]]) -> str:
    """Return changes of sign in words: "+ up to 3, - up to 7, + up to 9"."""
    runs: list[list] = []
    for x, value in values:
        sign = "+" if value > 0 else "-" if value < 0 else "0" if value == 0 else "?"
        if runs and runs[-1][0] == sign:
            runs[-1][1] = x
        else:
            runs.append([sign, x])
    return ", ".join(f"{sign} up to {np.round(x, 6):g}" for sign, x in runs)
