"""Meshes as fine as a tolerance requires, for schemes with given steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._checks import complaint
from .opening import check_end, open_on_steps
from .progress import Interruption
from .status import Status
from .stops import APART, breaks_ahead

# Steps of the first mesh, and most steps of any.
_FIRST_STEPS, MOST_STEPS = 24, 2**17
# Least and largest factor of the number of steps from one mesh to the next, and a margin.
_LEAST, _LARGEST, _MARGIN = 1.5, 8.0, 1.2
# Factor of the change that stands for the error, which of first order they equal in the limit; and
# part of the change over a first step that its error may be, where no coarser mesh tells.
_SAFE, _FIRST = 2.0, 0.35
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

    The error of a mesh is taken as twice the change of the solution when every step is halved,
    which from first order on is no less than what is left, or as a third of the change over the
    first step from a singular point, which no coarser mesh has; it is compared with ``atol + rtol``
    times the largest value so far of each component. Steps are then spread so that each is worth
    the same of ``sqrt(|y''| / tolerance)``, and their number follows the order. Where no mesh of at
    most `max_steps` steps suffices, the finest one is taken; `measured` tells its error.
    """
    check_end(t_end, equation)
    if not history.takes_meshes:
        required = "be SumOfExponentials or Direct where rtol refines a mesh"
        raise ValueError(complaint("history", required, repr(history)))

    def opened(times):
        asked = t_end, None, times, resume, allow_change
        stepper, n = open_on_steps(equation, scheme, history, *asked)
        stepper.set_breaks(breaks, t_end)
        return stepper, n

    start, least = 0.0, 4 * np.finfo(float).eps * abs(equation.frame.start)  # the user's clock
    if resume is not None:
        start = resume.t
        if resume.h == 0:  # as short as the modes of the run begun allow
            least = max(least, resume.memory_steps.shortest)
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
    n, calls = min(_FIRST_STEPS, max(2, max_steps // 2)), 0
    while True:
        times, kept = _mesh(stretches, n, least)
        error, trial = np.inf, _march(*opened(times[kept]))
        calls += trial.n_rhs
        if trial.trouble is None:
            coarse, trial = trial, _march(*opened(times))
            calls += trial.n_rhs
        if trial.trouble is None:
            scales = _scales(trial.rows, tolerances)
            error = _SAFE * float(np.max(np.abs(trial.rows[kept] - coarse.rows) / scales[kept]))
            singular = places[:-1][np.array(powers) > 1]
            error = max(error, _FIRST * _first_changes(trial, scales, singular))
            stretches = _spread(trial, scales, places, powers)
        lost = trial.trouble not in (None, Status.NOT_SOLVED, Status.BLOWN_UP)
        if error <= 1 or lost or 2 * n >= max_steps:
            break
        more = (_MARGIN * min(error, 1e9)) ** (1 / order)
        n = min(int(n * np.clip(more, _LEAST, _LARGEST)), max_steps // 2)
    stepper, last = opened(times)
    stepper.measured = Measured(error, tolerances[0], calls)
    return stepper, last


def _first_changes(trial, scales, places):
    """Return the largest change over a first step from these times, in units of the tolerance."""
    after = np.searchsorted(trial.times, places) + 1
    changes = np.abs(trial.rows[after] - trial.rows[after - 1])
    return float(np.max(changes / scales[after], initial=0.0))


def _mesh(stretches, n, least):
    """Return a mesh of about 2 n steps, and which of its times are those of n steps.

    Steps are no shorter than `least`, and than what a clock tells apart.
    """
    total = sum(stretch.worth[-1] for stretch in stretches)
    parts, numbers = [stretches[0].ends[:1]], [np.zeros(1)]
    for stretch in stretches:
        own = max(2, round(n * stretch.worth[-1] / total))
        parts.append(stretch.times(2 * own)[1:])
        numbers.append(np.arange(1, 2 * own + 1) % (2 * own))
    times, number = np.concatenate(parts), np.concatenate(numbers)
    chosen, ends = number % 2 == 0, number == 0
    close = np.diff(times) <= np.maximum(APART * times[1:], least)
    # of two times that are too close the later one goes, but for ends of stretches
    left_out = np.append(False, close & ~ends[1:]) | np.append(close & ends[1:], False)
    left_out[0] = False
    return times[~left_out], chosen[~left_out]


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
    sizes = np.maximum.accumulate(np.abs(rows), axis=0)
    least = np.maximum(0.01 * rtol * sizes[-1], 1e-300) if atol is None else atol
    return least + rtol * sizes


def _spread(trial, scales, places, powers):
    """Return the stretches of a better mesh, after the bends of the solution."""
    found = []
    for first, end, power in zip(places[:-1], places[1:], powers, strict=True):
        own = slice(np.searchsorted(trial.times, first), np.searchsorted(trial.times, end) + 1)
        times, rows = trial.times[own], trial.rows[own]
        steps = np.diff(times)
        slopes = np.diff(rows, axis=0) / steps[:, None]
        bends = 2 * np.abs(np.diff(slopes, axis=0)) / (steps[1:] + steps[:-1])[:, None]
        inside = np.sqrt((bends / scales[own][1:-1]).max(axis=1))
        density = np.zeros(steps.size)  # of a single step there is no bend
        density[1:] = inside
        density[:-1] = np.maximum(density[:-1], inside)
        density[0] *= power
        found.append((times, steps, density))
    length = places[-1] - places[0]
    even = _EVEN * sum(float(steps @ density) for _, steps, density in found) / length
    even = even if 0.0 < even < np.inf else 1.0
    return [
        Stretch(times, np.append(0.0, np.cumsum(steps * (density + even))), power)
        for (times, steps, density), power in zip(found, powers, strict=True)
    ]
