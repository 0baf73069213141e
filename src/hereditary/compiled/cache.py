"""On-disk cache of machine code, valid for one version of the package's sources."""

import hashlib
import os
import sys
import warnings
from contextlib import suppress
from functools import cached_property
from pathlib import Path

from .numba_internals import STORED, Entries


def _digest_of_sources():
    """Return a digest of all source files of the package."""
    found = hashlib.sha256()
    for folder, folders, names in os.walk(Path(__file__).parent.parent):
        folders.sort()
        for name in sorted(name for name in names if name.endswith(".py")):
            found.update(Path(folder, name).read_bytes())
    return found.hexdigest()


# Read at import: code loaded before an edit is not stored as that of the edit.
_STAMP = _digest_of_sources()
_NAMES: set[str] = set()


class CodeCache:
    """On-disk cache of one function of the package.

    A change in the file that defines a cached function is noticed by numba. It notices no change in
    the helpers, nor a switch of bounds checking or of fused arithmetic, and would return outdated
    machine code. An entry here is valid for one digest of all sources and one set of options.
    Functions of other packages, and those of one name after the first, are not stored. Where the
    cache has no place, the function is compiled anew, with a single warning; where an entry cannot
    be read, without one.

    Parameters
    ----------
    fun : function
        The function to compile.
    options : str
        Everything else its machine code depends on.
    told : str, optional
        Name of a compilation that takes seconds, for the message on standard error.
    """

    def __init__(self, fun, options, told=None):
        self._fun, self._options, self._told = fun, options, told
        name, package = f"{fun.__module__}.{fun.__qualname__}", __name__.split(".")[0] + "."
        self._stored = STORED and name.startswith(package) and name not in _NAMES
        _NAMES.add(name)

    def load_overload(self, sig, target_context):
        """Return the stored compile result for a signature, or None."""
        found, entries = None, self._entries
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
        try:
            if self._entries is not None:
                self._entries.save_overload(sig, data)
        except OSError as error:
            _warn_once(str(error))

    @property
    def cache_path(self):
        """Return the folder of the cache, or None."""
        return getattr(self._entries, "cache_path", None)

    @cached_property
    def _entries(self):
        """Open the entries on disk; None if there is no place for them."""
        try:
            return Entries(self._fun, self._options, _STAMP) if self._stored else None
        except (RuntimeError, OSError, AttributeError) as error:
            _warn_once(str(error))


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
