"""Pieces of HTML for notebooks."""

from __future__ import annotations

import base64
import html
import importlib
import io
from collections.abc import Iterable, Sequence

import numpy as np

# Points of a line in a small figure.
_POINTS = 2000
# Size of a small figure [inches].
_SIZE = (4.0, 1.8)


def table_html(head: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """Return a table with a head."""
    lines = [_cells("th", head), *(_cells("td", row) for row in rows)]
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def _cells(kind: str, values: Iterable[object]) -> str:
    return "".join(f"<{kind}>{escaped(value)}</{kind}>" for value in values)


def escaped(value: object) -> str:
    """Return a value as text in HTML, numbers with six digits."""
    return html.escape(f"{value:.6g}" if isinstance(value, float) else str(value))


def paragraph(text: object) -> str:
    """Return a paragraph of plain text."""
    return f"<p>{escaped(text)}</p>"


def small_figure(t: np.ndarray, y: np.ndarray) -> str:
    """Return a small figure of the columns of y (n, d) against t (n,), as an image."""
    figure = importlib.import_module("matplotlib.figure").Figure(_SIZE, layout="constrained")
    axes, every = figure.add_subplot(), max(1, len(t) // _POINTS)
    axes.plot(t[::every], y[::every], lw=0.8)
    axes.set_xlabel("$t$")
    axes.margins(x=0)
    image = io.BytesIO()
    figure.savefig(image, format="png", dpi=80)
    data = base64.b64encode(image.getvalue()).decode()
    return f'<img alt="solution against time" src="data:image/png;base64,{data}">'
