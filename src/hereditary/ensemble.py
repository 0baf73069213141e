"""Ensembles: one equation with many parameters or initial values."""

from __future__ import annotations

import multiprocessing
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .collocation.members import AT_END, LEFT, MemberRun
from .compiled.jacobian import FEW
from .compiled.records import zeros
from .equation.equation import Equation, current_equation
from .equation.system import displaced
from .given.history.history import History
from .given.opening import open_members
from .given.steps import UniformSteps, kept_steps
from .solver.accuracy import no_estimates
from .solver.elsewhere import lacking
from .solver.opening import how_to_step, open_stepper
from .solver.output import room_for
from .solver.progress import Interruption, ProgressBar
from .solver.run import Drive, reached_end, report
from .solver.saving import read_result, write_result
from .solver.solution import labelled_columns, numbered
from .solver.solve import (
    CHANGES,
    chosen_scheme,
    evaluation_times,
    kept_components,
    listed,
    run_end,
    solve,
)
from .stepping.scheme import Scheme
from .stepping.status import Ending, SolveWarning, StabilityWarning, Status
from .stepping.times import checked_breaks
from .support.checks import (
    count,
    left_out,
    mapping,
    real_array,
    refuse,
    refuse_masked,
    shown,
    whole,
)
from .support.machine import cores
from .support.optional import optional
from .support.warning import silence, warn

_SAVED_ENSEMBLE = "be an ensemble that Ensemble.save wrote"
_UNSTABLE = (Status.STEP_TOO_LARGE, Status.ZIGZAG)
# Entries of `Ensemble.stats` that have one number for each member.
_COUNTS = "n_steps", "n_rhs"
# Members that are timed, on one thread and on each of all, to choose the number of threads: while
# Python prepares a member, other threads wait.
_TIMED_MEMBERS = 8
# Largest time of a member on all threads, over that on one, for which they are taken.
_WORTH_THREADS = 0.8


