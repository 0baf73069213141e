"""Assemble the functions of an equation into a right-hand side and a Jacobian of all components.

A right-hand side may be written ``f(t, y)`` or ``f(t, y, params)``, which return the values, or in
place ``f(t, y, dy, params)``. A Jacobian may be written in the same ways. A function that reads
memory has it as its third argument. In each case the solver receives one compiled function of a
fixed signature. Its argument z contains the d components of y, then the k d values of memory.
"""

import warnings
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from ..compiled.jit import JAC_SIG, RHS_SIG, as_value, derived
from ..support.checks import refuse
from .build import Function, Start, function_of, locked
from .python_calls import Callback, PythonFunctionWarning, before_addresses, in_python


class Functions(NamedTuple):
    """Compiled functions of a system, and their parameters.

    `jac` may be None. If a function is called in Python, the last entries of `params` (p,) are the
    addresses of `callbacks`. The callbacks must stay alive as long as the functions are used.
    """

    rhs: Any
    jac: Any
    params: np.ndarray
    callbacks: tuple


def functions_of(
    rhs: Any,
    jac: Any,
    jac_memory: Any,
    start: Start,
    hint: Callable[[], str],
    shape: tuple[int, ...] | None = None,
) -> Functions:
    """Check the functions of an equation at the start and return them as `Functions`.

    If `rhs` is None, the result has no right-hand side. `jac_memory` returns the derivatives of
    `rhs` by memory. ``hint()`` is appended to messages if `rhs` does not fit y0. `shape` is the
    shape of the values of `jac`, (d, d) by default.
    """
    k, d = start.memory.shape
    shape, n = shape or (d, d), start.components().size
    if start.paired and jac is not None:
        refuse("jac", "be left out for complex y, so that differences are used", repr(jac))
    forces = [] if rhs is None else [function_of("rhs", "dy", rhs, start, (d,), RHS_SIG, hint)]
    if (jac is None) != (jac_memory is None) and (k or jac is None):
        given, lacking = ("jac", "jac_memory") if jac_memory is None else ("jac_memory", "jac")
        required = f"come with {lacking}" if k else "be left out if no memory is read"
        refuse(given, required, "it alone", "leave out both for differences")
    slopes = [] if jac is None else [_jacobian(jac, start, shape)]
    if jac is not None and k:
        beside = function_of("jac_memory", "jacobian", jac_memory, start, (d, k * d), JAC_SIG)
        slopes.append(beside)
    first = _callback("rhs", forces, start, (n,))
    second = _callback("jac", slopes, start, (n, n) if k else shape)
    held = tuple(filter(None, (first, second)))
    addresses = [first.address if first else 0.0, second.address if second else 0.0]
    return Functions(
        in_python(RHS_SIG) if first else _as_one(forces, RHS_SIG, k, held),
        in_python(JAC_SIG) if second else _as_one(slopes, JAC_SIG, k, held),
        np.append(start.params, addresses if held else []),
        held,
    )


def switch_of(switch: Any, y: np.ndarray, t: float) -> Any:
    """Check ``switch(t, y)``, which has one value, at y and t; return it compiled."""
    start = Start(y, np.zeros((0, y.size), y.dtype), np.zeros(0), t)
    required = "be functions switch(t, y) of real components that numba compiles"
    if not callable(switch) or start.paired:
        got = repr(switch) if not start.paired else "complex y"
        refuse("switches", required, got, kind=TypeError)
    how = start, (1,), RHS_SIG, str, required
    return function_of("switches", "value", switch, *how).compiled


def _as_one(parts: list[Function], signature: Any, k: int, called: tuple[Callback, ...]) -> Any:
    """Return one compiled function for all components, or None without `parts`.

    `parts` are the right-hand side, or the Jacobians by y and by memory. The parameters end with
    addresses if `called`, the functions called in Python, are not empty.
    """
    if not parts:
        return None
    one = parts[0].compiled
    if k:
        one = _padded(one, k) if signature is RHS_SIG else _joined(one, parts[1].compiled, k)
        one = as_value(one, signature)
    return before_addresses(one, signature) if called else one


def _jacobian(jac: Any, start: Start, shape: tuple[int, ...]) -> Function:
    """Check a Jacobian and return it as a function that fills a matrix.

    If its values are a vector of k entries, the matrix is a row, (1, k).
    """
    if len(shape) > 1:
        return function_of("jac", "jacobian", jac, start, shape, JAC_SIG)
    with warnings.catch_warnings():  # slow calls matter little: Jacobians serve many steps
        warnings.simplefilter("ignore", PythonFunctionWarning)
        made = function_of("jac", "data", jac, start, shape, RHS_SIG)
    return made._replace(compiled=made.compiled and _as_row(made.compiled))


def _callback(
    name: str, parts: list[Function], start: Start, shape: tuple[int, ...]
) -> Callback | None:
    """Return a callback that fills all values by calling `parts` in Python; None if all compile.

    `shape` is the shape of all values.
    """
    if all(part.compiled for part in parts):
        return None
    n, params = start.components().size, locked(start.params)
    d = n // (1 + len(start.memory))
    if d == n:
        return Callback(name, partial(parts[0].fill, params=params), n, shape)

    def fill_all(t: float, z: np.ndarray, out: np.ndarray) -> None:
        out[d:] = 0.0
        places = [out[:d]] if name == "rhs" else [out[:d, :d], out[:d, d:]]
        for part, place in zip(parts, places, strict=True):
            part.fill(t, z, place, params)

    return Callback(name, fill_all, n, shape)


@lru_cache(maxsize=256)
def _padded(rhs: Any, k: int) -> Any:
    """Return a right-hand side with d + k d values from one with d: values of memory are 0."""

    def all_components(t: float, z: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
        d = z.shape[0] // (1 + k)
        rhs(t, z, out[:d], params)
        for i in range(d, z.shape[0]):
            out[i] = 0.0

    return derived(all_components)


@lru_cache(maxsize=256)
def _joined(jac: Any, beside: Any, k: int) -> Any:
    """Return the Jacobian of `_padded` from those of f by y, (d, d), and by memory, (d, k d)."""

    def all_components(t: float, z: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
        n = z.shape[0]
        d = n // (1 + k)
        by_y, by_memory = np.empty((d, d)), np.empty((d, k * d))
        jac(t, z, by_y, params)
        beside(t, z, by_memory, params)
        for i in range(n):
            for j in range(n):
                if i >= d:
                    out[i, j] = 0.0
                else:
                    out[i, j] = by_y[i, j] if j < d else by_memory[i, j - d]

    return derived(all_components)


@lru_cache(maxsize=64)
def _as_row(values: Any) -> Any:
    """Return a function that fills an array (1, k), from one that fills a vector (k,)."""

    def row(t: float, y: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
        values(t, y, out[0], params)

    return as_value(derived(row), JAC_SIG)
