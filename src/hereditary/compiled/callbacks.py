"""Compiled calls of functions by their address: C functions that enter Python, and LAPACK's.

An exception in Python cannot pass through compiled code. It is stored for the thread, and compiled
code raises `PythonRaised` instead.
"""

import ctypes
import threading
from contextlib import suppress
from typing import Any

from llvmlite import ir
from numba import config, types
from numba.extending import get_cython_function_address, intrinsic

_WORD = ir.IntType(64)
C_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, ctypes.c_ssize_t, ctypes.c_ssize_t)
_raised = threading.local()


class PythonRaised(Exception):
    """A function called in Python raised; `__cause__` is its exception."""

    def __init__(self):
        super().__init__("a function that is called in Python raised")
        # the stored exception is not removed, because numba may construct this one several times
        self.__cause__ = vars(_raised).get("error")


def keep_raised(error):
    """Store an exception of this thread as the cause of the next `PythonRaised`."""
    _raised.error = error


def original(error):
    """Return the exception of a user's function: the cause of a `PythonRaised`, else `error`."""
    vars(_raised).clear()
    return error.__cause__ if isinstance(error, PythonRaised) else error


def pass_on(error, result):
    """Raise the cause of a `PythonRaised` again, with `result` as its attribute, if it is one."""
    # result: the solution of the run up to the exception
    cause = error.__cause__ if isinstance(error, PythonRaised) else None
    if cause is not None:
        hand_over(cause, result)
        raise cause


def hand_over(error: Any, result):
    """Make the solution of a run the attribute `result` of an exception, and say so in a note."""
    with suppress(Exception):  # an exception may accept no attributes
        error.result = result
        error.add_note("the run until then is the attribute `result` of this exception")


@intrinsic
def call_at(typing_context, address, t, components, values):
    """Call the C function at `address` with t and addresses of two arrays; return its status."""
    # of type C_FUNCTION: the arrays are the components and the values to be filled

    def codegen(context, builder, signature, arguments):
        place, *others = arguments
        kind = ir.FunctionType(ir.IntType(32), [ir.DoubleType(), _WORD, _WORD])
        result = builder.call(builder.inttoptr(place, kind.as_pointer()), others)
        return builder.sext(result, _WORD)

    return types.int64(types.int64, types.float64, types.uintp, types.uintp), codegen


@intrinsic
def call_lapack(typing_context, address, arguments):
    """Call LAPACK's function at `address`, without a result, with its arguments' addresses."""
    count = len(arguments)

    def codegen(context, builder, signature, values):
        places = [builder.extract_value(values[1], k) for k in range(count)]
        kind = ir.FunctionType(ir.VoidType(), [_WORD] * count)
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), places)
        return context.get_dummy_value()

    return types.void(types.int64, types.UniTuple(types.uintp, count)), codegen


def lapack_address(name):
    """Return the address of the function `name` of LAPACK; 0 if numba compiles nothing."""
    if config.DISABLE_JIT:
        return 0
    return get_cython_function_address("scipy.linalg.cython_lapack", name)
