"""Viscoelastic models of springs, dashpots and spring-pots, in series and in parallel.

A model has a stiffness Q(s): with Laplace transforms, stress = Q(s) strain for a body at rest
before t = 0. Parallel models add Q, models in series add 1/Q. The responses of a model follow from
``Q(s)/s = viscosity + g(s)`` and ``1/Q(s) = compliance + c(s)``, where g and c vanish at infinity.
The transform of the relaxation modulus is g, that of the rate of creep is c.
"""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from .equation.equation import Equation
from .equation.operators import Caputo, Memory, Summand, Terms
from .kernels.laplace import BINADE_DEGREE, by_polynomials, inverted, kernel_from_laplace
from .kernels.memory_kernel import Prony
from .support import checks
from .support.covariance import Estimates, covariance_of, estimates_of

__all__ = [
    "Combined", "Model", "ModelFit", "ModuliFit", "SpringPot", "burgers", "dashpot", "fit_creep",
    "fit_moduli", "fit_relaxation", "kelvin_voigt", "maxwell", "parallel", "poynting_thomson",
    "series", "spring", "zener",
]  # fmt: skip


def __dir__() -> list[str]:
    return __all__


# Arrangement whose parts add g, and the one whose parts add c.
_ADDING_ARRANGEMENTS = "parallel", "series"


