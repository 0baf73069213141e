"""The scheme contract (floor 2).

A scheme turns an equation and a step into a `Plan`: the tables its compiled march works on, and
the `Convolution` that a history must sum for it. Nothing here knows how the past is summed.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..equation import Equation


@dataclass(frozen=True)
class WeightRule:
    """A family of weights w_k, exact and as exponentials.

    Attributes
    ----------
    exact : callable
        ``exact(p, n)``: the weights w_0 .. w_(n-1), shape (n,).
    modal : callable
        ``modal(p, rates, weights, k)``: the shares of w_k of each mode when ``t**(p-1)`` is the sum
        of ``weights * exp(-rates t)`` on [1, ...) in units of the step; a share decays by
        ``exp(-rates)`` from one k to the next. Valid from k = 2 on.
    """

    exact: Callable[[float, int], np.ndarray]
    modal: Callable[[float, np.ndarray, np.ndarray, int], np.ndarray]


@dataclass(frozen=True)
class Convolution:
    """What a history has to sum on a uniform mesh: ``lag_n = sum_k W_k u_(n-k)``, k >= 2.

    The weights are sums ``W_k = sum_j factor_j rule_j(p_j)_k``, one such list of (factor, rule, p)
    for each class of components; a second list of the same kind weighs the start value, from k = 1
    on (the lag of step 0 is never used by a component that has a start value).

    Attributes
    ----------
    classes : tuple of tuple of (float, WeightRule, float)
    start_classes : tuple of tuple of (float, WeightRule, float)
    """

    classes: tuple
    start_classes: tuple

    def exponents(self):
        """Kernel exponents a = 1 - p that occur, without the memoryless ones (p = 0)."""
        lists = self.classes + self.start_classes
        return tuple(sorted({1 - p for terms in lists for _, _, p in terms if p > 0}))

    def exact(self, n):
        """Weights and start weights of every class for k < n, two arrays of shape (C, n)."""
        return tuple(
            np.array([_total((f * rule.exact(p, n) for f, rule, p in terms), n) for terms in lists])
            for lists in (self.classes, self.start_classes)
        )

    def modal(self, bank, k, k_start):
        """Mode shares of W_k and of the start weight at k_start, two arrays of shape (C, M).

        `bank` maps a kernel exponent to (rates, weights) of its exponential sum.
        """

        def share(terms, at):
            pieces = (f * rule.modal(p, *bank[1 - p], at) for f, rule, p in terms if p > 0)
            return _total(pieces, next(iter(bank.values()))[0].size)

        return tuple(
            np.array([share(terms, at) for terms in lists])
            for lists, at in ((self.classes, k), (self.start_classes, k_start))
        )


def _total(pieces, n):
    return sum(pieces, np.zeros(n))


@dataclass(frozen=True)
class Plan:
    """Everything a march needs to know of a scheme on one equation with one step.

    Attributes
    ----------
    convolution : Convolution
        What the history sums, already divided by the leading weight.
    classes : ndarray of int64, shape (d,)
        Class of each component in `convolution`.
    second : ndarray of int64, shape (d,)
        1 for components with an initial derivative.
    lead, near : ndarray, shape (d,)
        Reciprocal leading weight, and the exact weight of the newest increment.
    increments : ndarray, shape (d,)
        The increment ``y_(-1)`` or ``y_0`` the march starts from.
    limits : ndarray, shape (d,)
        Sharp stability limit of each component: -d rhs / d y must stay below it [1/time**order].
    """

    convolution: Convolution
    classes: np.ndarray
    second: np.ndarray
    lead: np.ndarray
    near: np.ndarray
    increments: np.ndarray
    limits: np.ndarray


class Scheme(ABC):
    """How one step is taken; subclasses are final frozen dataclasses, one file each.

    A subclass declares `march`, the compiled block loop (kernels/march.py tells its arguments),
    its proven order and its plan.
    """

    march: ClassVar[Callable]

    @abstractmethod
    def order(self, alpha: float, smoothness: str = "smooth") -> float:
        """Proven order of convergence at a fixed time."""

    @abstractmethod
    def plan(self, equation: Equation, h: float) -> Plan:
        """The `Plan` for `equation` with step h."""
