"""Events that change y, drawn: each exact zero acts once, whatever form the function has."""

import warnings
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

import hereditary as hd

C1 = hd.Caputo(1.0)
FORMS = {
    "number": lambda g: g,
    "tiny": lambda g: lambda t, y: 1e-8 * g(t, y),
    "truth": lambda g: lambda t, y: g(t, y) > 0.0,
    "sign": lambda g: lambda t, y: np.sign(g(t, y)),
    "cube": lambda g: lambda t, y: g(t, y) ** 3,
    "step": lambda g: lambda t, y: np.heaviside(g(t, y), 0.0) - 0.5,
}


class Drawn(NamedTuple):
    """A problem with `n` zeros of each event before `t_end`, at the exact `times`."""

    equation: hd.Equation
    t_end: float
    events: list[Callable]
    times: list[np.ndarray]


def event(rng, function, change, directions=(0,)):
    """An event in a drawn form, with a drawn one of its directions."""
    found = FORMS[rng.choice(list(FORMS))](function)
    found.change, found.direction = change, int(rng.choice(directions))
    return found


def stop(rng, times):
    """A time between the last two of `times`, and all times but the last."""
    return times[-2] + rng.uniform(0.25, 0.75) * (times[-1] - times[-2]), times[:-1]


def leaking(t, y, p):
    return p[0] - y


def threshold(rng):
    """y' = I - y up to 1, then back by a gap of 1e-8 to 1."""
    force, start, gap = rng.uniform(1.1, 3), rng.uniform(-1, 0.9), 10 ** rng.uniform(-8, 0)
    first, each = np.log((force - start) / (force - 1)), np.log1p(gap / (force - 1))
    t_end, times = stop(rng, first + each * np.arange(rng.integers(2, 20)))
    by = [lambda t, y: y - gap, lambda t, y: 0.0 * y + (1.0 - gap)][rng.integers(2)]
    fire = event(rng, lambda t, y: y[0] - 1.0, by, (0, 1))
    return Drawn(hd.Equation(C1, leaking, start, params=force), t_end, [fire], [times])


def bounce(rng):
    keep, g, height = rng.uniform(0.5, 0.95), 10 ** rng.uniform(-1, 1), rng.uniform(0.1, 10)
    powers = keep ** np.arange(1, rng.integers(2, 9))
    t_end, times = stop(rng, np.sqrt(2 * height / g) * np.cumsum([1, *(2 * powers)]))
    at = float(rng.integers(2))  # the height is kept, or set to 0
    floor = event(rng, lambda t, y: y[0], lambda t, y: np.array([at * y[0], -keep * y[1]]), (0, -1))
    equation = hd.Equation(C1, lambda t, y, p: np.array([y[1], -p[0]]), [height, 0.0], params=g)
    return Drawn(equation, t_end, [floor], [times])


def walls(rng):
    keep, width, speed = rng.uniform(0.7, 1), 10 ** rng.uniform(-2, 1), rng.uniform(0.5, 2)
    n, start = rng.integers(2, 12), rng.uniform(0.1, 0.9) * width
    flights = np.array([width - start, *(width / keep ** np.arange(1, n))]) / speed
    t_end, times = stop(rng, np.cumsum(flights))
    flip = lambda t, y: np.array([y[0], -keep * y[1]])  # noqa: E731
    right = event(rng, lambda t, y: y[0] - width, flip, (0, 1))
    left = event(rng, lambda t, y: y[0], flip, (0, -1))
    equation = hd.Equation(C1, lambda t, y: np.array([y[1], 0.0]), [start, speed])
    return Drawn(equation, t_end, [right, left], [times[::2], times[1::2]])


def heated(t, y, p):
    return np.array([(p[1] if y[1] > 0.5 else p[0]) - y[0], 0.0])


