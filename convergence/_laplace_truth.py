"""Exact solutions of linear problems with memory, by inverting their Laplace transforms.

``sum_k c_k D^(a_k) y = A y + sum_i f_i (t - t_i)_+**p_i`` for any orders, one row of them a term
and one column a component. With ``M(s) = sum_k diag(c_k s**a_k) - A`` the transform of y is

    Y(s) = M(s)^-1 (sum_k c_k (s**(a_k - 1) y(0) + [a_k > 1] s**(a_k - 2) y'(0)) + F(s)).

Y is summed along a hyperbola that tightens with t, after its poles are split off, in extended
precision if the machine has one. Errors are then near 1e-18 of the solution, also for stiff rates,
tiny orders, multiple poles and all times. `second_opinion` uses mpmath's own inversion in as many
digits as needed, which does not use the poles.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import mpmath
import numpy as np
from scipy.special import gamma

from hereditary import exact

REAL, COMPLEX = np.longdouble, np.clongdouble
# Hyperbola zeta = s t = scale (1 + sin(i theta - 0.8)): steps for 19 digits, ends at exp(-47).
_STEP, _NODES, _SCALES = REAL("0.0435"), 78, (6.0, 7.2, 8.6, 10.3, 12.4)
_THETA = 1j * (np.arange(_NODES) + REAL(0.5)) * _STEP - REAL("0.8")
_ZETA, _WEIGHTS = 1 + np.sin(_THETA), _STEP / REAL(np.pi) * np.cos(_THETA)
# Poles below this times scale / t stay left of it. Moments of a pole are taken on a circle; poles
# nearer than _NEAR, relatively, count as one, whose expansion goes on _BEYOND their number.
_TINY, _CIRCLE, _WIDE = 0.1, 32, 0.25
_NEAR, _SEVERAL, _BEYOND = 5e-3, 0.03, 10
# A lone pole is found, and its moments are taken, on a circle so much smaller than its room.
_LONE = 0.1


@dataclass(frozen=True)
class Force:
    """``amplitudes (t - start)**power`` from `start` on."""

    start: float
    power: float
    amplitudes: tuple[float, ...]


@dataclass(frozen=True)
class Truth:
    """Solution of a linear problem, and its share of every number it starts from.

    Parameters
    ----------
    orders, coefficients : ndarray, shape (n, d)
    matrix : ndarray, shape (d, d)
    start : ndarray, shape (2, d)
        y(0) and y'(0), 0 where no order above 1 needs it.
    forces : sequence of Force
    """

    orders: np.ndarray
    coefficients: np.ndarray
    matrix: np.ndarray
    start: np.ndarray
    forces: Sequence[Force] = ()

    @property
    def d(self):
        """Number of components."""
        return self.matrix.shape[0]

    def __call__(self, t, derivative=0):
        """y or y' at times t of shape (n,), shape (n, d); y' where the highest order is above 1."""
        return self.shares(t, derivative).sum(axis=2)

    def shares(self, t, derivative=0):
        """Columns of y or y': of y(0), of y'(0), and of the components of every force."""
        t, d = np.asarray(t, dtype=float), self.d
        out = np.zeros((t.size, d, (2 + len(self.forces)) * d))
        later = t > 0
        for row in range(derivative, 2):
            out[~later, :, row * d : (row + 1) * d] = np.diag(self.start[row]) * (row == derivative)
        begins = {0.0: [0, 1]}
        for k, force in enumerate(self.forces):
            begins.setdefault(force.start, []).append(2 + k)
        for begin, blocks in begins.items():
            chosen = t > begin
            if chosen.any():
                columns = np.concatenate([np.arange(d) + d * b for b in blocks])
                passed = (t[chosen] - begin).astype(REAL)
                out[np.ix_(chosen, np.arange(d), columns)] = self._inverted(
                    passed, blocks, derivative
                )
        return out

    def _inverted(self, t, blocks, derivative):
        """Their share at times t > 0 since they began, the hyperbola's and the poles'."""
        poles = [(s, self._moments(s, n, room, blocks, derivative)) for s, n, room in self.poles]
        z = np.array([np.exp(s + np.log(t)) for s, *_ in poles]).reshape(len(poles), t.size)
        out = np.empty((t.size, self.d, len(blocks) * self.d))
        far = [np.where(np.abs(z) > _TINY * scale, z, 1e6) for scale in _SCALES]
        gaps = [np.abs(_ZETA * s / f[..., None] - 1) for s, f in zip(_SCALES, far, strict=True)]
        best = np.argmax([g.min(axis=(0, 2), initial=1.0) for g in gaps], axis=0)
        for k in np.unique(best):
            i = np.flatnonzero(best == k)
            for part in np.array_split(i, 1 + i.size // 200):
                own = [(z[j, part], moments) for j, (_, moments) in enumerate(poles)]
                out[part] = self._summed(t[part], own, REAL(_SCALES[k]), blocks, derivative)
        return out

    def _summed(self, t, poles, scale, blocks, derivative):
        zeta = scale * _ZETA
        s = zeta / t[:, None]
        factor = (np.exp(zeta) * _WEIGHTS * scale / zeta)[:, None, None]
        ways = [self._transform(s, way, blocks) for way in ((1, 2) if derivative else (0,))]
        pole_parts, residues = 0.0, 0.0
        for z, moments in poles:
            split = (np.abs(z) > _TINY * scale)[:, None, None, None]
            near = np.where(split[..., 0, 0], z[:, None], 1.0)
            left, power = 1 / (zeta - near), np.ones_like(near)
            grown = np.exp(np.where(z.real < 11000, z, -np.inf))[:, None, None, None]
            for m, moment in enumerate(moments):
                cauchy = (zeta * left * power)[..., None, None, None] * moment
                pole_parts = pole_parts + np.where(split[:, None], cauchy, 0.0)
                share = grown * power[..., None, None] * moment / REAL(gamma(m + 1.0))
                residues = residues + np.where(split, share, 0.0)
                left, power = left / (zeta - near), power * near
        found, sizes = [], []
        for way, values in enumerate(ways):
            rest = (values - pole_parts).reshape(*s.shape, self.d, -1) * factor
            total = rest.sum(axis=1).real + _flat(residues, rest).real
            found.append(total + (self._taylor(blocks) if way else 0.0))
            sizes.append(np.abs(rest).sum(axis=1) + (np.abs(self._taylor(blocks)) if way else 0.0))
        if len(found) == 1:
            return found[0]
        return np.where(sizes[1] < sizes[0], found[1], found[0])

    def _taylor(self, blocks):
        """What y' is besides the transform of what it departs by."""
        columns = np.zeros((self.d, len(blocks), self.d))
        for place, block in enumerate(blocks):
            if block == 1:
                columns[:, place] = np.diag(self.start[1])
        return columns.reshape(self.d, -1)

    def _transform(self, s, way, blocks):
        """``s Y``, ``s**2 Y`` or s**2 times the transform of y - y(0) - y'(0) t, by columns.

        Shape (..., d, len(blocks), d): row, what it comes from, component of that.
        """
        logs, d = np.log(s), self.d
        terms, matrix = self._matrix(logs)
        right = np.zeros((*s.shape, d, len(blocks), d), dtype=COMPLEX)
        y0, v0 = self.start.astype(REAL)
        rates, one = self.matrix.astype(REAL), s[..., None]
        above, i = self.orders > 1, np.arange(d)
        for place, block in enumerate(blocks):
            if block == 0:
                value = terms.sum(axis=-2) * y0
            elif block == 1:
                value = (terms * above).sum(axis=-2) / one * v0
            else:
                force = self.forces[block - 2]
                size = gamma(force.power + 1) * np.array(force.amplitudes, dtype=REAL)
                value = np.exp(-logs * force.power)[..., None] * size
            if way == 2 and block == 0:
                right[..., place, :] = rates * y0 * one[..., None]
            elif way == 2 and block == 1:
                right[..., place, :] = rates * v0
                right[..., i, place, i] -= (terms * ~above).sum(axis=-2) * v0
            else:
                right[..., i, place, i] = value * one if way else value
        return _solved(matrix, right.reshape(*s.shape, d, -1)).reshape(right.shape)

    def _matrix(self, logs):
        """The terms of M and M itself at s."""
        terms = np.exp(logs[..., None, None] * self.orders.astype(REAL))
        terms = terms * self.coefficients.astype(REAL)
        matrix = -self.matrix.astype(COMPLEX) * np.ones_like(logs)[..., None, None]
        i = np.arange(self.d)
        matrix[..., i, i] += terms.sum(axis=-2)
        return terms, matrix

    @cached_property
    def poles(self):
        """Logarithms of poles, how many lie there, and how wide a circle is free around them."""
        groups: list[list] = []
        for z in sorted(self._candidates(), key=lambda z: (z.imag, z.real)):
            if abs(z.imag) < np.pi - 1e-3:
                home = [g for g in groups if min(abs(z - w) for w in g) < _NEAR]
                groups = [g for g in groups if g not in home] + [[z, *chain(*home)]]
        centres = [COMPLEX(np.mean(g)) for g in groups]
        found = []
        for j, (z, group) in enumerate(zip(centres, groups, strict=True)):
            others = [abs(z - w) for k, w in enumerate(centres) if k != j]
            widest = _WIDE if len(group) == 1 else _SEVERAL
            room = min([widest, (np.pi - abs(z.imag)) / 2, *(r / 3 for r in others)])
            if len(group) == 1:
                room *= _LONE
            for _ in range(4 if len(group) == 1 else 0):
                circle = np.exp(2j * np.pi * np.arange(_CIRCLE) / _CIRCLE) * REAL(room)
                inverse = 1 / _determinant(self._matrix(z + np.log1p(circle))[1])
                z = z + np.log1p((inverse * circle**2).mean() / (inverse * circle).mean())
            if abs(z - centres[j]) > 1e-6:
                raise ValueError("poles are too close to each other")
            found.append((z, len(group), REAL(room)))
        return found

    def _candidates(self):
        """Where the determinant of M is 0, in log s, to double precision."""
        a, c, matrix = self.orders, self.coefficients, self.matrix
        if len(a) == 1 and np.ptp(a) == 0 and np.ptp(c) == 0:
            values = np.linalg.eigvals(matrix / c[0, 0]).astype(complex)
            logs = np.log(values[values != 0])
            # above order 1 an eigenvalue may have a pole on either side of the axis
            found = np.concatenate([logs + turn for turn in (-2j * np.pi, 0, 2j * np.pi)]) / a[0, 0]
            return found[np.abs(found.imag) < np.pi]
        if np.array_equal(matrix, np.triu(matrix)):
            parts = [_roots(a[:, i], c[:, i], -matrix[i, i]) for i in range(self.d)]
            return np.concatenate(parts)
        assert self.d == 2
        (a0, a1), (c0, c1) = a[0], c[0]
        coefficients = [c0 * c1, -c0 * matrix[1, 1], -c1 * matrix[0, 0]]
        return _roots([a0 + a1, a0, a1], coefficients, np.linalg.det(matrix))

    def _moments(self, z, n, room, blocks, derivative):
        """Laurent coefficients of Y or s Y around a pole, relative to its size."""
        circle = np.exp(2j * REAL(np.pi) * np.arange(_CIRCLE) / _CIRCLE) * room
        values = self._transform(np.exp(z) * (1 + circle), derivative, blocks)
        values = values / (1 + circle)[:, None, None, None]
        powers = [circle ** (m + 1) for m in range(n if n == 1 else n + _BEYOND)]
        return np.array([(values * p[:, None, None, None]).mean(axis=0) for p in powers])


