"""Messages of functions that lack an argument of `solve`, or of other solvers."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from ..support.checks import refusing
from .solve import OF_OTHERS, solve

_P = ParamSpec("_P")
_R = TypeVar("_R")

# For arguments of `solve`, what a message says to do where another function lacks it.
OF_SOLVE = dict.fromkeys(inspect.signature(solve).parameters, "solve(...) takes it") | {
    "n_steps": "leave it out, and give what this function takes",
    "rtol": "give n_steps",
    "mesh": "give n_steps or rtol",
    "save_every": "select rows of the result",
    "components": "select components of the result",
    "max_step": "name times of jumps and pulses in breaks, where the function takes it",
    "max_steps": "take a larger rtol, or n_steps",
    "events": "solve(equation, t_end, events=...) finds them, also for each point of a sweep",
    "switches": "write a smooth function, such as tanh(x / eps), in place of what jumps",
    "changes": "solve(equation, t_end, changes=...) makes them, also for each point of a sweep",
    "progress": "only longer runs show a bar",
    "resume": "a run begins at t_start; solve(..., resume=...) goes on",
    "params": "pass equation.replace(params=...)",
}


def lacking(default: str = "", **instead: str) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Return a decorator that refuses keywords that a function has no argument for."""
    # a message says what to do `instead`, or, of an argument of `solve`, `default` or `OF_SOLVE`
    others = {} if default else OF_OTHERS
    remedies = {name: default or remedy for name, remedy in OF_SOLVE.items()}
    return refusing(others | remedies | instead)
