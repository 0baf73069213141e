"""Memory operators of a system, as schemes and histories use them.

Each operator maps y to ``int_0^t K(t-s) y^(m)(s) ds``. K is Caputo's kernel of a constant order,
Caputo's kernel of an order that varies, or a general kernel. If the operator is a derivative of y
that does not subtract y(0), it adds ``K(t) y(0)``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy.special import rgamma

from ..kernels.memory_kernel import MemoryKernel
from ..kernels.step_kernel import Integrated, PowerSteps, StepKernel
from ..support.checks import complaint, real, refuse
from .orders import OrderFailed, derivative_order, rounded_order

# Argument s of a Laplace transform K^(s), so close to 0 that s K^(s) is the limit of the kernel K
# at late times: its constant part, if it has one.
_LATE_S = 1e-200 + 0j
# Second argument s, closer to 0, at which a kernel without constant part has a smaller s K^(s).
_LATER_S = 1e-250 + 0j
# Ratio of s K^(s) at `_LATER_S` to that at `_LATE_S` above which a kernel has a constant part.
_CONSTANT = 0.99


class SystemTerm(NamedTuple):
    """An operator and its coefficient for each component, (d,); 0 for components without it."""

    operator: Operator
    coefficients: np.ndarray


class Definition(NamedTuple):
    """Names of an operator, and what it does with y(0)."""

    name: str  # in messages
    mark: str = ""  # after D in a formula, as HTML
    subtracts_start: bool = True  # whether it acts on y - y(0); else on y, 0 before the start
    instead: str = ""  # what to solve if f would read it, which is refused; empty if f may


def derivative_of_one(order: Any) -> tuple[Any, Any]:
    """Return c and e: the derivative of y exceeds that of y - y(0) by ``c t**e y(0)``."""
    return rgamma(1 - order), -order


# That of Caputo's derivative.
CAPUTO = Definition("Caputo")


@dataclass(frozen=True)
class ConstantOrder:
    """A derivative of a constant order, with Caputo's kernel."""

    order: float  # alpha in (0, 2]
    definition: Definition = CAPUTO
    kernel: ClassVar[MemoryKernel | None] = None
    constant: ClassVar[bool] = True
    varies: ClassVar[bool] = False
    t_last: ClassVar[float] = math.inf

    def __str__(self) -> str:
        return f"{self.definition.name}({self.order:g})"

    def lower(self, k: int) -> ConstantOrder | None:
        """Return the operator that on y^(k) gives what this one gives on y; None if none does."""
        return ConstantOrder(self.order - k) if self.definition.subtracts_start else None

    def order_at(self, t: float) -> float:
        """Return its order at time t."""
        return self.order

    @property
    def derivative(self) -> int:
        """m = ceil(alpha)."""
        return derivative_order(self.order)

    @property
    def power(self) -> float:
        """p = m - alpha."""
        return self.derivative - self.order

    @property
    def classical(self) -> bool:
        """Whether it is y' or y'', without memory."""
        return self.order in (1.0, 2.0)

    def symbol(self, s: np.ndarray) -> np.ndarray:
        """Return ``s**alpha``, the factor on ``exp(s t)`` if memory starts at minus infinity."""
        return s**self.order

    def factor(self, h: float) -> float:
        """Return ``h**-alpha / Gamma(p + 1)``, which multiplies sums over increments of y."""
        # for m = 2 over differences of increments
        return float(h**-self.order * rgamma(self.power + 1))

    def rate(self, t_end: float) -> float:
        """Return its value at t_end over y there if the value is constant, as it is of t**alpha."""
        return math.gamma(1 + self.order) * t_end**-self.order

    def in_steps(self, h: float) -> PowerSteps:
        """Return the kernel ``p t**(p-1)``, with t in units of the step h."""
        return PowerSteps(self.power)

    def powers(self, times: np.ndarray) -> tuple[np.ndarray, str]:
        """Return p at all times, and "" for no error; see `VaryingOrder.powers`."""
        return np.full(times.size, self.power), ""

    def described(self, times: np.ndarray) -> object:
        """Return a description that can be compared: the order, with a name if not Caputo's."""
        return self.order if self.definition == CAPUTO else (self.definition.name, self.order)


