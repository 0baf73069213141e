"""Memory as an argument of users' functions, and as further components of a system.

The components of a system are y (d,) and, behind it, memory (k, d) row by row.
"""

from functools import lru_cache

import numpy as np

from .._jit import derived


def split(fun, arity, k):
    """Return a compiled function of y and memory as one of all components; itself for k = 0.

    `arity` counts the arguments besides memory: t and y, with params, or with values and params.
    """
    if k == 0:
        return fun

    def alone(t, z):
        d = z.shape[0] // (1 + k)
        return fun(t, z[:d], z[d:].reshape(k, d))

    def with_params(t, z, params):
        d = z.shape[0] // (1 + k)
        return fun(t, z[:d], z[d:].reshape(k, d), params)

    def in_place(t, z, out, params):
        d = z.shape[0] // (1 + k)
        fun(t, z[:d], z[d:].reshape(k, d), out, params)

    return derived({2: alone, 3: with_params, 4: in_place}[arity])


def paired(fun):
    """Return a function of complex components as one of their real and imaginary parts."""

    def of_parts(t, z, out, params):
        fun(t, z.view(np.complex128), out.view(np.complex128), params)

    return derived(of_parts)


@lru_cache(maxsize=256)
def padded(rhs, k):
    """Return a right-hand side of d values as one of d + k d, those of memory 0."""

    def all_components(t, z, out, params):
        d = z.shape[0] // (1 + k)
        rhs(t, z, out[:d], params)
        for i in range(d, z.shape[0]):
            out[i] = 0.0

    return derived(all_components)


@lru_cache(maxsize=256)
def joined(jac, beside, k):
    """Return the Jacobian of `padded` from those by y, (d, d), and by memory, (d, k d)."""

    def all_components(t, z, out, params):
        n = z.shape[0]
        d = n // (1 + k)
        by_y, by_memory = np.empty((d, d)), np.empty((d, k * d))
        jac(t, z, by_y, params)
        beside(t, z, by_memory, params)
        for i in range(n):
            for j in range(n):
                if i >= d:
                    out[i, j] = 0.0
                else:
                    out[i, j] = by_y[i, j] if j < d else by_memory[i, j - d]

    return derived(all_components)
