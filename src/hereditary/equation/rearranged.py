"""Systems whose components are values, derivatives and memory of another one's.

Each of their right-hand sides is a component, or a force of the other system less lower terms.
Numbers that say which stand behind the parameters.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..compiled.jit import allocating, derived, inner


class Tables(NamedTuple):
    """How the components of a system make those of another one, and its forces theirs.

    Attributes
    ----------
    slots : list of (float, float, float)
        Value k that the other right-hand side reads behind its first d is factor times component
        place: (k, factor, place).
    lower : list of (float, float, float)
        Force j is less coefficient times component place: (j, coefficient, place).
    origins : list of float
        What the right-hand side of each component is: the component of this number, or -1 - j for
        force j. Components behind these have none.
    lead : ndarray, shape (d,)
        What forces are divided by.
    n_read : int
        Values that the other right-hand side reads.
    """

    slots: list
    lower: list
    origins: list
    lead: np.ndarray
    n_read: int


def rearranged(tables, params, rhs, jac):
    """Return params, right-hand side, and Jacobian or None, of the system that tables describe."""
    sizes = [len(tables.origins), tables.n_read, tables.lead.size]
    sizes += [len(tables.slots), len(tables.lower)]
    triples = np.ravel([*tables.slots, *tables.lower])
    flat = np.concatenate([triples, tables.origins, tables.lead, sizes])
    return np.concatenate([params, flat]), _right_side(rhs), jac and _jacobian(jac)


def mixed(matrix, params, rhs, jac):
    """Return params, right-hand side, and Jacobian or None, of forces multiplied by a matrix."""
    flat = np.append(matrix.ravel(), matrix.shape[0])
    return np.concatenate([params, flat]), _mixed_side(rhs), jac and _mixed_jacobian(jac)


@lru_cache(maxsize=64)
def _mixed_side(rhs):
    """Right-hand side multiplied by a matrix (d, d) that stands, with d, behind the parameters."""

    def product(t, y, out, params):
        d = int(params[params.shape[0] - 1])
        own = params.shape[0] - d * d - 1
        force = np.empty(d)
        rhs(t, y, force, params[:own])
        for i in range(d):
            out[i] = 0.0
            for k in range(d):
                out[i] += params[own + i * d + k] * force[k]

    return derived(product)


@lru_cache(maxsize=64)
def _mixed_jacobian(jac):
    """Return the Jacobian of `_mixed_side`."""

    def product(t, y, out, params):
        d = int(params[params.shape[0] - 1])
        own = params.shape[0] - d * d - 1
        slopes = np.empty((d, d))
        jac(t, y, slopes, params[:own])
        for i in range(d):
            for j in range(d):
                out[i, j] = 0.0
                for k in range(d):
                    out[i, j] += params[own + i * d + k] * slopes[k, j]

    return derived(product)


@inner
def _parts(params):
    """Numbers of components n and d, and where slots, lower terms, origins and lead begin."""
    end = params.shape[0] - 5
    n, d = int(params[end]), int(params[end + 2])
    lead = end - d
    origins = lead - n
    lower = origins - 3 * int(params[end + 4])
    return n, d, lower - 3 * int(params[end + 3]), lower, origins, lead


@allocating
def _y_and_memory(x, params, d, slots, lower):
    """Return what the user's right-hand side reads: y, and memory behind it."""
    z = np.zeros(int(params[params.shape[0] - 4]))
    for j in range(d):
        z[j] = x[j]
    for i in range(slots, lower, 3):
        z[int(params[i])] = params[i + 1] * x[int(params[i + 2])]
    return z


@lru_cache(maxsize=64)
def _right_side(rhs):
    """Right-hand side of the system; params end in tables, origins, lead and sizes."""

    def all_components(t, x, out, params):
        n, d, slots, lower, origins, lead = _parts(params)
        z = _y_and_memory(x, params, d, slots, lower)
        force = np.empty(z.shape[0])
        rhs(t, z, force, params[:slots])
        for i in range(lower, origins, 3):
            force[int(params[i])] -= params[i + 1] * x[int(params[i + 2])]
        for i in range(n):
            origin = int(params[origins + i])
            if origin < 0:
                out[i] = force[-1 - origin] / params[lead - 1 - origin]
            else:
                out[i] = x[origin]
        for i in range(n, out.shape[0]):
            out[i] = 0.0

    return derived(all_components)


@lru_cache(maxsize=64)
def _jacobian(jac):
    """Return the Jacobian of `_right_side`."""

    def all_components(t, x, out, params):
        n, d, slots, lower, origins, lead = _parts(params)
        z = _y_and_memory(x, params, d, slots, lower)
        n_all = out.shape[0]
        block, force = np.empty((z.shape[0], z.shape[0])), np.zeros((d, n_all))
        jac(t, z, block, params[:slots])
        for j in range(d):
            for k in range(d):
                force[j, k] = block[j, k]
            for i in range(slots, lower, 3):
                force[j, int(params[i + 2])] += params[i + 1] * block[j, int(params[i])]
        for i in range(lower, origins, 3):
            force[int(params[i]), int(params[i + 2])] -= params[i + 1]
        for i in range(n):
            origin = int(params[origins + i])
            for k in range(n_all):
                if origin < 0:
                    out[i, k] = force[-1 - origin, k] / params[lead - 1 - origin]
                else:
                    out[i, k] = 1.0 if k == origin else 0.0
        for i in range(n, n_all):
            for k in range(n_all):
                out[i, k] = 0.0

    return derived(all_components)
