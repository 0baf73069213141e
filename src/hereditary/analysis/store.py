"""Finished points of a sweep on disk, so that a killed sweep goes on where it was.

A file of lines of JSON: the grid, then one finished point a line, ``[index, status, values]``. Each
line is written at once to the file's end. Python writes floats so that they are read back exactly.
"""

import json
import os

import numpy as np

from ..support.checks import complaint

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None  # type: ignore[assignment]

_KIND = "points of a hereditary sweep"


class Store:
    """A file of finished points; a context manager that holds it for one process alone.

    Parameters
    ----------
    path : path-like
        Made where there is none yet.
    axes : dict of str to ndarray
        The grid; a file of another one is refused.
    """

    def __init__(self, path, axes):
        if not isinstance(path, str | os.PathLike):
            raise TypeError(complaint("store", "be the path of a file", repr(path)))
        self._path = os.fspath(path)
        self._axes = {name: axis.tolist() for name, axis in axes.items()}
        self._header = _line({"file": _KIND, "axes": self._axes})
        self._n_points = 1
        for axis in axes.values():
            self._n_points *= axis.size

    def __enter__(self):
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0)
        self._file = os.open(self._path, flags, 0o666)
        try:
            self._hold()
        except BaseException:
            os.close(self._file)
            raise
        return self

    def __exit__(self, *exception):
        os.close(self._file)

    def _hold(self):
        if fcntl is None:
            return
        try:
            # unlike flock, not inherited by worker processes that may outlive a killed sweep
            fcntl.lockf(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError) as error:
            got = f"{self._path!r}, which another process is using"
            raise ValueError(complaint("store", "be used by one sweep at a time", got)) from error
        except OSError:  # a file system without locks
            return

    def restore(self, take):
        """Hand every stored point to ``take(index, status, values)``; drop a torn last line."""
        # closing a second descriptor of the file would give up the lock
        with open(self._file, "rb", closefd=False) as file:
            header = file.readline()
            if header != self._header:
                if header.endswith(b"\n") or not self._header.startswith(header):
                    raise ValueError(self._foreign(header))
                os.ftruncate(self._file, 0)
                self._append(self._header)
                return
            whole = len(header)
            for number, line in enumerate(file, start=2):
                if not line.endswith(b"\n"):
                    os.ftruncate(self._file, whole)
                    return
                whole += len(line)
                take(*self._point(line, number))

    def add(self, index, status, values):
        """Put a finished point on disk."""
        self._append(_line([index, status, values]))

    def _append(self, line):
        # more than one write only where a disk is full or a signal came; what is torn is dropped
        while line:
            line = line[os.write(self._file, line) :]

    def _point(self, line, number):
        try:
            index, status, values = json.loads(line)
            known = type(index) is int and 0 <= index < self._n_points
            if known and isinstance(status, str) and _are_plain(values):
                return index, status, values
        except (TypeError, ValueError, RecursionError):
            pass
        got = f"{line[:40]!r} in line {number} of {self._path!r}"
        raise ValueError(complaint("store", "hold a point a line", got, "delete that line"))

    def _foreign(self, header):
        """Name what is wrong with a file that begins in another way."""
        remedy = "name another file, or delete this one to start anew"
        try:
            stored = json.loads(header)
            if stored["file"] != _KIND:
                raise ValueError
            axes = stored["axes"]
            if not isinstance(axes, dict) or not all(map(_is_axis, axes.values())):
                raise ValueError
        except (KeyError, TypeError, ValueError, RecursionError):
            required = "be a new file or one that an earlier sweep wrote"
            return complaint("store", required, repr(self._path), remedy)
        required = f"be of the same grid, with axes {', '.join(self._axes)}"
        got = f"{self._path!r} with axes {', '.join(axes)}"
        if list(axes) == list(self._axes):
            differing = [name for name, axis in axes.items() if axis != self._axes[name]]
            name = (differing or list(axes))[0]
            required = f"be of the same grid, with {name} = {_few(self._axes[name])}"
            got = f"{self._path!r} with {name} = {_few(axes[name])}"
        return complaint("store", required, got, remedy)


def _line(content):
    return json.dumps(content, separators=(",", ":")).encode() + b"\n"


def _are_plain(values):
    """Whether values are numbers, strings or arrays of either, by name."""
    if not isinstance(values, dict):
        return False
    # rows of unequal length raise a ValueError
    arrays = [np.asarray(value) for value in values.values()]
    return all(array.dtype.kind in "iufU" and (array.size or not len(array)) for array in arrays)


def _is_axis(values):
    return isinstance(values, list) and len(values) > 0


def _few(values):
    """Values of an axis in few words."""
    ends = repr(values[0]) if len(values) == 1 else f"{values[0]!r} .. {values[-1]!r}"
    return f"{ends} ({len(values)})"
