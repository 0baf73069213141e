"""Labelled results of a sweep."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ..support.checks import complaint
from ..support.html import paragraph, table_html
from ..support.optional import optional

# Status of a point that was computed to its end.
COMPLETED = "completed"
# Status of a point that was not computed yet.
NOT_COMPUTED = "not computed"
# Longest status, one line of so many characters. In an array of strings each takes as much storage
# as the longest.
STATUS_LENGTH = 200
_STATUS = "status"
# Rows that a notebook shows.
_MAX_ROWS_SHOWN = 10
# Status of a point, and its values by name.
Point: TypeAlias = tuple[str, dict[str, Any]]


@dataclass(frozen=True, eq=False)
class Table:
    """Values over a grid of parameters, labelled by its axes.

    Attributes
    ----------
    axes : dict of str to ndarray, shape (n,)
        The values of each axis, in the order of the array axes.
    values : dict of str to ndarray, shape table.shape + (...)
        The results by their names: float64, or strings. NaN, or an empty string, if a point has no
        result or one that does not fit. The same comes after the end of arrays shorter than the
        longest one.
    status : ndarray of str, shape table.shape
        "completed", the status that the function returned, "not computed", or the exception that it
        raised, as one line of at most 200 characters.

    Examples
    --------
    >>> import hereditary as hd
    >>> table = hd.sweep(lambda a, b: a / b, {"a": [1.0, 2.0], "b": [0.0, 4.0]})
    >>> table["value"].tolist()
    [[nan, 0.25], [nan, 0.5]]
    >>> table.status[0].tolist()
    ['ZeroDivisionError: float division by zero', 'completed']
    """

    axes: dict[str, np.ndarray]
    values: dict[str, np.ndarray]
    status: np.ndarray

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values on each axis."""
        return self.status.shape

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the values."""
        return tuple(self.values)

    @property
    def success(self) -> np.ndarray:
        """Where the status is "completed", shape table.shape."""
        return self.status == COMPLETED

    def __getitem__(self, name: str) -> np.ndarray:
        if name in self.values:
            return self.values[name]
        required = f"be one of {', '.join(map(repr, self.names)) or 'none: no point gave a value'}"
        raise KeyError(complaint("name", required, repr(name), "axes are in table.axes"))

    def to_pandas(self) -> Any:
        """Return the table as a pandas DataFrame: a row for each point, a column for each number.

        Returns
        -------
        pandas.DataFrame
            Rows are labelled by the axes; entries of arrays become columns "name[0]", "name[1]",
            ...; the last column is "status".
        """
        pandas = optional("pandas", "to_pandas")
        n = self.status.size
        columns = {}
        for name, value in self.values.items():
            entries = value.reshape(n, -1)
            for k, place in enumerate(np.ndindex(value.shape[len(self.shape) :])):
                label = f"{name}[{', '.join(map(str, place))}]" if place else name
                columns[label] = entries[:, k]
        columns[_STATUS] = self.status.ravel()
        rows = pandas.MultiIndex.from_product(self.axes.values(), names=self.axes)
        rows = rows.get_level_values(0) if rows.nlevels == 1 else rows
        return pandas.DataFrame(columns, index=rows)

    def to_xarray(self) -> Any:
        """Return the table as an xarray Dataset.

        Returns
        -------
        xarray.Dataset
            Dimensions are the axes and, for arrays, "name_0", "name_1", ...; the status is a
            variable like the values.
        """
        xarray = optional("xarray", "to_xarray")
        variables = {}
        for name, value in (self.values | {_STATUS: self.status}).items():
            dimensions = [f"{name}_{k}" for k in range(value.ndim - len(self.shape))]
            variables[name] = ([*self.axes, *dimensions], value)
        return xarray.Dataset(variables, coords=self.axes)

    def _repr_html_(self) -> str:
        plain = [name for name, value in self.values.items() if value.shape == self.shape]
        rows = []
        for index in itertools.islice(np.ndindex(self.shape), _MAX_ROWS_SHOWN):
            places = zip(index, self.axes.values(), strict=True)
            point = [axis[k].item() for k, axis in places]
            values = [self.values[name][index].item() for name in plain]
            rows.append([*point, *values, self.status[index]])
        return paragraph(repr(self)) + table_html([*self.axes, *plain, _STATUS], rows)

    def __repr__(self) -> str:
        axes = ", ".join(f"{name} ({axis.size})" for name, axis in self.axes.items())
        done = int(np.count_nonzero(self.success))
        return f"Table({', '.join(self.names)} over {axes}; {done} of {self.status.size} completed)"


def table_of(axes: dict[str, np.ndarray], points: list[Point | None]) -> Table:
    """Return the table of points, status and values or None, in the order of the grid."""
    # numbers, strings or nested lists, by name; points fail if these do not fit the first point
    status = [NOT_COMPUTED if point is None else point[0] for point in points]
    values: dict[str, np.ndarray] = {}
    shape = tuple(axis.size for axis in axes.values())
    for name in dict.fromkeys(name for point in points if point for name in point[1]):
        rows = {k: np.asarray(p[1][name]) for k, p in enumerate(points) if p and name in p[1]}
        column = _column(name, rows, status)
        values[name] = column.reshape(shape + column.shape[1:])
    return Table(axes, values, np.array(status).reshape(shape))


def _column(name: str, rows: dict[int, np.ndarray], status: list[str]) -> np.ndarray:
    """Return the values of one name at all points as one array; lengths may differ."""
    # values that do not fit the first point fail, as `status` says; an empty array fits all others
    filled = [row for row in rows.values() if row.shape != (0,)] or list(rows.values())
    layout = _layout(filled[0])
    content = layout[0]
    fitting = [row for row in filled if _layout(row) == layout]
    longest = max(row.shape for row in fitting)
    kind = max((row.dtype for row in fitting), key=lambda dtype: dtype.itemsize)
    column = np.full((len(status), *longest), "" if content == "text" else np.nan, dtype=kind)
    for k, row in rows.items():
        if _layout(row) == layout:
            column[(k, slice(len(row))) if longest else k] = row
        elif status[k] == COMPLETED and not (row.shape == (0,) and longest):
            required = f"be {content} of shape {longest}, but for its length, as at the first point"
            got = f"{_layout(row)[0]} of shape {row.shape}"
            status[k] = f"ValueError: {complaint(name, required, got)}"[:STATUS_LENGTH]
    return column


def _layout(row: np.ndarray) -> tuple[str, int, tuple[int, ...]]:
    """Return what the values of one name must share: their type, and all lengths but the first."""
    return "text" if row.dtype.kind == "U" else "numbers", row.ndim, row.shape[1:]
