"""Meshes as fine as a tolerance requires, for schemes with given steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._checks import complaint
from .opening import open_on_steps
from .progress import Interruption
from .status import Status
from .stops import APART, breaks_ahead

# Steps of the first mesh, and most steps of any.
_FIRST_STEPS, MOST_STEPS = 24, 2**17
# Least and largest factor of the number of steps from one mesh to the next, and a margin.
_LEAST, _LARGEST, _MARGIN = 1.5, 8.0, 1.2
# Factor of the change that stands for the error; of first order they are equal in the limit.
_SAFE = 2.0
# Largest exponent with which a mesh is refined towards a singular point.
_STEEPEST = 10.0
# Part of the steps that are spread evenly over time, whatever the solution does.
_EVEN = 0.3


class Stretch(NamedTuple):
    """Part of a run between singular points, and how many steps each of its intervals is worth.

    ends (k+1,) of the intervals [time]; worth (k+1,), summed from 0 on; power: within the first
    interval the time since its start grows like this power of the worth.
    """

    ends: np.ndarray
    worth: np.ndarray
    power: float

    def times(self, n):
        """Return the ends of n steps of equal worth, (n+1,)."""
        levels = np.linspace(0.0, self.worth[-1], n + 1)
        times = np.interp(levels, self.worth, self.ends)
        start, first, worth = self.ends[0], self.ends[1], self.worth[1]
        inside = levels < worth
        times[inside] = start + (first - start) * (levels[inside] / worth) ** self.power
        times[-1] = self.ends[-1]
        return times


class Measured(NamedTuple):
    """Largest error on a mesh in units of the tolerance, rtol, and calls of rhs to find it."""

    error: float
    rtol: float
    n_rhs: int


class Trial(NamedTuple):
    """Times (n+1,) and rows (n+1, d) of a march, its calls of rhs, and why it ended, or None."""

    times: np.ndarray
    rows: np.ndarray
    n_rhs: int
    trouble: Status | None


def open_refined(
    equation, scheme, history, t_end, tolerances, max_steps, breaks, resume, allow_change
):
    """Return a stepper on a mesh whose errors are within the tolerance, and its last step number.

    The errors of a mesh are those by which the solution changes when every step is halved, which
    from first order on is no less than what is left; they are compared with ``atol + rtol`` times
    the largest value so far of each component. Steps are then spread so that each is worth the same
    of ``sqrt(|y''| / tolerance)``, and their number follows the order. Where no mesh of at most
    `max_steps` steps suffices, the finest one is taken; `measured` tells its error.
    """
    if not history.takes_meshes:
        required = "be SumOfExponentials or Direct where rtol refines a mesh"
        raise ValueError(complaint("history", required, repr(history)))

    def opened(times):
        asked = t_end, None, times, resume, allow_change
        stepper, n = open_on_steps(equation, scheme, history, *asked)
        stepper.set_breaks(breaks, t_end)
        return stepper, n

    start = 0.0 if resume is None else resume.t
    highest = equation.highest_orders()
    power = min(_STEEPEST, 2.0 / float(highest.min()))
    order = scheme.order(float(highest.max()))
    at_once, ahead = breaks_ahead(breaks, start, t_end)
    places = np.concatenate([[start], ahead, [t_end]])
    powers = [power] * (places.size - 1)
    powers[0] = 1.0 if resume is not None and not at_once else power
    even = np.array([0.0, 1.0])
    stretches = [
        Stretch(places[k : k + 2], even * (places[k + 1] - places[k]), p)
        for k, p in enumerate(powers)
    ]
    n, calls = _FIRST_STEPS, 0
    while True:
        times, kept = _mesh(stretches, n)
        error, trial = np.inf, _march(*opened(times[kept]))
        calls += trial.n_rhs
        if trial.trouble is None:
            coarse, trial = trial, _march(*opened(times))
            calls += trial.n_rhs
        if trial.trouble is None:
            scales = _scales(trial.rows, tolerances)
            error = _SAFE * float(np.max(np.abs(trial.rows[kept] - coarse.rows) / scales[kept]))
            stretches = _spread(trial, scales, places, powers)
        lost = trial.trouble not in (None, Status.NOT_SOLVED, Status.BLOWN_UP)
        if error <= 1 or lost or 2 * n >= max_steps:
            break
        more = (_MARGIN * min(error, 1e9)) ** (1 / order)
        n = min(int(n * np.clip(more, _LEAST, _LARGEST)), max_steps // 2)
    stepper, last = opened(times)
    stepper.measured = Measured(error, tolerances[0], calls)
    return stepper, last


def _mesh(stretches, n):
    """Return a mesh of about 2 n steps, and which of its times are those of n steps."""
    total = sum(stretch.worth[-1] for stretch in stretches)
    parts, kept = [stretches[0].ends[:1]], [np.array([True])]
    for stretch in stretches:
        own = max(2, round(n * stretch.worth[-1] / total))
        parts.append(stretch.times(2 * own)[1:])
        kept.append(np.arange(1, 2 * own + 1) % 2 == 0)
    times, chosen = np.concatenate(parts), np.concatenate(kept)
    # steps next to a singular point may be too short for a clock
    ends = np.isin(times, [stretch.ends[-1] for stretch in stretches])
    apart = np.diff(times, prepend=-np.inf) > APART * times
    before = np.append(times[1:] - times[:-1] <= APART * times[1:], False) & np.append(
        ends[1:], False
    )
    good = (apart | ends) & ~before
    return times[good], chosen[good]


def _march(stepper, n):
    """March to step n, and return the `Trial`; Ctrl-C raises, for nothing is worth keeping."""
    times, rows, begun = [np.array([stepper.t])], [stepper.y[None]], stepper.n_rhs
    with Interruption() as interruption:
        while stepper.n < n and stepper.trouble is None and not interruption.asked:
            piece = stepper.advance(n)
            if piece is not None:
                times.append(piece.times[1:])
                rows.append(piece.rows[1:])
    trouble, calls = stepper.trouble, stepper.n_rhs - begun
    return Trial(np.concatenate(times), np.concatenate(rows), calls, trouble and trouble[0])


def _scales(rows, tolerances):
    """Return what each row may err by, (n+1, d)."""
    rtol, atol = tolerances
    return atol + rtol * np.maximum.accumulate(np.abs(rows), axis=0)


def _spread(trial, scales, places, powers):
    """Return the stretches of a better mesh, after the bends of the solution."""
    found = []
    for first, end, power in zip(places[:-1], places[1:], powers, strict=True):
        own = slice(np.searchsorted(trial.times, first), np.searchsorted(trial.times, end) + 1)
        times, rows = trial.times[own], trial.rows[own]
        steps = np.diff(times)
        slopes = np.diff(rows, axis=0) / steps[:, None]
        bends = 2 * np.abs(np.diff(slopes, axis=0)) / (steps[1:] + steps[:-1])[:, None]
        density = np.sqrt((bends / scales[own][1:-1]).max(axis=1))
        density = np.maximum(np.append(density[:1] * power, density), np.append(density, 0.0))
        found.append((times, steps, density))
    length = places[-1] - places[0]
    even = _EVEN * sum(float(steps @ density) for _, steps, density in found) / length
    even = even if 0.0 < even < np.inf else 1.0
    return [
        Stretch(times, np.append(0.0, np.cumsum(steps * (density + even))), power)
        for (times, steps, density), power in zip(found, powers, strict=True)
    ]
