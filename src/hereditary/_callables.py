"""Users' functions: recognised by arity, tried once, compiled once.

A right-hand side may be written ``f(t, y)``, ``f(t, y, params)`` (both return the values) or in
place ``f(t, y, dy, params)``; a Jacobian likewise. In each case the solver receives one compiled
function of one fixed signature. The function is first called once in plain Python, so that an error
shows its own line instead of a compiler's message.

It is compiled with bounds checks, and for read-only arrays y and params.
"""

import inspect
import warnings
from collections import OrderedDict
from typing import Any

import numpy as np
from numba import config, njit, types
from numba.extending import is_jitted

from ._checks import complaint, shown
from ._complaints import compile_complaint, defined, line_of, writing_complaint
from ._frozen import code_names, fresh, frozen_values, uncompiled
from ._jit import F8, JAC_SIG, RHS_SIG, as_value, compiling

_SHAPES = "{0}(t, y), {0}(t, y, params) or, in place, {0}(t, y, {1}, params)"
_READ_ONLY = types.Array(F8, 1, "C", readonly=True)
# Through these numba returns y as a writable array.
_PAST_READ_ONLY = {"flat", "nditer", "ascontiguousarray", "asfortranarray", "fill_diagonal", "dot"}
_COMPILED_MAX = 256
_compiled: OrderedDict[tuple, Any] = OrderedDict()
# Number of versions, by frozen values alone, of which the user is warned: numba frees none.
_VERSIONS_MAX = 50


def compile_rhs(fun, y0, params, hint=""):
    """Check `fun` at t = 0 and return it compiled as ``rhs(t, y, dy, params)``.

    `hint` is appended to messages where `fun` does not fit `y0`.
    """
    return _compile("rhs", "dy", fun, y0, params, (y0.size,), RHS_SIG, hint)


def compile_jac(fun, y0, params):
    """Check `fun` at t = 0 and return it compiled as ``jac(t, y, jacobian, params)``."""
    return _compile("jac", "jacobian", fun, y0, params, (y0.size, y0.size), JAC_SIG)


def present_values(fun):
    """Return the values that compilation of `fun` would freeze now, for comparison."""
    return frozen_values(_plain(fun)) if fun is not None else ()


def _plain(fun):
    """Return the Python function behind a compiled one; any other unchanged."""
    return fun.py_func if is_jitted(fun) else fun


def _compile(name, out, fun, y0, params, shape, signature, hint=""):
    """Check a user's function and return it compiled, from the cache if it is there."""
    plain = _plain(fun)
    if not inspect.isfunction(plain):
        required = f"be a function {_SHAPES.format(name, out)}"
        remedy = "write it with def or lambda and pass constants through params"
        raise TypeError(complaint(name, required, repr(fun), remedy))
    arity = _arity(name, out, plain)
    values, form = _try_out(name, out, plain, arity, y0, params, shape, hint)
    frozen = frozen_values(plain)
    options = repr(sorted(fun.targetoptions.items())) if is_jitted(fun) else ""
    key = (frozen, options, arity, form, signature)
    with compiling:
        if key not in _compiled:
            copied = bool(_PAST_READ_ONLY & code_names(frozen))
            _compiled[key] = _build(name, fun, arity, form, len(shape), signature, copied)
            _warn_of_versions(name, plain)
            while len(_compiled) > _COMPILED_MAX:
                _compiled.popitem(last=False)
        _compiled.move_to_end(key)
        compiled = _compiled[key]
    _compare(name, plain, arity, form, compiled, values, y0, params)
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


def _compare(name, fun, arity, form, compiled, values, y0, params):
    """Refuse a function whose compiled values differ from those in Python."""
    again = np.empty_like(values)
    try:
        compiled(0.0, y0.copy(), again, params.copy())
    except Exception as error:
        got = f"{type(error).__name__}: {error}"
        raise ValueError(complaint(name, "run at t = 0", got, defined(fun))) from error
    if _close(again, values):
        return
    # helpers compiled earlier may have run with the values of that time
    in_python = _adapter(uncompiled(fun), arity, form, values.ndim, False)
    expected = np.empty_like(values)
    in_python(0.0, y0.copy(), expected, params.copy())
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


