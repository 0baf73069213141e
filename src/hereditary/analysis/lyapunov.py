"""Lyapunov exponents over any stepper; tangents keep their whole memory."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..collocation.method import Collocation
from ..collocation.reading import reduced
from ..compiled.callbacks import pass_on
from ..compiled.functions import set_force
from ..compiled.jacobian import LEAST
from ..compiled.jit import F8, MAT, VEC, Matrix, Vector, compiled_type, entry
from ..compiled.records import record
from ..compiled.reference import Reference
from ..compiled.schedule import SCHEDULE
from ..compiled.signatures import RIGHT_SIDE, RightSide
from ..equation.equation import Equation, current_equation
from ..equation.system import System
from ..given.history.exponentials import SumOfExponentials
from ..given.history.history import History
from ..given.pairs import Pairs
from ..given.schemes.adams import Adams
from ..given.schemes.bdf import BDF
from ..given.schemes.explicit import ExplicitCaputo
from ..given.schemes.l1 import L1
from ..given.steps import steps_in
from ..solver.elsewhere import lacking
from ..solver.opening import chooses_steps, how_to_step, open_stepper
from ..solver.progress import Interruption, ProgressBar
from ..solver.run import Drive, reached_end, report
from ..solver.solve import run_end
from ..stepping.dense import Piece
from ..stepping.scheme import Scheme
from ..stepping.status import Ending, Status
from ..stepping.stepper import TangentStepper
from ..stepping.times import checked_breaks
from ..stepping.tolerance import Tolerance
from ..support.checks import (
    count,
    instance,
    one_of,
    positive,
    real_array,
    refuse,
    shown,
    whole,
    within,
)
from ..support.warning import silence, warn
from .growth import LyapunovResult, Verdict, assess, kaplan_yorke

# Keywords of `solve` and of former versions, and what to write instead.
_INSTEAD = {
    "resume": "make one run to the last time: `trace` has the rates of every earlier one",
    "t_eval": "`trace` has the rates at `times`",
    "save_every": "`trace` has the rates at `times`",
}
_MODES = ("tangent", "pair")
# Most blocks behind the standard error.
_MOST_BLOCKS = 10_000
# Default number of equally spaced times at which a run to a tolerance may renormalise tangents.
_MARKS = 1 << 16
# `max_steps` of a run to a tolerance: in practice no limit.
_UNLIMITED_STEPS = 10**9
# Renormalisations of a run whose intervals follow the growth. More of them cost time, and half of
# them are in the late window.
_RECORDS = 128
# First interval between renormalisations where intervals follow the growth [steps].
_FIRST_INTERVAL = 32
# Largest difference of the logarithms of growth in one interval. Beyond it, the smaller tangent has
# fewer than six digits.
_WIDE = 22.0
_LOST = (
    "tangents overflowed or vanished, or orbits fell together; shorten renorm, "
    "or in mode 'pair' take a larger separation"
)
# Least separation with which neighbouring orbits meet a jump in different steps.
_MIN_SEPARATION_AT_JUMPS = 1e-3
# Number of states of the orbit between which jumps of the right-hand side are looked for. Ten times
# as many find more rare jumps and cost 30 ms.
_STATES = 33
# Jumps below this fraction of the largest |f| are not looked for. A tenth of it takes a third more
# time.
_SMALLEST = 1e-3
# Ratio of sizes of components at the start from which lengths of tangents are those over the sizes.
_FAR_APART = 1e6
# Halvings of a line between two states, after which a continuous f has no change left. With a tenth
# of them steep functions count as jumps; ten times as many change nothing.
_HALVINGS_BETWEEN_STATES = 50
_TANGENTS_MISS_JUMPS = (
    "the right-hand side jumps between states of the orbit, and tangents do not see jumps"
)
# Status of runs that reached their end.
_AT_END = Status.COMPLETED, Status.STEP_TOO_LARGE, Status.KERNEL_INACCURATE, Status.ZIGZAG
# Largest tolerance that the second run multiplies by ten; looser runs are repeated at a tenth.
_LOOSEST = 0.01
# Order of the equation at which the order of convergence of a scheme is compared.
_NEAR_1 = 0.95
# Largest order of convergence, at that order of the equation, of a scheme of first order.
_FIRST_ORDER = 1.25
# Lowest order of an equation for which `Adams` is the default: below it `Adams` is not of second
# order, or no stability limit is known.
_ADAMS_LOWEST = 0.5
# Highest order of an equation for which `Adams` is the default.
_ADAMS_HIGHEST = 1.0

# A time and the components (d,) there.
_Moment = tuple[float, np.ndarray]


class _Stepping(NamedTuple):
    """Arguments of `lyapunov` that differ between a run and its second run."""

    t_end: Any
    n_steps: Any
    scheme: Scheme
    rtol: Any = None
    atol: Any = None


@dataclass(frozen=True)
class LyapunovOptions:
    """Arguments of `lyapunov` that both of its runs share; what needs no equation is checked."""

    k: int
    mode: str
    history: History | None
    renorm: float | None
    transient: float
    directions: ArrayLike | None
    seed: int
    window: float
    n_blocks: int
    separation: float
    breaks: ArrayLike
    progress: bool

    def __post_init__(self) -> None:
        within("window", self.window, 1e-6, 1.0, "(0, 1]")
        if count("n_blocks", self.n_blocks) > _MOST_BLOCKS:
            refuse("n_blocks", f"be at most {_MOST_BLOCKS}", self.n_blocks)
        restarts = isinstance(self.mode, str) and self.mode == "restart"
        remedy = "convergence/restarting.py cuts the memory" if restarts else ""
        one_of("mode", self.mode, _MODES, f"be one of {', '.join(map(repr, _MODES))}", remedy)
        count("k", self.k)
        if self.renorm is not None:
            positive("renorm", self.renorm)
        seed = self.seed
        if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
            refuse("seed", "be a whole number of at least 0", repr(seed), kind=TypeError)


@lacking(**_INSTEAD)
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
    atol: float | ArrayLike | None = None,
    breaks: ArrayLike = (),
    verify: bool | None = None,
    progress: bool = False,
) -> LyapunovResult:
    """Compute the k largest finite-time Lyapunov exponents of an equation with memory.

    Tangents Phi(t), the derivatives of the solution by its initial data, are solved with the orbit.
    At intervals ``Phi = Q R``, and everything that is linear in the tangents is multiplied by the
    inverse of R, also the whole memory. The sums of ``log R_ii`` then equal those of Phi(t) itself,
    for any interval.

    Parameters
    ----------
    equation : Equation
    t_end : float
        End of the run, above the equation's t_start [time].
    n_steps : int, optional
        Number of steps; or `rtol`. With `Collocation`, which chooses its own steps, the number of
        times at which tangents may be made orthonormal, 65536 by default.
    k : int
        Number of exponents, 1 <= k <= number of initial data (d, and one more for each component of
        order above 1).
    mode : {"tangent", "pair"}
        "pair" solves neighbouring orbits, and rescales their whole histories at intervals. It is
        for right-hand sides without a derivative, and for delays. If right-hand sides jump, use a
        `separation` of 1e-3 to 1e-2, so that orbits meet the jump in different steps.
    scheme : Scheme, optional
        `Collocation` by default if `rtol` is given or `n_steps` is not. With `n_steps` alone the
        default is a scheme of second order if one covers the equation. This is `Adams` for
        classical equations, and for one term in each component with orders from 1/2 to 1. It is
        `BDF(2)` for other Caputo terms. For other kernels and for orders that vary the default is
        `ExplicitCaputo`, of first order.
    history : History, optional
        As for `solve`.
    renorm : float, optional
        Interval between two renormalisations [time], rounded to whole steps; by default it follows
        the growth.
    transient : float, optional
        Growth in this time after t_start is not counted [time].
    directions : array_like, shape (n_data, k), optional
        Initial directions: rows for y(0), then for y'(0) of each component of order above 1. Random
        and orthonormal by default, from `seed`; the same for every k. With `rtol`, lengths are over
        the sizes of components at the start if these are more than 1e6 apart.
    seed : int, optional
    window : float, optional
        Share of the record, its end, that slopes and verdicts come from, 0 < window <= 1 [-].
    n_blocks : int, optional
        Blocks behind the standard error.
    separation : float, optional
        Distance of the orbits in mode "pair", in units of y, at most 1 or the largest initial
        value. Rounding errors grow like 1 / separation, and errors of
        the linearisation like separation.
    rtol, atol : float, optional
        Tolerances of the orbit with `Collocation`, as for `solve`; mode "tangent" alone.
    breaks : array_like, shape (k,), optional
        Times at which the right-hand side jumps, as for `solve`. With given steps the second run
        then has half the step, because twice the step may miss them.
    verify : bool, optional
        By default the run is repeated at twice the step, with `Collocation` at ten times the
        tolerance, and verdicts that change are "undetermined". Schemes of first order often have
        the same error at twice the step. They are compared with the default one, or the explicit
        one with `L1` and the other way round. True: at half the step (a tenth of the tolerance) and
        with the same scheme. False: no second run.
    progress : optional
        As for `solve`.

    Returns
    -------
    LyapunovResult
        Also when the run blows up, is interrupted, or the right-hand side raises, with the record
        so far.

    Warns
    -----
    RuntimeWarning
        The right-hand side jumps between states of the orbit: all verdicts are "undetermined". Or
        tangents lost digits between two renormalisations.

    Error
    -----
    Exponents converge with the order of the scheme, because tangents are the exact derivative of
    its steps. A first-order explicit scheme adds about h omega**2 / 2 to the rate of an
    oscillation, and an implicit one subtracts as much. This can create or hide chaos.

    Cost
    ----
    For k tangents, a Jacobian in each step and k more columns of memory, and 1 to 5 us for a
    renormalisation. The second run costs half as much again; more than twice as much with
    `ExplicitCaputo`, whose second run has half the step (convergence/lyapunov_cost.py).

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
    equation = current_equation(equation)
    choices = None, False, True
    verify = one_of("verify", verify, choices, "be True, False or None", kind=TypeError)
    if scheme is None:
        adaptive = rtol is not None or n_steps is None  # as `solve` chooses
        scheme = Collocation() if adaptive else _second_order(equation) or ExplicitCaputo()
    options = LyapunovOptions(
        k=k, mode=mode, history=history, renorm=renorm, transient=transient, directions=directions,
        seed=seed, window=window, n_blocks=n_blocks, separation=separation, breaks=breaks,
        progress=progress,
    )  # fmt: skip
    result = _run(equation, _Stepping(t_end, n_steps, scheme, rtol, atol), options)
    if result.status not in _AT_END or verify is False:
        return result
    unknown = set(result.verdicts) == {Verdict.UNDETERMINED}
    if unknown and (verify is None or _TANGENTS_MISS_JUMPS in result.message):
        return result
    other, difference = _another(equation, scheme, result, bool(verify), np.size(breaks) > 0)
    try:
        with silence():
            check, reason = _run(equation, other, options), ""
    except ValueError as error:  # a step that its scheme does not take
        check, reason = None, f"there is no run to compare with: {error}"
    return _compared(result, check, difference, reason)


