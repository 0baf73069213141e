"""Users' functions: how they are written, and two calls of each in Python at the start."""

import inspect
from typing import NamedTuple

import numpy as np

from ..support.checks import complaint, shown
from .messages import defined, line_of


class Start(NamedTuple):
    """Arguments that functions are tried with: y (d,), memory (k, d), params (p,) and the time t.

    y and memory may be complex.
    """

    y: np.ndarray
    memory: np.ndarray
    params: np.ndarray
    t: float = 0.0

    @property
    def paired(self):
        """Whether components are complex, two real ones of a system each."""
        return self.y.dtype.kind == "c"

    def components(self):
        """Return y and memory as the real components of one system."""
        return np.concatenate([self.y, self.memory.ravel()]).view(float)

    def named(self):
        """Name the arguments in front of params."""
        return "t, y, memory" if len(self.memory) else "t, y"

    def shapes(self, name, out):
        """Name the ways in which a function may be written."""
        first = self.named()
        return (
            f"{name}({first}), {name}({first}, params) or, in place, {name}({first}, {out}, params)"
        )


def arity_of(name, out, fun, start):
    """Return the number of positional arguments besides memory: 2, 3 or 4."""
    required = f"be one of {start.shapes(name, out)}"
    more = int(len(start.memory) > 0)
    try:
        signature = inspect.signature(fun)
    except (TypeError, ValueError) as error:
        raise TypeError(complaint(name, required, repr(fun), "write it with def")) from error
    got, parameters = f"{getattr(fun, '__name__', fun)}{signature}", signature.parameters.values()
    positional = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    fixed = [p for p in parameters if p.kind is p.KEYWORD_ONLY and p.default is not p.empty]
    known = len(positional) + len(fixed) == len(parameters)
    if not known or len(positional) - more not in (2, 3, 4):
        raise TypeError(complaint(name, required, got, "pass constants through params"))
    if positional[1].name in ("t", "time"):
        raise TypeError(complaint(name, "take t first and y second", got, defined(fun)))
    if more and positional[2].name in ("p", "params", "dy", "jacobian"):
        reason = f"equations with memory= pass it there, {defined(fun)}"
        raise TypeError(complaint(name, "take memory third", got, reason))
    return len(positional) - more


def try_out(name, out, fun, arity, start, shape, hint):
    """Call `fun` twice in Python at the start, check its values and return them and their form."""
    # other values at first in place show entries that are not set
    (values, form), (again, _) = (
        _values(name, out, fun, arity, start, shape, hint, unset) for unset in (np.nan, 0.5)
    )
    unset = np.isnan(values) & (again == 0.5)
    if arity == 4 and unset.any():
        got = f"entries {np.argwhere(unset).tolist()} left unset"
        raise ValueError(complaint(name, f"set every entry of {out}", got, defined(fun)))
    if not np.all(np.isfinite(values)):
        remedy = f"check y0 = {shown(start.y)} and params = {shown(start.params)}, {defined(fun)}"
        raise ValueError(complaint(name, f"be finite at t = {start.t:g}", shown(values), remedy))
    if not close(again, values):
        got = f"{shown(values)} and then {shown(again)}"
        remedy = f"take no random numbers and keep no state, {defined(fun)}"
        raise ValueError(complaint(name, "give equal values for equal t, y", got, remedy))
    return values, form


def close(values, expected):
    """Return whether values agree to 1e-8."""
    if np.array_equal(values, expected):  # in a tenth of the time
        return True
    return np.allclose(values, expected, rtol=1e-8, atol=1e-12 * np.abs(expected).max(initial=0.0))


def _values(name, out, fun, arity, start, shape, hint, unset):
    """Call `fun` at the start; return its values as an array of `shape`, and their form."""
    filled = np.full(shape, unset, start.y.dtype)
    y, memory, p = (part.copy() for part in start[:3])
    first = (start.t, y, memory) if len(memory) else (start.t, y)
    arguments = {2: first, 3: (*first, p), 4: (*first, filled, p)}

    def hinted():
        if arity < 4:
            return hint()
        words = ("five", "fourth", "fifth") if len(memory) else ("four", "third", "fourth")
        more = "; with {} arguments the {} is {out}, to be filled, and the {} params"
        return hint() + more.format(*words, out=out)

    try:
        with np.errstate(all="ignore"):  # values that are not finite are reported below
            result = fun(*arguments[arity])
    except Exception as error:
        raise ValueError(
            f"{name} must run at t = {start.t:g}, got {type(error).__name__}: {error} "
            f"{line_of(error, fun)}; it was called with y = {shown(start.y)} and params = "
            f"{shown(start.params)}{hinted()}"
        ) from error
    for argument, given, left in zip(start._fields, start, (y, memory, p), strict=False):
        if not np.array_equal(given, left):
            got = f"{shown(given)} changed to {shown(left)}"
            remedy = f"work on a copy, {defined(fun)}"
            raise ValueError(complaint(name, f"leave {argument} as it is", got, remedy))
    if arity == 4:
        if result is not None:
            remedy = f"leave {out} out of the arguments to return values, {defined(fun)}{hinted()}"
            raise TypeError(complaint(name, f"fill {out} and return None", repr(result), remedy))
        return filled, "in place"
    values = numbers_of(name, fun, result, shape, start)
    if values.shape != shape and not (values.ndim == 0 and np.prod(shape) == 1):
        size = f"shape {shape}" + (" or a number" if np.prod(shape) == 1 else "")
        got, remedy = f"shape {values.shape}", _remedy(fun, shape) + hinted()
        raise ValueError(complaint(name, f"return {size}", got, remedy))
    form = "array" if values.ndim else "number"
    return values.astype(start.y.dtype).reshape(shape), form


def numbers_of(name, fun, returned, shape, start):
    """Return what a function returned as an array; refuse anything but numbers."""
    try:
        values = np.asarray(returned)
    except ValueError:  # rows of unequal length
        values = np.asarray(None)
    if values.dtype.kind in ("biufc" if start.paired else "biuf"):
        return values
    required = "return numbers" if start.paired else "return real numbers"
    complex_remedy = "give y0 complex numbers for a complex solution"
    remedy = complex_remedy if values.dtype.kind == "c" else _remedy(fun, shape)
    raise TypeError(complaint(name, required, repr(returned), remedy))


def _remedy(fun, shape):
    """Say what a function should return."""
    return f"return numpy.array([...]) of shape {shape}, {defined(fun)}"
