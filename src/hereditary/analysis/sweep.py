"""Sweeps over grids of parameters: on all cores, in any order, resumed after a kill.

A store is a file of lines of JSON: the grid, then one finished point a line, ``[index, status,
values]``. Python writes floats so that they are read back exactly.
"""

from __future__ import annotations

import contextlib
import enum
import itertools
import json
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Container, Iterator, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import partial
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike

from ..solver.accuracy import no_estimates
from ..solver.elsewhere import lacking
from ..solver.progress import Interruption, ProgressBar
from ..support.checks import callable_with, complaint, instance, refuse, refuse_masked, shown, truth
from ..support.machine import cores
from ..support.warning import warn
from .table import COMPLETED, STATUS_LENGTH, Point, Table, table_of

# Most points that are submitted to an executor at a time: enough for its workers, few enough for
# any grid.
_IN_FLIGHT = 1024
# Seconds between two checks for Ctrl-C.
_SWEEP_POLL_SECONDS = 0.1


@lacking("the function that is swept passes it to solve")
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
        Called as ``function(**point)`` with one value for each axis. It returns a number, a string,
        an array of these, or a mapping of names to these; a bare value is named "value". Arrays may
        have a different length at each point: NaN fills the shorter ones. The entry "status" of a
        mapping is the status of the point, e.g. ``solution.status``.
    grid : mapping of str to sequence, shape (n,)
        The values of each axis, finite and distinct numbers or strings; the points are all
        combinations.
    executor : concurrent.futures.Executor, optional
        Where points are computed, e.g. a ``ProcessPoolExecutor()``, a Dask
        ``client.get_executor()`` or an ``mpi4py.futures.MPIPoolExecutor()``; it is not shut down.
        By default threads on all cores.
    store : path-like, optional
        File to which every finished point is written at once. If the file exists, the sweep
        computes only the points that are missing. A file of another grid is refused. The function
        is not checked. Only one sweep at a time may use a file.
    progress : bool, optional
        Show a bar with the time left, on a terminal.
    carry : bool, optional
        Go along the last axis in its order, and start each point from the state of the point
        before. The function is called as ``function(state=..., **point)``, with state None at the
        first point of each row. It returns a mapping with its "state" for the next point. Rows are
        computed in parallel. A row that a store contains only in part is computed again from its
        first point.

    Returns
    -------
    Table
        After Ctrl-C the sweep waits for the running points, and the others have the status "not
        computed". A second Ctrl-C raises at once.

    Warns
    -----
    UserWarning
        The last line of the store is incomplete, as after a kill: its point is computed again.

    Notes
    -----
    If the function raises, the point has the exception as its status and NaN as its values, also in
    the store. To try again, delete the store or the lines of such points. The table does not depend
    on the executor, on the number of threads, or on the order in which points end.

    Threads share one interpreter, so they speed up only the compiled part of each point. Use
    processes if Python takes most of the time, as in many short runs or in `lyapunov` below about
    100,000 steps. The function must then be defined at the top of a module (docs/sweeps.md).

    Examples
    --------
    >>> import hereditary as hd
    >>> def last_place(b):
    ...     sol = hd.solve(hd.scenes.stick_slip(spring_speed=b), 10.0, 1000)
    ...     return {"x": sol.y[-1, 0], "status": sol.status}
    >>> table = hd.sweep(last_place, {"b": [1.0, 2.0]})
    >>> table["x"].round(2).tolist()
    [4.19, 4.74]

    Each force starts from the last state of the force before:

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
        refuse("function", "be callable", repr(function), kind=TypeError)
    if not isinstance(grid, Mapping) or not grid:
        required = "be a mapping of axis names to values"
        refuse("grid", required, repr(grid), 'pass e.g. {"b": [1.0, 2.0]}', kind=TypeError)
    axes = {name: _axis(name, values) for name, values in grid.items()}
    if truth("carry", carry) and "state" in axes:
        refuse("grid", 'name no axis "state" with carry=True', ", ".join(axes))
    required, got = "have an axis for each argument of function", f"axes {', '.join(axes)}"
    got += ', where function takes "state" too with carry=True' * carry
    state = {"state": None} if carry else {}
    callable_with(function, required, "grid", got, **axes, **state)
    if executor is not None:
        example = "concurrent.futures.ProcessPoolExecutor() or a Dask client.get_executor()"
        instance("executor", executor, Executor, example)
    points: list[Point | None] = [None] * int(np.prod([axis.size for axis in axes.values()]))
    pool = ThreadPoolExecutor(cores()) if executor is None else executor
    try:
        with contextlib.nullcontext() if store is None else _opened(store, axes, points) as file:
            size = len(list(axes.values())[-1]) if carry else 1
            rows = (row for row in _rows(axes, size) if any(points[i] is None for i in row))
            _run(partial(computed, function, carry), rows, pool, points, file, progress)
    finally:
        if executor is None:
            pool.shutdown(wait=False, cancel_futures=True)
    return table_of(axes, points)


