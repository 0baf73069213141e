"""Parts of HTML for the display of objects in notebooks."""

from __future__ import annotations

import base64
import html
import importlib
import io
from collections.abc import Iterable, Sequence

import numpy as np

# Number of points of a line in a small figure; lines with more are thinned out.
_MAX_LINE_POINTS = 2000
# Width and height of a small figure [inches].
_SIZE = (4.0, 1.8)


def table_html(head: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """Return an HTML table with one row of headings and these rows."""
    lines = [_cells("th", head), *(_cells("td", row) for row in rows)]
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def _cells(kind: str, values: Iterable[object]) -> str:
    return "".join(f"<{kind}>{escaped(value)}</{kind}>" for value in values)


def escaped(value: object) -> str:
    """Return a value as escaped HTML text, a float with six digits."""
    return html.escape(f"{value:.6g}" if isinstance(value, float) else str(value))


def paragraph(text: object) -> str:
    """Return an HTML paragraph with this text."""
    return f"<p>{escaped(text)}</p>"


def small_figure(t: np.ndarray, y: np.ndarray) -> str:
    """Return an HTML image: a figure of the d columns of y (n, d) against t (n,)."""
    figure = importlib.import_module("matplotlib.figure").Figure(_SIZE, layout="constrained")
    axes, every = figure.add_subplot(), max(1, len(t) // _MAX_LINE_POINTS)
    axes.plot(t[::every], y[::every], lw=0.8)
    axes.set_xlabel("$t$")
    axes.margins(x=0)
    image = io.BytesIO()
    figure.savefig(image, format="png", dpi=80)
    data = base64.b64encode(image.getvalue()).decode()
    return f'<img alt="solution against time" src="data:image/png;base64,{data}">'
