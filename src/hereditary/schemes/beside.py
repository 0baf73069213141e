"""Terms with other kernels beside orders that vary.

With ``x_(n+1) = x_n + shift + w_n`` such a term is ``factor sum_k W_k u_(n-k)`` with weights that
last: u are the w where the term acts on y'', and whole increments where it acts on y' or y. Where
it acts on y itself, x(0) times the integrated kernel comes in addition.
"""

from dataclasses import dataclass

import numpy as np

from ..special import mean_exponential
from ..step_kernel import Integrated, StepKernel
from .scheme import WeightRule
from .weights import kernel_values, weighed


@dataclass(frozen=True)
class _Weighed:
    """One term: what its rule is multiplied by, the rule, its number, coefficient and m."""

    factor: float
    rule: WeightRule
    number: StepKernel
    coefficient: float
    derivative: int


@dataclass(frozen=True)
class KernelTerms:
    """Terms with constant kernels of one class, seen by a scheme at t_n + offset h.

    Attributes
    ----------
    terms : tuple of _Weighed
    theta, offset : float
    """

    terms: tuple[_Weighed, ...]
    theta: float
    offset: float

    @classmethod
    def seen(cls, pairs, h, theta, offset):
        """Make them of (coefficient, `KernelOperator`) pairs, with step h."""
        terms = []
        for c, term in pairs:
            factor, rule, number = weighed(c, term, h, theta)
            terms.append(_Weighed(factor, rule, number, c, term.derivative))
        return cls(tuple(terms), theta, offset)

    def __bool__(self):
        return bool(self.terms)

    @property
    def late(self) -> int:
        """First whole increment that counts: the explicit scheme's x_1 - x_0 is h x'(0) itself."""
        return int(self.offset == 0)

    def nearest(self) -> tuple[np.ndarray, np.ndarray]:
        """W_0 and W_1 of w, and those of shift."""
        both, whole = np.zeros(2), np.zeros(2)
        for term in self.terms:
            weights = term.factor * term.rule.exact(term.number, 2)
            both += weights
            if term.derivative < 2:
                whole += weights
        return both, whole

    def value(self, n: int) -> float:
        """Weight of x(0) in step n."""
        return float(self._values(n + 1)[n])

    def _values(self, n):
        rule = kernel_values(self.offset)
        values = np.zeros(n)
        for term in self.terms:
            if term.derivative == 0:
                values += term.coefficient * rule.exact(term.number, n)
        return values

    def exact(self, n: int) -> np.ndarray:
        """Weights of w_(n-k), of shift and of x(0) in step k, k < n, older than two increments."""
        weights = np.zeros((3, n))
        for term in self.terms:
            own = term.factor * term.rule.exact(term.number, n)
            own[:2] = 0.0
            weights[0] += own
            if term.derivative < 2:
                weights[1, self.late :] += np.cumsum(own)[: n - self.late]
        weights[2] = self._values(n)
        return weights

    def limit(self) -> float:
        """Stiffness at which the explicit scheme zigzags with these terms alone."""
        limit = 0.0
        for term in self.terms:
            sign = 4 if term.derivative == 2 else 2
            limit += sign * term.factor * term.number.alternating()
        return limit

    def groups(self) -> list[tuple[StepKernel, int]]:
        """Kernels whose modes are driven by the same: with m, 1 standing for 0 as well."""
        return [(term.number, max(1, term.derivative)) for term in self.terms]

    def begun(self, kernel, rates) -> np.ndarray:
        """Contribution of x(0) to the modes at k = 2, where the kernel is of x itself."""
        if not isinstance(kernel.kernel, Integrated):
            return np.zeros(rates.size)
        return np.exp(-rates * (1 + self.offset - self.theta)) / mean_exponential(rates)

    def amplitudes(self, group, rates, weights) -> np.ndarray:
        """Amplitudes of a group's modes in the weight of k = 2."""
        total = np.zeros(rates.size)
        for term, own in zip(self.terms, self.groups(), strict=True):
            if own == group:
                total += term.factor * term.rule.modal(term.number, rates, weights, 2)
        return total
