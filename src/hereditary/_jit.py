"""How functions are compiled and cached (floor 0).

`kernel` is for helpers called from compiled code, `entry` for the loops that Python calls,
`as_value` for a compiled function that is handed to an entry as a first-class value. Entries are
compiled at first use for one fixed list of argument types and then locked, so they are compiled
once per machine, whatever functions they are given.
"""

import hashlib
import threading
from functools import lru_cache
from pathlib import Path

from numba import config, njit, types
from numba.core.caching import FunctionCache

F8 = types.float64
I8 = types.int64
VEC = types.Array(F8, 1, "C")
MAT = types.Array(F8, 2, "C")
CUBE = types.Array(F8, 3, "C")
CUBES = types.Array(F8, 4, "C")
IVEC = types.Array(I8, 1, "C")

# t, y, dy, params: fills dy (d,)
RHS_SIG = types.void(F8, VEC, VEC, VEC)
# t, y, jacobian, params: fills jacobian (d, d)
JAC_SIG = types.void(F8, VEC, MAT, VEC)


def _package_digest():
    """Digest of every source file of the package and of the flags that change compiled code.

    numba notices a change in the file that defines a cached function, not one in the helpers it
    calls, nor a switch of bounds checking; either would hand back old machine code in silence.
    """
    digest = hashlib.sha256(str(bool(config.BOUNDSCHECK)).encode())
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


_DIGEST = _package_digest()


class _PackageCache(FunctionCache):
    """The on-disk cache of one function, keyed by the whole package as well."""

    def _index_key(self, sig, codegen):
        return (*super()._index_key(sig, codegen), _DIGEST)


def kernel(fun, fused=False):
    """Compile `fun` on first call: cached on disk, without the GIL, with IEEE division.

    With `fused` a product may be added without being rounded first; nothing is reordered.
    """
    loose = {"contract"} if fused else False
    dispatcher = njit(nogil=True, error_model="numpy", fastmath=loose)(fun)
    if not config.DISABLE_JIT:
        dispatcher._cache = _PackageCache(fun)
    return dispatcher


def inlined(fun):
    """Compile `fun` into its callers.

    For a few lines in a step loop that touch many arrays: handing those to a function costs 45 ns a
    call in reference counting.
    """
    return njit(inline="always")(fun)


def as_value(fun, signature):
    """Compile `fun` for `signature`, so that it can be passed as a function value."""
    if config.DISABLE_JIT:
        return fun
    with _COMPILING:
        if signature.args not in fun.overloads:
            fun.compile(signature.args)
        compiled = fun.overloads[signature.args]
        if isinstance(fun._cache, _PackageCache):
            # numba looks the function up by its signature, and its two addresses by their names,
            # at every entry to a loop, which takes 20 us; the package's own functions have but
            # one signature
            loaded = _Loaded(compiled)
            fun.get_compile_result = lambda _: loaded
    return fun


class _Loaded:
    """A compile result that remembers where its functions are."""

    def __init__(self, compiled):
        self.fndesc = compiled.fndesc
        self.library = self
        self.get_pointer_to_function = lru_cache(compiled.library.get_pointer_to_function)


# One lock for every compilation: numba's compiler is not safe to enter from two threads.
_COMPILING = threading.RLock()


class entry:
    """Decorator of a top-level loop: compiled for `argtypes` at the first call, then locked."""

    def __init__(self, *argtypes, fused=False):
        self.argtypes, self.fused = argtypes, fused

    def __call__(self, fun):
        if config.DISABLE_JIT:
            return fun
        dispatcher = kernel(fun, self.fused)

        def call(*args):
            if not dispatcher.overloads:
                with _COMPILING:
                    if not dispatcher.overloads:
                        dispatcher.compile(self.argtypes)
                        dispatcher.disable_compile()
            return dispatcher(*args)

        call.__doc__ = fun.__doc__
        call.__name__ = fun.__name__
        call.dispatcher = dispatcher
        return call
