"""Common parts of all figures: folder, executor, and saving of figures and tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from ..analysis.sweep import sweep
from ..analysis.table import Table


@dataclass(frozen=True)
class Job:
    """Settings of one call of the command."""

    folder: Path  # for figures and tables
    quick: bool = False  # a few points, short runs, few steps
    executor: Executor | None = None  # where points are computed; threads by default

    def few(self, values: np.ndarray, n: int = 3) -> np.ndarray:
        """Return the values of an axis, or `n` of them, from end to end, in a quick run."""
        if not self.quick or len(values) <= n:
            return values
        return np.asarray(values)[np.linspace(0, len(values) - 1, n).round().astype(int)]

    def size(self, full: Any, quick: Any) -> Any:
        """Return `full`, or `quick` in a quick run."""
        return quick if self.quick else full

    def sweep(self, function: Callable, grid: Mapping[str, Any], **settings: Any) -> Table:
        """Return the table of a function over a grid, computed with these settings."""
        return sweep(partial(function, **settings), grid, executor=self.executor)

    def save_table(self, name: str, table: Table) -> None:
        """Write NAME.npz: axes and values of a table by their names, and "status"."""
        arrays = {**table.axes, **table.values, "status": table.status}
        np.savez_compressed(self.folder / f"{name}.npz", allow_pickle=False, **arrays)

    def save_figure(self, name: str, figure: Figure) -> None:
        """Write NAME.png and NAME.pdf."""
        for suffix in ("png", "pdf"):
            figure.savefig(self.folder / f"{name}.{suffix}", dpi=150)
        plt.close(figure)


def merged(tables: Mapping[str, Table]) -> Table:
    """Return tables over the same axes as one table, with values named "part_value"."""
    first = next(iter(tables.values()))
    values = {f"{part}_{k}": v for part, table in tables.items() for k, v in table.values.items()}
    status = first.status.astype("U200")
    for table in tables.values():
        status = np.where(status == "completed", table.status.astype("U200"), status)
    return Table(first.axes, values, status)
