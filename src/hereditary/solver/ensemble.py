"""Ensembles: one equation with many parameters or initial values."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._checks import complaint, count, instance, whole
from .._machine import cores
from .._warning import silence, warn
from ..equation import Equation
from ..history.exponentials import SumOfExponentials
from ..history.history import History
from ..meshes import UniformSteps
from ..schemes.scheme import Scheme
from .lanes import Lane
from .members import members_of
from .opening import uniform_steps
from .output import room_for
from .progress import Interruption, ProgressBar
from .solution import SolveWarning, StabilityWarning
from .solve import chosen_scheme, evaluation_times, run_end, solve
from .status import Status
from .stops import kept_steps

# Seconds that members marched at once are to take.
_SECONDS = 0.05
_UNSTABLE = (Status.STEP_TOO_LARGE, Status.ZIGZAG)


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Solutions of the members of an ensemble, at the same times.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times of the rows [time].
    y : ndarray, shape (E, n, d)
        Solutions, a member for each entry of the first axis; NaN from where a run ended early.
    ydot : ndarray, shape (E, n, d), or None
        First derivatives when the highest order exceeds 1.
    status : ndarray of str, shape (E,)
        How each run ended, as `Solution.status` has it.
    messages : dict
        Sentences of those members, by their numbers, that did not complete.
    stats : dict
        n_steps and n_rhs, (E,) each, and seconds in all.
    """

    t: np.ndarray
    y: np.ndarray
    ydot: np.ndarray | None
    status: np.ndarray
    messages: dict[int, str] = field(repr=False)
    stats: dict[str, Any] = field(repr=False)

    @property
    def success(self) -> np.ndarray:
        """Whether each run completed, inside the scheme's stability limit; shape (E,)."""
        return self.status == Status.COMPLETED.value

    def __len__(self) -> int:
        return len(self.y)

    def __repr__(self):
        done = f"{int(self.success.sum())} of {len(self)} completed"
        return f"Ensemble({done}; {self.t.size} rows of {self.y.shape[2]} components)"


def ensemble(
    equation: Equation,
    t_end: float,
    n_steps: int | None = None,
    *,
    params: ArrayLike | None = None,
    y0: ArrayLike | None = None,
    rtol: float | None = None,
    atol: float | None = None,
    scheme: Scheme | None = None,
    history: History | None = None,
    save_every: int = 1,
    t_eval: ArrayLike | None = None,
    threads: int | None = None,
    progress: bool = False,
) -> Ensemble:
    """Solve one equation for many parameters or initial values, on all cores.

    Every member gets the solution that `solve` gives it, at times of uniform steps to the last bit
    (with BDF(3) to BDF(6) to rounding).
    With these all weights, modes and stability limits are worked out once, and members are marched
    one after the other in compiled code. For equations that differ otherwise, in their orders above
    all, take `sweep`.

    Parameters
    ----------
    equation : Equation
    t_end : float
        End of the runs [time].
    n_steps : int, optional
        Number of steps; or `rtol`.
    params : array_like, shape (E, p), optional
        Parameters of each member; shape (E,) where the equation has one.
    y0 : array_like, shape (E, ...), optional
        Initial values of each member, each row as `Equation` takes it.
    rtol, atol, scheme, history
        As in `solve`.
    save_every : int, optional
        Keep every so many-th step, besides the first and the last row.
    t_eval : array_like, shape (n,), optional
        Keep these times instead. With n_steps they must be times of steps. With rtol, whose steps
        differ from member to member, the start and the end are kept where none are given.
    threads : int, optional
        By default as many as there are cores; one where a function is called in Python.
    progress : bool, optional
        Show a progress bar, on a terminal only.

    Returns
    -------
    Ensemble
        Also when runs end early: each member has its status. After Ctrl-C, which is heeded between
        members, those that are left have the status "interrupted".

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
    With uniform steps that of the steps alone: 0.1 to 0.5 microseconds each for one component
    (convergence/ensembles.py). With rtol, FFT or orders that vary that of `solve` for each member.

    Examples
    --------
    >>> import numpy as np
    >>> import hereditary as hd
    >>> eq = hd.Equation(hd.Caputo(0.6), lambda t, y, p: -p[0] * y, 1.0, params=[1.0])
    >>> found = hd.ensemble(eq, 2.0, 200, params=np.linspace(0.5, 2.0, 100))
    >>> found.y.shape, bool(found.success.all())
    ((100, 201, 1), True)
    """
    equation = instance(
        "equation", equation, Equation, "hereditary.Equation(terms, rhs, y0)"
    ).current()
    members = members_of(equation, params, y0)
    start = equation.frame.start
    t_last = run_end("t_end", t_end, start)
    scheme = chosen_scheme(scheme, rtol, n_steps, None, None)
    save_every = count("save_every", whole(save_every))
    times = evaluation_times(t_eval, start, t_last)
    threads = cores() if threads is None else count("threads", threads)
    began = time.perf_counter()
    how = {"scheme": scheme, "history": history, "rtol": rtol, "atol": atol, "n_steps": n_steps}
    kept = None
    if rtol is None and not scheme.adaptive:
        if atol is not None:
            raise ValueError(complaint("atol", "come with rtol", atol))
        h, n_steps, _ = uniform_steps(equation, t_last - start, n_steps, None)
        kept = _kept(n_steps, save_every, times, h, start)
        times = start + h * kept
        times[-1] = t_last if kept[-1] == n_steps else times[-1]
    elif save_every > 1:
        required = "be left out with rtol, whose steps differ from member to member"
        raise ValueError(complaint("save_every", required, save_every, "give t_eval"))
    elif times is None:
        times = np.array([start, t_last])
    run = _Run(equation, members, times, t_last, how)
    # functions that are called in Python hold the parameters of their equation
    if kept is not None and not equation._callbacks:
        run.take_lanes(h, kept)
    run.march(1 if equation._callbacks else threads, progress)
    return run.close(time.perf_counter() - began)


