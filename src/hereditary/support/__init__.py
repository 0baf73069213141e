"""Checks and messages of arguments, warnings, HTML, and what the machine has."""
