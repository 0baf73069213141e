"""A chain of hereditary stick-slip blocks.

Each block is the oscillator of `stick_slip`, on the same chain of wells and pulled by its own
spring; springs between neighbours couple them,
``D^beta x_i + friction D^gamma x_i + omega**2 x_i = spring_speed t + adhesion sum_n a_n sin(n x_i)
+ coupling (x_(i-1) - 2 x_i + x_(i+1))``.
"""

from __future__ import annotations

import importlib
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..compiled.jit import compiled
from ..equation.equation import Equation
from ..solver.solution import Solution
from ..support.checks import count, positive, real, real_array, refuse
from .linear import oscillator_terms
from .stick_slip import checked_well, over_sine, slope_of_wells

# Default length of the interval from which the initial positions of blocks are taken.
_START_INTERVAL = 0.4
# Inverse of the golden ratio: the shift of the initial position from block to block, modulo 1.
_GOLDEN = 0.6180339887498949


@compiled
def _forces(t: float, y: np.ndarray, dy: np.ndarray, params: np.ndarray) -> None:
    """Set the forces of springs, pull and wells."""
    # params: omega**2, spring_speed, coupling, adhesion of each block, a_1, a_2, ...
    d = y.shape[0]
    for i in range(d):
        pull = 0.0
        if i > 0:
            pull += y[i - 1] - y[i]
        if i < d - 1:
            pull += y[i + 1] - y[i]
        well = params[3 + i] * over_sine(y[i], params, 3 + d) * math.sin(y[i])
        dy[i] = params[1] * t + well - params[0] * y[i] + params[2] * pull


@compiled
def _forces_jacobian(t: float, y: np.ndarray, ab: np.ndarray, params: np.ndarray) -> None:
    """Set three diagonals, as in `scipy.linalg.solve_banded`; one for a single block."""
    d, upper = y.shape[0], ab.shape[0] // 2
    for i in range(d):
        slope = params[3 + i] * slope_of_wells(y[i], params, 3 + d)
        neighbours = float((i > 0) + (i < d - 1))
        ab[upper, i] = slope - params[0] - params[2] * neighbours
        if upper > 0:
            ab[0, i] = ab[2, i] = params[2]


def stick_slip_chain(
    blocks: int = 100,
    *,
    beta: float = 1.8,
    gamma: float = 0.8,
    friction: float = 0.25,
    omega: float = 1.0,
    spring_speed: float = 1.0,
    adhesion: ArrayLike = 50.0,
    coupling: float = 10.0,
    x0: ArrayLike | None = None,
    v0: ArrayLike = 0.0,
    well: ArrayLike | None = None,
) -> Equation:
    """Make blocks of the stick-slip scene on one line, with springs between neighbours.

    ``D^beta x_i + friction D^gamma x_i + omega**2 x_i = spring_speed t + adhesion sum_n a_n
    sin(n x_i) + coupling (x_(i-1) - 2 x_i + x_(i+1))`` with free ends. This is the model of
    Burridge and Knopoff with memory in inertia and friction, in the scaled units of `stick_slip`
    [-].

    Parameters
    ----------
    blocks : int
        Number of blocks.
    beta, gamma, friction, omega, spring_speed, well
        As in `stick_slip`.
    adhesion : array_like, number or shape (blocks,)
        Depth of the wells under each block.
    coupling : float
        Stiffness of the springs between neighbours.
    x0, v0 : array_like, number or shape (blocks,), optional
        Initial places and velocities. By default places are irregular in [0, 0.4), shifted from
        each block to the next by the golden ratio, because equal blocks move as one.

    Returns
    -------
    Equation
        With the tridiagonal Jacobian.

    Source
    ------
    [BurridgeKnopoff1967]; each block as in [ParovikStickSlip], eq. (3).

    Examples
    --------
    >>> import hereditary as hd
    >>> eq = hd.scenes.stick_slip_chain(20)
    >>> sol = hd.solve(eq, 60.0, 12_000, save_every=10)
    >>> found = hd.scenes.slips(sol)
    >>> bool(found.size.sum() > 0)
    True
    """
    blocks = count("blocks", blocks)
    if x0 is None:
        x0 = _START_INTERVAL * (np.arange(blocks) * _GOLDEN % 1.0)
    params = (
        real("omega", omega) ** 2,
        real("spring_speed", spring_speed),
        real("coupling", coupling),
        *_by_blocks("adhesion", adhesion, blocks),
        *checked_well(well),
    )
    start = [_by_blocks("x0", x0, blocks), _by_blocks("v0", v0, blocks)]
    terms = oscillator_terms(beta, gamma, friction)
    return Equation(terms, _forces, start, params, _forces_jacobian, bandwidth=(1, 1))


def _by_blocks(name: str, values: ArrayLike, blocks: int) -> np.ndarray:
    """Return an array with one number for each block."""
    array = real_array(name, values)
    if array.shape not in ((), (blocks,)):
        refuse(name, f"be a number or have shape ({blocks},)", f"shape {array.shape}")
    return np.broadcast_to(array, blocks)


class Slips(NamedTuple):
    """Slips of a chain, in the order of their starts.

    start, end (k,) [time], the rows between which blocks moved; first, last (k,), the blocks; size
    (k,), the sum of their displacements.
    """

    start: np.ndarray
    end: np.ndarray
    first: np.ndarray
    last: np.ndarray
    size: np.ndarray


def slips(solution: Solution, speed: float = 2.0) -> Slips:
    """Return slips of a chain of blocks: moves connected in space and time.

    A block moves between two rows if its mean speed exceeds `speed`. Moves of neighbours, or of one
    block in successive rows, belong to one slip.

    Parameters
    ----------
    solution : Solution
        Of a chain, with rows of all blocks that resolve the slips.
    speed : float, optional
        Mean speed from which a block slips, above that of the pull [place/time].

    Returns
    -------
    Slips
        Named arrays ``start``, ``end``, ``first``, ``last``, ``size``, all of shape (k,).

    Examples
    --------
    >>> import hereditary as hd
    >>> eq = hd.scenes.stick_slip_chain(1, beta=2.0, gamma=1.0, x0=0.2, v0=0.3)
    >>> found = hd.scenes.slips(hd.solve(eq, 60.0, 60_000, save_every=20), speed=4.0)
    >>> found.start[found.size > 10.0].round().tolist()
    [45.0, 48.0, 51.0]
    """
    speed = positive("speed", speed)
    if solution.t.size < 2:
        none, where = np.zeros(0), np.zeros(0, dtype=np.int64)
        return Slips(none, none, where, where, none)
    moved, steps = np.diff(solution.y, axis=0), np.diff(solution.t)[:, None]
    images: Any = importlib.import_module("scipy.ndimage")
    labels, many = images.label(np.abs(moved) > speed * steps)
    places = images.find_objects(labels)
    sizes = images.sum_labels(np.abs(moved), labels, np.arange(1, many + 1))
    rows = np.array([(p[0].start, p[0].stop, p[1].start, p[1].stop - 1) for p in places])
    first, last, lowest, highest = rows.reshape(-1, 4).T.astype(np.int64)
    return Slips(solution.t[first], solution.t[last], lowest, highest, np.asarray(sizes))
