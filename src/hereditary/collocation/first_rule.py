"""Rule of the step that begins at a singular point, where a solution is a sum of powers of time.

With the time since then over the step's length equal to

    t = (v / (1 + c (1 - v)))**(q / m),   v = u**m,

functions of t are polynomials in u: the step is an ordinary one, on Radau points of u. All powers
of t that occur are integer powers of u, or so high that u is as good. A stiff solution of tiny
order g changes where c t**g is about 1. It is nearly 1 / (1 + c t**g), which is linear in v.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.special import rgamma

from .quadrature import check_points_of, legendre_values, radau_nodes, to_legendre
from .structures import Rule

# Width next to 1 that the graded rule leaves out. There kernels are integrated in closed form.
LEFT_OUT = 0.25**26 / 2
# Powers of u from this one on are as good as integer ones: their Legendre coefficients fall as
# n**(-2 power - 1).
_HIGH = 5.3
# Exponents whose distance from an integer is below this count as integers.
_APART = 1e-9
# Number of nodes of a first step.
_NODES = 24
# Number of nodes of a first step in a variable with c > 0, in which solutions of several rates have
# the same c.
_NODES_IF_BENT = 48
# Least distance at which kernels are evaluated.
_NEXT_TO_0 = 1e-300


class Variable(NamedTuple):
    """The variable u of a step: its powers q and m, the rate c, and the number of nodes."""

    q: float = 1.0
    m: float = 1.0
    c: float = 0.0
    n: int = _NODES

    @classmethod
    def of(cls, generators, c=0.0):
        """Return the variable for exponents that are sums of these numbers."""
        ratios = [g / generators[0] for g in generators[1:]]
        m = next((m for m in range(1, 6) if all(_is_smooth(m * r) for r in ratios)), _HIGH)
        return cls(m / generators[0], m, c, _NODES_IF_BENT if c else _NODES)

    def logs(self, u):
        """Return log(t) at u."""
        with np.errstate(divide="ignore"):
            return self.q * np.log(u) - self.q / self.m * np.log1p(self.c * (1 - u**self.m))

    def at(self, logs):
        """Return u at these log(t)."""
        return np.exp(logs / self.q) / self._bend(logs) ** (1 / self.m)

    def _bend(self, logs):
        """Return t**(m/q) / v."""
        return (1 + self.c * np.exp(logs * (self.m / self.q))) / (1 + self.c)

    def slopes(self, t):
        """Return du/dt at t above 0."""
        logs = np.log(t)
        return self.at(logs) / (self.q * t * (1 + self.c) * self._bend(logs))


def _is_smooth(exponent):
    """Return whether a power of u with this exponent is as good as a polynomial."""
    return exponent >= _HIGH or abs(exponent - round(exponent)) < _APART


def functions(variable, logs):
    """Return the node functions at log(t) (k,), each 1 at one node and 0 at the others; (k, n)."""
    return _legendre(variable, logs).T @ to_legendre(variable.n)


def _legendre(variable, logs):
    """Return the Legendre polynomials in u at log(t) (...,), (n, ...)."""
    x = 2 * np.minimum(variable.at(logs), 1.0) - 1
    return legendre_values(x.ravel(), variable.n - 1).reshape(variable.n, *x.shape)


@lru_cache(maxsize=64)
def first_rule(variable, orders):
    """Return the `Rule` of a step of length 1 in u, with the integrals of these orders."""
    u, looks = radau_nodes(variable.n), check_points_of(variable.n)
    logs, logs_of_looks = variable.logs(u), variable.logs(looks)
    integrals = np.exp(np.multiply.outer(orders, logs))[..., None] * means(variable, orders, logs)
    seen = np.exp(logs_of_looks)[:, None] * means(variable, (1.0,), logs_of_looks)[0]
    unused = np.full((variable.n, variable.n), np.nan)  # equations with p' begin otherwise
    parts = np.exp(logs), integrals, to_legendre(variable.n), unused, np.exp(logs_of_looks), seen
    looked = functions(variable, logs_of_looks)
    return Rule(*(np.array(part, order="C") for part in (*parts, looked)))


def means(variable, orders, logs):
    """Return ``J**a / t**a`` of the node functions at log(t), finite for all t; (n_a, k, n)."""
    points, v, rule = graded_rule()
    a = np.array(orders)[:, None]
    # the last weight is the integral over the width that the rule leaves out
    weights = rgamma(a) * np.hstack([rule * v ** (a - 1), LEFT_OUT**a / a])
    points = np.append(np.log(points), 0.0)
    if variable.c == 0.0:  # u is a product, so that the nodes are a rule for all times
        weights = weights @ functions(variable, points)
        points = variable.logs(radau_nodes(variable.n))
    within = np.add.outer(logs, points)
    return (_legendre(variable, within) @ weights.T).T @ to_legendre(variable.n)


@lru_cache(maxsize=64)
def means_at_nodes(variable):
    """Return the means of the polynomials from the start to each node, (n, n)."""
    return means(variable, (1.0,), variable.logs(radau_nodes(variable.n)))[0]


def convolutions(variable, kernel, h):
    """Return the convolutions with a kernel K, in a step of length h, at the nodes; (n, n).

    Row i is ``int_0^(h t_i) K(h t_i - s) q(s) ds`` from the values of q(h .) at the nodes.
    """
    points, v, weights = graded_rule()
    logs = variable.logs(radau_nodes(variable.n))
    ends = h * np.exp(logs)
    distances = np.maximum(np.multiply.outer(ends, v), _NEXT_TO_0)
    kernels = kernel(distances) * weights * ends[:, None]
    values = _legendre(variable, np.add.outer(logs, np.log(points)))
    # integral over the width that the rule leaves out
    rest = kernel.integral(np.maximum(ends * LEFT_OUT, _NEXT_TO_0))
    return np.einsum("ip,jip->ij", kernels, values) @ to_legendre(variable.n) + np.diag(rest)


@lru_cache(maxsize=16)
def at_rule(variable):
    """Return the node functions at points of the graded rule, (k, n)."""
    return functions(variable, np.log(graded_rule()[0]))


@lru_cache(maxsize=1)
def graded_rule():
    """Return points u, 1 - u and weights on [0, 1] for integrands singular at both ends."""
    x, w = leggauss(16)
    ends = np.concatenate([[LEFT_OUT], 0.5 * 0.25 ** np.arange(25, -1, -1)])
    widths = np.diff(ends)[:, None]
    half = (ends[:-1, None] + widths * (1 + x) / 2).ravel()
    weights = (widths * w / 2).ravel()
    return np.concatenate([half, 1 - half]), np.concatenate([1 - half, half]), np.tile(weights, 2)
