"""Sweeps over grids of parameters: on all cores, in any order, resumed after a kill."""

from __future__ import annotations

import contextlib
import enum
import inspect
import itertools
import os
import queue
import signal
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..solver.first_order import no_estimates
from ..solver.progress import Interruption, ProgressBar
from ..support.checks import complaint, instance, refuse_masked, shown
from ..support.machine import cores
from .store import Store
from .table import COMPLETED, STATUS_LENGTH, Columns, Table

# Points that an executor holds at a time: enough for its workers, few enough for any grid.
_IN_FLIGHT = 1024
# Seconds between two looks at Ctrl-C.
_LOOK = 0.1


def sweep(
    function: Callable[..., Any],
    grid: Mapping[str, ArrayLike],
    executor: Executor | None = None,
    store: str | os.PathLike | None = None,
    progress: bool = True,
    carry: bool = False,
) -> Table:
    """Call a function at every point of a grid, on all cores.

    Parameters
    ----------
    function : callable
        Called as ``function(**point)`` with one value for each axis. Returns a number, a string, an
        array of them, or a mapping of names to such; a bare value is named "value". Arrays may have
        a different length at each point: NaN fill them up to the longest. Under the name
        "status" a mapping may say how the point ended, e.g. ``solution.status``.
    grid : mapping of str to sequence, shape (n,)
        The values of each axis, finite and distinct numbers or strings; the points are all
        combinations.
    executor : concurrent.futures.Executor, optional
        Where points are computed, e.g. a ``ProcessPoolExecutor()``, a Dask
        ``client.get_executor()`` or an ``mpi4py.futures.MPIPoolExecutor()``; it is not shut down.
        By default threads on all cores.
    store : path-like, optional
        File that every finished point is written to as soon as it is known. A sweep that finds its
        file goes on from there: no point in it is computed again. A file of another grid is
        refused; that the function is the same is not checked.
    progress : bool, optional
        Show a bar with the time left, on a terminal.
    carry : bool, optional
        Go along the last axis in its order, each point from where the one before ended: the
        function is called as ``function(state=..., **point)`` and returns a mapping with its
        "state" for the next point, None at the first point of each row. Rows are computed side by
        side, and a row that a store holds in part is computed again from its first point on.

    Returns
    -------
    Table
        Also after Ctrl-C, when points under way have ended: the others have the status "not
        computed". A second Ctrl-C raises at once.

    Notes
    -----
    A point at which the function raises keeps the exception as its status and NaN as its values,
    in the store too; delete the store, or its lines, to try again. The table does not depend on the
    executor, on the number of threads, or on the order in which points end.

    Threads share one interpreter: a point gains by them what it spends in marches. Where Python
    itself takes most of the time (many short runs, `lyapunov` below some 100,000 steps) take
    processes, for which the function must be defined at the top of a module (docs/sweeps.md).

    Examples
    --------
    >>> import hereditary as hd
    >>> def last_place(b):
    ...     sol = hd.solve(hd.scenes.stick_slip(spring_speed=b), 10.0, 1000)
    ...     return {"x": sol.y[-1, 0], "status": sol.status}
    >>> table = hd.sweep(last_place, {"b": [1.0, 2.0]})
    >>> table["x"].round(2).tolist()
    [4.19, 4.74]

    Each force goes on from where the one before left y:

    >>> eq = hd.Equation(hd.Caputo(0.8), lambda t, y, p: p[0] - y, 0.0, params=[1.0])
    >>> def onwards(force, state):
    ...     if state is None:
    ...         sol = hd.solve(eq.replace(params=[force]), 10.0, 1000)
    ...     else:
    ...         sol = hd.solve(eq, state.t + 10.0, resume=state, params=[force])
    ...     return {"y": sol.y[-1, 0], "state": sol.state}
    >>> hd.sweep(onwards, {"force": [1.0, 2.0, 1.5]}, carry=True)["y"].round(1).tolist()
    [1.0, 1.9, 1.5]
    """
    if not callable(function):
        raise TypeError(complaint("function", "be callable", repr(function)))
    axes = _axes(grid)
    if carry and "state" in axes:
        required = 'name no axis "state" with carry=True'
        raise ValueError(complaint("grid", required, ", ".join(axes)))
    _check_arguments(function, axes, carry)
    if executor is not None:
        example = "concurrent.futures.ProcessPoolExecutor() or a Dask client.get_executor()"
        instance("executor", executor, Executor, example)
    columns = Columns(axes)
    with contextlib.nullcontext() if store is None else Store(store, axes) as kept:
        if kept is not None:
            kept.restore(columns.add)

        def keep(index, status, values):
            """Keep a point; return whether it is new."""
            if index in columns:  # of a row that was kept in part
                return False
            if kept is not None:
                kept.add(index, status, values)
            columns.add(index, status, values)
            return True

        pool = ThreadPoolExecutor(cores()) if executor is None else executor
        try:
            rows = _rows(axes, len(list(axes.values())[-1]) if carry else 1)
            left = (row for row in rows if any(i not in columns for i in row))
            _run(partial(computed, function, carry), left, columns.n_left, pool, keep, progress)
        finally:
            if executor is None:
                pool.shutdown(wait=False, cancel_futures=True)
    return columns.table()


