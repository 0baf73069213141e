"""Functions for the step out of a point where the solution is not smooth (floor 2).

There the solution is a sum of powers t**e, e running over the sums of a few generators g. Products
of Legendre polynomials in the t**g span them without the cancellation that powers suffer from.

A stiff solution of a tiny order takes its course where t**g is about 1 / c, c the size of its rate,
as 1 / (1 + c t**g) nearly. Polynomials in a bent power, (1 + c) t**g / (1 + c t**g), follow it.
They are taken as that function times polynomials, and a constant: so the rounding of what they are
made of fades as they do, and c times them, a right-hand side, is known as well late as early.
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
# Nodes lie at the points of tiny generators that are this many times larger than another.
_FURTHER = 30.0
# How many functions: as a rule, with a tiny generator, and where that is bent in several ways.
_SIZE, _SIZE_IF_TINY, _SIZE_IF_BENT = 18, 24, 48
# At most so many bends, none for drives below this.
_BENDS, _DRIVE = 3, 0.1
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
    bends : tuple of float, optional
        c > 0, descending: bent powers of the first g, one for each, instead of t**g.

    Attributes
    ----------
    nodes, between : ndarray, shape (n,) and (n + 1,)
        The nodes, the last one 1, and points between them, the first one 0.
    logs : ndarray, shape (2 n + 1,)
        Logarithms of the nodes and then of the others, also where these are too small for a float.
    """

    def __init__(self, generators, size=None, bends=()):
        g, n_bent = generators[0], len(bends)
        if size is None:
            several = _SIZE_IF_BENT if n_bent > 1 else _SIZE_IF_TINY
            size = several if g < _TINY else _SIZE
        self.bends = bends
        self._variables = [(g, c) for c in bends or (0.0,)] + [
            (other, 0.0) for other in generators[1:]
        ]
        self._degrees = _smallest_sums(self._variables, max(n_bent, 1), size)
        # Functions of several generators are nearly dependent: twice as many values tame that. They
        # lie at Chebyshev points of several t**g; by logarithms, for t may be no float.
        scales = _scales(self._variables, max(n_bent, 1))
        n = size * min(2, len(generators)) // len(scales)
        even, odd = np.arange(1, n + 1) / n, (np.arange(n) + 0.5) / n
        logs = [
            np.sort(np.concatenate([_unbent((1 - np.cos(np.pi * x)) / 2, *v) for v in scales]))
            for x in (even, odd)
        ]
        logs[0] = np.unique(logs[0])  # t = 1 belongs to all
        logs[1] = np.append(-np.inf, logs[1])  # t = 0 lies between none, but must be right too
        self.logs = np.concatenate(logs)
        self.nodes, self.between = np.exp(logs[0]), np.exp(logs[1])
        # late values count for more, between what fades and what does not
        shares = (1 + max(bends, default=0.0) * np.exp(g * logs[0])) ** 0.7
        functions = self._functions(logs[0]) * shares[:, None]
        lengths = np.linalg.norm(functions, axis=0)
        u, sizes, v = np.linalg.svd(functions / lengths, full_matrices=False)
        kept = sizes > _CUT * sizes[0]
        # an orthonormal basis, and its coefficients from values; kept apart, for the small sizes'
        # rounding errors meet only the small coefficients they belong to
        self._mix = v[kept].T / sizes[kept] / lengths[:, None]
        self._coefficients = u[:, kept].T * shares

    def at(self, t):
        """The functions that are 1 at one node and 0 at the others, at t in [0, 1], (k, n)."""
        return (self._functions(_log(t)) @ self._mix) @ self._coefficients

    def interpolate(self, values, t):
        """Functions given by `values` (..., n) at the nodes, at t, shape (..., k).

        Their differences from the last value are what the basis takes: a constant stays exact.
        """
        return self._interpolate(values, self.at(t))

    def interpolate_between(self, values):
        """Interpolate at the points between the nodes, also at those too small for a float."""
        functions = self._functions(self.logs[self.nodes.size :])
        return self._interpolate(values, (functions @ self._mix) @ self._coefficients)

    @staticmethod
    def _interpolate(values, at):
        end = values[..., -1:]
        return end + (values - end) @ at.T

    def slopes(self, t):
        """Their derivatives, infinite at 0 for powers below 1, shape (k, n)."""
        t = np.asarray(t, dtype=float)
        total = np.zeros((t.size, len(self._degrees)))
        for i, (g, c) in enumerate(self._variables):
            with np.errstate(divide="ignore", invalid="ignore"):
                inner = 2 * g * t ** (g - 1) * (1 + c) / (1 + c * t**g) ** 2
            varying = self._degrees[:, i] > 0
            part = self._functions(_log(t), derivative=i)[:, varying]
            total[:, varying] += inner[:, None] * part
        return (total @ self._mix) @ self._coefficients

    def integrals(self, orders):
        """Their integrals ``J**a`` from 0 to the nodes and between, (len(orders), 2 n + 1, n)."""
        return np.exp(np.multiply.outer(orders, self.logs))[..., None] * self.means(orders)

    @lru_cache(maxsize=16)  # noqa: B019 (bases are few and kept anyway)
    def means(self, orders):
        """These integrals divided by t**a, which no t is too small for."""
        u, v, weights = graded_rule()
        ends = self.logs
        values = self._functions(np.add.outer(ends, np.log(u)).ravel())
        values = values.reshape(ends.size, u.size, -1)
        last = self._functions(ends)
        found = []
        for a in orders:
            # what is left beyond the rule, next to the end, is a power of its width
            inner = np.einsum("q,kqj->kj", weights * v ** (a - 1), values) + last * LEFT_OUT**a / a
            found.append(rgamma(a) * (inner @ self._mix))
        return np.array(found) @ self._coefficients

    def convolutions(self, kernel, h):
        """Convolutions with a kernel K from 0 to the nodes and between, times h, (2 n, n).

        ``int_0^(h t) K(h t - s) q(s) ds`` from the values of q(h .) at the nodes.
        """
        u, v, weights = graded_rule()
        ends = np.exp(self.logs)
        values = self._functions(np.add.outer(self.logs, np.log(u)).ravel())
        values = values.reshape(ends.size, u.size, -1)
        distances = np.maximum(h * np.multiply.outer(ends, v), _NEXT_TO_0)
        kernels = kernel(distances) * weights * (h * ends)[:, None]
        inner = np.einsum("kq,kqj->kj", kernels, values)
        # what is left beyond the rule, next to the end
        rest = kernel.integral(np.maximum(h * ends * LEFT_OUT, _NEXT_TO_0))
        inner += self._functions(self.logs) * rest[:, None]
        return (inner @ self._mix) @ self._coefficients

    def _functions(self, log_t, derivative=None):
        """Products of functions of each power; of derivatives in the one numbered so."""
        product = np.ones((log_t.size, len(self._degrees)))
        for i, (variable, degrees) in enumerate(zip(self._variables, self._degrees.T, strict=True)):
            values = _polynomials(log_t, *variable, int(degrees.max()), i == derivative)
            product *= values[:, degrees]
        return product


