"""Floors of the sizes to which errors of components are relative by default.

The size of a component is its largest |y| so far. A component that begins at 0, or next to it, has
none yet, and relative to itself a high power of t or the front of a wave would have to be followed
over all its decades. Until |y| comes near it, a floor counts instead: what the right-hand side f
makes of the component over the run,

    gain * |f|,   1 / gain = sum of a_k / T**alpha_k + max over e != c of sqrt(|J_ce J_ec|),

where integrals of f(t, y(0)) over t replace f, so that fast forces count for little. The size is at
most the one at which f changes by as much. Then the same is done with f at y(0) plus the sizes
found so far. All these sizes have the units of y.
"""

import importlib
from contextlib import suppress

import numpy as np

from ..compiled.adaptive import NEAR
from ..compiled.jit import MAT, VEC, entry
from ..compiled.signatures import RHS

# Times at which forces are evaluated: a pulse of a 200th of the run is to be seen.
_TIMES = 256
# Initial values below this fraction of the largest may be roundings of 0.
_ROUNDED = 1e-12
# Step of differences where y and f are 0.
_LEAST = 1e-90
# Fractions of a size, of which the largest is looked for that causes no more than drives it.
_HALVED = 2.0 ** np.arange(-100, 1)
# Sweeps that balance a Jacobian: one is enough if all components of a kind are alike.
_SWEEPS = 10


def begins_at_rest(y0):
    """Return whether a component begins at 0, or so small that it may be rounding; y0 (d,)."""
    sizes = np.abs(y0)
    return bool(sizes.min() <= _ROUNDED * sizes.max())


def floors_of(system, many, t_end):
    """Return the floors of the sizes of y, (d,), and the number of calls of the right-hand side.

    -1 for components that have a size of their own from the start.

    Parameters
    ----------
    system : System
    many : bool
        Whether to share sizes among components that act upon each other, as those of a partial
        differential equation do; of few components each has its own.
    t_end : float
        Length of the run.
    """
    y0, units = system.y0[0].copy(), np.where(system.units > 0, system.units, _LEAST)
    jacobian = system.derivative(system.beside(0.0, 1), y0, units)
    powers = system.highest_orders()
    # what balances f: the terms over the run, or t**-alpha where kernels or orders vary
    terms = [np.abs(c) * t_end ** -np.asarray(o.order) for o, c in system.left if o.constant]
    balance = np.sum([np.zeros(y0.size), *terms], axis=0)
    balance = np.where(balance > 0, balance, t_end**-powers)
    pairs = abs(jacobian * jacobian.T)
    if not many:
        np.fill_diagonal(pairs, 0.0)
    largest = pairs.max(axis=1)
    rates = np.sqrt(largest if isinstance(largest, np.ndarray) else largest.toarray().ravel())
    rates = np.where(rates < np.inf, rates, 0.0)
    gains = 1 / (balance + rates)
    speeds = np.abs(system.y0[-1]) * (powers > 1)
    forces = _Forces(system)
    made, peaks = _made_over_the_run(forces, y0, t_end, np.ceil(powers))
    by_themselves = np.maximum(np.abs(y0), speeds * gains ** (1 / powers))
    found = np.where(made < np.inf, gains * made, 0.0)
    if many:
        found = _shared(jacobian, np.maximum(by_themselves, found))
    else:
        found = _balanced(forces, 0.5 * t_end, y0, gains, found, peaks, by_themselves)
    # what nothing drives counts from where it would drive others as much as all else does
    sizes = np.maximum(np.abs(y0), found)
    felt = abs(jacobian).T @ np.divide(gains, sizes, out=np.zeros(y0.size), where=sizes > 1e-200)
    alone = (sizes == 0) & (felt > 0) & (felt < np.inf)
    found = np.where(alone, 1 / np.maximum(felt, 1e-300), found)
    return np.where((np.abs(y0) >= NEAR * found) & (found > 0), -1.0, found), forces.calls


