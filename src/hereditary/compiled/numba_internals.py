"""Private parts of numba that the package uses, each behind a probe.

The probes run at import. They compare names, options and arguments with those of the versions of
numba that the package is tested with. Where one fails, plain numba stands in: results are the same,
compilation and runs take longer, and one RuntimeWarning says so. HEREDITARY_PLAIN_NUMBA=1 in the
environment makes all probes fail, for tests.
"""

import inspect
import os
import re
import sys
from functools import lru_cache
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numba
from numba import TypingError, config, types

from ..support.warning import warn

_PLAIN = os.environ.get("HEREDITARY_PLAIN_NUMBA", "0") not in ("", "0")


def _private(module, name) -> Any:
    """Return a private name of numba, or `object` where there is none."""
    try:
        return object if _PLAIN else getattr(import_module(f"numba.{module}"), name)
    except (ImportError, AttributeError):
        return object


_Dispatcher: Any = _private("core.registry", "CPUDispatcher")
_Compiler: Any = _private("core.compiler", "Compiler")
_Library: Any = _private("core.codegen", "JITCodeLibrary")
_FunctionCache: Any = _private("core.caching", "FunctionCache")
_IndexFile: Any = _private("core.caching", "IndexDataCacheFile")
_Result: Any = _private("core.compiler", "CompileResult")
_cpu_target: Any = _private("core.registry", "cpu_target")


class Inner(_Dispatcher):
    """A compiled function for compiled callers: Python runs its source."""

    def __call__(self, *args):
        return self.py_func(*args)

    def get_call_template(self, args, kws):
        """Compile once for an argument, whatever constants callers give for it."""
        return super().get_call_template([*map(types.unliteral, args)], kws)


class _LinkedCompiler(_Compiler):
    """Compiler of a function whose code is kept to be linked into its callers.

    Before numba links a function into its callers, it optimises it together with all that it calls,
    and makes machine code of the result. In the callers both happen again. A function that only
    compiled code calls needs neither: a loop and its helpers are optimised once, as a whole.
    """

    def compile_extra(self, func):
        """Compile a function."""
        self.state.library = _LinkedLibrary(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


class _LinkedLibrary(_Library):
    """Code that is neither optimised as a whole nor made machine code, and has no environment."""

    codegen = SimpleNamespace(set_env=lambda name, environment: None)

    def _optimize_final_module(self):
        pass

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name):
        """Return 0, for there is no such machine code."""
        self._ensure_finalized()
        return 0


class Value(_Dispatcher):
    """A compiled function of one signature that is handed to loops.

    At every entry numba would make its type anew. It would look up the function by its signature
    and its two addresses by their names, which takes 25 us.
    """

    _numba_type_ = property(lambda self: self._own_type)

    def get_compile_result(self, sig):
        """Return the compile result, for its signature alone."""
        if sig is not self._asked:  # a comparison takes 1 us
            if sig != self._signature:
                raise TypingError(f"{self.__name__} is {self._signature}, not {sig}")
            self._asked: Any = sig
        return self._loaded

    def _reduce_class(self):
        return _Dispatcher


class _Loaded:
    """A compile result that remembers where its functions are."""

    def __init__(self, compiled):
        self.fndesc = compiled.fndesc
        self.library = self
        find, own = compiled.library.get_pointer_to_function, self.fndesc.llvm_func_name
        # entries have no wrapper for C, which is never called, but asked for
        self.get_pointer_to_function = lru_cache(lambda name: find(name) or find(own))


class Entries(_FunctionCache):
    """Machine code of one function in the user's cache, of one stamp and one set of options."""

    def __init__(self, fun, options, stamp):
        super().__init__(fun)
        self._options = options
        self._cache_file: Any = _IndexFile(self._cache_path, _name_of(fun), stamp)

    def _index_key(self, sig, codegen):
        return _key(sig, codegen.magic_tuple(), self._options)


class Shipped:
    """Machine code of one function in a folder that is only read, made by `version` of numba.

    `made_for` is what `processor` returned there.
    """

    def __init__(self, folder, fun, options, stamp, version, made_for):
        self._fun, self._options, self._made_for = fun, options, made_for
        self._file: Any = _IndexFile(str(folder), _name_of(fun), stamp)
        self._file._version = version

    def load_overload(self, sig, context):
        """Return the stored compile result for a signature, or None."""
        context.refresh()
        found = self._file.load(_key(sig, self._made_for, self._options))
        result = found and _Result._rebuild(context, *found)
        named = result and (result.fndesc.modname, result.fndesc.qualname)
        return result if named == (self._fun.__module__, self._fun.__qualname__) else None


# Name of the processor that the user chose for numba, or None.
CHOSEN_PROCESSOR = config.CPU_NAME


def processor():
    """Return LLVM's names of the system, the processor and its features that code is made for."""
    return _cpu_target.target_context.codegen().magic_tuple()


def _name_of(fun):
    """Return the name of a function's files, which no other function of the package has."""
    python = f"py{sys.version_info[0]}{sys.version_info[1]}{getattr(sys, 'abiflags', '')}"
    return re.sub("[<>]", "", f"{fun.__module__}.{fun.__qualname__}.{python}")


