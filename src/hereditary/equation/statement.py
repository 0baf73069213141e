"""Check the terms and initial values that a user states, and convert them to those of a system."""

import numbers
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..compiled.functions import mapped
from ..functions.build import Start
from ..support.checks import complaint, count, real_array, refuse, refuse_masked, shown
from .delay import Delay, InitialFunction
from .operators import Summand, Term
from .orders import merged_orders
from .system import System, leading_orders
from .terms import Operator, SystemTerm


def as_terms(terms: Summand | Iterable[Summand], name: str = "terms") -> tuple[Term, ...]:
    """Return the terms of an argument in any of the forms that `Equation` accepts."""
    items: Any = [terms] if isinstance(terms, (Summand, Delay, numbers.Real)) else terms
    required = "be Caputo or Memory operators with coefficients"
    example = "write [Caputo(1.8), 0.25 * Caputo(0.8)]"
    if callable(items) and name == "terms":
        example = "they come first: Equation(terms, rhs, y0)"
    try:
        items = list(items)
    except TypeError as error:
        raise TypeError(complaint(name, required, repr(terms), example)) from error
    for item in items:
        if not isinstance(item, Summand):
            if isinstance(item, numbers.Real):
                example = f"write Caputo({item}) for a derivative of that order"
            if isinstance(item, Delay):
                example = "name it in memory=, for rhs to read"
            refuse(name, required, repr(item), example, kind=TypeError)
    if not items:
        refuse(name, "hold at least one term", repr(terms), example)
    return tuple(term.plain() for item in items for term in item._terms())


def left_side(
    terms: Iterable[Term],
    factors: Iterable[np.ndarray],
    orders: Iterable[np.ndarray],
    origin: float,
) -> list[SystemTerm]:
    """Return the terms of a system's left side; a term with several orders gives one for each."""
    # factors: coefficients of the user's terms; orders: those of all components for each term of
    # constant order; origin: the user's time at time 0 of the system
    left, rows = [], iter(orders)
    for term, c in zip(terms, factors, strict=True):
        row = next(rows) if term.operator.constant else np.zeros(0)
        for operator, held in term.operator.parts(row, origin):
            left.append(SystemTerm(operator, np.where(held, c, 0.0)))
    return left


def factors_of(terms: Sequence[Term], d: int, paired: bool) -> np.ndarray:
    """Return the terms' coefficients, (n_terms, d), or (n_terms, d, d) if one is a matrix."""
    # d becomes 2 d if components are complex (`paired`)
    found = [t.coefficient for t in terms]
    if all(factor.ndim < 2 for factor in found):
        return per_component("coefficient", found, d, paired)
    stacked = []
    for factor in found:
        if factor.ndim < 2:
            factor = np.diag(per_component("coefficient", [factor], d)[0])
        elif factor.shape != (d, d):
            required = f"be one number, or have shape ({d},) or ({d}, {d})"
            refuse("coefficient", required, f"shape {factor.shape}")
        stacked.append(np.kron(factor, np.eye(2)) if paired else factor)
    matrices = np.array(stacked)
    matrices.flags.writeable = False
    return matrices


def orders_of(terms: Sequence[Term], d: int, paired: bool) -> np.ndarray:
    """Return the orders of the terms of constant order for each component, (n, d)."""
    own = [term.operator._order for term in terms if term.operator.constant]
    orders = merged_orders(per_component("order", own, d, paired))
    orders.flags.writeable = False
    return orders


