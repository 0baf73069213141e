"""Check one function of a user, and compile it or wrap it for calls in Python.

The function is first called twice in plain Python, so that an error shows its own line instead of a
compiler's message. It is then compiled with bounds checks, for read-only arrays y and params. numba
freezes the globals and closed-over values that it reads. With the same code and the same frozen
values it is not compiled again. For each equation the values of the compiled function at the start
are compared with those in Python. If numba cannot compile the function, a compiled one calls it in
Python (python_calls.py).
"""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable
from contextlib import suppress
from types import FunctionType
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numba import config, typeof, types
from numba.core.errors import NumbaPendingDeprecationWarning
from numba.extending import is_jitted

from ..compiled.functions import views_of
from ..compiled.jit import F8, DerivedValue, compiling, derived
from ..compiled.numba_internals import built_as_one, options_of, stated_options, without
from ..support.checks import complaint, refuse, shown
from ..support.warning import warn
from .messages import compile_reason, defined, line_of, of_one_number, writing_complaint
from .python_calls import warn_of_python
from .reads import code_names, fresh, frozen_values, uncompiled

_READ_ONLY = types.Array(F8, 1, "C", readonly=True)
# Names of functions and attributes through which numba makes a writable array of a read-only one.
_PAST_READ_ONLY = {"flat", "nditer", "ascontiguousarray", "asfortranarray", "fill_diagonal", "dot"}
# Largest number of compiled functions that this module keeps for later equations.
_KEPT_MAX = 256
# Number of versions of one function, with different frozen values, at which the user is warned:
# numba frees no compiled code.
_VERSIONS_MAX = 50
# Type of ``fill(t, z, out, params)``, which calls a user's function; z contains y, then memory.
Fill: TypeAlias = Callable[..., None]


class Function(NamedTuple):
    """A user's function: compiled, or None; `fill` calls it in Python."""

    compiled: Any
    fill: Fill


class _Version(NamedTuple):
    """Result of a compilation: the function, or None and the reason.

    `arity` is the number of arguments besides memory, `form` that of the values: "number", "array"
    or "in place".
    """

    compiled: Any
    reason: str
    arity: int
    form: str


_versions: dict[tuple, _Version] = {}


def present_values(fun: Any) -> tuple:
    """Return the code of `fun` and the values that numba would freeze into it now."""
    if fun is None:
        return ()
    plain = _plain(fun)
    return frozen_values(plain) if isinstance(plain, FunctionType) else ()


def _plain(fun: Any) -> Any:
    """Return the Python function of a numba dispatcher; any other object unchanged."""
    # numba's answer about a plain function takes 1 us
    return fun.py_func if not isinstance(fun, FunctionType) and is_jitted(fun) else fun


def function_of(
    name: str,
    out: str,
    fun: Any,
    start: Start,
    shape: tuple[int, ...],
    hint: Callable[[], str] = str,
    required: str = "",
) -> Function:
    """Check a user's function and return it as a `Function`, compiled if numba can compile it.

    Parameters
    ----------
    name, out : str
        Names of the function and of its output array, for messages.
    fun : callable
    start : Start
        Arguments of the trial calls.
    shape : tuple of int
        Shape of the values.
    hint : callable, optional
        ``hint()`` is appended to messages about errors in the function.
    required : str, optional
        If not empty, numba must be able to compile the function. The message about a function that
        it cannot compile states this requirement.
    """
    candidate = Candidate(name, out, fun, start, shape, hint)
    plain = candidate.plain
    if not callable(plain):
        required = f"be a function {start.shapes(name, out)}"
        refuse(name, required, repr(fun), "write it with def or lambda", kind=TypeError)
    key = _key(candidate, plain) if isinstance(plain, FunctionType) else ()
    known = _versions.get(key)
    if known and known.compiled:
        fill = _in_python(candidate, known.arity)
        with suppress(Exception):  # the checks below report errors
            expected = _called(fill, candidate)
            if np.isfinite(expected).all() and not _difference(known.compiled, expected, start):
                return Function(known.compiled, fill)
    arity = arity_of(name, out, plain, start)
    values, form = try_out(candidate, arity)
    fill = _in_python(candidate, arity)
    found, reason = None, "because numba compiles only functions written with def or lambda"
    if key:
        found, reason, *_ = _version(candidate, key, arity, form)
        reason = reason or _difference(found, values, start)
        if found and reason:  # earlier compiled helpers may have had other values
            present = _in_python(candidate._replace(fun=uncompiled(plain)), arity)
            reason = _difference(found, _called(present, candidate), start)
    if not reason:
        return Function(found, fill)
    if required:
        refuse(name, required, f"{plain!r}, {reason}", kind=TypeError)
    warn_of_python(name, plain, reason, lambda: _called(fill, candidate))
    return Function(None, fill)


