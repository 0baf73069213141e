"""Sums of powers of t for the first step after a singular start.

There the solution is a sum of powers t**e, where e runs over the sums of a few generators g.
Products of Legendre polynomials in the t**g span them without the cancellation of plain powers.

A stiff solution of tiny order changes where t**g is about 1 / c, c the size of its rate, nearly as
1 / (1 + c t**g). Polynomials in the rational map (1 + c) t**g / (1 + c t**g) resolve it. They are
written as 1 / (1 + c t**g) times polynomials, plus a constant, so their rounding errors decay as
they do, and c times them, a right-hand side, is accurate at late times as well as early.
"""

import math
from functools import cached_property, lru_cache
from heapq import heappop, heappush
from operator import mul

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.special import rgamma

from .quadrature import legendre_values

# Singular values below this fraction of the largest are rounding errors of the basis.
_CUT = 1e-14
# A generator below this is tiny and counts as this when functions are chosen. Steps cannot be so
# small that its power becomes small; more functions are used instead.
TINY = 0.12
# Tiny generators have nodes of their own where they are this many times larger than the one before.
_SEPARATE = 30.0
# Number of functions: usually, with a tiny generator, and with several rational maps of it.
_SIZE, _SIZE_IF_TINY, _SIZE_IF_MAPPED = 18, 24, 48
# Weight of the ends where more values are fitted than functions: what steps join is continuous.
_AT_ENDS = 10.0
# Largest number of rational maps, and the least rate that has one.
_MOST_MAPS, _LEAST_RATE = 3, 0.1
# Least distance at which kernels are evaluated.
_NEXT_TO_0 = 1e-300
# Width next to 1 that the graded rule leaves out; kernels are integrated there in closed form.
LEFT_OUT = 0.25**26 / 2


