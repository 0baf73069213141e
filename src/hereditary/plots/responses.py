"""Figures of frequency responses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ._axes import chosen, made, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from ..analysis.frequency_response import FrequencyResponse


def frequency_response(
    response: FrequencyResponse,
    ax: Axes | None = None,
    *,
    components: ArrayLike = 0,
    phase: bool = False,
    **line: Any,
) -> Axes:
    """Amplitude, or phase, of the first harmonic along the curve, one line for each branch.

    Parameters
    ----------
    response : FrequencyResponse
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.
    components : int or array_like of int, optional
    phase : bool, optional
        The phase instead of the amplitude [radians].
    **line
        Keywords of ``Axes.plot``; `label` stands for the whole curve.

    Returns
    -------
    matplotlib Axes
    """
    with made(ax) as ax:
        drawn = response.phase if phase else response.amplitude
        which = chosen(components, drawn.shape[1])
        told = [str(line.pop("label"))] if "label" in line else []
        for k, c in enumerate(which):
            own = style({"marker": ".", "ms": 3, "color": f"C{k}"}, line)
            own["label"] = ", ".join(told + [f"component {c}"] * (len(which) > 1)) or None
            for number in np.unique(response.branch):
                here = response.branch == number
                dashed = {"ls": "--" if number % 2 else "-"}
                ax.plot(response.values[here], drawn[here, c], **style(dashed, own))
                own.pop("label", None)  # once for all branches
        if told or len(which) > 1:
            ax.legend()
        for value in response.turning:
            ax.axvline(value, color="0.5", lw=0.8)
        by_frequency = np.array_equal(response.values, response.omega)
        ax.set(
            xlabel=r"$\omega$" if by_frequency else "parameter",
            ylabel="phase" if phase else "amplitude",
        )
    return ax


def amplitude_and_phase(
    response: FrequencyResponse,
    axes: tuple[Axes, Axes] | None = None,
    *,
    components: ArrayLike = 0,
    **line: Any,
) -> tuple[Axes, Axes]:
    """Amplitude above phase of the first harmonic, with all branches.

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
