"""Compiled functions on plain arrays: no classes, no strings, no checks."""
