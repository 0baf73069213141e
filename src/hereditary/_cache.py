"""On-disk cache of machine code, keyed by all functions that it was made from."""

import hashlib
import inspect
import re
import sys
import warnings
from contextlib import suppress
from pathlib import Path

import numpy as np
from numba.extending import is_jitted

from .compiled.numba_internals import STORED, Entries, options_of
from .functions.reads import names_in


class CodeCache:
    """On-disk cache of one function of the package.

    numba notices a change in the file that defines a cached function, but not in the helpers it
    calls, nor a switch of bounds checking or of fused arithmetic, and would return outdated machine
    code. An entry here is valid for the code of every function that this one can reach, as it was
    loaded, and for nothing else: an edit recompiles the functions it changes and their callers.
    Where the cache has no place, or an entry cannot be read, the function is compiled anew, with a
    single warning.

    Parameters
    ----------
    fun : function
        The function to compile.
    options : str
        Everything else its machine code depends on.
    told : str, optional
        Name under which a compilation that takes seconds is told of on standard error.
    """

    def __init__(self, fun, options, told=None):
        self._fun, self._options, self._told = fun, options, told
        self._opened = False
        self._entries = None

    def load_overload(self, sig, target_context):
        """Return the stored compile result for a signature, or None."""
        found, entries = None, self._open()
        try:
            found = entries and entries.load_overload(sig, target_context)
        except Exception:  # a damaged entry may raise anything
            with suppress(OSError):
                entries.flush()
        if found is None and self._told and sys.stderr is not None:
            once = ", once on this machine" if entries is not None else ""
            with suppress(OSError, ValueError):  # of a stream that is closed
                sys.stderr.write(f"hereditary: compiling {self._told}{once} ...\n")
        return found

    def save_overload(self, sig, data):
        """Store a compile result."""
        entries = self._open()
        try:
            if entries is not None:
                entries.save_overload(sig, data)
        except OSError as error:
            _warn_once(str(error))

    @property
    def cache_path(self):
        """Folder of the cache, or None."""
        return getattr(self._open(), "cache_path", None)

    def _open(self):
        """Open the entries at first use, or return None with a warning."""
        if STORED and not self._opened:  # helpers further down in a file exist only now
            self._opened = True
            stamp = reached_digest(self._fun)
            try:
                self._entries = Entries(self._fun, self._options, _file_name(self._fun), stamp)
            except (RuntimeError, OSError, AttributeError) as error:
                _warn_once(str(error))
        return self._entries


def _file_name(fun):
    """Return the name of a function's entries, independent of its line number."""
    module = Path(fun.__code__.co_filename).stem
    name = re.sub(r"[^\w.]", "", fun.__qualname__)
    return f"{module}.{name}.py{sys.version_info[0]}{sys.version_info[1]}{sys.abiflags}"


def reached_digest(fun):
    """Return a digest of the code and constants of all functions that `fun` can reach."""
    digest = hashlib.sha256()
    seen, ahead = set(), [fun]
    while ahead:
        function = ahead.pop()
        if function in seen:
            continue
        seen.add(function)
        digest.update(_described(function.__code__).encode())
        for name, value in sorted(_used(function), key=lambda pair: pair[0]):
            value = getattr(value, "dispatcher", value)  # of an entry
            if is_jitted(value):
                ahead.append(value.py_func)
                digest.update(stated_options(value).encode())
            elif isinstance(value, np.ndarray):
                digest.update(f"{name} {value.dtype} {value.shape}".encode() + value.tobytes())
            elif isinstance(value, bool | int | float | str | tuple):
                digest.update(f"{name} {value!r}".encode())
    return digest.hexdigest()


def stated_options(dispatcher):
    """Represent the options that a function is compiled with as text, equal in every process."""
    options = options_of(dispatcher).items()
    return repr(sorted((k, sorted(v) if isinstance(v, set) else v) for k, v in options))


def _described(code):
    """Represent a code object as text, without docstring and line numbers."""
    constants = list(code.co_consts)
    if constants and isinstance(constants[0], str):
        constants[0] = ""  # the docstring of a function
    described = [_described(c) if inspect.iscode(c) else repr(c) for c in constants]
    names = code.co_name, code.co_names, code.co_varnames, code.co_freevars
    return repr((*names, code.co_code, described))


def _used(function):
    """List names and values of the globals and closed-over variables that a function reads."""
    names = set(names_in(function.__code__)) & function.__globals__.keys()
    found = [(name, function.__globals__[name]) for name in names]
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    return [*found, *((name, cell.cell_contents) for name, cell in cells)]


_warned = False


def _warn_once(reason):
    """Warn, once in a process, that compiled code cannot be stored."""
    global _warned
    if not _warned:
        _warned = True
        warnings.warn(
            f"compiled code cannot be kept on disk ({reason}), so every process compiles it anew; "
            "set NUMBA_CACHE_DIR to a folder that can be written to",
            RuntimeWarning,
            stacklevel=2,
        )
