"""Solutions as tables of other packages, and in files."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any

import numpy as np

from ..support.checks import complaint
from ..support.optional import optional
from .status import Status

_SAVED = "be a solution that Solution.save wrote"
# Fields that are kept as arrays, and as text.
_ARRAYS, _TEXT = ("t", "y", "ydot"), ("status", "message", "stats")


def as_frame(solution) -> Any:
    """Return rows as a pandas DataFrame; see `Solution.to_pandas`."""
    pandas = optional("pandas", "to_pandas")
    values = {"y": solution.y, "ydot": solution.ydot}
    columns = {
        f"{name}[{c}]": rows[:, c]
        for name, rows in values.items()
        if rows is not None
        for c in range(rows.shape[1])
    }
    return pandas.DataFrame(columns, index=pandas.Index(solution.t, name="t"))


def as_dataset(solution) -> Any:
    """Return rows as an xarray Dataset; see `Solution.to_xarray`."""
    xarray = optional("xarray", "to_xarray")
    values = {"y": solution.y, "ydot": solution.ydot}
    dims = ["t", "component"]
    variables = {name: (dims, rows) for name, rows in values.items() if rows is not None}
    stats = {k: v for k, v in solution.stats.items() if np.isscalar(v)}
    attributes = {"status": str(solution.status), "message": solution.message} | stats
    coordinates = {"t": solution.t, "component": np.arange(solution.y.shape[1])}
    return xarray.Dataset(variables, coords=coordinates, attrs=attributes)


def save(solution, path):
    """Write rows, events and how the run ended; see `Solution.save`."""
    arrays = {name: getattr(solution, name) for name in _ARRAYS}
    arrays = {name: array for name, array in arrays.items() if array is not None}
    for k, (times, rows) in enumerate(zip(solution.t_events, solution.y_events, strict=True)):
        arrays |= {f"t_events_{k}": times, f"y_events_{k}": rows}
    kept = {"status": str(solution.status), "message": solution.message}
    kept["stats"] = {name: _plain(value) for name, value in solution.stats.items()}
    arrays["text"] = np.array(json.dumps(kept))
    with open(path, "wb") as file:
        np.savez_compressed(file, **arrays)


def load(kind, path):
    """Read what `save` wrote, as a `Solution`, which is handed over as `kind`."""
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as loaded:
            arrays = {name: loaded[name] for name in loaded.files}
        kept = json.loads(str(arrays.pop("text")))
        n_events = sum(name.startswith("t_events_") for name in arrays)
        events = {
            name: [arrays.pop(f"{name}_{k}") for k in range(n_events)]
            for name in ("t_events", "y_events")
        }
        statuses = {str(status): status for status in Status}
        known = {"status": statuses[kept["status"]], "message": kept["message"]}
        known |= {"stats": kept["stats"], "left": None, "ydot": None}
        if not {"t", "y"} <= arrays.keys() <= {field.name for field in fields(kind)}:
            raise KeyError("t, y")
        return kind(**(known | arrays | events))
    except (FileNotFoundError, IsADirectoryError, PermissionError):
        raise
    except Exception as error:  # what a damaged or foreign file raises depends on its bytes
        raise ValueError(complaint("path", _SAVED, repr(path))) from error


def _plain(value):
    """Return a number of NumPy as one of Python."""
    return value.item() if isinstance(value, np.generic) else value
