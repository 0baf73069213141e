"""Digests of values, equal for equal contents in every process and after pickling.

A function is represented by its bytecode, its constants and the values it takes from outside, so a
digest changes with the version of Python, which compiles to other bytecode.
"""

import hashlib
import inspect
import sys
import types
from collections import OrderedDict

import numpy as np

from .reads import installed, names_in

_PLAIN = (bool, int, float, complex, str, bytes, type(None), type(...))
# Functions of these modules are represented by their names.
_FOREIGN = frozenset({"numpy", "scipy", "numba", *sys.stdlib_module_names})


def digest(*values):
    """Return sixteen hexadecimal digits that identify these values."""
    return _Digests(map(_package, values)).of(values, ())[:16]


# Digests of functions by the values that compilation freezes into them, and how many are kept.
_REMEMBERED: OrderedDict[tuple, str] = OrderedDict()
_REMEMBERED_MAX = 256


def remembered(frozen, function):
    """Return the digest of a compiled function, known by its frozen values where it was met."""
    found = _REMEMBERED.get(frozen)
    if found is None:
        found = _REMEMBERED[frozen] = digest(function)
        if len(_REMEMBERED) > _REMEMBERED_MAX:
            _REMEMBERED.popitem(last=False)
    return found


class _Digests:
    """Digests of values and their parts, each worked out once.

    `own` are the packages whose functions are looked into although they are installed.
    """

    def __init__(self, own):
        self._own, self._known = set(own), {}

    def of(self, value, above):
        """Return the digest of a value; `above` holds the ids of its containers."""
        if id(value) in above:  # which may hold themselves
            return "itself"
        if id(value) not in self._known:
            found = hashlib.sha256(self._contents(value, (*above, id(value))))
            self._known[id(value)] = found.hexdigest(), value  # alive, so that ids stay theirs
        return self._known[id(value)][0]

    def _contents(self, value, above):
        """Return bytes that represent a value."""
        value = getattr(value, "py_func", value)  # of a function compiled by numba
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, np.ndarray) and value.dtype.kind != "O":
            named = f"array {value.dtype.str} {value.shape}:".encode()
            return named + np.ascontiguousarray(value).tobytes()
        if isinstance(value, _PLAIN):
            return f"{type(value).__name__} {value!r};".encode()
        if isinstance(value, types.ModuleType):
            return f"module {value.__name__};".encode()
        kind, parts = self._taken_apart(value)
        found = [self.of(part, above) for part in parts]
        return (
            f"{kind} of {len(found)}:{' '.join(sorted(found) if kind == 'set' else found)}".encode()
        )

    def _taken_apart(self, value):
        """Return a name for the kind of a value, and its parts."""
        if isinstance(value, (tuple, list)):
            return "list", list(value)
        if isinstance(value, (set, frozenset)):
            return "set", list(value)
        if isinstance(value, dict):
            return "dict", sorted(value.items(), key=lambda item: repr(item[0]))
        if isinstance(value, types.CodeType):
            return "code", [value.co_argcount, value.co_code, value.co_names, value.co_consts]
        name = f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', '')}"
        if inspect.isfunction(value) and name.split(".")[0] not in _FOREIGN:
            defaults = value.__defaults__, value.__kwdefaults__
            return "function", [value.__code__, *defaults, self._outside(value)]
        if callable(value) and hasattr(value, "__name__"):  # built-in, ufunc, class or foreign
            owner = getattr(value, "__self__", None)
            bound = [value.__func__, owner] if inspect.ismethod(value) else []
            return f"{name} {value.__name__}" if not bound else "method", bound
        try:
            parts = list(value.__reduce_ex__(4)[:3])
        except Exception:  # a value that cannot be pickled is represented by its kind
            parts = []
        if inspect.isfunction(getattr(type(value), "__call__", None)):  # noqa: B004
            parts.append(type(value).__call__)
        return f"{type(value).__module__}.{type(value).__qualname__}", parts

    def _outside(self, function):
        """List what a function takes from outside; of one of other packages its closure alone."""
        if installed(function.__code__.co_filename) and _package(function) not in self._own:
            return _closed_over(function)
        return outer_values(function, self._own)


def _package(value):
    """Return the name of the package that a function, a method or an object comes from."""
    value = getattr(value, "func", value)
    module = getattr(value, "__module__", None) or type(value).__module__
    return str(module).split(".")[0]


def outer_values(function, own):
    """List the values a function takes from its closure, globals, and modules among these.

    Modules of installed packages besides `own` are left out.
    """
    cells = _closed_over(function)
    names = set(names_in(function.__code__))
    held = [function.__globals__[name] for name in sorted(names & function.__globals__.keys())]
    for module in [value for value in cells + held if inspect.ismodule(value)]:
        foreign = installed(getattr(module, "__file__", None) or "<frozen")
        if not foreign or module.__name__.split(".")[0] in own:
            held += [vars(module)[name] for name in sorted(names & vars(module).keys())]
    return cells + held


def _closed_over(function):
    """List the values in the closure of a function."""
    return [cell.cell_contents for cell in function.__closure__ or () if _is_filled(cell)]


def _is_filled(cell):
    """Return whether a cell of a closure has contents."""
    try:
        cell.cell_contents  # noqa: B018
    except ValueError:
        return False
    return True
