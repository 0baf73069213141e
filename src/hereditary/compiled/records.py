"""Records that compiled code reads or changes: entries of structured arrays, and groups of arrays.

A group of arrays is a NamedTuple, whose fields are declared with their types and shapes:
``matrices: Annotated[Cube, "K s s"]``. An axis is a sum of products of letters and integers, such
as ``1+k``. An axis ``.`` has any length, and is empty at first.
"""

from functools import cache
from typing import Any, TypeVar, get_type_hints

import numpy as np
from numba import config
from numba.np.numpy_support import as_dtype

_T = TypeVar("_T")


def zeros(cls: type[_T], **sizes: int) -> _T:
    """Return a group of arrays of zeros; `sizes` are the lengths of axes by their letters.

    Fields that are numbers are 0.
    """
    made: Any = cls
    code, names = _making(made)
    return eval(code, names, sizes)


@cache
def _making(cls):
    """Return the code that makes a group of arrays from the lengths of its axes, and its names."""
    hints = get_type_hints(cls, include_extras=True).values()
    names, fields = {"made": cls, "zeros": np.zeros}, []
    for n, hint in enumerate(hints):
        array, shape = getattr(hint, "__metadata__", (None, None))
        names[f"kind_{n}"] = as_dtype(array.dtype) if array else hint
        axes = None if shape is None else "".join(f"{axis}, " for axis in shape.split())
        lengths = axes and axes.replace(".", "0")
        fields.append(f"kind_{n}()" if axes is None else f"zeros(({lengths}), kind_{n})")
    return compile(f"made({', '.join(fields)})", cls.__name__, "eval"), names


def record(dtype, values=None, **fields):
    """Return a record of `dtype` that compiled code may change.

    It has the given values, or zeros. Keyword arguments set single fields.
    """
    made = np.zeros(1, dtype) if values is None else np.array([values], dtype)
    made = (made.view(np.recarray) if config.DISABLE_JIT else made)[0]
    for name, value in fields.items():
        made[name] = value
    return made


def records(values, dtype):
    """Return an array of records with these values.

    If numba compiles nothing, the fields are also attributes, as compiled code reads them. They are
    not otherwise, because np.record takes ten times as long to read a field by its name.
    """
    made = np.array(values, dtype)
    return made.view(np.recarray) if config.DISABLE_JIT else made


def plain(array):
    """Return a record or an array of records as rows of numbers; a plain array unchanged."""
    named = array.dtype.names
    return array if named is None else np.array(array.tolist(), dtype=float).reshape(-1, len(named))
