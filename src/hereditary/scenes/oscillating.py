"""Nonlinear oscillators, classical or with memory.

A driven cubic spring, a self-excited circuit and two oscillating reactions. All quantities are
scaled [-].
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..compiled.jit import compiled
from ..equation.equation import Equation
from ..equation.operators import Caputo, RiemannLiouville
from ..support.checks import positive, real, refuse, truth
from ._coupled import coupled
from .linear import oscillator_terms


@compiled
def _cubic_spring(t: float, y: np.ndarray, dy: np.ndarray, params: np.ndarray) -> None:
    # params: stiffness, cubic, force, frequency
    spring = y[0] * (params[0] + params[1] * y[0] * y[0])
    dy[0] = params[2] * math.cos(params[3] * t) - spring


@compiled
def _cubic_spring_jacobian(
    t: float, y: np.ndarray, jacobian: np.ndarray, params: np.ndarray
) -> None:
    jacobian[0, 0] = -params[0] - 3.0 * params[1] * y[0] * y[0]


def duffing(
    beta: float | Callable[[float], float] = 2.0,
    gamma: float | Callable[[float], float] = 1.0,
    friction: float = 0.05,
    stiffness: float = 0.0,
    cubic: float = 1.0,
    force: float = 7.5,
    frequency: float = 1.0,
    x0: float = 2.5,
    v0: float = 0.0,
    riemann_liouville: bool = False,
) -> Equation:
    """Make the Duffing oscillator with memory; by default the chaotic one of Ueda.

    ``D^beta x + friction D^gamma x + stiffness x + cubic x**3 = force cos(frequency t)``.

    Parameters
    ----------
    beta, gamma : float or callable
        Orders of inertia and friction, 1 < beta <= 2 and 0 < gamma <= 1 [-], or functions of time.
    friction : float
        Coefficient of the friction term.
    stiffness, cubic : float
        The spring; a negative stiffness with a positive cubic makes two wells.
    force, frequency : float
        Amplitude and angular frequency of the drive.
    x0, v0 : float
        x(0) and x'(0).
    riemann_liouville : bool
        Whether the friction is the Riemann-Liouville derivative instead of Caputo's; gamma must be
        below beta - 1.

    Returns
    -------
    Equation

    Source
    ------
    [Ueda1979], at friction 0.05 and force 7.5; [KimParovik2020] for a Riemann-Liouville friction
    whose order varies.

    Examples
    --------
    Two wells, without a drive; the load comes to rest in one of them:

    >>> import hereditary as hd
    >>> eq = hd.scenes.duffing(friction=0.5, stiffness=-1.0, force=0.0)
    >>> round(float(hd.solve(eq, 100.0, n_steps=20_000).y[-1, 0]), 3)
    1.0
    """
    params = (
        real("stiffness", stiffness),
        real("cubic", cubic),
        real("force", force),
        real("frequency", frequency),
    )
    kind = RiemannLiouville if truth("riemann_liouville", riemann_liouville) else Caputo
    terms, y0 = oscillator_terms(beta, gamma, friction, kind), [[real("x0", x0)], [real("v0", v0)]]
    return Equation(terms, _cubic_spring, y0, params, _cubic_spring_jacobian)


@compiled
def _van_der_pol(t: float, y: np.ndarray, dy: np.ndarray, params: np.ndarray) -> None:
    # params: mu, force, frequency
    dy[0] = y[1]
    drive = params[1] * math.cos(params[2] * t)
    dy[1] = params[0] * (1.0 - y[0] * y[0]) * y[1] - y[0] + drive


@compiled
def _van_der_pol_jacobian(
    t: float, y: np.ndarray, jacobian: np.ndarray, params: np.ndarray
) -> None:
    jacobian[0, 0], jacobian[0, 1] = 0.0, 1.0
    jacobian[1, 0] = -2.0 * params[0] * y[0] * y[1] - 1.0
    jacobian[1, 1] = params[0] * (1.0 - y[0] * y[0])


def van_der_pol(
    alpha: ArrayLike = 1.0,
    mu: float = 1.0,
    force: float = 0.0,
    frequency: float = 1.0,
    y0: ArrayLike = (2.0, 0.0),
) -> Equation:
    """Make the van der Pol oscillator, self-excited and stiff for large mu, free or driven.

    ``D^alpha x = v``, ``D^alpha v = mu (1 - x**2) v - x + force cos(frequency t)``.

    Parameters
    ----------
    alpha : float or array_like, shape (2,)
        Order, 0 < alpha <= 1, one for both components or one for each [-].
    mu : float
        Strength of the excitation.
    force, frequency : float
        Amplitude and angular frequency of the drive.
    y0 : array_like, shape (2,)
        x(0) and v(0).

    Returns
    -------
    Equation

    Source
    ------
    [VanDerPol1926].

    Examples
    --------
    The amplitude of the limit cycle:

    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.van_der_pol(), 50.0, n_steps=10_000, scheme=hd.L2Sigma())
    >>> round(float(sol.y[5_000:, 0].max()), 3)
    2.009
    """
    params = (real("mu", mu), real("force", force), real("frequency", frequency))
    return coupled(2, alpha, _van_der_pol, y0, params, _van_der_pol_jacobian)


@compiled
def _brusselator(t: float, y: np.ndarray, dy: np.ndarray, params: np.ndarray) -> None:
    # params: a, b
    product = y[0] * y[0] * y[1]
    dy[0] = params[0] - (params[1] + 1.0) * y[0] + product
    dy[1] = params[1] * y[0] - product


@compiled
def _brusselator_jacobian(
    t: float, y: np.ndarray, jacobian: np.ndarray, params: np.ndarray
) -> None:
    slope, square = 2.0 * y[0] * y[1], y[0] * y[0]
    jacobian[0, 0], jacobian[0, 1] = slope - params[1] - 1.0, square
    jacobian[1, 0], jacobian[1, 1] = params[1] - slope, -square


def brusselator(
    alpha: ArrayLike = 1.0, a: float = 1.0, b: float = 3.0, y0: ArrayLike = (1.2, 2.8)
) -> Equation:
    """Make the Brusselator, two reactants of which one is autocatalytic.

    ``D^alpha x = a - (b + 1) x + x**2 y``, ``D^alpha y = b x - x**2 y``.

    Parameters
    ----------
    alpha : float or array_like, shape (2,)
        Order, 0 < alpha <= 1, one for both components or one for each [-].
    a, b : float
        Feeds of the reaction.
    y0 : array_like, shape (2,)
        Concentrations x(0) and y(0).

    Returns
    -------
    Equation

    Notes
    -----
    The only equilibrium is (a, b/a). For one order alpha and a > 0 it is unstable if
    ``b > 1 + a**2 + 2 a cos(pi alpha / 2)``.

    Source
    ------
    [PrigogineLefever1968]; with memory [GuglielmiHairer2025].

    Examples
    --------
    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.brusselator(alpha=0.8), 100.0, n_steps=50_000, scheme=hd.BDF(2))
    >>> round(float(sol.y[-1, 0]), 3)
    1.236
    """
    params = (real("a", a), real("b", b))
    return coupled(2, alpha, _brusselator, y0, params, _brusselator_jacobian)


@compiled
def _selkov(t: float, y: np.ndarray, dy: np.ndarray, params: np.ndarray) -> None:
    # params: a, b
    eaten = params[0] * y[1] + y[0] * y[0] * y[1]
    dy[0] = eaten - y[0]
    dy[1] = params[1] - eaten


@compiled
def _selkov_jacobian(t: float, y: np.ndarray, jacobian: np.ndarray, params: np.ndarray) -> None:
    by_x, by_y = 2.0 * y[0] * y[1], params[0] + y[0] * y[0]
    jacobian[0, 0], jacobian[0, 1] = by_x - 1.0, by_y
    jacobian[1, 0], jacobian[1, 1] = -by_x, -by_y


def selkov(
    alpha: ArrayLike | Callable | tuple[Callable, Callable] = 1.0,
    a: float = 0.08,
    b: float = 0.6,
    time_scale: float = 1.0,
    y0: ArrayLike = (0.5, 0.7),
) -> Equation:
    """Make Selkov's self-oscillating reaction, with a time scale; orders may vary.

    ``time_scale**(alpha_1 - 1) D^alpha_1 x = a y + x**2 y - x`` and
    ``time_scale**(alpha_2 - 1) D^alpha_2 y = b - a y - x**2 y``.

    Parameters
    ----------
    alpha : float, array_like of shape (2,), callable, or two of them
        Order, 0 < alpha <= 1, one for both components or one for each [-]; functions of the time
        give orders that vary.
    a, b : float
        Rates of the reaction.
    time_scale : float
        Characteristic time of the memory, above 0 [time].
    y0 : array_like, shape (2,)
        x(0) and y(0).

    Returns
    -------
    Equation

    Notes
    -----
    The only equilibrium is (b, b / (a + b**2)). If both components have the constant order alpha,
    it is unstable if ``alpha > 2/pi arctan(sqrt(4 D - T**2) / T)``, with trace T and determinant D
    of the Jacobian. For the default parameters it is unstable above 0.905423. Then the time scale
    only multiplies time, by ``time_scale**((1 - alpha) / alpha)``.

    Source
    ------
    [Selkov1968]; with memory and a time scale [Parovik2025].

    Examples
    --------
    Oscillations die out where the memory is long:

    >>> import hereditary as hd
    >>> import numpy as np
    >>> late = [hd.solve(hd.scenes.selkov(alpha), 400.0, rtol=1e-6) for alpha in (0.88, 0.95)]
    >>> [bool(np.ptp(sol.y[sol.t > 350, 0]) > 0.1) for sol in late]
    [False, True]
    """
    params, scale = (real("a", a), real("b", b)), positive("time_scale", time_scale)
    each = alpha if isinstance(alpha, (tuple, list)) else (alpha, alpha)
    if not any(callable(order) for order in each):
        scene = coupled(2, alpha, _selkov, y0, params, _selkov_jacobian)
        return scene.replace(terms=scale ** (scene.orders[0] - 1) * Caputo(scene.orders[0]))
    if len(each) != 2 or not all(callable(order) for order in each):
        required = "be functions of the time for both components, or for none"
        refuse("alpha", required, repr(alpha), "write lambda t: 0.9")
    first, second = each
    log_scale = math.log(scale)

    def faster(t: float, y: np.ndarray, dy: np.ndarray, params: np.ndarray) -> None:
        _selkov(t, y, dy, params)
        dy[0] *= math.exp((1.0 - first(t)) * log_scale)
        dy[1] *= math.exp((1.0 - second(t)) * log_scale)

    only_x, only_y = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    return Equation(only_x * Caputo(first) + only_y * Caputo(second), faster, y0, params=params)
