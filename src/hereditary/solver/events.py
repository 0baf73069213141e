"""Events: times at which functions of the solution vanish."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from ..functions.reads import digest
from ..stepping.stepper import Stepper
from ..stepping.times import together
from ..support.checks import complaint, positional, real, refuse, shown

# The smallest float above 0: with a sign it stands for 0 if only the sign of a value is known.
TINY = 5e-324
# Number of points of each step of `Collocation`, besides its end, at which event functions are
# evaluated. For the event sin 5t in a run of D^0.5 y = -y, rtol 1e-4, 8 points find 159 of 159
# zeros in 96 ms, and 1 point finds 37 in 34 ms.
_EVENT_CHECKS_PER_STEP = 8
# Width of a bracket, relative to the larger bound, at which the search for a zero ends.
_LEAST_BRACKET = 2.0**-60


class Events:
    """Zeros of event functions along a run, located on its dense output."""

    over = interrupted = False  # a terminal event ended the run; continue with a changed y or f

    def __init__(
        self, functions: Iterable[Callable], stepper: Stepper, signs: dict[str, float],
        n_events: int | None = None,
    ) -> None:  # fmt: skip
        # signs: those of the run that is resumed; the solution has the first n_events only
        self._functions, self._on_given_steps = list(functions), stepper.on_given_steps
        self._looks = 1 if stepper.on_given_steps else _EVENT_CHECKS_PER_STEP
        self.n_events = len(self._functions) if n_events is None else n_events
        self._limits = [_limit(function) for function in self._functions]
        self.times: list[list[float]] = [[] for _ in self._functions]
        self.values: list[list[np.ndarray]] = [[] for _ in self._functions]
        self.failure, self._failed_at = "", math.inf
        t, y = stepper.t, stepper.y if self._functions else np.empty(0)
        values = [_first_value(function, t, y) for function in self._functions]
        self._begin(t, values, [signs.get(digest(f), 0.0) for f in self._functions])

    @property
    def any(self) -> bool:
        """Whether there are any event functions."""
        return bool(self._functions)

    def _begin(self, t: float, values: list[float], after: list[float]) -> None:
        """Start the search at t, where functions have these values, with signs `after` it."""
        self._start, self._values = t, list(values)
        for number, (value, sign) in enumerate(zip(values, after, strict=True)):
            # at a zero the computed value may have either sign, so the known sign replaces it
            if sign * np.sign(value) <= 0 and sign:
                self._values[number] = math.copysign(max(abs(value), TINY), sign)
        self._after = [float(np.sign(value)) for value in self._values]

    def look(self, edges: np.ndarray, at: Callable) -> float | None:
        """Search for zeros between ends of steps; return the time at which the run ends."""
        # at(t): the solution (k, d) at k times; None if no terminal event or failure ends the run
        looks = edges[:-1, None] + np.diff(edges)[:, None] * np.arange(self._looks) / self._looks
        times = self._looked_at(np.append(looks.ravel(), edges[-1]), edges)
        rows, found, end = at(times), [], math.inf
        for number, function in enumerate(self._functions):
            values = np.append(self._values[number], self._seen(function, times[1:], rows[1:]))
            left = self._limits[number] - len(self.times[number])
            seen = times, values
            if not self._on_given_steps:
                seen = self._with_turns(function, times, values, at)
            for t, sign in self._zeros_of(number, *seen, at, edges):
                found.append((t, number, sign))
                left -= 1
                if left == 0:
                    end = min(end, t)
                    break
        end = self._end(end, found, edges)
        self._keep(sorted(found), min(end, edges[-1]), at)
        return None if end == math.inf else float(end)

    def _with_turns(
        self, function: Callable, times: np.ndarray, values: np.ndarray, at: Callable
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return times and values, with those where a parabola through three looks reaches 0."""
        a, v, b = values[:-2], values[1:-1], values[2:]
        with np.errstate(all="ignore"):
            turns = (np.sign(a) == np.sign(v)) & (np.sign(b) == np.sign(v))
            turns &= (np.abs(v) < np.abs(a)) & (np.abs(v) < np.abs(b))
        turns &= (times[:-2] < times[1:-1]) & (times[1:-1] < times[2:])
        for i in np.flatnonzero(turns)[::-1]:
            vertex, least = _vertex(times[i : i + 3], values[i : i + 3])
            if least * v[i] < 0.0:
                value = self._seen(function, [vertex], at(np.array([vertex])))[0]
                where = i + 1 + int(vertex > times[i + 1])
                if value * v[i] < 0.0:
                    times, values = np.insert(times, where, vertex), np.insert(values, where, value)
        return times, values

    def _looked_at(self, times: np.ndarray, edges: np.ndarray) -> np.ndarray:
        """Return the times at which functions are evaluated; a subclass may change `times`."""
        return times

    def _zeros_of(
        self, number: int, times: np.ndarray, values: np.ndarray, at: Callable, edges: np.ndarray
    ) -> Iterator[tuple[float, float]]:
        """Yield the times of the zeros of function `number`, each with the sign after it."""
        self._values[number] = values[-1]
        for t, sign in self._zeros(self._functions[number], times, values, at):
            if together(t, self._start) or t < self._start:
                t = self._start
                if self._is_known(number, t):
                    continue
            yield t, sign

    def _is_known(self, number: int, t: float) -> bool:
        """Return whether the last known zero of a function is at t, up to rounding."""
        known = self.times[number]
        return bool(known) and bool(t <= known[-1] or together(t, known[-1]))

    def _end(self, end: float, found: list[tuple[float, int, float]], edges: np.ndarray) -> float:
        """Return the time at which the run ends; `end` is that of a terminal event, or infinite."""
        self.over = end < math.inf
        if self.failure and self._failed_at <= end:  # back to the end of the step before it
            return edges[max(int(np.searchsorted(edges, self._failed_at)) - 1, 0)]
        self.failure = ""
        return end

    def _keep(self, found: list[tuple[float, int, float]], end: float, at: Callable) -> None:
        """Store the zeros up to `end`, and the signs of all functions just after it."""
        row = at(np.array([end]))
        for number, function in enumerate(self._functions if end > self._start else ()):
            self._after[number] = float(np.sign(self._seen(function, [end], row)[0]))
        for t, number, sign in reversed(found):
            if t > end:  # the row at the end may show another sign by rounding
                self._after[number] = -sign
        for t, number, sign in found:
            if t <= end:
                self.times[number].append(t)
                self.values[number].append(at(np.array([t]))[0])
            if t == end:
                self._after[number] = sign

    def signs(self) -> dict[str, float]:
        """Return the sign of each function just after the end of the run, by its digest."""
        # so that a resumed run neither finds a zero at the end again, nor misses a later zero
        pairs = zip(self._functions, self._after, strict=True)
        return {digest(function): sign for function, sign in pairs if sign in (-1.0, 1.0)}

    def _seen(
        self,
        function: Callable,
        times: np.ndarray | list[float],
        rows: np.ndarray | list[np.ndarray],
    ) -> np.ndarray:
        """Return values of a function at several times; NaN from its first failure on."""
        values = np.full(len(times), math.nan)
        try:
            for i, (t, y) in enumerate(zip(times, rows, strict=True)):
                values[i] = value_of(function, float(t), y)
        except _Failed as error:
            self._note(error)
        return values

    def _note(self, error: _Failed) -> None:
        """Store a failure if it is the earliest one."""
        if error.t < self._failed_at:
            self._failed_at, self.failure = error.t, str(error)

    def _zeros(
        self, function: Callable, times: np.ndarray, values: np.ndarray, at: Callable
    ) -> Iterator[tuple[float, float]]:
        """Yield the zeros of a function in ascending order, each with the sign after it."""
        # a zero at the first time belongs to the interval before; next to a NaN no zero is sought
        direction, signs = getattr(function, "direction", 0), np.sign(values)
        known = (signs[:-1] != 0) & ~np.isnan(signs[:-1]) & ~np.isnan(signs[1:])
        for i in np.flatnonzero(known & (signs[:-1] != signs[1:])):
            if direction and np.sign(values[i + 1] - values[i]) != np.sign(direction):
                continue
            if signs[i + 1] == 0:
                yield float(times[i + 1]), float(-signs[i])
                continue

            def along(t: float, i: np.intp = i) -> float:
                # the values at the ends are known; evaluated again, rounding could change their
                # signs
                if t == times[i] or t == times[i + 1]:
                    return float(values[i] if t == times[i] else values[i + 1])
                value = value_of(function, t, at(np.array([t]))[0])
                if math.isnan(value):
                    raise _Undefined
                return value

            try:
                zero = bracketed_root(along, float(times[i]), float(times[i + 1]))
            except _Undefined:
                continue
            except _Failed as error:
                self._note(error)
                return
            yield zero, float(signs[i + 1])