def _flat(residues, like):
    return residues.reshape(residues.shape[0], like.shape[2], -1) if np.ndim(residues) else residues


def _roots(a, c, rate):
    """Zeros of ``sum c s**a + rate`` in log s off the negative axis; 1 term in closed form."""
    a, c = np.asarray(a, dtype=float)[np.nonzero(c)], np.asarray(c, dtype=float)[np.nonzero(c)]
    if rate == 0 and a.size == 1:
        return np.zeros(0, dtype=complex)
    if a.size == 1:
        first = np.log(complex(-rate / c[0])) / a[0]
        return np.unique([first, first.conjugate()])
    if rate:
        a, c = np.append(a, 0.0), np.append(c, rate)
    distinct, which = np.unique(a, return_inverse=True)
    total = np.bincount(which, weights=c)
    kept = total != 0
    return exact._zeros(exact._Exponentials(distinct[kept], total[kept]))


def _solved(matrix, right):
    """Solutions of many small systems, by elimination with pivots, in any precision.

    Columns are scaled by what the diagonal alone would make of the unknowns, and then rows. With
    other orders in each component they differ by tens of orders.
    """
    d = matrix.shape[-1]
    diagonal = np.abs(matrix[..., np.arange(d), np.arange(d)])
    guess = np.abs(right).max(axis=-1) / np.where(diagonal > 0, diagonal, 1)
    guess = np.maximum(guess, 1e-300 * guess.max(axis=-1, keepdims=True))
    guess = np.where(guess > 0, guess, 1)
    matrix = matrix * guess[..., None, :]
    size = np.abs(matrix).max(axis=-1, keepdims=True)
    matrix, right = matrix / size, right / size
    for k in range(d):
        pivot = k + np.argmax(np.abs(matrix[..., k:, k]), axis=-1)[..., None, None]
        for array in (matrix, right):
            upper = array[..., k : k + 1, :].copy()
            index = np.broadcast_to(pivot, (*pivot.shape[:-1], array.shape[-1]))
            array[..., k : k + 1, :] = np.take_along_axis(array, index, axis=-2)
            np.put_along_axis(array, index, upper, axis=-2)
        for i in range(d):
            if i != k:
                factor = (matrix[..., i, k] / matrix[..., k, k])[..., None]
                matrix[..., i, :] -= factor * matrix[..., k, :]
                right[..., i, :] -= factor * right[..., k, :]
    return guess[..., None] * right / matrix[..., np.arange(d), np.arange(d)][..., None]