def check_leading(left: Iterable[SystemTerm], y0: np.ndarray, reads: bool) -> None:
    """Refuse components without Caputo or Memory terms, and initial values that no term needs."""
    # A component must have a term that acts on y - y(0), or no term at all. If f reads memory
    # (`reads`), an algebraic row may have initial values of all orders.
    d = y0.shape[1]
    highest = leading_orders([term for term in left if term.operator.definition.subtracts_start], d)
    present = np.array([own.reshape(-1, d).any(axis=0) for _, own in left]).any(axis=0)
    for j in ((highest == 0) & present).nonzero()[0]:
        name = next(op.definition.name for op, own in left if own.reshape(-1, d)[:, j].any())
        required = f"leave every component at least one nonzero term other than {name}"
        refuse("terms", required, f"none for component {j}")
    _check_initial_terms(left, highest)
    highest = np.where(present | (not reads), highest, len(y0))
    for k in range(1, len(y0)):
        for j in np.flatnonzero((highest <= k) & (y0[k] != 0)):
            got = f"y0[{k}][{j}] = {y0[k, j]}"
            primes = "'" * k
            required = (
                f"hold no y{primes}(0) for component {j}, whose highest order is {highest[j]}"
            )
            refuse("y0", required, got, "set it to 0")


def _check_initial_terms(left: Iterable[SystemTerm], leading: np.ndarray) -> None:
    """Refuse terms that act on y itself, whose order is too high in a component."""
    # It must be below `leading` (d,), the highest order of the component's other terms. If that
    # exceeds 1, it must be below it by more than 1: y' would be infinite at 0 otherwise.
    for operator, coefficients in left:
        if operator.definition.subtracts_start:
            continue
        gamma, allowed = operator.order_at(0.0), leading - (leading > 1)
        present = coefficients.reshape(-1, leading.size).any(axis=0)
        for c in np.flatnonzero(present & (gamma >= allowed)):
            required = f"be below {allowed[c]:g} for {operator.definition.name} in component {c}"
            required += f", 1 below its highest order {leading[c]:g}" * bool(leading[c] > 1)
            refuse("order", required, gamma, "or take Caputo")


def per_component(
    name: str, arrays: Sequence[np.ndarray], d: int, paired: bool = False
) -> np.ndarray:
    """Return a row of d entries for each of `arrays`, which are numbers or (d,)."""
    # entries are repeated if components are complex (`paired`), for 2 d real components
    for array in arrays:
        if array.ndim and array.size != d:
            required = f"be one number or one for each of the {d} components"
            refuse(name, required, f"shape {array.shape}")
    stacked = np.empty((len(arrays), d))
    for row, array in zip(stacked, arrays, strict=True):
        row[:] = array
    stacked = np.repeat(stacked, 2, axis=1) if paired else stacked
    stacked.flags.writeable = False
    return stacked


def read_memory(memory: Any) -> tuple[Term | Delay, ...]:
    """Return the terms and delays of the argument `memory`, in its order."""
    parts = list(memory) if isinstance(memory, (list, tuple)) else [memory]
    found: list[Term | Delay] = []
    for part in parts:
        found += [part] if isinstance(part, Delay) else _read_terms(part)
    return tuple(found)


def _read_terms(memory: Summand) -> tuple[Term, ...]:
    """Return the terms of one part of the argument `memory`; refuse any that cannot be read."""
    terms = as_terms(memory, "memory")
    for term in terms:
        if term.operator.derivative > 2:
            refuse("memory", "have orders up to 2", f"{term}")
        instead = term.operator.definition.instead
        if instead:
            remedy = f"if y(0) = 0 it is Caputo's; {instead}"
            refuse("memory", "hold Caputo or Memory terms", f"{term}", remedy)
    return terms


def with_memory(system: System, memory: Sequence[Term]) -> System:
    """Return a system with the k terms of memory that its right-hand side reads as components."""
    # Each term adds d components, of which it is the left side, so that schemes discretise it like
    # a term of an equation. Its increments are those of the source.
    d, k, origin, paired = system.d, len(memory), system.frame.start, system.frame.paired
    own_d = d // 2 if paired else d
    factors = factors_of(memory, own_d, paired)
    if factors.ndim > 2:
        required = "have coefficients of shape (d,)"
        refuse("memory", required, f"shape {factors.shape[1:]}", "multiply in rhs")
    orders = orders_of(memory, own_d, paired)
    mine = [op.order for op, _ in system.left if op.constant]
    # orders of memory that differ from orders of the left side by rounding become equal to them
    orders = merged_orders(np.vstack([np.tile(mine, (d, 1)).T.reshape(-1, d), orders]))[len(mine) :]
    left = [SystemTerm(op, np.concatenate([c, np.zeros(k * d)])) for op, c in system.left]
    rows = iter(orders)
    for number, (term, c) in enumerate(zip(memory, factors, strict=True), 1):
        for operator, held in left_side([term], [c], rows, origin):
            coefficients = np.zeros((1 + k, d))
            coefficients[number] = held
            left.append(SystemTerm(operator, coefficients.ravel()))
            _check_below(operator, held != 0, system)
    return _without_unread(system, left, factors)


