"""Compiled functions on plain arrays (floor 1): no classes, no strings, no checks."""