class Model:
    """A viscoelastic model; see `SpringPot`, `series` and `parallel`."""

    def _split(self, s: np.ndarray) -> tuple[tuple[float, np.ndarray], tuple[float, np.ndarray]]:
        """Return (viscosity, g) and (compliance, c) of the model at complex s."""
        raise NotImplementedError

    def _rest(self, half: int, s: np.ndarray) -> np.ndarray:
        """Return g or c, as `half` selects, at complex s."""
        return self._split(s)[half][1]

    def stiffness(self, s: ArrayLike) -> np.ndarray:
        """Return Q(s) at complex s off the negative real axis [stress]."""
        s = _complex_array("s", s)
        (viscosity, g), _ = self._split(s)
        return s * (viscosity + g)

    def moduli(self, omega: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return the storage and the loss modulus, real and imaginary part of ``Q(i omega)``.

        Parameters
        ----------
        omega : array_like
            Angular frequencies above 0 [1/time].

        Returns
        -------
        tuple of ndarray
            G' and G'' [stress].
        """
        modulus = self.stiffness(1j * _positive_array("omega", omega))
        return modulus.real, modulus.imag

    def relaxation(self, t: ArrayLike) -> np.ndarray:
        """Return the relaxation modulus G(t): the stress after a step of the strain by 1.

        At times t > 0 [time], with errors of 1e-14 of its mean from 0 to t. A viscosity adds an
        impulse at t = 0.
        """
        return inverted(partial(self._rest, 0), _positive_array("t", t))

    def creep(self, t: ArrayLike) -> np.ndarray:
        """Return the creep compliance J(t): the strain after a step of the stress by 1.

        At times t > 0 [time], with relative errors of 1e-14.
        """
        _, (compliance, _) = self._split(np.ones(1, dtype=complex))
        return compliance + inverted(lambda s: self._rest(1, s) / s, _positive_array("t", t))

    @cached_property
    def operator(self) -> Terms:
        """Operator from strain to stress, for equations: ``stress = operator strain``.

        The strain is 0 before t = 0. An oscillator on this body has the terms ``mass * Caputo(2) +
        model.operator``.
        """
        return self._terms(0)

    @cached_property
    def rate_operator(self) -> Terms:
        """Operator from stress to the rate of the strain."""
        return self._terms(1)

    def _summands(self, half: int) -> tuple[Model, ...]:
        """Return models whose g, or c, add up to that of this model."""
        return (self,)

    def _terms(self, half: int) -> Terms:
        """Return the terms of g or c: those of spring-pots, and one kernel for all other parts."""
        summands = self._summands(half)
        terms = [one._operator(half) for one in summands if isinstance(one, SpringPot)]
        others = tuple(one for one in summands if not isinstance(one, SpringPot))
        if others:
            both = Combined(_ADDING_ARRANGEMENTS[half], others)
            limit, rest = both._split(np.ones(1, dtype=complex))[half]
            if limit:
                terms.append(limit * Caputo(1))
            if np.any(rest):
                terms.append(Memory(kernel_from_laplace(partial(both._rest, half)), 1))
        return Terms([one for term in terms for one in term._terms()])

    def strain_equation(self, stress: Callable, params: ArrayLike = ()) -> Equation:
        """Make the equation of the strain under a given stress.

        Parameters
        ----------
        stress : callable
            ``stress(t, strain)`` or ``stress(t, strain, params)``, as right-hand sides are; it may
            begin with a step at t = 0.
        params : array_like, optional
            Parameters of `stress`.

        Returns
        -------
        Equation
            Of one component, the strain, 0 before t = 0. Solve it with ``rtol=``, and with
            ``breaks=`` at later steps.
        """
        return Equation(self.operator, stress, 0.0, params)

    def stress_equation(self, strain_rate: Callable, params: ArrayLike = ()) -> Equation:
        """Make the equation of the stress under a given rate of the strain.

        Parameters
        ----------
        strain_rate : callable
            ``strain_rate(t, stress)`` or ``strain_rate(t, stress, params)`` [1/time]. A step of
            the strain at t = 0 adds ``step * relaxation(t)`` to the solution.
        params : array_like, optional
            Parameters of `strain_rate`.

        Returns
        -------
        Equation
            Of one component, the stress, 0 before t = 0.
        """
        return Equation(self.rate_operator, strain_rate, 0.0, params)


@dataclass(frozen=True)
class SpringPot(Model):
    """Scott Blair's element: ``stress = modulus * D**order strain``.

    Parameters
    ----------
    modulus : float
        Above 0 [stress time**order].
    order : float
        0 (a spring) to 1 (a dashpot) [-].

    Examples
    --------
    >>> from hereditary.viscoelastic import SpringPot
    >>> storage, loss = SpringPot(2.0, 0.5).moduli(1.0)
    >>> round(float(storage), 6), round(float(loss), 6)
    (1.414214, 1.414214)
    """

    modulus: float
    order: float

    def __post_init__(self) -> None:
        checks.positive("modulus", self.modulus)
        checks.within("order", self.order, 0.0, 1.0, "[0, 1]", "in a fit, give it bounds")

    def _split(self, s: np.ndarray) -> tuple[tuple[float, np.ndarray], tuple[float, np.ndarray]]:
        one, nothing = float(self.modulus), np.zeros_like(s)
        if self.order == 0:
            return (0.0, one / s), (1 / one, nothing)
        if self.order == 1:
            return (one, nothing), (0.0, 1 / (one * s))
        stiffness = one * s**self.order
        return (0.0, stiffness / s), (0.0, 1 / stiffness)

    def _operator(self, half: int) -> Summand:
        """Return the operator from strain to stress, or from stress to the rate of strain."""
        order = 1 - self.order if half else self.order
        operator = Caputo(order) if order else Memory(Prony([0.0], [1.0]), 1)
        return operator / self.modulus if half else self.modulus * operator


@dataclass(frozen=True)
class Combined(Model):
    """Models in series or in parallel; made by `series` and `parallel`.

    Attributes
    ----------
    arrangement : str
        "series" or "parallel".
    parts : tuple of Model
    """

    arrangement: str
    parts: tuple[Model, ...]

    def __post_init__(self) -> None:
        for part in self.parts:
            checks.instance(
                "parts", part, Model, "hereditary.viscoelastic.SpringPot(modulus, order)"
            )
        if not self.parts:
            checks.refuse("parts", "hold at least one model", repr(self.parts))

    def _split(self, s: np.ndarray) -> tuple[tuple[float, np.ndarray], tuple[float, np.ndarray]]:
        # A = Q/s and B = 1/Q, or the reverse in series: then A B = 1/s, and parts add A
        halves = list(zip(*(part._split(s) for part in self.parts), strict=True))
        added, others = halves if self.arrangement == "parallel" else halves[::-1]
        limit, rest = sum(one for one, _ in added), sum(one for _, one in added)
        other, small = 0.0, 1 / (s * (limit + rest))
        if all(one for one, _ in others):
            # B - B(infinity) without cancellation
            other = 1 / sum(1 / one for one, _ in others)
            small = other * small * sum(one / (top * (top + one)) for top, one in others)
        pair = (limit, rest), (other, small)
        return pair if self.arrangement == "parallel" else pair[::-1]

    def _summands(self, half: int) -> tuple[Model, ...]:
        if self.arrangement != _ADDING_ARRANGEMENTS[half]:
            return (self,)
        return tuple(one for part in self.parts for one in part._summands(half))


def spring(modulus: float) -> SpringPot:
    """Make a spring, ``stress = modulus * strain``."""
    return SpringPot(modulus, 0.0)


def dashpot(viscosity: float) -> SpringPot:
    """Make a dashpot, ``stress = viscosity * strain'``."""
    return SpringPot(viscosity, 1.0)


def parallel(*parts: Model) -> Model:
    """Combine models that have the same strain."""
    return Combined("parallel", parts)


def series(*parts: Model) -> Model:
    """Combine models that have the same stress."""
    return Combined("series", parts)


def maxwell(first: Model, second: Model) -> Model:
    """Make Maxwell's model, two elements in series."""
    return series(first, second)


def kelvin_voigt(first: Model, second: Model) -> Model:
    """Make Kelvin and Voigt's model, two elements in parallel."""
    return parallel(first, second)


def zener(alone: Model, first: Model, second: Model) -> Model:
    """Make Zener's model: one element parallel to two in series.

    Examples
    --------
    A fractional solid, whose modulus goes from 5 to 1 like ``1 + 4 E_0.6(-t**0.6)``:

    >>> from hereditary.viscoelastic import SpringPot, spring, zener
    >>> solid = zener(spring(1.0), spring(4.0), SpringPot(4.0, 0.6))
    >>> solid.relaxation([1e-12, 1.0, 1e12]).round(6).tolist()
    [5.0, 2.653309, 1.0]
    """
    return parallel(alone, series(first, second))


def poynting_thomson(alone: Model, first: Model, second: Model) -> Model:
    """Make Poynting and Thomson's model: one element in series with two in parallel."""
    return series(alone, parallel(first, second))


def burgers(first: Model, second: Model, third: Model, fourth: Model) -> Model:
    """Make Burgers' model: Maxwell's in series with Kelvin and Voigt's of the last two."""
    return series(first, second, parallel(third, fourth))


@dataclass(frozen=True, eq=False, repr=False)
class ModelFit(Estimates):
    """Parameters of a model that fit moduli, relaxation or creep best; see `hereditary.Estimates`.

    Attributes
    ----------
    model : Model
        The model with these parameters.
    residuals : ndarray, shape (n,), or (2, n) for G' and G''
        ``log(model / data)``.
    """

    model: Model
    residuals: np.ndarray


# The name of a time when moduli alone were fitted.
ModuliFit = ModelFit


def fit_moduli(
    model: Callable[..., Model],
    omega: ArrayLike,
    storage: ArrayLike,
    loss: ArrayLike,
    p0: Mapping[str, float],
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> ModelFit:
    """Fit a model to storage and loss moduli by least squares of their logarithms.

    Parameters
    ----------
    model : callable
        ``model(**parameters)`` returns a model.
    omega, storage, loss : array_like, shape (n,)
        Angular frequencies [1/time], and G' and G'' there [stress], above 0.
    p0 : mapping of str to float
        First guess, above 0; of moduli it may be wrong by a factor of 1e6, as tests have it.
    bounds : mapping of str to (float, float), optional
        Lowest and highest values of some parameters, by default 0 and infinity. An order has at
        most (0, 1).

    Returns
    -------
    ModelFit
    """
    measured = {"storage": storage, "loss": loss}
    return _fitted(model, "omega", omega, measured, lambda made, w: made.moduli(w), p0, bounds)


def fit_relaxation(
    model: Callable[..., Model],
    t: ArrayLike,
    relaxation: ArrayLike,
    p0: Mapping[str, float],
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> ModelFit:
    """Fit a model to its relaxation modulus by least squares of the logarithm.

    Parameters
    ----------
    model : callable
        ``model(**parameters)`` returns a model.
    t, relaxation : array_like, shape (n,)
        Times after a step of the strain [time], and the stress over this step [stress], above 0.
    p0, bounds
        As in `fit_moduli`.

    Returns
    -------
    ModelFit

    Examples
    --------
    >>> from hereditary.viscoelastic import SpringPot, fit_relaxation
    >>> data = SpringPot(2.0, 0.4).relaxation([0.1, 1.0, 10.0])
    >>> found = fit_relaxation(SpringPot, [0.1, 1, 10], data, {"modulus": 1.0, "order": 0.5})
    >>> {name: round(value, 6) for name, value in found.parameters.items()}
    {'modulus': 2.0, 'order': 0.4}
    """
    measured = {"relaxation": relaxation}
    return _fitted(model, "t", t, measured, partial(_curve, "relaxation"), p0, bounds)


def fit_creep(
    model: Callable[..., Model],
    t: ArrayLike,
    creep: ArrayLike,
    p0: Mapping[str, float],
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> ModelFit:
    """Fit a model to its creep compliance by least squares of the logarithm.

    Parameters
    ----------
    model : callable
        ``model(**parameters)`` returns a model.
    t, creep : array_like, shape (n,)
        Times after a step of the stress [time], and the strain over this step [1/stress], above 0.
    p0, bounds
        As in `fit_moduli`.

    Returns
    -------
    ModelFit
    """
    measured = {"creep": creep}
    return _fitted(model, "t", t, measured, partial(_curve, "creep"), p0, bounds)


def _curve(response: str, made: Model, t: np.ndarray) -> list[np.ndarray]:
    """Return a response at times (n,), by polynomials if these need fewer inverse transforms."""
    values_at = getattr(made, response)
    few = BINADE_DEGREE * np.unique(np.frexp(t)[1]).size < t.size
    return [by_polynomials(values_at, t, {}) if few else values_at(t)]


def _fitted(
    model: Callable[..., Model], place: str, places: ArrayLike, measured: dict[str, ArrayLike],
    responses: Callable[[Model, np.ndarray], Sequence[np.ndarray]], p0: Mapping[str, float],
    bounds: Mapping[str, tuple[float, float]] | None,
) -> ModelFit:  # fmt: skip
    """Fit a model to its responses, k rows (n,), measured at frequencies or times (n,)."""
    from scipy.optimize import least_squares

    at = _positive_array(place, places)
    rows = [_positive_array(name, values) for name, values in measured.items()]
    names_of_rows = " and ".join(measured)
    for each in rows:
        if at.ndim != 1 or each.shape != at.shape:
            got = f"{each.shape} beside {at.shape} of {place}"
            checks.refuse(names_of_rows, f"have shape (n,) as {place}", got)
    data = np.array(rows)
    checks.function("model", model, "model(**parameters)")
    names = list(checks.mapping("p0", p0, "be a mapping of names to numbers"))
    start = _positive_array("p0", list(p0.values()))
    if not names:
        checks.refuse("p0", "hold a parameter at least", repr(p0))
    limits = _limits({} if bounds is None else bounds, names, start)

    def made(p: np.ndarray) -> Model:
        values = dict(zip(names, p.tolist(), strict=True))
        remedy = "a function that returns a Model"
        return checks.instance("what model returns", model(**values), Model, remedy)

    def residuals(p: np.ndarray) -> np.ndarray:
        with np.errstate(divide="ignore"):
            return np.log(np.array(responses(made(p), at)) / data).ravel()

    first = residuals(start)
    if not np.all(np.isfinite(first)):
        got, remedy = f"0 from {made(start)!r}", "add an element that responds"
        checks.refuse("model", f"have {names_of_rows} above 0", got, remedy)

    def at_logs(logs: np.ndarray) -> np.ndarray:  # of parameters over their first guesses
        return np.clip(start * np.exp(logs), *limits)

    with np.errstate(divide="ignore"):
        ends = tuple(np.log(limits / start))
    fit = least_squares(lambda logs: residuals(at_logs(logs)), 0.0 * start, bounds=ends)
    fit.x = at_logs(fit.x)
    fit.jac /= fit.x
    at_bound = fit.active_mask != 0
    covariance, _ = covariance_of(fit, fit.x, at_bound, True, names)
    return ModelFit(
        **estimates_of(names, fit.x, covariance, at_bound, fit.message),
        freedom=float(data.size - np.sum(~at_bound)),
        cost=float(fit.cost),
        success=bool(fit.success),
        model=made(fit.x),
        residuals=fit.fun.reshape(data.shape if len(data) > 1 else -1),
    )


def _limits(
    bounds: Mapping[str, tuple[float, float]], names: list[str], start: np.ndarray
) -> np.ndarray:
    """Return lowest and highest values of all parameters, (2, n), with `start` between them."""
    required = "be a mapping of names to (lowest, highest)"
    if set(checks.mapping("bounds", bounds, required)) - set(names):
        checks.refuse("bounds", f"be of {', '.join(names)}", repr(bounds))
    limits = np.tile([[0.0], [np.inf]], len(names))
    for name, pair in bounds.items():
        ends = np.asarray(pair)
        if ends.shape != (2,) or ends.dtype.kind not in "iuf" or not ends[0] < ends[1]:
            checks.refuse(f"bounds[{name!r}]", "be (lowest, highest)", repr(pair))
        limits[:, names.index(name)] = ends
    if np.any(start < limits[0]) or np.any(start > limits[1]):
        checks.refuse("p0", "lie within the bounds", checks.shown(start))
    return limits


def _complex_array(name: str, values: ArrayLike) -> np.ndarray:
    """Return values as an array of finite complex numbers."""
    checks.refuse_masked(name, values, "be finite complex numbers")
    array = np.asarray(values)
    if array.dtype.kind not in "iufc" or not np.all(np.isfinite(array)):
        kind = ValueError if array.dtype.kind in "iufc" else TypeError
        raise kind(checks.complaint(name, "be finite complex numbers", reprlib.repr(values)))
    return array.astype(complex)


def _positive_array(name: str, values: ArrayLike) -> np.ndarray:
    """Return values as an array of numbers above 0."""
    array = checks.real_array(name, values)
    if np.any(array <= 0):
        checks.refuse(name, "be above 0", checks.shown(array))
    return array
