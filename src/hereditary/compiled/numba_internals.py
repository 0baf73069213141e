"""Private parts of numba that the package uses, each behind a probe.

The probes run at import. They compare names, options and arguments with those of the versions of
numba that the package is tested with. If a probe fails, the package uses public numba instead:
results are the same, compilation and runs take longer, and one RuntimeWarning says so.
HEREDITARY_PLAIN_NUMBA=1 in the environment makes all probes fail, for tests.
"""

import inspect
import os
import re
import sys
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numba
from numba import config, types

from ..support.warning import warn

_PLAIN_NUMBA = os.environ.get("HEREDITARY_PLAIN_NUMBA", "0") not in ("", "0")


def _private(module, name) -> Any:
    """Return the object `name` of a module of numba; `object` if this numba lacks it."""
    try:
        return object if _PLAIN_NUMBA else getattr(import_module(f"numba.{module}"), name)
    except (ImportError, AttributeError):
        return object


_Dispatcher: Any = _private("core.registry", "CPUDispatcher")
_Compiler: Any = _private("core.compiler", "Compiler")
_Library: Any = _private("core.codegen", "JITCodeLibrary")
_FunctionCache: Any = _private("core.caching", "FunctionCache")
_IndexFile: Any = _private("core.caching", "IndexDataCacheFile")
_Result: Any = _private("core.compiler", "CompileResult")
_cpu_target: Any = _private("core.registry", "cpu_target")
_environment_of: Any = _private("core.environment", "lookup_environment")
_compiler_lock: Any = _private("core.compiler_lock", "global_compiler_lock")


class Inner(_Dispatcher):
    """Dispatcher of a function for compiled callers; a call from Python runs its source."""

    def __call__(self, *args):
        return self.py_func(*args)

    def get_call_template(self, args, kws):
        """Return the template of a call, the same for all constants that callers pass."""
        return super().get_call_template([*map(types.unliteral, args)], kws)


class _LinkedCompiler(_Compiler):
    """Compiler that stops at LLVM code, which is then linked into the callers of the function."""

    # numba would optimise and compile each function with all that it calls, then again in each
    # caller. A function that only compiled code calls needs neither: a loop and its helpers are
    # optimised once, together.

    def compile_extra(self, func):
        """Return the compile result of `func`, with a `_LinkedLibrary` as its code."""
        self.state.library = _LinkedLibrary(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


class _LinkedLibrary(_Library):
    """LLVM code of a function, which has machine code only if its address is asked for."""

    # numba asks for it if Python calls the function, which only then has an object for its
    # environment

    _alone = False  # whether it has machine code

    @property
    def codegen(self):
        """The code generator, or one that sets no environment."""
        return self._codegen if self._alone else SimpleNamespace(set_env=lambda *_: None)

    def _optimize_final_module(self):
        if self._alone:
            super()._optimize_final_module()

    def _finalize_final_module(self):
        if self._alone:
            super()._finalize_final_module()
            return
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name):
        """Return the address of a function; 0 if this library has no function of that name."""
        if not self._alone:
            functions = self._final_module.functions
            if not any(f.name == name and not f.is_declaration for f in functions):
                return 0
            self._alone = True
            if self._finalized:
                self._optimize_final_module()
                self._finalize_final_module()
        address = super().get_pointer_to_function(name)
        set_environments(SimpleNamespace(library=self))
        return address


class _Part(_LinkedLibrary):
    """LLVM code of a function, which its callers optimise."""

    def _optimize_functions(self, module):
        module.data_layout = self._codegen._data_layout


class Entries(_FunctionCache):
    """Machine code of one function in the user's cache, for one set of options and one `stamp`."""

    def __init__(self, fun, options, stamp):
        # stamp: digest of the sources
        super().__init__(fun)
        self._options = options
        self._cache_file: Any = _IndexFile(self._cache_path, _name_of(fun), stamp)

    def _index_key(self, sig, codegen):
        return _key(sig, codegen.magic_tuple(), self._options)


class Shipped:
    """Machine code of one function in a read-only folder."""

    def __init__(self, folder, fun, options, stamp, version, made_for):
        # version: numba's; made_for: what `processor` returned on the machine that made it
        self._fun, self._options, self._made_for = fun, options, made_for
        self._file: Any = _IndexFile(str(folder), _name_of(fun), stamp)
        self._file._version = version

    def load_overload(self, sig, context):
        """Return the compile result that the folder has for a signature, or None."""
        context.refresh()
        stored = self._file.load(_key(sig, self._made_for, self._options))
        result = stored and _Result._rebuild(context, *stored)
        named = result and (result.fndesc.modname, result.fndesc.qualname)
        return result if named == (self._fun.__module__, self._fun.__qualname__) else None


# Name of the processor that the user chose for numba, or None.
CHOSEN_PROCESSOR = config.CPU_NAME


def processor():
    """Return LLVM's names of the system, the processor and its features that numba compiles for."""
    return _cpu_target.target_context.codegen().magic_tuple()


