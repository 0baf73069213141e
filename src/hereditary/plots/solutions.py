"""Figures of a solution."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .._checks import complaint
from ._axes import made

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..solver.solution import Solution


def oscillogram(solution: Solution, ax: Axes | None = None) -> Axes:
    """The solution against time, one line for each component.

    Parameters
    ----------
    solution : Solution
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.

    Returns
    -------
    matplotlib Axes
    """
    ax = made(ax)
    _lines(ax, solution.t, solution.y)
    ax.set(xlabel="$t$", ylabel="$x$", title="Oscillogram")
    ax.margins(x=0)
    return ax


def velocity(solution: Solution, ax: Axes | None = None) -> Axes:
    """The first derivative against time; the equation's highest order must exceed 1.

    Parameters and return value as for `oscillogram`.
    """
    ax = made(ax)
    _lines(ax, solution.t, _derivative(solution))
    ax.set(xlabel="$t$", ylabel=r"$\dot x$", title="Velocity")
    ax.margins(x=0)
    return ax


def phase_portrait(solution: Solution, ax: Axes | None = None) -> Axes:
    """The orbit in its phase plane: x' against x, or the second component against the first.

    Parameters
    ----------
    solution : Solution
        Of an equation with highest order above 1, or with two components at least.
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.

    Returns
    -------
    matplotlib Axes
    """
    first_order_system = solution.ydot is None and solution.y.shape[1] > 1
    slopes = solution.y[:, 1:2] if first_order_system else _derivative(solution)
    ax = made(ax)
    for j in range(slopes.shape[1]):
        (line,) = ax.plot(solution.y[:, j], slopes[:, j], lw=0.8)
        ax.plot(solution.y[0, j], slopes[0, j], "o", ms=4, color=line.get_color())
    labels = ("$y_1$", "$y_2$") if first_order_system else ("$x$", r"$\dot x$")
    ax.set(xlabel=labels[0], ylabel=labels[1], title="Phase portrait")
    return ax


def _lines(ax, t, values):
    lines = ax.plot(t, values, lw=0.8)
    if values.shape[1] > 1:
        ax.legend(lines, [f"component {j}" for j in range(values.shape[1])])


def _derivative(solution):
    if solution.ydot is None:
        required = "hold a first derivative (highest order above 1)"
        raise ValueError(complaint("solution", required, "ydot = None", "plot the oscillogram"))
    return solution.ydot