def inner_event(stepper: Stepper, function: Callable) -> Callable:
    """Return an event function of the user as one of times and components of a run."""
    # a function of three arguments gets what the delays of the equation read at its time
    system, delayed = stepper.system, getattr(stepper, "delayed", None)
    needed = positional(function)
    if len(needed) != 3:
        return system.frame.event(function)
    if delayed is None or system.reads:
        required = "be functions event(t, y), or event(t, y, memory) where memory= has delays alone"
        remedy = "name them there"
        if system.reads:
            remedy = "by rtol= let y[1] of an algebraic row 0 = memory[0, 0] - y[1] be the memory, "
            remedy += "with memory=np.array([1, 0]) * term, and let the event read y[1]"
        refuse("events", required, f"{_name(function)}({', '.join(needed)})", remedy, TypeError)
    return system.frame.event(function, delayed)


class _Undefined(Exception):
    """An event function is NaN between two values of different sign."""


class _Failed(Exception):
    """An event function raised, wrote into y or returned no number, at time t."""

    def __init__(self, function: Callable, how: str, t: float) -> None:
        shown_t = t + getattr(function, "start", 0.0)
        super().__init__(f"{_name(function)} {how} at t = {shown_t:g}")
        self.t = t


def value_of(function: Callable, t: float, y: np.ndarray) -> float:
    """Return the function's value as a float: a number, or 1 for True and -1 for False."""
    given = y.copy()
    try:
        value = np.asarray(function(t, given))
    except Exception as error:
        raise _Failed(function, f"raised {type(error).__name__}: {error}", t) from error
    if given.tobytes() != y.tobytes():  # takes an eighth of the time of np.array_equal
        raise _Failed(function, "wrote into y, where only its attribute `change` sets y,", t)
    if value.size != 1 or value.dtype.kind not in "biuf":
        raise _Failed(function, f"returned {shown(value)}", t)
    number = float(value.reshape(()))
    return 2 * number - 1 if value.dtype.kind == "b" else number


