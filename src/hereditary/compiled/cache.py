"""Machine code on disk: shipped with the package, or in the user's cache."""

import hashlib
import json
import sys
import warnings
from contextlib import suppress
from functools import cache, cached_property
from pathlib import Path
from typing import NamedTuple

import numba

from .numba_internals import CHOSEN_PROCESSOR, STORED, Entries, Shipped, processor

# Folder of the machine code that is shipped with the package.
SHIPPED = Path(__file__).parent.parent / "machine_code"
# Name of the file in that folder that states the target of the code, as JSON.
_MADE_FOR = "made_for.json"
# Name of the file that the installation puts in its place if there is no code: a line with the
# reason, then what the compiler said.
_NO_CODE = "none.txt"


class Target(NamedTuple):
    """Target of machine code: versions of numba and Python, and the system and processor.

    The system and the processor have LLVM's names. `features` are those of the processor, such as
    "+avx2,-avx512f".
    """

    numba: str
    python: str
    system: str
    processor: str
    features: str

    def misfit(self, host: "Target") -> str:
        """Return why code for this target does not run on a host, a target too; "" if it does."""
        # the first two numbers of numba's version count, and the processor if the user chose one
        # for numba
        lacking = {name for name in self.features.split(",") if name.startswith("+")}
        lacking -= {*host.features.split(",")}
        chosen = self.processor if CHOSEN_PROCESSOR is None else CHOSEN_PROCESSOR
        for fits, target, here in (
            (_minor(self.numba) == _minor(host.numba), f"numba {self.numba}", host.numba),
            (self.python == host.python, self.python, host.python),
            (self.system == host.system, self.system, host.system),
            (chosen == self.processor, self.processor, f"NUMBA_CPU_NAME={chosen}"),
            (not lacking, f"processors with {' '.join(sorted(lacking))}", host.processor),
        ):
            if not fits:
                return f"it is for {target}, and this is {here}"
        return ""


def _minor(version: str) -> list[str]:
    return version.split(".")[:2]


def _target_here():
    """Return the target of numba's compilation in this process."""
    return Target(numba.__version__, str(sys.implementation.cache_tag), *processor())


def note_target(folder):
    """Write the target of this process into a folder of machine code that this process has made."""
    Path(folder, _MADE_FOR).write_text(json.dumps(_target_here()._asdict(), indent=1))


def shipped_target() -> tuple[Target | None, str]:
    """Return the target of the shipped machine code, and why this process cannot use it, or ""."""
    # None if there is no code. The reason's first line says it all; the output of a failed compiler
    # follows.
    if not STORED:
        return None, "numba is not to store code, or lacks what the library needs for that"
    if not SHIPPED.is_dir():
        return None, "this is an editable installation, or a folder of sources"
    try:
        if (SHIPPED / _NO_CODE).exists():
            return None, (SHIPPED / _NO_CODE).read_text(encoding="utf-8").strip()
        target = Target(**json.loads((SHIPPED / _MADE_FOR).read_text()))
        return target, target.misfit(_target_here())
    except Exception:  # the file may be damaged, or of another version
        return None, f"{SHIPPED / _MADE_FOR} is missing or damaged"


@cache
def _shipped_for():
    """Return the target of the shipped machine code; None if none fits this process."""
    target, reason = shipped_target()
    return None if reason else target


@cache
def _digest(room):
    """Return a digest of the files with compiled functions in a subpackage or a module `room`."""
    # in `compiled` all files count; elsewhere those that import compiled/jit.py
    digest, package = hashlib.sha256(), Path(__file__).parents[1]
    for path in sorted([*package.glob(f"{room}.py"), *package.glob(f"{room}/**/*.py")]):
        source = path.read_bytes()
        if room == "compiled" or b"jit import" in source:
            digest.update(source)
    return digest.hexdigest()


_NAMES: set[str] = set()


class CodeCache:
    """Machine code of one function of the package on disk, shipped or in the user's cache."""

    def __init__(self, fun, options, announced=None):
        # It is valid for one set of options and one digest of sources. Sources are the files with
        # compiled functions in `compiled` and the function's own subpackage, as no others enter.
        # Numba's own cache misses changes of helpers, of bounds checking or of fused arithmetic.
        # Functions of other packages, and all but the first of one name, are not stored. A cache
        # that cannot be written gives one warning; code that cannot be read, or is for another
        # processor, numba or Python, gives none. options: text of those of numba.jit; announced:
        # what is compiled, for a message on standard error if that takes seconds.
        self._fun, self._options, self._announced = fun, options, announced
        name, package = f"{fun.__module__}.{fun.__qualname__}", __name__.split(".")[0] + "."
        self._stored = STORED and name.startswith(package) and name not in _NAMES
        _NAMES.add(name)
        if self._stored:  # taken at import, so that an edit of the sources after it does not count
            self._stamp = _digest("compiled") + _digest(fun.__module__.split(".")[1])

    def load_overload(self, sig, target_context):
        """Return the stored compile result for a signature, or None if a compilation is needed."""
        result = self._load_shipped(sig, target_context) or self._load_own(sig, target_context)
        if result is None and self._announced and sys.stderr is not None:
            once = ", once on this machine" if self._entries is not None else ""
            reason, _, more = shipped_target()[1].partition("\n")
            reason = reason or "it is for other sources or options"
            reason += ", see python -m hereditary --version" if more else ""
            with suppress(OSError, ValueError):  # the stream may be closed
                sys.stderr.write(
                    f"hereditary: compiling {self._announced}{once} "
                    f"(no installed code is used: {reason}) ...\n"
                )
        return result

    def _load_shipped(self, sig, context):
        """Return the shipped compile result for a signature, or None."""
        target = _shipped_for() if self._stored else None
        if target is not None:
            with suppress(Exception):  # a damaged entry may raise anything
                return Shipped(
                    SHIPPED, self._fun, self._options, self._stamp, target.numba, tuple(target[2:])
                ).load_overload(sig, context)
        return None

    def _load_own(self, sig, context):
        """Return the compile result for a signature from the user's cache, or None."""
        entries = self._entries
        try:
            return entries and entries.load_overload(sig, context)
        except Exception:  # a damaged entry may raise anything
            with suppress(OSError):
                entries.flush()
        return None

    def save_overload(self, sig, data):
        """Store the compile result `data` of a signature in the user's cache."""
        try:
            if self._entries is not None:
                self._entries.save_overload(sig, data)
        except OSError as error:
            _warn_once(str(error))

    @property
    def cache_path(self):
        """Return the folder of the user's cache, or None if this function has not used it yet."""
        return getattr(vars(self).get("_entries"), "cache_path", None)

    @cached_property
    def _entries(self):
        """The function's entries in the user's cache; None if it cannot be written, or need not."""
        try:
            return Entries(self._fun, self._options, self._stamp) if self._stored else None
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