def _axes(grid):
    """The grid, checked, as one array for each axis."""
    if not isinstance(grid, Mapping) or not grid:
        required = "be a mapping of axis names to values"
        raise TypeError(complaint("grid", required, repr(grid), 'pass e.g. {"b": [1.0, 2.0]}'))
    return {name: _axis(name, values) for name, values in grid.items()}


def _axis(name, values):
    if not isinstance(name, str) or name in ("", "status"):
        required = "be named by strings other than '' and 'status'"
        raise ValueError(complaint("axes of grid", required, repr(name)))
    argument = f"grid[{name!r}]"
    refuse_masked(argument, values, "hold numbers or strings alone")
    try:
        array = np.asarray(values)
    except ValueError:  # rows of unequal length
        array = np.asarray(None)
    if array.ndim != 1 or array.size == 0:
        required = "be a flat sequence of at least one value"
        raise ValueError(complaint(argument, required, repr(values)[:STATUS_LENGTH]))
    kind = array.dtype.kind
    # numpy turns numbers beside strings into strings
    if kind not in "biufU" or (kind == "U" and not all(isinstance(v, str) for v in values)):
        required = "hold numbers or strings alone"
        raise TypeError(complaint(argument, required, repr(values)[:STATUS_LENGTH]))
    array = array.astype(float) if kind == "f" else array
    if kind == "f" and not np.all(np.isfinite(array)):
        raise ValueError(complaint(argument, "hold finite numbers", shown(array)))
    if np.unique(array).size < array.size:
        raise ValueError(complaint(argument, "hold distinct values", shown(array)))
    return array


