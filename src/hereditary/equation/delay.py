"""Delays: the solution at an earlier time, which a right-hand side reads from tables.

A table holds ``y(t - tau(t))`` on an interval of time, as polynomials in t. Compiled code reads it
behind the parameters of the right-hand side. The march fills it in advance (solver/delayed.py).
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from ..compiled.jit import JAC_SIG, RHS_SIG, as_value, compiled, derived
from ..support.checks import complaint, positive, refuse, shown

# Coefficients of a polynomial of a table. Steps of collocation have at most as many.
N_COEFFICIENTS = 10
# Coefficients of a whole table, from which the number of its polynomials follows.
_NUMBERS = 20_000
# Fewest polynomials of a table, also of many components.
_FEWEST = 128
# Most polynomials of a table, also of one component.
_MOST = 2048
# What to do about a delay that touches 0.
TOUCHES = "for a delay that touches 0, take max(tau(t), least) with a least one above 0"
# Numbers at the head of a table: of polynomials that it has, and that it has room for.
_HEAD = 2


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
    try:
        needed = [p for p in inspect.signature(given).parameters.values() if p.default is p.empty]
    except (TypeError, ValueError):  # a number, or a function that does not tell
        return
    names = [p.name for p in needed if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    if len(names) > 1:
        refuse(name, "be a function of t alone", f"{name}({', '.join(names)})", remedy, TypeError)


class Earlier(NamedTuple):
    """The solution before `origin`, the user's start, as a delay reads it.

    - values: y at n times of the user, shape (n, d), complex if y is complex.
    - first: y at the time ``origin - tau``, (d,).
    """

    delay: Delay
    values: Callable
    origin: float
    first: np.ndarray


class Delayed(NamedTuple):
    """A delay of a system, whose times count from the start.

    - past: the delay and the solution before the start.
    - place: index of the parameter at which the table of the delay begins.
    - capacity: polynomials that the table has room for.
    - lift: displacement of the solution before the start, (d,), for neighbouring orbits.
    """

    past: Earlier
    place: int
    capacity: int
    lift: np.ndarray

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

    def lifted(self, lift: np.ndarray, params: np.ndarray) -> Delayed:
        """Return the delay with its past displaced by `lift` (d,); displace its first table too."""
        times, coefficients = self.content(params)
        coefficients[..., 0] += lift
        self.fill(params, times, coefficients)
        return self._replace(lift=self.lift + lift)

    def content(self, params: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return copies of the times and polynomials of the table, as arguments of `fill`."""
        n, first = int(params[self.place]), self.place + _HEAD
        times, first = params[first : first + n + 1].copy(), first + self.capacity + 1
        d = self.past.first.view(float).size
        values = params[first : first + n * d * N_COEFFICIENTS]
        return times, values.reshape(n, d, N_COEFFICIENTS).copy()

    def fill(self, params: np.ndarray, times: np.ndarray, coefficients: np.ndarray) -> None:
        """Write times (n + 1,), and polynomials (n, d, N_COEFFICIENTS) between, into the table."""
        n, first = len(coefficients), self.place + _HEAD
        params[self.place] = n
        params[first : first + n + 1] = times
        first += self.capacity + 1
        params[first : first + coefficients.size] = coefficients.ravel()


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


def pasts_of(memory: Sequence[Any], y0: np.ndarray, origin: float) -> list[Earlier | None]:
    """Return the past of each delay in `memory`, and None for each other operator."""
    return [_past(part, y0, origin) if isinstance(part, Delay) else None for part in memory]


def _past(delay: Delay, y0: np.ndarray, origin: float) -> Earlier:
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
    return Earlier(delay, values, origin, values(np.array([at]))[0])


