"""A user's functions: their checks, their compilation or calls in Python, and values they read."""
