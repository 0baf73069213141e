"""Figures of a solution, of a fit and of a frequency response.

Lines follow the dense output of a run that chose its steps, and join the rows of other runs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..stepping.dense import curve
from ..support.checks import positive, refuse, truth
from ._axes import chosen, made, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from ..analysis.fitting import FitResult
    from ..analysis.frequency_response import FrequencyResponse
    from ..solver.accuracy import Accuracy
    from ..solver.solution import Solution

# Points of a drawn response curve between two of its values.
_POINTS_BETWEEN_VALUES = 20


def oscillogram(
    solution: Solution, ax: Axes | None = None, *, components: ArrayLike | None = None, **line: Any
) -> Axes:
    """Draw the solution against time, one line for each component; grey where it slides.

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
    solution: Solution, ax: Axes | None = None, *, components: ArrayLike | None = None, **line: Any
) -> Axes:
    """Draw the first derivative against time; the equation's highest order must exceed 1.

    Parameters and return value as for `oscillogram`.
    """
    _check_derivative(solution)
    return _against_time(solution, ax, 1, components, line)


def phase_portrait(
    solution: Solution,
    ax: Axes | None = None,
    *,
    components: ArrayLike | None = None,
    delay: float | None = None,
    **line: Any,
) -> Axes:
    """Draw the orbit in its phase plane: x' against x, or one component against another.

    With a delay it is each component at an earlier time, against that component.

    Parameters
    ----------
    solution : Solution
        Of an equation with a highest order above 1, or with at least two components.
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.
    components : int or array_like of int, optional
        Components whose x' is drawn against x; all by default. For orders up to 1, the two that are
        drawn against each other; by default the first two.
    delay : float, optional
        y(t - delay) is drawn against y(t), as delay equations have it [time].
    **line
        Keywords of ``Axes.plot``.

    Returns
    -------
    matplotlib Axes
    """
    now, other, labels = _phases(solution, components, delay)
    with made(ax) as ax:
        for x, y in zip(now.T, other.T, strict=True):
            (drawn,) = ax.plot(x, y, **line)
            ax.plot(x[0], y[0], "o", ms=4, color=drawn.get_color())
        ax.set(xlabel=labels[0], ylabel=labels[1], title="Phase portrait")
        if "label" in line:
            ax.legend()
    return ax


def _phases(
    solution: Solution, components: ArrayLike | None, delay: float | None
) -> tuple[np.ndarray, np.ndarray, tuple[str, str]]:
    """Return the values along both axes of a phase portrait, (k, m) each, and their labels."""
    d = solution.y.shape[1]
    if delay is not None:
        delay, which = positive("delay", delay), chosen(components, d)
        t, _ = curve(solution, which)
        t = t[t >= t[0] + delay]
        if t.size < 2:
            refuse("delay", "be shorter than the solution", delay)
        before = solution(np.maximum(t - delay, solution.t[0]))[:, which]
        return solution(t)[:, which], before, ("$y(t)$", rf"$y(t - {delay:g})$")
    pair = solution.ydot is None and d > 1
    which = chosen(components, d) if components is not None or not pair else [0, 1]
    if pair and len(which) != 2:
        required = "name two components, one against the other, for orders up to 1"
        refuse("components", required, repr(components))
    if pair:
        labels = f"$y_{{{which[0] + 1}}}$", f"$y_{{{which[1] + 1}}}$"
    else:
        _check_derivative(solution)
        labels = "$x$", r"$\dot x$"
    _, columns = curve(solution, which, (0,) if pair else (0, 1))
    half = columns.shape[1] // 2
    return columns[:, :half], columns[:, half:], labels


def errors(
    accuracy: Accuracy, ax: Axes | None = None, *, components: ArrayLike | None = None, **line: Any
) -> Axes:
    """Draw relative errors of a run against time, on a logarithmic scale.

    A dotted line shows the tolerance of the accurate run. Errors below it are not known.

    Parameters
    ----------
    accuracy : Accuracy
        What ``Solution.check`` returns.
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.
    components : int or array_like of int, optional
        Which columns of ``accuracy.error``; all by default.
    **line
        Keywords of ``Axes.plot``.

    Returns
    -------
    matplotlib Axes
    """
    which = chosen(components, accuracy.size.size)
    relative = accuracy.relative[:, which]
    with made(ax) as ax:
        lines = ax.plot(accuracy.t, np.where(relative > 0, relative, np.nan), **line)
        ax.axhline(accuracy.rtol, color="0.5", ls=":", lw=1)
        if "label" in line:
            ax.legend()
        elif len(which) > 1:
            ax.legend(lines, [f"component {j}" for j in which])
        ax.set(xlabel="$t$", ylabel="error / size [-]", title="Errors", yscale="log")
        ax.margins(x=0)
    return ax


