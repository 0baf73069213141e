"""Axes, their style and labels, and the components that are drawn."""

from contextlib import contextmanager
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.cbook import normalize_kwargs
from matplotlib.lines import Line2D

from ..support.checks import component_numbers

# What `matplotlib.style.use` takes: hereditary.mplstyle in this folder.
STYLE = "hereditary.plots.hereditary"
# Names of the scenes' parameters in figures; scaled quantities have no unit.
LABELS = {
    "alpha": r"order $\alpha$ [-]",
    "beta": r"order of inertia $\beta$ [-]",
    "gamma": r"order of friction $\gamma$ [-]",
    "friction": r"friction $\lambda$ [-]",
    "omega": r"spring frequency $\omega$ [1/time]",
    "spring_speed": r"spring speed $b$ [-]",
    "adhesion": r"adhesion $c$ [-]",
    "stiffness": "stiffness [-]",
    "cubic": "cubic stiffness [-]",
    "force": "force [-]",
    "frequency": r"frequency of the force $\omega$ [1/time]",
    "depth": "depth of the modulation [-]",
    "stimulus": "stimulus $z$ [-]",
    "time_scale": r"time scale $\theta$ [time]",
    "mu": r"excitation $\mu$ [-]",
    "sigma": r"$\sigma$ [-]",
    "rho": r"$\rho$ [-]",
}


@contextmanager
def made(ax: Any, rows: int = 1) -> Any:
    """Yield the given axes unchanged, or new ones with the style of the package."""
    if ax is not None:
        yield ax
        return
    with plt.style.context(STYLE):
        yield plt.subplots(rows, sharex=True, layout="constrained")[1]


def chosen(components: Any, d: int) -> Any:
    """Return the requested components as a list; all of d by default."""
    if components is None:
        return list(range(d))
    return component_numbers(components, d).tolist()


def style(defaults: dict[str, Any], line: dict[str, Any]) -> dict[str, Any]:
    """Return keywords of a line; those of the user replace ours, also under their short names."""
    return normalize_kwargs(defaults, Line2D) | normalize_kwargs(line, Line2D)
