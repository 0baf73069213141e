"""Symmetric order reduction: order beta in (1, 2] as two equations of order beta/2.

With ``z = x - x(0) - t x'(0)`` and ``w = c D^(beta/2) z`` the equation ``c D^beta x = f(t, x)``
becomes ``D^(beta/2) z = w / c``, ``D^(beta/2) w = f(t, x)``, with z(0) = w(0) = 0. The increments
that a march stores leave out t x'(0). So the first equation is written for x instead of z, with the
initial values of x. Source: [LyuVong2022].
"""

import numpy as np

from ...compiled.functions import mapped
from ...equation.system import System
from ...equation.terms import ConstantOrder, SystemTerm


def reduce_order(system: System, coefficient: float, beta: float) -> System:
    """Return the system of (x, w), 2 d components, for d components whose only term is c D^beta."""
    # coefficient: c
    d = system.d
    y0 = np.hstack([system.y0, np.zeros((2, d))])
    structure = system.structure and system.structure.with_velocities()
    halves = np.c_[np.arange(d), np.arange(d, 2 * d), np.full(d, 1 / coefficient)]
    functions = system.functions if structure is None else system.functions.without_jac()
    left = (SystemTerm(ConstantOrder(beta / 2), np.ones(2 * d)),)
    return System(left, y0, mapped(functions, 2 * d, d, halves), structure=structure)