def _key(candidate: Candidate, plain: FunctionType) -> tuple:
    """Return what compiled code depends on besides the arity and the form: the key of a version."""
    fun, start = candidate.fun, candidate.start
    options = "" if fun is plain else stated_options(options_of(fun))
    kinds = candidate.width, len(start.memory), start.paired
    return frozen_values(plain), options, *kinds


def _called(fill: Fill, candidate: Candidate) -> np.ndarray:
    """Return the values that `fill` gives in Python at the start."""
    start = candidate.start
    values = np.full(candidate.shape, np.nan, start.y.dtype)
    with np.errstate(all="ignore"):
        fill(start.t, locked(start.components()), values.view(float), locked(start.params))
    return values


def _difference(compiled: Any, expected: np.ndarray, start: Start) -> str:
    """Return how compiled values at the start differ from Python's; "" if they agree."""
    found = np.full(expected.shape, np.nan, expected.dtype)
    try:
        compiled(start.t, start.components(), found.ravel().view(float), start.params.copy())
    except Exception as error:
        return f"for compiled it raises {type(error).__name__}: {error}"
    if nearly_equal(found, expected):
        return ""
    return (
        f"for compiled it gives {shown(found)} instead of {shown(expected)} at t = {start.t:g}"
        ": write 1.0 for 1 if whole numbers are divided, raised or grow large"
    )


def _version(candidate: Candidate, key: tuple, arity: int, form: str) -> _Version:
    """Return the `_Version` of a user's function for a key; compile the function if it is new."""
    with compiling:
        known = _versions.pop(key, None)
        if known is None or known[2:] != (arity, form):
            with warnings.catch_warnings():  # a warning about lists
                warnings.simplefilter("ignore", NumbaPendingDeprecationWarning)
                found, reason = built_as_one(lambda: _build(candidate, key, arity, form))
            known = _Version(found, reason, arity, form)
            if known.compiled:
                _warn_of_versions(candidate.name, candidate.plain)
        _versions[key] = known  # as the newest, which is removed last
        if len(_versions) > _KEPT_MAX:
            _versions.pop(next(iter(_versions)), None)
    return known


def _warn_of_versions(name: str, plain: FunctionType) -> None:
    """Warn if one function has been compiled `_VERSIONS_MAX` times for different frozen values."""
    versions = 1 + sum(frozen[0] == plain.__code__ for frozen, *_ in _versions)
    if versions == _VERSIONS_MAX:
        warn(
            f"{name} was compiled {versions} times for other globals or closed-over values, "
            f"{defined(plain)}; every time takes 0.6 MB of memory that numba cannot free; pass "
            "what changes through params",
            UserWarning,
        )


