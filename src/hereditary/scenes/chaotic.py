"""Chaotic systems of three components, classical or with memory.

``D^alpha y = rhs(y)``, alpha one order for all components or one for each; alpha = 1 is the system
as its authors wrote it. All quantities are scaled [-].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..compiled.jit import compiled
from ..equation.equation import Equation
from ..support.checks import real
from ._coupled import coupled


@compiled
def _lorenz(t: float, y: np.ndarray, dy: np.ndarray, params: np.ndarray) -> None:
    # params: sigma, rho, b
    dy[0] = params[0] * (y[1] - y[0])
    dy[1] = y[0] * (params[1] - y[2]) - y[1]
    dy[2] = y[0] * y[1] - params[2] * y[2]


@compiled
def _lorenz_jacobian(t: float, y: np.ndarray, jacobian: np.ndarray, params: np.ndarray) -> None:
    jacobian[0, 0], jacobian[0, 1], jacobian[0, 2] = -params[0], params[0], 0.0
    jacobian[1, 0], jacobian[1, 1], jacobian[1, 2] = params[1] - y[2], -1.0, -y[0]
    jacobian[2, 0], jacobian[2, 1], jacobian[2, 2] = y[1], y[0], -params[2]


def lorenz(
    alpha: ArrayLike = 1.0,
    sigma: float = 10.0,
    rho: float = 28.0,
    b: float = 8 / 3,
    y0: ArrayLike = (0.1, 0.1, 0.1),
) -> Equation:
    """Make the Lorenz system, a convection roll reduced to three modes.

    ``D^alpha x = sigma (y - x)``, ``D^alpha y = x (rho - z) - y``, ``D^alpha z = x y - b z``.

    Parameters
    ----------
    alpha : float or array_like, shape (3,)
        Order, 0 < alpha <= 1, one for all components or one for each [-].
    sigma : float
        Prandtl number.
    rho : float
        Rayleigh number; convection starts at 1.
    b : float
        Shape of the roll.
    y0 : array_like, shape (3,)
        x(0), y(0) and z(0).

    Returns
    -------
    Equation

    Notes
    -----
    The divergence is -sigma - 1 - b everywhere. For rho > 1 there are two equilibria apart from the
    origin, ``x = y = +-sqrt(b (rho - 1))``, ``z = rho - 1``. With the default parameters and one
    order for all components they are unstable for alpha > 0.994 and stable below.

    Source
    ------
    [Lorenz1963], eqs. (25)-(27).

    Examples
    --------
    >>> import hereditary as hd
    >>> near_equilibrium = (8.0, 8.0, 27.0)
    >>> eq = hd.scenes.lorenz(alpha=0.9, y0=near_equilibrium)
    >>> hd.solve(eq, 20.0, n_steps=20_000).y[-1].round(2).tolist()
    [8.49, 8.49, 27.0]
    """
    params = (real("sigma", sigma), real("rho", rho), real("b", b))
    return coupled(3, alpha, _lorenz, y0, params, _lorenz_jacobian)


@compiled
def _rossler(t: float, y: np.ndarray, dy: np.ndarray, params: np.ndarray) -> None:
    # params: a, b, c
    dy[0] = -y[1] - y[2]
    dy[1] = y[0] + params[0] * y[1]
    dy[2] = params[1] + y[2] * (y[0] - params[2])


@compiled
def _rossler_jacobian(t: float, y: np.ndarray, jacobian: np.ndarray, params: np.ndarray) -> None:
    jacobian[0, 0], jacobian[0, 1], jacobian[0, 2] = 0.0, -1.0, -1.0
    jacobian[1, 0], jacobian[1, 1], jacobian[1, 2] = 1.0, params[0], 0.0
    jacobian[2, 0], jacobian[2, 1], jacobian[2, 2] = y[2], 0.0, y[0] - params[2]


def rossler(
    alpha: ArrayLike = 1.0,
    a: float = 0.2,
    b: float = 0.2,
    c: float = 5.7,
    y0: ArrayLike = (1.0, 1.0, 0.0),
) -> Equation:
    """Make the Rössler system, a spiral that folds onto itself by one product.

    ``D^alpha x = -y - z``, ``D^alpha y = x + a y``, ``D^alpha z = b + z (x - c)``.

    Parameters
    ----------
    alpha : float or array_like, shape (3,)
        Order, 0 < alpha <= 1, one for all components or one for each [-].
    a : float
        Growth of the spiral.
    b : float
        Inflow of z.
    c : float
        Value of x above which z grows.
    y0 : array_like, shape (3,)
        x(0), y(0) and z(0).

    Returns
    -------
    Equation

    Notes
    -----
    The divergence is a + x - c. For c**2 > 4 a b the equilibria are ``x = a z``, ``y = -z`` with
    ``z = (c +- sqrt(c**2 - 4 a b)) / (2 a)``; the attractor winds about the one with the smaller z.

    Source
    ------
    [Rossler1976].

    Examples
    --------
    >>> import hereditary as hd
    >>> how = {"n_steps": 40_000, "scheme": hd.L2Sigma(), "estimate": False}
    >>> sol = hd.solve(hd.scenes.rossler(), 200.0, **how)
    >>> bool(sol.y[:, 0].min() > -11 and sol.y[:, 0].max() < 13)
    True
    """
    params = (real("a", a), real("b", b), real("c", c))
    return coupled(3, alpha, _rossler, y0, params, _rossler_jacobian)


@compiled
def _rabinovich_fabrikant(t: float, y: np.ndarray, dy: np.ndarray, params: np.ndarray) -> None:
    # params: a, b
    square = y[0] * y[0]
    dy[0] = y[1] * (y[2] - 1.0 + square) + params[0] * y[0]
    dy[1] = y[0] * (3.0 * y[2] + 1.0 - square) + params[0] * y[1]
    dy[2] = -2.0 * y[2] * (params[1] + y[0] * y[1])


@compiled
def _rabinovich_fabrikant_jacobian(
    t: float, y: np.ndarray, jacobian: np.ndarray, params: np.ndarray
) -> None:
    square, product = y[0] * y[0], y[0] * y[1]
    jacobian[0, 0] = 2.0 * product + params[0]
    jacobian[0, 1] = y[2] - 1.0 + square
    jacobian[0, 2] = y[1]
    jacobian[1, 0] = 3.0 * (y[2] - square) + 1.0
    jacobian[1, 1] = params[0]
    jacobian[1, 2] = 3.0 * y[0]
    jacobian[2, 0] = -2.0 * y[1] * y[2]
    jacobian[2, 1] = -2.0 * y[0] * y[2]
    jacobian[2, 2] = -2.0 * (params[1] + product)


def rabinovich_fabrikant(
    alpha: ArrayLike = 1.0, a: float = 0.1, b: float = 0.98, y0: ArrayLike = (0.1, 0.1, 0.1)
) -> Equation:
    """Make the Rabinovich-Fabrikant system, self-modulated waves in a dissipative medium.

    ``D^alpha x = y (z - 1 + x**2) + a x``, ``D^alpha y = x (3 z + 1 - x**2) + a y``,
    ``D^alpha z = -2 z (b + x y)``.

    Parameters
    ----------
    alpha : float or array_like, shape (3,)
        Order, 0 < alpha <= 1, one for all components or one for each [-].
    a : float
        Growth of x and y, gamma in the source.
    b : float
        Damping of z, alpha in the source.
    y0 : array_like, shape (3,)
        x(0), y(0) and z(0).

    Returns
    -------
    Equation

    Notes
    -----
    The divergence is 2 a - 2 b everywhere.

    Source
    ------
    [RabinovichFabrikant1979]; with memory, at these parameters, [DancaKuznetsov2018].

    Examples
    --------
    >>> import hereditary as hd
    >>> eq = hd.scenes.rabinovich_fabrikant(alpha=0.999)
    >>> sol = hd.solve(eq, 100.0, n_steps=20_000, scheme=hd.L2Sigma())
    >>> bool(abs(sol.y).max() < 4)
    True
    """
    params = (real("a", a), real("b", b))
    return coupled(3, alpha, _rabinovich_fabrikant, y0, params, _rabinovich_fabrikant_jacobian)