def _polynomials(log_t, g, c, highest, differentiated):
    """Polynomials in t**g, bent by c, up to the highest degree, or their derivatives in 2 t**g - 1.

    Where c > 0 those above degree 0 are 1 / (1 + c t**g) times Legendre polynomials.
    """
    u = np.exp(g * log_t)
    fading = 1 / (1 + c * u)
    x = 2 * (1 + c) * u * fading - 1
    degree = highest - 1 if c and highest else highest
    values = legvander(x, degree)
    if differentiated:
        slopes = np.array([legval(x, _slope(k)) for k in range(degree + 1)]).T
        if not c:
            return slopes
        slopes = slopes * fading[:, None] - values * c / (2 * (1 + c))
        return np.hstack([np.zeros((x.size, 1)), slopes])
    return np.hstack([np.ones((x.size, 1)), values * fading[:, None]]) if c else values


def _scales(variables, n_first):
    """Variables that nodes crowd towards 0 with: the first, and, if tiny, more of ever less haste.

    All tiny ones well above each other, what bounds these, and the first that is not tiny.
    """
    scales, others = variables[:n_first], variables[n_first:]
    if scales[0][0] >= _TINY:
        return scales
    bent = scales[0][1] > 0.0  # these reach to where others begin
    for variable in [] if bent else [v for v in others if v[0] < _TINY] + [(_TINY, 0.0)]:
        if variable[0] > _FURTHER * scales[-1][0]:
            scales = [*scales, variable]
    return scales + [v for v in others if v[0] >= _TINY][:1]


def _log(t):
    with np.errstate(divide="ignore"):
        return np.log(np.asarray(t, dtype=float))


def _unbent(w, g, c):
    """log(t) where t**g, or what the bend c makes of it, is w."""
    return np.log(w / (1 + c * (1 - w))) / g


def bends_for(generators, drives):
    """The bends for a solution that is driven, by integrals of the first g, with these strengths.

    Powers that no step is too small for can do without. Of few values, for bases are kept.
    """
    if generators[0] >= _TINY:
        return ()
    found = {2.0 ** round(math.log2(drive)) for drive in drives if drive >= _DRIVE}
    return tuple(sorted(found, reverse=True)[:_BENDS])


@lru_cache(maxsize=64)
def power_basis(generators, bends=()):
    """The basis of these generators, made once."""
    return PowerBasis(generators, bends=bends)


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


def _smallest_sums(variables, n_first, size):
    """Degrees in each variable of the smallest sums, shape (size, variables).

    A tiny generator counts for more than it is, lest its multiples leave no room for the others.
    Products of the first ones, which stand for the same generator, count by what they multiply to.
    """
    weights = np.array([max(g, _TINY) for g, _ in variables])

    def total(degrees):
        first = weights[0] * (math.prod(1 + k for k in degrees[:n_first]) - 1)
        return first + float(weights[n_first:] @ degrees[n_first:])

    found = {(0,) * len(variables): 0.0}
    for i in range(len(variables)):
        step = np.eye(len(variables), dtype=int)[i]
        for _ in range(size):
            for degrees in tuple(found):
                more = tuple((degrees + step).tolist())
                found.setdefault(more, total(more))
            found = dict(sorted(found.items(), key=lambda item: item[1])[:size])
    return np.array(list(found))