def _name(function: Callable) -> str:
    return getattr(function, "__name__", repr(function))


def _first_value(function: Callable, t: float, y: np.ndarray) -> float:
    """Check an event function; return its value at the start of the run."""
    required = "be functions event(t, y)"
    if not callable(function):
        refuse("events", required, repr(function), kind=TypeError)
    try:
        value = value_of(function, t, y)
    except _Failed as error:
        required = "be functions event(t, y) that return one number"
        kind = TypeError if error.__cause__ is not None else ValueError
        raise kind(complaint("events", required, error)) from error
    if not math.isfinite(value):
        got = f"{value} from {_name(function)} at t = {t + getattr(function, 'start', 0.0)}"
        refuse("events", "be finite at the start", got)
    real("direction", getattr(function, "direction", 0.0))
    if getattr(function, "forget", False):
        remedy = "end the run there, and begin another Equation with t_start and the y reached"
        refuse("events", "forget no past", f"forget of {_name(function)}", remedy)
    return value


def _limit(function: Callable) -> float:
    """Return the number of zeros after which the function ends the run; infinite for never."""
    terminal = getattr(function, "terminal", False)
    if terminal is None or isinstance(terminal, (bool, np.bool_)):
        return 1.0 if terminal else math.inf
    if isinstance(terminal, numbers.Integral) and int(terminal) >= 0:
        return float(terminal) or math.inf
    required = "be True, False or the number of zeros that end the run"
    refuse("terminal", required, f"{terminal!r} of {_name(function)}")


def _vertex(times: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Return the time and the value of the vertex of a parabola through three points."""
    (before, t, after), (a, v, b) = times.tolist(), values.tolist()
    left, right = (v - a) / (t - before), (b - v) / (after - t)
    bend = (right - left) / (after - before)
    slope = left + bend * (t - before)
    return t - 0.5 * slope / bend, v - 0.25 * slope**2 / bend


def bracketed_root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return a zero between `low` and `high`, where signs differ, accurate to rounding."""
    # The sign at the zero is 0 or that at `high`. The method is the variant of false position by
    # Anderson and Bjorck, with a bisection whenever three steps have not halved the bracket. To
    # import scipy.optimize instead would take half a second.
    f_low, f_high = function(low), function(high)
    if f_low == 0.0:
        return low
    upward = f_high > 0.0
    width, slow = abs(high - low), 0
    least = _LEAST_BRACKET * max(abs(low), abs(high))  # for a zero near 0
    while f_high != 0.0:
        middle = low + 0.5 * (high - low)
        if middle in (low, high) or abs(high - low) <= least:
            break
        x = high - f_high * (high - low) / (f_high - f_low)
        if slow == 3 or not min(low, high) < x < max(low, high):
            x, slow = middle, 0
        f = function(x)
        if (f > 0.0) != (f_high > 0.0) or f == 0.0:  # products of tiny values are 0
            low, f_low = high, f_high
        else:
            shrink = 1.0 - f / f_high
            f_low *= shrink if shrink > 0.0 else 0.5
        high, f_high = x, f
        halved = abs(high - low) <= 0.5 * width
        width, slow = (abs(high - low), 0) if halved else (width, slow + 1)
    return high if f_high == 0.0 or (f_high > 0.0) == upward else low
