"""Figures of fits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ._axes import chosen, made, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from ..analysis.fitting import FitResult


def fit(
    result: FitResult,
    ax: Axes | None = None,
    *,
    components: ArrayLike | None = None,
    **line: Any,
) -> Axes:
    """Draw data as points and the fitted model as lines, also between the data.

    Bars show the standard deviations of the data where they are given.

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
                (points, *_) = ax.errorbar(
                    one.t,
                    one.data[:, c],
                    spread,
                    fmt=".",
                    alpha=0.7,
                    label=", ".join(names) or "data",
                )
                ax.plot(t, model[:, c], **style({"ls": "-", "color": points.get_color()}, line))
        told = ", ".join(
            f"{name} {value:.4g}({result.standard_errors[name]:.1g})"
            for name, value in result.parameters.items()
        )
        ax.set(xlabel="$t$", ylabel="data and model")
        ax.set_title(told, fontsize="small")
        ax.legend()
    return ax
