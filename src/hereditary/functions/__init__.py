"""Functions of the user: checked, compiled or called in Python, and the values that they read."""
