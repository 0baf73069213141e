"""States that a run leaves and another goes on from, and what both runs have in common."""

import importlib.metadata
from dataclasses import dataclass, field, is_dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from ..support.checks import refuse
from .scheme import Scheme

# Shares of the time so far at which a state remembers orders and kernels that are functions.
_LOOKS = np.linspace(0.0, 1.0, 5)
# Traits that may change where that is meant: the memory does not depend on them.
_CHANGEABLE = ("params", "right-hand side")
# Characters of a value that a message shows.
_SHOWN = 120


@dataclass(frozen=True, eq=False, kw_only=True)
class State:
    """Everything a run needs to go on, in arrays that cannot be changed; it pickles.

    Attributes
    ----------
    t : float
        Time reached.
    y : ndarray, shape (d,)
        Solution at `t`.
    scheme : Scheme
        How the run was made, and how it goes on.
    identity : dict
        Terms, right-hand side and more, by name; checked on resuming, as `version` and `layout`.
    march : tuple
    event_signs : dict
        Sign of each event function just after `t`, by its digest.
    version : str
        Version of the library.
    layout : list
        Shapes and types of the arrays.
    """

    t: float
    y: np.ndarray
    scheme: Scheme
    identity: dict[str, Any] = field(repr=False)
    march: tuple = field(repr=False)
    event_signs: dict[str, float] = field(default_factory=dict, repr=False)
    version: str = field(default="", repr=False)
    layout: list = field(default_factory=list, repr=False)


@dataclass(frozen=True, eq=False, kw_only=True)
class GivenState(State):
    """State of a run on given steps.

    Attributes
    ----------
    n : int
        Steps made.
    steps : UniformSteps or MeshSteps
        Steps made, and of uniform ones all others.
    history : History
    """

    n: int
    steps: Any
    history: Any
    block: int = field(repr=False)
    memory: tuple = field(repr=False)
    memory_steps: Any = field(repr=False)
    watched: tuple[float, int] = field(repr=False)

    @property
    def h(self) -> float:
        """Step of uniform ones; 0 on a mesh [time]."""
        return self.steps.h


@dataclass(frozen=True, eq=False, kw_only=True)
class AdaptiveState(State):
    """State of a run whose steps are chosen by tolerances: rtol, atol, and that of the modes."""

    rtol: float
    atol: float | tuple[float, ...] | None
    modes_tol: float = field(repr=False)
    orbit: Any = field(repr=False)
    at_singular_start: bool = field(repr=False)


def complete(state):
    """Return the state, whose arrays cannot be changed, with the library's version and layout."""
    for array in (state.y, *state.march, *getattr(state, "memory", ())):
        array.flags.writeable = False
    return replace(state, version=_version(), layout=_layout(state))


def check_sound(state):
    """Refuse a state of another version, or with other arrays than those that a run left."""
    here, version = _version(), getattr(state, "version", "another one")
    if version != here:
        required = f"come from the same version of hereditary, here {here}"
        refuse("resume", required, version, "start anew")
    if state.layout != _layout(state):
        required, got = "be a state as a run left it", "arrays of other shapes or types"
        refuse("resume", required, got, "start anew")


def check_reach(state, t_end):
    """Refuse a run beyond what the modes of an `AdaptiveState` hold."""
    reached = state.orbit.farthest
    if reached and t_end > reached:
        required = f"stay within t = {reached}, the end of its history"
        remedy = f"begin the run with Collocation(horizon={t_end}), or with the end of later runs"
        refuse("resume", required, f"a run to {t_end}", remedy)


def _layout(state):
    """Return the shape and the type of each array that compiled code is going to read."""
    parts = state.memory if isinstance(state, GivenState) else vars(state.orbit).values()
    arrays = state.y, *state.march, *(part for part in parts if isinstance(part, np.ndarray))
    return [(array.shape, array.dtype.str) for array in arrays]


@cache
def _version():
    return importlib.metadata.version("hereditary")


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
    """Return orders, kernels and coefficients of terms in a form that can be compared.

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
        remedy = "start again, or change it back"
        if name in _CHANGEABLE:
            remedy += "; solve(..., allow_change=True) accepts another and keeps the memory"
        required = f"come from a run with the same {name}, here {_short(mine[name])}"
        refuse("resume", required, _short(theirs[name]), remedy)
    return bool(changed)


def _short(value):
    text = str(value)
    return text if len(text) <= _SHOWN else text[:_SHOWN] + " ..."


def described(description):
    """Return a description of a frozen dataclass: its name and its values.

    Schemes may be values, too.
    """
    values = {
        key: value if value is None else described(value) if is_dataclass(value) else float(value)
        for key, value in vars(description).items()
    }
    return f"{type(description).__name__}({values})"