def _another(
    equation: Equation, scheme: Scheme, result: LyapunovResult, finer: bool, broken: bool
) -> tuple[_Stepping, str]:
    """Return the `_Stepping` of the run with which verdicts are compared, and how it differs."""
    # given steps of a run with breaks (`broken`) are halved, because the breaks are times of steps
    n, found = result.stats["n_steps"], result.settings
    if chooses_steps(scheme):
        finer = finer or found["rtol"] > _LOOSEST
        factor = 0.1 if finer else 10.0
        atol = None if found["atol"] is None else factor * np.asarray(found["atol"])
        difference = "a tenth of the tolerance" if finer else "ten times the tolerance"
        return _Stepping(found["t_end"], n, scheme, factor * found["rtol"], atol), difference
    halved = finer or broken
    n, h = (2 * n, found["h"] / 2) if halved else (n // 2, 2 * found["h"])
    other = scheme if finer else _checking_scheme(scheme, equation)
    difference = "half the step" if halved else "twice the step"
    difference += "" if other == scheme else f" and {other!r}"
    return _Stepping(equation.t_start + n * h, n, other), difference


def _compared(
    result: LyapunovResult, check: LyapunovResult | None, difference: str, reason: str
) -> LyapunovResult:
    """Return the result with its second run, or with the `reason` why there is none."""
    # verdicts that differ become "undetermined"
    verdicts = (Verdict.UNDETERMINED,) * len(result.verdicts)
    if check and check.status not in _AT_END:
        reason = f"it ended otherwise: {check.message}"
    elif check:
        pairs = list(zip(result.verdicts, check.verdicts, strict=True))
        verdicts = tuple(one if one == other else Verdict.UNDETERMINED for one, other in pairs)
        if verdicts == result.verdicts:
            return replace(result, verified=True, check=check)
        number = next(i for i, (one, _) in enumerate(pairs) if one != verdicts[i])
        one, other = map(str, pairs[number])
        reason = f"verdict {number + 1} is {other!r} instead of {one!r}: take smaller steps"
    message = f"{result.message}; with {difference} {reason}"
    result = replace(result, verdicts=verdicts, verdict=verdicts[0], message=message)
    return replace(result, verified=False, check=check)


def _run(equation: Equation, stepping: _Stepping, options: LyapunovOptions) -> LyapunovResult:
    """Return the result of one run."""
    began, start, scheme = time.perf_counter(), equation.t_start, stepping.scheme
    t_last, mode, k = run_end("t_end", stepping.t_end, start), options.mode, options.k
    t_end = t_last - start
    instance("scheme", scheme, Scheme, "hereditary.ExplicitCaputo()")
    adaptive, history = chooses_steps(scheme), options.history
    if adaptive and mode != "tangent":
        remedy = "take a scheme of given steps, e.g. Adams() or BDF(2)"
        refuse("mode", 'be "tangent" with Collocation', repr(mode), remedy)
    if equation.system.algebraic.any():
        required = "have a derivative of every component for exponents"
        refuse("equation", required, repr(equation), "solve rows without one in rhs")
    if equation.system.delays and mode == "tangent":
        remedy = "take mode='pair' with a scheme of given steps, e.g. Adams()"
        refuse("mode", 'be "pair" with delays, which tangents do not see', repr(mode), remedy)
    system, most = marched(equation.system, scheme), n_data(equation.system)
    if history is None and not adaptive:
        history = SumOfExponentials()
    given = {"max_steps": _UNLIMITED_STEPS} if adaptive else {"n_steps": stepping.n_steps}
    steps = how_to_step(
        system, scheme, t_end, history=history, rtol=stepping.rtol, atol=stepping.atol, **given
    )
    marks = adaptive and stepping.n_steps is None
    n = _MARKS if marks else count("n_steps", whole(stepping.n_steps))
    h = t_end / n
    if k > most:
        refuse("k", f"be at most the number of initial data, {most}", k)
    interval = options.renorm and max(1, steps_in("renorm", options.renorm, h))
    inside = "[0, t_end)" if start == 0 else "[0, t_end - t_start)"
    transient = round(within("transient", options.transient, 0.0, h * (n - 1), inside) / h)
    separation = _separation(options.separation, equation)
    norm = _norm(system, t_end) if adaptive else 1.0
    directions = _directions(options.directions, int(options.seed), k, most, norm)

    opened = partial(open_stepper, scheme=scheme, history=history, policy=steps, t_end=t_end)
    if mode == "pair":
        stepper = Pairs(lambda system: opened(system)[0], system, directions, separation)
    else:
        stepper, _ = opened(system, directions=directions)
        stepper.norm = norm
    stepper.set_breaks(checked_breaks(options.breaks, start), t_end)
    plain = memory(system) == "none" and not equation.system.reads
    flow = Divergence(system, h) if mode == "tangent" and plain and k == most else None
    unit = stepper.stop_at(h).position
    schedule = record(SCHEDULE, transient=transient, end=n, longest=max(1, n // _RECORDS))
    schedule["unit"] = unit
    schedule["automatic"] = interval is None
    schedule["interval"] = interval or min(_FIRST_INTERVAL, schedule["longest"])
    states: list[_Moment] = []
    ended, grown = _grow(stepper, schedule, h, flow, states, options.progress)
    settings = {
        "mode": mode, "k": int(k), "h": h, "renorm": interval and h * interval,
        "transient": h * transient, "seed": int(options.seed), "separation": separation,
        "scheme": scheme, "history": history, "t_end": t_last, "window": options.window,
    }  # fmt: skip
    if isinstance(steps, Tolerance):
        settings |= {"rtol": steps.rtol, "atol": steps.atol}
    seconds = time.perf_counter() - began
    found = _found(stepper, equation, flow, ended, grown, settings, options.n_blocks, seconds)
    if found.status in _AT_END and (mode == "tangent" or separation < _MIN_SEPARATION_AT_JUMPS):
        found = _without_jumps(found, stepper.system, states)
    pass_on(ended and ended.error, found)
    return found


def _found(
    stepper: TangentStepper, equation: Equation, flow: Divergence | None, ended: Ending | None,
    grown: np.ndarray, settings: dict[str, Any], n_blocks: int, seconds: float,
) -> LyapunovResult:  # fmt: skip
    """Return the result of a run that has ended, from its renormalisations (n, 1 + k)."""
    ended = ended or Ending(reached_end(stepper.diagnostics))
    h, transient = settings["h"], settings["transient"]
    times, totals = h * grown[:, 0], np.cumsum(grown[:, 1:], axis=0)
    n_early = np.count_nonzero(grown[:, 0] <= round(transient / h))
    sums = totals[n_early:] - (totals[n_early - 1] if n_early else 0.0)
    late = times[n_early:]
    trace = sums / (late - transient)[:, None]
    growth = assess(late, sums, settings["window"], n_blocks, memory(stepper.system))
    if ended.status is Status.BLOWN_UP:
        growth = replace(growth, verdicts=(Verdict.DIVERGED,) * settings["k"])
    exponents = trace[-1] if late.size else np.full(settings["k"], np.nan)
    defect = dimension = None
    if flow is not None and late.size:
        integral = flow.up_to(int(grown[-1, 0]))
        defect, dimension = float(totals[-1].sum() - integral) / times[-1], kaplan_yorke(exponents)
    return LyapunovResult(
        exponents=exponents,
        times=late + equation.t_start,
        trace=trace,
        log_growth=sums,
        **vars(growth),
        verdict=growth.verdicts[0],
        sum_rule_defect=defect,
        kaplan_yorke=dimension,
        mode=settings["mode"],
        status=ended.status,
        message=report(stepper, ended, stepper.diagnostics) + _lost_digits(grown[:, 1:]),
        y=equation.system.frame.values(stepper.y[: equation.d]),
        settings=settings,
        stats={
            "n_steps": _marks(stepper.t, h),
            **{name: stepper.stats().get(name, 0) for name in ("n_rhs", "n_modes")},
            "run_seconds": seconds,
        },
    )


def _without_jumps(result: LyapunovResult, system: System, states: list[_Moment]) -> LyapunovResult:
    """Return the result; without verdicts, and with a warning, if f jumps along the orbit."""
    # jumps of an f that reads memory are not detected
    if system.reads or system.delays or not _jumps(system, states):
        return result
    clause = f"{_TANGENTS_MISS_JUMPS}: smooth it, for example sign(x) as tanh(x / eps), and let "
    clause += "eps decrease, or take mode='pair' with a separation of 1e-3 to 1e-2"
    warn(clause, RuntimeWarning)
    unknown = (Verdict.UNDETERMINED,) * len(result.verdicts)
    result = replace(result, verdicts=unknown, verdict=unknown[0], verified=False)
    return replace(result, message=f"{result.message}; {clause}")


def _jumps(system: System, states: list[_Moment]) -> bool:
    """Return whether f jumps on a line between two consecutive states (t, y) of the orbit."""
    chosen = np.unique(np.linspace(0, len(states) - 1, _STATES).astype(int))
    times, rows = zip(*(states[i] for i in chosen), strict=True)
    with suppress(Exception):  # f may have no value between states
        return bool(_jumps_between(system.compiled, np.array(times), np.array(rows)))
    return False


@entry(RIGHT_SIDE, VEC, MAT)
def _jumps_between(right: Any, times: np.ndarray, states: np.ndarray) -> bool:
    """Return whether f jumps on a line between two consecutive states (n, d)."""
    # the half of the line on which f changes more is halved again: that of a continuous f vanishes
    (n, d), force = states.shape, right.force
    f, least = np.empty((n, d)), np.full(d, LEAST)
    for i in range(n):
        set_force(force, times[i], states[i], f[i])
    for c in range(d):
        least[c] += _SMALLEST * np.abs(f[:, c]).max()
    for i in range(n - 1):
        a, b, f_a, f_b = states[i], states[i + 1], f[i], np.empty(d)
        set_force(force, times[i], b, f_b)  # at the same time
        left, change = _HALVINGS_BETWEEN_STATES, (np.abs(f_b - f_a) / least).max()
        while left > 0 and change > 1.0:
            left -= 1
            middle, f_of_middle = (a + b) / 2, np.empty(d)
            set_force(force, times[i], middle, f_of_middle)
            before = (np.abs(f_of_middle - f_a) / least).max()
            change = (np.abs(f_b - f_of_middle) / least).max()
            if before > change:
                b, f_b, change = middle, f_of_middle, before
            else:
                a, f_a = middle, f_of_middle
        if change > 1.0:
            return True
    return False


def _grow(
    stepper: TangentStepper, schedule: Any, h: float, flow: Divergence | None,
    states: list[_Moment], progress: bool,
) -> tuple[Ending | None, np.ndarray]:  # fmt: skip
    """March to the end, renormalise tangents meanwhile, and append some (t, y) to `states`."""
    # returns the `Ending` of a march that ended early, or None; the mark of each renormalisation,
    # and the logarithms of the growth since the one before, (n, 1 + k)
    grown = [np.empty((0, 1 + stepper.tangent.shape[1]))]
    end = int(schedule["end"]) * float(schedule["unit"])
    states.append((stepper.t, stepper.y))

    def advance(stop: float) -> Ending | None:
        piece, logs, lost = stepper.grow(stop, schedule)
        few = len(states) <= _STATES
        if piece is not None and (few or piece.edges().size > _STATES):
            times, every = piece.edges(), 1 + piece.edges().size // _STATES
            times = times[every::every]
            states.extend(zip(times.tolist(), piece.evaluate(times, 0), strict=True))
        states.append((stepper.t, stepper.y))
        grown.append(logs)
        if flow is not None and piece is not None:
            flow.add(piece, _marks(stepper.t, h), int(schedule["last"]))
        return Ending(Status.BLOWN_UP, _LOST) if lost else None

    bar = ProgressBar(progress)
    try:
        with Interruption() as interruption:
            ended = Drive(stepper, end, advance, interruption, bar).to(end)
    finally:
        bar.close()
    return ended, np.vstack(grown)


def _lost_digits(logs: np.ndarray) -> str:
    """Return a clause if the sizes of tangents differ so much that R loses digits, or ""."""
    widest = np.ptp(logs, axis=1).max(initial=0.0)
    if widest < _WIDE:
        return ""
    clause = (
        f"; between two renormalisations tangents drew apart by exp({widest:.0f}), which "
        "rounding hides: take a shorter renorm"
    )
    warn(clause[2:], RuntimeWarning)
    return clause


def _marks(t: float, h: float) -> int:
    """Return the number of whole steps h up to time t."""
    return int(t / h * (1 + 1e-12))


class Divergence:
    """Integral of the divergence of the first-order system behind an equation of integer orders."""

    def __init__(self, system: System, h: float) -> None:
        # A component c_1 x' = f adds d f_j / d x_j / c_1, one of c_2 x'' + c_1 x' = f adds -c_1 /
        # c_2, because f does not depend on velocities. h is the distance of marks [time].
        self._system, self._h, above_one = system.dense(), h, system.above_one
        first, leading = system.coefficient(1.0), system.coefficient(2.0)
        self._shares = np.where(above_one, 0.0, 1 / np.where(above_one, 1.0, first))
        self._constant = -float(np.sum(first[above_one] / leading[above_one]))
        self._integral, self._last = 0.0, 0
        self._ahead = self._traces(0, system.y0[:1].copy())

    def add(self, piece: Piece, n: int, n_last: int) -> None:
        """Add the orbit up to mark n; the growth of tangents is known up to mark n_last."""
        first = self._last + self._ahead.size
        if first > n:
            return
        rows = piece.evaluate(self._h * np.arange(first, n + 1), 0)
        self._ahead = np.append(self._ahead, self._traces(first, rows))
        self.up_to(n_last)

    def up_to(self, n_last: int) -> float:
        """Return the integral from 0 to a mark by the trapezoidal rule; drop the values used."""
        known = n_last - self._last
        self._integral += self._h * float(np.trapezoid(self._ahead[: known + 1]))
        self._ahead, self._last = self._ahead[known:], n_last
        return self._integral

    def _traces(self, n: int, rows: np.ndarray) -> np.ndarray:
        """Return the divergence at rows (k, d) of the orbit, the first one at mark n."""
        found, system = np.full(len(rows), self._constant), self._system
        rows = np.ascontiguousarray(rows)
        workspace = np.empty((system.d, system.d))
        traces = _Traces(system.compiled, self._h, self._shares, system.units(), workspace)
        _add_traces(traces, n * self._h, rows, found)
        return found


class _Traces(NamedTuple):
    """Weighted traces of the Jacobian at times h apart."""

    right: RightSide
    h: float
    shares: Annotated[Vector, "d"]  # weights of the diagonal
    units: Annotated[Vector, "d"]  # sizes of y, for differences
    jacobian: Annotated[Matrix, "d d"]  # workspace


@entry(Reference(compiled_type(_Traces)), F8, MAT, VEC)
def _add_traces(m: Any, t: float, rows: np.ndarray, found: np.ndarray) -> None:
    """Add ``sum_j shares_j d f_j / d x_j`` of rows (k, d), the first one at time t, to found."""
    right, shares, j_f = m.right, m.shares, m.jacobian
    for k in range(rows.shape[0]):
        right.jacobian(right.force, t + k * m.h, rows[k], m.units, j_f)
        for j in range(rows.shape[1]):
            found[k] += shares[j] * j_f[j, j]


def _separation(value: Any, equation: Equation) -> float:
    """Return a separation, checked to leave orbits neighbours."""
    largest = max(1.0, float(np.abs(equation.y0[0]).max()))
    remedy = "1e-7 is for smooth right-hand sides, 1e-3 to 1e-2 for those that jump"
    required = f"be at most {largest:g}, that orbits be neighbours"
    if positive("separation", value) > largest:
        refuse("separation", required, value, remedy)
    return float(value)


def _norm(system: System, t_end: float) -> np.ndarray | float:
    """Return the sizes over which tangents are orthonormal, (n_data, 1); 1 if they are near."""
    # at the start: those of y, then those of y' for orders above 1
    n, above_one = system.n_solved, system.above_one
    sizes = system.units(t_end)[:n]
    speeds = sizes / t_end
    if system.m == 2:
        speeds = np.maximum(np.abs(system.y0[1, :n]), speeds)
    found = np.concatenate([sizes, speeds[above_one]])
    return found[:, None] if found.max() > _FAR_APART * found.min() else 1.0


def _directions(given: Any, seed: int, k: int, rows: int, norm: np.ndarray | float) -> np.ndarray:
    """Return initial directions, shape (rows, k), which are orthonormal over the sizes `norm`."""
    if given is None:
        given = np.random.default_rng(seed).normal(size=(rows, rows))[:, :k]
    else:
        given = real_array("directions", given)
        if given.shape != (rows, k):
            required = f"have shape ({rows}, {k}): one column for each exponent"
            refuse("directions", required, f"shape {given.shape}")
        given = given / norm
        given = given / (np.abs(given).max() or 1.0)  # squares of any numbers stay finite
    q, r = np.linalg.qr(given)
    if not np.abs(np.diag(r)).min() > 1e-12 * np.abs(r).max():  # zeros are refused as well
        refuse("directions", "be linearly independent columns", shown(given))
    return norm * q * np.sign(np.diag(r))


def marched(system: System, scheme: Scheme) -> System:
    """Return the system to march; a classical one of second order becomes first-order."""
    # Above order 1 most schemes store increments without t x'(0). In their rounding a tangent that
    # has decayed is lost. With memory no tangent decays so far.
    if scheme.whole or system.m == 1 or memory(system) != "none" or system.delays:
        return system
    return reduced(system.dense())[0]


def memory(system: System) -> str:
    """Return whether "all", "none" or "some" components have a term of fractional order."""
    found = np.zeros(system.n_solved, dtype=bool)
    for operator, coefficients in system.left:
        found[system.sources[(coefficients != 0) & (not operator.classical)]] = True
    return "all" if found.all() else "some" if found.any() else "none"


def n_data(system: System) -> int:
    """Number of initial data: d, and one more for each component of order above 1."""
    return system.n_solved + int(np.sum(system.above_one))


def _checking_scheme(scheme: Scheme, equation: Equation) -> Scheme:
    """Return the scheme of the second run, with which a verdict is compared."""
    # A first-order scheme with twice the step often repeats a wrong verdict, so the default scheme
    # of second order is taken. If none covers the equation, it is the other scheme of first order:
    # the explicit scheme adds to a rate what the implicit one subtracts.
    if scheme.order(_NEAR_1) > _FIRST_ORDER:
        return scheme
    opposite = L1() if scheme.solve == "explicit" else ExplicitCaputo()
    return _second_order(equation) or opposite


def _second_order(equation: Equation) -> Scheme | None:
    """Return `Adams` if its order is 2, otherwise `BDF(2)`; None for other kernels."""
    system = equation.system
    if not system.constant:
        return None
    if system.reads:
        return BDF(2)
    distinct, _ = marched(system, Adams()).distinct
    orders = [operator.order for key in distinct for _, operator in key]
    single = len(orders) == len(distinct)
    covered = min(orders) >= _ADAMS_LOWEST and max(orders) <= _ADAMS_HIGHEST
    return Adams() if single and covered else BDF(2)
