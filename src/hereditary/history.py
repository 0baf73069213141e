"""Histories, one file each, and what a history of your own needs (docs/extending.md)."""

from .compiled.jit import compiled
from .given.history.history import History, OpenHistory
from .given.signatures import Tables, held
from .support.checks import count

__all__ = ["History", "OpenHistory", "Tables", "compiled", "count", "held"]
