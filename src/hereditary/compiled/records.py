"""Records of named numbers that compiled code may change: entries of structured NumPy arrays."""

import numpy as np
from numba import config


def record(dtype, values=None, **fields):
    """Return a record of `dtype` that compiled code may change.

    It has the given values, or zeros. Keyword arguments set single fields.
    """
    found = np.zeros(1, dtype) if values is None else np.array([values], dtype)
    found = (found.view(np.recarray) if config.DISABLE_JIT else found)[0]
    for name, value in fields.items():
        found[name] = value
    return found


def records(values, dtype):
    """Return an array of records with these values.

    If numba compiles nothing, the fields are also attributes, as compiled code reads them. They are
    not otherwise, because np.record takes ten times as long to read a field by its name.
    """
    found = np.array(values, dtype)
    return found.view(np.recarray) if config.DISABLE_JIT else found


def plain(part):
    """Return a record or an array of records as rows of numbers; a plain array unchanged."""
    named = part.dtype.names
    return part if named is None else np.array(part.tolist(), dtype=float).reshape(-1, len(named))
