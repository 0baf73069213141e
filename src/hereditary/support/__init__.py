"""Checks of arguments and their messages, warnings, HTML, and cores and storage of the machine."""
