"""Files of results: arrays by name and a text of JSON in a compressed .npz file, without pickles.

A state consists of tuples, dicts, numbers, arrays, and objects of a few classes whose attributes
are such again. The text names the class of each object. Only classes of `_DATA`, schemes and
histories are made of a file, so that no code of a file is run.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..collocation.exponential_basis import KernelBasis, PowerLawBasis
from ..collocation.first_rule import Variable
from ..collocation.orbit import OrbitAndTangents
from ..collocation.pieces import FirstPiece, PolynomialPieces
from ..collocation.varying import VaryingBasis
from ..given.first_steps import FirstSteps
from ..given.history.history import History
from ..given.steps import MeshSteps, Span, UniformSteps
from ..kernels.memory_kernel import ExponentialSum, KernelErrors
from ..stepping.dense import StepPieces
from ..stepping.scheme import Scheme
from ..stepping.state import State, check_version
from ..stepping.tolerance import Tolerance
from ..support.checks import complaint, refuse
from .delayed import Remembered

# Classes whose objects are parts of states, beside schemes and histories.
_DATA = (
    State, UniformSteps, MeshSteps, Span, Tolerance, OrbitAndTangents, PowerLawBasis, VaryingBasis,
    KernelBasis, KernelErrors, ExponentialSum, Variable, FirstPiece, PolynomialPieces, StepPieces,
    FirstSteps, Remembered,
)  # fmt: skip
# Begin of the names of arrays that belong to a state.
_STATE = "state"


def write_result(path: str | os.PathLike, arrays: dict[str, Any], text: dict[str, Any]) -> None:
    """Write arrays, those that are not None, and a text of plain values to the file `path`."""
    kept = {name: array for name, array in arrays.items() if array is not None}
    with open(path, "wb") as file:
        np.savez_compressed(file, text=np.array(json.dumps(text)), **kept)


def read_result(path: str | os.PathLike, required: str, made: Callable[[dict, dict], Any]) -> Any:
    """Return ``made(arrays, text)`` of a file of `write_result`; refuse others by `required`."""
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as loaded:
            arrays = {name: loaded[name] for name in loaded.files}
        return made(arrays, json.loads(str(arrays.pop("text"))))
    except (FileNotFoundError, IsADirectoryError, PermissionError):
        raise
    except Exception as error:  # what a damaged or foreign file raises depends on its bytes
        raise ValueError(complaint("path", required, repr(path))) from error


def stored_state(state: State, arrays: dict[str, Any]) -> dict[str, Any]:
    """Return a state as plain values; its arrays are added to `arrays`."""
    # TypeError for what is no array, number or known object, as in a state of a user's history
    return {"version": state.version, "parts": _stored(state, _STATE, arrays)}


def state_from(stored: dict[str, Any], arrays: dict[str, np.ndarray]) -> State:
    """Return the state that `stored_state` described, of this version of the library."""
    check_version(stored["version"])
    return _restored(stored["parts"], arrays)


def take_arrays(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Remove those arrays that belong to a state, and return them."""
    return {name: arrays.pop(name) for name in list(arrays) if name.split(".")[0] == _STATE}


def _stored(part: Any, name: str, arrays: dict[str, Any]) -> Any:
    """Return a part of a state as plain values; add its arrays, named by `name` and a number."""
    # a part that is no plain value becomes a dict whose first key is the kind of the part
    if part is None or type(part) in (bool, int, float, str):
        return part
    if isinstance(part, np.ndarray | np.generic):
        arrays[name] = array = np.asarray(part)
        if array.dtype.hasobject:
            raise TypeError(f"{name} has values of type {array.dtype}")
        return {"array" if isinstance(part, np.ndarray) else "number": name}
    if type(part) in (tuple, list):
        return {
            type(part).__name__: [_stored(p, f"{name}.{k}", arrays) for k, p in enumerate(part)]
        }
    if type(part) is not dict:
        if type(part) not in _classes():
            raise TypeError(f"{name} is a {_name(type(part))}")
        return {"object": _name(type(part)), "of": _stored(_contents(part), name, arrays)}
    return {"dict": {key: _stored(p, f"{name}.{key}", arrays) for key, p in part.items()}}


def _restored(stored: Any, arrays: dict[str, np.ndarray]) -> Any:
    """Return the part of a state that `_stored` described."""
    if not isinstance(stored, dict):
        return stored
    (kind, content), *more = stored.items()
    if kind == "number":
        return arrays[content][()]
    if kind == "array":
        arrays[content].flags.writeable = False
        return arrays[content]
    if kind in ("tuple", "list"):
        parts = [_restored(part, arrays) for part in content]
        return tuple(parts) if kind == "tuple" else parts
    if kind == "dict":
        return {key: _restored(part, arrays) for key, part in content.items()}
    found = [each for each in _classes() if _name(each) == content]
    if not found:
        required, remedy = "be of classes that are imported", "import the module that defines it"
        refuse("resume", required, content, remedy)
    return _made(found[0], _restored(more[0][1], arrays))


def _name(cls: type) -> str:
    return f"{cls.__module__}.{cls.__qualname__}"


def _classes() -> set[type]:
    return {*_DATA, *_subclasses(Scheme), *_subclasses(History)}


def _subclasses(cls: type) -> Iterator[type]:
    each: type
    for each in cls.__subclasses__():
        yield each
        yield from _subclasses(each)


def _contents(part: Any) -> dict[str, Any]:
    """Return the attributes from which an object can be made again."""
    if isinstance(part, tuple):
        return part._asdict()  # type: ignore[attr-defined]
    return part.__getstate__() or {}


def _made(cls: type, contents: dict[str, Any]) -> Any:
    """Return an object with these attributes."""
    if issubclass(cls, tuple):
        return cls(**contents)
    found = object.__new__(cls)
    vars(found).update(contents)
    return found
