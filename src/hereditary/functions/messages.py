"""Complaints about a user's function, in one sentence with its line."""

import linecache
import re
import traceback
from pathlib import Path

from ..support.checks import complaint


def code_of(fun):
    """Return the code behind a function, a method, a partial or a callable object; or None."""
    fun = getattr(fun, "func", fun)
    return getattr(fun, "__code__", None) or getattr(type(fun).__call__, "__code__", None)


def defined(fun):
    """Where a function begins, in a clause."""
    code = code_of(fun)
    if code is None:
        return f"in {fun!r}"
    return f"in the function at line {code.co_firstlineno} of {code.co_filename}"


def line_of(error, fun):
    """Where in the user's function an exception came from."""
    code = code_of(fun)
    path = code.co_filename if code else ""
    lines = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == path]
    return f'at line {lines[-1].lineno} of {path}: "{lines[-1].line}"' if lines else ""


def compile_reason(fun, error):
    """Why numba cannot compile a function, by its report: the line, its reason, and the remedy."""
    return (
        f"for numba cannot compile it {_place(fun, str(error))} ({_reason(str(error))}): use "
        "arithmetic, math and NumPy functions on floats and arrays, and pass constants through "
        "params"
    )


def writing_complaint(name, fun, error):
    """One sentence on a function that compiles only where y and params may be written to."""
    return complaint(
        name,
        "leave y and params as they are",
        f"one that writes into them {_place(fun, str(error))}",
        "work on y.copy()",
    )


def _place(fun, text):
    """The line of a function's file that numba's report names, or where the function begins."""
    path = fun.__code__.co_filename
    file, whole = re.escape(Path(path).name), re.escape(path)
    told = re.search(rf'File "[^"]*{file}", line (\d+)|{whole} \((\d+)\)', text)
    if not told:
        return defined(fun)
    number = int(told[1] or told[2])
    return f'at line {number} of {path}: "{linecache.getline(path, number).strip()}"'


def _reason(text):
    """The sentence in numba's report that says most.

    Where it tried several implementations of a call, that is why it took none of them, and stands
    deepest; otherwise its first.
    """
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    lines = [line for line in lines if not line.startswith("Failed in nopython")]
    found = re.findall(r"^\s*\w*Error: (?!Failed in|Poison)(.+)$", text, re.MULTILINE)
    call = re.search(r"^\s*>>> (.+)$", text, re.MULTILINE)
    if call:
        return f"{call[1]}: {found[-1]}" if found else f"no implementation of {call[1]}"
    first = lines[0] if lines else "no reason given"
    return _OF_NO_USE.sub("", first)


_OF_NO_USE = re.compile(r"\. Raised from .*|^\w*Error: ")
