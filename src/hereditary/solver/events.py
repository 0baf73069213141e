"""Events: times at which functions of the solution vanish."""

import math
import numbers
from functools import partial

import numpy as np

from .._checks import complaint, real, shown
from .._digest import digest
from ..special import bracketed_root
from .ways import TINY, Way, sign_ahead, uncertainty

# Zeros this close to the start, relatively, are the start itself.
_SAME = 1e-12
# Times this close to a start, relatively, tell nothing of a sign there.
_ROUNDED = 64 * np.finfo(float).eps
# Fractions of the first step after a change that are looked at too.
_NEXT = 10.0 ** np.arange(-9, 0)


class Events:
    """Zeros of some functions along a run, located on its dense output.

    Parameters
    ----------
    functions : sequence of callable
        ``event(t, y)``, with the attributes `terminal` (default False: that many zeros end the
        run, True for one) and `direction` (default 0: both; 1 upwards only, -1 downwards only) as
        in SciPy. A number, or a truth value whose changes are sought; NaN where there is none. One
        with `change` or `forget` acts on the march.
    switches : sequence of callable
        Such functions at whose zeros the right-hand side jumps.
    stepper : Stepper or AdaptiveStepper
        Where the run begins.
    signs : dict
        Signs that `signs` gave at the end of the run that this one goes on from.

    Attributes
    ----------
    times, values : list of list
        Zeros of each event, and the solution there.
    failure : str
        How an event function failed; empty where none did.
    fired : dict of int and float
        Events and, behind them, switches that act where the march was ended by `look`, with the
        signs behind their zeros.
    over : bool
        Whether a terminal event ends the run there.
    stuck : int or None
        The one of them whose zero was followed by the next one at once.
    """

    def __init__(self, functions, switches, stepper, signs):
        functions, switches = tuple(functions), tuple(switches)
        self._functions = [*functions, *switches]
        self._looks, self._stands_at = stepper.looks, stepper.stands_at
        # the part of a step in which a solution comes back to a switch at once
        self._at_once = 1.0 if stepper.looks == 1 else 1e-6
        self._limits = [_limit(function) for function in self._functions]
        acting = [getattr(f, "change", None) or getattr(f, "forget", False) for f in functions]
        self._acting = [*map(bool, acting), *(True for _ in switches)]
        self._n_told = len(functions)
        self.times: list[list[float]] = [[] for _ in functions]
        self.values: list[list[np.ndarray]] = [[] for _ in functions]
        self.failure, self._failed_at = "", math.inf
        self.fired: dict[int, float] = {}
        self._last: dict[int, float] = {}
        self._start = stepper.t
        self.over, self.stuck = False, None
        t, y = stepper.t, stepper.y
        values = [_first_value(function, t, y) for function in self._functions]
        self._begin(t, values, [signs.get(digest(f), 0.0) for f in self._functions])

    @property
    def any(self):
        """Whether there is something to look for."""
        return bool(self._functions)

    def begin(self, before, stepper):
        """Go on from where a march stands, whose components, (d,), were `before` until then."""
        t, y = stepper.t, stepper.y
        values, known, ways = [], [], {}
        for number, function in enumerate(self._functions):
            then, now = self._seen(function, [t, t], [before, y]).tolist()
            values.append(now)
            known.append(self._after[number] if now == then else 0.0)
            if number < self._n_told:
                ways[number] = self._way(number, then, now, before, stepper)
        self._begin(t, values, known, ways)

    def _way(self, number, then, now, before, stepper):
        """Return the `Way` of an event that was `then` before a change; None if off its zero.

        Events without changes, too, may have found the zero at which another one acted.
        """
        acted, by_steps = number in self.fired, self._looks == 1
        sign = self.fired[number] if acted else self._after[number]
        if not sign or (by_steps and not acted):
            return None
        value = partial(_value, self._functions[number])
        error = uncertainty(value, stepper)
        if not by_steps:  # these stand at the zero itself
            error = max(error, abs(then))
        if not abs(now) <= error and not (by_steps and now == then):
            return None
        ahead = sign_ahead(value, sign, before, stepper, acted)
        return Way(sign, ahead, now, error, by_steps) if ahead or acted else None

    def _begin(self, t, values, after, ways=None):
        """Begin at time t, where functions have some values; `after` are signs, 0 for unknown.

        `ways` holds the `Way` of each event that has just changed y, or None.
        """
        # the last value seen: a zero between two stretches is then found once, and only once
        earlier = self._last if t == self._start else {}
        self._start, self._values = t, list(values)
        self._last, self.fired = earlier | self.fired, {}
        self._ways = ways or {}
        # switches at which the run begins, which it may yet turn out to leave to the other side
        self._open: set[int] = set()
        for number, (value, sign) in enumerate(zip(self._values, after, strict=True)):
            way = self._ways.get(number)
            if way and way.sign:
                sign = way.sign
            elif number >= self._n_told and value == 0 and not sign:
                self._open.add(number)
                sign = 1.0
            elif value == 0 and not sign and self._looks == 1 and number in self._last:
                sign = -self._last[number]  # a change took it back; steps show no more of it
            # a run that begins at a zero may stand on either side of it by its tolerance
            if sign * np.sign(value) <= 0 and sign:
                self._values[number] = math.copysign(max(abs(value), TINY), sign)
        self._after = [float(np.sign(value)) for value in self._values]
        self._sides = self._after[self._n_told :]

    def leave_switches(self, stepper):
        """Let switches count as on the side that the march goes on from, if f leads away there.

        Errors may put the start on the other side of their zero.
        """
        for number in range(self._n_told, len(self._functions) if self._looks > 1 else 0):
            value, y = partial(_value, self._functions[number]), stepper.y
            side = self._sides[number - self._n_told]
            if number in self._last and sign_ahead(value, side, y, stepper, False) == side:
                error = uncertainty(value, stepper)
                self._ways[number] = Way(side, side, 0.0, error, False)

    def sides(self):
        """Return the sign of each switch from which the march goes on."""
        return self._sides

    def look(self, edges, at):
        """Search between consecutive `edges`; `at(t)` is the solution, (k, d) for k times.

        Returns the time at which the march is to stand where a terminal event, a function that
        fails, or one that acts ends it, or None.
        """
        looks = edges[:-1, None] + np.diff(edges)[:, None] * np.arange(self._looks) / self._looks
        times = np.append(looks.ravel(), edges[-1])
        if edges[0] == self._start and self._last and self._looks > 1:
            # just after a change two zeros may follow each other in any time
            times = np.union1d(times, edges[0] + (edges[1] - edges[0]) * _NEXT)
            near = (times > edges[0]) & (times < edges[0] * (1 + _ROUNDED)) & (times < edges[1])
            times = times[~near]
        rows, found, acting, end = at(times), [], [], math.inf
        at_once = self._start * (1 + _SAME)
        if edges[0] == self._start:
            at_once = max(at_once, self._start + self._at_once * (edges[1] - edges[0]))
        for number, function in enumerate(self._functions):
            values = np.append(self._values[number], self._seen(function, times[1:], rows[1:]))
            way, stuck_at = self._ways.get(number), None
            if way and self._looks > 1 and edges[0] == self._start and way.settle(values):
                stuck_at = self._start
            elif way and way.returning:
                away = way.follow(values)
                stuck_at = None if away is None else float(times[away])
            self._values[number] = values[-1]
            if way and stuck_at is not None:
                self.stuck = number
                acting.append((stuck_at, number, way.before))
                continue
            left = self._limits[number] - self._n_found(number)
            for t, sign in self._zeros(function, times, values, at):
                if self._comes_back(number, t, sign, at_once):
                    self.stuck = number
                    acting.append((self._start, number, sign))
                    break
                if t <= self._start * (1 + _SAME) or (number in self._open and t <= at_once):
                    if number in self._last and (self._looks > 1 or sign != self._last[number]):
                        continue  # where a run goes on from its own event
                    # given steps that end beyond the zero again change there
                    t = float(edges[1]) if number in self._last else self._start
                    if self._n_found(number) and t <= self.times[number][-1] * (1 + _SAME):
                        continue
                if self._acting[number]:  # a step at the very time may be earlier by rounding
                    t = min(t, self._stands_at(t))
                found.append((t, number, sign))
                left -= 1
                if left == 0:
                    end = min(end, t)
                if self._acting[number]:
                    acting.append((t, number, sign))
                if left == 0 or self._acting[number]:
                    break
        end = self._end(end, acting, edges)
        self._keep(sorted(found), min(end, edges[-1]), at)
        return None if end == math.inf else float(end)

    def _comes_back(self, number, t, sign, at_once):
        """Return whether a zero at t is that from which the run has just gone on."""
        if number >= self._n_told:
            return number in self._last and t <= at_once
        again = self._looks > 1 and self._last.get(number) == sign
        return again and t <= self._start * (1 + _SAME)

    def _n_found(self, number):
        """Return how many zeros of a function are known."""
        return len(self.times[number]) if number < self._n_told else 0

    def _end(self, end, acting, edges):
        """Return where the march ends, `end` by a terminal event; acting (time, number, sign)."""
        stands = self._stands_at(min(acting)[0]) if acting else math.inf
        self.over = end < math.inf
        if acting and stands <= (self._stands_at(end) if self.over else end):
            end, self.fired = stands, {number: sign for t, number, sign in acting if t <= stands}
        if self.failure and self._failed_at <= end:  # back to the last step before
            self.fired = {}
            return edges[max(int(np.searchsorted(edges, self._failed_at)) - 1, 0)]
        self.failure = ""
        return end

    def _keep(self, found, end, at):
        """Take in zeros up to `end`, and the signs just after it."""
        row = at(np.array([end]))
        for number, function in enumerate(self._functions if end > self._start else ()):
            self._after[number] = float(np.sign(self._seen(function, [end], row)[0]))
        for number in self.fired:
            if number >= self._n_told:  # whose zero may lie at the end itself
                self._after[number] = -self._sides[number - self._n_told]
        for t, number, sign in reversed(found):
            if t > end:  # the row at the end may show another sign by rounding
                self._after[number] = -sign
        for t, number, sign in found:
            if t <= end and number < self._n_told:
                self.times[number].append(t)
                self.values[number].append(at(np.array([t]))[0])
            if t == end:
                self._after[number] = sign

    def take_back(self, number):
        """Let a run that goes on find the last zero of a function again."""
        self._after[number] = -self.fired[number]

    def signs(self):
        """Signs of the functions where the run ended, just after any zero there, by their digests.

        A run that goes on from there then neither finds such a zero again nor misses another.
        """
        pairs = zip(self._functions, self._after, strict=True)
        return {digest(function): sign for function, sign in pairs if sign in (-1.0, 1.0)}

    def _seen(self, function, times, rows):
        """Values at some times, NaN from the first one on where the function fails."""
        values = np.full(len(times), math.nan)
        try:
            for i, (t, y) in enumerate(zip(times, rows, strict=True)):
                values[i] = _value(function, float(t), y)
        except _Failed as error:
            self._note(error)
        return values

    def _note(self, error):
        """Keep the earliest failure."""
        if error.t < self._failed_at:
            self._failed_at, self.failure = error.t, str(error)

    def _zeros(self, function, times, values, at):
        """Zeros in ascending order, each with the sign after it.

        One at the first time belongs to what was before. Where a value is NaN nothing is known.
        """
        direction, signs = getattr(function, "direction", 0), np.sign(values)
        known = (signs[:-1] != 0) & ~np.isnan(signs[:-1]) & ~np.isnan(signs[1:])
        for i in np.flatnonzero(known & (signs[:-1] != signs[1:])):
            if direction and np.sign(values[i + 1] - values[i]) != np.sign(direction):
                continue
            if signs[i + 1] == 0:
                yield float(times[i + 1]), float(-signs[i])
                continue

            def along(t, i=i):
                # at the ends the signs are known; another rounding must not change them
                if t == times[i] or t == times[i + 1]:
                    return float(values[i] if t == times[i] else values[i + 1])
                value = _value(function, t, at(np.array([t]))[0])
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


