"""Records that compiled code may change, and the arrays of numbers that they are stored as."""

import numpy as np
from numba import config


def record(dtype, values=None, **fields):
    """Return a record that compiled code may change, with the given values or else zeros.

    Keyword arguments set single fields.
    """
    found = records([values or (0,) * len(dtype)], dtype)[0]
    for name, value in fields.items():
        found[name] = value
    return found


def records(values, dtype):
    """Return an array of records; without a compiler their fields are attributes as well.

    Fields of np.record take ten times as long to read by name.
    """
    found = np.array(values, dtype)
    return found.view(np.recarray) if config.DISABLE_JIT else found


def plain(part):
    """Return a record, or an array of records, as an array of numbers; anything else unchanged."""
    named = part.dtype.names
    return part if named is None else np.array(part.tolist(), dtype=float).reshape(-1, len(named))
