"""Delays: the solution at an earlier time, which a right-hand side reads.

Compiled code reads it from the steps of the march (compiled/delayed_values.py). The march with
delays is solver/delayed.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..compiled.functions import Functions, with_delays
from ..support.checks import complaint, positional, positive, refuse, shown

# What to do about a delay that touches 0.
TOUCHES = "for a delay that touches 0, take max(tau(t), least) with a least one above 0"


class Delay:
    """The solution at an earlier time, ``y(t - tau)``, for the right-hand side to read.

    Name it in `memory=` of an `Equation`, alone or among other memory: its row of `memory` is
    y(t - tau), shape (d,).

    Parameters
    ----------
    tau : float or callable
        The delay, above 0 [time]; or tau(t), which stays above 0 and grows slower than t. It may
        have corners, and jumps downwards.
    past : float, array_like of shape (d,) or callable, optional
        y before `t_start`: a constant, or past(t), which may have jumps and corners. By default y0.

    Examples
    --------
    A population that reacts late:

    >>> import hereditary as hd
    >>> eq = hd.Equation(
    ...     hd.Caputo(0.9), lambda t, y, late: y * (1 - late[0]), 0.5, memory=hd.Delay(1.0)
    ... )
    >>> hd.solve(eq, 5.0, rtol=1e-8).y[-1].round(6)
    array([0.947702])
    """

    def __init__(self, tau: float | Callable, past: Any = None) -> None:
        _of_time("tau", tau, "delays that depend on y are not covered")
        _of_time("past", past, "close over what else it needs")
        self.tau = tau if callable(tau) else positive("tau", tau)
        self.past = past if callable(past) or past is None else np.array(past)
        if isinstance(self.past, np.ndarray) and self.past.dtype.kind not in "iufc":
            refuse("past", "be numbers or a function of t", repr(past), kind=TypeError)

    def __repr__(self) -> str:
        past = "" if self.past is None else f", past={shown(self.past)}"
        return f"Delay({self.tau!r}{past})"


def _of_time(name: str, given: Any, remedy: str) -> None:
    """Refuse a function of more than the time."""
    names = positional(given)
    if len(names) > 1:
        refuse(name, "be a function of t alone", f"{name}({', '.join(names)})", remedy, TypeError)


class InitialFunction(NamedTuple):
    """The solution before `origin`, the user's start, as a delay reads it."""

    delay: Delay
    values: Callable  # y at n times of the user, (n, d), complex if y is complex
    origin: float
    first: np.ndarray  # y at the time origin - tau, (d,)


class Delayed(NamedTuple):
    """A delay of a system, whose times count from the start."""

    past: InitialFunction
    number: int  # among the delays of the right-hand side

    def ago(self, t: np.ndarray) -> np.ndarray:
        """Return the times t - tau(t), the shape of t."""
        return t - self.taus(t)

    def taus(self, t: np.ndarray) -> np.ndarray:
        """Return tau at times t, the shape of t."""
        return _taus(self.past.delay, t, self.past.origin)

    def before(self, t: np.ndarray) -> np.ndarray:
        """Return y at times t (n,) before the start, as given, in real numbers (n, d)."""
        past = self.past
        if not callable(past.delay.past):
            return np.broadcast_to(past.first.view(float), (t.size, past.first.view(float).size))
        return past.values(past.origin + t).astype(past.first.dtype).view(float)


def _taus(delay: Delay, t: np.ndarray, origin: float) -> np.ndarray:
    """Return tau at times t after `origin`, the user's start; refuse values that are not > 0."""
    tau = delay.tau
    if not callable(tau):
        return np.full(np.shape(t), tau)
    times = (origin + np.ravel(t)).tolist()
    found = np.empty(len(times))
    for i, row in enumerate(_called("tau", tau, times)):
        if not isinstance(row, float):
            array = np.asarray(row)
            if array.size != 1 or array.dtype.kind not in "biuf":
                refuse("tau", "return one number", f"{row!r} at t = {times[i]:g}", kind=TypeError)
            row = array.item()
        found[i] = row
    good = (found > 0) & (found < np.inf)
    if not good.all():
        wrong = int(np.argmin(good))
        refuse("tau", "stay above 0", f"tau({times[wrong]:g}) = {found[wrong]:g}", TOUCHES)
    return found.reshape(np.shape(t))


def _called(name: str, function: Callable, times: list[float]) -> list:
    """Return the values of a user's function at these times."""
    rows = []
    for t in times:
        try:
            rows.append(function(t))
        except Exception as error:
            raise ValueError(complaint(name, f"be defined at t = {t:g}", repr(error))) from error
    return rows


def pasts_of(memory: Sequence[Any], y0: np.ndarray, origin: float) -> list[InitialFunction | None]:
    """Return the past of each delay in `memory`, and None for each other operator."""
    return [_past(part, y0, origin) if isinstance(part, Delay) else None for part in memory]


def _past(delay: Delay, y0: np.ndarray, origin: float) -> InitialFunction:
    """Return the solution before `origin` as `delay` has it; by default it is y0 (d,)."""
    d, given = y0.size, y0 if delay.past is None else delay.past
    kinds = "biufc" if y0.dtype.kind == "c" else "biuf"

    def values(times: np.ndarray) -> np.ndarray:
        rows = _called("past", given, times.tolist()) if callable(given) else [given] * times.size
        found, wrong = np.empty((times.size, d), y0.dtype), -1
        for i, row in enumerate(rows):
            if isinstance(row, float):
                found[i] = row
                continue
            array = np.asarray(row)
            if array.dtype.kind not in kinds or array.size not in (1, d):
                wrong = i
                break
            found[i] = array.ravel()
        if wrong < 0 and not np.isfinite(found).all():
            wrong = int(np.argmin(np.isfinite(found).all(axis=1)))
        if wrong >= 0:
            required = f"be finite at t = {times[wrong]:g}, one number or shape ({d},), real where"
            refuse("past", f"{required} y0 is", shown(rows[wrong]))
        return found

    at = origin - float(_taus(delay, np.zeros(1), origin)[0])
    return InitialFunction(delay, values, origin, values(np.array([at]))[0])


def reading(
    functions: Functions, pasts: Sequence[InitialFunction | None]
) -> tuple[Functions, tuple[Delayed, ...]]:
    """Return functions that read delays, and the delays; `functions` read none."""
    # functions have k rows of memory; pasts: one for each row, None if it remains an unknown
    if not any(pasts):
        return functions, ()
    rows, found = [], list[Delayed]()
    for past in pasts:
        rows.append(len(found) if past else -1)
        if past:
            found.append(Delayed(past, len(found)))
    firsts = np.array([delay.past.first.view(float) for delay in found])
    return with_delays(functions, rows, firsts), tuple(found)