class _Undefined(Exception):
    """An event function is NaN between two values of different sign."""


class _Failed(Exception):
    """An event function raised, wrote into y or returned no number, at time t."""

    def __init__(self, function, how, t):
        shown_t = t + getattr(function, "start", 0.0)
        super().__init__(f"{_name(function)} {how} at t = {shown_t:g}")
        self.t = t


def _value(function, t, y):
    """Return the function's value; truth values as 1 and -1."""
    given = y.copy()
    try:
        value = np.asarray(function(t, given))
    except Exception as error:
        raise _Failed(function, f"raised {type(error).__name__}: {error}", t) from error
    if given.tobytes() != y.tobytes():  # an eighth of the time of np.array_equal
        raise _Failed(function, "wrote into y, where only its attribute `change` sets y,", t)
    if value.size != 1 or value.dtype.kind not in "biuf":
        raise _Failed(function, f"returned {shown(value)}", t)
    number = float(value.reshape(()))
    return 2 * number - 1 if value.dtype.kind == "b" else number


def _name(function):
    return getattr(function, "__name__", repr(function))


def _first_value(function, t, y):
    """The function at the start, checked."""
    required = "be functions event(t, y)"
    if not callable(function):
        raise TypeError(complaint("events", required, repr(function)))
    try:
        value = _value(function, t, y)
    except _Failed as error:
        required = "be functions event(t, y) that return one number"
        kind = TypeError if error.__cause__ is not None else ValueError
        raise kind(complaint("events", required, error)) from error
    if not math.isfinite(value):
        got = f"{value} from {_name(function)} at t = {t + getattr(function, 'start', 0.0)}"
        raise ValueError(complaint("events", "be finite at the start", got))
    real("direction", getattr(function, "direction", 0.0))
    return value


def _limit(function):
    """How many zeros end the run."""
    terminal = getattr(function, "terminal", False)
    if terminal is None or isinstance(terminal, (bool, np.bool_)):
        return 1.0 if terminal else math.inf
    if isinstance(terminal, numbers.Integral) and int(terminal) >= 0:
        return float(terminal) or math.inf
    required = "be True, False or the number of zeros that end the run"
    raise ValueError(complaint("terminal", required, f"{terminal!r} of {_name(function)}"))