def _build(candidate: Candidate, key: tuple, arity: int, form: str) -> tuple[Any, str]:
    """Compile a user's function; return it and "", or None and the reason of numba's failure.

    A function that uses a name of `_PAST_READ_ONLY` gets copies of y and params, because it could
    write into them. The function and its helpers are compiled from fresh copies, so that earlier
    compilations have no influence.
    """
    fun, plain, start = candidate.fun, candidate.plain, candidate.start
    k, unit = len(start.memory), 1j if start.paired else 1.0
    if config.DISABLE_JIT:
        fill = _in_python(candidate, arity)
        shape = candidate.shape if candidate.width else -1
        return lambda t, z, out, p: fill(t, locked(z.copy()), out.reshape(shape), locked(p)), ""
    # only compiled code calls these functions, and a wrapper for Python would take 1 MB each
    inside = {"boundscheck": True, **without("cpython")}
    inner: dict[str, Any] = {"nogil": True, **without("cfunc"), **inside}
    # the package's own scenes always read the same entries, which the trial calls have checked
    inner["boundscheck"] = not str(plain.__module__).startswith("hereditary.")
    if not is_jitted(fun):
        inner["error_model"] = "numpy"
    number = typeof(unit)
    y, memory = (types.Array(number, axes, "C", readonly=True) for axes in (1, 2))
    first = (F8, y, memory) if k else (F8, y)
    filled = types.Array(number, len(candidate.shape), "C")
    own = (*first, *{2: (), 3: (_READ_ONLY,), 4: (filled, _READ_ONLY)}[arity])
    try:
        jitted = fresh(fun, inner, inside)
        jitted.compile(own)  # first by itself: messages then name the user's lines
        jitted.disable_compile()
        returned = jitted.nopython_signatures[0].return_type
        simple = isinstance(returned, (types.NoneType, types.Number, types.Boolean))
        if isinstance(returned, types.Tuple):  # entries of several types
            jitted = derived(_as_array(jitted))
        if k or start.paired:
            jitted = derived(_of_parts(jitted, k, unit), not simple)
        adapter = _adapter(jitted, candidate, arity, form, unit)
        if _PAST_READ_ONLY & code_names(key[0]):
            adapter, simple = _of_copies(derived(adapter)), False
        return DerivedValue(adapter, allocates=not simple), ""
    except Exception as error:  # numba raises exceptions of many types
        if _compiles(fresh(fun, inner, inside), [a.copy(readonly=False) for a in own[1:]]):
            raise TypeError(writing_complaint(candidate.name, plain, error)) from error
        return None, compile_reason(plain, error)


def _compiles(jitted: Any, arrays: list) -> bool:
    """Return whether a function compiles if its arguments are t and these writable arrays."""
    try:
        jitted.compile((F8, *arrays))
    except Exception:
        return False
    return True


def _as_array(fun: Any) -> Callable[..., np.ndarray]:
    """Return a function that calls `fun` and makes an array of its values."""
    return lambda *arguments: np.asarray(fun(*arguments))


def _of_copies(fun: Any) -> Fill:
    """Return a function that calls `fun` with copies of z and params, which it may change."""
    return lambda t, z, out, params: fun(t, z.copy(), out, params.copy())


def _of_parts(fun: Any, k: int, unit: complex) -> Callable[..., Any]:
    """Return a function that calls `fun` with y and, if k > 0, the k rows of memory in z."""

    def split(t: float, z: np.ndarray, *others: np.ndarray) -> Any:
        y, memory, _ = views_of(z, 1 + k, unit)
        return fun(t, y, memory, *others) if k else fun(t, y, *others)

    return split


