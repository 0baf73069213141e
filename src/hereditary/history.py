"""Histories, one file each, and what a history of your own needs (docs/extending.md)."""

from .compiled.jit import compiled
from .given.history.history import History, Memory
from .given.signatures import Tables, held
from .support.checks import count

__all__ = ["History", "Memory", "Tables", "compiled", "count", "held"]