# Parts into which the members of each process are divided, so that all end at about the same time.
_PARTS = 8
# Seconds between two checks for Ctrl-C while processes solve members.
_ENSEMBLE_POLL_SECONDS = 0.1


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Solutions of the members of an ensemble, at the same times.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times of the rows [time].
    y : ndarray, shape (E, n, d)
        Solutions, a member for each entry of the first axis; NaN after the end of a run that ended
        early.
    ydot : ndarray, shape (E, n, d), or None
        First derivatives, if the highest order exceeds 1.
    status : ndarray of str, shape (E,)
        How each run ended, as in `Solution.status`.
    messages : dict
        By member number, the message of each member that did not complete.
    stats : dict
        n_steps and n_rhs, (E,) each, and seconds in all.
    t_events, y_events : list of list of ndarray
        For each member, the times (k,) of the zeros of each event function, and the solution (k, d)
        there. Empty lists if there are no events.
    components : ndarray, shape (d,), or None
        Numbers of the components that the rows have, if the argument `components` chose some.
    """

    t: np.ndarray
    y: np.ndarray
    ydot: np.ndarray | None
    status: np.ndarray
    messages: dict[int, str] = field(repr=False)
    stats: dict[str, Any] = field(repr=False)
    t_events: list[list[np.ndarray]] = field(default_factory=list, repr=False)
    y_events: list[list[np.ndarray]] = field(default_factory=list, repr=False)
    components: np.ndarray | None = field(default=None, repr=False)

    @property
    def success(self) -> np.ndarray:
        """Whether each run reached its end or a terminal event, with stable steps; shape (E,)."""
        return np.isin(self.status, (Status.COMPLETED.value, Status.EVENT.value))

    def to_pandas(self) -> Any:
        """Return the rows as a pandas DataFrame.

        Returns
        -------
        pandas.DataFrame
            Indexed by "member" and "t", with columns "y[0]", "y[1]", ... and, if there is y',
            "ydot[0]", ...
        """
        pandas = optional("pandas", "to_pandas")
        tables = {"y": self.y, "ydot": self.ydot}
        flat = {name: a if a is None else a.reshape(-1, a.shape[2]) for name, a in tables.items()}
        axes = range(len(self)), self.t
        index = pandas.MultiIndex.from_product(axes, names=["member", "t"])
        return pandas.DataFrame(labelled_columns(self.components, **flat), index=index)

    def to_xarray(self) -> Any:
        """Return the rows as an xarray Dataset.

        Returns
        -------
        xarray.Dataset
            Variables y and, if there is y', ydot over "member", "t" and "component"; status,
            n_steps and n_rhs over "member".
        """
        xarray = optional("xarray", "to_xarray")
        tables = {"y": self.y, "ydot": self.ydot}
        dims = ["member", "t", "component"]
        variables = {name: (dims, array) for name, array in tables.items() if array is not None}
        of_member = {name: self.stats[name] for name in _COUNTS} | {"status": self.status}
        variables |= {name: (dims[:1], array) for name, array in of_member.items()}
        numbers = np.arange(len(self)), self.t, numbered(self.components, self.y)
        coordinates = dict(zip(dims, numbers, strict=True))
        attributes = {"seconds": self.stats["seconds"]}
        return xarray.Dataset(variables, coords=coordinates, attrs=attributes)

    def save(self, path: str | os.PathLike) -> None:
        """Write all results to a compressed .npz file, named exactly `path`.

        Parameters
        ----------
        path : path-like
        """
        arrays = {"t": self.t, "y": self.y, "ydot": self.ydot, "status": self.status}
        arrays["components"] = self.components
        arrays |= {name: self.stats[name] for name in _COUNTS}
        for k, of_members in enumerate(zip(*self.t_events, strict=True)):
            arrays[f"n_events_{k}"] = np.array([len(times) for times in of_members])
            arrays[f"t_events_{k}"] = np.concatenate(of_members)
            arrays[f"y_events_{k}"] = np.concatenate([rows[k] for rows in self.y_events])
        text = {"messages": self.messages, "seconds": self.stats["seconds"]}
        write_result(path, arrays, text)

    @classmethod
    def load(cls, path: str | os.PathLike) -> Ensemble:
        """Read an ensemble that `save` wrote. No code of the file is run.

        Parameters
        ----------
        path : path-like

        Returns
        -------
        Ensemble
        """
        return read_result(path, _SAVED_ENSEMBLE, cls._from_file)

    @classmethod
    def _from_file(cls, arrays: dict[str, np.ndarray], text: dict[str, Any]) -> Ensemble:
        """Return an ensemble from the arrays and the plain values of a file."""
        events: dict[str, list] = {"t_events": [], "y_events": []}
        counts = [arrays[f"n_events_{k}"] for k in range(sum("n_events" in a for a in arrays))]
        for name, found in events.items():
            parts = [
                np.split(arrays[f"{name}_{k}"], np.cumsum(own)[:-1]) for k, own in enumerate(counts)
            ]
            found.extend(map(list, zip(*parts, strict=True)))
        stats = {name: arrays[name] for name in _COUNTS} | {"seconds": text["seconds"]}
        messages = {int(m): message for m, message in text["messages"].items()}
        chosen = arrays.get("components")
        return cls(
            arrays["t"],
            arrays["y"],
            arrays.get("ydot"),
            arrays["status"],
            messages,
            stats,
            events["t_events"],
            events["y_events"],
            chosen,
        )

    def __len__(self) -> int:
        return len(self.y)

    def __repr__(self) -> str:
        done = f"{np.count_nonzero(self.status == Status.COMPLETED)} of {len(self)} completed"
        n_ended = np.count_nonzero(self.status == Status.EVENT)
        done += f", {n_ended} ended by an event" if n_ended else ""
        return f"Ensemble({done}; {self.t.size} rows of {self.y.shape[2]} components)"


@lacking()
def ensemble(
    equation: Equation,
    t_end: float,
    n_steps: int | None = None,
    *,
    params: ArrayLike | None = None,
    y0: ArrayLike | None = None,
    rtol: float | None = None,
    atol: float | ArrayLike | None = None,
    scheme: Scheme | None = None,
    history: History | None = None,
    max_step: float | None = None,
    breaks: ArrayLike = (),
    events: Callable | Sequence[Callable] = (),
    switches: Callable | Sequence[Callable] = (),
    changes: Mapping[float, Callable] | Sequence[Mapping[float, Callable]] | None = None,
    save_every: int = 1,
    t_eval: ArrayLike | None = None,
    components: ArrayLike | None = None,
    threads: int | None = None,
    workers: int | None = None,
    progress: bool = False,
) -> Ensemble:
    """Solve one equation for many parameters or initial values, on all cores.

    Every member has the solution of `solve`. With uniform steps it is equal to the last bit, with
    BDF(3) to BDF(6) and with rtol to rounding. Weights, modes and stability limits are computed
    once, and each thread solves one member after the other in compiled code. With events, switches
    or changes each member is a run of its own. So it is with rtol, if

    - f is called in Python, or reads memory or delays;
    - orders vary, some exceed 1 and others do not, or one is less than 0.12 above 0, 1 or another
      one of its component;
    - there are breaks, general kernels, algebraic components, or more than nine real ones.

    Use `sweep` for equations that differ in anything else, such as their orders.

    Parameters
    ----------
    equation : Equation
    t_end : float
        End of the runs [time].
    n_steps : int, optional
        Number of steps; or `rtol`.
    params : array_like, shape (E, p), optional
        Parameters of each member; shape (E,) if the equation has one.
    y0 : array_like, shape (E, ...), optional
        Initial values of each member, each row as for `Equation`.
    rtol, atol, scheme, history, max_step, breaks, events, switches
        As in `solve`.
    changes : mapping of float to callable, or sequence of E such mappings, optional
        ``{time: change}`` as in `solve`, for all members or for each. Rows at these times contain y
        after the change.
    save_every : int, optional
        Keep the first row, the last one, and every `save_every`-th one.
    t_eval : array_like, shape (n,), optional
        Keep these times instead. With n_steps they must be times of steps. With rtol the steps
        differ between members, and the default is the start and the end.
    components : array_like of int, shape (k,), optional
        Keep only these components of y, in this order.
    threads : int, optional
        By default as many as there are cores, if the first members take less time so. Else it is
        one, and if a function is called in Python.
    workers : int, optional
        Solve the members in so many processes instead, on Linux. They are copies of this one, so
        that any function is allowed. Results are the same to the last bit. Threads hardly help
        where each member is a run of its own.
    progress : bool, optional
        Show a progress bar, on a terminal only.

    Returns
    -------
    Ensemble
        Each member has its status, also if its run ends early. After Ctrl-C all unfinished members
        have the status "interrupted".

    Raises
    ------
    TypeError, ValueError
        An argument is not as required.

    Warns
    -----
    SolveWarning, StabilityWarning
        Members did not complete, or are beyond the scheme's stability limit.

    Cost
    ----
    Uniform steps take 0.1 to 0.5 microseconds each for one component, and a member 0.1 to 0.2
    milliseconds more, which threads hardly reduce. With rtol a member takes a quarter of the time
    of `solve`, if it is short (convergence/thousands_of_runs.py). A member that is a run of its own
    costs as much as `solve`.

    Examples
    --------
    >>> import numpy as np
    >>> import hereditary as hd
    >>> eq = hd.Equation(hd.Caputo(0.6), lambda t, y, p: -p[0] * y, 1.0, params=[1.0])
    >>> found = hd.ensemble(eq, 2.0, 200, params=np.linspace(0.5, 2.0, 100))
    >>> found.y.shape, bool(found.success.all())
    ((100, 201, 1), True)

    A dose at t = 1 for all:

    >>> found = hd.ensemble(
    ...     eq, 2.0, 200, params=[0.5, 1.0], changes={1.0: lambda t, y: y + 1.0}, t_eval=[0.99, 1.0]
    ... )
    >>> found.y[:, :, 0].round(2)
    array([[0.61, 1.61],
           [0.41, 1.41]])
    """
    equation = current_equation(equation)
    members = _Members(equation, params, y0)
    start = equation.t_start
    t_last = run_end("t_end", t_end, start)
    scheme = chosen_scheme(scheme, rtol, n_steps, None, None)
    save_every = count("save_every", whole(save_every))
    times = evaluation_times(t_eval, start, t_last)
    threads = threads if threads is None else count("threads", threads)
    workers = workers if workers is None else _processes(workers, threads)
    began = time.perf_counter()
    arguments: dict[str, Any] = {
        "rtol": rtol, "atol": atol, "n_steps": n_steps, "max_step": max_step, "scheme": scheme,
        "history": history, "breaks": breaks, "events": listed(events),
        "switches": listed(switches), "components": kept_components(equation, components),
    }  # fmt: skip
    kept = None
    steps = how_to_step(
        equation.system, scheme, t_last - start,
        history=history, rtol=rtol, atol=atol, n_steps=n_steps, max_step=max_step,
    )  # fmt: skip
    if isinstance(steps, UniformSteps):
        kept = _kept(steps, save_every, times, start)
        times = start + steps.h * kept
        times[-1] = t_last if kept[-1] == steps.n else times[-1]
    elif save_every > 1:
        required = "be left out with rtol, whose steps differ from member to member"
        refuse("save_every", required, save_every, "give t_eval")
    elif times is None:
        times = np.array([start, t_last])
    run = _Run(members, times, t_last, kept, steps, arguments, _each(changes, members.size))
    if workers is None:
        run.march(1 if equation.system.callbacks else threads, progress)
    else:
        run.march_in_processes(workers, progress)
    return run.close(time.perf_counter() - began)


def _processes(workers: Any, threads: int | None) -> int:
    """Check the number of processes and return it."""
    left_out("with workers", threads=threads)
    if sys.platform != "linux":
        remedy = "use hd.sweep with an executor"
        refuse("workers", "be left out on systems other than Linux", sys.platform, remedy)
    return count("workers", workers)


def _each(changes: Any, size: int) -> list[Mapping]:
    """Check `changes` and return the changes of each of `size` members."""
    if not isinstance(changes, list | tuple):
        return [{} if changes is None else mapping("changes", changes, CHANGES)] * size
    if len(changes) != size:
        required = f"be a mapping, or one for each of the {size} members"
        refuse("changes", required, f"{len(changes)} of them")
    return [mapping(f"changes[{m}]", own, CHANGES) for m, own in enumerate(changes)]


def _kept(steps: Any, save_every: int, times: np.ndarray | None, start: float) -> np.ndarray:
    """Return the numbers of the steps whose rows are kept; the start has the number 0."""
    if times is None:
        return np.append(np.arange(0, steps.n, min(save_every, steps.n)), steps.n)
    if save_every > 1:
        refuse("save_every", "be left out if t_eval names the rows to keep", save_every)
    return kept_steps(times, steps.h, start)


class _Members:
    """Parameters and initial values of E members, checked."""

    def __init__(self, equation: Equation, params: Any, y0: Any) -> None:
        # params (E, p); inside (E, m, d): initial values of the components that are marched
        if params is None and y0 is None:
            required = "be given, params or y0 or both"
            refuse("params", required, "None for both", "a row for each member", kind=TypeError)
        self._given: dict[str, np.ndarray] = {}
        if params is not None:
            self._given["params"] = _params(params, equation.params.size)
        if y0 is not None:
            self._given["y0"] = _table("y0", y0, np.iscomplexobj(np.asarray(y0)))
        sizes = [len(table) for table in self._given.values()]
        if len(set(sizes)) > 1:
            got = f"{sizes[0]} rows of params and {sizes[1]} of y0"
            refuse("params", "have as many rows as y0", got)
        self.base, self.size = equation, sizes[0]
        own = np.broadcast_to(equation.params, (self.size, equation.params.size))
        self.params = self._given.get("params", own)
        self.inside = np.broadcast_to(equation.y0, (self.size, *equation.y0.shape))
        if y0 is not None:
            self.inside = _inside(equation, self._given["y0"])

    def equation(self, m: int) -> Equation:
        """Return the equation of member m."""
        return self.base.replace(**{name: table[m] for name, table in self._given.items()})


def _table(name: str, given: Any, is_complex: bool = False) -> Any:
    """Return an array with a row for each member."""
    refuse_masked(name, given)
    if is_complex:
        table = np.array(given, dtype=complex)
        for part in (table.real, table.imag):
            real_array(name, part)
    else:
        table = real_array(name, given)
    if table.ndim == 0 or len(table) == 0:
        refuse(name, "have a row for each member, one at least", f"shape {table.shape}")
    return table


def _params(given: Any, p: int) -> Any:
    """Return the table of parameters, (E, p)."""
    table = _table("params", given)
    if table.ndim == 1 and p == 1:
        table = table[:, None]
    if table.ndim != 2 or table.shape[1] != p:
        required = f"have shape (E, {p}), a row of the equation's parameters for each member"
        refuse("params", required, f"shape {table.shape}")
    return table


def _inside(equation: Equation, values: Any) -> Any:
    """Return the initial values of the components that are marched, (E, m, d)."""
    first = equation.replace(y0=values[0])  # which says what is wrong with them
    if first.d != equation.d:
        refuse("y0", f"hold {equation.d} components, as the equation has", f"{first.d} in a row")
    rearranged = equation.system.frame.paired or equation.system.frame.speeds
    if rearranged or equation._initial.stated_d is not None:
        rows = [first, *(equation.replace(y0=row) for row in values[1:])]
        return np.array([row.y0 for row in rows])
    inside = values.reshape(-1, *first.y0.shape)
    idle = ~equation.system.above_one
    if equation.m == 2 and np.any(inside[:, 1, idle]):
        m = int(np.argmax(np.any(inside[:, 1, idle] != 0, axis=1)))
        required = "hold no y'(0) for components whose highest order is at most 1"
        refuse(f"y0[{m}]", required, shown(values[m]), "set it to 0")
    return inside


class _Run:
    """Members of which some are solved: their rows, and how each ended."""

    def __init__(
        self, members: Any, times: np.ndarray, t_end: float, kept: Any, steps: Any,
        arguments: dict, changes: list[Mapping],
    ) -> None:  # fmt: skip
        # kept (n,): numbers of those of `steps`, `UniformSteps`, whose rows are kept; both None by
        # a tolerance. arguments: those of `solve`, and changes: those of each member.
        self._members, self._times, self._t_end = members, times, t_end
        self._kept, self._steps, self._changes, self._arguments = kept, steps, changes, arguments
        size, frame = members.size, members.base.system.frame
        every = frame.values(members.base.y0[0])
        self._chosen = slice(None) if arguments["components"] is None else arguments["components"]
        width, n_events = every[self._chosen].size, len(arguments["events"])
        none = [np.empty(0)] * n_events, [np.empty((0, every.size), every.dtype)] * n_events
        self._events = [none] * size
        numbers = width * (2 if frame.paired else 1)
        _, y, ydot = room_for(size * times.size, numbers, arguments["n_steps"] is not None)
        shape = size, times.size, width
        self._y, self._ydot = (
            (part.view(complex) if frame.paired else part).reshape(shape) for part in (y, ydot)
        )
        self._y[:], self._ydot[:] = np.nan, np.nan
        self._ends = [(Status.INTERRUPTED, Status.INTERRUPTED.sentence, 0, 0)] * size
        self._left, self._done = iter(range(size)), 0
        self._interruption = Interruption()
        self._refused: set[int] = set()
        self._refusal: Exception | None = None  # of the first member
        self._plan: Any = None
        self._no_bar = ProgressBar(False)

    def march(self, threads: int | None, progress: bool) -> None:
        """March all members, on several threads, until Ctrl-C."""
        interruption, bar, left = self._interruption, ProgressBar(progress), self._members.size
        try:
            with interruption, ThreadPoolExecutor(threads or cores()) as pool:
                work = self.worker()
                work(1, bar)  # compiles what is needed
                helpers = [self.worker() for _ in range(min(threads or cores(), left) - 1)]
                if threads is None and helpers:
                    alone, together = (
                        self._timed(partial(work, _TIMED_MEMBERS, bar), pool, also)
                        for also in ([], helpers)
                    )
                    worth = together < _WORTH_THREADS * alone * (1 + len(helpers))
                    helpers = helpers if worth else []
                others = [pool.submit(helper) for helper in helpers]
                try:
                    work(None, bar)
                except BaseException:
                    interruption.asked = True  # by a second Ctrl-C
                    raise
                for other in others:
                    other.result()
                interruption.heeded |= next(self._left, None) is not None
        finally:
            bar.close()

    def _timed(self, work: Callable, pool: ThreadPoolExecutor, helpers: list[Callable]) -> float:
        """Return the seconds in which this thread and helpers solve `_TIMED_MEMBERS` each."""
        began = time.perf_counter()
        others = [pool.submit(helper, _TIMED_MEMBERS) for helper in helpers]
        work()
        for other in others:
            other.result()
        return time.perf_counter() - began

    def march_in_processes(self, workers: int, progress: bool) -> None:
        """March all members, in processes that are copies of this one, until Ctrl-C."""
        interruption, bar = self._interruption, ProgressBar(progress)
        size = self._members.size
        n_each = -(-size // (_PARTS * workers))
        pool = ProcessPoolExecutor(
            workers, multiprocessing.get_context("fork"), initializer=_adopt, initargs=(self,)
        )
        try:
            with interruption, pool:
                self.worker()(1, bar)  # compiles what is needed, before the process is copied
                parts = [range(m, min(m + n_each, size)) for m in range(1, size, n_each)]
                waiting = {pool.submit(_solved_part, part) for part in parts}
                while waiting:
                    ready, waiting = wait(waiting, _ENSEMBLE_POLL_SECONDS, FIRST_COMPLETED)
                    for future in ready:
                        if not future.cancelled():
                            self._take(*future.result())
                            bar.update(self._done / size)
                    if interruption.asked:
                        interruption.heeded = True
                        for future in waiting:
                            future.cancel()
        finally:
            bar.close()

    def solved_part(self, work: Callable, members: range) -> tuple[range, list, set[int]]:
        """Solve these members by `work` in a copy of the process; return what `_take` takes."""
        self._left, self._refused = iter(members), set()
        work()
        results = self._y, self._ydot, self._ends, self._events
        return members, [part[members.start : members.stop] for part in results], self._refused

    def _take(self, members: range, results: list, refused: set[int]) -> None:
        """Store the results of members that a copy of the process has solved."""
        own = slice(members.start, members.stop)
        self._y[own], self._ydot[own], self._ends[own], self._events[own] = results
        self._refused |= refused
        self._done += len(members)

    def worker(self) -> Callable:
        """Return a function that solves remaining members: `most` of them, or all."""
        base, one, given = self._members.base, self._solve, self._arguments
        # a function in Python reads the parameters of its own equation, so each member needs a
        # separate stepper
        alone = base.system.callbacks or base.system.delays
        if self._kept is not None and not (
            alone or given["events"] or given["switches"] or any(self._changes)
        ):
            end = self._steps.n
            stepper = open_members(
                base.system, given["scheme"], given["history"], self._steps,
                self._members.params, self._members.inside, self._plan,
            )  # fmt: skip
            self._plan = stepper.plan
            breaks = checked_breaks(given["breaks"], base.t_start)
            stepper.set_breaks(breaks, self._t_end - base.t_start)

            def one(m: int) -> None:
                self._march(stepper, end, m)

        one = self._by_tolerance() or one

        def work(most: int | None = None, bar: Any = None) -> None:
            for m in islice(self._left, most):
                one(m)
                self._done += 1
                if bar is not None:
                    bar.update(self._done / self._members.size)
                if self._interruption.asked:
                    return

        return work

    def _by_tolerance(self) -> Callable | None:
        """Return a function that marches a member in compiled code, or None."""
        given, base, members = self._arguments, self._members.base, self._members
        frame, (_, order, d) = base.system.frame, members.inside.shape
        others = given["events"], given["switches"], any(self._changes), np.size(given["breaks"])
        own = base.system.callbacks, base.system.delays, frame.speeds
        if self._kept is not None or any(others) or any(own) or d > FEW:
            return None
        first = displaced(base.system, members.inside[0], members.params[0])
        how = given["scheme"], given["history"], self._steps, self._t_end - base.t_start
        try:
            stepper, _ = open_stepper(first, *how)
        except ValueError:  # `solve` tells of it
            return None
        sizes = {"p": members.params.shape[1], "m": order, "d": d, "d_s": d * (order - 1)}
        run = zeros(MemberRun, n_t=self._times.size, **sizes)
        run = run._replace(times=self._times - base.t_start)
        loop, asked = stepper.members(run), lambda: self._interruption.asked

        def one(m: int) -> None:
            ended = LEFT
            run.params[:], run.y0[:] = members.params[m], members.inside[m]
            with suppress(Exception):  # of a right-hand side: `solve` tells of it
                ended = loop.march(asked)
            if ended == LEFT:
                self._solve(m)
            elif ended == AT_END:
                self._y[m] = frame.values(run.y)[:, self._chosen]
                if base.m == 2:
                    self._ydot[m] = frame.slopes(run.y, run.ydot)[:, self._chosen]
                self._ends[m] = Status.COMPLETED, "", *run.counts[:2].tolist()
            else:
                self._interruption.heeded = True

        return one if loop else None

    def _march(self, stepper: Any, end: float, m: int) -> None:
        """March member m to step `end`, by a stepper that several members use."""
        kept, frame = self._kept, self._members.base.system.frame

        def advance(stop: float) -> None:
            n, piece = stepper.position, stepper.advance(stop)
            if piece is not None:
                first, last = np.searchsorted(kept, [n + (n > 0), stepper.position + 1])
                chosen = kept[first:last] - n
                y, slopes = piece.rows[chosen], piece.slopes[chosen]
                self._y[m, first:last] = frame.values(y)[:, self._chosen]
                self._ydot[m, first:last] = frame.slopes(y, slopes)[:, self._chosen]

        try:
            stepper.begin(m)
        except Exception:  # of a right-hand side: `solve` tells of it
            return self._solve(m)
        ended = Drive(stepper, end, advance, self._interruption, self._no_bar).to(end)
        if stepper.position <= 1 and stepper.failure:
            return self._solve(m)  # which tells what is wrong at the start
        ended, message = ended or Ending(reached_end(stepper.diagnostics)), ""
        if ended.status is not Status.COMPLETED:
            with silence():
                message = report(stepper, ended, stepper.diagnostics)
        counts = stepper.stats()
        self._ends[m] = (ended.status, message, counts["n_steps"], counts["n_rhs"])

    def _solve(self, m: int) -> None:
        """Solve member m by `solve`."""
        found: Any
        self._y[m], self._ydot[m] = np.nan, np.nan
        try:
            with silence(), no_estimates():
                equation = self._members.equation(m)
                arguments = self._arguments | {"changes": self._changes[m], "estimate": False}
                found = solve(equation, self._t_end, t_eval=self._times, **arguments)
        except Exception as error:
            found = getattr(error, "result", None)
            if found is None:
                self._refused.add(m)
                self._refusal = error if m == 0 else self._refusal
                status = Status.RHS_FAILED
                message = f"{status.sentence}: {type(error).__name__}: {error}"
                self._ends[m] = (status, message, 0, 0)
                return
        n = len(found.y)
        self._y[m, :n] = found.y
        if found.ydot is not None:
            self._ydot[m, :n] = found.ydot
        self._events[m] = found.t_events, found.y_events
        self._ends[m] = (found.status, found.message, found.stats["n_steps"], found.stats["n_rhs"])
        if found.status is Status.INTERRUPTED:
            self._interruption.asked = self._interruption.heeded = True

    def close(self, seconds: float) -> Ensemble:
        """Return the `Ensemble`, and warn of members that did not complete."""
        if self._refusal and len(self._refused) == len(self._ends):
            raise self._refusal  # arguments that suit no member
        ends, messages, n_steps, n_rhs = zip(*self._ends, strict=True)
        failing = [m for m, end in enumerate(ends) if end is not Status.COMPLETED]
        asked = Status.INTERRUPTED, Status.EVENT
        unasked = [ends[m] for m in failing if ends[m] not in asked]
        if unasked:
            found = ", ".join(f"{n} {end}" for end, n in Counter(unasked).items())
            unstable = any(end in _UNSTABLE for end in unasked)
            warn(
                f"{len(unasked)} of {len(ends)} members did not complete: {found}; "
                "status and messages of the result give the reasons",
                StabilityWarning if unstable else SolveWarning,
            )
        base = self._members.base
        return Ensemble(
            t=self._times,
            y=self._y,
            ydot=self._ydot if base.m == 2 or base.system.frame.speeds else None,
            status=np.array([str(end) for end in ends]),
            messages={m: messages[m] for m in failing},
            stats={"n_steps": np.array(n_steps), "n_rhs": np.array(n_rhs), "seconds": seconds},
            t_events=[times for times, _ in self._events] if self._arguments["events"] else [],
            y_events=[rows for _, rows in self._events] if self._arguments["events"] else [],
            components=self._arguments["components"],
        )


def _adopt(run: _Run) -> None:
    """Let this process, a copy of another, solve members of a run."""
    global _copied
    _copied = run, run.worker()


def _solved_part(members: range) -> tuple[range, list, set[int]]:
    """Solve members of the run that this process has adopted."""
    run, work = _copied
    return run.solved_part(work, members)


# The run of which this process solves members, and what solves them; only in copies of a process.
_copied: tuple[_Run, Callable]
