"""Memory kernels and memory operators, and the terms they make (floor 2).

A memory operator sends y to ``int_0^t K(t-s) y^(m)(s) ds``. Caputo's derivative of order alpha is
the one with m = ceil(alpha) and ``K(t) = t**(m-1-alpha) / Gamma(m-alpha)``; for integer alpha it
is the classical derivative and has no memory.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ._checks import complaint, real_array, within
from .exponential_sum import ExponentialSum, MemoryKernel, fit_interval, fit_power


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
        within("exponent", self.exponent, 5e-324, 2.0, "(0, 2]")

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
    order : float or array_like, shape (d,)
        Order alpha in (0, 2] [-], one for all components or one for each (an incommensurate
        system); m = ceil(alpha). Integers give the classical derivative exactly.

    Notes
    -----
    Limits, for whoever continues a model through an integer: as alpha -> 2 from below the operator
    tends to y''; as alpha -> 1 from above to y' - y'(0), from below to y'; as alpha -> 0 to
    y - y(0). A family of equations that crosses alpha = 1 is discontinuous there unless y'(0) = 0.

    Examples
    --------
    >>> import hereditary as hd
    >>> 0.25 * hd.Caputo(0.8)
    0.25 * Caputo(0.8)
    """

    # without this NumPy would take `array * Caputo(...)` apart, entry by entry
    __array_ufunc__ = None

    def __init__(self, order: ArrayLike) -> None:
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
    def order(self) -> float | np.ndarray:
        """The order: a float, or an array of shape (d,)."""
        return self._order if self._order.ndim else float(self._order)

    def __repr__(self):
        return f"Caputo({self._order.tolist()})"

    def __mul__(self, coefficient: ArrayLike) -> Term:
        return Term(self, coefficient)

    __rmul__ = __mul__

    def __neg__(self) -> Term:
        return Term(self, -1.0)


class Term:
    """A coefficient times a memory operator; made by multiplication, ``0.25 * Caputo(0.8)``."""

    __array_ufunc__ = None

    def __init__(self, operator: Caputo, coefficient: ArrayLike) -> None:
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

    def __repr__(self):
        return f"{self.coefficient.tolist()} * {self.operator!r}"


def derivative_order(alpha: float) -> int:
    """m = ceil(alpha), the derivative inside Caputo's operator: 1 or 2."""
    return math.ceil(alpha)
