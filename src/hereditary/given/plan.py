"""Plans: what a scheme computes for one equation and its steps before a march.

A scheme (stepping/scheme.py) turns an equation and a step into a `Plan`. The plan has the tables of
the compiled march, and the `Convolution` that a history must sum. How a history sums is no part of
the plan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np

from ..equation.system import System
from ..kernels.step_kernel import ExponentialSteps
from ..support.checks import refuse
from .signatures import StepRows


@dataclass(frozen=True)
class WeightRule:
    """A family of weights w_k with a parameter p, a number or a kernel in units of the step."""

    # exact(p, n): w_0 .. w_(n-1) along the last axis, a row for each kernel of `ExponentialSteps`
    exact: Callable[[Any, int], np.ndarray]
    # exponent(p): a of the kernel t**-a, or a `StepKernel`; None without memory
    exponent: Callable[[Any], Any] = attrgetter("key")
    shares: Callable[[Any, np.ndarray, np.ndarray, int], np.ndarray] | None = None  # as `modal`

    def modal(self, p: Any, rates: np.ndarray, weights: np.ndarray, k: int) -> np.ndarray:
        """Return the contributions (M,) to w_k of M modes."""
        # The modes are summands weights exp(-rates t), t >= 1, of a kernel in units of the step.
        # From k to k + 1 a contribution decays by exp(-rates).
        if self.shares:
            return self.shares(p, rates, weights, k)
        return self.exact(ExponentialSteps(rates, p.amplitude * weights), k + 1)[..., k]


@dataclass(frozen=True)
class Convolution:
    """Sum that a history computes on uniform steps: ``lag_n = sum_k W_k u_(n-k)``, k >= 2."""

    # Each of C groups of columns has weights W_k = sum_j factor_j rule_j(p_j)_k. Those of V start
    # values of each column are sums of exponentials from k = 2 on.

    groups: tuple  # (factor, rule, p) of all summands of W_k, for each of C groups
    start_groups: tuple  # the same of start values: C tuples of the first, then of the second, ..
    first_modal: int = 2  # first k from which weights are sums of exponentials

    def prepare(self, n_end: int) -> None:
        """Do nothing: all steps but the first have the same coefficients."""

    def reach(self, n: int) -> tuple[int, None]:
        """Return a step beyond every run, and None for unchanged rows; see `RowSums.reach`."""
        return n + 2**62, None

    def check(self, history: Any) -> None:
        """Refuse a history that cannot sum kernels other than power laws, if these occur."""
        if self.kernels and not history.takes_kernels:
            required = "be another one if terms have kernels other than Caputo's"
            refuse("history", required, repr(history), "use SumOfExponentials, FFT or Direct")

    @property
    def n_starts(self) -> int:
        """Number of start values of each column."""
        return len(self.start_groups) // len(self.groups)

    @cached_property
    def exponents(self) -> tuple[Any, ...]:
        """The exponents of all power-law kernels in the terms, sorted."""
        return tuple(sorted(key for key in self._keys if isinstance(key, float)))

    @cached_property
    def kernels(self) -> tuple[Any, ...]:
        """The kernels that are no power laws, each as a `StepKernel`."""
        return tuple(key for key in self._keys if not isinstance(key, float))

    @cached_property
    def _keys(self) -> list[Any]:
        """The distinct results of `WeightRule.exponent` in the order of the terms."""
        lists = self.groups + self.start_groups
        found = [rule.exponent(p) for terms in lists for _, rule, p in terms]
        return [key for key in dict.fromkeys(found) if key is not None]

    def has_memory(self) -> bool:
        """Return whether any pieces u_(n-k) with k > 1 have weights."""
        return bool(self._keys) or self.first_modal > 3

    def exact(self, n: int) -> tuple[np.ndarray, ...]:
        """Return weights (C, n) of pieces and (V C, n) of start values for k < n."""
        return tuple(
            np.array([_total((f * rule.exact(p, n) for f, rule, p in terms), n) for terms in lists])
            for lists in (self.groups, self.start_groups)
        )

    def modal(
        self, rates: np.ndarray, weights: dict[Any, Any], k: int, k_start: int
    ) -> tuple[np.ndarray, ...]:
        """Return contributions of modes to W_k, (C, M), and to start weights, (V C, M)."""
        # those at k_start instead of k; weights: those of modes (M,) by the exponent of a kernel,
        # or by its `StepKernel`

        def share(terms: list[Any], at: int) -> np.ndarray:
            pieces = (
                f * rule.modal(p, rates, weights[rule.exponent(p)], at)
                for f, rule, p in terms
                if rule.exponent(p) is not None
            )
            return _total(pieces, rates.size)

        return tuple(
            np.array([share(terms, at) for terms in lists])
            for lists, at in ((self.groups, k), (self.start_groups, k_start))
        )


def _total(pieces: Iterator[Any], n: int) -> np.ndarray:
    return sum(pieces, np.zeros(n))


@dataclass(frozen=True)
class Plan:
    """Coefficients of a scheme for one equation with d components, with one step or on a mesh."""

    past: Any  # `Convolution` or `RowSums` that the history computes, by `History.open`
    rows: StepRows  # coefficients of the steps; if each step has its own, blocks have one step
    groups: np.ndarray  # int64 (d,), group of each component; those of a group have the same terms
    initial: np.ndarray  # (d,), y(0)
    increments: np.ndarray  # (d,), the increment before the first step
    # (d,), y'(0) in the unit of ``rows.length`` if pieces leave out t y'(0); otherwise 0
    shift: np.ndarray
    sweeps: int = 0  # number of corrector sweeps in a step
    integral: bool = False  # whether the pieces are values of f instead of increments
    # int64 (d,), 1 if an explicit scheme takes the first increment from `increments`
    given: np.ndarray | None = None
    powers: np.ndarray | None = None  # (r, d), of r known terms ``drift t**power`` on the left side
    # (r, d), of these terms; if each step has its own rows, y(0) for terms that act on y
    drift: np.ndarray | None = None
    corrections: np.ndarray | None = None  # (k, d), of the right-hand side in the first k steps
    starts: np.ndarray | None = None  # (V, d), start values, whose weights are in `past`
    lasting: bool = False  # whether `corrections` extend beyond the first few steps
    # largest number of steps between growing turns of increments that are watched; 0 turns the
    # watch off, for schemes without a step limit
    slowest: float = 0.0


def distinct_columns(system: System) -> tuple[list[Any], np.ndarray]:
    """Return terms of each group of components, whether f reads it as memory, and groups (d,)."""
    distinct, groups = system.distinct
    keys = [
        (distinct[a], bool(is_memory))
        for a, is_memory in zip(groups, system.is_memory, strict=True)
    ]
    found = list(dict.fromkeys(keys))
    return found, np.array([found.index(key) for key in keys], dtype=np.int64)
