"""Common traits of a run and of one that resumes it."""

from dataclasses import is_dataclass

import numpy as np

from ..support.checks import complaint

# Shares of the time so far at which a state remembers orders and kernels that are functions.
_LOOKS = np.linspace(0.0, 1.0, 5)
# Traits that may change where that is meant: the memory does not depend on them.
_CHANGEABLE = ("params", "right-hand side")
# Characters of a value that a message shows.
_SHOWN = 120


def identity(equation, t, **how):
    """Describe what a run to time t must share with one that resumes it, by name.

    Parameters
    ----------
    equation : System
    t : float
    **how
        Scheme, tolerances and the like, in things that can be compared.
    """
    return {
        **how,
        **described_terms(equation, t),
        "y0": equation.y0.tolist(),
        "t_start": equation.frame.start,
        "params": equation.params.tolist(),
        "right-hand side": equation.rhs_digest,
        "terms": equation.terms_digest,
    }


def described_terms(equation, t):
    """Orders, kernels and coefficients of an equation's terms, in things that can be compared.

    Functions are known by some of their values up to time t.
    """
    left = equation.enlarged.left
    return {
        "orders": [op.described(_LOOKS * t) for op, _ in left if op.kernel is None],
        "coefficients": [coefficients.tolist() for _, coefficients in left],
        "kernels": [op.described(_LOOKS * t) for op, _ in left if op.kernel is not None],
    }


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


def described(description):
    """A frozen dataclass by name and values, whatever number types these have.

    Schemes may be values, too.
    """
    values = {
        key: value if value is None else described(value) if is_dataclass(value) else float(value)
        for key, value in vars(description).items()
    }
    return f"{type(description).__name__}({values})"
