"""Orders, coefficients and initial values from data, by least squares."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..equation.equation import Equation
from ..solver.solution import Solution
from ..solver.solve import solve
from ..support.checks import complaint, real_array, shown
from ..support.warning import warn
from .series import Series, series_of

# Relative change of parameters in differences: runs to a tolerance of 1e-8 leave 1e-4 in them.
_CHANGE = 1e-4
# Ratio of singular values below which data do not tell a combination of parameters, and share of a
# parameter in such a combination from which it has no error.
_UNTOLD, _SHARE = 1e-4, 0.01


class IdentifiabilityWarning(UserWarning):
    """Data do not tell all parameters: some combination of them leaves residuals as they are."""


@dataclass(frozen=True, eq=False)
class FitResult:
    """Parameters that fit data best, and how well they are known.

    Attributes
    ----------
    parameters, standard_errors : dict
        By name, m of them; errors by the linear theory of least squares, NaN at a bound and where
        data do not tell the parameter.
    covariance, correlation : ndarray, shape (m, m)
        In the order of `parameters`; NaN where an error is.
    residuals : list of ndarray, shape (n, k)
        Model minus data of each series, in units of the data; NaN where data are missing.
    cost : float
        Half the sum of squares of residuals over sigma.
    singular_values : ndarray
        Of the derivatives of residuals by parameters that are at no bound, columns of length 1: 0
        for a combination that data do not tell.
    solutions : list of Solution
        Of each series, with the best parameters.
    success : bool
    message : str
    n_runs : int
        Sets of runs, one run for each series.
    series : list of Series
        Times, data and their standard deviations, as fitted.
    curves : list of (ndarray, ndarray)
        Times (m,) and values (m, k) of the best model for each series, also between the data.
    """

    parameters: dict[str, float]
    standard_errors: dict[str, float]
    covariance: np.ndarray = field(repr=False)
    correlation: np.ndarray = field(repr=False)
    residuals: list[np.ndarray] = field(repr=False)
    cost: float
    singular_values: np.ndarray = field(repr=False)
    solutions: list[Solution] = field(repr=False)
    success: bool
    message: str
    n_runs: int
    series: list[Series] = field(repr=False)
    curves: list[tuple[np.ndarray, np.ndarray]] = field(repr=False)

    def __repr__(self):
        told = (
            f"{name} = {value:.6g} +- {self.standard_errors[name]:.2g}"
            for name, value in self.parameters.items()
        )
        return f"FitResult({', '.join(told)}; cost {self.cost:.4g}; {self.message})"


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
    **how: Any,
) -> FitResult:
    """Fit the parameters of an equation with memory to data, by least squares.

    `scipy.optimize.least_squares` minimises the residuals' squares over sigma; derivatives are
    differences over relative changes of 1e-4, and serve until parameters move by half of that. Any
    number may be a parameter: orders, rates, initial values, coefficients of an order that varies.

    Parameters
    ----------
    model : callable
        ``model(**parameters)``, or ``model(p)`` where p0 has no names, returns an `Equation`, or a
        list with one for each series. What changes belongs into the equation's `params`, orders and
        y0: a right-hand side that closes over a parameter is compiled anew for each value. Where an
        order may cross 1, state y0 with ``d=``.
    t : array_like, shape (n,), or list of such
        Increasing times of the data [time]; a list of several series.
    data : array_like, shape (n,) or (n, k), or list of such
        NaN, or a masked entry, for a missing value.
    p0 : mapping of str to float, or sequence of float
        First guess; names are "p0", "p1", ... where a sequence is given.
    bounds : mapping of str to (float, float), optional
        Lowest and highest values of some of the parameters.
    sigma : float, array_like or list of such, optional
        Standard deviations of the data, one for all or of their shape. By default all are equal,
        and estimated from the residuals.
    observe : callable or sequence of int, optional
        ``observe(y)`` of rows (n, d) returns what is measured, (n,) or (n, k); or the components
        that are. By default the first k of them.
    loss : str, optional
        As in `scipy.optimize.least_squares`: "soft_l1" or "huber" for outliers, beyond one sigma.
    **how
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
        Data do not tell a parameter, or some combination of them: what they change is below 1e-4 of
        what others do, which is what differences leave of nothing.

    Error
    -----
    Standard errors are those of a model that is linear near its best parameters, with independent
    normal errors of the data (convergence/fits.py: true values lie within two of them in 95 per
    cent of seeded trials). A minimum may be a local one: try other first guesses. These also say
    how large parameters are: 0 is taken for a size of 1, but 1e-12 for what it is.

    Cost
    ----
    m + 1 runs an iteration, some eight iterations: 0.1 to 0.2 s for four parameters and 60 data.

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
    names, start = _start(p0)
    low, high = _bounds(bounds, names, start)
    series = series_of(t, data, sigma)
    if loss != "linear" and series[0].sigma is None:
        remedy = "it tells outliers from data"
        raise ValueError(complaint("sigma", f"be given with loss={loss!r}", "none", remedy))
    if sum(one.size for one in series) < start.size:
        required = f"hold at least {start.size} values, one for each parameter"
        raise ValueError(complaint("data", required, sum(one.size for one in series)))
    runs = _Runs(model, names, isinstance(p0, Mapping), series, observe, how)
    scale = np.where(start != 0, np.abs(start), 1.0)
    differences = _Differences(runs.residuals, scale, low, high)
    least_squares = importlib.import_module("scipy.optimize").least_squares  # whose import is long
    limits = {"bounds": (low, high), "x_scale": scale, "loss": loss}
    found = least_squares(differences.value, start, differences.jacobian, **limits)
    best = runs.at(found.x)
    at_bound = found.active_mask != 0
    scale = np.maximum(np.abs(found.x), scale)
    estimated = series[0].sigma is None
    covariance, singular = _covariance(found, scale, at_bound, estimated, names)
    completed = all(sol.success for sol in best)
    errors = np.sqrt(np.diag(covariance)) if completed else np.full(start.size, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / np.outer(errors, errors)
    message = found.message
    if at_bound.any():
        held = ", ".join(name for name, held in zip(names, at_bound, strict=True) if held)
        message += f" At a bound: {held}."
    return FitResult(
        parameters=dict(zip(names, found.x.tolist(), strict=True)),
        standard_errors=dict(zip(names, errors.tolist(), strict=True)),
        covariance=covariance,
        correlation=correlation,
        residuals=[one.lacking(sol, observe) for sol, one in zip(best, series, strict=True)],
        cost=float(found.cost) * runs.unit**2,
        singular_values=singular,
        solutions=best,
        success=bool(found.success) and completed,
        message=message,
        n_runs=runs.count,
        series=series,
        curves=runs.curves(found.x, best),
    )


class _Best(NamedTuple):
    """Parameters p (m,) with the least squares of residuals so far, and their solutions."""

    squares: float
    p: np.ndarray | None
    solutions: list


class _Runs:
    """Runs of a model for sets of parameters, and their residuals.

    Attributes
    ----------
    unit : float
        Size of the data where their deviations are not given, which residuals are divided by:
        what the optimiser stops at is absolute.
    count : int
        Sets of runs so far.
    best : _Best
        Of these the one with the least squares.
    """

    def __init__(self, model, names, named, series, observe, how):
        self._model, self._names, self._named = model, names, named
        self._series, self._observe, self.count = series, observe, 0
        self.best = _Best(np.inf, None, [])
        largest = max(one.largest for one in series)
        self.unit = (largest or 1.0) if series[0].sigma is None else 1.0
        if "t_eval" in how:
            raise TypeError(complaint("t_eval", "be left out, for t says it", "some"))
        if not {"n_steps", "mesh", "rtol"} & how.keys():
            how = {"rtol": 1e-8} | how
        self._how = {"estimate": False} | how

    def solutions(self, p, series):
        """Return solutions with these parameters, one for each series."""
        self.count += 1
        values = p.tolist()
        named = dict(zip(self._names, values, strict=True))
        try:
            made = self._model(**named) if self._named else self._model(p.copy())
        except ValueError as error:
            if self.count == 1:  # at p0
                raise
            at = ", ".join(f"{name} = {value:.6g}" for name, value in named.items())
            remedy = "keep parameters in range by bounds={name: (lowest, highest)}"
            raise ValueError(f"{error}, from model at {at}; {remedy}") from error
        pairs = zip(_equations(made, len(series)), series, strict=True)
        return [_solved(*pair, self._how) for pair in pairs]

    def residuals(self, p):
        """Return all residuals over their deviations, (n,); large ones where runs ended early."""
        solutions = self.solutions(p, self._series)
        pairs = zip(solutions, self._series, strict=True)
        found = [one.weighed(one.lacking(sol, self._observe)) for sol, one in pairs]
        residuals = np.concatenate(found) / self.unit
        squares = float(residuals @ residuals)
        if squares < self.best.squares:
            self.best = _Best(squares, p.copy(), solutions)
        return residuals

    def at(self, p):
        """Return solutions with these parameters, those of the best set where it is theirs."""
        same = self.best.p is not None and np.array_equal(self.best.p, p)
        return self.best.solutions if same else self.solutions(p, self._series)

    def curves(self, p, best):
        """Return times and values of the model for each series."""
        fine = self.solutions(p, [one._replace(t=one.finer_times()) for one in self._series])
        runs = zip(self._series, best, fine, strict=True)
        return [one.curve(*pair, self._observe) for one, *pair in runs]


class _Differences:
    """Derivatives of residuals by differences, which serve the points close by too.

    A point is close where every parameter has moved by less than half of the change that the
    differences are over: what these leave out is more than the derivatives change by.

    Parameters
    ----------
    residuals : callable
        Of parameters (m,).
    scale, low, high : ndarray, shape (m,)
        Sizes of parameters that are 0, and lowest and highest values.
    """

    def __init__(self, residuals, scale, low, high):
        self._residuals, self._scale, self._low, self._high = residuals, scale, low, high
        self._at, self._found = np.full(scale.size, np.nan), np.zeros((0, scale.size))
        self._last = self._at, np.zeros(0)

    def value(self, p):
        """Return the residuals, kept for the derivatives that are asked for next."""
        self._last = p.copy(), self._residuals(p)
        return self._last[1]

    def jacobian(self, p):
        """Return the derivatives of the residuals, (n, m)."""
        changes = _CHANGE * np.where(p != 0, p, self._scale)
        if np.all(np.abs(p - self._at) <= 0.5 * np.abs(changes)):
            return self._found
        at, value = self._last
        value = value if np.array_equal(at, p) else self._residuals(p)
        columns = []
        for k, change in enumerate(changes):
            moved, sides = p.copy(), np.array([p[k] + change, p[k] - change])
            sides = np.clip(sides, self._low[k], self._high[k])
            moved[k] = sides[np.argmax(np.abs(sides - p[k]))]
            columns.append((self._residuals(moved) - value) / (moved[k] - p[k]))
        self._at, self._found = p.copy(), np.array(columns).T
        return self._found


def _start(p0):
    """Return names and first values of the parameters."""
    required = "be a mapping of names to numbers, or a flat sequence of numbers"
    values = list(p0.values()) if isinstance(p0, Mapping) else p0
    start = real_array("p0", values, required)
    if start.ndim != 1 or start.size == 0:
        raise ValueError(complaint("p0", required, f"shape {start.shape}"))
    names = list(p0) if isinstance(p0, Mapping) else [f"p{k}" for k in range(start.size)]
    return names, start


def _bounds(bounds, names, start):
    """Return lowest and highest values of all parameters."""
    low, high = np.full(start.size, -np.inf), np.full(start.size, np.inf)
    bounds = {} if bounds is None else bounds
    if not isinstance(bounds, Mapping):
        required = "be a mapping of names to (lowest, highest)"
        raise TypeError(complaint("bounds", required, repr(bounds)))
    for name, pair in bounds.items():
        if name not in names:
            required = f"name parameters, {', '.join(names)}"
            raise ValueError(complaint("bounds", required, repr(name)))
        k, limits = names.index(name), np.asarray(pair, dtype=float).ravel()
        if limits.size != 2 or not limits[0] < limits[1] or not limits[0] <= start[k] <= limits[1]:
            required = f"hold a lower value, a higher one, and p0 = {start[k]:g} between them"
            raise ValueError(complaint(f"bounds[{name!r}]", required, shown(pair)))
        low[k], high[k] = limits
    return low, high


def _equations(made, n):
    """Return equations as a list, one for each series."""
    several = isinstance(made, (list, tuple))
    equations = list(made) if several else [made]
    if len(equations) != n or not all(isinstance(one, Equation) for one in equations):
        required = f"return an Equation, or a list with one for each of {n} series"
        raise TypeError(complaint("model", required, repr(made)))
    return equations


def _solved(equation, one, how):
    """Solve the equation of a series up to its last time."""
    t_end = float(one.t[-1])
    if t_end <= equation.t_start or one.t[0] < equation.t_start:
        required = f"begin at t_start = {equation.t_start:g} or later"
        raise ValueError(complaint("t", required, shown(one.t)))
    return solve(equation, t_end, t_eval=one.t, **how)


def _covariance(found, scale, at_bound, estimated, names):
    """Return the covariance of parameters, and singular values for changes by their scale.

    NaN where a parameter is at a bound, or part of a combination that leaves residuals as they are;
    warns of these.
    """
    free = np.flatnonzero(~at_bound)
    jacobian = found.jac[:, free] * scale[free]
    sizes = np.linalg.norm(jacobian, axis=0)
    dead = sizes <= _UNTOLD * sizes.max(initial=0.0)
    sizes[dead] = 1.0
    _, singular, rows = np.linalg.svd(np.where(dead, 0.0, jacobian) / sizes, full_matrices=False)
    told = singular > _UNTOLD * singular.max(initial=0.0)
    shares = np.linalg.norm(rows[~told], axis=0)
    untold = shares > _SHARE
    if untold.any():
        parts = " and ".join(names[k] for k in free[untold])
        warn(f"data do not tell {parts}: fix one of them, or measure more", IdentifiabilityWarning)
    inverse = np.where(told, 1 / np.where(told, singular, 1.0), 0.0)
    half = (rows.T * inverse) * (scale[free] / sizes)[:, None]
    spread = half @ half.T
    if estimated:
        freedom = found.jac.shape[0] - free.size
        spread *= 2 * found.cost / freedom if freedom > 0 else np.nan
    spread[untold] = spread[:, untold] = np.nan
    covariance = np.full((scale.size, scale.size), np.nan)
    covariance[np.ix_(free, free)] = spread
    return covariance, singular
