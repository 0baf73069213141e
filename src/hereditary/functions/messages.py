"""Parts of messages about a user's function, which name the line of its code."""

import linecache
import re
import traceback
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

from ..support.checks import complaint


def code_of(fun: Any) -> CodeType | None:
    """Return the code of a function, a method, a partial or a callable object; or None."""
    fun = getattr(fun, "func", fun)
    return getattr(fun, "__code__", None) or getattr(type(fun).__call__, "__code__", None)


def defined(fun: Any) -> str:
    """Return a clause that names the first line of a function."""
    code = code_of(fun)
    if code is None:
        return f"in {fun!r}"
    return f"in the function at line {code.co_firstlineno} of {code.co_filename}"


def line_of(error: Exception, fun: Any) -> str:
    """Return a clause that names the line of `fun` that raised an exception; "" if unknown."""
    code = code_of(fun)
    path = code.co_filename if code else ""
    lines = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == path]
    return f'at line {lines[-1].lineno} of {path}: "{lines[-1].line}"' if lines else ""


def of_one_number(error: Exception) -> str:
    """Return a remedy for an array where a number is needed, as by functions of math; else ""."""
    if "converted to Python scalar" not in str(error):
        return ""
    return "; math.sin and float take one number: write np.sin(y), or math.sin(y[0])"


def compile_reason(fun: FunctionType, error: Exception) -> str:
    """Return the reason why numba cannot compile a function: line, cause and remedy."""
    return (
        f"for numba cannot compile it {_place(fun, str(error))} ({_reason(str(error))}): use "
        "arithmetic, math and NumPy functions on floats and arrays, and pass constants through "
        "params"
    )


def writing_complaint(name: str, fun: FunctionType, error: Exception) -> str:
    """Return the message about a function that writes into y or params."""
    # numba compiles it only for writable arrays
    return complaint(
        name,
        "leave y and params as they are",
        f"one that writes into them {_place(fun, str(error))}",
        "work on y.copy()",
    )


def _place(fun: FunctionType, text: str) -> str:
    """Return a clause that names the line in numba's report, or else the first line of `fun`."""
    path = fun.__code__.co_filename
    file, whole = re.escape(Path(path).name), re.escape(path)
    found = re.search(rf'File "[^"]*{file}", line (\d+)|{whole} \((\d+)\)', text)
    if not found:
        return defined(fun)
    number = int(found[1] or found[2])
    return f'at line {number} of {path}: "{linecache.getline(path, number).strip()}"'


def _reason(text: str) -> str:
    """Return the most useful sentence of numba's report `text`."""
    # the last error if numba tried several implementations of a call, otherwise the first line
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    lines = [line for line in lines if not line.startswith("Failed in nopython")]
    found = re.findall(r"^\s*\w*Error: (?!Failed in|Poison)(.+)$", text, re.MULTILINE)
    call = re.search(r"^\s*>>> (.+)$", text, re.MULTILINE)
    if call:
        return f"{call[1]}: {found[-1]}" if found else f"no implementation of {call[1]}"
    first = lines[0] if lines else "no reason given"
    return _OF_NO_USE.sub("", first)


# Parts of numba's sentence that do not help a user.
_OF_NO_USE = re.compile(r"\. Raised from .*|^\w*Error: ")
