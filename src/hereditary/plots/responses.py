"""Figures of frequency responses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np

from ._axes import made

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..analysis.frequency_response import FrequencyResponse


def frequency_response(
    response: FrequencyResponse, ax: Axes | None = None, component: int = 0, phase: bool = False
) -> Axes:
    """Amplitude, or phase, of the first harmonic along the curve, one line for each branch.

    Parameters
    ----------
    response : FrequencyResponse
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.
    component : int, optional
    phase : bool, optional
        The phase instead of the amplitude [radians].

    Returns
    -------
    matplotlib Axes
    """
    ax = made(ax)
    drawn = response.phase if phase else response.amplitude
    for number in np.unique(response.branch):
        here = response.branch == number
        style = "--" if number % 2 else "-"
        ax.plot(response.values[here], drawn[here, component], style, marker=".", ms=3, color="C0")
    for value in response.turning:
        ax.axvline(value, color="0.7", lw=0.8)
    by_frequency = np.array_equal(response.values, response.omega)
    ax.set(
        xlabel=r"$\omega$" if by_frequency else "parameter",
        ylabel="phase" if phase else "amplitude",
    )
    return ax


def amplitude_and_phase(
    response: FrequencyResponse, axes: tuple[Axes, Axes] | None = None, component: int = 0
) -> tuple[Axes, Axes]:
    """Amplitude above phase of the first harmonic, with all branches.

    Parameters
    ----------
    response : FrequencyResponse
    axes : pair of matplotlib Axes, optional
        Where to draw; a new figure by default.
    component : int, optional

    Returns
    -------
    pair of matplotlib Axes
    """
    if axes is None:
        axes = plt.subplots(2, sharex=True, layout="constrained")[1]
    upper, lower = axes
    frequency_response(response, upper, component)
    frequency_response(response, lower, component, phase=True)
    upper.set_xlabel("")
    return upper, lower
