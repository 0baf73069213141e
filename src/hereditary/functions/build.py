"""One function of a user: tried, compiled once or called in Python.

It is first called twice in plain Python, so that an error shows its own line instead of a
compiler's message. It is compiled with bounds checks, and for read-only arrays y and params; with
the same code and the same values frozen into it, it is compiled no second time, and is tried by one
call of each, whose values are compared. A function that numba cannot compile is called in Python
from a compiled one (python_calls.py).
"""

import inspect
from collections import OrderedDict
from typing import Any, NamedTuple

import numpy as np
from numba import config, types
from numba.extending import is_jitted

from .._checks import complaint, shown
from .._jit import F8, as_value, compiling, derived
from .._warning import warn
from ..compiled.numba_internals import options_of, stated_options, without
from .memory_argument import paired, split
from .messages import compile_reason, defined, writing_complaint
from .python_calls import warn_of_python
from .reads import code_names, fresh, frozen_values, uncompiled
from .trial import arity_of, close, try_out

_READ_ONLY = types.Array(F8, 1, "C", readonly=True)
# Through these numba returns y as a writable array.
_PAST_READ_ONLY = {"flat", "nditer", "ascontiguousarray", "asfortranarray", "fill_diagonal", "dot"}
_COMPILED_MAX = 256
_compiled: OrderedDict[tuple, Any] = OrderedDict()
# Compiled functions that were tried and compared, and their numbers of arguments.
_tried: OrderedDict[tuple, tuple[Any, int]] = OrderedDict()
# Number of versions, by frozen values alone, of which the user is warned: numba frees none.
_VERSIONS_MAX = 50


class Function(NamedTuple):
    """A user's function: compiled, or None, and ``fill(t, z, out, params)``, which calls it."""

    compiled: Any
    fill: Any


def present_values(fun):
    """Return the values that compilation of `fun` would freeze now, for comparison."""
    plain = None if fun is None else _plain(fun)
    return frozen_values(plain) if inspect.isfunction(plain) else ()


def _plain(fun):
    """Return the Python function behind a compiled one; any other unchanged."""
    return fun.py_func if is_jitted(fun) else fun


def _of_package(plain):
    """Return whether a Python function is one of this package."""
    return str(plain.__module__).startswith("hereditary.")


class _NotCompiled(Exception):
    """numba cannot compile a function, or makes another one of it."""


def function_of(name, out, fun, start, shape, signature, hint=str, required=""):
    """Check a user's function and return it, compiled where it can be, as a `Function`.

    `required` is what is required of a function that must compile.
    """
    plain = _plain(fun)
    if not callable(plain):
        required = f"be a function {start.shapes(name, out)}"
        raise TypeError(complaint(name, required, repr(fun), "write it with def or lambda"))
    key = _key(fun, signature, start) if inspect.isfunction(plain) else ()
    compiled, arity = _tried.get(key, (None, 0))
    if compiled:
        fill = _in_python(name, plain, arity, start, shape)
        if _agree(compiled, fill, start, shape):
            return Function(compiled, fill)
    arity = arity_of(name, out, plain, start)
    values, form = try_out(name, out, plain, arity, start, shape, hint)
    fill = _in_python(name, plain, arity, start, shape)
    try:
        if not key:
            raise _NotCompiled("for numba compiles functions written with def or lambda alone")
        compiled = _from_cache(name, fun, key, arity, form, values, signature, start)
        _compare(name, plain, arity, compiled, values, start)
        if not _of_package(plain):
            _tried[key] = compiled, arity
        while len(_tried) > _COMPILED_MAX:
            _tried.popitem(last=False)
    except _NotCompiled as reason:
        if required:
            raise TypeError(complaint(name, required, f"{plain!r}, {reason}")) from reason
        z, room, params = start.components(), np.empty_like(values).view(float), start.params
        warn_of_python(name, plain, reason, lambda: fill(start.t, z, room, params))
        compiled = None
    return Function(compiled, fill)


