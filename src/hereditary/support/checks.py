"""Checks of arguments, with messages of one form.

Every message names the argument, what was required, what arrived and, if it helps, what to do. An
example is "n_steps must be a positive integer, got 2.5; pass int(n_steps)".
"""

import difflib
import inspect
import math
import numbers
import reprlib
import sys
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from typing import Any, NoReturn, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike

_P = ParamSpec("_P")
_R = TypeVar("_R")

# Least similarity, by difflib, of a string to the name of a class that a message then suggests.
# "explicit" has 0.73 to ExplicitCaputo, and SciPy's "Radau" has 0.6 to Adams. At 1 only names
# written in full would be recognised. It is also the least similarity of a keyword to an argument:
# "nsteps" has 0.92 to n_steps, and "first_step" 0.56 to max_step.
_MIN_SIMILARITY = 0.65
# Integers below this number are counts as they are.
_SMALL = 1 << 53
# Words of a message for an integer above the largest float, which may have thousands of digits.
_NUMBER_ABOVE_FLOATS = "a number beyond 1e308"


def complaint(argument: str, required: str, got: object, remedy: object = "") -> str:
    """Return the sentence of the error for a refused argument."""
    return f"{argument} must {required}, got {got}" + (f"; {remedy}" if remedy else "")


def refuse(
    argument: str, required: str, got: object, remedy: str = "", kind: type[Exception] = ValueError
) -> NoReturn:
    """Raise the error for a refused argument: what it must do, what arrived, what to do."""
    raise kind(complaint(argument, required, got, remedy))


def left_out(reason: str, remedy: str = "", **given: Any) -> None:
    """Refuse each of the arguments `given`, by name, whose value is not None."""
    for name, value in given.items():
        if value is not None:
            refuse(name, f"be left out {reason}", shown(value), remedy)


def refusing(instead: dict[str, str]) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Return a decorator that refuses keywords that a function has no argument for."""
    # a message says what to write `instead`, or names the most similar argument, or the help

    def decorator(function: Callable[_P, _R]) -> Callable[_P, _R]:
        parameters, called = list(inspect.signature(function).parameters), function.__name__

        @wraps(function)
        def checked(*args: _P.args, **keywords: _P.kwargs) -> _R:
            for name in [name for name in keywords if name not in parameters]:
                similar = difflib.get_close_matches(name, parameters, n=1, cutoff=_MIN_SIMILARITY)
                default = f"write {similar[0]}=" if similar else f"see help(hereditary.{called})"
                required, got = f"be left out of {called}", reprlib.repr(keywords[name])
                refuse(name, required, got, instead.get(name, default), kind=TypeError)
            return function(*args, **keywords)

        return checked

    return decorator


def shown(array: ArrayLike) -> str:
    """Return a short text of an array, for a message."""
    return np.array2string(np.asarray(array), separator=", ", threshold=8, edgeitems=3)


def real(
    argument: str, value: Any, required: str = "be a finite real number", remedy: str = ""
) -> float:
    """Return `value` as a finite float, or refuse it."""
    if type(value) is float and math.isfinite(value):  # nearly all; the other checks take 1 us
        return value
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (numbers.Real, np.ndarray)):
        refuse(argument, required, repr(value), remedy, kind=TypeError)
    if isinstance(value, np.ndarray) and (value.ndim or value.dtype.kind not in "iuf"):
        refuse(argument, required, f"an array {value!r}", remedy, kind=TypeError)
    try:
        number = float(value)
    except OverflowError as error:
        raise ValueError(complaint(argument, required, _NUMBER_ABOVE_FLOATS, remedy)) from error
    if not math.isfinite(number):
        refuse(argument, required, number, remedy)
    return number


def positive(argument: str, value: Any, remedy: str = "") -> float:
    """Return `value` as a finite float above zero."""
    number = real(argument, value, "be a finite number above 0", remedy)
    if number <= 0:
        refuse(argument, "be a finite number above 0", number, remedy)
    return number


def within(
    argument: str, value: Any, low: float, high: float, interval: str, remedy: str = ""
) -> float:
    """Return `value` as a float with low <= value <= high; messages name the range `interval`."""
    required = f"lie in {interval}"
    number = real(argument, value, required, remedy)
    if not low <= number <= high:
        refuse(argument, required, number, remedy)
    return number


def count(
    argument: str, value: Any, remedy: str = "pass a whole number of at least 1", least: int = 1
) -> int:
    """Return `value` as an int of at least `least`, 1 or 0."""
    if type(value) is int and least <= value < _SMALL:
        return value
    required = "be a positive integer" if least else "be an integer of at least 0"
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, numbers.Integral):
        refuse(argument, required, repr(value), remedy, kind=TypeError)
    if abs(int(value)) > sys.float_info.max:
        refuse(argument, required, _NUMBER_ABOVE_FLOATS, remedy)
    if value < least:
        refuse(argument, required, int(value), remedy)
    return int(value)


def one_of(
    argument: str, value: Any, options: Iterable[Any], required: str, remedy: str = "",
    kind: type[Exception] = ValueError,
) -> Any:  # fmt: skip
    """Return the option that `value` is or equals, or refuse it; an array equals no option."""
    for option in options:
        if value is option or (np.isscalar(value) and value == option):
            return option
    raise kind(complaint(argument, required, reprlib.repr(value), remedy))


def truth(argument: str, value: Any) -> bool:
    """Return `value` as a bool if it is True, False, 1 or 0; refuse anything else."""
    if value is True or value is False:
        return value
    return one_of(argument, value, (True, False), "be True or False", kind=TypeError)


def function(argument: str, value: Any, call: str) -> Callable[..., Any]:
    """Return `value` if it is callable, or refuse it; messages show its arguments by `call`."""
    if not callable(value):
        refuse(argument, f"be a function {call}", reprlib.repr(value), kind=TypeError)
    return value


def positional(function: Any) -> list[str]:
    """Return the names of arguments that a function needs by position; none if it tells none."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return []
    needed = [p for p in parameters if p.default is p.empty]
    return [p.name for p in needed if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]


