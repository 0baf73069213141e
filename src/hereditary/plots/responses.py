"""Figures of frequency responses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ._axes import made

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..analysis.frequency_response import FrequencyResponse


def frequency_response(
    response: FrequencyResponse, ax: Axes | None = None, component: int = 0, phase: bool = False
) -> Axes:
    """Amplitude, or phase, of the first harmonic against frequency, one line for each branch.

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
        ax.plot(response.omega[here], drawn[here, component], style, marker=".", ms=3, color="C0")
    for omega in response.turning:
        ax.axvline(omega, color="0.7", lw=0.8)
    ax.set(xlabel=r"$\omega$", ylabel="phase" if phase else "amplitude")
    return ax
