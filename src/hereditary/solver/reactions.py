"""Changes by events: jumps of y, a past that is forgotten, switches of the right-hand side."""

import numpy as np

from .._checks import complaint, shown
from .status import Status

# Intervals between changes by one event, relative to the longest one: two in a row below the first,
# or of a step each where they were of _STEPS, or one below the second, mean that they follow each
# other without end; so do _MANY changes within a fraction _CROWDED of the run.
# The longest one counts as a fraction _LONG of the run at least.
_CLOSE, _AT_ONCE, _STEPS, _MANY, _CROWDED, _LONG = 1e-6, 1e-9, 100, 10_000, 1e-3, 0.03


class Reactions:
    """Act on a march where an event says so.

    Parameters
    ----------
    stepper : Stepper or AdaptiveStepper
    events : Events
    functions : sequence of callable
        The user's events; `change` and `forget` are attributes of some.
    signs : list of int
        For each switch, which stand behind them, the parameter that is its sign.
    span : float
        Length of the run [time].
    """

    def __init__(self, stepper, events, functions, signs, span):
        self._stepper, self._functions, self._span = stepper, functions, span
        self._signs, self._begun = signs, stepper.t
        self._times: list[list[float]] = [[] for _ in functions]
        self._longest = [0.0 for _ in functions]
        for function in functions:
            change = getattr(function, "change", None)
            if change is not None and not callable(change):
                required = "have a function change(t, y), or none"
                raise TypeError(complaint("events", required, repr(change)))
        kinds = reaction_kinds(functions, signs)
        if kinds:
            stepper.expect(kinds)
        self._take_sides(events)

    def act(self, output):
        """Do what the events that fired say, and let the run go on.

        Returns status and detail where the run ends by that, else None.
        """
        events, before = output.events, self._stepper.y
        fired, stuck = events.fired, events.stuck
        if stuck in fired and stuck >= len(self._functions):
            events.take_back(stuck)
            return Status.SLIDING, ""
        for number in fired:
            if number < len(self._functions):
                if stuck == number or self._piles_up(number):
                    events.take_back(number)
                    return Status.PILED_UP, self._name(number)
                trouble = self._change(number)
                if trouble is not None:
                    return trouble
        output.go_on(before)
        self._take_sides(output.events)
        output.events.leave_switches(self._stepper)
        failure = output.events.failure
        return (Status.EVENT_FAILED, failure) if failure else None

    def _take_sides(self, events):
        """Let the right-hand side be taken from the present side of each switch."""
        for number, side in zip(self._signs, events.sides(), strict=True):
            self._stepper.set_parameter(number, side)

    def _name(self, number):
        """Return the name of an event."""
        return getattr(self._functions[number], "__name__", repr(self._functions[number]))

    def _piles_up(self, number):
        """Note a change by an event; return whether they follow each other without end."""
        times, t = self._times[number], self._stepper.t
        times.append(t)
        first = times[-2] if len(times) > 1 else self._begun
        self._longest[number] = longest = max(self._longest[number], t - first)
        if len(times) < 3:
            return False
        last, before = t - first, first - times[-3]
        h, size = self._stepper.h, max(longest, _LONG * self._span)
        close = max(_CLOSE * size, 1.5 * h if longest > _STEPS * h > 0.0 else 0.0)
        if len(times) > _MANY and t - times.pop(0) <= _CROWDED * self._span:
            return True
        return last <= _AT_ONCE * size or max(last, before) <= close

    def _change(self, number):
        """Set the y that an event gives, and forget the past where it says so."""
        stepper, function = self._stepper, self._functions[number]
        y = stepper.y
        change = getattr(function, "change", None)
        if change is not None:
            try:
                y = _moved(change, stepper)
            except Exception as error:
                return Status.EVENT_FAILED, f"change: {type(error).__name__}: {error}"
        if getattr(function, "forget", False):
            stepper.forget(y)
        else:
            stepper.change(y)
        return None


def _moved(change, stepper):
    """Return the components that ``change(t, y)`` makes of those of a march."""
    frame, inside = stepper.equation.frame, stepper.y
    y = frame.values(inside)
    given = np.asarray(change(stepper.t + frame.start, y.copy()))
    kinds = "biufc" if frame.paired else "biuf"
    if given.shape != y.shape or given.dtype.kind not in kinds or not np.all(np.isfinite(given)):
        required = f"return a new y, finite and of shape {y.shape}"
        raise ValueError(complaint("change", required, shown(given)))
    return frame.moved(inside, given)


def reaction_kinds(functions, switches):
    """Return the kinds of what events and switches do to a run, a set of names."""
    kinds = {name for f in functions for name in ("change", "forget") if getattr(f, name, None)}
    return kinds | {"switch"} if switches else kinds


def check_on_given_steps(kinds, equation):
    """Refuse what events cannot do where steps are given."""
    if "forget" in kinds:
        required, remedy = "forget nothing on given steps", "take rtol= and Collocation"
        raise ValueError(complaint("events", required, "forget", remedy))
    terms = [operator for operator, _ in equation.enlarged.left]
    if "change" in kinds and any(op.derivative == 0 or op.from_zero for op in terms):
        required = "change no y that a kernel or RiemannLiouville acts on, on given steps"
        raise ValueError(complaint("events", required, "a change"))
