"""The class `Equation`: a sum of terms with memory equals a right-hand side."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..compiled.callbacks import PythonRaised, original
from ..compiled.functions import Functions
from ..functions.assemble import Assembled, functions_of
from ..functions.build import Start, present_values
from ..functions.differences import check_jacobian
from ..functions.reads import digest, digest_of_compiled
from ..support.checks import instance, real, real_array, refuse
from . import statement
from .chain import chained
from .delay import Delay, pasts_of, reading
from .formula import formula
from .frame import Frame
from .jacobian_structure import JacobianInfo, copied, jacobian_info
from .operators import Summand
from .system import System, with_params
from .terms import SystemTerm


class Equation:
    """An initial value problem ``sum_j c_j (memory operator)_j y = rhs(t, y)`` from t_start on.

    An equation is checked when it is made: the right-hand side is compiled and called twice, so
    that an error is reported before any run.

    Parameters
    ----------
    terms : Caputo, Memory, Term, a sum or a sequence of them
        Operators with their coefficients, ``[Caputo(1.8), 0.25 * Caputo(0.8)]`` or ``Caputo(1.8) +
        0.25 * Caputo(0.8)``. An order or a coefficient is one number for all components, or has
        shape (d,). A coefficient of shape (d, d) has a row for each equation and a column for each
        component. A sequence is a sum: two components of orders 0.9 and 0.8 are ``Caputo([0.9,
        0.8])``. With `rtol=` in `solve`, all coefficients of a component may be 0. Its equation is
        then algebraic, 0 = rhs, and y0 has to satisfy it.
    rhs : callable, or None with `linear`
        ``rhs(t, y)`` or ``rhs(t, y, params)`` returning shape (d,) (or a number when d = 1), or in
        place ``rhs(t, y, dy, params)``. The number of arguments decides. t is a float, y has shape
        (d,). The function is compiled with the functions that it calls, and again before a run if a
        global or a closed-over value has changed. A function that numba cannot compile (methods,
        callable objects, SciPy's functions, try) is called in Python, with a
        `PythonFunctionWarning` and 3 us more a call. `rhs` must return equal values for equal t and
        y, and not write into y or params. An exception or an index out of bounds ends the run.
    y0 : array_like, shape (m, d)
        Initial values y(0), y'(0), ..., with m = ceil(highest order). Shorthands: shape (m,) if
        d = 1, shape (d,) if m = 1, a number if both are 1. A component of order at most 1 has 0 in
        the row of y'(0). Complex numbers state a complex equation: then `rhs` gets and returns
        complex numbers, results are complex, and there is no `jac`.
    params : float or sequence of float, optional
        Argument of `rhs` and `jac`, as an array of shape (p,).
    jac : callable, optional
        The Jacobian d rhs / d y, ``jac(t, y)`` or ``jac(t, y, params)`` returning shape (d, d), or
        in place ``jac(t, y, jacobian, params)``. If it is left out, the Jacobian comes from
        differences. A given one is compared with them at y(0) and at two points near it. It is
        refused if they show that an entry errs there by more than 1 % of the largest entry of its
        row. It is accepted if all entries err by less than 0.1 % of their own size. With
        `bandwidth` or `jac_sparsity` its product with a random vector is compared.
    memory : Caputo, Memory, Term, Delay, a sum or a sequence of them, optional
        Terms and delays that `rhs` reads, for example for friction that depends on the state. They
        are not on the left side. Their values, shape (k, d), are the third argument: ``rhs(t, y,
        memory)``, ``rhs(t, y, memory, params)`` or in place ``rhs(t, y, memory, dy, params)``.
        `jac` has the same third argument. Orders must be below the highest order of their
        component.
    jac_memory : callable, optional
        The derivatives of `rhs` by ``memory.ravel()``, shape (d, k d), with the arguments of `jac`.
        If `rhs` reads memory, give both or none.
    t_start : float, optional
        Time at which y0 is given and the memory starts; 0 by default [time].
    linear : array_like or SciPy sparse matrix, shape (d, d), optional
        Constant matrix A: the right side is ``A y + rhs(t, y)``, or A y if `rhs` is None. If the
        code of `rhs` reads no value of y, but at most its size, the Jacobian has A's entries alone.
    bandwidth : (int, int), optional
        Numbers of diagonals of d rhs / d y below and above the main one. Then `jac` fills, or
        returns, shape (lower + upper + 1, d) as `scipy.linalg.solve_banded` has it,
        ``ab[upper + i - j, j] = d rhs[i] / d y[j]``.
    jac_sparsity : array_like or SciPy sparse matrix, shape (d, d), optional
        Entries of d rhs / d y that may differ from 0. Then `jac` fills, or returns, their values in
        the order of the pattern's data, or returns SciPy's matrices. With `bandwidth` or
        `jac_sparsity` a system of 10^5 components needs no dense matrix. Differences then use
        groups of columns; LAPACK factorises bands, and SuperLU other patterns. A pattern that lacks
        entries near y0 is refused.
    d : int, optional
        Number of components in a row of y0. If it is given, y0 may have more rows than the orders
        need; further rows are ignored. So an order may cross 1 in a sweep or a fit.

    Attributes
    ----------
    d : int
        Number of real components; a complex one counts as two.
    m : int
        Number of initial conditions of the system that is solved: ceil(highest order) up to order
        2. Above order 2 it is 1, because derivatives of y are further components of that system.
    orders, coefficients : ndarray, shape (n_terms, d)
        Order and coefficient of each Caputo term of constant order, for each component. If one
        coefficient is a matrix, coefficients have the shape (n_terms, d, d).
    y0 : ndarray, shape (m, d)
        Initial values of the system that is solved. The real and the imaginary part of a complex
        value are two components, next to each other.
    params : ndarray, shape (p,)
        The p parameters of `rhs` and `jac`.
    system : System
        The form of the equation that schemes and steppers solve; its times count from t_start.
    terms, rhs, jac, memory, jac_memory, linear, bandwidth, jac_sparsity
        The arguments. No attribute and no array can be changed: `replace` makes another equation.

    Raises
    ------
    TypeError, ValueError
        Each message names the argument, what was required and what arrived.

    Examples
    --------
    >>> import numpy as np
    >>> import hereditary as hd
    >>> eq = hd.Equation([hd.Caputo(1.5), 0.5 * hd.Caputo(0.5)], lambda t, x: -x, y0=[1.0, 0.0])
    >>> eq.d, eq.m
    (1, 2)

    Diffusion on 1,000 points of a line, D^0.7 u = u_xx:

    >>> import scipy.sparse
    >>> parts = [np.ones(999), -2 * np.ones(1000), np.ones(999)]
    >>> laplacian = 1001**2 * scipy.sparse.diags_array(parts, offsets=[-1, 0, 1])
    >>> u0 = np.sin(np.pi * np.arange(1, 1001) / 1001)
    >>> eq = hd.Equation(hd.Caputo(0.7), None, u0, linear=laplacian)
    >>> sol = hd.solve(eq, 1.0, 1000, scheme=hd.BDF(2))
    >>> sol.stats["n_factorised"]
    1

    Van der Pol's friction acts on a derivative of order 0.8:

    >>> def rhs(t, x, memory):
    ...     return (1 - x[0] ** 2) * memory[0, 0] - x[0]
    >>> eq = hd.Equation(hd.Caputo(1.8), rhs, [0.5, 0.0], memory=hd.Caputo(0.8))
    >>> sol = hd.solve(eq, 20.0, 4000, scheme=hd.BDF(2))
    """

    def __init__(
        self,
        terms: Summand | Iterable[Summand],
        rhs: Callable | None,
        y0: ArrayLike,
        params: ArrayLike = (),
        jac: Callable | None = None,
        *,
        memory: Summand | Delay | Iterable[Summand | Delay] = (),
        jac_memory: Callable | None = None,
        t_start: float = 0.0,
        d: int | None = None,
        linear: Any = None,
        bandwidth: tuple[int, int] | None = None,
        jac_sparsity: Any = None,
    ) -> None:
        self.terms, self.memory = statement.as_terms(terms), statement.read_memory(memory)
        self.rhs, self.jac, self.jac_memory = rhs, jac, jac_memory
        self.linear, self.jac_sparsity, self.bandwidth = linear, jac_sparsity, bandwidth
        initial = self._initial = statement.initial_of(y0, self.terms, d)
        self.t_start = real("t_start", t_start)
        factors = statement.factors_of(self.terms, initial.d, initial.paired)
        self.orders = statement.orders_of(self.terms, initial.d, initial.paired)
        self.coefficients = factors[[term.operator.constant for term in self.terms]]
        self.coefficients.flags.writeable = False
        pasts = pasts_of(self.memory, initial.values[0], self.t_start)
        start = statement.start_of(initial, pasts, _numbers(params), self.t_start)
        info = self._stated(initial, factors.ndim > 2)
        functions = self._assembled(info, initial, start)
        made, structure = functions.functions._replace(start=self.t_start), None
        if info is not None:
            made, structure = info.assembled(made, start.components().size)
        if made.has_jac or structure is not None:
            check_jacobian(made, start.components(), structure)
        made, delays = reading(made, pasts)
        self._constants = info.constants() if info else ()
        self._in_python = bool(functions.callbacks)
        self._frozen = self._present_values()
        self.system = self._system_of(
            statement.left_side(self.terms, factors, self.orders, self.t_start),
            made,
            structure=structure,
            matrix=info and info.linear,
            linear_alone=rhs is None,
            callbacks=functions.callbacks,
            delays=delays,
            rhs_digest=self._digest_of_rhs(),
        )

    @property
    def d(self) -> int:
        """Number of real components; a complex one counts as two."""
        return self.system.n_solved

    @property
    def m(self) -> int:
        """Number of initial conditions of the system that is solved."""
        return self.system.m

    @property
    def y0(self) -> np.ndarray:
        """Initial values of the system that is solved, shape (m, d)."""
        return self.system.y0[:, : self.d]

    @property
    def params(self) -> np.ndarray:
        """Parameters, shape (p,)."""
        return self.system.params

    def _stated(self, initial: statement.Initial, matrices: bool) -> JacobianInfo | None:
        """Check what is stated of the Jacobian, and return it as `JacobianInfo` or None."""
        # matrices: whether coefficients of the terms are matrices
        if self.rhs is not None and self.linear is self.bandwidth is self.jac_sparsity is None:
            return None
        self.linear, self.jac_sparsity = copied(self.linear), copied(self.jac_sparsity)
        rearranged = len(initial.values) > 2 or matrices or initial.paired or bool(self.memory)
        stated = self.bandwidth, self.jac_sparsity, self.linear
        return jacobian_info(initial.d, self.rhs, self.jac, rearranged, *stated)

    def _assembled(
        self, info: JacobianInfo | None, initial: statement.Initial, start: Start
    ) -> Assembled:
        """Check the functions at the start and return them, compiled where numba can."""
        entries = info.values_of(self.jac, start) if info else self.jac
        hint = partial(statement.of_shorthand, initial, bool(self.memory))
        shape = info and info.shape
        return functions_of(self.rhs, entries, self.jac_memory, start, hint, shape)

    def _system_of(self, left: list[SystemTerm], functions: Functions, **fields: Any) -> System:
        """Return the system to solve, without matrices as coefficients and orders above 2."""
        y0 = self._initial.needed(left)
        kept = [term for term in self.memory if not isinstance(term, Delay)]
        statement.check_leading(left, y0, bool(kept))
        if fields["delays"]:
            pasts = [each.past.delay for each in fields["delays"]]
            fields["terms_digest"] = digest([(delay.tau, delay.past) for delay in pasts])
        if len(y0) > 2 or left[0].coefficients.ndim > 1:
            if self.memory:
                required = "be left out with orders above 2 and with matrices as coefficients"
                remedy = "write the equation as a system of y and its derivatives"
                refuse("memory", required, repr(self.memory), remedy)
            fields["terms_digest"] = digest([(operator.order, c) for operator, c in left])
            system, speeds = chained(left, y0, functions)
            frame = Frame(self.t_start, self._initial.paired, tuple(speeds.tolist()))
            system = replace(system, frame=frame, **fields)
        else:
            frame = Frame(self.t_start, self._initial.paired)
            system = System(left, y0, functions, frame=frame, **fields)
        system = statement.with_memory(system, kept) if kept else system
        system.y0.flags.writeable = False
        return system

    def __repr__(self) -> str:
        read = f", memory=[{', '.join(map(repr, self.memory))}]" if self.memory else ""
        return f"Equation({' + '.join(map(repr, self.terms))} = rhs, d={self.d}{read})"

    def _repr_html_(self) -> str:
        return formula(self)

    def __setattr__(self, name: str, value: Any) -> None:
        if "system" in self.__dict__:  # the equation is complete
            remedy = f"eq.replace({name}=...)" if name in _GIVEN else "eq.replace(...)"
            raise AttributeError(
                f"{name} of an Equation cannot be changed; make another equation with {remedy}"
            )
        object.__setattr__(self, name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        return _made, (self._arguments(),)

    def replace(self, **changes: Any) -> Equation:
        """Return an equation like this one with some of its arguments changed.

        Parameters
        ----------
        **changes
            Any arguments of `Equation`. An unchanged rhs is not compiled again. A new rhs needs a
            new jac if the equation has one, or None for differences.

        Examples
        --------
        >>> import hereditary as hd
        >>> eq = hd.Equation(hd.Caputo(0.5), lambda t, y, p: -p[0] * y, 1.0, params=[1.0])
        >>> eq.replace(params=[2.0]).params
        array([2.])
        """
        unknown = changes.keys() - set(_GIVEN)
        if unknown:
            required = f"be among {', '.join(_GIVEN)}"
            refuse("changes", required, ", ".join(sorted(unknown)), kind=TypeError)
        if changes.keys() == {"params"}:
            found = self._with_params(_numbers(changes["params"]))
            if found is not None:
                return found
        for name in ("jac", "jac_memory"):
            if "rhs" in changes and getattr(self, name) is not None and "jac" not in changes:
                refuse(name, "come with another rhs", "rhs alone", "or jac=None for differences")
        if "jac" in changes:  # which are given together
            changes = {"jac_memory": None} | changes
        return Equation(**(self._arguments() | changes))

    def _with_params(self, params: np.ndarray) -> Equation | None:
        """Return the equation with other parameters; None if functions must be checked again."""
        # the functions were checked before, so one call of the right-hand side is enough
        system = self.system
        alone = not system.reads and system.structure is None and not self._in_python
        same = params.size == system.functions.params.size
        if not alone or not same or self._present_values() != self._frozen:
            return None
        system = with_params(system, params)
        try:
            out = system.rhs(0.0, system.y0[0])
        except Exception:  # the checks of a new equation report it
            return None
        if not np.isfinite(out).all():
            return None
        found = Equation.__new__(Equation)
        vars(found).update(vars(self), system=system)
        return found

    def _arguments(self) -> dict[str, Any]:
        """Return the arguments that make this equation."""
        own = {"y0": self._initial.given, "d": self._initial.stated_d}
        return {name: getattr(self, name) for name in _GIVEN} | own

    def jacobian(self, t: float, y: ArrayLike) -> Any:
        """Return d rhs / d y at (t, y), shape (d, d), by `jac` or by differences, with `linear`.

        y (d,) has real components. With `bandwidth`, `jac_sparsity` or `linear` the result may be a
        sparse CSR array of SciPy.
        """
        if self.system.reads or self.system.delays:
            required = "read no memory where its Jacobian by y alone is asked for"
            refuse("rhs", required, "memory", "or take differences of rhs(t, y, memory)")
        try:
            return self.system.derivative(t - self.t_start, y)
        except PythonRaised as error:
            raise original(error) from None

    def current(self) -> Equation:
        """Return this equation with the present globals and closed-over values of its functions."""
        # the same object if no value has changed since it was made
        return self if self._present_values() == self._frozen else self.replace()

    def _digest_of_rhs(self) -> str:
        """Return the digest of the right-hand side, from frozen values if these determine it."""
        if self._in_python or self._constants or self.rhs is None:
            return digest(self.rhs, *self._constants)
        return digest_of_compiled(self._frozen[0], self.rhs)

    def _present_values(self) -> Any:
        """Return the values that the functions read now, to notice changes."""
        functions = self.rhs, self.jac, self.jac_memory
        if self._in_python:  # its objects may contain anything
            return digest(*functions)
        return tuple(map(present_values, functions))


def _made(arguments: dict[str, Any]) -> Equation:
    """Return the equation with these arguments: the function that unpickles it."""
    return Equation(**arguments)


# Names of the arguments of an equation.
_GIVEN = (
    "terms", "rhs", "y0", "params", "jac", "memory", "jac_memory", "t_start", "d", "linear",
    "bandwidth", "jac_sparsity",
)  # fmt: skip


def _numbers(params: ArrayLike) -> np.ndarray:
    """Return the parameters as a flat array; a number becomes one parameter."""
    remedy = "pass a flat sequence of floats"
    values = real_array("params", params, remedy=remedy)
    if values.ndim > 1:
        refuse("params", "be a number or a flat sequence of floats", f"shape {values.shape}")
    return values.reshape(-1)


def current_equation(equation: Any) -> Equation:
    """Return `equation.current()`; refuse an argument that is not an `Equation`."""
    return instance("equation", equation, Equation, "hereditary.Equation(terms, rhs, y0)").current()
