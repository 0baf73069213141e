"""Memory kernels and memory operators, and the terms they make (floor 2).

A memory operator sends y to ``int_0^t K(t-s) y^(m)(s) ds``. Caputo's derivative of order alpha is
the one with m = ceil(alpha) and ``K(t) = t**(m-1-alpha) / Gamma(m-alpha)``; for integer alpha it
is the classical derivative and has no memory.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gamma

from ._checks import complaint, instance, real, real_array, within
from .exponential_sum import fit_interval, fit_power
from .memory_kernel import ExponentialSum, MemoryKernel, ScaledKernel


@dataclass(frozen=True)
class PowerLaw(MemoryKernel):
    """The memory kernel ``K(t) = t**-exponent``.

    Parameters
    ----------
    exponent : float
        0 < exponent <= 2 [-]. Caputo's derivative of order alpha in (0, 1) has exponent alpha,
        of order beta in (1, 2) exponent beta - 1.

    Examples
    --------
    >>> import hereditary as hd
    >>> float(hd.PowerLaw(0.5)(4.0))
    0.5
    """

    exponent: float

    def __post_init__(self):
        remedy = "K(t) is t**-exponent; Caputo(beta) with 1 < beta < 2 has beta - 1"
        within("exponent", self.exponent, 5e-324, 2.0, "(0, 2]", remedy)

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Kernel values, the shape of `t`."""
        return np.asarray(t, dtype=float) ** -self.exponent

    @property
    def singular_exponent(self) -> float:
        """The exponent itself."""
        return float(self.exponent)

    def integral(self, t: ArrayLike) -> np.ndarray:
        """``int_0^t K`` = t**(1 - exponent) / (1 - exponent), for exponents below 1."""
        a = float(self.exponent)
        if a >= 1:
            raise ValueError(complaint("exponent", "be below 1 for a finite integral from 0", a))
        return np.asarray(t, dtype=float) ** (1 - a) / (1 - a)

    def fit(self, t_min: float, t_max: float, tol: float) -> ExponentialSum:
        """The kernel as a sum of exponentials; see `fit_exponentials`."""
        return fit_power(float(self.exponent), *fit_interval(t_min, t_max, tol))


