"""Nonlinear oscillators, classical or with memory.

A driven cubic spring, a self-excited circuit and an oscillating reaction. All quantities are
scaled [-].
"""

import math

from numpy.typing import ArrayLike

from .._checks import real
from .._jit import compiled
from ..equation import Equation
from ..operators import Caputo, RiemannLiouville
from ._coupled import coupled
from .linear import oscillator_terms


@compiled
def _cubic_spring(t, y, dy, params):
    # params: stiffness, cubic, force, frequency
    spring = y[0] * (params[0] + params[1] * y[0] * y[0])
    dy[0] = params[2] * math.cos(params[3] * t) - spring


@compiled
def _cubic_spring_jacobian(t, y, jacobian, params):
    jacobian[0, 0] = -params[0] - 3.0 * params[1] * y[0] * y[0]


def duffing(
    beta: float = 2.0,
    gamma: float = 1.0,
    friction: float = 0.05,
    stiffness: float = 0.0,
    cubic: float = 1.0,
    force: float = 7.5,
    frequency: float = 1.0,
    x0: float = 2.5,
    v0: float = 0.0,
    riemann_liouville: bool = False,
) -> Equation:
    """The Duffing oscillator with memory; Ueda's chaotic one by default.

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
        Whether the friction is Riemann and Liouville's derivative instead of Caputo's, gamma below
        beta - 1.

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
    kind = RiemannLiouville if riemann_liouville else Caputo
    return Equation(
        oscillator_terms(beta, gamma, friction, kind),
        _cubic_spring,
        [[real("x0", x0)], [real("v0", v0)]],
        params=params,
        jac=_cubic_spring_jacobian,
    )


@compiled
def _van_der_pol(t, y, dy, params):
    # params: mu, force, frequency
    dy[0] = y[1]
    drive = params[1] * math.cos(params[2] * t)
    dy[1] = params[0] * (1.0 - y[0] * y[0]) * y[1] - y[0] + drive


@compiled
def _van_der_pol_jacobian(t, y, jacobian, params):
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
    """The van der Pol oscillator, self-excited and stiff for large mu, free or driven.

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
def _airy(t, y, memory, dy, params):
    # params: friction, stiffness
    dy[0] = params[0] * (1.0 - y[0] * y[0]) * memory[0, 0] - params[1] * t * y[0]


@compiled
def _airy_jacobian(t, y, memory, jacobian, params):
    jacobian[0, 0] = -2.0 * params[0] * y[0] * memory[0, 0] - params[1] * t


@compiled
def _airy_memory_jacobian(t, y, memory, jacobian, params):
    jacobian[0, 0] = params[0] * (1.0 - y[0] * y[0])


def van_der_pol_airy(
    beta: float = 1.8,
    gamma: float = 0.8,
    friction: float = 1.0,
    stiffness: float = 1.0,
    x0: float = 0.1,
    v0: float = 0.0,
) -> Equation:
    """The van der Pol-Airy oscillator: friction with memory that depends on the state.

    ``D^beta x + friction (x**2 - 1) D^gamma x + stiffness t x = 0``.

    Parameters
    ----------
    beta, gamma : float
        Orders of inertia and friction, 1 < beta <= 2 and 0 < gamma <= 1 [-].
    friction : float
        Strength of the friction, which excites below ``|x| = 1`` and damps above.
    stiffness : float
        Rate at which the spring grows stiffer.
    x0, v0 : float
        x(0) and x'(0).

    Returns
    -------
    Equation
        The friction is memory that its right-hand side reads (docs/memory_terms.md).

    Source
    ------
    [VanDerPol1926] for the friction, Airy's equation for the spring.

    Examples
    --------
    The inertia of order below 2 damps fast oscillations more than the friction excites them:

    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.van_der_pol_airy(), 30.0, rtol=1e-8)
    >>> bool(0.1 < abs(sol.y[sol.t > 10]).max() < 0.2), bool(abs(sol.y[-1, 0]) < 0.01)
    (True, True)
    """
    orders = oscillator_terms(beta, gamma, 1.0)
    return Equation(
        orders[0],
        _airy,
        [[real("x0", x0)], [real("v0", v0)]],
        params=(real("friction", friction), real("stiffness", stiffness)),
        jac=_airy_jacobian,
        memory=orders[1],
        jac_memory=_airy_memory_jacobian,
    )


@compiled
def _brusselator(t, y, dy, params):
    # params: a, b
    product = y[0] * y[0] * y[1]
    dy[0] = params[0] - (params[1] + 1.0) * y[0] + product
    dy[1] = params[1] * y[0] - product


@compiled
def _brusselator_jacobian(t, y, jacobian, params):
    slope, square = 2.0 * y[0] * y[1], y[0] * y[0]
    jacobian[0, 0], jacobian[0, 1] = slope - params[1] - 1.0, square
    jacobian[1, 0], jacobian[1, 1] = params[1] - slope, -square


def brusselator(
    alpha: ArrayLike = 1.0,
    a: float = 1.0,
    b: float = 3.0,
    y0: ArrayLike = (1.2, 2.8),
) -> Equation:
    """The Brusselator, two reactants of which one makes more of itself.

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
    The only equilibrium is (a, b/a), for one order alpha and a > 0 unstable where
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
