"""States that a run leaves and another goes on from."""

import importlib.metadata
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, ClassVar

import numpy as np

from ..history.history import History
from ..schemes.scheme import Scheme
from ..schemes.steps import MeshSteps, Span, UniformSteps
from ..support.checks import complaint


@dataclass(frozen=True, eq=False)
class State:
    """Everything a run needs to go on, in arrays that cannot be changed; it pickles.

    Attributes
    ----------
    t : float
        Time reached.
    n : int
        Steps made.
    steps : UniformSteps or MeshSteps
        Steps made, and of uniform ones all others.
    y : ndarray, shape (d,)
        Solution at `t`.
    scheme, history : Scheme, History
        How the run was made, and how it goes on.
    identity : dict
        Terms, right-hand side and more, by name; checked on resuming, as the next two are.
    event_signs : dict
        Sign of each event function just after its last zero, by its digest.
    version : str
        Version of the library.
    layout : list
        Shapes and types of the arrays.
    """

    adaptive: ClassVar[bool] = False
    t: float
    n: int
    steps: UniformSteps | MeshSteps
    y: np.ndarray
    scheme: Scheme
    history: History
    identity: dict[str, Any] = field(repr=False)
    block: int = field(repr=False)
    march: tuple = field(repr=False)
    memory: tuple = field(repr=False)
    memory_steps: int | Span = field(repr=False)
    watched: tuple[float, int] = field(repr=False)
    event_signs: dict[str, float] = field(default_factory=dict, repr=False)
    version: str = field(default="", repr=False)
    layout: list = field(default_factory=list, repr=False)

    @property
    def h(self) -> float:
        """Step of uniform ones; 0 on a mesh [time]."""
        return self.steps.h


@dataclass(frozen=True, eq=False)
class AdaptiveState:
    """Everything an adaptive run needs to go on; it pickles.

    Attributes
    ----------
    t : float
        Time reached.
    y : ndarray, shape (d,)
        Solution at `t`.
    scheme : Collocation
    rtol, atol, modes_tol : float
        How the run was made, and how it goes on.
    event_signs : dict
        Sign of each event function just after `t`, by its digest.
    identity : dict
        Terms, right-hand side and more, by name; checked on resuming, as the next two are.
    version : str
        Version of the library.
    layout : list
        Shapes and types of the arrays.
    """

    adaptive: ClassVar[bool] = True
    t: float
    y: np.ndarray
    scheme: Scheme
    rtol: float
    atol: float | None
    modes_tol: float = field(repr=False)
    identity: dict[str, Any] = field(repr=False)
    march: tuple = field(repr=False)
    orbit: Any = field(repr=False)
    at_singular_start: bool = field(repr=False)
    event_signs: dict[str, float] = field(default_factory=dict, repr=False)
    version: str = field(default="", repr=False)
    layout: list = field(default_factory=list, repr=False)


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
        raise ValueError(complaint("resume", required, version, "start anew"))
    if state.layout != _layout(state):
        required, got = "be a state as a run left it", "arrays of other shapes or types"
        raise ValueError(complaint("resume", required, got, "start anew"))


def check_reach(state, t_end):
    """Refuse a run beyond what the modes of an `AdaptiveState` hold."""
    reached = state.orbit.farthest
    if reached and t_end > reached:
        required = f"stay within t = {reached}, as far as its history reaches"
        remedy = f"begin the run with Collocation(horizon={t_end})"
        raise ValueError(complaint("resume", required, f"a run to {t_end}", remedy))


def _layout(state):
    """Return the shape and the type of each array that compiled code is going to read."""
    parts = state.memory if isinstance(state, State) else vars(state.orbit).values()
    arrays = state.y, *state.march, *(part for part in parts if isinstance(part, np.ndarray))
    return [(array.shape, array.dtype.str) for array in arrays]


@cache
def _version():
    return importlib.metadata.version("hereditary")
