"""One Lyapunov run, from its arguments to its result."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..collocation.adaptive_stepper import Tolerance
from ..compiled.callbacks import pass_on
from ..equation.equation import Equation
from ..history.history import History
from ..schemes.scheme import Scheme
from ..schemes.steps import UniformSteps, steps_in
from ..solver.opening import how_to_step, open_stepper
from ..solver.progress import Interruption, ProgressBar
from ..solver.run import Drive, reached_end, told
from ..solver.solution import Status
from ..support.checks import complaint, count, instance, positive, real_array, shown, whole, within
from ..support.warning import warn
from .divergence import Divergence
from .estimators import Pairs, StepTangents, Tangents
from .growth import Verdict, assess, kaplan_yorke
from .marched import marched, memory, n_data
from .spectrum import LyapunovResult, Record

_MODES = ("tangent", "pair")
# Tangents further apart than exp(this) leave the smaller one fewer than six digits.
_WIDE = 22.0
# More blocks than a window holds records are equal parts of them.
_MOST_BLOCKS = 10_000
# Times of an adaptive run at which it may be renormalised, and steps of it: no limit, in practice.
_MARKS, _ANY = 1 << 16, 10**9


@dataclass(frozen=True)
class Request:
    """The arguments of `lyapunov`, and whether the run may warn."""

    equation: Equation
    t_end: float
    n_steps: int | None
    k: int
    mode: str
    scheme: Scheme
    history: History | None
    renorm: float | None
    transient: float
    directions: Any
    seed: int
    window: float
    n_blocks: int
    separation: float
    rtol: float | None
    atol: float | None
    progress: bool
    loud: bool = True


class Run(NamedTuple):
    """A run that has ended, and how."""

    estimator: Tangents
    record: Record
    divergence: Divergence | None
    status: Status
    detail: str
    settings: dict[str, Any]
    seconds: float


def march(request: Request) -> Run:
    """Check the arguments and march to the end or as far as it goes."""
    began = time.perf_counter()
    equation, t_end = request.equation, positive("t_end", request.t_end)
    if equation.frame.start != 0:
        required = "be 0 for exponents"
        remedy = "shift the time in rhs"
        raise ValueError(complaint("t_start", required, equation.frame.start, remedy))
    scheme, history = request.scheme, request.history
    instance("scheme", scheme, Scheme, "hereditary.ExplicitCaputo()")
    if history is not None:
        instance("history", history, History, "hereditary.SumOfExponentials()")
    within("window", request.window, 1e-6, 1.0, "(0, 1]")
    if count("n_blocks", request.n_blocks) > _MOST_BLOCKS:
        raise ValueError(complaint("n_blocks", f"be at most {_MOST_BLOCKS}", request.n_blocks))
    system = marched(equation, scheme)
    how, marks = _how_to_step(request, system, t_end)
    settings = _settings(request, marks.h, marks.n)
    start = _directions(request.directions, settings["seed"], settings["k"], n_data(equation))

    def opened(system, directions=None):
        run = system, scheme, history, how, t_end
        return open_stepper(*run, directions=directions)[0]

    estimator = _estimator(settings, how, opened, system, start)
    record, divergence = _begin(settings, marks, system)
    status, detail = _run(estimator, record, divergence, marks.n, request.progress)
    settings |= {
        "scheme": scheme,
        "history": getattr(estimator.stepper, "history", history),
        "t_end": t_end,
        "window": request.window,
    }
    settings |= {"rtol": how.rtol, "atol": how.atol} if isinstance(how, Tolerance) else {}
    seconds = time.perf_counter() - began
    return Run(estimator, record, divergence, status, detail, settings, seconds)


def _settings(request, h, n_total):
    """The arguments that a record depends on, checked."""
    mode, k, renorm, seed = request.mode, request.k, request.renorm, request.seed
    if mode not in _MODES:
        required = f"be one of {', '.join(map(repr, _MODES))}"
        remedy = "convergence/restarting.py cuts the memory" if mode == "restart" else ""
        raise ValueError(complaint("mode", required, repr(mode), remedy))
    most = n_data(request.equation)
    if count("k", k) > most:
        required = f"be at most the number of initial data, {most}"
        raise ValueError(complaint("k", required, k))
    if renorm is not None:
        renorm = h * max(1, steps_in("renorm", positive("renorm", renorm), h))
    transient = within("transient", request.transient, 0.0, h * (n_total - 1), "[0, t_end)")
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise TypeError(complaint("seed", "be a whole number of at least 0", repr(seed)))
    return {
        "mode": mode,
        "k": int(k),
        "h": h,
        "renorm": renorm,
        "transient": h * round(transient / h),
        "seed": int(seed),
        "separation": _separation(request.separation, request.equation),
    }


def _separation(value, equation):
    """A distance at which orbits can still be neighbours."""
    largest = max(1.0, float(np.abs(equation.y0[0]).max()))
    remedy = "1e-7 is for smooth right-hand sides, 1e-3 to 1e-2 for those that jump"
    required = f"be at most {largest:g}, that orbits be neighbours"
    if positive("separation", value) > largest:
        raise ValueError(complaint("separation", required, value, remedy))
    return float(value)


def _directions(given, seed, k, rows):
    """Orthonormal initial directions, shape (rows, k)."""
    if given is None:
        given = np.random.default_rng(seed).normal(size=(rows, rows))[:, :k]
    else:
        given = real_array("directions", given)
        if given.shape != (rows, k):
            required = f"have shape ({rows}, {k}): one column for each exponent"
            raise ValueError(complaint("directions", required, f"shape {given.shape}"))
        given = given / (np.abs(given).max() or 1.0)  # squares of any numbers stay finite
    q, r = np.linalg.qr(given)
    if not np.abs(np.diag(r)).min() > 1e-12 * np.abs(r).max():  # zeros are refused as well
        required = "be linearly independent columns"
        raise ValueError(complaint("directions", required, shown(given)))
    return q * np.sign(np.diag(r))


def _how_to_step(request, system, t_end):
    """Return how the run steps, and the `UniformSteps` at which tangents may be measured."""
    mode, n_steps, tolerated = request.mode, request.n_steps, {"rtol": request.rtol}
    tolerated["atol"] = request.atol
    if not request.scheme.adaptive:
        steps = how_to_step(system, request.scheme, t_end, n_steps=n_steps, **tolerated)
        return steps, steps
    if mode != "tangent":
        required = 'be "tangent" with Collocation'
        remedy = "take a scheme of given steps, e.g. Adams() or BDF(2)"
        raise ValueError(complaint("mode", required, repr(mode), remedy))
    tolerated |= {"history": request.history, "max_steps": _ANY}
    n = _MARKS if n_steps is None else count("n_steps", whole(n_steps))
    return how_to_step(system, request.scheme, t_end, **tolerated), UniformSteps(t_end / n, n)


def _estimator(settings, how, opened, system, start):
    if settings["mode"] == "pair":
        return Pairs(opened, system, start, settings["separation"])
    kind = Tangents if isinstance(how, Tolerance) else StepTangents
    return kind(opened, system, start)


def _begin(settings, marks, equation):
    """Return an empty record, and the divergence of a classical flow or None."""
    k, h, n_total = settings["k"], marks.h, marks.n
    plain = memory(equation) == "none" and equation.enlarged is equation
    whole = settings["mode"] == "tangent" and plain and k == n_data(equation)
    divergence = Divergence(equation, h) if whole else None
    interval = None if settings["renorm"] is None else round(settings["renorm"] / h)
    return Record(h, interval, n_total, round(settings["transient"] / h), k), divergence


def _run(estimator, record, divergence, n_total, progress):
    """March to the end or as far as it goes; return the status and a detail for it."""
    stepper, keep = estimator.stepper, divergence is not None
    unit = record.h if stepper.adaptive else 1  # of positions

    def advance(stop):
        n = _marks(stepper.t, record.h)
        piece = estimator.advance(stop, keep)
        steps, logs = estimator.grown()
        if keep and piece is not None:
            size = _marks(stepper.t, record.h) - n
            known = int(steps[-1]) - n if steps.size else 0
            rows = _rows(piece, n, size, record.h, stepper.adaptive)
            divergence.add(n, rows[:known])
            if known:
                divergence.mark()
            divergence.add(n + known, rows[known:])
        record.add(steps, logs)

    estimator.follow(record.pace, n_total, unit)
    bar = ProgressBar(progress)
    try:
        with Interruption() as interruption:
            if not stepper.adaptive:
                estimator.prepare(n_total)
            drive = Drive(estimator, n_total * unit, advance, interruption, bar)
            ended = drive.to(n_total * unit)
    finally:
        bar.close()
    return ended or (reached_end(estimator.stepper), "")


def _rows(piece, n, size, h, adaptive):
    """Return the orbit at the `size` steps after step n, (size, d)."""
    if adaptive and size == 0:  # steps may be longer than the distance of these times
        return np.empty((0, 0))
    if adaptive:
        return piece.evaluate(h * np.arange(n + 1, n + size + 1), np.zeros(1, dtype=bool), 0)
    return piece.at_ends(None, slice(None), None)[0]


def _marks(t, h):
    """Number of whole steps h up to time t."""
    return int(t / h * (1 + 1e-12))


def result_of(request: Request, run: Run) -> LyapunovResult:
    """Put together the result of a run; warn of too large a step where the run may warn."""
    estimator, record, divergence, status, detail, settings, seconds = run
    times, sums, trace = record.times, record.log_growth, record.trace
    kind = memory(estimator.stepper.equation)
    growth = assess(times, sums, settings["window"], request.n_blocks, kind)
    verdicts = growth.verdicts
    if status is Status.BLOWN_UP:
        verdicts = (Verdict.DIVERGED,) * len(verdicts)
    exponents = trace[-1] if times.size else np.full(len(verdicts), np.nan)
    defect = dimension = None
    if divergence is not None and times.size:
        integral = divergence.integral(record.n_last)
        defect = float(np.sum(record.total) - integral) / (record.n_last * settings["h"])
        dimension = kaplan_yorke(exponents)
    message = status.sentence + (f": {detail}" if detail else "")
    if request.loud:
        message = told(estimator.stepper, status, detail) + _lost_digits(record)
    result = LyapunovResult(
        exponents=exponents,
        times=times,
        trace=trace,
        log_growth=sums,
        slope=growth.slope,
        slope_stderr=growth.slope_stderr,
        algebraic_slope=growth.algebraic_slope,
        verdict=verdicts[0],
        verdicts=verdicts,
        sum_rule_defect=defect,
        kaplan_yorke=dimension,
        mode=settings["mode"],
        status=status,
        message=message,
        y=request.equation.frame.values(estimator.stepper.y[: request.equation.d]),
        settings=settings,
        stats={
            "n_steps": _marks(estimator.stepper.t, record.h),
            "n_rhs": estimator.n_rhs,
            "n_modes": estimator.stepper.n_modes,
            "run_seconds": seconds,
        },
    )
    for stepper in estimator.steppers:
        pass_on(stepper.error, result)
    return result


def _lost_digits(record):
    """A clause where tangents drew so far apart that R holds few digits; empty otherwise."""
    if record.widest < _WIDE:
        return ""
    clause = (
        f"; between two renormalisations tangents drew apart by exp({record.widest:.0f}), which "
        "rounding hides: take a shorter renorm"
    )
    warn(clause[2:], RuntimeWarning)
    return clause
