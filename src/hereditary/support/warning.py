"""Warnings that point at the user's line."""

import os
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

_HERE = str(Path(__file__).parent.parent) + os.sep  # the package


class ThreadSwitch(threading.local):
    """A flag for each thread: True within ``with set():`` of the same thread, otherwise False."""

    value = False

    @contextmanager
    def set(self) -> Iterator[None]:
        """Return a context in which the flag is True in this thread."""
        before, self.value = self.value, True
        try:
            yield
        finally:
            self.value = before


_silent = ThreadSwitch()


def silence() -> AbstractContextManager[None]:
    """Return a context in which the package gives no warnings in this thread."""
    return _silent.set()


def warn(message: str, kind: type[Warning]) -> None:
    """Warn at the line of the user's code that called the package."""
    if _silent.value:
        return
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_HERE):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, kind, stacklevel=level)
