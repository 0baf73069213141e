"""The solver: runs over any stepper, events, output, solutions."""
