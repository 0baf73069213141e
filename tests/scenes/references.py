"""What the scenes are held to: classical trajectories."""

from scipy.integrate import solve_ivp


def classical(rhs, t_end, y0):
    """y(t_end) of y' = rhs(t, y), right to ten digits or so."""
    return solve_ivp(rhs, (0, t_end), y0, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
