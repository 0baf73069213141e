"""Common traits of a run and of one that resumes it (floor 4)."""

import numpy as np

from .._checks import complaint
from ..orders import VaryingOrder

# Shares of the time so far at which a state remembers orders and kernels that are functions.
_LOOKS = np.linspace(0.0, 1.0, 5)
# What another equation may bring where that is meant: the memory does not depend on it.
_CHANGEABLE = ("params", "right-hand side")
# Characters of a value that a message shows.
_SHOWN = 120


def identity(equation, t, n_tangents, **how):
    """Describe what a run to time t must share with one that resumes it, by name.

    Parameters
    ----------
    equation : System
    t : float
    n_tangents : int
    **how
        Scheme, tolerances and the like, in things that can be compared.
    """
    orders, coefficients, kernels = described_terms(equation, t)
    return {
        **how,
        "orders": orders,
        "coefficients": coefficients,
        "kernels": kernels,
        "tangents": n_tangents,
        "y0": equation.y0.tolist(),
        "params": equation.params.tolist(),
        "right-hand side": equation.rhs_digest,
    }


def described_terms(equation, t):
    """Orders, coefficients and kernels of an equation's terms, in things that can be compared.

    Functions have no lasting names: orders and kernels that are some are known by some of their
    values up to time t.
    """
    orders, coefficients = equation.orders.tolist(), [equation.coefficients.tolist()]
    kernels = []
    for term, factors in equation.memories:
        if isinstance(term, VaryingOrder):
            orders.append(term.sampled(_LOOKS * t)[0].tolist())
        else:
            kernels.append((_described(term.kernel, t), term.derivative))
        coefficients.append(factors.tolist())
    return orders, coefficients, kernels


def _described(kernel, t):
    if " at 0x" not in repr(kernel):  # a function's or object's address, which does not last
        return repr(kernel)
    values = kernel(_LOOKS[1:] * t) if t > 0 else np.zeros(0)
    return f"{type(kernel).__name__}, {', '.join(f'{value:.9g}' for value in values)}"


def check_identity(theirs, mine, allow_change):
    """Refuse a state of another run; return whether it is one that was changed on purpose."""
    changed = [name for name in mine if theirs[name] != mine[name]]
    for name in changed:
        if allow_change and name in _CHANGEABLE:
            continue
        remedy = "start anew, or change it back"
        if name in _CHANGEABLE:
            remedy += "; solve(..., allow_change=True) goes on with another, the memory kept"
        required = f"come from a run with the same {name}, here {_short(mine[name])}"
        raise ValueError(complaint("resume", required, _short(theirs[name]), remedy))
    return bool(changed)


def _short(value):
    text = str(value)
    return text if len(text) <= _SHOWN else text[:_SHOWN] + " ..."
