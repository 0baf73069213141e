"""Histories, one file each, and what a history of your own needs (docs/extending.md)."""

from ..compiled.jit import compiled
from ..compiled.signatures import Tables, held
from ..support.checks import count
from .history import History, Memory

__all__ = ["History", "Memory", "Tables", "compiled", "count", "held"]