@dataclass(frozen=True)
class KernelOperator:
    """Operator ``int_0^t K(t-s) y^(m)(s) ds`` with a general kernel."""

    kernel: MemoryKernel
    derivative: int  # m: 0, 1 or 2
    constant: ClassVar[bool] = False
    varies: ClassVar[bool] = False
    classical: ClassVar[bool] = False

    def __str__(self) -> str:
        return f"a Memory with {self.kernel!r}"

    @property
    def order(self) -> float:
        """m, the derivative of y inside the integral, as a float."""
        return float(self.derivative)

    @property
    def definition(self) -> Definition:
        """The name of the operator, and whether it acts on y - y(0)."""
        return Definition("Memory", subtracts_start=self.derivative > 0)

    def lower(self, k: int) -> KernelOperator:
        """Return the operator that on y^(k) gives what this one gives on y."""
        return KernelOperator(self.kernel, self.derivative - k)

    def order_at(self, t: float) -> float:
        """Return the order m - 1 + a like which a kernel acts that is like t**-a near 0."""
        return self.order + (self.kernel.singular_exponent - 1)

    @property
    def t_last(self) -> float:
        """Time up to which the kernel is known [time]."""
        return self.kernel.t_last

    def symbol(self, s: np.ndarray) -> np.ndarray:
        """Return ``s**m`` times the kernel's Laplace transform: the factor on ``exp(s t)``."""
        mean = _mean_symbol(self.kernel, self.derivative)
        with np.errstate(all="ignore"):  # at 0 a transform may be infinite
            return np.where(s == 0, mean, s**self.derivative * self.kernel.laplace(s))

    def factor(self, h: float) -> float:
        """Return what multiplies sums over increments of y, 1, or over their differences, 1/h."""
        return 1 / h if self.derivative == 2 else 1.0

    def rate(self, t_end: float) -> float:
        """Return its value at t_end over y there if y^(m) is constant."""
        integral = abs(float(self.kernel.integral(min(t_end, self.t_last))))
        return integral * t_end**-self.derivative

    def in_steps(self, h: float) -> StepKernel:
        """Return the kernel K(h t), or its integral if the operator acts on y itself."""
        return StepKernel(self.kernel if self.derivative else Integrated(self.kernel), h)

    def described(self, times: np.ndarray) -> object:
        """Return a description that can be compared: the kernel's text or several values, and m."""
        # an address differs in each process
        if not self.kernel.by_values and " at 0x" not in repr(self.kernel):
            return repr(self.kernel), self.derivative
        times = times[times > 0]
        values = self.kernel(times) if times.size else np.zeros(0)
        shown = ", ".join(f"{value:.9g}" for value in values)
        return f"{type(self.kernel).__name__}, {shown}", self.derivative


@lru_cache(maxsize=64)
def _mean_symbol(kernel: MemoryKernel, m: int) -> complex:
    """Return the factor of a term with y^(m) on the mean of a periodic y; refuse some kernels."""
    # Refused are kernels with a constant part, for which s K^(s) has a limit other than 0 as s
    # tends to 0, and for m = 0 those whose integral over all times is infinite or unknown.
    with np.errstate(all="ignore"):
        mean = 0.0 if m else complex(kernel.laplace(0j))
        late, later = (abs(s * kernel.laplace(s)) for s in (_LATE_S, _LATER_S))
    known = m > 0 or math.isinf(kernel.t_last)
    if not known or not np.isfinite(mean) or later > _CONSTANT * late:
        required = "fade" if m else "be integrable over all times"
        remedy = "the past would not be forgotten; write a spring in the right-hand side"
        refuse("kernel", required, repr(kernel), remedy)
    return mean


