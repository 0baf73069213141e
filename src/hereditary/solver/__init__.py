"""The solver: stepper, driver, solution."""
