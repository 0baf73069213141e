"""Users' functions: recognised by arity, tried once, compiled once.

A right-hand side may be written ``f(t, y)``, ``f(t, y, params)`` (both return the values) or in
place ``f(t, y, dy, params)``; a Jacobian likewise. One that reads memory takes it behind y. In each
case the solver receives one compiled function of one fixed signature, to which memory is further
components. The function is first called once in plain Python, so that an error
shows its own line instead of a compiler's message.

It is compiled with bounds checks, and for read-only arrays y and params.
"""

import inspect
import warnings
from collections import OrderedDict
from typing import Any, NamedTuple

import numpy as np
from numba import config, types
from numba.extending import is_jitted

from ._checks import complaint, shown
from ._complaints import compile_complaint, defined, line_of, writing_complaint
from ._frozen import code_names, fresh, frozen_values, uncompiled
from ._jit import F8, JAC_SIG, RHS_SIG, as_value, compiling, derived
from ._memory_argument import joined, padded, split

_SHAPES = "{0}({2}), {0}({2}, params) or, in place, {0}({2}, {1}, params)"
_READ_ONLY = types.Array(F8, 1, "C", readonly=True)
_MEMORY = types.Array(F8, 2, "C", readonly=True)
# Through these numba returns y as a writable array.
_PAST_READ_ONLY = {"flat", "nditer", "ascontiguousarray", "asfortranarray", "fill_diagonal", "dot"}
_COMPILED_MAX = 256
_compiled: OrderedDict[tuple, Any] = OrderedDict()
# Number of versions, by frozen values alone, of which the user is warned: numba frees none.
_VERSIONS_MAX = 50


class Start(NamedTuple):
    """Arguments that functions are tried with at t = 0: y (d,), memory (k, d) and params (p,)."""

    y: np.ndarray
    memory: np.ndarray
    params: np.ndarray

    def components(self):
        """Return y and memory as the components of one system, (d + k d,)."""
        return np.concatenate([self.y, self.memory.ravel()])

    def named(self):
        """Name the arguments in front of params."""
        return "t, y, memory" if len(self.memory) else "t, y"


def compile_rhs(fun, start, hint=""):
    """Check `fun` at t = 0 and return it compiled as ``rhs(t, y, dy, params)``.

    `hint` is appended to messages where `fun` does not fit y0.
    """
    compiled = _compile("rhs", "dy", fun, start, (start.y.size,), RHS_SIG, hint)
    k = len(start.memory)
    return as_value(padded(compiled, k), RHS_SIG) if k else compiled


def compile_jac(fun, fun_memory, start):
    """Check a Jacobian at t = 0 and return it compiled as ``jac(t, y, jacobian, params)``.

    None where none is given; `fun_memory` holds the derivatives by the memory.
    """
    k, d = start.memory.shape
    if (fun is None) != (fun_memory is None) and (k or fun is None):
        given, lacking = ("jac", "jac_memory") if fun_memory is None else ("jac_memory", "jac")
        required = f"come with {lacking}" if k else "be left out where no memory is read"
        raise ValueError(complaint(given, required, "it alone", "leave out both for differences"))
    if fun is None:
        return None
    compiled = _compile("jac", "jacobian", fun, start, (d, d), JAC_SIG)
    if not k:
        return compiled
    beside = _compile("jac_memory", "jacobian", fun_memory, start, (d, k * d), JAC_SIG)
    return as_value(joined(compiled, beside, k), JAC_SIG)


def present_values(fun):
    """Return the values that compilation of `fun` would freeze now, for comparison."""
    return frozen_values(_plain(fun)) if fun is not None else ()


def _plain(fun):
    """Return the Python function behind a compiled one; any other unchanged."""
    return fun.py_func if is_jitted(fun) else fun


