"""The hereditary stick-slip oscillator.

A load on a spring that is pulled at a constant speed over a chain of potential wells,
``D^beta x + friction D^gamma x + omega**2 x = spring_speed t + adhesion sum_n a_n sin(n x)``.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..compiled.jit import compiled, inner
from ..equation.equation import Equation
from ..equation.operators import Memory, Term
from ..kernels.memory_kernel import MemoryKernel
from ..solver.events import bracketed_root
from ..solver.solution import Solution
from ..support.checks import count, positive, real, real_array, refuse
from .linear import oscillator_terms

# Fourier coefficients of the well as [ParovikStickSlip], Example 1, prints them.
PRINTED_WELL = (0.436, 0.344, 0.164, 0.058, 0.021, 0.004, 0.003)
# A stay between two barriers counts as sticking when it lasts longer than this [time].
_SHORTEST_STAY = 3.0
# Points of each step at which dense output is evaluated to find stays.
_POINTS_PER_STEP_FOR_STAYS = 8


@inner
def over_sine(x: float, params: np.ndarray, first: int) -> float:
    """Return ``sum_n a_n sin(n x) / sin(x)`` by Clenshaw's recurrence; a_1 is params[first]."""
    twice_cosine = 2.0 * math.cos(x)
    b, b_next, last = 0.0, 0.0, params.shape[0] - 1
    for k in range(last - first + 1):  # a loop that counts up takes 7 ns less
        b, b_next = (params[last - k] - b_next) + twice_cosine * b, b
    return b


@inner
def slope_of_wells(x: float, params: np.ndarray, first: int) -> float:
    """Return ``sum_n n a_n cos(n x)``, by the same recurrence."""
    cosine = math.cos(x)
    b, b_next, n = 0.0, 0.0, params.shape[0] - first
    for k in range(n):
        b, b_next = ((n - k) * params[first + n - 1 - k] - b_next) + 2.0 * cosine * b, b
    return b * cosine - b_next


@compiled
def _force(t: float, y: np.ndarray, dy: np.ndarray, params: np.ndarray) -> None:
    """Return the force of spring, pull and wells."""
    # params: omega**2, spring_speed, adhesion, a_1, a_2, ...
    b = over_sine(y[0], params, 3)
    dy[0] = params[1] * t + params[2] * b * math.sin(y[0]) - params[0] * y[0]


@compiled
def _force_jacobian(t: float, y: np.ndarray, jacobian: np.ndarray, params: np.ndarray) -> None:
    """Return -omega**2 + adhesion sum_n n a_n cos(n x)."""
    jacobian[0, 0] = params[2] * slope_of_wells(y[0], params, 3) - params[0]


def stick_slip(
    *,
    beta: float | Callable[[float], float] = 1.8,
    gamma: float | Callable[[float], float] = 0.8,
    friction: float = 0.25,
    omega: float = 1.0,
    spring_speed: float = 1.0,
    adhesion: float = 50.0,
    x0: float = 0.2,
    v0: float = 0.3,
    well: ArrayLike | None = None,
    inertia: MemoryKernel | None = None,
    resistance: MemoryKernel | None = None,
) -> Equation:
    """Make the stick-slip oscillator with memory; classical at beta = 2, gamma = 1.

    ``D^beta x + friction D^gamma x + omega**2 x = spring_speed t + adhesion sum_n a_n sin(n x)``
    in scaled units: x in widths of a well, all quantities [-]. With kernels K1 and K2 the first two
    terms are ``int_0^t K1(t-s) x''(s) ds + friction int_0^t K2(t-s) x'(s) ds``.

    Parameters
    ----------
    beta, gamma : float or callable
        Orders of inertia and friction, 1 < beta <= 2 and 0 < gamma <= 1; functions of the time for
        orders that vary (`hereditary.Caputo`).
    friction : float
        Coefficient lambda of dynamic friction.
    omega : float
        Frequency of the spring.
    spring_speed : float
        Speed b at which the spring is pulled.
    adhesion : float
        Depth c of the wells.
    x0, v0 : float
        x(0) and x'(0).
    well : sequence of float, optional
        Fourier coefficients a_1, a_2, ... of the force; the seven printed ones by default,
        ``well_coefficients(n)`` computes them from the well's shape.
    inertia, resistance : MemoryKernel, optional
        K1 and K2, instead of the power laws of beta and gamma.

    Returns
    -------
    Equation

    Notes
    -----
    The force has the sign of eqs. (2) and (3) of the paper, with which its figures were computed.
    Minus the gradient of its eq. (1) has the opposite sign. With the sign used here, the load is in
    wide wells between narrow barriers at the multiples of 2 pi.

    Source
    ------
    [ParovikStickSlip], eqs. (3), (4) and (6), Examples 1 and 2.

    Examples
    --------
    >>> import hereditary as hd
    >>> eq = hd.scenes.stick_slip(beta=2.0, gamma=1.0)
    >>> sol = hd.solve(eq, 60.0, n_steps=120_000, save_every=10)
    >>> round(hd.scenes.sticking_intervals(sol)[0][1], 1)
    45.3
    """
    params = (
        real("omega", omega) ** 2,
        real("spring_speed", spring_speed),
        real("adhesion", adhesion),
        *checked_well(well),
    )
    terms = oscillator_terms(beta, gamma, friction)
    if inertia is not None:
        terms[0] = Term(Memory(inertia, 2), 1.0)
    if resistance is not None:
        terms[1] = real("friction", friction) * Memory(resistance, 1)
    return Equation(terms, _force, [[real("x0", x0)], [real("v0", v0)]], params, _force_jacobian)