def _without_unread(system: System, left: Sequence[SystemTerm], factors: np.ndarray) -> System:
    """Return a system with its memory components, but without those whose factor (k, d) is 0."""
    # the right-hand side still gets 0 as the value of an omitted component
    k, d = factors.shape
    kept = np.append(np.full(d, True), factors.ravel() != 0)
    sources = np.tile(np.arange(d), 1 + k)[kept]
    left = [SystemTerm(operator, c[kept]) for operator, c in left]
    known: dict[str, Any] = {"of_y": system.of_y[sources]}
    if not kept.all():
        ones, places = np.ones(kept.sum()), np.flatnonzero(kept)
        read = np.c_[places, np.arange(places.size), ones]
        functions = mapped(system.functions, places.size, kept.size, a=read[:d], s=read)
        known["functions"] = functions
    y0 = np.take(system.y0, sources, axis=1)
    return replace(system, left=left, y0=y0, sources=sources, **known)


def _check_below(operator: Operator, read: np.ndarray, system: System) -> None:
    """Refuse memory of an order that is not below the highest order of its components."""
    # read (d,): which components it has; algebraic ones may have any order with values in y0
    bare = system.algebraic
    if operator.derivative > system.m and np.any(read & bare) and operator.constant:
        remedy = f"add 0 * Caputo({operator.order:g}) to the terms, and y'(0) to y0"
        refuse("memory", "need no y'(0) that y0 lacks", f"{operator}", remedy)
    if not np.any(read & ~bare):
        return
    lowest = float(system.highest_orders()[read & ~bare].min())
    order = operator.order_at(0.0)  # an order that varies is checked at t = 0 only
    if order >= lowest:
        required = f"have orders below the highest of their component, {lowest:g}"
        refuse("memory", required, f"{order:g}", "solve the equation for its highest derivative")


# Part of messages about y0 that explains how a right-hand side reads y'.
_SPEED = (
    "; y' is no entry of y: with memory=hd.Caputo(1), rhs(t, y, memory) or rhs(t, y, memory, "
    "params) reads it as memory[0, 0]"
)


class Initial(NamedTuple):
    """Initial values of an equation."""

    given: np.ndarray  # all rows of y0, (k, d), as `Equation` accepts them again; real or complex
    values: np.ndarray  # the rows y(0), y'(0), ... that the highest order needs, (m, d)
    shorthand: np.ndarray  # y0 as the user gave it, for messages
    stated_d: int | None  # the argument `d` of `Equation`, or None

    @property
    def d(self) -> int:
        """Number of components, where a complex one counts once."""
        return self.values.shape[1]

    @property
    def paired(self) -> bool:
        """Whether components are complex: each is two real components of the system."""
        return self.values.dtype.kind == "c"

    def needed(self, left: Iterable[SystemTerm]) -> np.ndarray:
        """Return the values in real numbers; if d is stated, 0 where no term needs them."""
        real = self.values.view(float)
        if self.stated_d is None:
            return real
        orders = leading_orders(left, real.shape[1])
        return np.where(orders > np.arange(len(real))[:, None], real, 0.0)


