"""Fractional differential equations as systems of weakly singular integral equations.

Let p = y for components of order up to 1, and p = y' for higher orders. Every component satisfies
``p = p(0) + sum_k c_k J**a_k (q_k - o_k)``, 0 < a_k <= 1. The integrand q is the right-hand side
f, p or y, and o is a constant. ``J**a`` is the fractional integral of order a from 0, and m is
alpha rounded up. The highest term ``b D**alpha`` gives c = 1/b and a = alpha - m + 1 with q = f.

A lower term ``b_j D**alpha_j`` gives c = -b_j/b and ``J**(alpha - alpha_j)`` of p. The integrand is
p - p(0) if alpha_j, rounded up, is m as well. If the order alpha - alpha_j exceeds 1, the term is
``J**(alpha - alpha_j - 1)`` of y - y(0) instead.

Terms with general kernels or varying orders are no such integrals; they are subtracted from the
right-hand side. If they contain the highest derivative, the row of p is *implicit*. Then p follows
from the balance of right-hand side and terms, and p' is an integrand.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from ..compiled.jacobian import FEW
from ..compiled.records import records
from ..equation.system import System
from ..equation.terms import Operator, SystemTerm
from ..support.checks import refuse
from .operators import FORCE, ITSELF, POSITION, PRIMARY, SLOPE
from .structures import ALGEBRAIC, TERM

# Smallest order of integration. For smaller orders a, the powers h**a of two step lengths h are
# equal in double precision.
_MIN_ORDER = 5e-10
# Distance below which two exponents of t count as one: two generators, or a generator and a sum of
# other generators.
_EQUAL_EXPONENTS_TOL = 1e-9
# Largest number of generators in a sum that may equal another generator.
_MOST_IN_SUM = 4


@dataclass(frozen=True, eq=False)
class Form:
    """Integral equations of a system."""

    # Row c < d is p of component c, row d + c the terms subtracted from its right-hand side. If p
    # follows from their balance, `implicit`, or there are no terms, `ALGEBRAIC`, row c is empty.

    terms: np.ndarray  # `TERM` (n,); the index -1 is the integrand itself
    offset_of: np.ndarray  # constant subtracted from it, (n,): 0 none, 1 p(0), 2 y(0)
    orders: np.ndarray  # of integration in (0, 1], ascending to 1, (n_a,)
    above_one: np.ndarray  # 1 if the primary unknown p is y', 0 if it is y, (d,)
    generators: tuple[float, ...]  # sums of these are exponents of t in f, p, y near 0
    implicit: np.ndarray  # 1 by balance, 2 (`ALGEBRAIC`) without terms, else 0, (d,)
    kernels: tuple = ()  # general ones, whose indices follow those of the orders
    varying: tuple = ()  # orders, whose indices follow those of the kernels
    # integrand and component of terms with varying orders that act on y, 0 before the start
    jumping: tuple[tuple[int, int], ...] = ()

    @cached_property
    def listed(self) -> list[tuple[int, int, int, float]]:
        """Row, integrand, index of order or kernel, and coefficient of each convolution term."""
        return self.terms.tolist()

    @cached_property
    def groups(self) -> list[Group]:
        """The convolution terms in groups; terms of one group differ by their rows alone."""
        # each row occurs at most once in a group
        found: dict[tuple, list] = {}
        repeats: Counter = Counter()
        for number, term in enumerate(self.listed):
            row, *kind = term
            found.setdefault((*kind, repeats[term]), []).append((row, number))
            repeats[term] += 1
        return [Group(*kind, *np.array(places).T) for (*kind, _), places in found.items()]

    @cached_property
    def n_rows(self) -> int:
        """Number of rows, sums of convolution terms: d, or 2 d for d components."""
        # 2 d if terms are subtracted from any component's right-hand side, or if one has no terms
        d = self.above_one.size
        subtracted = bool((self.terms["row"] >= d).any()) or bool(self.algebraic.any())
        return 2 * d if subtracted else d

    @cached_property
    def powers(self) -> tuple[float, ...]:
        """The orders of integration as numbers."""
        return tuple(self.orders.tolist())

    @cached_property
    def layout(self) -> tuple:
        """Numbers from which the shapes of work arrays follow, and the kinds of the components."""
        sizes = self.n_rows, self.n_integrands, self.unweighted.size
        return *sizes, self.kinds.tobytes(), self.above_one.tobytes()

    @property
    def algebraic(self) -> np.ndarray:
        """True for components without terms, whose equation is 0 = f; shape (d,)."""
        return self.implicit == ALGEBRAIC

    @cached_property
    def kinds(self) -> np.ndarray:
        """Number of each component's kind, (d,); components of one kind have the same terms."""
        d = self.above_one.size
        terms: list[list] = [[] for _ in range(d)]
        for row, *term in self.listed:
            terms[row % d].append((row // d, *term))
        how = zip(terms, self.above_one.tolist(), self.implicit.tolist(), strict=True)
        numbers: dict[tuple, int] = {}
        keys = [(tuple(own), *rest) for own, *rest in how]
        return np.array([numbers.setdefault(key, len(numbers)) for key in keys], dtype=np.int64)

    @cached_property
    def n_integrands(self) -> int:
        """Number of integrands that a step stores: f, p and y, and p' if any term has it."""
        return 4 if (self.terms["integrand"] == SLOPE).any() else 3

    @cached_property
    def unweighted(self) -> np.ndarray:
        """Integrands of varying orders, ascending, whose modes are stored without weights."""
        first = self.orders.size + len(self.kernels)
        if not self.varying:
            return np.zeros(0, dtype=np.int64)
        return np.unique(self.terms["integrand"][self.terms["index"] >= first])

    @cached_property
    def begins_graded(self) -> bool:
        """Whether a run begins with tiny steps: no change of variable smooths its start."""
        return bool(self.varying) or self.solves_slopes

    @cached_property
    def solves_slopes(self) -> bool:
        """Whether any component has p' as an integrand and an implicit row."""
        d, slopes = self.above_one.size, self.terms["integrand"] == SLOPE
        return bool(self.implicit[self.terms["row"][slopes] % d].any())

    def start_exponent(self, t: float = 0.0) -> float:
        """Return the smallest exponent e if p changes like (time - t)**e after a start at t."""
        d, found = self.above_one.size, []
        for c in range(d):
            integrand = SLOPE if self.implicit[c] else FORCE
            own = (self.terms["row"] % d == c) & (self.terms["integrand"] == integrand)
            places = self.terms["index"][own].tolist()
            if not places:  # this p follows from other components
                continue
            powers = [self._start_power(k, integrand, t) for k in places]
            found.append(max(powers) if self.implicit[c] else min(powers))
            if t == 0 and any(component == c for _, component in self.jumping):
                found[-1] -= max(operator.order_at(0.0) for operator in self.varying)
        return min(1.0, *found)

    def graded_first_step(self, t: float, left: float, atol: float, least: float = 0.0) -> float:
        """Return the length of a first step from t over which p hardly changes."""
        # A change of p like ((time - t) / left)**e is then at most atol, e as in `start_exponent`.
        # left: time to the next stop; least: shortest length.
        return max(least, left * min(1e-2, atol ** (1 / self.start_exponent(t))))

    def _start_power(self, k: int, integrand: int, t: float) -> float:
        """Return the exponent of time with which the term of order or kernel k alone changes p."""
        n_a, n_k = self.orders.size, len(self.kernels)
        if k < n_a:
            return self.orders[k] if integrand == FORCE else 1 - self.orders[k]
        if k < n_a + n_k:
            kernel = self.kernels[k - n_a]
            return kernel.singular_exponent or min((*kernel.generators, 1.0))
        order = self.varying[k - n_a - n_k]
        return 1 - order.derivative + order.order_at(t)


class Group(NamedTuple):
    """Convolution terms of a `Form` that differ by their rows alone.

    `integrand`, `coefficient` and `place`, the index of the order or kernel, hold for all n terms.
    `rows` (n,) has the row of each term, `numbers` (n,) its index in `Form.terms`.
    """

    integrand: int
    place: int
    coefficient: float
    rows: np.ndarray
    numbers: np.ndarray


class _Row(NamedTuple):
    """One convolution term of a row of equations.

    If `order` a is given, the term is the fractional integral J**a of the integrand. If `operator`
    is given, the term is the convolution with its general kernel or varying order. If neither is
    given, the term is the integrand itself. `offset` is an entry of `Form.offset_of`.
    """

    row: int
    integrand: int
    coefficient: float
    order: float | None = None
    operator: Operator | None = None
    offset: int = 0


def integral_form(system: System) -> Form:
    """Return the integral equations of a system whose derivatives have orders in (0, 2]."""
    if not system.constant or system.d > FEW:
        return _form_of(system)
    return _kept_form(system.terms_key, system.m)


@lru_cache(maxsize=256)
def _kept_form(left: tuple[tuple[Operator, tuple[float, ...]], ...], m: int) -> Form:
    """Return the integral equations of few components with constant orders, cached between runs."""
    # left: operators with coefficients; m: largest derivative in a term
    terms = [SystemTerm(operator, np.array(coefficients)) for operator, coefficients in left]
    y0 = np.zeros((m, terms[0].coefficients.size))
    return _form_of(System(terms, y0))


def _form_of(system: System) -> Form:
    """Return the integral equations of a system, without a cache."""
    highest = system.highest_orders()
    leading, above_one = system.leading, highest > 1
    balanced = [  # by a term that is no Caputo derivative of constant order
        not any(term.constant and term.order == highest[c] and a[c] != 0 for term, a in system.left)
        for c in range(system.d)
    ]
    bare = [not any(own[c] for _, own in system.left) for c in range(system.d)]
    implicit = np.where(bare, ALGEBRAIC, balanced).astype(np.int64)
    rows: list[_Row] = []
    for c in range(system.d):
        if implicit[c]:
            present = [op for op, own in system.left if own[c] != 0]
            for operator in present:
                if operator.derivative and not operator.definition.subtracts_start:
                    name = operator.definition.name
                    required = f"have a constant order in front of {name}, with Collocation"
                    required += f", and one of 1 or more where that of {name} varies"
                    refuse("terms", required, " and ".join(map(str, present)), "take L1")
            rows += _derivative_rows(system, c, above_one[c])
        elif leading[c] == 0:
            required = "leave a nonzero coefficient before the highest order"
            refuse("terms", required, f"0 for component {c}")
        else:
            rows += _integral_rows(system, c, highest[c], above_one[c], leading[c])
    orders = sorted({row.order for row in rows if row.order is not None} | {1.0})
    if orders[0] < _MIN_ORDER:
        required = f"keep {_MIN_ORDER:g} above integers, and from each other, with Collocation"
        remedy = "take the integer, or equal orders, instead"
        refuse("order", required, sorted({operator.order for operator, _ in system.left}), remedy)
    others = [row.operator for row in rows if row.operator is not None]
    kernels = list(dict.fromkeys(op.kernel for op in others if op.kernel is not None))
    varying = list(dict.fromkeys(op for op in others if op.kernel is None))
    places: list = [*orders, *kernels, *varying]
    listed = [(row.row, row.integrand, _place(row, places), row.coefficient) for row in rows]
    # an integral of y - y(0) raises exponents by one more: y - y(0) begins with the exponent 1
    raised = [row.integrand == POSITION and row.offset > 0 for row in rows]
    powers = zip(rows, raised, strict=True)
    increments = [row.order + one for row, one in powers if row.order is not None]
    for kernel in kernels:
        increments += [1 - kernel.singular_exponent, *kernel.generators]
    return Form(
        records(listed, TERM),
        np.array([row.offset for row in rows], dtype=np.int64),
        np.array(orders),
        above_one.astype(np.int64),
        _generators(tuple(increments)),
        implicit,
        tuple(kernels),
        tuple(varying),
        _jumping(rows, system.d),
    )


def _jumping(rows: list[_Row], d: int) -> tuple[tuple[int, int], ...]:
    """Return integrand and component of each term with a varying order that acts on y itself."""
    # refuses a component that mixes them with terms of varying order that act on y - y(0)
    found: dict[tuple[int, int], list] = {}
    for row in rows:
        if row.operator is not None and row.operator.varies:
            kinds = found.setdefault((row.integrand, row.row % d), [])
            kinds.append(row.operator)
    for kinds in found.values():
        if len({operator.definition.subtracts_start for operator in kinds}) > 1:
            names = " and ".join(operator.definition.name for operator in kinds)
            required = f"not mix orders that vary of {names}, with Collocation"
            refuse("terms", required, " and ".join(map(str, kinds)), "take L1 or ExplicitCaputo")
    return tuple(place for place, kinds in found.items() if not kinds[0].definition.subtracts_start)


def _place(row: _Row, places: list[Any]) -> int:
    """Return the index of a term's order or kernel in `places`, -1 for the integrand itself."""
    if row.operator is not None:
        return places.index(row.operator.kernel or row.operator)
    return ITSELF if row.order is None else places.index(row.order)


def _integral_rows(
    system: System, c: int, highest: float, above_one: bool, leading: float
) -> list[_Row]:
    """Return the terms of component c if its highest derivative can be integrated."""
    # highest: its order; leading: its coefficient; above_one: 1 if p is y'
    rows = [_Row(c, FORCE, 1 / leading, float(highest - above_one))]
    for operator, coefficients in system.left:
        factor = -coefficients[c] / leading
        if factor == 0 or (operator.constant and operator.order == highest):
            continue
        if not operator.constant:
            # if the highest order is an integer, the integral of the convolution with p' is the
            # convolution with p - p(0)
            if operator.kernel is not None and operator.derivative == 1 + above_one:
                rows.append(_Row(c, PRIMARY, factor, operator=operator, offset=1))
            else:
                rows.append(_subtracted_row(operator, coefficients[c], c, system.d, above_one))
            continue
        a = float(highest - operator.order)
        taken = operator.definition.subtracts_start
        if not above_one or operator.order > 1:
            rows.append(_Row(c, PRIMARY, factor, a, offset=1 * taken))
        elif a <= 1:
            rows.append(_Row(c, PRIMARY, factor, a))
        else:
            rows.append(_Row(c, POSITION, factor, a - 1, offset=2 * taken))
    return rows


def _derivative_rows(system: System, c: int, above_one: bool) -> list[_Row]:
    """Return the terms of an implicit row c, subtracted from f; `above_one` is 1 if p = y'."""
    present: list[tuple[Any, float]] = [(op, own[c]) for op, own in system.left if own[c] != 0]
    rows = []
    for operator, coefficient in present:
        if not operator.constant:
            rows.append(_subtracted_row(operator, coefficient, c, system.d, above_one))
            continue
        integrand = SLOPE if operator.derivative > above_one else PRIMARY
        order = None if operator.classical else operator.power
        rows.append(_Row(system.d + c, integrand, coefficient, order))
    return rows


def _subtracted_row(
    operator: Operator, coefficient: float, c: int, d: int, above_one: bool
) -> _Row:
    """Return the term that is subtracted from f of component c of d; `above_one` is 1 if p = y'."""
    integrand = (POSITION, PRIMARY, SLOPE)[operator.derivative - above_one + 1]
    return _Row(d + c, integrand, coefficient, operator=operator)


def _generators(increments: tuple[float, ...]) -> tuple[float, ...]:
    """Return the generators, numbers whose sums are the exponents of t in the solution near 0."""
    # 1 and the increments, by which integrals raise exponents, but for sums of up to _MOST_IN_SUM
    # smaller ones
    kept: list[float] = []
    for g in sorted({*increments, 1.0}):
        sums = {0.0}
        for _ in range(_MOST_IN_SUM):
            sums |= {
                e + other for e in sums for other in kept if e + other < g + _EQUAL_EXPONENTS_TOL
            }
        if min(abs(g - e) for e in sums) > _EQUAL_EXPONENTS_TOL:
            kept.append(float(g))
    return tuple(kept)
