"""Systems, the form of equations that schemes and steppers solve, and systems made from others."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..compiled.delayed_values import Delays
from ..compiled.functions import Functions, no_functions
from ..compiled.jacobian import VALUES, derivatives_by_parameters, force_at, jacobian_at, right_side
from ..compiled.signatures import RightSide
from ..compiled.units import units_of
from ..support.checks import refuse
from .delay import Delayed
from .frame import Frame
from .jacobian_structure import Structure
from .terms import SystemTerm

_IDENTITY_FRAME = Frame()
_T = TypeVar("_T")


class _of_left(cached_property[_T]):
    """A property that follows from the left side alone, which systems that differ in y0 share."""


@dataclass(frozen=True, eq=False, repr=False)
class System:
    """A sum of terms with memory for each component, equal to a right-hand side."""

    # `Equation.system` is a system with all checks done. There are d components. The first
    # `n_solved` of them have an equation. The others are memory that the right-hand side reads:
    # each is a term of its source, one of the first components.

    # operators with coefficients: of the left side, or of the term that a memory component is
    left: Iterable[SystemTerm]  # a tuple from __post_init__ on
    y0: np.ndarray  # (m, d): y(0), and y'(0) if m = 2; those of the source for memory
    functions: Functions = field(default_factory=no_functions)  # f, its Jacobian and parameters
    force_of_plan: Any = None  # force_of_plan(t, y) instead of f, to make plans
    sources: Any = None  # (d,) int64: source of each component, itself if it has an equation
    structure: Structure | None = None  # entries that may differ from 0, those of a given Jacobian
    of_y: Any = None  # (d,): component of y to which each belongs, its source by default
    frame: Frame = _IDENTITY_FRAME
    rhs_digest: str = ""  # of the user's right-hand side, equal in other processes
    terms_digest: str = ""  # of terms that `left` does not contain
    matrix: Any = None  # constant CSR array that is part of the right-hand side
    linear_alone: bool = False  # whether it is the complete right-hand side
    callbacks: tuple = ()  # to functions in Python, kept alive while compiled code may call them
    by_params: int = 0  # number of tangents by parameters: tangent k is that by parameter k
    delays: tuple[Delayed, ...] = ()  # whose values f reads from `functions`
    switches: tuple = ()  # compiled ones, kept alive
    m: int = field(init=False)
    d: int = field(init=False)

    def __post_init__(self) -> None:
        set_once = partial(object.__setattr__, self)
        set_once("left", tuple(self.left))
        set_once("m", self.y0.shape[0])
        set_once("d", self.y0.shape[1])
        if self.sources is None:
            set_once("sources", np.arange(self.d))
        if self.of_y is None:
            set_once("of_y", self.sources)

    def spread(self, values: Any) -> np.ndarray:
        """Return values for all components, (d,), from one number or from values for y."""
        values = np.asarray(values)
        return np.zeros(self.d) + values if values.ndim == 0 else values[self.of_y]

    @property
    def n_y(self) -> int:
        """Number of components of the user's y, where a complex one counts once."""
        n = int(self.of_y.max()) + 1
        return n // 2 if self.frame.paired else n

    @_of_left
    def n_solved(self) -> int:
        """Number of components with an equation, which come first."""
        return int(np.count_nonzero(~self.is_memory))

    @_of_left
    def distinct(self) -> tuple[list[tuple[tuple[float, Any], ...]], np.ndarray]:
        """Distinct lists of (nonzero coefficient, operator), and each component's index, (d,)."""
        columns = np.array([c for _, c in self.left])
        if np.all(columns == columns[:, :1]):
            columns = columns[:, :1]
        rows = map(tuple, columns.T.tolist())
        kinds: dict[tuple, int] = {}
        numbers = [kinds.setdefault(row, len(kinds)) for row in rows]
        held = [zip(row, self.left, strict=True) for row in kinds]
        keys = [tuple((c, operator) for c, (operator, _) in terms if c != 0) for terms in held]
        distinct = list(dict.fromkeys(keys))
        found = np.array([distinct.index(key) for key in keys], dtype=np.int64)[numbers]
        return distinct, np.broadcast_to(found, self.d).copy()

    @property
    def has_jac(self) -> bool:
        """Whether the Jacobian is given; otherwise it comes from differences."""
        return self.functions.has_jac

    @cached_property
    def compiled(self) -> RightSide:
        """Right-hand side and its Jacobian for the records of compiled code."""
        return right_side(self.functions, self.structure is not None, self.by_params)

    @property
    def params(self) -> np.ndarray:
        """Parameters of the right-hand side, (p,), read-only: marches use those of `functions`."""
        locked = self.functions.params.view()
        locked.flags.writeable = False
        return locked

    def rhs(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return the right-hand side at time t, counted from the start, and y (d,)."""
        if self.force_of_plan is not None:
            return self.force_of_plan(t, y)
        out = np.empty(self.d)
        force_at(self.compiled, float(t), np.array(y, dtype=float), out)
        return out

    def beside(self, t: float, sign: float) -> float:
        """Return a time just after (sign 1) or just before (-1) t, by some units of rounding."""
        # functions that round the time differently still see it on that side of a jump at t
        start = self.frame.start
        largest = max(abs(t), abs(start), abs(start + t)) if start else t
        return t + sign * 8 * math.ulp(largest)

    @_of_left
    def is_memory(self) -> np.ndarray:
        """Whether each component is memory that the right-hand side reads, shape (d,)."""
        return self.sources != np.arange(self.d)

    @_of_left
    def above(self) -> np.ndarray:
        """Whether each component, or the source of its memory, has an order above 1, (d,)."""
        return self.highest_orders()[self.sources] > 1

    @cached_property
    def at_start(self) -> np.ndarray:
        """Components at time 0, shape (d,): y(0), and memory, which is 0 unless its order is 1."""
        first = self.y0[-1] if self.m == 2 else np.zeros(self.d)
        return np.where(self.is_memory, self.coefficient(1.0) * first, self.y0[0])

    def highest_orders(self) -> np.ndarray:
        """Return the highest order with a nonzero coefficient of each component, shape (d,)."""
        # terms with general kernels, or with orders that vary, count as the derivative inside them
        return self._highest_orders

    @_of_left
    def _highest_orders(self) -> np.ndarray:
        highest = leading_orders(self.left, self.d)
        highest.flags.writeable = False
        return highest

    @_of_left
    def above_one(self) -> np.ndarray:
        """Whether each component with an equation has an order above 1, shape (n_solved,)."""
        return self.highest_orders()[: self.n_solved] > 1

    @_of_left
    def algebraic(self) -> np.ndarray:
        """Whether each component with an equation has an algebraic one, 0 = f, (n_solved,)."""
        held = [coefficients[: self.n_solved] != 0 for _, coefficients in self.left]
        return ~np.any(held, axis=0)

    def coefficient(self, alpha: float | np.ndarray) -> np.ndarray:
        """Return the coefficient (d,) of Caputo's derivative of order `alpha`, a number or (d,)."""
        total = np.zeros(self.d)
        for operator, coefficients in self.left:
            if operator.constant:
                total += np.where(operator.order == np.asarray(alpha), coefficients, 0.0)
        return total

    @_of_left
    def leading(self) -> np.ndarray:
        """Coefficients of Caputo's derivatives of the highest orders, (d,), or 0."""
        found = self.coefficient(self.highest_orders())
        found.flags.writeable = False
        return found

    @_of_left
    def highest_order(self) -> float:
        """The highest order of all components."""
        return float(self.highest_orders().max())

    @_of_left
    def reads(self) -> bool:
        """Whether the right-hand side reads memory."""
        return bool(self.is_memory.any())

    @_of_left
    def has_algebraic(self) -> bool:
        """Whether any component has an algebraic equation."""
        return bool(self.algebraic.any())

    @_of_left
    def subtracts_start(self) -> bool:
        """Whether all operators act on y - y(0)."""
        return all(operator.definition.subtracts_start for operator, _ in self.left)

    @_of_left
    def terms_key(self) -> tuple[tuple[Any, tuple[float, ...]], ...]:
        """The operators with their coefficients: equal for systems with equal left sides."""
        return tuple((operator, tuple(own.tolist())) for operator, own in self.left)

    @_of_left
    def constant(self) -> bool:
        """Whether all operators are Caputo's derivatives of constant order."""
        return all(operator.constant for operator, _ in self.left)

    @_of_left
    def varies(self) -> bool:
        """Whether an order varies."""
        return any(operator.varies for operator, _ in self.left)

    def derivative(self, t: float, y: ArrayLike, units: np.ndarray | None = None) -> Any:
        """Return d rhs / d y at (t, y): the given one, or differences."""
        # (d, d), or a CSR array if `structure` is given; a complex component is two real ones;
        # times count from the start; units are those of a run to t = 1 by default
        structure, d = self.structure, self.d
        out = np.empty((d, d)) if structure is None else structure.entries.copy()
        y = np.array(y, dtype=float)
        units = self.units() if units is None else units
        jacobian_at(self.compiled, float(t), y, units, out)
        return out if structure is None else structure.matrix(out[VALUES])

    def derivatives_by_parameters(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return d rhs / d p at (t, y) by the first `by_params` parameters, (by_params, d)."""
        out = np.empty((self.by_params, self.d))
        if self.by_params:
            derivatives_by_parameters(self.compiled, float(t), np.array(y, dtype=float), out)
        return out

    @cached_property
    def _units(self) -> dict[float, np.ndarray]:
        """Units of the components by the length of the run; 0 if they are not known."""
        return {}

    def units(self, t_end: float = 1.0) -> np.ndarray:
        """Return units (d,) of a run to t_end, for differences where y is 0; 1 if unknown."""
        if self.has_jac:
            return np.ones(self.d)
        known = self._units.get(t_end)
        if known is None:
            self._units[t_end] = known = np.empty(self.d)
            units_of(self.compiled, self.at_start, t_end, self.rates(t_end), known)
        return np.where(known > 0, known, 1.0)

    @_of_left
    def _rates(self) -> dict[float, np.ndarray]:
        """Rates of the components by the length of the run."""
        return {}

    def rates(self, t_end: float) -> np.ndarray:
        """Return f over the y that it makes in a run to t_end, if it is constant, (d,)."""
        # 1 / t_end for y' = f, and 0 for an algebraic row
        found = self._rates.get(t_end)
        if found is None:
            found = np.zeros(self.d)
            for operator, coefficients in self.left:
                found += np.abs(coefficients) * operator.rate(t_end)
            self._rates[t_end] = found
        return found

    def dense(self) -> System:
        """Return the system with a dense Jacobian, by differences if a sparse one is stated."""
        if self.structure is None:
            return self
        functions = self.functions.without_jac()
        return replace(self, functions=functions, structure=None, matrix=None, linear_alone=False)

    def motion(self, t: float, y: np.ndarray, ydot: np.ndarray) -> np.ndarray:
        """Estimate y' at time t from y and ydot, both (d,)."""
        # ydot for a highest order above 1, otherwise f over the leading coefficient
        f = self.rhs(self.beside(t, 1), y)
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = f / self.leading
        slope[: self.n_solved][self.algebraic] = 0.0
        return np.where(self.highest_orders() > 1, ydot, slope)


_CACHED = {name: kind for name, kind in vars(System).items() if isinstance(kind, cached_property)}
# Properties that follow from the left side alone.
_OF_LEFT = frozenset(name for name, kind in _CACHED.items() if isinstance(kind, _of_left))
# Properties that follow from initial values or functions as well.
_OF_REST = _CACHED.keys() - _OF_LEFT


def refuse_late(system: System, t_end: float) -> None:
    """Refuse a run that ends after the last time at which an operator is known."""
    last = min(operator.t_last for operator, _ in system.left)
    if t_end > last * (1 + 1e-12):
        required = f"stay within t = {last:g}, up to which a kernel is known"
        remedy = "end the run there, or give a kernel that reaches farther"
        refuse("t_end", required, f"{t_end:g}", remedy)


def leading_orders(left: Iterable[SystemTerm], d: int) -> np.ndarray:
    """Return the highest order of each of d components in any equation; 0 without terms."""
    # coefficients (d,), or (d, d) with a row for each equation
    highest = np.zeros(d)
    for operator, coefficients in left:
        held = (coefficients.reshape(-1, d) != 0).any(axis=0)
        highest = np.maximum(highest, np.where(held, operator.order, 0.0))
    return highest


def variational(system: System, directions: np.ndarray) -> System:
    """Return the system and its linearisation along k directions, d (1 + k) components."""
    # directions (m, d, k): derivatives of y(0), y'(0). It serves plans of schemes only, which call
    # f from Python; a march calls that of `system`. Schemes treat all components in the same way,
    # so a scheme applied to it gives the exact derivative of the scheme applied to `system`.
    d, k = system.d, directions.shape[2]
    y0 = np.hstack([system.y0, *np.moveaxis(directions, 2, 0)])

    def force(t: float, y: np.ndarray) -> np.ndarray:
        forces = (system.derivative(t, y[:d]) @ y[d:].reshape(k, d).T).T
        forces[: system.by_params] += system.derivatives_by_parameters(t, y[:d])
        return np.concatenate([system.rhs(t, y[:d]), forces.ravel()])

    return _repeated(system, 1 + k, y0, force)


def side_by_side(systems: Sequence[System]) -> System:
    """Return several systems with the same left side as one system, for plans alone."""
    d = systems[0].d

    def force(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [system.rhs(t, y[m * d : (m + 1) * d]) for m, system in enumerate(systems)]
        )

    return _repeated(systems[0], len(systems), np.hstack([s.y0 for s in systems]), force)


def _repeated(system: System, times: int, y0: np.ndarray, force: Any) -> System:
    """Return a system with `times` copies of the components of `system`, each with its terms."""
    left = [SystemTerm(operator, np.tile(c, times)) for operator, c in system.left]
    sources = (system.sources + system.d * np.arange(times)[:, None]).ravel()
    return System(left, y0, system.functions, force, sources)


def displaced(system: System, y0: np.ndarray, params: np.ndarray | None = None) -> System:
    """Return the system with other initial values (m, n_solved) and first parameters (p,)."""
    # delays read a past that is displaced as y(0) is
    functions = system.functions
    if params is not None:
        params = np.concatenate((params, functions.params[params.size :]))
        functions = functions._replace(params=params)
    if system.delays:
        displacement = (y0 - system.y0[:, : y0.shape[1]])[0, : system.n_solved]
        pieces = functions.delays
        pieces = pieces._replace(displacements=pieces.displacements + displacement)
        functions = functions._replace(delays=pieces)
    y0 = y0.take(system.sources, axis=1)
    y0.flags.writeable = False
    return _sharing(system, y0=y0, functions=functions)


def with_params(system: System, params: np.ndarray) -> System:
    """Return the system with these parameters (p,), as many as it has."""
    functions = system.functions._replace(params=params)
    return _sharing(system, functions=functions, at_start=system.at_start)


def with_pieces(system: System, pieces: Delays) -> System:
    """Return the system whose right-hand side reads delayed values from these pieces."""
    return _sharing(system, functions=system.functions._replace(delays=pieces))


def _sharing(system: System, **changed: Any) -> System:
    """Return a system with some values changed, and all that follows from the left side."""
    # `replace` would check the fields again, and forget what follows from them
    for name in _OF_LEFT:
        if name not in system.__dict__:
            getattr(system, name)
    found, known = object.__new__(System), vars(system).copy()  # to which other threads may add
    vars(found).update({name: known[name] for name in known if name not in _OF_REST}, **changed)
    return found
