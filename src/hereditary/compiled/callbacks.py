"""C functions by which compiled code enters Python, and exceptions that pass through it."""

import ctypes
import threading
from contextlib import suppress
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

C_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, ctypes.c_ssize_t, ctypes.c_ssize_t)
_raised = threading.local()


class PythonRaised(Exception):
    """A function called in Python raised; `__cause__` is its exception."""

    def __init__(self):
        super().__init__("a function that is called in Python raised")
        # numba may make the exception more than once
        self.__cause__ = vars(_raised).get("error")


def keep_raised(error):
    """Remember an exception for the `PythonRaised` that compiled code raises."""
    _raised.error = error


def original(error):
    """Return the exception that a user's function raised."""
    vars(_raised).clear()
    return error.__cause__ if isinstance(error, PythonRaised) else error


def pass_on(error, result):
    """Raise the exception of a function called in Python, with the `result` of the run so far."""
    cause: Any = error.__cause__ if isinstance(error, PythonRaised) else None
    if cause is not None:
        with suppress(Exception):  # of exceptions that take no attributes
            cause.result = result
            cause.add_note("the run until then is the attribute `result` of this exception")
        raise cause


@intrinsic
def call_at(typing_context, address, t, components, values):
    """Call the C function at an address."""

    def codegen(context, builder, signature, arguments):
        place, *others = arguments
        word = ir.IntType(64)
        kind = ir.FunctionType(ir.IntType(32), [ir.DoubleType(), word, word])
        result = builder.call(builder.inttoptr(place, kind.as_pointer()), others)
        return builder.sext(result, word)

    return types.int64(types.int64, types.float64, types.uintp, types.uintp), codegen
