"""Changes by events: jumps of y, a past that is forgotten, switches of the right-hand side."""

import numpy as np

from .._checks import complaint, shown
from .status import Status

# Intervals between changes by one event, relative to the run: two in a row below the first, or of
# a step each, or one below the second, mean that they follow each other without end.
_CLOSE, _AT_ONCE = 1e-6, 1e-9


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
        self._signs, self._last = signs, [(-np.inf, np.inf)] * len(functions)
        kinds = {name for f in functions for name in ("change", "forget") if getattr(f, name, None)}
        if signs:
            kinds.add("switch")
        self._close = _CLOSE
        if kinds:
            stepper.expect(kinds)
            self._close = max(_CLOSE, 1.5 * stepper.h / span)
        self._take_sides(events)

    def act(self, output):
        """Do what the events that fired say, and let the run go on.

        Returns status and detail where the run ends by that, else None.
        """
        fired, stuck, before = output.events.fired, output.events.stuck, self._stepper.y
        if stuck in fired and stuck >= len(self._functions):
            return Status.SLIDING, ""
        for number in fired:
            if number < len(self._functions):
                trouble = self._change(number, stuck == number)
                if trouble is not None:
                    return trouble
        output.go_on(bool(np.any(self._stepper.y != before)))
        self._take_sides(output.events)
        failure = output.events.failure
        return (Status.EVENT_FAILED, failure) if failure else None

    def _take_sides(self, events):
        """Let the right-hand side be taken from the present side of each switch."""
        for number, side in zip(self._signs, events.sides(), strict=True):
            self._stepper.set_parameter(number, side)

    def _change(self, number, stuck):
        """Set the y that an event gives, and forget the past where it says so."""
        stepper, function = self._stepper, self._functions[number]
        last, before = self._last[number]
        interval = (stepper.t - last) / self._span
        if stuck or interval <= _AT_ONCE or max(interval, before) <= self._close:
            return Status.PILED_UP, getattr(function, "__name__", repr(function))
        self._last[number] = stepper.t, interval
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