def checked_well(well: ArrayLike | None) -> np.ndarray:
    """Return Fourier coefficients (n,) of the force, the printed ones by default."""
    coefficients = real_array("well", PRINTED_WELL if well is None else well)
    if coefficients.ndim != 1 or coefficients.size == 0:
        refuse("well", "be a flat sequence a_1, a_2, ...", f"shape {coefficients.shape}")
    return coefficients


def well_coefficients(n: int) -> np.ndarray:
    """Return the coefficients a_k = 2 k int_0^1 cos(pi k y) / cosh(pi y)**2 dy, k = 1..n.

    Parameters
    ----------
    n : int
        Number of coefficients; the paper prints seven of them to three decimals.

    Returns
    -------
    ndarray, shape (n,)
        Absolute error below 1e-11 for n up to 100.

    Source
    ------
    [ParovikStickSlip], eq. (2).

    Examples
    --------
    >>> import hereditary as hd
    >>> hd.scenes.well_coefficients(2).round(3).tolist()
    [0.436, 0.344]
    """

    k = np.arange(1, count("n", n) + 1)
    # Gauss-Legendre: the integrand is analytic up to y = i/2, its error here 2.9**(-2 nodes)
    nodes, weights = np.polynomial.legendre.leggauss(64 + 4 * k.size)
    y = (nodes + 1) / 2
    return k * (np.cos(np.pi * np.outer(k, y)) @ (weights / np.cosh(np.pi * y) ** 2))


def sticking_intervals(
    solution: Solution, shortest: float = _SHORTEST_STAY
) -> list[tuple[float, float]]:
    """Return the stays between two crossings of the barriers at multiples of 2 pi.

    Parameters
    ----------
    solution : Solution
        Of a stick-slip scene; its rows must resolve the slips.
    shortest : float, optional
        Shorter stays are slips and are omitted [time].

    Returns
    -------
    list of (float, float)
        Start and end of each stay; the last one ends with the solution. Crossings are located to
        rounding on a dense output, otherwise by linear interpolation between rows.

    Examples
    --------
    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.stick_slip(beta=2.0, gamma=1.0), 70.0, rtol=1e-9)
    >>> [(round(a, 4), round(b, 4)) for a, b in hd.scenes.sticking_intervals(sol)[:2]]
    [(0.0, 45.2716), (53.5556, 70.0)]
    """
    shortest = positive("shortest", shortest)
    t, x, crossing = _sampled(solution)
    well = np.floor(x / (2 * np.pi))
    stays, start = [], float(t[0])
    for i in np.flatnonzero(np.diff(well)):
        up = int(well[i + 1] > well[i])
        # between two rows the load may pass several wells: it leaves the old one and enters the new
        # one
        stays.append((start, crossing(i, 2 * np.pi * (well[i] + up))))
        start = crossing(i, 2 * np.pi * (well[i + 1] + 1 - up))
    stays.append((start, float(t[-1])))
    return [(a, b) for a, b in stays if b - a > shortest]


def _sampled(
    solution: Solution,
) -> tuple[np.ndarray, np.ndarray, Callable[[np.integer, float], float]]:
    """Return times, positions, and a function that locates a level crossed after a sample."""
    t, x = solution.t, solution.y[:, 0]
    if not solution.coarse:

        def between_rows(i: np.integer, level: float) -> float:
            return float(t[i] + (level - x[i]) * (t[i + 1] - t[i]) / (x[i + 1] - x[i]))

        return t, x, between_rows
    share = np.arange(_POINTS_PER_STEP_FOR_STAYS) / _POINTS_PER_STEP_FOR_STAYS
    times = np.append((t[:-1, None] + np.diff(t)[:, None] * share).ravel(), t[-1])
    places = solution(times)[:, 0]

    def on_dense_output(i: np.integer, level: float) -> float:
        if places[i] == level:
            return float(times[i])
        low, high = float(times[i]), float(times[i + 1])
        return bracketed_root(lambda s: float(solution(s)[0] - level), low, high)

    return times, places, on_dense_output