def _adapter(fun: Any, candidate: Candidate, arity: int, form: str, unit: complex) -> Fill:
    """Return a function that calls `fun` and writes its values to the output array.

    `arity` and `form` are as in `_Version`. The loops are explicit because numba takes two seconds
    to compile ``out[...] = values``.
    """
    with_params, paired, width = arity == 3, candidate.start.paired, candidate.width
    parts = 1 + len(candidate.start.memory)

    def in_place(t: float, z: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
        fun(t, z, views_of(out, 1, unit)[0] if paired else out, params)

    def from_number(t: float, z: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
        filled = views_of(out, 1, unit)[0] if paired else out
        filled[0] = fun(t, z, params) if with_params else fun(t, z)

    def from_vector(t: float, z: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
        values = fun(t, z, params) if with_params else fun(t, z)
        filled = views_of(out, 1, unit)[0] if paired else out
        if len(values) != len(filled):
            raise ValueError(_RESHAPED)
        for i in range(len(filled)):
            filled[i] = values[i]

    def matrix_in_place(t: float, z: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
        n = out.shape[0] * parts // (z.shape[0] * width)
        fun(t, z, views_of(out, n, unit)[2], params)

    def from_matrix(t: float, z: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
        values = np.asarray(fun(t, z, params) if with_params else fun(t, z))
        columns = z.shape[0] // parts * width
        if values.shape != (out.shape[0] // columns, columns):
            raise ValueError(_RESHAPED)
        for i in range(values.shape[0]):
            for j in range(columns):
                out[i * columns + j] = values[i, j]

    if form == "in place":
        return matrix_in_place if width else in_place
    if form == "number":
        return from_number
    return from_matrix if width else from_vector


def _in_python(candidate: Candidate, arity: int) -> Fill:
    """Return ``fill(t, z, out, params)``, which calls it in Python; z is y, then memory."""
    fun, start, shape = candidate.plain, candidate.start, candidate.shape
    k, d = start.memory.shape
    kind = start.y.dtype

    def fill(t: float, z: np.ndarray, out: np.ndarray, params: np.ndarray) -> None:
        if start.paired:
            z, out = z.view(kind), out.view(kind)
        arguments = (t, z[:d], z[d:].reshape(k, d)) if k else (t, z)
        if arity == 4:
            values = np.empty(shape, kind)  # new, because `fun` may keep it
            fun(*arguments, values, params)
        else:
            values = fun(*arguments, params) if arity == 3 else fun(*arguments)
            if type(values) is list and shape == (len(values),) and len(values) <= _FEW_ENTRIES:
                for place, value in enumerate(values):  # making an array takes twice as long
                    out[place] = value
                return
            values = numbers_of(candidate, values)
        if values.shape != shape:
            if values.size != 1 or out.size != 1:
                raise ValueError(_RESHAPED)
            values = values.reshape(shape)
        out[...] = values

    return fill


def locked(array: np.ndarray) -> np.ndarray:
    """Return a read-only view of an array."""
    view = array.view()
    view.setflags(write=False)
    return view


# Length of a returned list up to which its entries are copied one by one, without an array.
_FEW_ENTRIES = 6
_RESHAPED = "the function returned another shape than at the start"


class Start(NamedTuple):
    """Arguments of trial calls: y (d,), memory (k, d), params (p,) and the time t.

    There are d components, k rows of memory and p parameters. y and memory may be complex.
    """

    y: np.ndarray
    memory: np.ndarray
    params: np.ndarray
    t: float = 0.0

    @property
    def paired(self) -> bool:
        """Whether components are complex: each then is two real components of the system."""
        return self.y.dtype.kind == "c"

    def components(self) -> np.ndarray:
        """Return y and memory as the real components of one system."""
        return np.concatenate([self.y, self.memory.ravel()]).view(float)

    def shapes(self, name: str, out: str) -> str:
        """Return the allowed lists of arguments of a function, for messages."""
        first = f"{name}(t, y" + ", memory" * (len(self.memory) > 0)
        return f"{first}), {first}, params) or, in place, {first}, {out}, params)"


class Candidate(NamedTuple):
    """A user's function with all that its checks need."""

    name: str  # of the function, for messages
    out: str  # of its output array, for messages
    fun: Any  # the function, or numba's dispatcher of one
    start: Start  # arguments of the trial calls
    shape: tuple[int, ...]  # that of the values
    hint: Callable[[], str]  # ``hint()`` is appended to messages about errors in the function

    @property
    def plain(self) -> Any:
        """The function in Python."""
        return _plain(self.fun)

    @property
    def width(self) -> int:
        """Columns of a matrix of values, for each component; 0 for a vector."""
        return self.shape[1] // len(self.start.y) if len(self.shape) > 1 else 0


def arity_of(name: str, out: str, fun: Callable[..., Any], start: Start) -> int:
    """Return the number of positional arguments of `fun`, not counting memory: 2, 3 or 4."""
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
        remedy = "pass constants through params"
        if known and len(positional) < 2 + more:
            remedy = "memory= passes memory third" if len(positional) == 2 else "take t and y"
            remedy += f", {defined(fun)}"
        refuse(name, required, got, remedy, kind=TypeError)
    if positional[1].name in ("t", "time"):
        refuse(name, "take t first and y second", got, defined(fun), kind=TypeError)
    if more and positional[2].name in ("p", "params", "dy", "jacobian"):
        reason = f"equations with memory= pass it there, {defined(fun)}"
        refuse(name, "take memory third", got, reason, kind=TypeError)
    return len(positional) - more


def try_out(candidate: Candidate, arity: int) -> tuple[np.ndarray, str]:
    """Call it twice in Python at the start; check its values, and return them and their form."""
    name, out, fun, start = candidate.name, candidate.out, candidate.plain, candidate.start
    # the two calls get output arrays with different contents, which shows entries that are not set
    (values, form), (again, _) = (_values(candidate, arity, unset) for unset in (np.nan, 0.5))
    unset = np.isnan(values) & (again == 0.5)
    if arity == 4 and unset.any():
        got = f"entries {np.argwhere(unset).tolist()} left unset"
        refuse(name, f"set every entry of {out}", got, defined(fun))
    if not np.all(np.isfinite(values)):
        remedy = f"check y0 = {shown(start.y)} and params = {shown(start.params)}, {defined(fun)}"
        refuse(name, f"be finite at t = {start.t:g}", shown(values), remedy)
    if not nearly_equal(again, values):
        got = f"{shown(values)} and then {shown(again)}"
        remedy = f"take no random numbers and keep no state, {defined(fun)}"
        refuse(name, "give equal values for equal t, y", got, remedy)
    return values, form


def nearly_equal(values: np.ndarray, expected: np.ndarray) -> bool:
    """Return whether values agree with those expected to a relative 1e-8."""
    if (values == expected).all():  # takes a tenth of the time of allclose
        return True
    return np.allclose(values, expected, rtol=1e-8, atol=1e-12 * np.abs(expected).max(initial=0.0))


def _values(candidate: Candidate, arity: int, unset: float) -> tuple[np.ndarray, str]:
    """Call it at the start; return its values as an array of its `shape`, and their form.

    `unset` fills the output array before the call.
    """
    name, out, fun = candidate.name, candidate.out, candidate.plain
    start, shape, hint = candidate.start, candidate.shape, candidate.hint
    filled = np.full(shape, unset, start.y.dtype)
    y, memory, p = (part.copy() for part in start[:3])
    first = (start.t, y, memory) if len(memory) else (start.t, y)
    arguments = {2: first, 3: (*first, p), 4: (*first, filled, p)}

    def hinted() -> str:
        if arity < 4:
            empty = arity == 3 and not p.size
            return hint() + ("; params is empty: give params=, or memory= to read" if empty else "")
        words = ("five", "fourth", "fifth") if len(memory) else ("four", "third", "fourth")
        more = "; with {} arguments the {} is {out}, to be filled, and the {} params"
        more += "" if len(memory) else f"; {name}(t, y, memory, params) needs memory="
        return hint() + more.format(*words, out=out)

    try:
        with np.errstate(all="ignore"):  # values that are not finite are reported below
            result = fun(*arguments[arity])
    except Exception as error:
        raise ValueError(
            f"{name} must run at t = {start.t:g}, got {type(error).__name__}: {error} "
            f"{line_of(error, fun)}; it was called with y = {shown(start.y)} and params = "
            f"{shown(start.params)}{of_one_number(error)}{hinted()}"
        ) from error
    for argument, given, left in zip(start._fields, start[:3], (y, memory, p), strict=False):
        if not np.array_equal(given, left):
            got = f"{shown(given)} changed to {shown(left)}"
            refuse(name, f"leave {argument} as it is", got, f"work on a copy, {defined(fun)}")
    if arity == 4:
        if result is not None:
            remedy = f"leave {out} out of the arguments to return values, {defined(fun)}{hinted()}"
            refuse(name, f"fill {out} and return None", repr(result), remedy, kind=TypeError)
        return filled, "in place"
    values = numbers_of(candidate, result)
    if values.shape != shape and not (values.ndim == 0 and np.prod(shape) == 1):
        size = f"shape {shape}" + (" or a number" if np.prod(shape) == 1 else "")
        refuse(name, f"return {size}", f"shape {values.shape}", _remedy(candidate) + hinted())
    form = "array" if values.ndim else "number"
    return values.astype(start.y.dtype).reshape(shape), form


def numbers_of(candidate: Candidate, returned: Any) -> np.ndarray:
    """Return the values that a function returned, as an array; refuse anything but numbers."""
    try:
        values = np.asarray(returned)
    except ValueError:  # rows of unequal length
        values = np.asarray(None)
    paired = candidate.start.paired
    if values.dtype.kind in ("biufc" if paired else "biuf"):
        return values
    required = "return numbers" if paired else "return real numbers"
    complex_remedy = "give y0 complex numbers for a complex solution"
    remedy = complex_remedy if values.dtype.kind == "c" else _remedy(candidate)
    refuse(candidate.name, required, repr(returned), remedy, kind=TypeError)


def _remedy(candidate: Candidate) -> str:
    """Return a remedy for messages: what the function should return."""
    return f"return numpy.array([...]) of shape {candidate.shape}, {defined(candidate.plain)}"
