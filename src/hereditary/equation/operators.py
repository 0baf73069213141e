"""Memory operators, which the user adds and multiplies to the terms of an equation.

A memory operator maps y to ``int_0^t K(t-s) y^(m)(s) ds`` with a kernel K. Caputo's derivative of
order alpha has m = ceil(alpha) and ``K(t) = t**(m-1-alpha) / Gamma(m-alpha)``. For integer alpha it
is the classical derivative, without memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gamma

from ..kernels.memory_kernel import MemoryKernel, ScaledKernel
from ..kernels.named_kernels import PowerLaw
from ..support.checks import instance, one_of, real_array, refuse, shown
from .orders import HIGHEST, ROUNDING, derivative_order, rounded_order
from .terms import CAPUTO, ConstantOrder, Definition, KernelOperator, Parts, VaryingOrder

# Remedy for a negative order, which means a fractional integral.
_INTEGRAL = (
    "the fractional integral of order a, 0 < a < 1, is "
    "Memory(PowerLaw(1 - a) / scipy.special.gamma(a), 0), also in hereditary.derivative"
)


class Summand:
    """A part of an equation's left-hand side, which can be scaled and added to other parts."""

    # tells NumPy to leave `array * Caputo(...)` to __rmul__ instead of multiplying entry by entry
    __array_ufunc__ = None

    def _terms(self) -> tuple[Term, ...]:
        raise NotImplementedError

    def __mul__(self, factor: ArrayLike) -> Term | Terms:
        return _summed([term.times(factor) for term in self._terms()])

    __rmul__ = __mul__

    def __truediv__(self, divisor: ArrayLike) -> Term | Terms:
        values = real_array("divisor", divisor, "be a real number or have shape (d,)")
        if np.any(values == 0):
            refuse("divisor", "be other than 0", shown(values))
        return self * (1 / values)

    def __neg__(self) -> Term | Terms:
        return self * -1.0

    def __pos__(self) -> Self:
        return self

    def __add__(self, other: Summand) -> Terms:
        return Terms([*self._terms(), *_summand(other)._terms()])

    def __radd__(self, other: int | Summand) -> Terms:
        # Python's sum([...]) adds the first term to 0
        if isinstance(other, int) and other == 0:
            return Terms(self._terms())
        return _summand(other) + self

    def __sub__(self, other: Summand) -> Terms:
        return self + -_summand(other)

    def __rsub__(self, other: Summand) -> Terms:
        return _summand(other) - self


def _summand(other: Any) -> Summand:
    """Return what is added to a term, or taken from it; refuse anything but terms."""
    remedy = "what has no derivative, such as a y or a force, stands in rhs, on the right side"
    if not isinstance(other, Summand):
        required = "be terms with memory, such as Caputo(1) and 0.5 * Memory(kernel, 1)"
        refuse("summands", required, repr(other), remedy, kind=TypeError)
    return other


class Terms(Summand):
    """Several terms, made by adding operators: ``Caputo(1.8) + 0.25 * Caputo(0.8)``."""

    def __init__(self, terms: Iterable[Term]) -> None:
        self.terms = tuple(terms)

    def _terms(self) -> tuple[Term, ...]:
        return self.terms

    def __iter__(self) -> Iterator[Term]:
        return iter(self.terms)

    def __len__(self) -> int:
        return len(self.terms)

    def __repr__(self) -> str:
        return " + ".join(map(repr, self.terms))


def _summed(terms: Sequence[Term]) -> Term | Terms:
    return terms[0] if len(terms) == 1 else Terms(terms)


