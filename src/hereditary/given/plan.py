"""Plans: results of schemes for one equation and its steps.

A scheme (stepping/scheme.py) turns an equation and a step into a `Plan`. This has the tables that
its compiled march works on, and the `Convolution` that a history must sum for it. Nothing here
knows how the past is summed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np

from ..kernels.step_kernel import ExponentialSteps
from ..support.checks import refuse
from .signatures import StepRows
from .stability import StabilityRegion


@dataclass(frozen=True)
class WeightRule:
    """A family of weights w_k that depends on p, a number or a kernel in units of the step.

    Attributes
    ----------
    exact : callable
        ``exact(p, n)``: the weights w_0 .. w_(n-1), along the last axis. If p is a kernel, it may
        be one exponential in each row (`ExponentialSteps`).
    exponent : callable, optional
        ``exponent(p)``: exponent a of the kernel ``t**-a`` behind the weights, a `StepKernel` where
        that is a general one, or None where there is no memory. By default the kernel's `key`.
    shares : callable, optional
        ``shares(p, rates, weights, k)``, as `modal`. By default ``exact`` of the exponentials.
    """

    exact: Callable[[Any, int], np.ndarray]
    exponent: Callable[[Any], Any] = attrgetter("key")
    shares: Callable[[Any, np.ndarray, np.ndarray, int], np.ndarray] | None = None

    def modal(self, p, rates, weights, k):
        """Return shares of w_k, (M,), of the modes of a kernel ``weights exp(-rates t)``, t >= 1.

        A share decays by ``exp(-rates)`` from one k to the next.
        """
        if self.shares:
            return self.shares(p, rates, weights, k)
        return self.exact(ExponentialSteps(rates, p.amplitude * weights), k + 1)[..., k]


@dataclass(frozen=True)
class Convolution:
    """Sum that a history makes on a uniform mesh: ``lag_n = sum_k W_k u_(n-k)``, k >= 2.

    The weights are sums ``W_k = sum_j factor_j rule_j(p_j)_k``, with a list of (factor, rule, p)
    for each group of columns. Start values have separate lists: those of all groups for the first
    value, then those for the next. Their weights are sums of exponentials from k = 2 on.

    Attributes
    ----------
    groups : tuple of tuple of (float, WeightRule, float)
    start_groups : tuple of tuple of (float, WeightRule, float)
    first_modal : int
        First k from which the weights are sums of exponentials, at least 2.
    """

    groups: tuple
    start_groups: tuple
    first_modal: int = 2

    def prepare(self, n_end: int) -> None:
        """Do nothing: all steps but the first have the same row."""

    def reach(self, n: int):
        """Return all steps, which are computed; see `RowSums.reach`."""
        return n + 2**62, None

    def check(self, history):
        """Refuse a history that does not accept these kernels."""
        if self.kernels() and not history.takes_kernels:
            required = "be another one if terms have kernels other than Caputo's"
            refuse("history", required, repr(history), "use SumOfExponentials, FFT or Direct")

    @property
    def n_starts(self):
        """Number of start values of each column."""
        return len(self.start_groups) // len(self.groups)

    def exponents(self):
        """Return the exponents of all power-law kernels."""
        return tuple(sorted(key for key in self._keys() if isinstance(key, float)))

    def kernels(self):
        """Return all kernels that are not power laws, each as a `StepKernel`."""
        return tuple(key for key in self._keys() if not isinstance(key, float))

    def _keys(self):
        """Return the different results of `WeightRule.exponent`, in order."""
        lists = self.groups + self.start_groups
        found = [rule.exponent(p) for terms in lists for _, rule, p in terms]
        return [key for key in dict.fromkeys(found) if key is not None]

    def has_memory(self):
        """Return whether any weight beyond k = 1 differs from 0."""
        return bool(self._keys()) or self.first_modal > 3

    def exact(self, n):
        """Return weights (C, n) and start weights (V C, n) of every group for k < n."""
        return tuple(
            np.array([_total((f * rule.exact(p, n) for f, rule, p in terms), n) for terms in lists])
            for lists in (self.groups, self.start_groups)
        )

    def modal(self, rates, weights, k, k_start):
        """Return the shares of W_k of M rates, (C, M), and those of the start weights, (V C, M).

        The shares of start weights are those at `k_start`. `weights` maps the exponent of a kernel,
        or its `StepKernel`, to the weights (M,) of its exponential sum.
        """

        def share(terms, at):
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


def _total(pieces, n):
    return sum(pieces, np.zeros(n))


@dataclass(frozen=True)
class Plan:
    """Everything a march needs to know of a scheme on one equation with one step, or on a mesh.

    Attributes
    ----------
    past : Convolution or RowSums
        Sums that the history makes; `open` gives its memory for them.
    rows : StepRows
        Coefficients of the steps; for blocks of one step where each has its own.
    groups : ndarray of int64, shape (d,)
        Group of each component, of the same terms.
    initial, increments : ndarray, shape (d,)
        y(0), and the newest increment before the first step.
    shift : ndarray, shape (d,)
        y'(0) times the unit of the rows' lengths, where the pieces leave it out; 0 elsewhere.
    sweeps : int
        Sweeps of a corrector.
    integral : bool
        Whether the pieces are values of the right-hand side instead of increments.
    given : ndarray of int64, shape (d,), or None
        Whether `increments` are those of the first step, which an explicit scheme is given.
    powers, drift : ndarray, shape (r, d)
        Known terms ``drift t**power`` on the left side.
    corrections : ndarray, shape (k, d)
        Corrections of the right-hand side in the first k steps.
    starts : ndarray, shape (V, d)
        Start values that `past` weighs.
    lasting : bool
        Whether `corrections` last beyond the first few steps.
    region : StabilityRegion or None
        Where the eigenvalues of the Jacobian must stay; None for a scheme without a step limit.
    slowest : float
        Steps between turns up to which growing turns are watched; 0 for a scheme without a limit.
    """

    past: Any
    rows: StepRows
    groups: np.ndarray
    initial: np.ndarray
    increments: np.ndarray
    shift: np.ndarray
    sweeps: int = 0
    integral: bool = False
    given: np.ndarray | None = None
    powers: np.ndarray | None = None
    drift: np.ndarray | None = None
    corrections: np.ndarray | None = None
    starts: np.ndarray | None = None
    lasting: bool = False
    region: StabilityRegion | None = None
    slowest: float = 0.0


def distinct_columns(system):
    """Group columns by their terms, and by whether they are memory that f reads.

    The results are those of `System.distinct`. The first one lists terms and whether the column is
    memory.
    """
    distinct, groups = system.distinct
    keys = [(distinct[a], bool(read)) for a, read in zip(groups, system.read, strict=True)]
    found = list(dict.fromkeys(keys))
    return found, np.array([found.index(key) for key in keys], dtype=np.int64)
