"""What a run and one that resumes it must have in common (floor 4)."""

import numpy as np

from ..operators import VaryingOrder

# Shares of the time so far at which a state remembers orders that vary.
_LOOKS = np.linspace(0.0, 1.0, 5)


def described_terms(equation, t):
    """Orders and coefficients of an equation's terms up to time t, in things that can be compared.

    Functions have no lasting names: orders that vary are known by some of their values.
    """
    orders, coefficients = equation.orders.tolist(), [equation.coefficients.tolist()]
    for pair in equation.memories:
        term, factors = pair
        varying = isinstance(term, VaryingOrder)
        if varying:
            orders.append(term.sampled(_LOOKS * t)[0].tolist())
        coefficients.append(factors.tolist() if varying else str(pair))
    return orders, coefficients
