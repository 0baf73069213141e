"""Results of Lyapunov runs: growth and decay of tangents, slopes, their errors, verdicts."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..stepping.status import Status
from ..support.html import paragraph, table_html

# A slope counts as different from zero beyond this many standard errors.
_STANDARD_ERRORS = 3.0
# Growth or decay that a power of t up to this one would explain as well is not called exponential.
_POWER = 2.0


class Verdict(enum.StrEnum):
    """Verdict on the late window of a run; equal to its string."""

    EXPONENTIAL_GROWTH = "exponential growth"
    NEUTRAL = "neutral"
    ALGEBRAIC_DECAY = "algebraic decay"
    EXPONENTIAL_DECAY = "exponential decay"
    UNDETERMINED = "undetermined"
    DIVERGED = "diverged"


@dataclass(frozen=True, eq=False)
class Growth:
    """Slopes of k logarithms over a late window, and their verdicts."""

    slope: np.ndarray
    slope_stderr: np.ndarray
    algebraic_slope: np.ndarray
    verdicts: tuple[Verdict, ...]


def assess(
    times: np.ndarray, log_growth: np.ndarray, window: float, n_blocks: int, memory: str
) -> Growth:
    """Return slopes and verdicts over the last fraction `window` of the record."""
    # times (n,), without the start; log_growth (n, k); n_blocks: for the standard error; memory:
    # whether "all", "none" or "some" components have a term of fractional order. If all have one,
    # no solution decays exponentially for ever: its algebraic tail is reached, or still to come.
    k = log_growth.shape[1]
    unknown = np.full(k, np.nan)
    if times.size < 4:
        return Growth(unknown, unknown, unknown, (Verdict.UNDETERMINED,) * k)
    start = times[-1] - window * (times[-1] - times[0])
    inside = times >= start
    edges = np.linspace(max(start, times[0]), times[-1], n_blocks + 1)
    at_edges = [np.interp(edges, times, column) for column in log_growth.T]
    slope, stderr = np.transpose([_block_slope(edges, values) for values in at_edges])
    algebraic = -_power(times[inside], log_growth[inside])
    verdicts = tuple(_verdict(*row, memory) for row in zip(slope, stderr, -algebraic, strict=True))
    return Growth(slope, stderr, algebraic, verdicts)


def _block_slope(edges: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Return the mean slope and its standard error, the largest over three lengths of blocks."""
    # neighbouring blocks are not independent, which longer blocks reveal
    errors = []
    for every in (1, 2, 4):
        slopes = np.diff(values[::every]) / np.diff(edges[::every])
        if slopes.size > 2:
            errors.append(slopes.std(ddof=1) / np.sqrt(slopes.size))
    mean = (values[-1] - values[0]) / (edges[-1] - edges[0])
    return mean, max(errors, default=np.inf)


