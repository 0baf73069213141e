"""Functions for the step out of a point where the solution is not smooth (floor 2).

There the solution is a sum of powers t**e, e running over the sums of a few generators g. Products
of Legendre polynomials in the t**g span them without the cancellation that powers suffer from.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.polynomial.legendre import leggauss, legval, legvander
from scipy.special import rgamma

# Singular values below this share of the largest are noise of the basis.
_CUT = 1e-14
# A generator below this is treated as if it were this when the functions are chosen. No step is
# so small that its power is: more functions then, instead.
_TINY = 0.12
# How many functions, and how many with a tiny generator.
_SIZE, _SIZE_IF_TINY = 18, 24
# Kernels are taken no closer to 0 than this.
_NEXT_TO_0 = 1e-300
# The graded rule leaves out this much next to 1, where kernels are integrated in closed form.
LEFT_OUT = 0.25**26 / 2


class PowerBasis:
    """Functions on [0, 1] by their values at nodes that crowd towards 0.

    Parameters
    ----------
    generators : tuple of float
        Ascending, above 0.
    size : int, optional
        Number of functions.
    bend : float, optional
        c >= 0: a polynomial in (1 + c) t**g / (1 + c t**g) instead of t**g, for the first g. Where
        a solution takes most of its course while t**g is about 1 / c, that follows it.

    Attributes
    ----------
    nodes, between : ndarray, shape (n,) and (n + 1,)
        The nodes, the last one 1, and points between them, the first one 0.
    """

    def __init__(self, generators, size=None, bend=0.0):
        if size is None:
            size = _SIZE_IF_TINY if generators[0] < _TINY else _SIZE
        self._generators, self.bend = np.array(generators), bend
        self._degrees = _smallest_sums(generators, size)
        # Functions of several generators are nearly dependent: twice as many values tame that. They
        # lie at Chebyshev points of t**g, for the smallest g and, where that is tiny, for a larger
        # one too; by logarithms, for t itself may be too small for a float.
        several = min(2, len(generators))
        scales = (generators[0], next(g for g in generators if g >= _TINY))[:several]
        n = size * several // len(set(scales))
        even, odd = np.arange(1, n + 1) / n, (np.arange(n) + 0.5) / n
        logs = [
            np.sort(
                np.concatenate([self._unbent((1 - np.cos(np.pi * x)) / 2, g) for g in set(scales)])
            )
            for x in (even, odd)
        ]
        logs[0] = np.unique(logs[0])  # t = 1 belongs to both
        logs[1] = np.append(-np.inf, logs[1])  # t = 0 lies between none, but must be right too
        self._logs = np.concatenate(logs)
        self.nodes, self.between = np.exp(logs[0]), np.exp(logs[1])
        n = self.nodes.size
        u, sizes, v = np.linalg.svd(self._functions(self._logs[:n]), full_matrices=False)
        kept = sizes > _CUT * sizes[0]
        # an orthonormal basis, and its coefficients from values; kept apart, for the small sizes'
        # rounding errors meet only the small coefficients they belong to
        self._mix, self._coefficients = v[kept].T / sizes[kept], u[:, kept].T

    def at(self, t):
        """The functions that are 1 at one node and 0 at the others, at t in [0, 1], (k, n)."""
        return (self._functions(_log(t)) @ self._mix) @ self._coefficients

    def interpolate(self, values, t):
        """Functions given by `values` (..., n) at the nodes, at t, shape (..., k).

        Their differences from the last value are what the basis takes: a constant stays exact.
        """
        return self._interpolate(values, self.at(t))

    def interpolate_between(self, values):
        """The same at the points between the nodes, also where these are too small for a float."""
        functions = self._functions(self._logs[self.nodes.size :])
        return self._interpolate(values, (functions @ self._mix) @ self._coefficients)

    @staticmethod
    def _interpolate(values, at):
        end = values[..., -1:]
        return end + (values - end) @ at.T

    def slopes(self, t):
        """Their derivatives, infinite at 0 for powers below 1, shape (k, n)."""
        t = np.asarray(t, dtype=float)
        total = np.zeros((t.size, len(self._degrees)))
        for i, g in enumerate(self._generators):
            with np.errstate(divide="ignore", invalid="ignore"):
                inner = 2 * g * t ** (g - 1)
                if i == 0:
                    inner *= (1 + self.bend) / (1 + self.bend * t**g) ** 2
            varying = self._degrees[:, i] > 0
            part = self._functions(_log(t), derivative=i)[:, varying]
            total[:, varying] += inner[:, None] * part
        return (total @ self._mix) @ self._coefficients

    @lru_cache(maxsize=16)  # noqa: B019 (bases are few and kept anyway)
    def integrals(self, orders):
        """Their integrals ``J**a`` from 0 to the nodes and between, shape (len(orders), 2 n, n)."""
        u, v, weights = graded_rule()
        ends = self._logs
        values = self._functions(np.add.outer(ends, np.log(u)).ravel())
        values = values.reshape(ends.size, u.size, -1)
        last = self._functions(ends)
        found = []
        for a in orders:
            # what is left beyond the rule, next to the end, is a power of its width
            inner = np.einsum("q,kqj->kj", weights * v ** (a - 1), values) + last * LEFT_OUT**a / a
            found.append(np.exp(a * ends)[:, None] * rgamma(a) * (inner @ self._mix))
        return np.array(found) @ self._coefficients

    def _unbent(self, w, g):
        """log(t) where t**g, or what the bend makes of it, is w."""
        if g == self._generators[0]:
            w = w / (1 + self.bend * (1 - w))
        return np.log(w) / g

    def convolutions(self, kernel, h):
        """Convolutions with a kernel K from 0 to the nodes and between, times h, (2 n, n).

        ``int_0^(h t) K(h t - s) q(s) ds`` from the values of q(h .) at the nodes.
        """
        u, v, weights = graded_rule()
        ends = np.exp(self._logs)
        values = self._functions(np.add.outer(self._logs, np.log(u)).ravel())
        values = values.reshape(ends.size, u.size, -1)
        distances = np.maximum(h * np.multiply.outer(ends, v), _NEXT_TO_0)
        kernels = kernel(distances) * weights * (h * ends)[:, None]
        inner = np.einsum("kq,kqj->kj", kernels, values)
        # what is left beyond the rule, next to the end
        rest = kernel.integral(np.maximum(h * ends * LEFT_OUT, _NEXT_TO_0))
        inner += self._functions(self._logs) * rest[:, None]
        return (inner @ self._mix) @ self._coefficients

    def _functions(self, log_t, derivative=None):
        """Products of Legendre polynomials; of derivatives in the generator numbered so."""
        product = np.ones((log_t.size, len(self._degrees)))
        for i, (g, degrees) in enumerate(zip(self._generators, self._degrees.T, strict=True)):
            u, highest = np.exp(g * log_t), int(degrees.max())
            x = 2 * ((1 + self.bend) * u / (1 + self.bend * u) if i == 0 else u) - 1
            if i == derivative:
                values = np.array([legval(x, _slope(k)) for k in range(highest + 1)]).T
            else:
                values = legvander(x, highest)
            product *= values[:, degrees]
        return product


def _log(t):
    with np.errstate(divide="ignore"):
        return np.log(np.asarray(t, dtype=float))


def bend_for(generators, size):
    """The bend for a solution whose course takes place where t**g, g the first, is about 1 / size.

    Powers that no step is too small for can do without. One of few values, for bases are kept.
    """
    if generators[0] >= _TINY or size < 2:
        return 0.0
    return 4.0 ** round(math.log(size, 4))


@lru_cache(maxsize=64)
def power_basis(generators, bend=0.0):
    """The basis of these generators, made once."""
    return PowerBasis(generators, bend=bend)


@lru_cache(maxsize=1)
def graded_rule():
    """Points u and 1 - u and weights on [0, 1] for functions that are singular at both ends."""
    x, w = leggauss(16)
    ends = np.concatenate([[LEFT_OUT], 0.5 * 0.25 ** np.arange(25, -1, -1)])
    widths = np.diff(ends)[:, None]
    half = (ends[:-1, None] + widths * (1 + x) / 2).ravel()
    weights = (widths * w / 2).ravel()
    return np.concatenate([half, 1 - half]), np.concatenate([1 - half, half]), np.tile(weights, 2)


@lru_cache(maxsize=64)
def _slope(k):
    """Coefficients of P_k'."""
    return np.polynomial.legendre.legder(np.eye(k + 1)[k]) if k else np.zeros(1)


def _smallest_sums(generators, size):
    """Degrees in each generator of the smallest sums, shape (size, g).

    A tiny generator counts for more than it is, lest its multiples leave no room for the others.
    """
    found = {(0,) * len(generators): 0.0}
    for i, g in enumerate(generators):
        step = np.eye(len(generators), dtype=int)[i]
        for _ in range(size):
            for degrees, e in tuple(found.items()):
                found.setdefault(tuple((degrees + step).tolist()), e + max(g, _TINY))
            found = dict(sorted(found.items(), key=lambda item: item[1])[:size])
    return np.array(list(found))
