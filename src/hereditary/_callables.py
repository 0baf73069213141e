"""Users' functions: told apart by arity, tried once, compiled once (floor 1).

A right-hand side may be written ``f(t, y)``, ``f(t, y, params)`` (both return the values) or in
place ``f(t, y, dy, params)``; a Jacobian likewise. Whatever its shape, the solver sees one
compiled function of one fixed signature. The function is first called once as plain Python, so
that a mistake surfaces with its own line instead of as a compiler's message.
"""

import inspect
import linecache
import re
import threading
import traceback
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
from numba import config, njit
from numba.extending import is_jitted

from ._checks import complaint, shown
from ._jit import JAC_SIG, RHS_SIG, as_value

_SHAPES = "{0}(t, y), {0}(t, y, params) or, in place, {0}(t, y, {1}, params)"
_COMPILED_MAX = 256
_compiled: OrderedDict[tuple, Any] = OrderedDict()
_lock = threading.Lock()


def compile_rhs(fun, y0, params):
    """Check `fun` at t = 0 and return it compiled as ``rhs(t, y, dy, params)``."""
    return _compile("rhs", "dy", fun, y0, params, (y0.size,), RHS_SIG)


def compile_jac(fun, y0, params):
    """Check `fun` at t = 0 and return it compiled as ``jac(t, y, jacobian, params)``."""
    return _compile("jac", "jacobian", fun, y0, params, (y0.size, y0.size), JAC_SIG)


def _compile(name, out, fun, y0, params, shape, signature):
    plain = fun.py_func if is_jitted(fun) else fun
    if not inspect.isfunction(plain):
        required = f"be a function {_SHAPES.format(name, out)}"
        remedy = "write it with def or lambda and pass constants through params"
        raise TypeError(complaint(name, required, repr(fun), remedy))
    arity = _arity(name, out, plain)
    values, form = _try_out(name, out, plain, arity, y0, params, shape)
    key = (fun, _frozen_values(plain), arity, form, signature)
    with _lock:
        if key not in _compiled:
            # a dispatcher that was compiled before keeps the values it saw then
            used = any(other[0] is fun for other in _compiled)
            source = plain if used or not getattr(fun, "_can_compile", True) else fun
            _compiled[key] = _build(name, source, arity, form, len(shape), signature)
            while len(_compiled) > _COMPILED_MAX:
                _compiled.popitem(last=False)
        _compiled.move_to_end(key)
        compiled = _compiled[key]
    _compare(name, compiled, values, y0, params)
    return compiled


def _compare(name, compiled, values, y0, params):
    """Refuse a function that gives something else compiled than in Python."""
    again = np.empty_like(values)
    compiled(0.0, y0.copy(), again, params.copy())
    if not np.allclose(again, values, rtol=1e-8, atol=1e-12 * np.abs(values).max()):
        raise ValueError(
            complaint(
                name,
                "give the same numbers compiled as in Python",
                f"{shown(again)} and {shown(values)} at t = 0",
                "write 1.0 for 1 where whole numbers are divided, raised or grow large",
            )
        )


def _arity(name, out, fun):
    """Number of positional arguments: 2, 3 or 4."""
    required = f"be one of {_SHAPES.format(name, out)}"
    try:
        parameters = inspect.signature(fun).parameters.values()
    except (TypeError, ValueError) as error:
        raise TypeError(complaint(name, required, repr(fun), "write it with def")) from error
    positional = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    if len(positional) != len(parameters) or len(positional) not in (2, 3, 4):
        got = f"{getattr(fun, '__name__', fun)}{inspect.signature(fun)}"
        raise TypeError(complaint(name, required, got, "pass constants through params"))
    return len(positional)


def _try_out(name, out, fun, arity, y0, params, shape):
    """Call `fun` once in Python at t = 0 and check what it gives; return that and its form."""
    filled, form = _values(name, out, fun, arity, y0, params, shape, np.nan)
    if np.all(np.isfinite(filled)):
        return filled, form
    if arity == 4:
        again, _ = _values(name, out, fun, arity, y0, params, shape, 0.5)
        unset = np.isnan(filled) & (again == 0.5)
        if unset.any():
            got = f"entries {np.argwhere(unset).tolist()} left unset"
            raise ValueError(complaint(name, f"set every entry of {out}", got, _defined(fun)))
    remedy = f"check y0 = {shown(y0)} and params = {shown(params)}, {_defined(fun)}"
    raise ValueError(complaint(name, "be finite at t = 0", shown(filled), remedy))


