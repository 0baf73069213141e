"""The solver: runs with any stepper, their events, output and solutions."""
