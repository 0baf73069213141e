"""Results of a Lyapunov run, and the record they are made from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..compiled.growing_march import PACE
from ..compiled.structures import record
from ..solver.solution import Status
from ..support.html import paragraph, rows_of
from .growth import Verdict

# Samples of an automatic record; more would cost time, and the late window holds half of them.
_SAMPLES = 128
# First automatic interval [steps].
_FIRST = 32


class Record:
    """When tangents are made orthonormal, and how much they had grown.

    Parameters
    ----------
    h : float
        Step [time].
    interval : int or None
        Steps between two renormalisations; None to follow the growth.
    n_steps, n_transient, k : int

    Attributes
    ----------
    pace : record of `PACE`
        When tangents are made orthonormal; whoever does so keeps it up to date.
    """

    def __init__(self, h, interval, n_steps, n_transient, k):
        longest = max(1, n_steps // _SAMPLES)
        first = min(_FIRST, longest) if interval is None else interval
        how = {"longest": longest, "automatic": int(interval is None)}
        self.pace = record(PACE, interval=first, transient=n_transient, **how)
        self.h, self._n_transient = h, n_transient
        self.steps: list[int] = []
        self.sums: list[np.ndarray] = []
        self.total = np.zeros(k)
        self._at_transient = np.zeros(k)
        self.widest = 0.0

    @property
    def n_last(self):
        """Step of the last renormalisation."""
        return int(self.pace["last"])

    def add(self, steps, logs):
        """Note the growth (n, k) up to each of some steps, (n,), since the one before."""
        if len(steps) == 0:
            return
        self.widest = max(self.widest, float((logs.max(axis=1) - logs.min(axis=1)).max()))
        totals = np.cumsum(np.vstack([self.total, logs]), axis=0)[1:]
        self.total = totals[-1]
        for n, total in zip(steps, totals, strict=True):
            if n == self._n_transient:
                self._at_transient = total
            elif n > self._n_transient:
                self.steps.append(int(n))
                self.sums.append(total - self._at_transient)

    @property
    def times(self):
        """Times after the transient at which growth was measured, shape (n,)."""
        return self.h * np.array(self.steps, dtype=float)

    @property
    def log_growth(self):
        """Logarithms of the growth since the transient, shape (n, k)."""
        return np.array(self.sums).reshape(-1, self.total.size)

    @property
    def trace(self):
        """Mean rates since the transient, shape (n, k)."""
        return self.log_growth / (self.times - self.h * self._n_transient)[:, None]


@dataclass(frozen=True, eq=False)
class LyapunovResult:
    """Finite-time Lyapunov exponents and what the record of the growth says of them.

    All rates are natural logarithms by time [1/time]. For equations with memory they are facts
    about this horizon: only growth that lasts has a rate of its own (docs/lyapunov.md).

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
        -d log(growth) / d log(t) over the late window: near the lowest fractional order where a
        decay has reached its algebraic tail [-].
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
        Whether the verdicts stood in a second run, with twice or half the step (`verify`); those
        that did not are "undetermined", and `message` says why. None without a second run.
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

    def _repr_html_(self):
        columns = self.exponents, self.slope, self.slope_stderr, self.algebraic_slope
        numbers = zip(*(column.tolist() for column in columns), strict=True)
        rows = [[*row, verdict] for row, verdict in zip(numbers, self.verdicts, strict=True)]
        head = ["exponent", "late slope", "its error", "algebraic slope", "verdict"]
        return rows_of(head, rows) + paragraph(f"{self.mode}: {self.message}")

    def __repr__(self):
        rates = ", ".join(
            f"{rate:.5g} (late {slope:.3g} +- {error:.1g}, {verdict})"
            for rate, slope, error, verdict in zip(
                self.exponents, self.slope, self.slope_stderr, self.verdicts, strict=True
            )
        )
        return f"LyapunovResult({rates}; mode {self.mode!r}, {self.message})"
