"""Assemble the functions of an equation into a right-hand side and a Jacobian of all components.

A right-hand side may be written ``f(t, y)`` or ``f(t, y, params)``, which return the values, or in
place ``f(t, y, dy, params)``. A Jacobian may be written in the same ways. A function that reads
memory has it as its third argument. Each function becomes a field of one record, `Functions`. All
fields have one list of arguments, for real and complex components, with and without memory.
"""

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..compiled.functions import (
    BY_DIFFERENCES,
    GIVEN,
    OF_MEMORY,
    OF_Y,
    Functions,
    of_user,
)
from ..support.checks import positional, refuse
from .build import Function, Start, function_of, locked
from .python_calls import Callback, PythonFunctionWarning


class Assembled(NamedTuple):
    """The record of a system's functions, and the callbacks into Python whose addresses it has.

    The callbacks must stay alive as long as the record is used.
    """

    functions: Functions
    callbacks: tuple[Callback, ...]


def functions_of(
    rhs: Any,
    jac: Any,
    jac_memory: Any,
    start: Start,
    hint: Callable[[], str],
    shape: tuple[int, ...] | None = None,
) -> Assembled:
    """Check the functions of an equation at the start and return their record as `Assembled`.

    If `rhs` is None, it is 0 and its Jacobian too. `jac_memory` returns the derivatives of `rhs` by
    memory. ``hint()`` is appended to messages if `rhs` does not fit y0. `shape` is the shape of the
    values of `jac`, (d, d) by default.
    """
    k, d = start.memory.shape
    shape = shape or (d, d)
    if start.paired and jac is not None:
        refuse("jac", "be left out for complex y, so that differences are used", repr(jac))
    fields: dict[str, Any] = {}
    parts: list[tuple[str, Function, tuple[int, ...]]] = []
    if rhs is not None:
        found = function_of("rhs", "dy", rhs, start, (d,), hint)
        parts.append(("rhs", found, (start.y.view(float).size,)))
        fields = {"form": OF_MEMORY if k else OF_Y, "jac_form": BY_DIFFERENCES}
    if (jac is None) != (jac_memory is None) and (k or jac is None):
        given, lacking = ("jac", "jac_memory") if jac_memory is None else ("jac_memory", "jac")
        required = f"come with {lacking}" if k else "be left out if no memory is read"
        refuse(given, required, "it alone", "leave out both for differences")
    if jac is not None:
        parts.append(("jac", _jacobian(jac, start, shape), shape))
        fields |= {"jac_form": GIVEN, "jac_size": int(np.prod(shape))}
    if jac is not None and k:
        by_memory = d, k * d
        found = function_of("jac_memory", "jacobian", jac_memory, start, by_memory)
        parts.append(("jac_memory", found, by_memory))
    addresses, callbacks = np.zeros(3, dtype=np.int64), []
    for number, (name, function, values) in enumerate(parts):
        if function.compiled:
            fields[name] = function.compiled
            continue
        fill = partial(function.fill, params=locked(start.params))
        made = Callback(name, fill, start.components().size, values)
        addresses[number] = made.address
        callbacks.append(made)
    functions = of_user(start.params, start.y.view(float).size, in_python=addresses, **fields)
    return Assembled(functions, tuple(callbacks))


def switch_of(switch: Any, y: np.ndarray, t: float) -> Any:
    """Check ``switch(t, y)``, which has one value, at y and t; return it compiled."""
    start = Start(y, np.zeros((0, y.size), y.dtype), np.zeros(0), t)
    required = "be functions switch(t, y) of real components that numba compiles"
    if len(positional(switch)) == 3:
        remedy = "an event(t, y, memory) may change a component, constant else, that rhs reads"
        refuse("switches", "be functions switch(t, y)", repr(switch), remedy, kind=TypeError)
    if not callable(switch) or start.paired:
        got = repr(switch) if not start.paired else "complex y"
        refuse("switches", required, got, kind=TypeError)
    return function_of("switches", "value", switch, start, (1,), str, required).compiled


def _jacobian(jac: Any, start: Start, shape: tuple[int, ...]) -> Function:
    """Check a Jacobian, whose values are a matrix, or a vector of entries."""
    if len(shape) > 1:
        return function_of("jac", "jacobian", jac, start, shape)
    with warnings.catch_warnings():  # slow calls matter little: Jacobians serve many steps
        warnings.simplefilter("ignore", PythonFunctionWarning)
        return function_of("jac", "data", jac, start, shape)
