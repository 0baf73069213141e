"""Optional packages, which only a few methods need."""

import importlib
from types import ModuleType


def optional(package: str, method: str) -> ModuleType:
    """Return an optional package that a method needs, or say how to install it."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        remedy = f"python -m pip install {package}"
        raise ImportError(f"{method} needs {package}, which is not installed; {remedy}") from error