def _kept(n_steps, save_every, times, h, start):
    """Return the numbers of the steps whose rows are kept, the start being 0."""
    if times is None:
        return np.append(np.arange(0, n_steps, min(save_every, n_steps)), n_steps)
    if save_every > 1:
        required = "be left out where t_eval says which rows to keep"
        raise ValueError(complaint("save_every", required, save_every))
    return kept_steps(times, h, start)


class _Run:
    """Members under way: rows of those that are done, and how each ended."""

    def __init__(self, equation, members, times, t_end, how):
        self._equation, self._members, self._times = equation, members, times
        self._t_end, self._how = t_end, how
        size, frame = members.size, equation.frame
        width = frame.values(equation.y0[0]).size
        numbers = width * (2 if frame.paired else 1)
        _, y, ydot = room_for(size * times.size, numbers, how["n_steps"] is not None)
        shape = size, times.size, width
        self._y, self._ydot = (
            (part.view(complex) if frame.paired else part).reshape(shape) for part in (y, ydot)
        )
        self._y[:], self._ydot[:] = np.nan, np.nan
        self._ends = [(Status.INTERRUPTED, "", 0, 0)] * size
        self._next, self._lock, self._stopped = 0, threading.Lock(), False
        self._open: Callable = lambda: self._solve
        self._refused: dict[int, Exception] = {}

    def take_lanes(self, h, kept):
        """Let compiled code march the members, where one of its marches gets to the end."""
        equation, members, how = self._equation, self._members, self._how
        history = SumOfExponentials() if how["history"] is None else how["history"]
        instance("history", history, History, "hereditary.SumOfExponentials()")
        n_steps = round((self._t_end - equation.frame.start) / h)

        def opened():
            return Lane(equation, how["scheme"], history, UniformSteps(h), n_steps)

        first = opened()
        if not first.whole(n_steps):
            return
        try:
            starts = first.starts(members.params, members.inside)
        except Exception:  # of a right-hand side, for some member: `solve` tells of which
            return
        lanes = [first]

        def open_lane():
            lane = lanes.pop() if lanes else opened()
            lane.whole(n_steps)

            def march(part):
                some, frame = starts.of(part), equation.frame
                rows, slopes = lane.rows(some, kept)
                self._ends[part] = lane.run(some, n_steps, kept, rows, slopes)
                self._y[part] = frame.values(rows)
                self._ydot[part] = frame.slopes(rows, slopes)
                for m in range(part.start, part.stop):
                    end, _, n, _ = self._ends[m]
                    if n <= 1 < n_steps and end is not Status.COMPLETED:
                        self._solve(slice(m, m + 1))  # which tells what is wrong at the start

            return march

        self._open = open_lane

    def _solve(self, part):
        """Solve some members one by one."""
        for m in range(part.start, part.stop):
            found: Any
            self._y[m], self._ydot[m] = np.nan, np.nan
            try:
                with silence():
                    equation = self._members.equation(m, self._equation)
                    found = solve(equation, self._t_end, t_eval=self._times, **self._how)
            except Exception as error:
                found = getattr(error, "result", None)
                if found is None:
                    self._refused[m] = error
                    self._ends[m] = (Status.RHS_FAILED, f"{type(error).__name__}: {error}", 0, 0)
                    continue
            n = len(found.y)
            self._y[m, :n] = found.y
            if found.ydot is not None:
                self._ydot[m, :n] = found.ydot
            counts = found.stats["n_steps"], found.stats["n_rhs"]
            self._ends[m] = (found.status, found.message, *counts)
            self._stopped |= found.status is Status.INTERRUPTED

    def march(self, threads, progress):
        """March all members, on several threads, until Ctrl-C."""
        bar = ProgressBar(progress)
        try:
            with Interruption() as interruption:
                work = self._open()
                self._work(work, interruption, bar, most=1)  # compiles what is needed
                n_others = min(threads - 1, self._members.size - 1)
                others = [self._open() for _ in range(n_others)]
                with ThreadPoolExecutor(max(1, n_others)) as pool:
                    futures = [pool.submit(self._work, one, interruption) for one in others]
                    try:
                        self._work(work, interruption, bar)
                    finally:
                        self._stopped = True
                for future in futures:
                    future.result()
                interruption.heeded = self._next < self._members.size
        finally:
            bar.close()

    def _work(self, work, interruption, bar=None, most=None):
        """March members that are left, as many at once as take a moment."""
        n = 1
        while not (interruption.asked or self._stopped):
            with self._lock:
                part = slice(self._next, min(self._next + n, self._members.size))
                self._next = part.stop
            if part.start == part.stop:
                return
            began = time.perf_counter()
            work(part)
            if bar is not None:
                bar.update(self._next / self._members.size)
            if most is not None:
                return
            seconds = (time.perf_counter() - began) / n
            n = int(np.clip(_SECONDS / max(seconds, 1e-9), 1, 4 * n))

    def close(self, seconds):
        """Return the `Ensemble`, and warn of members that did not complete."""
        if len(self._refused) == len(self._ends):  # arguments that suit no member
            raise self._refused[0]
        status = np.array([str(end[0]) for end in self._ends])
        failing = [m for m, end in enumerate(self._ends) if end[0] is not Status.COMPLETED]
        messages = {}
        for m in failing:
            end, detail, *_ = self._ends[m]
            same = detail.startswith(end.sentence)
            messages[m] = detail if same or not detail else f"{end.sentence}: {detail}"
            messages[m] = messages[m] or end.sentence
        unasked = [self._ends[m][0] for m in failing]
        unasked = [end for end in unasked if end is not Status.INTERRUPTED]
        if unasked:
            told = ", ".join(f"{n} {end}" for end, n in Counter(unasked).items())
            unstable = any(end in _UNSTABLE for end in unasked)
            warn(
                f"{len(unasked)} of {self._members.size} members did not complete: {told}; "
                "the result's status and messages say which and why",
                StabilityWarning if unstable else SolveWarning,
            )
        sloped = self._equation.m == 2 or self._equation.frame.speeds
        counts = np.array([end[2:] for end in self._ends])
        stats = {"n_steps": counts[:, 0], "n_rhs": counts[:, 1], "seconds": seconds}
        ydot = self._ydot if sloped else None
        return Ensemble(self._times, self._y, ydot, status, messages, stats)