class Caputo(Summand):
    r"""Caputo's derivative of y, a memory operator with a power-law kernel.

    .. math::

        D^\alpha y(t) = \frac{1}{\Gamma(m-\alpha)} \int_0^t (t-s)^{m-1-\alpha}\, y^{(m)}(s)\, ds

    Multiply it by a coefficient to make a term of an equation: ``0.25 * Caputo(0.8)``.

    Parameters
    ----------
    order : float, array_like of shape (d,), or callable
        Order alpha above 0 [-], one for all components or one for each (an incommensurate system);
        m = ceil(alpha). Integers give the classical derivative exactly. A function ``alpha(t)`` of
        time is an order that varies: all its values are in (0, 1], or all in (1, 2]. An equation
        with orders above 2 is solved as a system of y and its derivatives. All orders of such an
        equation must be constant.

    Notes
    -----
    If the order varies, the order at the present time applies to the whole past: alpha is alpha(t)
    everywhere in the definition. For the whole run m is 1 or 2. Definitions with alpha(s) or
    alpha(t-s) inside the integral are other operators. `ExplicitCaputo`, `L1` and `Collocation`
    accept such terms, together with all other terms that they accept. The function is called in
    Python, if possible with an array of times; write it with NumPy.

    Limits at integers: as alpha -> 2 from below the operator tends to y''. As alpha -> 1 it tends
    to y' - y'(0) from above and to y' from below. As alpha -> 0 it tends to y - y(0). A family of
    equations that crosses alpha = 1 is discontinuous there unless y'(0) = 0.

    Examples
    --------
    >>> import hereditary as hd
    >>> 0.25 * hd.Caputo(0.8)
    0.25 * Caputo(0.8)
    >>> import numpy as np
    >>> terms = [hd.Caputo(lambda t: 1.5 + 0.3 * np.cos(t)), 0.2 * hd.Caputo(0.5)]
    >>> sol = hd.solve(hd.Equation(terms, lambda t, x: -x, y0=[1.0, 0.0]), 10.0, n_steps=1000)
    >>> sol.success
    True
    """

    definition: ClassVar[Definition] = CAPUTO

    def __init__(self, order: ArrayLike | Callable) -> None:
        self.varying: VaryingOrder | None = None
        if callable(order):
            self.varying = VaryingOrder.from_function(order, self.definition)
            return
        orders = real_array("order", order, "be above 0", "give a number or one per component")
        orders = rounded_order(orders)
        if orders.ndim > 1 or orders.size == 0:
            refuse("order", "be a number or have shape (d,)", f"shape {orders.shape}")
        if ((orders <= 0) | (orders > HIGHEST)).any():
            required, remedy = f"lie in (0, {HIGHEST}]", _INTEGRAL if np.all(orders < 0) else ""
            refuse("order", required, orders.tolist(), remedy)
        orders.flags.writeable = False
        self._order = orders

    @property
    def order(self) -> float | np.ndarray | Callable:
        """The order: a float, an array of shape (d,), or a function of the time."""
        if self.varying is not None:
            return self.varying.function
        return self._order if self._order.ndim else float(self._order)

    @property
    def derivative(self) -> int:
        """m, the highest derivative of y inside the integral: ceil of the highest order."""
        if self.varying is not None:
            return self.varying.derivative
        return max(map(derivative_order, self._order.flat))

    @property
    def constant(self) -> bool:
        """Whether the order does not vary."""
        return self.varying is None

    def parts(self, orders: np.ndarray, origin: float = 0.0) -> Parts:
        """Return pairs of an operator and which components (d,) have it, True for all."""
        # orders (d,): those of the components after rounding, ignored if the order varies; origin:
        # the user's time at time 0 of the operator
        if self.varying is not None:
            return [(replace(self.varying, origin=origin), True)]
        distinct = dict.fromkeys(orders.tolist())
        return [(ConstantOrder(a, self.definition), orders == a) for a in distinct]

    def __repr__(self) -> str:
        order = self.varying.name if self.varying else self._order.tolist()
        return f"{self.definition.name}({order})"

    def _terms(self) -> tuple[Term, ...]:
        return (Term(self, 1.0),)


class RiemannLiouville(Caputo):
    """Riemann and Liouville's derivative of order below 1, ``d/dt J**(1-gamma) y``.

    J is the integral from 0. The derivative is ``Caputo(gamma) y + y(0) t**-gamma /
    Gamma(1-gamma)``: y counts as 0 before the start. Multiply it by a coefficient to make a term of
    an equation. The equation needs a Caputo term of higher order too, whose initial values are y(0)
    and y'(0).

    Parameters
    ----------
    order : float, array_like of shape (d,), or callable
        gamma in (0, 1) [-], below the highest order of its component. If that order exceeds 1,
        gamma must be below it by more than 1, because y'(0) would be infinite otherwise. A function
        ``gamma(t)`` of time is an order that varies.

    Notes
    -----
    The contribution of y(0) is infinite at t = 0, and schemes never sample it there. `Collocation`
    integrates it exactly. With fixed steps the first samples of the contribution are corrected so
    that their sum is its integral. `ExplicitCaputo`, `GrunwaldLetnikov` and `L1` have the same
    orders of convergence as for solutions like t**alpha. ``BDF(p)`` has order p for f linear in y,
    otherwise min(p, 1 + 2 (alpha - gamma)), with the highest order alpha. `L2` and `L12` have order
    1 - gamma, and the full order on a mesh ``graded(n, order / (1 - gamma))``. `L2Sigma` stays
    below order 1 on uniform steps (convergence/riemann_liouville.py).

    Examples
    --------
    >>> import hereditary as hd
    >>> terms = hd.Caputo(2) + 0.5 * hd.RiemannLiouville(0.5)
    >>> sol = hd.solve(hd.Equation(terms, lambda t, x: -x, y0=[1.0, 0.0]), 10.0, rtol=1e-8)
    >>> sol.success
    True
    """

    definition = Definition(
        "RiemannLiouville",
        mark="<sub>RL</sub>",
        subtracts_start=False,
        instead="for C RiemannLiouville(gamma) below Caputo(alpha) solve D^alpha w = f and "
        "D^(alpha - gamma) v = y from w = y(0), v = 0, where y = w - C v",
    )

    def __init__(self, order: ArrayLike | Callable) -> None:
        super().__init__(order)
        required = "lie in (0, 1) with RiemannLiouville"
        if self.varying is not None:
            if self.varying.derivative > 1:
                refuse("order", required, f"above 1 in {self.varying.name}")
        elif np.any(self._order >= 1):
            refuse("order", required, self._order.tolist())


