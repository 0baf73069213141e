"""Lyapunov exponents over any stepper, with all of the memory kept."""

from __future__ import annotations

from dataclasses import replace

from numpy.typing import ArrayLike

from ..equation.equation import Equation
from ..history.history import History
from ..schemes.scheme import Scheme
from ..solver.solution import Status
from ..support.checks import complaint, instance, refusing
from .growth import Verdict
from .marched import checking_scheme, usual_scheme
from .one_run import Request, march, result_of
from .spectrum import LyapunovResult

# What to write instead of keywords of former versions.
_INSTEAD = {"resume": "make one run to the last time: `trace` has the rates of every earlier one"}


@refusing(_INSTEAD)
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
    verify: bool | None = None,
    progress: bool = False,
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
        Number of steps. With `Collocation`, which chooses its own steps, the number of times at
        which tangents may be made orthonormal, 65536 by default.
    k : int
        How many exponents, 1 <= k <= number of initial data (d, and one more for each component of
        order above 1).
    mode : {"tangent", "pair"}
        "pair" takes orbits side by side whose whole histories are drawn back together, for
        right-hand sides without a derivative; where they jump, with a `separation` of 1e-3 to
        1e-2, so that orbits meet the jump in different steps.
    scheme : Scheme, optional
        By default one of second order wherever one covers the equation: `Adams` for one term a
        component with orders from 1/2 to 1 and for classical equations, `BDF(2)` for other Caputo
        terms; `ExplicitCaputo`, of first order, for other kernels and for orders that vary.
    history : History, optional
        As for `solve`.
    renorm : float, optional
        Interval between two renormalisations [time], rounded to whole steps; by default it follows
        the growth.
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
        Distance of the orbits in mode "pair", in units of y, at most 1 or the largest initial
        value: rounding grows like its inverse, what is not linear like itself.
    rtol, atol : float, optional
        Tolerances of the orbit with `Collocation`, as for `solve`; mode "tangent" alone.
    verify : bool, optional
        By default the run is repeated at twice the step, with `Collocation` at ten times the
        tolerance, and verdicts that change are "undetermined". Schemes of first order, whose error
        often is the same at twice the step, are compared with the default one, or the explicit one
        with `L1` and the other way round. True: at half the step (a tenth of the tolerance) and
        with the same scheme. False: no second run.
    progress : optional
        As for `solve`.

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
    For k tangents one Jacobian a step and k more columns of memory, and 1 to 5 us a
    renormalisation; half as much again for the second run, and more than twice as much with
    `ExplicitCaputo`, which takes half the step there (convergence/lyapunov_cost.py).

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
    equation = instance(
        "equation", equation, Equation, "hereditary.Equation(terms, rhs, y0)"
    ).current()
    if verify not in (None, False, True):
        raise TypeError(complaint("verify", "be True, False or None", repr(verify)))
    scheme = usual_scheme(equation) if scheme is None else scheme
    request = Request(
        equation, t_end, n_steps, k, mode, scheme, history, renorm, transient, directions,
        seed, window, n_blocks, separation, rtol, atol, progress,
    )  # fmt: skip
    result = result_of(request, march(request))
    if result.status not in _REACHED_END or verify is False:
        return result
    if verify is None and set(result.verdicts) == {Verdict.UNDETERMINED}:
        return result
    other, how = _another(request, result, bool(verify))
    try:
        check = result_of(other, march(other))
    except ValueError as error:  # a step that its scheme does not take
        return _undetermined(result, None, f"with {how} there is no run to compare with: {error}")
    return _compared(result, check, how)


_REACHED_END = (
    Status.COMPLETED,
    Status.STEP_TOO_LARGE,
    Status.KERNEL_INACCURATE,
    Status.ZIGZAG,
)
# Largest tolerance of `Collocation` that leaves room for one ten times as large.
_LOOSEST = 0.01


def _another(request, result, finer):
    """The run that a verdict is compared with, and how it differs."""
    scheme, found = request.scheme, result.settings
    n, t_end = result.stats["n_steps"], found["t_end"]
    if scheme.adaptive:
        finer = finer or found["rtol"] > _LOOSEST
        factor = 0.1 if finer else 10.0
        how = "a tenth of the tolerance" if finer else "ten times the tolerance"
        atol = None if found["atol"] is None else factor * found["atol"]
        changed = {"rtol": factor * found["rtol"], "atol": atol}
    else:
        n, h = (2 * n, found["h"] / 2) if finer else (n // 2, 2 * found["h"])
        other = scheme if finer else checking_scheme(scheme, request.equation)
        how = "half the step" if finer else "twice the step"
        how += "" if other == scheme else f" and {other!r}"
        changed, t_end = {"scheme": other}, n * h
    return replace(request, t_end=t_end, n_steps=n, loud=False, **changed), how


def _compared(result, check, how):
    """The result with its check; verdicts that differ are undetermined."""
    if check.status not in _REACHED_END:
        return _undetermined(result, check, f"with {how} it ended otherwise: {check.message}")
    pairs = list(zip(result.verdicts, check.verdicts, strict=True))
    verdicts = tuple(one if one == other else Verdict.UNDETERMINED for one, other in pairs)
    if verdicts == result.verdicts:
        return replace(result, verified=True, check=check)
    number = next(i for i, (one, _) in enumerate(pairs) if one != verdicts[i])
    one, other = map(str, pairs[number])
    reason = f"with {how} verdict {number + 1} is {other!r} instead of {one!r}: take smaller steps"
    return _undetermined(result, check, reason, verdicts)


def _undetermined(result, check, reason, verdicts=None):
    """The result with verdicts that are not told, and why."""
    if verdicts is None:
        verdicts = (Verdict.UNDETERMINED,) * len(result.verdicts)
    message = f"{result.message}; {reason}"
    changed = {"verdicts": verdicts, "verdict": verdicts[0], "message": message}
    return replace(result, verified=False, check=check, **changed)