class PowerBasis:
    """Functions on [0, 1] given by their values at nodes that cluster at 0.

    Parameters
    ----------
    generators : tuple of float
        Ascending, above 0.
    size : int, optional
        Number of functions.
    map_rates : tuple of float, optional
        Rates c > 0, descending: rational maps of t**g for the first generator g, one for each rate,
        instead of t**g itself.

    Attributes
    ----------
    nodes, between : ndarray, shape (n,) and (k,)
        The nodes, the first one 0 and the last one 1, and points between them.
    logs : ndarray, shape (n + k,)
        Logarithms of the nodes and then of `between`, valid where these are too small for a float.
    missing : float
        Exponent of the first power of t that the functions leave out.
    """

    def __init__(self, generators, size=None, map_rates=()):
        self._made_of = generators, size, map_rates
        g, n_maps = generators[0], len(map_rates)
        if size is None:
            several = _SIZE_IF_MAPPED if n_maps > 1 else _SIZE_IF_TINY
            size = several if g < TINY else _SIZE
        self.map_rates = map_rates
        self._variables = [(g, c) for c in map_rates or (0.0,)] + [
            (other, 0.0) for other in generators[1:]
        ]
        self._degrees, self.missing = _smallest_sums(self._variables, max(n_maps, 1), size)
        # Functions of several generators are nearly dependent, so they are fitted to twice as many
        # values, at Chebyshev points of several t**g, by logarithms since t may be below any float.
        scales = _scales(self._variables, max(n_maps, 1))
        n = size * min(2, len(generators)) // len(scales)
        # both ends are nodes: extrapolated to t = 0, values of f would grow by thousands
        even, odd = np.linspace(0.0, 1.0, n), (np.arange(n - 1) + 0.5) / (n - 1)
        logs = [
            np.sort(np.concatenate([_inverse_map((1 - np.cos(np.pi * x)) / 2, *v) for v in scales]))
            for x in (even, odd)
        ]
        logs[0] = np.unique(logs[0])  # all variables have t = 0 and t = 1
        self.logs = np.concatenate(logs)
        self.nodes, self.between = np.exp(logs[0]), np.exp(logs[1])
        # late values count for more, to separate decaying functions from constants
        row_weights = (1 + max(map_rates, default=0.0) * np.exp(g * logs[0])) ** 0.7
        if self.nodes.size > size:
            row_weights[[0, -1]] *= _AT_ENDS
        # at the points of the graded rule too: most of a call is overhead
        found = self._functions(np.concatenate([self.logs, _logs_of_rule()]))
        self._at_logs, self._at_points = np.hsplit(found, [self.logs.size])
        functions = self._at_logs[:, : self.nodes.size] * row_weights
        lengths = np.linalg.norm(functions, axis=1)
        u, sizes, v = np.linalg.svd((functions / lengths[:, None]).T, full_matrices=False)
        kept = sizes > _CUT * sizes[0]
        # Two factors, to an orthonormal basis and from values to its coefficients: kept apart, the
        # rounding errors of small singular values meet only the small coefficients they belong to.
        self._mix = v[kept].T / sizes[kept] / lengths[:, None]
        self._coefficients = u[:, kept].T * row_weights

    def __reduce__(self):
        return _basis_of, self._made_of

    def at(self, t):
        """Return the cardinal functions, 1 at one node and 0 at the others, at t (k,); (k, n)."""
        return self._cardinal(self._functions(_log(t)))

    def _cardinal(self, functions):
        """Return the combinations of functions, (size, ...), that are cardinal, (..., n)."""
        return (functions.T @ self._mix) @ self._coefficients

    def interpolate(self, values, t):
        """Interpolate `values` (..., n) at the nodes to the points t, shape (..., k).

        Differences from the last value are interpolated, so that a constant is exact.
        """
        return self._interpolate(values, self.at(t))

    def interpolate_between(self, values):
        """Interpolate `values` (..., n) to the points between the nodes, shape (..., k)."""
        return self._interpolate(values, self._at_between)

    @cached_property
    def _at_between(self):
        """The cardinal functions at the points between the nodes, (k, n)."""
        return self._cardinal(self._at_logs[:, self.nodes.size :])

    @cached_property
    def at_rule(self):
        """The cardinal functions at the points of the graded rule, (k, n)."""
        return self._cardinal(self._at_points[:, :-1])

    @cached_property
    def slopes_at_end(self):
        """Derivatives of the cardinal functions at 1, (n,)."""
        return self.slopes(np.ones(1))[0]

    @staticmethod
    def _interpolate(values, at):
        """Interpolate `values` (..., n) by the cardinal functions `at` k points, (k, n)."""
        end = values[..., -1:]
        return end + (values - end) @ at.T

    def slopes(self, t):
        """Return the derivatives of the cardinal functions, (k, n), possibly infinite at 0."""
        t = np.asarray(t, dtype=float)
        total = np.zeros((len(self._degrees), t.size))
        for i, (g, c) in enumerate(self._variables):
            with np.errstate(divide="ignore", invalid="ignore"):
                inner = 2 * g * t ** (g - 1) * (1 + c) / (1 + c * t**g) ** 2
            varying = self._degrees[:, i] > 0
            total[varying] += inner * self._functions(_log(t), derivative=i)[varying]
        return self._cardinal(total)

    def integrals(self, orders):
        """Return ``J**a`` of the cardinal functions at nodes and between, (n_a, n + k, n)."""
        return np.exp(np.multiply.outer(orders, self.logs))[..., None] * self.means(orders)

    @lru_cache(maxsize=16)  # noqa: B019 (bases are few and kept anyway)
    def means(self, orders):
        """Return ``J**a / t**a`` of the cardinal functions, finite for all t, (n_a, n + k, n)."""
        _, v, rule = graded_rule()
        a = np.array(orders)[:, None]
        # the width that the rule leaves out contributes a power of itself
        weights = rgamma(a) * np.hstack([rule * v ** (a - 1), LEFT_OUT**a / a])
        points = _logs_of_rule()
        if not self.map_rates:
            points, weights = self.logs[: self.nodes.size], self._means_at_end(weights)
        times = np.add.outer(self.logs, points)
        values = self._functions(times.ravel()).reshape(-1, *times.shape)
        return self._cardinal(values @ weights.T)  # from (size, n + k, n_a)

    def _means_at_end(self, weights):
        """Return from weights of the graded rule, (n_a, q), those of the nodes, (n_a, n).

        Both integrate the functions over [0, 1]. Powers of t u are powers of u, so that the rule of
        the nodes serves all t; rational maps are none.
        """
        values, wanted = self._at_logs[:, : self.nodes.size], self._at_points @ weights.T
        found = self._cardinal(wanted)
        return found + self._cardinal(wanted - values @ found.T)  # what rounding has left

    def convolutions(self, kernel, h):
        """Return the convolutions with a kernel K, in steps of length h, (n + k, n).

        Row i is ``int_0^(h t_i) K(h t_i - s) q(s) ds`` from the values of q(h .) at the nodes.
        """
        _, v, weights = graded_rule()
        ends = np.exp(self.logs)
        values = self._functions(np.add.outer(self.logs, _logs_of_rule()[:-1]).ravel())
        values = values.reshape(-1, ends.size, v.size)
        distances = np.maximum(h * np.multiply.outer(ends, v), _NEXT_TO_0)
        kernels = kernel(distances) * weights * (h * ends)[:, None]
        inner = np.einsum("kq,jkq->jk", kernels, values)
        # the width that the rule leaves out
        rest = kernel.integral(np.maximum(h * ends * LEFT_OUT, _NEXT_TO_0))
        inner += self._at_logs * rest
        return self._cardinal(inner)

    def _functions(self, log_t, derivative=None):
        """Return the products of polynomials, (size, k), one variable's differentiated if given."""
        product = np.empty((len(self._degrees), log_t.size))
        highest = self._degrees.max(axis=0).tolist()
        tables = [
            _polynomials(log_t, *variable, degree, i == derivative)
            for i, (variable, degree) in enumerate(zip(self._variables, highest, strict=True))
        ]
        # row by row: arrays of all would take ten times as long to allocate
        for row, degrees in zip(product, self._degrees.tolist(), strict=True):
            row[:] = tables[0][degrees[0]]
            for table, degree in zip(tables[1:], degrees[1:], strict=True):
                row *= table[degree]
        return product