def _arity(name, out, fun):
    """Return the number of positional arguments: 2, 3 or 4."""
    required = f"be one of {_SHAPES.format(name, out)}"
    try:
        parameters = inspect.signature(fun).parameters.values()
    except (TypeError, ValueError) as error:
        raise TypeError(complaint(name, required, repr(fun), "write it with def")) from error
    positional = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    if len(positional) != len(parameters) or len(positional) not in (2, 3, 4):
        got = f"{getattr(fun, '__name__', fun)}{inspect.signature(fun)}"
        raise TypeError(complaint(name, required, got, "pass constants through params"))
    if positional[1].name in ("t", "time"):
        got = f"{fun.__name__}{inspect.signature(fun)}"
        raise TypeError(complaint(name, "take t first and y second", got, defined(fun)))
    return len(positional)


def _try_out(name, out, fun, arity, y0, params, shape, hint):
    """Call `fun` once in Python at t = 0, check its values and return them and their form."""
    filled, form = _values(name, out, fun, arity, y0, params, shape, hint, np.nan)
    if np.all(np.isfinite(filled)):
        return filled, form
    if arity == 4:
        again, _ = _values(name, out, fun, arity, y0, params, shape, hint, 0.5)
        unset = np.isnan(filled) & (again == 0.5)
        if unset.any():
            got = f"entries {np.argwhere(unset).tolist()} left unset"
            raise ValueError(complaint(name, f"set every entry of {out}", got, defined(fun)))
    remedy = f"check y0 = {shown(y0)} and params = {shown(params)}, {defined(fun)}"
    raise ValueError(complaint(name, "be finite at t = 0", shown(filled), remedy))


def _values(name, out, fun, arity, y0, params, shape, hint, fill):
    """Call `fun` at t = 0; return its values as an array of `shape`, and their form."""
    filled = np.full(shape, fill)  # marks entries that an in-place function leaves unset
    y, p = y0.copy(), params.copy()
    arguments = {2: (0.0, y), 3: (0.0, y, p), 4: (0.0, y, filled, p)}
    if arity == 4:
        hint += f"; with four arguments the third is {out}, to be filled, and the fourth params"
    try:
        with np.errstate(all="ignore"):  # values that are not finite are reported below
            result = fun(*arguments[arity])
    except Exception as error:
        raise ValueError(
            f"{name} must run at t = 0, got {type(error).__name__}: {error} {line_of(error, fun)};"
            f" it was called with y = {shown(y0)} and params = {shown(params)}{hint}"
        ) from error
    for argument, given, left in (("y", y0, y), ("params", params, p)):
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


def _build(name, fun, arity, form, n_axes, signature, copied):
    """Compile `fun` for `signature`, through an adapter that passes it read-only arrays.

    numba converts arrays to read-only ones where it calls a function compiled for these alone.
    """
    if config.DISABLE_JIT:
        return _adapter(_locking(fun), arity, form, n_axes, copied)
    # the functions are called from compiled code alone: a wrapper for others takes 1 MB each
    inside = {"boundscheck": True, "no_cpython_wrapper": True}
    inner: dict[str, Any] = {"nogil": True, "no_cfunc_wrapper": True, **inside}
    # scenes of the package always read the same entries, which the call at t = 0 has checked
    inner["boundscheck"] = not str(_plain(fun).__module__).startswith(f"{__package__}.")
    if not is_jitted(fun):
        inner["error_model"] = "numpy"
    t, _, out, _ = signature.args
    own = {2: (t, _READ_ONLY), 3: (t, _READ_ONLY, _READ_ONLY), 4: (t, _READ_ONLY, out, _READ_ONLY)}
    try:
        jitted = fresh(fun, inner, inside)
        jitted.compile(own[arity])  # by itself first, so that a message refers to the user's lines
        jitted.disable_compile()
        return as_value(_njit(_adapter(jitted, arity, form, n_axes, copied)), signature)
    except Exception as error:  # numba raises many types besides its own
        plain = _plain(fun)
        if _compiles(fresh(fun, inner, inside), [a.copy(readonly=False) for a in own[arity][1:]]):
            raise TypeError(writing_complaint(name, plain, error)) from error
        raise TypeError(compile_complaint(name, plain, error)) from error


def _compiles(jitted, arrays):
    """Return whether a function compiles for writable arrays."""
    try:
        jitted.compile((F8, *arrays))
    except Exception:
        return False
    return True


_njit = njit(error_model="numpy", nogil=True)


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


def _locking(fun):
    """Return the function with y and params read-only, for runs without a compiler."""

    def locked(t, y, *rest):
        views = [array.view() for array in (y, *rest)]
        views[0].flags.writeable = views[-1].flags.writeable = False
        return fun(t, *views)

    return locked


_RESHAPED = "the function returned another shape than at t = 0"