def _determinant(a):
    d = a.shape[-1]
    if d == 1:
        return a[..., 0, 0]
    if d == 2:
        return a[..., 0, 0] * a[..., 1, 1] - a[..., 0, 1] * a[..., 1, 0]
    minors = [np.delete(a[..., 1:, :], k, axis=-1) for k in range(d)]
    return sum((-1) ** k * a[..., 0, k] * _determinant(m) for k, m in enumerate(minors))


def second_opinion(truth, t, derivative=0, degree=60):
    """y or y' at one time t > 0, shape (d,), by mpmath's Talbot inversion of the transform.

    `degree` must exceed some three times the largest ``abs(s) t`` of a pole right of the hyperbola.
    """
    out = np.zeros(truth.d)
    for begin in {0.0, *(force.start for force in truth.forces)}:
        passed = mpmath.mpf(t) - mpmath.mpf(begin)
        for i in range(truth.d if passed > 0 else 0):

            def at(s, i=i, begin=begin):
                return _transform_in_digits(truth, s, begin)[i] * s**derivative

            found = mpmath.invertlaplace(at, passed, method="talbot", degree=degree)
            out[i] += float(found)
    return out


def _transform_in_digits(truth, s, begin):
    """Y of what begins at a time, in mpmath's numbers."""
    matrix = mpmath.matrix((-truth.matrix).tolist())
    right = mpmath.matrix(truth.d, 1)
    for i in range(truth.d):
        y0, v0 = (float(x) if begin == 0 else 0.0 for x in truth.start[:, i])
        for a, c in zip(truth.orders[:, i], truth.coefficients[:, i], strict=True):
            power = float(c) * s ** mpmath.mpf(float(a))
            matrix[i, i] += power
            right[i] += power * (y0 / s + (v0 / s**2 if a > 1 else 0))
        for force in truth.forces:
            if force.start == begin:
                p = mpmath.mpf(force.power)
                right[i] += force.amplitudes[i] * mpmath.gamma(p + 1) / s ** (p + 1)
        size = max(abs(matrix[i, j]) for j in range(truth.d))
        matrix[i, :], right[i] = matrix[i, :] / size, right[i] / size
    return mpmath.lu_solve(matrix, right)
