"""What the scenes are held to: differences of right-hand sides, and classical trajectories."""

import numpy as np
from scipy.integrate import solve_ivp


def differences(rhs, t, y, params):
    """The Jacobian of a right-hand side by central differences, exact for degrees up to 4."""
    d = y.size
    jacobian = np.empty((d, d))
    for j in range(d):
        unit = np.zeros(d)
        unit[j] = 1.0
        near = value(rhs, t, y + unit, params) - value(rhs, t, y - unit, params)
        far = value(rhs, t, y + 2 * unit, params) - value(rhs, t, y - 2 * unit, params)
        jacobian[:, j] = (8 * near - far) / 12
    return jacobian


def value(rhs, t, y, params):
    """A right-hand side as a function that returns its values."""
    dy = np.full(y.size, np.nan)
    rhs(t, np.asarray(y, dtype=float), dy, np.asarray(params, dtype=float))
    return dy


def matrix(jac, t, y, params):
    """A Jacobian as a function that returns its values."""
    jacobian = np.full((len(y), len(y)), np.nan)
    jac(t, np.asarray(y, dtype=float), jacobian, np.asarray(params, dtype=float))
    return jacobian


def classical(rhs, t_end, y0):
    """y(t_end) of y' = rhs(t, y), right to ten digits or so."""
    return solve_ivp(rhs, (0, t_end), y0, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
