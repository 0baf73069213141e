"""Call functions that numba cannot compile from compiled code.

If a user's function must run in Python, compiled code calls a C function instead, made by ctypes,
which enters Python. Its arguments are t, all components, and an array for the values. The record of
an equation's functions has its address. Therefore nothing is compiled for a single function.
"""

import ctypes
import time
import weakref
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from ..compiled.callbacks import C_FUNCTION, keep_raised
from ..support.warning import warn
from .messages import code_of

# Largest number of NumPy views of addresses that one callback keeps; a run uses few addresses.
_VIEWS = 256
# Time after which the timing of a function, for the warning, ends [seconds].
_MAX_TIMING_SECONDS = 1e-3
# Time that a call from compiled code into Python adds to that of the function [seconds].
_CALLBACK_SECONDS = 3e-6
# Time of one explicit step of a compiled equation [seconds].
_COMPILED_STEP = 2e-7
# Messages of the ValueError of module `math` outside of a function's domain, where compiled code
# gives NaN. The last three are those of Python 3.14 and later.
_OUTSIDE = (
    "math domain error",
    "expected a nonnegative input",
    "expected a positive input",
    "expected a number between -1 and 1",
)
_warned: weakref.WeakSet = weakref.WeakSet()


class PythonFunctionWarning(UserWarning):
    """A function that numba cannot compile is called in Python, which makes runs slow."""


class Callback:
    """C function at `address` that fills an array with the values of a Python function."""

    def __init__(
        self,
        name: str,
        fill: Callable[[float, np.ndarray, np.ndarray], None],
        n: int,
        shape: tuple[int, ...],
    ) -> None:
        # name: argument of the equation, for messages; fill(t, z, out) sets out, of a shape, from z
        # (n,), which is read-only
        # one function without helpers, because a run may call it a million times
        components: dict[int, np.ndarray] = {}
        values: dict[int, np.ndarray] = {}
        kinds = ctypes.c_double * n, ctypes.c_double * int(np.prod(shape))

        def call(t: float, given: int, wanted: int) -> int:
            """Fill values at address `wanted` from components at `given`; 1 after an exception."""
            try:
                z, out = components.get(given), values.get(wanted)
                if z is None:
                    z = _view(components, given, kinds[0], (n,))
                if out is None:
                    out = _view(values, wanted, kinds[1], shape)
                z = z.copy()  # the function may keep it
                z.setflags(write=False)
                fill(t, z, out)
                return 0
            except BaseException as error:
                outside = type(error) is ValueError and str(error).startswith(_OUTSIDE)
                if outside and out is not None:
                    out[...] = np.nan
                    return 0
                keep_raised(error)
                with suppress(Exception):  # it may accept no attributes
                    error.add_note(f"raised by {name} at t = {t:.10g}")
                return 1

        self._function = C_FUNCTION(call)
        self.address = int(ctypes.cast(self._function, ctypes.c_void_p).value or 0)


def _view(
    known: dict[int, np.ndarray], address: int, kind: Any, shape: tuple[int, ...]
) -> np.ndarray:
    """Return an array that views the numbers at an address, and store it in `known`."""
    if len(known) >= _VIEWS:
        known.clear()
    return known.setdefault(address, np.frombuffer(kind.from_address(address)).reshape(shape))


def warn_of_python(name: str, fun: Any, reason: str, call: Callable[[], object]) -> None:
    """Warn, once for each function, that Python runs it, and how much longer runs may take."""
    # call() runs the function once, and is timed
    known = code_of(fun) or type(fun)
    if known in _warned:
        return
    _warned.add(known)
    spent: list[float] = []
    began = time.perf_counter()
    while not spent or (len(spent) < 20 and time.perf_counter() - began < _MAX_TIMING_SECONDS):
        start = time.perf_counter()
        call()
        spent.append(time.perf_counter() - start)
    seconds = min(spent) + _CALLBACK_SECONDS
    warn(
        f"{name} is called in Python, {reason}; a call takes {1e6 * seconds:.3g} us, where a step "
        f"of a compiled run takes {1e6 * _COMPILED_STEP:g} us and more, so that runs may take "
        f"{seconds / _COMPILED_STEP:.0f} times as long",
        PythonFunctionWarning,
    )
