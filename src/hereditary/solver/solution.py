"""The result of a run: its rows, how it ended, and the state to resume it."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..stepping.dense import Dense, curve
from ..stepping.state import State
from ..stepping.status import Status
from ..support.checks import one_of, refuse, shown
from ..support.html import paragraph, small_figure, table_html
from ..support.optional import optional
from ..support.warning import warn
from .saving import read_result, state_from, stored_state, take_arrays, write_result

if TYPE_CHECKING:
    from .accuracy import Accuracy, Provenance

_SAVED_SOLUTION = "be a solution that Solution.save wrote"
# Fields of a solution that `Solution.save` writes as arrays.
_ARRAYS = "t", "y", "ydot", "components"


@dataclass(frozen=True, eq=False)
class Solution:
    """A numerical solution: its rows, how the run ended, and what is needed to resume it.

    Attributes
    ----------
    t : ndarray, shape (n+1,)
        Times of the rows [time]. If an event changed y, its time occurs twice, for y before and
        after.
    y : ndarray, shape (n+1, d)
        Solution, a row for each time, with the argument `components` only these components.
    ydot : ndarray, shape (n+1, d), or None
        First derivative, if the highest order exceeds 1; NaN at t = 0 for components without an
        initial derivative.
    status : Status
        How the run ended, such as ``"completed"``. ``bool(sol)`` is ``sol.success``.
    message : str
        A sentence about how this run ended.
    stats : dict
        Counts and measurements of the run:

        - n_steps and n_rhs: steps and evaluations of the right-hand side, from t = 0 on.
        - n_factorised: Newton matrices that implicit steps factorised.
        - n_modes, history_bytes: number of modes, storage of the history.
        - setup_seconds, run_seconds: time before the first step, and of the steps.
        - kernel_error: the largest relative error of sums of exponentials for general kernels.
        - n_rejected: with `Collocation`, the steps that were repeated with a shorter length.
        - jumps: times at which the right-hand side jumps, as `Collocation` found them; those that
          `breaks=` or `switches=` name are not among them. With given steps, those that the run to
          1e-4 found.
        - slides: with `switches=`, the number of the switch, begin and end [time] of each slide.
        - error_estimate: with `Collocation`, ten times the largest estimated error of a step,
          relative to the size of y, and at least rtol / 10. It also contains what errors of the
          modes and rounding errors add up to if nothing damps them. With given steps, the largest
          difference of a row from a run of `Collocation` to 1e-4, relative to the size of its
          component (see `Accuracy`). It is the error of the run wherever it is above 2e-4
          (convergence/estimates.py); 1e-4 means at most 1e-4. It is None if it cannot be known.
        - error_unknown: if error_estimate is None, a clause that says why.
    left : State or callable
        The value of `state`, or a function that returns it.
    dense : Dense or None
        Dense output for ``sol(t)``; None if the run did not keep every step.
    t_events, y_events : list of ndarray
        For each event function the times (k,) of its zeros, and the solution (k, d) there.
    components : ndarray, shape (d,), or None
        Numbers of the components that the rows have, if the argument `components` chose some.
    accuracy : Accuracy or None
        Errors of all components over the run, from which error_estimate on given steps is.
    provenance : Provenance or None
        What was solved and how, for `check`; None if the solution comes from a file.
    """

    t: np.ndarray
    y: np.ndarray
    ydot: np.ndarray | None
    status: Status
    message: str
    stats: dict[str, Any] = field(repr=False)
    left: State | Callable | None = field(repr=False)
    dense: Dense | None = field(default=None, repr=False)
    t_events: list[np.ndarray] = field(default_factory=list, repr=False)
    y_events: list[np.ndarray] = field(default_factory=list, repr=False)
    components: np.ndarray | None = field(default=None, repr=False)
    accuracy: Accuracy | None = field(default=None, repr=False)
    provenance: Provenance | None = field(default=None, repr=False)
    # a right-hand side may read a solution: its contents never change, so its digest is kept
    fixed_contents: ClassVar[bool] = True

    @cached_property
    def state(self) -> State | None:
        """Everything that is needed to resume the run: ``solve(eq, t_later, resume=sol.state)``.

        It has a few kilobytes with `SumOfExponentials`, and the complete past with `Direct`. With
        ten or more components an implicit scheme adds 32 d**2 bytes. A file may have none, as
        `save` warns; ValueError then.
        """
        return self.left() if callable(self.left) else self.left

    def __getstate__(self) -> dict[str, Any]:
        left = self.left if self.left is _left_out else self.state
        return vars(self) | {"left": left, "provenance": None}

    @property
    def success(self) -> bool:
        """Whether the run reached its end or a terminal event, with stable steps."""
        return self.status in (Status.COMPLETED, Status.EVENT)

    @property
    def coarse(self) -> bool:
        """Whether steps are so long that curves need the dense output between rows."""
        return self.dense is not None and self.dense.coarse

    def __bool__(self) -> bool:
        return self.success

    def __call__(self, t: ArrayLike, derivative: int = 0) -> np.ndarray:
        """Return the solution at any time of the run, with the accuracy of its steps.

        Parameters
        ----------
        t : float or array_like, shape (k,)
            Times between the first and the last row.
        derivative : {0, 1}, optional
            1 for the first derivative. It is infinite at 0 if the solution starts like t**alpha
            with alpha below 1.

        Returns
        -------
        ndarray, shape (d,) or (k, d)

        Raises
        ------
        ValueError
            A time is outside the run, or the run kept only rows.
        """
        if self.dense is None:
            required = "be answered by rows: this run kept no dense output"
            remedy = "leave out t_eval, save_every and components, or pass t_eval; a file of "
            remedy += "Solution.save has rows only: pickle the solution to call it later"
            refuse("t", required, shown(t), remedy)
        derivative = one_of("derivative", derivative, (0, 1), "be 0 or 1")
        return self.dense(t, derivative, self.t[-1])

    def check(self, rtol: float | None = None) -> Accuracy:
        """Return the errors of this solution: its differences from an accurate run.

        Parameters
        ----------
        rtol : float, optional
            Tolerance of the accurate run, by `Collocation`. The default is 1e-6 for a run on given
            steps, and a hundredth of the tolerance of a run by `rtol`. The accurate run of the
            latter has another number of nodes as well.

        Returns
        -------
        Accuracy
            Errors up to the end of the run, or of the accurate run if that ends earlier.

        Raises
        ------
        ValueError
            The run was resumed, is a map, or comes from a file. Or `Collocation` refuses its
            equation.
        RuntimeError
            The accurate run ended before the first row after the start.

        Warns
        -----
        SolveWarning
            The accurate run ended early. The errors are those up to its end, and ``Accuracy.ended``
            says why it ended.

        Cost
        ----
        The accurate run. It calls all functions of the user again, also changes of y.

        Examples
        --------
        >>> import hereditary as hd
        >>> sol = hd.solve(hd.scenes.brusselator(), 20.0, 8000)
        >>> sol.check()
        component  largest   at t  at the end
                0  2.4e-02  14.05     6.1e-04
                1  2.4e-02  14.06     3.2e-04
        largest error 2.4e-02 of the size of component 0, at t = 14.05
        against 62 steps to rtol=1e-06
        """
        if self.provenance is None:
            required = "be one that `solve` returned in this process"
            refuse("solution", required, "one from a file, or a copy", "solve it again")
        return self.provenance.check(self, rtol)

    def _repr_html_(self) -> str:
        wanted = "n_steps", "n_rhs", "n_modes", "error_estimate", "run_seconds"
        names = [name for name in wanted if name in self.stats]
        about = paragraph(f"{self.status}: {self.message}")
        counts = table_html(names, [[self.stats[name] for name in names]])
        t, y = curve(self, slice(None))
        parts = (y.real, y.imag) if np.iscomplexobj(y) else (y,)
        return small_figure(t, np.hstack(parts)) + about + counts

    def to_pandas(self) -> Any:
        """Return the rows as a pandas DataFrame.

        Returns
        -------
        pandas.DataFrame
            Indexed by t, with columns "y[0]", "y[1]", ... and, if there is y', "ydot[0]", ...
        """
        pandas = optional("pandas", "to_pandas")
        columns = labelled_columns(self.components, y=self.y, ydot=self.ydot)
        return pandas.DataFrame(columns, index=pandas.Index(self.t, name="t"))

    def to_xarray(self) -> Any:
        """Return the rows as an xarray Dataset.

        Returns
        -------
        xarray.Dataset
            Variables y and, if there is y', ydot over "t" and "component". Status, message and
            single numbers of the stats are attributes.
        """
        xarray = optional("xarray", "to_xarray")
        values = {"y": self.y, "ydot": self.ydot}
        dims = ["t", "component"]
        variables = {name: (dims, rows) for name, rows in values.items() if rows is not None}
        stats = {k: v for k, v in self.stats.items() if np.isscalar(v)}
        attributes = {"status": str(self.status), "message": self.message} | stats
        coordinates = {"t": self.t, "component": numbered(self.components, self.y)}
        return xarray.Dataset(variables, coords=coordinates, attrs=attributes)

    def save(self, path: str | os.PathLike) -> None:
        """Write rows, events, status, stats and the state to a compressed .npz file, named `path`.

        The file has no dense output: pickle the solution to call it later.

        Parameters
        ----------
        path : path-like

        Warns
        -----
        UserWarning
            A scheme or a history of the user has attributes other than numbers and arrays. The file
            has no state then.
        """
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        for k, (times, rows) in enumerate(zip(self.t_events, self.y_events, strict=True)):
            arrays |= {f"t_events_{k}": times, f"y_events_{k}": rows}
        text: dict[str, Any] = {"status": str(self.status), "message": self.message}
        text["stats"] = {name: _plain(value) for name, value in self.stats.items()}
        if self.left is not _left_out and self.state is not None:
            of_state: dict[str, Any] = {}
            try:
                text["state"] = stored_state(self.state, of_state)
                arrays |= of_state
            except TypeError as error:
                warn(f"the file has no state: {error}; pickle the state instead", UserWarning)
        write_result(path, arrays, text)

    @classmethod
    def load(cls, path: str | os.PathLike) -> Solution:
        """Read a solution that `save` wrote. No code of the file is run.

        Parameters
        ----------
        path : path-like

        Returns
        -------
        Solution
            Without dense output.

        Examples
        --------
        >>> import os, tempfile
        >>> import hereditary as hd
        >>> equation = hd.scenes.relaxation(0.5)
        >>> sol = hd.solve(equation, 1.0, rtol=1e-6)
        >>> path = os.path.join(tempfile.mkdtemp(), "relaxation.npz")
        >>> sol.save(path)
        >>> loaded = hd.Solution.load(path)
        >>> bool((loaded.y == sol.y).all())
        True

        Later the run goes on:

        >>> hd.solve(equation, 2.0, resume=loaded.state)(2.0).round(4)
        array([0.3362])
        """
        return read_result(path, _SAVED_SOLUTION, cls._from_file)

    @classmethod
    def _from_file(cls, arrays: dict[str, np.ndarray], text: dict[str, Any]) -> Solution:
        """Return a solution from the arrays and the plain values, `text`, of a file."""
        n_events = sum(name.startswith("t_events_") for name in arrays)
        events = {
            name: [arrays.pop(f"{name}_{k}") for k in range(n_events)]
            for name in ("t_events", "y_events")
        }
        of_state, state = take_arrays(arrays), text.get("state")
        statuses = {str(status): status for status in Status}
        values = {"status": statuses[text["status"]], "message": text["message"], "ydot": None}
        state_or_refusal = partial(state_from, state, of_state) if state else _left_out
        values |= {"left": state_or_refusal, "stats": text["stats"]}
        if not {"t", "y"} <= arrays.keys() <= {field.name for field in fields(cls)}:
            raise KeyError("t, y")
        return cls(**(values | arrays | events))

    def __repr__(self) -> str:
        rows = f"{self.t.size} rows of {self.y.shape[1]} components"
        times = f", t = {self.t[0]:g} .. {self.t[-1]:g}" if self.t.size else ""
        return f"Solution({self.message}; {rows}{times})"


def numbered(components: np.ndarray | None, rows: np.ndarray) -> np.ndarray:
    """Return the numbers (d,) of the components that rows (..., d) have, `components` or all."""
    return np.arange(rows.shape[-1]) if components is None else components


def labelled_columns(
    components: np.ndarray | None, **tables: np.ndarray | None
) -> dict[str, np.ndarray]:
    """Return the columns of tables (n, d) that are not None, labelled "y[0]", "y[1]", ..."""
    return {
        f"{name}[{c}]": column
        for name, rows in tables.items()
        if rows is not None
        for c, column in zip(numbered(components, rows), rows.T, strict=True)
    }


def _left_out() -> None:
    """Refuse to return the state of a solution whose file has none."""
    required, remedy = "have a state to resume", "pickle the state of the run itself"
    refuse("solution", required, "one from a file without", remedy)


def _plain(value: Any) -> Any:
    """Return a NumPy number as a Python number; other values unchanged."""
    return value.item() if isinstance(value, np.generic) else value