def initial_of(y0: ArrayLike, terms: Iterable[Term], d: int | None) -> Initial:
    """Return the initial values that terms need; `d` is the stated number of components or None."""
    values = _finite(y0)
    m = max(term.operator.derivative for term in terms)
    if m == 0:
        required = "hold a derivative"
        remedy = "hereditary.derivative(t, g, ...) solves equations of the first kind for y"
        refuse("terms", required, repr(next(iter(terms))), remedy)
    if d is None:
        given = initial_values(values, m)
        return Initial(given, given, values, None)
    given = _initial_rows(values, m, count("d", d))
    return Initial(given, given[:m].copy(), values, d)


def start_of(
    initial: Initial, pasts: Sequence[InitialFunction | None], params: np.ndarray, t_start: float
) -> Start:
    """Return the arguments of functions at the start; memory is 0 there, except for delays."""
    remembered = np.zeros((len(pasts), initial.d), initial.values.dtype)
    for row, past in zip(remembered, pasts, strict=True):
        row[:] = 0.0 if past is None else past.first
    return Start(initial.values[0], remembered, params, t_start)


def _finite(y0: ArrayLike) -> np.ndarray:
    """Return initial values as an array of finite numbers, real or complex."""
    remedy = "give shape (m, d): y(0), y'(0), ..."
    refuse_masked("y0", y0)
    try:
        is_complex = np.array(y0).dtype.kind == "c"
    except (TypeError, ValueError):  # rows of unequal length
        is_complex = False
    if not is_complex:
        return real_array("y0", y0, remedy=remedy)
    values = np.array(y0, dtype=complex)
    for part in (values.real, values.imag):
        real_array("y0", part, "be finite numbers", remedy)
    return values


def initial_values(values: np.ndarray, m: int) -> np.ndarray:
    """Return y0 as an array (m, d); shorthands are (m,) if d = 1, (d,) if m = 1, and a number."""
    given = values.shape
    if values.ndim == 0:
        values = values.reshape(1, 1)
    elif values.ndim == 1:
        values = values.reshape(1, -1) if m == 1 else values.reshape(-1, 1)
    if values.ndim == 2 and values.shape[0] == m and values.shape[1] >= 1:
        return np.ascontiguousarray(values)
    given_names = [f"y{chr(39) * k}(0)" for k in range(m)]
    names = " and ".join(filter(None, [", ".join(given_names[:-1]), given_names[-1]]))
    required = f"hold {names}, shape ({m}, d)"
    remedy = "the highest order sets how many rows are needed, ceil(order)"
    if m == 2 and values.size == 1:
        remedy = f"an order above 1 needs y'(0) too, e.g. [{values[0, 0]}, 0.0]"
    elif m == 1 and len(given) == 2 and given[1] == 1:
        remedy = "orders up to 1 need only y(0), its components in a row"
    elif m == 2 and values.ndim == 2 and values.shape[1] == 1:
        remedy = f"for {values.size} components give two rows, [[y(0), ...], [y'(0), ...]]"
    refuse("y0", required, f"shape {given}" if given else shown(values[0, 0]), remedy)


def _initial_rows(values: np.ndarray, m: int, d: int) -> np.ndarray:
    """Return y0 as an array (k, d) of at least m rows; the number d of components is given."""
    rows = values.reshape(-1, d) if values.ndim < 2 and values.size % d == 0 else values
    if rows.ndim != 2 or rows.shape[1] != d or len(rows) < m:
        required = f"hold at least {m} rows of {d}, where d = {d} is stated"
        refuse("y0", required, f"shape {values.shape}" if values.ndim else shown(values))
    return np.ascontiguousarray(rows)


def of_shorthand(initial: Initial, reads_memory: bool) -> str:
    """Return a hint for messages: how a flat y0 is understood, and how rhs reads y'; or ""."""
    values, shape = initial.shorthand, initial.values.shape
    speed = _SPEED if shape == (2, 1) and not reads_memory else ""
    if values.ndim != 1 or shape[0] == 1:
        return speed
    return (
        f"; y0 = {shown(values)} is taken for y(0) and y'(0) of one component: for two write "
        f"[[y(0), ...], [y'(0), ...]]{speed}"
    )