def _key(fun, signature, start):
    """Return what a compiled function depends on, besides its number of arguments and its form."""
    options = stated_options(options_of(fun)) if is_jitted(fun) else ""
    return frozen_values(_plain(fun)), options, signature, len(start.memory), start.paired


def _agree(compiled, fill, start, shape):
    """Return whether a compiled function and Python give equal numbers of `shape` at the start."""
    values, expected = np.full((2, *shape), np.nan, start.y.dtype)
    z, params = start.components(), start.params.copy()
    try:
        compiled(start.t, z, values.view(float), params)
        with np.errstate(all="ignore"):
            fill(start.t, locked(z), expected.view(float), locked(params))
    except Exception:  # the whole way says what is wrong
        return False
    return bool(np.isfinite(values).all()) and close(values, expected)


def _from_cache(name, fun, key, arity, form, values, signature, start):
    """Return a user's function compiled, from the cache if it is there."""
    key = (*key, arity, form)
    with compiling:
        if key not in _compiled:
            copied = bool(_PAST_READ_ONLY & code_names(key[0]))
            kinds = arity, form, start, values.shape
            try:
                _compiled[key] = _build(name, fun, kinds, signature, copied)
                _warn_of_versions(name, _plain(fun))
            except _NotCompiled as reason:  # which takes as long to find as to compile
                _compiled[key] = reason
            while len(_compiled) > _COMPILED_MAX:
                _compiled.popitem(last=False)
        _compiled.move_to_end(key)
        found = _compiled[key]
    if isinstance(found, _NotCompiled):
        raise _NotCompiled(*found.args)
    return found


def _warn_of_versions(name, plain):
    """Warn where one function is compiled over and over for other frozen values."""
    versions = sum(frozen[0] == plain.__code__ for frozen, *_ in _compiled)
    if versions == _VERSIONS_MAX:
        warn(
            f"{name} was compiled {versions} times for other globals or closed-over values, "
            f"{defined(plain)}; every time takes 2 MB of memory that numba cannot free; pass "
            "what changes through params",
            UserWarning,
        )


def _compare(name, fun, arity, compiled, values, start):
    """Refuse compiled code whose values differ from those in Python."""
    again, z, params = np.empty_like(values), start.components(), start.params
    try:
        compiled(start.t, z.copy(), again.view(float), params.copy())
    except Exception as error:
        raise _NotCompiled(f"for compiled it raises {type(error).__name__}: {error}") from error
    if close(again, values):
        return
    # helpers compiled earlier may have run with the values of that time
    expected = np.empty_like(values)
    fill = _in_python(name, uncompiled(fun), arity, start, values.shape)
    fill(start.t, z, expected.view(float), params)
    if not close(again, expected):
        raise _NotCompiled(
            f"for compiled it gives {shown(again)} instead of {shown(expected)} at t = {start.t:g}"
            ": write 1.0 for 1 where whole numbers are divided, raised or grow large"
        )


def _build(name, fun, kinds, signature, copied):
    """Compile a user's function, or with `copied` one that is given copies of y and params.

    Those may be written to. `kinds` are number of arguments, form, start and shape of the values.
    Its own code, and its helpers, are compiled anew, so that the result depends on these alone.
    """
    arity, form, start, shape = kinds
    if config.DISABLE_JIT:
        return _locking(_in_python(name, _plain(fun), arity, start, shape))
    k = len(start.memory)
    # the functions are called from compiled code alone: a wrapper for others takes 1 MB each
    inside = {"boundscheck": True, **without("cpython")}
    inner: dict[str, Any] = {"nogil": True, **without("cfunc"), **inside}
    # scenes of the package always read the same entries, which the call at t = 0 has checked
    inner["boundscheck"] = not _of_package(_plain(fun))
    if not is_jitted(fun):
        inner["error_model"] = "numpy"
    number = types.complex128 if start.paired else F8
    y, memory = (types.Array(number, axes, "C", readonly=True) for axes in (1, 2))
    first = (F8, y, memory) if k else (F8, y)
    filled = types.Array(number, len(shape), "C")
    own = (*first, *{2: (), 3: (_READ_ONLY,), 4: (filled, _READ_ONLY)}[arity])
    try:
        jitted = fresh(fun, inner, inside)
        jitted.compile(own)  # by itself first, so that a message refers to the user's lines
        jitted.disable_compile()
        adapter = _adapter(split(jitted, arity, k), arity, form, len(shape), copied)
        returned = jitted.nopython_signatures[0].return_type
        simple = isinstance(returned, (types.NoneType, types.Number, types.Boolean))
        adapter = derived(adapter, counted=copied or not simple)
        return as_value(paired(adapter) if start.paired else adapter, signature)
    except Exception as error:  # numba raises many types besides its own
        plain = _plain(fun)
        if _compiles(fresh(fun, inner, inside), [a.copy(readonly=False) for a in own[1:]]):
            raise TypeError(writing_complaint(name, plain, error)) from error
        raise _NotCompiled(compile_reason(plain, error)) from error


