"""Warnings that point at the user's line."""

import os
import sys
import threading
import warnings
from contextlib import contextmanager
from pathlib import Path

_HERE = str(Path(__file__).parent) + os.sep


_silent = threading.local()


@contextmanager
def silence():
    """Let no warning of the package out of this thread."""
    before, _silent.now = getattr(_silent, "now", False), True
    try:
        yield
    finally:
        _silent.now = before


def warn(message, kind):
    """Warn at the line that called into the package, however deep inside it this is."""
    if getattr(_silent, "now", False):
        return
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_HERE):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, kind, stacklevel=level)
