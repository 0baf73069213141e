"""Scenes without memory are the systems of the literature, here written out and solved by SciPy."""

import math
from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hereditary as hd

scenes = hd.scenes


def classical(rhs, t_end, y0):
    """y(t_end) of y' = rhs(t, y), right to ten digits or so."""
    return solve_ivp(rhs, (0, t_end), y0, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]


def lorenz(t, u):
    x, y, z = u
    return [10 * (y - x), x * (28 - z) - y, x * y - 8 / 3 * z]


def rossler(t, u):
    x, y, z = u
    return [-y - z, x + 0.2 * y, 0.2 + z * (x - 5.7)]


def rabinovich_fabrikant(t, u):
    x, y, z = u
    third = -2 * z * (0.98 + x * y)
    return [y * (z - 1 + x**2) + 0.1 * x, x * (3 * z + 1 - x**2) + 0.1 * y, third]


def brusselator(t, u):
    x, y = u
    return [1 - 4 * x + x**2 * y, 3 * x - x**2 * y]


def selkov(t, u):
    x, y = u
    return [0.08 * y + x**2 * y - x, 0.6 - 0.08 * y - x**2 * y]


def moved(acceleration):
    """Return the system of x'' = acceleration(t, x, x')."""
    return lambda t, u: [u[1], acceleration(t, *u)]


WELLS = partial(scenes.duffing, friction=0.25, stiffness=-1.0, cubic=1.0, force=0.3, frequency=1.2)
VAN_DER_POL_DUFFING = 2.0, 1.0, 0.7, 1.2, 0.3, 0.5, 1.1, 0.4, -0.2
# A scene, and the system of which it is a component or all of them.
CLASSICAL = {
    "Lorenz": (scenes.lorenz, lorenz),
    "Rossler": (scenes.rossler, rossler),
    "Rabinovich-Fabrikant": (scenes.rabinovich_fabrikant, rabinovich_fabrikant),
    "Brusselator": (scenes.brusselator, brusselator),
    "Selkov": (scenes.selkov, selkov),
    "Riccati": (partial(scenes.riccati, 1.0), lambda t, u: [1 + 2 * u[0] - u[0] ** 2]),
    "Ueda": (
        scenes.duffing,
        moved(lambda t, x, v: 7.5 * math.cos(t) - 0.05 * v - x**3),
    ),
    "two wells": (
        partial(WELLS, x0=0.5),
        moved(lambda t, x, v: 0.3 * math.cos(1.2 * t) - 0.25 * v + x - x**3),
    ),
    "van der Pol": (
        partial(scenes.van_der_pol, mu=5.0, force=5.0, frequency=2.466),
        moved(lambda t, x, v: 5 * (1 - x**2) * v - x + 5 * math.cos(2.466 * t)),
    ),
    "van der Pol-Duffing": (
        partial(scenes.van_der_pol_duffing, *VAN_DER_POL_DUFFING),
        moved(
            lambda t, x, v: -0.7 * (x**2 - 1) * v - 1.2 * x - 0.3 * x**3 + 0.5 * math.cos(1.1 * t)
        ),
    ),
    "van der Pol-Airy": (
        partial(scenes.van_der_pol_airy, 2.0, 1.0, 0.4, 0.5, 0.4, -0.2),
        moved(lambda t, x, v: -0.4 * (x**2 - 1) * v - 0.5 * t * x),
    ),
    "Mathieu": (
        partial(scenes.mathieu, 2.0, 1.0, 0.2, 0.3, 0.4, 1.5, 0.4, -0.2),
        moved(lambda t, x, v: -0.2 * v - (0.3 + 0.4 * math.cos(1.5 * t)) * x),
    ),
}


@pytest.mark.parametrize("name", CLASSICAL)
def test_without_memory_scenes_are_classical_systems(name):
    scene, rhs = CLASSICAL[name]
    equation = scene()
    t_end = 2.0 if name == "Lorenz" else 8.0
    exact = classical(rhs, t_end, equation.y0.ravel())[: equation.d]
    off = np.abs(hd.solve(equation, t_end, rtol=1e-10).y[-1] - exact).max()
    assert off < 1e-8 * max(1.0, np.abs(exact).max())


def test_the_nerve_is_the_system_of_fitzhugh():
    """As one equation of second order: x' = c (y + x - x**3/3 + z), y' = -(x - a + b y) / c."""
    a, b, c, z = 0.7, 0.8, 3.0, -0.4

    def system(t, u):
        x, y = u
        return [c * (y + x - x**3 / 3 + z), -(x - a + b * y) / c]

    x0, y0 = 0.3, -0.2
    nerve = hd.scenes.fitzhugh_nagumo(x0=x0, v0=c * (y0 + x0 - x0**3 / 3 + z))
    exact = classical(system, 12.0, [x0, y0])[0]
    assert abs(hd.solve(nerve, 12.0, rtol=1e-10).y[-1, 0] - exact) < 1e-8
