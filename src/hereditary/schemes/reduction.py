"""Symmetric order reduction: order beta in (1, 2] as two equations of order beta/2.

With ``z = x - x(0) - t x'(0)`` and ``w = D^(beta/2) z`` the equation ``c D^beta x = f(t, x)``
becomes ``D^(beta/2) z = w``, ``D^(beta/2) w = f(t, x) / c``, with z(0) = w(0) = 0. Marches remember
increments without t x'(0), so they take x itself for z, with the initial values of x.
Source: [LyuVong2022].
"""

from functools import lru_cache

import numpy as np

from ..compiled.jit import derived
from ..equation.system import System
from ..equation.terms import ConstantOrder, SystemTerm


def reduce_order(system: System, coefficient: float, beta: float) -> System:
    """The system of (x, w), 2 d components, for one whose only term is c D^beta everywhere."""
    d = system.d
    y0 = np.hstack([system.y0, np.zeros((2, d))])
    params = np.append(system.compiled_params, coefficient)
    structure = system.structure and system.structure.with_velocities()
    jac = _pair_jacobian(system.compiled_jac) if system.has_jac and structure is None else None
    left = (SystemTerm(ConstantOrder(beta / 2), np.ones(2 * d)),)
    return System(left, y0, params, _pair(system.compiled_rhs), jac, structure=structure)


@lru_cache(maxsize=64)
def _pair(rhs):
    """The right-hand side of the pair; y is (x, w), params end in c."""

    def pair(t, y, dy, params):
        d = y.shape[0] // 2
        own = params.shape[0] - 1
        rhs(t, y[:d], dy[d:], params[:own])
        for j in range(d):
            dy[j] = y[d + j]
            dy[d + j] /= params[own]

    return derived(pair)


@lru_cache(maxsize=64)
def _pair_jacobian(jac):
    """The Jacobian of the pair."""

    def pair(t, y, out, params):
        d = y.shape[0] // 2
        own = params.shape[0] - 1
        block = np.empty((d, d))
        jac(t, y[:d], block, params[:own])
        out[:] = 0.0
        for i in range(d):
            out[i, d + i] = 1.0
            for j in range(d):
                out[d + i, j] = block[i, j] / params[own]

    return derived(pair)