class Memory(Summand):
    """The memory operator ``int_0^t K(t-s) y^(m)(s) ds`` with any decaying kernel K.

    Multiply it by a coefficient to make a term of an equation: ``0.5 * Memory(kernel, 1)``.

    Parameters
    ----------
    kernel : MemoryKernel
        `PowerLaw`, `TemperedPowerLaw`, `Prony`, `MittagLeffler`, `StretchedExponential`,
        `DistributedOrder`, or `Kernel` for any other function. It must be integrable at 0. A sum of
        exponentials from `fit_exponentials` is used unchanged, in runs up to its t_max. Such a sum
        has no singularity at 0, so it differs from a singular kernel before its t_min.
    derivative : int
        m, the derivative of y inside the integral: 0, 1 or 2.

    Notes
    -----
    With ``PowerLaw(a)``, 0 < a < 1, this is ``Gamma(1-a) Caputo(m - 1 + a)`` and is solved as
    such. So ``Memory(PowerLaw(beta - 1) / Gamma(2 - beta), 2)`` is ``Caputo(beta)``, 1 < beta < 2.

    Examples
    --------
    >>> import hereditary as hd
    >>> 0.5 * hd.Memory(hd.Prony([1.0, 10.0], [0.3, 0.7]), 1)
    0.5 * Memory(Prony(rates=(1.0, 10.0), weights=(0.3, 0.7)), 1)
    """

    def __init__(self, kernel: MemoryKernel, derivative: int) -> None:
        remedy = "e.g. hereditary.PowerLaw(0.8)"
        self.kernel = instance("kernel", kernel, MemoryKernel, remedy)
        if kernel.singular_exponent >= 1:
            required, got = "be integrable at 0", f"{kernel!r}"
            refuse("kernel", required, got, "take an exponent below 1, with one derivative more")
        if isinstance(derivative, bool):
            refuse("derivative", "be 0, 1 or 2", derivative)
        self.derivative = one_of("derivative", derivative, (0, 1, 2), "be 0, 1 or 2")

    constant = False
    definition = Definition("Memory")

    def parts(self, orders: np.ndarray, origin: float = 0.0) -> Parts:
        """Return the operator of a `System`, which every component has; ignore the arguments."""
        return [(KernelOperator(self.kernel, self.derivative), True)]

    def __repr__(self) -> str:
        return f"Memory({self.kernel!r}, {self.derivative})"

    def _terms(self) -> tuple[Term, ...]:
        return (Term(self, 1.0),)


class Term(Summand):
    """A coefficient times a memory operator; made by multiplication, ``0.25 * Caputo(0.8)``."""

    def __init__(self, operator: Caputo | Memory, coefficient: ArrayLike) -> None:
        required = "be a real number or have shape (d,) or (d, d)"
        remedy = "it cannot vary; let the right-hand side read the term: Equation(..., memory=)"
        factor = real_array("coefficient", coefficient, required, remedy)
        square = factor.ndim < 2 or factor.shape == factor.shape[:1] * 2
        if not square or factor.size == 0:
            refuse("coefficient", required, f"shape {factor.shape}")
        factor.flags.writeable = False
        # Caputo or Memory, whose attributes differ
        self.operator: Any = operator
        self.coefficient = factor

    def _terms(self) -> tuple[Term, ...]:
        return (self,)

    def times(self, factor: ArrayLike) -> Term:
        """Return this term with `factor` times its coefficient, a matrix from the left."""
        checked, own = Term(self.operator, factor).coefficient, self.coefficient
        if checked.ndim == 2 and own.ndim:
            return Term(self.operator, checked @ (own if own.ndim == 2 else np.diag(own)))
        if checked.ndim == 1 and own.ndim == 2:
            return Term(self.operator, checked[:, None] * own)
        return Term(self.operator, checked * own)

    def plain(self) -> Term:
        """Return an equal term in the simplest form."""
        # the coefficient gets a kernel's factor; a power law of m > 0 becomes Caputo's derivative
        operator, coefficient = self.operator, self.coefficient
        if not isinstance(operator, Memory):
            return self
        kernel, m = operator.kernel, operator.derivative
        if isinstance(kernel, ScaledKernel):
            coefficient, kernel = kernel.factor * coefficient, kernel.kernel
        if isinstance(kernel, PowerLaw) and m:
            a = float(kernel.exponent)
            if m == 2 and a <= ROUNDING:  # order 1 would be y', not y' - y'(0)
                required = f"exceed {ROUNDING} for derivative 2"
                refuse("exponent", required, a, "take derivative 1 less y'(0)")
            return Term(Caputo(m - 1 + a), gamma(1 - a) * coefficient)
        return Term(Memory(kernel, m), coefficient)

    def __repr__(self) -> str:
        return f"{self.coefficient.tolist()} * {self.operator!r}"
