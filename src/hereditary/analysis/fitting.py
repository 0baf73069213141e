"""Orders, coefficients and initial values from data, by least squares."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..equation.equation import Equation
from ..solver.accuracy import no_estimates
from ..solver.opening import chooses_steps
from ..solver.progress import ProgressBar
from ..solver.solution import Solution
from ..solver.solve import chosen_scheme, solve
from ..stepping.scheme import Scheme
from ..support.checks import (
    callable_with,
    complaint,
    component_numbers,
    function,
    mapping,
    one_of,
    real_array,
    refuse,
    shown,
)
from ..support.covariance import Estimates, covariance_of, estimates_of
from ..support.warning import silence
from .sensitivity import obstacle, sensitivities

# Relative change of parameters in difference quotients. Runs to a tolerance of 1e-8 leave errors of
# 1e-4 in the quotients.
_PARAMETER_CHANGE = 1e-4
# A residual that is not a number counts as ten times the largest one, or as this multiple of the
# largest datum.
_RESIDUAL_IF_NOT_FINITE = 1e2
# Fewest parameters for which tangents are solved instead of differences: one run with tangents
# takes about twice the time of a plain run.
_ENOUGH = 2
# Arguments of a fit that `sensitivities` accepts as well.
_OF_TANGENTS = {"rtol", "atol", "scheme", "history", "breaks", "max_step", "estimate"}
# The losses of SciPy's least_squares.
_LOSSES = "linear", "soft_l1", "huber", "cauchy", "arctan"
# Fewest points of the curve of a fitted model: about the pixels of a figure's width.
_MIN_POINTS_OF_FIT_CURVE = 1000


class Series(NamedTuple):
    """Data at increasing times, and their standard deviations."""

    t: np.ndarray  # (n,)
    data: np.ndarray  # (n, k), NaN for missing or masked values
    sigma: np.ndarray | None  # (n, k)


@dataclass(frozen=True, eq=False, repr=False)
class FitResult(Estimates):
    """Parameters that fit data best; it has the attributes of `Estimates`, and these.

    Attributes
    ----------
    residuals : list of ndarray, shape (n, k)
        Model minus data of each series, in units of the data; NaN where data are missing.
    singular_values : ndarray
        Of the derivatives of residuals by parameters that are at no bound, columns of length 1. It
        is 0 for a combination that the data do not determine.
    solutions : list of Solution
        Of each series, with the best parameters.
    n_runs : int
        Sets of runs, one run for each series; a run with sensitivities counts once.
    series : list of Series
        Times, data and their standard deviations, as fitted.
    curves : list of (ndarray, ndarray)
        Times (m,) and values (m, k) of the best model for each series, also between the data.
    """

    residuals: list[np.ndarray]
    singular_values: np.ndarray
    solutions: list[Solution]
    n_runs: int
    series: list[Series]
    curves: list[tuple[np.ndarray, np.ndarray]]


def fit(
    model: Callable[..., Equation | Sequence[Equation]],
    t: ArrayLike | Sequence[ArrayLike],
    data: ArrayLike | Sequence[ArrayLike],
    p0: Mapping[str, float] | Sequence[float],
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    sigma: Any = None,
    observe: Callable | ArrayLike | None = None,
    loss: str = "linear",
    progress: bool = False,
    **options: Any,
) -> FitResult:
    """Fit the parameters of an equation with memory to data, by least squares.

    `scipy.optimize.least_squares` minimises the squares of the residuals over sigma. Its
    derivatives are differences over relative changes of 1e-4. With a tolerance, two or more
    parameters that only move the equation's `params` and `y0` share a run of `sensitivities`. Each
    other one takes a run. Any number may be a parameter: orders, rates, initial values,
    coefficients of an order that varies.

    Parameters
    ----------
    model : callable
        ``model(**parameters)``, or ``model(p)`` if p0 has no names, returns an `Equation`, or a
        list with one for each series. Put what changes into the equation's `params`, orders and y0:
        a right-hand side that closes over a parameter is compiled again for each value. If an order
        may cross 1, state y0 with ``d=``.
    t : array_like, shape (n,), or list of such
        Increasing times of the data [time]; a list of several series.
    data : array_like, shape (n,) or (n, k), or list of such
        NaN, or a masked entry, for a missing value.
    p0 : mapping of str to float, or sequence of float
        First guess; the names of a sequence are "p0", "p1", ...
    bounds : mapping of str to (float, float), optional
        Lowest and highest values of some of the parameters.
    sigma : float, array_like or list of such, optional
        Standard deviations of the data, one for all or of their shape, NaN if data are missing
        there. By default all are equal, and estimated from the residuals.
    observe : callable or sequence of int, optional
        ``observe(y)`` of rows (n, d) returns the measured values, (n,) or (n, k); or the numbers of
        the measured components. By default the first k components.
    loss : str, optional
        As in `scipy.optimize.least_squares`: "soft_l1" or "huber" for outliers, beyond one sigma.
    progress : bool, optional
        Show the number of runs and the cost so far, on a terminal only.
    **options
        As in `solve`, by default ``rtol=1e-8``.

    Returns
    -------
    FitResult

    Raises
    ------
    TypeError, ValueError
        An argument is not as required, or the model does not return equations.

    Warns
    -----
    IdentifiabilityWarning
        The data do not determine a parameter, or a combination of parameters. Its effect is below
        1e-4 of the effect of others, which is the error of the differences.

    Error
    -----
    Standard errors are those of a model that is linear near its best parameters, with independent
    normal errors of the data. True values are within two of them in 94 per cent of seeded trials
    (convergence/fits.py). A minimum may be a local one: try other first guesses. A first guess is
    also the size of its parameter; for a guess of 0 the size is 1.

    Cost
    ----
    m + 1 runs an iteration at most, about eight iterations: 0.1 to 0.3 s for four parameters and 60
    data.

    Examples
    --------
    >>> import numpy as np
    >>> import hereditary as hd
    >>> def decay(t, y, p):
    ...     return -p[0] * y
    >>> def model(alpha, rate):
    ...     return hd.Equation(hd.Caputo(alpha), decay, 1.0, params=[rate])
    >>> t = np.linspace(0.1, 5.0, 40)
    >>> data = hd.exact.relaxation(0.7, 1.5)(t)[:, 0]
    >>> found = hd.fit(model, t, data, {"alpha": 0.9, "rate": 1.0}, bounds={"alpha": (0.1, 1.0)})
    >>> {name: round(value, 5) for name, value in found.parameters.items()}
    {'alpha': 0.7, 'rate': 1.5}
    """
    from scipy.optimize import least_squares

    function("model", model, "model(**parameters)")
    if not callable(loss):
        one_of("loss", loss, _LOSSES, f"be one of {', '.join(_LOSSES)}")
    names = list(p0) if isinstance(p0, Mapping) else [f"p{k}" for k in range(np.size(p0))]
    start = real_array("p0", list(p0.values()) if isinstance(p0, Mapping) else p0)
    if start.ndim != 1 or start.size == 0:
        refuse("p0", "be a mapping of names to numbers, or a flat sequence of numbers", repr(p0))
    called = _Model(model, names, isinstance(p0, Mapping))
    called.check(start)
    low, high = _bounds({} if bounds is None else bounds, names, start)
    series = _series(t, data, sigma)
    estimated = series[0].sigma is None
    if loss != "linear" and estimated:
        refuse("sigma", f"be given with loss={loss!r}", repr(sigma), "it tells outliers from data")
    size = sum(int(np.isfinite(one.data).sum()) for one in series)
    if size < start.size:
        refuse("data", f"hold at least {start.size} values, one for each parameter", size)
    runs = _Runs(called, series, observe, _RunOptions(options), ProgressBar(progress))
    # parameters are scaled to size 1 for SciPy: its differences are relative, its tolerances at
    # bounds absolute
    shift = np.where(start == 0, 1.0, 0.0)
    scale = np.abs(start) + shift

    def unscaled(x: np.ndarray) -> np.ndarray:
        return np.clip(scale * x - shift, low, high)

    limits = (low + shift) / scale, (high + shift) / scale

    def derivatives(x: np.ndarray) -> np.ndarray:
        moved = _moved(x, *limits)
        by = np.diagonal(moved) - x
        return runs.differences(unscaled(x), [unscaled(each) for each in moved]).T / by

    try:
        optimum = least_squares(
            lambda x: runs.residuals(unscaled(x)), (start + shift) / scale, jac=derivatives,
            bounds=limits, loss=loss,
        )  # fmt: skip
    finally:
        runs.bar.close()
    best, at_bound = unscaled(optimum.x), optimum.active_mask != 0
    equations = runs.equations(best)
    solutions = runs.solutions(equations)
    completed = all(sol.success for sol in solutions)
    sizes = np.maximum(np.abs(best) / scale, 1.0)
    covariance, singular = covariance_of(optimum, sizes, at_bound, estimated, completed and names)
    covariance *= np.outer(scale, scale) if completed else np.nan
    ends = (f"the run with these parameters failed: {sol.message}" for sol in solutions)
    failed = next((end for end, sol in zip(ends, solutions, strict=True) if not sol.success), "")
    return FitResult(
        **estimates_of(names, best, covariance, at_bound, failed or optimum.message),
        freedom=float(size - np.sum(~at_bound)) if estimated else np.inf,
        residuals=runs.misfits([sol.y for sol in solutions]),
        cost=float(optimum.cost) * runs.unit**2,
        singular_values=singular,
        solutions=solutions,
        success=bool(optimum.success) and completed,
        n_runs=runs.count,
        series=series,
        curves=runs.curves(equations, solutions),
    )


@dataclass(frozen=True)
class _Model:
    """The function that makes equations from parameters; `named` says if it takes them by name."""

    function: Callable[..., Any]
    names: list[str]
    named: bool

    def __call__(self, p: np.ndarray) -> Any:
        """Return what the function makes of parameters p (n,)."""
        return self.function(**self.at(p)) if self.named else self.function(p.copy())

    def check(self, p: np.ndarray) -> None:
        """Refuse parameters p (n,) with which each call would fail."""
        required, got = "name the arguments of model", f"names {', '.join(self.names)}"
        if self.named:
            callable_with(self.function, required, "p0", got, **self.at(p))
        else:
            required = "be a mapping of names, unless one sequence is the argument of model"
            callable_with(self.function, required, "p0", shown(p), p)

    def at(self, p: np.ndarray) -> dict[str, float]:
        """Return the parameters by their names."""
        return dict(zip(self.names, p.tolist(), strict=True))


@dataclass(frozen=True)
class _RunOptions:
    """Arguments of `solve` for the runs of a fit: the user's, which are checked, and defaults."""

    arguments: dict[str, Any]

    def __post_init__(self) -> None:
        if "t_eval" in self.arguments:
            got = shown(self.arguments["t_eval"])
            refuse("t_eval", "be left out, for t says it", got, kind=TypeError)
        for name in self.arguments.keys() & {"params", "resume"}:
            required = "be left out, for model makes the equation of each run"
            refuse(name, required, shown(self.arguments[name]), kind=TypeError)

    @cached_property
    def of_solve(self) -> dict[str, Any]:
        """Arguments of `solve`."""
        default = {} if {"n_steps", "mesh", "rtol"} & self.arguments.keys() else {"rtol": 1e-8}
        return {"estimate": False} | default | self.arguments

    @cached_property
    def scheme(self) -> Scheme:
        """The scheme of the runs."""
        names = "scheme", "rtol", "n_steps", "mesh", "resume"
        return chosen_scheme(*map(self.of_solve.get, names))

    @property
    def has_tangents(self) -> bool:
        """Whether `sensitivities` accepts these arguments."""
        return chooses_steps(self.scheme) and self.of_solve.keys() <= _OF_TANGENTS


