"""Compile functions of the package.

- `entry` is for a loop that Python calls. It is compiled at the first call for one fixed list of
  argument types and for no other ones. A user's functions are arguments of one type, so that a loop
  is compiled once per machine.
- `inner` is for a function that compiled code calls by its name.
- `plug_in` is for a function that compiled code gets as a field of a record
  (compiled/reference.py). `as_value` compiles it for the signature of the field.
- `compiled` is for a function that both Python and compiled code call.
- `derived` is for a function that calls a user's functions. It is not stored on disk.
"""

import gc
import signal
import threading
from functools import cache, partial
from typing import Annotated, Any, TypeAlias, get_type_hints

import numpy as np
from numba import config, njit, types

from . import numba_internals as internals
from .cache import CodeCache
from .reference import FunctionField, Reference, as_checked, by_reference

F8 = types.float64
I8 = types.int64
VEC = types.Array(F8, 1, "C")
MAT = types.Array(F8, 2, "C")
CUBE = types.Array(F8, 3, "C")
CUBES = types.Array(F8, 4, "C")
IVEC = types.Array(I8, 1, "C")
_C16 = types.complex128
# Annotations for the fields of NamedTuples that compiled code reads, each with numba's type.
Vector: TypeAlias = Annotated[np.ndarray, VEC]
Matrix: TypeAlias = Annotated[np.ndarray, MAT]
Cube: TypeAlias = Annotated[np.ndarray, CUBE]
Cubes: TypeAlias = Annotated[np.ndarray, CUBES]
Integers: TypeAlias = Annotated[np.ndarray, IVEC]
ComplexVector: TypeAlias = Annotated[np.ndarray, types.Array(_C16, 1, "C")]
ComplexMatrix: TypeAlias = Annotated[np.ndarray, types.Array(_C16, 2, "C")]
ComplexCube: TypeAlias = Annotated[np.ndarray, types.Array(_C16, 3, "C")]


@cache
def compiled_type(cls):
    """Return numba's type of a NamedTuple class, from the annotations of its fields."""
    numbers = {int: I8, float: F8}
    hints = get_type_hints(cls, include_extras=True).values()
    kinds = [
        numbers.get(hint) or getattr(hint, "__metadata__", (None,))[0] or compiled_type(hint)
        for hint in hints
    ]
    if len(set(kinds)) == 1:
        return types.NamedUniTuple(kinds[0], len(kinds), cls)
    return types.NamedTuple(kinds, cls)


def checked(record):
    """Return a record, a NamedTuple, checked once: entries do not check it again."""
    cls: Any = type(record)
    return as_checked(record, compiled_type(cls))


# Signature of a right-hand side or its Jacobian, ``rhs(t, z, out, params)``, which fills `out`. z
# has the d components, followed by the k rows of memory that are read, ((1 + k) d,). `out` has the
# values (d,), or the rows of a Jacobian, one after another. A complex number is two real ones.
RHS_SIG = types.void(F8, VEC, VEC, VEC)


# Least thresholds of Python's garbage collector, as in gc.set_threshold, while functions are
# compiled: the compiler makes millions of objects. With the default thresholds the collector took
# 7 % of the time of compilation.
_RARELY = 20_000, 20, 50


class _Compiling:
    """Context manager of every compilation: one at a time, and never interrupted in the middle.

    numba's compiler must not be entered from two threads. An exception inside it leaves incomplete
    functions, and every later call fails. Therefore KeyboardInterrupt is delayed. It is raised
    before the compilation of the next function, or at the end.
    """

    def __init__(self):
        self._lock, self._depth, self._asked, self._previous = threading.RLock(), 0, False, None
        self._collected = gc.get_threshold()

    def __enter__(self):
        self._lock.acquire()
        self._depth += 1
        if self._depth == 1:
            self._collected = gc.get_threshold()
            if self._collected[0]:  # 0: the user switched the collector off
                gc.set_threshold(*map(max, self._collected, _RARELY))
        if self._depth == 1 and threading.current_thread() is threading.main_thread():
            self._previous = signal.getsignal(signal.SIGINT)
            if callable(self._previous):
                signal.signal(signal.SIGINT, self._ask)
        elif self._asked:
            self.__exit__()
            raise KeyboardInterrupt

    def __exit__(self, *exception):
        self._depth -= 1
        asked = False
        if self._depth == 0:
            gc.set_threshold(*self._collected)
        if self._depth == 0 and callable(self._previous):
            signal.signal(signal.SIGINT, self._previous)
            asked, self._asked, self._previous = self._asked, False, None
        self._lock.release()
        if asked and not (exception and exception[0]):
            signal.raise_signal(signal.SIGINT)

    def _ask(self, number, frame):
        self._asked = True


compiling = _Compiling()


def compiled(fun, announced=None, **options):
    """Return `fun` compiled at its first call: cached on disk, without the GIL, with IEEE division.

    `announced`, optional, names a slow compilation in a message, as in `CodeCache`. The other
    options are those of numba.jit.
    """
    dispatcher = njit(nogil=True, error_model="numpy", **options)(fun)
    if config.DISABLE_JIT:
        return dispatcher
    options = internals.stated_options(internals.options_of(dispatcher))
    internals.keep(dispatcher, CodeCache(fun, options, announced))
    return _guarded(dispatcher, internals.set_environments)


def plug_in(fun):
    """Return `fun` as a compiled function for the field of a record, cached on disk.

    Only compiled code calls it, so it has no wrapper for Python.
    """
    return compiled(fun, **internals.without("cpython", "cfunc"))