@dataclass(frozen=True)
class VaryingOrder:
    """An order that is a function of the time, and the derivative with it and Caputo's kernel."""

    function: Callable
    derivative: int  # m, 1 or 2: orders lie in (m - 1, m]
    origin: float = 0.0  # argument of the function at time 0 of the operator [time]
    definition: Definition = CAPUTO

    @classmethod
    def from_function(cls, function: Callable, definition: Definition) -> VaryingOrder:
        """Return the operator of a user's function; m is the ceil of its value at 0."""
        required = "be a function order(t) with values in (0, 1], or in (1, 2]"
        try:
            start = function(0.0)
        except Exception as error:
            got = f"{type(error).__name__} at t = 0: {error}"
            raise ValueError(complaint("order", required, got)) from error
        value = float(rounded_order(real("order", np.asarray(start)[()], required)))
        if not 0 < value <= 2:
            refuse("order", required, f"{value} at t = 0")
        return cls(function, derivative_order(value), definition=definition)

    @property
    def name(self) -> str:
        """Name of the function."""
        return getattr(self.function, "__name__", type(self.function).__name__)

    kernel: ClassVar[MemoryKernel | None] = None
    constant: ClassVar[bool] = False
    varies: ClassVar[bool] = True
    classical: ClassVar[bool] = False
    t_last: ClassVar[float] = math.inf

    def __str__(self) -> str:
        return f"{self.definition.name}({self.name})"

    def lower(self, k: int) -> None:
        """Return None: no operator on a derivative of y replaces it."""

    @property
    def order(self) -> float:
        """m, the upper bound of its orders."""
        return float(self.derivative)

    def rate(self, t_end: float) -> float:
        """Return its value at t_end over y there, with the order at the start."""
        return t_end ** -self.order_at(0.0)

    def powers(self, times: np.ndarray) -> tuple[np.ndarray, str]:
        """Return p = m - alpha at increasing times (n,), and a failure, as `sampled` does."""
        values, failure = self.sampled(times)
        return self.derivative - values, failure

    def described(self, times: np.ndarray) -> object:
        """Return orders at several times: a function has no name that identifies it elsewhere."""
        values = self.sampled(times)[0].tolist()
        return values if self.definition == CAPUTO else (self.definition.name, values)

    def order_at(self, t: float) -> float:
        """Return its order at time t."""
        return float(self.at(np.full(1, t))[0])

    def at(self, times: np.ndarray) -> np.ndarray:
        """Return orders at increasing times (n,); raise `OrderFailed` for one out of range."""
        values, failure = self.sampled(times)
        if failure:
            raise OrderFailed(failure)
        return values

    def sampled(self, times: np.ndarray) -> tuple[np.ndarray, str]:
        """Return orders at increasing times (n,), up to the first out of range, and its failure."""
        # (k,) in (m - 1, m]; a sentence about an order out of range or an exception, empty if none
        times = times + self.origin
        values = self._at_once(times)
        reason = ""
        if values is None:
            values, reason = self._one_by_one(times)
        values = rounded_order(values)
        low, high = self.derivative - 1, self.derivative
        if not reason and values.size and values.min() > low and values.max() <= high:
            return values, ""
        good = (values > low) & (values <= high)
        k = values.size if good.all() else int(np.argmin(good))
        if k < values.size:
            reason = f"{values[k]}"
        if not reason:
            return values, ""
        required = f"stay in ({low}, {high}], where it is at the start"
        return values[:k], complaint("order", required, f"{reason} at t = {times[k]:.6g}")

    def _at_once(self, times: np.ndarray) -> np.ndarray | None:
        """Return the orders at all times by one call; None if the function accepts no arrays."""
        try:
            # a copy, because the function may write into it
            values = np.broadcast_to(np.asarray(self.function(times.copy())), times.shape)
            if values.dtype.kind not in "iuf":
                return None
            some = sorted({0, times.size // 2, times.size - 1})
            alone = np.array([float(self.function(float(times[i]))) for i in some])
        except Exception:  # `_one_by_one` reports it
            return None
        close = np.abs(values[some] - alone) <= 1e-12 * np.abs(alone)
        return np.asarray(values, dtype=float) if close.all() else None

    def _one_by_one(self, times: np.ndarray) -> tuple[np.ndarray, str]:
        """Return the orders up to the first time at which the function raises, and the error."""
        values = np.empty(times.size)
        for i, t in enumerate(times.tolist()):
            try:
                values[i] = float(self.function(t))
            except Exception as error:
                return values[:i], f"{type(error).__name__}: {error}"
        return values, ""


Operator = ConstantOrder | KernelOperator | VaryingOrder
Parts = list[tuple[Operator, np.ndarray | bool]]