def callable_with(
    function: Callable[..., Any], required: str, argument: str, got: str, *values: Any, **named: Any
) -> None:
    """Refuse an argument that a function cannot be called with: these values, and named ones."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # some built-in functions have none
        return
    try:
        signature.bind(*values, **named)
    except TypeError as error:
        raise TypeError(complaint(argument, f"{required}{signature}", got, error)) from error


def mapping(argument: str, value: Any, required: str) -> Mapping[Any, Any]:
    """Return `value` if it is a mapping, or refuse it."""
    if not isinstance(value, Mapping):
        refuse(argument, required, reprlib.repr(value), kind=TypeError)
    return value


def whole(value: Any) -> Any:
    """Return a float with an integer value, such as ``1e3``, as an int; other values unchanged."""
    is_float = isinstance(value, (float, np.floating))
    return int(value) if is_float and float(value).is_integer() else value


def refuse_masked(argument: str, value: Any, required: str = "be real, finite numbers") -> None:
    """Refuse masked entries, because NumPy reads the numbers under a mask."""
    for array in value if isinstance(value, (list, tuple)) else (value,):
        if isinstance(array, np.ma.MaskedArray) and np.ma.is_masked(array):
            remedy = "leave these entries out, or fill them with .filled(...)"
            refuse(argument, required, "masked entries", remedy)


def real_array(
    argument: str, value: Any, required: str = "be real, finite numbers", remedy: str = ""
) -> np.ndarray:
    """Return `value` as a float64 array of finite entries (a copy, C order)."""
    if type(value) is float and math.isfinite(value):  # very often; the other checks take 2 us
        return np.array(value)
    refuse_masked(argument, value, required)
    try:
        array = np.array(value)
    except (TypeError, ValueError) as error:
        raise TypeError(complaint(argument, required, repr(value), remedy)) from error
    if array.dtype.kind not in "iuf":
        got = f"{reprlib.repr(value)} of dtype {array.dtype}"
        refuse(argument, required, got, remedy, kind=TypeError)
    if not np.isfinite(array).all():
        refuse(argument, required, shown(array), remedy)
    return array.astype(float, order="C", copy=False)


def instance(argument: str, value: Any, kind: type, example: str) -> Any:
    """Return `value` if it is an instance of `kind`, or refuse it; messages suggest `example`."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIO" else "a"
        got, remedy = repr(value), f"pass {example}"
        if isinstance(value, type) and issubclass(value, kind):
            got, remedy = f"the class {value.__name__}", f"write {value.__name__}(...)"
        elif isinstance(value, str):
            remedy = _call_named(value, kind) or remedy
        refuse(argument, f"be {article} {kind.__name__}", got, remedy, kind=TypeError)
    return value


def _call_named(name: str, kind: type) -> str:
    """Return a remedy that suggests the subclass of `kind` with the most similar name; or ""."""
    classes = [kind]
    for one in classes:
        classes += one.__subclasses__()
    package = __name__.split(".")[0] + "."
    by_name = {c.__name__.lower(): c for c in classes if c.__module__.startswith(package)}
    similar = difflib.get_close_matches(name.lower(), by_name, n=1, cutoff=_MIN_SIMILARITY)
    if not similar:
        return ""
    cls = by_name[similar[0]]
    needed = [p for p in inspect.signature(cls).parameters.values() if p.default is p.empty]
    return f"write hd.{cls.__name__}({'...' if needed else ''})"


def component_numbers(components: Any, d: int, argument: str = "components") -> np.ndarray:
    """Return numbers of components, 0 to d - 1, as an array; refuse anything else."""
    refuse_masked(argument, components, "be whole numbers")
    indices = np.atleast_1d(np.asarray(components))
    whole = indices.ndim == 1 and indices.size and indices.dtype.kind in "iu"
    if not whole or np.any(indices < 0) or np.any(indices >= d):
        refuse(argument, f"be numbers of components, 0 to {d - 1}", shown(components))
    return indices.astype(np.int64)