def thermostat(rng):
    out, hot, gap = -rng.uniform(0.5, 2), 1 + rng.uniform(0.5, 2), 10 ** rng.uniform(-6, 0)
    start, low = rng.uniform(-1, 0.9 - gap), 1 - gap
    down, up = np.log((1 - out) / (low - out)), np.log((hot - low) / (hot - 1))
    more = np.resize([down, up], rng.integers(1, 15))
    t_end, times = stop(rng, np.cumsum([np.log((hot - start) / (hot - 1)), *more]))
    off = event(rng, lambda t, y: y[0] - 1.0, lambda t, y: np.array([y[0], 0.0]), (1,))
    on = event(rng, lambda t, y: y[0] - low, lambda t, y: np.array([y[0], 1.0]), (-1,))
    equation = hd.Equation(C1, heated, [start, 1.0], params=[out, hot])
    return Drawn(equation, t_end, [off, on], [times[::2], times[1::2]])


def kicks(rng):
    """Zeros in time alone, in one direction or both, and of two functions at once."""
    w, phase, up = 10 ** rng.uniform(-1, 1), rng.uniform(0.01, 0.99), int(rng.integers(-1, 2))
    times = (phase + np.arange(rng.integers(4, 40))) * np.pi / w
    t_end, times = stop(rng, times if up == 0 else times[(1 - up) // 2 :: 2])
    events = [
        event(rng, lambda t, y: np.sin(w * t - phase * np.pi), lambda t, y: y + 1.0, (up,)),
        event(rng, lambda t, y: 3.0 * np.sin(w * t - phase * np.pi), lambda t, y: 2.0 * y, (up,)),
    ]
    return Drawn(hd.Equation(C1, lambda t, y: 0.0 * y, 1.0), t_end, events, [times, times])


KINDS = [threshold, bounce, walls, thermostat, kicks]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("seed", range(8))
def test_each_zero_acts_once_by_a_tolerance(kind, seed):
    rng = np.random.default_rng([26, seed])
    drawn = kind(rng)
    rtol, breaks = 10 ** rng.uniform(-10, -3), ()
    if seed % 2:  # the run stops at some of the zeros
        breaks = np.unique(np.concatenate(drawn.times)[:: rng.integers(1, 4)])
    sol = hd.solve(drawn.equation, drawn.t_end, rtol=rtol, breaks=breaks, events=drawn.events)
    assert sol.status is hd.Status.COMPLETED
    for found, times in zip(sol.t_events, drawn.times, strict=True):
        assert found.size == times.size
        assert np.abs(found - times).max(initial=0.0) <= 100 * rtol * drawn.t_end


@pytest.mark.parametrize("kind", [walls, kicks], ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("seed", range(8))
def test_each_zero_acts_once_on_given_steps(kind, seed):
    """Two and a half steps are between two kicks, thirty between two walls."""
    rng = np.random.default_rng([27, seed])
    drawn = kind(rng)
    closest = np.diff([0.0, *np.unique(np.concatenate(drawn.times))]).min()
    n = int(np.ceil((2.5 if kind is kicks else 30.0) * drawn.t_end / closest))
    sol = hd.solve(drawn.equation, drawn.t_end, n, events=drawn.events, estimate=False)
    for found, times in zip(sol.t_events, drawn.times, strict=True):
        assert found.size == times.size


def test_an_event_that_acts_at_each_step_is_told():
    """A reset by 1e-3, where y rises by 1e-2 in each step."""
    fire = lambda t, y: y[0] - 1.0  # noqa: E731
    fire.change = lambda t, y: y - 1e-3
    eq = hd.Equation(C1, leaking, 0.0, params=2.0)
    with pytest.warns(hd.SolveWarning, match="at one step after the other from t = 0.7"):
        sol = hd.solve(eq, 0.9, 90, events=fire, estimate=False)
    assert sol.t_events[0].size > 15
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert hd.solve(eq, 0.9, rtol=1e-6, events=fire).success


def test_two_zeros_between_two_looks_are_found():
    """y = sin t exceeds 0.9999 for 0.03 of a time at each of its tops."""
    top = lambda t, y: y[0] - 0.9999  # noqa: E731
    sol = hd.solve(hd.Equation(hd.Caputo(2.0), lambda t, y: -y, [0.0, 1.0]), 30.0, events=top)
    width = np.arccos(0.9999)
    exact = (np.pi / 2 + 2 * np.pi * np.arange(5)[:, None] + [-width, width]).ravel()
    assert sol.t_events[0] == pytest.approx(exact, abs=1e-4)
