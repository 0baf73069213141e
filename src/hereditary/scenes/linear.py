"""Linear scenes with known solutions."""

from collections.abc import Callable

import numpy as np

from ..compiled.jit import compiled
from ..equation.equation import Equation
from ..equation.operators import Caputo, Summand
from ..support.checks import real, within


@compiled
def _proportional(t: float, y: np.ndarray, dy: np.ndarray, params: np.ndarray) -> None:
    """Set dy to params[0] y."""
    for j in range(y.shape[0]):
        dy[j] = params[0] * y[j]


@compiled
def _proportional_jacobian(
    t: float, y: np.ndarray, jacobian: np.ndarray, params: np.ndarray
) -> None:
    jacobian[:] = 0.0
    for j in range(y.shape[0]):
        jacobian[j, j] = params[0]


def relaxation(alpha: float = 0.5, rate: float = 1.0, y0: float = 1.0) -> Equation:
    """Make the fractional relaxation ``D^alpha y = -rate y``.

    Its solution is ``y0 E_alpha(-rate t**alpha)``.

    Parameters
    ----------
    alpha : float
        Order, 0 < alpha <= 1 for a relaxation [-].
    rate : float
        [1/time**alpha].
    y0 : float
        y(0).

    Returns
    -------
    Equation

    Examples
    --------
    >>> import hereditary as hd
    >>> hd.scenes.relaxation(alpha=0.5).m
    1
    """
    within("alpha", alpha, 5e-324, 1.0, "(0, 1]", "see oscillator for higher orders")
    y0, params = real("y0", y0), (-real("rate", rate),)
    return Equation(Caputo(alpha), _proportional, y0, params, _proportional_jacobian)


def oscillator_terms(
    beta: float | Callable[[float], float],
    gamma: float | Callable[[float], float],
    friction: float,
    kind: type[Caputo] = Caputo,
) -> list[Summand]:
    """Return inertia and friction, ``D^beta + friction D^gamma``, with checked orders."""
    # an order may be a function of time; its value at 0 determines its range
    at_start = [order(0.0) if callable(order) else order for order in (beta, gamma)]
    within("beta", at_start[0], 1 + 1e-15, 2.0, "(1, 2]", "order 1 and below takes no x'(0)")
    within("gamma", at_start[1], 5e-324, 1.0, "(0, 1]")
    return [Caputo(beta), real("friction", friction) * kind(gamma)]


def oscillator(
    beta: float = 1.8,
    gamma: float = 0.8,
    friction: float = 0.25,
    omega: float = 1.0,
    x0: float = 1.0,
    v0: float = 0.0,
) -> Equation:
    """Make the fractional oscillator ``D^beta x + friction D^gamma x + omega**2 x = 0``.

    Parameters
    ----------
    beta, gamma : float
        Orders, 1 < beta <= 2 and 0 < gamma <= 1 [-].
    friction : float
        Coefficient of the friction term [time**(gamma - beta)].
    omega : float
        [1/time**(beta/2)].
    x0, v0 : float
        x(0) and x'(0).

    Returns
    -------
    Equation

    Examples
    --------
    >>> import hereditary as hd
    >>> hd.scenes.oscillator(beta=1.5, gamma=0.5).m
    2
    """
    stiffness = real("omega", omega) ** 2
    terms, y0 = oscillator_terms(beta, gamma, friction), [[real("x0", x0)], [real("v0", v0)]]
    return Equation(terms, _proportional, y0, (-stiffness,), _proportional_jacobian)
