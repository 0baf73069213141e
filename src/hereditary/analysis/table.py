"""Labelled results of a sweep, and how they are gathered from points in any order."""

from __future__ import annotations

import itertools
import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..support.checks import complaint
from ..support.html import paragraph, rows_of
from ..support.optional import optional

COMPLETED, NOT_COMPUTED = "completed", "not computed"
# A status is one line of at most so many characters: arrays of strings are as wide as the widest.
STATUS_LENGTH = 200
_AXIS, _VALUE, _STATUS = "axis:", "value:", "status"
# Rows that a notebook shows.
_SHOWN = 10
_SAVED = "be a whole file that Table.save wrote"


@dataclass(frozen=True, eq=False)
class Table:
    """Values over a grid of parameters, labelled by its axes.

    Attributes
    ----------
    axes : dict of str to ndarray, shape (n,)
        The values of each axis, in the order of the array axes.
    values : dict of str to ndarray, shape table.shape + (...)
        What the function returned, under its names: float64, or strings. NaN, or an empty string,
        where a point gave none or one that does not fit, and behind arrays shorter than the longest
        one.
    status : ndarray of str, shape table.shape
        "completed", what the function returned as its status, "not computed", or the exception that
        it raised, as one line of at most 200 characters.

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

    def save(self, path: str | os.PathLike) -> None:
        """Write the table to a compressed .npz file, named exactly `path`.

        Parameters
        ----------
        path : path-like
        """
        arrays = {_AXIS + name: axis for name, axis in self.axes.items()}
        arrays |= {_VALUE + name: value for name, value in self.values.items()}
        with open(path, "wb") as file:
            np.savez_compressed(file, allow_pickle=False, **{_STATUS: self.status}, **arrays)

    @classmethod
    def load(cls, path: str | os.PathLike) -> Table:
        """Read a table that `save` wrote.

        Parameters
        ----------
        path : path-like

        Returns
        -------
        Table
        """
        try:
            with open(path, "rb") as file, np.load(file, allow_pickle=False) as loaded:
                arrays = {name: loaded[name] for name in loaded.files}
        except (FileNotFoundError, IsADirectoryError, PermissionError):
            raise
        except Exception as error:  # what a damaged or foreign file raises depends on its bytes
            raise ValueError(complaint("path", _SAVED, repr(path))) from error
        axes, values = (
            {name[len(kind) :]: arrays[name] for name in arrays if name.startswith(kind)}
            for kind in (_AXIS, _VALUE)
        )
        shape = tuple(axis.size for axis in axes.values())
        status = arrays.get(_STATUS, np.empty(0))
        if status.shape != shape or any(v.shape[: len(shape)] != shape for v in values.values()):
            raise ValueError(complaint("path", _SAVED, repr(path)))
        return cls(axes, values, status)

    def to_pandas(self) -> Any:
        """The table as a pandas DataFrame: a row a point, a column a number.

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
        if len(self.axes) == 1:
            ((name, axis),) = self.axes.items()
            rows = pandas.Index(axis, name=name)
        else:
            rows = pandas.MultiIndex.from_product(self.axes.values(), names=self.axes)
        return pandas.DataFrame(columns, index=rows)

    def to_xarray(self) -> Any:
        """The table as an xarray Dataset.

        Returns
        -------
        xarray.Dataset
            Dimensions are the axes and, for arrays, "name_0", "name_1", ...; the status is a
            variable like the values.
        """
        xarray = optional("xarray", "to_xarray")
        variables = {}
        for name, value in (self.values | {_STATUS: self.status}).items():
            own = [f"{name}_{k}" for k in range(value.ndim - len(self.shape))]
            variables[name] = ([*self.axes, *own], value)
        return xarray.Dataset(variables, coords=self.axes)

    def _repr_html_(self):
        plain = [name for name, value in self.values.items() if value.shape == self.shape]
        rows = []
        for index in itertools.islice(np.ndindex(self.shape), _SHOWN):
            places = zip(index, self.axes.values(), strict=True)
            point = [axis[k].item() for k, axis in places]
            values = [self.values[name][index].item() for name in plain]
            rows.append([*point, *values, self.status[index]])
        return paragraph(repr(self)) + rows_of([*self.axes, *plain, _STATUS], rows)

    def __repr__(self):
        axes = ", ".join(f"{name} ({axis.size})" for name, axis in self.axes.items())
        done = int(np.count_nonzero(self.success))
        return f"Table({', '.join(self.names)} over {axes}; {done} of {self.status.size} completed)"


def _but_length(kind, shape):
    """Return kind, number of dimensions and all but the first length of an array."""
    return kind, len(shape), shape[1:]


class Columns:
    """Takes in points in any order and makes the table, which does not depend on that order.

    Parameters
    ----------
    axes : dict of str to ndarray
    """

    def __init__(self, axes):
        self._axes = axes
        self._shape = tuple(axis.size for axis in axes.values())
        self._status = [NOT_COMPUTED] * int(np.prod(self._shape))
        # name -> kind and shape -> indices and rows: points may disagree until all are known
        self._found: dict[str, dict[tuple, tuple[list, list]]] = {}
        self._first: dict[str, tuple[int, int]] = {}

    def __contains__(self, index):
        return self._status[index] is not NOT_COMPUTED

    @property
    def n_left(self):
        """Number of points that are missing."""
        return sum(status is NOT_COMPUTED for status in self._status)

    def add(self, index, status, values):
        """Take in a point: its status, and numbers, strings or nested lists of them by name."""
        self._status[index] = COMPLETED if status == COMPLETED else str(status)
        for place, (name, value) in enumerate(values.items()):
            row = np.asarray(value) if isinstance(value, list) else value
            kind = ("text" if np.asarray(row).dtype.kind == "U" else "numbers", np.shape(row))
            indices, rows = self._found.setdefault(name, {}).setdefault(kind, ([], []))
            indices.append(index)
            rows.append(row)
            self._first[name] = min(self._first.get(name, (index, place)), (index, place))

    def table(self):
        """All points as a table; those that do not fit the first one of the grid have failed."""
        values = {
            name: self._column(name)
            for name in sorted(self._found, key=lambda name: self._first[name])
        }
        return Table(self._axes, values, np.array(self._status).reshape(self._shape))

    def _column(self, name):
        forms = self._found[name]
        # arrays may be of different lengths: the longest one decides; an empty one is of any kind
        empty = {form for form in forms if form[1] == (0,)}
        told = forms.keys() - empty or empty
        kind, shape = min(told, key=lambda form: min(forms[form][0]))
        alike = {form for form in told if _but_length(*form) == _but_length(kind, shape)}
        shape = max(own for _, own in alike)
        column = np.full((len(self._status), *shape), "" if kind == "text" else np.nan)
        for _, own in alike:
            indices, rows = forms[kind, own]
            filled = np.array(rows)
            column = column.astype(np.promote_types(column.dtype, filled.dtype))
            column[(indices, slice(own[0])) if own else indices] = filled
        for form in forms.keys() - alike - (empty if shape else set()):
            required = f"be {kind} of shape {shape}, but for its length, as at the first point"
            got = f"{form[0]} of shape {form[1]}"
            for index in forms[form][0]:
                if self._status[index] is COMPLETED:
                    trouble = f"ValueError: {complaint(name, required, got)}"
                    self._status[index] = trouble[:STATUS_LENGTH]
        return column.reshape(self._shape + shape)
