"""Oscillators whose friction has memory, depends on the state and feeds small oscillations.

All quantities are scaled [-].
"""

import math
from collections.abc import Callable

import numpy as np

from ..compiled.jit import compiled
from ..equation.equation import Equation
from ..support.checks import real, refuse
from .linear import oscillator_terms


@compiled
def _excited(
    t: float, y: np.ndarray, memory: np.ndarray, dy: np.ndarray, params: np.ndarray
) -> None:
    # params: friction, level, stiffness, its rate, cubic, constant force, force, frequency
    x = y[0]
    drive = params[5] + params[6] * math.cos(params[7] * t)
    spring = (params[2] + params[3] * t + params[4] * x * x) * x
    dy[0] = params[0] * (params[1] - x * x) * memory[0, 0] - spring + drive


@compiled
def _excited_jacobian(
    t: float, y: np.ndarray, memory: np.ndarray, jacobian: np.ndarray, params: np.ndarray
) -> None:
    x = y[0]
    stiffness = params[2] + params[3] * t + 3.0 * params[4] * x * x
    jacobian[0, 0] = -2.0 * params[0] * x * memory[0, 0] - stiffness


@compiled
def _excited_memory_jacobian(
    t: float, y: np.ndarray, memory: np.ndarray, jacobian: np.ndarray, params: np.ndarray
) -> None:
    jacobian[0, 0] = params[0] * (params[1] - y[0] * y[0])


def _oscillator(
    beta: float | Callable[[float], float],
    gamma: float | Callable[[float], float],
    params: tuple[float, ...],
    x0: float,
    v0: float,
) -> Equation:
    """Return ``D^beta x`` and memory ``D^gamma x``, with the parameters of `_excited`."""
    inertia, friction = oscillator_terms(beta, gamma, 1.0)
    return Equation(
        inertia, _excited, [[real("x0", x0)], [real("v0", v0)]], params, _excited_jacobian,
        memory=friction, jac_memory=_excited_memory_jacobian,
    )  # fmt: skip


def van_der_pol_duffing(
    beta: float | Callable[[float], float] = 1.9,
    gamma: float | Callable[[float], float] = 0.9,
    friction: float = 1.0,
    stiffness: float = 1.0,
    cubic: float = 0.2,
    force: float = 0.0,
    frequency: float = 1.0,
    x0: float = 0.1,
    v0: float = 0.0,
) -> Equation:
    """Make the van der Pol-Duffing oscillator: its friction has memory.

    ``D^beta x + friction (x**2 - 1) D^gamma x + stiffness x + cubic x**3 = force cos(frequency
    t)``.

    Parameters
    ----------
    beta, gamma : float or callable
        Orders of inertia and friction, 1 < beta <= 2 and 0 < gamma <= 1 [-], or functions of time.
    friction : float
        Strength of the friction.
    stiffness, cubic : float
        The spring.
    force, frequency : float
        Amplitude and angular frequency of the drive, which is parameter 7 of the equation.
    x0, v0 : float
        x(0) and x'(0).

    Returns
    -------
    Equation
        The friction is memory that its right-hand side reads (docs/memory_terms.md); with orders
        that vary `ExplicitCaputo` and `L1` take it.

    Notes
    -----
    Rest is unstable where ``s**beta - friction s**gamma + stiffness`` has zeros of positive real
    part: for gamma 0.8 and friction and stiffness 1 above beta = 1.337001.

    Source
    ------
    [Novikova2017].

    Examples
    --------
    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.van_der_pol_duffing(2.0, 1.0, cubic=0.0), 60.0, rtol=1e-8)
    >>> times, tops = hd.maxima(sol, transient=40.0)
    >>> round(float(times[-1] - times[-2]), 4), round(float(tops[-1]), 4)
    (6.6633, 2.0086)
    """
    spring = real("stiffness", stiffness), 0.0, real("cubic", cubic)
    drive = 0.0, real("force", force), real("frequency", frequency)
    return _oscillator(beta, gamma, (real("friction", friction), 1.0, *spring, *drive), x0, v0)


