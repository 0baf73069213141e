"""Figures of a solution.

Lines follow the dense output of a run that chose its steps, and join the rows of other runs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..solver.dense import curve
from ..support.checks import complaint
from ._axes import chosen, made

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from ..solver.solution import Solution


def oscillogram(
    solution: Solution,
    ax: Axes | None = None,
    *,
    components: ArrayLike | None = None,
    **line: Any,
) -> Axes:
    """The solution against time, one line for each component.

    Parameters
    ----------
    solution : Solution
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.
    components : int or array_like of int, optional
        Which columns of ``solution.y``; all by default.
    **line
        Keywords of ``Axes.plot``, e.g. `label`, `color`, `lw`.

    Returns
    -------
    matplotlib Axes
    """
    return _against_time(solution, ax, 0, components, line)


def velocity(
    solution: Solution,
    ax: Axes | None = None,
    *,
    components: ArrayLike | None = None,
    **line: Any,
) -> Axes:
    """The first derivative against time; the equation's highest order must exceed 1.

    Parameters and return value as for `oscillogram`.
    """
    _check_derivative(solution)
    return _against_time(solution, ax, 1, components, line)


def phase_portrait(
    solution: Solution,
    ax: Axes | None = None,
    *,
    components: ArrayLike | None = None,
    **line: Any,
) -> Axes:
    """The orbit in its phase plane: x' against x, or one component against another.

    Parameters
    ----------
    solution : Solution
        Of an equation with highest order above 1, or with two components at least.
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.
    components : int or array_like of int, optional
        Components whose x' is drawn against x, all by default; for orders up to 1 the two that are
        drawn against each other, the first two by default.
    **line
        Keywords of ``Axes.plot``.

    Returns
    -------
    matplotlib Axes
    """
    d = solution.y.shape[1]
    pair = solution.ydot is None and d > 1
    which = chosen(components, d) if components is not None or not pair else [0, 1]
    if pair and len(which) != 2:
        required = "name two components, one against the other, for orders up to 1"
        raise ValueError(complaint("components", required, repr(components)))
    if pair:
        labels = f"$y_{{{which[0] + 1}}}$", f"$y_{{{which[1] + 1}}}$"
    else:
        _check_derivative(solution)
        labels = "$x$", r"$\dot x$"
    _, columns = curve(solution, which, (0,) if pair else (0, 1))
    half = columns.shape[1] // 2
    with made(ax) as ax:
        for x, y in zip(columns.T[:half], columns.T[half:], strict=True):
            (drawn,) = ax.plot(x, y, **line)
            ax.plot(x[0], y[0], "o", ms=4, color=drawn.get_color())
        ax.set(xlabel=labels[0], ylabel=labels[1], title="Phase portrait")
        if "label" in line:
            ax.legend()
    return ax


def _against_time(solution, ax, derivative, components, line):
    """Draw components, or their first derivatives, against time; return the axes."""
    which = chosen(components, solution.y.shape[1])
    with made(ax) as ax:
        lines = ax.plot(*curve(solution, which, (derivative,)), **line)
        if "label" in line:
            ax.legend()
        elif len(which) > 1:
            ax.legend(lines, [f"component {j}" for j in which])
        ylabel, title = (r"$\dot x$", "Velocity") if derivative else ("$x$", "Oscillogram")
        ax.set(xlabel="$t$", ylabel=ylabel, title=title)
        ax.margins(x=0)
    return ax


def _check_derivative(solution):
    if solution.ydot is None:
        required = "hold a first derivative (highest order above 1)"
        raise ValueError(complaint("solution", required, "ydot = None", "plot the oscillogram"))
