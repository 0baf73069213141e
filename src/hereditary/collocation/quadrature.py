"""Quadrature of collocation steps: Radau nodes, their polynomials, exact fractional integrals.

A step has s nodes. Node polynomial l_j is 1 at node j, 0 at the other nodes, of degree s - 1.
``J**a`` is the fractional integral of order a from the start of the step, whose length is 1.
"""

from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre as leg
from scipy.special import rgamma, roots_jacobi

from ..compiled.jit import MAT, VEC, checked, entry
from .structures import Rule

# Number of Chebyshev orders a at which the integrals J**a are tabulated. Between these orders the
# integrals, entire functions of a, are interpolated.
_N_ORDERS = 24


@lru_cache(maxsize=16)
def radau_nodes(s: int) -> np.ndarray:
    """Return the right Radau points on (0, 1], zeros of P_s - P_(s-1); the last one is 1."""
    difference = np.zeros(s + 1)
    difference[s], difference[s - 1] = 1.0, -1.0
    x = np.sort(leg.legroots(difference).real)
    derivative = leg.legder(difference)
    for _ in range(3):
        x = x - leg.legval(x, difference) / leg.legval(x, derivative)
    nodes = (1 + x) / 2
    nodes[-1] = 1.0
    return _frozen(nodes)


@lru_cache(maxsize=16)
def to_legendre(s: int) -> np.ndarray:
    """Return the matrix from values at the nodes to shifted Legendre coefficients, (s, s)."""
    return _frozen(np.linalg.inv(leg.legvander(2 * radau_nodes(s) - 1, s - 1)))


@lru_cache(maxsize=256)
def radau_integrals(s: int, a: float) -> np.ndarray:
    """Return the integrals ``J**a l_j`` of the node polynomials at each node, (s, s)."""
    return _frozen(integrals_of_rows(s, np.full(s, a)))


def integrals_of_rows(s: int, a: np.ndarray) -> np.ndarray:
    """Return the integrals of the node polynomials at the nodes, (..., s, s), with orders a."""
    # a (..., s): an order in [0, 1] for each node, to which the integral extends
    means = np.einsum("...ik,kij->...ij", _towards(a), _tabulated(s))
    return radau_nodes(s)[:, None] ** a[..., None] * means


def _towards(a: np.ndarray) -> np.ndarray:
    """Return the weights, (..., 24), that interpolate from the 24 Chebyshev orders to orders a."""
    orders, barycentric = _chebyshev_orders()
    gaps = a[..., None] - orders
    coincides = gaps == 0.0
    fractions = barycentric / (gaps + coincides)
    if coincides.any():
        fractions = np.where(coincides.any(axis=-1, keepdims=True), coincides, fractions)
    return fractions / fractions.sum(axis=-1, keepdims=True)


@lru_cache(maxsize=1)
def _chebyshev_orders() -> tuple[np.ndarray, np.ndarray]:
    """Return the 24 Chebyshev orders in [0, 1], and their weights for barycentric interpolation."""
    k = np.arange(_N_ORDERS)
    orders = (1 - np.cos(np.pi * (k + 0.5) / _N_ORDERS)) / 2
    return _frozen(orders), _frozen((-1.0) ** k * np.sin(np.pi * (k + 0.5) / _N_ORDERS))


@lru_cache(maxsize=16)
def _tabulated(s: int) -> np.ndarray:
    """Return ``J**a l_j / t**a`` at the nodes t for the 24 Chebyshev orders a, (24, s, s)."""
    nodes = radau_nodes(s)
    orders, _ = _chebyshev_orders()
    means = [polynomial_integrals(s, a, nodes) / nodes[:, None] ** a for a in orders]
    return _frozen(np.array(means))


@lru_cache(maxsize=256)
def rule_of(s: int, orders: tuple[float, ...]) -> Rule:
    """Return the `Rule` of s nodes with fractional integrals of these orders; the last one is 1."""
    singular = integrals_of_rows(s, np.repeat(np.array(orders)[:, None], s, axis=1))
    matrices = radau_nodes(s), singular, to_legendre(s), _slopes(s)
    parts = *matrices, *check_points(s), (1.0, 1.0, 0.0)
    return checked(Rule(*(np.array(part) for part in parts)))


