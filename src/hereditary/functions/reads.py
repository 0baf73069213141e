"""Collect the values that functions read, hash them, and copy functions with the present values.

numba compiles the globals and closed-over values of a function, and of the helpers that it calls,
as constants. Therefore two compiled functions are equal only if their code and all of these values
are equal. `frozen_values` collects both for comparison in one process. A `digest` identifies
contents in every process and after pickling. It changes with the version of Python, because the
bytecode does.
"""

import dis
import hashlib
import inspect
import sys
import sysconfig
from collections.abc import Callable, Collection, Hashable
from contextlib import suppress
from functools import lru_cache
from types import CellType, CodeType, FunctionType, ModuleType
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numba import jit
from numba.extending import is_jitted

from ..compiled.numba_internals import options_of, stated_options

# Folders of installed packages and of Python's library; code in them is not the user's.
_INSTALLED = tuple({sysconfig.get_path(name) for name in ("purelib", "platlib", "stdlib")})
# Packages whose functions count by their names, without their code.
_FOREIGN = frozenset({"numpy", "scipy", "numba", *sys.stdlib_module_names})
# Types of values that are compared by their text.
_TYPES_COMPARED_BY_TEXT = bool | int | float | complex | str | bytes | np.generic | None | type(...)
# Largest size in bytes of a contiguous array that numba copies into compiled code.
_COPIED_MAX = 1_000_000
# Known digests of objects that never change: their class has a true attribute `fixed_contents`.
_FIXED: WeakKeyDictionary[Any, str] = WeakKeyDictionary()


def _installed(path: object) -> bool:
    """Return whether a file belongs to Python or to an installed package."""
    return str(path).startswith((*_INSTALLED, "<frozen"))


def _package(value: Any) -> str:
    """Return the name of the package that a function, a method or an object comes from."""
    value = getattr(value, "func", value)
    module = getattr(value, "__module__", None) or type(value).__module__
    return str(module).split(".")[0]


def _is_helper(value: Any, caller: Any) -> bool:
    """Return whether a value is a function that is compiled together with `caller`."""
    # not plain functions of other installed packages, which may call any number of others
    if not inspect.isfunction(value):
        return is_jitted(value)
    return _package(value) == _package(caller) or not _installed(value.__code__.co_filename)


def _parts(helper: Any) -> tuple[Any, dict[str, Any]]:
    """Return the Python function of a helper, and the options of numba.jit for it."""
    if is_jitted(helper):
        return helper.py_func, options_of(helper)
    return helper, {"nopython": True}


def _reads(function: FunctionType) -> dict[str, Any]:
    """Return globals, closed-over values, defaults and modules' attributes by name."""
    names, held = _names_in(function.__code__), function.__globals__
    found = {name: held[name] for name in names if name in held}
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        with suppress(ValueError):  # the cell may be empty
            found[f"{name} closed over"] = cell.cell_contents
    for i, value in enumerate(function.__defaults__ or ()):
        found[f"default {i}"] = value
    for name, value in (function.__kwdefaults__ or {}).items():
        found[f"{name} by default"] = value
    for module in [value for value in found.values() if isinstance(value, ModuleType)]:
        values = {name: vars(module)[name] for name in names & vars(module).keys()}
        if module.__name__.split(".")[0] in _FOREIGN:  # their objects may contain anything
            values = {
                name: value
                for name, value in values.items()
                if isinstance(value, _TYPES_COMPARED_BY_TEXT)
            }
        found |= {f"{module.__name__}.{name}": value for name, value in values.items()}
    return found


def _names_in(code: CodeType) -> set[str]:
    """Return the names of globals and attributes in a code object and nested ones."""
    found = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            found |= _names_in(constant)
    return found


def frozen_values(fun: FunctionType) -> tuple:
    """Return the code of `fun` and of its helpers with all values that they read; hashable."""
    functions = [fun]
    held: list[Any] = []
    for function in functions:  # the loop appends helpers
        held.append(function.__code__)
        for name, value in sorted(_reads(function).items()):
            of_module = "." in name  # numba compiles no plain functions of modules
            if not (is_jitted(value) if of_module else _is_helper(value, function)):
                held.append((name, _key(value)))
                continue
            helper, options = _parts(value)
            if helper not in functions:
                functions.append(helper)
            held.append((name, functions.index(helper), stated_options(options)))
    return tuple(held)


