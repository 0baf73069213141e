"""Functions of a user: checked, compiled or called in Python, and what they read."""
