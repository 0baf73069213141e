"""Histories, one file each, and what a history of your own needs (docs/extending.md)."""

from ..compiled.jit import compiled
from ..support.checks import count
from .history import History, Memory, NoMemory

__all__ = ["History", "Memory", "NoMemory", "compiled", "count"]