def _compile(name, out, fun, start, shape, signature, hint=""):
    """Check a user's function and return it compiled, from the cache if it is there."""
    plain = _plain(fun)
    if not inspect.isfunction(plain):
        required = f"be a function {_SHAPES.format(name, out, start.named())}"
        remedy = "write it with def or lambda and pass constants through params"
        raise TypeError(complaint(name, required, repr(fun), remedy))
    k = len(start.memory)
    arity = _arity(name, out, plain, start)
    values, form = _try_out(name, out, plain, arity, start, shape, hint)
    frozen = frozen_values(plain)
    options = repr(sorted(fun.targetoptions.items())) if is_jitted(fun) else ""
    key = (frozen, options, arity, form, signature, k)
    with compiling:
        if key not in _compiled:
            copied = bool(_PAST_READ_ONLY & code_names(frozen))
            _compiled[key] = _build(name, fun, arity, form, len(shape), signature, copied, k)
            _warn_of_versions(name, plain)
            while len(_compiled) > _COMPILED_MAX:
                _compiled.popitem(last=False)
        _compiled.move_to_end(key)
        compiled = _compiled[key]
    _compare(name, plain, arity, form, compiled, values, start)
    return compiled


def _warn_of_versions(name, plain):
    """Warn where one function is compiled over and over for other frozen values."""
    versions = sum(frozen[0] == plain.__code__ for frozen, *_ in _compiled)
    if versions == _VERSIONS_MAX:
        warnings.warn(
            f"{name} was compiled {versions} times for other globals or closed-over values, "
            f"{defined(plain)}; every time takes 2 MB of memory that numba cannot free; pass "
            "what changes through params",
            stacklevel=5,
        )


def _compare(name, fun, arity, form, compiled, values, start):
    """Refuse a function whose compiled values differ from those in Python."""
    again = np.empty_like(values)
    try:
        compiled(0.0, start.components(), again, start.params.copy())
    except Exception as error:
        got = f"{type(error).__name__}: {error}"
        raise ValueError(complaint(name, "run at t = 0", got, defined(fun))) from error
    if _close(again, values):
        return
    # helpers compiled earlier may have run with the values of that time
    plain = split(uncompiled(fun), arity, len(start.memory), compiled=False)
    in_python = _adapter(plain, arity, form, values.ndim, False)
    expected = np.empty_like(values)
    in_python(0.0, start.components(), expected, start.params.copy())
    if not _close(again, expected):
        raise ValueError(
            complaint(
                name,
                "give the same numbers compiled as in Python",
                f"{shown(again)} and {shown(expected)} at t = 0",
                "write 1.0 for 1 where whole numbers are divided, raised or grow large",
            )
        )


def _close(values, expected):
    """Return whether values agree to 1e-8."""
    return np.allclose(values, expected, rtol=1e-8, atol=1e-12 * np.abs(expected).max())


def _arity(name, out, fun, start):
    """Return the number of positional arguments besides memory: 2, 3 or 4."""
    required = f"be one of {_SHAPES.format(name, out, start.named())}"
    more = int(len(start.memory) > 0)
    try:
        parameters = inspect.signature(fun).parameters.values()
    except (TypeError, ValueError) as error:
        raise TypeError(complaint(name, required, repr(fun), "write it with def")) from error
    positional = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    if len(positional) != len(parameters) or len(positional) - more not in (2, 3, 4):
        got = f"{getattr(fun, '__name__', fun)}{inspect.signature(fun)}"
        raise TypeError(complaint(name, required, got, "pass constants through params"))
    if positional[1].name in ("t", "time"):
        got = f"{fun.__name__}{inspect.signature(fun)}"
        raise TypeError(complaint(name, "take t first and y second", got, defined(fun)))
    if more and positional[2].name in ("p", "params", "dy", "jacobian"):
        got = f"{fun.__name__}{inspect.signature(fun)}"
        reason = f"equations with memory= pass it there, {defined(fun)}"
        raise TypeError(complaint(name, "take memory third", got, reason))
    return len(positional) - more


def _try_out(name, out, fun, arity, start, shape, hint):
    """Call `fun` once in Python at t = 0, check its values and return them and their form."""
    filled, form = _values(name, out, fun, arity, start, shape, hint, np.nan)
    if np.all(np.isfinite(filled)):
        return filled, form
    if arity == 4:
        again, _ = _values(name, out, fun, arity, start, shape, hint, 0.5)
        unset = np.isnan(filled) & (again == 0.5)
        if unset.any():
            got = f"entries {np.argwhere(unset).tolist()} left unset"
            raise ValueError(complaint(name, f"set every entry of {out}", got, defined(fun)))
    remedy = f"check y0 = {shown(start.y)} and params = {shown(start.params)}, {defined(fun)}"
    raise ValueError(complaint(name, "be finite at t = 0", shown(filled), remedy))