class _Runs:
    """Runs of a model for sets of parameters, and their residuals, in units of the data."""

    def __init__(
        self, model: _Model, series: list[Series], observe: Callable | ArrayLike | None,
        options: _RunOptions, bar: ProgressBar,
    ) -> None:  # fmt: skip
        # unit: size of data without deviations, because the optimiser stops at absolute values;
        # count: number of sets of runs, which `bar` shows with the cost
        self.bar, self._model, self._options = bar, model, options
        self._series, self._observe, self.count = series, observe, 0
        largest = [float(np.nanmax(np.abs(one.data))) for one in series]
        self._far = [_RESIDUAL_IF_NOT_FINITE * (size or 1.0) for size in largest]
        self.unit = (max(largest) or 1.0) if series[0].sigma is None else 1.0

    def equations(self, p: np.ndarray) -> list[Equation]:
        """Return the equations of the model with these parameters, one for each series."""
        try:
            made = self._model(p)
        except ValueError as error:
            if self.count == 0:  # at p0
                raise
            at = ", ".join(f"{name} = {value:.6g}" for name, value in self._model.at(p).items())
            remedy = "keep parameters in range by bounds={name: (lowest, highest)}"
            raise ValueError(f"{error}, from model at {at}; {remedy}") from error
        equations = list(made) if isinstance(made, (list, tuple)) else [made]
        n = len(self._series)
        if len(equations) != n or not all(isinstance(each, Equation) for each in equations):
            required = f"return an Equation, or a list with one for each of {n} series"
            refuse("model", required, repr(made), kind=TypeError)
        return equations

    def solutions(
        self, equations: list[Equation], times: list[np.ndarray] | None = None
    ) -> list[Solution]:
        """Return solutions of these equations, one a series, at times (n,) or those of its data."""
        self.count += 1
        times = [one.t for one in self._series] if times is None else times
        for equation, t in zip(equations, times, strict=True):
            if t[-1] <= equation.t_start or t[0] < equation.t_start:
                refuse("t", f"begin at t_start = {equation.t_start:g} or later", shown(t))
        pairs, options = zip(equations, times, strict=True), self._options.of_solve
        with no_estimates():
            return [solve(equation, float(t[-1]), t_eval=t, **options) for equation, t in pairs]

    def misfits(self, rows: list[np.ndarray]) -> list[np.ndarray]:
        """Return model minus data (n, k), by rows (m, d): NaN without data, inf after the end."""
        misfits = []
        for one, y in zip(self._series, rows, strict=True):
            observed = self._observed(y, one.data.shape[1])
            misfits.append(np.full(one.data.shape, np.inf))
            misfits[-1][: len(observed)] = observed - one.data[: len(observed)]
            misfits[-1][np.isnan(one.data)] = np.nan
        return misfits

    def residuals(self, p: np.ndarray) -> np.ndarray:
        """Return all residuals over their deviations, (n,)."""
        equations = self.equations(p)
        rows = [sol.y for sol in self.solutions(equations)]
        self._last = p, equations, rows
        residuals = self._weighed(rows)
        self.bar.count(
            f"{self.count} sets of runs, cost {residuals @ residuals / 2 * self.unit**2:.4g}"
        )
        return residuals

    def differences(self, p: np.ndarray, moved: list[np.ndarray]) -> np.ndarray:
        """Return the changes of `residuals` from p to each of these sets of parameters, (m, n)."""
        before = self._weighed(self._last[2])
        if not np.array_equal(self._last[0], p):
            before = self.residuals(p)
        _, equations, rows = self._last
        others = [self.equations(each) for each in moved]
        linear = self._linearised(equations, others, rows)
        return np.array([
            self._weighed(linear[k] if k in linear else [sol.y for sol in self.solutions(each)])
            - before
            for k, each in enumerate(others)
        ])  # fmt: skip

    def _linearised(
        self, equations: list[Equation], others: list[list[Equation]], rows: list[np.ndarray]
    ) -> dict[int, list[np.ndarray]]:
        """Return the rows of those equations, among `others`, that one run with tangents gives."""
        # it needs a tolerance, and two or more sets that differ in params and y0 alone
        linear = {k: by for k, each in enumerate(others) if (by := _changes(equations, each))}
        complete = all(len(y) == one.t.size for y, one in zip(rows, self._series, strict=True))
        possible = complete and self._options.has_tangents
        possible = possible and not any(obstacle(each, self._options.scheme) for each in equations)
        if len(linear) < _ENOUGH or not possible:
            return {}
        self.count += 1
        options = {k: value for k, value in self._options.of_solve.items() if k != "estimate"}
        runs = []
        for k, (equation, one) in enumerate(zip(equations, self._series, strict=True)):
            kinds = sorted({kind for changes in linear.values() for kind in changes[k]}) or "y0"
            with silence():
                run = sensitivities(equation, float(one.t[-1]), t_eval=one.t, wrt=kinds, **options)
            runs.append(run)
        if not all(each.success for each in runs):
            return {}
        return {
            k: [
                y + sum(getattr(each, f"by_{kind}") @ by for kind, by in change.items())
                for y, each, change in zip(rows, runs, changes, strict=True)
            ]
            for k, changes in linear.items()
        }

    def _weighed(self, rows: list[np.ndarray]) -> np.ndarray:
        """Return the residuals of rows over their deviations, (n,)."""
        # rows after the end of a run count as far from the data: other parameters are preferred
        misfits = self.misfits(rows)
        for k, (one, far) in enumerate(zip(self._series, self._far, strict=True)):
            finite = np.isfinite(misfits[k])
            far = 10 * max(far, np.abs(misfits[k][finite]).max(initial=0.0))
            weighed = np.where(finite, misfits[k], far) / (1.0 if one.sigma is None else one.sigma)
            misfits[k] = weighed[np.isfinite(one.data)]
        return np.concatenate(misfits) / self.unit

    def curves(
        self, equations: list[Equation], solutions: list[Solution]
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return times (m,) and values (m, k) of the model for each series, also between data."""
        # only times of the data if `observe` needs these, as differences of rows do
        curves, often = [], self.solutions(equations, [_between(one.t) for one in self._series])
        for one, sol, fine in zip(self._series, solutions, often, strict=True):
            k, slack = one.data.shape[1], 1e-6 * np.nanmax(np.abs(one.data))
            curves.append((sol.t, self._observed(sol.y, k)))
            with suppress(ValueError):  # of shapes
                values = self._observed(fine.y, k)
                again = values[np.isin(fine.t, sol.t)]
                if np.allclose(again, curves[-1][1], rtol=0, atol=slack):
                    curves[-1] = fine.t, values
        return curves

    def _observed(self, y: np.ndarray, k: int) -> np.ndarray:
        """Return the observed values of rows (m, d), (m, k)."""
        if callable(self._observe):
            values = np.asarray(self._observe(y))
        elif self._observe is None:
            values = y[:, :k]
        else:
            values = y[:, component_numbers(self._observe, y.shape[1], "observe")]
        if (
            values.shape[:1] != (len(y),)
            or values.size != len(y) * k
            or values.dtype.kind not in "iuf"
        ):
            shape = f"({len(y)}{f', {k}' if k > 1 else ','})"
            got = f"shape {values.shape} of {values.dtype} from y of shape {y.shape}"
            refuse("observe", f"give real values of shape {shape}, as data has", got)
        return values.reshape(len(y), k)


def _moved(x: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return sets of parameters, (m, m): set k has parameter k changed a little, inside bounds."""
    by = _PARAMETER_CHANGE * np.where(x == 0.0, 1.0, x)
    above, below = high - x, x - low
    outside = (x + by > high) | (x + by < low)
    by = np.where(outside, -by, by)
    narrow = np.abs(by) > np.maximum(above, below)
    by = np.where(narrow, np.where(above >= below, above, -below), by)
    return x + np.diag(by)


def _changes(equations: list[Equation], others: list[Equation]) -> list[dict[str, np.ndarray]]:
    """Return how equations differ in "params" and "y0"; no list if they differ in anything else."""
    changes = []
    for one, other in zip(equations, others, strict=True):
        before, after = one.system, other.system
        if not (
            [operator for operator, _ in before.left] == [operator for operator, _ in after.left]
            and np.array_equal([c for _, c in before.left], [c for _, c in after.left])
            and np.array_equal(before.sources, after.sources)
            and before.functions.code == after.functions.code
            and (before.frame, before.y0.shape) == (after.frame, after.y0.shape)
            and before.params.size == after.params.size
            and before.matrix is None is after.matrix
        ):
            return []
        moved = (after.y0 - before.y0)[:, : before.n_solved]
        y0 = np.concatenate([moved[0], *moved[1:, before.above_one]])
        parts = {"params": after.params - before.params, "y0": y0}
        changes.append({kind: by for kind, by in parts.items() if by.any()})
    return changes


def _between(t: np.ndarray) -> np.ndarray:
    """Return the times of data, and many equidistant times from each to the next."""
    return np.union1d(
        t, np.interp(np.linspace(0, t.size - 1, _MIN_POINTS_OF_FIT_CURVE), np.arange(t.size), t)
    )


def _bounds(
    bounds: Mapping[str, tuple[float, float]], names: list[str], start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return lowest and highest values of all parameters."""
    low, high = np.full(start.size, -np.inf), np.full(start.size, np.inf)
    mapping("bounds", bounds, "be a mapping of names to (lowest, highest)")
    for name, pair in bounds.items():
        if name not in names:
            refuse("bounds", f"name parameters, {', '.join(names)}", repr(name))
        k, limits = names.index(name), np.asarray(pair, dtype=float).ravel()
        if limits.size != 2 or not limits[0] < limits[1] or not limits[0] <= start[k] <= limits[1]:
            required = f"hold a lower value, a higher one, and p0 = {start[k]:g} between them"
            refuse(f"bounds[{name!r}]", required, shown(pair))
        low[k], high[k] = limits
    return low, high


def _series(t: Any, data: Any, sigma: Any) -> list[Series]:
    """Return series of data, checked; t and data are arrays, or lists of one for each series."""
    if not (isinstance(t, (list, tuple)) and len(t) > 0 and np.ndim(t[0]) > 0):
        return [_one("", t, data, sigma)]
    n, sigmas = len(t), sigma if isinstance(sigma, (list, tuple)) else [sigma] * len(t)
    for name, values in (("data", data), ("sigma", sigmas)):
        if not isinstance(values, (list, tuple)) or len(values) != n:
            refuse(name, f"be a list of {n} series, as t is", shown(values))
    missing = [k for k in range(n) if sigmas[k] is None]
    if 0 < len(missing) < n:
        got = f"None for the series {shown(missing)}"
        refuse("sigma", "be given for all series or for none", got)
    return [_one(f"[{k}]", *arrays) for k, arrays in enumerate(zip(t, data, sigmas, strict=True))]


def _one(place: str, t: ArrayLike, data: Any, sigma: Any) -> Series:
    """Return one series; `place` is its number in a list."""
    t = real_array(f"t{place}", t)
    if t.ndim != 1 or t.size == 0 or np.any(np.diff(t) <= 0):
        refuse(f"t{place}", "be increasing times (n,)", shown(t))
    if np.iscomplexobj(np.asarray(data)):
        remedy = "give real and imaginary part as two values, and observe them"
        refuse(f"data{place}", "be real", shown(data), remedy, kind=TypeError)
    try:
        values: np.ndarray = np.ma.array(data, dtype=float, copy=True).filled(np.nan)
    except (TypeError, ValueError, OverflowError) as error:
        required = "be real numbers, NaN for missing ones"
        raise TypeError(complaint(f"data{place}", required, reprlib.repr(data))) from error
    if values.ndim not in (1, 2) or len(values) != t.size:
        required = f"have shape ({t.size},) or ({t.size}, k), NaN for missing values"
        refuse(f"data{place}", required, f"shape {values.shape}")
    if np.any(np.isinf(values)) or not np.any(np.isfinite(values)):
        refuse(f"data{place}", "be finite, or NaN", shown(values))
    if np.shape(sigma) == values.shape and not np.ma.is_masked(sigma):
        sigma = np.where(np.isnan(values), 1.0, sigma)
    values = values.reshape(t.size, -1)
    if sigma is None:
        return Series(t, values, None)
    spread = real_array(f"sigma{place}", sigma)
    spread = spread[:, None] if spread.shape == t.shape else spread
    if np.any(spread <= 0):
        refuse(f"sigma{place}", "be above 0", shown(spread))
    try:
        return Series(t, values, np.broadcast_to(spread, values.shape))
    except ValueError as error:
        required = "be one number, or have the shape of data"
        raise ValueError(complaint(f"sigma{place}", required, f"shape {spread.shape}")) from error
