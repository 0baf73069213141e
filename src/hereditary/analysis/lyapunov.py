"""Lyapunov exponents over any stepper, with all of the memory kept (floor 5)."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import rgamma

from .._checks import complaint, count, instance, positive, real_array, shown, within
from ..equation import Equation
from ..history.exponentials import SumOfExponentials
from ..history.history import History
from ..schemes.collocation import Collocation
from ..schemes.explicit import ExplicitCaputo
from ..schemes.scheme import Scheme
from ..solver.adaptive import modes_tolerance, tolerances
from ..solver.drive import Drive, reached_end, told
from ..solver.marked_stepper import MarkedState, MarkedStepper
from ..solver.progress import Interruption, ProgressBar
from ..solver.solution import Status
from ..solver.stepper import Stepper
from ..solver.uniform import uniform_steps
from ..system import first_order
from .divergence import Divergence
from .estimators import Pairs, Restarted, Tangents
from .growth import Verdict, assess, kaplan_yorke
from .spectrum import LyapunovResult, LyapunovState, Record

_MODES = ("tangent", "pair", "restart")


def lyapunov(
    equation: Equation,
    t_end: float,
    n_steps: int | None = None,
    k: int = 1,
    mode: str = "tangent",
    scheme: Scheme | None = None,
    history: History | None = None,
    renorm: float | None = None,
    transient: float = 0.0,
    *,
    directions: ArrayLike | None = None,
    seed: int = 0,
    window: float = 0.5,
    n_blocks: int = 20,
    separation: float = 1e-7,
    rtol: float | None = None,
    atol: float | None = None,
    verify: bool = False,
    progress: bool = False,
    resume: LyapunovState | None = None,
) -> LyapunovResult:
    """The k largest finite-time Lyapunov exponents of an equation with memory.

    Tangents Phi(t), the derivatives of the solution with respect to its initial data, are carried
    alongside the orbit; now and then ``Phi = Q R`` and everything that is linear in them, the whole
    memory included, is multiplied by the inverse of R. The sums of ``log R_ii`` are then those of
    Phi(t) itself, whatever the interval.

    Parameters
    ----------
    equation : Equation
    t_end : float
        End of the run, above 0 [time].
    n_steps : int
        Number of steps; not needed when resuming. With `Collocation`, which chooses its own steps,
        the number of times at which tangents may be made orthonormal, 65536 by default.
    k : int
        How many exponents, 1 <= k <= number of initial data (d, and one more for each component of
        order above 1).
    mode : {"tangent", "pair", "restart"}
        "pair" takes orbits side by side whose whole histories are drawn back together, for
        right-hand sides without a derivative; where they jump, with a `separation` of 1e-3 to
        1e-2, so that orbits meet the jump in different steps. "restart" cuts the memory of orbit
        and tangents off at every renormalisation; it is for comparison with published tables alone
        and does not give exponents of this equation.
    scheme, history : Scheme, History, optional
        As for `solve`.
    renorm : float, optional
        Interval between two renormalisations [time], rounded to whole steps; by default it follows
        the growth. Needed for "restart", whose numbers depend on it.
    transient : float, optional
        Growth before this time is not counted [time].
    directions : array_like, shape (n_data, k), optional
        Initial directions: rows for y(0), then for y'(0) of each component of order above 1. Random
        and orthonormal by default, from `seed`; the same for every k.
    seed : int, optional
    window : float, optional
        Share of the record, its end, that slopes and verdicts come from, 0 < window <= 1 [-].
    n_blocks : int, optional
        Blocks behind the standard error.
    separation : float, optional
        Distance of the orbits in mode "pair", in units of y: rounding grows like its inverse, what
        is not linear like itself.
    rtol, atol : float, optional
        Tolerances of the orbit with `Collocation`, as for `solve`; mode "tangent" alone.
    verify : bool, optional
        Repeat the run at half the step, with `Collocation` at a tenth of the tolerance, and say
        whether the verdicts stand. They may stand on an error that both runs make: take steps small
        enough, or a scheme of higher order, too.
    progress, resume : optional
        As for `solve`; `resume` takes ``LyapunovResult.state``.

    Returns
    -------
    LyapunovResult
        Also when the run blows up, is interrupted, or the right-hand side raises, with the record
        so far.

    Error
    -----
    That of the scheme: the tangents are the exact derivative of its steps, so the exponents
    converge with its order. A first-order explicit scheme adds about h omega**2 / 2 to the rate of
    an oscillation and an implicit one takes as much away, enough to make or hide chaos.

    Cost
    ----
    For k tangents one Jacobian a step and k more columns of memory, and 0.1 ms a renormalisation:
    some three times a plain run of 200,000 steps (convergence/lyapunov_cost.py).

    Source
    ------
    [BenettinEtAl1980] for the method; docs/lyapunov.md for memory.

    Examples
    --------
    >>> import hereditary as hd
    >>> res = hd.lyapunov(hd.scenes.stick_slip(), 100.0, n_steps=8_000)
    >>> res.exponents.round(3).tolist()
    [-0.078]
    """
    began = time.perf_counter()
    instance("equation", equation, Equation, "hereditary.Equation(terms, rhs, y0)")
    t_end = positive("t_end", t_end)
    scheme = ExplicitCaputo() if scheme is None else scheme
    instance("scheme", scheme, Scheme, "hereditary.ExplicitCaputo()")
    if not isinstance(scheme, Collocation):
        history = SumOfExponentials() if history is None else history
        instance("history", history, History, "hereditary.SumOfExponentials()")
    if resume is not None:
        instance("resume", resume, LyapunovState, "the .state of an earlier LyapunovResult")
    window = within("window", window, 1e-6, 1.0, "(0, 1]")
    n_blocks = count("n_blocks", n_blocks)
    tols = _tolerances(scheme, mode, rtol, atol)
    n_steps = _MARKS if tols and n_steps is None and resume is None else n_steps
    h, n_total, prepared = uniform_steps(t_end, n_steps, resume and resume.steppers[0])
    settings = _settings(mode, k, h, n_total, renorm, transient, seed, separation, equation)
    system = _marched(equation, scheme, mode)
    start = _directions(directions, seed, settings["k"], _n_data(equation))
    open_stepper: Callable = partial(Stepper, scheme=scheme, history=history, h=h, n_steps=prepared)
    if tols:
        n_marks = max(prepared, n_total)
        given = {"scheme": scheme, "tols": tols, "h": h, "n_marks": n_marks}
        open_stepper = partial(MarkedStepper, **given, modes_tol=modes_tolerance(history))
    estimator = _estimator(settings, open_stepper, system, start)
    record, divergence = _begin(estimator, settings, h, n_total, system, resume)
    ended = _run(estimator, record, divergence, n_total, progress)
    seconds = time.perf_counter() - began
    settings |= {"scheme": scheme, "history": history, "t_end": t_end, "window": window}
    settings |= {"rtol": tols[0], "atol": tols[1]} if tols else {}
    result = _result(estimator, record, divergence, ended, settings, n_blocks, seconds, equation.d)
    if not verify or result.status not in (Status.COMPLETED, Status.STEP_TOO_LARGE, Status.ZIGZAG):
        return result
    finer = {"rtol": tols[0] / 10, "atol": tols[1] / 10} if tols else {"n_steps": 2 * n_total}
    check = lyapunov(
        equation, t_end, **finer, k=k, mode=mode, scheme=scheme, history=history, renorm=renorm,
        transient=transient, directions=directions, seed=seed, window=window, n_blocks=n_blocks,
        separation=separation, progress=progress,
    )  # fmt: skip
    return replace(result, verified=check.verdicts == result.verdicts, check=check)


def _settings(mode, k, h, n_total, renorm, transient, seed, separation, equation):
    """The arguments that a record depends on, checked."""
    if mode not in _MODES:
        required = f"be one of {', '.join(map(repr, _MODES))}"
        raise ValueError(complaint("mode", required, repr(mode)))
    n_data = _n_data(equation)
    if count("k", k) > n_data:
        required = f"be at most the number of initial data, {n_data}"
        raise ValueError(complaint("k", required, k))
    if renorm is not None:
        renorm = h * max(1, round(positive("renorm", renorm) / h))
    elif mode == "restart":
        remedy = "the numbers depend on it"
        raise TypeError(complaint("renorm", 'be given with mode="restart"', "none", remedy))
    transient = within("transient", transient, 0.0, h * (n_total - 1), "[0, t_end)")
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise TypeError(complaint("seed", "be a whole number of at least 0", repr(seed)))
    return {
        "mode": mode,
        "k": int(k),
        "h": h,
        "renorm": renorm,
        "transient": h * round(transient / h),
        "seed": int(seed),
        "separation": positive("separation", separation),
    }


def _marched(equation, scheme, mode):
    """The system to march: classical ones of second order as first-order ones.

    Increments kept apart from t x'(0), as most schemes keep them above order 1, lose a tangent that
    has decayed to their rounding. With memory none decays so far.
    """
    whole = isinstance(scheme, (ExplicitCaputo, Collocation)) or mode == "restart"
    if whole or equation.m == 1 or _memory(equation) != "none":
        return equation
    return first_order(equation)


def _n_data(equation):
    return equation.d + int(np.sum(equation.highest_orders() > 1))


def _directions(given, seed, k, n_data):
    """Orthonormal initial directions, shape (n_data, k)."""
    if given is None:
        given = np.random.default_rng(seed).normal(size=(n_data, n_data))[:, :k]
    else:
        given = real_array("directions", given)
        if given.shape != (n_data, k):
            required = f"have shape ({n_data}, {k}): one column for each exponent"
            raise ValueError(complaint("directions", required, f"shape {given.shape}"))
    q, r = np.linalg.qr(given)
    if np.abs(np.diag(r)).min() < 1e-12 * np.abs(r).max():
        required = "be linearly independent columns"
        raise ValueError(complaint("directions", required, shown(given)))
    return q * np.sign(np.diag(r))


def _tolerances(scheme, mode, rtol, atol):
    """Tolerances of an adaptive run, None for given steps."""
    if isinstance(scheme, Collocation):
        if mode != "tangent":
            required = 'be "tangent" with Collocation'
            remedy = "take a scheme of given steps, e.g. Adams() or BDF(2)"
            raise ValueError(complaint("mode", required, repr(mode), remedy))
        return tolerances(rtol, atol)
    for name, value in (("rtol", rtol), ("atol", atol)):
        if value is not None:
            required = "be left out or come with scheme=Collocation()"
            raise ValueError(complaint(name, required, value))
    return None


def _estimator(settings, open_stepper, system, start):
    if settings["mode"] == "pair":
        return Pairs(open_stepper, system, start, settings["separation"])
    kind = Tangents if settings["mode"] == "tangent" else Restarted
    return kind(open_stepper, system, start)


def _begin(estimator, settings, h, n_total, equation, resume):
    """Record and divergence, anew or as the state left them."""
    n_data, k = _n_data(equation), settings["k"]
    whole = settings["mode"] == "tangent" and _memory(equation) == "none" and k == n_data
    divergence = Divergence(equation, h) if whole else None
    if resume is None:
        interval = None if settings["renorm"] is None else round(settings["renorm"] / h)
        n_transient = round(settings["transient"] / h)
        return Record(h, interval, n_total, n_transient, k), divergence
    if isinstance(resume.steppers[0], MarkedState) != isinstance(estimator.stepper, MarkedStepper):
        required = "come from a run with the same kind of scheme"
        remedy = "given steps and Collocation do not go on from each other"
        raise ValueError(complaint("resume", required, type(resume.steppers[0]).__name__, remedy))
    for name, value in resume.settings.items():
        if settings[name] != value:
            required = f"come from a run with the same {name}, here {settings[name]}"
            remedy = "start anew, or change it back"
            raise ValueError(complaint("resume", required, value, remedy))
    estimator.restore(resume.steppers)
    if divergence is not None:
        divergence.restore(resume.divergence)
    return resume.record.copy(), divergence


def _run(estimator, record, divergence, n_total, progress):
    """March from one renormalisation to the next; return the status and a detail for it."""

    def advance(n_more):
        if divergence is None:
            estimator.advance(n_more)
            return
        n, rows = estimator.n, np.empty((n_more, estimator.stepper.equation.d))
        estimator.advance(n_more, rows)
        divergence.add(n, rows[: estimator.n - n])

    bar = ProgressBar(progress)
    try:
        with Interruption() as interruption:
            estimator.prepare(n_total)
            whole = isinstance(estimator.stepper, MarkedStepper)
            drive = Drive(estimator, n_total, advance, interruption, bar, whole)
            while estimator.n < n_total:
                stop = record.next_stop(n_total)
                ended = drive.to(stop)
                if ended is not None:
                    return ended
                logs = estimator.renormalise()
                if logs is None:
                    return Status.BLOWN_UP, "tangents overflowed or vanished; shorten renorm"
                record.add(stop, logs)
    finally:
        bar.close()
    return reached_end(estimator.stepper), ""


def _memory(equation):
    """Whether "all", "none" or "some" components have a term of fractional order."""
    fractional = (equation.coefficients != 0) & (equation.orders % 1 != 0)
    found = fractional.any(axis=0)
    for _, coefficients in equation.memories:
        found = found | (coefficients != 0)
    return "all" if found.all() else "some" if found.any() else "none"


def _result(estimator, record, divergence, ended, settings, n_blocks, seconds, d):
    status, detail = ended
    equation, mode = estimator.stepper.equation, settings["mode"]
    times, sums, trace = record.times, record.log_growth, record.trace
    memory = "none" if mode == "restart" else _memory(equation)
    growth = assess(times, sums, settings["window"], n_blocks, memory)
    verdicts = growth.verdicts
    if status is Status.BLOWN_UP:
        verdicts = (Verdict.DIVERGED,) * len(verdicts)
    exponents = trace[-1] if times.size else np.full(len(verdicts), np.nan)
    defect = dimension = None
    if divergence is not None and times.size:
        integral = divergence.integral(record.n_last)
        defect = float(np.sum(record.total) - integral) / (record.n_last * settings["h"])
        dimension = kaplan_yorke(exponents)
    resumable = {name: settings[name] for name in _RESUMED}
    state = None
    if mode != "restart":
        left = divergence.state() if divergence else ()
        t, n = estimator.stepper.t, estimator.n
        state = LyapunovState(t, n, resumable, estimator.state(), record.copy(), left)
    return LyapunovResult(
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
        restart_factor=_restart_factor(equation, settings) if mode == "restart" else None,
        mode=mode,
        status=status,
        message=told(estimator.stepper, status, detail) + _lost_digits(record),
        y=estimator.stepper.y[:d],
        settings=settings,
        stats={
            "n_steps": estimator.n,
            "n_rhs": estimator.n_rhs,
            "n_modes": estimator.stepper.n_modes,
            "run_seconds": seconds,
        },
        state=state,
    )


def _lost_digits(record):
    """A clause where tangents drew so far apart that R holds few digits; empty otherwise."""
    if record.widest < _WIDE:
        return ""
    clause = (
        f"; between two renormalisations tangents drew apart by exp({record.widest:.0f}), which "
        "rounding hides: take a shorter renorm"
    )
    warnings.warn(clause[2:], RuntimeWarning, stacklevel=4)
    return clause


# Tangents further apart than exp(this) leave the smaller one fewer than six digits.
_WIDE = 22.0
# Marks of an adaptive run.
_MARKS = 1 << 16
_RESUMED = ("mode", "k", "renorm", "transient", "seed", "separation")


def _restart_factor(equation, settings):
    alpha = equation.highest_orders()
    return settings["renorm"] ** (alpha - 1) * rgamma(1 + alpha)
