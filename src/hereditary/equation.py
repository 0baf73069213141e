"""The equation: a sum of memory terms equals a right-hand side (floor 2)."""

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import ArrayLike

from ._callables import compile_jac, compile_rhs
from ._checks import complaint, real_array
from .operators import Caputo, Memory, Term
from .system import KernelTerm, System


class Equation(System):
    """An initial value problem ``sum_j c_j (memory operator)_j y = rhs(t, y)`` on t >= 0.

    Everything is checked here: the right-hand side is called once at t = 0 and compiled, so that a
    mistake is reported before any run.

    Parameters
    ----------
    terms : Caputo, Memory, Term or sequence of them
        Operators with their coefficients, ``[Caputo(1.8), 0.25 * Caputo(0.8)]``. Orders and
        coefficients are one for all components or of shape (d,).
    rhs : callable
        ``rhs(t, y)`` or ``rhs(t, y, params)`` returning shape (d,) (or a number when d = 1), or in
        place ``rhs(t, y, dy, params)``; told apart by the number of arguments. t is a float, y has
        shape (d,). It is compiled with numba, and compiled again when a global it reads changes.
    y0 : array_like, shape (m, d)
        Initial values y(0), y'(0), ..., with m = ceil(highest order). Shorthands: shape (m,) when
        d = 1, shape (d,) when m = 1, a number when both are 1. A component whose own highest order
        needs no y'(0) takes 0 there.
    params : sequence of float, optional
        Handed to `rhs` and `jac` as an array of shape (p,).
    jac : callable, optional
        The Jacobian d rhs / d y, ``jac(t, y)`` or ``jac(t, y, params)`` returning shape (d, d), or
        in place ``jac(t, y, jacobian, params)``. Differences otherwise.

    Attributes
    ----------
    d : int
        Number of components.
    m : int
        Number of initial conditions, ceil(highest order).
    orders, coefficients : ndarray, shape (n_terms, d)
        Order and coefficient for each component of each Caputo term of constant order.
    y0 : ndarray, shape (m, d)
    params : ndarray, shape (p,)

    Raises
    ------
    TypeError, ValueError
        Each message names the argument, what was required and what arrived.

    Examples
    --------
    >>> import hereditary as hd
    >>> eq = hd.Equation([hd.Caputo(1.5), 0.5 * hd.Caputo(0.5)], lambda t, x: -x, y0=[1.0, 0.0])
    >>> eq.d, eq.m
    (1, 2)
    """

    def __init__(
        self,
        terms: Caputo | Term | Iterable[Caputo | Term],
        rhs: Callable,
        y0: ArrayLike,
        params: ArrayLike = (),
        jac: Callable | None = None,
    ) -> None:
        self.terms = _as_terms(terms)
        values = real_array("y0", y0, remedy="give shape (m, d): y(0), y'(0), ...")
        highest = max(t.operator.derivative for t in self.terms)
        if highest == 0:
            required = "hold a derivative"
            remedy = "an equation in y and its past alone is none of these"
            raise ValueError(complaint("terms", required, repr(self.terms[0]), remedy))
        initial = _initial_values(values, highest)
        d = initial.shape[1]
        factors = _per_component("coefficient", [t.coefficient for t in self.terms], d)
        own = [_own_operator(term.operator) for term in self.terms]
        caputo = [operator is None for operator in own]
        constant = [t.operator for t, held in zip(self.terms, caputo, strict=True) if held]
        orders = _per_component("order", [operator._order for operator in constant], d)
        coefficients = factors[caputo]
        pairs = zip(own, factors, strict=True)
        memories = [(operator, factor) for operator, factor in pairs if operator is not None]
        numbers = real_array("params", params, remedy="pass a flat sequence of floats")
        if numbers.ndim != 1:
            required = "be a flat sequence of floats"
            raise ValueError(complaint("params", required, f"shape {numbers.shape}"))
        compiled = compile_rhs(rhs, initial[0], numbers)
        compiled_jac = compile_jac(jac, initial[0], numbers) if jac is not None else None
        super().__init__(orders, coefficients, initial, numbers, compiled, compiled_jac, memories)
        _check_leading(self.highest_orders(), initial)

    def __repr__(self):
        return f"Equation({' + '.join(map(repr, self.terms))} = rhs, d={self.d})"


def _own_operator(operator):
    """What a `System` calls an operator that is no Caputo derivative of constant order."""
    if isinstance(operator, Memory):
        return KernelTerm(operator.kernel, operator.derivative)
    return operator.varying


def _per_component(name, arrays, d):
    """Stack one row a term, each broadcast to the d components."""
    for array in arrays:
        if array.ndim and array.size != d:
            required = f"be one number or one for each of the {d} components"
            raise ValueError(complaint(name, required, f"shape {array.shape}"))
    stacked = np.array([np.broadcast_to(array, (d,)) for array in arrays]).reshape(-1, d)
    stacked.flags.writeable = False
    return stacked


def _check_leading(highest, y0):
    for j in np.flatnonzero(highest == 0):
        required = "leave every component at least one nonzero term"
        raise ValueError(complaint("terms", required, f"none for component {j}"))
    needless = (highest <= 1) & np.any(y0[1:] != 0, axis=0)
    for j in np.flatnonzero(needless):
        got = f"y0[1][{j}] = {y0[1, j]}"
        required = f"hold no y'(0) for component {j}, whose highest order is {highest[j]}"
        raise ValueError(complaint("y0", required, got, "set it to 0"))


def _as_terms(terms):
    items = [terms] if isinstance(terms, (Caputo, Memory, Term)) else terms
    required = "be Caputo or Memory operators with coefficients"
    example = "write [Caputo(1.8), 0.25 * Caputo(0.8)]"
    try:
        items = list(items)
    except TypeError as error:
        raise TypeError(complaint("terms", required, repr(terms), example)) from error
    for item in items:
        if not isinstance(item, (Caputo, Memory, Term)):
            raise TypeError(complaint("terms", required, repr(item), example))
    if not items:
        raise ValueError(complaint("terms", "hold at least one term", "none", example))
    items = (item if isinstance(item, Term) else Term(item, 1.0) for item in items)
    return tuple(term.plain() for term in items)


def _initial_values(values, m):
    """The (m, d) array behind any of the shorthands."""
    if values.ndim == 0:
        values = values.reshape(1, 1)
    elif values.ndim == 1:
        values = values.reshape(1, -1) if m == 1 else values.reshape(-1, 1)
    if values.ndim == 2 and values.shape[0] == m and values.shape[1] >= 1:
        return np.ascontiguousarray(values)
    names = "y(0)" if m == 1 else "y(0) and y'(0)"
    required = f"hold {names}, shape ({m}, d)"
    remedy = "the highest order sets how many rows are needed, ceil(order)"
    raise ValueError(complaint("y0", required, f"shape {values.shape}", remedy))