def reading(
    functions: tuple[np.ndarray, Any, Any], pasts: Sequence[Earlier | None]
) -> tuple[tuple[np.ndarray, Any, Any], tuple[Delayed, ...]]:
    """Return params, right-hand side and Jacobian that read delays from tables, and the delays.

    Parameters
    ----------
    functions : (ndarray, callable, callable or None)
        Parameters, right-hand side and Jacobian, of y and k rows of memory: (1 + k) d components.
    pasts : sequence of length k
        For each row of memory its past if it is a delay. None if the row remains an unknown.
    """
    params, rhs, jac = functions
    firsts = [past.first.view(float) for past in pasts if past]
    d = firsts[0].size
    capacity = int(np.clip(_NUMBERS // (N_COEFFICIENTS * d), _FEWEST, _MOST))
    size = _HEAD + capacity + 1 + capacity * d * N_COEFFICIENTS
    places = np.zeros(len(pasts))
    found: list[Delayed] = []
    for k, past in enumerate(pasts):
        if past:
            places[k] = len(pasts) + len(found) * size
            found.append(Delayed(past, params.size + int(places[k]), capacity, np.zeros(d)))
    tables = np.zeros(len(found) * size)
    tables[1::size] = capacity
    values = np.concatenate([params, places, tables, [len(pasts), d, params.size]])
    for delayed, first in zip(found, firsts, strict=True):
        constant = np.zeros((1, d, N_COEFFICIENTS))
        constant[0, :, 0] = first
        delayed.fill(values, np.array([0.0, 1.0]), constant)
    return (values, _reading(rhs), None if jac is None else _slopes(jac)), tuple(found)


@lru_cache(maxsize=64)
def _reading(rhs: Any) -> Any:
    """Return a right-hand side that reads delayed rows from tables behind the parameters."""

    def read(t: float, x: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
        own = int(params[-1])
        z = _all_rows(t, x, params)
        force = np.empty(z.shape[0])
        rhs(t, z, force, params[:own])
        for c in range(x.shape[0]):
            out[c] = force[c]

    return as_value(derived(read), RHS_SIG)


@lru_cache(maxsize=64)
def _slopes(jac: Any) -> Any:
    """Return the Jacobian of `_reading` with respect to the unknowns, without delayed rows."""

    def read(t: float, x: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
        own, d, k = int(params[-1]), int(params[-2]), int(params[-3])
        z = _all_rows(t, x, params)
        block = np.empty((z.shape[0], z.shape[0]))
        jac(t, z, block, params[:own])
        for i in range(x.shape[0]):
            column = 0
            for row in range(1 + k):
                kept = row == 0 or params[own + row - 1] == 0.0
                for c in range(d if kept else 0):
                    out[i, column] = block[i, row * d + c]
                    column += 1

    return as_value(derived(read), JAC_SIG)


@compiled
def _all_rows(t: float, x: np.ndarray, params: np.ndarray) -> np.ndarray:
    """Return y and all rows of memory, ((1 + k) d,)."""
    own, d, k = int(params[-1]), int(params[-2]), int(params[-3])
    z, column = np.empty((1 + k) * d), d
    for c in range(d):
        z[c] = x[c]
    for row in range(k):
        place, first = int(params[own + row]), (1 + row) * d
        if place == 0:
            for c in range(d):
                z[first + c] = x[column + c]
            column += d
        else:
            _look_up(t, params[own + place :], z[first : first + d])
    return z


@compiled
def _look_up(t: float, table: np.ndarray, out: np.ndarray) -> None:
    """Set out (d,) to the value of a table at time t."""
    n, capacity = int(table[0]), int(table[1])
    times, values = table[2:], table[3 + capacity :]
    low, high = 0, n
    while high - low > 1:
        middle = (low + high) // 2
        if times[middle] <= t:
            low = middle
        else:
            high = middle
    u = 2.0 * (t - times[low]) / (times[low + 1] - times[low]) - 1.0
    u = min(max(u, -1.0), 1.0)
    for c in range(out.shape[0]):
        first = (low * out.shape[0] + c) * N_COEFFICIENTS
        before, last = 0.0, 0.0
        for j in range(N_COEFFICIENTS - 1, 0, -1):
            before, last = last, 2.0 * u * last - before + values[first + j]
        out[c] = u * last - before + values[first]


def _nodes() -> tuple[np.ndarray, np.ndarray]:
    """Return Chebyshev's points in (-1, 1), and the matrix from values there to coefficients."""
    points = np.cos(np.pi * (np.arange(N_COEFFICIENTS) + 0.5) / N_COEFFICIENTS)[::-1]
    return points, np.linalg.inv(chebvander(points, N_COEFFICIENTS - 1))


NODES, TO_COEFFICIENTS = _nodes()