def _key(sig, processor, options):
    # numba's own key would hold what the function closes over, which is pickled anew in every
    # process; the stamp stands for all that
    return sig, processor, options, bool(config.BOUNDSCHECK)


def _takes(owner, *calls):
    """Return whether a class has methods of the given names and arguments."""
    return all(
        [*inspect.signature(getattr(owner, name)).parameters][1:] == arguments
        for name, *arguments in map(str.split, calls)
    )


def _becomes(subclass):
    """Return a compiled function that has become one of a subclass."""
    trial: Any = numba.njit(_becomes)
    trial._own_type = trial._numba_type_
    trial.__class__ = subclass
    return trial


def _links():
    options = {"_nrt", "no_cpython_wrapper", "no_cfunc_wrapper", "forceinline"}
    steps = "optimize_final_module finalize_final_module finalize_dynamic_globals ensure_finalized "
    steps += "verify_declare_only_symbols"
    return (
        isinstance(_becomes(Inner), Inner)
        and _takes(_Dispatcher, "get_call_template args kws")
        and options <= set(dir(_private("core.cpu", "CPUTargetOptions")))
        and _takes(_Library, *(f"_{step}" for step in steps.split()))
        and _takes(_Library, "__init__ codegen name", "get_pointer_to_function name")
        and isinstance(_Library.codegen, property)
        and _takes(_Compiler, "compile_extra func")
        and "library" in inspect.signature(_Compiler).parameters
        and _takes(_Result, "_find_referenced_environments")
        and _takes(_private("core.codegen", "JITCPUCodegen"), "set_env env_name env")
    )


def _hands_on():
    trial = _becomes(Value)
    return (
        numba.typeof(trial) is trial._own_type
        and _takes(_Dispatcher, "get_compile_result sig", "_reduce_class")
        and _takes(_Library, "get_pointer_to_function name")
        and hasattr(_private("core.funcdesc", "FunctionDescriptor"), "llvm_func_name")
    )


def _stores():
    calls = "load_overload sig target_context", "save_overload sig data", "flush"
    kept = hasattr(numba.njit(_stores), "_cache")
    return (
        kept
        and _takes(_FunctionCache, "_index_key sig codegen", *calls)
        and _takes(_IndexFile, "load key", "__init__ cache_path filename_base source_stamp")
        and hasattr(_Result, "_rebuild")
        and len(processor()) == 3
    )


def _passes(probe):
    """Return whether a probe passes; numba may have become anything."""
    try:
        return not config.DISABLE_JIT and probe()
    except Exception:
        return False


_FOUND = [*map(_passes, (_links, _hands_on, _stores))]
LINKED, FUNCTION_VALUES, STORED = _FOUND
if not (config.DISABLE_JIT or all(_FOUND)):
    _NAMES = "linked functions", "function values", "code on disk"
    _missing = ", ".join(name for name, found in zip(_NAMES, _FOUND, strict=True) if not found)
    warn(
        f"hereditary uses plain numba {numba.__version__} in place of private parts that are "
        f"missing ({_missing}): results are the same, compilation and runs take longer; install "
        "numba>=0.61,<0.69",
        RuntimeWarning,
    )


def keep(dispatcher, cache):
    """Let a cache keep the compile results of a function."""
    dispatcher._cache = cache


def options_of(jitted):
    """Return the options of numba.jit that a function was compiled with."""
    return getattr(jitted, "targetoptions", {"nopython": True})


def stated_options(options):
    """Represent options of numba.jit as text, equal in every process."""
    return repr(sorted((k, sorted(v) if isinstance(v, set) else v) for k, v in options.items()))


def without(*wrappers):
    """Return options of numba.jit that leave wrappers out, which take time and 1 MB each."""
    return {f"no_{name}_wrapper": True for name in wrappers if LINKED}


def uncounted():
    """Return options of numba.jit that count no references to arrays, which callers keep alive."""
    return {"_nrt": False} if LINKED else {}


def linking(**options):
    """Return options of numba.jit for a function that is linked into its callers."""
    own = {**options, **without("cpython", "cfunc"), "pipeline_class": _LinkedCompiler}
    return own if LINKED else {}


def set_environments(result):
    """Tell the machine code of a compile result the environments of all that is linked into it."""
    for environment in result._find_referenced_environments() if LINKED else ():
        result.library.codegen.set_env(environment.env_name, environment)


def become_value(dispatcher, signature):
    """Let a compiled function be handed to loops, as a value of one signature."""
    result = dispatcher.overloads[signature.args]
    returned = types.unliteral(result.signature.return_type)
    if returned != signature.return_type:
        raise TypeError(f"{dispatcher.__name__} must be {signature}; it returns {returned}")
    if FUNCTION_VALUES:
        dispatcher._signature = dispatcher._asked = signature
        dispatcher._own_type = dispatcher._numba_type_
        dispatcher._loaded, dispatcher.__class__ = _Loaded(result), Value
