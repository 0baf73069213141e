"""Rule of the first step after a singular start, where a solution is a sum of powers of time.

Let t be the time since the start over the step's length. It depends on a variable u in [0, 1]:

    t = (v / (1 + c (1 - v)))**(q / m),   v = u**m.

The step approximates functions of t by polynomials in u, through their values at n Radau points of
u. The powers of t in the solution are integer powers of u, or powers that are high enough for the
same accuracy. A stiff solution of tiny order g changes where c t**g is about 1. It is nearly
1 / (1 + c t**g), which is linear in v.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.special import rgamma

from ..compiled.jit import checked
from ..kernels.memory_kernel import MemoryKernel
from .quadrature import check_points_of, legendre_values, radau_nodes, to_legendre
from .structures import ExponentialBasis, Rule, StepTables

# Width of the interval next to a singular end of [0, 1] that the graded rule leaves out. Kernels
# are integrated over it in closed form.
LEFT_OUT = 0.25**26 / 2
# Exponent from which a power of u is approximated as well as an integer power. Its Legendre
# coefficients decrease like n**(-2 power - 1).
_SMOOTH_EXPONENT = 5.3
# Distance from an integer within which an exponent counts as this integer.
_INTEGER_EXPONENT_TOL = 1e-9
# Number of nodes of a first step with c = 0.
_FIRST_STEP_NODES = 24
# Number of nodes of a first step with c > 0. It is larger because solutions with several decay
# rates share one c.
_BENT_FIRST_STEP_NODES = 48
# Smallest time lag at which kernels are evaluated.
NEXT_TO_0 = 1e-300


class Variable(NamedTuple):
    """The variable u of a first step, t = (v / (1 + c (1 - v)))**(q / m) with v = u**m.

    t is the time over the step's length, q and m are powers, c is a rate, n the number of nodes.
    """

    q: float = 1.0
    m: float = 1.0
    c: float = 0.0
    n: int = _FIRST_STEP_NODES

    @classmethod
    def of(cls, generators: tuple[float, ...], c: float = 0.0) -> Variable:
        """Return the variable for functions whose exponents of t are sums of the `generators`."""
        ratios = [g / generators[0] for g in generators[1:]]
        m = next(
            (m for m in range(1, 6) if all(_is_smooth(m * r) for r in ratios)), _SMOOTH_EXPONENT
        )
        return cls(m / generators[0], m, c, _BENT_FIRST_STEP_NODES if c else _FIRST_STEP_NODES)

    def logs(self, u: np.ndarray) -> np.ndarray:
        """Return log(t) at u."""
        with np.errstate(divide="ignore"):
            return self.q * np.log(u) - self.q / self.m * np.log1p(self.c * (1 - u**self.m))

    def at(self, logs: np.ndarray) -> np.ndarray:
        """Return u at times with the logarithms `logs`."""
        return np.exp(logs / self.q) / self._bend(logs) ** (1 / self.m)

    def _bend(self, logs: np.ndarray) -> np.ndarray:
        """Return t**(m/q) / v at times with the logarithms `logs`; 1 for c = 0."""
        return (1 + self.c * np.exp(logs * (self.m / self.q))) / (1 + self.c)

    def slopes(self, t: np.ndarray) -> np.ndarray:
        """Return du/dt at t above 0."""
        logs = np.log(t)
        return self.at(logs) / (self.q * t * (1 + self.c) * self._bend(logs))


def _is_smooth(exponent: float) -> bool:
    """Return whether polynomials approximate u to this power well."""
    return exponent >= _SMOOTH_EXPONENT or abs(exponent - round(exponent)) < _INTEGER_EXPONENT_TOL


def functions(variable: Variable, logs: np.ndarray) -> np.ndarray:
    """Return the n Lagrange polynomials in u at k times with logarithms `logs` (k,), (k, n)."""
    return _legendre(variable, logs).T @ to_legendre(variable.n)


def _legendre(variable: Variable, logs: np.ndarray) -> np.ndarray:
    """Return shifted Legendre polynomials P_0 .. P_(n-1) in u at `logs` of times, (n, ...)."""
    x = 2 * np.minimum(variable.at(logs), 1.0) - 1
    return legendre_values(x.ravel(), variable.n - 1).reshape(variable.n, *x.shape)


@lru_cache(maxsize=64)
def first_rule(variable: Variable, orders: tuple[float, ...]) -> Rule:
    """Return the `Rule` of a first step of length 1, with fractional integrals of these orders."""
    n, logs, looks = variable.n, node_logs(variable), variable.logs(check_points_of(variable.n))
    integrals = np.exp(np.multiply.outer(orders, logs))[..., None] * means(variable, orders)
    seen = np.exp(looks)[:, None] * means(variable, (1.0,), True)[0]
    unused = np.full((n, n), np.nan)  # equations with p' begin with tiny steps
    parts = np.exp(logs), integrals, to_legendre(n), unused, np.exp(looks), seen
    looked = _at_products(n, True)[..., -1].T @ to_legendre(n)  # the last node is 1
    return checked(Rule(*(np.array(part, order="C") for part in (*parts, looked, variable[:3]))))


@lru_cache(maxsize=64)
def node_logs(variable: Variable) -> np.ndarray:
    """Return log(t) at the nodes of a first step, (n,)."""
    return variable.logs(radau_nodes(variable.n))


@lru_cache(maxsize=16)
def known_at_nodes(n: int, n_weights: int, n_kernels: int) -> tuple[ExponentialBasis, StepTables]:
    """Return the basis and the tables of a first step whose history is known at its n nodes."""
    # Each node has a mode of its own, whose decay to the others is 0, so the march reads the
    # history as modes. n_weights orders and kernels, n_kernels of them kernels. Length of the step
    # and convolutions with kernels are to be filled in.
    basis = ExponentialBasis(
        np.ones(n), np.zeros(0, complex), np.zeros((n_weights, n)), np.zeros(n_kernels),
        np.zeros((n, n, n)),
    )  # fmt: skip
    local = np.zeros((1, n_kernels, n, n))
    return checked(basis), StepTables(
        np.zeros(1), np.eye(n)[None], np.zeros((1, n)), np.zeros((1, n, n)), local
    )


def means(variable: Variable, orders: tuple[float, ...], looks: bool = False) -> np.ndarray:
    """Return ``J**a l_j / t**a`` at the nodes, or at the k check points (`looks`), (n_a, k, n)."""
    # l_j: the n Lagrange polynomials in u; a: one of n_a orders; finite for all t
    points, v, rule = graded_rule()
    a = np.array(orders)[:, None]
    # over the width that the rule leaves out, the kernel is integrated in closed form
    weights = rgamma(a) * np.hstack([rule * v ** (a - 1), LEFT_OUT**a / a])
    if variable.c == 0.0:  # u of a product of times is a product: one rule on the nodes suffices
        weights = weights @ _at_rule_and_end(variable).T @ to_legendre(variable.n)
        values = _at_products(variable.n, looks)
    else:
        logs = variable.logs(_points(variable.n, looks))
        values = _legendre(variable, np.add.outer(logs, np.append(np.log(points), 0.0)))
    return (values @ weights.T).T @ to_legendre(variable.n)


def _points(n: int, looks: bool) -> np.ndarray:
    """Return the check points of a step with n nodes, or its nodes, as values of u, (k,)."""
    return check_points_of(n) if looks else radau_nodes(n)


@lru_cache(maxsize=8)
def _at_products(n: int, looks: bool) -> np.ndarray:
    """Return shifted Legendre polynomials at products of k `_points` and nodes, (n, k, n)."""
    u = np.multiply.outer(_points(n, looks), radau_nodes(n))
    return legendre_values(2 * u.ravel() - 1, n - 1).reshape(n, *u.shape)


@lru_cache(maxsize=64)
def means_at_nodes(variable: Variable) -> np.ndarray:
    """Return the means of the n Lagrange polynomials from the start to each node, (n, n)."""
    return means(variable, (1.0,))[0]


def convolutions(variable: Variable, kernel: MemoryKernel, h: float) -> np.ndarray:
    """Return the matrix of the convolution with a kernel K in a step of length h, (n, n)."""
    # row i gives int_0^(h t_i) K(h t_i - s) q(s) ds from the values of q at the times h t_j of the
    # n nodes
    points, v, weights = graded_rule()
    logs = variable.logs(radau_nodes(variable.n))
    ends = h * np.exp(logs)
    distances = np.maximum(np.multiply.outer(ends, v), NEXT_TO_0)
    kernels = kernel(distances) * weights * ends[:, None]
    values = _legendre(variable, np.add.outer(logs, np.log(points)))
    # the integral of the kernel over the width that the rule leaves out
    rest = kernel.integral(np.maximum(ends * LEFT_OUT, NEXT_TO_0))
    return np.einsum("ip,jip->ij", kernels, values) @ to_legendre(variable.n) + np.diag(rest)


@lru_cache(maxsize=16)
def _at_rule_and_end(variable: Variable) -> np.ndarray:
    """Return the n Legendre polynomials in u at k points of `graded_rule`, and at 1, (n, k + 1)."""
    return _legendre(variable, np.append(np.log(graded_rule()[0]), 0.0))


@lru_cache(maxsize=16)
def at_points(variable: Variable, name: tuple[bool, int]) -> np.ndarray:
    """Return the n Lagrange polynomials in u at the points of `rule_of_modes`, (n, k)."""
    return np.ascontiguousarray(functions(variable, np.log(_rule_of_modes(*name)[0])).T)


@lru_cache(maxsize=16)
def at_rule(variable: Variable) -> np.ndarray:
    """Return the n Lagrange polynomials in u at the k points of `graded_rule`, (k, n)."""
    return functions(variable, np.log(graded_rule()[0]))


@lru_cache(maxsize=1)
def graded_rule() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x, 1 - x and weights on [0, 1] for integrands that are singular at both ends."""
    # 1 - x without cancellation
    x, w = leggauss(16)
    ends = np.concatenate([[LEFT_OUT], 0.5 * 0.25 ** np.arange(25, -1, -1)])
    widths = np.diff(ends)[:, None]
    half = (ends[:-1, None] + widths * (1 + x) / 2).ravel()
    weights = (widths * w / 2).ravel()
    return np.concatenate([half, 1 - half]), np.concatenate([1 - half, half]), np.tile(weights, 2)


