"""Values that compilation freezes into a function, and copies with present values.

numba compiles the globals and closed-over values of a function as constants, and those of the
helpers that it calls. Compiled functions are therefore equal only if their code and all of
these values are.
"""

import hashlib
import inspect
import sysconfig
from types import CellType, FunctionType
from typing import Any

import numpy as np
from numba import jit
from numba.extending import is_jitted

from ..compiled.numba_internals import options_of

# Where packages are installed; what they hold is not the user's.
_INSTALLED = tuple({sysconfig.get_path(name) for name in ("purelib", "platlib", "stdlib")})


def installed(path):
    """Return whether a file belongs to Python or to an installed package."""
    return str(path).startswith((*_INSTALLED, "<frozen"))


def _is_helper(value, caller):
    """Return whether a value is a function that is compiled together with `caller`.

    Plain functions of other packages are not: there may be no end to what they call.
    """
    if not inspect.isfunction(value):
        return is_jitted(value)
    own = str(value.__module__).split(".")[0] == str(caller.__module__).split(".")[0]
    return own or not installed(value.__code__.co_filename)


def _parts(helper):
    """Return the Python function of a helper, and its numba options."""
    if is_jitted(helper):
        return helper.py_func, options_of(helper)
    return helper, {"nopython": True}


def frozen_values(fun):
    """Return the code of `fun` and of its helpers with all frozen values; hashable."""
    functions = [fun]
    held: list[Any] = []
    for function in functions:  # which grows
        held.append(function.__code__)
        for name, value in sorted(_read(function).items()):
            of_module = "." in name  # where numba takes compiled functions alone
            if not (is_jitted(value) if of_module else _is_helper(value, function)):
                held.append((name, _identity(value)))
                continue
            helper, options = _parts(value)
            if helper not in functions:
                functions.append(helper)
            held.append((name, functions.index(helper), repr(sorted(options.items()))))
    return tuple(held)


def code_names(frozen):
    """Return all names of globals and attributes in the code found by `frozen_values`."""
    return {name for value in frozen if inspect.iscode(value) for name in names_in(value)}


def fresh(fun, own_options, helper_options):
    """Return a dispatcher for a copy of `fun` that calls fresh copies of its helpers.

    A dispatcher keeps the code it compiled first, with the values and options of that time. Helpers
    reached as attributes of a module stay as they are.

    Parameters
    ----------
    fun : function or Dispatcher
    own_options, helper_options : dict
        Options of numba.jit for `fun` and for its helpers, which override those they have.
    """

    def compiled(copy, given):
        own = own_options if given is fun else helper_options
        return jit(**(_parts(given)[1] | own))(copy)

    return _copied(fun, compiled)


def uncompiled(fun):
    """Return a copy of `fun` in plain Python, its helpers included."""
    return _copied(fun, lambda copy, given: copy)


def _copied(fun, make):
    """Copy a function and its helpers, each made by ``make(copy, given)``."""
    made: dict[int, Any] = {}

    def again(given):
        if id(given) not in made:
            plain, _ = _parts(given)
            copy = _blank(plain)
            made[id(given)] = make(copy, given)
            names = set(names_in(plain.__code__)) & plain.__globals__.keys()
            found = {name: held(plain.__globals__[name], plain) for name in names}
            copy.__globals__.update(found)
            for own, cell in zip(copy.__closure__ or (), plain.__closure__ or (), strict=True):
                own.cell_contents = held(cell.cell_contents, plain)
        return made[id(given)]

    def held(value, caller):
        return again(value) if _is_helper(value, caller) else value

    return again(fun)


def _blank(plain):
    """Return a function with the code of `plain`, and globals and closure to be filled."""
    inherited = ("__name__", "__builtins__")
    known = {name: plain.__globals__[name] for name in inherited if name in plain.__globals__}
    cells = tuple(CellType() for _ in plain.__closure__ or ())
    copy = FunctionType(plain.__code__, known, plain.__name__, plain.__defaults__, cells)
    copy.__qualname__, copy.__kwdefaults__ = plain.__qualname__, plain.__kwdefaults__
    return copy


def _read(function):
    """Return the names and values that a function reads besides its arguments."""
    names = set(names_in(function.__code__))
    found = {name: function.__globals__[name] for name in names & function.__globals__.keys()}
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    found |= {f"{name} closed over": cell.cell_contents for name, cell in cells}
    found |= {f"default {i}": value for i, value in enumerate(function.__defaults__ or ())}
    found |= {f"{name} by default": v for name, v in (function.__kwdefaults__ or {}).items()}
    for module in [value for value in found.values() if inspect.ismodule(value)]:
        own = names & vars(module).keys()
        found |= {f"{module.__name__}.{name}": vars(module)[name] for name in own}
    return found


def names_in(code):
    """Iterate over names of globals and attributes in a code object and nested ones."""
    yield from code.co_names
    for constant in code.co_consts:
        if inspect.iscode(constant):
            yield from names_in(constant)


class _Itself:
    """Key of an object that equals only itself; keeps the object alive."""

    def __init__(self, value):
        self._value = value

    def __eq__(self, other):
        return isinstance(other, _Itself) and self._value is other._value

    def __hash__(self):
        return id(self._value)


def _identity(value):
    """Return a hashable key that is equal for equal frozen values."""
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        content = hashlib.sha256(value.tobytes()).digest()
        # numba compiles for the layout too
        return value.shape, value.strides, value.dtype.str, content
    if isinstance(value, int | float | complex | bool | str | np.generic):
        return type(value), repr(value)
    if isinstance(value, list | tuple):
        return type(value), tuple(_identity(v) for v in value)
    return _Itself(value)