def _name_of(fun):
    """Return the base name of a function's files in the cache, unique in the package."""
    python = f"py{sys.version_info[0]}{sys.version_info[1]}{getattr(sys, 'abiflags', '')}"
    return re.sub("[<>]", "", f"{fun.__module__}.{fun.__qualname__}.{python}")


def _key(sig, processor, options):
    # numba's own key would contain the closed-over values, which have other pickles in every
    # process; the stamp of the files covers them
    return sig, processor, options, bool(config.BOUNDSCHECK)


def _arguments(call):
    return {*inspect.signature(call).parameters}


def _takes(owner, *calls):
    """Return whether a class has methods of these names and arguments, such as "load key"."""
    return all(
        [*inspect.signature(getattr(owner, name)).parameters][1:] == arguments
        for name, *arguments in map(str.split, calls)
    )


def _links():
    options = {"_nrt", "no_cpython_wrapper", "no_cfunc_wrapper"}
    steps = "optimize_final_module finalize_final_module finalize_dynamic_globals ensure_finalized "
    steps += "verify_declare_only_symbols"
    return (
        _takes(_Dispatcher, "get_call_template args kws")
        and {"py_func", "targetoptions", "pipeline_class"} <= _arguments(_Dispatcher)
        and options <= set(dir(_private("core.cpu", "CPUTargetOptions")))
        and _takes(_Library, *(f"_{step}" for step in steps.split()))
        and _takes(_Library, "__init__ codegen name", "get_pointer_to_function name")
        and isinstance(_Library.codegen, property)
        and _takes(_Compiler, "compile_extra func")
        and "library" in _arguments(_Compiler)
        and _takes(_Library, "_optimize_functions ll_module")
        and {"env_name"} == _arguments(_environment_of)
        and hasattr(_private("core.codegen", "JITCPUCodegen"), "_library_class")
        and hasattr(_private("core.codegen", "RuntimeLinker")(), "_unresolved")
        and callable(_compiler_lock.__enter__)
        and _takes(_private("core.codegen", "JITCPUCodegen"), "set_env env_name env")
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
    """Return whether a probe passes; any exception in it counts as failure."""
    try:
        return not config.DISABLE_JIT and probe()
    except Exception:
        return False


LINKED = _passes(_links)
STORED = _passes(_stores)
if not (config.DISABLE_JIT or (LINKED and STORED)):
    _MISSING = ["linked functions"] * (not LINKED) + ["code on disk"] * (not STORED)
    warn(
        f"hereditary uses plain numba {numba.__version__} in place of private parts that are "
        f"missing ({', '.join(_MISSING)}): results are the same, compilation and runs take longer; "
        "install numba>=0.61,<0.69",
        RuntimeWarning,
    )


def keep(dispatcher, cache):
    """Make `cache` store and load the compile results of a dispatcher."""
    dispatcher._cache = cache


def options_of(jitted):
    """Return the options of numba.jit that a function was compiled with."""
    return getattr(jitted, "targetoptions", {"nopython": True})


def stated_options(options):
    """Represent options of numba.jit as text, equal in every process."""
    return repr(sorted((k, sorted(v) if isinstance(v, set) else v) for k, v in options.items()))


def without(*wrappers):
    """Return options of numba.jit that omit these wrappers; each takes time and 1 MB."""
    return {f"no_{name}_wrapper": True for name in wrappers if LINKED}


def uncounted():
    """Return options of numba.jit that switch off reference counting; callers keep arrays alive."""
    return {"_nrt": False} if LINKED else {}


def linked(fun, options):
    """Return `fun`, with options of numba.jit, with LLVM code that is linked into its callers."""
    if not LINKED:
        return numba.njit(**{name: value for name, value in options.items() if name != "_nrt"})(fun)
    options |= {"nopython": True, **without("cpython", "cfunc")}
    return Inner(py_func=fun, targetoptions=options, pipeline_class=_LinkedCompiler)


def set_environments(result):
    """Set in the machine code of a result the environments of all functions linked into it."""
    for variable in result.library._final_module.global_variables if LINKED else ():
        environment = _environment_of(variable.name)
        if environment is not None:
            result.library.codegen.set_env(variable.name, environment)


def built_as_one(build):
    """Return ``build()``, which makes one compiled function of several."""
    # Only a function whose address is asked for gets machine code, with all that it calls, in half
    # the time. Recursive functions are found by their addresses: then build is called again, and
    # each gets its own.
    if not LINKED:
        return build()
    _cpu_target.target_context.refresh()  # numba's runtime has machine code of its own
    codegen = _cpu_target.target_context.codegen()
    with _compiler_lock:
        library_class, codegen._library_class = codegen._library_class, _Part
        missing = set(codegen._rtlinker._unresolved)
        try:
            built = build()
        finally:
            codegen._library_class = library_class
        return built if missing == set(codegen._rtlinker._unresolved) else build()


def address_of(result):
    """Return the address of the machine code of a compile result."""
    return result.library.get_pointer_to_function(result.fndesc.llvm_func_name)