def _values(name, out, fun, arity, start, shape, hint, fill):
    """Call `fun` at t = 0; return its values as an array of `shape`, and their form."""
    filled = np.full(shape, fill)  # marks entries that an in-place function leaves unset
    y, memory, p = (part.copy() for part in start)
    first = (0.0, y, memory) if len(memory) else (0.0, y)
    arguments = {2: first, 3: (*first, p), 4: (*first, filled, p)}
    if arity == 4:
        words = ("five", "fourth", "fifth") if len(memory) else ("four", "third", "fourth")
        hint += "; with {} arguments the {} is {out}, to be filled, and the {} params".format(
            *words, out=out
        )
    try:
        with np.errstate(all="ignore"):  # values that are not finite are reported below
            result = fun(*arguments[arity])
    except Exception as error:
        raise ValueError(
            f"{name} must run at t = 0, got {type(error).__name__}: {error} {line_of(error, fun)};"
            f" it was called with y = {shown(start.y)} and params = {shown(start.params)}{hint}"
        ) from error
    for argument, given, left in zip(start._fields, start, (y, memory, p), strict=True):
        if not np.array_equal(given, left):
            got = f"{shown(given)} changed to {shown(left)}"
            remedy = f"work on a copy, {defined(fun)}"
            raise ValueError(complaint(name, f"leave {argument} as it is", got, remedy))
    if arity == 4:
        if result is not None:
            remedy = f"leave {out} out of the arguments to return values, {defined(fun)}{hint}"
            raise TypeError(complaint(name, f"fill {out} and return None", repr(result), remedy))
        return filled, "in place"
    remedy = f"return numpy.array([...]) of shape {shape}, {defined(fun)}"
    try:
        values = np.asarray(result)
    except ValueError:  # rows of unequal length
        values = np.asarray(None)
    if values.dtype.kind not in "biuf":
        raise TypeError(complaint(name, "return real numbers", repr(result), remedy))
    if values.shape != shape and not (values.ndim == 0 and np.prod(shape) == 1):
        size = f"shape {shape}" + (" or a number" if np.prod(shape) == 1 else "")
        got = f"shape {values.shape}"
        raise ValueError(complaint(name, f"return {size}", got, remedy + hint))
    form = "array" if values.ndim else "number"
    return values.astype(float).reshape(shape), form


def _build(name, fun, arity, form, n_axes, signature, copied, k):
    """Compile `fun` for `signature`, through an adapter that passes it read-only arrays.

    numba converts arrays to read-only ones where it calls a function compiled for these alone.
    """
    if config.DISABLE_JIT:
        return _adapter(split(_locking(fun, k), arity, k, False), arity, form, n_axes, copied)
    # the functions are called from compiled code alone: a wrapper for others takes 1 MB each
    inside = {"boundscheck": True, "no_cpython_wrapper": True}
    inner: dict[str, Any] = {"nogil": True, "no_cfunc_wrapper": True, **inside}
    # scenes of the package always read the same entries, which the call at t = 0 has checked
    inner["boundscheck"] = not str(_plain(fun).__module__).startswith(f"{__package__}.")
    if not is_jitted(fun):
        inner["error_model"] = "numpy"
    t, _, out, _ = signature.args
    first = (t, _READ_ONLY, _MEMORY) if k else (t, _READ_ONLY)
    own = (*first, *{2: (), 3: (_READ_ONLY,), 4: (out, _READ_ONLY)}[arity])
    try:
        jitted = fresh(fun, inner, inside)
        jitted.compile(own)  # by itself first, so that a message refers to the user's lines
        jitted.disable_compile()
        adapter = _adapter(split(jitted, arity, k), arity, form, n_axes, copied)
        return as_value(derived(adapter), signature)
    except Exception as error:  # numba raises many types besides its own
        plain = _plain(fun)
        if _compiles(fresh(fun, inner, inside), [a.copy(readonly=False) for a in own[1:]]):
            raise TypeError(writing_complaint(name, plain, error)) from error
        raise TypeError(compile_complaint(name, plain, error)) from error


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


def _locking(fun, k):
    """Return the function with its arguments read-only, for runs without a compiler."""

    def locked(t, y, *rest):
        views = [array.view() for array in (y, *rest)]
        views[0].flags.writeable = views[-1].flags.writeable = False
        if k:
            views[1].flags.writeable = False
        return fun(t, *views)

    return locked


_RESHAPED = "the function returned another shape than at t = 0"