class Caputo:
    """Caputo's derivative, ``D^alpha y = 1/Gamma(m-alpha) int_0^t (t-s)**(m-1-alpha) y^(m)(s) ds``.

    Multiply it by a coefficient to make a term of an equation: ``0.25 * Caputo(0.8)``.

    Parameters
    ----------
    order : float, array_like of shape (d,), or callable
        Order alpha in (0, 2] [-], one for all components or one for each (an incommensurate
        system); m = ceil(alpha). Integers give the classical derivative exactly. A function
        ``alpha(t)`` of the time gives an order that varies: all its values in (0, 1], or all in
        (1, 2].

    Notes
    -----
    An order that varies is taken at the present time, for all of the past: ``D^alpha(t) y(t) =
    1/Gamma(m-alpha(t)) int_0^t (t-s)**(m-1-alpha(t)) y^(m)(s) ds`` with one m for the whole run,
    1 or 2. (Other definitions in use, with alpha(s) or alpha(t-s) inside the integral, are other
    operators.) `ExplicitCaputo`, `L1` and `Collocation` take such terms, beside any they take
    without. The function is called from Python, with an array of times where it bears that; write
    it with NumPy.

    Limits, for whoever continues a model through an integer: as alpha -> 2 from below the operator
    tends to y''; as alpha -> 1 from above to y' - y'(0), from below to y'; as alpha -> 0 to
    y - y(0). A family of equations that crosses alpha = 1 is discontinuous there unless y'(0) = 0.

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

    # without this NumPy would take `array * Caputo(...)` apart, entry by entry
    __array_ufunc__ = None

    def __init__(self, order: ArrayLike | Callable) -> None:
        self.varying = VaryingOrder.begun(order) if callable(order) else None
        if self.varying is not None:
            return
        remedy = "Caputo orders above 2 are not covered; write the equation as a system"
        orders = real_array("order", order, "lie in (0, 2]", "give a number or one per component")
        if orders.ndim > 1 or orders.size == 0:
            raise ValueError(
                complaint("order", "be a number or have shape (d,)", f"shape {orders.shape}")
            )
        if np.any(orders <= 0) or np.any(orders > 2):
            raise ValueError(complaint("order", "lie in (0, 2]", orders.tolist(), remedy))
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
        """m, the highest derivative inside: ceil(order) of the highest order."""
        if self.varying is not None:
            return self.varying.derivative
        return max(map(derivative_order, self._order.flat))

    def __repr__(self):
        return f"Caputo({self.varying.name if self.varying else self._order.tolist()})"

    def __mul__(self, coefficient: ArrayLike) -> Term:
        return Term(self, coefficient)

    __rmul__ = __mul__

    def __neg__(self) -> Term:
        return Term(self, -1.0)


class OrderFailed(ValueError):
    """An order that varies left its range, or its function raised."""


@dataclass(frozen=True)
class VaryingOrder:
    """An order that is a function of the time, and the Caputo operator with it.

    Attributes
    ----------
    function : callable
        ``function(t)``, the order at time t.
    derivative : int
        m, 1 or 2: orders lie in (m - 1, m].
    origin : float
        The time that is called 0 [time].
    """

    function: Callable
    derivative: int
    origin: float = 0.0

    @classmethod
    def begun(cls, function: Callable) -> VaryingOrder:
        """The operator of a user's function, whose value at 0 tells m."""
        required = "be a function order(t) with values in (0, 1], or in (1, 2]"
        try:
            start = function(0.0)
        except Exception as error:
            got = f"{type(error).__name__} at t = 0: {error}"
            raise ValueError(complaint("order", required, got)) from error
        value = real("order", np.asarray(start)[()], required)
        if not 0 < value <= 2:
            raise ValueError(complaint("order", required, f"{value} at t = 0"))
        return cls(function, derivative_order(value))

    @property
    def name(self) -> str:
        """What the function is called."""
        return getattr(self.function, "__name__", type(self.function).__name__)

    def later(self, origin: float) -> VaryingOrder:
        """The same with time counted from `origin`, in the user's time."""
        return replace(self, origin=origin)

    def sampled(self, times: np.ndarray) -> tuple[np.ndarray, str]:
        """Orders at increasing times (n,), up to the first bad one, and what is wrong with that.

        Returns
        -------
        values : ndarray, shape (k,)
            All inside the range; k = n where all is well.
        trouble : str
            A sentence; empty where all is well.
        """
        times = times + self.origin
        values = self._at_once(times)
        reason = ""
        if values is None:
            values, reason = self._one_by_one(times)
        low, high = self.derivative - 1, self.derivative
        if not reason and values.size and values.min() > low and values.max() <= high:
            return values, ""
        good = (values > low) & (values <= high)
        k = values.size if good.all() else int(np.argmin(good))
        if k < values.size:
            reason = f"{values[k]}"
        if not reason:
            return values, ""
        required = f"stay in ({low}, {high}], where it is at t = 0"
        return values[:k], complaint("order", required, f"{reason} at t = {times[k]:.6g}")

    def _at_once(self, times):
        """Its values from one call, or None where it does not take arrays of times."""
        try:
            # a function may write into what it is given
            values = np.broadcast_to(np.asarray(self.function(times.copy())), times.shape)
            if values.dtype.kind not in "iuf":
                return None
            some = sorted({0, times.size // 2, times.size - 1})
            alone = np.array([float(self.function(float(times[i]))) for i in some])
        except Exception:  # whatever it is: one by one will tell
            return None
        close = np.abs(values[some] - alone) <= 1e-12 * np.abs(alone)
        return np.asarray(values, dtype=float) if close.all() else None

    def _one_by_one(self, times):
        """Its values up to the first call that fails, and how that failed."""
        values = np.empty(times.size)
        for i, t in enumerate(times.tolist()):
            try:
                values[i] = float(self.function(t))
            except Exception as error:
                return values[:i], f"{type(error).__name__}: {error}"
        return values, ""


class Memory:
    """The memory operator ``int_0^t K(t-s) y^(m)(s) ds`` with any decaying kernel K.

    Multiply it by a coefficient to make a term of an equation: ``0.5 * Memory(kernel, 1)``.

    Parameters
    ----------
    kernel : MemoryKernel
        `PowerLaw`, `TemperedPowerLaw`, `Prony`, `MittagLeffler`, `StretchedExponential`,
        `DistributedOrder`, or `Kernel` for any other; integrable at 0.
    derivative : int
        m: 0, 1 or 2.

    Notes
    -----
    With ``PowerLaw(a)``, 0 < a < 1, this is ``Gamma(1-a) Caputo(m - 1 + a)``, and taken for that;
    so ``Memory(PowerLaw(beta - 1) / Gamma(2 - beta), 2)`` is ``Caputo(beta)``, 1 < beta < 2.

    Examples
    --------
    >>> import hereditary as hd
    >>> 0.5 * hd.Memory(hd.Prony([1.0, 10.0], [0.3, 0.7]), 1)
    0.5 * Memory(Prony(rates=(1.0, 10.0), weights=(0.3, 0.7)), 1)
    """

    __array_ufunc__ = None

    def __init__(self, kernel: MemoryKernel, derivative: int) -> None:
        remedy = "e.g. hereditary.PowerLaw(0.8)"
        self.kernel = instance("kernel", kernel, MemoryKernel, remedy)
        if kernel.singular_exponent >= 1:
            required, got = "be integrable at 0", f"{kernel!r}"
            remedy = "take an exponent below 1, with one derivative more"
            raise ValueError(complaint("kernel", required, got, remedy))
        if isinstance(derivative, bool) or derivative not in (0, 1, 2):
            raise ValueError(complaint("derivative", "be 0, 1 or 2", derivative))
        self.derivative = int(derivative)

    def __repr__(self):
        return f"Memory({self.kernel!r}, {self.derivative})"

    def __mul__(self, coefficient: ArrayLike) -> Term:
        return Term(self, coefficient)

    __rmul__ = __mul__

    def __neg__(self) -> Term:
        return Term(self, -1.0)


class Term:
    """A coefficient times a memory operator; made by multiplication, ``0.25 * Caputo(0.8)``."""

    __array_ufunc__ = None

    def __init__(self, operator: Caputo | Memory, coefficient: ArrayLike) -> None:
        factor = real_array("coefficient", coefficient, "be a real number or have shape (d,)")
        if factor.ndim > 1 or factor.size == 0:
            required = "be a number or have shape (d,)"
            raise ValueError(complaint("coefficient", required, f"shape {factor.shape}"))
        factor.flags.writeable = False
        self.operator = operator
        self.coefficient = factor

    def __mul__(self, factor: ArrayLike) -> Term:
        return Term(self.operator, np.asarray(factor) * self.coefficient)

    __rmul__ = __mul__

    def __neg__(self) -> Term:
        return Term(self.operator, -self.coefficient)

    def plain(self) -> Term:
        """The same term with a kernel's factor in its coefficient, and a power law by Caputo's."""
        operator, coefficient = self.operator, self.coefficient
        if not isinstance(operator, Memory):
            return self
        kernel, m = operator.kernel, operator.derivative
        if isinstance(kernel, ScaledKernel):
            coefficient, kernel = kernel.factor * coefficient, kernel.kernel
        if isinstance(kernel, PowerLaw) and m:
            a = kernel.exponent
            return Term(Caputo(m - 1 + a), gamma(1 - a) * coefficient)
        return Term(Memory(kernel, m), coefficient)

    def __repr__(self):
        return f"{self.coefficient.tolist()} * {self.operator!r}"


def derivative_order(alpha: float) -> int:
    """m = ceil(alpha), the derivative inside Caputo's operator: 1 or 2."""
    return math.ceil(alpha)
