"""Reasons why a march of collocation cannot go on."""

import numpy as np

from ..compiled.linalg import LARGEST
from ..equation.system import System
from ..stepping.status import NOT_FINITE, Ending, Status
from .march import CRAWLING, JUMPING, NEWTON_FAILED
from .operators import POSITION, PRIMARY

# Relative growth of the solution over the last step. A run that cannot go on has blown up if the
# solution grew by more and exceeds all earlier values.
_GROWING = 1e-3
# A run has not blown up if its next step was reduced to this fraction of the last one: then f
# jumps.
_WALL = 1e-8
# Distances from a failed step at which f is evaluated, in lengths of the last step. They are
# positive along the last change of y, negative against it.
_DISTANCES_AHEAD = (0.0, 1.0, 10.0, 100.0, 1000.0, -1.0, -10.0, -100.0, -1000.0)
# f jumps if it changes over these distances by more than this fraction of its size, since steps are
# short.
_JUMP = 0.1
# If no first step succeeds, f is evaluated at these fractions of the predicted motion.
_SHARES = 10.0 ** np.arange(-1, -16, -2)
_CORNERS = "name times of jumps and corners of the right-hand side, as a table has, in breaks"
_RHS_JUMPS = (
    "the right-hand side jumps, or stops being finite, wherever the solution goes on (it may slide "
    "or chatter there); name known times in breaks, functions that change their sign in switches"
)
_CRAWLS = (
    "steps stay short wherever the solution goes on: it may slide or chatter where the right-hand "
    "side jumps, or rounding hides what the tolerance asks for"
)
_STEPS_END_IN_ROUNDING = (
    "rounding hides what the tolerance asks for, or the solution is too steep; loosen rtol, and if "
    "the right-hand side jumps here name the time in breaks, or the function in switches"
)

_BLOWN_UP = Ending(Status.BLOWN_UP)
UNSOLVED = Ending(Status.NOT_SOLVED)
TOO_STEEP = Ending(Status.STEP_TOO_SMALL, _STEPS_END_IN_ROUNDING)
OUTSIDE = Ending(Status.STEP_TOO_SMALL, NOT_FINITE)
ROUGH_TABLE = Ending(
    Status.STEP_TOO_SMALL,
    "the memory of a table that the right-hand side reads is rougher at the start than the "
    "tolerance: state it as a term on the left, or read hd.fit_exponentials(table, t_min, t_max, "
    "tol), which is smooth but not singular before t_min",
)
NO_SLOPE_AT_START = Ending(
    Status.STEP_TOO_SMALL,
    "the right-hand side has no derivative at y(0) = 0, from where the solution leaves like an "
    "unknown power of time: begin with a tiny y(0) on the side of the solution, or loosen rtol",
)
SINGULAR_ROWS = Ending(
    Status.STEP_TOO_SMALL,
    "the Jacobian of the algebraic rows with respect to the algebraic components becomes singular "
    "here, so that no solution goes on",
)


def ending(
    status: int,
    system: System,
    t: float,
    h: float,
    rejected: float,
    last: np.ndarray,
    peak: np.ndarray,
    is_noise: np.ndarray,
) -> Ending:
    """Return the reason why a march with this status code cannot go on from time t."""
    # last (3 or 4, d, s): f, p and y at the nodes of the last step, of length h. rejected: length
    # down to which the next one was rejected. peak (2, d): largest |p| and |y| before. is_noise
    # (d,): components that are rounding of others, which do not count.
    before, now = (np.abs(last[PRIMARY : POSITION + 1, :, i]) for i in (0, -1))
    if now.max() >= LARGEST:
        return _BLOWN_UP
    if status == CRAWLING:
        return Ending(Status.STEP_TOO_SMALL, _CRAWLS)
    largest = np.maximum((1 + _GROWING) * before, peak)
    growing = np.any((now > largest)[:, ~is_noise]) and rejected > _WALL * h
    if status != JUMPING and growing:
        return _BLOWN_UP
    # at predictions of y beyond the step, linear ones from its first and its last node
    first, y = last[POSITION, :, 0], last[POSITION, :, -1]
    steps = [(abs(a) * h, a) for a in _DISTANCES_AHEAD]
    forces = np.array([system.rhs(t + dt, y + a * (y - first)) for dt, a in steps])
    if not np.all(np.isfinite(forces)):
        return OUTSIDE
    jumps = np.abs(forces - forces[0]).max(axis=0) > _JUMP * np.abs(forces).max(axis=0)
    jumps = np.any(jumps & ~is_noise)
    if status == NEWTON_FAILED and not jumps:
        return UNSOLVED
    return (
        Ending(Status.STEP_TOO_SMALL, _RHS_JUMPS)
        if status in (JUMPING, NEWTON_FAILED)
        else TOO_STEEP
    )


def of_near_orders(gap: float) -> Ending:
    """Return the reason why no first step was found, for an equation with two orders so close."""
    why = (
        f"an order is {gap:.1g} from another one or from an integer, so that the solution bends "
        "within 1e-300 of this time: make these orders equal"
    )
    return TOO_STEEP._replace(detail=f"{_STEPS_END_IN_ROUNDING}; {why}")


def after_steps(n_steps: int) -> Ending:
    """Return the reason why a march ends that has made the largest number of steps."""
    return Ending(Status.MAX_STEPS, f"{n_steps} in all; {_CORNERS}")


def of_rounded_rows(t: float, rtol: float) -> Ending:
    """Return the reason why algebraic rows whose values rounding hides next to time t end a run."""
    why = (
        f"next to t = {t:.10g} an algebraic row changes by more than the tolerance within the "
        f"rounding of t: take an rtol of {rtol:.0e} or more, or eliminate the row, so that the "
        "right-hand side reads components with a derivative alone"
    )
    return Ending(Status.STEP_TOO_SMALL, why)


def of_small_component(number: int) -> str:
    """Return a clause on a component far below its reach, whose error ended a march."""
    why = "is below a millionth of what others make of it"
    return f"component {number} {why}, so it may be their rounding: give atol="


def leaves_domain(system: System, t: float, y: np.ndarray, move: np.ndarray) -> bool:
    """Return whether f is infinite or NaN at all test points between y and y + move, (d,) each."""
    points = [y + share * move for share in _SHARES]
    ahead = [system.rhs(t, point) for point in points if np.any(point != y)]
    return bool(ahead) and not np.isfinite(ahead).all(axis=1).any()
