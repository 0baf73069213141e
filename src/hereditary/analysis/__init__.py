"""Studies of equations and schemes: convergence, exponents, fits, sweeps, sections, responses."""