def _axis(name: Any, values: Any) -> np.ndarray:
    argument, got = f"grid[{name!r}]", repr(values)[:STATUS_LENGTH]
    if not isinstance(name, str) or name in ("", "status"):
        refuse("axes of grid", "be named by strings other than '' and 'status'", repr(name))
    refuse_masked(argument, values, "have only numbers or strings")
    try:
        array = np.asarray(values)
    except ValueError:  # rows of unequal length
        array = np.empty(0)
    if array.ndim != 1 or array.size == 0:
        refuse(argument, "be a flat sequence of at least one value", got)
    numbers = array.dtype.kind in "biuf"
    # an array of numbers and strings would turn the numbers into strings
    if not numbers and not all(isinstance(value, str) for value in values):
        refuse(argument, "have only numbers or strings", got, kind=TypeError)
    if numbers and not np.isfinite(array).all():
        refuse(argument, "hold finite numbers", shown(array))
    if np.unique(array).size < array.size:
        refuse(argument, "hold distinct values", shown(array))
    return array.astype(float) if array.dtype.kind == "f" else array


def _rows(axes: dict[str, np.ndarray], size: int) -> Iterator[dict[int, dict[str, Any]]]:
    """Yield points of the grid by their numbers, `size` at a time, the last axis fastest."""
    found = itertools.product(*(axis.tolist() for axis in axes.values()))
    points = enumerate(dict(zip(axes, values, strict=True)) for values in found)
    while row := dict(itertools.islice(points, size)):
        yield row


def _run(
    compute: Callable[..., list[Point]], rows: Iterator[dict[int, dict[str, Any]]],
    executor: Executor, points: list[Point | None], file: BinaryIO | None, progress: bool,
) -> None:  # fmt: skip
    """Submit rows of points, a bounded number at a time, and store their results."""
    finished: queue.SimpleQueue = queue.SimpleQueue()
    running: dict[Any, dict] = {}
    bar, n_left, n_done = ProgressBar(progress), points.count(None), 0
    try:
        # an exception that is raised while the executor takes a lock would leave it locked
        with Interruption(max_asked=sys.maxsize) as interruption:
            while True:
                if interruption.asked > 1:
                    raise KeyboardInterrupt
                if interruption.asked:
                    rows = iter(())
                    for future in running:
                        future.cancel()
                for row in itertools.islice(rows, _IN_FLIGHT - len(running)):
                    future = executor.submit(compute, list(row.values()), os.getpid())
                    running[future] = row
                    future.add_done_callback(finished.put)
                if not running:
                    break
                with contextlib.suppress(queue.Empty):
                    future = finished.get(timeout=_SWEEP_POLL_SECONDS)
                    results = _results(future, interruption.asked)
                    for index, point in zip(running.pop(future), results, strict=False):
                        if points[index] is None:  # a store may hold a part of the row
                            points[index], n_done = point, n_done + 1
                            if file is not None:
                                file.write(_line([index, *point]))
                                file.flush()
                    bar.update(n_done / n_left)
            interruption.heeded = n_done < n_left
    finally:
        for future in running:
            future.cancel()
        bar.close()


def _results(future: Future[list[Point]], asked_to_stop: int) -> list[Point]:
    """Return the points of a future, or none of a future that was cancelled."""
    error = None if future.cancelled() else future.exception()
    if future.cancelled() or (error and asked_to_stop):  # Ctrl-C reaches worker processes too
        return []
    if error:
        got = f"{type(error).__name__}: {error}"
        remedy = "for other processes define function at the top of a module; "
        remedy += "points in the store are kept"
        required = "carry every point to its end"
        raise RuntimeError(complaint("executor", required, got, remedy)) from error
    return future.result()


