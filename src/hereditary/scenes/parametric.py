"""An oscillator whose spring is shaken, with memory; all quantities are scaled [-]."""

import math
from collections.abc import Callable

import numpy as np

from ..compiled.jit import compiled
from ..equation.equation import Equation
from ..support.checks import real
from .linear import oscillator_terms


@compiled
def _shaken(t: float, y: np.ndarray, dy: np.ndarray, params: np.ndarray) -> None:
    # params: stiffness, depth, frequency
    dy[0] = -(params[0] + params[1] * math.cos(params[2] * t)) * y[0]


@compiled
def _shaken_jacobian(t: float, y: np.ndarray, jacobian: np.ndarray, params: np.ndarray) -> None:
    jacobian[0, 0] = -(params[0] + params[1] * math.cos(params[2] * t))


def mathieu(
    beta: float | Callable[[float], float] = 2.0,
    gamma: float | Callable[[float], float] = 0.5,
    friction: float = 0.1,
    stiffness: float = 0.25,
    depth: float = 0.3,
    frequency: float = 1.0,
    x0: float = 1.0,
    v0: float = 0.0,
) -> Equation:
    """Make Mathieu's oscillator with memory: a spring whose stiffness oscillates.

    ``D^beta x + friction D^gamma x + (stiffness + depth cos(frequency t)) x = 0``.

    Parameters
    ----------
    beta, gamma : float or callable
        Orders of inertia and friction, 1 < beta <= 2 and 0 < gamma <= 1 [-], or functions of time.
    friction : float
        Coefficient of the friction term.
    stiffness, depth, frequency : float
        Mean stiffness, and amplitude and angular frequency of its oscillation.
    x0, v0 : float
        x(0) and x'(0).

    Returns
    -------
    Equation

    Notes
    -----
    For frequency 1 and beta = 2, oscillations of half the frequency grow where ``|stiffness - 1/4 +
    friction cos(pi gamma / 2) / 2**gamma|`` is below ``sqrt(depth**2 - (friction 2**(1 - gamma)
    sin(pi gamma / 2))**2) / 2``, to first order in friction and depth. With the default parameters
    they grow for a stiffness between 0.0481 and 0.3290; to first order, 0.0586 and 0.3414.

    Source
    ------
    [RandEtAl2010], of friction with memory; [Parovik2020] of both.

    Examples
    --------
    >>> import hereditary as hd
    >>> orbits = [hd.solve(hd.scenes.mathieu(stiffness=s), 200.0, rtol=1e-6) for s in (0.25, 0.4)]
    >>> [bool(abs(sol.y[-1, 0]) > 10) for sol in orbits]
    [True, False]
    """
    terms, y0 = oscillator_terms(beta, gamma, friction), [[real("x0", x0)], [real("v0", v0)]]
    params = real("stiffness", stiffness), real("depth", depth), real("frequency", frequency)
    return Equation(terms, _shaken, y0, params, _shaken_jacobian)