def _balanced(forces, t, y0, gains, sizes, peaks, least):
    """Return the sizes, bounded by what drives the components, and raised by the others'."""
    found, rounded = least.copy(), _ROUNDED * np.abs(y0).max()
    for c in np.flatnonzero(sizes > least):
        found[c] = max(least[c], _bounded(forces, t, y0, c, sizes[c], peaks[c]))
    for _ in found:
        before = found.copy()
        for c in np.flatnonzero(np.abs(y0) <= np.maximum(NEAR * found, rounded)):
            others = y0 + found
            others[c] = y0[c]
            drive = abs(forces.at([t], others)[0, c])
            size = _bounded(forces, t, others, c, gains[c] * drive, drive)
            found[c] = size if found[c] <= NEAR * size else found[c]
        if np.array_equal(found, before):
            break
    return found


def _bounded(forces, t, y, c, size, drive):
    """Return the size, at most the given one, at which f_c changes by twice its drive.

    At least |y_c|.
    """
    if not 0 < size < np.inf:
        return abs(y[c])
    sizes = size * _HALVED
    points = np.tile(y, (sizes.size, 1))
    points[:, c] += sizes
    f = forces.at(np.full(sizes.size, t), points)[:, c]
    within = np.flatnonzero(np.abs(f - f[0]) <= 2 * drive)
    return max(abs(y[c]), sizes[within[-1]] if within.size else 0.0)


class _Forces:
    """The right-hand side of a system at many times, and the number of its calls."""

    def __init__(self, system):
        self._system, self.calls = system, 0

    def at(self, times, points):
        """Return f (n, d) at times (n,) and points (n, d); NaN from where it raises an exception.

        The run meets that itself, or does not.
        """
        points = np.array(np.broadcast_to(points, (len(times), self._system.d)), order="C")
        out, self.calls = np.full(points.shape, np.nan), self.calls + len(times)
        with suppress(Exception):
            rhs, *_, params = self._system.compiled
            _forces_at(rhs, params, np.array(times), points, out)
        return out


@entry(RHS, VEC, VEC, MAT, MAT)
def _forces_at(rhs, params, times, points, out):
    """Set out (n, d) to the right-hand side at times (n,) and points (n, d)."""
    for i in range(times.shape[0]):
        rhs(times[i], points[i], out[i], params)


def _made_over_the_run(forces, y0, t_end, times_integrated):
    """Return integrals of f(t, y0), once or twice, over powers of the run, and its peaks."""
    found = forces.at(t_end * (np.arange(_TIMES) + 0.5) / _TIMES, y0)
    found = np.where(np.isfinite(found), found, 0.0)
    once = np.cumsum(found, axis=0) / _TIMES
    integrals = np.where(times_integrated > 1, np.cumsum(once, axis=0) / _TIMES, once)
    return np.abs(integrals).max(axis=0), np.abs(found).max(axis=0)


def _shared(jacobian, sizes):
    """Return the largest size among components that act upon each other, in their units, (d,).

    Units balance rows and columns of the Jacobian J. A component that acts upon none has
    J_ce / J_cc times the size of a component e that acts upon it.
    """
    sparse = importlib.import_module("scipy.sparse")  # whose imports take long
    graphs = importlib.import_module("scipy.sparse.csgraph")
    diagonal, entries = np.abs(jacobian.diagonal()), sparse.coo_array(abs(jacobian))
    kept = (entries.row != entries.col) & (entries.data > 0) & np.isfinite(entries.data)
    rows, columns, values = entries.row[kept], entries.col[kept], entries.data[kept]
    matrix = sparse.coo_array((values, (rows, columns)), entries.shape).tocsc()
    numbers = graphs.connected_components(matrix, connection="strong")[1]
    inside, units = numbers[rows] == numbers[columns], np.ones(sizes.size)
    i, j, size = rows[inside], columns[inside], values[inside]
    for _ in range(_SWEEPS):
        scaled = size * (units[j] / units[i])
        of_rows, of_columns = (np.bincount(k, scaled, units.size) for k in (i, j))
        known = (of_rows > 0) & (of_columns > 0)
        units[known] *= np.sqrt(of_rows[known] / of_columns[known])
    largest = np.zeros(sizes.size)
    np.maximum.at(largest, numbers, sizes / units)
    found = np.maximum(sizes, largest[numbers] * units)
    ahead = np.flatnonzero(found).tolist()
    for e in ahead:  # which grows
        first, end = matrix.indptr[e : e + 2]
        for c, value in zip(matrix.indices[first:end], matrix.data[first:end], strict=True):
            if found[c] == 0 and diagonal[c] > 0:
                found[c] = value / diagonal[c] * found[e]
                ahead.append(c)
    return found
