"""States: what a run saves so that another run can resume it, and checks that both runs agree."""

import importlib.metadata
from dataclasses import dataclass, field, is_dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from ..equation.system import System
from ..support.checks import refuse, shown
from .scheme import Scheme

# Times, as fractions of the time reached, at which a state samples orders and kernels that are
# functions, to compare them when a run is resumed.
_SAMPLED_FRACTIONS = np.linspace(0.0, 1.0, 5)
# Entries of `State.identity` that may differ with allow_change=True: the memory does not depend on
# them.
_CHANGEABLE = ("params", "right-hand side")
# Largest number of characters of a value that a message shows.
_MAX_CHARACTERS_SHOWN = 120


@dataclass(frozen=True, eq=False, kw_only=True)
class State:
    """Everything that is needed to resume a run, in read-only arrays; it can be pickled."""

    t: float  # time reached
    y: np.ndarray  # (d,), at t
    scheme: Scheme
    how: Any  # UniformSteps or MeshSteps made so far, or a Tolerance
    history: Any = None  # None with Collocation
    identity: dict[str, Any] = field(repr=False)  # properties checked on resumption, by name
    checkpoint: tuple = field(repr=False)  # the stepper's
    event_signs: dict[str, float] = field(default_factory=dict, repr=False)  # after t
    accurate: "State | None" = field(default=None, repr=False)  # of an accurate run
    version: str = field(default="", repr=False)  # of the library
    layout: list = field(default_factory=list, repr=False)  # shape and type of each array


def go_on_from(state: State | None, stepper: Any, allow_change: bool) -> None:
    """Restore a stepper from a state, if there is one; refuse a solution that is not finite."""
    if state is not None:
        stepper.restore(state, allow_change)
        if not np.all(np.isfinite(stepper.y)):
            refuse("resume", "hold a finite solution", f"y = {shown(stepper.y)}")


def state_of(stepper: Any, scheme: Scheme, how: Any, history: Any = None) -> State:
    """Return the `State` of a stepper that has a method `identity`."""
    state = State(
        t=stepper.t, y=stepper.y, scheme=scheme, how=how, history=history,
        identity=stepper.identity(stepper.t), checkpoint=stepper.checkpoint(),
    )  # fmt: skip
    for array in (state.y, *_arrays(state.checkpoint)):
        array.flags.writeable = False
    return replace(state, version=_version(), layout=layout_of(state))


def _arrays(item: Any) -> list[np.ndarray]:
    """List the arrays in a tuple and in the tuples inside it; ignore objects of other types."""
    if isinstance(item, np.ndarray):
        return [item]
    return [array for each in item for array in _arrays(each)] if isinstance(item, tuple) else []


def check_sound(state: Any) -> None:
    """Refuse a state of another version of the library, or with arrays that have been changed."""
    check_version(getattr(state, "version", "another one"))
    if state.layout != layout_of(state):
        required, got = "be a state as a run left it", "arrays of other shapes or types"
        refuse("resume", required, got, "start anew")


def check_version(version: str) -> None:
    """Refuse a state that another version of the library made."""
    here = _version()
    if version != here:
        required = f"come from the same version of hereditary, here {here}"
        refuse("resume", required, version, "start anew")


def layout_of(state: State) -> list[tuple]:
    """Return the shape and the type of each array of a state that compiled code reads."""
    objects = (tuple(vars(item).values()) for item in state.checkpoint if hasattr(item, "__dict__"))
    arrays = _arrays((state.y, state.checkpoint, *objects))
    return [(array.shape, array.dtype.str) for array in arrays]


@cache
def _version() -> str:
    return importlib.metadata.version("hereditary")


def identity(system: System, t: float, **properties: Any) -> dict[str, Any]:
    """Return the properties of a run to time t that a run must share to resume it, by name."""
    # properties: further ones, such as the scheme and tolerances, in a form that can be compared
    return {
        **properties,
        **described_terms(system, t),
        "y0": system.y0[:, : system.n_solved].tolist(),
        "t_start": system.frame.start,
        "params": system.params.tolist(),
        "right-hand side": system.rhs_digest,
        "terms": system.terms_digest,
    }


def described_terms(system: System, t: float) -> dict[str, list]:
    """Return orders, kernels and coefficients of terms in a form that can be compared."""
    # a function is represented by several of its values up to time t
    left, times = system.left, _SAMPLED_FRACTIONS * t
    return {
        "orders": [op.described(times) for op, _ in left if op.kernel is None],
        "coefficients": [coefficients.tolist() for _, coefficients in left],
        "kernels": [op.described(times) for op, _ in left if op.kernel is not None],
    }


def check_identity(theirs: dict[str, Any], mine: dict[str, Any], allow_change: bool) -> bool:
    """Refuse a state whose identity `theirs` differs from `mine`; return whether it differs."""
    # f and the parameters may differ if `allow_change`
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


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= _MAX_CHARACTERS_SHOWN else text[:_MAX_CHARACTERS_SHOWN] + " ..."


def described(description: Any) -> str:
    """Return a text of a frozen dataclass: its name and its fields, which may be such classes."""
    values = {
        key: value if value is None else described(value) if is_dataclass(value) else float(value)
        for key, value in vars(description).items()
    }
    return f"{type(description).__name__}({values})"