def _compiles(jitted, arrays):
    """Return whether a function compiles for writable arrays."""
    try:
        jitted.compile((F8, *arrays))
    except Exception:
        return False
    return True


def _adapter(fun, arity, form, n_axes, copied):
    """Return a function that calls `fun` and writes its values to the output array.

    `form` is that of the trial call; with `copied`, `fun` receives copies of y and params. The
    loops are written out because numba takes two seconds to compile ``out[...] = values``.
    """
    one, with_params = (0,) * n_axes, arity == 3

    def in_place(t, y, out, params):
        if copied:
            y, params = y.copy(), params.copy()
        fun(t, y, out, params)

    def from_number(t, y, out, params):
        if copied:
            y, params = y.copy(), params.copy()
        out[one] = fun(t, y, params) if with_params else fun(t, y)

    def from_vector(t, y, out, params):
        if copied:
            y, params = y.copy(), params.copy()
        values = np.asarray(fun(t, y, params) if with_params else fun(t, y))
        if values.shape != out.shape:
            raise ValueError(_RESHAPED)
        for i in range(out.shape[0]):
            out[i] = values[i]

    def from_matrix(t, y, out, params):
        if copied:
            y, params = y.copy(), params.copy()
        values = np.asarray(fun(t, y, params) if with_params else fun(t, y))
        if values.shape != out.shape:
            raise ValueError(_RESHAPED)
        for i in range(out.shape[0]):
            for j in range(out.shape[1]):
                out[i, j] = values[i, j]

    if form == "in place":
        return in_place
    if form == "number":
        return from_number
    return from_vector if n_axes == 1 else from_matrix


def _in_python(name, fun, arity, start, shape):
    """Return ``fill(t, z, out, params)``, which calls `fun` in Python; z holds y and memory."""
    k, d = start.memory.shape
    kind = start.y.dtype

    def fill(t, z, out, params):
        if start.paired:
            z, out = z.view(kind), out.view(kind)
        arguments = (t, z[:d], z[d:].reshape(k, d)) if k else (t, z)
        if arity == 4:
            values = np.empty(shape, kind)  # which the function may keep
            fun(*arguments, values, params)
        else:
            values = fun(*arguments, params) if arity == 3 else fun(*arguments)
            if type(values) is list and shape == (len(values),) and len(values) <= _FEW:
                for place, value in enumerate(values):  # an array is made in twice the time
                    out[place] = value
                return
            given, values = values, np.asarray(values)
            if values.dtype.kind not in ("biufc" if start.paired else "biuf"):
                required = "return numbers" if start.paired else "return real numbers"
                raise TypeError(complaint(name, required, repr(given), defined(fun)))
        if values.shape != shape:
            if values.size != 1 or out.size != 1:
                raise ValueError(_RESHAPED)
            values = values.reshape(shape)
        out[...] = values

    return fill


def _locking(fill):
    """Return the function with its arguments read-only, for runs without a compiler."""
    return lambda t, z, out, params: fill(t, locked(z), out, locked(params))


def locked(array):
    """Return a view of an array that cannot be written to."""
    view = array.view()
    view.setflags(write=False)
    return view


# Longest list that is not made an array first.
_FEW = 6
_RESHAPED = "the function returned another shape than at the start"