def _polynomials(log_t, g, c, highest, differentiated):
    """Return polynomials in t**g, or its rational map of rate c, of degree up to `highest`.

    The shape is (highest + 1, k). Where c > 0 those above degree 0 are 1 / (1 + c t**g) times
    Legendre polynomials. If `differentiated` the derivatives with respect to 2 t**g - 1 are
    returned.
    """
    u = np.exp(g * log_t)
    decay = 1 / (1 + c * u)
    x = 2 * (1 + c) * u * decay - 1
    degree = highest - 1 if c and highest else highest
    values = legendre_values(x, degree)
    if differentiated:
        slopes = _slopes(values)
        if not c:
            return slopes
        slopes = slopes * decay - values * c / (2 * (1 + c))
        return np.vstack([np.zeros((1, x.size)), slopes])
    return np.vstack([np.ones((1, x.size)), values * decay]) if c else values


def _slopes(values):
    """Return the derivatives of Legendre polynomials from their values, (degree + 1, n)."""
    slopes = np.zeros_like(values)
    slopes[1:2] = 1.0
    for k in range(2, len(values)):
        slopes[k] = slopes[k - 2] + (2 * k - 1) * values[k - 1]
    return slopes


def _scales(variables, n_first):
    """Choose the variables (g, c) whose Chebyshev points are the nodes.

    They are the first variable and, if its generator is tiny, the other tiny ones that are well
    separated, the bound of tiny generators, and the first generator that is not tiny.
    """
    scales, others = variables[:n_first], variables[n_first:]
    if scales[0][0] >= TINY:
        return scales
    is_mapped = scales[0][1] > 0.0  # maps cover the times before those of other variables
    for variable in [] if is_mapped else [v for v in others if v[0] < TINY] + [(TINY, 0.0)]:
        if variable[0] > _SEPARATE * scales[-1][0]:
            scales = [*scales, variable]
    return scales + [v for v in others if v[0] >= TINY][:1]


def _log(t):
    """Return log(t), -inf at 0."""
    with np.errstate(divide="ignore"):
        return np.log(np.asarray(t, dtype=float))


def _inverse_map(w, g, c):
    """Return log(t) where t**g, or its rational map of rate c > 0, equals w."""
    return _log(w / (1 + c * (1 - w))) / g


def choose_map_rates(generators, rates):
    """Choose the rates of the rational maps for components with these rates of decay; often none.

    Only a tiny first generator needs maps: other powers are resolved by small steps. Rates are
    rounded to powers of 2, since bases are cached.
    """
    if generators[0] >= TINY:
        return ()
    found = {2.0 ** round(math.log2(rate)) for rate in rates if rate >= _LEAST_RATE}
    return tuple(sorted(found, reverse=True)[:_MOST_MAPS])


def power_basis(generators, map_rates=()):
    """Return the cached basis of these generators and rational maps."""
    return _kept_basis(generators, map_rates)


@lru_cache(maxsize=64)
def _kept_basis(generators, map_rates):
    """Make the basis of `power_basis`; a default here would be kept twice."""
    return PowerBasis(generators, map_rates=map_rates)


def _basis_of(generators, size, map_rates):
    """Return the basis that these arguments make, the cached one where it is."""
    if size is None:
        return power_basis(generators, map_rates)
    return PowerBasis(generators, size, map_rates)


@lru_cache(maxsize=1)
def graded_rule():
    """Return points u, 1 - u and weights on [0, 1] for integrands singular at both ends."""
    x, w = leggauss(16)
    ends = np.concatenate([[LEFT_OUT], 0.5 * 0.25 ** np.arange(25, -1, -1)])
    widths = np.diff(ends)[:, None]
    half = (ends[:-1, None] + widths * (1 + x) / 2).ravel()
    weights = (widths * w / 2).ravel()
    return np.concatenate([half, 1 - half]), np.concatenate([1 - half, half]), np.tile(weights, 2)


@lru_cache(maxsize=1)
def _logs_of_rule():
    """Return the logarithms of the points of the graded rule, and of 1 behind them."""
    return np.append(np.log(graded_rule()[0]), 0.0)


def _smallest_sums(variables, n_first, size):
    """Return the degrees in each variable of the functions with the smallest exponents.

    The shape is (size, len(variables)); the next exponent is returned too. A tiny generator counts
    as a larger one, so that its multiples leave room for the others. The first `n_first` variables
    stand for one generator, and products of their polynomials count as one polynomial of the
    product's degree.
    """
    weights = [max(g, TINY) for g, _ in variables]

    def total(degrees):
        first = weights[0] * (math.prod(1 + k for k in degrees[:n_first]) - 1)
        return first + sum(map(mul, weights[n_first:], degrees[n_first:]))

    found: list[tuple[int, ...]] = []
    ahead = [(0.0, (0,) * len(variables), 0)]
    while len(found) < size:
        _, degrees, last = heappop(ahead)
        found.append(degrees)
        for i in range(last, len(variables)):  # earlier ones were raised before: each comes once
            more = (*degrees[:i], degrees[i] + 1, *degrees[i + 1 :])
            heappush(ahead, (total(more), more, i))
    return np.array(found), ahead[0][0]
