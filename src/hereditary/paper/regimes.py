"""Dynamic regimes of a load that is pulled over a chain of wells.

Barriers passed and intervals at rest are counted. Whether the times spent in the wells repeat
themselves, and the late slope of the exponent, distinguish order from disorder.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from ..analysis.growth import LyapunovResult
from ..analysis.sections import check_unbroken, values_at
from ..solver.solution import Solution, Status
from ..support.checks import instance, positive, real, refuse

# A load rests while it moves by less than this fraction of what the pull advances in a quarter of
# the period of the wells. A small fraction asks for a firm stop; a load in a soft well creeps at up
# to 1/2.
_SLOWNESS = (0.25, 0.5, 0.75)
# Least fraction of the time at rest that counts as sticking. Less of it may be rest at the start
# alone.
_REST = 0.05
# The orbit repeats itself if the times spent in the wells repeat. These are the tolerances of their
# root mean square difference, relative to the longest time.
_TOLERANCES = (0.025, 0.05, 0.1)
# Votes are taken from these last fractions of the run.
_WINDOWS = (1.0, 0.75, 0.5)
# Fewest long times in a well from which repetition is judged. A time is long if it exceeds half of
# the longest.
_STAYS = 4
# Points of the orbit in one period of the wells.
_POINTS_PER_PERIOD = 64
# Fewest points of a run.
_MIN_ORBIT_POINTS = 512
# Most points of a run.
_MAX_ORBIT_POINTS = 65_536
# Statuses of a run whose regime is not judged: all but completed runs and those that the user
# stopped.
_CUT_SHORT = frozenset(Status) - {
    Status.COMPLETED,
    Status.STEP_TOO_LARGE,
    Status.KERNEL_INACCURATE,
    Status.ZIGZAG,
    Status.INTERRUPTED,
    Status.EVENT,
}
# Largest probability that follows from the slope of an exponent, whose normal distribution is
# unknown further out.
_SUREST = 0.99


class Regime(enum.StrEnum):
    """Motion of a pulled load; equal to its string."""

    PERIODIC = "stick-slip, periodic"
    IRREGULAR = "stick-slip, irregular"
    SLIDING = "sliding"
    STUCK = "stuck"
    UNDETERMINED = "undetermined"


@dataclass(frozen=True)
class RegimeVerdict:
    """A regime, its certainty, and the evidence.

    Attributes
    ----------
    regime : Regime
    certainty : float
        In [0, 1]: the share of the votes that agree on stuck, sliding or stick-slip. For stick-slip
        this is multiplied by the probability of being periodic or irregular.
    agreement : float
        The share of the votes that agree. Each vote uses one part of the run (all, the last three
        quarters, the last half) and one run (the orbit or its check). It uses one definition of
        rest (an advance of less than 1/4, 1/2, 3/4 of the pull).
    irregular : float
        Probability that the stick-slip is irregular, NaN for other regimes. One estimate is from
        the votes on repetition, with half a vote added on either side. The other is the probability
        of a positive exponent, by the normal law of its late slope and standard error. The two
        count as independent, so their odds are multiplied. The fewer stays were seen to judge
        repetition, the less the exponent counts. Without an exponent only the votes count.
    recurrence : float
        How far the times in the wells are from repeating themselves, in the last half of the run.
        It is the root mean square difference over the longest time; NaN if there are too few.
    cycle : int
        Number of wells after which the times repeat; 0 if they differ by more than 0.05.
    n_wells : int
        Barriers passed in the run, each counted once.
    n_stays : int
        Wells in which the load rested.
    longest_stay : float
        Longest rest in one of them [time].
    """

    regime: Regime
    certainty: float
    agreement: float
    irregular: float
    recurrence: float
    cycle: int
    n_wells: int
    n_stays: int
    longest_stay: float


def classify(
    solution: Solution,
    exponent: LyapunovResult | None = None,
    *,
    period: float,
    spacing: float = 2 * math.pi,
    transient: float = 0.0,
    check: Solution | None = None,
) -> RegimeVerdict:
    """Classify the dynamic regime of a load pulled over a chain of wells.

    - *Stuck*: no barrier is passed in this run. A run shorter than the wells' period cannot show
      this.
    - *Sliding*: barriers are passed without rest.
    - *Stick-slip*: barriers are passed and the load rests in between. *Periodic* when the times
      between first passages of the barriers repeat themselves, *irregular* otherwise.

    The load rests while it moves by less than half of the way that it is pulled in a quarter of the
    wells' period. This threshold and the others are varied, and `certainty` is the share of the
    variations that agree.

    Parameters
    ----------
    solution : Solution
        Its first component is the load's place; rows must resolve the slips.
    exponent : LyapunovResult, optional
        Of the same equation, over the same time. Its second run, if any, counts as well.
    period : float
        Time in which the pull passes one well, ``2 pi omega**2 / b`` for the stick-slip oscillator;
        infinite for a load that is not pulled [time].
    spacing : float, optional
        Distance of the barriers, which lie at its multiples.
    transient : float, optional
        What happens before is left out [time].
    check : Solution, optional
        The same run with half the step, or a smaller tolerance. Its votes count like those of the
        first run, so a verdict that depends on the step has less certainty.

    Returns
    -------
    RegimeVerdict

    Error
    -----
    A verdict is about this run: a stuck load may slip later, irregular slips may become periodic.
    If the load rests for most of the run, there are few stays to judge repetition or a late slope.
    Then the certainty is near 1/2. A run that failed is undetermined.

    Examples
    --------
    >>> import math
    >>> import hereditary as hd
    >>> from hereditary import classify
    >>> eq = hd.scenes.stick_slip(adhesion=10.0)
    >>> sol = hd.solve(eq, 400.0, 40_000, save_every=10)
    >>> found = classify(sol, hd.lyapunov(eq, 400.0, 40_000), period=2 * math.pi)
    >>> str(found.regime), found.cycle, found.certainty > 0.9
    ('stick-slip, periodic', 2, True)
    """
    instance("solution", solution, Solution, "hereditary.solve(...)")
    if exponent is not None:
        instance("exponent", exponent, LyapunovResult, "hereditary.lyapunov(...)")
    spacing = positive("spacing", spacing)
    if period != math.inf:
        period = positive("period", period)
    begin = real("transient", transient)
    if begin >= solution.t[-1]:
        refuse("transient", f"lie before the end of the run, {solution.t[-1]:g}", begin)
    runs = [solution]
    if check is not None:
        runs.append(instance("check", check, Solution, "a run with half the step"))
    for run in runs:
        check_unbroken(run)
    if any(run.status in _CUT_SHORT or not np.isfinite(run.y[:, 0]).all() for run in runs):
        return RegimeVerdict(
            Regime.UNDETERMINED, 0.0, 0.0, cycle=0, n_wells=0, n_stays=0, irregular=math.nan,
            recurrence=math.nan, longest_stay=0.0,
        )  # fmt: skip
    orbits = [_Orbit(run, period, spacing, begin) for run in runs]
    votes = [kind for orbit in orbits for window in _WINDOWS for kind in orbit.kinds(window)]
    kinds = [Regime.STUCK, Regime.SLIDING, Regime.PERIODIC]
    shares = [votes.count(kind) / len(votes) for kind in kinds]
    best = int(np.argmax(shares))
    regime, certainty, irregular = kinds[best], shares[best], math.nan
    if shares[best] == 0:
        regime = Regime.UNDETERMINED
    elif regime is Regime.PERIODIC:
        against, known = _share_irregular(orbits)
        # with few stays a late slope is that of the well in which the load rests
        growth = 0.5 + known * (_chance_of_growth(exponent) - 0.5)
        # the odds of two independent estimates are multiplied
        both = against * growth
        irregular = both / (both + (1 - against) * (1 - growth))
        regime = Regime.IRREGULAR if irregular > 0.5 else Regime.PERIODIC
        certainty *= max(irregular, 1 - irregular)
    stays = orbits[0].stays()
    cycle, distance = orbits[0].recurrence(_WINDOWS[-1])
    return RegimeVerdict(
        regime=regime,
        certainty=float(certainty),
        agreement=float(shares[best]),
        irregular=irregular,
        recurrence=distance,
        cycle=cycle if distance < _TOLERANCES[1] else 0,
        n_wells=orbits[0].n_wells,
        n_stays=len(stays),
        longest_stay=max((b - a for a, b in stays), default=0.0),
    )


class _Orbit:
    """Positions of the load at equidistant times, and counts of its passages and rests."""

    def __init__(self, solution: Solution, period: float, spacing: float, begin: float) -> None:
        self._period, self._pulled = period, math.isfinite(period)
        points = _POINTS_PER_PERIOD * (solution.t[-1] - begin) / period
        n = int(np.clip(points, _MIN_ORBIT_POINTS, _MAX_ORBIT_POINTS))
        self._t = np.linspace(begin, solution.t[-1], n + 1)
        x = values_at(solution, self._t)[:, 0]
        self._well = np.floor(x / spacing)
        # points in a quarter of the period, the advance of the load in it, and the advance of the
        # pull
        step = self._t[1] - self._t[0]
        self._quarter = int(np.clip(period / 4 / step, 1, n).round())
        self._advance = np.abs(x[self._quarter :] - x[: -self._quarter])
        self._pull = spacing / period * self._quarter * step
        self._passages = _passages(self._t, x * np.sign(x[-1] - x[0]), spacing)
        self.n_wells = self._passages.size

    def _from(self, window: float) -> int:
        """Return the index of the first point in the last fraction `window` of the run."""
        return round((1 - window) * (self._t.size - 1))

    def _slow(self, slowness: float) -> np.ndarray:
        """Return for each point whether a rest of a quarter period begins there."""
        slow = self._advance < slowness * self._pull
        return np.append(slow, np.zeros(self._quarter, dtype=bool))

    def _resting(self, slowness: float) -> np.ndarray:
        """Return for each point whether the load is at rest."""
        sums = np.cumsum(self._slow(slowness))
        return sums > np.concatenate([np.zeros(self._quarter), sums[: -self._quarter]])

    def kinds(self, window: float) -> list[Regime | None]:
        """Return STUCK, SLIDING, PERIODIC (any stick-slip) or None for each slowness."""
        first = self._from(window)
        if not np.any(np.diff(self._well[first:])):
            known = not self._pulled or self._t[-1] - self._t[first] >= self._period
            return [Regime.STUCK if known else None] * len(_SLOWNESS)
        shares = [np.mean(self._resting(slowness)[first:]) for slowness in _SLOWNESS]
        return [Regime.PERIODIC if share > _REST else Regime.SLIDING for share in shares]

    def stays(self) -> list[tuple[float, float]]:
        """Return starts and ends of the intervals at rest, one for each well."""
        slow = np.concatenate([[0], self._slow(_SLOWNESS[1]).astype(int), [0]])
        edges = np.flatnonzero(np.diff(slow))
        # at its ends a rest may be between two wells; in its middle the load is in one well
        half = self._quarter // 2
        stays: list[list[int]] = []
        for start, stop in zip(edges[::2], edges[1::2] - 1 + self._quarter, strict=True):
            # swings in the well interrupt a stay without ending it
            if stays and self._well[stays[-1][1] - half] == self._well[start + half]:
                stays[-1][1] = stop
            else:
                stays.append([start, stop])
        return [(float(self._t[a]), float(self._t[b])) for a, b in stays]

    def recurrence(self, window: float) -> tuple[int, float]:
        """Return after how many wells times in wells repeat best, and their difference."""
        # 0 and NaN unless every cycle, and four of the longer times, have been passed
        begin = self._t[self._from(window)]
        passages = self._passages[self._passages >= begin]
        times = np.diff(passages)
        # the stays that the window cuts off were longer still
        cut = np.diff(np.concatenate([[begin], passages, [self._t[-1]]])).max()
        if np.sum(times > cut / 2) < _STAYS:
            return 0, math.nan
        shifts = np.arange(1, times.size // 2 + 1)
        errors = np.array([np.sqrt(np.mean((times[k:] - times[:-k]) ** 2)) for k in shifts])
        distances = errors / times.max()
        # the shortest cycle that is about as good as the best
        best = int(np.argmax(distances <= max(2 * distances.min(), _TOLERANCES[0])))
        return int(shifts[best]), float(distances[best])


def _passages(t: np.ndarray, x: np.ndarray, spacing: float) -> np.ndarray:
    """Return times at which a load moving upwards first passes each barrier, ascending."""
    furthest = np.maximum.accumulate(x)
    barriers = spacing * np.arange(
        math.floor(furthest[0] / spacing) + 1, math.floor(furthest[-1] / spacing) + 1
    )
    after = np.searchsorted(furthest, barriers)
    share = (barriers - furthest[after - 1]) / (furthest[after] - furthest[after - 1])
    return t[after - 1] + share * (t[after] - t[after - 1])


def _share_irregular(orbits: Sequence[_Orbit]) -> tuple[float, float]:
    """Return the fraction of votes against repetition, and that of all votes that were possible."""
    # half a vote is added on either side
    votes: list[bool | None] = []
    for orbit in orbits:
        for window in _WINDOWS[1:]:
            _, distance = orbit.recurrence(window)
            unknown = math.isnan(distance)
            votes += [None if unknown else distance < tolerance for tolerance in _TOLERANCES]
    against = sum(0.5 if vote is None else float(not vote) for vote in votes)
    known = sum(vote is not None for vote in votes) / len(votes)
    return (against + 0.5) / (len(votes) + 1), known


def _chance_of_growth(exponent: LyapunovResult | None) -> float:
    """Return the probability that the late slope is positive; 1/2 if it is unknown."""
    if exponent is None:
        return 0.5
    runs = [exponent] if exponent.check is None else [exponent, exponent.check]
    chances = []
    for run in runs:
        slope, error = run.slope[0], run.slope_stderr[0]
        known = np.isfinite(slope) and np.isfinite(error) and error > 0
        chances.append(float(ndtr(slope / error)) if known else 0.5)
    return float(np.clip(np.mean(chances), 1 - _SUREST, _SUREST))