def van_der_pol_airy(
    beta: float | Callable[[float], float] = 1.8,
    gamma: float | Callable[[float], float] = 0.8,
    friction: float = 1.0,
    stiffness: float = 1.0,
    x0: float = 0.1,
    v0: float = 0.0,
) -> Equation:
    """Make the van der Pol-Airy oscillator: a spring that stiffens, friction with memory.

    ``D^beta x + friction (x**2 - 1) D^gamma x + stiffness t x = 0``.

    Parameters
    ----------
    beta, gamma : float or callable
        Orders of inertia and friction, 1 < beta <= 2 and 0 < gamma <= 1 [-], or functions of time.
    friction : float
        Strength of the friction, which excites below ``|x| = 1`` and damps above.
    stiffness : float
        Rate at which the spring grows stiffer.
    x0, v0 : float
        x(0) and x'(0).

    Returns
    -------
    Equation
        The friction is memory that its right-hand side reads (docs/memory_terms.md); with orders
        that vary `ExplicitCaputo` and `L1` take it.

    Notes
    -----
    Without friction and with v0 = 0 the solution is the series ``x0 sum_n a_n t**(n (beta + 1))``,
    ``a_n = -stiffness a_(n-1) Gamma(n (beta+1) + 1 - beta) / Gamma(n (beta+1) + 1)``, of Airy's
    functions for beta = 2.

    Source
    ------
    [SalimovaParovik2024].

    Examples
    --------
    The inertia of order below 2 damps fast oscillations more than the friction excites them:

    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.van_der_pol_airy(), 30.0, rtol=1e-8)
    >>> bool(0.1 < abs(sol.y[sol.t > 10]).max() < 0.2), bool(abs(sol.y[-1, 0]) < 0.01)
    (True, True)
    """
    spring = 0.0, real("stiffness", stiffness), 0.0
    params = (real("friction", friction), 1.0, *spring, 0.0, 0.0, 1.0)
    return _oscillator(beta, gamma, params, x0, v0)


def fitzhugh_nagumo(
    beta: float | Callable[[float], float] = 2.0,
    gamma: float | Callable[[float], float] = 1.0,
    a: float = 0.7,
    b: float = 0.8,
    c: float = 3.0,
    stimulus: float = -0.4,
    x0: float = 0.1,
    v0: float = 0.0,
) -> Equation:
    """Make the FitzHugh-Nagumo nerve model as one oscillator, with memory.

    ``D^beta x + c (x**2 - 1 + b/c**2) D^gamma x + (b/3) x**3 + (1 - b) x = a + b stimulus``: for
    beta = 2 and gamma = 1 the system ``x' = c (y + x - x**3/3 + stimulus)``, ``y' = -(x - a + b y)
    / c`` without y.

    Parameters
    ----------
    beta, gamma : float or callable
        Orders of inertia and friction, 1 < beta <= 2 and 0 < gamma <= 1 [-], or functions of time.
    a, b, c : float
        The nerve; c not 0.
    stimulus : float
        Constant stimulus z.
    x0, v0 : float
        Membrane potential x(0), and x'(0).

    Returns
    -------
    Equation
        The friction is memory that its right-hand side reads (docs/memory_terms.md); with orders
        that vary `ExplicitCaputo` and `L1` take it.

    Notes
    -----
    Without memory the nerve fires at stimuli from -1.403522 to -0.346478, between its two Hopf
    bifurcations at ``x**2 = 1 - b/c**2``. With gamma = 1 and the default stimulus its rest is
    x = 0.906567. It is stable below beta = 1.818246, where ``s**beta + p s + q``, with the friction
    p and the stiffness q at rest, has zeros on the imaginary axis. Down to about beta = 1.7 the
    nerve can also fire.

    Source
    ------
    [FitzHugh1961]; with memory [LipkoParovik2018].

    Examples
    --------
    >>> import hereditary as hd
    >>> import numpy as np
    >>> nerves = [hd.scenes.fitzhugh_nagumo(beta, x0=0.9) for beta in (1.75, 1.9)]
    >>> orbits = [hd.solve(nerve, 300.0, rtol=1e-7) for nerve in nerves]
    >>> [bool(np.ptp(sol.y[sol.t > 250]) > 1) for sol in orbits]
    [False, True]
    """
    a, b, c = real("a", a), real("b", b), real("c", c)
    if c == 0:
        refuse("c", "not be 0", c)
    spring = 1.0 - b, 0.0, b / 3
    drive = a + b * real("stimulus", stimulus), 0.0, 1.0
    return _oscillator(beta, gamma, (c, 1.0 - b / c**2, *spring, *drive), x0, v0)