def _check_arguments(function, axes, carry):
    """Refuse axes that every call would stumble over."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # some built-in functions tell nothing
        return
    try:
        signature.bind(**axes, **({"state": None} if carry else {}))
    except TypeError as error:
        required = "have an axis for each argument of function"
        required += ', which takes "state" too with carry=True' if carry else ""
        raise TypeError(complaint("grid", required, f"axes {', '.join(axes)}", error)) from error


def _rows(axes, size):
    """Points of the grid by their numbers, `size` of them at a time, the last axis fastest."""
    found = itertools.product(*(axis.tolist() for axis in axes.values()))
    points = enumerate(dict(zip(axes, values, strict=True)) for values in found)
    while row := dict(itertools.islice(points, size)):
        yield row


def _run(compute, left, n_left, executor, keep, progress):
    """Hand out rows of points, a bounded number at a time, and keep what comes back."""
    finished: queue.SimpleQueue = queue.SimpleQueue()
    running: dict[Any, dict] = {}
    bar, n_done, stopped = ProgressBar(progress), 0, False
    try:
        with Interruption() as interruption:
            following = next(left, None)
            while running or following is not None:
                handed_out = False
                if following is not None and len(running) < _IN_FLIGHT:
                    handed_out = True
                    future = executor.submit(compute, list(following.values()), os.getpid())
                    running[future] = following
                    future.add_done_callback(finished.put)
                    following = next(left, None)
                future = _taken(finished, 0.0 if handed_out else _LOOK)
                if future is not None:
                    n_done += _kept(future, running.pop(future), keep, interruption.asked)
                    bar.update(n_done / n_left)
                if interruption.asked and not stopped:
                    following, stopped = None, True
                    _withdraw(running)
            interruption.heeded = n_done < n_left
    finally:
        _withdraw(running)
        bar.close()


def _taken(finished, seconds):
    """The next finished point, None if there is none for so long."""
    try:
        return finished.get(timeout=seconds) if seconds else finished.get_nowait()
    except queue.Empty:
        return None


def _kept(future, row, keep, asked_to_stop):
    """Keep what a finished future holds; return the number of new points in it."""
    if future.cancelled():
        return 0
    error = future.exception()
    if error is None:
        results = zip(row, future.result(), strict=True)
        return sum([keep(index, *found) for index, found in results])
    if asked_to_stop:  # Ctrl-C reaches worker processes too
        return 0
    remedy = (
        "for other processes define function at the top of a module; points in the store are kept"
    )
    got = f"{type(error).__name__}: {error}"
    raise RuntimeError(
        complaint("executor", "carry every point to its end", got, remedy)
    ) from error


def _withdraw(running):
    """Take back points that are not under way yet."""
    for future in list(running):
        future.cancel()


def computed(function, carry, points, home):
    """Status and plain values of each of some points: what an executor runs, in any process.

    Parameters
    ----------
    function : callable
    carry : bool
        Whether each point goes on from the state that the one before returned.
    points : list of dict
    home : int
        Process of the sweep.

    Returns
    -------
    list of (str, dict)
        Statuses; floats, strings and nested lists of them, as a store gives them back.
    """
    deaf = contextlib.nullcontext() if os.getpid() == home else _deaf_to_ctrl_c()
    with deaf, no_estimates():
        found, state = [], None
        for point in points:
            try:
                if carry:
                    returned, state = _with_state(function(state=state, **point))
                else:
                    returned = function(**point)
                found.append(_plain(returned, point))
            except Exception as error:
                found.append((_one_line(f"{type(error).__name__}: {error}"), {}))
        return found


def _with_state(returned):
    """Split what a function returned into values and the state for the next point."""
    if not isinstance(returned, Mapping) or "state" not in returned:
        required = 'return a mapping with "state", for the next point, with carry=True'
        raise ValueError(complaint("function", required, repr(returned)[:STATUS_LENGTH]))
    values = dict(returned)
    return values, values.pop("state")


@contextlib.contextmanager
def _deaf_to_ctrl_c():
    """Ctrl-C reaches every process, but a run that it cut short here would pass for a whole one."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_DFL if before is None else before)


def _one_line(text):
    text = " ".join(text.split())
    return text if len(text) <= STATUS_LENGTH else text[: STATUS_LENGTH - 3] + "..."


def _plain(returned, point):
    """Status and values of what the function returned."""
    values = dict(returned) if isinstance(returned, Mapping) else {"value": returned}
    status = _one_line(str(values.pop("status", COMPLETED)))
    for name, value in values.items():
        if not isinstance(name, str) or name in point:
            required = "name its values by strings other than the names of the axes"
            raise ValueError(complaint("function", required, repr(name), "return a mapping"))
        values[name] = _plain_value(name, value)
    return status, values


def _plain_value(name, value):
    array = np.asarray(str(value) if isinstance(value, enum.Enum) else value)
    kind = array.dtype.kind
    if kind not in "biufU" or (array.size == 0 and len(array)):
        required = "be a number, a string, or an array of them"
        raise TypeError(complaint(name, required, f"a {type(value).__name__}"))
    if kind != "U":
        array = array.astype(float)
        array[np.isnan(array)] = np.nan  # one NaN of many: a store keeps no sign of it
    return array.tolist()