def fit(
    result: FitResult, ax: Axes | None = None, *, components: ArrayLike | None = None, **line: Any
) -> Axes:
    """Draw data as points and the fitted model as lines, also between the data.

    Bars show the standard deviations of the data, if they are given.

    Parameters
    ----------
    result : FitResult
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.
    components : int or array_like of int, optional
        Which columns of the data; all by default.
    **line
        Keywords of ``Axes.plot`` for the model.

    Returns
    -------
    matplotlib Axes
    """
    with made(ax) as ax:
        several = len(result.series) > 1
        for k, (one, (t, model)) in enumerate(zip(result.series, result.curves, strict=True)):
            for c in chosen(components, one.data.shape[1]):
                names = [f"series {k}"] * several + [f"value {c}"] * (one.data.shape[1] > 1)
                spread = None if one.sigma is None else one.sigma[:, c]
                label, data = ", ".join(names) or "data", one.data[:, c]
                (points, *_) = ax.errorbar(one.t, data, spread, fmt=".", alpha=0.7, label=label)
                ax.plot(t, model[:, c], **style({"ls": "-", "color": points.get_color()}, line))
        title = ", ".join(
            f"{name} {value:.4g}({result.standard_errors[name]:.1g})"
            for name, value in result.parameters.items()
        )
        ax.set(xlabel="$t$", ylabel="data and model")
        ax.set_title(title, fontsize="small")
        ax.legend()
    return ax


def frequency_response(
    response: FrequencyResponse,
    ax: Axes | None = None,
    *,
    components: ArrayLike = 0,
    phase: bool = False,
    **line: Any,
) -> Axes:
    """Draw amplitude, or phase, of the first harmonic along the curve, one line for each branch.

    Parameters
    ----------
    response : FrequencyResponse
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.
    components : int or array_like of int, optional
    phase : bool, optional
        The phase instead of the amplitude [radians].
    **line
        Keywords of ``Axes.plot``; `label` is for the whole curve.

    Returns
    -------
    matplotlib Axes
    """
    with made(ax) as ax:
        which = chosen(components, response.coefficients.shape[1])
        labels = [str(line.pop("label"))] if "label" in line else []
        for k, c in enumerate(which):
            keywords = style({"color": f"C{k}"}, line)
            keywords["label"] = ", ".join(labels + [f"component {c}"] * (len(which) > 1)) or None
            values, harmonic, branch = _joined(response, c)
            drawn = np.angle(harmonic) if truth("phase", phase) else np.abs(harmonic)
            for number in np.unique(branch):
                here = branch == number
                here[:-1] |= here[1:]  # joined to the branch before
                dashed = {"ls": "--" if number % 2 else "-"}
                ax.plot(values[here], drawn[here], **style(dashed, keywords))
                keywords.pop("label", None)  # once for all branches
        if labels or len(which) > 1:
            ax.legend()
        by_frequency = np.array_equal(response.values, response.omega)
        ax.set_xlabel(r"$\omega$" if by_frequency else "parameter")
        ax.set_ylabel("phase" if phase else "amplitude")
    return ax


def _joined(response: Any, component: Any) -> Any:
    """Return values, first harmonics and branches of a curve, also between the given values."""
    # from a cubic spline over the length of the curve, through its turning points
    values, harmonic = response.values, response.coefficients[:, component, 1]
    from scipy.interpolate import CubicSpline

    places = np.column_stack([values, harmonic.real, harmonic.imag])
    if len(values) < 2:
        return values, harmonic, response.branch
    sizes = np.ptp(places, axis=0)
    steps = np.linalg.norm(np.diff(places / np.where(sizes > 0, sizes, 1.0), axis=0), axis=1)
    s = np.append(0.0, np.cumsum(steps))
    n = np.arange(len(s))
    fine = np.interp(np.linspace(0, n[-1], _POINTS_BETWEEN_VALUES * n[-1] + 1), n, s)
    values, real, imag = CubicSpline(s, places)(fine).T
    return values, real + 1j * imag, np.rint(np.interp(fine, s, response.branch))


def amplitude_and_phase(
    response: FrequencyResponse,
    axes: tuple[Axes, Axes] | None = None,
    *,
    components: ArrayLike = 0,
    **line: Any,
) -> tuple[Axes, Axes]:
    """Draw amplitude above phase of the first harmonic, with all branches.

    Parameters
    ----------
    response : FrequencyResponse
    axes : pair of matplotlib Axes, optional
        Where to draw; a new figure by default.
    components : int or array_like of int, optional
    **line
        Keywords of ``Axes.plot``.

    Returns
    -------
    pair of matplotlib Axes
    """
    with made(axes, 2) as (upper, lower):
        frequency_response(response, upper, components=components, **line)
        frequency_response(response, lower, components=components, phase=True, **line)
        upper.set_xlabel("")
    return upper, lower


def _against_time(
    solution: Any, ax: Any, derivative: int, components: Any, line: dict[str, Any]
) -> Any:
    """Draw components, or their first derivatives, against time; return the axes."""
    which = chosen(components, solution.y.shape[1])
    with made(ax) as ax:
        lines = ax.plot(*curve(solution, which, (derivative,)), **line)
        for _, begin, end in solution.stats.get("slides", ()):
            ax.axvspan(begin, end, color="0.5", alpha=0.15, lw=0.0, zorder=0)
        if "label" in line:
            ax.legend()
        elif len(which) > 1:
            ax.legend(lines, [f"component {j}" for j in which])
        ylabel, title = (r"$\dot x$", "Velocity") if derivative else ("$x$", "Oscillogram")
        ax.set(xlabel="$t$", ylabel=ylabel, title=title)
        ax.margins(x=0)
    return ax


def _check_derivative(solution: Any) -> None:
    if solution.ydot is None:
        required = "hold a first derivative (highest order above 1)"
        refuse("solution", required, "ydot = None", "plot the oscillogram")