def _opened(
    path: str | os.PathLike, axes: dict[str, np.ndarray], points: list[Point | None]
) -> BinaryIO:
    """Read the points of a store; return the file, for appending further points."""
    if not isinstance(path, str | os.PathLike):
        refuse("store", "be the path of a file", repr(path), kind=TypeError)
    header = _line({"axes": {name: axis.tolist() for name, axis in axes.items()}})
    with open(path, "a+b") as file:
        file.seek(0)
        for number, line in enumerate(file):
            if not line.endswith(b"\n") and (number or header.startswith(line)):
                warn(f"the last line of {str(path)!r} is torn and dropped", UserWarning)
                file.truncate(file.tell() - len(line))
            elif number:
                index, point = _read(line, len(points), f"line {number + 1} of {str(path)!r}")
                points[index] = point
            elif line != header:
                required, remedy = "hold points of the same grid", "name another file"
                refuse("store", required, repr(str(path)), remedy)
        if file.seek(0, os.SEEK_END) == 0:
            file.write(header)
    return open(path, "ab")


def _line(content: object) -> bytes:
    return json.dumps(content, separators=(",", ":")).encode() + b"\n"


def _read(line: bytes, n: int, where: str) -> tuple[int, Point]:
    """Return index, status and values of a point, from a line of a store."""
    with contextlib.suppress(TypeError, ValueError, RecursionError):
        index, status, values = json.loads(line)
        if type(index) is int and 0 <= index < n and isinstance(status, str):
            return index, _plain(values | {"status": status}, ())
    refuse("store", "hold a point a line", f"{line[:40]!r} in {where}", "delete that line")


def computed(
    function: Callable[..., Any], carry: bool, points: list[dict[str, Any]], home: int
) -> list[Point]:
    """Return status and plain values of several points; an executor runs it in any process."""
    # carry: whether each point starts from the state that the point before returned; home: process
    # of the sweep. Values are floats, strings and nested lists of them, as a store gives them back.
    with _deaf_to_ctrl_c(home), no_estimates():
        found, state = [], None
        for point in points:
            try:
                values = function(**point, **({"state": state} if carry else {}))
                values = dict(values) if isinstance(values, Mapping) else {"value": values}
                if carry and "state" not in values:
                    required = 'return a mapping with "state", for the next point, with carry=True'
                    refuse("function", required, f"only {', '.join(values)}")
                state = values.pop("state") if carry else None
                found.append(_plain(values, point))
            except Exception as error:
                found.append((_one_line(f"{type(error).__name__}: {error}"), {}))
        return found


@contextlib.contextmanager
def _deaf_to_ctrl_c(home: int) -> Iterator[None]:
    """Ignore Ctrl-C, which all processes receive, except in the process `home`."""
    # otherwise a run that Ctrl-C ends early in a worker would count as complete
    main = threading.current_thread() is threading.main_thread()
    deaf = main and os.getpid() != home
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if deaf else None
    try:
        yield
    finally:
        if deaf:
            signal.signal(signal.SIGINT, before or signal.SIG_DFL)


def _one_line(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= STATUS_LENGTH else text[: STATUS_LENGTH - 3] + "..."


def _plain(values: dict[str, Any], point: Container[str]) -> Point:
    """Return the status of a point, and its values as floats, strings and lists of either."""
    status = sys.intern(_one_line(str(values.pop("status", COMPLETED))))
    for name, value in values.items():
        if not isinstance(name, str) or name in point:
            required = "name its values by strings other than the names of the axes"
            refuse("function", required, repr(name), "return a mapping")
        values[name] = _plain_value(name, value)
    return status, values


def _plain_value(name: str, value: Any) -> Any:
    array = np.asarray(str(value) if isinstance(value, enum.Enum) else value)
    kind = array.dtype.kind
    if kind not in "biufU" or (array.size == 0 and len(array)):
        required = "be a number, a string, or an array of them"
        refuse(name, required, f"a {type(value).__name__}", kind=TypeError)
    if kind != "U":
        array = array.astype(float)
        array[np.isnan(array)] = np.nan  # one NaN of many: a store keeps no sign of it
    return array.tolist()
