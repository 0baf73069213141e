"""Figures of a sweep's table: spectra, bifurcation diagrams, regime maps.

The colours of Okabe and Ito differ for colour-blind readers too. If a figure consists of many
points, vector files contain these as an image.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.patches import Patch

from ..support.checks import refuse
from ._axes import LABELS, made, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..analysis.table import Table

_BLUE = "#0072B2"
_VERMILLION = "#D55E00"
_GREEN = "#009E73"
_DARK = "#404040"
_PALE = "#F0E442"
COLOURS = {
    "stick-slip, periodic": _BLUE,
    "stick-slip, irregular": _VERMILLION,
    "sliding": _GREEN,
    "stuck": _DARK,
    "undetermined": _PALE,
}
# Opacity of a regime without certainty, whose colour must still be visible.
_PALEST = 0.12
# Number of points from which on a table is drawn as an image.
_MAX_POINTS_AS_VECTORS = 2000


def lyapunov_spectrum(
    table: Table,
    value: str = "exponent",
    error: str | None = None,
    ax: Axes | None = None,
    *,
    name: str | None = None,
    **line: Any,
) -> Axes:
    """Draw an exponent over one parameter, and the line between growth and decay.

    Parameters
    ----------
    table : Table
        Over one axis. Points whose status is not "completed" are crossed out.
    value : str, optional
        Which of its values; for each point a number, or an array of several exponents.
    error : str, optional
        Its standard errors, drawn as bars.
    ax : matplotlib Axes, optional
        Where to draw, e.g. next to another spectrum; new axes by default.
    name : str, optional
        Its name in the legend; no legend without one.
    **line
        Keywords of ``Axes.plot``.

    Returns
    -------
    matplotlib Axes
    """
    axis, x = _only_axis(table)
    with made(ax) as ax:
        y = np.asarray(table[value], dtype=float).reshape(x.size, -1)
        bars = None if error is None else np.asarray(table[error], dtype=float).reshape(y.shape)
        if not any(line.get_gid() == "zero" for line in ax.lines):
            ax.axhline(0, color="0.5", lw=0.8, zorder=1, gid="zero")
        for k in range(y.shape[1]):
            label = name if y.shape[1] == 1 or name is None else f"{name}, {k + 1}"
            # a line breaks where a value is missing
            defaults = {"marker": ".", "ms": 4, "label": label}
            (drawn_line,) = ax.plot(x, y[:, k], **style(defaults, line))
            if bars is not None:
                ax.errorbar(x, y[:, k], bars[:, k], fmt="none", color=drawn_line.get_color())
        _cross_out(ax, x[~table.success])
        ax.set(xlabel=LABELS.get(axis, axis), ylabel=r"exponent $\Lambda$ [1/time]")
        if name is not None:
            ax.legend()
    return ax


def bifurcation(
    table: Table,
    value: str = "place",
    ax: Axes | None = None,
    *,
    ylabel: str | None = None,
    **points: Any,
) -> Axes:
    """Draw a bifurcation diagram: samples of the orbit over one parameter.

    Parameters
    ----------
    table : Table
        Over one axis; for each point an array of samples, followed by NaN if there are fewer. If
        the status of a point is not "completed", a cross replaces its samples.
    value : str, optional
        Which of its values.
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.
    ylabel : str, optional
        The name of `value` by default.
    **points
        Keywords of ``Axes.plot``, e.g. `ms` or `color`.

    Returns
    -------
    matplotlib Axes
    """
    axis, x = _only_axis(table)
    with made(ax) as ax:
        y = np.asarray(table[value], dtype=float).reshape(x.size, -1)
        places, samples = np.repeat(x, y.shape[1]), y.ravel()
        shown = np.isfinite(samples) & np.repeat(table.success, y.shape[1])
        many = int(shown.sum()) > _MAX_POINTS_AS_VECTORS
        defaults = {"ls": "", "marker": "o", "ms": 1.2 if many else 2, "mew": 0, "rasterized": many}
        ax.plot(places[shown], samples[shown], **style(defaults, points))
        _cross_out(ax, x[~table.success])
        ax.set(xlabel=LABELS.get(axis, axis), ylabel=value if ylabel is None else ylabel)
        ax.margins(x=0.01)
    return ax


def regime_map(
    table: Table,
    regime: str = "regime",
    certainty: str | None = "certainty",
    ax: Axes | None = None,
    **mesh: Any,
) -> Axes:
    """Draw a map of dynamic regimes over two parameters; pale cells are uncertain.

    Parameters
    ----------
    table : Table
        Over two axes, the first one drawn upwards. Cells whose status is not "completed" are
        crossed out.
    regime : str, optional
        Name of its regimes, see `hereditary.Regime`.
    certainty : str, optional
        Name of their certainties in [0, 1]; None to draw all of them alike.
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.
    **mesh
        Keywords of ``Axes.pcolormesh``.

    Returns
    -------
    matplotlib Axes
    """
    if len(table.axes) != 2:
        refuse("table", "have two axes", ", ".join(table.axes), "fix the others")
    (up, y), (right, x) = table.axes.items()
    with made(ax) as ax:
        verdicts = table[regime]
        sure = np.ones(verdicts.shape) if certainty is None else np.nan_to_num(table[certainty])
        shade = (_PALEST + (1 - _PALEST) * np.clip(sure, 0.0, 1.0))[..., None]
        colours = np.ones((*verdicts.shape, 3))
        for kind, colour in COLOURS.items():
            colours[verdicts == kind] = to_rgb(colour)
        mesh = {"rasterized": True} | mesh
        ax.pcolormesh(_edges(x), _edges(y), 1 - shade * (1 - colours), **mesh)
        failed = ~table.success
        if failed.any():
            rows, columns = np.nonzero(failed)
            ax.plot(x[columns], y[rows], "x", color=_DARK, ms=3, mew=0.6, rasterized=True)
        shown = [item for item in COLOURS.items() if np.any(verdicts == item[0])]
        handles = [Patch(color=colour, label=kind) for kind, colour in shown]
        ax.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3,
                  frameon=False)  # fmt: skip
        if certainty is not None:
            greys = LinearSegmentedColormap.from_list("certainty", [str(1 - _PALEST), "0"])
            shades = ScalarMappable(cmap=greys)
            plt.colorbar(shades, ax=ax, label="certainty [-]", aspect=30, pad=0.02)
        ax.set(xlabel=LABELS.get(right, right), ylabel=LABELS.get(up, up))
    return ax


def _only_axis(table: Any) -> tuple[Any, Any]:
    if len(table.axes) != 1:
        refuse("table", "have one axis", ", ".join(table.axes), "fix the others")
    ((axis, values),) = table.axes.items()
    return axis, values


def _cross_out(ax: Any, x: Any) -> None:
    """Draw crosses at the lower edge for points that failed."""
    if x.size:
        ax.plot(x, np.full(x.size, 0.02), "x", color=_VERMILLION, ms=4, clip_on=False,
                transform=ax.get_xaxis_transform())  # fmt: skip


def _edges(centres: np.ndarray) -> np.ndarray:
    """Return the edges of cells around ascending centres."""
    if centres.size == 1:
        return centres[0] + np.array([-0.5, 0.5])
    middle = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])