@lru_cache(maxsize=16)
def _slopes(s: int) -> np.ndarray:
    """Return the inverse of the integrals of order 1, (s, s): to slopes of polynomials from 0."""
    return _frozen(np.linalg.inv(radau_integrals(s, 1.0)))


def polynomial_integrals(s: int, a: float, ends: np.ndarray) -> np.ndarray:
    """Return ``J**a l_j`` at k points `ends` in [0, 1], (k, s), for the node polynomials l_j."""
    # By parts, J**a l(c) = c**a / Gamma(a+1) (l(0) + int_0^1 (1-u)**a c l'(c u) du). The weight
    # (1-u)**a is bounded also as a tends to 0, and the Gauss-Jacobi rule is exact.
    coefficients = to_legendre(s)
    slopes = 2 * leg.legder(coefficients, axis=0)
    x, weights = roots_jacobi(s // 2 + 1, a, 0.0)
    u, weights = (1 + x) / 2, weights / 2 ** (a + 1)
    ends = np.asarray(ends, dtype=float)
    at = np.multiply.outer(ends, u)
    values = np.moveaxis(leg.legval(2 * at - 1, slopes), 0, -1)  # (k, nodes, s)
    inner = ends[:, None] * np.einsum("q,kqj->kj", weights, values)
    start = leg.legval(-1.0, coefficients)
    return ends[:, None] ** a * rgamma(a + 1) * (start + inner)


@lru_cache(maxsize=16)
def shortened_legendre(s: int) -> np.ndarray:
    """Return matrices from q at the nodes c_i to Legendre coefficients of q(c_i u), (s, s, s)."""
    # the first axis is that of node i
    nodes, transform = radau_nodes(s), to_legendre(s)
    return np.array(
        [transform @ leg.legvander(2 * c * nodes - 1, s - 1) @ transform for c in nodes]
    )


@lru_cache(maxsize=16)
def through_start(s: int) -> np.ndarray:
    """Return the matrix from values at 0 and the Radau points to shifted Legendre coefficients."""
    points = np.concatenate([[0.0], radau_nodes(s)])
    return _frozen(np.linalg.inv(leg.legvander(2 * points - 1, s)))


@lru_cache(maxsize=16)
def check_points_of(s: int) -> np.ndarray:
    """Return the points of a step, besides its nodes, at which f is checked, (2,)."""
    ends = np.concatenate([[0.0], radau_nodes(s)])
    # of all midpoints between nodes, this one shows most often that a solution slides along a jump
    return _frozen(np.array([0.0, ends[s - 2 : s].mean()]))


@lru_cache(maxsize=16)
def check_points(s: int) -> tuple[np.ndarray, ...]:
    """Return points off the nodes, and the integrals and values of the node polynomials there."""
    # points (2,): the start, and the middle of the last node but two and the last but one; matrices
    # (2, s) from nodal values to integrals from the start, and to values
    points = check_points_of(s)
    values_there = leg.legvander(2 * points - 1, s - 1) @ to_legendre(s)
    found = points, polynomial_integrals(s, 1.0, points), values_there
    return tuple(_frozen(np.ascontiguousarray(array)) for array in found)


def legendre_values(x: np.ndarray, degree: int) -> np.ndarray:
    """Return Legendre polynomials P_0 .. P_degree at x (n,), (degree + 1, n), exact at -1 and 1."""
    values = np.ones((degree + 1, x.size))
    values[1:2] = x
    _go_up(x, values)
    return values


@entry(VEC, MAT, allocates=False)
def _go_up(x: np.ndarray, values: np.ndarray) -> None:
    """Fill rows 2 to n - 1 of `values` (n, k), Legendre polynomials at x (k,), from the first."""
    # NumPy takes 50 us, mostly for calls, for the 24 nodes of a first step
    for k in range(2, values.shape[0]):
        ratio = (k - 1) / k
        for i in range(x.shape[0]):
            product = x[i] * values[k - 1, i]
            values[k, i] = (product - values[k - 2, i]) * ratio + product


def _frozen(array: np.ndarray) -> np.ndarray:
    """Return the array, made read-only."""
    array.flags.writeable = False
    return array