def _values(name, out, fun, arity, y0, params, shape, fill):
    """What `fun` gives at t = 0 as an array of `shape`, and in which form."""
    filled = np.full(shape, fill)  # what an in-place function leaves unset stays recognisable
    y, p = y0.copy(), params.copy()
    arguments = {2: (0.0, y), 3: (0.0, y, p), 4: (0.0, y, filled, p)}
    try:
        result = fun(*arguments[arity])
    except Exception as error:
        raise ValueError(
            f"{name} must run at t = 0, got {type(error).__name__}: {error} {_line_of(error, fun)};"
            f" it was called with y = {shown(y0)} and params = {shown(params)}"
        ) from error
    for argument, given, left in (("y", y0, y), ("params", params, p)):
        if not np.array_equal(given, left):
            got = f"{shown(given)} changed to {shown(left)}"
            remedy = f"work on a copy, {_defined(fun)}"
            raise ValueError(complaint(name, f"leave {argument} as it is", got, remedy))
    if arity == 4:
        if result is not None:
            remedy = f"fill {out} in place or leave it out of the arguments, {_defined(fun)}"
            raise TypeError(complaint(name, f"fill {out} and return None", repr(result), remedy))
        return filled, "in place"
    remedy = f"return numpy.array([...]) of shape {shape}, {_defined(fun)}"
    try:
        values = np.asarray(result)
    except ValueError:  # rows of unequal length
        values = np.asarray(None)
    if values.dtype.kind not in "biuf":
        raise TypeError(complaint(name, "return real numbers", repr(result), remedy))
    if values.shape != shape and not (values.ndim == 0 and np.prod(shape) == 1):
        size = f"shape {shape}" + (" or a number" if np.prod(shape) == 1 else "")
        raise ValueError(complaint(name, f"return {size}", f"shape {values.shape}", remedy))
    form = "array" if values.ndim else "number"
    return values.astype(float).reshape(shape), form


def _defined(fun):
    """Where a function begins, in a clause."""
    return f"in the function at line {fun.__code__.co_firstlineno} of {fun.__code__.co_filename}"


def _line_of(error, fun):
    """Where in the user's function an exception came from."""
    frames = [
        f
        for f in traceback.extract_tb(error.__traceback__)
        if f.filename == fun.__code__.co_filename
    ]
    if not frames:
        return ""
    return f'at line {frames[-1].lineno} of {frames[-1].filename}: "{frames[-1].line}"'


def _frozen_values(fun):
    """The globals and closure values that compilation freezes into `fun`.

    They belong to the cache key: after ``b = 2`` the function is another one.
    """
    cells = [cell.cell_contents for cell in fun.__closure__ or ()]
    names = set(_names(fun.__code__))
    held = [fun.__globals__[name] for name in sorted(names & fun.__globals__.keys())]
    for module in [value for value in cells + held if inspect.ismodule(value)]:
        held += [vars(module)[name] for name in sorted(names & vars(module).keys())]
    return tuple(_identity(value) for value in cells + held)


def _names(code):
    """Names of globals and attributes in a code object and those nested in it."""
    yield from code.co_names
    for constant in code.co_consts:
        if inspect.iscode(constant):
            yield from _names(constant)


def _identity(value):
    if isinstance(value, np.ndarray):
        return (value.shape, value.dtype.str, value.tobytes())
    if isinstance(value, (int, float, bool, str)):
        return (type(value), repr(value))
    if isinstance(value, (list, tuple)):
        return (type(value), tuple(_identity(v) for v in value))
    return id(value)


def _build(name, fun, arity, form, n_axes, signature):
    """Compile `fun` for `signature`, through an adapter where it returns its values."""
    if config.DISABLE_JIT:
        return fun if arity == 4 else _adapter(fun, arity == 3, form, n_axes)
    jitted = fun if is_jitted(fun) else _njit(fun)
    t, y, _, params = signature.args
    own = {2: (t, y), 3: (t, y, params), 4: signature.args}[arity]
    try:
        jitted.compile(own)  # by itself first: a complaint then speaks of the user's own lines
        if arity == 4:
            return as_value(jitted, signature)
        return as_value(_njit(_adapter(jitted, arity == 3, form, n_axes)), signature)
    except Exception as error:  # numba raises all sorts, not its own kind alone
        plain = fun.py_func if is_jitted(fun) else fun
        raise TypeError(_compile_complaint(name, plain, error)) from error


_njit = njit(error_model="numpy", nogil=True)


def _adapter(fun, with_params, form, n_axes):
    """A function that calls `fun` and writes what it returns into the output array.

    `form` is what the trial call gave. The loops are written out because numba takes two seconds
    to compile ``out[...] = values``.
    """
    one = (0,) * n_axes

    def from_number(t, y, out, params):
        out[one] = fun(t, y, params) if with_params else fun(t, y)

    def from_vector(t, y, out, params):
        values = np.asarray(fun(t, y, params) if with_params else fun(t, y))
        if values.shape != out.shape:
            raise ValueError(_RESHAPED)
        for i in range(out.shape[0]):
            out[i] = values[i]

    def from_matrix(t, y, out, params):
        values = np.asarray(fun(t, y, params) if with_params else fun(t, y))
        if values.shape != out.shape:
            raise ValueError(_RESHAPED)
        for i in range(out.shape[0]):
            for j in range(out.shape[1]):
                out[i, j] = values[i, j]

    if form == "number":
        return from_number
    return from_vector if n_axes == 1 else from_matrix


_RESHAPED = "the function returned another shape than at t = 0"


def _compile_complaint(name, fun, error):
    """One sentence from numba's report: the line it stopped at, its reason, and the remedy."""
    path = fun.__code__.co_filename
    text = str(error)
    told = re.search(rf'File "[^"]*{re.escape(Path(path).name)}", line (\d+)', text)
    where = ""
    if told:
        source = linecache.getline(path, int(told[1])).strip()
        where = f' at line {told[1]} of {path}: "{source}"'
    lines = (line.strip() for line in text.splitlines())
    reason = next((s for s in lines if s and not s.startswith("Failed in nopython")), "no reason")
    return (
        f"{name} must be a function that numba can compile, got one that stops it{where} "
        f"({reason}); use arithmetic, math and NumPy functions on floats and arrays, and pass "
        "constants through params"
    )
