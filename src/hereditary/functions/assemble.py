"""Assemble the functions of an equation into a right-hand side and a Jacobian of all components.

A right-hand side may be written ``f(t, y)`` or ``f(t, y, params)``, which return the values, or in
place ``f(t, y, dy, params)``. A Jacobian may be written in the same ways. A function that reads
memory has it as its third argument. Each function becomes a field of one record, `Functions`, which
calls it by its own arguments.
"""

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..compiled.functions import (
    A_MATRIX,
    BY_DIFFERENCES,
    COMPLEX,
    COMPLEX_READING,
    ENTRIES,
    IN_PYTHON,
    IN_TWO_PARTS,
    JAC_IN_PYTHON,
    READING,
    REAL,
    Functions,
    of_user,
)
from ..compiled.jit import (
    COMPLEX_MEMORY_RHS_SIG,
    COMPLEX_RHS_SIG,
    JAC_SIG,
    MEMORY_JAC_SIG,
    MEMORY_RHS_SIG,
    RHS_SIG,
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
    parts: list[_Part] = []
    if rhs is not None:
        name, form, signature = _FORMS[k > 0, start.paired]
        found = function_of("rhs", "dy", rhs, start, (d,), signature, hint)
        values = (start.y.view(float).size,)
        parts.append(_Part("rhs", found, name, {"form": form}, {"form": IN_PYTHON}, values))
        fields = {"jac_form": BY_DIFFERENCES}
    if (jac is None) != (jac_memory is None) and (k or jac is None):
        given, lacking = ("jac", "jac_memory") if jac_memory is None else ("jac_memory", "jac")
        required = f"come with {lacking}" if k else "be left out if no memory is read"
        refuse(given, required, "it alone", "leave out both for differences")
    if jac is not None:
        parts.append(_jacobian(jac, start, shape))
        rows, columns = shape if len(shape) > 1 else (1, *shape)
        fields |= {"jac_rows": rows, "jac_columns": columns}
    if jac is not None and k:
        by_memory = d, k * d
        found = function_of("jac_memory", "jacobian", jac_memory, start, by_memory, MEMORY_JAC_SIG)
        parts.append(_Part("jac_memory", found, "jac_memory", {}, {}, by_memory))
    addresses, callbacks = np.zeros(3, dtype=np.int64), []
    for number, part in enumerate(parts):
        if part.function.compiled:
            fields |= part.compiled | {part.field: part.function.compiled}
            continue
        fill = partial(part.function.fill, params=locked(start.params))
        made = Callback(part.name, fill, start.components().size, part.shape)
        addresses[number] = made.address
        callbacks.append(made)
        fields |= part.in_python
    functions = of_user(start.params, start.y.view(float).size, in_python=addresses, **fields)
    return Assembled(functions, tuple(callbacks))


class _Part(NamedTuple):
    """One function of a user, and what the record has of it."""

    name: str  # argument of the equation, for messages
    function: Function
    field: str  # its field in `Functions`
    compiled: dict[str, int]  # further fields of the record, if it is compiled
    in_python: dict[str, int]  # further fields of the record, if it is called in Python
    shape: tuple[int, ...]  # that of its values, in real numbers


# Field, form and signature of a right-hand side, by whether it reads memory and is complex.
_FORMS = {
    (False, False): ("rhs", REAL, RHS_SIG),
    (True, False): ("reading", READING, MEMORY_RHS_SIG),
    (False, True): ("complex", COMPLEX, COMPLEX_RHS_SIG),
    (True, True): ("complex_reading", COMPLEX_READING, COMPLEX_MEMORY_RHS_SIG),
}


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
    return function_of("switches", "value", switch, start, (1,), RHS_SIG, str, required).compiled


def _jacobian(jac: Any, start: Start, shape: tuple[int, ...]) -> _Part:
    """Check a Jacobian, whose values are a matrix, or a vector of entries."""
    called = {"jac_form": JAC_IN_PYTHON}
    if len(shape) > 1:
        field, form, signature = "jac", A_MATRIX, JAC_SIG
        if len(start.memory):
            field, form, signature = "jac_reading", IN_TWO_PARTS, MEMORY_JAC_SIG
        made = function_of("jac", "jacobian", jac, start, shape, signature)
        return _Part("jac", made, field, {"jac_form": form}, called, shape)
    with warnings.catch_warnings():  # slow calls matter little: Jacobians serve many steps
        warnings.simplefilter("ignore", PythonFunctionWarning)
        made = function_of("jac", "data", jac, start, shape, RHS_SIG)
    return _Part("jac", made, "jac_entries", {"jac_form": ENTRIES}, called, shape)
