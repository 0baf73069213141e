"""The solver (floor 4): stepper, driver, solution."""
