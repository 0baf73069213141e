"""Digests of values, equal for equal contents in every process and after pickling.

A function is represented by its bytecode, its constants and the values it takes from outside, so a
digest changes with the version of Python, which compiles to other bytecode.
"""

import hashlib
import inspect
import sys
import types

import numpy as np

from ._frozen import installed, names_in

_PLAIN = (bool, int, float, complex, str, bytes, type(None), type(...))
# Functions of these modules are represented by their names.
_FOREIGN = frozenset({"numpy", "scipy", "numba", *sys.stdlib_module_names})


def digest(*values):
    """Return sixteen hexadecimal digits that identify these values."""
    found = hashlib.sha256()
    _feed(found, values, ())
    return found.hexdigest()[:16]


def _feed(found, value, above):
    """Add a value to a digest; `above` holds the ids of its containers, for it may be recursive."""
    if id(value) in above:
        found.update(b"itself;")
        return
    above = (*above, id(value))
    value = getattr(value, "py_func", value)  # of a function compiled by numba
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray) and value.dtype.kind != "O":
        found.update(f"array {value.dtype.str} {value.shape}:".encode())
        found.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, _PLAIN):
        found.update(f"{type(value).__name__} {value!r};".encode())
    elif isinstance(value, types.ModuleType):
        found.update(f"module {value.__name__};".encode())
    else:
        kind, parts = _taken_apart(value)
        found.update(f"{kind} of {len(parts)}:".encode())
        for part in parts:
            _feed(found, part, above)


def _taken_apart(value):
    """Return a name for the kind of a value, and its parts."""
    if isinstance(value, (tuple, list)):
        return "list", list(value)
    if isinstance(value, (set, frozenset)):
        return "set", sorted(digest(part) for part in value)
    if isinstance(value, dict):
        return "dict", sorted(value.items(), key=lambda item: repr(item[0]))
    if isinstance(value, types.CodeType):
        return "code", [value.co_argcount, value.co_code, value.co_names, value.co_consts]
    name = f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', '')}"
    if inspect.isfunction(value) and name.split(".")[0] not in _FOREIGN:
        return "function", [value.__code__, value.__defaults__, _outside(value)]
    if callable(value) and hasattr(value, "__name__"):  # built-in, ufunc, class or foreign
        owner = getattr(value, "__self__", None)
        bound = [value.__func__, owner] if inspect.ismethod(value) else []
        return f"{name} {value.__name__}" if not bound else "method", bound
    try:
        parts = value.__reduce_ex__(4)[:3]
    except Exception:  # a value that cannot be pickled is represented by its kind
        parts = ()
    return f"{type(value).__module__}.{type(value).__qualname__}", parts


def outer_values(function):
    """List the values a function takes from its closure, globals, and modules among these."""
    cells = _closed_over(function)
    names = set(names_in(function.__code__))
    held = [function.__globals__[name] for name in sorted(names & function.__globals__.keys())]
    for module in [value for value in cells + held if inspect.ismodule(value)]:
        if not installed(getattr(module, "__file__", None) or "<frozen"):
            held += [vars(module)[name] for name in sorted(names & vars(module).keys())]
    return cells + held


def _outside(function):
    """List what a function takes from outside; of one that is installed its closure alone."""
    if installed(function.__code__.co_filename):
        return _closed_over(function)
    return outer_values(function)


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
