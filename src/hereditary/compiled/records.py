"""Records that compiled code reads or changes: entries of structured arrays, and groups of arrays.

A group of arrays is a NamedTuple, whose fields are declared with their types and shapes:
``matrices: Annotated[Cube, "K s s"]``. An axis is a sum of products of letters and integers, such
as ``1+k``. An axis ``.`` has any length, and is empty at first.
"""

from functools import cache
from math import prod
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
    return made(*[_zero(kind, shape, {".": 0} | sizes) for kind, shape in _fields(made)])


@cache
def _fields(cls):
    """List (dtype, shape) of each array of a class, and (class, None) of each number."""
    hints = get_type_hints(cls, include_extras=True).values()
    parts = [(hint, *getattr(hint, "__metadata__", (None, None))) for hint in hints]
    return [(as_dtype(array.dtype) if array else hint, shape) for hint, array, shape in parts]


def _zero(kind, shape, lengths):
    axes = [] if shape is None else [_length(axis, lengths) for axis in shape.split()]
    return kind() if shape is None else np.zeros(axes, kind)


def _length(axis, lengths):
    for symbol, join in (("+", sum), ("*", prod)):
        if symbol in axis:
            return join(_length(term, lengths) for term in axis.split(symbol))
    return int(axis) if axis.isdigit() else lengths[axis]


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