def code_names(frozen: tuple) -> set[str]:
    """Return the names of all globals and attributes in the code that `frozen_values` returned."""
    return {name for value in frozen if inspect.iscode(value) for name in _names_in(value)}


class _Itself:
    """Key that equals only keys of the same object, and keeps that object alive."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Itself) and self.value is other.value

    def __hash__(self) -> int:
        return id(self.value)


def _contents(value: Any) -> tuple | None:
    """Return a hashable form of an array, a number or a text; None for any other type."""
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return value.shape, value.dtype.str, hashlib.sha256(value.tobytes()).hexdigest()
    return (
        (type(value).__name__, repr(value)) if isinstance(value, _TYPES_COMPARED_BY_TEXT) else None
    )


def _key(value: Any) -> Hashable:
    """Return a hashable key that is equal for equal frozen values."""
    found = _contents(value)
    if found is None:
        several = isinstance(value, list | tuple)
        return (type(value), tuple(map(_key, value))) if several else _Itself(value)
    if isinstance(value, np.ndarray):
        copied = value.flags.forc and value.nbytes <= _COPIED_MAX
        return found if copied else (found, _Itself(value))  # not copied by numba
    return found


# What tells of an array no more than its shape: attributes, and functions of it.
_TELLS_SHAPE = {"size", "shape", "ndim", "dtype"}
_OF_SHAPE = {"len", "zeros_like", "ones_like", "empty_like", "full_like"}


def reads_argument(function: Any, number: int) -> bool:
    """Return whether a function may read values of an argument; False is certain."""
    # its code then never loads the argument, or only for its shape
    plain = getattr(function, "py_func", function)
    if not isinstance(plain, FunctionType) or plain.__code__.co_argcount <= number:
        return True
    code = plain.__code__
    name = code.co_varnames[number]
    own = [one for one in dis.get_instructions(code) if one.opname not in ("PRECALL", "PUSH_NULL")]
    for before, one, after in zip(own, own[1:], own[2:], strict=False):
        names = one.argval if isinstance(one.argval, tuple) else (one.argval,)
        of_shape = before.argval in _OF_SHAPE or after.argval in _TELLS_SHAPE
        if name in names and (len(names) > 1 or not of_shape):
            return True
    return name in code.co_cellvars


def digest(*values: Any) -> str:
    """Return sixteen hexadecimal digits that identify the contents of these values."""
    return _Digests(set(map(_package, values))).of(values, ())[:16]


def digest_of_compiled(frozen: tuple, function: Any) -> str:
    """Return the digest of a compiled function, from what `frozen_values` returned for it."""
    return _digest_of_frozen(frozen, _package(function))


@lru_cache(maxsize=256)
def _digest_of_frozen(frozen: tuple, package: str) -> str:
    return _Digests({package}).of((frozen,), ())[:16]


class _Digests:
    """Digests of values and of their parts; the digest of each object is computed once."""

    def __init__(self, own: set[str]) -> None:
        # own: packages whose functions count by their code even if they are installed
        self._own = own
        self._known: dict[int, tuple[str, Any]] = {}

    def of(self, value: Any, above: tuple[int, ...]) -> str:
        """Return the digest of a value; `above` has the ids of the containers around it."""
        value = value.value if isinstance(value, _Itself) else value
        if id(value) in above:  # a container may contain itself
            return "itself"
        if id(value) not in self._known:
            lasting = getattr(type(value), "fixed_contents", False)
            found = _FIXED.get(value) if lasting else None
            if found is None:
                text = self._text(value, (*above, id(value)))
                found = hashlib.sha256(text.encode()).hexdigest()
            if lasting:
                _FIXED[value] = found
            self._known[id(value)] = found, value  # kept alive, so that no other object gets its id
        return self._known[id(value)][0]

    def _text(self, value: Any, above: tuple[int, ...]) -> str:
        """Return a text that is equal for equal contents: a kind, and digests of the parts."""
        value = getattr(value, "py_func", value)  # the function of a dispatcher
        found = _contents(value.item() if isinstance(value, np.generic) else value)
        if found is not None:
            return repr(found)
        if inspect.isfunction(value) and self._looked_into(value):
            value = frozen_values(value)
        kind, parts = self._taken_apart(value)
        digests = [self.of(part, above) for part in parts]
        return f"{kind} of {len(parts)}: {sorted(digests) if kind == 'set' else digests}"

    def _looked_into(self, function: FunctionType) -> bool:
        """Return whether a function counts by its code and what it reads, not by its name."""
        package, path = _package(function), function.__code__.co_filename
        return package not in _FOREIGN and (package in self._own or not _installed(path))

    def _taken_apart(self, value: Any) -> tuple[str, Collection[Any]]:
        """Return a name for the type of a value, and the parts that determine its contents."""
        if isinstance(value, tuple | list):
            return "list", value
        if isinstance(value, set | frozenset):
            return "set", value
        if isinstance(value, dict):
            return "dict", sorted(value.items(), key=lambda item: repr(item[0]))
        if isinstance(value, CodeType):
            return "code", [value.co_argcount, value.co_code, value.co_names, value.co_consts]
        if isinstance(value, ModuleType):
            return f"module {value.__name__}", []
        if inspect.ismethod(value):
            return "method", [value.__func__, value.__self__]
        if inspect.isfunction(value):
            held = [item for item in _reads(value).items() if item[0].endswith(" closed over")]
            return _name(value), [value.__defaults__, value.__kwdefaults__, held]
        if callable(value) and hasattr(value, "__name__"):  # built-in, ufunc or class
            return f"{_name(value)} {value.__name__}", []
        try:
            parts = list(value.__reduce_ex__(4)[:3])
        except Exception:  # a value that cannot be pickled counts by its type alone
            parts = []
        if inspect.isfunction(getattr(type(value), "__call__", None)):  # noqa: B004
            parts.append(type(value).__call__)
        return _name(type(value)), parts


def _name(value: Any) -> str:
    """Return the full name of a function or a class."""
    return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', '')}"


def fresh(fun: Any, own_options: dict[str, Any], helper_options: dict[str, Any]) -> Any:
    """Return a dispatcher for a copy of `fun` that calls fresh copies of its helpers."""
    # A dispatcher keeps the values and options of its first compilation. Helpers read as attributes
    # of a module are not copied. Both options of numba.jit replace those that functions have.

    def compiled(copy: FunctionType, given: Any) -> Any:
        own = own_options if given is fun else helper_options
        return jit(**(_parts(given)[1] | own))(copy)

    return _copied(fun, compiled)


def uncompiled(fun: Any) -> Any:
    """Return a copy of `fun` in plain Python that calls plain copies of its helpers."""
    return _copied(fun, lambda copy, given: copy)


def _copied(fun: Any, make: Callable[[FunctionType, Any], Any]) -> Any:
    """Return a copy of a function that calls copies of its helpers."""
    # make(copy, given) turns each plain copy of a function given into the result
    made: dict[int, Any] = {}

    def again(given: Any) -> Any:
        if id(given) not in made:
            plain, _ = _parts(given)
            copy = _blank(plain)
            made[id(given)] = make(copy, given)
            names = _names_in(plain.__code__) & plain.__globals__.keys()
            found = {name: held(plain.__globals__[name], plain) for name in names}
            copy.__globals__.update(found)
            for own, cell in zip(copy.__closure__ or (), plain.__closure__ or (), strict=True):
                with suppress(ValueError):  # the cell may be empty
                    own.cell_contents = held(cell.cell_contents, plain)
        return made[id(given)]

    def held(value: Any, caller: Any) -> Any:
        return again(value) if _is_helper(value, caller) else value

    return again(fun)


def _blank(plain: FunctionType) -> FunctionType:
    """Return a function with the code of `plain`, but with empty globals and closure."""
    inherited = ("__name__", "__builtins__")
    known = {name: plain.__globals__[name] for name in inherited if name in plain.__globals__}
    cells = tuple(CellType() for _ in plain.__closure__ or ())
    copy = FunctionType(plain.__code__, known, plain.__name__, plain.__defaults__, cells)
    copy.__qualname__, copy.__kwdefaults__ = plain.__qualname__, plain.__kwdefaults__
    return copy
