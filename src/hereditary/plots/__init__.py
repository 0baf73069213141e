"""Figures; with the command line, the only modules that import matplotlib.

Every function draws into given axes or makes its own, and returns the axes. Its own have the
style of the package, ``matplotlib.style.use(hereditary.plots.STYLE)``.
"""

from ._axes import STYLE
from .lines import (
    amplitude_and_phase,
    errors,
    fit,
    frequency_response,
    oscillogram,
    phase_portrait,
    velocity,
)
from .tables import bifurcation, lyapunov_spectrum, regime_map

__all__ = [
    "STYLE", "amplitude_and_phase", "bifurcation", "errors", "fit", "frequency_response",
    "lyapunov_spectrum", "oscillogram", "phase_portrait", "regime_map", "velocity",
]  # fmt: skip


def __dir__() -> list[str]:
    return __all__