def _power(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return least-squares slopes (k,) of `values` (n, k) against the logarithm of time."""
    # NaN for one time, as in an interrupted run, whose renormalisations are far apart
    if times.size < 2:
        return np.full(values.shape[1], np.nan)
    x = np.log(times)
    x = x - x.mean()
    return x @ (values - values.mean(axis=0)) / (x @ x)


def _verdict(slope: float, stderr: float, power: float, memory: str) -> Verdict:
    """Return the verdict on a logarithm with given slopes in t and in log t."""
    if not (np.isfinite(slope) and np.isfinite(stderr)):
        return Verdict.UNDETERMINED
    if slope > _STANDARD_ERRORS * stderr:
        return Verdict.EXPONENTIAL_GROWTH if power > _POWER else Verdict.UNDETERMINED
    if slope < -_STANDARD_ERRORS * stderr:
        if memory == "none":
            return Verdict.EXPONENTIAL_DECAY
        algebraic = memory == "all" or power > -_POWER
        return Verdict.ALGEBRAIC_DECAY if algebraic else Verdict.UNDETERMINED
    return Verdict.NEUTRAL if abs(power) < _POWER else Verdict.UNDETERMINED


def kaplan_yorke(exponents: np.ndarray) -> float:
    """Return j + (sum of the j largest) / |the next|, with the last j whose sum is positive."""
    ordered = np.sort(exponents)[::-1]
    sums = np.cumsum(ordered)
    if ordered[0] < 0:
        return 0.0
    j = int(np.flatnonzero(sums >= 0)[-1]) + 1
    return float(j) if j == ordered.size else j + sums[j - 1] / -ordered[j]


@dataclass(frozen=True, eq=False)
class LyapunovResult:
    """Finite-time Lyapunov exponents, their record over time, and a verdict.

    All rates are natural logarithms by time [1/time]. With memory they depend on the time of the
    run: only growth that lasts has a rate of its own (docs/lyapunov.md).

    Attributes
    ----------
    exponents : ndarray, shape (k,)
        Mean rates from the transient to the end, the last row of `trace`.
    times : ndarray, shape (n,)
        When the tangents were made orthonormal [time].
    trace : ndarray, shape (n, k)
        Mean rates up to each of these times.
    log_growth : ndarray, shape (n, k)
        Logarithms of the growth since the transient [-].
    slope, slope_stderr : ndarray, shape (k,)
        Mean rate over the late window and its standard error from blocks.
    algebraic_slope : ndarray, shape (k,)
        -d log(growth) / d log(t) over the late window; near the lowest fractional order once a
        decay is algebraic [-].
    verdict : Verdict
        On the leading exponent.
    verdicts : tuple of Verdict, length k
    sum_rule_defect : float or None
        Sum of all exponents less the mean divergence along the orbit; for classical equations with
        k the number of initial data, in mode "tangent".
    kaplan_yorke : float or None
        Kaplan-Yorke dimension, under the same conditions [-].
    mode : str
    status : Status
        How the run ended; ``success`` says whether it is COMPLETED.
    message : str
    y : ndarray, shape (d,)
        The orbit at the end.
    settings : dict
        What the exponents depend on: scheme, history, h, t_end, renorm, transient, seed, ...
    stats : dict
        n_steps, n_rhs, n_modes, run_seconds.
    verified : bool or None
        Whether a second run, with twice or half the step, has the same verdicts (`verify`). The
        others are "undetermined", and `message` gives the reason. None without a second run.
    check : LyapunovResult or None
        The second run.
    """

    exponents: np.ndarray
    times: np.ndarray
    trace: np.ndarray = field(repr=False)
    log_growth: np.ndarray = field(repr=False)
    slope: np.ndarray
    slope_stderr: np.ndarray
    algebraic_slope: np.ndarray
    verdict: Verdict
    verdicts: tuple[Verdict, ...]
    sum_rule_defect: float | None
    kaplan_yorke: float | None
    mode: str
    status: Status
    message: str
    y: np.ndarray
    settings: dict[str, Any] = field(repr=False)
    stats: dict[str, Any] = field(repr=False)
    verified: bool | None = None
    check: LyapunovResult | None = field(default=None, repr=False)

    @property
    def success(self) -> bool:
        """Whether the run reached the end inside the scheme's stability limit."""
        return self.status is Status.COMPLETED

    def _repr_html_(self) -> str:
        columns = self.exponents, self.slope, self.slope_stderr, self.algebraic_slope
        numbers = zip(*(column.tolist() for column in columns), strict=True)
        rows = [[*row, verdict] for row, verdict in zip(numbers, self.verdicts, strict=True)]
        head = ["exponent", "late slope", "its error", "algebraic slope", "verdict"]
        return table_html(head, rows) + paragraph(f"{self.mode}: {self.message}")

    def __repr__(self) -> str:
        columns = zip(self.exponents, self.slope, self.slope_stderr, self.verdicts, strict=True)
        rates = ", ".join(f"{r:.5g} (late {s:.3g} +- {e:.1g}, {v})" for r, s, e, v in columns)
        return f"LyapunovResult({rates}; mode {self.mode!r}, {self.message})"
