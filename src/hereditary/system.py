"""Equations as schemes and marches see them (floor 2), and systems derived from one."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit

from ._jit import JAC_SIG, as_value, kernel
from .kernels.jacobian import jacobian_at
from .memory_kernel import MemoryKernel


@dataclass(frozen=True)
class KernelTerm:
    """The operator ``int_0^t K(t-s) y^(m)(s) ds``; equal to another where kernel and m are.

    Attributes
    ----------
    kernel : MemoryKernel
    derivative : int
        m: 0, 1 or 2.
    """

    kernel: MemoryKernel
    derivative: int

    def later(self, origin: float):
        """Return the term with time counted from `origin`: itself, for it knows no time."""
        return self


class System:
    """A sum of memory terms for each component, equal to a right-hand side.

    `hereditary.Equation` is one, with everything checked; others are derived from it.

    Attributes
    ----------
    orders, coefficients : ndarray, shape (n_terms, d)
        Order and coefficient of each Caputo term of constant order for each component.
    memories : tuple of (KernelTerm or VaryingOrder, ndarray of shape (d,))
        Terms with other kernels or with orders that vary, and their coefficients.
    y0 : ndarray, shape (m, d)
        y(0), and y'(0) where m = 2.
    params : ndarray, shape (p,)
    d, m : int
    has_jac : bool
        Whether the Jacobian is given; otherwise it comes from differences.
    rhs_digest : str
        What tells the user's right-hand side from others, also in another process.
    """

    rhs_digest = ""

    def __init__(self, orders, coefficients, y0, params, rhs, jac=None, memories=()):
        self.orders, self.coefficients = orders, coefficients
        self.memories = tuple(memories)
        self.y0, self._params = y0, params
        self.m, self.d = y0.shape
        self._rhs = rhs
        self.has_jac = jac is not None
        self._jac = jac if self.has_jac else as_value(_no_jacobian, JAC_SIG)

    @property
    def params(self) -> np.ndarray:
        """Parameters of the right-hand side, shape (p,), not to be written to.

        Marches take `_params`: compiled code knows no read-only arrays.
        """
        locked = self._params.view()
        locked.flags.writeable = False
        return locked

    def highest_orders(self) -> np.ndarray:
        """Highest order with a nonzero coefficient of each component, shape (d,).

        Terms with other kernels, or with orders that vary, count as the derivative inside them.
        """
        highest = highest_orders(self.orders, self.coefficients)
        for term, coefficients in self.memories:
            highest = np.maximum(highest, np.where(coefficients != 0, term.derivative, 0.0))
        return highest

    def jacobian(self, t, y):
        """d rhs / d y at (t, y), shape (d, d): the given one, or differences."""
        out = np.empty((self.d, self.d))
        y = np.array(y, dtype=float)
        jacobian_at(self._rhs, self._jac, int(self.has_jac), float(t), y, self._params, out)
        return out


@kernel
def _no_jacobian(t, y, out, params):
    """Stands in for a Jacobian where the user gives none."""


def highest_orders(orders, coefficients):
    """Highest order with a nonzero coefficient of each component, shape (d,)."""
    return np.where(coefficients != 0, orders, 0.0).max(axis=0, initial=0.0)


def variational(system, directions):
    """The system with its linearisation along k directions behind it, d (1 + k) components.

    Parameters
    ----------
    system : System
    directions : ndarray, shape (m, d, k)
        Derivatives of y(0), y'(0) along each direction.

    Returns
    -------
    System
        For plans of schemes, which call its right-hand side from Python; a march takes the one of
        `system`. Since schemes treat all components alike, a scheme applied to it gives the exact
        derivative of the scheme applied to `system`.
    """
    d, k = system.d, directions.shape[2]
    y0 = np.hstack([system.y0, *np.moveaxis(directions, 2, 0)])

    def rhs(t, y, dy, params):
        system._rhs(t, np.ascontiguousarray(y[:d]), dy[:d], params)
        dy[d:] = (y[d:].reshape(k, d) @ system.jacobian(t, y[:d]).T).ravel()

    orders, coefficients = (np.tile(a, (1, 1 + k)) for a in (system.orders, system.coefficients))
    memories = [(term, np.tile(factors, 1 + k)) for term, factors in system.memories]
    return System(orders, coefficients, y0, system._params, rhs, memories=memories)


def shifted(system, origin, y0):
    """Begin a system anew at time `origin`, which becomes its time 0, from `y0` (m, d)."""
    params = np.append(system._params, float(origin))
    jac = _shifted(system._jac) if system.has_jac else None
    terms = system.orders, system.coefficients
    memories = [(term.later(origin), factors) for term, factors in system.memories]
    return System(*terms, y0, params, _shifted(system._rhs), jac, memories)


@lru_cache(maxsize=64)
def _shifted(fun):
    """A right-hand side or Jacobian that reads the origin of time behind its parameters."""

    def later(t, y, out, params):
        own = params.shape[0] - 1
        fun(t + params[own], y, out, params[:own])

    return njit(error_model="numpy", nogil=True)(later)


def first_order(system):
    """A system of integer orders as one of first order: the velocities become components.

    They stand behind the d components, in their order, one for each component of order 2.
    """
    second = system.highest_orders() > 1
    friction, leading, only = (
        np.where(system.orders == order, system.coefficients, 0.0).sum(axis=0) * chosen
        for order, chosen in ((1, second), (2, second), (1, ~second))
    )
    coefficients = np.concatenate([np.where(second, 1.0, only), leading[second]])
    y0 = np.concatenate([system.y0[0], system.y0[-1][second]])
    params = np.concatenate([system._params, second, friction, [system.d]])
    jac = _with_velocities_jacobian(system._jac) if system.has_jac else None
    rhs = _with_velocities(system._rhs)
    enlarged = System(np.ones((1, y0.size)), coefficients[None], y0[None], params, rhs, jac)
    enlarged.rhs_digest = system.rhs_digest
    return enlarged


@lru_cache(maxsize=64)
def _with_velocities(rhs):
    """The right-hand side of the first-order system; params end in masks and frictions (d,), d."""

    def enlarged(t, y, dy, params):
        d = int(params[-1])
        own = params.shape[0] - 2 * d - 1
        rhs(t, y[:d], dy[:d], params[:own])
        k = d
        for j in range(d):
            if params[own + j] == 1.0:
                force = dy[j]
                dy[j] = y[k]
                dy[k] = force - params[own + d + j] * y[k]
                k += 1

    return njit(error_model="numpy", nogil=True)(enlarged)


@lru_cache(maxsize=64)
def _with_velocities_jacobian(jac):
    """Return the Jacobian of `_with_velocities`."""

    def enlarged(t, y, out, params):
        d = int(params[-1])
        own = params.shape[0] - 2 * d - 1
        block = np.empty((d, d))
        jac(t, y[:d], block, params[:own])
        out[:] = 0.0
        k = d
        for j in range(d):
            row = j
            if params[own + j] == 1.0:
                out[j, k] = 1.0
                out[k, k] = -params[own + d + j]
                row = k
                k += 1
            out[row, :d] = block[j]

    return njit(error_model="numpy", nogil=True)(enlarged)