def rule_of_modes(
    n: int, fastest: float
) -> tuple[tuple[bool, int], np.ndarray, np.ndarray, np.ndarray]:
    """Return a key, and the rule of `graded_rule` for polynomials of u times decays to the end."""
    # polynomials in n nodes, exponentials of rates up to `fastest`: panels next to the end need not
    # be shorter than they decay
    # the last panel is not longer than two decay times of the fastest rate
    key = n <= _FIRST_STEP_NODES, min(max(math.ceil(math.log(max(fastest, 1.0), 4)), 3), 26)
    return key, *_rule_of_modes(*key)


@lru_cache(maxsize=64)
def _rule_of_modes(smooth: bool, n_ends: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rule with `n_ends` panels between the middle and the end."""
    # smooth: panels next to the start have fewer points the shorter they are, as polynomials have
    # no more than 24 nodes
    x, of_x = _side(LEFT_OUT, [max(4, 16 - k // 2) if smooth else 16 for k in range(26)])
    v, of_v = _side(0.0, [16] * n_ends)
    return np.concatenate([x, 1 - v]), np.concatenate([1 - x, v]), np.concatenate([of_x, of_v])


def _side(least: float, numbers: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return points and weights on [least, 1/2], of which each panel is a quarter as long."""
    # numbers: of points in the panels, beginning with the longest
    ends = [0.5 * 0.25**k for k in range(len(numbers))] + [least]
    points, weights = [], []
    for k, number in enumerate(numbers):
        x, w = leggauss(number)
        width = ends[k] - ends[k + 1]
        points.append(ends[k + 1] + width * (1 + x) / 2)
        weights.append(width * w / 2)
    return np.concatenate(points), np.concatenate(weights)