def _guarded(dispatcher, finish=None):
    """Return `dispatcher`, which compiles inside `compiling`; `finish` gets each compile result."""
    compile_alone = dispatcher.compile

    def compile_guarded(sig):
        with compiling:
            result = compile_alone(sig)
            if finish:
                finish(dispatcher.overloads[tuple(sig)])
            return result

    dispatcher.compile = compile_guarded
    return dispatcher


def inner(fun=None, *, allocates=False, fuses=False, reorders=False):
    """Return `fun` compiled as a part of its compiled callers; it has no file of its own on disk.

    It gets no wrappers for other callers, which would take a seventh of the time of all
    compilation. If Python calls it, its Python source runs.

    Parameters
    ----------
    fun : function, optional
        The function; None returns a decorator with these options.
    allocates : bool
        Whether `fun` makes or returns arrays. If not, numba's reference counting is switched off
        for `fun`; its callers keep the arrays alive.
    fuses : bool
        Whether the compiler may use fused multiply-add, without rounding the product first.
    reorders : bool
        Whether the compiler may reorder sums and use fused multiply-add. It implies `allocates`.
    """
    if fun is None:
        return partial(inner, allocates=allocates, fuses=fuses, reorders=reorders)
    if config.DISABLE_JIT:
        return fun
    counts, loose = allocates or reorders, {"contract"} if fuses else set()
    if reorders:
        loose = {"contract", "reassoc"}
    options = {"nogil": True, "error_model": "numpy", "fastmath": loose, "_nrt": counts}
    linked = internals.linked(fun, options)
    return _guarded(linked, None if counts else _refuse_arrays)


def _refuse_arrays(result):
    """Raise TypeError if a function without reference counting returns an array."""
    # its callers would release an array that the function has not counted
    returned: list[Any] = [result.signature.return_type]
    for kind in returned:  # the loop appends to this list
        if isinstance(kind, types.BaseTuple):
            returned.extend(kind)  # type: ignore[arg-type]
        if isinstance(kind, types.Array):
            raise TypeError(
                f"{result.fndesc.qualname} returns an array; make it `inner(allocates=True)`"
            )


def derived(fun, allocates=True):
    """Return a function that calls a user's functions, compiled for this process only.

    `allocates` is False if it neither makes nor returns arrays; then numba counts no references.
    Python cannot call it.
    """
    options = _counting(allocates) | internals.without("cfunc", "cpython")
    return njit(error_model="numpy", nogil=True, **options)(fun)


def _counting(allocates):
    return {} if allocates else internals.uncounted()


def as_value(fun, signature):
    """Return `fun` compiled for one signature, as the value of a field of a record.

    The result has the address of the machine code as its attribute `address`. TypeError if the
    function returns another type than the signature has.
    """
    compiled_for = getattr(fun, "of_signature", None)
    # a comparison of two signatures takes 2 us
    if config.DISABLE_JIT or compiled_for is signature or compiled_for == signature:
        return fun
    with compiling:
        if signature.args not in fun.overloads:
            fun.compile(signature.args)
        result = fun.overloads[signature.args]
        returned = types.unliteral(result.signature.return_type)
        if returned != signature.return_type:
            raise TypeError(f"{fun.__name__} must be {signature}; it returns {returned}")
        fun.address, fun.of_signature = internals.address_of(result), signature
    return fun


def loop_value(loop, signature):
    """Return the loop of an `entry`, compiled, as the value of a field of a record."""
    if config.DISABLE_JIT:
        return loop
    loop.compiled()
    return as_value(loop.dispatcher, signature)


def _as_argument(value, kind):
    return value if kind is None else by_reference(value, kind)


class entry:
    """Decorator of a top-level loop: compiled at the first call for `argtypes` only.

    `announced` names the loop in a message if its compilation takes seconds. If `allocates` is
    False, the loop makes no arrays, and numba counts no references. Counting would take a fifth of
    the time of its steps.
    """

    def __init__(self, *argtypes, announced=None, allocates=True):
        self.argtypes, self.announced, self.allocates = argtypes, announced, allocates

    def __call__(self, fun):
        if config.DISABLE_JIT:
            return fun
        # only Python calls it, and a wrapper for C would take a tenth of the compilation
        options = internals.without("cfunc") | _counting(self.allocates)
        dispatcher = compiled(fun, self.announced, **options)
        # numba's types answer isinstance slowly
        kinds = [kind if isinstance(kind, Reference) else None for kind in self.argtypes]

        def ready():
            with compiling:
                if not dispatcher.overloads:
                    dispatcher.compile(self.argtypes)
                    dispatcher.disable_compile()

        def call(*args):
            if not dispatcher.overloads:
                ready()
            return dispatcher(*map(_as_argument, args, kinds))

        call.__doc__ = fun.__doc__
        call.__name__ = fun.__name__
        call.dispatcher, call.compiled = dispatcher, ready
        return call


@entry(FunctionField(RHS_SIG), *RHS_SIG.args)
def _call(function, t, z, out, params):
    """Call a function of a user; this is the way from Python."""
    function(t, z, out, params)


class DerivedValue:
    """A function that calls a user's function, as the value of a field of a record.

    Python calls it through `_call`. A wrapper of its own would take a third of its compilation.
    """

    def __init__(self, fun, allocates=True):
        self._compiled = as_value(derived(fun, allocates), RHS_SIG)  # keeps the machine code alive
        self.address, self.of_signature = self._compiled.address, RHS_SIG
        self._numba_type_ = FunctionField(RHS_SIG)

    def __call__(self, t, z, out, params):
        _call(self, t, z, out, params)
